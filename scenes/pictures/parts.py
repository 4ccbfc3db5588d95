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
from stiction.scenes.pictures.geometry import AXIS_ARROW, LOAD_ARROW, Poses, View, attachments, spring_ends

MOST_NAMES = 12
"""Bodies up to which each has its name beside it."""
SOLID = 0.8
"""Symbols: how thick the solid behind a surface is drawn."""
_COILS = 6
_TURNS = np.linspace(0.0, 4 * np.pi, 60)
_CIRCLE = tuple((float(np.cos(angle)), float(np.sin(angle))) for angle in np.linspace(0.0, 2 * np.pi, 25)[:-1])
_ARC = np.linspace(-0.4 * np.pi, 1.1 * np.pi, 40)

Point = tuple[float, float]
Place = tuple[str, Point]
"""A body and a point in its axes, m."""


@dataclass(frozen=True)
class Look:
    """How a stroke is drawn: names of colours (none: not drawn), width in points; what is filled is closed."""

    line: str = "ink"
    fill: str = ""
    width: float = 0.8
    hatched: bool = False
    arrow: str = ""
    """``"end"``, ``"both"`` or none"""


LOOKS = {
    "ground": Look("", "paper", hatched=True), "moving guide": Look("", "body"), "surface": Look(), "slider": Look(fill="shade", width=0.9),
    "support": Look(fill="paper"), "foot": Look(width=1.2), "spring anchor": Look("spring", width=1.2),
    "plate": Look(fill="body"), "edge": Look(width=4.5), "bar": Look("body", width=3.0), "centre": Look(width=0.7), "spring": Look("spring", width=1.0),
    "drive": Look("drive", width=1.5, arrow="both"), "turning drive": Look("drive", width=1.5, arrow="end"), "pin": Look(fill="paper", width=1.0),
    "load": Look("load", width=1.8, arrow="end"), "turning load": Look("load", width=1.5, arrow="end"),
    "corner force": Look("corner", width=1.2, arrow="end"), "gravity": Look(arrow="end")}


@dataclass(frozen=True)
class Stroke:
    """A line or an area, m; its origin is a point of a body, it turns with `axes`."""

    look: str
    points: tuple[Point, ...]
    at: Place
    axes: str = GROUND
    sign: tuple[str, int] | None = None
    """A load and its sign, -1 or 1, at which it is drawn"""

    def place(self, poses: Poses) -> np.ndarray:
        """In ground axes; shape (n, 2)."""
        origin = poses[self.at[0]].place(self.at[1])
        return np.array([origin + poses[self.axes].turn(point) for point in self.points])


@dataclass(frozen=True)
class Link:
    """A line between two points of bodies, as of a spring or a drive: each point the share of the way from the second to the first, and m across it."""

    look: str
    points: tuple[Point, ...]
    bodies: tuple[str, str]
    ends: tuple[Point, Point]
    axis: Point | None

    def place(self, poses: Poses, unit: float) -> np.ndarray:
        """In ground axes; shape (n, 2). One with an axis that is shorter than a symbol shows where it leads to."""
        first, second = spring_ends(self.bodies, self.ends, self.axis, poses)
        if np.hypot(*(first - second)) < unit and self.axis is not None and LOOKS[self.look].arrow:
            axis = poses[self.bodies[1]].turn(self.axis)
            first = second + AXIS_ARROW * unit * axis / np.hypot(*axis)
        length = np.hypot(*(first - second))
        across = np.array([second[1] - first[1], first[0] - second[0]]) / (length or 1.0)
        return np.array([second + share * (first - second) + beside * across for share, beside in self.points])


