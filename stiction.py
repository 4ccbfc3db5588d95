"""The command line `stiction`, and the two functions that most scripts begin with.

    from stiction import load_scene, load_engine

Nothing heavy is imported before a command needs it, so that ``stiction --help`` answers at once.
"""

from __future__ import annotations

import functools
import os
import signal
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from comparisons.files import NotWritten, whole_file

if TYPE_CHECKING:
    import pandas as pd

    from comparisons.campaign import Campaign as NightlyCampaign
    from comparisons.single_scene import Campaign
    from comparisons.validation import Validation
    from comparisons.variants import Variant
    from engines import load_engine
    from scenes import Scene, Trajectory, load_scene

__all__ = ["app", "load_engine", "load_scene", "main"]

FINE, FAILED, BAD_INPUT, REGRESSED, COULD_NOT_RUN, INTERRUPTED, TERMINATED = 0, 1, 2, 3, 4, 130, 143
EXIT_CODES = ("Exit codes: 0 done (in validate, compare and sweep, what failed is a row of the result); 1 the run failed: the "
              "engine failed, refused, crashed, is not installed or ran out of time, or in validate a run of the reference did, "
              "or in compare and sweep nobody's came out; 2 bad input: scene, override, option, engine, campaign, baseline or output; "
              "3 regression (nightly, check), or a truth has moved (baseline update); 4 no regression, but not everything could be "
              "run (nightly, check); 130 interrupted; 143 ended by SIGTERM.")
ENDINGS = (".csv", ".parquet")
EVENTS_SHOWN = 20


def __getattr__(name: str) -> Any:
    if name == "load_scene":
        from scenes import load_scene as found
    elif name == "load_engine":
        from engines import load_engine as found
    else:
        raise AttributeError(f"module 'stiction' has no attribute {name!r}")
    return found


def main() -> None:
    """The command `stiction`; ``--engine module:Class`` is looked up in the working folder too."""
    sys.path.append(os.getcwd())
    signal.signal(signal.SIGTERM, _end)
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except OSError as error:  # everything else that can be written has a name of its own: this is standard output
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left in its buffer has nowhere to go
        _say(f"standard output: {error.strerror or error}")
        sys.exit(FAILED)


def _end(*_: Any) -> None:
    """Leave as after an error: temporary folders are removed, children ended."""
    raise SystemExit(TERMINATED)


def _exit_codes(command: Callable) -> Callable:
    """A command whose ValueErrors, scene errors among them, are bad input: a message and an exit code."""

    @functools.wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except KeyboardInterrupt:
            _say("interrupted")
            raise typer.Exit(INTERRUPTED) from None
        except NotWritten as error:
            raise _failure(str(error)) from None
        except ValueError as error:
            if not _is_bad_input(error):
                raise
            _say(str(error))
            raise typer.Exit(BAD_INPUT) from None

    return wrapped


def _is_bad_input(error: Exception) -> bool:
    """Whether an error is about what the user gave: subclasses of ValueError such as LinAlgError are not."""
    from comparisons.truth import NotThisMechanism
    from engines import UnknownEngine
    from scenes import FileError

    return isinstance(error, FileError) or type(error) in (ValueError, UnknownEngine, NotThisMechanism)


def _say(message: str) -> None:
    print(f"stiction: {message}", file=sys.stderr)


def _failure(message: str) -> typer.Exit:
    _say(message)
    return typer.Exit(FAILED)


def _could_not_run(message: str) -> typer.Exit:
    _say(message)
    return typer.Exit(COULD_NOT_RUN)


SceneName = Annotated[str, typer.Argument(metavar="SCENE", help="Name of the catalogue (see `stiction scenes`) or a TOML file.")]
Overrides = Annotated[list[str], typer.Option(
    "--set", metavar="KEY=VALUE", help="Replace a value of the scene: F0=4, motor.rate=pi/2, guide.mu=0.1, bar.position.0=1, "
                                       "gravity=[0,-1.62]; without a value, remove it. Repeatable.")]
Engines = Annotated[list[str], typer.Option(
    "--engines", metavar="A,B,..", help="Engines beside the reference; all known ones if not given. Names or module:Class.")]
Workers = Annotated[str | None, typer.Option(metavar="N", help="Child processes at a time; the number of CPUs if not given.")]
Timeout = Annotated[str, typer.Option(metavar="S", help="Seconds that one run may take before it is given up.")]
Assemble = Annotated[bool, typer.Option("--assemble", help="Move a start that violates the constraints onto them.")]
EndTime = Annotated[str | None, typer.Option("--t-end", metavar="S", help="Seconds to simulate; the scene's own if not given.")]
Quick = Annotated[bool, typer.Option("--quick", help="Fewer and coarser steps.")]
Repeats = Annotated[str, typer.Option(metavar="N", help="Timed repeats of a run; times are medians.")]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Folder that `stiction validate` has written.")]
CampaignFile = Annotated[Path | None, typer.Argument(metavar="[CAMPAIGN.toml]", help="What is run; the suite's own campaign if not given.")]
BaselineFile = Annotated[str | None, typer.Option("--baseline", metavar="REF", help="A file, a commit (its version of the suite's own "
                                                  "baseline), or COMMIT:PATH; the suite's own if not given.")]
OneEngine = Annotated[str | None, typer.Option("--engine", metavar="NAME", help="This engine alone: a name or module:Class. One derived "
                                               "from an engine of the campaign takes its place.")]
OtherScenes = Annotated[list[str], typer.Option("--scenes", metavar="A,B,..", help="Scenes of the catalogue or TOML files in place of the "
                                                "campaign's.")]
TableFile = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Write the whole table: .csv or .parquet.")]

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, epilog=EXIT_CODES,
                  help="Is a solver for rigid mechanisms with sliding joints, dry friction and motors right, and what does "
                       "being right cost?")
