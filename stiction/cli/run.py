"""Single scenes, maps of their parameters, stored problems: ``run``, ``sweep``, ``replay``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stiction.cli.exit_codes import FAILED, ended, interrupted, say
from stiction.cli.options import (
    Assemble,
    EndTime,
    EngineName,
    ExecutorName,
    Fidelity,
    Overrides,
    SceneName,
    Settings,
    TableFile,
    Timeout,
    Workers,
    about,
    distinct,
    listed,
    positive,
    scene_of,
    settings_of,
)
from stiction.cli.pictures import Animation, Plot, write_pictures
from stiction.cli.prove import verified_set
from stiction.cli.render import (
    EVENTS_SHOWN,
    or_shown,
    progress,
    show,
    show_table,
    show_trajectory,
    write_table,
)

if TYPE_CHECKING:
    from stiction.scenes import InputError, Scene, Trajectory

commands = typer.Typer()
RUN_TIMEOUT = 600.0
"""Seconds that the run of a replay may take."""


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
    out: TableFile = None,
    events: Annotated[
        bool,
        typer.Option(
            "--events", help="Add two rows per event to FILE, with the values before and after it."
        ),
    ] = False,
    plot: Plot = None,
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

    loaded, chosen = scene_of(scene, overrides), settings_of(settings)
    distinct("--plot", plot, out)
    distinct("--animate", animation, plot)
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
    if taken := chosen.keys() & arguments.keys():
        raise typer.BadParameter(
            f"found {', '.join(taken)}; expected it as an option of its own", param_hint="--setting"
        )
    title = f"{engine} on {loaded.name}"
    given = engine, loaded, assemble, arguments | chosen
    trajectory: Trajectory = _in_child(title, run_as_asked, given, timeout, traceback)
    if out is None:
        show_trajectory(trajectory)
    else:
        with or_shown(lambda: show_trajectory(trajectory)):
            write_table(trajectory.to_frame(events), out)
        print(out)
    write_pictures(trajectory, plot, animation)
    if trajectory.termination != "end":
        where = (
            ""
            if trajectory.breakdown or not len(trajectory.t)
            else f" at t = {trajectory.t[-1]:g} s"
        )
        raise ended(FAILED, f"{title}: stopped{where}: {trajectory.termination}")


def _in_child(
    title: str,
    function: Callable[..., Any],
    arguments: tuple[Any, ...],
    timeout: float,
    traceback: bool = False,
) -> Any:
    """Call a function in a child process; bad input is raised here, any other failure ends the command."""
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
        if traceback and outcome.log and not outcome.bug:  # of a bug it is printed already
            print(outcome.log, file=sys.stderr)
        raise ended(FAILED, f"{title}: {outcome.status.label}: {outcome.reason}")
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
            help="stick-fraction, peak-torque, peak-speed, event-count or threshold; peak-speed:NAME refers "
            "to the guide, drive or body NAME. threshold is the upper end of the band of F0 with "
            "stick phases that is nearest to the scene's F0; the table contains all such bands.",
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
    """Measure the steady state over a grid of parameters.

    Initial states are projected onto the constraints. A motion that neither comes to rest nor becomes periodic has no
    steady state, and its point has no value.
    """
    from stiction.comparisons.bench.executors import check_executor, open_isolate
    from stiction.comparisons.measures.steady_state_measures import SteadyRun
    from stiction.comparisons.sweep import sweep as sweeps
    from stiction.scenes.fidelity import fidelity_of

    loaded = scene_of(scene, overrides)
    end = t_end or sweeps.usual_end(loaded)
    steady = SteadyRun(settle or end / 3, end, rtol, engine, fidelity_of(fidelity), dt)
    axes = tuple(sweeps.parse_axis(text) for text in vary)
    specification = sweeps.Specification(loaded, axes, tuple(listed(measure)), steady, timeout)
    folder = out or Path("sweeps") / f"{loaded.name}-{specification.digest[:8]}"
    check_executor(executor)
    with about("--out"):
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
        raise interrupted(
            interrupt, f"the same command goes on with the points that are kept for {folder}"
        ) from None
    _show_sweep(result, folder)


def _show_sweep(result: Any, folder: Path) -> None:
    """Draw the maps, print their ranges and the reasons of failed points, and fail where all points failed."""
    from stiction.comparisons.bench.quantities import quantity_of
    from stiction.comparisons.studies.threshold import WITH_STICK, WITHOUT_STICK
    from stiction.comparisons.sweep.sweep import THRESHOLD_COLUMN
    from stiction.engines.status import Status
    from stiction.reports.figures.style import rc, save
    from stiction.reports.figures.sweep_figures import sweep_drawings

    with rc():
        for drawing in sweep_drawings(result):
            save(drawing, folder, kinds=("png", "pdf"))
    tables = {
        part: table
        for part, table in (("map", result.map), ("threshold", result.threshold))
        if table is not None
    }
    print(folder)
    scene, measures = result.specification.scene, result.specification.run_measures
    shown_of = {
        "map": [measure.quantity for measure in measures],
        "threshold": [quantity_of(name) for name in (THRESHOLD_COLUMN, WITH_STICK, WITHOUT_STICK)],
    }
    columns = [
        (part, quantity, table[quantity.key])
        for part, table in tables.items()
        for quantity in shown_of[part]
    ]
    subjects = {measure.column: measure.subject(scene) for measure in measures}

    def range_of(values: Any) -> tuple[str, str]:
        """The ends of a column's numbers, if it has any."""
        return ("-", "-") if values.isna().all() else (f"{values.min():.6g}", f"{values.max():.6g}")

    show(
        ("table", "column", "of", "smallest", "largest", "points", "without a number"),
        [
            (
                part,
                quantity.head,
                subjects.get(quantity.key, ""),
                *range_of(values),
                str(len(values)),
                str(values.isna().sum()),
            )
            for part, quantity, values in columns
        ],
    )
    for part, table in tables.items():
        failed = table[table["status"] != Status.OK]
        for reason, points in (
            (failed["status"] + ": " + failed["reason"]).value_counts()[:EVENTS_SHOWN].items()
        ):
            print(f"{part}: {points} {'point' if points == 1 else 'points'}: {reason}")
    if result.threshold is not None:
        _show_bands(result.threshold)
    if all((table["status"] != Status.OK).all() for table in tables.values()):
        raise ended(FAILED, "all points failed")


