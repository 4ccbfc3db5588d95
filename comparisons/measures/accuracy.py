"""Errors of runs compared with the truth: position, velocity, torque, events."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stiction.comparisons.measures.distances import Graph, l1, match_events, value_at
from stiction.engines.protocol import PRECISION
from stiction.engines.status import Status
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Event, Scene, Trajectory
from stiction.truths import Tier, Truth
from stiction.uncertain import Uncertain

EVENT_WINDOW = 0.05
"""Largest difference of the times of an event of the run and a true event of the same kind that
match, s. If there is no match, the true event is missed, and the event of the run is spurious."""

KINDS = ("slip", "stick", "reversal", "corner")
"""Kinds of events."""
POSITIONS = ("x", "y")
"""Labels of the columns whose largest error is the position error."""
VELOCITIES = ("vx", "vy")
"""Labels of the columns whose largest error is the velocity error."""

AT_ONCE = 2**17
"""Number of intervals that are integrated together. It limits the memory for tables with millions
of rows."""
TORQUE_ERROR = "torque_error"
"""Column: mean over time of the error of a drive's effort, N m or N."""


def size_of(scene: Scene) -> float:
    """Return the largest extent of the points, positions and sliders in a scene, m."""
    return Mechanism(scene, stabilization="none").arrays.length_scale


def errors(trajectory: Trajectory | None, truth: Truth, size: float = math.inf) -> dict[str, Any]:
    """Return the errors of one run as columns of a table.

    Positions and velocities are continuous: their errors are the largest ones over all bodies and
    output times. The efforts of drives have jumps: their error is the mean of |error| over time,
    for the drive with the largest mean. It is missing if guides at rest leave an effort
    undetermined. ``time_covered`` is the end of the run, which may be earlier than the end of the
    scene.

    Parameters
    ----------
    trajectory : Trajectory or None
        None if the run failed; then there are no errors.
    truth : Truth
        If its tier is `Tier.NONE`, there are no errors, and ``truth_note`` gives the reason.
    size : float
        Size of the mechanism, m, see `size_of`. If the position error is larger than this size and
        than the largest coordinate of the true motion, the row has no errors. Instead it has a
        ``status``, `Status.WRONG`, and a ``reason``, which replace those of `Record.describe`.
    """
    row: dict[str, Any] = {"truth": truth.scene, "truth_tier": truth.tier, "truth_note": truth.note}
    if trajectory is None or len(trajectory.t) < 2 or truth.tier == Tier.NONE:
        return row
    exact = truth(trajectory.t)
    row["time_covered"] = float(trajectory.t[-1])

    # A run with a position error larger than the mechanism does not approximate its motion.
    positions = _columns_of(trajectory, exact, POSITIONS)
    if positions:
        error = _largest_error(trajectory, exact, positions)
        limit = max(size, *(float(np.max(np.abs(exact[name]))) for name in positions))
        if not error <= limit:  # so written that it includes nan
            return row | _wrong(trajectory, error, limit)

    # Continuous quantities: the largest error over all bodies and instants.
    velocities = _columns_of(trajectory, exact, VELOCITIES)
    for label, names in (("position", positions), ("velocity", velocities)):
        if names:
            row[f"{label}_error"] = _largest_error(trajectory, exact, names)
            row[f"{label}_uncertainty"] = max(
                truth.uncertainty.get(name, 0.0) + rounding_effect(trajectory, name)
                for name in names
            )

    # Efforts: the largest mean over time of all drives.
    efforts = [name for name in exact if name.endswith(".effort") and is_known(trajectory, name)]
    effort_errors = [effort_error(trajectory, truth, name) for name in efforts]
    known_errors = [error for error in effort_errors if error is not None]
    if known_errors:
        worst = max(known_errors, key=lambda error: error.value)
        row |= {TORQUE_ERROR: worst.value, "torque_uncertainty": worst.uncertainty}
    return row | _event_errors(trajectory, truth)