@dataclass(frozen=True)
class Label:
    """A word at a point, m, whose origin and axes are those of a `Stroke`."""

    text: str
    point: Point
    at: Place
    axes: str = GROUND

    def place(self, poses: Poses) -> np.ndarray:
        """In ground axes; shape (2,)."""
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
    """All of the drawing, what lies below first."""
    held, ways = attachments(scene), {name: [*_ways_to_guides(scene, name, view)] for name in scene.bodies}
    yield from _guides(scene, view)
    sliders = {guide.slider for guide in scene.guides.values()}
    for name in scene.bodies:
        yield from _body(name, [*held[name], *ways[name]], view.unit, name in sliders)
    yield from _supports(scene, view.unit)
    for spring in scene.springs.values():
        if isinstance(spring, LinearSpring):
            for points in _spring(view.unit, spring.stiffness > 0, spring.damping > 0):
                yield Link("spring", points, spring.bodies, spring.points, spring.axis)
        else:
            radius = view.unit * (0.6 + 0.25 * _TURNS / np.pi)
            yield Stroke("spring", _points(radius * np.cos(_TURNS), radius * np.sin(_TURNS)), _centre(scene, spring.bodies))
    for drive in scene.drives.values():
        yield _drive(scene, drive, view.unit)
    for joint in scene.joints.values():
        if isinstance(joint, Revolute):
            yield Stroke("pin", _scaled(_CIRCLE, 0.25 * view.unit), (joint.bodies[0], joint.points[0]))
    yield from _loads(scene, view.unit)
    yield from _corners(scene, view.unit)
    if len(scene.bodies) <= MOST_NAMES:
        yield from _names(scene, view.unit)
    if scene.gravity is not None and np.hypot(*scene.gravity) > 0:
        down = np.array(scene.gravity) / np.hypot(*scene.gravity)
        begin = np.array([view.x[1], view.y[1]]) - view.unit * (1.5 + 2.0 * np.maximum(down, 0))
        ground = (GROUND, (float(begin[0]), float(begin[1])))
        yield Stroke("gravity", ((0.0, 0.0), _point(2 * view.unit * down)), ground)
        yield Label("g", _point(view.unit * (down + [-1.2, 0.0])), ground)


def slider_size(scene: Scene, name: str, unit: float) -> Point:
    """Length and width of a slider as drawn, m; what is not declared is some symbols."""
    guide = scene.guides[name]
    length = guide.length or 3 * unit
    return length, guide.width or length * (0.4 if guide.width is None else 0.02)


def _guides(scene: Scene, view: View) -> Iterator[Stroke]:
    """Two surfaces with the solid behind them, hatched where it is the ground; then sliders; then what these guide."""
    for names in _from_the_ground(scene):
        for name in names:
            guide, width, reach = scene.guides[name], slider_size(scene, name, view.unit)[1], view.reach[name]
            at, behind = (guide.guide, guide.point), width / 2 + SOLID * view.unit
            for side in (-1, 1):
                near, far = side * width / 2, side * behind
                yield Stroke("ground" if guide.guide == GROUND else "moving guide",
                             _along(guide.direction, [(reach[0], near), (reach[1], near), (reach[1], far), (reach[0], far)]), at, guide.guide)
                yield Stroke("surface", _along(guide.direction, [(s, near) for s in reach]), at, guide.guide)
            if (end := _end(guide, reach)) is not None:
                back = end + np.sign(end - np.mean(reach)) * SOLID * view.unit
                yield Stroke("moving guide", _along(guide.direction, [(end, -behind), (end, behind), (back, behind), (back, -behind)]), at, guide.guide)
        for name in names:
            guide = scene.guides[name]
            yield Stroke("slider", _along(guide.direction, _box(slider_size(scene, name, view.unit))), (guide.slider, guide.slider_point), guide.guide)


def _from_the_ground(scene: Scene) -> Iterator[list[str]]:
    """Guides on what does not slide, then those on the sliders of these, and so on: a yoke lies below the slot in it."""
    rest = dict(scene.guides)
    while rest:
        sliders = {guide.slider for guide in rest.values()}
        yield (names := [name for name, guide in rest.items() if guide.guide not in sliders] or [*rest])  # all, where they guide each other in a ring
        for name in names:
            del rest[name]


def _end(guide: Translational, reach: tuple[float, float]) -> float | None:
    """Where a body holds the surfaces of its guide, m along it: at their end nearer to its centre; None if it lies between."""
    [centre] = _across(guide.direction, [-np.array(guide.point)])
    return None if guide.guide == GROUND or reach[0] <= centre[0] <= reach[1] else min(reach, key=lambda end: abs(end - centre[0]))


