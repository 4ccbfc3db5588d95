"""A campaign run to its end whatever happens: every night into the history, or now as a check of a change."""

from __future__ import annotations

import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from filelock import FileLock, Timeout

from stiction.comparisons.bench.campaign import Campaign
from stiction.comparisons.bench.environment import origin
from stiction.comparisons.bench.identity import circumstances
from stiction.comparisons.bench.planned_runs import (
    TRUTH,
    WAYS,
    PlannedRun,
    Row,
    row_of,
)
from stiction.comparisons.bench.runner import prepare
from stiction.comparisons.bench.timing.calibration_kernel import calibration_kernel
from stiction.comparisons.regression.baseline import Baseline, expected_of
from stiction.comparisons.regression.check import (
    SESSIONS,
    Finding,
    Times,
    compared,
    findings,
    verdict,
)
from stiction.comparisons.regression.history import History, HistoryRefused, open_history
from stiction.comparisons.regression.measurement import task_of
from stiction.comparisons.regression.night_changes import engine_versions, environment_changes
from stiction.comparisons.regression.older_code import times_in_turns
from stiction.comparisons.regression.tolerances import with_rounding
from stiction.engines.isolation import Isolate, Outcome, isolate
from stiction.engines.registry import load_engine
from stiction.engines.status import Status
from stiction.scenes import StictionError
from stiction.scenes.atomic_files import make_folder
from stiction.scenes.digest import digest

HISTORY = "history.sqlite"

OnStart = Callable[[int], None] | None
"""Called with the number of runs."""
OnRow = Callable[[Row], None] | None
"""Called with each row as soon as its run has ended."""


@dataclass(frozen=True)
class Result:
    """Rows and findings of a night, or of a ``check``; worst findings first.

    `compared` runs were compared with something; an interrupted run of the same night had made `resumed` rows.
    `first_nights` has the nights with which runs without a baseline are compared. `night_before` is the finished night
    before, empty if there is none, `changed` what is different since then (`night_changes.environment_changes`).
    """

    name: str
    campaign: Campaign
    rows: tuple[Row, ...]
    findings: tuple[Finding, ...]
    verdict: str
    origin: Mapping[str, Any]
    compared: int
    wall_s: float
    resumed: int = 0
    first_nights: Mapping[str, str] = field(default_factory=dict)
    night_before: str = ""
    changed: tuple[str, ...] = ()


class _Spent(Exception):
    """The campaign has used up its time."""


def run_night(
    campaign: Campaign,
    folder: Path,
    baseline: Baseline,
    publish: Callable[[Result], None],
    *,
    isolated: Isolate = isolate,
    on_start: OnStart = None,
    on_result: OnRow = None,
) -> Result:
    """Run the rest of the last night, if it was cut off, or a new one; each run is in the history as soon as it ended.

    The history is in `folder`. `publish` is called with the result before the night counts as finished: if it is cut
    off in there, the next call resumes. On a cluster (`isolated`) no run may be timed. Raises `HistoryRefused` if the
    history cannot be used, or another night is being written to it.
    """
    started = time.monotonic()
    make_folder(folder)
    lock = FileLock(folder / f".{HISTORY}.lock", blocking=False)
    try:
        lock.acquire()
    except Timeout:
        raise HistoryRefused(f"{folder / HISTORY}: another night is being written to it") from None
    with lock, open_history(folder / HISTORY) as history:
        here = origin()
        night = history.begin(campaign.name, _digest(campaign), here)
        done = {row.key for row in history.rows(night)}

        def keep(row: Row) -> None:
            history.append(night, row)
            if on_result is not None:
                on_result(row)

        left = [run for run in campaign.runs if run.key not in done]
        _measure(left, campaign, isolated, on_start, keep)
        rows, past = history.rows(night), history.times(here["conditions"], night)
        times = {}
        for row in rows:
            sessions = past.get((row.identity, row.engine), []) + _times(row)
            if len(sessions) >= SESSIONS and _times(row):
                times[row.key] = Times(sessions[-SESSIONS:], sessions[:-SESSIONS])
        known, first_nights = _with_first_nights(baseline, rows, history, night)
        night_before, changed = _since_night_before(history, night, here, rows)
        result = replace(
            _judged(night, campaign, rows, known, times, here, started),
            resumed=len(done),
            first_nights=first_nights,
            night_before=night_before,
            changed=changed,
        )
        publish(result)
        history.finish(night, result.verdict)
    return result


def run_check(
    campaign: Campaign,
    baseline: Baseline,
    history: Path | None = None,
    control: Path | None = None,
    *,
    whole: bool = False,
    on_start: OnStart = None,
    on_result: OnRow = None,
) -> Result:
    """Run the part of a campaign for checks, or the `whole`.

    Times are compared with those of a file with nights, the `history`, else with the baseline's. They lead to a verdict
    only against the code before: `control`, its checkout (`older_code.times_in_turns`).
    """
    started, here, runs = (
        time.monotonic(),
        origin(),
        campaign.runs if whole else campaign.check_runs,
    )
    past: Mapping[tuple[str, str], Sequence[float]] = {}
    rows = _measure(runs, campaign, isolate, on_start, on_result)
    night_before, changed = "", tuple[str, ...]()
    if history is not None:
        with open_history(history, write=False) as nights:
            past = nights.times(here["conditions"])
            night_before, changed = _since_night_before(nights, "~", here, rows)
    times = {
        row.key: Times(_times(row), past.get((row.identity, row.engine), ()))
        for row in rows
        if _times(row)
    }
    timed = [run for run in runs if run.key in times]
    turns = {} if control is None else times_in_turns(timed, control, campaign.budget.run)
    return replace(
        _judged("check", campaign, rows, baseline, times, here, started, turns),
        night_before=night_before,
        changed=changed,
    )


