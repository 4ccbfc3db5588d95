"""The data of a run folder, in full precision: tables as CSV and Parquet, a Parquet file per trajectory, all events.

Trajectories take most of the room. Which of them are stored is for the caller to say; a row of a table whose run is not stored has the command that makes it again
(`stiction.reports.run_folder.again`). They are stored at every 10 ms and on both sides of events; finer samples, off which jumps are read, are not.
`stiction.reports.run_folder.stored_run` reads it all.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd
import pyarrow as pa

from stiction.comparisons.results import Results
from stiction.comparisons.complementarity.problems import write_problems
from stiction.comparisons.presentation.cells import AGAIN, TRAJECTORY
from stiction.comparisons.truth import Truth
from stiction.comparisons.truth.truth import SAMPLES
from stiction.comparisons.variants import Record
from stiction.reports.run_folder.again import again, again_study
from stiction.reports.run_folder.settings import scene_parameters, variant_settings
from stiction.scenes import Trajectory
from stiction.scenes.trajectory import events_frame

TRUTH = "truth/"
"""Begins the key of a truth, before its name, in ``events.parquet``."""
SAMPLE_STEP = 1e-2
"""s; between the stored samples of a trajectory, at least."""
SUMS_UP = ("threshold",)
"""Tables whose rows sum up runs that are not among the validation's, though they have the keys of some."""


def tables_of(validation: Results) -> dict[str, pd.DataFrame]:
    """The tables of the validation, ``runs`` (every run), ``variants``, ``parameters``, and ``truths``: tier, and by column the uncertainty."""
    runs = pd.DataFrame([{**record.describe(), "wall [s]": record.outcome.wall_s} for record in validation.records])
    truths = pd.DataFrame([(name, truth.tier, column, unsure) for name, truth in validation.truths.items() for column, unsure in truth.uncertainty.items()],
                          columns=["truth", "tier", "column", "uncertainty"])
    return {"runs": runs, "variants": variant_settings(validation), "parameters": scene_parameters(validation), "truths": truths, **validation.tables}


def data_tables(validation: Results, stored: Container[str]) -> dict[str, pd.DataFrame]:
    """`tables_of` the validation; beside the key of a run that came out `TRAJECTORY` or, where it is not among those `stored`, `AGAIN`."""
    everything = (*validation.records, *validation.timed)
    files = trajectory_files(everything, stored)
    commands = {record.key: again(record) for record in everything if record.trajectory is not None and record.key not in files}
    tables = {name: table.assign(**{TRAJECTORY: table["key"].map(files), AGAIN: table["key"].map(commands)})
              if "key" in table and name not in SUMS_UP else table for name, table in tables_of(validation).items()}
    if "run" in (study := tables.get("study", pd.DataFrame())):
        tables["study"] = study.assign(**{AGAIN: [again_study(row) for row in study.to_dict("records")]})
    return tables


def trajectory_files(records: Iterable[Record], stored: Container[str]) -> dict[str, str]:
    """By key of a run, the file of its trajectory relative to the run folder; runs without one, or not among those `stored`, are left out.

    Names keep letters, digits and ``. = + -`` of the key; where two keys would share a name (upper and lower case are
    the same to some file systems), later ones are numbered.
    """
    files: dict[str, str] = {}
    taken: set[str] = set()
    for record in records:
        if record.trajectory is None or record.key not in stored or record.key in files:
            continue
        stem = re.sub(r"[^A-Za-z0-9.=+-]+", "_", record.key)[:200]
        name, number = stem, 1
        while name.casefold() in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name.casefold())
        files[record.key] = f"data/trajectories/{name}.parquet"
    return files


def write_data(validation: Results, folder: Path, stored: Container[str], others: Mapping[str, pd.DataFrame] = MappingProxyType({})) -> None:
    """Write ``data/`` of a run folder: `data_tables` and others.

    Trajectories, of the runs whose keys are `stored`, hold two more rows per event, the values before and after it. ``events.parquet`` holds all events of
    all runs and truths with their two-sided values, ``key`` first. A truth is a file in ``data/truths``.
    ``hard-problems.parquet``: see `stiction.comparisons.complementarity.problems`.
    """
    (folder / "data" / "trajectories").mkdir(parents=True)
    (folder / "data" / "truths").mkdir()
    for name, table in {**data_tables(validation, stored), **others}.items():
        written = storable(table)
        written.to_csv(folder / "data" / f"{name}.csv", index=False)
        write_frame(written, folder / "data" / f"{name}.parquet")
    if validation.problems:
        write_problems(validation.problems, folder / "data" / "hard-problems.parquet")
    everything = (*validation.records, *validation.timed)
    files = trajectory_files(everything, stored)
    events = []
    for key, record in {record.key: record for record in reversed(everything)}.items():  # of a run that was made again to be timed the first
        if key in files:
            write_frame(thinned(record.trajectory).to_frame(events=True), folder / files[key])
        if record.trajectory is not None and record.trajectory.events:
            events.append(events_frame(record.trajectory.events).assign(key=key))
    for name, truth in validation.truths.items():
        write_frame(truth_frame(truth).assign(tier=truth.tier), folder / truth_file(name))
        if truth.events:
            events.append(events_frame(truth.events).assign(key=TRUTH + name))
    columns = ["key", "t", "kind", "joint"]
    told = pd.concat(events, ignore_index=True) if events else pd.DataFrame(columns=columns)
    sides = [column for column in told if column not in columns]
    write_frame(told[[*columns, *sides]], folder / "data" / "events.parquet")


def thinned(trajectory: Trajectory) -> Trajectory:
    """Every so many of its samples that they are `SAMPLE_STEP` apart, and the last; all of its events."""
    count = len(trajectory.t)
    every = max(1, round(SAMPLE_STEP / float(np.median(np.diff(trajectory.t))))) if count > 1 else 1
    kept = np.union1d(np.arange(0, count, every), np.arange(count)[-1:])
    return replace(trajectory, t=trajectory.t[kept], columns={name: values[kept] for name, values in trajectory.columns.items()})


def write_frame(frame: pd.DataFrame, file: Path) -> None:
    """As Parquet, bit by bit what it is. The bytes of numbers stand together by their place in a number, which makes them compress by a third more."""
    numbers = [name for name, column in frame.items() if column.dtype == float]
    frame.to_parquet(file, index=False, compression="zstd", compression_level=9, use_dictionary=[name for name in frame if name not in numbers],
                     column_encoding=dict.fromkeys(numbers, "BYTE_STREAM_SPLIT"))


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
