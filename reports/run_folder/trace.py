"""Origin of the rows in the tables of a report: rows of the data, trajectories, settings, versions.

Each row of a table has a key, which consists of the name of the table and the number of the row, from 1:
``torque:3`` is the third row of the table ``torque``. A row may summarize several rows of the data.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

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
    """The data from which a row of a report was computed.

    Attributes
    ----------
    table : str
        Name of the table in the data, without folder and ending.
    rows : DataFrame
        Its rows in full precision; the index contains their numbers, from 1.
    files : tuple of str
        Files of trajectories and truths, relative to the run folder; empty if they are not stored.
    """

    table: str
    rows: pd.DataFrame
    files: tuple[str, ...]

    @property
    def place(self) -> str:
        """File and numbers of the rows: ``data/torque.csv, rows 16-30, 45``."""
        word = "rows" if len(self.rows) > 1 else "row"
        return f"data/{self.table}.csv, {word} {ranges(self.rows.index)}"


def ranges(numbers: Iterable[int]) -> str:
    """Return whole numbers in ascending order as text, consecutive ones as a range: ``16-30, 45``."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def keys(view: TableView) -> list[str]:
    """Return the key of each row of a table."""
    return [f"{view.name}:{number}" for number in range(1, len(view.rows) + 1)]


def source_of(run: StoredRun, view: TableView, number: int) -> Source:
    """Return the source of a row of a table in the report, by the number of the row, from 1."""
    return _source_in_data(run, view.source, sorted(view.rows[number - 1]))


def sources_of(run: StoredRun, view: TableView) -> Iterator[tuple[str, Source]]:
    """Yield the key and the source of each row of a table in the report."""
    for number, key in enumerate(keys(view), start=1):
        yield key, source_of(run, view, number)


def _source_in_data(run: StoredRun, name: str, numbers: list[int]) -> Source:
    """Return the source that consists of rows of a table in the data, by their numbers, from 1."""
    table = run.tables[name]
    rows = table.iloc[[number - 1 for number in numbers]].set_axis(numbers)
    files: list[str] = []
    if TRAJECTORY in rows:
        files.extend(rows[TRAJECTORY].dropna())
    if "truth" in rows:
        # Not all truths that tables name are stored.
        truths = rows["truth"].dropna().map(truth_file)
        files.extend(file for file in truths if (run.folder / file).is_file())
    return Source(name, rows, tuple(dict.fromkeys(files)))


def resolve(run: StoredRun, views: Iterable[TableView], key: str) -> Source:
    """Return the source of the row with a key.

    Parameters
    ----------
    run : StoredRun
        The run.
    views : iterable of TableView
        The tables of its report.
    key : str
        Key of a row of these tables, or of a table in the data that the report does not show.

    Raises
    ------
    InputError
        If there is no such row.
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
    return _source_in_data(run, name, [int(number)])


def describe_source(run: StoredRun, source: Source) -> Iterator[tuple[str, str]]:
    """Yield (name, value) for everything that is known about a source.

    These are the place, files, columns and settings of its rows, and date, versions, commit and machine
    of the run. A column with the same value in all rows is given by this value.
    """
    yield "data", source.place
    for file in source.files:
        yield "file", file
    for name, values in source.rows.dropna(axis="columns", how="all").items():
        texts = [str(value) for value in values]
        if len(set(texts)) == 1:
            texts = texts[:1]
        if name == "settings" and len(texts) == 1:
            for key, value in json.loads(texts[0]).items():
                yield f"setting {key}", json.dumps(value, ensure_ascii=False)
        elif name != TRAJECTORY:
            yield str(name), "; ".join(texts)
    origin = run.origin
    yield "date", origin["date"]
    yield "versions", ", ".join(f"{name} {version}" for name, version in origin["versions"].items())
    yield "commit", commit_in_words(origin)
    yield "machine", ", ".join(f"{name}: {value}" for name, value in origin["machine"].items())
