"""Geometry of the drawing of a mechanism: poses of bodies, points of elements, and limits of the view.

Points are rows of arrays, m. Sizes of symbols and arrows are multiples of a unit, which is a fraction of the size of
the mechanism.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant
from stiction.scenes.model import Drive, Force, LinearSpring, Revolute, Scene, Translational
from stiction.scenes.trajectory import Trajectory

Point = Sequence[float] | np.ndarray
"""Coordinates of a point or a vector; shape (2,)."""
UNIT = 0.03
"""Size of a symbol relative to the size of the mechanism."""
ROOM = 3.5
"""Distance from the mechanism to the frame, in units."""
LOAD_ARROW = 5.0
"""Length of the arrow of a load, in units."""
AXIS_ARROW = 4.0
"""Length of the arrow of a drive along an axis if its coordinate is near 0, in units."""
LONGEST_ARROW = 5.0
"""Length of the arrow of the largest corner force, in units."""
GUIDE_BEYOND = 1.2
"""Distance to which a guide is drawn beyond the outermost positions of its slider, relative to the slider's length."""
DEFAULT_SLIDER = 3.0
"""Length of a slider that declares none, in units."""
UNIFORM = 1e-6
"""Relative difference up to which a body pinned at one end has the inertia of a uniform rod."""


@dataclass(frozen=True)
class Pose:
    """Position of the centre of mass of a body, m, and its angle, rad."""

    x: float
    y: float
    angle: float

    def place(self, points: Sequence[float] | np.ndarray) -> np.ndarray:
        """Transform points from the axes of the body to ground axes; shape (2,) or (n, 2)."""
        return np.array([self.x, self.y]) + self.turn(points)

    def turn(self, vectors: Sequence[float] | np.ndarray) -> np.ndarray:
        """Transform vectors from the axes of the body to ground axes; shape (2,) or (n, 2)."""
        x, y = np.asarray(vectors, dtype=float).T
        cosine, sine = math.cos(self.angle), math.sin(self.angle)
        return np.array([cosine * x - sine * y, sine * x + cosine * y]).T


Poses = Mapping[str, Pose]
"""Poses of all bodies and of the ground, by name."""
_GROUND_POSE = {GROUND: Pose(0.0, 0.0, 0.0)}


def poses_at_start(scene: Scene) -> Poses:
    """Return the poses at t = 0."""
    return _GROUND_POSE | {
        name: Pose(*body.position, body.angle) for name, body in scene.bodies.items()
    }


def poses_at(scene: Scene, trajectory: Trajectory | Mapping[str, np.ndarray], row: int) -> Poses:
    """Return the poses in a row of a trajectory, or of its columns."""
    poses = dict(_GROUND_POSE)
    for name in scene.bodies:
        x, y, angle = (float(trajectory[f"{name}.{key}"][row]) for key in ("x", "y", "angle"))
        poses[name] = Pose(x, y, angle)
    return poses


def unit_vector(direction: Point) -> np.ndarray:
    """Return the unit vector in a direction; shape (2,)."""
    return np.array(direction) / np.hypot(direction[0], direction[1])


def axes_along(direction: Point) -> np.ndarray:
    """Return the unit vector in a direction, and its normal turned by +90 degrees, as rows; shape (2, 2).

    ``points @ axes_along(d)`` transforms components along and across the direction to x and y;
    ``axes_along(d) @ point`` is the inverse.
    """
    along = unit_vector(direction)
    return np.array([along, [-along[1], along[0]]])


def box(size: Sequence[float]) -> np.ndarray:
    """Return the corners of a slider relative to its point, in components along and across the guide.

    Parameters
    ----------
    size
        Length and width, m.

    Returns
    -------
    ndarray, shape (4, 2)
        Corners 1 lower rear, 2 lower front, 3 upper front, 4 upper rear.
    """
    return np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * size / 2


def displacement(guide: Translational, poses: Poses) -> float:
    """Return the displacement of the slider along its guide, m."""
    pose = poses[guide.guide]
    distance = poses[guide.slider].place(guide.slider_point) - pose.place(guide.point)
    return float(distance @ unit_vector(pose.turn(guide.direction)))


def corners(guide: Translational, poses: Poses, size: tuple[float, float]) -> np.ndarray:
    """Return the corners of a slider in ground axes, shape (4, 2); `size` and order are as in `box`."""
    axes = axes_along(poses[guide.guide].turn(guide.direction))
    return poses[guide.slider].place(guide.slider_point) + box(size) @ axes


def link_ends(
    bodies: Sequence[str], points: Sequence[Point], axis: Point | None, poses: Poses
) -> tuple[np.ndarray, np.ndarray]:
    """Return the two points between which a spring or drive acts, in ground axes.

    If it has an axis, the first point is projected onto the line through the second one along the axis.
    """
    first, second = (poses[body].place(point) for body, point in zip(bodies, points))
    if axis is None:
        return first, second
    along = unit_vector(poses[bodies[1]].turn(axis))
    return second + (first - second) @ along * along, second


