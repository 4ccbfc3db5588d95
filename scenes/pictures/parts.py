"""The drawing of a mechanism as data: strokes and labels, each fixed to what it moves with.

`stiction.scenes.pictures.mechanism` draws them with matplotlib, ``browser/player.js`` in a browser.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from stiction.scenes.fields import GROUND
from stiction.scenes.laws import evaluate_law
from stiction.scenes.model import Drive, Force, LinearSpring, Revolute, Scene, Translational
from stiction.scenes.pictures.geometry import (
    AXIS_ARROW,
    LOAD_ARROW,
    Point,
    Poses,
    View,
    attachments,
    axes_along,
    box,
    link_ends,
    unit_vector,
)

MOST_NAMES = 12
"""Bodies up to which each has its name next to it."""
SOLID = 0.8
"""Symbols: how thick the solid behind a surface is drawn."""
COILS = 6

Place = tuple[str, Point]
"""A body and a point in its axes, m."""


@dataclass(frozen=True)
class Look:
    """Style of a stroke: names of colours (none: not drawn), width in points; what is filled is closed."""

    line: str = "ink"
    fill: str = ""
    width: float = 0.8
    hatched: bool = False
    arrow: str = ""
    """``"end"``, ``"both"`` or none"""


LOOKS = {
    "ground": Look("", "paper", hatched=True),
    "moving guide": Look("", "body"),
    "surface": Look(),
    "slider": Look(fill="shade", width=0.9),
    "support": Look(fill="paper"),
    "foot": Look(width=1.2),
    "spring anchor": Look("spring", width=1.2),
    "plate": Look(fill="body"),
    "edge": Look(width=4.5),
    "bar": Look("body", width=3.0),
    "centre": Look(width=0.7),
    "spring": Look("spring", width=1.0),
    "drive": Look("drive", width=1.5, arrow="both"),
    "turning drive": Look("drive", width=1.5, arrow="end"),
    "pin": Look(fill="paper", width=1.0),
    "load": Look("load", width=1.8, arrow="end"),
    "turning load": Look("load", width=1.5, arrow="end"),
    "corner force": Look("corner", width=1.2, arrow="end"),
    "gravity": Look(arrow="end"),
}

_TURNS = np.linspace(0.0, 4 * np.pi, 60)


def _around(angles: np.ndarray) -> np.ndarray:
    return np.column_stack([np.cos(angles), np.sin(angles)])


CIRCLE, ARC = (
    _around(np.linspace(0.0, 2 * np.pi, 25)[:-1]),
    _around(np.linspace(-0.4 * np.pi, 1.1 * np.pi, 40)),
)
SPIRAL = (0.6 + 0.25 * _TURNS / np.pi)[:, None] * _around(_TURNS)
TRIANGLE, FOOT = (
    np.array([(0.0, 0.0), (-0.8, -1.2), (0.8, -1.2)]),
    np.array([(-1.2, -1.2), (1.2, -1.2)]),
)
CROSS = np.array([[(-1, 0), (1, 0)], [(0, -1), (0, 1)]])
ANCHOR = np.array([[(-0.5, -0.5), (0.5, 0.5)], [(-0.5, 0.5), (0.5, -0.5)]])
PISTON = np.array(
    [
        [(0.0, 0.0), (0.45, 0.0)],
        [(0.45, -0.5), (0.45, 0.5)],
        [(0.65, -0.7), (0.35, -0.7)],
        [(0.65, 0.7), (0.35, 0.7)],
        [(0.65, -0.7), (0.65, 0.7)],
        [(0.65, 0.0), (1.0, 0.0)],
    ]
)
"""Symbols, in units of their size; of the piston first the share of the way."""


@dataclass(frozen=True)
class Stroke:
    """A line or an area, m, points of shape (n, 2); its origin is a point of a body, it turns with `axes`."""

    look: str
    points: np.ndarray
    at: Place
    axes: str = GROUND
    sign: tuple[str, int] | None = None
    """A load and its sign, -1 or 1, at which it is drawn"""

    def place(self, poses: Poses) -> np.ndarray:
        """Return the points in ground axes; shape (n, 2)."""
        return poses[self.at[0]].place(self.at[1]) + poses[self.axes].turn(self.points)


@dataclass(frozen=True)
class Link:
    """A line between two points of bodies, as of a spring or a drive.

    Each of its points, shape (n, 2), has the share of the way from the second to the first, and m across it.
    """

    look: str
    points: np.ndarray
    bodies: tuple[str, str]
    ends: tuple[Point, Point]
    axis: Point | None

    def place(self, poses: Poses, unit: float) -> np.ndarray:
        """Return the points in ground axes; shape (n, 2).

        One with an axis that is shorter than a symbol shows where it leads to.
        """
        first, second = link_ends(self.bodies, self.ends, self.axis, poses)
        if np.hypot(*(first - second)) < unit and self.axis is not None and LOOKS[self.look].arrow:
            first = second + AXIS_ARROW * unit * unit_vector(poses[self.bodies[1]].turn(self.axis))
        way = first - second
        across = np.array([-way[1], way[0]]) / (np.hypot(*way) or 1.0)
        return second + self.points @ np.array([way, across])


@dataclass(frozen=True)
class Label:
    """A word at a point, m, whose origin and axes are those of a `Stroke`."""

    text: str
    point: Point
    at: Place
    axes: str = GROUND

    def place(self, poses: Poses) -> np.ndarray:
        """Return the point in ground axes; shape (2,)."""
        return poses[self.at[0]].place(self.at[1]) + poses[self.axes].turn(self.point)


@dataclass(frozen=True)
class CornerForce:
    """The arrow of a column of corner forces, N: it ends at the corner, where it pushes to."""

    guide: str
    number: int
    corner: Point
    direction: Point
    at: Place
    axes: str

    @property
    def column(self) -> str:
        return f"{self.guide}.F{self.number}"

    def place(self, poses: Poses, length: float) -> np.ndarray:
        """Begin and end, in ground axes; shape (2, 2)."""
        end = poses[self.at[0]].place(self.at[1]) + poses[self.axes].turn(self.corner)
        return np.array([end - length * poses[self.axes].turn(self.direction), end])


Part = Stroke | Link | Label | CornerForce


def parts(scene: Scene, view: View) -> Iterator[Part]:
    """Yield all of the drawing, what lies below first."""
    held, sliders = attachments(scene), {guide.slider for guide in scene.guides.values()}
    yield from _guides(scene, view)
    for name in scene.bodies:
        yield from _body(
            name, [*held[name], *_holds(scene, name, view)], view.unit, name in sliders
        )
    yield from _supports(scene, view.unit)
    yield from _springs(scene, view.unit)
    for drive in scene.drives.values():
        yield _drive(scene, drive, view.unit)
    for joint in scene.joints.values():
        if isinstance(joint, Revolute):
            yield Stroke("pin", 0.25 * view.unit * CIRCLE, (joint.bodies[0], joint.points[0]))
    yield from _loads(scene, view.unit)
    yield from _corners(scene, view.unit)
    if len(scene.bodies) <= MOST_NAMES:
        yield from _names(scene, view.unit)
    if scene.gravity is not None and np.hypot(*scene.gravity) > 0:
        down = unit_vector(scene.gravity)
        begin = (
            GROUND,
            np.array([view.x[1], view.y[1]]) - view.unit * (1.5 + 2.0 * np.maximum(down, 0)),
        )
        yield Stroke("gravity", np.array([(0.0, 0.0), 2 * view.unit * down]), begin)
        yield Label("g", view.unit * (down + [-1.2, 0.0]), begin)


def slider_size(scene: Scene, name: str, unit: float) -> tuple[float, float]:
    """Length and width of a slider as drawn, m; what is not declared is some symbols."""
    guide = scene.guides[name]
    length = guide.length or 3 * unit
    return length, guide.width or length * (0.4 if guide.width is None else 0.02)


def _guides(scene: Scene, view: View) -> Iterator[Stroke]:
    """Two surfaces with the solid behind them, hatched where it is the ground; then sliders; then what these guide."""
    for names in _from_the_ground(scene):
        for name in names:
            guide, (low, high) = scene.guides[name], view.reach[name]
            at, axes = (guide.guide, guide.point), axes_along(guide.direction)
            surface = slider_size(scene, name, view.unit)[1] / 2
            behind = surface + SOLID * view.unit
            for side in (-1, 1):
                near, far = side * surface, side * behind
                yield Stroke(
                    "ground" if guide.guide == GROUND else "moving guide",
                    np.array([(low, near), (high, near), (high, far), (low, far)]) @ axes,
                    at,
                    guide.guide,
                )
                yield Stroke(
                    "surface", np.array([(low, near), (high, near)]) @ axes, at, guide.guide
                )
            if (end := _end(guide, (low, high))) is not None:
                back = end + np.sign(end - (low + high) / 2) * SOLID * view.unit
                outline = np.array([(end, -behind), (end, behind), (back, behind), (back, -behind)])
                yield Stroke("moving guide", outline @ axes, at, guide.guide)
        for name in names:
            guide = scene.guides[name]
            outline = box(slider_size(scene, name, view.unit)) @ axes_along(guide.direction)
            yield Stroke("slider", outline, (guide.slider, guide.slider_point), guide.guide)


def _from_the_ground(scene: Scene) -> Iterator[list[str]]:
    """Yield guides on what does not slide, then those on their sliders, ..: a yoke lies below the slot in it."""
    rest = dict(scene.guides)
    while rest:
        sliders = {guide.slider for guide in rest.values()}
        names = [name for name, guide in rest.items() if guide.guide not in sliders]
        yield names or [*rest]  # all, where they guide each other in a ring
        rest = {name: guide for name, guide in rest.items() if names and name not in names}


def _end(guide: Translational, reach: tuple[float, float]) -> float | None:
    """Return the end of a guide nearer to its body's centre, m along it; None if the centre is between the ends."""
    centre = -(axes_along(guide.direction) @ guide.point)[0]
    if guide.guide == GROUND or reach[0] <= centre <= reach[1]:
        return None
    return min(reach, key=lambda end: abs(end - centre))


