"""Commands that run campaigns: ``validate``, ``nightly``, ``check``, ``baseline update``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path
from shutil import disk_usage
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stiction.cli.exit_codes import (
    COULD_NOT_RUN,
    FAILED,
    FINE,
    NOT_COMPARED,
    REGRESSED,
    Commands,
    exit_interrupted,
    exit_with,
    first_signal,
    say,
)
from stiction.cli.options import (
    Assemble,
    BaselineFile,
    CampaignFile,
    Engines,
    ExecutorName,
    Full,
    OneEngine,
    OtherScenes,
    Overrides,
    Quick,
    ValidatedScenes,
    Workers,
    check_distinct,
    check_written,
    errors_of_option,
    scenes_of,
    split_names,
)
from stiction.cli.render import progress, show_summary, shown_if_not_written

if TYPE_CHECKING:
    from stiction.comparisons.bench.campaign import Campaign
    from stiction.comparisons.bench.planned_runs import Row
    from stiction.comparisons.bench.results import Results
    from stiction.comparisons.bench.store import KeptRuns
    from stiction.comparisons.regression.baseline import Baseline
    from stiction.comparisons.regression.nightly import Result
    from stiction.scenes import Scene

MIN_FREE_BYTES = 200e6
"""Free space of the disk below which `validate` prints a warning, bytes.

