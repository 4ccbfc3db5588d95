"""From a number in a table to where it comes from: key, row of the data, trajectory, settings, versions.

A key is a letter for the table of the data, and the numbers of the rows: ``A12`` is row 12 (from 1, the heading not
counted) of ``data/accuracy.csv``; ``J16-30,45`` are the rows of ``data/torque.csv`` that one number summarizes. A table
without a letter stands with its name: ``toy:3``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import count, groupby

import numpy as np
import pandas as pd

from stiction.comparisons.bench.presentation import TableView
from stiction.comparisons.bench.presentation.cells import TRAJECTORY
from stiction.reports.run_folder.data import truth_file
from stiction.reports.run_folder.provenance import commit_in_words
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.scenes import InputError

LETTERS = {
    "accuracy": "A",
    "claims": "P",
    "cost": "C",
    "drift": "D",
    "effects": "E",
    "equal-error": "Q",
    "hard": "H",
    "hold": "F",
    "octaves": "B",
    "orders": "N",
    "parameters": "M",
    "runs": "R",
    "sensitivity": "O",
    "settings": "G",
    "study": "L",
    "suppression": "S",
    "threshold": "T",
    "torque": "J",
    "variants": "V",
}
_KEY = re.compile(r"(?:([A-Z])|([\w-]+):)(\d+(?:-\d+(?:/[1-9]\d*)?)?(?:,\d+(?:-\d+)?)*)")


@dataclass(frozen=True)
class Source:
    """The rows and files that a key leads to."""

    table: str
    """Its name in the data, without folder and ending"""
    numbers: str
    """Its rows as in the key: ``16-30,45``"""
    rows: pd.DataFrame
    """In full precision, by their numbers"""
    files: tuple[str, ...]
    """Trajectories and truths behind the rows, relative to the run folder; none where no run is kept"""

    @property
    def place(self) -> str:
        """``data/torque.csv, row 16-30,45``."""
        return f"data/{self.table}.csv, row {self.numbers}"


def keys(view: TableView) -> list[str]:
    """Return the key of each row of a table."""
    return [key_of(view.source, rows) for rows in view.rows]


def key_of(table: str, rows: Iterable[int]) -> str:
    """Return the key of rows from 1 of a table: ``A7``, ``A7,105``, ``J16-30``; every 17th row as ``H3-887/17``."""
    numbers = sorted(set(rows))
    letter = LETTERS.get(table) or f"{table}:"
    steps = set(np.diff(numbers))
    if len(steps) == 1 and len(numbers) > 2 and steps != {1}:
        return f"{letter}{numbers[0]}-{numbers[-1]}/{steps.pop()}"
    place = count()
    runs = [list(group) for _, group in groupby(numbers, key=lambda number: number - next(place))]
    return letter + ",".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)


def resolve(run: StoredRun, key: str) -> Source:
    """Find what `key` leads to in `run`; InputError for a key that leads nowhere says what would."""
    match = _KEY.fullmatch(key.strip())
    names = {letter: name for name, letter in LETTERS.items() if name in run.tables}
    name = (names.get(match[1]) if match[1] else match[2]) if match else None
    if match is None or name is None or name not in run.tables:
        letters = ", ".join(f"{letter} ({name})" for letter, name in names.items())
        raise InputError(
            f"key: found {key!r}; expected a letter and rows, such as A12 or J16-30,45, or the name of a "
            f"table, such as accuracy:12; letters of this run: {letters}"
        )
    table, numbers = run.tables[name], list[int]()
    for first, last, step in re.findall(r"(\d+)(?:-(\d+))?(?:/(\d+))?", match[3]):
        numbers += range(int(first), int(last or first) + 1, int(step or 1))
    if not numbers or min(numbers) < 1 or max(numbers) > len(table):
        raise InputError(f"key: found {key!r}; data/{name}.csv has rows 1 to {len(table)}")
    rows = table.iloc[[number - 1 for number in numbers]].set_axis(numbers)
    files = list(rows[TRAJECTORY].dropna()) if TRAJECTORY in rows else []
    truths = rows["truth"].dropna().map(truth_file) if "truth" in rows else []
    files += [file for file in truths if (run.folder / file).is_file()]
    return Source(name, match[3], rows, tuple(dict.fromkeys(files)))


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