def _columns_of(
    trajectory: Trajectory, exact: Mapping[str, np.ndarray], labels: tuple[str, ...]
) -> list[str]:
    """Return the columns with one of some labels that both a run and its truth contain."""
    return [name for name in exact if name.rpartition(".")[2] in labels and name in trajectory]


def _largest_error(
    trajectory: Trajectory, exact: Mapping[str, np.ndarray], names: Sequence[str]
) -> float:
    """Return the largest |error| of some columns."""
    return max(float(np.max(np.abs(trajectory[name] - exact[name]))) for name in names)


def _wrong(trajectory: Trajectory, error: float, limit: float) -> dict[str, str]:
    """Return status and reason of a run whose position error (m) is above the limit (m)."""
    termination = "" if trajectory.termination == "end" else f"; {trajectory.termination}"
    reason = (
        f"position error {error:.2g} m, where the mechanism and its motion measure "
        f"{limit:.2g} m{termination}"
    )
    return {"status": Status.WRONG, "reason": reason}


def missed(kind: str) -> str:
    """Return the name of the column that counts the events of a kind that a run misses."""
    return f"{kind}_events_missed"


def _event_errors(trajectory: Trajectory, truth: Truth) -> dict[str, Any]:
    """Return the errors of the events of a run, if it locates events.

    All kinds of true events are expected, even if the engine cannot locate some of them.
    """
    # The reference always locates events: if it has none, it has missed those of the truth.
    locates_events = trajectory.events or trajectory.engine == "reference" and truth.events
    if not locates_events:
        return {}
    # true events up to the end of the run, and events of the guides whose events count
    true = [event for event in truth.events if event.time <= trajectory.t[-1]]
    located = [
        event for event in trajectory.events if truth.guides is None or event.joint in truth.guides
    ]
    comparison = match_events(true, located, EVENT_WINDOW)
    missed_of_kind = Counter(event.kind for event in comparison.missed)
    true_kinds = {event.kind for event in true}
    return {
        "event_time_error": comparison.time_error,
        "event_time_uncertainty": truth.uncertainty.get("event time", 0.0),
        "events_matched": len(comparison.matched),
        "events_missed": len(comparison.missed),
        "events_spurious": len(comparison.spurious),
        **{missed(kind): missed_of_kind[kind] for kind in KINDS if kind in true_kinds},
    }


def effort_error(trajectory: Trajectory, truth: Truth, name: str) -> Uncertain | None:
    """Return the mean of |error| of an effort over time.

    Intervals in which the truth leaves the effort undetermined (nan) are excluded, for example if a
    motor holds against friction, or if several efforts result in the same motion. Returns None if
    no other interval remains.

    The values of the run are used where it has values: at its output times and on both sides of its
    events. Between them the error is interpolated, and not the effort, so that the result depends
    on the output times only by the curvature of the error. At a true event, the error of a run that
    locates events has the jump of the truth. A run that does not locate events jumps somewhere in
    an output interval; therefore the uncertainty contains the true jump over the whole interval.
    """
    effort = graph(trajectory, name)
    t, error = effort.t, effort.values - truth(effort.t)[name]
    events = [event for event in _inside(truth, t) if name in event.before]
    times = np.array([event.time for event in events])
    # The jump is nan beside an interval in which the truth is undetermined, which is excluded.
    jumps = np.nan_to_num([event.jump(name) for event in events])
    jump_area = 0.0  # uncertainty of the integral of |error|
    if not has_two_sided_events(trajectory):
        right = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
        jump_area = float(np.sum(np.abs(jumps) * (t[right] - t[right - 1])))
    elif len(events):
        # The error jumps at true events, which lie between the samples of the error. It is smooth
        # after the sum of all previous jumps has been added, and can be interpolated. Then the sum
        # is subtracted again, which yields two values at each event.
        sums = np.cumsum(jumps)
        sum_at_sample = np.append(0.0, sums)[np.searchsorted(times, t, side="right")]
        smooth = value_at(Graph(t, error + sum_at_sample), times, "before")
        after = smooth - sums
        before = after + jumps
        t, error = _in_order((times, before), (times, after), (t, error))

    # The mean over all intervals in which both truth and run determine the effort.
    duration, area, uncertainty = 0.0, 0.0, jump_area
    for first, end in _known_ranges(error):
        part_t, part_error = t[first:end], error[first:end]
        if part_t[-1] > part_t[0]:
            duration += part_t[-1] - part_t[0]
            for part_area in _areas(part_t, part_error):
                area += part_area.value
                uncertainty += part_area.uncertainty
    if duration == 0.0:
        return None
    own = truth.uncertainty.get(name, 0.0) + rounding_effect(trajectory, name)
    return Uncertain(area / duration, uncertainty / duration + own)


