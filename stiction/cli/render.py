"""Output of commands: results on standard output, progress on standard error, and tables in files."""

from __future__ import annotations

import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.cli.exit_codes import say

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from stiction.comparisons.bench.results import Results
    from stiction.comparisons.bench.study import Study
    from stiction.reports.report import Report
    from stiction.scenes import Trajectory

EVENTS_SHOWN = 20
"""Largest number of lines of a list that may be long: events, reasons, components."""
UNBROKEN = 18
"""Width up to which a cell is never broken into lines, characters: it is enough for a number with its uncertainty."""
SILENCE_S = 60.0
"""Time between two lines about the progress, if standard error is not a terminal, s."""
SECONDS_SHOWN = 95
"""Remaining times below this one are shown in seconds, s; others in minutes."""
_GAP = 3
"""Number of characters between two columns on a terminal."""


class Progress:
    """The progress of some work: a bar on a terminal, or else a line every `SILENCE_S` seconds.

    Runs that end with a bug are collected, and `progress` prints their tracebacks at the end.
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
        self._start_time = time.monotonic()
        self._total = 0
        self._done = 0
        self._remaining = ""
        self.bugs: list[Any] = []

    def start(self, number: int) -> None:
        """Set the number of results that will come."""
        self._total = number
        self.bar.update(self._task, total=number, state=f"0 of {number}")

    def collect(self, result: Any) -> None:
        """Store a result that has a traceback."""
        # Some results, such as those of a part of a sweep, do not have this attribute.
        if getattr(result, "traceback", ""):
            self.bugs.append(result)

    def result(self, result: Any) -> None:
        """Count a result."""
        self.collect(result)
        self._done += 1
        if self._total:
            self.share(self._done / self._total, f"{self._done} of {self._total}, ")

    def share(self, share: float, count: str = "") -> None:
        """Show the fraction of the work that is done, above 0 and up to 1, and the remaining time."""
        seconds = (time.monotonic() - self._start_time) * (1 / share - 1)
        if seconds < SECONDS_SHOWN:
            self._remaining = f"{10 * round(seconds / 10):d} s left"
        else:
            self._remaining = f"{round(seconds / 60):d} min left"
        total = self._total or 1.0
        self.bar.update(
            self._task, total=total, completed=share * total, state=count + self._remaining
        )

    def line(self) -> str:
        """Return the progress as text: ``sweep of sled: 120 of 480, 3 min left, after 60 s``."""
        parts = []
        if self._total:
            parts.append(f"{self._done} of {self._total}")
        if self._remaining:
            parts.append(self._remaining)
        parts.append(f"after {time.monotonic() - self._start_time:.0f} s")
        return f"{self._title}: {', '.join(parts)}"

    def study(self, study: Study, results: Results) -> None:
        """Print the answer of a study on one line, with the remaining time unless the bar shows it."""
        from stiction.reports.text import section_of

        answer = section_of(study, results).answer
        if not answer:
            return
        remaining = f" ({self._remaining})" if self.bar.disable and self._remaining else ""
        line = f"{study.title}: {answer}{remaining}"
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)


@contextmanager
def progress(title: str) -> Iterator[Progress]:
    """Show the progress of the work in the block, and print the tracebacks of its bugs at the end."""
    shown = Progress(title)
    with ExitStack() as stack:
        stack.enter_context(shown.bar)
        if shown.bar.disable:
            stack.enter_context(_call_regularly(lambda: say(shown.line())))
        yield shown
    for result in shown.bugs:
        say(f"{result.label} ended with a bug:\n{result.traceback}")


@contextmanager
def _call_regularly(function: Callable[[], None]) -> Iterator[None]:
    """Call a function every `SILENCE_S` seconds, in a thread, until the end of the block."""
    is_over = threading.Event()

    def call_until_over() -> None:
        while not is_over.wait(SILENCE_S):
            # Standard error may be closed.
            with suppress(OSError, ValueError):
                function()

    thread = threading.Thread(target=call_until_over, daemon=True, name="stiction-progress")
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


def announce(message: str) -> None:
    """Print what the command is waiting for, if standard error is a terminal."""
    if sys.stderr.isatty():
        say(f"{message} ..")


def show(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table of text cells, or nothing if it has no rows. Numbers are never cut.

    On a terminal, long texts are broken into lines to fit its width. If that does not suffice, each row is
    printed as a paragraph. Otherwise each row is a line.
    """
    rows = list(rows)
    if not rows:
        return
    if not sys.stdout.isatty():
        _print_lines(columns, rows)
        return
    from rich.console import Console

    console = Console(markup=False, highlight=False)
    if _smallest_width(columns, rows) > console.width:
        _print_paragraphs(columns, rows)
    else:
        _print_on_terminal(console, columns, rows)


