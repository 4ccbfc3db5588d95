"""The data of a run folder, in full precision: tables as CSV and Parquet, a Parquet file per trajectory, all events.

Trajectories take most of the room. The caller says which are stored, at every 10 ms and on both sides of events; a row
whose run is not stored has the command that makes it again (`stiction.reports.run_folder.reproduce`).
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from stiction.comparisons.bench.complementarity.problems import write_problems
from stiction.comparisons.bench.presentation.cells import AGAIN, TRAJECTORY
from stiction.comparisons.bench.quantities import Quantity
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import Record
from stiction.engines.registry import label_of
from stiction.reports.run_folder.data_package import columns_of_motion, columns_of_table, metadata
from stiction.reports.run_folder.reproduce import again
from stiction.scenes import Trajectory, catalogue, load_scene
from stiction.scenes.motion_table import with_sides
from stiction.scenes.trajectory import events_frame
from stiction.truths import Truth
from stiction.truths.truth import SAMPLES

TRUTH = "truth/"
"""Begins the key of a truth, before its name, in ``events.parquet``."""
SAMPLE_STEP = 1e-2
"""s; between the stored samples of a trajectory, at least."""


def tables_of(results: Results) -> dict[str, pd.DataFrame]:
    """Return the tables of a run, and ``runs`` (all), ``variants``, ``parameters`` (of scenes), ``truths``."""
    runs = [{**record.describe(), "wall_time": record.outcome.wall_s} for record in results.records]
    scenes = [
        name
        for name in dict.fromkeys(record.scene for record in results.records)
        if name in catalogue()
    ]
    parameters = [{"scene": name, **load_scene(name).parameters} for name in scenes]
    truths = [
        (name, truth.tier, column, unsure)
        for name, truth in results.truths.items()
        for column, unsure in truth.uncertainty.items()
    ]
    return {
        "runs": pd.DataFrame(runs),
        "variants": _variants(results),
        "parameters": pd.DataFrame(parameters),
        "truths": pd.DataFrame(truths, columns=["truth", "tier", "column", "uncertainty"]),
        **results.tables,
    }


def _variants(results: Results) -> pd.DataFrame:
    """A row per variant, as its runs state: friction law and who supplies it, stabilization, iterations, all else."""
    named, rows = ("friction_law", "stabilization", "iterations", "solver"), []
    runs = {record.variant.label: record for record in results.records}
    runs |= {
        record.variant.label: record for record in results.records if record.trajectory is not None
    }
    for record in runs.values():
        variant, trajectory = record.variant, record.trajectory
        stated = variant.settings if trajectory is None else trajectory.settings
        others = {
            key: value
            for key, value in stated.items()
            if key not in (*named, "method", variant.parameter)
        }
        rows.append(
            {
                "variant": variant.label,
                "engine": label_of(variant.engine),
                "version": trajectory.version if trajectory else None,
                "fidelity": variant.fidelity,
                "ladder": f"{variant.parameter} = {words(variant.ladder)}",
                "method": words(stated.get("method")),
                **{key: words(stated.get(key)) for key in named},
                "other_settings": words(others),
            }
        )
    return pd.DataFrame(rows)


def words(value: Any) -> str:
    """Write a setting as text: ``baumgarte (alpha = 90, beta = 10)`` for a mapping with a method."""
    if value is None:
        return ""
    if isinstance(value, Mapping):
        others = ", ".join(
            f"{key} = {words(entry)}" for key, entry in value.items() if key != "method"
        )
        return (
            f"{value['method']} ({others})"
            if others and "method" in value
            else str(value.get("method", others))
        )
    if isinstance(value, (list, tuple)):
        return ", ".join(map(words, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def data_tables(results: Results, stored: Container[str]) -> dict[str, pd.DataFrame]:
    """Return `tables_of` a run with the file of each row's trajectory or, where it is not `stored`, its command.

    Rows that sum up runs which are not kept, as of a threshold, have neither.
    """
    everything = (*results.records, *results.timed)
    files = trajectory_files(everything, stored)
    commands = {
        record.key: again(record)
        for record in everything
        if record.trajectory is not None and record.key not in files
    }
    tables, known = tables_of(results), {record.key for record in everything}
    for name, table in tables.items():
        if "key" in table and table["key"].isin(known).any():
            tables[name] = table.assign(
                **{TRAJECTORY: table["key"].map(files), AGAIN: table["key"].map(commands)}
            )
    return tables


def trajectory_files(records: Iterable[Record], stored: Container[str]) -> dict[str, str]:
    """Return by key of a run the file of its trajectory, for the runs that have one and are `stored`.

    Where two keys would share a name (upper and lower case are the same to some file systems), later ones are numbered.
    """
    files: dict[str, str] = {}
    taken: set[str] = set()
    for record in records:
        if record.trajectory is None or record.key not in stored or record.key in files:
            continue
        stem = re.sub(r"[^A-Za-z0-9.=+-]+", "_", record.key)[:200]
        names = chain([stem], (f"{stem}_{number}" for number in count(2)))
        name = next(name for name in names if name.casefold() not in taken)
        taken.add(name.casefold())
        files[record.key] = f"data/trajectories/{name}.parquet"
    return files


def write_data(results: Results, folder: Path, stored: Container[str]) -> None:
    """Write ``data/`` of a run folder: `data_tables`, the `stored` trajectories, truths, hard problems, all events.

    Trajectories and truths hold two more rows per event, the values before and after it.
    """
    (folder / "data" / "trajectories").mkdir(parents=True)
    (folder / "data" / "truths").mkdir()
    for name, table in data_tables(results, stored).items():
        written = storable(table)
        written.to_csv(folder / "data" / f"{name}.csv", index=False)
        write_frame(
            written, folder / "data" / f"{name}.parquet", columns_of_table(name, list(written))
        )
    if results.problems:
        write_problems(results.problems, folder / "data" / "hard-problems.parquet")
    everything = (*results.records, *results.timed)
    files = trajectory_files(everything, stored)
    events = []
    for key, record in {
        record.key: record for record in reversed(everything)
    }.items():  # the first run of each key
        if key in files:
            write_frame(
                thinned(record.run).to_frame(events=True, interpolated=True), folder / files[key]
            )
        if record.trajectory is not None and record.trajectory.events:
            events.append(events_frame(record.trajectory.events).assign(key=key))
    for name, truth in results.truths.items():
        write_frame(truth_frame(truth).assign(tier=truth.tier), folder / truth_file(name))
        if truth.events:
            events.append(events_frame(truth.events).assign(key=TRUTH + name))
    first = ["key", "t", "kind", "joint"]
    frame = pd.concat(events, ignore_index=True) if events else pd.DataFrame(columns=first)
    write_frame(frame[[*first, *frame.columns.drop(first)]], folder / "data" / "events.parquet")


def thinned(trajectory: Trajectory) -> Trajectory:
    """Keep samples that are `SAMPLE_STEP` apart, and the last; all events."""
    count = len(trajectory.t)
    every = max(1, round(SAMPLE_STEP / float(np.median(np.diff(trajectory.t))))) if count > 1 else 1
    kept = np.union1d(np.arange(0, count, every), np.arange(count)[-1:])
    columns = {name: values[kept] for name, values in trajectory.columns.items()}
    return replace(trajectory, t=trajectory.t[kept], columns=columns)


def write_frame(
    frame: pd.DataFrame, file: Path, quantities: Iterable[Quantity] | None = None
) -> None:
    """Write Parquet, bit by bit what it is; numbers split by the place of their bytes compress by a third more.

    The metadata of each column say what it is: by `quantities`, in the order of the columns, or as of a trajectory.
    """
    numbers = [name for name, column in frame.items() if column.dtype == float]
    table = pa.Table.from_pandas(frame, preserve_index=False)
    about = columns_of_motion(frame) if quantities is None else quantities
    fields = [
        table.schema.field(quantity.key).with_metadata(metadata(quantity)) for quantity in about
    ]
    table = table.cast(pa.schema(fields, table.schema.metadata))
    pq.write_table(
        table,
        file,
        compression="zstd",
        compression_level=9,
        use_dictionary=[name for name in frame if name not in numbers],
        column_encoding=dict.fromkeys(numbers, "BYTE_STREAM_SPLIT"),
    )


def truth_file(name: str) -> str:
    """Return the file of a truth, relative to the run folder."""
    return f"data/truths/{name}.parquet"


def truth_frame(truth: Truth) -> pd.DataFrame:
    """Return `SAMPLES` rows of a truth, and two more per event: the values before and after it."""
    t = np.linspace(0.0, truth.t_end, SAMPLES)
    return with_sides(pd.DataFrame({"t": t, **truth(t)}), truth.events)


def storable(table: pd.DataFrame) -> pd.DataFrame:
    """Give every column one type: what mixes numbers and words, or holds structures, becomes text."""
    columns = {}
    for name, column in table.items():
        try:
            pa.array(column, from_pandas=True)
            columns[str(name)] = column
        except (pa.ArrowInvalid, pa.ArrowTypeError, pa.ArrowNotImplementedError):
            columns[str(name)] = column.map(str, na_action="ignore")
    return pd.DataFrame(columns, index=table.index)
