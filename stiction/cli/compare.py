"""``compare``: engines on one scene, a table with one row per run, failures among them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from stiction.cli.exit_codes import FAILED, Commands, ended
from stiction.cli.options import (Assemble, EndTime, Engines, EnginesOrNone, ExecutorName, Overrides, Quick, Repeats, SceneName, TableFile, Timeout, Workers, apart,
                                  check_written, scene_of)
from stiction.cli.render import progress, show_comparison, show_table, show_truths, write_table

if TYPE_CHECKING:
    import pandas as pd

    from stiction.comparisons.campaigns.comparison import Comparison
    from stiction.comparisons.depth import Depth
    from stiction.scenes import Scene

T = TypeVar("T")

commands = typer.Typer(cls=Commands, no_args_is_help=True, help="Compare engines on one scene; a table with one row per run, failures among them.")


@commands.command()
def drift(scene: SceneName, engines: Engines = [], overrides: Overrides = [], t_end: EndTime = None, quick: Quick = False,
          workers: Workers = None, timeout: Timeout = 240, assemble: Assemble = False, out: TableFile = None) -> None:
    """Residuals of the constraints over time, with and without stabilization, over step sizes."""
    from stiction.comparisons.campaigns.participants import variants
    from stiction.comparisons.campaigns.single_scene import drift_comparison
    from stiction.comparisons.variants import scaled

    subject = _subject(scene, overrides, assemble)
    _show(_make(subject, drift_comparison(subject, scaled(variants(engines or None, _depth(quick)), subject, t_end), t_end), workers, timeout), out)


@commands.command()
def threshold(scene: SceneName, engines: Engines = [], overrides: Overrides = [], quick: Quick = False, workers: Workers = None,
              timeout: Timeout = 240, assemble: Assemble = False, out: TableFile = None) -> None:
    """Largest amplitude F0 with a stick phase in the steady state (slider-bar scenes)."""
    from stiction.comparisons.campaigns.participants import extent, threshold_variants
    from stiction.comparisons.studies.stick_threshold import threshold_comparison, true_thresholds

    subject, depth = _subject(scene, overrides, assemble), _depth(quick)
    true = _make(subject, true_thresholds(subject), workers, timeout)
    _show(_make(subject, threshold_comparison(subject, threshold_variants(engines or None, depth), extent(depth).bracket, true), workers, timeout), out)


@commands.command()
def torque(scene: SceneName, engines: Engines = [], overrides: Overrides = [], t_end: EndTime = None, quick: Quick = False,
           drive: Annotated[str | None, typer.Option(metavar="NAME", help="The scene's first drive if not given.")] = None,
           workers: Workers = None, timeout: Timeout = 240, assemble: Assemble = False, out: TableFile = None) -> None:
    """Jumps of a drive's effort at the events of the truth; printed: the largest errors, in FILE: every jump."""
    from stiction.comparisons.campaigns.participants import variants
    from stiction.comparisons.campaigns.single_scene import torque_comparison
    from stiction.comparisons.variants import scaled
    from stiction.comparisons.presentation.cells import worst_per_run

    subject = _subject(scene, overrides, assemble)
    comparison = torque_comparison(subject, scaled(variants(engines or None, _depth(quick)), subject, t_end), t_end, drive)
    _show(_make(subject, comparison, workers, timeout), out, worst_per_run, len(comparison.tasks))


@commands.command()
def cost(scene: SceneName, engines: Engines = [], overrides: Overrides = [], t_end: EndTime = None, quick: Quick = False,
         repeats: Repeats = 5, timeout: Timeout = 240, assemble: Assemble = False, out: TableFile = None) -> None:
    """Error against CPU time along a ladder of steps or tolerances; what a given error costs whom. One run at a time."""
    from stiction.comparisons.campaigns.participants import cost_variants, extent
    from stiction.comparisons.studies.equal_error import equal_error
    from stiction.comparisons.studies.work_precision import work_precision
    from stiction.comparisons.variants import scaled
    from stiction.reports.markdown.cost_page import IN_BRIEF, picked, times_table

    subject, depth = _subject(scene, overrides, assemble), _depth(quick)
    ladders = scaled(cost_variants(engines or None, depth), subject, t_end)
    found = _make(subject, work_precision(subject, ladders, t_end=t_end, repeats=repeats, budget_s=extent(depth).ladder), None, timeout)
    show_table(times_table(equal_error(found.table, found.samples)).drop(columns="scene"))
    print(IN_BRIEF)
    _show(found.table, out, lambda rows: picked(rows, "cost"))


@commands.command()
def effects(scene: SceneName, engines: EnginesOrNone = [], overrides: Overrides = [], t_end: EndTime = None, repeats: Repeats = 5,
            timeout: Timeout = 240, assemble: Assemble = False, out: TableFile = None) -> None:
    """The scene without each effect that it declares: what changes in motion, events, effort, and in time. One run at a time."""
    from stiction.comparisons.studies.effects import effects_comparison, effects_variants
    from stiction.reports.markdown.cost_page import picked

    subject = _subject(scene, overrides, assemble)
    comparison = effects_comparison(subject, effects_variants(engines), t_end=t_end, repeats=repeats)
    _show(_make(subject, comparison, None, timeout).table, out, lambda rows: picked(rows, "effects"))


@commands.command()
def suppression(scene: SceneName, overrides: Overrides = [], t_end: EndTime = None, repeats: Repeats = 5, timeout: Timeout = 240,
                assemble: Assemble = False, out: TableFile = None) -> None:
    """Both ways of the reference without drift suppression, with Baumgarte's, with projection: cost, drift, error."""
    from stiction.comparisons.studies.drift_suppression import suppression_comparison
    from stiction.reports.markdown.cost_page import picked

    subject = _subject(scene, overrides, assemble)
    comparison = suppression_comparison(subject, t_end=t_end, repeats=repeats)
    _show(_make(subject, comparison, None, timeout).table, out, lambda rows: picked(rows, "suppression"))


