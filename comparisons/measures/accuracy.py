"""Errors of runs against the truth: position, velocity, torque, events."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stiction.comparisons.measures.distances import Graph, l1, match_events, value_at
from stiction.engines.status import Status
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Event, Scene, Trajectory
from stiction.truths import Tier, Truth
from stiction.uncertain import Uncertain

EVENT_WINDOW = 0.05
"""Seconds within which a found event matches a true one of the same kind; otherwise both count, missed and spurious."""

KINDS = ("slip", "stick", "reversal", "corner")
"""Kinds of events."""
POSITIONS, VELOCITIES = ("x", "y"), ("vx", "vy")
"""Labels of columns whose largest errors are the position and the velocity error."""

AT_ONCE = 2**17
"""Intervals whose area is found together: of a table of millions of rows there is memory for some of them at a time."""
TORQUE_ERROR = "torque_error"


def size_of(scene: Scene) -> float:
    """Return the largest extent of points, positions and sliders that the scene declares, m."""
    return Mechanism(scene, stabilization="none").arrays.length_scale


def errors(trajectory: Trajectory | None, truth: Truth, size: float = math.inf) -> dict[str, Any]:
    """Return the errors of one run; without a run or a truth there are none (``truth_note`` gives the reason).

    Position and velocity are continuous: their errors are the largest ones over all bodies and
    output times. The efforts of drives jump: their error is the mean of |error| over time, for the
    drive with the largest mean. It is missing where guides at rest leave an effort undetermined.
    ``time_covered`` is the end of the run, which may be early.

    Parameters
    ----------
    size
        The mechanism's, m, see `size_of`. A position error above it, and above the largest coordinate of the true
        motion, is the ``reason`` of a row with the ``status`` `Status.WRONG`, instead of those of `Record.describe`.
    """
    row: dict[str, Any] = {"truth": truth.scene, "truth_tier": truth.tier, "truth_note": truth.note}
    if trajectory is None or len(trajectory.t) < 2 or truth.tier == Tier.NONE:
        return row
    exact = truth(trajectory.t)
    row["time_covered"] = float(trajectory.t[-1])

    # A run whose positions are off by more than the mechanism is large has nothing to measure: its
    # row has no numbers.
    places = _columns_of(trajectory, exact, POSITIONS)
    if places:
        error = _largest_error(trajectory, exact, places)
        reach = max(size, *(float(np.max(np.abs(exact[name]))) for name in places))
        if not error <= reach:
            return row | _wrong(trajectory, error, reach)

    # Continuous quantities: the largest error over all bodies and instants.
    for label, names in (
        ("position", places),
        ("velocity", _columns_of(trajectory, exact, VELOCITIES)),
    ):
        if names:
            row[f"{label}_error"] = _largest_error(trajectory, exact, names)
            row[f"{label}_uncertainty"] = max(truth.uncertainty.get(name, 0.0) for name in names)

    # Efforts jump: the mean over time, of the drive that is worst.
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
    """Columns with one of some labels that both a run and its truth have."""
    return [name for name in exact if name.rpartition(".")[2] in labels and name in trajectory]


def _largest_error(
    trajectory: Trajectory, exact: Mapping[str, np.ndarray], names: Sequence[str]
) -> float:
    return max(float(np.max(np.abs(trajectory[name] - exact[name]))) for name in names)


def _wrong(trajectory: Trajectory, error: float, reach: float) -> dict[str, str]:
    """Status and reason of a run that does not approximate the motion; they replace those of `Record.describe`."""
    stopped = "" if trajectory.termination == "end" else f"; {trajectory.termination}"
    reason = (
        f"position error {error:.2g} m, where the mechanism and its motion measure "
        f"{reach:.2g} m{stopped}"
    )
    return {"status": Status.WRONG, "reason": reason}


def missed(kind: str) -> str:
    """Return the name of the column that counts the events of a kind that a run misses."""
    return f"{kind}_events_missed"


def _event_errors(trajectory: Trajectory, truth: Truth) -> dict[str, Any]:
    """Compare the events of a run that locates events with all those of the truth, whichever kinds it locates."""
    if not trajectory.events and not (truth.events and trajectory.engine == "reference"):
        return {}
    # Only what the run could have found: events up to its end, on the guides whose events count.
    true = [event for event in truth.events if event.time <= trajectory.t[-1]]
    located = [
        event for event in trajectory.events if truth.guides is None or event.joint in truth.guides
    ]
    matched = match_events(true, located, EVENT_WINDOW)
    absent = Counter(event.kind for event in matched.missed)
    kinds = {event.kind for event in true}
    return {
        "event_time_error": matched.time_error,
        "event_time_uncertainty": truth.uncertainty.get("event time", 0.0),
        "events_matched": len(matched.matched),
        "events_missed": len(matched.missed),
        "events_spurious": len(matched.spurious),
        **{missed(kind): absent[kind] for kind in KINDS if kind in kinds},
    }


def effort_error(trajectory: Trajectory, truth: Truth, name: str) -> Uncertain | None:
    """Return the mean of the effort's |error| over time, from the method's own values.

    Intervals in which the truth leaves the effort undetermined (nan), as where a motor holds
    against friction or several efforts give the same motion, are excluded from the mean. None if no
    other interval is left.

    Values are compared at the instants of the run and on both sides of its events, where they are
    its own. Between them the error is interpolated, not the effort, so that the result depends on
    the output instants only through the curvature of the error. At an event of the truth the error
    of a run that locates events jumps by the truth's jump. A run without located events jumps at an
    unknown instant of an output interval: the uncertainty then contains the truth's jump over the
    whole interval.
    """
    effort = graph(trajectory, name)
    t, error = effort.t, effort.values - truth(effort.t)[name]
    inner = [event for event in _inside(truth, t) if name in event.before]
    times = np.array([event.time for event in inner])
    # beside an open stretch there is no jump to add
    jumps = np.nan_to_num([event.jump(name) for event in inner])
    unsure = 0.0
    if not has_two_sided_events(trajectory):
        # When the run jumps within an output interval is not known: by up to the whole interval.
        right = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
        unsure = float(np.sum(np.abs(jumps) * (t[right] - t[right - 1])))
    elif len(inner):
        # The error itself jumps at the truth's events, between instants of the run. Without the
        # truth's jumps it is smooth there and can be interpolated; then the jumps are put back, as
        # two values at each event.
        passed = np.cumsum(jumps)
        smooth = Graph(t, error + np.append(0.0, passed)[np.searchsorted(times, t, side="right")])
        left = value_at(smooth, times, "before")
        t, error = _in_order((times, left - passed + jumps), (times, left - passed), (t, error))

    # The mean over the stretches in which truth and run determine the effort.
    span, value, uncertainty = 0.0, 0.0, unsure
    for first, behind in _known_stretches(error):
        part_t, part = t[first:behind], error[first:behind]
        if part_t[-1] > part_t[0]:
            span += part_t[-1] - part_t[0]
            for mean in _areas(part_t, part):
                value += mean.value
                uncertainty += mean.uncertainty
    if span == 0.0:
        return None
    return Uncertain(value / span, uncertainty / span + truth.uncertainty.get(name, 0.0))


def _areas(t: np.ndarray, values: np.ndarray) -> Iterator[Uncertain]:
    """The area below |values|, of `AT_ONCE` intervals at a time: the parts add up to that of all."""
    for first in range(0, len(t) - 1, AT_ONCE):
        part_t, part = (numbers[first : first + AT_ONCE + 1] for numbers in (t, values))
        if part_t[-1] > part_t[0]:
            yield l1(Graph(part_t, part), Graph(part_t[[0, -1]], np.zeros(2)))


def _known_stretches(values: np.ndarray) -> list[tuple[int, int]]:
    """Return the first place and the place behind the last of each stretch of values that are not nan."""
    known = np.concatenate([[False], ~np.isnan(values), [False]])
    return [
        (int(first), int(behind))
        for first, behind in np.flatnonzero(np.diff(known.astype(int))).reshape(-1, 2)
    ]


def graph(trajectory: Trajectory, column: str) -> Graph:
    """Return a column over time, jumps at located events as vertical lines."""
    frame = replace(trajectory, columns={column: trajectory[column]}).to_frame(
        events=has_two_sided_events(trajectory)
    )
    return Graph(frame["t"].to_numpy(), frame[column].to_numpy())


def is_known(trajectory: Trajectory, column: str) -> bool:
    """Check that a run has a column throughout: forces that guides at rest leave open are nan."""
    return (
        column in trajectory
        and not np.isnan(trajectory[column]).any()
        and not any(
            np.isnan(side[column])
            for event in trajectory.events
            for side in (event.before, event.after)
            if column in side
        )
    )


def has_two_sided_events(trajectory: Trajectory) -> bool:
    """Check that there are events, and that they carry the values from both sides of the instant."""
    return bool(trajectory.events) and all(
        event.before and event.after for event in trajectory.events
    )


def truth_over_time(truth: Truth, column: str, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of the truth at times t, with both values at its events; nan where it is left open."""
    inner = _inside(truth, t)
    times = [event.time for event in inner]
    return _in_order(
        (t, truth(t)[column]),
        (times, [event.before[column] for event in inner]),
        (times, [event.after[column] for event in inner]),
    )


def _inside(truth: Truth, t: np.ndarray) -> list[Event]:
    return [event for event in truth.events if t[0] < event.time < t[-1]]


def _in_order(*parts: tuple[Any, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of several parts in order of time; where times are equal, in that of the parts."""
    times, values = map(np.concatenate, zip(*parts))
    order = np.argsort(times, kind="stable")
    return times[order], values[order]
