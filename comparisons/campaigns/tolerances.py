"""How far a number may be from the baseline's: hard bounds, and what rounding alone does to it."""

from __future__ import annotations

from stiction.comparisons.campaigns.measurement import MOTION, Metric
from stiction.comparisons.measures.scene_truth import OWN_RUN
from stiction.comparisons.truth import CLOSED_FORM, HIGH_PRECISION, PROVEN, PUBLISHED

FACTOR = {"rtol": 30.0, "dt": 2.0}
"""By what the ladder of a run varies, how many times the baseline's an error may be. Another machine or library changes the rounding,
and with it which steps an adaptive method rejects: a tolerance changed by 1e-6 of itself moves errors by factors of up to 13
(Baumgarte on mass-on-belt, rtol 1e-11; tests/comparisons/campaigns/test_regression.py). At rtol 1e-9 it would be 54: there not the tolerance but the
limit of stability sets Baumgarte's steps, and the errors are chance. Fixed steps stay where they are."""
MARGIN = {PROVEN: 2.0, CLOSED_FORM: 2.0, HIGH_PRECISION: 2.0, PUBLISHED: 2.0, OWN_RUN: 10.0}
"""By tier, how many times the uncertainty of the truth an error may differ whatever the baseline says: that of now and that of
then; of our own run, whose uncertainty is the difference of two tolerances of one method, ten times."""

PATH_MOVED = 1e-6
"""Of itself, by how much the path of fixed steps may differ. In the case that the suite's campaign follows (case 1, 24 s), a mass
that is another by some 1e-13 of itself moves it by 1e-11 at most, in every engine; friction that is 1 % more by 2.5e-3 at least."""

FURTHER = {"accuracy": 2.0, "drift": 2.0, "counter": 3.0}
"""By kind, how many times as far as in the runs that were made again another rounding is expected to move a number: few were made."""


def bound(error: float, parameter: str, margin: float) -> float:
    """The largest error that is no regression where the baseline has `error`."""
    return max(FACTOR.get(parameter, FACTOR["dt"]) * error, error + margin)


def margin_of(tier: str, uncertainty: float) -> float:
    """What errors may differ by that both are measured against truths with, together, this uncertainty."""
    return MARGIN[tier] * uncertainty


def not_judged(metric: Metric, parameter: str) -> str:
    """Why a number of a baseline leads to no verdict; empty where it does. A count has what rounding does in its tolerance."""
    moved = metric.rounding
    if moved is None or metric.kind == "counter":
        return ""
    tolerated = 0.0 if metric.kind == "event" else PATH_MOVED * metric.value if metric.kind == MOTION else bound(metric.value, parameter, margin_of(metric.tier, 2 * (metric.uncertainty or 0.0))) - metric.value
    return f"not judged: rounding moves it by {moved:.3g}" if FURTHER.get(metric.kind, 1.0) * moved > tolerated else ""