def _print_lines(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table with one line for each row, and an empty line below it."""
    widths = [max(map(len, cells)) for cells in zip(columns, *rows)]
    for row in (columns, *rows):
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip())
    print()


def _print_paragraphs(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print each row of a table as a paragraph, with one line for each cell that is not empty."""
    for first, *others in rows:
        print(f"{columns[0]}: {first}")
        for name, text in zip(columns[1:], others):
            if text:
                print(f"    {name}: {text}")
        print()


def _print_on_terminal(
    console: Console, columns: Sequence[str], rows: Sequence[Sequence[str]]
) -> None:
    """Print a table with long texts broken into lines to fit the width of a terminal."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    for name, *cells in zip(columns, *rows):
        longest = max(map(len, cells))
        is_unbroken = longest <= UNBROKEN
        heading = name
        if is_unbroken:
            # The heading is broken instead, so that it does not widen the column.
            heading = textwrap.fill(name, max(longest, 1), break_long_words=False)
        table.add_column(heading, no_wrap=is_unbroken, overflow="fold")
    for row in rows:
        table.add_row(*row)
    console.print(table)


def _smallest_width(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> int:
    """Return the number of characters that a table takes if all long texts are broken into lines."""
    width = 0
    for name, *cells in zip(columns, *rows):
        longest = max(map(len, cells))
        longest_of_heading = _longest_word([name])
        if longest <= UNBROKEN:
            column_width = max(longest, longest_of_heading)
        else:
            column_width = min(max(longest_of_heading, _longest_word(cells)), UNBROKEN)
        width += _GAP + column_width
    return width


def _longest_word(texts: Iterable[str]) -> int:
    """Return the length of the longest word in some texts."""
    return max((len(word) for text in texts for word in text.split()), default=0)


def show_table(table: pd.DataFrame) -> None:
    """Print all rows of a table; the quantity of a column determines its number format."""
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
    """Print a line about each truth of a table that is a run of the reference or has a note."""
    from stiction.comparisons.measures.scene_truth import OWN_RTOL
    from stiction.truths.truth import Tier

    if "truth_note" not in table:
        return
    for (tier, note), _ in table.groupby(["truth_tier", "truth_note"]):
        remarks = []
        if tier == Tier.OWN_RUN:
            remarks.append(f"errors are against our own run at rtol {OWN_RTOL:g} (not independent)")
        if note:
            remarks.append(note)
        if remarks:
            print(f"truth, {Tier(tier).label}: {'; '.join(remarks)}")


def show_trajectory(trajectory: Trajectory) -> None:
    """Print settings, final state, efforts, drift, events and cost of a run."""
    from stiction.scenes.run_summary import more_events, run_tables, run_title

    print(run_title(trajectory))
    if len(trajectory.t) < 2:
        return
    show(("setting", "value"), [(key, str(value)) for key, value in trajectory.settings.items()])
    for heads, rows in run_tables(trajectory):
        show(heads, rows)
    remark = more_events(trajectory)
    if remark:
        print(remark)
    cost = trajectory.cost
    times = (
        f"{cost.setup_s:.3g} s set-up, {cost.compile_s:.3g} s compiling or loading kernels, "
        f"{cost.stepping_s:.3g} s stepping, {cost.own_s:.3g} s of it in the engine itself, "
        f"{cost.output_s:.3g} s output, {cost.gate_s:.3g} s examination of the result"
    )
    counts = ", ".join(f"{name} {count}" for name, count in cost.counters.items())
    print(f"CPU: {times}; {counts}" if counts else f"CPU: {times}")


def show_summary(report: Report) -> None:
    """Print the recommendation and the answers of page one, a line each."""
    from stiction.reports.page_one import answer_lines

    taken_over = report.results.settings["runs taken over"]
    if taken_over:
        print(f"{taken_over} runs were taken over from an earlier call.")
    for line in answer_lines(report):
        print(line)


def print_or_write(text: str, out: Path | None) -> None:
    """Print a text, or write it to a file and print the name of the file."""
    from stiction.scenes.atomic_files import write_text

    if out is None:
        print(text, end="")
    else:
        write_text(out, text)
        print(out)


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV or Parquet, by the ending of the file, completely or not at all."""
    from stiction.scenes.atomic_files import whole_file

    with whole_file(path) as partial:
        if path.suffix.lower() == ".csv":
            table.to_csv(partial, index=False)
        else:
            table.to_parquet(partial, index=False)


@contextmanager
def shown_if_not_written(show_result: Callable[[], None]) -> Iterator[None]:
    """Print a result if the block fails to write it, so that it is not lost."""
    from stiction.scenes import StictionError

    try:
        yield
    except StictionError:
        show_result()
        raise