compare = typer.Typer(no_args_is_help=True, help="Compare engines on one scene; a table with one row per run, failures among them.")
app.add_typer(compare, name="compare")
baselines = typer.Typer(no_args_is_help=True, help="What runs are held to.")
app.add_typer(baselines, name="baseline")


@app.command(epilog=EXIT_CODES)
@_exit_codes
def validate(quick: Quick = False, engines: Engines = [], workers: Workers = None,
             out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of the report; runs/<date-time> if not given.")]
             = None) -> None:
    """Compare reference and engines with the truth on the paper's three cases, and write a report."""
    from comparisons.accuracy import WRONG
    from comparisons.kept import KeptRefused, kept_file, kept_runs
    from comparisons.validation import validate as run_campaign
    from engines import engine_names
    from reports import REPORT, EarlyFigures, FolderRefused, check_folder, write_report

    names, count = _engine_names(engines), _count("--workers", workers)
    folder = out or Path("runs") / datetime.now().strftime("%Y-%m-%d-%H%M%S")
    with _output(FolderRefused):
        check_folder(folder, REPORT)
    with ExitStack() as stack:
        with _output(KeptRefused):
            kept = stack.enter_context(kept_runs(folder, ["reference", *(engine_names() if names is None else names)]))
        stack.callback(_tell_kept, kept_file(folder), folder)
        early = EarlyFigures(Path(stack.enter_context(TemporaryDirectory(prefix="stiction-", ignore_cleanup_errors=True))))
        if len(kept):
            _say(f"{len(kept)} runs of an earlier call are kept; those of the same scenes, engines and code are taken over")
        with _progress("validate") as (on_start, on_result):
            validation = run_campaign(quick=quick, engines=names, workers=count, on_start=on_start, on_result=on_result,
                                      on_compared=early.draw, isolated=kept.isolate)
        validation = replace(validation, settings={**validation.settings, "runs taken over": kept.taken_over})
        with _output(FolderRefused), _or_shown(lambda: _show_summary(validation)):
            report = write_report(validation, folder, early)
        if not kept.interrupted:
            kept_file(folder).unlink()
    print(report)
    _show_summary(validation)
    if kept.interrupted:
        _say("interrupted: the report has what was done until then")
        raise typer.Exit(INTERRUPTED)
    lost = [f"{record.key}: {record.describe()['reason']}" for record in validation.records
            if record.variant.engine == "reference" and record.describe()["reason"]]
    accuracy = validation.tables["accuracy"]
    lost += [f"{row.key}: {row.status}: {row.reason}" for row in accuracy[(accuracy["engine"] == "reference") & (accuracy["status"] == WRONG)].itertuples()]
    lost += _lost_hard(validation.tables["hard"])
    if lost:
        raise _failure(f"{len(lost)} runs of the reference did not come out: {lost[0]}")


def _tell_kept(file: Path, folder: Path) -> None:
    if file.exists():
        _say(f"the runs that are done are kept; the same command with --out {folder} goes on with them")


def _show_summary(validation: Validation) -> None:
    from reports.summary import summary

    if taken_over := validation.settings["runs taken over"]:
        print(f"{taken_over} runs were taken over from an earlier call.")
    for line in summary(validation):
        print(line.replace("**", ""))


@app.command(epilog=EXIT_CODES)
@_exit_codes
def paper(run: RunFolder,
          out: Annotated[Path, typer.Option(metavar="DIR", help="Folder to write: new, empty, or of an earlier call.")],
          width: Annotated[str, typer.Option(metavar="double|single", help="Of the figures: both columns of a journal page, 174 mm, or one, "
                                             "84 mm.")] = "double") -> None:
    """Write a run as vector figures, LaTeX and CSV tables, methods, references and a PDF; the same run gives the same bytes."""
    from reports import FolderRefused, check_folder
    from reports.figures.style import COLUMNS
    from reports.paper import MAIN, write_paper
    from reports.stored import read_run

    if width not in COLUMNS:
        raise ValueError(f"--width: found {width!r}; expected one of {', '.join(COLUMNS)}")
    stored = read_run(run)
    with _output(FolderRefused):
        check_folder(out, MAIN, run)
        print(write_paper(stored, out, width))


@app.command(epilog=EXIT_CODES)
@_exit_codes
def page(source: Annotated[Path, typer.Argument(metavar="RUN|HISTORY", help="Folder of a run, or the history of `stiction nightly`.")],
         out: Annotated[Path | None, typer.Option(metavar="FILE", help="beside RUN or HISTORY, .html added to its name, if not given.")]
         = None) -> None:
    """Write a run, or the history of the nights, as a page for a browser; it needs no network."""
    from comparisons.history import HistoryRefused
    from reports.page import write_history_page, write_run_page
    from reports.stored import read_run

    file = out or source.with_name(source.resolve().name + ".html")
    _check_file(file, (".html",), source)
    if source.is_dir():
        stored = read_run(source)
        with _output():
            write_run_page(stored, file)
    else:
        try:
            write_history_page(source, file)
        except HistoryRefused as error:
            raise ValueError(str(error)) from error
    print(file)


@app.command(epilog=EXIT_CODES)
@_exit_codes
def trace(run: RunFolder, key: Annotated[str, typer.Argument(metavar="KEY", help="In the last column of a table: A12, J16-30.")]) -> None:
    """Where a number in a table of `paper` or `page` comes from: row, trajectory, truth, settings, versions."""
    from reports.stored import read_run
    from reports.trace import resolve, told

    stored = read_run(run)
    _show(("what", "value"), told(stored, resolve(stored, key)))


