"""The gate: a list of predicates that a trajectory has to fulfil before it is measured.

Engines are third-party code, so their results are validated before use: a trajectory of another scene, or with columns
that contradict each other, would be measured as if it were a motion. The gate does not judge accuracy; the comparisons
do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from stiction.engines.examined import (
    MODES,
    POSITIONS,
    RESIDUALS,
    ROUNDING,
    SPRING_EVENTS,
    VELOCITIES,
    Examined,
    Predicate,
    described,
    first,
    is_number,
)
from stiction.scenes import Breakdown, Cost, Event, Scene, Trajectory
from stiction.scenes.columns import BODY_COLUMNS, columns_of
from stiction.scenes.event_values import Row
from stiction.scenes.trajectory import stacked
from stiction.scenes.wording import names

MAX_GAP_STEPS = 2.0
"""Largest distance between instants, in requested output steps. An engine uses the nearest multiple of its step, which
is less than twice the request."""
_FIELDS = (
    ("engine", str, "text"),
    ("version", str, "text"),
    ("settings", Mapping, "a mapping"),
    ("cost", Cost, "a stiction.scenes.Cost"),
    ("columns", Mapping, "a mapping of arrays by name"),
    ("events", tuple, "a tuple of stiction.scenes.Event"),
)
_MAX_NAMES_SHOWN = 4
"""Number of names that a message lists at most."""


def required_columns(scene: Scene) -> list[str]:
    """Return the columns that every trajectory of a scene has: all of `stiction.scenes.Trajectory` but ``mode``.

    ``mode`` is left to engines that have contact modes.
    """
    return [name for name in columns_of(scene) if not name.endswith(".mode")]


def first_problem(run: Examined) -> str | None:
    """Return the first fault of the result of an engine, as the end of a sentence with "the engine returned".

    A result without faults, for which this is None, is a `Trajectory` that fulfils `PREDICATES` and
    `coherence.PREDICATES`.
    """
    if not isinstance(run.trajectory, Trajectory):
        return f"{described(run.trajectory)}; expected a stiction.scenes.Trajectory"
    for predicate in PREDICATES:
        for problem in predicate(run):
            return problem
    if not len(run.trajectory.t) and not run.trajectory.events:
        return None
    # imported here because it compiles kernels, which commands that only list engines do not need
    from stiction.engines import coherence

    for predicate in coherence.PREDICATES:
        for problem in predicate(run):
            return problem
    return None


def check_fields(run: Examined) -> Iterator[str]:
    """Check that the fields have their types, and are those of this scene and fidelity."""
    trajectory = run.trajectory
    for name, expected in (("scene", run.scene.name), ("fidelity", run.fidelity)):
        if getattr(trajectory, name) != expected:
            yield f"{name} {described(getattr(trajectory, name))}; expected {str(expected)!r}"
    for name, kind, words in _FIELDS:
        if not isinstance(getattr(trajectory, name), kind):
            yield f"{name} {described(getattr(trajectory, name))}; expected {words}"
    if not (isinstance(trajectory.termination, str) and trajectory.termination.strip()):
        yield f"termination {described(trajectory.termination)}; expected 'end' or why it stopped"
    cost = trajectory.cost
    seconds = (cost.setup_s, cost.compile_s, cost.stepping_s, cost.own_s)
    if not (
        all(is_number(value) and value >= 0 for value in seconds)
        and isinstance(cost.counters, Mapping)
        and all(map(is_number, cost.counters.values()))
    ):
        yield f"cost {described(cost)}; expected seconds >= 0 and finite counters"


def check_breakdown(run: Examined) -> Iterator[str]:
    """Check that a breakdown, if there is one, is within the time of the run, and that the termination is not 'end'."""
    stop = run.trajectory.breakdown
    latest = run.t_end + run.slack
    if stop is None:
        return
    if not (
        isinstance(stop, Breakdown) and is_number(stop.time) and -run.slack <= stop.time <= latest
    ):
        yield f"breakdown {described(stop)}; expected a stiction.scenes.Breakdown within 0 .. {run.t_end:g} s"
    elif run.trajectory.termination == "end":
        yield f"a breakdown ({described(stop.reason)}) and the termination 'end'; expected one of them"


def check_times(run: Examined) -> Iterator[str]:
    """Check that times are finite, begin at 0, increase by at most two output steps, and reach the requested end.

    A trajectory may have none, or an earlier end, if `termination` gives the reason.
    """
    t = run.trajectory.t
    t_end = run.t_end
    ended = run.trajectory.termination == "end"
    if not isinstance(t, np.ndarray) or t.dtype.kind not in "fiu" or t.ndim != 1:
        yield f"times {described(t)}; expected a one-dimensional array of numbers"
    if not len(t):
        if ended:
            yield "no instant at all; expected times from 0 to t_end, or a termination that says why there is no motion"
        return
    # `run.step` may be longer than the output step, and rounding is that of sums of steps.
    if (i := first(~np.isfinite(t))) is not None:
        yield f"a time that is not finite, t[{i}]; expected seconds"
    if abs(t[0]) > ROUNDING * t_end:
        yield f"times that begin at {t[0]:g} s; expected 0"
    gaps = np.diff(t.astype(float))
    if (i := first(gaps <= 0)) is not None:
        yield f"times that do not increase: {t[i]:.9g} s, then {t[i + 1]:.9g} s"
    widest = MAX_GAP_STEPS * max(run.output_step, run.step) + ROUNDING * t_end
    if (gap := np.max(gaps, initial=0.0)) > widest:
        yield f"times {gap:.9g} s apart; expected {widest:.9g} s at most, two of the output steps requested"
    if t[-1] > t_end + run.slack:
        yield f"times up to {t[-1]:.9g} s; expected t_end = {t_end:.9g} s at most"
    if ended and t[-1] < t_end - run.slack:
        yield (
            f"times up to {t[-1]:.9g} s and no reason; expected t_end = {t_end:.9g} s, or a termination that says "
            "why it stopped"
        )


def check_columns(run: Examined) -> Iterator[str]:
    """Check that all required columns are there, with one finite number per time.

    Forces may be nan where the motion does not determine them. At a start at which a run breaks down, accelerations may
    be nan too.
    """
    trajectory = run.trajectory
    missing = [name for name in required_columns(run.scene) if name not in trajectory.columns]
    if missing:
        others = (
            f" and {len(missing) - _MAX_NAMES_SHOWN} others"
            if len(missing) > _MAX_NAMES_SHOWN
            else ""
        )
        yield (
            f"no column {names(missing[:_MAX_NAMES_SHOWN])}{others}; expected all columns that the scene calls for "
            "(stiction.reference_impl.multibody.reactions.recover_columns makes them from states)"
        )
    # Columns of the state are always numbers. Values of the others that are not finite are collected
    # first, because it is costly to find out which forces are open.
    state_columns = {*run.columns(POSITIONS + VELOCITIES), *RESIDUALS}
    not_finite = {}
    for name, values in trajectory.columns.items():
        if not _is_column(values, trajectory.t.shape):
            kind = described(values)
            if isinstance(values, np.ndarray):
                kind = f"an array of {values.dtype}, shape {values.shape}"
            yield f"column {name}: {kind}; expected numbers of shape {trajectory.t.shape}, one per time"
            continue
        may_be_unknown = run.stopped_at_once and name not in state_columns
        is_finite = np.isfinite(values)
        if not is_finite.all() and not may_be_unknown:
            not_finite[name] = ~is_finite
    if not not_finite:
        return
    left_open = _left_open(run, trajectory.t, trajectory.columns)
    for name, is_wrong in not_finite.items():
        if name in left_open:
            is_wrong = is_wrong & ~left_open[name]
        if (i := first(is_wrong)) is not None:
            yield (
                f"column {name}: {trajectory[name][i]} at t = {trajectory.t[i]:.9g} s; expected finite "
                "numbers, or nan in forces that the motion leaves open"
            )


def _is_column(values: object, shape: tuple[int, ...]) -> bool:
    """Return True for an array of real numbers of this shape."""
    return isinstance(values, np.ndarray) and values.dtype.kind in "fiub" and values.shape == shape


def _left_open(
    run: Examined, t: np.ndarray, columns: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return, by column, the instants at which a force is nan and is determined neither by motion nor by friction."""
    from stiction.reference_impl.multibody.reactions import recover_columns

    left_open = dict[str, np.ndarray]()
    for part in run.parts:
        if not all(f"{body}.x" in columns for body in part.body_names):
            continue  # an event has the columns of its own part only
        # Forces are recovered from the motion and from the frictions that the engine reports. What
        # is nan there as well may be nan.
        motion = [stacked(columns, part.body_names, labels) for labels in BODY_COLUMNS]
        frictions = {name: columns[name] for name in part.force_names[part.arrays.rows :]}
        if (
            any(np.isinf(values).any() for values in frictions.values())
            or not np.isfinite(motion).all()
        ):
            continue
        q, v, a = motion
        recovered = recover_columns(part.scene, t, q, v, a, frictions, part)
        # an event may lack columns that belong to no part, such as the drift of all
        left_open |= {
            name: np.isnan(values) & np.isnan(columns[name])
            for name, values in recovered.items()
            if name in columns
        }
    return left_open


