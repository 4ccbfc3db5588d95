"""Campaigns: ``validate``, ``nightly``, ``check``, ``baseline update``."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stiction.cli.compare import lost_hard
from stiction.cli.exit_codes import COULD_NOT_RUN, FAILED, FINE, NOT_COMPARED, REGRESSED, Commands, ended, first_signal, interrupted, say
from stiction.cli.options import BaselineFile, CampaignFile, Engines, ExecutorName, Full, OneEngine, OtherScenes, Quick, Workers, about, apart, check_written, listed
from stiction.cli.render import or_shown, progress, show_summary, validation_progress

if TYPE_CHECKING:
    from stiction.comparisons.campaigns.campaign import Campaign
    from stiction.comparisons.campaigns.checkpoint import KeptRuns
    from stiction.comparisons.campaigns.nightly import Result

commands = typer.Typer()
baselines = typer.Typer(cls=Commands, no_args_is_help=True, help="What runs are held to.")


@commands.command()
def validate(quick: Quick = False, full: Full = False, engines: Engines = [], workers: Workers = None, executor: ExecutorName = "processes",
             out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of the report; runs/<date-time> if not given.")] = None) -> None:
    """Compare reference and engines with the truth on the paper's three cases, and write a report."""
    from stiction.comparisons.campaigns.checkpoint import kept_runs
    from stiction.comparisons.campaigns.validation import validate as run_campaign
    from stiction.comparisons.depth import Depth
    from stiction.comparisons.measures.accuracy import WRONG
    from stiction.comparisons.studies.executors import open_isolate
    from stiction.engines import engine_names
    from stiction.reports import REPORT, check_folder, write_report

    if quick and full:
        raise typer.BadParameter("found both; expected one of them, or neither", param_hint="--quick, --full")
    folder = out or Path("runs") / datetime.now().strftime("%Y-%m-%d-%H%M%S")
    with about("--out"):
        check_folder(folder, REPORT)
    with ExitStack() as stack:
        with about("--out"):
            kept = stack.enter_context(kept_runs(folder, ["reference", *(engines or engine_names())]))
        stack.callback(_tell_kept, kept, folder)
        if kept.kept:
            say(f"{kept.kept} runs of an earlier call are kept; those of the same scenes, engines and code are taken over")
        made_by = stack.enter_context(open_isolate(executor, workers))
        stack.enter_context(first_signal(partial(_end_runs, kept)))
        with validation_progress("validate") as (on_result, on_share, on_study):
            validation = run_campaign(depth=Depth.QUICK if quick else Depth.FULL if full else Depth.DEFAULT, engines=engines or None, workers=workers,
                                      on_result=on_result, on_share=on_share, on_study=on_study, isolated=partial(kept.isolate, made_by=made_by), timed_by=kept.isolate)
        validation = replace(validation, settings={**validation.settings, "runs taken over": kept.taken_over})
        with or_shown(lambda: show_summary(validation)):
            report = write_report(validation, folder)
        kept.finished = kept.interrupt is None
    print(report)
    show_summary(validation)
    if kept.interrupt is not None:
        raise interrupted(kept.interrupt, "the report has what was done until then")
    lost = [f"{record.key}: {record.describe()['reason']}" for record in validation.records
            if record.variant.engine == "reference" and record.describe()["reason"]]
    accuracy = validation.table("accuracy")
    wrong = accuracy[(accuracy["engine"] == "reference") & (accuracy["status"] == WRONG)] if len(accuracy) else accuracy
    lost += [f"{row.key}: {row.status}: {row.reason}" for row in wrong.itertuples()]
    lost += lost_hard(validation.table("hard"))
    if lost:
        raise ended(FAILED, f"{len(lost)} runs of the reference did not come out: {lost[0]}")


def _end_runs(kept: KeptRuns, interrupt: KeyboardInterrupt) -> None:
    try:
        kept.end(interrupt)
    finally:
        if kept.settled:
            with suppress(OSError):  # of a standard error that nobody reads any more
                say("no more runs are made; the report of what is done follows")


def _tell_kept(kept: KeptRuns, folder: Path) -> None:
    if kept.kept and not kept.finished:
        say(f"the runs that are done are kept; the same command with --out {folder} goes on with them")


@commands.command()
def nightly(campaign: CampaignFile = None, baseline: BaselineFile = None, engine: OneEngine = None, scenes: OtherScenes = [],
            executor: ExecutorName = "processes",
            out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of history.sqlite and of a folder per night.")] = Path("nightly"),
            ) -> None:
    """Run a campaign, or what an interrupted night has left of it, add it to the history, and report what changed."""
    from stiction.comparisons.campaigns.baseline import load_baseline
    from stiction.comparisons.campaigns.history import HistoryRefused
    from stiction.comparisons.campaigns.nightly import run_night
    from stiction.comparisons.studies.executors import open_isolate
    from stiction.reports.markdown.regression_report import check_report, write_night

    def publish(result: Result) -> None:
        write_night(result, _exit_code(result.verdict), out / result.name.replace(":", ""))

    chosen, expected = _campaign(campaign, engine, scenes), load_baseline(baseline)
    if executor != "processes" and "time" in chosen.measure:
        raise typer.BadParameter(f"found {executor!r}, and the campaign {chosen.name} measures time; expected processes, or a campaign whose `measure` leaves it "
                                 "out", param_hint="--executor")
    try:
        with open_isolate(executor, chosen.workers) as isolated, progress(f"night of {chosen.name}") as (on_start, on_result):
            result = run_night(chosen, out, expected, publish, isolated=isolated, on_start=on_start, on_result=on_result)
    except HistoryRefused as error:
        raise ended(COULD_NOT_RUN, str(error)) from None
    except KeyboardInterrupt as interrupt:
        raise interrupted(interrupt, f"the same command goes on with the runs that are in {out}") from None
    print(out / result.name.replace(":", ""))
    print(check_report(result), end="")
    raise typer.Exit(_exit_code(result.verdict))


