"""``compare``: a command for each study, on one scene or several; a row per method or run, failures among them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stiction.cli.exit_codes import FAILED, Commands, ended
from stiction.cli.options import (
    PICTURES,
    Assemble,
    EndTime,
    Engines,
    ExecutorName,
    Overrides,
    Quick,
    SceneNames,
    TableFile,
    Timeout,
    Workers,
    count,
    distinct,
    positive,
    scene_of,
    written,
)
from stiction.cli.render import or_shown, progress, show, show_truths, write_table

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
    """The studies as commands; they are loaded when one is looked up."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(_compared())

    def get_command(self, ctx: Any, name: str) -> Any:
        if name not in self.commands and (study := _compared().get(name)):
            group = typer.Typer()
            group.command(study.name, help=study.question)(_command(study))
            self.commands[name] = typer.main.get_command_from_info(
                group.registered_commands[0], pretty_exceptions_short=True, rich_markup_mode=None
            )
        return super().get_command(ctx, name)


commands = typer.Typer(cls=StudyCommands, no_args_is_help=True, help=HELP)


@commands.callback(help=HELP)
def _group() -> None:
    pass


def _compared() -> dict[str, Study]:
    from stiction.comparisons.studies import studies

    return {study.name: study for study in studies() if study.compared}


def _command(study: Study) -> Callable[..., None]:
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
        problems: Problems = None,
        parameter: Parameter = None,
        searched: SearchedRange = None,
        joint: Joint = None,
        resolution: Resolution = None,
    ) -> None:
        from stiction.comparisons.bench.depth import Depth
        from stiction.comparisons.bench.study import Scope

        given: dict[str, Any] = {
            "engines": tuple(engines) or None,
            "t_end": t_end,
            "repeats": repeats,
        }
        options = {
            name: value
            for name, value in {
                "drive": drive,
                "problems": problems,
                "parameter": parameter,
                "range": None if searched is None else _range(searched),
                "joint": joint,
                "resolution": resolution,
            }.items()
            if value is not None
        }
        for name, value in {**given, **options}.items():
            if value is not None and name not in study.takes:
                raise typer.BadParameter(
                    f"found {value!r}; `compare {study.name}` makes no use of it",
                    param_hint=f"--{name.replace('_', '-')}",
                )
        distinct("--plot", plot, out)
        distinct("--problems", problems, out)
        subject = _subject(study, scenes, overrides, assemble)
        scope = Scope(subject, Depth.QUICK if quick else Depth.FULL, **given, options=options)
        _show(study, _made(study, scope, workers, timeout, executor), out, plot, problems)

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


def _subject(
    study: Study, scenes: Sequence[str], overrides: Sequence[str], assemble: bool
) -> tuple[Scene, ...]:
    from stiction.reference_impl.multibody.initial_state import with_consistent_start
    from stiction.scenes.wording import names

    if study.takes_scene and study.needs_scene and not scenes:
        raise typer.BadParameter(
            "found nothing; expected a scene of the catalogue (see `stiction scenes`) or a TOML "
            "file",
            param_hint="SCENE",
        )
    if not study.takes_scene and (given := " ".join(scenes) or overrides or assemble):
        raise typer.BadParameter(
            f"found {given!r}; `compare {study.name}` has scenes of its own",
            param_hint="SCENE" if scenes else "--set, --assemble",
        )
    if len(scenes) > 1 and "scenes" not in study.takes:
        raise typer.BadParameter(
            f"found {' '.join(scenes)}; `compare {study.name}` takes one", param_hint="SCENE"
        )
    found = tuple(with_consistent_start(scene_of(name, overrides), assemble) for name in scenes)
    if twice := [
        name for name, count in Counter(scene.name for scene in found).items() if count > 1
    ]:
        raise typer.BadParameter(
            f"found {names(twice)} more than once; expected scenes of different names",
            param_hint="SCENE",
        )
    return found


