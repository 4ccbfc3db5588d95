"""The drawing of a mechanism as data: strokes and labels, each fixed to a body.

`stiction.scenes.pictures.mechanism` draws them with matplotlib, and ``browser/player.js`` in a browser.
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
    DEFAULT_SLIDER,
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

MAX_LABELLED_BODIES = 12
"""Largest number of bodies whose names are written next to them; more would overlap."""
SOLID = 0.8
"""Thickness of the solid behind a surface, in units of the view."""
COILS = 6
"""Number of coils of a spring."""

Place = tuple[str, Point]
"""A body and a point in its axes, m."""


@dataclass(frozen=True)
class Look:
    """Style of a stroke."""

    line: str = "ink"
    """Name of the colour of the line; empty if it is not drawn"""
    fill: str = ""
    """Name of the colour of the area, whose outline is closed; empty if it is not filled"""
    width: float = 0.8
    """Width of the line, points"""
    hatched: bool = False
    """Whether the area is hatched"""
    arrow: str = ""
    """Which ends of the line have a head: ``"end"``, ``"both"``, or empty"""


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
    "dry pin": Look(fill="shade", width=1.8),
    "load": Look("load", width=1.8, arrow="end"),
    "turning load": Look("load", width=1.5, arrow="end"),
    "corner force": Look("corner", width=1.2, arrow="end"),
    "gravity": Look(arrow="end"),
}


def _on_unit_circle(angles: np.ndarray) -> np.ndarray:
    """Return the points of the unit circle at angles (n,), rad; shape (n, 2)."""
    return np.column_stack([np.cos(angles), np.sin(angles)])


# Symbols, in units of their size.
CIRCLE = _on_unit_circle(np.linspace(0.0, 2 * np.pi, 25)[:-1])
ARC = _on_unit_circle(np.linspace(-0.4 * np.pi, 1.1 * np.pi, 40))
_SPIRAL_ANGLES = np.linspace(0.0, 4 * np.pi, 60)
_SPIRAL_RADII = 0.6 + 0.25 * _SPIRAL_ANGLES / np.pi
SPIRAL = _SPIRAL_RADII[:, None] * _on_unit_circle(_SPIRAL_ANGLES)
TRIANGLE = np.array([(0.0, 0.0), (-0.8, -1.2), (0.8, -1.2)])
FOOT = np.array([(-1.2, -1.2), (1.2, -1.2)])
CROSS = np.array([[(-1, 0), (1, 0)], [(0, -1), (0, 1)]])
ANCHOR = np.array([[(-0.5, -0.5), (0.5, 0.5)], [(-0.5, 0.5), (0.5, -0.5)]])
# The lines of a piston; the first number of a point is a fraction of the distance of the ends.
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


@dataclass(frozen=True)
class Stroke:
    """A line or an area that moves with bodies."""

    look: str
    """Key of `LOOKS`"""
    points: np.ndarray
    """Points relative to the origin, m, shape (n, 2)"""
    at: Place
    """The origin"""
    axes: str = GROUND
    """Body with which the stroke rotates"""
    sign: tuple[str, int] | None = None
    """Name of a load, and the sign of it, -1 or 1, for which the stroke is drawn; None if it is always drawn"""

    def place(self, poses: Poses) -> np.ndarray:
        """Return the points in ground axes; shape (n, 2)."""
        return poses[self.at[0]].place(self.at[1]) + poses[self.axes].turn(self.points)


@dataclass(frozen=True)
class Link:
    """A line between two points of bodies, for a spring or a drive."""

    look: str
    """Key of `LOOKS`"""
    points: np.ndarray
    """For each point, the fraction of the distance from the second end to the first, and the distance from the straight
    line, m; shape (n, 2)"""
    bodies: tuple[str, str]
    """The two bodies"""
    ends: tuple[Point, Point]
    """The ends in the axes of their bodies, m"""
    axis: Point | None
    """Direction of the line in the axes of the second body, see `link_ends`"""

    def place(self, poses: Poses, unit: float) -> np.ndarray:
        """Return the points in ground axes; shape (n, 2).

        An arrow along an axis that would be shorter than a symbol (`unit`, m) is drawn longer, to show its direction.
        """
        first, second = link_ends(self.bodies, self.ends, self.axis, poses)
        is_short = np.hypot(*(first - second)) < unit
        if is_short and self.axis is not None and LOOKS[self.look].arrow:
            first = second + AXIS_ARROW * unit * unit_vector(poses[self.bodies[1]].turn(self.axis))
        along = first - second
        across = np.array([-along[1], along[0]]) / (np.hypot(*along) or 1.0)
        return second + self.points @ np.array([along, across])


@dataclass(frozen=True)
class Label:
    """A text at a point, m, whose origin and axes are those of a `Stroke`."""

    text: str
    point: Point
    at: Place
    axes: str = GROUND

    def place(self, poses: Poses) -> np.ndarray:
        """Return the point in ground axes; shape (2,)."""
        return poses[self.at[0]].place(self.at[1]) + poses[self.axes].turn(self.point)


@dataclass(frozen=True)
class CornerForce:
    """The arrow of a corner force, which ends at the corner."""

    guide: str
    """Name of the guide"""
    number: int
    """Number of the corner, 1 to 4"""
    corner: Point
    """The corner relative to the origin, m"""
    direction: Point
    """Direction of the force; a unit vector"""
    at: Place
    """The origin"""
    axes: str
    """Body with which the arrow rotates"""

    @property
    def column(self) -> str:
        """Name of the column of the force."""
        return f"{self.guide}.F{self.number}"

    def place(self, poses: Poses, length: float) -> np.ndarray:
        """Return begin and end of an arrow with this length (m) in ground axes; shape (2, 2)."""
        end = poses[self.at[0]].place(self.at[1]) + poses[self.axes].turn(self.corner)
        return np.array([end - length * poses[self.axes].turn(self.direction), end])


Part = Stroke | Link | Label | CornerForce


def parts(scene: Scene, view: View) -> Iterator[Part]:
    """Yield all parts of a drawing, in the order in which they are drawn: later parts cover earlier ones."""
    attached = attachments(scene)
    sliders = {guide.slider for guide in scene.guides.values()}
    yield from _guides(scene, view)
    for name in scene.bodies:
        points = [*attached[name], *_ends_of_own_guides(scene, name, view)]
        yield from _body(name, points, view.unit, name in sliders)
    yield from _supports(scene, view.unit)
    yield from _springs(scene, view.unit)
    for drive in scene.drives.values():
        yield _drive(scene, drive, view.unit)
    for joint in scene.joints.values():
        if isinstance(joint, Revolute):
            look = "dry pin" if joint.rubs else "pin"
            yield Stroke(look, 0.25 * view.unit * CIRCLE, (joint.bodies[0], joint.points[0]))
    yield from _loads(scene, view.unit)
    yield from _corners(scene, view.unit)
    if len(scene.bodies) <= MAX_LABELLED_BODIES:
        yield from _names(scene, view.unit)
    if scene.gravity is not None and np.hypot(*scene.gravity) > 0:
        yield from _gravity_arrow(unit_vector(scene.gravity), view)


def _gravity_arrow(down: np.ndarray, view: View) -> Iterator[Part]:
    """Yield the arrow of gravity in the upper right corner of a view; `down` is its direction."""
    corner = np.array([view.x[1], view.y[1]])
    begin = (GROUND, corner - view.unit * (1.5 + 2.0 * np.maximum(down, 0)))
    yield Stroke("gravity", np.array([(0.0, 0.0), 2 * view.unit * down]), begin)
    yield Label("g", view.unit * (down + [-1.2, 0.0]), begin)


def slider_size(scene: Scene, name: str, unit: float) -> tuple[float, float]:
    """Return the length and width with which a slider is drawn, m; `unit` replaces sizes that are not declared."""
    guide = scene.guides[name]
    length = guide.length or DEFAULT_SLIDER * unit
    if guide.width:
        return length, guide.width
    # A declared width of 0 is drawn as a thin line.
    return length, length * (0.4 if guide.width is None else 0.02)


def _guides(scene: Scene, view: View) -> Iterator[Stroke]:
    """Yield guides and sliders; guides on sliders cover these."""
    for names in _guides_by_level(scene):
        for name in names:
            yield from _guide(scene, name, view)
        for name in names:
            guide = scene.guides[name]
            outline = box(slider_size(scene, name, view.unit)) @ axes_along(guide.direction)
            yield Stroke("slider", outline, (guide.slider, guide.slider_point), guide.guide)


def _guide(scene: Scene, name: str, view: View) -> Iterator[Stroke]:
    """Yield the two surfaces of a guide and the solid behind each, which is hatched if it is the ground."""
    guide = scene.guides[name]
    low, high = view.reach[name]
    at = (guide.guide, guide.point)
    axes = axes_along(guide.direction)
    _, width = slider_size(scene, name, view.unit)
    surface = width / 2 + (guide.clearance or 0.0)
    behind = surface + SOLID * view.unit
    look = "ground" if guide.guide == GROUND else "moving guide"
    for side in (-1, 1):
        near, far = side * surface, side * behind
        solid = np.array([(low, near), (high, near), (high, far), (low, far)])
        yield Stroke(look, solid @ axes, at, guide.guide)
        yield Stroke("surface", np.array([(low, near), (high, near)]) @ axes, at, guide.guide)
    # A guide that its body holds at one end is closed there.
    end = _held_end(guide, (low, high))
    if end is not None:
        back = end + np.sign(end - (low + high) / 2) * SOLID * view.unit
        outline = np.array([(end, -behind), (end, behind), (back, behind), (back, -behind)])
        yield Stroke("moving guide", outline @ axes, at, guide.guide)


def _guides_by_level(scene: Scene) -> Iterator[list[str]]:
    """Yield the names of guides on bodies that do not slide, then of those on their sliders, and so on."""
    remaining = dict(scene.guides)
    while remaining:
        sliders = {guide.slider for guide in remaining.values()}
        names = [name for name, guide in remaining.items() if guide.guide not in sliders]
        if not names:
            # Bodies that guide each other in a ring have no lowest level.
            names = list(remaining)
        yield names
        for name in names:
            del remaining[name]


def _held_end(guide: Translational, reach: tuple[float, float]) -> float | None:
    """Return the end of a guide that is nearer to the centre of its body, m along the guide.

    It is None if the guide extends on both sides of the centre, or belongs to the ground.
    """
    centre = -(axes_along(guide.direction) @ guide.point)[0]
    if guide.guide == GROUND or reach[0] <= centre <= reach[1]:
        return None
    return min(reach, key=lambda end: abs(end - centre))


def _ends_of_own_guides(scene: Scene, body: str, view: View) -> Iterator[np.ndarray]:
    """Yield the points of a body, in its own axes, at which it holds its guides; each of shape (2,)."""
    for name, guide in scene.guides.items():
        if guide.guide != body:
            continue
        end = _held_end(guide, view.reach[name])
        if end is not None:
            yield np.array(guide.point) + end * unit_vector(guide.direction)


def _corners(scene: Scene, unit: float) -> Iterator[Part]:
    """Yield the arrows of corner forces, and the numbers of the corners inside the slider."""
    for name, guide in scene.guides.items():
        if guide.length is None:
            continue
        at = (guide.slider, guide.slider_point)
        axes = axes_along(guide.direction)
        corners = box(slider_size(scene, name, unit)) @ axes
        for number, corner in enumerate(corners, 1):
            # The lower surface pushes the slider along the normal, the upper one against it.
            direction = axes[1] if number <= 2 else -axes[1]
            yield CornerForce(name, number, corner, direction, at, guide.guide)
        for number, corner in enumerate(corners, 1):
            inset = min(0.3, 1.5 * unit / np.hypot(*corner))
            yield Label(str(number), corner * (1 - inset), at, guide.guide)


def _names(scene: Scene, unit: float) -> Iterator[Label]:
    """Yield names of bodies: of a slider above the upper surface, of others near the centre of mass."""
    guides = {guide.slider: (name, guide) for name, guide in scene.guides.items()}
    for body in scene.bodies:
        if body in guides:
            name, guide = guides[body]
            length, width = slider_size(scene, name, unit)
            point = np.array([-length / 2, width / 2 + 2.0 * unit]) @ axes_along(guide.direction)
            yield Label(body, point, (body, guide.slider_point), guide.guide)
        else:
            yield Label(body, (1.2 * unit, 1.4 * unit), (body, (0.0, 0.0)))


def _body(
    name: str, attached: Sequence[np.ndarray], unit: float, is_slider: bool
) -> Iterator[Stroke]:
    """Yield the outline of a body and its centre of mass.

    The outline is a bar or a plate through the centre and the attached points, in the axes of the body. A body without
    such points is a disc, unless it is drawn as a slider.
    """
    at = (name, (0.0, 0.0))
    outline = _outline(np.array([(0.0, 0.0), *attached]))
    if len(outline) > 2:
        yield Stroke("plate", outline, at, name)
    elif np.ptp(outline, axis=0).max() > 0:
        # A wide dark line below a lighter one makes a bar with an edge.
        for look in ("edge", "bar"):
            yield Stroke(look, outline, at, name)
    elif not is_slider:
        yield Stroke("plate", 0.4 * unit * CIRCLE, at, name)
    for line in CROSS:
        yield Stroke("centre", 0.2 * unit * line, at, name)


def _outline(points: np.ndarray) -> np.ndarray:
    """Return the convex hull of points, shape (n, 2), or the two ends if they lie on a line."""
    if len(points) <= 2:
        return points
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        # The points lie on a line through the origin, which is the first of them.
        direction = points[np.argmax(np.hypot(*points.T))]
        return points[np.argsort(points @ direction)][[0, -1]]


def _supports(scene: Scene, unit: float) -> Iterator[Stroke]:
    """Yield symbols for points of the ground: a triangle for a pin, a cross for a spring.

    A spring whose ends coincide has its symbol at the body. A triangle would suggest that the body is pinned there.
    """
    for joint in scene.joints.values():
        if isinstance(joint, Revolute) and GROUND in joint.bodies:
            at = GROUND, joint.points[joint.bodies.index(GROUND)]
            yield Stroke("support", unit * TRIANGLE, at)
            yield Stroke("foot", unit * FOOT, at)
    for spring in scene.springs.values():
        if isinstance(spring, LinearSpring) and GROUND in spring.bodies:
            at = GROUND, spring.points[spring.bodies.index(GROUND)]
            for line in ANCHOR:
                yield Stroke("spring anchor", unit * line, at)


def _springs(scene: Scene, unit: float) -> Iterator[Stroke | Link]:
    """Yield springs as zigzag lines, dampers as pistons, both side by side, and torsional springs as spirals."""
    for spring in scene.springs.values():
        if not isinstance(spring, LinearSpring):
            yield Stroke("spring", unit * SPIRAL, _centre(scene, spring.bodies))
            continue
        has_both = spring.stiffness > 0 and spring.damping > 0
        offset = 0.7 * unit if has_both else 0.0
        lines: list[np.ndarray] = []
        if spring.stiffness > 0:
            lines.append(_zigzag(0.6 * unit, offset))
        if spring.damping > 0:
            lines += list(PISTON * [1.0, 0.7 * unit] - [0.0, offset])
        for line in lines:
            yield Link("spring", line, spring.bodies, spring.points, spring.axis)


def _zigzag(amplitude: float, offset: float) -> np.ndarray:
    """Return the `Link.points` of a spring with an amplitude and an offset from the straight line, both in m."""
    turns = np.linspace(0.15, 0.85, 2 * COILS + 1)[1:-1]
    fractions = [0.0, 0.15, *turns, 0.85, 1.0]
    sides = np.tile([1.0, -1.0], COILS)[: len(turns)]
    across = amplitude * np.array([0.0, 0.0, *sides, 0.0, 0.0]) + offset
    return np.column_stack([fractions, across])


def _drive(scene: Scene, drive: Drive, unit: float) -> Stroke | Link:
    """Return the symbol of a drive: an arc in the direction of its first motion, or a line with two heads."""
    if drive.type == "angle":
        _, rate, _ = evaluate_law(drive.law, 0.0)
        sign = -1 if rate < 0 else 1
        return Stroke("turning drive", 1.8 * unit * ARC[::sign], _centre(scene, drive.bodies))
    return Link("drive", np.array([(0.0, 0.0), (1.0, 0.0)]), drive.bodies, drive.points, drive.axis)


def _loads(scene: Scene, unit: float) -> Iterator[Stroke]:
    """Yield two arrows for each load, one for each sign; the arc of a positive torque is counter-clockwise."""
    for name, load in scene.forces.items():
        for sign in (1, -1):
            if isinstance(load, Force):
                tip = sign * LOAD_ARROW * unit * unit_vector(load.direction)
                arrow = np.array([(0.0, 0.0), tip])
                yield Stroke("load", arrow, (load.body, load.point), sign=(name, sign))
            else:
                arc = 2.6 * unit * ARC[::sign]
                yield Stroke("turning load", arc, (load.body, (0.0, 0.0)), sign=(name, sign))


def _centre(scene: Scene, bodies: Sequence[str]) -> Place:
    """Return the place of a symbol for a rotation of two bodies relative to each other.

    It is the pin between them, or the centre of mass of the first that is not the ground.
    """
    for joint in scene.joints.values():
        if isinstance(joint, Revolute) and set(joint.bodies) == set(bodies):
            return joint.bodies[0], joint.points[0]
    first, second = bodies
    return (second if first == GROUND else first), (0.0, 0.0)
