"""Runs of a campaign as a night, which is stored in a history, or as a check of a change.

Both come to an end even if runs fail, hang or terminate their processes.
"""

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
    count_compared,
    findings,
    verdict,
)
from stiction.comparisons.regression.history import (
    AFTER_ALL_NIGHTS,
    History,
    HistoryRefused,
    open_history,
)
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
"""Name of the file of the history in its folder."""

OnStart = Callable[[int], None] | None
"""Called with the number of runs."""
OnRow = Callable[[Row], None] | None
"""Called with each row as soon as its run has ended."""


@dataclass(frozen=True)
class Result:
    """The result of a night or a check.

    Attributes
    ----------
    name : str
        The night, or ``check``.
    campaign : Campaign
        The campaign, of which a check may contain a part.
    rows : tuple of Row
        The runs, in the order of the campaign.
    findings : tuple of Finding
        Differences from the baseline and the history, worst first.
    verdict : str
        See `check.verdict`.
    origin : Mapping
        Machine, versions and commit (`environment.origin`).
    compared : int
        Number of runs that were compared.
    wall_s : float
        Duration, s.
    resumed : int
        Number of runs that an interrupted call for the same night had made.
    first_nights : Mapping
        By key of the run, the night with which a run is compared that the baseline does not have.
    night_before : str
        The last finished night before; empty if there is none.
    changed : tuple of str
        What has changed in the environment since then (`night_changes.environment_changes`).
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
    """Raised if the campaign has used up its time."""


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
    """Run a night, or the rest of the last one if it was interrupted.

    Parameters
    ----------
    folder
        Folder of the history. Each run is stored there as soon as it has ended.
    publish
        Called with the result before the night counts as finished. If it is interrupted, the next call resumes the
        night.
    isolated
        How the runs are made; on a cluster, no run may be timed.
    on_start, on_result
        Called with the number of runs, and with each row.

    Raises
    ------
    HistoryRefused
        If the history cannot be used, or if another night is being written to it.
    """
    started = time.monotonic()
    make_folder(folder)
    lock = FileLock(folder / f".{HISTORY}.lock", blocking=False)
    try:
        lock.acquire()
    except Timeout:
        raise HistoryRefused(f"{folder / HISTORY}: another night is being written to it") from None
    with lock, open_history(folder / HISTORY) as history:
        # Make the runs that the history does not have.
        here = origin()
        night = history.begin(campaign.name, _digest(campaign), here)
        stored = {row.key for row in history.rows(night)}

        def store(row: Row) -> None:
            history.append(night, row)
            if on_result is not None:
                on_result(row)

        missing = [run for run in campaign.runs if run.key not in stored]
        _measure(missing, campaign, isolated, on_start, store)

        # Judge all runs of the night.
        rows = history.rows(night)
        times = _times_of_nights(rows, history.times(here["conditions"], night))
        extended, first_nights = _with_first_nights(baseline, rows, history, night)
        night_before, changed = _since_night_before(history, night, here, rows)
        result = replace(
            _result_of(night, campaign, rows, extended, times, here, started),
            resumed=len(stored),
            first_nights=first_nights,
            night_before=night_before,
            changed=changed,
        )
        publish(result)
        history.finish(night, result.verdict)
    return result


def _times_of_nights(
    rows: Iterable[Row], past: Mapping[tuple[str, str], Sequence[float]]
) -> dict[str, Times]:
    """Return the times that are judged in a night, by key of the run: those of the last `SESSIONS` nights.

    `past` are the times of earlier nights, oldest first, by identity and engine.
    """
    times = {}
    for row in rows:
        now = _times(row)
        if not now:
            continue
        sessions = [*past.get((row.identity, row.engine), ()), *now]
        if len(sessions) >= SESSIONS:
            times[row.key] = Times(sessions[-SESSIONS:], sessions[:-SESSIONS])
    return times


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
    """Check a change by the part of a campaign that is meant for checks.

    Parameters
    ----------
    baseline
        What the runs are compared with.
    history
        File of nights with whose times those of the runs are compared; the baseline's if None. The comparison leads to
        no verdict.
    control
        Checkout of the older code against which the times are judged (`older_code.times_in_turns`); they are not judged
        if None.
    whole
        True if all runs of the campaign are to be made.
    on_start, on_result
        Called with the number of runs, and with each row.
    """
    started = time.monotonic()
    here = origin()
    runs = campaign.runs if whole else campaign.check_runs
    rows = _measure(runs, campaign, isolate, on_start, on_result)
    past: Mapping[tuple[str, str], Sequence[float]] = {}
    night_before = ""
    changed: tuple[str, ...] = ()
    if history is not None:
        with open_history(history, write=False) as nights:
            past = nights.times(here["conditions"])
            night_before, changed = _since_night_before(nights, AFTER_ALL_NIGHTS, here, rows)
    times = {}
    for row in rows:
        now = _times(row)
        if now:
            times[row.key] = Times(now, past.get((row.identity, row.engine), ()))
    turns: Mapping[str, Mapping[str, float] | str] = {}
    if control is not None:
        timed = [run for run in runs if run.key in times]
        turns = times_in_turns(timed, control, campaign.budget.run)
    return replace(
        _result_of("check", campaign, rows, baseline, times, here, started, turns),
        night_before=night_before,
        changed=changed,
    )


def _since_night_before(
    history: History, night: str, here: Mapping[str, Any], rows: Sequence[Row]
) -> tuple[str, tuple[str, ...]]:
    """Return the last finished night before a night, and what has changed since then; empty if there is none."""
    before = history.finished_before(night)
    if before is None:
        return "", ()
    engines = engine_versions((row.engine, row.version) for row in rows)
    engines |= _versions(row.engine for row in rows if row.engine not in engines)
    changes = environment_changes(history.origin(before), here, history.engines(before), engines)
    return before, tuple(changes)


def _versions(engines: Iterable[str]) -> dict[str, str]:
    """Return the versions that engines state themselves; engines that cannot be loaded are left out."""
    versions = {}
    for name in dict.fromkeys(engines):
        if name == TRUTH:
            continue
        try:
            versions[name] = load_engine(name).version
        except StictionError:
            # The rows of its runs contain the reason.
            continue
    return versions


def _result_of(
    name: str,
    campaign: Campaign,
    rows: Sequence[Row],
    baseline: Baseline,
    times: Mapping[str, Times],
    here: Mapping[str, Any],
    started: float,
    turns: Mapping[str, Mapping[str, float] | str] = MappingProxyType({}),
) -> Result:
    """Return the result of runs that began at the monotonic time `started` (s)."""
    differences = findings(rows, baseline, campaign.measure, times, here["conditions"], turns)
    compared_runs = count_compared(rows, baseline)
    return Result(
        name,
        campaign,
        tuple(rows),
        tuple(differences),
        verdict(differences, compared_runs),
        here,
        compared_runs,
        time.monotonic() - started,
    )


def measured_rounding(
    campaign: Campaign, rows: Sequence[Row], on_start: OnStart = None, on_result: OnRow = None
) -> list[Row]:
    """Return rows with the effect of rounding on each number, for which the runs are repeated in all `WAYS`.

    Rows of runs for which the time of the campaign is not sufficient are returned unchanged.
    """
    keys = {row.key for row in rows if row.metrics}
    runs = [run for run in campaign.runs if run.variant is not None and run.key in keys]
    repeated = [replace(run, way=way) for run in runs for way in WAYS]
    # Without times, runs may disturb each other, and all processors are used.
    kinds = tuple(kind for kind in campaign.measure if kind != "time")
    untimed = campaign.model_copy(update={"workers": os.cpu_count() or 1, "measure": kinds})
    repeated_rows = _measure(repeated, untimed, isolate, on_start, on_result)
    rows_of: dict[str, list[Row]] = defaultdict(list)
    for run, row in zip(repeated, repeated_rows, strict=True):
        # Other causes than rounding, such as a busy machine, are left out.
        if row.status not in (Status.NOT_RUN, Status.TIMED_OUT, Status.CRASHED):
            rows_of[replace(run, way="").key].append(row)
    return [with_rounding(row, rows_of[row.key]) for row in rows]


def _with_first_nights(
    baseline: Baseline, rows: Sequence[Row], history: History, night: str
) -> tuple[Baseline, dict[str, str]]:
    """Return a baseline that also has the first nights of runs which it lacks, and these nights by key of the run."""
    runs = dict(baseline.runs)
    nights: dict[str, str] = {}
    for row in rows:
        if baseline.expected(row) is not None:
            continue
        first = history.first(row.identity, night)
        if first is None:
            continue
        earlier, old = first
        runs[row.key] = expected_of(old, history.origin(earlier)["conditions"])
        if row.variant != TRUTH:
            nights[row.key] = earlier
    return baseline.model_copy(update={"runs": runs}), nights


def _measure(
    runs: Sequence[PlannedRun],
    campaign: Campaign,
    isolated: Isolate,
    on_start: OnStart,
    on_row: OnRow,
) -> list[Row]:
    """Make runs and return their rows, in the order of the runs.

    If the time of the campaign is over, the remaining runs have rows with the status `Status.NOT_RUN`.
    """
    prepare(variant.engine for variant in campaign.variants)
    calibration_kernel()
    if on_start is not None:
        on_start(len(runs))
    run_of = {run.key: run for run in runs}
    rows: dict[str, Row] = {}
    budget = campaign.budget
    end = time.monotonic() + budget.total

    def keep(outcome: Outcome) -> None:
        row = row_of(run_of[outcome.label], outcome)
        rows[outcome.label] = row
        if on_row is not None:
            on_row(row)
        if time.monotonic() > end and outcome.status != Status.NOT_RUN:
            raise _Spent

    tasks = [task_of(run, campaign.measure, campaign.repeats) for run in runs]
    try:
        isolated(tasks, workers=campaign.workers, timeout_s=budget.run, on_result=keep)
    except _Spent:
        reason = f"the {budget.total:g} s of the campaign were over"
        for key in [key for key in run_of if key not in rows]:
            keep(Outcome(key, Status.NOT_RUN, reason=reason))
    return [rows[key] for key in run_of]


def _times(row: Row) -> list[float]:
    """Return the time of a run as a list, which is empty if it was not measured."""
    return [metric.value for metric in row.metrics if metric.kind == "time"]


def _digest(campaign: Campaign) -> str:
    """Return a digest of all that the numbers of a campaign depend on; an interrupted night is resumed only with it."""
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
