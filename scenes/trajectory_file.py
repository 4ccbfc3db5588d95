"""A trajectory in one Parquet file: a row per output time, all else as JSON in its metadata; nothing is rounded."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from stiction.scenes.base_errors import InputError
from stiction.scenes.loading import scene_from_dict, tables_of
from stiction.scenes.trajectory import Breakdown, Cost, Event, Trajectory

_KEY = b"stiction trajectory"
_VERSION = 1


def save_trajectory(run: Trajectory, file: str | Path) -> None:
    """Write a trajectory, its events, settings, cost and scene; TypeError for a setting that JSON has no form for."""
    about = {
        name: value
        for name, value in vars(run).items()
        if name not in ("t", "columns", "mechanism")
    }
    about |= {
        "version of the file": _VERSION,
        "mechanism": run.mechanism and [run.mechanism.name, tables_of(run.mechanism)],
    }
    table = pa.table({"t": run.t, **run.columns})
    pq.write_table(table.replace_schema_metadata({_KEY: json.dumps(about, default=_plain)}), file)


def load_trajectory(file: str | Path) -> Trajectory:
    """Read what `save_trajectory` wrote, the same numbers to the bit; InputError for any other file."""
    try:
        table = pq.read_table(file)
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError(f"{file}: found {error}; expected a file of Trajectory.save") from error
    about = json.loads((table.schema.metadata or {}).get(_KEY, "{}"))
    version = about.pop("version of the file", None)
    if version != _VERSION:
        content = "no trajectory" if version is None else f"version {version}"
        raise InputError(
            f"{file}: found {content}; expected a file of Trajectory.save, version {_VERSION}"
        )
    columns = {name: table[name].to_numpy() for name in table.column_names}
    alternatives = about.pop("alternatives", {})
    about["alternatives"] = {
        name: np.array(values, dtype=float) for name, values in alternatives.items()
    }
    about["events"] = tuple(Event(**event) for event in about["events"])
    about["cost"] = Cost(**about["cost"])
    if about["breakdown"]:
        about["breakdown"] = Breakdown(**about["breakdown"])
    if about["mechanism"]:
        name, tables = about["mechanism"]
        about["mechanism"] = scene_from_dict(tables, f"scene of {file}", name=name)
    return Trajectory(t=columns.pop("t"), columns=columns, **about)


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return vars(value)
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"setting: found {value!r}; expected what JSON has a form for")