def _since_night_before(
    history: History, night: str, here: Mapping[str, Any], rows: Sequence[Row]
) -> tuple[str, tuple[str, ...]]:
    """The finished night before a night, and what changed since then; empty where there is none."""
    before = history.finished_before(night)
    if before is None:
        return "", ()
    stated = engine_versions((row.engine, row.version) for row in rows)
    engines = {**_versions(row.engine for row in rows if row.engine not in stated), **stated}
    return before, tuple(
        environment_changes(history.origin(before), here, history.engines(before), engines)
    )


def _versions(engines: Iterable[str]) -> dict[str, str]:
    """Return the versions of engines of which no run came out, as they state them; without those that do not."""
    found = {}
    for name in dict.fromkeys(engines):
        if name == TRUTH:
            continue
        try:
            found[name] = load_engine(name).version
        except StictionError:
            continue  # its runs are rows with the reason
    return found


def _judged(
    name: str,
    campaign: Campaign,
    rows: Sequence[Row],
    baseline: Baseline,
    times: Mapping[str, Times],
    here: Mapping[str, Any],
    started: float,
    turns: Mapping[str, Mapping[str, float] | str] = MappingProxyType({}),
) -> Result:
    found = findings(rows, baseline, campaign.measure, times, here["conditions"], turns)
    count = compared(rows, baseline)
    return Result(
        name,
        campaign,
        tuple(rows),
        tuple(found),
        verdict(found, count),
        here,
        count,
        time.monotonic() - started,
    )


def measured_rounding(
    campaign: Campaign, rows: Sequence[Row], on_start: OnStart = None, on_result: OnRow = None
) -> list[Row]:
    """Return the rows with the effect of rounding on each number, for which the runs are made again.

    They stay as they are where the campaign's time is over first.
    """
    known = {row.key for row in rows if row.metrics}
    runs = [run for run in campaign.runs if run.variant is not None and run.key in known]
    again = [replace(run, way=way) for run in runs for way in WAYS]
    untimed = campaign.model_copy(
        update={  # so that runs may disturb each other
            "workers": os.cpu_count() or 1,
            "measure": tuple(kind for kind in campaign.measure if kind != "time"),
        }
    )
    found: dict[str, list[Row]] = defaultdict(list)
    for run, row in zip(again, _measure(again, untimed, isolate, on_start, on_result), strict=True):
        if row.status not in (
            Status.NOT_RUN,
            Status.TIMED_OUT,
            Status.CRASHED,
        ):
            # these are of a busy machine, and no rounding
            found[replace(run, way="").key].append(row)
    return [with_rounding(row, found[row.key]) for row in rows]


def _with_first_nights(
    baseline: Baseline, rows: Sequence[Row], history: History, night: str
) -> tuple[Baseline, dict[str, str]]:
    """Return the baseline with the first nights of runs that it does not have, and by key these nights."""
    runs, nights = dict(baseline.runs), dict[str, str]()
    for row in rows:
        if baseline.expected(row) is not None:
            continue
        first = history.first(row.identity, night)
        if first is not None:
            earlier, old = first
            runs[row.key] = expected_of(old, history.origin(earlier)["conditions"])
            nights |= {row.key: earlier} if row.variant != TRUTH else {}
    return baseline.model_copy(update={"runs": runs}), nights


def _measure(
    runs: Sequence[PlannedRun],
    campaign: Campaign,
    isolated: Isolate,
    on_start: OnStart,
    on_row: OnRow,
) -> list[Row]:
    """Return the rows of the runs; a run that there is no time left for has a row as well."""
    prepare(variant.engine for variant in campaign.variants)
    calibration_kernel()
    if on_start is not None:
        on_start(len(runs))
    by_key, budget = {run.key: run for run in runs}, campaign.budget
    rows: dict[str, Row] = {}
    end = time.monotonic() + budget.total

    def keep(outcome: Outcome) -> None:
        rows[outcome.label] = row_of(by_key[outcome.label], outcome)
        if on_row is not None:
            on_row(rows[outcome.label])
        if time.monotonic() > end and outcome.status != Status.NOT_RUN:
            raise _Spent

    try:
        tasks = [task_of(run, campaign.measure, campaign.repeats) for run in runs]
        isolated(tasks, workers=campaign.workers, timeout_s=budget.run, on_result=keep)
    except _Spent:
        for key in [key for key in by_key if key not in rows]:
            keep(
                Outcome(
                    key, Status.NOT_RUN, reason=f"the {budget.total:g} s of the campaign were over"
                )
            )
    return [rows[key] for key in by_key]


def _times(row: Row) -> list[float]:
    return [metric.value for metric in row.metrics if metric.kind == "time"]


def _digest(campaign: Campaign) -> str:
    engines = dict.fromkeys(["reference", *(variant.engine for variant in campaign.variants)])
    return digest(
        [
            campaign.name,
            campaign.scenes,
            campaign.variants,
            campaign.measure,
            campaign.repeats,
            campaign.workers,
            campaign.budget.run,
            circumstances(engines),
        ]
    )
