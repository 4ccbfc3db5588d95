"""Checks whether a trajectory fits its mechanism, and whether its columns and events fit each other.

A trajectory that passes need not be accurate, but its columns and events belong to one motion of the mechanism, at the
same instants. The checks of forces are in `force_coherence`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from stiction.engines.examined import (
    MODES,
    POSITIONS,
    RESIDUALS,
    ROUNDING,
    VELOCITIES,
    Examined,
    InEquations,
    Predicate,
    first,
)
from stiction.engines.force_coherence import (
    ENGINES_OWN,
    SAME,
    check_balance,
    check_cone,
    check_corner_forces,
    check_dissipation,
    check_momentum_of_steps,
    largest_magnitude,
    velocity_scale,
)
from stiction.reference_impl.multibody.initial_state import CONSISTENT
from stiction.reference_impl.multibody.mechanism import TRANSLATIONAL
from stiction.reference_impl.multibody.trajectory_columns import (
    GUIDE_COLUMNS,
    LIMIT_COLUMNS,
    PIN_SLIP,
    guide_motion,
    limited_motion,
    residual_norms,
    slip_velocity,
)
from stiction.scenes import Event
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.event_values import Sides
from stiction.scenes.trajectory import stacked

__all__ = [
    "PREDICATES",
    "check_balance",
    "check_cone",
    "check_continuity",
    "check_corner_forces",
    "check_displacements",
    "check_dissipation",
    "check_modes",
    "check_momentum_of_steps",
    "check_residuals",
    "check_residuals_at_events",
    "check_start",
    "check_unreported_events",
    "check_velocities",
]

START = 1e-6
"""Largest distance of the first state from the scene's start, relative to the mechanism's size; for velocities,
relative to the size per second or the largest speed at the start. Scene files satisfy their constraints to 1e-9
(`CONSISTENT`); engines that compute in single precision (eps = 6e-8) round the start."""
DRIFT = 1e-6
"""Accuracy of the residuals that a trajectory reports for its own states: relative, and absolute in units of the
mechanism's size."""


def check_start(run: Examined) -> Iterator[str]:
    """Check that the first state is the scene's start.

    If the scene's start does not satisfy the constraints, the engine may have assembled the mechanism, and the start is
    not checked.
    """
    if not len(run.trajectory.t):
        return
    q, v, _ = run.motion
    start_q, start_v = run.start
    [position], [velocity] = _residuals(run, np.zeros(1), start_q[None], start_v[None])
    speed = velocity_scale(run, start_v)
    if position > CONSISTENT * run.size or velocity > CONSISTENT * speed:
        return
    for values, expected, labels, size in (
        (q[0], start_q, POSITIONS, run.size),
        (v[0], start_v, VELOCITIES, speed),
    ):
        i = first(~(np.abs(values - expected) <= START * size))
        if i is not None:
            yield (
                f"a start that is not the scene's: {run.columns(labels)[i]} = {values[i]:.9g}; expected "
                f"{expected[i]:.9g} within {START * size:.1g}"
            )


def check_residuals(run: Examined) -> Iterator[str]:
    """Check that states satisfy the constraints at the start and roughly later, and that residuals fit the states."""
    t = run.trajectory.t
    if not len(t):
        return
    q, v, _ = run.motion
    norms = _residuals(run, t.astype(float), q, v, run.in_equations)
    is_constrained = bool(run.scene.joints or run.scene.drives)
    i = first(~(norms[0] <= run.size))
    if i is not None and is_constrained:
        yield (
            f"states that have left the mechanism: {norms[0][i]:.3g} m off the constraints at t = {t[i]:.9g} s; "
            f"expected less than its size, {run.size:.3g} m"
        )
    sizes = (run.size, velocity_scale(run, run.start[1]))
    for name, residual, size, unit in zip(RESIDUALS, norms, sizes, ("m", "m/s")):
        if not residual[0] <= START * size:
            yield f"a start that is {residual[0]:.3g} {unit} off the constraints; expected at most {START * size:.1g}"
        reported = run.trajectory[name]
        i = first(~_agrees(reported, residual, size))
        if i is not None:
            yield (
                f"{name} = {reported[i]:.6g} at t = {t[i]:.9g} s; expected {residual[i]:.6g}, the residual "
                "of its states"
            )


