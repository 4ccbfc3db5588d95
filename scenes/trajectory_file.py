"""Storage of trajectories in Parquet files, without rounding.

The file has a row per output time. Everything else is stored as JSON in the metadata of the table.
"""

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
from stiction.scenes.fidelity import fidelity_of
from stiction.scenes.loading import scene_from_dict
from stiction.scenes.trajectory import Breakdown, Cost, Event, Trajectory

_METADATA_KEY = b"stiction trajectory"
"""Key of the JSON text in the metadata of the table."""
_VERSION_KEY = "version of the file"
"""Key of the version in the JSON text."""
_VERSION = 1
"""Version of the format. Files of other versions are refused."""


def save_trajectory(run: Trajectory, file: str | Path) -> None:
    """Write a trajectory with its events, settings, cost and scene.

    Raises
    ------
    TypeError
        If a setting cannot be converted to JSON.
    """
    metadata = {
        name: value
        for name, value in vars(run).items()
        if name not in ("t", "columns", "mechanism")
    }
    metadata[_VERSION_KEY] = _VERSION
    metadata["mechanism"] = None
    if run.mechanism is not None:
        metadata["mechanism"] = [run.mechanism.name, run.mechanism.to_dict()]
    text = json.dumps(metadata, default=_to_json_types)
    table = pa.table({"t": run.t, **run.columns})
    pq.write_table(table.replace_schema_metadata({_METADATA_KEY: text}), file)


def load_trajectory(file: str | Path) -> Trajectory:
    """Read a trajectory that `save_trajectory` wrote; all numbers are the same.

    Raises
    ------
    InputError
        If the file cannot be read, or was not written by this version of `save_trajectory`.
    """
    try:
        table = pq.read_table(file)
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError(f"{file}: found {error}; expected a file of Trajectory.save") from error
    fields = json.loads((table.schema.metadata or {}).get(_METADATA_KEY, "{}"))
    version = fields.pop(_VERSION_KEY, None)
    if version != _VERSION:
        content = "no trajectory" if version is None else f"version {version}"
        raise InputError(
            f"{file}: found {content}; expected a file of Trajectory.save, version {_VERSION}"
        )
    columns = {name: table[name].to_numpy() for name in table.column_names}
    t = columns.pop("t")
    # JSON contains dictionaries, lists and texts in place of the classes of the fields.
    alternatives = fields.pop("alternatives", {})
    fields["alternatives"] = {
        name: np.array(values, dtype=float) for name, values in alternatives.items()
    }
    fields["events"] = tuple(Event(**event) for event in fields["events"])
    fields["switches"] = tuple(Event(**event) for event in fields.pop("switches", ()))
    fields["fidelity"] = fidelity_of(fields["fidelity"])
    fields["cost"] = Cost(**fields["cost"])
    if fields["breakdown"]:
        fields["breakdown"] = Breakdown(**fields["breakdown"])
    if fields["mechanism"]:
        name, tables = fields["mechanism"]
        fields["mechanism"] = scene_from_dict(tables, f"scene of {file}", name=name)
    return Trajectory(t=t, columns=columns, **fields)


def _to_json_types(value: Any) -> Any:
    """Convert what the JSON encoder does not know: dataclasses, numbers and arrays of NumPy, and mappings."""
    if is_dataclass(value):
        return vars(value)
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"setting: found {value!r}; expected what JSON has a form for")
