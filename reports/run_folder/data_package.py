"""Description of the data of a run folder by the Data Package standard: ``datapackage.json``.

The standard (Frictionless Data, https://specs.frictionlessdata.io) describes the files of ``data/`` and the
columns of their tables: name, title, type, and, as additional properties, the unit and the key of the
uncertainty. The metadata of the columns of the Parquet files contain the same description.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from stiction.comparisons.bench.quantities import QUANTITIES, Quantity, quantity_of
from stiction.comparisons.studies import studies
from stiction.scenes import Scene
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
"""Predicates of Arrow types, and the corresponding types of the standard."""
OTHER_TYPE = "any"
"""Type of all other columns, such as a column without any value."""
MISSING_VALUES = ("",)
"""Texts of cells without a value."""
EVENTS = "events"
"""File of all events, with the columns of trajectories."""
PARAMETERS = "parameters"
"""Table of the parameters of scenes, whose columns have the names that the scenes give them."""
TITLES = {
    "parameters": "Parameters of the scenes",
    "runs": "All compared runs",
    "truths": "Uncertainties of the truths",
    "variants": "Methods, and their settings",
}
"""Titles of the tables that do not belong to a study."""


@cache
def _titles() -> Mapping[str, str]:
    """Return the titles of all tables of the data, by name."""
    titles = dict(TITLES)
    for study in studies():
        titles.update(study.tables)
    return titles


def columns_of_table(table: str, names: Iterable[str]) -> list[Quantity]:
    """Return the descriptions of the columns of a table of a study or of the runs."""
    quantities = []
    for name in names:
        if table == PARAMETERS and name != "scene":
            quantities.append(Quantity(name, name, description="a parameter of the scene"))
        else:
            quantities.append(quantity_of(name))
    return quantities


def columns_of_motion(names: Iterable[str], scene: Scene | None = None) -> list[Quantity]:
    """Return the descriptions of the columns of a trajectory, of a truth, or of events.

    Columns of pins and guides have the same names, and other units: the `scene` tells which elements are pins.
    """
    quantities = []
    for name in names:
        if name in QUANTITIES and "." not in name:
            quantities.append(QUANTITIES[name])
        else:
            # A column of a scene, named ELEMENT.QUANTITY
            unit = unit_of(name, scene)
            quantities.append(Quantity(name, name, unit, description=meaning_of(name, scene)))
    return quantities


def metadata(quantity: Quantity) -> dict[bytes, bytes]:
    """Return the metadata of a column of a Parquet file; properties that a quantity lacks are left out."""
    properties = {
        "title": quantity.label,
        "unit": quantity.unit,
        "description": quantity.description,
        "uncertainty": quantity.uncertainty,
    }
    return {name.encode(): text.encode() for name, text in properties.items() if text}


def _described(field: pa.Field) -> Quantity:
    """Return the description of a column of a Parquet file, from the `metadata` that it was written with."""
    properties = {name.decode(): text.decode() for name, text in (field.metadata or {}).items()}
    return Quantity(
        field.name,
        properties.get("title", field.name),
        properties.get("unit", ""),
        uncertainty=properties.get("uncertainty", ""),
        description=properties.get("description", ""),
    )


def write_data_package(folder: Path, title: str, created: str) -> None:
    """Write ``datapackage.json`` to a run folder whose ``data/`` is complete.

    Parameters
    ----------
    folder : Path
        The run folder.
    title : str
        Title of the run.
    created : str
        Date and time in the format of ISO 8601.
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
    """Return the description of a file of the data.

    A CSV file does not contain the types of its columns. They are read from the Parquet file of the same
    table.
    """
    path = file.relative_to(folder)
    schema = pq.read_schema(file.with_suffix(".parquet"))
    is_table_of_study = path.parent == Path("data") and path.stem != EVENTS
    if is_table_of_study:
        quantities = columns_of_table(path.stem, schema.names)
    else:
        quantities = [_described(schema.field(name)) for name in schema.names]
    # The standard allows lower-case letters, digits, ".", "_" and "-" in names.
    name = re.sub(r"[^a-z0-9._-]+", "-", "-".join((*path.parts[1:-1], path.name)).lower())
    return resource_of(path, name, _titles().get(path.stem, path.stem), quantities, schema)


def resource_of(
    path: Path, name: str, title: str, quantities: Iterable[Quantity], schema: pa.Schema
) -> dict[str, Any]:
    """Return the description of a table.

    Parameters
    ----------
    path : Path
        The CSV or Parquet file, relative to the folder of the package.
    name, title : str
        Name and title of the table in the package.
    quantities : iterable of Quantity
        Descriptions of the columns.
    schema : pyarrow.Schema
        Names and types of the columns.
    """
    fields = [_field(quantity, schema.field(quantity.key).type) for quantity in quantities]
    resource: dict[str, Any] = {
        "name": name,
        "path": path.as_posix(),
        "title": title,
        "format": path.suffix.removeprefix("."),
    }
    if path.suffix == ".csv":
        return {
            **resource,
            "profile": "tabular-data-resource",
            "encoding": "utf-8",
            "mediatype": "text/csv",
            "schema": {"fields": fields, "missingValues": list(MISSING_VALUES)},
        }
    return {
        **resource,
        "profile": "data-resource",
        "mediatype": "application/vnd.apache.parquet",
        "schema": {"fields": fields},
    }


def _field(quantity: Quantity, arrow_type: pa.DataType) -> dict[str, Any]:
    """Return the description of a column. Unit and uncertainty are not properties of the standard."""
    properties = {
        "name": quantity.key,
        "title": quantity.label,
        "type": _standard_type(arrow_type),
        "description": quantity.description or quantity.label,
        "unit": quantity.unit,
        "uncertainty": quantity.uncertainty,
    }
    return {name: value for name, value in properties.items() if value}


def _standard_type(arrow_type: pa.DataType) -> str:
    """Return the type of the standard for a type of Arrow."""
    for is_of_type, name in TYPES:
        if is_of_type(arrow_type):
            return name
    return OTHER_TYPE