def _ways_to_guides(scene: Scene, body: str, view: View) -> Iterator[np.ndarray]:
    """Points of a body, in its own axes, at which it holds its guides; each of shape (2,)."""
    for name, guide in scene.guides.items():
        if guide.guide == body and (end := _end(guide, view.reach[name])) is not None:
            [point] = _along(guide.direction, [(end, 0.0)])
            yield np.array(guide.point) + point


def _corners(scene: Scene, unit: float) -> Iterator[Part]:
    """Arrows of the forces on the sliders' corners, at the lower ones along the normal, at the upper ones against it; the corners' numbers."""
    for name, guide in scene.guides.items():
        if guide.length is None:
            continue
        at = guide.slider, guide.slider_point
        corners = _along(guide.direction, _box(slider_size(scene, name, unit)))
        for number, corner in enumerate(corners, 1):
            [inwards] = _along(guide.direction, [(0.0, 1.0 if number <= 2 else -1.0)])
            yield CornerForce(name, number, corner, inwards, at, guide.guide)
        for number, corner in enumerate(corners, 1):
            yield Label(str(number), _point(np.array(corner) * (1 - min(0.3, 1.5 * unit / np.hypot(*corner)))), at, guide.guide)


def _names(scene: Scene, unit: float) -> Iterator[Label]:
    """Of a slider behind the upper surface, of others beside the centre of mass."""
    guides = {guide.slider: (name, guide) for name, guide in scene.guides.items()}
    for body in scene.bodies:
        if body in guides:
            name, guide = guides[body]
            length, width = slider_size(scene, name, unit)
            [point] = _along(guide.direction, [(-length / 2, width / 2 + 2.0 * unit)])
            yield Label(body, point, (body, guide.slider_point), guide.guide)
        else:
            yield Label(body, (1.2 * unit, 1.4 * unit), (body, (0.0, 0.0)))