@commands.command("settings")
def engine_settings(scene: SceneName, engines: Engines = [], overrides: Overrides = [], t_end: EndTime = None, repeats: Repeats = 3,
                    timeout: Timeout = 240, assemble: Assemble = False, executor: ExecutorName = "processes", out: TableFile = None,
                    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="Draw it: .svg, .pdf or .png.")] = None) -> None:
    """The settings of each engine, one changed at a time: error against its own time, and how far the defaults are from the best. One run at a time."""
    from stiction.comparisons.studies.engine_settings import ON_FRONT, distance_of_defaults, settings_comparison
    from stiction.reports.figures.engine_settings import settings_figure
    from stiction.reports.figures.style import rc, write_figure
    from stiction.reports.markdown.cost_page import picked

    if plot is not None:
        check_written(plot, (".svg", ".pdf", ".png"), "--plot")
    apart("--plot", plot, out)
    subject = _subject(scene, overrides, assemble)
    rows = _make(subject, settings_comparison(subject, engines, t_end=t_end, repeats=repeats), None, timeout, executor)
    show_table(distance_of_defaults(rows))
    _show(rows, out, lambda rows: picked(rows[rows[ON_FRONT] | (rows["status"] != "ok")], "cost"))
    with rc():
        if plot is not None and (drawing := settings_figure(rows)) is not None:
            write_figure(drawing, plot)


@commands.command()
def hard(engines: Engines = [], quick: Quick = False, workers: Workers = None, timeout: Timeout = 60, executor: ExecutorName = "processes",
         out: TableFile = None,
         problems: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the complementarity problems that the reference met, for "
                                                       "`stiction replay`: .parquet.")] = None) -> None:
    """The catalogue of hard cases through the reference and the engines: right, degraded, declined (by the method or by its adapter), impulsive, not expressible, wrong or failed, and why."""
    from stiction.comparisons.complementarity.problems import write_problems
    from stiction.comparisons.hard import hard_comparison, hard_matrix
    from stiction.comparisons.hard.examination import NOT_INSTALLED
    from stiction.comparisons.studies.executors import open_isolate
    from stiction.reports.markdown.hard_page import not_right
    from stiction.reports.run_folder.data import storable

    if problems is not None:
        check_written(problems, (".parquet",), "--problems")
    apart("--problems", problems, out)
    with open_isolate(executor, workers) as isolated, progress("hard cases") as (on_start, on_result):
        found = hard_comparison(depth=_depth(quick), engines=engines or None).make(workers=workers, timeout_s=timeout, isolated=isolated, on_start=on_start, on_result=on_result)
    show_table(hard_matrix(found.table))
    show_table(not_right(found.table))
    if out is not None:
        write_table(storable(found.table), out)
    if problems is not None:
        write_problems(found.problems, problems)
    _check_installed(found.table, found.table["verdict"] == NOT_INSTALLED, "about")
    if lost := lost_hard(found.table):
        raise ended(FAILED, f"{len(lost)} cases are lost to the reference: {lost[0]}")


def lost_hard(table: pd.DataFrame) -> list[str]:
    """Hard cases on which the reference is wrong or failed, in words."""
    rows = table[(table["variant"] == "reference") & table["verdict"].isin(["wrong", "failed"])]
    return [f"{row.case}: {row.verdict}: {row.about}" for row in rows.itertuples()]


def _depth(quick: bool) -> Depth:
    from stiction.comparisons.depth import Depth

    return Depth.QUICK if quick else Depth.FULL


def _subject(scene: str, overrides: Sequence[str], assemble: bool) -> Scene:
    from stiction.reference_impl.multibody.initial_state import with_consistent_start

    return with_consistent_start(scene_of(scene, overrides), assemble)


def _make(scene: Scene, comparison: Comparison[T], workers: int | None, timeout: float, executor: str = "processes") -> T:
    from stiction.comparisons.studies.executors import open_isolate
    from stiction.engines import isolate

    with open_isolate(executor, workers) as isolated, progress(f"compare on {scene.name}") as (on_start, on_result):
        return comparison.make(workers=workers, timeout_s=timeout, isolated=isolated, timed_by=isolate, on_start=on_start, on_result=on_result)


def _show(rows: pd.DataFrame, out: Path | None, shown: Callable[[pd.DataFrame], pd.DataFrame] = lambda rows: rows, runs: int = 0) -> None:
    """Show a table, or the part of it that is `shown`, and write all of it. Of so many `runs` those that came out may have no row, for want of events."""
    from stiction.reports.run_folder.data import storable

    if len(rows):
        show_comparison(shown(rows))
        show_truths(rows)
        if out is not None:
            write_table(storable(rows), out)
        _check_installed(rows, rows["status"] == "missing", "reason")
    if rows.empty or not (rows["status"] == "ok").any():
        if len(rows) and len(rows) >= runs:
            raise ended(FAILED, "no run came out")
        print("nothing to compare: the truth has no such event")


def _check_installed(rows: pd.DataFrame, missing: pd.Series, reason: str) -> None:
    """Fail where engines were to be compared with the reference and none of them is installed."""
    others = rows["engine"] != "reference"
    if others.any() and missing[others].all():
        raise ended(FAILED, "; ".join(["no engine to compare with the reference is installed", *rows.loc[others, reason].unique()]))
