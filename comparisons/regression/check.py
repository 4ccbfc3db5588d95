"""Changes beyond noise: of runs against the baseline, of times against the history.

A run is compared with that of the same identity in the baseline; one that it does not have is new. Every kind of number
has its own rule, and knows how far rounding alone moves it (`tolerances`):

- status and events are compared exactly, and so are counters that rounding leaves alone;
- other counters may differ by `FURTHER` times as much as rounding moves them;
- truths may differ by their uncertainties;
- errors and drift have hard bounds; one that rounding moves beyond its bound leads to no verdict.

Where that was not measured, errors, drift and counters are judged under the same `environment.conditions` only: no
verdict depends on the make of the processor. A number that only one of two truths has, such as a kind of events, is
compared within a tier only.

Times lead to a verdict only against the code before, timed in turns with it (`regression.older_code`).
The median over the runs of an engine decides, see `BOUND_TURNS`. Against a baseline or the history they are reported
without a verdict: a neighbour that keeps both cores busy makes 1.5 times of them, another processor 1.9 times.
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

REGRESSION, COULD_NOT_RUN, BETTER, NOT_JUDGED, NEW = (
    "regression",
    "could not run",
    "better",
    "not judged",
    "new",
)
SEVERITIES = (REGRESSION, COULD_NOT_RUN, BETTER, NOT_JUDGED, NEW)
"""Severities of a finding, worst first."""
FINE, NOTHING = "fine", "nothing compared"
"""Verdicts without a regression or a run that could not be made; `NOTHING` where no run was compared."""

BOUND_TURNS, FEWEST = 1.25, 5
"""Ratio to the code before from which on the median of an engine's runs counts as slower, and their least number.

On two cores with six processes each run by itself gave 0.75 to 1.20 for the same code, the median of 42 runs 1.01 and
0.98; 1.52 for an engine that is half as slow again."""
SESSIONS = 3
"""Measurements of a time in different nights, each of which must be beyond the bound to be reported."""
HISTORY = (5, 20)
"""Measurements that make a history: at least, and at most, the latest."""
BOUND_HISTORY, SIGMAS = 1.25, 6.0
"""Against the history under the same conditions, bounds of a time: ratio to its median, and standard deviations (1.4826
times the median absolute deviation) above it."""
BOUND_BASELINE = 1.5
"""Ratio to one measurement, a baseline's."""

IN_TURNS = "over_older:{}"
"""Name of the quantity."""

_RANKS = ("status", TRUTH, "event", "accuracy", MOTION, "drift", "counter", "time")
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
"""From good to bad, silently wrong the worst; `UNMADE` ones are no property of a solver."""
_MORE_IS_BETTER = ("events_matched",)


