"""Jumps of the driving effort: size and time at every event of the truth, and what each engine makes of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.measures.accuracy import has_two_sided_events
from stiction.comparisons.truth import NO_TRUTH, Truth
from stiction.comparisons.variants import Record
from stiction.scenes import Event, Trajectory

SAMPLES = 6
"""Samples on either side of a jump through which a parabola is laid: enough to see past the step of the jump itself
and to average the noise of an impulse-based solver, few enough to stay within the smooth piece."""

SEARCH = 0.05
"""Seconds around a true event in which an engine's jump is sought, at least SAMPLES samples; half the distance to the next
event if that is less."""

SMALLEST = 1e-9
"""N m; events whose true jump is smaller (corner forces through zero) are kinks and have no row."""


@dataclass(frozen=True)
class JumpEstimate:
    """A jump read off a trajectory: time (s), size, and their uncertainty from sampling."""

    time: float
    size: float
    time_uncertainty: float
    size_uncertainty: float


def torque_table(records: Iterable[Record], truth_for: Mapping[str, Truth], effort: str = "motor.effort") -> pd.DataFrame:
    """One row per run and jump of the truth; per run where there is no truth, with the reason.

    The true jump is two-sided, and for the slider-bar also known in closed form, -c sin(th) times the jump of the
    slider's acceleration; the larger of the difference of both and the truth's own uncertainty is the truth's uncertainty here.
    Located events of a run give its jumps directly; otherwise `estimate_jump`.
    """
    rows = []
    for record in records:
        truth, trajectory = truth_for[record.key], record.trajectory
        if trajectory is None or truth.tier == NO_TRUTH:
            rows.append({**record.describe(), "effort": effort, "truth tier": truth.effort_tier, "truth note": truth.note})
            continue
        for i, event in enumerate(truth.events):
            if effort not in event.before or abs(event.jump(effort)) < SMALLEST or event.time > trajectory.t[-1]:
                continue
            rows.append({**record.describe(), **_row(trajectory, truth, i, effort)})
    return pd.DataFrame(rows)


def _row(trajectory: Trajectory, truth: Truth, i: int, effort: str) -> dict[str, Any]:
    event = truth.events[i]
    true = event.jump(effort)
    closed = truth.jump_closed_form[i] if truth.jump_closed_form is not None else None
    row: dict[str, Any] = {
        "effort": effort, "event": i, "event time [s]": event.time, "kind": event.kind, "joint": event.joint,
        "jump, truth [N m]": true, "jump, closed form [N m]": closed, "truth tier": truth.effort_tier, "truth note": truth.note,
        "truth uncertainty [N m]": max(truth.uncertainty.get(effort, 0.0), abs(true - closed) if closed is not None else 0.0)}
    estimate = _located(trajectory, event, effort) if has_two_sided_events(trajectory) \
        else estimate_jump(trajectory, event, _room(truth, i), effort)
    if estimate is None:
        return {**row, "resolved": False}
    return {**row, "resolved": True, "jump [N m]": estimate.size, "jump error [N m]": estimate.size - true,
            "jump uncertainty [N m]": estimate.size_uncertainty + row["truth uncertainty [N m]"], "time [s]": estimate.time,
            "time error [s]": estimate.time - event.time,
            "time uncertainty [s]": estimate.time_uncertainty + truth.uncertainty.get("event time", 0.0)}


def _room(truth: Truth, i: int) -> float:
    """Half the distance to the nearest other event, of any kind."""
    times = np.array([event.time for event in truth.events])
    others = np.abs(np.delete(times, i) - times[i])
    return 0.5 * float(np.min(others[others > 1e-9], initial=truth.t_end))


def _located(trajectory: Trajectory, event: Event, effort: str) -> JumpEstimate | None:
    found = [e for e in trajectory.events if e.kind == event.kind and e.joint == event.joint and abs(e.time - event.time) < SEARCH]
    if not found:
        return None
    nearest = min(found, key=lambda e: abs(e.time - event.time))
    return JumpEstimate(nearest.time, nearest.jump(effort), 0.0, 0.0)


def estimate_jump(trajectory: Trajectory, event: Event, room: float, effort: str = "motor.effort") -> JumpEstimate | None:
    """Size and time of a jump from samples.

    Parabolas through SAMPLES samples on either side of each candidate interval are continued to its middle; the interval
    with the largest difference of the two is the jump. Time is unsure by half that interval, size by the
    scatter of the samples about their parabolas.

    Parameters
    ----------
    room : float
        Seconds on either side of the true event in which nothing else happens.

    Returns
    -------
    JumpEstimate or None
        None if the samples do not suffice or no difference exceeds three times the scatter.
    """
    t, values = trajectory.t, trajectory[effort]
    step = float(np.median(np.diff(t)))
    reach = min(max(SEARCH, 2 * step), room)
    best: JumpEstimate | None = None
    for k in np.flatnonzero((t[:-1] >= event.time - reach) & (t[1:] <= event.time + reach)):
        before, after = slice(k + 1 - SAMPLES, k + 1), slice(k + 1, k + 1 + SAMPLES)
        if before.start < 0 or after.stop > len(t):
            continue
        middle = 0.5 * (t[k] + t[k + 1])
        sides, scatter = [], 0.0
        for part in (before, after):
            fit, residuals, *_ = np.polyfit(t[part] - middle, values[part], 2, full=True)
            sides.append(fit[-1])
            scatter = max(scatter, float(np.sqrt(residuals[0] / (SAMPLES - 3))) if len(residuals) else 0.0)
        size = float(sides[1] - sides[0])
        if best is None or abs(size) > abs(best.size):
            best = JumpEstimate(float(middle), size, 0.5 * float(t[k + 1] - t[k]), scatter)
    return best if best is not None and abs(best.size) > 3 * best.size_uncertainty else None