def _made(
    study: Study, scope: Scope, workers: int | None, timeout: float, executor: str
) -> Results:
    from stiction.comparisons.bench.executors import open_isolate
    from stiction.comparisons.bench.runner import make
    from stiction.comparisons.bench.study import planned, union
    from stiction.engines import isolate

    about = ", ".join(scene.name for scene in scope.scenes) if scope.scenes else study.title
    with (
        open_isolate(executor, workers) as isolated,
        progress(f"compare {study.name} on {about}") as bar,
    ):
        options: dict[str, Any] = {"workers": workers, "timeout_s": timeout, "isolated": isolated}
        comparison = planned(scope, [study], **options)[study]
        return union(
            make(
                [comparison], timed_by=isolate, on_start=bar.start, on_result=bar.result, **options
            )
        )


def _show(
    study: Study, results: Results, out: Path | None, plot: Path | None, problems: Path | None
) -> None:
    """Print answer, findings and tables, write what was asked for, and fail where no run succeeded."""
    from stiction.comparisons.bench.complementarity.problems import write_problems
    from stiction.reports.run_folder.data import storable
    from stiction.reports.text import section_of

    table, said = results.table(study.name), section_of(study, results)
    if out is not None:  # an empty table, too: its file says which columns it would have
        with or_shown(lambda: _print(said, results, table)):
            write_table(storable(table), out)
    _print(said, results, table)
    if out is None and len(table):
        print("\nEvery row with its numbers and reasons: --out FILE.csv")
    if plot is not None and (said.figures or len(table)):
        from stiction.reports.figures.charts import drawn
        from stiction.reports.figures.style import rc
        from stiction.scenes.atomic_files import whole_file
        from stiction.scenes.pictures.picture import write_figure

        if not said.figures:
            raise ended(
                FAILED, f"{plot}: not written: `compare {study.name}` has no figure of these runs"
            )
        with rc(), whole_file(plot) as partial:
            [drawing] = drawn(said.figures[:1], results)
            write_figure(drawing.figure, partial)
    if problems is not None:
        write_problems(results.problems, problems)
    if table.empty:
        print(
            f"nothing to compare: the table of `compare {study.name}` is empty for this scene"
            + (f"; {plot} is not written" if plot is not None and not said.figures else "")
        )
    _check(_runs(results, table) if table.empty else table)


def _print(said: Section, results: Results, table: pd.DataFrame) -> None:
    from stiction.comparisons.bench.methods import succeeded
    from stiction.engines.status import Status

    for part in (said.answer, *said.findings):
        if part:
            print(part)
    for view in said.tables:
        if view.in_report:
            print(f"\n{view.caption}")
            show(view.heads(), view.cells())
    for note in said.notes:
        print(note)
    show_truths(table)
    runs = _runs(results, table)
    if {"status", "reason", "variant"} <= set(runs):
        absent, failed = (
            runs["status"] == Status.MISSING,
            runs[~succeeded(runs) & (runs["status"] != Status.MISSING)],
        )
        for reason, rows in runs[absent].groupby("reason", sort=False, dropna=False):
            print(f"not installed, {len(rows)} run{'s' * (len(rows) != 1)} not made: {reason}")
        made = runs["variant"].value_counts()
        for (method, status, reason), rows in failed.groupby(
            ["variant", "status", "reason"], sort=False, dropna=False
        ):
            print(
                f"method {method}, {len(rows)} of {made[method]} run{'s' if made[method] != 1 else ''} "
                f"{'ended early' if status == Status.OK else Status(status).label}: {reason}"
            )


def _runs(results: Results, table: pd.DataFrame) -> pd.DataFrame:
    """A row per run; of studies without such runs the rows of the table."""
    import pandas as pd

    return (
        pd.DataFrame([record.describe() for record in results.records])
        if results.records
        else table
    )


def _check(rows: pd.DataFrame) -> None:
    """Fail where no run succeeded, or no engine to compare with the reference is installed."""
    from stiction.engines.status import Status

    if "status" not in rows:
        return
    others = rows[rows["engine"] != "reference"] if "engine" in rows else rows[:0]
    if len(others) and (others["status"] == Status.MISSING).all():
        reasons = "; ".join(others["reason"].unique())
        raise ended(FAILED, f"no engine to compare with the reference is installed; {reasons}")
    if not (rows["status"] == Status.OK).any():
        raise ended(FAILED, f"all runs failed: {rows['reason'].iloc[0]}")
