"""A campaign run to its end whatever happens on the way: every night into the history, or now as a check of a change."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from stiction.comparisons.atomic_files import make_folder
from stiction.comparisons.campaigns.baseline import Baseline, expected_of
from stiction.comparisons.campaigns.campaign import Campaign
from stiction.comparisons.campaigns.comparison import prepare
from stiction.comparisons.campaigns.history import History, HistoryRefused, open_history
from stiction.comparisons.campaigns.measurement import NOT_RUN, RANDOM, TRUTH, PlannedRun, Row
from stiction.comparisons.campaigns.regression import SESSIONS, Finding, Times, compared, findings, verdict
from stiction.comparisons.campaigns.rounding import WAYS, Disturbed, with_rounding
from stiction.comparisons.digest import circumstances, digest
from stiction.comparisons.environment import origin
from stiction.comparisons.random_scenes.night_draws import Draw, draws_of_night, sentences_on_draws
from stiction.comparisons.timing.calibration import calibration_kernel
from stiction.comparisons.timing.older_code import times_in_turns
from stiction.engines.isolation import Isolate, Outcome, isolate

HISTORY = "history.sqlite"


@dataclass(frozen=True)
class Result:
    """What a night or a check found.

    Attributes
    ----------
    name : str
        Of the night; ``check``.
    campaign : Campaign
    rows : tuple of Row
        Every run of it, failures included.
    findings : tuple of Finding
        Worst first.
    verdict : str
        See `regression.verdict`.
    origin : Mapping
        See `environment.origin`.
    random : str
        What became of the random scenes, with their seed; empty if none were drawn.
    resumed : int
        Rows that an interrupted run of the same night had made.
    wall_s : float
    compared : int
        Runs that were held to something.
    first_nights : Mapping[str, str]
        By key, of runs that the baseline does not have, the first night that has them: they are held to it.
    """

    name: str
    campaign: Campaign
    rows: tuple[Row, ...]
    findings: tuple[Finding, ...]
    verdict: str
    origin: Mapping[str, Any]
    resumed: int = 0
    wall_s: float = 0.0
    random: str = ""
    compared: int = 0
    first_nights: Mapping[str, str] = field(default_factory=dict)


class _Spent(Exception):
    """The campaign has used up its time."""


def run_night(campaign: Campaign, folder: Path, baseline: Baseline, publish: Callable[[Result], None], *, isolated: Isolate = isolate,
              on_start: Callable[[int], None] | None = None, on_result: Callable[[Row], None] | None = None) -> Result:
    """Run what the last night, if it was cut off, has left to do, or a new night; each run is in the history as soon as it ended.

    Parameters
    ----------
    folder
        Of the history, made if it is not there.
    publish
        Called with the result before the night counts as finished: if it is cut off in there, the next call resumes.
    isolated
        How the runs are made; on a cluster, none may be timed.
    on_start, on_result
        Told the number of runs, and each row as it comes in.

    Raises
    ------
    HistoryRefused
        If the history cannot be used, or another night is being written to it.
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

        runs = [*campaign.runs, *draws_of_night(night, {"slider-bars": campaign.random, "mechanisms": campaign.random_mechanisms})]
        _measure([run for run in runs if run.key not in done], campaign, campaign.measure, campaign.total_s, isolated, on_start, keep)
        rows = history.rows(night)
        past = history.times(here["conditions"], night)
        times = {}
        for row in rows:
            sessions = past.get((row.identity, row.engine), []) + _times(row)
            if len(sessions) >= SESSIONS and _times(row):
                times[row.key] = Times(sessions[-SESSIONS:], sessions[:-SESSIONS])
        held_to, first_nights = _with_first_nights(baseline, rows, history, night)
        found, count = findings(rows, held_to, campaign.measure, times, here["conditions"]), compared(rows, held_to)
        result = Result(night, campaign, tuple(rows), tuple(found), verdict(found, count), here, len(done), time.monotonic() - started, sentences_on_draws(rows), count,
                        first_nights)
        publish(result)
        history.finish(night, result.verdict)
    return result


