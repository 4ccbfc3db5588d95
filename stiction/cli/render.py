"""Output of commands: on standard output, the progress on standard error, and tables in files."""

from __future__ import annotations

import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.cli.exit_codes import say

if TYPE_CHECKING:
    import pandas as pd

    from stiction.comparisons.bench.results import Results
    from stiction.comparisons.bench.study import Study
    from stiction.reports.report import Report
    from stiction.scenes import Trajectory

EVENTS_SHOWN = 20
"""Lines of a list that may be long: reasons, components."""
UNBROKEN = 18
"""Characters of a cell that stays on one line whatever the width, as numbers do, their uncertainty included."""
SILENCE_S = 60.0
"""Seconds between two lines that say how far a command is, where standard error is no terminal that shows a bar."""
_GAP = 3
"""Characters between two columns on a terminal."""


class Progress:
    """A bar with the time left on standard error, if that is a terminal, else a line a minute; what is said above it.

    A run that ended with a bug is a failed run like any other; its traceback is printed when all are done.
    """

    def __init__(self, title: str):
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[state]}"),
        )
        self._console = Console(stderr=True)
        self.bar = Progress(
            *columns, console=self._console, transient=True, disable=not sys.stderr.isatty()
        )
        self._task = self.bar.add_task(title, total=None, state="")
        self._title = title
        self._started, self._total, self._done, self._left = time.monotonic(), 0, 0, ""
        self.bugs: list[Any] = []

    def start(self, number: int) -> None:
        """Show how many results will come."""
        self._total = number
        self.bar.update(self._task, total=number, state=f"0 of {number}")

    def collect(self, result: Any) -> None:
        """Keep a bug."""
        if getattr(result, "traceback", ""):  # a chunk of a sweep has none
            self.bugs.append(result)

    def result(self, result: Any) -> None:
        """Count a result."""
        self.collect(result)
        self._done += 1
        if self._total:
            self.share(self._done / self._total, f"{self._done} of {self._total}, ")

    def share(self, share: float, counted: str = "") -> None:
        """Show the part of the work that is done, 0 to 1, and the time left."""
        seconds = (time.monotonic() - self._started) * (1 / share - 1)
        self._left = (
            f"{10 * round(seconds / 10):d} s" if seconds < 95 else f"{round(seconds / 60):d} min"
        ) + " left"
        total = self._total or 1.0
        self.bar.update(
            self._task, total=total, completed=share * total, state=counted + self._left
        )

    def line(self) -> str:
        """How far it is: ``"sweep of sled: 120 of 480, 3 min left, after 60 s"``."""
        counted = f"{self._done} of {self._total}" if self._total else ""
        known = ", ".join(filter(None, (counted, self._left)))
        return (
            f"{self._title}: "
            + (f"{known}, " if known else "")
            + f"after {time.monotonic() - self._started:.0f} s"
        )

    def study(self, study: Study, results: Results) -> None:
        """Print the answer of a study that is done, on one line; without a terminal the time left stands at its end."""
        from stiction.reports.text import section_of

        if answer := section_of(study, results).answer:
            remaining = f" ({self._left})" if self.bar.disable and self._left else ""
            line = f"{study.title}: {answer}{remaining}"
            self._console.print(line, markup=False, highlight=False, soft_wrap=True)


@contextmanager
def progress(title: str) -> Iterator[Progress]:
    """Show the progress of some work, and then the tracebacks of its bugs."""
    shown = Progress(title)
    with shown.bar, _regularly(lambda: say(shown.line())) if shown.bar.disable else nullcontext():
        yield shown
    for result in shown.bugs:
        say(f"{result.label} ended with a bug:\n{result.traceback}")


@contextmanager
def _regularly(tell: Callable[[], None]) -> Iterator[None]:
    """Call a function every `SILENCE_S` seconds, in a thread, for the time of the block."""
    over = threading.Event()

    def serve() -> None:
        while not over.wait(SILENCE_S):
            with suppress(OSError, ValueError):  # of a standard error that is closed
                tell()

    thread = threading.Thread(target=serve, daemon=True, name="stiction-progress")
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def announce(words: str) -> None:
    """Say what is waited for, if somebody sits at a terminal."""
    if sys.stderr.isatty():
        say(f"{words} ..")