def rounding_effect(trajectory: Trajectory, name: str) -> float:
    """Return how far a column of a run depends on the rounding of its inputs, in the unit of the column.

    It is the setting `PRECISION` of runs in single precision, and zero if it was not measured.
    """
    return float(trajectory.settings.get(PRECISION, {}).get(name, 0.0))


def _areas(t: np.ndarray, values: np.ndarray) -> Iterator[Uncertain]:
    """Yield the integrals of |values| over `AT_ONCE` intervals at a time."""
    for first in range(0, len(t) - 1, AT_ONCE):
        part_t = t[first : first + AT_ONCE + 1]
        part = values[first : first + AT_ONCE + 1]
        if part_t[-1] > part_t[0]:
            zero = Graph(part_t[[0, -1]], np.zeros(2))
            yield l1(Graph(part_t, part), zero)


def _known_ranges(values: np.ndarray) -> list[tuple[int, int]]:
    """Return the ranges of indices (first, end) of successive values that are not nan, end excluded."""
    is_known = np.concatenate([[False], ~np.isnan(values), [False]])
    changes = np.flatnonzero(np.diff(is_known.astype(int)))
    return [(int(first), int(end)) for first, end in changes.reshape(-1, 2)]


def graph(trajectory: Trajectory, column: str) -> Graph:
    """Return a column as a function of time, with jumps at located events."""
    frame = replace(trajectory, columns={column: trajectory[column]}).to_frame(
        events=has_two_sided_events(trajectory)
    )
    return Graph(frame["t"].to_numpy(), frame[column].to_numpy())


def is_known(trajectory: Trajectory, column: str) -> bool:
    """Return whether a run has a column without nan, which denotes forces that guides at rest leave undetermined."""
    if column not in trajectory or np.isnan(trajectory[column]).any():
        return False
    sides = [side for event in trajectory.events for side in (event.before, event.after)]
    return not any(np.isnan(side[column]) for side in sides if column in side)


def has_two_sided_events(trajectory: Trajectory) -> bool:
    """Return whether there are events, and all of them have values on both sides."""
    return bool(trajectory.events) and all(
        event.before and event.after for event in trajectory.events
    )


def truth_over_time(truth: Truth, column: str, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of the truth at times t and on both sides of its events; nan if undetermined."""
    inner = _inside(truth, t)
    times = [event.time for event in inner]
    return _in_order(
        (t, truth(t)[column]),
        (times, [event.before[column] for event in inner]),
        (times, [event.after[column] for event in inner]),
    )


def _inside(truth: Truth, t: np.ndarray) -> list[Event]:
    """Return the events between the first and the last of some times."""
    return [event for event in truth.events if t[0] < event.time < t[-1]]


def _in_order(*parts: tuple[Any, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return the times and values of several parts sorted by time, and by the order of the parts if equal."""
    times, values = map(np.concatenate, zip(*parts))
    order = np.argsort(times, kind="stable")
    return times[order], values[order]