@app.command(epilog=EXIT_CODES)
@_exit_codes
def run(scene: SceneName,
        engine: Annotated[str, typer.Option(metavar="NAME", help="See `stiction engines`; or module:Class.")] = "reference",
        fidelity: Annotated[str, typer.Option(metavar="joint|contact", help="Bilateral joints, or a box between surfaces.")]
        = "joint",
        t_end: EndTime = None,
        dt: Annotated[str | None, typer.Option(metavar="H", help="Step in seconds of a fixed-step method.")] = None,
        rtol: Annotated[str | None, typer.Option(metavar="R", help="Relative tolerance of an adaptive method.")] = None,
        output_step: Annotated[str, typer.Option(metavar="S", help="Seconds between the rows of the result.")] = "0.01",
        overrides: Overrides = [],
        settings: Annotated[list[str], typer.Option("--setting", metavar="KEY=VALUE",
                                                    help="A setting of the engine, e.g. stabilization=projection. Repeatable.")] = [],
        assemble: Assemble = False,
        out: Annotated[Path | None, typer.Option(metavar="FILE", help="Write all columns: .csv or .parquet.")] = None,
        events: Annotated[bool, typer.Option("--events", help="In FILE two more rows per event: values before and after it.")] = False,
        timeout: Timeout = "600",
        traceback: Annotated[bool, typer.Option("--traceback", help="If the run fails, print the end of what the engine printed, its traceback "
                                                "included.")] = False) -> None:
    """Simulate a scene in a child process; without --out print end state, efforts, events and cost."""
    from engines import Task, isolate

    loaded = _scene(scene, overrides)
    _check_file(out)
    if dt is not None and rtol is not None:
        raise ValueError(f"--dt, --rtol: found both, {dt} and {rtol}; expected one: a fixed step or a tolerance")
    numbers = {"t_end": t_end, "dt": dt, "rtol": rtol, "output_step": output_step}
    arguments = {name: _number(f"--{name.replace('_', '-')}", text) for name, text in numbers.items()} | {"fidelity": fidelity}
    limit = _number("--timeout", timeout)
    chosen = _settings(settings)
    if taken := chosen.keys() & arguments.keys():
        raise ValueError(f"--setting: found {', '.join(taken)}; expected it as an option of its own")
    with _progress(f"{engine} on {loaded.name}") as (_, on_result):
        [outcome] = isolate([Task("run", _simulate, (engine, loaded, assemble, arguments | chosen))],
                            workers=1, timeout_s=limit, on_result=on_result)
    if isinstance(outcome.value, Exception):
        raise ValueError(str(outcome.value))
    if outcome.status != "ok":
        if traceback and outcome.log:
            print(outcome.log, file=sys.stderr)
        raise _failure(f"{engine} on {loaded.name}: {outcome.status}: {outcome.reason}")
    trajectory: Trajectory = outcome.value
    if out is None:
        _show_trajectory(trajectory, loaded)
    else:
        with _or_shown(lambda: _show_trajectory(trajectory, loaded)):
            _write(trajectory.to_frame(events), out)
    if trajectory.termination != "end":
        where = "" if trajectory.breakdown or not len(trajectory.t) else f" at t = {trajectory.t[-1]:g} s"
        raise _failure(f"{engine} on {loaded.name}: stopped{where}: {trajectory.termination}")


def _simulate(engine: str, scene: Scene, assemble: bool, arguments: Mapping[str, Any]) -> Trajectory | Exception:
    """In the child: a trajectory, or the error if the fault is the input's, to be told apart from failures."""
    from engines import load_engine
    from reference_impl.assembly import with_consistent_start

    try:
        return load_engine(engine).simulate(with_consistent_start(scene, assemble), **arguments)
    except Exception as error:
        if _is_bad_input(error):
            return error
        raise


@compare.command("drift", epilog=EXIT_CODES)
@_exit_codes
def compare_drift(scene: SceneName, engines: Engines = [], overrides: Overrides = [], t_end: EndTime = None, quick: Quick = False,
                  workers: Workers = None, timeout: Timeout = "240", assemble: Assemble = False, out: TableFile = None) -> None:
    """Residuals of the constraints over time, with and without stabilization, over step sizes."""
    from comparisons import single_scene
    from comparisons.variants import scaled

    end = _number("--t-end", t_end)

    def table(subject: Scene, variants: Sequence[Variant], campaign: Campaign) -> pd.DataFrame:
        return single_scene.compare_drift(subject, scaled(variants, subject, end), campaign, end)

    _compare(table, scene, engines, overrides, quick, workers, timeout, assemble, out)


@compare.command("threshold", epilog=EXIT_CODES)
@_exit_codes
def compare_threshold(scene: SceneName, engines: Engines = [], overrides: Overrides = [], quick: Quick = False,
                      workers: Workers = None, timeout: Timeout = "240", assemble: Assemble = False,
                      out: TableFile = None) -> None:
    """Largest amplitude F0 with a stick phase in the steady state (slider-bar scenes)."""
    from comparisons import single_scene

    def table(subject: Scene, variants: Sequence[Variant], campaign: Campaign) -> pd.DataFrame:
        return single_scene.compare_threshold(subject, variants, campaign, quick)

    _compare(table, scene, engines, overrides, quick, workers, timeout, assemble, out)


@compare.command("torque", epilog=EXIT_CODES)
@_exit_codes
def compare_torque(scene: SceneName, engines: Engines = [], overrides: Overrides = [], t_end: EndTime = None, quick: Quick = False,
                   drive: Annotated[str | None, typer.Option(metavar="NAME", help="The scene's first drive if not given.")] = None,
                   workers: Workers = None, timeout: Timeout = "240", assemble: Assemble = False, out: TableFile = None) -> None:
    """Jumps of a drive's effort at the events of the truth; printed: the largest errors, in FILE: every jump."""
    from comparisons import single_scene
    from comparisons.variants import scaled
    from reports.tables import worst_per_run

    end = _number("--t-end", t_end)

    def table(subject: Scene, variants: Sequence[Variant], campaign: Campaign) -> pd.DataFrame:
        return single_scene.compare_torque(subject, scaled(variants, subject, end), campaign, end, drive)

    _compare(table, scene, engines, overrides, quick, workers, timeout, assemble, out, worst_per_run)


