"""Commands that run a scene, a sweep over its parameters, or a solver on problems: ``run``, ``sweep``, ``replay``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stiction.cli.exit_codes import FAILED, exit_interrupted, exit_with, say
from stiction.cli.options import (
    Assemble,
    Columns,
    EndTime,
    EngineName,
    ExecutorName,
    Fidelity,
    Overrides,
    SceneName,
    Settings,
    TableFile,
    Timeout,
    Width,
    Workers,
    check_distinct,
    errors_of_option,
    positive,
    scene_of,
    settings_of,
    split_names,
    width_in_mm,
)
from stiction.cli.pictures import Animation, Plot, write_pictures
from stiction.cli.prove import verified_set
from stiction.cli.render import (
    EVENTS_SHOWN,
    progress,
    show,
    show_table,
    show_trajectory,
    shown_if_not_written,
    write_table,
)

if TYPE_CHECKING:
    import pandas as pd

    from stiction.comparisons.bench.quantities import Quantity
    from stiction.comparisons.sweep.sweep import Sweep
    from stiction.scenes import InputError, Scene, Trajectory

commands = typer.Typer()
RUN_TIMEOUT_S = 600.0
"""Time limit of the run whose problems `replay` uses, s."""
REASONS_SHOWN = EVENTS_SHOWN
"""Largest number of reasons of failed points that `sweep` prints."""


@commands.command()
def run(
    scene: SceneName,
    engine: EngineName = "reference",
    fidelity: Fidelity = "joint",
    t_end: EndTime = None,
    dt: Annotated[
        float | None,
        typer.Option(metavar="H", parser=positive, help="Step of a fixed-step method, s."),
    ] = None,
    rtol: Annotated[
        float | None,
        typer.Option(
            metavar="R", parser=positive, help="Relative tolerance of an adaptive method."
        ),
    ] = None,
    output_step: Annotated[
        float,
        typer.Option(metavar="S", parser=positive, help="Interval between output times, s."),
    ] = 0.01,
    overrides: Overrides = [],
    settings: Settings = [],
    assemble: Assemble = False,
    from_run: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="FILE",
            help="Start in the last state of the run in FILE, which --out wrote; the laws of time go on from there.",
        ),
    ] = None,
    out: TableFile = None,
    events: Annotated[
        bool,
        typer.Option(
            "--events", help="Add two rows per event to FILE, with the values before and after it."
        ),
    ] = False,
    plot: Plot = None,
    columns: Columns = [],
    width: Width = "double",
    animation: Animation = None,
    timeout: Timeout = 600,
    traceback: Annotated[
        bool,
        typer.Option(
            "--traceback",
            help="If the run fails, print the end of the engine's output, including its "
            "traceback. The traceback of a bug is always printed.",
        ),
    ] = False,
) -> None:
    """Simulate a scene in a child process; without --out, print final state, efforts, events and cost."""
    from stiction.engines.command_run import run_as_asked
    from stiction.scenes.continuation import continued

    loaded = scene_of(scene, overrides)
    if from_run is not None:
        with errors_of_option("--from"):
            loaded = continued(loaded, from_run)
    engine_settings = settings_of(settings)
    check_distinct("--plot", plot, out)
    check_distinct("--animate", animation, plot)
    shown = _checked_columns(loaded, columns, plot)
    width_mm = width_in_mm(width)
    if dt is not None and rtol is not None:
        raise typer.BadParameter(
            f"found both, {dt:g} and {rtol:g}; expected one: a fixed step or a tolerance",
            param_hint="--dt, --rtol",
        )
    arguments = {
        "t_end": t_end,
        "dt": dt,
        "rtol": rtol,
        "output_step": output_step,
        "fidelity": fidelity,
    }
    repeated = engine_settings.keys() & arguments.keys()
    if repeated:
        raise typer.BadParameter(
            f"found {', '.join(repeated)}, which is no setting; expected an option such as --dt",
            param_hint="--setting",
        )
    title = f"{engine} on {loaded.name}"
    trajectory: Trajectory = _run_in_child(
        title,
        run_as_asked,
        (engine, loaded, assemble, arguments | engine_settings),
        timeout,
        traceback,
    )
    if out is None:
        show_trajectory(trajectory)
    else:
        with shown_if_not_written(lambda: show_trajectory(trajectory)):
            write_table(trajectory.to_frame(events), out)
        print(out)
    write_pictures(trajectory, plot, animation, shown, width_mm)
    if trajectory.termination != "end":
        time = ""
        # The message of a breakdown contains the time.
        if not trajectory.breakdown and len(trajectory.t):
            time = f" at t = {trajectory.t[-1]:g} s"
        raise exit_with(FAILED, f"{title}: stopped{time}: {trajectory.termination}")


def _checked_columns(scene: Scene, texts: Sequence[str], plot: Path | None) -> list[str]:
    """Return the columns of the option ``--columns``, and check that the scene has them."""
    from stiction.scenes.columns import columns_of
    from stiction.scenes.wording import did_you_mean

    names = split_names(texts)
    if names and plot is None:
        raise typer.BadParameter(
            "found this option without --plot; expected --plot with the file of the figure",
            param_hint="--columns",
        )
    known = columns_of(scene)
    for name in names:
        if name not in known:
            raise typer.BadParameter(
                f"found {name!r}; expected columns of the scene such as "
                f"{', '.join(known[-3:])}{did_you_mean(name, known)}",
                param_hint="--columns",
            )
    return names


def _run_in_child(
    title: str,
    function: Callable[..., Any],
    arguments: tuple[Any, ...],
    timeout: float,
    traceback: bool = False,
) -> Any:
    """Return the result of a function that is called in a child process, with a progress bar.

    Parameters
    ----------
    title : str
        Text before the progress and in messages.
    function, arguments
        The function, which must be importable, and its arguments.
    timeout : float
        Time limit, s.
    traceback : bool
        Whether to print the output of the child process if it fails.

    Raises
    ------
    InputError
        If the function returns this error.
    typer.Exit
        If the function fails in any other way; the reason is printed.
    """
    from stiction.engines import Task, isolate
    from stiction.engines.status import Status
    from stiction.scenes import InputError

    with progress(title) as bar:
        [outcome] = isolate(
            [Task("run", function, arguments)],
            workers=1,
            timeout_s=timeout,
            on_result=bar.result,
            on_note=say,
        )
    if isinstance(outcome.value, InputError):
        raise outcome.value
    if outcome.status != Status.OK:
        # The traceback of a bug is printed by `progress`.
        if traceback and outcome.log and not outcome.bug:
            print(outcome.log, file=sys.stderr)
        raise exit_with(FAILED, f"{title}: {outcome.status.label}: {outcome.reason}")
    return outcome.value


@commands.command()
def sweep(
    scene: SceneName,
    vary: Annotated[
        list[str],
        typer.Option(
            "--vary",
            metavar="KEY=FROM:TO:COUNT|KEY=A,B,..",
            help="Axis of the grid, for example F0=0.5:6:100 or guide.mu=0.01,0.03. "
            "Repeatable; one axis is drawn as a curve, two as a map.",
        ),
    ],
    measure: Annotated[
        list[str],
        typer.Option(
            "--measure",
            metavar="A,B,..",
            help="stick-fraction, peak-torque, peak-speed, event-count, break-away or threshold; "
            "peak-speed:NAME refers "
            "to the guide, drive or body NAME. threshold is the upper end of the band of F0 with "
            "stick phases that is nearest to the scene's F0; the table contains all bands. "
            "threshold:KEY does the same for another number of the scene.",
        ),
    ],
    engine: EngineName = "reference",
    fidelity: Fidelity = "joint",
    workers: Workers = None,
    executor: ExecutorName = "processes",
    timeout: Timeout = 240,
    t_end: Annotated[
        float | None,
        typer.Option(
            "--t-end",
            metavar="S",
            parser=positive,
            help="End of every run, s. Default: twice that of the scene, or 30 periods of "
            "its loads and drives if that is longer.",
        ),
    ] = None,
    settle: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            parser=positive,
            help="Length of the transient at the start, which is not evaluated, s. "
            "Default: a third of the run.",
        ),
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option(
            metavar="H",
            parser=positive,
            help="Largest step of a fixed-step method, s. Default for fixed-step engines: "
            "1 ms, less for fast scenes.",
        ),
    ] = None,
    rtol: Annotated[
        float,
        typer.Option(
            metavar="R",
            parser=positive,
            help="Relative tolerance R of an adaptive method. A motion counts as steady if "
            "it is periodic to within 1000 R.",
        ),
    ] = 1e-6,
    overrides: Overrides = [],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder of the results. Default: sweeps/<scene>-<digest>. If it contains "
            "points of the same sweep, the command resumes it.",
        ),
    ] = None,
) -> None:
    """Measure the steady state on a grid of parameter values.

    Initial states are projected onto the constraints. A motion that neither comes to rest nor becomes periodic has no
    steady state, and its point has no value.
    """
    from stiction.comparisons.bench.executors import check_executor, open_isolate
    from stiction.comparisons.measures.steady_state_measures import SteadyRun
    from stiction.comparisons.sweep import sweep as sweeps
    from stiction.comparisons.sweep.axes import parse_axis
    from stiction.scenes.fidelity import fidelity_of

    loaded = scene_of(scene, overrides)
    end = t_end or sweeps.usual_end(loaded)
    # By default the first third of a run is not evaluated.
    transient = settle or end / 3
    steady = SteadyRun(transient, end, rtol, engine, fidelity_of(fidelity), dt)
    axes = tuple(parse_axis(text) for text in vary)
    specification = sweeps.Specification(loaded, axes, tuple(split_names(measure)), steady, timeout)
    folder = out or Path("sweeps") / f"{loaded.name}-{specification.digest[:8]}"
    check_executor(executor)
    with errors_of_option("--out"):
        sweeps.check_folder(specification, folder)
    try:
        with open_isolate(executor, workers) as made_by, progress(f"sweep of {loaded.name}") as bar:
            result = sweeps.sweep(
                specification,
                folder,
                workers=workers,
                made_by=made_by,
                on_start=bar.start,
                on_result=bar.result,
            )
    except KeyboardInterrupt as interrupt:
        raise exit_interrupted(
            interrupt,
            f"the finished runs are stored; the same command resumes the sweep in {folder}",
        ) from None
    _show_sweep(result, folder)


def _show_sweep(result: Sweep, folder: Path) -> None:
    """Draw the figures of a sweep, print ranges of its tables and its failures, and fail if no point has an answer."""
    from stiction.engines.status import ANSWERS
    from stiction.reports.figures.style import rc, save
    from stiction.reports.figures.sweep_figures import sweep_drawings

    with rc():
        for drawing in sweep_drawings(result):
            save(drawing, folder, kinds=("png", "pdf"))
    print(folder)
    _show_ranges(result)
    tables = {"map": result.map, "threshold": result.threshold}
    answered_points = 0
    for name, table in tables.items():
        if table is not None:
            _show_failed_points(name, table)
            answered_points += table["status"].isin(ANSWERS).sum()
    if result.threshold is not None:
        _show_bands(result.threshold, result.specification.varied_unit)
    if not answered_points:
        raise exit_with(FAILED, "all points failed")


def _show_ranges(result: Sweep) -> None:
    """Print the smallest and the largest value of each measure of a sweep and of its threshold."""
    from stiction.comparisons.bench.quantities import quantity_of
    from stiction.comparisons.studies.threshold_tables import WITH_STICK, WITHOUT_STICK
    from stiction.comparisons.sweep.points import THRESHOLD_COLUMN

    scene = result.specification.scene
    rows = []
    if result.map is not None:
        for measure in result.specification.run_measures:
            subject = measure.subject(scene)
            rows.append(_range_row("map", result.map, measure.quantity, subject))
    if result.threshold is not None:
        for column in (THRESHOLD_COLUMN, WITH_STICK, WITHOUT_STICK):
            quantity = replace(quantity_of(column), unit=result.specification.varied_unit)
            searched = result.specification.band_search
            subject = "" if searched is None else searched.parameter
            rows.append(_range_row("threshold", result.threshold, quantity, subject))
    show(("table", "column", "of", "smallest", "largest", "points", "without a number"), rows)


def _range_row(name: str, table: pd.DataFrame, quantity: Quantity, subject: str) -> tuple[str, ...]:
    """Return the row of `_show_ranges` about a column; `name` is that of the table."""
    values = table[quantity.key]
    smallest, largest = "-", "-"
    if values.notna().any():
        smallest, largest = f"{values.min():.6g}", f"{values.max():.6g}"
    missing = values.isna().sum()
    return (name, quantity.head, subject, smallest, largest, str(len(values)), str(missing))


def _show_failed_points(name: str, table: pd.DataFrame) -> None:
    """Print the most frequent reasons of failed points of a table, and the number of points of each."""
    from stiction.engines.status import Status

    failed = table[table["status"] != Status.OK]
    reasons = (failed["status"] + ": " + failed["reason"]).value_counts()
    for reason, count in reasons[:REASONS_SHOWN].items():
        points = "1 point" if count == 1 else f"{count} points"
        print(f"{name}: {points}: {reason}")


def _show_bands(table: pd.DataFrame, unit: str) -> None:
    """Print the bands above the threshold in which the slider sticks again, for the first points."""
    from stiction.comparisons.bench.presentation.cells import intervals_in_words
    from stiction.comparisons.studies.threshold_tables import AGAIN

    rows = table[table[AGAIN] != ""]
    with_unit = f" {unit}" if unit else ""
    # The columns of the axes precede the status.
    axes = list(table.columns[: list(table.columns).index("status")])
    for row in rows.to_dict("records")[:EVENTS_SHOWN]:
        point = ", ".join(f"{axis} = {row[axis]:g}" for axis in axes)
        bands = f"{with_unit} and ".join(intervals_in_words(row[AGAIN]))
        print(
            f"threshold: above {row['threshold']:.6g}{with_unit} the slider sticks again at about "
            f"{bands}{with_unit} ({point})"
        )
    if len(rows) > EVENTS_SHOWN:
        print(f"threshold: .. and so at {len(rows) - EVENTS_SHOWN} points more")


@commands.command()
def replay(
    solver: Annotated[
        str,
        typer.Option(
            metavar="MODULE:FUNCTION",
            help="Solver: a function solve(M, q) -> (w, z) or solve(A0, A1, b) -> (y, x), "
            "which returns None if it finds no solution.",
        ),
    ] = "stiction.comparisons.bench.complementarity.replay:lemke",
    problems: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Stored set of problems. Default: the set of the suite."),
    ] = None,
    run: Annotated[
        str | None,
        typer.Option(
            "--run",
            metavar="SCENE",
            help="Instead of a stored set, use the problems of a run of the reference: at "
            "the ends of its steps, before and after its events, and at the instants "
            "within steps at which it verifies Coulomb's law.",
        ),
    ] = None,
    overrides: Overrides = [],
    verify: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="Prove for each problem whether it has a solution, and judge the answers "
            "of the solver by this proof (needs the extra stiction[proof]).",
        ),
    ] = False,
    export: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Write the set as Matrix Market files to this folder instead of running a "
            "solver; --problems reads them.",
        ),
    ] = None,
    workers: Workers = None,
    timeout: Timeout = 60,
    out: TableFile = None,
) -> None:
    """Test a solver for (horizontal) linear complementarity problems on a set of problems.

    The table has one row for each class of problems.
    """
    check_distinct("--out", out, problems)
    if run is None and overrides:
        raise typer.BadParameter(
            "found this option without --run; expected --run with the scene to which it applies",
            param_hint="--set",
        )
    if run is not None and problems is not None:
        raise typer.BadParameter(
            "found both; expected a stored set or a run", param_hint="--run, --problems"
        )
    with TemporaryDirectory() as folder:
        if run is not None:
            scene = scene_of(run, overrides)
            problems = Path(folder) / "problems.parquet"
            title = f"reference on {scene.name}"
            _run_in_child(title, _write_problems_of_run, (scene, problems), RUN_TIMEOUT_S)
        if export is not None:
            from stiction.comparisons.bench.complementarity.exchange import write_folder
            from stiction.comparisons.bench.complementarity.problems import read_problems

            print(f"{export}: {write_folder(read_problems(problems), export)} problems")
        elif verify:
            _show_classes(verified_set(solver, problems), out)
        else:
            _replay_set(solver, problems, timeout, workers, out)


def _replay_set(
    solver: str, problems: Path | None, timeout: float, workers: int | None, out: Path | None
) -> None:
    """Run a solver on a set of problems, print a row for each class, and fail if a class has no result."""
    from stiction.comparisons.bench.complementarity.replay import replay as run_solver

    with progress(f"replay of {solver}") as bar:
        table = run_solver(
            solver,
            problems,
            timeout_s=timeout,
            workers=workers,
            on_start=bar.start,
            on_result=bar.result,
        )
    _show_classes(table, out)
    failed = table[table["problems"] == 0]
    if len(failed):
        raise exit_with(
            FAILED,
            f"{len(failed)} of {len(table)} classes failed: "
            f"{failed['class'].iloc[0]}: {failed['reason'].iloc[0]}",
        )


def _write_problems_of_run(scene: Scene, path: Path) -> int | InputError:
    """Write the problems of a run of the reference, in a child process, and return their number.

    An error of the input is returned, because the parent process raises it again.
    """
    from stiction.comparisons.bench.complementarity.audited_run import write_problems_of_run
    from stiction.scenes import InputError

    try:
        return write_problems_of_run(scene, path)
    except InputError as error:
        return error


def _show_classes(table: pd.DataFrame, out: Path | None) -> None:
    """Print a table of classes of problems, and write it to a file if one is given."""
    show_table(table)
    if out is not None:
        write_table(table, out)
