"""``compare``: a command for each study, on one scene; tables with one row per method or run, failures among them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stiction.cli.exit_codes import FAILED, Commands, ended
from stiction.cli.options import (Assemble, EndTime, Engines, ExecutorName, Overrides, Quick, SceneName, TableFile, Timeout, Workers, apart,
                                  check_written, count, scene_of)
from stiction.cli.render import or_shown, progress, show, show_truths, write_table

if TYPE_CHECKING:
    import pandas as pd

    from stiction.comparisons.presentation.presentation import Presentation
    from stiction.comparisons.results import Results
    from stiction.comparisons.studies.study import Scope, Study
    from stiction.scenes import Scene

Repeats = Annotated[int | None, typer.Option(metavar="N", parser=count, help="Timed repeats of a run, at least; times are medians.")]
Plot = Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="Draw the study's first figure: .svg, .pdf or .png.")]
Drive = Annotated[str | None, typer.Option(metavar="NAME", help="The drive whose effort is compared; the scene's first if not given.")]
Problems = Annotated[Path | None, typer.Option(metavar="FILE", help="Write the complementarity problems that the reference met, for `stiction replay`: .parquet.")]


class StudyCommands(Commands):
    """The studies as commands; they are loaded when one is looked up."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [study.name for study in _compared()]

    def get_command(self, ctx: Any, name: str) -> Any:
        for study in _compared():
            if study.name == name and name not in self.commands:
                group = typer.Typer()
                group.command(study.name, help=study.question)(_command(study))
                self.commands[name] = typer.main.get_command_from_info(group.registered_commands[0], pretty_exceptions_short=True, rich_markup_mode=None)
        return super().get_command(ctx, name)


commands = typer.Typer(cls=StudyCommands, no_args_is_help=True, help="Answer one question on one scene: engines beside the reference.")


@commands.callback()
def _group() -> None:
    """Answer one question on one scene: engines beside the reference."""


def _compared() -> list[Study]:
    from stiction.comparisons.studies.study import studies

    return [study for study in studies() if study.compared]


def _command(study: Study) -> Callable[..., None]:
    def compare(scene: SceneName = "", engines: Engines = [], overrides: Overrides = [], t_end: EndTime = None, quick: Quick = False,
                repeats: Repeats = None, drive: Drive = None, workers: Workers = None, timeout: Timeout = 240, assemble: Assemble = False,
                executor: ExecutorName = "processes", out: TableFile = None, plot: Plot = None, problems: Problems = None) -> None:
        from stiction.comparisons.depth import Depth
        from stiction.comparisons.studies.study import Scope

        given = {"engines": tuple(engines) or None, "t_end": t_end, "repeats": repeats}
        options = {"drive": drive, "problems": problems}
        for name, value in {**given, **options}.items():
            if value is not None and name not in study.takes:
                raise typer.BadParameter(f"found {value!r}; `compare {study.name}` makes no use of it", param_hint=f"--{name.replace('_', '-')}")
        for option, path, endings in (("--plot", plot, (".svg", ".pdf", ".png")), ("--problems", problems, (".parquet",))):
            if path is not None:
                check_written(path, endings, option)
            apart(option, path, out)
        subject = _subject(study, scene, overrides, assemble)
        scope = Scope(subject, Depth.QUICK if quick else Depth.FULL, **given, options={name: value for name, value in options.items() if value is not None})
        results = _made(study, scope, workers, timeout, executor)
        _show(study, results, out, plot, problems)

    return compare


def _subject(study: Study, scene: str, overrides: Sequence[str], assemble: bool) -> tuple[Scene, ...]:
    from stiction.reference_impl.multibody.initial_state import with_consistent_start

    if study.takes_scene and not scene:
        raise typer.BadParameter("found nothing; expected a scene of the catalogue (see `stiction scenes`) or a TOML file", param_hint="SCENE")
    if not study.takes_scene and (overrides or assemble):
        raise typer.BadParameter(f"`compare {study.name}` has scenes of its own", param_hint="--set, --assemble")
    if not study.takes_scene and scene:
        raise typer.BadParameter(f"found {scene!r}; `compare {study.name}` has scenes of its own", param_hint="SCENE")
    return (with_consistent_start(scene_of(scene, overrides), assemble),) if scene else ()


