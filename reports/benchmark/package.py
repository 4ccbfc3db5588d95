"""Description of the benchmark by the Data Package standard: ``datapackage.json``."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from stiction.comparisons.bench.quantities import Quantity
from stiction.comparisons.judge.benchmark import NAME, SCENES
from stiction.comparisons.judge.truth_folder import SCENE
from stiction.reports.run_folder.data_package import (
    DATA_PACKAGE,
    columns_of_motion,
    columns_of_table,
    resource_of,
)
from stiction.scenes import Scene
from stiction.scenes.resolved import load_resolved

LICENCE = {"name": "BSD-3-Clause", "path": "https://opensource.org/license/bsd-3-clause"}
"""Licence of the set; its text is in the file LICENSE."""
SIDES = ("before.", "after.")
"""Prefixes of the columns of events."""


def write_benchmark_package(folder: Path) -> None:
    """Write ``datapackage.json`` to a folder that contains all tables of the benchmark."""
    resources = []
    for file in sorted(folder.rglob("*")):
        if file.suffix not in (".csv", ".parquet"):
            continue
        schema = _schema_of(file)
        path = file.relative_to(folder)
        if path.parts[0] == SCENES:
            scene_file = file.parent / SCENE
            scene = load_resolved(scene_file.read_text(encoding="utf-8"), str(scene_file))
            quantities = columns_of_events_or_motion(schema.names, scene)
            title = f"{scene.name}: {path.stem}"
        else:
            quantities = columns_of_table(path.stem, schema.names)
            title = path.stem
        # The standard allows lower-case letters, digits, ".", "_" and "-" in names.
        name = re.sub(r"[^a-z0-9._-]+", "-", "-".join(path.parts).lower())
        resource = resource_of(path, name, title, quantities, schema)
        # The columns of a Parquet file are those of the CSV file beside it.
        if file.suffix == ".parquet":
            del resource["schema"]
        resources.append(resource)
    package: dict[str, Any] = {
        "name": NAME.replace(" ", "-"),
        "version": "1.0.0",
        "title": "Friction benchmark: planar mechanisms with dry friction, and their exact motions",
        "profile": "data-package",
        "licenses": [LICENCE],
        "resources": resources,
    }
    text = json.dumps(package, indent=1, ensure_ascii=False) + "\n"
    (folder / DATA_PACKAGE).write_text(text, encoding="utf-8", newline="\n")


def _schema_of(file: Path) -> pa.Schema:
    """Return names and types of the columns of a table.

    A CSV file has those of the Parquet file beside it, or else the types that its values have.
    """
    parquet = file.with_suffix(".parquet")
    if parquet.is_file():
        return pq.read_schema(parquet)
    return pa.Schema.from_pandas(pd.read_csv(file), preserve_index=False)


def columns_of_events_or_motion(names: Iterable[str], scene: Scene) -> list[Quantity]:
    """Return the descriptions of the columns of a motion, or of events, whose values have a side as prefix."""
    quantities = []
    for name in names:
        column = name
        for side in SIDES:
            column = column.removeprefix(side)
        [quantity] = columns_of_motion([column], scene)
        quantities.append(Quantity(name, name, quantity.unit, description=quantity.description))
    return quantities
