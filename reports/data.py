"""The data of a run folder, in full precision: tables as CSV and Parquet, a Parquet file per trajectory, all events."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import pandas as pd
import pyarrow as pa

from comparisons.problems import write_problems
from comparisons.validation import Validation
from comparisons.variants import Record

TRAJECTORY = "trajectory"
"""Column that leads from a row to the file of its trajectory, relative to the run folder."""


def data_tables(validation: Validation) -> dict[str, pd.DataFrame]:
    """The tables of the validation and ``runs`` (every run), with `TRAJECTORY` beside the key."""
    files = trajectory_files(validation.records)
    runs = pd.DataFrame([{**record.describe(), "wall [s]": record.outcome.wall_s} for record in validation.records])
    tables = {"runs": runs, **validation.tables}
    return {name: table.assign(**{TRAJECTORY: table["key"].map(files)}) if "key" in table else table
            for name, table in tables.items()}


def trajectory_files(records: Iterable[Record]) -> dict[str, str]:
    """By key of a run, the file of its trajectory relative to the run folder; runs without one are left out.

    Names keep letters, digits and ``. = + -`` of the key; where two keys would share a name (upper and lower case are
    the same to some file systems), later ones are numbered.
    """
    files: dict[str, str] = {}
    taken: set[str] = set()
    for record in records:
        if record.trajectory is None or record.key in files:
            continue
        stem = re.sub(r"[^A-Za-z0-9.=+-]+", "_", record.key)[:200]
        name, number = stem, 1
        while name.casefold() in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name.casefold())
        files[record.key] = f"data/trajectories/{name}.parquet"
    return files


def write_data(validation: Validation, folder: Path) -> None:
    """Write ``data/`` of a run folder.

    Trajectories hold two more rows per event, the values before and after it. ``events.parquet`` holds all events of
    all runs with their two-sided values, ``key`` first. ``hard-problems.parquet``: see `comparisons.problems`.
    """
    (folder / "data" / "trajectories").mkdir(parents=True)
    for name, table in data_tables(validation).items():
        stored = storable(table)
        stored.to_csv(folder / "data" / f"{name}.csv", index=False)
        stored.to_parquet(folder / "data" / f"{name}.parquet", index=False)
    if validation.problems:
        write_problems(validation.problems, folder / "data" / "hard-problems.parquet")
    files = trajectory_files(validation.records)
    events = []
    for record in validation.records:
        if record.key in files:
            record.trajectory.to_frame(events=True).to_parquet(folder / files.pop(record.key), index=False)
            if record.trajectory.events:
                events.append(record.trajectory.events_frame().assign(key=record.key))
    columns = ["key", "t", "kind", "joint"]
    everything = pd.concat(events, ignore_index=True) if events else pd.DataFrame(columns=columns)
    sides = [column for column in everything if column not in columns]
    everything[[*columns, *sides]].to_parquet(folder / "data" / "events.parquet", index=False)


def storable(table: pd.DataFrame) -> pd.DataFrame:
    """The table with every column of one type: what mixes numbers and words, or holds structures, becomes text."""
    columns = {}
    for name, column in table.items():
        try:
            pa.array(column, from_pandas=True)
            columns[str(name)] = column
        except (pa.ArrowInvalid, pa.ArrowTypeError, pa.ArrowNotImplementedError):
            columns[str(name)] = column.map(str, na_action="ignore")
    return pd.DataFrame(columns, index=table.index)
