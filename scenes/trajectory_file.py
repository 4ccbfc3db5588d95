"""A trajectory in one Parquet file: a row per output time, all else as JSON in its metadata; nothing is rounded."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
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
_IN_TABLE = ("t", "columns")


def save_trajectory(run: Trajectory, file: str | Path) -> None:
    """Write a trajectory, its events, settings, cost and scene.

    Raises
    ------
    TypeError
        For a setting that JSON has no form for.
    OSError
        If the file cannot be written.
    """
    about = {each.name: getattr(run, each.name) for each in fields(run) if each.name not in (*_IN_TABLE, "mechanism")}
    about |= {"version of the file": _VERSION, "events": [asdict(event) for event in run.events],
              "cost": asdict(run.cost), "breakdown": run.breakdown and asdict(run.breakdown),
              "mechanism": run.mechanism and [run.mechanism.name, tables_of(run.mechanism)]}
    table = pa.table({"t": run.t, **run.columns})
    text = json.dumps(about, default=_plain)
    pq.write_table(table.replace_schema_metadata({_KEY: text}), file)


def load_trajectory(file: str | Path) -> Trajectory:
    """Read what `save_trajectory` wrote: the same numbers to the bit.

    Raises
    ------
    InputError
        For a file that is not there, or is no trajectory of this version.
    """
    try:
        table = pq.read_table(file)
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError(f"{file}: found {error}; expected a file of Trajectory.save") from error
    about = json.loads((table.schema.metadata or {}).get(_KEY, "{}"))
    if (found := about.pop("version of the file", None)) != _VERSION:
        there = "no trajectory" if found is None else f"version {found}"
        raise InputError(f"{file}: found {there}; expected a file of Trajectory.save, version {_VERSION}")
    columns = {name: table[name].to_numpy() for name in table.column_names}
    made: dict[str, Any] = {"events": tuple(Event(**event) for event in about.pop("events")),
                            "cost": Cost(**about.pop("cost"))}
    if breakdown := about.pop("breakdown"):
        made["breakdown"] = Breakdown(**breakdown)
    if mechanism := about.pop("mechanism"):
        name, tables = mechanism
        made["mechanism"] = scene_from_dict(tables, f"scene of {file}", name=name)
    return Trajectory(t=columns.pop("t"), columns=columns, **about, **made)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"setting: found {value!r}; expected what JSON has a form for")
