"""Places of the parts of a mechanism in the plane, for drawing it; points are rows of arrays, m."""

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
"""Size of a symbol by the size of what is shown."""
ROOM = 3.5
"""Symbols between what is shown and the frame."""
LOAD_ARROW, AXIS_ARROW, LONGEST_ARROW = 5.0, 4.0, 5.0
"""Symbols: length of a load, of a drive along an axis whose coordinate is near 0, of the largest corner force."""
UNIFORM = 1e-6
"""Relative difference up to which a body pinned at one end has the inertia of a uniform rod."""


@dataclass(frozen=True)
class Pose:
    """Position of a body: its centre of mass, m, and its angle, rad."""

    x: float
    y: float
    angle: float

    def place(self, points: Sequence[float] | np.ndarray) -> np.ndarray:
        """Points in the axes of the body, in ground axes; shape (2,) or (n, 2)."""
        return np.array([self.x, self.y]) + self.turn(points)

    def turn(self, vectors: Sequence[float] | np.ndarray) -> np.ndarray:
        """Vectors in the axes of the body, in ground axes; shape (2,) or (n, 2)."""
        x, y = np.asarray(vectors, dtype=float).T
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([c * x - s * y, s * x + c * y]).T


Poses = Mapping[str, Pose]
_STANDING = {GROUND: Pose(0.0, 0.0, 0.0)}


def poses_at_start(scene: Scene) -> Poses:
    """Pose of each body and of the ground, by name, at t = 0."""
    return _STANDING | {
        name: Pose(*body.position, body.angle) for name, body in scene.bodies.items()
    }


def poses_at(scene: Scene, trajectory: Trajectory | Mapping[str, np.ndarray], row: int) -> Poses:
    """Pose of each body and of the ground, by name, at a row of a trajectory or of its columns."""
    return _STANDING | {
        name: Pose(*(float(trajectory[f"{name}.{key}"][row]) for key in ("x", "y", "angle")))
        for name in scene.bodies
    }


def unit_vector(direction: Point) -> np.ndarray:
    """Unit vector in a direction; shape (2,)."""
    return np.array(direction) / np.hypot(direction[0], direction[1])


def axes_along(direction: Point) -> np.ndarray:
    """Rows: the unit vector in a direction and its normal, turned by +90 degrees.

    ``points @ axes_along(d)`` are points given along a direction and across it, ``axes_along(d) @ point`` is the
    reverse.
    """
    along = unit_vector(direction)
    return np.array([along, [-along[1], along[0]]])


def box(size: Sequence[float]) -> np.ndarray:
    """Corners 1 lower rear, 2 lower front, 3 upper front, 4 upper rear, along a guide and across it; shape (4, 2)."""
    return np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * size / 2


def displacement(guide: Translational, poses: Poses) -> float:
    """Displacement of the slider along its guide, m."""
    pose = poses[guide.guide]
    way = poses[guide.slider].place(guide.slider_point) - pose.place(guide.point)
    return float(way @ unit_vector(pose.turn(guide.direction)))


def corners(guide: Translational, poses: Poses, size: tuple[float, float]) -> np.ndarray:
    """Corners of a slider of a length and width, in ground axes, numbered as by `box`; shape (4, 2)."""
    axes = axes_along(poses[guide.guide].turn(guide.direction))
    return poses[guide.slider].place(guide.slider_point) + box(size) @ axes


def link_ends(
    bodies: Sequence[str], points: Sequence[Point], axis: Point | None, poses: Poses
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points, in ground axes, between which a spring or drive acts; along its axis, if it has one."""
    first, second = (poses[body].place(point) for body, point in zip(bodies, points))
    if axis is None:
        return first, second
    along = unit_vector(poses[bodies[1]].turn(axis))
    return second + (first - second) @ along * along, second


def attachments(scene: Scene) -> dict[str, list[np.ndarray]]:
    """Return by body the points, in its own axes, at which something acts on it; each of shape (2,)."""
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
        # half the length of a uniform rod of this mass and moment of inertia, m l^2/3
        rod = math.sqrt(3 * own.inertia / own.mass)
        for held in points[name][:]:
            if abs(np.hypot(*held) - rod) < UNIFORM * rod:
                # a uniform rod held at an end: the other end is drawn too
                points[name].append(-held)
    return points


@dataclass(frozen=True)
class View:
    """Limits of the axes, m; size of symbols, m; how far each guide reaches along its direction, m."""

    x: tuple[float, float]
    y: tuple[float, float]
    unit: float
    reach: Mapping[str, tuple[float, float]]

    @property
    def size(self) -> float:
        """The longer side, m."""
        return max(self.x[1] - self.x[0], self.y[1] - self.y[0])


def view_of(scene: Scene, instants: Iterable[Poses]) -> View:
    """Make a view that all the instants fit into."""
    # All that must be seen: bodies with what is attached to them, and sliders, at every instant.
    instants = list(instants)
    held = attachments(scene)
    shown = [
        pose.place(point)
        for poses in instants
        for name, pose in poses.items()
        for point in (held[name] if name == GROUND else [np.zeros(2), *held[name]])
    ]
    shown += [
        corner
        for guide in scene.guides.values()
        for poses in instants
        for corner in corners(guide, poses, (guide.length or 0.0, guide.width or 0.0))
    ]
    # Symbols are sized by that; guides reach somewhat beyond where their sliders come.
    unit = UNIT * (float(np.max(np.ptp(shown, axis=0))) or 1.0)
    reach = {}
    for name, guide in scene.guides.items():
        along = [displacement(guide, poses) for poses in instants]
        beyond = 1.2 * (guide.length or 3 * unit)
        reach[name] = min(along) - beyond, max(along) + beyond
        ends = [(s, side * (guide.width or 0.0) / 2) for s in reach[name] for side in (-1, 1)]
        for pose in (poses[guide.guide] for poses in instants):
            shown += [*(pose.place(guide.point) + ends @ axes_along(pose.turn(guide.direction)))]
    # Arrows have a length in symbols, so that they come last; they need less room than bodies.
    tips = [*_arrow_tips(scene, instants, unit)]
    low = np.min([np.min(shown, axis=0) - ROOM * unit, *(tip - unit for tip in tips)], axis=0)
    high = np.max([np.max(shown, axis=0) + ROOM * unit, *(tip + unit for tip in tips)], axis=0)
    return View((float(low[0]), float(high[0])), (float(low[1]), float(high[1])), unit, reach)


def _arrow_tips(scene: Scene, instants: Sequence[Poses], unit: float) -> Iterator[np.ndarray]:
    """Yield tips of the arrows of loads and drives, in a film those of corner forces as well; each of shape (2,)."""
    for poses in instants:
        for load in scene.forces.values():
            if isinstance(load, Force):
                # a load that changes may push either way
                signs: tuple[int, ...] = (-1, 1)
                if isinstance(load.law, Constant):
                    signs = (-1 if load.law.value < 0 else 1,)
                for sign in signs:
                    yield poses[load.body].place(
                        load.point
                    ) + sign * LOAD_ARROW * unit * unit_vector(load.direction)
        for drive in scene.drives.values():
            if drive.axis is not None:
                first, second = link_ends(drive.bodies, drive.points, drive.axis, poses)
                if np.hypot(*(first - second)) < unit:
                    yield second + AXIS_ARROW * unit * unit_vector(
                        poses[drive.bodies[1]].turn(drive.axis)
                    )
        for guide in scene.guides.values():
            if guide.length is not None and len(instants) > 1:
                yield from corners(
                    guide, poses, (guide.length, (guide.width or 0.0) + 2 * LONGEST_ARROW * unit)
                )
