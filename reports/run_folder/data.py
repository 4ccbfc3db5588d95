"""The data of a run folder in full precision: tables, trajectories, truths and events.

Tables are written as CSV and Parquet, trajectories and truths as one Parquet file each. Trajectories take
most of the space. Therefore the caller selects the runs whose trajectories are stored, and these have a
sample every 10 ms and two at each event. The row of any other run contains the command that repeats the
run (`stiction.reports.run_folder.reproduce`).
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace
from itertools import count
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
from stiction.comparisons.bench.variants import Record, truth_key
from stiction.engines.registry import label_of
from stiction.reports.run_folder.data_package import columns_of_motion, columns_of_table, metadata
from stiction.reports.run_folder.reproduce import rerun_command
from stiction.scenes import Trajectory
from stiction.scenes.motion_table import with_sides
from stiction.scenes.trajectory import events_frame
from stiction.truths import Truth
from stiction.truths.truth import SAMPLES

TRUTH = "truth/"
"""Prefix of the key of a truth in ``events.parquet``; the name of the truth follows."""
SAMPLE_STEP = 1e-2
"""Smallest time between the stored samples of a trajectory, s."""
MAX_FILE_NAME = 200
"""Largest number of characters in a file name, without a number and the ending: file systems allow 255."""
COMPRESSION_LEVEL = 9
"""Level of zstd compression, 1 to 22; higher levels take much longer and save little."""
NAMED_SETTINGS = ("friction_law", "stabilization", "iterations", "solver")
"""Settings with a column of their own in the table of variants."""


def tables_of(results: Results) -> dict[str, pd.DataFrame]:
    """Return the tables of the studies, and the tables ``runs``, ``variants``, ``parameters`` and ``truths``.

    ``runs`` has one row for each run, ``variants`` one for each method, ``parameters`` one for each scene,
    and ``truths`` one for each truth and column whose uncertainty is known.
    """
    runs = [{**record.describe(), "wall_time": record.outcome.wall_s} for record in results.records]
    parameters = []
    for name in results.compared_scenes:
        scene = results.scene(name)
        if scene is not None:
            parameters.append({"scene": name, **scene.parameters})
    truths = [
        (name, truth.tier, column, uncertainty)
        for name, truth in results.truths.items()
        for column, uncertainty in truth.uncertainty.items()
    ]
    return {
        "runs": pd.DataFrame(runs),
        "variants": _variants(results),
        "parameters": pd.DataFrame(parameters),
        "truths": pd.DataFrame(truths, columns=["truth", "tier", "column", "uncertainty"]),
        **results.tables,
    }


def _variants(results: Results) -> pd.DataFrame:
    """Return a row per variant with its settings, as stated by the trajectory of its last successful run."""
    last_records = {record.variant.label: record for record in results.records}
    for record in results.records:
        if record.trajectory is not None:
            last_records[record.variant.label] = record
    return pd.DataFrame([_variant_row(record) for record in last_records.values()])


def _variant_row(record: Record) -> dict[str, Any]:
    """Return the row of the table of variants for the variant of a run."""
    variant = record.variant
    settings = variant.settings
    version = None
    if record.trajectory is not None:
        # The trajectory also states the default settings of the engine.
        settings = record.trajectory.settings
        version = record.trajectory.version
    columns = (*NAMED_SETTINGS, "method", variant.parameter)
    others = {name: value for name, value in settings.items() if name not in columns}
    return {
        "variant": variant.label,
        "engine": label_of(variant.engine),
        "version": version,
        "fidelity": variant.fidelity,
        "ladder": f"{variant.parameter} = {in_words(variant.ladder)}",
        "method": in_words(settings.get("method")),
        **{name: in_words(settings.get(name)) for name in NAMED_SETTINGS},
        "other_settings": in_words(others),
    }


def in_words(value: Any) -> str:
    """Return a setting as text, such as ``baumgarte (alpha = 90, beta = 10)`` for a mapping with a method."""
    if value is None:
        return ""
    if isinstance(value, Mapping):
        parameters = ", ".join(
            f"{name} = {in_words(entry)}" for name, entry in value.items() if name != "method"
        )
        if "method" not in value:
            return parameters
        return f"{value['method']} ({parameters})" if parameters else str(value["method"])
    if isinstance(value, (list, tuple)):
        return ", ".join(map(in_words, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def data_tables(results: Results, stored: Container[str]) -> dict[str, pd.DataFrame]:
    """Return `tables_of` a run, with the origin of each row.

    A column contains the file of the trajectory if the key of the run is in `stored`, and another one
    the command that repeats the run. Rows that summarize several runs which are not kept, such as a
    threshold, have neither.
    """
    records = (*results.records, *results.timed)
    files = trajectory_files(records, stored)
    commands = {
        record.key: rerun_command(record, results)
        for record in records
        if record.trajectory is not None
    }
    keys = {record.key for record in records}
    tables = tables_of(results)
    for name, table in tables.items():
        if "key" in table and table["key"].isin(keys).any():
            tables[name] = table.assign(
                **{TRAJECTORY: table["key"].map(files), AGAIN: table["key"].map(commands)}
            )
    return tables


def trajectory_files(records: Iterable[Record], stored: Container[str]) -> dict[str, str]:
    """Return the file of each trajectory that is stored, relative to the run folder, by the key of the run.

    If two keys would have the same file name, the later ones are numbered. Names that differ only in
    case are the same to some file systems.
    """
    files: dict[str, str] = {}
    used_names: set[str] = set()
    for record in records:
        if record.trajectory is None or record.key not in stored or record.key in files:
            continue
        stem = re.sub(r"[^A-Za-z0-9.=+-]+", "_", record.key)[:MAX_FILE_NAME]
        name = stem
        numbers = count(2)
        while name.casefold() in used_names:
            name = f"{stem}_{next(numbers)}"
        used_names.add(name.casefold())
        files[record.key] = f"data/trajectories/{name}.parquet"
    return files


def write_data(results: Results, folder: Path, stored: Container[str]) -> None:
    """Write the folder ``data`` of a run folder.

    It contains `data_tables`, the trajectories of the runs whose keys are in `stored`, truths, hard
    complementarity problems, and all events.
    """
    (folder / "data" / "trajectories").mkdir(parents=True)
    (folder / "data" / "truths").mkdir()
    for name, table in data_tables(results, stored).items():
        write_table(table, folder / "data", name)
    if results.problems:
        write_problems(results.problems, folder / "data" / "hard-problems.parquet")
    run_events = _write_trajectories(results, folder, stored)
    truth_events = _write_truths(results, folder)
    _write_events([*run_events, *truth_events], folder / "data" / "events.parquet")


def _write_trajectories(
    results: Results, folder: Path, stored: Container[str]
) -> list[pd.DataFrame]:
    """Write the stored trajectories, and return the events of all runs, a table for each run."""
    records = (*results.records, *results.timed)
    files = trajectory_files(records, stored)
    events = []
    # Runs that several studies need have one key. The first record with a key remains in the dictionary.
    first_records = {record.key: record for record in reversed(records)}
    for key, record in first_records.items():
        if key in files:
            frame = thin(record.run).to_frame(events=True, interpolated=True)
            quantities = columns_of_motion(frame, results.scene(record.scene))
            write_frame(frame, folder / files[key], quantities)
        if record.trajectory is not None and record.trajectory.events:
            events.append(events_frame(record.trajectory.events).assign(key=key))
    return events


def _write_truths(results: Results, folder: Path) -> list[pd.DataFrame]:
    """Write the truths, and return their events, a table for each truth."""
    events = []
    scene_of_truth = {
        truth_key(record.scene, static_coefficient, has_gaps): record.scene
        for record in results.records
        for static_coefficient in (True, False)
        for has_gaps in (True, False)
    }
    for name, truth in results.truths.items():
        frame = truth_frame(truth).assign(tier=truth.tier)
        scene = results.scene(scene_of_truth[name]) if name in scene_of_truth else None
        write_frame(frame, folder / truth_file(name), columns_of_motion(frame, scene))
        if truth.events:
            events.append(events_frame(truth.events).assign(key=TRUTH + name))
    return events


def _write_events(events: list[pd.DataFrame], file: Path) -> None:
    """Write the events of all runs and truths as one table; columns that not all events have come last."""
    first_columns = ["key", "t", "kind", "joint"]
    frame = pd.DataFrame(columns=first_columns)
    if events:
        frame = pd.concat(events, ignore_index=True)
    write_frame(frame[[*first_columns, *frame.columns.drop(first_columns)]], file)


def thin(trajectory: Trajectory) -> Trajectory:
    """Return a trajectory with samples `SAMPLE_STEP` apart, with its last sample, and with all its events."""
    samples = len(trajectory.t)
    stride = 1
    if samples > 1:
        step = float(np.median(np.diff(trajectory.t)))
        stride = max(1, round(SAMPLE_STEP / step))
    last_row = np.arange(samples)[-1:]
    rows = np.union1d(np.arange(0, samples, stride), last_row)
    columns = {name: values[rows] for name, values in trajectory.columns.items()}
    return replace(trajectory, t=trajectory.t[rows], columns=columns)


def write_table(table: pd.DataFrame, folder: Path, name: str) -> None:
    """Write a table to a folder as CSV and Parquet, with the descriptions of the columns of its name."""
    storable = to_storable(table)
    storable.to_csv(folder / f"{name}.csv", index=False)
    write_frame(storable, folder / f"{name}.parquet", columns_of_table(name, list(storable)))


def write_frame(
    frame: pd.DataFrame, file: Path, quantities: Iterable[Quantity] | None = None
) -> None:
    """Write a table as Parquet, without rounding, and describe its columns in their metadata.

    Parameters
    ----------
    quantities : iterable of Quantity, optional
        Descriptions of the columns, in their order. By default the columns are those of a trajectory.
    """
    if quantities is None:
        quantities = columns_of_motion(frame)
    table = pa.Table.from_pandas(frame, preserve_index=False)
    fields = [
        table.schema.field(quantity.key).with_metadata(metadata(quantity))
        for quantity in quantities
    ]
    table = table.cast(pa.schema(fields, table.schema.metadata))
    # Storing all first bytes of a column of numbers, then all second bytes and so on makes the
    # compressed file smaller by a third. Such columns must not have a dictionary.
    number_columns = [name for name, column in frame.items() if column.dtype == float]
    pq.write_table(
        table,
        file,
        compression="zstd",
        compression_level=COMPRESSION_LEVEL,
        use_dictionary=[name for name in frame if name not in number_columns],
        column_encoding=dict.fromkeys(number_columns, "BYTE_STREAM_SPLIT"),
    )


def truth_file(name: str) -> str:
    """Return the file of a truth, relative to the run folder."""
    return f"data/truths/{name}.parquet"


def truth_frame(truth: Truth) -> pd.DataFrame:
    """Return `SAMPLES` rows of a truth, and two more for each event, with the values before and after it."""
    t = np.linspace(0.0, truth.t_end, SAMPLES)
    return with_sides(pd.DataFrame({"t": t, **truth(t)}), truth.events)


def to_storable(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table whose columns have one type each, as Parquet requires.

    Columns that contain values of several types, or structures, are converted to text.
    """
    columns = {}
    for name, column in table.items():
        try:
            pa.array(column, from_pandas=True)
            columns[str(name)] = column
        except (pa.ArrowInvalid, pa.ArrowTypeError, pa.ArrowNotImplementedError):
            columns[str(name)] = column.map(str, na_action="ignore")
    return pd.DataFrame(columns, index=table.index)
