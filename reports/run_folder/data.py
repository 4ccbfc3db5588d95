"""The data of a run folder, in full precision: tables as CSV and Parquet, a Parquet file per trajectory, all events.

`stiction.reports.run_folder.stored_run` reads it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd
import pyarrow as pa

from stiction.comparisons.campaigns.validation import Validation
from stiction.comparisons.complementarity.problems import write_problems
from stiction.comparisons.truth import Truth
from stiction.comparisons.variants import Record
from stiction.reports.run_folder.settings import scene_parameters, variant_settings
from stiction.scenes.trajectory import events_frame

TRAJECTORY = "trajectory"
"""Column that leads from a row to the file of its trajectory, relative to the run folder."""
TRUTH = "truth/"
"""Begins the key of a truth, before its name, in ``events.parquet``."""
SAMPLES = 2401
"""Of a truth, over the whole of its time: every 10 ms of 24 s."""


def data_tables(validation: Validation) -> dict[str, pd.DataFrame]:
    """The tables of the validation, ``runs`` (every run), ``variants`` and ``parameters``; `TRAJECTORY` beside the key."""
    files = trajectory_files((*validation.records, *validation.timed))
    runs = pd.DataFrame([{**record.describe(), "wall [s]": record.outcome.wall_s} for record in validation.records])
    tables = {"runs": runs, "variants": variant_settings(validation), "parameters": scene_parameters(validation), **validation.tables}
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


def write_data(validation: Validation, folder: Path, others: Mapping[str, pd.DataFrame] = MappingProxyType({})) -> None:
    """Write ``data/`` of a run folder: `data_tables` and others.

    Trajectories hold two more rows per event, the values before and after it. ``events.parquet`` holds all events of
    all runs and truths with their two-sided values, ``key`` first. A truth is a file in ``data/truths``.
    ``hard-problems.parquet``: see `stiction.comparisons.complementarity.problems`.
    """
    (folder / "data" / "trajectories").mkdir(parents=True)
    (folder / "data" / "truths").mkdir()
    for name, table in {**data_tables(validation), **others}.items():
        stored = storable(table)
        stored.to_csv(folder / "data" / f"{name}.csv", index=False)
        stored.to_parquet(folder / "data" / f"{name}.parquet", index=False)
    if validation.problems:
        write_problems(validation.problems, folder / "data" / "hard-problems.parquet")
    everything = (*validation.records, *validation.timed)
    files = trajectory_files(everything)
    events = []
    for record in everything:
        if record.key in files:
            record.trajectory.to_frame(events=True).to_parquet(folder / files.pop(record.key), index=False)
            if record.trajectory.events:
                events.append(events_frame(record.trajectory.events).assign(key=record.key))
    for name, truth in validation.truths.items():
        truth_frame(truth).assign(tier=truth.tier).to_parquet(folder / truth_file(name), index=False)
        if truth.events:
            events.append(events_frame(truth.events).assign(key=TRUTH + name))
    columns = ["key", "t", "kind", "joint"]
    told = pd.concat(events, ignore_index=True) if events else pd.DataFrame(columns=columns)
    sides = [column for column in told if column not in columns]
    told[[*columns, *sides]].to_parquet(folder / "data" / "events.parquet", index=False)


def truth_file(name: str) -> str:
    """The file of a truth, relative to the run folder."""
    return f"data/truths/{name}.parquet"


def truth_frame(truth: Truth) -> pd.DataFrame:
    """`SAMPLES` rows, and two more per event: the values before and after it."""
    t = np.linspace(0.0, truth.t_end, SAMPLES)
    sides = [{"t": event.time, **side} for event in truth.events for side in (event.before, event.after)]
    frame = pd.concat([pd.DataFrame({"t": t, **truth(t)}), pd.DataFrame(sides)])
    return frame.sort_values("t", kind="stable", ignore_index=True)


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