def attachments(scene: Scene) -> dict[str, list[np.ndarray]]:
    """Return the points of each body, by name, at which joints, drives, springs or forces act on it.

    Points have the shape (2,) and are in the axes of the body. For a body that looks like a uniform rod held at one
    end, the other end is added.
    """
    points: dict[str, list[np.ndarray]] = {name: [] for name in (GROUND, *scene.bodies)}
    pairs: list[Revolute | Drive | LinearSpring] = [*scene.pins.values()]
    pairs += [drive for drive in scene.drives.values() if drive.type == "distance"]
    pairs += [spring for spring in scene.springs.values() if isinstance(spring, LinearSpring)]
    for pair in pairs:
        for body, point in zip(pair.bodies, pair.points):
            points[body].append(np.array(point))
    for load in scene.forces.values():
        if isinstance(load, Force):
            points[load.body].append(np.array(load.point))
    for name, own in scene.bodies.items():
        # Half the length l of a uniform rod with this mass and moment of inertia, m (l/2)^2/3.
        half_length = math.sqrt(3 * own.inertia / own.mass)
        for held in points[name][:]:
            if abs(np.hypot(*held) - half_length) < UNIFORM * half_length:
                points[name].append(-held)
    return points


@dataclass(frozen=True)
class View:
    """The visible part of the plane.

    Attributes
    ----------
    x, y : tuple of float
        Limits of the axes, m.
    unit : float
        Size of a symbol, m.
    reach : Mapping[str, tuple of float]
        Coordinates of the ends of each guide along its direction, m, by its name.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    unit: float
    reach: Mapping[str, tuple[float, float]]

    @property
    def size(self) -> float:
        """The longer side, m."""
        return max(self.x[1] - self.x[0], self.y[1] - self.y[0])


def view_of(scene: Scene, instants: Iterable[Poses]) -> View:
    """Return a view in which the mechanism is visible in all of the poses."""
    instants = list(instants)
    # Points that must be visible: centres of mass, attachments, and corners of sliders.
    attached = attachments(scene)
    visible: list[np.ndarray] = []
    for poses in instants:
        for name, pose in poses.items():
            if name != GROUND:
                visible.append(pose.place((0.0, 0.0)))
            visible += [pose.place(point) for point in attached[name]]
        for guide in scene.guides.values():
            visible += list(corners(guide, poses, guide.extent))
    # The size of symbols follows from these points. Guides extend beyond their sliders.
    unit = UNIT * (float(np.max(np.ptp(visible, axis=0))) or 1.0)
    reach = {}
    for name, guide in scene.guides.items():
        along = [displacement(guide, poses) for poses in instants]
        beyond = GUIDE_BEYOND * (guide.length or DEFAULT_SLIDER * unit)
        reach[name] = min(along) - beyond, max(along) + beyond
        _, width = guide.extent
        ends = [(end, side * width / 2) for end in reach[name] for side in (-1, 1)]
        for poses in instants:
            pose = poses[guide.guide]
            axes = axes_along(pose.turn(guide.direction))
            visible += list(pose.place(guide.point) + ends @ axes)
    # The lengths of arrows depend on the size of symbols. Arrows need less room than bodies.
    tips = list(_arrow_tips(scene, instants, unit))
    low = np.min([np.min(visible, axis=0) - ROOM * unit, *(tip - unit for tip in tips)], axis=0)
    high = np.max([np.max(visible, axis=0) + ROOM * unit, *(tip + unit for tip in tips)], axis=0)
    return View((float(low[0]), float(high[0])), (float(low[1]), float(high[1])), unit, reach)


def _arrow_tips(scene: Scene, instants: Sequence[Poses], unit: float) -> Iterator[np.ndarray]:
    """Yield the tips of the arrows of loads and drives, and of corner forces in a film; each of shape (2,)."""
    for poses in instants:
        for load in scene.forces.values():
            if isinstance(load, Force):
                yield from _load_tips(load, poses, unit)
        for drive in scene.drives.values():
            if drive.axis is not None:
                first, second = link_ends(drive.bodies, drive.points, drive.axis, poses)
                if np.hypot(*(first - second)) < unit:
                    axis = poses[drive.bodies[1]].turn(drive.axis)
                    yield second + AXIS_ARROW * unit * unit_vector(axis)
        for guide in scene.guides.values():
            # A film has several instants, and shows corner forces.
            if guide.length is not None and len(instants) > 1:
                length, width = guide.extent
                yield from corners(guide, poses, (length, width + 2 * LONGEST_ARROW * unit))


def _load_tips(load: Force, poses: Poses, unit: float) -> Iterator[np.ndarray]:
    """Yield the tip of the arrow of a force, for both signs unless the force is constant."""
    signs: tuple[int, ...] = (-1, 1)
    if isinstance(load.law, Constant):
        signs = (-1 if load.law.value < 0 else 1,)
    begin = poses[load.body].place(load.point)
    for sign in signs:
        yield begin + sign * LOAD_ARROW * unit * unit_vector(load.direction)