@compare.command("cost", epilog=EXIT_CODES)
@_exit_codes
def compare_cost(scene: SceneName, engines: Engines = [], overrides: Overrides = [], t_end: EndTime = None, quick: Quick = False,
                 repeats: Repeats = "5", timeout: Timeout = "240", assemble: Assemble = False, out: TableFile = None) -> None:
    """Error against CPU time along a ladder of steps or tolerances; what a given error costs whom. One run at a time."""
    from comparisons.cost import cost_variants, work_precision
    from comparisons.variants import scaled
    from reports.cost_page import picked, reached_table

    end, count = _number("--t-end", t_end), _count("--repeats", repeats)

    def table(subject: Scene, _: Sequence[Variant], campaign: Campaign) -> pd.DataFrame:
        return work_precision(subject, scaled(cost_variants(_engine_names(engines), quick), subject, end), t_end=end, repeats=count, **vars(campaign))

    def shown(rows: pd.DataFrame) -> pd.DataFrame:
        reached = reached_table(rows)
        _show_table(reached)
        return picked(rows, "cost")

    _compare(table, scene, engines, overrides, quick, "1", timeout, assemble, out, shown)


@compare.command("effects", epilog=EXIT_CODES)
@_exit_codes
def compare_effects(scene: SceneName,
                    engines: Annotated[list[str], typer.Option("--engines", metavar="A,B,..", help="Engines beside the reference; none "
                                                               "if not given.")] = [],
                    overrides: Overrides = [], t_end: EndTime = None, repeats: Repeats = "5", timeout: Timeout = "240",
                    assemble: Assemble = False, out: TableFile = None) -> None:
    """The scene without each effect that it declares: what changes in motion, events, effort, and in time. One run at a time."""
    from comparisons.effects import effects_table, effects_variants
    from reports.cost_page import picked

    end, count = _number("--t-end", t_end), _count("--repeats", repeats)

    def table(subject: Scene, _: Sequence[Variant], campaign: Campaign) -> pd.DataFrame:
        return effects_table(subject, effects_variants(_engine_names(engines) or ()), t_end=end, repeats=count, **vars(campaign))

    _compare(table, scene, engines, overrides, False, "1", timeout, assemble, out, lambda rows: picked(rows, "effects"))


@compare.command("suppression", epilog=EXIT_CODES)
@_exit_codes
def compare_suppression(scene: SceneName, overrides: Overrides = [], t_end: EndTime = None, repeats: Repeats = "5",
                        timeout: Timeout = "240", assemble: Assemble = False, out: TableFile = None) -> None:
    """Both ways of the reference without drift suppression, with Baumgarte's, with projection: cost, drift, error."""
    from comparisons.suppression import suppression_table
    from reports.cost_page import picked

    end, count = _number("--t-end", t_end), _count("--repeats", repeats)

    def table(subject: Scene, _: Sequence[Variant], campaign: Campaign) -> pd.DataFrame:
        return suppression_table(subject, t_end=end, repeats=count, **vars(campaign))

    _compare(table, scene, ["reference"], overrides, False, "1", timeout, assemble, out, lambda rows: picked(rows, "suppression"))


@compare.command("hard", epilog=EXIT_CODES)
@_exit_codes
def compare_hard_cases(engines: Engines = [], quick: Quick = False, workers: Workers = None, timeout: Timeout = "60", out: TableFile = None,
                       problems: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the complementarity problems that the "
                                                                     "reference met, for `stiction replay`: .parquet.")] = None) -> None:
    """The catalogue of hard cases through the reference and the engines: right, degraded, refused, wrong or failed, and why."""
    from comparisons.hard import compare_hard, hard_matrix
    from comparisons.problems import write_problems
    from reports.data import storable
    from reports.hard_page import not_right

    _check_file(out)
    _check_file(problems, ENDINGS, out)
    limit, count, names = _number("--timeout", timeout), _count("--workers", workers), _engine_names(engines)
    with _progress("hard cases") as (on_start, on_result):
        found = compare_hard(quick=quick, engines=names, workers=count, timeout_s=limit, on_start=on_start, on_result=on_result)
    _show_table(hard_matrix(found.table))
    _show_table(not_right(found.table))
    if out is not None:
        _write(storable(found.table), out)
    if problems is not None:
        write_problems(found.problems, problems)
    if lost := _lost_hard(found.table):
        raise _failure(f"{len(lost)} cases are lost to the reference: {lost[0]}")


def _lost_hard(table: pd.DataFrame) -> list[str]:
    """Hard cases on which the reference is wrong or failed, in words."""
    rows = table[(table["variant"] == "reference") & table["verdict"].isin(["wrong", "failed"])]
    return [f"{row.case}: {row.verdict}: {row.about}" for row in rows.itertuples()]


@app.command(epilog=EXIT_CODES)
@_exit_codes
def replay(solver: Annotated[str, typer.Option(metavar="MODULE:FUNCTION", help="solve(M, q) -> (w, z) or solve(A0, A1, b) -> (y, x); "
                                               "None where it finds none.")] = "comparisons.replay:lemke",
           problems: Annotated[Path | None, typer.Option(metavar="FILE", help="A stored set; that of the suite if not given.")] = None,
           workers: Workers = None, timeout: Timeout = "60", out: TableFile = None) -> None:
    """Run any solver of (horizontal) linear complementarity problems over a stored set of hard ones; a row per class."""
    from comparisons.replay import replay as run_set

    _check_file(out, ENDINGS, problems)
    limit, count = _number("--timeout", timeout), _count("--workers", workers)
    with _progress(f"replay of {solver}") as (on_start, on_result):
        table = run_set(solver, problems, timeout_s=limit, workers=count, on_start=on_start, on_result=on_result)
    _show_table(table)
    if out is not None:
        _write(table, out)
    lost = table[table["problems"] == 0]
    if len(lost):
        raise _failure(f"{len(lost)} of {len(table)} classes did not come out: {lost['class'].iloc[0]}: {lost['reason'].iloc[0]}")


