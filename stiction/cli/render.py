"""What commands show on standard output, the progress on standard error, and tables in files."""

from __future__ import annotations

import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.cli.exit_codes import say

if TYPE_CHECKING:
    import pandas as pd

    from stiction.comparisons.results import Results
    from stiction.comparisons.studies.study import Study
    from stiction.scenes import Scene, Trajectory

EVENTS_SHOWN = 20
"""Lines of a list that may be long: events, reasons, components."""
UNBROKEN = 18
"""Characters of a cell that stays on one line whatever the width, as numbers do, their uncertainty included."""
DIGITS = 9
"""Of the numbers of a run."""
ROUNDING = 1e-13
"""Of the largest value of a kind: what some hundred roundings of double precision come to."""
_GAP = 3
"""Characters between two columns on a terminal."""


@contextmanager
def progress(title: str) -> Iterator[tuple[Callable[[int], None], Callable[[Any], None]]]:
    """A bar with the time left on standard error, if that is a terminal: calls for the number of runs and for each result.

    A run of many that ended with a bug is a row like any other that failed; its traceback is printed on standard error when all are done.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    started = time.monotonic()
    with _bugs() as collect, Progress(TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TextColumn("{task.fields[state]}"),
                                      console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(title, total=None, state="")

        def start(number: int) -> None:
            bar.update(task, total=number, state=f"0 of {number}")

        def count(result: Any) -> None:
            bar.advance(task)
            found = bar.tasks[task]
            if found.total:
                share = found.completed / found.total
                bar.update(task, state=f"{found.completed:g} of {found.total:g}, {left(started, share)}")
            collect(result)

        yield start, count


@contextmanager
def validation_progress(title: str) -> Iterator[tuple[Callable[[Any], None], Callable[[float], None], Callable[[Study, Results], None]]]:
    """A validation as it goes on, on standard error: a line with the answer of each study that is done and, on a terminal, a bar with the time left.

    Calls for each result, for the share of the work that is done, and for each study; of bugs see `progress`. Without a terminal the time left stands
    at the end of the lines.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    started, console = time.monotonic(), Console(stderr=True)
    with _bugs() as collect, Progress(TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("{task.fields[left]}"),
                                      console=console, transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(title, total=1.0, left="")

        def on_share(share: float) -> None:
            bar.update(task, completed=share, left=left(started, share))

        def on_study(study: Study, results: Results) -> None:
            if answer := study.present(results).answer:
                left = bar.tasks[task].fields["left"]
                console.print(f"{study.title}: {answer.text}" + (f" ({left})" if bar.disable and left else ""), markup=False, highlight=False, soft_wrap=True)

        yield collect, on_share, on_study


@contextmanager
def _bugs() -> Iterator[Callable[[Any], None]]:
    """A call for each result; the tracebacks of bugs among them are printed in the end."""
    bugs = []

    def collect(result: Any) -> None:
        if getattr(result, "traceback", ""):  # a chunk of a sweep has none
            bugs.append(result)

    yield collect
    for result in bugs:
        say(f"{result.label} ended with a bug:\n{result.traceback}")


def left(started: float, share: float) -> str:
    """``3 min left``, by the time that a share (0 < share <= 1) of the work has taken since `time.monotonic` was `started`."""
    return f"{duration((time.monotonic() - started) * (1 / share - 1))} left"


def duration(seconds: float) -> str:
    """``40 s``, ``3 min``: as exactly as an estimate is."""
    return f"{10 * round(seconds / 10):d} s" if seconds < 95 else f"{round(seconds / 60):d} min"


def show(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A table on standard output, in which no number is cut; nothing of one without rows.

    On a terminal words are wrapped to its width; where numbers do not fit in it, each row is a paragraph. Without a terminal columns are aligned, one line per row.
    """
    rows = list(rows)
    if not rows:
        return
    if not sys.stdout.isatty():
        widths = [max(map(len, cells)) for cells in zip(columns, *rows)]
        for row in (columns, *rows):
            print("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip())
        print()
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console, table, least = Console(markup=False, highlight=False), Table(box=box.SIMPLE_HEAD), 0
    for name, *cells in zip(columns, *rows):
        longest, word = max(map(len, cells), default=0), max(len(word) for text in (name, *cells) for word in (text.split() or [""]))
        whole = longest <= UNBROKEN
        least += _GAP + (max(longest, max(map(len, name.split() or [""]))) if whole else min(word, UNBROKEN))
        table.add_column(textwrap.fill(name, max(longest, 1), break_long_words=False) if whole else name, no_wrap=whole, overflow="fold")
    if least > console.width:
        for first, *others in rows:
            print(f"{columns[0]}: {first}")
            print("".join(f"    {name}: {text}\n" for name, text in zip(columns[1:], others) if text))
        return
    for row in rows:
        table.add_row(*row)
    console.print(table)


def show_table(table: pd.DataFrame) -> None:
    """All of a table on standard output, numbers rounded by what their column is."""
    from stiction.comparisons.presentation.cells import MISSING, cell

    rows = [[cell(name, value) for name, value in row.items()] for row in table.to_dict("records")]
    show(list(table), rows)
    if any(MISSING in row for row in rows):
        print(f"{MISSING}: no value")


def show_truths(table: pd.DataFrame) -> None:
    """What errors are measured against, where that is not independent of us or has a note."""
    from stiction.comparisons.measures.scene_truth import OWN_RTOL, OWN_RUN

    for (tier, note), _ in table.groupby(["truth tier", "truth note"]) if "truth note" in table else ():
        words = [f"errors are against our own run at rtol {OWN_RTOL:g} (not independent)"] if tier == OWN_RUN else []
        if words or note:
            print(f"truth, {tier}: " + "; ".join(filter(None, (*words, note))))


def show_trajectory(trajectory: Trajectory, scene: Scene) -> None:
    """End state, efforts, drift, events and cost."""
    import numpy as np  # imported here: most of what is printed needs none of it

    times = f"t = 0 .. {trajectory.t[-1]:g} s" if len(trajectory.t) > 1 else "no motion"
    print(f"{trajectory.scene}: {trajectory.engine} {trajectory.version}, {trajectory.fidelity}, {times}, {len(trajectory.t)} rows")
    if len(trajectory.t) < 2:
        return
    show(("setting", "value"), [(key, str(value)) for key, value in trajectory.settings.items()])
    state = ("x", "y", "angle", "vx", "vy", "omega")
    told = _above_noise(trajectory)
    show(("end state [m, rad, s]", *state),
         [(name, *(told(f"{name}.{key}", trajectory[f"{name}.{key}"][-1]) for key in state)) for name in scene.bodies])
    show(("over time", "smallest", "largest", "at the end"),
         [(name, *("left open" if value != value else told(name, value) for value in (np.fmin.reduce(values), np.fmax.reduce(values), values[-1])))
          for name, values in trajectory.columns.items()
          if name.rpartition(".")[2] in ("effort", "normal_force", "friction") or name.startswith("drift.")])
    if trajectory.events:
        efforts = [f"{name}.effort" for name in scene.drives]
        # events without values have none, nor has one the values of another part of the scene
        several = any(event.other_modes for event in trajectory.events)
        show(("event [s]", "kind", "joint", *(f"jump of {name}" for name in efforts), *(["other consistent modes"] if several else [])),
             [(f"{event.time:.9f}", event.kind, event.joint, *(told(name, event.jump(name)) if name in event.before else "" for name in efforts),
               *([str(event.other_modes)] if several else []))
              for event in trajectory.events[:EVENTS_SHOWN]])
        if (more := len(trajectory.events) - EVENTS_SHOWN) > 0:
            print(f"... and {more} more events")
    cost = trajectory.cost
    times = (f"{cost.setup_s:.3g} s set-up, {cost.compile_s:.3g} s compiling or loading kernels, {cost.stepping_s:.3g} s stepping, "
             f"{cost.own_s:.3g} s of it in the engine itself")
    counts = ", ".join(f"{name} {count}" for name, count in cost.counters.items())
    print("CPU: " + "; ".join(filter(None, (times, counts))))


def _above_noise(trajectory: Trajectory) -> Callable[[str, float], str]:
    """Digits of a value of a column, or 0 where rounding, or drift that digits do not show, makes as much.

    As in the norms of the drift, lengths and angles count together, and so do forces and moments.
    """
    import numpy as np

    from stiction.scenes.columns import unit_of

    kinds, largest, drift = {"rad": "m", "rad/s": "m/s", "N m": "N", "N m or N": "N"}, {}, {"m": "drift.position", "m/s": "drift.velocity"}
    for name, values in trajectory.columns.items():
        if name not in drift.values():
            kind = kinds.get(unit := unit_of(name), unit)
            largest[kind] = max(largest.get(kind, 0.0), np.nanmax(np.abs(values), initial=0.0))

    def told(name: str, value: float) -> str:
        kind = kinds.get(unit := unit_of(name), unit)
        noise = 0.0
        if kind in largest:
            drifted = np.nanmax(trajectory[drift[kind]], initial=0.0) if kind in drift else 0.0
            noise = largest[kind] * max(ROUNDING, min(drifted / (largest[kind] or 1.0), 10.0 ** -DIGITS))
        return "0" if abs(value) <= noise else f"{value:.{DIGITS}g}"

    return told


def show_summary(results: Results) -> None:
    """The answers of page one, a line each."""
    from stiction.reports.page_one import answer_lines
    from stiction.reports.presentations import presentations

    if taken_over := results.settings["runs taken over"]:
        print(f"{taken_over} runs were taken over from an earlier call.")
    for line in answer_lines(results, presentations(results)):
        print(line)


def write_table(table: pd.DataFrame, path: Path) -> None:
    from stiction.comparisons.atomic_files import whole_file

    with whole_file(path) as partial:
        if path.suffix.lower() == ".csv":
            table.to_csv(partial, index=False)
        else:
            table.to_parquet(partial, index=False)


@contextmanager
def or_shown(shown: Callable[[], None]) -> Iterator[None]:
    """Show a result that could not be written, lest it is lost."""
    from stiction.scenes import StictionError

    try:
        yield
    except StictionError:
        shown()
        raise