def run_check(campaign: Campaign, baseline: Baseline, history: Path | None = None, control: Path | None = None, *,
              on_start: Callable[[int], None] | None = None, on_result: Callable[[Row], None] | None = None) -> Result:
    """Run the part of a campaign for checks.

    Parameters
    ----------
    history
        File with nights, for times; the baseline's where None.
    control
        Checkout of the code before, to be timed against in turns; without it, times lead to no verdict.

    Raises
    ------
    ControlRefused
        See `control.times_in_turns`.
    """
    started, here, part = time.monotonic(), origin(), campaign.check
    past: Mapping[tuple[str, str], Sequence[float]] = {}
    if history is not None:
        with open_history(history, write=False) as nights:
            past = nights.times(here["conditions"])
    rows = _measure(part.runs, part, part.measure, part.total_s, isolate, on_start, on_result)
    times = {row.key: Times(_times(row), past.get((row.identity, row.engine), ())) for row in rows if _times(row)}
    turns = {} if control is None else times_in_turns([run for run in part.runs if run.key in times], control, part.run_s)
    found, count = findings(rows, baseline, part.measure, times, here["conditions"], turns), compared(rows, baseline)
    return Result("check", part, tuple(rows), tuple(found), verdict(found, count), here, wall_s=time.monotonic() - started, compared=count)


def measured_rounding(campaign: Campaign, rows: Sequence[Row], on_start: Callable[[int], None] | None = None,
                      on_result: Callable[[Row], None] | None = None) -> list[Row]:
    """The rows with how far rounding moves each number, the runs made again; as they are where the campaign's time is over first."""
    came = {row.key for row in rows if row.metrics}
    runs = [Disturbed(run, way) for run in campaign.runs if run.variant is not None and run.key in came for way in WAYS]
    found: dict[str, list[Row]] = {}
    untimed = replace(campaign, workers=os.cpu_count() or 1)  # nothing is timed: runs may disturb each other
    for row in _measure(runs, untimed, [kind for kind in campaign.measure if kind != "time"], campaign.total_s, isolate, on_start, on_result):
        if row.status not in (NOT_RUN, "timed out", "crashed"):  # that is a busy machine's doing, or its memory's, and no rounding
            found.setdefault(row.key, []).append(row)
    return with_rounding(rows, found)


def _with_first_nights(baseline: Baseline, rows: Sequence[Row], history: History, night: str) -> tuple[Baseline, dict[str, str]]:
    """The baseline with entries from the first nights for runs that it does not have, and by key the nights that these are from."""
    runs, nights = dict(baseline.runs), {}
    for row in rows:
        if row.variant == RANDOM or baseline.expected(row) is not None:
            continue
        first = history.first(row.identity, night)
        if first is not None:
            earlier, old = first
            runs[row.key] = expected_of(old, history.origin(earlier)["conditions"])
            nights |= {row.key: earlier} if row.variant != TRUTH else {}
    return baseline.model_copy(update={"runs": runs}), nights


def _measure(runs: Sequence[PlannedRun | Draw | Disturbed], campaign: Campaign, kinds: Sequence[str], total_s: float,
             isolated: Isolate, on_start: Callable[[int], None] | None, on_row: Callable[[Row], None] | None) -> list[Row]:
    """The rows of the runs; what there is no time left for is a row as well."""
    prepare(variant.engine for variant in campaign.variants)
    calibration_kernel()
    if on_start is not None:
        on_start(len(runs))
    by_key = {run.key: run for run in runs}
    rows: dict[str, Row] = {}
    end = time.monotonic() + total_s

    def keep(outcome: Outcome) -> None:
        rows[outcome.label] = by_key[outcome.label].row(outcome)
        if on_row is not None:
            on_row(rows[outcome.label])
        if time.monotonic() > end and outcome.status != NOT_RUN:
            raise _Spent

    try:
        isolated([run.task(kinds, campaign.repeats) for run in runs], workers=campaign.workers, timeout_s=campaign.run_s, on_result=keep)
    except _Spent:
        for key in [key for key in by_key if key not in rows]:
            keep(Outcome(key, NOT_RUN, reason=f"the {total_s:g} s of the campaign were over"))
    return [rows[key] for key in by_key]


def _times(row: Row) -> list[float]:
    return [metric.value for metric in row.metrics if metric.kind == "time"]


def _digest(campaign: Campaign) -> str:
    """Digest of everything that the numbers depend on."""
    engines = dict.fromkeys(["reference", *(variant.engine for variant in campaign.variants)])
    return digest([campaign.name, campaign.scenes, campaign.variants, campaign.measure, campaign.random,
                   campaign.random_mechanisms, campaign.repeats, campaign.workers, campaign.run_s, circumstances(engines)])