def _holds(scene: Scene, body: str, view: View) -> Iterator[np.ndarray]:
    """Points of a body, in its own axes, at which it holds its guides; each of shape (2,)."""
    for name, guide in scene.guides.items():
        if guide.guide == body and (end := _end(guide, view.reach[name])) is not None:
            yield np.array(guide.point) + end * unit_vector(guide.direction)


def _corners(scene: Scene, unit: float) -> Iterator[Part]:
    """Arrows of the forces on the sliders' corners, along the normal at the lower ones; the corners' numbers."""
    for name, guide in scene.guides.items():
        if guide.length is None:
            continue
        at, axes = (guide.slider, guide.slider_point), axes_along(guide.direction)
        corners = box(slider_size(scene, name, unit)) @ axes
        for number, corner in enumerate(corners, 1):
            yield CornerForce(
                name, number, corner, axes[1] if number <= 2 else -axes[1], at, guide.guide
            )
        for number, corner in enumerate(corners, 1):
            yield Label(
                str(number),
                corner * (1 - min(0.3, 1.5 * unit / np.hypot(*corner))),
                at,
                guide.guide,
            )


def _names(scene: Scene, unit: float) -> Iterator[Label]:
    """Names of bodies: of a slider behind the upper surface, of others near the centre of mass."""
    guides = {guide.slider: (name, guide) for name, guide in scene.guides.items()}
    for body in scene.bodies:
        if body in guides:
            name, guide = guides[body]
            length, width = slider_size(scene, name, unit)
            point = np.array([-length / 2, width / 2 + 2.0 * unit]) @ axes_along(guide.direction)
            yield Label(body, point, (body, guide.slider_point), guide.guide)
        else:
            yield Label(body, (1.2 * unit, 1.4 * unit), (body, (0.0, 0.0)))


