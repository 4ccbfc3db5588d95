"""From a number in a table to where it comes from: key, row of the data, trajectory, settings, versions.

A key is a letter for the table of the data, and the numbers of the rows: ``A12`` is row 12 (from 1, the heading not counted) of
``data/accuracy.csv``; ``J16-30`` are the rows of ``data/torque.csv`` that one number summarizes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import pandas as pd

from stiction.comparisons.presentation.cells import TRAJECTORY
from stiction.reports.run_folder.data import truth_file
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.scenes import InputError

LETTERS = {"accuracy": "A", "claims": "P", "cost": "C", "drift": "D", "effects": "E", "equal-error": "Q", "hard": "H", "octaves": "B", "orders": "N", "parameters": "M", "runs": "R",
           "sensitivity": "O", "settings": "G", "study": "L", "suppression": "S", "threshold": "T", "torque": "J", "variants": "V"}
_KEY = re.compile(r"([A-Z])(\d+)(?:-(\d+))?")


@dataclass(frozen=True)
class Source:
    """What a key leads to.

    Attributes
    ----------
    table : str
        Of the data, without folder and ending.
    rows : DataFrame
        Its rows in full precision, by their numbers.
    files : tuple of str
        Trajectories and truths behind the rows, relative to the run folder; none where no run is (a claim, a parameter) and where a
        row sums up runs that are not kept (a threshold).
    """

    key: str
    table: str
    rows: pd.DataFrame
    files: tuple[str, ...]


def key_of(table: str, rows: Iterable[int]) -> str:
    """The key of rows of a table of the data, by their numbers from 1; they must follow each other."""
    numbers = sorted(rows)
    if numbers != list(range(numbers[0], numbers[-1] + 1)):
        raise ValueError(f"{table}: found rows {numbers}; expected rows that follow each other")
    return f"{LETTERS[table]}{numbers[0]}" + (f"-{numbers[-1]}" if len(numbers) > 1 else "")


def resolve(run: StoredRun, key: str) -> Source:
    """What `key` leads to in `run`.

    Raises
    ------
    InputError
        For a key that leads nowhere, saying what would.
    """
    match = _KEY.fullmatch(key.strip())
    names = {letter: name for name, letter in LETTERS.items() if name in run.tables}
    if not match or match[1] not in names:
        letters = ", ".join(f"{letter} ({name})" for letter, name in names.items())
        raise InputError(f"key: found {key!r}; expected a letter and a row, such as A12 or J16-30; letters of this run: {letters}")
    name = names[match[1]]
    table, first, last = run.tables[name], int(match[2]), int(match[3] or match[2])
    if not 1 <= first <= last <= len(table):
        raise InputError(f"key: found {key!r}; data/{name}.csv has rows 1 to {len(table)}")
    rows = table.iloc[first - 1:last].set_axis(range(first, last + 1))
    files = list(rows[TRAJECTORY].dropna()) if TRAJECTORY in rows else []
    truths = rows["truth"].dropna().map(truth_file) if "truth" in rows else []
    files += [file for file in truths if (run.folder / file).is_file()]
    return Source(key, name, rows, tuple(dict.fromkeys(files)))


def told(run: StoredRun, source: Source) -> Iterator[tuple[str, str]]:
    """All of it, as (what, value): rows, files, settings, versions, machine, commit; what is the same in all rows once."""
    numbers = f"row {source.rows.index[0]}" + (f" to {source.rows.index[-1]}" if len(source.rows) > 1 else "")
    yield "data", f"data/{source.table}.csv, {numbers}"
    yield from (("file", file) for file in source.files)
    for name, values in source.rows.dropna(axis="columns", how="all").items():
        texts = [str(value) for value in values]
        if len(set(texts)) == 1:
            texts = texts[:1]
        if name == "settings" and len(texts) == 1:
            yield from ((f"setting {key}", json.dumps(value, ensure_ascii=False)) for key, value in json.loads(texts[0]).items())
        elif name != TRAJECTORY:
            yield str(name), "; ".join(texts)
    origin = run.origin
    commit = origin["commit"]
    yield "date", origin["date"]
    yield "versions", ", ".join(f"{name} {version}" for name, version in origin["versions"].items())
    yield "commit", "not in a checkout" if commit is None else commit["hash"] + (" with uncommitted changes" if commit["dirty"] else "")
    yield "machine", ", ".join(f"{name}: {value}" for name, value in origin["machine"].items())