def _made(study: Study, scope: Scope, workers: int | None, timeout: float, executor: str) -> Results:
    from stiction.comparisons.campaigns.comparison import make
    from stiction.comparisons.campaigns.validation import planned, union
    from stiction.comparisons.studies.executors import open_isolate
    from stiction.engines import isolate

    about = scope.scenes[0].name if scope.scenes else study.title
    with open_isolate(executor, workers) as isolated, progress(f"compare {study.name} on {about}") as (on_start, on_result):
        options = {"workers": workers, "timeout_s": timeout, "isolated": isolated}
        comparison = planned(scope, [study], **options)[study]
        return union(make([comparison], timed_by=isolate, on_start=on_start, on_result=on_result, **options))


def _show(study: Study, results: Results, out: Path | None, plot: Path | None, problems: Path | None) -> None:
    """Print answer, findings and tables, write what was asked for, and fail where no run succeeded."""
    from stiction.comparisons.complementarity.problems import write_problems
    from stiction.reports.run_folder.data import storable

    table, said = results.table(study.name), study.present(results)
    if out is not None and len(table):
        with or_shown(lambda: _print(said, results, table)):
            write_table(storable(table), out)
    _print(said, results, table)
    if plot is not None:
        _draw(study, results, plot)
    if problems is not None:
        write_problems(results.problems, problems)
    _check(study, table)


def _print(said: Presentation, results: Results, table: pd.DataFrame) -> None:
    for part in (said.answer, *said.findings):
        if part:
            print(part.text)
    for view in said.tables:
        if view.in_report:
            print(f"\n{view.caption}")
            show(view.heads(), view.cells())
    for note in said.notes:
        print(note)
    show_truths(table)
    _print_failed(results, table)


def _print_failed(results: Results, table: pd.DataFrame) -> None:
    """The runs that failed or ended early, a line for each method and reason; of studies without such runs the rows of the table."""
    import pandas as pd

    from stiction.comparisons.methods import succeeded

    runs = pd.DataFrame([record.describe() for record in results.records]) if results.records else table
    if not {"status", "reason", "variant"} <= set(runs):
        return
    failed = runs[~succeeded(runs)]
    for (method, status, reason), rows in failed.groupby(["variant", "status", "reason"], sort=False, dropna=False):
        print(f"{method}: {len(rows)} {'ended early' if status == 'ok' else status}: {reason}")


def _draw(study: Study, results: Results, path: Path) -> None:
    from stiction.reports.figures.charts import drawn
    from stiction.reports.figures.style import rc, write_figure
    from stiction.reports.presentations import presented

    figures = presented(study, results).figures
    if not figures:
        raise ended(FAILED, f"{path}: not written: `compare {study.name}` has no figure of these runs")
    with rc():
        [drawing] = drawn(figures[:1], results)
        write_figure(drawing, path)


def _check(study: Study, table: pd.DataFrame) -> None:
    """Fail where no run succeeded, or no engine to compare with the reference is installed."""
    if table.empty:
        print("nothing to compare: the truth has no such event")
        return
    if "status" not in table:
        return
    others = table["engine"] != "reference" if "engine" in table else table["status"] != table["status"]
    if others.any() and (table.loc[others, "status"] == "missing").all():
        raise ended(FAILED, "; ".join(["no engine to compare with the reference is installed", *table.loc[others, "reason"].unique()]))
    if not (table["status"] == "ok").any():
        raise ended(FAILED, f"all runs failed: {table['reason'].iloc[0]}")


def lost_hard(table: pd.DataFrame) -> list[str]:
    """Hard cases on which the reference is wrong or failed, in words."""
    if table.empty:
        return []
    rows = table[(table["variant"] == "reference") & table["verdict"].isin(["wrong", "failed"])]
    return [f"{row.case}: {row.verdict}: {row.about}" for row in rows.itertuples()]
