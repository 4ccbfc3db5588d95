"""Errors of runs against the truth: position, velocity, torque, events."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
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

AT_ONCE = 2**17
"""Intervals whose area is found together: of a table of millions of rows there is memory for some of them at a time."""
TORQUE_ERROR = "torque_error"


def size_of(scene: Scene) -> float:
    """Return the largest extent of points, positions and sliders that the scene declares, m."""
    return Mechanism(scene, stabilization="none").arrays.length_scale


def errors(trajectory: Trajectory | None, truth: Truth, size: float = math.inf) -> dict[str, Any]:
    """Return the errors of one run; empty values where there is no run, or no truth (`truth note` says why).

    Position and velocity errors are the largest over all bodies and output times (both are continuous). The efforts of
    drives jump: their error is the mean of |error| over time, the largest of all drives; empty where guides at rest
    leave an effort open. The time covered is stated, also of a run that ended early.

    Parameters
    ----------
    size
        The mechanism's, m, see `size_of`. A position error above it, and above the largest coordinate of the true
        motion, is the ``reason`` of a row with the ``status`` `Status.WRONG`, instead of those of `Record.describe`.
    """
    row: dict[str, Any] = {"truth": truth.scene, "truth_tier": truth.tier, "truth_note": truth.note}
    if trajectory is None or len(trajectory.t) < 2 or truth.tier == Tier.NONE:
        return row
    t = trajectory.t
    exact = truth(t)
    row["time_covered"] = float(t[-1])
    for label, suffixes in (("position", ("x", "y")), ("velocity", ("vx", "vy"))):
        names = [
            name for name in exact if name.rpartition(".")[2] in suffixes and name in trajectory
        ]
        if names:
            error = max(float(np.max(np.abs(trajectory[name] - exact[name]))) for name in names)
            reach = max(size, *(float(np.max(np.abs(exact[name]))) for name in names))
            if label == "position" and not error <= reach:
                stopped = "" if trajectory.termination == "end" else f"; {trajectory.termination}"
                return {
                    **row,
                    "status": Status.WRONG,
                    "reason": f"position error {error:.2g} m, where the mechanism and its "
                    f"motion measure {reach:.2g} m{stopped}",
                }
            row[f"{label}_error"] = error
            row[f"{label}_uncertainty"] = max(truth.uncertainty.get(name, 0.0) for name in names)
    efforts = [name for name in exact if name.endswith(".effort") and is_known(trajectory, name)]
    means = [
        mean for name in efforts if (mean := effort_error(trajectory, truth, name)) is not None
    ]
    if means:
        mean = max(means, key=lambda error: error.value)
        row |= {TORQUE_ERROR: mean.value, "torque_uncertainty": mean.uncertainty}
    return row | _event_errors(trajectory, truth)


def missed(kind: str) -> str:
    """Return the name of the column of the events of a kind that a run does not have."""
    return f"{kind}_events_missed"


def _event_errors(trajectory: Trajectory, truth: Truth) -> dict[str, Any]:
    """Compare the events of a run that locates events with all those of the truth, whichever kinds it locates."""
    if not trajectory.events and not (truth.events and trajectory.engine == "reference"):
        return {}
    true = [event for event in truth.events if event.time <= trajectory.t[-1]]
    found = [
        event for event in trajectory.events if truth.guides is None or event.joint in truth.guides
    ]
    matched = match_events(true, found, EVENT_WINDOW)
    absent, kinds = Counter(event.kind for event in matched.missed), {event.kind for event in true}
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

    Stretches in which the truth leaves the effort open (nan), as where a motor holds against friction or several
    efforts give one motion, are not charged for: the mean is over the others. None where there are none.

    Values are compared at the instants of the run and on both sides of its events, where they are its own. Between
    them the error is interpolated, not the effort, so that the result depends on the output instants as little as the
    error is curved. At an event of the truth the error of a run that locates events jumps by the truth's jump. Where
    within an output interval a run without located events jumps is not known: there the uncertainty has the truth's
    jump over the whole interval.
    """
    found = graph(trajectory, name)
    t, error = found.t, found.values - truth(found.t)[name]
    inner = [event for event in _inside(truth, t) if name in event.before]
    times = np.array([event.time for event in inner])
    jumps = np.nan_to_num(
        [event.jump(name) for event in inner]
    )  # beside an open stretch there is no jump to add
    unsure = 0.0
    if not has_two_sided_events(trajectory):
        right = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
        unsure = float(np.sum(np.abs(jumps) * (t[right] - t[right - 1])))
    elif len(inner):
        passed = np.cumsum(jumps)
        smooth = Graph(t, error + np.append(0.0, passed)[np.searchsorted(times, t, side="right")])
        left = value_at(smooth, times, "before")
        t, error = _in_order((times, left - passed + jumps), (times, left - passed), (t, error))
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
