"""What the data of a run folder are, by the Data Package standard: ``datapackage.json``.

The standard (Frictionless Data, https://specs.frictionlessdata.io) describes every file of ``data/`` and every
column of its tables: name, title, type, and, as properties of our own, the unit and the key of its uncertainty. The
Parquet files have the same in the metadata of their columns.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from stiction.comparisons.bench.quantities import QUANTITIES, Quantity, quantity_of
from stiction.comparisons.studies import studies
from stiction.scenes.atomic_files import write_text
from stiction.scenes.columns import meaning_of, unit_of

DATA_PACKAGE = "datapackage.json"
TYPES = (
    (pa.types.is_boolean, "boolean"),
    (pa.types.is_integer, "integer"),
    (pa.types.is_floating, "number"),
    (pa.types.is_string, "string"),
    (pa.types.is_large_string, "string"),
)
"""Types of the standard by those of Arrow; a column without any value has any."""
MISSING_VALUES = ("",)
"""Texts of cells without a value."""
EVENTS = "events"
"""File of all events, with the columns of trajectories."""
PARAMETERS = "parameters"
"""Table of the parameters of scenes, whose columns are named by the scenes."""
TITLES = {
    "parameters": "Parameters of the scenes",
    "runs": "All compared runs",
    "truths": "Uncertainties of the truths",
    "variants": "Methods, and their settings",
}
"""Titles of the tables that are of no study."""


@cache
def _titles() -> Mapping[str, str]:
    """Titles of all tables of the data."""
    return TITLES | {name: title for study in studies() for name, title in study.tables.items()}


def columns_of_table(table: str, names: Iterable[str]) -> list[Quantity]:
    """Return what the columns of a table of the comparisons are."""
    if table != PARAMETERS:
        return [quantity_of(name) for name in names]
    return [
        quantity_of(name)
        if name == "scene"
        else Quantity(name, name, description="a parameter of the scene")
        for name in names
    ]


def columns_of_motion(names: Iterable[str]) -> list[Quantity]:
    """Return what the columns of a trajectory, of a truth, or of events are."""
    return [
        QUANTITIES[name]
        if name in QUANTITIES and "." not in name
        else Quantity(name, name, unit_of(name), description=meaning_of(name))
        for name in names
    ]


def metadata(quantity: Quantity) -> dict[bytes, bytes]:
    """Describe a column of a Parquet file, in the metadata of its field."""
    found = {
        "title": quantity.label,
        "unit": quantity.unit,
        "description": quantity.description,
        "uncertainty": quantity.uncertainty,
    }
    return {name.encode(): text.encode() for name, text in found.items() if text}


def write_data_package(folder: Path, title: str, created: str) -> None:
    """Write ``datapackage.json`` of a run folder whose ``data/`` is complete.

    Parameters
    ----------
    created
        Date and time, as ISO 8601 has them.
    """
    files = sorted(
        path for path in (folder / "data").rglob("*") if path.suffix in (".csv", ".parquet")
    )
    package = {
        "name": "stiction-run",
        "title": title,
        "profile": "data-package",
        "created": created,
        "resources": [_resource(folder, file) for file in files],
    }
    write_text(folder / DATA_PACKAGE, json.dumps(package, indent=1, ensure_ascii=False) + "\n")


def _resource(folder: Path, file: Path) -> dict[str, Any]:
    """Describe a file; the types of a CSV file are those of the Parquet file of the same table beside it."""
    path = file.relative_to(folder)
    name = re.sub(r"[^a-z0-9._-]+", "-", "-".join((*path.parts[1:-1], path.name)).lower())
    is_table = path.parent == Path("data")
    schema = pq.read_schema(file.with_suffix(".parquet"))
    describe = (
        partial(columns_of_table, path.stem)
        if is_table and path.stem != EVENTS
        else columns_of_motion
    )
    fields = [
        _field(quantity, schema.field(quantity.key).type) for quantity in describe(schema.names)
    ]
    found: dict[str, Any] = {
        "name": name,
        "path": path.as_posix(),
        "title": _titles().get(path.stem, path.stem),
        "format": path.suffix[1:],
    }
    if path.suffix == ".csv":
        return found | {
            "profile": "tabular-data-resource",
            "encoding": "utf-8",
            "mediatype": "text/csv",
            "schema": {"fields": fields, "missingValues": list(MISSING_VALUES)},
        }
    return found | {
        "profile": "data-resource",
        "mediatype": "application/vnd.apache.parquet",
        "schema": {"fields": fields},
    }


def _field(quantity: Quantity, stored: pa.DataType) -> dict[str, Any]:
    """Describe a column as the standard has it; unit and uncertainty are properties of our own."""
    kind = next((name for test, name in TYPES if test(stored)), "any")
    found = {
        "name": quantity.key,
        "title": quantity.label,
        "type": kind,
        "description": quantity.description or quantity.label,
        "unit": quantity.unit,
        "uncertainty": quantity.uncertainty,
    }
    return {name: value for name, value in found.items() if value}