@dataclass(frozen=True)
class Finding:
    """Something that is not as the baseline has it.

    `severity` is one of `SEVERITIES`; `kind` is that of the number, or ``status``, where `metric` is empty. The
    baseline or the history had `before`, this run has `now`; None where there is none. `ratio` is that of the larger
    to the smaller size, infinite where that means nothing. `reason` says why this is not noise.
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
    """Measurements of a time: `now`, each of which is judged, and `past`, oldest first, under the same conditions."""

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
    """Return all that is not as the baseline has it, worst first. Rows that only the baseline has are not missed.

    The rows have numbers of these `kinds`, made under these `environment.conditions`. `times` are those that are
    reported, by key of the run; `turns` the yield of `older_code.times_in_turns`.
    """
    found: list[Finding] = []
    for row in rows:
        expected = baseline.expected(row)
        if finding := _of_status(row, expected, baseline):
            found.append(finding)
        elif expected is not None:
            tiers = {metric.tier for metric in row.metrics if metric.kind == TRUTH}
            found += [
                Finding(
                    NOT_JUDGED if now is None and tiers and fixed.tier not in tiers else REGRESSION,
                    TRUTH,
                    row.key,
                    fixed.name,
                    fixed.value,
                    None if now is None else now.value,
                    math.inf,
                    why,
                )
                for fixed, now, why in moved_truths(row, expected)
            ]
            found += _compared(
                row, expected, kinds, times.get(row.key), expected.conditions == conditions
            )
    found += _of_turns(rows, turns)
    found += _without_ends(rows, baseline)
    return sorted(
        found,
        key=lambda f: (
            SEVERITIES.index(f.severity),
            _RANKS.index(f.kind),
            -f.ratio,
            f.key,
            f.metric,
        ),
    )


def verdict(found: Iterable[Finding], compared: int) -> str:
    """Return `REGRESSION` or `COULD_NOT_RUN` if there is one; else `FINE`, or `NOTHING` where no run was compared."""
    severities = {finding.severity for finding in found}
    return next(
        (severity for severity in (REGRESSION, COULD_NOT_RUN) if severity in severities),
        FINE if compared else NOTHING,
    )


def compared(rows: Iterable[Row], baseline: Baseline) -> int:
    """Count the runs that were made and have an entry in the baseline; truths are no runs."""
    return sum(
        row.variant != TRUTH and row.outcome in _STATUSES and baseline.expected(row) is not None
        for row in rows
    )


def _of_status(row: Row, expected: Expected | None, baseline: Baseline) -> Finding | None:
    now, before = row.outcome, None if expected is None else expected.outcome
    entry = entry_of(row.engine)
    if now == Status.MISSING and entry and entry.optional:  # it need not be installed
        severity, words = NOT_JUDGED, row.reason
    elif expected is None:
        severity = NEW if now in (Status.OK, Status.REFUSED) else COULD_NOT_RUN
        other = baseline.runs.get(row.key)
        words = "not in the baseline" + (
            f", where the name is that of another run ({other.identity})" if other else ""
        )
        words += f": {row.reason}" if row.reason else ""
    elif now == before:
        return None
    else:
        words = (row.reason or f"before: {expected.reason}") + _other_version(row, expected)
        if now not in _STATUSES:
            severity = COULD_NOT_RUN
        elif now in expected.other_ends:
            severity, words = NOT_JUDGED, f"rounding decides how it ends: {words}"
        else:
            worse = before in _STATUSES and _STATUSES.index(now) > _STATUSES.index(before)
            severity = REGRESSION if worse else BETTER
    return Finding(severity, "status", row.key, "", before, now, math.inf, words)


def _compared(
    row: Row, expected: Expected, kinds: Collection[str], times: Times | None, alike: bool
) -> Iterator[Finding]:
    """Compare the numbers of a row with those expected, made under the same conditions where `alike`."""
    measured, known = {metric.name: metric for metric in row.metrics}, expected.metrics
    for name, new in measured.items():
        if name not in known:
            if new.kind == MOTION:  # `_without_ends`, once for all
                continue
            yield Finding(
                NEW,
                new.kind,
                row.key,
                name,
                None,
                new.value,
                math.inf,
                "the baseline does not have it",
            )
    for name, old in known.items():
        if name not in measured:
            if old.kind in kinds:
                yield _gone(row, old)
            continue
        why = not_judged(old, row.parameter)
        if not alike and old.rounding is None and old.kind in (*FURTHER, MOTION):
            why = "not judged: made under other conditions, and how far rounding moves it was not measured"
        rule = _of_error if old.kind in ("accuracy", "drift") else _of_number
        found = (
            times and _of_time(row.key, old, times, alike)
            if old.kind == "time"
            else rule(row, old, measured[name])
        )
        if found:
            found = replace(found, reason=found.reason + _other_version(row, expected))
            yield (
                replace(found, severity=NOT_JUDGED, reason=f"{why}; {found.reason}")
                if why
                else found
            )


def _without_ends(rows: Iterable[Row], baseline: Baseline) -> Iterator[Finding]:
    """Say of how many runs a baseline of an earlier version has no motion; it is not held against them."""
    keys = []
    for row in rows:
        expected = baseline.expected(row)
        new = [metric.name for metric in row.metrics if metric.kind == MOTION]
        if (
            expected is not None
            and expected.outcome == row.outcome
            and not expected.motion.keys() >= {*new}
        ):
            keys.append(row.key)
    if keys:
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


def _gone(row: Row, old: Metric) -> Finding:
    """Return the finding of a number that the baseline has and the row has not."""
    kinds = ("accuracy", "event")
    tiers = sorted(
        {metric.tier for metric in row.metrics if metric.kind in kinds} if old.kind in kinds else ()
    )
    severity, words = REGRESSION, "the baseline has it, this run has nothing"
    if tiers and old.tier not in tiers:
        severity = NOT_JUDGED
        now = ", ".join(tier.label for tier in tiers)
        words = f"not judged: the baseline's truth ({old.tier.label}) has it, that of now ({now}) has not"
    elif old.rounding == math.inf:
        severity, words = NOT_JUDGED, "not judged: with other rounding it is not there"
    return Finding(severity, old.kind, row.key, old.name, old.value, None, math.inf, words)


def _other_version(row: Row, expected: Expected) -> str:
    known = row.version and expected.version and row.version != expected.version
    return (
        f" ({row.engine} {row.version}; the baseline's is of {expected.version})" if known else ""
    )


def _of_number(row: Row, old: Metric, new: Metric) -> Finding | None:
    """Compare a number that may change by its `tolerance`."""
    allowed, moved = tolerance(old, _uncertainty(old, new)), new.value - old.value
    if abs(moved) <= allowed or old.kind == TRUTH and old.tier != Tier.OWN_RUN:
        return None
    severity, ratio = REGRESSION, _ratio(old.value, new.value)
    if old.kind == MOTION:
        if old.uncertainty is None:
            words = (
                f"by {abs(new.value / old.value - 1):.2g} of itself; allowed {PATH_MOVED:g}: fixed steps stay "
                "where they are"
            )
        else:
            words = f"it ends {abs(moved):.2g} from where it did; allowed {allowed:.2g}"
            ratio = abs(moved) / allowed if allowed else math.inf
    elif old.kind == TRUTH:
        ratio = math.inf
        words = f"the run that stands in for a truth has moved by {abs(moved):.2g}; allowed {allowed:.2g}"
    else:
        if (moved > 0) == (old.name in _MORE_IS_BETTER):
            severity = BETTER
        words = (
            f"rounding moves it by {old.rounding:g}, allowed {allowed:g}"
            if allowed
            else "counted exactly"
        )
        words += f", against the truth ({new.tier.label})" if old.kind == "event" else ""
        words = f"{'more' if moved > 0 else 'fewer'}; {words}"
    return Finding(severity, old.kind, row.key, old.name, old.value, new.value, ratio, words)


def _of_error(row: Row, old: Metric, new: Metric) -> Finding | None:
    """Compare an error or a drift, which has a hard `bound`."""
    margin, ratio = MARGIN[new.tier] * _uncertainty(old, new), _ratio(old.value, new.value)
    most, severity = bound(old.value, row.parameter, margin), REGRESSION
    words = f"{ratio:.3g} times the baseline's, against the truth ({new.tier.label}); allowed up to {most:.2g}"
    if new.value <= most:
        severity, words = BETTER, f"the baseline's is {ratio:.3g} times this one"
        if old.value <= bound(new.value, row.parameter, margin):
            return None
    return Finding(severity, old.kind, row.key, old.name, old.value, new.value, ratio, words)


def _of_time(key: str, old: Metric, times: Times, alike: bool) -> Finding | None:
    least, most = HISTORY
    if len(times.past) >= least:
        past = times.past[-most:]
        before = median(past)
        deviation = 1.4826 * median(abs(value - before) for value in past)
        factor, alike = max(BOUND_HISTORY, 1 + SIGMAS * deviation / before), True
        words = f"the median of {len(past)} nights under these conditions"
    else:
        before, factor, words = old.value, BOUND_BASELINE, "the baseline's"
    shortest, longest = min(times.now), max(times.now)
    if before / factor <= longest and shortest <= factor * before:
        return None
    slow = shortest > before
    now = shortest if slow else longest
    ratio = _ratio(before, now)
    why = (
        "other work on the machine has the same effect"
        if alike
        else "the baseline was made under other conditions"
    )
    return Finding(
        NOT_JUDGED,
        "time",
        key,
        old.name,
        before,
        now,
        ratio,
        f"at least {ratio:.2f} times as {'slow' if slow else 'fast'}; reported from {factor:.2f} times "
        f"{words}; no verdict: {why}, `stiction check --control` decides",
    )


def _of_turns(
    rows: Sequence[Row], turns: Mapping[str, Mapping[str, float] | str]
) -> Iterator[Finding]:
    """Compare the times of each engine with those of the code before, by the median of its runs."""
    measured: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        if isinstance(of_row := turns.get(row.key, {}), str):
            yield Finding(
                NOT_JUDGED, "time", row.key, IN_TURNS.format(TOTAL), None, None, math.inf, of_row
            )
            continue
        for what, ratio in of_row.items():
            measured.setdefault((row.engine, what), []).append(ratio)
    for (engine, what), ratios in measured.items():
        now, enough = median(ratios), len(ratios) >= FEWEST
        if 1 / BOUND_TURNS <= now <= BOUND_TURNS and enough:
            continue
        severity = NOT_JUDGED if not enough else REGRESSION if now > 1 else BETTER
        why = (
            f"noise ends at {BOUND_TURNS:g}"
            if enough
            else f"no verdict on fewer than {FEWEST} runs"
        )
        yield Finding(
            severity,
            "time",
            engine,
            IN_TURNS.format(what),
            1.0,
            now,
            _ratio(1.0, now),
            f"median of {len(ratios)} runs, {min(ratios):.2f} to {max(ratios):.2f}, timed in turns with the "
            f"code before; {why}",
        )


def _uncertainty(old: Metric, new: Metric) -> float:
    return (old.uncertainty or 0.0) + (new.uncertainty or 0.0)


def _ratio(old: float, new: float) -> float:
    small, large = sorted((abs(old), abs(new)))
    return large / small if small > 0 else math.inf
