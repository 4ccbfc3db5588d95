"""What has changed beyond noise: runs against the baseline, times against the history.

Every kind of number has its own rule. Status, events and counters are compared exactly: they are whole numbers of a deterministic
program. Truths may differ by their uncertainties. Errors and drift have hard bounds, see `FACTOR` and `MARGIN`. Times are
medians over several measurements, held to medians over the history, see `BOUND_HISTORY`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from comparisons.accuracy import WRONG
from comparisons.baseline import Baseline, Expected, moved_truths
from comparisons.ground import OWN_RUN
from comparisons.measurement import TRUTH, Metric, Row
from comparisons.truth import CLOSED_FORM, HIGH_PRECISION, PUBLISHED

REGRESSION, COULD_NOT_RUN, BETTER, NEW = "regression", "could not run", "better", "new"
SEVERITIES = (REGRESSION, COULD_NOT_RUN, BETTER, NEW)
"""What a finding can be, worst first."""
FINE = "fine"
"""Verdict where there is neither a regression nor a run that could not be made."""

FACTOR = {"rtol": 30.0, "dt": 2.0}
"""By what the ladder of a run varies, how many times the baseline's an error may be. Another machine or library changes the rounding,
and with it which steps an adaptive method rejects: a tolerance changed by 1e-6 of itself moves errors by factors of up to 13
(Baumgarte on mass-on-belt, rtol 1e-11; tests/test_regression_rules.py). At rtol 1e-9 it would be 54: there not the tolerance but the
limit of stability sets Baumgarte's steps, and the errors are chance. Fixed steps stay where they are."""
MARGIN = {CLOSED_FORM: 2.0, HIGH_PRECISION: 2.0, PUBLISHED: 2.0, OWN_RUN: 10.0}
"""By tier, how many times the uncertainty of the truth an error may differ whatever the baseline says: that of now and that of
then; of our own run, whose uncertainty is the difference of two tolerances of one method, ten times."""

SESSIONS = 3
"""Measurements of a time, in different nights or different processes, whose median is judged: one slow one is outvoted."""
HISTORY = (5, 20)
"""Measurements that make a history: at least, and at most, the latest."""
BOUND_HISTORY, SIGMAS = 1.25, 6.0
"""Against the history of the same machine: how many times its median, and how many standard deviations (1.4826 times the median
absolute deviation) above it, a time must be to count as slower. Medians of calibrated times spread by up to 10 % on a machine with
other work on it."""
BOUND_BASELINE = 1.5
"""Against a baseline, which another machine may have made: calibration leaves what processors differ in beyond their speed."""

_RANKS = ("status", TRUTH, "event", "accuracy", "drift", "counter", "time")
"""Kinds of findings in the order in which they are shown."""
_STATUSES = ("ok", "incomplete", "refused", "failed", "timed out", "crashed", WRONG)
"""From good to bad: worst is a result that is none and does not say so; ``missing`` and `NOT_RUN` say nothing about the solver."""
_MORE_IS_BETTER = ("events matched",)


@dataclass(frozen=True)
class Finding:
    """Something that is not as the baseline has it.

    Attributes
    ----------
    severity : str
        One of `SEVERITIES`.
    kind : str
        ``status``, ``truth``, ``event``, ``accuracy``, ``drift``, ``counter``, ``time``.
    key, metric : str
        The run, and its number; empty for the status.
    before, now : float, str or None
        In the baseline or history, and in this run; None where there is none.
    ratio : float
        How many times the worse value is the better one; infinite where that means nothing.
    reason : str
        Why this is not noise, in words.
    """

    severity: str
    kind: str
    key: str
    metric: str
    before: float | str | None
    now: float | str | None
    ratio: float
    reason: str


@dataclass(frozen=True)
class Times:
    """Measurements of a time: `now`, of which the median is judged, and `past`, oldest first, of the same machine."""

    now: Sequence[float]
    past: Sequence[float] = ()


def findings(rows: Iterable[Row], baseline: Baseline, kinds: Collection[str], times: Mapping[str, Times]) -> list[Finding]:
    """All that is not as the baseline has it, worst first.

    Parameters
    ----------
    rows
        What was run. Rows that only the baseline has are not missed.
    kinds
        What was measured.
    times
        By key of the run; one that is not among them has its time not judged.
    """
    found = [finding for row in rows for finding in _of_row(row, baseline.runs.get(row.key), kinds, times)]
    return sorted(found, key=lambda f: (SEVERITIES.index(f.severity), _RANKS.index(f.kind), -f.ratio, f.key, f.metric))


def verdict(found: Iterable[Finding]) -> str:
    """The worst of the findings that count: `REGRESSION`, `COULD_NOT_RUN` or `FINE`."""
    severities = {finding.severity for finding in found}
    return next((severity for severity in (REGRESSION, COULD_NOT_RUN) if severity in severities), FINE)