def _show_bands(table: Any) -> None:
    """Print where the slider sticks again above its threshold, of the first rows at which it does."""
    from stiction.comparisons.bench.presentation.cells import intervals_in_words
    from stiction.comparisons.studies.threshold import AGAIN

    again = table[table[AGAIN] != ""]
    keys = list(table.columns[: list(table.columns).index("status")])
    for row in again.to_dict("records")[:EVENTS_SHOWN]:
        point = ", ".join(f"{key} = {row[key]:g}" for key in keys)
        bands = " N and ".join(intervals_in_words(row[AGAIN]))
        print(
            f"threshold: above {row['threshold']:.6g} N the slider sticks again at about {bands} N "
            f"({point})"
        )
    if len(again) > EVENTS_SHOWN:
        print(f"threshold: .. and so at {len(again) - EVENTS_SHOWN} points more")


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
            "the ends of its steps, at the audited instants within them, and on both "
            "sides of its events.",
        ),
    ] = None,
    overrides: Overrides = [],
    verify: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="Prove for each problem whether it has a solution, and judge the solver "
            "by that (needs the extra stiction[proof]).",
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
    """Test a solver for (horizontal) linear complementarity problems on a set of problems, with one row per class."""
    distinct("--out", out, problems)
    if run is None and overrides:
        raise typer.BadParameter(
            "found it without --run; expected a scene whose values it replaces", param_hint="--set"
        )
    if run is not None and problems is not None:
        raise typer.BadParameter(
            "found both; expected a stored set or a run", param_hint="--run, --problems"
        )
    with TemporaryDirectory() as folder:
        if run is not None:
            scene, problems = scene_of(run, overrides), Path(folder) / "met.parquet"
            _in_child(f"reference on {scene.name}", _write_met, (scene, problems), RUN_TIMEOUT)
        if export is not None:
            from stiction.comparisons.bench.complementarity.exchange import write_folder
            from stiction.comparisons.bench.complementarity.problems import read_problems

            print(f"{export}: {write_folder(read_problems(problems), export)} problems")
        elif verify:
            _show_set(verified_set(solver, problems), out)
        else:
            from stiction.comparisons.bench.complementarity.replay import replay as run_set

            with progress(f"replay of {solver}") as bar:
                table = run_set(
                    solver,
                    problems,
                    timeout_s=timeout,
                    workers=workers,
                    on_start=bar.start,
                    on_result=bar.result,
                )
            _show_set(table, out)
            if len(failed := table[table["problems"] == 0]):
                raise ended(
                    FAILED,
                    f"{len(failed)} of {len(table)} classes failed: "
                    f"{failed['class'].iloc[0]}: {failed['reason'].iloc[0]}",
                )


def _write_met(scene: Scene, path: Path) -> int | InputError:
    """In the child: the number of problems, or the error if the fault is the input's."""
    from stiction.comparisons.bench.complementarity.audited_run import write_problems_of_run
    from stiction.scenes import InputError

    try:
        return write_problems_of_run(scene, path)
    except InputError as error:
        return error


def _show_set(table: Any, out: Path | None) -> None:
    show_table(table)
    if out is not None:
        write_table(table, out)
