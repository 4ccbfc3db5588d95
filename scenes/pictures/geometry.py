"""Where the parts of a mechanism are in the plane, for drawing it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant
from stiction.scenes.model import Force, LinearSpring, Revolute, Scene, Translational
from stiction.scenes.trajectory import Trajectory

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
    """Where a body is: its centre of mass, m, and its angle, rad."""

    x: float
    y: float
    angle: float

    def place(self, point: Sequence[float]) -> np.ndarray:
        """A point in the axes of the body, in ground axes; shape (2,)."""
        return np.array([self.x, self.y]) + self.turn(point)

    def turn(self, vector: Sequence[float]) -> np.ndarray:
        """A vector in the axes of the body, in ground axes; shape (2,)."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


Poses = Mapping[str, Pose]


def poses_at_start(scene: Scene) -> Poses:
    """By name of the body, the ground among them, at t = 0."""
    return {GROUND: Pose(0.0, 0.0, 0.0)} | {name: Pose(*body.position, body.angle) for name, body in scene.bodies.items()}


def poses_at(scene: Scene, trajectory: Trajectory | Mapping[str, np.ndarray], row: int) -> Poses:
    """By name of the body, the ground among them, at a row of a trajectory or of its columns."""
    return {GROUND: Pose(0.0, 0.0, 0.0)} | {
        name: Pose(*(float(trajectory[f"{name}.{key}"][row]) for key in ("x", "y", "angle"))) for name in scene.bodies}


def guide_frame(guide: Translational, poses: Poses) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Point of a guide's line, unit vector along it, normal (that turned by +90 degrees), in ground axes; each of shape (2,)."""
    pose = poses[guide.guide]
    along = pose.turn(guide.direction)
    along = along / np.hypot(*along)
    return pose.place(guide.point), along, np.array([-along[1], along[0]])


def displacement(guide: Translational, poses: Poses) -> float:
    """Of the slider along its guide, m."""
    point, along, _ = guide_frame(guide, poses)
    return float((poses[guide.slider].place(guide.slider_point) - point) @ along)


def corners(guide: Translational, poses: Poses, size: tuple[float, float]) -> np.ndarray:
    """The slider's corners 1 lower rear, 2 lower front, 3 upper front, 4 upper rear, shape (4, 2), for a length and width."""
    _, along, normal = guide_frame(guide, poses)
    centre, (a, b) = poses[guide.slider].place(guide.slider_point), size
    return np.array([centre + p * a / 2 * along + q * b / 2 * normal for p, q in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


def spring_ends(bodies: Sequence[str], points: Sequence[Sequence[float]], axis: Sequence[float] | None, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
    """The two points, in ground axes, between which a spring or drive acts; along its axis, if it has one."""
    first, second = (poses[body].place(point) for body, point in zip(bodies, points))
    if axis is None:
        return first, second
    along = poses[bodies[1]].turn(axis)
    along = along / np.hypot(*along)
    return second + (first - second) @ along * along, second


def attachments(scene: Scene) -> dict[str, list[np.ndarray]]:
    """By body the points, in its own axes, at which something acts on it; each of shape (2,)."""
    points: dict[str, list[np.ndarray]] = {name: [] for name in (GROUND, *scene.bodies)}
    pairs = [joint for joint in scene.joints.values() if isinstance(joint, Revolute)]
    pairs += [drive for drive in scene.drives.values() if drive.type == "distance"]
    pairs += [spring for spring in scene.springs.values() if isinstance(spring, LinearSpring)]
    for pair in pairs:
        for body, point in zip(pair.bodies, pair.points):
            points[body].append(np.array(point))
    for load in scene.forces.values():
        if isinstance(load, Force):
            points[load.body].append(np.array(load.point))
    for name, body in scene.bodies.items():
        rod = math.sqrt(3 * body.inertia / body.mass)
        for point in points[name][:]:
            if abs(np.hypot(*point) - rod) < UNIFORM * rod:  # a uniform rod held at an end: the other end is drawn too
                points[name].append(-point)
    return points


@dataclass(frozen=True)
class View:
    """What is shown: limits of the axes, m; size of symbols, m; how far each guide reaches along its direction, m."""

    x: tuple[float, float]
    y: tuple[float, float]
    unit: float
    reach: Mapping[str, tuple[float, float]]

    @property
    def size(self) -> float:
        """The longer side, m."""
        return max(self.x[1] - self.x[0], self.y[1] - self.y[0])


def view_of(scene: Scene, instants: Iterable[Poses]) -> View:
    """A view that all the instants fit into."""
    instants = list(instants)
    held = attachments(scene)
    points = np.array([pose.place(point) for poses in instants for name, pose in poses.items()
                       for point in (held[name] if name == GROUND else [(0.0, 0.0), *held[name]])])
    boxes = [corners(guide, poses, (guide.length or 0.0, guide.width or 0.0)) for guide in scene.guides.values() for poses in instants]
    points = np.concatenate([points, *boxes])
    low, high = points.min(axis=0), points.max(axis=0)
    unit = UNIT * (max(high - low) or 1.0)
    reach = {}
    for name, guide in scene.guides.items():
        along = [displacement(guide, poses) for poses in instants]
        beyond = 1.2 * (guide.length or 3 * unit)
        reach[name] = min(along) - beyond, max(along) + beyond
        frames = [guide_frame(guide, poses) for poses in instants]
        ends = [point + s * direction + side * (guide.width or 0.0) / 2 * normal
                for point, direction, normal in frames for s in reach[name] for side in (-1, 1)]
        low, high = np.minimum(low, np.min(ends, axis=0)), np.maximum(high, np.max(ends, axis=0))
    low, high, tips = low - ROOM * unit, high + ROOM * unit, [*_arrow_tips(scene, instants, unit)]
    if tips:
        low, high = np.minimum(low, np.min(tips, axis=0) - unit), np.maximum(high, np.max(tips, axis=0) + unit)
    return View((float(low[0]), float(high[0])), (float(low[1]), float(high[1])), unit, reach)


def _arrow_tips(scene: Scene, instants: Sequence[Poses], unit: float) -> Iterator[np.ndarray]:
    """Ends of the arrows of loads and drives that may stand out and, in a film, of the forces on corners; each of shape (2,)."""
    for poses in instants:
        for load in scene.forces.values():
            if isinstance(load, Force):
                arrow, value = LOAD_ARROW * unit * np.array(load.direction) / np.hypot(*load.direction), load.law
                for sign in (-1 if value.value < 0 else 1,) if isinstance(value, Constant) else (-1, 1):
                    yield poses[load.body].place(load.point) + sign * arrow
        for drive in scene.drives.values():
            if drive.axis is not None:
                first, second = spring_ends(drive.bodies, drive.points, drive.axis, poses)
                if np.hypot(*(first - second)) < unit:
                    axis = poses[drive.bodies[1]].turn(drive.axis)
                    yield second + AXIS_ARROW * unit * axis / np.hypot(*axis)
        for guide in scene.guides.values():
            if guide.length is not None and len(instants) > 1:
                yield from corners(guide, poses, (guide.length, (guide.width or 0.0) + 2 * LONGEST_ARROW * unit))