It is more than twice what the stored runs take with --quick and one engine.
"""
commands = typer.Typer()
baselines = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    help="Update the baseline, the numbers with which runs are compared.",
)


@commands.command()
def validate(
    quick: Quick = False,
    full: Full = False,
    scenes: ValidatedScenes = [],
    overrides: Overrides = [],
    assemble: Assemble = False,
    engines: Engines = [],
    workers: Workers = None,
    executor: ExecutorName = "processes",
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the report. Default: runs/<date-time>."),
    ] = None,
) -> None:
    """Compare the reference and the engines with the truth, and write a report.

    The scenes are the three cases of the paper, or those of --scenes.
    """
    from stiction.comparisons.bench.depth import Depth
    from stiction.comparisons.bench.executors import open_isolate
    from stiction.comparisons.bench.store import kept_runs
    from stiction.comparisons.validation import validate as run_campaign
    from stiction.engines import engine_names
    from stiction.reports import REPORT, check_folder, report_of, write_report

    if quick and full:
        raise typer.BadParameter(
            "found both; expected at most one of them", param_hint="--quick, --full"
        )
    if (overrides or assemble) and not scenes:
        raise typer.BadParameter(
            "found this option without --scenes; expected --scenes with the scenes that it changes",
            param_hint="--set" if overrides else "--assemble",
        )
    chosen = scenes_of(split_names(scenes), overrides, assemble) if scenes else ()
    if chosen:
        _check_names(chosen)
    folder = out or Path("runs") / datetime.now().strftime("%Y-%m-%d-%H%M%S")
    with errors_of_option("--out"):
        check_folder(folder, REPORT)
    _warn_if_disk_is_small(folder)
    depth = Depth.DEFAULT
    if quick:
        depth = Depth.QUICK
    elif full:
        depth = Depth.FULL
    with ExitStack() as stack:
        with errors_of_option("--out"):
            kept = stack.enter_context(
                kept_runs(folder, ["reference", *(engines or engine_names())])
            )
        stack.callback(_say_how_to_resume, kept, folder)
        if kept.kept:
            say(
                f"found {kept.kept} stored runs of an earlier call; those with the same scenes, engines and code are "
                "not repeated"
            )
        made_by = stack.enter_context(open_isolate(executor, workers))
        # After the first interrupt the report of the finished runs is written.
        stack.enter_context(first_signal(partial(_end_runs, kept)))
        with progress("validate") as bar:
            results = run_campaign(
                scenes=chosen,
                depth=depth,
                engines=engines or None,
                workers=workers,
                on_result=bar.collect,
                on_share=bar.share,
                on_study=bar.study,
                isolated=partial(kept.isolate, made_by=made_by),
                timed_by=kept.isolate,
            )
        settings = {**results.settings, "runs taken over": kept.taken_over}
        report = report_of(replace(results, settings=settings))
        with shown_if_not_written(partial(show_summary, report)):
            file = write_report(report, folder)
        kept.finished = kept.interrupt is None
    print(file)
    show_summary(report)
    if kept.interrupt is not None:
        raise exit_interrupted(kept.interrupt, "the report contains the runs that were finished")
    broken_down = list(_breakdowns_of_papers_scheme(results))
    if broken_down:
        say(
            f"the paper's scheme could not complete {len(broken_down)} runs of other scenes than those of "
            f"the paper; this is a result, and no failure of the command: {broken_down[0]}"
        )
    failed = list(_failures_of_reference(results))
    if failed:
        raise exit_with(FAILED, f"{len(failed)} runs of the reference failed: {failed[0]}")


def _check_names(scenes: Sequence[Scene]) -> None:
    """Check that the names of scenes can be parts of the names of files, of figures and of keys."""
    for scene in scenes:
        if not re.fullmatch(r"[A-Za-z0-9_-]+", scene.name):
            raise typer.BadParameter(
                f"found a scene with the name {scene.name!r}; expected a file whose name consists of the letters a "
                "to z, digits, hyphens and underscores, as figures and tables are named after it",
                param_hint="--scenes",
            )


def _warn_if_disk_is_small(folder: Path) -> None:
    """Print a warning if the disk with the folder of a report may be too small for the stored runs."""
    place = folder.absolute().parent
    while not place.exists():
        place = place.parent
    free = disk_usage(place).free
    if free < MIN_FREE_BYTES:
        say(
            f"only {free / 1e6:.0f} MB are free at {place}, where all runs are stored until the report is written; "
            "they need about 80 MB with --quick and one engine, and more otherwise. If the disk is full, the command "
            "ends; the same command resumes it"
        )


def _failures_of_reference(results: Results) -> Iterator[str]:
    """Yield key and reason of each run of the reference that failed, ended early or is wrong."""
    from stiction.comparisons.studies import studies

    for record in results.records:
        run = record.describe()
        is_own = run["engine"] == "reference" and not results.is_papers_scheme_elsewhere(record)
        if is_own and run["reason"]:
            yield f"{run['key']}: {run['reason']}"
    # Studies such as that of hard cases have runs of their own.
    for study in studies():
        if study.failures_of_reference is not None:
            yield from study.failures_of_reference(results)


def _breakdowns_of_papers_scheme(results: Results) -> Iterator[str]:
    """Yield key and reason of each run of the paper's scheme, on another scene, that failed or ended early."""
    for record in results.records:
        run = record.describe()
        if results.is_papers_scheme_elsewhere(record) and run["reason"]:
            yield f"{run['key']}: {run['reason']}"


def _end_runs(kept: KeptRuns, interrupt: KeyboardInterrupt) -> None:
    """Handle an interrupt of `validate`: make no more runs."""
    try:
        kept.end(interrupt)
    finally:
        if kept.settled:
            # Standard error may be closed.
            with suppress(OSError):
                say("interrupted; writing the report of the finished runs")


def _say_how_to_resume(kept: KeptRuns, folder: Path) -> None:
    """Print how to resume `validate`, if it has ended before its report was complete."""
    if kept.kept and not kept.finished:
        say(f"the finished runs are stored; to resume, repeat the command with --out {folder}")