def _compare(table: Callable[[Scene, Sequence[Variant], Campaign], pd.DataFrame], scene: str, engines: Sequence[str],
             overrides: Sequence[str], quick: bool, workers: str | None, timeout: str, assemble: bool, out: Path | None,
             shown: Callable[[pd.DataFrame], pd.DataFrame] = lambda rows: rows) -> None:
    from comparisons.single_scene import Campaign
    from comparisons.variants import variants
    from reference_impl.assembly import with_consistent_start

    _check_file(out)
    limit, count, names = _number("--timeout", timeout), _count("--workers", workers), _engine_names(engines)
    subject = with_consistent_start(_scene(scene, overrides), assemble)
    with _progress(f"compare on {subject.name}") as (on_start, on_result):
        rows = table(subject, variants(names, quick), Campaign(limit, count, on_start, on_result))
    if rows.empty:
        print("nothing to compare: the truth has no such event")
        return
    _show_comparison(shown(rows))
    if out is not None:
        from reports.data import storable

        _write(storable(rows), out)
    if not (rows["status"] == "ok").any():
        raise _failure("no run came out")


@app.command(epilog=EXIT_CODES)
@_exit_codes
def sweep(scene: SceneName,
          vary: Annotated[list[str], typer.Option("--vary", metavar="KEY=FROM:TO:COUNT|KEY=A,B,..", help="An axis of the grid: F0=0.5:6:100, "
                                                  "guide.mu=0.03,0.1. Repeatable; two axes are drawn as a map.")],
          measure: Annotated[list[str], typer.Option("--measure", metavar="A,B,..", help="stick-fraction, peak-torque, peak-speed, "
                                                     "event-count; threshold: largest F0 with a stick phase.")],
          workers: Workers = None,
          executor: Annotated[str, typer.Option(metavar="processes|dask[:ADDRESS]", help="Processes of this machine, or a Dask cluster: "
                                                "one on this machine, or that of the scheduler at ADDRESS.")] = "processes",
          t_end: Annotated[str | None, typer.Option("--t-end", metavar="S", help="End of every run; twice the scene's own if not given.")]
          = None,
          settle: Annotated[str | None, typer.Option(metavar="S", help="Measure from here on; a third of the end if not given.")] = None,
          rtol: Annotated[str, typer.Option(metavar="R", help="Relative tolerance.")] = "1e-6",
          overrides: Overrides = [],
          out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder; sweeps/<scene>-<digest> if not given. The same command goes "
                                                   "on with what is there.")] = None) -> None:
    """Measure the steady state over a grid of parameters with the reference; starts are moved onto the constraints."""
    from comparisons import sweep as sweeps
    from comparisons.executors import check_executor, open_executor
    from reports.figures.map import map_drawings
    from reports.figures.style import rc, save

    loaded, count = _scene(scene, overrides), _count("--workers", workers)
    end = _number("--t-end", t_end) or 2 * loaded.t_end
    names = tuple(name.strip() for part in measure for name in part.split(","))
    specification = sweeps.Specification(loaded, tuple(sweeps.parse_axis(text) for text in vary), names,
                                         _number("--settle", settle) or end / 3, end, _number("--rtol", rtol))
    folder = out or Path("sweeps") / f"{loaded.name}-{specification.digest[:8]}"
    check_executor(executor)
    with _output(sweeps.SweepRefused):
        sweeps.check_folder(specification, folder)
    with open_executor(executor, count) as pool, _progress(f"sweep of {loaded.name}") as (on_start, on_result), \
            _output(sweeps.SweepRefused):
        result = sweeps.sweep(specification, pool, folder, on_start=on_start, on_result=on_result)
    with _output(), rc():
        for drawing in map_drawings(result):
            save(drawing, folder)
    tables = {part: table for part, table in (("map", result.map), ("threshold", result.threshold)) if table is not None}
    print(folder)
    _show(("table", "column", "smallest", "largest", "points", "without a number"),
          [(part, name, f"{table[name].min():.6g}", f"{table[name].max():.6g}", str(len(table)), str(table[name].isna().sum()))
           for part, table in tables.items() for name in table.columns if "[" in name and not name.startswith("window")])
    for part, table in tables.items():
        for reason, points in table.loc[table["status"] != "ok", "reason"].value_counts()[:EVENTS_SHOWN].items():
            print(f"{part}: {points} points: {reason}")
    if not any((table["status"] == "ok").any() for table in tables.values()):
        raise _failure("no point came out")


@app.command(epilog=EXIT_CODES)
@_exit_codes
def nightly(campaign: CampaignFile = None, baseline: BaselineFile = None, engine: OneEngine = None, scenes: OtherScenes = [],
            out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of history.sqlite and of a folder per night.")] = Path("nightly"),
            ) -> None:
    """Run a campaign, or what an interrupted night has left of it, add it to the history, and report what changed."""
    from comparisons.baseline import load_baseline
    from comparisons.history import HistoryRefused
    from comparisons.nightly import Result, run_night
    from reports.regression import check_report, write_night

    def publish(result: Result) -> None:
        write_night(result, _exit_code(result.verdict), out / result.name.replace(":", ""))

    chosen, expected = _campaign(campaign, engine, scenes), load_baseline(baseline)
    try:
        with _progress(f"night of {chosen.name}") as (on_start, on_result), _output():
            result = run_night(chosen, out, expected, publish, on_start=on_start, on_result=on_result)
    except HistoryRefused as error:
        raise _could_not_run(str(error)) from None
    print(out / result.name.replace(":", ""))
    print(check_report(result), end="")
    raise typer.Exit(_exit_code(result.verdict))


