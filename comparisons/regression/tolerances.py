"""Largest differences of a number from the baseline's: hard bounds, and how far rounding alone moves it.

A number that rounding moves far has no value to hold a night to: past a singular position, say, rounding decides which
way a mechanism goes on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from stiction.comparisons.bench.planned_runs import MOTION, TRUTH, WAYS, Metric, Row
from stiction.truths import Tier

FACTOR = {"rtol": 30.0, "dt": 2.0}
"""Largest ratio of an error to the baseline's, by the parameter of a run.

Another machine or library changes the rounding, and with it the steps that an adaptive method rejects. A tolerance
changed by 1e-6 of itself moves errors by factors of up to 13 (Baumgarte on mass-on-belt, rtol 1e-11;
tests/comparisons/regression/test_check.py). At rtol 1e-9 it would be 54: there not the tolerance but the limit of
stability sets Baumgarte's steps, and the errors are chance. Fixed steps stay where they are.
"""
MARGIN = {
    Tier.PROVEN: 2.0,
    Tier.CLOSED_FORM: 2.0,
    Tier.HIGH_PRECISION: 2.0,
    Tier.PUBLISHED: 2.0,
    Tier.OWN_RUN: 10.0,
}
"""Largest difference of an error by tier, in uncertainties of the truth, whatever the baseline says: that of now and
that of then. Our own run has the difference of two tolerances of one method as its uncertainty, so ten times that."""

PATH_MOVED = 1e-6
"""Largest relative change of the path of fixed steps. In case 1 over 24 s, which the suite's campaign follows, a
relative change of a mass by 1e-13 moves the path by 1e-11 at most, in every engine; 1 % more friction by 2.5e-3."""

FURTHER = {"accuracy": 2.0, "drift": 2.0, "counter": 3.0}
"""Factor on the largest change in the runs that were made again, of which there are few; by kind."""


def bound(error: float, parameter: str, margin: float) -> float:
    """Return the largest error that is no regression where the baseline has `error`."""
    return max(FACTOR.get(parameter, FACTOR["dt"]) * error, error + margin)


def tolerance(old: Metric, uncertainty: float) -> float:
    """Return the largest change of a number other than an error, whose truths are as uncertain as this together."""
    if old.kind == MOTION:
        # an end position has what is no change as its uncertainty, a path has none
        return PATH_MOVED * old.value if old.uncertainty is None else old.uncertainty
    return {
        "event": 0.0,
        "counter": FURTHER["counter"] * (old.rounding or 0.0),
        TRUTH: MARGIN[Tier.OWN_RUN] * uncertainty,
    }[old.kind]


def not_judged(metric: Metric, parameter: str) -> str:
    """Return why a number of a baseline leads to no verdict; empty where it does.

    A count leads to one always: its tolerance has the effect of rounding.
    """
    moved = metric.rounding
    if moved is None or metric.kind == "counter":
        return ""
    uncertainty = 2 * (metric.uncertainty or 0.0)
    tolerated = (
        tolerance(metric, uncertainty)
        if metric.kind in ("event", MOTION)
        else bound(metric.value, parameter, MARGIN[metric.tier] * uncertainty) - metric.value
    )
    return (
        f"not judged: rounding moves it by {moved:.3g}"
        if FURTHER.get(metric.kind, 1.0) * moved > tolerated
        else ""
    )


def with_rounding(row: Row, again: Sequence[Row]) -> Row:
    """Return a row, each number with its largest change in the same run, made `again` in all `WAYS`.

    It is infinite where one of these does not have the number. Of the last one, `GRID`, a part counts: a grid is no
    chance, and moves a number as far every time. A run that was not made in all ways stays as it is.
    """
    if len(again) < len(WAYS):
        return row
    values = [{metric.name: metric.value for metric in other.metrics} for other in again]

    def moved(metric: Metric) -> float:
        *rounded, by_grid = (
            abs(found.get(metric.name, math.inf) - metric.value) for found in values
        )
        if metric.kind in (
            "counter",
            MOTION,
        ):
            # samples are work too, and with half as many a path has other corners
            return max(rounded)
        return max(*rounded, by_grid / FURTHER.get(metric.kind, 1.0))

    metrics = tuple(
        metric if metric.kind == "time" else replace(metric, rounding=moved(metric))
        for metric in row.metrics
    )
    return replace(
        row,
        metrics=metrics,
        other_ends=tuple(sorted({other.outcome for other in again} - {row.outcome})),
    )