def _box(size: Point) -> list[Point]:
    """Corners 1 lower rear, 2 lower front, 3 upper front, 4 upper rear: along the guide and across it."""
    a, b = size
    return [(p * a / 2, q * b / 2) for p, q in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def _along(direction: Sequence[float], points: Sequence[Point]) -> tuple[Point, ...]:
    """Points given along a direction and across it."""
    along = np.array(direction) / np.hypot(*direction)
    return tuple(_point(s * along + n * np.array([-along[1], along[0]])) for s, n in points)


def _across(direction: Sequence[float], points: Sequence[np.ndarray]) -> tuple[Point, ...]:
    """The reverse of `_along`."""
    along = np.array(direction) / np.hypot(*direction)
    return tuple(_point(np.array([point @ along, point @ [-along[1], along[0]]])) for point in points)


def _body(name: str, held: Sequence[np.ndarray], unit: float, slider: bool) -> Iterator[Stroke]:
    """A bar through what is attached to it, or a plate; its centre of mass."""
    at, points = (name, (0.0, 0.0)), np.array([(0.0, 0.0), *held])
    try:
        outline = points[ConvexHull(points).vertices] if len(points) > 2 else points
    except QhullError:  # they lie on a line
        way = points[np.argmax(np.hypot(*points.T))]
        outline = points[np.argsort(points @ way)][[0, -1]]
    corners = tuple(_point(point) for point in outline)
    if len(outline) > 2:
        yield Stroke("plate", corners, at, name)
    elif np.ptp(outline, axis=0).max() > 0:
        yield from (Stroke(look, corners, at, name) for look in ("edge", "bar"))
    elif not slider:
        yield Stroke("plate", _scaled(_CIRCLE, 0.4 * unit), at, name)
    yield from (Stroke("centre", _scaled(cross, 0.2 * unit), at, name) for cross in (((-1, 0), (1, 0)), ((0, -1), (0, 1))))


def _supports(scene: Scene, unit: float) -> Iterator[Stroke]:
    """Points of the ground that something is held at: of a pin a triangle that stands on it, of a spring a cross.

    A spring of no length has its anchor where its body is: a triangle there would say that the body is pinned to the ground.
    """
    for joint in scene.joints.values():
        if isinstance(joint, Revolute) and GROUND in joint.bodies:
            at = GROUND, joint.points[joint.bodies.index(GROUND)]
            yield Stroke("support", _scaled(((0.0, 0.0), (-0.8, -1.2), (0.8, -1.2)), unit), at)
            yield Stroke("foot", _scaled(((-1.2, -1.2), (1.2, -1.2)), unit), at)
    for spring in scene.springs.values():
        if isinstance(spring, LinearSpring) and GROUND in spring.bodies:
            at = GROUND, spring.points[spring.bodies.index(GROUND)]
            yield from (Stroke("spring anchor", _scaled(line, unit), at) for line in (((-0.5, -0.5), (0.5, 0.5)), ((-0.5, 0.5), (0.5, -0.5))))


def _spring(unit: float, elastic: bool, damped: bool) -> Iterator[tuple[Point, ...]]:
    """A zigzag, a piston, or both side by side."""
    beside = 0.7 * unit if elastic and damped else 0.0
    if elastic:
        share = [0.0, 0.15, *np.linspace(0.15, 0.85, 2 * _COILS + 1)[1:-1], 0.85, 1.0]
        swing = [0.0, 0.0, *np.tile([1.0, -1.0], _COILS)[:2 * _COILS - 1], 0.0, 0.0]
        yield _points(share, 0.6 * unit * np.array(swing) + beside)
    if damped:
        for line in (((0.0, 0.0), (0.45, 0.0)), ((0.45, -0.5), (0.45, 0.5)), ((0.65, -0.7), (0.35, -0.7)), ((0.65, 0.7), (0.35, 0.7)),
                     ((0.65, -0.7), (0.65, 0.7)), ((0.65, 0.0), (1.0, 0.0))):
            yield tuple((share, swing * 0.7 * unit - beside) for share, swing in line)


def _drive(scene: Scene, drive: Drive, unit: float) -> Stroke | Link:
    if drive.type == "angle":
        sign = -1 if evaluate_law(drive.law, 0.0)[1] < 0 else 1
        return Stroke("turning drive", _turning(1.8 * unit, sign), _centre(scene, drive.bodies))
    return Link("drive", ((0.0, 0.0), (1.0, 0.0)), drive.bodies, drive.points, drive.axis)


def _loads(scene: Scene, unit: float) -> Iterator[Stroke]:
    """Each twice, for the two signs that it may have."""
    for name, load in scene.forces.items():
        for sign in (1, -1):
            if isinstance(load, Force):
                direction = np.array(load.direction) / np.hypot(*load.direction)
                yield Stroke("load", ((0.0, 0.0), _point(sign * LOAD_ARROW * unit * direction)), (load.body, load.point), sign=(name, sign))
            else:
                yield Stroke("turning load", _turning(2.6 * unit, sign), (load.body, (0.0, 0.0)), sign=(name, sign))


def _turning(radius: float, sign: int) -> tuple[Point, ...]:
    """An arc, counter-clockwise for a sign of 1."""
    return _points(radius * np.cos(_ARC[::sign]), radius * np.sin(_ARC[::sign]))


def _centre(scene: Scene, bodies: Sequence[str]) -> Place:
    """Where something that turns two bodies against each other is drawn: at the pin between them, else at the first that moves."""
    for joint in scene.joints.values():
        if isinstance(joint, Revolute) and set(joint.bodies) == set(bodies):
            return joint.bodies[0], joint.points[0]
    return next(name for name in bodies if name != GROUND), (0.0, 0.0)


def _point(values: np.ndarray) -> Point:
    return float(values[0]), float(values[1])


def _points(x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray) -> tuple[Point, ...]:
    return tuple((float(a), float(b)) for a, b in zip(x, y, strict=True))


def _scaled(points: Sequence[Point], size: float) -> tuple[Point, ...]:
    return tuple((size * x, size * y) for x, y in points)