@app.command(epilog=EXIT_CODES)
@_exit_codes
def check(campaign: CampaignFile = None, baseline: BaselineFile = None, engine: OneEngine = None, scenes: OtherScenes = [],
          history: Annotated[Path | None, typer.Option(metavar="FILE", help="History of this machine's nights, for times; "
                                                       "nightly/history.sqlite if it is there.")] = None,
          control: Annotated[Path | None, typer.Option(metavar="DIR", help="Checkout of the code before (git worktree add DIR main): runs are "
                                                       "timed in turns with it. Without it no verdict rests on time.")] = None) -> None:
    """Run the fast part of a campaign and print what changed beyond noise, worst first, as Markdown."""
    from comparisons.baseline import load_baseline
    from comparisons.control import ControlRefused
    from comparisons.history import HistoryRefused
    from comparisons.nightly import HISTORY, run_check
    from reports.regression import check_report

    usual = Path("nightly") / HISTORY
    chosen, expected = _campaign(campaign, engine, scenes), load_baseline(baseline)
    try:
        with _progress(f"check of {chosen.name}") as (on_start, on_result):
            result = run_check(chosen, expected, history or (usual if usual.is_file() else None), control, on_start=on_start, on_result=on_result)
    except HistoryRefused as error:
        raise ValueError(f"--history: {error}") from None
    except ControlRefused as error:
        raise ValueError(f"--control: {error}") from None
    print(check_report(result), end="")
    raise typer.Exit(_exit_code(result.verdict))


@baselines.command("update", epilog=EXIT_CODES)
@_exit_codes
def baseline_update(reason: Annotated[str, typer.Option(metavar="TEXT", help="Why the numbers changed; it is kept in the file.")],
                    campaign: CampaignFile = None, engine: OneEngine = None, scenes: OtherScenes = [],
                    file: Annotated[Path | None, typer.Option("--file", metavar="FILE", help="The baseline; the suite's own if not given. Made "
                                                              "if it is not there.")] = None,
                    night: Annotated[Path | None, typer.Option("--night", metavar="HISTORY", help="Take the last finished night of this "
                                                               "history; if not given, the part of the campaign for checks is run.")] = None) -> None:
    """Make what the runs give now what is expected of them. Truths of a tier above our own run are never touched."""
    from comparisons import baseline as files
    from comparisons.environment import origin
    from comparisons.history import HistoryRefused, open_history
    from comparisons.nightly import run_check

    if not reason.strip():
        raise ValueError("--reason: found nothing; expected why the numbers changed")
    path = file or files.DEFAULT
    _check_file(path, (), night, "--file")
    chosen = _campaign(campaign, engine, scenes)
    old = files.load_baseline(str(path)) if file is None or file.exists() else files.Baseline(format=files.FORMAT)
    if night is not None:
        try:
            with open_history(night, write=False) as history:
                name = history.last_finished()
                rows, made = (history.rows(name), history.origin(name)) if name else ([], origin())
        except HistoryRefused as error:
            raise ValueError(f"--night: {error}") from None
    else:
        with _progress(f"baseline of {chosen.name}") as (on_start, on_result):
            result = run_check(chosen, old, on_start=on_start, on_result=on_result)
        rows, made = result.rows, result.origin
    try:
        # what --engine and --scenes leave out stays as it is
        known = {run.key for part in (chosen, _campaign(campaign, None, [])) for run in part.runs}
        new = files.updated(old, rows, reason.strip(), made, known)
    except files.BaselineRefused as error:
        _say(f"{path}: {error}")
        raise typer.Exit(REGRESSED) from None
    files.write_baseline(new, path)
    print(f"{path}: {len(rows)} runs")


def _campaign(path: Path | None, engine: str | None, scenes: Sequence[str]) -> NightlyCampaign:
    from comparisons.campaign import load_campaign
    from engines import EngineMissing, UnknownEngine

    found = load_campaign(path, [name.strip() for part in scenes for name in part.split(",")])
    try:
        return found if engine is None else found.of_engine(engine)
    except UnknownEngine as error:
        raise ValueError(str(error)) from error
    except EngineMissing as error:
        raise _could_not_run(str(error)) from None


def _exit_code(verdict: str) -> int:
    from comparisons import regression

    return {regression.FINE: FINE, regression.REGRESSION: REGRESSED, regression.COULD_NOT_RUN: COULD_NOT_RUN}[verdict]


@app.command("scenes", epilog=EXIT_CODES)
@_exit_codes
def list_scenes(folder: Annotated[str, typer.Argument(metavar="[FOLDER]", help="hard: the scenes of `stiction compare hard`.")] = "") -> None:
    """The scenes of the catalogue, or of a folder of it, and the effects that they declare."""
    from reference_impl.blocks import blocks
    from scenes import catalogue, load_scene

    rows = []
    names = catalogue(folder)
    if not names:
        raise ValueError(f"folder: found {folder!r}; expected hard")
    for name in names:
        scene = load_scene(name)
        rows.append((name, scene.title, ", ".join(block.name for block in blocks(scene)[1:] if block.elements)))
    _show(("scene", "title", "effects"), rows)