def check_residuals_at_events(run: Examined) -> Iterator[str]:
    """Check that the residuals on both sides of events are those of the states there.

    The constraint of a drive depends on time, so that values of a neighbouring sample are noticed.
    """
    position = run.columns(POSITIONS)
    velocity = run.columns(VELOCITIES)
    sides = run.sides.with_columns({*position, *velocity, *RESIDUALS})
    if not len(sides):
        return
    q = np.stack([sides[name] for name in position], axis=1)
    v = np.stack([sides[name] for name in velocity], axis=1)
    sizes = (run.size, velocity_scale(run, v))
    for name, residual, size in zip(RESIDUALS, _residuals(run, sides.t, q, v), sizes):
        reported = sides[name]
        i = first(~_agrees(reported, residual, size))
        if i is not None:
            yield (
                f"{sides.label(i)}, {name} = {reported[i]:.6g}; expected {residual[i]:.6g}, the residual of its "
                "states then"
            )


def check_velocities(run: Examined) -> Iterator[str]:
    """Check that velocities are the derivatives of positions.

    Along the direction of its velocity, the positions of a body must change by the integral of the velocity; means are
    removed from both. Between two instants a velocity is uncertain by its change there: half of the change is the error
    of the trapezoidal rule, and the other half that of engines that use the velocity at the end of a step. Intervals in
    which velocities change by their own size are not judged. Means are removed because a vibration whose period is one
    interval would bias them. Motions that are small compared with the mechanism and with the longest distance are not
    judged either, because engines correct positions by as much.
    """
    size = run.size
    h = np.diff(run.trajectory.t.astype(float))
    # Translation and rotation of each body are judged separately.
    motions = []
    for body in run.scene.bodies:
        motions.append(_BodyMotion.translation(run, body))
        motions.append(_BodyMotion.rotation(run, body))
    # Choose the intervals in which the velocities of all bodies together change by less than
    # themselves.
    jump = np.sum([motion.jump for motion in motions], axis=0)
    acceleration = np.sum([motion.acceleration for motion in motions], axis=0)
    speed = np.sqrt(sum(_square(motion.mean) for motion in motions))
    is_judged = _change(h, jump, acceleration) < speed
    if not is_judged.any():
        return
    # Compare the distances by positions and by velocities, both about their means.
    h_judged = h[is_judged]
    begin = run.trajectory.t[:-1][is_judged]
    centred = [motion.without_means(is_judged, h_judged) for motion in motions]
    speeds = [np.sqrt(_square(mean)) for _, mean in centred]
    small = ENGINES_OWN * (size + max(h_judged @ speed for speed in speeds))
    for motion, (moved, mean), speed in zip(motions, centred, speeds):
        distance = h_judged @ speed
        if distance <= small:
            continue
        along = sum(change * velocity for change, velocity in zip(moved, mean))
        by_position = along / np.where(speed > 0, speed, 1.0)
        unknown = h_judged * _change(h, motion.jump, motion.acceleration)[is_judged]
        allowed = np.sum(unknown) + small
        if abs(np.sum(by_position) - distance) > allowed:
            i = int(np.argmax(np.abs(by_position - h_judged * speed) - unknown))
            scale = motion.scale
            yield (
                f"velocities of {motion.body} ({motion.velocity_labels}) that are not those of its positions: "
                f"about their mean they move it by {distance / scale:.4g} {motion.unit}, its positions by "
                f"{np.sum(by_position) / scale:.4g} {motion.unit}, and differ most from t = {begin[i]:.9g} s on; "
                f"expected the same within {allowed / scale:.2g} {motion.unit}"
            )


