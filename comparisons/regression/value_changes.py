"""Changes of the numbers of runs from one night to another that are beyond noise."""

from __future__ import annotations

from stiction.comparisons.bench.planned_runs import TRUTH
from stiction.comparisons.regression.baseline import FORMAT, Baseline, expected_of
from stiction.comparisons.regression.check import (
    BETTER,
    COULD_NOT_RUN,
    REGRESSION,
    Finding,
    findings,
)
from stiction.comparisons.regression.history import History

BEYOND_NOISE = (REGRESSION, COULD_NOT_RUN, BETTER)
"""Severities of changes that are more than noise."""


def value_changes(history: History, before: str, night: str) -> list[Finding]:
    """Return the changes of the runs of a night since an earlier night, worst first.

    The rules are those by which a night is compared with its baseline (`check.findings`); here the earlier
    night is the baseline. Times are not compared, because a single difference of times may be noise.
    """
    conditions_before = history.origin(before)["conditions"]
    expected = {row.key: expected_of(row, conditions_before) for row in history.rows(before)}
    rows = history.rows(night)
    # A kind of numbers that the campaign does not measure any more is not a change of a run.
    kinds = {metric.kind for row in rows for metric in row.metrics} - {TRUTH}
    changes = findings(
        rows,
        Baseline(format=FORMAT, runs=expected),
        kinds,
        {},
        history.origin(night)["conditions"],
    )
    return [change for change in changes if change.severity in BEYOND_NOISE]
