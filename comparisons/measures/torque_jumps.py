"""Jumps of the effort of a drive at events: true size and time, and those determined from the samples of runs."""

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
from stiction.comparisons.measures.distances import match_events
from stiction.engines.status import UNMADE
from stiction.scenes import Event, Trajectory
from stiction.truths import Tier, Truth

SAMPLES_PER_SIDE = (6, 10)
"""Numbers of samples on either side of a jump to which a parabola is fitted. Both are tried: fewer
samples do not leave the smooth part of the effort; more samples average oscillations after an
impulse."""
MAX_GAP_INTERVALS = 5
"""Largest number of output intervals between the samples of both sides, which the jump may extend
over."""
CONFIDENCE = 0.95
"""Level of the confidence interval of the size of a jump."""
MIN_SIGNAL_TO_NOISE = 2.5
"""Smallest ratio of the size of a jump to half its interval. As several gaps are tried, noise alone
reaches this ratio in one of 30 searches."""
SEARCH_RADIUS_S = 0.05
"""Distance from a true event up to which the jump of a run is searched for, s; less if other events
are near, and more if there are too few samples."""
MIN_TRUE_JUMP = 1e-9
"""Smallest size of a true jump that has a row, N m or N. The effort is continuous at other events,
for example if a corner force passes through zero."""
NO_JUMP = "the effort does not jump"
"""Note on a truth without any jump. An example is a motor at constant speed where a pin reverses: friction jumps at
a zero rate, at which it takes no power."""
SIMULTANEOUS_S = 1e-9
"""Difference of times below which several true events are one jump, s."""
PARABOLA_COEFFICIENTS = 3
"""Number of coefficients of a parabola."""
ROUNDING_ERRORS = 4
"""Rounding error of the size of a jump, in units of that of the largest sample: two extrapolations
and a difference."""
MAX_TIME_ERROR_S = 0.01
"""Largest difference of the times of a jump in a run and of the true event, beyond its uncertainty,
s. It is one step of the coarsest runs."""
MAX_RELATIVE_ERROR = 0.5
"""Largest error of a resolved jump, relative to the true jump. With a larger error, it could as
well be no jump."""
BOUND = "jump_bound"
"""Column: bound of the error of a jump's size; for a jump that is not resolved, at least its whole
size."""


@dataclass(frozen=True)
class JumpEstimate:
    """A jump determined from a trajectory.

    Attributes
    ----------
    time, time_uncertainty : float
        s.
    size, size_uncertainty : float
        In the unit of the effort, N m or N.
    """

    time: float
    size: float
    time_uncertainty: float
    size_uncertainty: float


