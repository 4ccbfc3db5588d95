"""Comparison of runs with a baseline, of times with the history or with older code: findings and a verdict.

A run is compared with the run of the same identity in the baseline. If the baseline has none, the run is new. Each kind
of number has its own rule, which takes into account how far rounding alone moves the number (`tolerances`):

- The status and the events are compared exactly, and so are counters that do not depend on rounding.
- Other counters may differ by `FURTHER` times as much as rounding moves them.
- Truths may differ by their uncertainties.
- Errors and drift have hard bounds. A number that rounding moves beyond its bound leads to no verdict.

If the effect of rounding was not measured, errors, drift and counters are judged only under the same
`environment.conditions`, so that no verdict depends on the processor. A number that only one of two truths has, such as
a kind of events, is compared only if both truths have the same tier.

Times lead to a verdict only against older code that runs in alternation with this code (`regression.older_code`). The
median over the runs of an engine decides, see `BOUND_TURNS`. Differences of times from a baseline or the history are
reported without a verdict: other work on both cores multiplies them by 1.5, another processor by 1.9.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from types import MappingProxyType

from stiction.comparisons.bench.planned_runs import MOTION, TRUTH, Metric, Row
from stiction.comparisons.regression.baseline import Baseline, Expected, moved_truths
from stiction.comparisons.regression.older_code import TOTAL
from stiction.comparisons.regression.tolerances import (
    FURTHER,
    MARGIN,
    PATH_MOVED,
    bound,
    not_judged,
    tolerance,
)
from stiction.engines.registry import entry_of
from stiction.engines.status import Status
from stiction.truths.truth import Tier

REGRESSION = "regression"
"""Severity of a change for the worse that is beyond noise; also the verdict if there is one."""
COULD_NOT_RUN = "could not run"
"""Severity of a run that was not made; also the verdict if there is one, and no regression."""
BETTER = "better"
"""Severity of a change for the better that is beyond noise."""
NOT_JUDGED = "not judged"
"""Severity of a change that may be noise."""
NEW = "new"
"""Severity of a run or number that the baseline does not have."""
SEVERITIES = (REGRESSION, COULD_NOT_RUN, BETTER, NOT_JUDGED, NEW)
"""Severities of a finding, worst first."""
FINE = "fine"
"""Verdict without a regression and without a run that could not be made."""
NOTHING = "nothing compared"
"""Verdict if no run was compared."""

BOUND_TURNS = 1.25
"""Ratio of an engine's times to those with older code, as the median of its runs, above which the engine counts as
slower; below the reciprocal it counts as faster. On two cores with six processes, single runs had ratios from 0.75 to
1.20 with the same code. The median of 42 runs was 1.01 and 0.98, and 1.52 for an engine that was slowed down by half
its time."""
MIN_RUNS_IN_TURNS = 5
"""Least number of runs of an engine for a verdict on its times."""
SESSIONS = 3
"""Number of nights in which a time must be beyond the bound to be reported."""
MIN_HISTORY = 5
"""Least number of earlier measurements with which a time is compared."""
MAX_HISTORY = 20
"""Number of the latest measurements with which a time is compared, at most: older ones may be of other code."""
BOUND_HISTORY = 1.25
"""Ratio to the median of the history above which a time is reported, unless `SIGMAS` requires more."""
SIGMAS = 6.0
"""Number of standard deviations of the history by which a time must exceed its median to be reported."""
STANDARD_DEVIATION = 1.4826
"""Standard deviation of a normal distribution, divided by its median absolute deviation."""
BOUND_BASELINE = 1.5
"""Ratio to a single measurement, that of a baseline, above which a time is reported."""

IN_TURNS = "over_older:{}"
"""Pattern of the key of a ratio of times to those with older code; it is completed by the name of the time."""

_KINDS = ("status", TRUTH, "event", "accuracy", MOTION, "drift", "counter", "time")
"""Kinds of findings in the order in which they are shown."""
_STATUSES = (
    Status.OK,
    Status.INCOMPLETE,
    Status.REFUSED,
    Status.FAILED,
    Status.TIMED_OUT,
    Status.CRASHED,
    Status.WRONG,
)
"""Statuses of runs that were made, from good to bad; a wrong result without a warning is the worst. Other statuses say
nothing about a solver."""
_MORE_IS_BETTER = ("events_matched",)
"""Counts that are better the larger they are."""


@dataclass(frozen=True)
class Finding:
    """A difference of a run from the baseline or the history.

    Attributes
    ----------
    severity : str
        One of `SEVERITIES`.
    kind : str
        Kind of the number, or ``status``.
    key : str
        Key of the run, or name of the engine if several runs were compared together.
    metric : str
        Key of the number; empty for a status.
    before, now : float, str or None
        Values in the baseline or the history, and in this run; None if there is none.
    ratio : float
        Ratio of the larger to the smaller value; infinite if it has no meaning.
    reason : str
        Why the difference is not noise, or why it is not judged.
    excess : float
        Ratio of the difference (of an error or time: of the value) to the largest one that counts as noise. It is 1 at
        the bound, and infinite if no difference is allowed. Among findings of the same severity and kind, the one with
        the largest excess is the worst: a large ratio of two tiny errors may be within the uncertainty of the truth.
    """

    severity: str
    kind: str
    key: str
    metric: str
    before: float | str | None
    now: float | str | None
    ratio: float
    reason: str
    excess: float = math.inf


@dataclass(frozen=True)
class Times:
    """Measurements of the time of a run.

    Attributes
    ----------
    now : sequence of float
        Measurements that are judged; each of them must be beyond the bound.
    past : sequence of float
        Earlier measurements under the same conditions, the oldest first.
    """

    now: Sequence[float]
    past: Sequence[float] = ()


def findings(
    rows: Sequence[Row],
    baseline: Baseline,
    kinds: Collection[str],
    times: Mapping[str, Times],
    conditions: str,
    turns: Mapping[str, Mapping[str, float] | str] = MappingProxyType({}),
) -> list[Finding]:
    """Return all differences of runs from a baseline, worst first.

    Runs that only the baseline has are not reported.

    Parameters
    ----------
    rows
        The runs.
    kinds
        Kinds of numbers that were measured.
    times
        Measurements of times that are to be reported, by key of the run.
    conditions
        The `environment.conditions` under which the runs were made.
    turns
        Returned by `older_code.times_in_turns`.
    """
    differences: list[Finding] = []
    for row in rows:
        expected = baseline.expected(row)
        status_finding = _compare_status(row, expected, baseline)
        if status_finding is not None:
            differences.append(status_finding)
        elif expected is not None:
            differences += _compare_truths(row, expected)
            differences += _compare_numbers(row, expected, kinds, times.get(row.key), conditions)
    differences += _compare_times_in_turns(rows, turns)
    differences += _without_motion(rows, baseline)
    return sorted(differences, key=_order)


def _order(finding: Finding) -> tuple[int, int, float, float, str, str]:
    """Return the key by which findings are sorted, worst first."""
    return (
        SEVERITIES.index(finding.severity),
        _KINDS.index(finding.kind),
        -finding.excess,
        -finding.ratio,
        finding.key,
        finding.metric,
    )


def verdict(differences: Iterable[Finding], compared: int) -> str:
    """Return the verdict on a check with these findings, in which `compared` runs were compared."""
    severities = {finding.severity for finding in differences}
    for severity in (REGRESSION, COULD_NOT_RUN):
        if severity in severities:
            return severity
    return FINE if compared else NOTHING


def count_compared(rows: Iterable[Row], baseline: Baseline) -> int:
    """Count the runs that were made and that the baseline has, without truths."""
    return sum(
        row.variant != TRUTH and row.outcome in _STATUSES and baseline.expected(row) is not None
        for row in rows
    )


def _compare_status(row: Row, expected: Expected | None, baseline: Baseline) -> Finding | None:
    """Return the finding of a run that is new or ends in another way; None if its numbers can be compared."""
    before = None if expected is None else expected.outcome
    engine = entry_of(row.engine)
    if row.outcome == Status.MISSING and engine is not None and engine.optional:
        # An optional engine need not be installed.
        severity, reason = NOT_JUDGED, row.reason
    elif expected is None:
        severity, reason = _new_status(row, baseline)
    elif row.outcome == before:
        return None
    else:
        severity, reason = _changed_status(row, expected)
    return Finding(severity, "status", row.key, "", before, row.outcome, math.inf, reason)


def _new_status(row: Row, baseline: Baseline) -> tuple[str, str]:
    """Return severity and reason of a run that the baseline does not have."""
    severity = NEW if row.outcome in (Status.OK, Status.REFUSED) else COULD_NOT_RUN
    reason = "not in the baseline"
    namesake = baseline.runs.get(row.key)
    if namesake is not None:
        reason += f", where the name is that of another run ({namesake.identity})"
    if row.reason:
        reason += f": {row.reason}"
    return severity, reason


def _changed_status(row: Row, expected: Expected) -> tuple[str, str]:
    """Return severity and reason of a run whose status is not the one in the baseline."""
    now, before = row.outcome, expected.outcome
    reason = row.reason if row.reason else f"before: {expected.reason}"
    reason += _version_note(row, expected)
    if now not in _STATUSES:
        return COULD_NOT_RUN, reason
    if now in expected.other_ends:
        return NOT_JUDGED, f"rounding decides how it ends: {reason}"
    is_worse = before in _STATUSES and _STATUSES.index(now) > _STATUSES.index(before)
    return (REGRESSION if is_worse else BETTER), reason


def _compare_truths(row: Row, expected: Expected) -> Iterator[Finding]:
    """Yield a finding for each truth that differs from the baseline by more than the uncertainties."""
    tiers = {metric.tier for metric in row.metrics if metric.kind == TRUTH}
    for fixed, now, reason in moved_truths(row, expected):
        # A truth of another tier need not have the same numbers.
        is_other_tier = now is None and bool(tiers) and fixed.tier not in tiers
        severity = NOT_JUDGED if is_other_tier else REGRESSION
        value = None if now is None else now.value
        yield Finding(severity, TRUTH, row.key, fixed.name, fixed.value, value, math.inf, reason)


def _compare_numbers(
    row: Row,
    expected: Expected,
    kinds: Collection[str],
    times: Times | None,
    conditions: str,
) -> Iterator[Finding]:
    """Yield the differences of the numbers of a run, which ended like the expected one."""
    has_same_conditions = expected.conditions == conditions
    measured = {metric.name: metric for metric in row.metrics}
    known = expected.metrics
    for name, new in measured.items():
        # Motions that the baseline lacks are counted for all runs together, by `_without_motion`.
        if name not in known and new.kind != MOTION:
            reason = "the baseline does not have it"
            yield Finding(NEW, new.kind, row.key, name, None, new.value, math.inf, reason)
    for name, old in known.items():
        if name not in measured:
            if old.kind in kinds:
                yield _missing_number(row, old)
            continue
        finding = _compare_number(row, old, measured[name], times, has_same_conditions)
        if finding is None:
            continue
        reason = finding.reason + _version_note(row, expected)
        excuse = _excuse(row, old, has_same_conditions)
        if excuse:
            yield replace(finding, severity=NOT_JUDGED, reason=f"{excuse}; {reason}")
        else:
            yield replace(finding, reason=reason)


def _compare_number(
    row: Row, old: Metric, new: Metric, times: Times | None, has_same_conditions: bool
) -> Finding | None:
    """Return the finding of a number by the rule of its kind; None if the difference is noise."""
    if old.kind == "time":
        return None if times is None else _compare_time(row.key, old, times, has_same_conditions)
    if old.kind in ("accuracy", "drift"):
        return _compare_error(row, old, new)
    if old.kind == TRUTH:
        return _compare_own_truth(row, old, new)
    if old.kind == MOTION:
        return _compare_motion(row, old, new)
    return _compare_count(row, old, new)


def _excuse(row: Row, old: Metric, has_same_conditions: bool) -> str:
    """Return why a difference of a number leads to no verdict; empty if it does."""
    if not has_same_conditions and old.rounding is None and old.kind in (*FURTHER, MOTION):
        return "not judged: made under other conditions, and how far rounding moves it was not measured"
    return not_judged(old, row.parameter)


def _without_motion(rows: Iterable[Row], baseline: Baseline) -> Iterator[Finding]:
    """Yield one finding for all runs whose motion a baseline of an earlier version does not have."""
    keys = []
    for row in rows:
        expected = baseline.expected(row)
        if expected is None or expected.outcome != row.outcome:
            continue
        motion = {metric.name for metric in row.metrics if metric.kind == MOTION}
        if not motion <= expected.motion.keys():
            keys.append(row.key)
    if not keys:
        return
    others = f" and {len(keys) - 1} others" if len(keys) > 1 else ""
    yield Finding(
        NEW,
        MOTION,
        keys[0] + others,
        "positions at the end",
        None,
        None,
        math.inf,
        "the baseline, of an earlier version, does not have them: `stiction baseline update` records "
        "them",
    )


def _missing_number(row: Row, old: Metric) -> Finding:
    """Return the finding of a number that the baseline has and the run has not."""
    severity, reason = REGRESSION, "the baseline has it, this run has nothing"
    # A truth of another tier may lack the number with which the run would be compared.
    tiers: list[Tier] = []
    if old.kind in ("accuracy", "event"):
        tiers = sorted(
            {metric.tier for metric in row.metrics if metric.kind in ("accuracy", "event")}
        )
    if tiers and old.tier not in tiers:
        severity = NOT_JUDGED
        now = ", ".join(tier.label for tier in tiers)
        reason = f"not judged: the baseline's truth ({old.tier.label}) has it, that of now ({now}) has not"
    elif old.rounding == math.inf:
        severity, reason = NOT_JUDGED, "not judged: with other rounding it is not there"
    return Finding(severity, old.kind, row.key, old.name, old.value, None, math.inf, reason)


def _version_note(row: Row, expected: Expected) -> str:
    """Return both versions of the engine as an addition to a reason; empty if they are equal or unknown."""
    if not row.version or not expected.version or row.version == expected.version:
        return ""
    return f" ({row.engine} {row.version}; the baseline's is of {expected.version})"


def _compare_count(row: Row, old: Metric, new: Metric) -> Finding | None:
    """Return the finding of a number of events or of a counter."""
    change = new.value - old.value
    allowed = tolerance(old, _uncertainty(old, new))
    if abs(change) <= allowed:
        return None
    is_better = (change > 0) == (old.name in _MORE_IS_BETTER)
    reason = "more" if change > 0 else "fewer"
    if allowed:
        reason += f"; rounding moves it by {old.rounding:g}, allowed {allowed:g}"
    else:
        reason += "; counted exactly"
    if old.kind == "event":
        reason += f", against the truth ({new.tier.label})"
    return Finding(
        BETTER if is_better else REGRESSION,
        old.kind,
        row.key,
        old.name,
        old.value,
        new.value,
        _ratio(old.value, new.value),
        reason,
        # No change of a count is smaller than 1.
        excess=_excess(abs(change), max(allowed, 1.0)),
    )


def _compare_motion(row: Row, old: Metric, new: Metric) -> Finding | None:
    """Return the finding of a position at the end, or of the length of the path of a run with fixed steps."""
    change = abs(new.value - old.value)
    allowed = tolerance(old, _uncertainty(old, new))
    if change <= allowed:
        return None
    excess = _excess(change, allowed)
    if old.uncertainty is None:  # a path
        ratio = _ratio(old.value, new.value)
        relative_change = abs(new.value / old.value - 1) if old.value else math.inf
        reason = f"by {relative_change:.2g} of itself; allowed {PATH_MOVED:g}: fixed steps stay where they are"
    else:
        ratio = excess
        reason = f"it ends {change:.2g} from where it did; allowed {allowed:.2g}"
    return Finding(
        REGRESSION, MOTION, row.key, old.name, old.value, new.value, ratio, reason, excess
    )


def _compare_own_truth(row: Row, old: Metric, new: Metric) -> Finding | None:
    """Return the finding of a truth that is our own run; others are compared by `_compare_truths`."""
    if old.tier != Tier.OWN_RUN:
        return None
    change = abs(new.value - old.value)
    allowed = tolerance(old, _uncertainty(old, new))
    if change <= allowed:
        return None
    reason = f"the run that stands in for a truth has moved by {change:.2g}; allowed {allowed:.2g}"
    return Finding(REGRESSION, TRUTH, row.key, old.name, old.value, new.value, math.inf, reason)


def _compare_error(row: Row, old: Metric, new: Metric) -> Finding | None:
    """Return the finding of an error or a drift, which has a hard `bound` in both directions."""
    margin = MARGIN[new.tier] * _uncertainty(old, new)
    ratio = _ratio(old.value, new.value)
    largest = bound(old.value, row.parameter, margin)
    largest_before = bound(new.value, row.parameter, margin)
    # Written such that an error that is not a number is a regression, too.
    if not new.value <= largest:
        severity = REGRESSION
        excess = _excess(new.value, largest)
        reason = (
            f"{ratio:.3g} times the baseline's, against the truth ({new.tier.label}); "
            f"allowed up to {largest:.2g}"
        )
    elif old.value > largest_before:
        severity = BETTER
        excess = _excess(old.value, largest_before)
        reason = f"the baseline's is {ratio:.3g} times this one"
    else:
        return None
    return Finding(
        severity, old.kind, row.key, old.name, old.value, new.value, ratio, reason, excess
    )


def _compare_time(key: str, old: Metric, times: Times, has_same_conditions: bool) -> Finding | None:
    """Return the finding of a time, which leads to no verdict.

    It is compared with the history if this is long enough, and else with the baseline.
    """
    if len(times.past) >= MIN_HISTORY:
        past = times.past[-MAX_HISTORY:]
        before = median(past)
        deviation = STANDARD_DEVIATION * median(abs(value - before) for value in past)
        factor = max(BOUND_HISTORY, 1 + SIGMAS * deviation / before)
        origin = f"the median of {len(past)} nights under these conditions"
        has_same_conditions = True
    else:
        before = old.value
        factor = BOUND_BASELINE
        origin = "the baseline's"
    # All measurements must be beyond the bound; the one nearest to it is reported.
    shortest, longest = min(times.now), max(times.now)
    if shortest > factor * before:
        now, word = shortest, "slow"
    elif longest < before / factor:
        now, word = longest, "fast"
    else:
        return None
    ratio = _ratio(before, now)
    cause = "the baseline was made under other conditions"
    if has_same_conditions:
        cause = "other work on the machine has the same effect"
    reason = (
        f"at least {ratio:.2f} times as {word}; reported from {factor:.2f} times {origin}; "
        f"no verdict: {cause}, `stiction check --control` decides"
    )
    return Finding(
        NOT_JUDGED, "time", key, old.name, before, now, ratio, reason, excess=ratio / factor
    )


def _compare_times_in_turns(
    rows: Sequence[Row], turns: Mapping[str, Mapping[str, float] | str]
) -> Iterator[Finding]:
    """Yield the engines whose times differ from those with older code, and the runs that could not be timed."""
    # Ratios of the runs of an engine, by engine and name of the time.
    ratios_of: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        ratios = turns.get(row.key, {})
        if isinstance(ratios, str):
            name = IN_TURNS.format(TOTAL)
            yield Finding(NOT_JUDGED, "time", row.key, name, None, None, math.inf, ratios)
            continue
        for name, ratio in ratios.items():
            ratios_of.setdefault((row.engine, name), []).append(ratio)
    for (engine, name), measured in ratios_of.items():
        finding = _compare_engine_in_turns(engine, name, measured)
        if finding is not None:
            yield finding


def _compare_engine_in_turns(engine: str, name: str, ratios: Sequence[float]) -> Finding | None:
    """Return the finding of the ratios of an engine's times to those with older code; None if they are noise."""
    now = median(ratios)
    if len(ratios) < MIN_RUNS_IN_TURNS:
        severity = NOT_JUDGED
        reason = f"no verdict on fewer than {MIN_RUNS_IN_TURNS} runs"
    elif 1 / BOUND_TURNS <= now <= BOUND_TURNS:
        return None
    else:
        severity = REGRESSION if now > 1 else BETTER
        reason = f"noise ends at {BOUND_TURNS:g}"
    ratio = _ratio(1.0, now)
    return Finding(
        severity,
        "time",
        engine,
        IN_TURNS.format(name),
        1.0,
        now,
        ratio,
        f"median of {len(ratios)} runs, {min(ratios):.2f} to {max(ratios):.2f}, timed in turns with the "
        f"code before; {reason}",
        excess=ratio / BOUND_TURNS,
    )


def _uncertainty(old: Metric, new: Metric) -> float:
    """Return the sum of the uncertainties of two numbers; an unknown one counts as 0."""
    return (old.uncertainty or 0.0) + (new.uncertainty or 0.0)


def _ratio(old: float, new: float) -> float:
    """Return the ratio of the larger to the smaller size of two numbers; infinite if one is 0."""
    smaller, larger = sorted((abs(old), abs(new)))
    return larger / smaller if smaller > 0 else math.inf


def _excess(size: float, allowed: float) -> float:
    """Return the ratio of a size to the largest one that is allowed; infinite if none is, or the size is no number."""
    if math.isnan(size) or allowed == 0.0:
        return math.inf
    return size / allowed