@app.command(epilog=EXIT_CODES)
@_exit_codes
def export(scene: SceneName, overrides: Overrides = [],
           to: Annotated[str, typer.Option("--to", metavar="FORMAT", help="mjcf (MuJoCo) or urdf.")] = "mjcf",
           out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Where to write it; shown if not given.")] = None) -> None:
    """The scene as a model that an engine's users know."""
    from comparisons.files import whole_file
    from engines import Refused
    from engines.fixed_step import DEFAULT_STEP
    from engines.mujoco_engine import scene_as_mjcf
    from engines.urdf import urdf

    writers = {"mjcf": lambda loaded: scene_as_mjcf(loaded, DEFAULT_STEP), "urdf": urdf}
    if to not in writers:
        raise ValueError(f"--to: found {to!r}; expected {' or '.join(writers)}")
    loaded = _scene(scene, overrides)
    try:
        text = writers[to](loaded)
    except Refused as error:
        raise _failure(f"{to} of {loaded.name}: {error}") from None
    if out is None:
        print(text, end="")
        return
    with whole_file(out) as partial:
        partial.write_text(text, encoding="utf-8")


@app.command("engines", epilog=EXIT_CODES)
@_exit_codes
def list_engines() -> None:
    """The engines: version or why it is missing, fidelities, friction law and who supplies it."""
    from engines import EngineMissing, UnknownEngine, engine_names, load_engine

    rows = []
    for name in engine_names():
        try:
            engine = load_engine(name)
        except (EngineMissing, UnknownEngine) as error:
            rows.append((name, "not installed", *[""] * 4, str(error)))
            continue
        can = engine.capabilities
        rows += [(name, engine.version, fidelity, "yes" if can.static_coefficient.get(fidelity) else "no", can.order, can.reactions,
                  can.friction_law.get(fidelity, "")) for fidelity in can.fidelities]
    _show(("engine", "version", "fidelity", "mus", "order", "reactions from", "friction law (supplied by)"), rows)


@app.command(epilog=EXIT_CODES)
@_exit_codes
def explain(scene: SceneName, overrides: Overrides = []) -> None:
    """What the reference assembles for a scene and what it leaves out, the size of its HLCP, and who refuses it."""
    from reference_impl.blocks import blocks, constraint_components, constraint_rows, hlcp_size, rank
    from reference_impl.components import independent_parts

    loaded = _scene(scene, overrides)
    print(f"{loaded.name}: {loaded.title}\n\nAssembled:")
    _show(("block", "elements", "equation", "size"),
          [(block.name, _few(block.elements), block.equation, block.size) for block in blocks(loaded) if block.elements])
    print("Left out, because the scene does not declare it:")
    _show(("block", "so"), [(block.name, block.absence) for block in blocks(loaded) if not block.elements])
    coordinates, rows, independent = 3 * len(loaded.bodies), constraint_rows(loaded), rank(loaded)
    redundant = f" ({rows - independent} redundant at the start: minimum-norm forces)" if independent < rows else ""
    print(f"Freedoms: {coordinates - independent} = {coordinates} coordinates - {independent} independent of {rows} constraint "
          f"rows{redundant}\n\nComplementary pairs in the HLCP, by contact mode, and equations of the linear solve while it lasts:")
    sliders = len(loaded.frictional_guides)
    _show(("contact mode", "HLCP", "linear"),
          [(_mode(sliders, sticking), str(hlcp_size(loaded, sticking)), str(rows + sticking))
           for sticking in sorted({0, min(1, sliders), sliders})])
    groups = constraint_components(loaded)
    print(f"Independent parts, each integrated on its own: {len(independent_parts(loaded))}\nIndependent components of the constraint graph: {len(groups)}")
    _show(("component", "bodies"), [(str(i), _few(group)) for i, group in enumerate(groups[:EVENTS_SHOWN], 1)])
    print("Engines:")
    _show(("engine", "fidelity", "represents it"), list(_refusals(loaded)))


def _refusals(scene: Scene) -> Iterator[tuple[str, str, str]]:
    from engines import EngineMissing, UnknownEngine, engine_names, load_engine

    for name in engine_names():
        try:
            engine = load_engine(name)
        except (EngineMissing, UnknownEngine) as error:
            yield name, "", f"not installed: {error}"
            continue
        for fidelity in engine.capabilities.fidelities:
            reason = engine.refusal(scene, fidelity)
            yield name, fidelity, "yes" if reason is None else f"no: {reason}"


def _mode(sliders: int, sticking: int) -> str:
    if not sliders:
        return "no friction: no complementarity problem"
    if sliders == 1:
        return "sticking" if sticking else "slipping"
    return f"{sticking} of {sliders} guides sticking"


def _few(names: Sequence[str], most: int = 8) -> str:
    return ", ".join(names[:most]) + (f", ... ({len(names)} in all)" if len(names) > most else "")


def _scene(name: str, overrides: Iterable[str]) -> Scene:
    from scenes import load_scene, parse_override

    return load_scene(name, dict(parse_override(text) for text in overrides))


def _engine_names(given: Iterable[str]) -> list[str] | None:
    """The names in ``a,b`` lists, each of which is an engine (installed or not); None where none is given."""
    from engines import EngineMissing, UnknownEngine, load_engine

    names = list(dict.fromkeys(name.strip() for part in given for name in part.split(",")))
    for name in names:
        try:
            load_engine(name)
        except UnknownEngine as error:
            raise ValueError(str(error)) from error
        except EngineMissing:
            pass  # its rows will say so
    return names or None


def _settings(given: Iterable[str]) -> dict[str, Any]:
    """Settings of an engine from ``KEY=VALUE``: values as TOML has them, anything else a word."""
    settings = {}
    for text in given:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not (key.isidentifier() and equals and value):
            raise ValueError(f"--setting: found {text!r}; expected KEY=VALUE such as stabilization=projection")
        try:
            settings[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            settings[key] = value
    return settings


def _number(option: str, text: str | None) -> float | None:
    """The value of an option that takes a number > 0 or arithmetic; None where it is not given."""
    from scenes.expressions import evaluate

    if text is None:
        return None
    try:
        value = evaluate(text, {})
    except ValueError as error:
        raise ValueError(f"{option}: found {text!r}; {error}") from None
    if value <= 0:
        raise ValueError(f"{option}: found {text!r}; expected a number > 0")
    return value


def _count(option: str, text: str | None) -> int | None:
    value = _number(option, text)
    if value is not None and value != int(value):
        raise ValueError(f"{option}: found {text!r}; expected a whole number >= 1")
    return None if value is None else int(value)


@contextmanager
def _output(*refusals: type[Exception]) -> Iterator[None]:
    """What the system, or one of `refusals`, has against an output, as bad input."""
    try:
        yield
    except (OSError, *refusals) as error:
        raise ValueError(f"--out: {error}") from error


def _check_file(path: Path | None, endings: Sequence[str] = ENDINGS, other: Path | None = None, option: str = "--out") -> None:
    """Whether a table, or something else with one of these endings (any, if there are none), can be written there, asked before it is computed.

    `other` is a file that the command reads or writes as well.
    """
    if path is None:
        return
    if other is not None and path.resolve() == other.resolve():
        raise ValueError(f"{option}: found {str(path)!r}, which the command needs for something else; expected another file")
    if endings and path.suffix.lower() not in endings:
        raise ValueError(f"{option}: found {str(path)!r}; expected a name that ends in {' or '.join(endings)}")
    with _output():
        writable = path.parent.is_dir() and not path.is_dir() and all(os.access(place, os.W_OK) for place in (path, path.parent) if place.exists())
    if not writable:
        raise ValueError(f"{option}: found {str(path)!r}; expected a file in a folder that exists and can be written")


def _write(table: pd.DataFrame, path: Path) -> None:
    with whole_file(path) as partial:
        if path.suffix.lower() == ".csv":
            table.to_csv(partial, index=False)
        else:
            table.to_parquet(partial, index=False)


@contextmanager
def _or_shown(show: Callable[[], None]) -> Iterator[None]:
    """Show a result that could not be written, lest it is lost."""
    try:
        yield
    except NotWritten:
        show()
        raise


@contextmanager
def _progress(title: str) -> Iterator[tuple[Callable[[int], None], Callable[[Any], None]]]:
    """A bar with the time left on standard error, if that is a terminal: calls for the number of runs and for each result."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    with Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"),
                  TimeRemainingColumn(), console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(title, total=None)
        yield lambda count: bar.update(task, total=count), lambda _: bar.advance(task)


def _show(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A table on standard output: as wide as the terminal, or one line per row where there is none."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(*columns, box=box.SIMPLE_HEAD)
    for row in rows:
        table.add_row(*row)
    Console(markup=False, highlight=False, width=None if sys.stdout.isatty() else 10_000).print(table)


def _show_trajectory(trajectory: Trajectory, scene: Scene) -> None:
    """End state, efforts, drift, events and cost."""
    times = f"t = 0 .. {trajectory.t[-1]:g} s" if len(trajectory.t) > 1 else "no motion"
    print(f"{trajectory.scene}: {trajectory.engine} {trajectory.version}, {trajectory.fidelity}, {times}, {len(trajectory.t)} rows")
    if len(trajectory.t) < 2:
        return
    _show(("setting", "value"), [(key, str(value)) for key, value in trajectory.settings.items()])
    state = ("x", "y", "angle", "vx", "vy", "omega")
    _show(("end state [m, rad, s]", *state),
          [(name, *(f"{trajectory[f'{name}.{key}'][-1]:.9g}" for key in state)) for name in scene.bodies])
    _show(("over time", "smallest", "largest", "at the end"),
          [(name, *(f"{value:.9g}" for value in (values.min(), values.max(), values[-1])))
           for name, values in trajectory.columns.items()
           if name.rpartition(".")[2] in ("effort", "normal_force", "friction") or name.startswith("drift.")])
    if trajectory.events:
        efforts = [f"{name}.effort" for name in scene.drives]
        _show(("event [s]", "kind", "joint", *(f"jump of {name}" for name in efforts)),
              [(f"{event.time:.9f}", event.kind, event.joint, *(f"{event.jump(name):.9g}" for name in efforts))
               for event in trajectory.events[:EVENTS_SHOWN]])
        if (more := len(trajectory.events) - EVENTS_SHOWN) > 0:
            print(f"... and {more} more events")
    cost = trajectory.cost
    print(f"CPU: {cost.setup_s:.3g} s set-up, {cost.compile_s:.3g} s compiling or loading kernels, {cost.stepping_s:.3g} s stepping, {cost.own_s:.3g} s of it in the engine itself; "
          + ", ".join(f"{name} {count}" for name, count in cost.counters.items()))


def _show_table(table: pd.DataFrame) -> None:
    from reports.tables import cell

    _show(list(table), [[cell(name, value) for name, value in row.items()] for row in table.to_dict("records")])


def _show_comparison(table: pd.DataFrame) -> None:
    """One row per run; what is the same in all of them is said once."""
    from comparisons.variants import OWN_CPU
    from reports.tables import cell, quantities, setting_of

    columns = {"variant": list(table["variant"]), "setting": [setting_of(*pair) for pair in zip(table["parameter"], table["step"])]}
    if (table["status"] != "ok").any():
        columns |= {"status": list(table["status"]), "reason": list(table["reason"])}
    for name in [*quantities(table), "cpu [s]", OWN_CPU]:
        known = table[name].dropna().unique() if name in table else []
        if len(known) == 1 and len(table) > 1:
            print(f"{name}: {cell(name, known[0])}")
        elif len(known):
            columns[name] = [cell(name, value) for value in table[name]]
    _show(list(columns), [[str(value) for value in row] for row in zip(*columns.values())])
    for (tier, note), _ in table.groupby(["truth tier", "truth note"]) if "truth note" in table else ():
        if note:
            print(f"truth, {tier}: {note}")


if __name__ == "__main__":
    main()