def torque_table(
    records: Iterable[Record], truths: Mapping[str, Truth], effort: str = "motor.effort"
) -> pd.DataFrame:
    """Return the table of jumps, one row for each run and true jump.

    A run that was not executed, has no truth, or whose true effort does not jump, has a single row without a jump.

    The true jump is the difference of both sides of an event. For the slider-bar, a closed form is
    known as well, -c sin(th) times the jump of the slider's acceleration; if its difference from
    the first value is larger than the uncertainty of the truth, this difference is the uncertainty.
    The jumps of a run that locates events are those of its events. The jumps of other runs are
    determined by `estimate_jump`.

    A jump is ``resolved`` if the errors of time and size are below `MAX_TIME_ERROR_S` and `MAX_RELATIVE_ERROR`. Jumps
    that a run does not reach are not resolved. `BOUND` is the sum of the error of the size and its
    uncertainty.
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
        jumps = jump_rows(record.trajectory, truth, effort)
        if not jumps:
            jumps = [{"effort": effort, "truth_tier": truth.effort_tier, "truth_note": NO_JUMP}]
        rows += [{**record.describe(), "truth": truth.scene, **row} for row in jumps]
    return pd.DataFrame(rows)


def jump_rows(trajectory: Trajectory | None, truth: Truth, effort: str) -> list[dict[str, Any]]:
    """Return the rows of `torque_table` for one run; None is a run that failed."""
    located_jumps: dict[int, JumpEstimate] | None = None
    if trajectory is not None and has_two_sided_events(trajectory):
        located_jumps = _located_jumps(trajectory, truth, effort)
    rows = []
    for i, event in enumerate(truth.events):
        if effort not in event.before or abs(event.jump(effort)) < MIN_TRUE_JUMP:
            continue
        # Jumps after the end of a run do not exist in it.
        estimate = None
        if trajectory is not None and event.time <= trajectory.t[-1]:
            if located_jumps is not None:
                estimate = located_jumps.get(i)
            else:
                estimate = _sampled_jump(trajectory, truth, i, effort)
        rows.append(_row(truth, i, estimate, effort))
    return rows


def _located_jumps(trajectory: Trajectory, truth: Truth, effort: str) -> dict[int, JumpEstimate]:
    """Return the jumps at the located events of a run, by the indices of the true events.

    Each located event belongs to at most one true event of the same kind and joint, within `MAX_TIME_ERROR_S` of it.
    """
    located = [event for event in trajectory.events if effort in event.before]
    index_of = {id(event): i for i, event in enumerate(truth.events)}
    jumps = {}
    for true_event, event in match_events(truth.events, located, MAX_TIME_ERROR_S).matched:
        size = event.jump(effort)
        if not math.isnan(size):
            jumps[index_of[id(true_event)]] = JumpEstimate(event.time, size, 0.0, 0.0)
    return jumps


def _sampled_jump(trajectory: Trajectory, truth: Truth, i: int, effort: str) -> JumpEstimate | None:
    """Return the jump at the i-th event of the truth by `estimate_jump`.

    Returns None if there is none within `MAX_TIME_ERROR_S` of the event.
    """
    event = truth.events[i]
    # The jump is searched for up to half the distance to the nearest other event.
    times = np.array([event.time for event in truth.events])
    distances = np.abs(np.delete(times, i) - times[i])
    nearest = float(np.min(distances[distances > SIMULTANEOUS_S], initial=truth.t_end))
    estimate = estimate_jump(trajectory, event, 0.5 * nearest, effort)
    if (
        estimate is None
        or abs(estimate.time - event.time) > MAX_TIME_ERROR_S + estimate.time_uncertainty
    ):
        return None
    return estimate


def _row(truth: Truth, i: int, estimate: JumpEstimate | None, effort: str) -> dict[str, Any]:
    """Return the row of the jump at the i-th event of the truth; the estimate of a run without it is None."""
    event = truth.events[i]
    true_jump = event.jump(effort)
    true_uncertainty = truth.uncertainty.get(effort, 0.0)
    closed_form = None
    if truth.jump_closed_form is not None:
        closed_form = truth.jump_closed_form[i]
        true_uncertainty = max(true_uncertainty, abs(true_jump - closed_form))
    row: dict[str, Any] = {
        "effort": effort,
        "event": i,
        "event_time": event.time,
        "kind": event.kind,
        "joint": event.joint,
        "true_jump": true_jump,
        "closed_form_jump": closed_form,
        "truth_tier": truth.effort_tier,
        "truth_note": truth.note,
        "true_jump_uncertainty": true_uncertainty,
    }
    if estimate is None:
        return {**row, "resolved": False, BOUND: abs(true_jump) + true_uncertainty}
    error = estimate.size - true_jump
    uncertainty = estimate.size_uncertainty + true_uncertainty
    bound = abs(error) + uncertainty
    is_resolved = abs(error) < MAX_RELATIVE_ERROR * abs(true_jump)
    if not is_resolved:
        # It could as well be no jump, whose error is the whole true jump.
        bound = max(bound, abs(true_jump) + true_uncertainty)
    return {
        **row,
        "resolved": is_resolved,
        "jump": estimate.size,
        "jump_error": error,
        "jump_uncertainty": uncertainty,
        "time": estimate.time,
        "time_error": estimate.time - event.time,
        "time_uncertainty": estimate.time_uncertainty + truth.uncertainty.get("event time", 0.0),
        BOUND: bound,
    }


def nearest_event(events: Iterable[Event], event: Event, effort: str, reach: float) -> Event | None:
    """Return the nearest event of the same kind and joint that has the effort; None if none is within reach (s)."""
    candidates = [
        other
        for other in events
        if other.kind == event.kind and other.joint == event.joint and effort in other.before
    ]
    nearest = min(candidates, key=lambda other: abs(other.time - event.time), default=None)
    if nearest is None or abs(nearest.time - event.time) > reach:
        return None
    return nearest


def estimate_jump(
    trajectory: Trajectory, event: Event, room: float, effort: str = "motor.effort"
) -> JumpEstimate | None:
    """Determine size and time of a jump from samples near a true event.

    An engine with fixed steps has one value in the step of a jump, which may be anywhere between or
    beyond the values of both sides. Therefore parabolas are fitted to samples on either side of a
    gap of one to `MAX_GAP_INTERVALS` intervals, and extrapolated to the middle of the gap; samples within the gap
    belong to neither side. This is done for each number of `SAMPLES_PER_SIDE` and all gaps. The jump is the
    one whose size is the largest relative to its uncertainty.

    The uncertainty of the time is half the gap. The uncertainty of the size is that of both
    extrapolations (least squares, at the level `CONFIDENCE` by Student's distribution), plus the
    difference of their slopes times half the gap and one interval, because the time of the jump
    within the gap is unknown.

    Parameters
    ----------
    trajectory : Trajectory
    event : Event
        The true event.
    room : float
        Largest distance of the jump from the true event, s. Samples at more than twice this
        distance are not used, because other events may be there.
    effort : str
        Column of the effort.

    Returns
    -------
    JumpEstimate or None
        None if there are too few samples, or one of them is nan (undetermined by guides at rest),
        or no size exceeds `MIN_SIGNAL_TO_NOISE` times its uncertainty.
    """
    inside = np.abs(trajectory.t - event.time) < 2 * room
    t, values = trajectory.t[inside], trajectory[effort][inside]
    if len(t) < 2 * min(SAMPLES_PER_SIDE) or np.isnan(values).any():
        return None
    # Samples at which a gap may begin; in a coarse run at least those within two intervals.
    reach = min(max(SEARCH_RADIUS_S, 2 * float(np.median(np.diff(t)))), room)
    near = np.flatnonzero(np.abs(t - event.time) <= reach)
    estimates: list[JumpEstimate] = []
    for count, gap in product(SAMPLES_PER_SIDE, range(1, MAX_GAP_INTERVALS + 1)):
        estimates += _over_gaps(t, values, near, count, gap)
    if not estimates:
        return None
    best = max(estimates, key=lambda estimate: abs(estimate.size) / estimate.size_uncertainty)
    return best if abs(best.size) > MIN_SIGNAL_TO_NOISE * best.size_uncertainty else None


def _over_gaps(
    t: np.ndarray, values: np.ndarray, last: np.ndarray, count: int, gap: int
) -> Iterator[JumpEstimate]:
    """Return the jumps over gaps of `gap` intervals that begin at the samples with the indices `last`.

    Samples with fewer than `count` samples on either side of the gap are skipped.
    """
    last = last[(last >= count - 1) & (last + gap + count <= len(t))]
    middle = (t[last + gap] + t[last]) / 2
    half_gap = (t[last + gap] - t[last]) / 2
    before = _extrapolate(t, values, last - count + 1, count, middle)
    after = _extrapolate(t, values, last + gap, count, middle)
    # Error of the difference of both extrapolations. The standard deviation of a sample is
    # estimated from the residuals of both fits together.
    degrees_of_freedom = 2 * (count - PARABOLA_COEFFICIENTS)
    deviation = np.sqrt((before.residual_square + after.residual_square) / degrees_of_freedom)
    quantile = student.ppf((1 + CONFIDENCE) / 2, degrees_of_freedom)
    fit_error = quantile * deviation * np.sqrt(before.variance_ratio + after.variance_ratio)
    # If the slopes differ, the size depends on the time of the jump within the gap, or one interval
    # beyond it.
    interval = 2 * half_gap / gap
    slope_error = np.abs(after.slope - before.slope) * (half_gap + interval)
    # The residuals of constant samples are zero: only rounding errors remain.
    rounding_error = ROUNDING_ERRORS * np.spacing(np.max(np.abs(values)))
    size = after.value - before.value
    size_uncertainty = fit_error + slope_error + rounding_error
    return map(
        JumpEstimate,
        middle.tolist(),
        size.tolist(),
        half_gap.tolist(),
        size_uncertainty.tolist(),
    )


@dataclass(frozen=True)
class _Extrapolation:
    """Parabolas through windows of samples, extrapolated to a time for each; all arrays have the shape (n,).

    Attributes
    ----------
    value, slope : ndarray
        Value and derivative (1/s) of each parabola at its time.
    residual_square : ndarray
        Sum of the squared residuals of the samples.
    variance_ratio : ndarray
        Variance of the value divided by the variance of a sample.
    """

    value: np.ndarray
    slope: np.ndarray
    residual_square: np.ndarray
    variance_ratio: np.ndarray


def _extrapolate(
    t: np.ndarray, values: np.ndarray, first: np.ndarray, count: int, target: np.ndarray
) -> _Extrapolation:
    """Fit parabolas to samples by least squares, and extrapolate them.

    Parameters
    ----------
    t, values : ndarray
        Times (s) and values of all samples.
    first : ndarray, shape (n,)
        Index of the first sample of each window.
    count : int
        Number of samples in a window.
    target : ndarray, shape (n,)
        Time to which each parabola is extrapolated, s.
    """
    # Least squares for all windows together. The time is measured from the target in units of the
    # window's length, so that the constant coefficient is the extrapolated value.
    window = first[:, None] + np.arange(count)
    length = t[window[:, -1]] - t[window[:, 0]]
    scaled_time = (t[window] - target[:, None]) / length[:, None]
    powers = scaled_time[..., None] ** np.arange(PARABOLA_COEFFICIENTS)
    transposed = np.swapaxes(powers, 1, 2)
    pseudoinverse = np.linalg.inv(transposed @ powers) @ transposed
    coefficients = (pseudoinverse @ values[window][..., None])[..., 0]
    residuals = values[window] - (powers @ coefficients[..., None])[..., 0]
    return _Extrapolation(
        value=coefficients[:, 0],
        slope=coefficients[:, 1] / length,
        residual_square=np.sum(residuals**2, axis=1),
        variance_ratio=np.sum(pseudoinverse[:, 0] ** 2, axis=1),
    )