@commands.command()
def nightly(
    campaign: CampaignFile = None,
    baseline: BaselineFile = None,
    engine: OneEngine = None,
    scenes: OtherScenes = [],
    executor: ExecutorName = "processes",
    out: Annotated[
        Path,
        typer.Option(metavar="DIR", help="Folder for history.sqlite and one subfolder per night."),
    ] = Path("nightly"),
) -> None:
    """Run a campaign, or resume an interrupted night, add the results to the history, and report changes."""
    from stiction.comparisons.bench.executors import open_isolate
    from stiction.comparisons.regression.history import HistoryRefused
    from stiction.comparisons.regression.nightly import run_night
    from stiction.reports.markdown.regression_report import write_night

    def publish(result: Result) -> None:
        write_night(result, _exit_code(result.verdict), _night_folder(out, result))

    chosen = _load_campaign(campaign, engine, scenes)
    expected = _load_baseline(campaign, baseline)
    if executor != "processes" and "time" in chosen.measure:
        raise typer.BadParameter(
            f"found {executor!r}, and the campaign {chosen.name} measures time; expected "
            "processes, or a campaign without time in `measure`",
            param_hint="--executor",
        )
    try:
        with (
            open_isolate(executor, chosen.workers) as isolated,
            progress(f"night of {chosen.name}") as bar,
        ):
            result = run_night(
                chosen,
                out,
                expected,
                publish,
                isolated=isolated,
                on_start=bar.start,
                on_result=bar.result,
            )
    except HistoryRefused as error:
        raise exit_with(COULD_NOT_RUN, str(error)) from None
    except KeyboardInterrupt as interrupt:
        raise exit_interrupted(
            interrupt, f"the finished runs are stored in {out}; the same command resumes the night"
        ) from None
    print(_night_folder(out, result))
    _print_and_exit(result)


def _night_folder(out: Path, result: Result) -> Path:
    """Return the folder of a night, whose name is a time; Windows does not allow colons in file names."""
    return out / result.name.replace(":", "")


@commands.command()
def check(
    campaign: CampaignFile = None,
    baseline: BaselineFile = None,
    engine: OneEngine = None,
    scenes: OtherScenes = [],
    history: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="History of nightly runs on this machine, used to judge times. Default: "
            "nightly/history.sqlite if it exists.",
        ),
    ] = None,
    control: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Checkout of the code before the change (git worktree add DIR main). Runs "
            "of both versions are timed in alternation; without it, times do not "
            "affect the verdict.",
        ),
    ] = None,
) -> None:
    """Run the fast part of a campaign, and print the results that have changed beyond noise (Markdown, worst first)."""
    from stiction.comparisons.regression.history import HistoryRefused
    from stiction.comparisons.regression.nightly import HISTORY, run_check
    from stiction.comparisons.regression.older_code import ControlRefused

    if history is None:
        default_history = Path("nightly") / HISTORY
        history = default_history if default_history.is_file() else None
    chosen = _load_campaign(campaign, engine, scenes)
    expected = _load_baseline(campaign, baseline)
    try:
        with progress(f"check of {chosen.name}") as bar:
            result = run_check(
                chosen,
                expected,
                history,
                control,
                on_start=bar.start,
                on_result=bar.result,
            )
    except (HistoryRefused, ControlRefused) as error:
        hint = "--history" if isinstance(error, HistoryRefused) else "--control"
        raise typer.BadParameter(str(error), param_hint=hint) from None
    _print_and_exit(result)