@commands.command()
def check(campaign: CampaignFile = None, baseline: BaselineFile = None, engine: OneEngine = None, scenes: OtherScenes = [],
          history: Annotated[Path | None, typer.Option(metavar="FILE", help="History of this machine's nights, for times; "
                                                       "nightly/history.sqlite if it is there.")] = None,
          control: Annotated[Path | None, typer.Option(metavar="DIR", help="Checkout of the code before (git worktree add DIR main): runs are "
                                                       "timed in turns with it. Without it no verdict rests on time.")] = None) -> None:
    """Run the fast part of a campaign and print what changed beyond noise, worst first, as Markdown."""
    from stiction.comparisons.campaigns.baseline import load_baseline
    from stiction.comparisons.campaigns.history import HistoryRefused
    from stiction.comparisons.campaigns.nightly import HISTORY, run_check
    from stiction.comparisons.timing.older_code import ControlRefused
    from stiction.reports.markdown.regression_report import check_report

    usual = Path("nightly") / HISTORY
    chosen, expected = _campaign(campaign, engine, scenes), load_baseline(baseline)
    try:
        with progress(f"check of {chosen.name}") as (on_start, on_result):
            result = run_check(chosen, expected, history or (usual if usual.is_file() else None), control, on_start=on_start, on_result=on_result)
    except HistoryRefused as error:
        raise typer.BadParameter(str(error), param_hint="--history") from None
    except ControlRefused as error:
        raise typer.BadParameter(str(error), param_hint="--control") from None
    print(check_report(result), end="")
    raise typer.Exit(_exit_code(result.verdict))


@baselines.command("update")
def baseline_update(reason: Annotated[str, typer.Option(metavar="TEXT", help="Why the numbers changed; it is kept in the file.")],
                    campaign: CampaignFile = None, engine: OneEngine = None, scenes: OtherScenes = [],
                    file: Annotated[Path | None, typer.Option("--file", metavar="FILE", help="The baseline; the suite's own if not given. Made "
                                                              "if it is not there.")] = None,
                    night: Annotated[Path | None, typer.Option("--night", metavar="HISTORY", help="Take the last finished night of this "
                                                               "history; if not given, the part of the campaign for checks is run.")] = None,
                    whole: Annotated[bool, typer.Option("--whole", help="Run the whole campaign, not only the part for checks.")] = False) -> None:
    """Make what the runs give now what is expected of them. Truths of a tier above our own run are never touched.

    Each run is then made again in five ways that change nothing but rounding; what that moves beyond its tolerance is not judged.
    """
    from stiction.comparisons.campaigns import baseline as files
    from stiction.comparisons.campaigns.history import open_history
    from stiction.comparisons.campaigns.nightly import measured_rounding, run_check
    from stiction.comparisons.environment import origin

    if whole and night is not None:
        raise typer.BadParameter("found both; expected one of them, or neither", param_hint="--whole, --night")
    if not reason.strip():
        raise typer.BadParameter("found nothing; expected why the numbers changed", param_hint="--reason")
    path = file or files.DEFAULT
    check_written(path, option="--file")
    apart("--file", path, night)
    chosen = _campaign(campaign, engine, scenes)
    old = files.load_baseline(str(path)) if file is None or file.exists() else files.Baseline(format=files.FORMAT)
    if night is not None:
        with about("--night"), open_history(night, write=False) as history:
            name = history.last_finished()
            rows, made = (history.rows(name), history.origin(name)) if name else ([], origin())
    else:
        with progress(f"baseline of {chosen.name}") as (on_start, on_result):
            result = run_check(chosen, old, whole=whole, on_start=on_start, on_result=on_result)
        rows, made = result.rows, result.origin
    with progress(f"rounding of {chosen.name}") as (on_start, on_result):
        rows = measured_rounding(chosen, rows, on_start, on_result)
    try:
        # what --engine and --scenes leave out stays as it is
        known = {run.key for part in (chosen, _campaign(campaign, None, [])) for run in part.runs}
        new = files.updated(old, rows, reason.strip(), made, known)
    except files.BaselineRefused as error:
        raise ended(REGRESSED, f"{path}: {error}") from None
    files.write_baseline(new, path)
    print(f"{path}: {len(rows)} runs")


def _campaign(path: Path | None, engine: str | None, scenes: Sequence[str]) -> Campaign:
    from stiction.comparisons.campaigns.campaign import load_campaign
    from stiction.engines import EngineMissing

    found = load_campaign(path, listed(scenes))
    try:
        return found if engine is None else found.of_engine(engine)
    except EngineMissing as error:
        raise ended(COULD_NOT_RUN, str(error)) from None


def _exit_code(verdict: str) -> int:
    from stiction.comparisons.campaigns import regression

    return {regression.FINE: FINE, regression.REGRESSION: REGRESSED, regression.COULD_NOT_RUN: COULD_NOT_RUN, regression.NOTHING: NOT_COMPARED}[verdict]