class _BodyMotion(NamedTuple):
    """Translation or rotation of a body between neighbouring instants.

    Angles are multiplied by the size of the mechanism, so that all coordinates are lengths.

    Attributes
    ----------
    body, velocity_labels : str
        The body, and the columns of its velocity, for messages.
    scale : float
        Factor by which the columns are multiplied: 1, or the size of the mechanism (m).
    unit : str
        Unit of the coordinates before they are multiplied.
    moved, mean : list of ndarray, shape (n - 1,)
        For each coordinate, its change in each interval, and the mean of the velocities at both ends.
    jump : ndarray, shape (n - 1,)
        Square of the change of the velocity.
    acceleration : ndarray, shape (n,)
        Square of the acceleration at the instants.
    """

    body: str
    velocity_labels: str
    scale: float
    unit: str
    moved: list[np.ndarray]
    mean: list[np.ndarray]
    jump: np.ndarray
    acceleration: np.ndarray

    @staticmethod
    def translation(run: Examined, body: str) -> _BodyMotion:
        """Read the motion of a body's centre of mass."""
        return _BodyMotion._of(run, body, slice(0, 2), 1.0, "m")

    @staticmethod
    def rotation(run: Examined, body: str) -> _BodyMotion:
        """Read the rotation of a body."""
        return _BodyMotion._of(run, body, slice(2, 3), run.size, "rad")

    @staticmethod
    def _of(run: Examined, body: str, chosen: slice, scale: float, unit: str) -> _BodyMotion:
        """Read the chosen labels of positions, velocities and accelerations of a body."""
        q, v, a = (
            [scale * run.trajectory[f"{body}.{label}"].astype(float) for label in labels[chosen]]
            for labels in BODY_COLUMNS
        )
        return _BodyMotion(
            body=body,
            velocity_labels=", ".join(VELOCITIES[chosen]),
            scale=scale,
            unit=unit,
            moved=[np.diff(values) for values in q],
            mean=[(values[1:] + values[:-1]) / 2 for values in v],
            jump=_square([np.diff(values) for values in v]),
            acceleration=_square(a),
        )

    def without_means(
        self, is_judged: np.ndarray, h: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Return `moved` and `mean` in the judged intervals, of lengths h (s), without their mean velocity there."""
        duration = h.sum()
        moved = [values[is_judged] for values in self.moved]
        mean = [values[is_judged] for values in self.mean]
        moved_about_mean = [values - h * (values.sum() / duration) for values in moved]
        mean_about_mean = [values - h @ values / duration for values in mean]
        return moved_about_mean, mean_about_mean


def check_displacements(run: Examined) -> Iterator[str]:
    """Check that displacements and slip velocities of joints, and those of limited drives, are those of the states."""
    for part in run.parts:
        q = stacked(run.trajectory.columns, part.body_names, POSITIONS)
        v = stacked(run.trajectory.columns, part.body_names, VELOCITIES)
        # Displacements are compared with the largest coordinate, slip velocities with the largest
        # velocity.
        sizes = [max(part.arrays.length_scale, float(np.max(np.abs(values)))) for values in (q, v)]
        for k, name in enumerate([*part.scene.joints, *part.scene.drives]):
            expected_of: dict[str, tuple[np.ndarray, float]] = {}
            if part.arrays.constraint[k]["kind"] == TRANSLATIONAL:
                motion = guide_motion(part.arrays, k, q, v)
                expected_of = dict(zip(GUIDE_COLUMNS, zip(motion, sizes)))
            elif name in part.scene.limited_drives:
                drive = part.scene.drives[name]
                motion = limited_motion(drive, part.body_names, run.trajectory.t, q, v)
                # the law may be faster, or further, than all bodies
                expected_of = {
                    label: (values, max(size, largest_magnitude(values)))
                    for label, values, size in zip(LIMIT_COLUMNS, motion, reversed(sizes))
                }
            elif name in part.guide_names:
                expected_of = {PIN_SLIP: (slip_velocity(part.arrays, k, q, v), sizes[1])}
            for label, (expected, size) in expected_of.items():
                yield from run.differs(
                    f"{name}.{label}", expected, SAME * size, "that of its states"
                )


def check_modes(run: Examined) -> Iterator[str]:
    """Check that modes are -1, 0 or 1, and change only at the events of their guide, according to the kinds of these.

    If corner events are located, the surfaces that the corners of a slipping guide touch do not change either, if it
    has a coefficient of friction.
    """
    trajectory = run.trajectory
    locates_corners = any(event.kind == "corner" for event in trajectory.events)
    for name in run.scene.bounded_elements:
        column = f"{name}.mode"
        if column not in trajectory.columns:
            continue
        mode = trajectory[column]
        i = first(~np.isin(mode, (-1, 0, 1)))
        if i is not None:
            yield f"{column} = {mode[i]} at t = {trajectory.t[i]:.9g} s; expected -1, 0 or 1"
        events = [
            event for event in trajectory.events if event.joint == name and column in event.before
        ]
        if events:
            # A table of a few columns may have the mode of a guide and not all of its corner forces. Corners of a guide
            # without a coefficient of friction have no events.
            has_corners = getattr(run.scene.bounded_elements[name], "mu", None) is not None and all(
                force in trajectory.columns for force in _corner_forces(name)
            )
            yield from _check_sequence(run, events, name, has_corners and locates_corners)
            yield from _check_modes_between(run, events, column)


def _check_sequence(
    run: Examined, events: Sequence[Event], name: str, check_surfaces: bool
) -> Iterator[str]:
    """Check that each event of a guide changes the mode by its kind, from the mode after the previous event.

    With `check_surfaces`, the corners must also touch the same surfaces between two events.
    """
    sides = Sides(events)
    mode = sides[f"{name}.mode"]
    before, after = mode[::2], mode[1::2]
    for event, old, new in zip(events, before.tolist(), after.tolist()):
        if not MODES[event.kind](old, new):
            yield (
                f"{event.kind} of {name} at t = {event.time:.9g} s: mode {old:g} before and {new:g} after; expected "
                f"those of a {event.kind}"
            )
    # Each event ends in the mode, and on the surfaces, in which the next one begins, and is reported
    # once.
    is_broken = after[:-1] != before[1:]
    if check_surfaces:
        is_broken |= _other_surfaces(run, name, sides)
    is_same_instant = np.diff(sides.t[1::2]) == 0.0
    for i in np.flatnonzero(is_broken | is_same_instant).tolist():
        event, following = events[i], events[i + 1]
        if is_broken[i] or event == following:
            yield (
                f"{event.kind} of {name} at t = {event.time:.9g} s, then {following.kind} at "
                f"{following.time:.9g} s: the contact mode after the first is not that before the second; "
                "expected every event once"
            )


def _check_modes_between(run: Examined, events: Sequence[Event], column: str) -> Iterator[str]:
    """Check that samples between two events of a guide have its mode there; at an event, both modes are accepted."""
    t, values = run.trajectory.t, run.trajectory[column]
    times = np.array([event.time for event in events])
    # `mode[k]` is the mode between the events k - 1 and k. Rounding of the times decides whether a
    # sample at an event is before or after it: it may have any of the modes from `earliest` to `latest`.
    mode = np.concatenate([[events[0].before[column]], Sides(events)[column][1::2]])
    earliest = np.searchsorted(times, t - ROUNDING * t[-1], "left")
    latest = np.searchsorted(times, t + ROUNDING * t[-1], "right")
    for i in np.flatnonzero((values != mode[earliest]) & (values != mode[latest])):
        if values[i] not in mode[earliest[i] : latest[i] + 1]:
            yield f"{column} = {values[i]:g} at t = {t[i]:.9g} s; expected {mode[latest[i]]:g}, that between its events"


def _other_surfaces(run: Examined, name: str, sides: Sides) -> np.ndarray:
    """Return flags of pairs of neighbouring events between which a corner of a slipping guide changes its surface."""
    forces = _corner_forces(name)
    threshold = SAME * max(largest_magnitude(run.trajectory[force]) for force in forces)
    presses = [sides[force] > threshold for force in forces]
    after_first = slice(1, -1, 2)
    before_second = slice(2, None, 2)
    slips = sides[f"{name}.mode"][after_first] != 0
    # The corners 1 and 4 are at the rear of a slider, 2 and 3 at its front, on opposite surfaces.
    opposite = ((0, 3), (3, 0), (1, 2), (2, 1))
    changes = [presses[i][after_first] & presses[j][before_second] for i, j in opposite]
    return slips & np.any(changes, axis=0)


def _corner_forces(name: str) -> list[str]:
    """Return the columns of the corner forces of a guide."""
    return [f"{name}.F{corner}" for corner in (1, 2, 3, 4)]


def check_unreported_events(run: Examined) -> Iterator[str]:
    """Check that each change of a guide's mode has an event, if the engine locates events.

    A change is one between two equal modes and two other ones: at an event, a single sample may have either mode.
    """
    trajectory = run.trajectory
    if not run.locates(trajectory.settings):
        return
    for name, element in run.scene.bounded_elements.items():
        if not element.rubs:
            continue
        mode = trajectory.columns.get(f"{name}.mode")
        if mode is None:
            speed = trajectory[f"{name}.slip_velocity"]
            mode = np.where(np.abs(speed) > SAME * np.max(np.abs(speed)), np.sign(speed), 0.0)
        times = np.array([event.time for event in trajectory.events if event.joint == name])
        changes = (mode[:-3] == mode[1:-2]) & (mode[1:-2] != mode[2:-1]) & (mode[2:-1] == mode[3:])
        for i in 1 + np.flatnonzero(changes):
            if not np.any((times >= trajectory.t[i - 1]) & (times <= trajectory.t[i + 2])):
                yield (
                    f"no event of {name} between t = {trajectory.t[i]:.9g} and {trajectory.t[i + 1]:.9g} s, "
                    f"where its mode goes from {mode[i]:g} to {mode[i + 1]:g}; expected one there, as the "
                    "engine says that it locates events"
                )


def check_continuity(run: Examined) -> Iterator[str]:
    """Check that positions and velocities do not jump at an event, beyond rounding and the error of a step."""
    for labels in (POSITIONS, VELOCITIES):
        columns = run.columns(labels)
        largest = max(float(np.max(np.abs(run.trajectory[name]))) for name in columns)
        allowed = ENGINES_OWN * largest + SAME * run.size
        for name in columns:
            sides = run.sides.with_columns({name})
            before, after = sides[name][::2], sides[name][1::2]
            i = first(np.abs(after - before) > allowed)
            if i is not None:
                event = sides.events[i]
                yield (
                    f"{event.kind} of {event.joint} at t = {event.time:.9g} s: {name} = {before[i]:.9g} before and "
                    f"{after[i]:.9g} after; expected no jump of a state"
                )


def _while_moving(predicate: Predicate) -> Predicate:
    """Return a predicate that is skipped if there is no motion."""

    def of_motion(run: Examined) -> Iterator[str]:
        has_motion = len(run.trajectory.t) and not run.stopped_at_once
        return predicate(run) if has_motion else iter(())

    return of_motion


def _residuals(
    run: Examined,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    evaluated: Sequence[InEquations | None] = (),
) -> np.ndarray:
    """Return the norms of Phi and Phi' over all parts, shape (2, n).

    Parameters
    ----------
    run : Examined
        The run, whose mechanisms are used.
    t : ndarray, shape (n,)
        Times, s.
    q, v : ndarray, shape (n, 3 * bodies)
        Coordinates and velocities of all bodies, in the order of the scene.
    evaluated : sequence
        For each part, its equations at these states if they were evaluated already.
    """
    # A part has its bodies in an order of its own. Norms of parts add up as squares.
    first_coordinate = {body: 3 * i for i, body in enumerate(run.scene.bodies)}
    total = np.zeros((2, len(t)))
    for part, equations in zip_longest(run.parts, evaluated):
        if equations is not None:
            total += np.square((equations.position, equations.velocity))
            continue
        coordinates = [first_coordinate[body] + k for body in part.body_names for k in range(3)]
        norms = residual_norms(
            part.arrays,
            part.workspace,
            t,
            np.ascontiguousarray(q[:, coordinates]),
            np.ascontiguousarray(v[:, coordinates]),
        )
        total += np.square(norms)
    return np.sqrt(total)


def _agrees(reported: np.ndarray, residual: np.ndarray, size: float) -> np.ndarray:
    """Return flags of the instants at which the reported residual is that of the states."""
    # A run that diverges has residuals that overflow here; a nan agrees with nothing.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.abs(reported - residual) <= DRIFT * (size + residual)


def _square(vectors: Sequence[np.ndarray]) -> np.ndarray:
    """Return the squares of the lengths of vectors, which are given by their components."""
    return np.sum([component * component for component in vectors], axis=0)


def _change(h: np.ndarray, jump: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Return the largest change of velocities in intervals of lengths h (s), shape (n - 1,).

    It is the change from end to end, or that by the larger acceleration at both ends.

    Parameters
    ----------
    h : ndarray, shape (n - 1,)
        Lengths of the intervals, s.
    jump : ndarray, shape (n - 1,)
        Squares of the changes from end to end.
    acceleration : ndarray, shape (n,)
        Squares of the accelerations.
    """
    return np.sqrt(np.maximum(jump, h * h * np.maximum(acceleration[1:], acceleration[:-1])))


_OF_MOTION: tuple[Predicate, ...] = (
    check_velocities,
    check_displacements,
    check_dissipation,
    check_momentum_of_steps,
    check_balance,
    check_corner_forces,
    check_modes,
    check_unreported_events,
    check_cone,
    check_continuity,
)
PREDICATES: tuple[Predicate, ...] = (
    check_start,
    check_residuals,
    check_residuals_at_events,
    *map(_while_moving, _OF_MOTION),
)
"""All checks, in the order in which they are made."""
