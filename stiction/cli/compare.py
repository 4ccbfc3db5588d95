"""The commands of ``compare``: one for each study, on one scene or several."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stiction.cli.exit_codes import FAILED, Commands, exit_with, say
from stiction.cli.options import (
    PICTURES,
    Assemble,
    Columns,
    EndTime,
    Engines,
    ExecutorName,
    Overrides,
    Quick,
    SceneNames,
    TableFile,
    Timeout,
    Width,
    Workers,
    check_distinct,
    count,
    errors_of_option,
    positive,
    scenes_of,
    split_names,
    width_in_mm,
    written,
)
from stiction.cli.render import progress, show, show_truths, shown_if_not_written, write_table

if TYPE_CHECKING:
    import pandas as pd

    from stiction.comparisons.bench.results import Results
    from stiction.comparisons.bench.study import Scope, Study
    from stiction.reports.text import Section
    from stiction.scenes import Scene

Repeats = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        parser=count,
        help="Minimum number of timed repetitions of a run; reported times are medians.",
    ),
]
Plot = Annotated[
    Path | None,
    typer.Option(
        "--plot",
        metavar="FILE",
        callback=written(*PICTURES),
        help="Draw the first figure of the study to this file (.svg, .pdf or .png).",
    ),
]
Drive = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Drive whose effort is compared. Default: the first drive of the scene.",
    ),
]
Report = Annotated[
    Path | None,
    typer.Option(
        "--report",
        metavar="DIR",
        help="Write a report with all tables, figures and data of the study to this folder, from "
        "which `stiction page` and `stiction paper` make a page and a paper.",
    ),
]
Problems = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        callback=written(".parquet"),
        help="Write the complementarity problems solved by the reference to this file "
        "(.parquet), for `stiction replay`.",
    ),
]
Parameter = Annotated[
    str | None,
    typer.Option(
        metavar="KEY",
        help="Parameter or value of the scene, named as in --set, whose stick bands are searched "
        "for. Default: F0.",
    ),
]
SearchedRange = Annotated[
    str | None,
    typer.Option(
        "--range",
        metavar="LOW:HIGH",
        help="Values of the parameter that are searched, with arithmetic. Default: from zero to "
        "four times the value in the scene.",
    ),
]
Joint = Annotated[
    str | None,
    typer.Option(
        metavar="GUIDE",
        help="Guide whose slider is examined. Default: the first guide with friction.",
    ),
]
Resolution = Annotated[
    float | None,
    typer.Option(
        metavar="STEP",
        parser=positive,
        help="Largest distance between two examined values of the parameter; narrower bands may "
        "be missed. Default: 1/120 of the range.",
    ),
]
HELP = "Compare the engines and the reference on a scene, with regard to one question."


class StudyCommands(Commands):
    """The group of the studies, whose commands are created when they are looked up.

    The import of the studies takes long, and the help of other commands does not need it.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the studies."""
        return list(_studies_by_name())

    def get_command(self, ctx: Any, name: str) -> Any:
        """Return the command of a study, or None if there is no such study."""
        study = _studies_by_name().get(name)
        if study is not None and name not in self.commands:
            group = typer.Typer()
            group.command(study.name, help=study.question)(_command(study))
            self.commands[name] = typer.main.get_command_from_info(
                group.registered_commands[0], pretty_exceptions_short=True, rich_markup_mode=None
            )
        return super().get_command(ctx, name)


commands = typer.Typer(cls=StudyCommands, no_args_is_help=True, help=HELP)


@commands.callback(help=HELP)
def _group() -> None:
    # The callback makes typer create a group, although its commands are not known yet.
    pass


def _studies_by_name() -> dict[str, Study]:
    """Return the studies that are commands, by name."""
    from stiction.comparisons.studies import studies

    return {study.name: study for study in studies() if study.compared}


def _command(study: Study) -> Callable[..., None]:
    """Return the function of the command of a study; typer reads the options from its signature."""

    def compare(
        scenes: SceneNames = [],
        engines: Engines = [],
        overrides: Overrides = [],
        t_end: EndTime = None,
        quick: Quick = False,
        repeats: Repeats = None,
        drive: Drive = None,
        workers: Workers = None,
        timeout: Timeout = 240,
        assemble: Assemble = False,
        executor: ExecutorName = "processes",
        out: TableFile = None,
        plot: Plot = None,
        columns: Columns = [],
        width: Width = "double",
        report: Report = None,
        problems: Problems = None,
        parameter: Parameter = None,
        searched: SearchedRange = None,
        joint: Joint = None,
        resolution: Resolution = None,
    ) -> None:
        from stiction.comparisons.bench.depth import Depth
        from stiction.comparisons.bench.study import Scope

        arguments: dict[str, Any] = {
            "engines": tuple(engines) or None,
            "t_end": t_end,
            "repeats": repeats,
        }
        options: dict[str, Any] = {}
        optional_values = {
            "drive": drive,
            "columns": tuple(split_names(columns)) if columns else None,
            "problems": problems,
            "parameter": parameter,
            "range": None if searched is None else _range(searched),
            "joint": joint,
            "resolution": resolution,
        }
        for name, value in optional_values.items():
            if value is not None:
                options[name] = value
        # All studies have the same options; those that a study does not use are refused.
        for name, value in {**arguments, **options}.items():
            if value is not None and name not in study.takes:
                raise typer.BadParameter(
                    f"`compare {study.name}` does not have this option",
                    param_hint=f"--{name.replace('_', '-')}",
                )
        width_in_mm(width)
        check_distinct("--plot", plot, out)
        check_distinct("--problems", problems, out)
        loaded = _load_scenes(study, scenes, overrides, assemble)
        depth = Depth.QUICK if quick else Depth.FULL
        scope = Scope(loaded, depth, **arguments, options=options)
        if report is not None:
            _check_report(study, report)
        results = _run_study(study, scope, workers, timeout, executor)
        _show(study, results, out, plot, problems, width)
        if report is not None:
            _write_report(results, loaded, report)

    return compare


def _range(text: str) -> tuple[float, float]:
    """Return the ends of ``LOW:HIGH``, each a number or arithmetic."""
    from stiction.scenes import InputError
    from stiction.scenes.expressions import evaluate

    parts = text.split(":")
    if len(parts) != 2:
        raise typer.BadParameter(
            f"found {text!r}; expected LOW:HIGH, such as 0:12", param_hint="--range"
        )
    try:
        low, high = (evaluate(part.strip(), {}) for part in parts)
    except InputError as error:
        raise typer.BadParameter(f"found {text!r}; {error}", param_hint="--range") from None
    return low, high


def _load_scenes(
    study: Study, scenes: Sequence[str], overrides: Sequence[str], assemble: bool
) -> tuple[Scene, ...]:
    """Load the scenes of a study with overrides, and check that the study takes them."""
    if study.takes_scene and study.needs_scene and not scenes:
        raise typer.BadParameter(
            "found nothing; expected a scene of the catalogue (see `stiction scenes`) or a TOML "
            "file",
            param_hint="SCENE",
        )
    superfluous = " ".join(scenes) or overrides or assemble
    if superfluous and not study.takes_scene:
        raise typer.BadParameter(
            f"found {superfluous!r}; expected nothing: `compare {study.name}` uses fixed scenes",
            param_hint="SCENE" if scenes else "--set, --assemble",
        )
    if len(scenes) > 1 and "scenes" not in study.takes:
        raise typer.BadParameter(
            f"found {' '.join(scenes)}; `compare {study.name}` accepts one scene",
            param_hint="SCENE",
        )
    return scenes_of(scenes, overrides, assemble)


def _run_study(
    study: Study, scope: Scope, workers: int | None, timeout: float, executor: str
) -> Results:
    """Plan and make the runs of a study, with a progress bar."""
    from stiction.comparisons.bench.executors import open_isolate
    from stiction.comparisons.bench.runner import make
    from stiction.comparisons.bench.study import planned, union
    from stiction.engines import isolate

    subject = study.title
    if scope.scenes:
        subject = ", ".join(scene.name for scene in scope.scenes)
    with (
        open_isolate(executor, workers) as isolated,
        progress(f"compare {study.name} on {subject}") as bar,
    ):
        options: dict[str, Any] = {"workers": workers, "timeout_s": timeout, "isolated": isolated}
        comparison = planned({study: scope}, **options)[study]
        results = make(
            [comparison], timed_by=isolate, on_start=bar.start, on_result=bar.result, **options
        )
        return union(results, scenes=scope.scenes)


def _show(
    study: Study,
    results: Results,
    out: Path | None,
    plot: Path | None,
    problems: Path | None,
    width: str,
) -> None:
    """Print the results of a study, write the files that were asked for, and fail if no run succeeded."""
    from stiction.comparisons.bench.complementarity.problems import write_problems
    from stiction.reports.run_folder.data import to_storable
    from stiction.reports.text import section_of

    table = results.table(study.name)
    # A scene may have runs of another kind, in a table of their own: those of joints in `hold`.
    for name in study.tables:
        if table.empty:
            table = results.table(name)
    section = section_of(study, results)
    if out is not None:
        # An empty table is written, too; the file then shows which columns it would have.
        with shown_if_not_written(lambda: _print(section, results, table)):
            write_table(to_storable(_stored_table(study, results, table)), out)
    _print(section, results, table)
    if out is None and len(table):
        print("\nEvery row with its numbers and reasons: --out FILE.csv")
    if plot is not None and section.figures:
        _write_first_figure(study, section, results, plot, width)
    elif plot is not None and not table.empty:
        say(f"{plot} is not written: `compare {study.name}` has no figure for these runs")
    if problems is not None:
        write_problems(results.problems, problems)
    if not table.empty:
        _check_success(_stored_table(study, results, table))
        return
    message = f"nothing to compare: the table of `compare {study.name}` is empty for this scene"
    if plot is not None and not section.figures:
        message += f"; {plot} is not written"
    print(message)
    _check_success(_run_rows(results, table))


def _stored_table(study: Study, results: Results, main: pd.DataFrame) -> pd.DataFrame:
    """Return the table that ``--out`` writes: the main one, or several with their names in a column."""
    import pandas as pd

    if not study.stored:
        return main
    parts = []
    for name in study.stored:
        table = results.table(name)
        parts.append(table.assign(table=name)[["table", *table]])
    return pd.concat([part for part in parts if len(part)] or parts, ignore_index=True)


def _check_report(study: Study, folder: Path) -> None:
    """Check that a study can have a report and its folder can be written, before the runs are made."""
    from stiction.reports import REPORT, check_folder
    from stiction.reports.run_folder.stored_run import TABLES_OF_RUNS

    if study.name in TABLES_OF_RUNS:
        raise typer.BadParameter(
            f"found {str(folder)!r}; `compare {study.name}` has no report: --out writes its table, "
            "and --plot its figure",
            param_hint="--report",
        )
    with errors_of_option("--report"):
        check_folder(folder, REPORT)


def _write_report(results: Results, scenes: Sequence[Scene], folder: Path) -> None:
    """Write the report of a study, and print the name of its file."""
    from stiction.comparisons.bench.participants import validation_campaign
    from stiction.comparisons.bench.results import COMMAND, SCENES_OF_PAPER
    from stiction.reports import report_of, write_report

    papers_cases = validation_campaign().scenes
    settings = {
        "scenes": [scene.name for scene in scenes],
        SCENES_OF_PAPER: [scene.name for scene in scenes if scene in papers_cases],
        COMMAND: shlex.join(["stiction", *sys.argv[1:]]),
    }
    print(write_report(report_of(replace(results, settings=settings)), folder))


def _write_first_figure(
    study: Study, section: Section, results: Results, file: Path, width: str
) -> None:
    """Write the first figure of a section; one column wide, it must fit on a page."""
    from stiction.reports.figures.charts import draw_figures, in_one_column
    from stiction.reports.figures.style import rc
    from stiction.scenes.atomic_files import whole_file
    from stiction.scenes.pictures.picture import write_figure

    figures = section.figures[:1]
    if width == "single":
        figures = in_one_column(figures[0])
    if len(figures) > 1:
        raise exit_with(
            FAILED,
            f"{file}: not written: one column wide, the figure needs {len(figures)} pages; expected "
            "--width double, or fewer columns, scenes or engines",
        )
    with rc(width), whole_file(file) as partial:
        [drawing] = draw_figures(figures, results)
        write_figure(drawing.figure, partial)


def _print(section: Section, results: Results, table: pd.DataFrame) -> None:
    """Print answer, findings, tables, notes and truths of a study, and the runs that failed."""
    for text in (section.answer, *section.findings):
        if text:
            print(text)
    for view in section.tables:
        if view.in_report:
            print(f"\n{view.caption}")
            show(view.heads(), view.cells())
    for note in section.notes:
        print(note)
    show_truths(table)
    _print_failures(_run_rows(results, table))


def _print_failures(runs: pd.DataFrame) -> None:
    """Print a line for each reason of runs that were not made, failed or ended early."""
    from stiction.comparisons.bench.methods import succeeded
    from stiction.engines.status import Status

    if not {"status", "reason", "variant"} <= set(runs):
        return
    is_missing = runs["status"] == Status.MISSING
    for reason, rows in runs[is_missing].groupby("reason", sort=False, dropna=False):
        # The engine is not installed, or it is installed and cannot be started.
        print(f"engine not available, {_count_runs(len(rows))} not made: {reason}")
    runs_of_methods = runs["variant"].value_counts()
    failed = runs[~succeeded(runs) & ~is_missing]
    for (method, status, reason), rows in failed.groupby(
        ["variant", "status", "reason"], sort=False, dropna=False
    ):
        outcome = "ended early" if status == Status.OK else Status(status).label
        print(
            f"method {method}, {len(rows)} of {_count_runs(runs_of_methods[method])} {outcome}: {reason}"
        )


def _count_runs(number: int) -> str:
    """Return a number of runs as text, such as ``1 run`` or ``2 runs``."""
    return "1 run" if number == 1 else f"{number} runs"


def _run_rows(results: Results, table: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each run, or the rows of the table for a study whose runs are not recorded."""
    import pandas as pd

    if not results.records:
        return table
    return pd.DataFrame([record.describe() for record in results.records])


def _check_success(rows: pd.DataFrame) -> None:
    """Fail if no run succeeded, or if no engine to compare with the reference is available."""
    from stiction.engines.status import Status

    if "status" not in rows:
        return
    if "engine" in rows:
        others = rows[rows["engine"].notna() & (rows["engine"] != "reference")]
        if len(others) and (others["status"] == Status.MISSING).all():
            reasons = "; ".join(others["reason"].unique())
            raise exit_with(
                FAILED, f"no engine to compare with the reference is available; {reasons}"
            )
    if not (rows["status"] == Status.OK).any():
        raise exit_with(FAILED, f"all runs failed: {rows['reason'].iloc[0]}")