def check_events(run: Examined) -> Iterator[str]:
    """Check that events are in order of time, are of guides of the scene, and have finite values on both sides."""
    for event in run.trajectory.events:
        if not isinstance(event, Event):
            yield f"event {described(event)}; expected a stiction.scenes.Event"
    yield from _check_instants(run)
    yield from _check_sides(run)


def _check_instants(run: Examined) -> Iterator[str]:
    """Check that events are of known kinds and joints, and in order of time within the run."""
    before = 0.0
    latest = run.t_end + run.slack
    joints = {**run.scene.guides, **run.scene.bounded_elements}
    for i, event in enumerate(run.trajectory.events):
        if not is_number(event.time):
            yield f"{_named(run, i)}: time {described(event.time)}; expected finite seconds"
        if not before <= event.time <= latest:
            yield (
                f"{_named(run, i)}: t = {event.time:.9g} s after one at {before:.9g} s; expected events in order "
                f"within 0 .. {latest:.9g} s"
            )
        before = event.time
        is_of_joint = event.kind in MODES and event.joint in joints
        is_of_spring = event.kind in SPRING_EVENTS and event.joint in run.scene.one_sided_springs
        if not is_of_joint and not is_of_spring:
            yield f"{_named(run, i)}; expected {', '.join(MODES)} of a guide of the scene"