def _body(name: str, held: Sequence[np.ndarray], unit: float, slider: bool) -> Iterator[Stroke]:
    """A bar through what is attached to it, or a plate; its centre of mass."""
    at, points = (name, (0.0, 0.0)), np.array([(0.0, 0.0), *held])
    try:
        outline = points[ConvexHull(points).vertices] if len(points) > 2 else points
    except QhullError:  # they lie on a line
        way = points[np.argmax(np.hypot(*points.T))]
        outline = points[np.argsort(points @ way)][[0, -1]]
    if len(outline) > 2:
        yield Stroke("plate", outline, at, name)
    elif np.ptp(outline, axis=0).max() > 0:
        yield from (Stroke(look, outline, at, name) for look in ("edge", "bar"))
    elif not slider:
        yield Stroke("plate", 0.4 * unit * CIRCLE, at, name)
    yield from (Stroke("centre", 0.2 * unit * line, at, name) for line in CROSS)


def _supports(scene: Scene, unit: float) -> Iterator[Stroke]:
    """Points of the ground that something is held at: of a pin a triangle that stands on it, of a spring a cross.

    A spring of no length has its anchor where its body is: a triangle there would say that the body is pinned to the
    ground.
    """
    for joint in scene.joints.values():
        if isinstance(joint, Revolute) and GROUND in joint.bodies:
            at = GROUND, joint.points[joint.bodies.index(GROUND)]
            yield Stroke("support", unit * TRIANGLE, at)
            yield Stroke("foot", unit * FOOT, at)
    for spring in scene.springs.values():
        if isinstance(spring, LinearSpring) and GROUND in spring.bodies:
            at = GROUND, spring.points[spring.bodies.index(GROUND)]
            yield from (Stroke("spring anchor", unit * line, at) for line in ANCHOR)


