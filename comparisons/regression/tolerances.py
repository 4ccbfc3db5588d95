"""Largest differences of numbers from a baseline: hard bounds, and the effect of rounding.

A number on which rounding has a large effect cannot be compared. For example, rounding decides in which direction a
mechanism continues after a singular position.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from stiction.comparisons.bench.planned_runs import MOTION, TRUTH, WAYS, Metric, Row
from stiction.truths import Tier

FACTOR = {"rtol": 30.0, "dt": 2.0}
"""Largest ratio of an error to that of the baseline, by the parameter of a run.

Another machine or library changes the rounding, and with it the steps that an adaptive method rejects. If a tolerance
is changed by 1e-6 of itself, errors change by factors of up to 13 (Baumgarte on mass-on-belt, rtol 1e-11;
tests/comparisons/regression/test_check.py). At rtol 1e-9 the factor would be 54, because the steps of Baumgarte are
then determined by the limit of stability instead of the tolerance, and the errors are random. Fixed steps do not
change.
"""
MARGIN = {
    Tier.PROVEN: 2.0,
    Tier.CLOSED_FORM: 2.0,
    Tier.HIGH_PRECISION: 2.0,
    Tier.PUBLISHED: 2.0,
    Tier.OWN_RUN: 10.0,
}
"""Difference of an error that is allowed in any case, by tier of the truth, in uncertainties of both truths together.
The uncertainty of our own run is the difference between two tolerances of one method. It is only an estimate of the
error, and is therefore multiplied by ten."""

PATH_MOVED = 1e-6
"""Largest relative change of the length of the path of a run with fixed steps. In case 1 over 24 s, which is part of
the suite's campaign, a relative change of a mass by 1e-13 changes the path by at most 1e-11 in all engines, and 1 %
more friction by 2.5e-3."""

FURTHER = {"accuracy": 2.0, "drift": 2.0, "counter": 3.0}
"""Factor on the largest change by rounding that was observed, by kind: only few runs were repeated, and another one
may change more."""


def bound(error: float, parameter: str, margin: float) -> float:
    """Return the largest error that is no regression.

    Parameters
    ----------
    error
        The error in the baseline.
    parameter
        Parameter of the run, ``rtol`` or ``dt``.
    margin
        Difference that is allowed in any case, in the unit of the error.
    """
    factor = FACTOR.get(parameter, FACTOR["dt"])
    return max(factor * error, error + margin)


def tolerance(old: Metric, uncertainty: float) -> float:
    """Return the largest change of a number that is not an error.

    Parameters
    ----------
    old
        The number in the baseline.
    uncertainty
        Sum of the uncertainties of both truths, if the number is one.
    """
    if old.kind == "event":
        return 0.0
    if old.kind == "counter":
        return FURTHER["counter"] * (old.rounding or 0.0)
    if old.kind == TRUTH:
        return MARGIN[Tier.OWN_RUN] * uncertainty
    if old.kind != MOTION:
        raise ValueError(f"{old.name}: found the kind {old.kind!r}; expected one without a bound")
    # The uncertainty of a position at the end is the change that is allowed; a path has none.
    return PATH_MOVED * old.value if old.uncertainty is None else old.uncertainty


def not_judged(metric: Metric, parameter: str) -> str:
    """Return why a number of a baseline leads to no verdict; empty if it does.

    That is the case if rounding changes it by more than its tolerance. Counters always lead to a verdict, because their
    tolerance contains the effect of rounding.
    """
    rounding = metric.rounding
    if rounding is None or metric.kind == "counter":
        return ""
    # The truth of a later run is assumed to be as uncertain as that of the baseline.
    uncertainty = 2 * (metric.uncertainty or 0.0)
    if metric.kind in ("event", MOTION):
        tolerated = tolerance(metric, uncertainty)
    else:
        margin = MARGIN[metric.tier] * uncertainty
        tolerated = bound(metric.value, parameter, margin) - metric.value
    if FURTHER.get(metric.kind, 1.0) * rounding > tolerated:
        return f"not judged: rounding moves it by {rounding:.3g}"
    return ""


def with_rounding(row: Row, again: Sequence[Row]) -> Row:
    """Return a row in which each number has its largest change by rounding.

    Parameters
    ----------
    row
        A run.
    again
        The same run, repeated in all `WAYS` in their order. If runs are missing, the row is returned unchanged.

    Returns
    -------
    Row
        The change of a number is infinite if one of the repeated runs does not have it. Statuses with which repeated
        runs ended are in `other_ends`.
    """
    if len(again) < len(WAYS):
        return row
    values = [{metric.name: metric.value for metric in other.metrics} for other in again]
    metrics = []
    for metric in row.metrics:
        if metric.kind != "time":
            changes = [abs(one.get(metric.name, math.inf) - metric.value) for one in values]
            metric = replace(metric, rounding=_largest_change(metric.kind, changes))
        metrics.append(metric)
    other_ends = {other.outcome for other in again} - {row.outcome}
    return replace(row, metrics=tuple(metrics), other_ends=tuple(sorted(other_ends)))


def _largest_change(kind: str, changes: Sequence[float]) -> float:
    """Return the largest of the changes of a number in the ways `WAYS`, the last of which is `GRID`.

    With half as many samples a counter counts less work and a path has other corners, so that the change by the grid
    does not count for them. For other numbers it is not random like rounding, but the same each time, and needs no
    factor `FURTHER`.
    """
    *rounded, by_grid = changes
    if kind in ("counter", MOTION):
        return max(rounded)
    return max(*rounded, by_grid / FURTHER.get(kind, 1.0))
