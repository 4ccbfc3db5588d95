"""Jumps of the driving effort: size and time at every event of the truth, and as read off the runs of engines."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t as student

from stiction.comparisons.bench.variants import Record
from stiction.comparisons.measures.accuracy import has_two_sided_events
from stiction.engines.status import UNMADE
from stiction.scenes import Event, Trajectory
from stiction.truths import Tier, Truth

SAMPLES, GAP = (6, 10), 5
"""Samples on either side of a jump through which a parabola is laid: few, to stay within the smooth piece, or more, to
average what rings after an impulse; and intervals that the jump itself may take: with five, four samples between its
sides."""
CONFIDENCE, CERTAIN = 0.95, 2.5
"""Confidence of the interval of a size, and the least ratio of a jump's size to half its interval: of all gaps that are
tried, noise alone gets as far in one of 30 searches."""

SEARCH = 0.05
"""Seconds around a true event in which an engine's jump is sought, at least SAMPLES samples; half the distance to the
next event if that is less."""

SMALLEST = 1e-9
"""N m; events whose true jump is smaller (corner forces through zero) are kinks and have no row."""

AT_ONCE = 1e-9
"""s; events of the truth that are closer are one jump."""
COEFFICIENTS = 3
"""Of a parabola."""
ROUNDINGS = 4
"""Roundings of the largest sample that the size of a jump has: of two continuations and their difference."""

LATEST = 0.01
"""Largest distance of a reading from the true event beyond its own uncertainty, s: a step of the coarsest runs."""
FARTHEST = 0.5
"""Part of a jump that its reading may be off by: a reading of less than half of a jump is nearer to none at all."""
BOUND = "jump_bound"
"""Column: bound of the error of the size of a jump; of a jump that is not read at least its whole size."""


@dataclass(frozen=True)
class JumpEstimate:
    """A jump read off a trajectory: time (s), size, and their uncertainty from sampling."""

    time: float
    size: float
    time_uncertainty: float
    size_uncertainty: float


def torque_table(
    records: Iterable[Record], truths: Mapping[str, Truth], effort: str = "motor.effort"
) -> pd.DataFrame:
    """Return one row per run and jump of the truth; per run where it was not made or there is no truth.

    The true jump is two-sided, and for the slider-bar also known in closed form, -c sin(th) times the jump of the
    slider's acceleration; the larger of the difference of both and the truth's own uncertainty is the truth's
    uncertainty here. Located events of a run give its jumps directly; otherwise `estimate_jump`.

    A jump is ``resolved`` if it is read within `LATEST` of its time and `FARTHEST` of its size. A run that failed or
    ended early has not read the jumps that it did not reach. `BOUND` is the error and its uncertainty together.
    """
    rows = []
    for record in records:
        truth = truths[record.key]
        if truth.tier == Tier.NONE or record.outcome.status in UNMADE:
            rows.append(
                {
                    **record.describe(),
                    "truth": truth.scene,
                    "effort": effort,
                    "truth_tier": truth.effort_tier,
                    "truth_note": truth.note,
                }
            )
            continue
        rows += [
            {**record.describe(), "truth": truth.scene, **row}
            for row in jump_rows(record.trajectory, truth, effort)
        ]
    return pd.DataFrame(rows)


def jump_rows(trajectory: Trajectory | None, truth: Truth, effort: str) -> list[dict[str, Any]]:
    """Return a row per jump of the truth, read off a run as `torque_table` says; None is a run that failed."""
    return [
        _row(trajectory, truth, i, effort)
        for i, event in enumerate(truth.events)
        if effort in event.before and abs(event.jump(effort)) >= SMALLEST
    ]


def _row(trajectory: Trajectory | None, truth: Truth, i: int, effort: str) -> dict[str, Any]:
    # Two independent values of the true jump, where a closed form gives one: their difference shows
    # errors of either.
    event = truth.events[i]
    true = event.jump(effort)
    closed, difference = None, 0.0
    if truth.jump_closed_form is not None:
        closed = truth.jump_closed_form[i]
        difference = abs(true - closed)
    unsure = max(truth.uncertainty.get(effort, 0.0), difference)
    row: dict[str, Any] = {
        "effort": effort,
        "event": i,
        "event_time": event.time,
        "kind": event.kind,
        "joint": event.joint,
        "true_jump": true,
        "closed_form_jump": closed,
        "truth_tier": truth.effort_tier,
        "truth_note": truth.note,
        "true_jump_uncertainty": unsure,
    }
    estimate = _read(trajectory, truth, i, effort)
    if estimate is None:
        return {**row, "resolved": False, BOUND: abs(true) + unsure}
    # A reading that is too far off is no better than none, and has at least the bound of a jump
    # that is not read.
    error = estimate.size - true
    bound = abs(error) + estimate.size_uncertainty + unsure
    is_read = abs(error) < FARTHEST * abs(true)
    return {
        **row,
        "resolved": is_read,
        "jump": estimate.size,
        "jump_error": error,
        "jump_uncertainty": estimate.size_uncertainty + unsure,
        "time": estimate.time,
        "time_error": estimate.time - event.time,
        "time_uncertainty": estimate.time_uncertainty + truth.uncertainty.get("event time", 0.0),
        BOUND: bound if is_read else max(bound, abs(true) + unsure),
    }


def _read(trajectory: Trajectory | None, truth: Truth, i: int, effort: str) -> JumpEstimate | None:
    """The jump of a run at an event of the truth; None if the run did not reach it, or has none near enough to it."""
    event = truth.events[i]
    if trajectory is None or event.time > trajectory.t[-1]:
        return None
    estimate = None
    if has_two_sided_events(trajectory):
        located = counterpart(trajectory.events, event, effort, SEARCH)
        if located is not None and not math.isnan(located.jump(effort)):
            estimate = JumpEstimate(located.time, located.jump(effort), 0.0, 0.0)
    else:
        # Samples up to halfway to the next event; events at the same instant are one jump.
        times = np.array([event.time for event in truth.events])
        others = np.abs(np.delete(times, i) - times[i])
        half_way = 0.5 * float(np.min(others[others > AT_ONCE], initial=truth.t_end))
        estimate = estimate_jump(trajectory, event, half_way, effort)
    if estimate is None or abs(estimate.time - event.time) > LATEST + estimate.time_uncertainty:
        return None
    return estimate


def counterpart(events: Iterable[Event], event: Event, effort: str, reach: float) -> Event | None:
    """Return the event of the same kind that is nearest in time, with the effort, if it is within reach (s)."""
    alike = [
        other
        for other in events
        if (other.kind, other.joint) == (event.kind, event.joint) and effort in other.before
    ]
    nearest = min(alike, key=lambda other: abs(other.time - event.time), default=None)
    return nearest if nearest is not None and abs(nearest.time - event.time) <= reach else None


def estimate_jump(
    trajectory: Trajectory, event: Event, room: float, effort: str = "motor.effort"
) -> JumpEstimate | None:
    """Read size and time of a jump off samples.

    An engine of fixed step has one value in the step of a jump, anywhere between the two sides of it or beyond both.
    So parabolas are laid through each number of `SAMPLES` on either side of a gap of one to `GAP` intervals, and
    continued to its middle; samples in the gap belong to neither side. Of all such gaps the jump is the one whose size
    is the largest in units of its own uncertainty. Time is unsure by half the gap. Size is unsure by the standard
    error of both continuations (least squares, at `CONFIDENCE` by Student's distribution). To it comes the difference
    of their slopes over half the gap and an interval more: a value inside may belong to either side.

    Parameters
    ----------
    room : float
        Seconds on either side of the true event in which the jump is sought; samples beyond twice that, where other
        events are, are not used.

    Returns
    -------
    JumpEstimate or None
        None if the samples do not suffice, guides at rest leave one of them open, or no size exceeds `CERTAIN` times
        its uncertainty.
    """
    inside = np.abs(trajectory.t - event.time) < 2 * room
    t, values = trajectory.t[inside], trajectory[effort][inside]
    if len(t) < 2 * min(SAMPLES) or np.isnan(values).any():
        return None
    # Samples after which a gap may begin, of a coarse run at least two intervals on either side.
    reach = min(max(SEARCH, 2 * float(np.median(np.diff(t)))), room)
    near = np.flatnonzero(np.abs(t - event.time) <= reach)
    # All gaps are tried; the one that stands out most from its own scatter is the jump.
    estimates = [
        estimate
        for count, gap in product(SAMPLES, range(1, GAP + 1))
        for estimate in _over_gaps(t, values, near, count, gap)
    ]
    best = max(
        estimates, key=lambda estimate: abs(estimate.size) / estimate.size_uncertainty, default=None
    )
    return best if best is not None and abs(best.size) > CERTAIN * best.size_uncertainty else None


def _over_gaps(
    t: np.ndarray, values: np.ndarray, last: np.ndarray, count: int, gap: int
) -> Iterator[JumpEstimate]:
    """The jump over `gap` intervals after each of the samples `last` that has `count` samples on either side."""
    last = last[(last >= count - 1) & (last + gap + count <= len(t))]
    middle, half = (t[last + gap] + t[last]) / 2, (t[last + gap] - t[last]) / 2
    before, slope_before, squares_before, leverage_before = _continued(
        t, values, last - count + 1, count, middle
    )
    after, slope_after, squares_after, leverage_after = _continued(
        t, values, last + gap, count, middle
    )
    # Standard error of the difference: both parabolas share one deviation of a sample, estimated
    # from the residuals of both with the degrees of freedom that their coefficients leave.
    freedom = 2 * (count - COEFFICIENTS)
    deviation = np.sqrt((squares_before + squares_after) / freedom)
    error = (
        student.ppf((1 + CONFIDENCE) / 2, freedom)
        * deviation
        * np.sqrt(leverage_before + leverage_after)
    )
    # Where in the gap the jump is matters if the slopes differ; one interval more, as a value may
    # be of either side.
    bend = np.abs(slope_after - slope_before) * (half + 2 * half / gap)
    # Samples of a constant have no residuals: the rounding of the differences is left.
    unsure = error + bend + ROUNDINGS * np.spacing(np.max(np.abs(values)))
    return map(
        JumpEstimate, middle.tolist(), (after - before).tolist(), half.tolist(), unsure.tolist()
    )


def _continued(
    t: np.ndarray, values: np.ndarray, first: np.ndarray, count: int, to: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Continue parabolas through `count` samples from each of `first` on to the instants `to`; all of shape (n,).

    Value and slope there, sum of the squared residuals of the samples, and the value's variance over a sample's.
    """
    # Least squares for all windows at once, in powers of the time from `to` in units of the window:
    # the constant term is the value there.
    window = first[:, None] + np.arange(count)
    scale = t[window[:, -1]] - t[window[:, 0]]
    powers = ((t[window] - to[:, None]) / scale[:, None])[..., None] ** np.arange(COEFFICIENTS)
    inverse = np.linalg.inv(np.swapaxes(powers, 1, 2) @ powers) @ np.swapaxes(powers, 1, 2)
    coefficients = (inverse @ values[window][..., None])[..., 0]
    off = values[window] - (powers @ coefficients[..., None])[..., 0]
    return (
        coefficients[:, 0],
        coefficients[:, 1] / scale,
        np.sum(off**2, axis=1),
        np.sum(inverse[:, 0] ** 2, axis=1),
    )
