"""From a row of a table of the report to where it comes from: rows of the data, trajectories, settings, versions.

Each row of a table has a key, the name of the table and the number of the row, from 1: ``torque:3`` is the third row
of the table ``torque`` of the report. A row may sum up several rows of the data.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import count, groupby

import pandas as pd

from stiction.comparisons.bench.presentation import TableView
from stiction.comparisons.bench.presentation.cells import TRAJECTORY
from stiction.reports.run_folder.data import truth_file
from stiction.reports.run_folder.provenance import commit_in_words
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.scenes import InputError
from stiction.scenes.wording import did_you_mean


@dataclass(frozen=True)
class Source:
    """The rows and files that a key leads to."""

    table: str
    """Its name in the data, without folder and ending"""
    rows: pd.DataFrame
    """In full precision, by their numbers"""
    files: tuple[str, ...]
    """Trajectories and truths behind the rows, relative to the run folder; none where no run is kept"""

    @property
    def place(self) -> str:
        """``data/torque.csv, rows 16-30, 45``."""
        return f"data/{self.table}.csv, row{'s' if len(self.rows) > 1 else ''} {ranges(self.rows.index)}"


def ranges(numbers: Iterable[int]) -> str:
    """Write whole numbers in ascending order, neighbours as a range: ``16-30, 45``."""
    place = count()
    runs = [
        list(group)
        for _, group in groupby(sorted(numbers), key=lambda number: number - next(place))
    ]
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def keys(view: TableView) -> list[str]:
    """Return the key of each row of a table."""
    return [f"{view.name}:{number}" for number in range(1, len(view.rows) + 1)]


def source_of(run: StoredRun, view: TableView, number: int) -> Source:
    """Return what is behind a row of a table of the report, by its number from 1."""
    return _rows_of(run, view.source, sorted(view.rows[number - 1]))


def sources_of(run: StoredRun, view: TableView) -> Iterator[tuple[str, Source]]:
    """Yield the key of each row of a table of the report, and what is behind the row."""
    for number, key in enumerate(keys(view), start=1):
        yield key, source_of(run, view, number)


def _rows_of(run: StoredRun, name: str, numbers: list[int]) -> Source:
    """Rows of a table of the data, by their numbers from 1."""
    table = run.tables[name]
    rows = table.iloc[[number - 1 for number in numbers]].set_axis(numbers)
    files = list(rows[TRAJECTORY].dropna()) if TRAJECTORY in rows else []
    truths = rows["truth"].dropna().map(truth_file) if "truth" in rows else []
    files += [file for file in truths if (run.folder / file).is_file()]
    return Source(name, rows, tuple(dict.fromkeys(files)))


def resolve(run: StoredRun, views: Iterable[TableView], key: str) -> Source:
    """Find what `key` leads to, with the tables of the report of `run`.

    A key of a table of the data that the report does not show leads to the row of the data.

    Raises
    ------
    InputError
        For a key that leads nowhere; the message says what would.
    """
    by_name = {view.name: view for view in views}
    sizes = {name: len(table) for name, table in run.tables.items()}
    sizes |= {name: len(view.rows) for name, view in by_name.items()}
    name, _, number = key.strip().rpartition(":")
    if name not in sizes or not number.isascii() or not number.isdigit():
        raise InputError(
            f"key: found {key!r}; expected the name of a table and the number of a row, such as "
            f"accuracy:12{did_you_mean(name, sizes)}; tables of this run: {', '.join(sizes)}"
        )
    if not 1 <= int(number) <= sizes[name]:
        raise InputError(f"key: found {key!r}; the table {name} has rows 1 to {sizes[name]}")
    if name in by_name:
        return source_of(run, by_name[name], int(number))
    return _rows_of(run, name, [int(number)])


def described(run: StoredRun, source: Source) -> Iterator[tuple[str, str]]:
    """Yield all of it, as (what, value): rows, files, settings, versions, machine, commit; equal values once."""
    yield "data", source.place
    yield from (("file", file) for file in source.files)
    for name, values in source.rows.dropna(axis="columns", how="all").items():
        texts = list(map(str, values))
        texts = texts[:1] if len(set(texts)) == 1 else texts
        if name == "settings" and len(texts) == 1:
            yield from (
                (f"setting {key}", json.dumps(value, ensure_ascii=False))
                for key, value in json.loads(texts[0]).items()
            )
        elif name != TRAJECTORY:
            yield str(name), "; ".join(texts)
    origin = run.origin
    yield "date", origin["date"]
    yield "versions", ", ".join(f"{name} {version}" for name, version in origin["versions"].items())
    yield "commit", commit_in_words(origin)
    yield "machine", ", ".join(f"{name}: {value}" for name, value in origin["machine"].items())