@baselines.command("update")
def baseline_update(
    reason: Annotated[
        str,
        typer.Option(
            metavar="TEXT", help="Reason why the numbers changed; it is stored in the baseline."
        ),
    ],
    campaign: CampaignFile = None,
    engine: OneEngine = None,
    scenes: OtherScenes = [],
    file: Annotated[
        Path | None,
        typer.Option(
            "--file",
            metavar="FILE",
            help="Baseline to update; it is created if it does not exist. Default: "
            "stiction's own baseline.",
        ),
    ] = None,
    night: Annotated[
        Path | None,
        typer.Option(
            "--night",
            metavar="HISTORY",
            help="Take the numbers of the last finished night of this history. Default: "
            "run the part of the campaign that `check` runs.",
        ),
    ] = None,
    whole: Annotated[
        bool,
        typer.Option(
            "--whole", help="Run the whole campaign instead of the part that `check` runs."
        ),
    ] = False,
) -> None:
    """Replace the numbers in the baseline by those of the current code.

    Truths of a higher tier than "our own run" are never replaced. To measure the effect of rounding, each run is
    repeated with five changes that make no difference in exact arithmetic. Numbers for which this effect exceeds the
    permitted change are recorded, but not judged by `check`.
    """
    from stiction.comparisons.bench.environment import origin
    from stiction.comparisons.regression import baseline as files
    from stiction.comparisons.regression.history import open_history
    from stiction.comparisons.regression.nightly import measured_rounding, run_check

    if whole and night is not None:
        raise typer.BadParameter(
            "found both; expected at most one of them", param_hint="--whole, --night"
        )
    if not reason.strip():
        raise typer.BadParameter(
            "found nothing; expected the reason why the numbers changed", param_hint="--reason"
        )
    path = file or files.DEFAULT
    check_written(path, option="--file")
    check_distinct("--file", path, night)
    chosen = _load_campaign(campaign, engine, scenes)
    old = files.Baseline(format=files.FORMAT)
    if file is None or file.exists():
        old = files.load_baseline(str(path))
    rows: Sequence[Row] = []
    rows_origin: Mapping[str, Any] = origin()
    if night is not None:
        with errors_of_option("--night"), open_history(night, write=False) as history:
            name = history.last_finished()
            if name:
                rows = history.rows(name)
                rows_origin = history.origin(name)
    else:
        with progress(f"baseline of {chosen.name}") as bar:
            result = run_check(chosen, old, whole=whole, on_start=bar.start, on_result=bar.result)
        rows = result.rows
        rows_origin = result.origin
    with progress(f"rounding of {chosen.name}") as bar:
        rows = measured_rounding(chosen, rows, bar.start, bar.result)
    # Runs of the campaign that --engine or --scenes leave out stay in the baseline. Runs that are no
    # longer part of the campaign are removed.
    whole_campaign = _load_campaign(campaign, None, [])
    keys = {run.key for run in (*chosen.runs, *whole_campaign.runs)}
    try:
        new = files.updated(old, rows, reason.strip(), rows_origin, keys)
    except files.BaselineRefused as error:
        raise exit_with(REGRESSED, f"{path}: {error}") from None
    files.write_baseline(new, path)
    print(f"{path}: {len(rows)} runs")


def _load_campaign(path: Path | None, engine: str | None, scenes: Sequence[str]) -> Campaign:
    """Load a campaign, restricted to an engine and to scenes if these are given."""
    from stiction.comparisons.bench.campaign import load_campaign
    from stiction.engines import EngineMissing

    campaign = load_campaign(path, split_names(scenes))
    if engine is None:
        return campaign
    try:
        return campaign.of_engine(engine)
    except EngineMissing as error:
        raise exit_with(COULD_NOT_RUN, str(error)) from None


def _load_baseline(campaign: Path | None, baseline: str | None) -> Baseline:
    """Load the baseline of a night or check.

    The baseline of the suite is the default for the campaign of the suite only; for other campaigns the
    default is empty.
    """
    from stiction.comparisons.bench.campaign import DEFAULT
    from stiction.comparisons.regression import baseline as files

    if baseline is None and campaign is not None and campaign.resolve() != DEFAULT.resolve():
        return files.Baseline(format=files.FORMAT)
    return files.load_baseline(baseline)


def _print_and_exit(result: Result) -> None:
    """Print what changed, and exit with the code of the verdict."""
    from stiction.reports.markdown.regression_report import check_report

    print(check_report(result), end="")
    raise typer.Exit(_exit_code(result.verdict))


def _exit_code(verdict: str) -> int:
    """Return the exit code of a verdict."""
    from stiction.comparisons.regression import check

    return {
        check.FINE: FINE,
        check.REGRESSION: REGRESSED,
        check.COULD_NOT_RUN: COULD_NOT_RUN,
        check.NOTHING: NOT_COMPARED,
    }[verdict]