def _springs(scene: Scene, unit: float) -> Iterator[Stroke | Link]:
    """Zigzags for springs, pistons for dampers, both side by side; spirals for those of an angle."""
    for spring in scene.springs.values():
        if not isinstance(spring, LinearSpring):
            yield Stroke("spring", unit * SPIRAL, _centre(scene, spring.bodies))
            continue
        lines, aside = [], 0.7 * unit if spring.stiffness > 0 and spring.damping > 0 else 0.0
        if spring.stiffness > 0:
            share = [0.0, 0.15, *np.linspace(0.15, 0.85, 2 * COILS + 1)[1:-1], 0.85, 1.0]
            swing = [0.0, 0.0, *np.tile([1.0, -1.0], COILS)[: 2 * COILS - 1], 0.0, 0.0]
            lines.append(np.column_stack([share, 0.6 * unit * np.array(swing) + aside]))
        if spring.damping > 0:
            lines += [*(PISTON * [1.0, 0.7 * unit] - [0.0, aside])]
        yield from (
            Link("spring", line, spring.bodies, spring.points, spring.axis) for line in lines
        )


def _drive(scene: Scene, drive: Drive, unit: float) -> Stroke | Link:
    if drive.type == "angle":
        sign = -1 if evaluate_law(drive.law, 0.0)[1] < 0 else 1
        return Stroke("turning drive", 1.8 * unit * ARC[::sign], _centre(scene, drive.bodies))
    return Link("drive", np.array([(0.0, 0.0), (1.0, 0.0)]), drive.bodies, drive.points, drive.axis)


def _loads(scene: Scene, unit: float) -> Iterator[Stroke]:
    """Each twice, for the two signs that it may have; an arc is counter-clockwise for a sign of 1."""
    for name, load in scene.forces.items():
        for sign in (1, -1):
            if isinstance(load, Force):
                arrow = np.array(
                    [(0.0, 0.0), sign * LOAD_ARROW * unit * unit_vector(load.direction)]
                )
                yield Stroke("load", arrow, (load.body, load.point), sign=(name, sign))
            else:
                yield Stroke(
                    "turning load",
                    2.6 * unit * ARC[::sign],
                    (load.body, (0.0, 0.0)),
                    sign=(name, sign),
                )


def _centre(scene: Scene, bodies: Sequence[str]) -> Place:
    """Place of what turns two bodies against each other: the pin between them, else the first that moves."""
    for joint in scene.joints.values():
        if isinstance(joint, Revolute) and set(joint.bodies) == set(bodies):
            return joint.bodies[0], joint.points[0]
    return next(name for name in bodies if name != GROUND), (0.0, 0.0)