def show(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table, in which no number is cut; nothing of one without rows.

    On a terminal words are wrapped to its width; where numbers do not fit in it, each row is a paragraph. Without a
    terminal columns are aligned, one line per row.
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
        longest, head = max(map(len, cells)), _longest_word([name])
        whole = longest <= UNBROKEN
        least += _GAP + (
            max(longest, head) if whole else min(max(head, _longest_word(cells)), UNBROKEN)
        )
        heading = textwrap.fill(name, max(longest, 1), break_long_words=False) if whole else name
        table.add_column(heading, no_wrap=whole, overflow="fold")
    if least > console.width:
        for first, *others in rows:
            print(f"{columns[0]}: {first}")
            print(
                "".join(f"    {name}: {text}\n" for name, text in zip(columns[1:], others) if text)
            )
        return
    for row in rows:
        table.add_row(*row)
    console.print(table)


def _longest_word(texts: Iterable[str]) -> int:
    return max((len(word) for text in texts for word in text.split()), default=0)


def show_table(table: pd.DataFrame) -> None:
    """Print all of a table, numbers rounded by what their column is."""
    from stiction.comparisons.bench.presentation.cells import MISSING, cell
    from stiction.comparisons.bench.quantities import quantity_of

    quantities = {name: quantity_of(str(name)) for name in table}
    rows = [
        [cell(quantities[name], value) for name, value in row.items()]
        for row in table.to_dict("records")
    ]
    show([quantity.head for quantity in quantities.values()], rows)
    if any(MISSING in row for row in rows):
        print(f"{MISSING}: no value")


def show_truths(table: pd.DataFrame) -> None:
    """Print what errors are measured against, where that is not independent of us or has a note."""
    from stiction.comparisons.measures.scene_truth import OWN_RTOL
    from stiction.truths.truth import Tier

    for (tier, note), _ in (
        table.groupby(["truth_tier", "truth_note"]) if "truth_note" in table else ()
    ):
        own = (
            f"errors are against our own run at rtol {OWN_RTOL:g} (not independent)"
            if tier == Tier.OWN_RUN
            else ""
        )
        if words := "; ".join(filter(None, (own, note))):
            print(f"truth, {Tier(tier).label}: {words}")


def show_trajectory(trajectory: Trajectory) -> None:
    """Print settings, end state, efforts, drift, events and cost."""
    from stiction.scenes.run_summary import more_events, run_tables, run_title

    print(run_title(trajectory))
    if len(trajectory.t) < 2:
        return
    show(("setting", "value"), [(key, str(value)) for key, value in trajectory.settings.items()])
    for heads, rows in run_tables(trajectory):
        show(heads, rows)
    if more := more_events(trajectory):
        print(more)
    cost = trajectory.cost
    times = (
        f"{cost.setup_s:.3g} s set-up, {cost.compile_s:.3g} s compiling or loading kernels, "
        f"{cost.stepping_s:.3g} s stepping, {cost.own_s:.3g} s of it in the engine itself, "
        f"{cost.output_s:.3g} s output, {cost.gate_s:.3g} s examination of the result"
    )
    counts = ", ".join(f"{name} {count}" for name, count in cost.counters.items())
    print("CPU: " + "; ".join(filter(None, (times, counts))))


def show_summary(report: Report) -> None:
    """Print the answers of page one, a line each."""
    from stiction.reports.page_one import answer_lines

    if taken_over := report.results.settings["runs taken over"]:
        print(f"{taken_over} runs were taken over from an earlier call.")
    for line in answer_lines(report):
        print(line)


def print_or_write(text: str, out: Path | None) -> None:
    """Print a text, or write it to a file and print the name of that."""
    from stiction.scenes.atomic_files import write_text

    if out is None:
        print(text, end="")
    else:
        write_text(out, text)
        print(out)


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV or Parquet, whole or not at all."""
    from stiction.scenes.atomic_files import whole_file

    with whole_file(path) as partial:
        if path.suffix.lower() == ".csv":
            table.to_csv(partial, index=False)
        else:
            table.to_parquet(partial, index=False)


@contextmanager
def or_shown(shown: Callable[[], None]) -> Iterator[None]:
    """Show a result that cannot be written, so that it is not in vain."""
    from stiction.scenes import StictionError

    try:
        yield
    except StictionError:
        shown()
        raise