def _check_sides(run: Examined) -> Iterator[str]:
    """Check that both sides of each event have values of the same columns of the trajectory, which are finite."""
    columns = run.trajectory.columns.keys()
    checked = set[int]()
    for i, event in enumerate(run.trajectory.events):
        before, after = event.before, event.after
        if isinstance(before, Row) and isinstance(after, Row) and before.columns is after.columns:
            # The events of a run share a table: its names are checked once.
            if id(before.columns) in checked:
                continue
            checked.add(id(before.columns))
        for side, values in (("before", before), ("after", after)):
            if not isinstance(values, Mapping) or values.keys() != before.keys():
                yield (
                    f"{_named(run, i)}: {side} {described(values)}; expected values of the same columns on both sides"
                )
            elif not values.keys() <= columns:
                unknown = sorted(map(str, values.keys() - columns))
                shown = names(unknown[:_MAX_NAMES_SHOWN])
                yield f"{_named(run, i)}: {side} has {shown}; expected columns of the trajectory"
    # Forces that the motion leaves open may be nan. This is costly to find out, and only sides with
    # values that are not finite are looked at.
    for place in np.flatnonzero(~run.sides.are_finite()).tolist():
        event, side = run.sides.events[place // 2], ("before", "after")[place % 2]
        values = getattr(event, side)
        left_open = _left_open_at(run, event.time, values)
        for name, value in values.items():
            if not is_number(value) and name not in left_open:
                yield f"{_named(run, place // 2)}: {side}, {name} = {described(value)}; expected finite numbers"


def _named(run: Examined, i: int) -> str:
    """Return number, kind and guide of an event, for a message."""
    event = run.trajectory.events[i]
    return f"event {i}, {event.kind} of {event.joint}"


def _left_open_at(run: Examined, t: float, values: Mapping[str, float]) -> set[str]:
    """Return the columns of one side of an event whose force is nan, and is not determined there."""
    if not all(map(_is_number_or_nan, values.values())):
        return set()
    columns = {name: np.array([value], dtype=float) for name, value in values.items()}
    return {name for name, flags in _left_open(run, np.array([t]), columns).items() if flags[0]}


def _is_number_or_nan(value: object) -> bool:
    return is_number(value) or (isinstance(value, float) and math.isnan(value))


PREDICATES: tuple[Predicate, ...] = (
    check_fields,
    check_breakdown,
    check_times,
    check_columns,
    check_events,
)
"""Each relies on those before it."""