def _of_row(row: Row, expected: Expected | None, kinds: Collection[str], times: Mapping[str, Times]) -> Iterator[Finding]:
    now = _status(row)
    if expected is None:
        lost = now not in ("ok", "refused")
        words = f"the baseline does not have it{f': {row.reason}' if row.reason else ''}"
        yield Finding(COULD_NOT_RUN if lost else NEW, "status", row.key, "", None, now, math.inf, words)
        return
    before = _status(expected)
    if now != before:
        if now not in _STATUSES:
            severity = COULD_NOT_RUN
        else:
            worse = before in _STATUSES and _STATUSES.index(now) > _STATUSES.index(before)
            severity = REGRESSION if worse else BETTER
        yield Finding(severity, "status", row.key, "", before, now, math.inf, row.reason or f"before: {expected.reason}")
        return
    for fixed, new, why in moved_truths(row, expected):
        yield Finding(REGRESSION, TRUTH, row.key, fixed.name, fixed.value, new and new.value, math.inf, why)
    measured, known = {metric.name: metric for metric in row.metrics}, expected.metrics
    for name, new in measured.items():
        if name not in known:
            yield Finding(NEW, new.kind, row.key, name, None, new.value, math.inf, "the baseline does not have it")
    for name, old in known.items():
        if name in measured:
            yield from _of_number(row, old, measured[name], times.get(row.key))
        elif old.kind in kinds:
            yield Finding(REGRESSION, old.kind, row.key, name, old.value, None, math.inf, "the baseline has it, this run has nothing")


def _status(run: Row | Expected) -> str:
    """``incomplete`` where a run came out with a reservation: it ended early, or there is no truth for it."""
    return "incomplete" if run.status == "ok" and run.reason else run.status


def _of_number(row: Row, old: Metric, new: Metric, times: Times | None) -> Iterator[Finding]:
    key = row.key
    if old.kind == "time":
        if times is not None:
            yield from _of_time(key, old, times)
    elif old.kind in ("event", "counter"):
        if new.value != old.value:
            worse = new.value < old.value if old.name in _MORE_IS_BETTER else new.value > old.value
            yield Finding(REGRESSION if worse else BETTER, old.kind, key, old.name, old.value, new.value, _ratio(old.value, new.value),
                          f"{'more' if new.value > old.value else 'fewer'}; counted exactly")
    elif old.kind == TRUTH:
        allowed = MARGIN[OWN_RUN] * _uncertainty(old, new)
        if old.tier == OWN_RUN and abs(new.value - old.value) > allowed:
            yield Finding(REGRESSION, TRUTH, key, old.name, old.value, new.value, math.inf,
                          f"the run that stands in for a truth has moved by {abs(new.value - old.value):.2g}; allowed {allowed:.2g}")
    else:
        yield from _of_error(row, old, new)


def _of_error(row: Row, old: Metric, new: Metric) -> Iterator[Finding]:
    key, factor, margin = row.key, FACTOR.get(row.parameter, FACTOR["dt"]), MARGIN[new.tier] * _uncertainty(old, new)

    def bound(error: float) -> float:
        return max(factor * error, error + margin)

    if new.value > bound(old.value):
        yield Finding(REGRESSION, old.kind, key, old.name, old.value, new.value, _ratio(old.value, new.value),
                      f"{_ratio(old.value, new.value):.3g} times the baseline's, against the truth ({new.tier}); allowed up to {bound(old.value):.2g}")
    elif old.value > bound(new.value):
        yield Finding(BETTER, old.kind, key, old.name, old.value, new.value, _ratio(old.value, new.value),
                      f"the baseline's is {_ratio(old.value, new.value):.3g} times this one")


def _of_time(key: str, old: Metric, times: Times) -> Iterator[Finding]:
    now = median(times.now)
    least, most = HISTORY
    if len(times.past) >= least:
        past = times.past[-most:]
        before = median(past)
        deviation = 1.4826 * median(abs(value - before) for value in past)
        bound = max(BOUND_HISTORY, 1 + SIGMAS * deviation / before)
        words = f"the median of {len(past)} nights on this machine"
    else:
        before, bound, words = old.value, BOUND_BASELINE, "the baseline (too few nights of this machine to go by)"
    if not before / bound <= now <= bound * before:
        yield Finding(REGRESSION if now > before else BETTER, "time", key, old.name, before, now, _ratio(before, now),
                      f"{_ratio(before, now):.2f} times as {'slow' if now > before else 'fast'} (median of {len(times.now)}); noise ends at {bound:.2f} "
                      f"times {words}")


def _uncertainty(old: Metric, new: Metric) -> float:
    return (old.uncertainty or 0.0) + (new.uncertainty or 0.0)


def _ratio(old: float, new: float) -> float:
    small, large = sorted((abs(old), abs(new)))
    return large / small if small > 0 else math.inf
