"""Data sets for people who do not use stiction: the friction benchmark, and truths of any scenes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import resources
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.bench.environment import source_digest
from stiction.comparisons.judge.benchmark import NAME as BENCHMARK
from stiction.comparisons.judge.benchmark import copy_benchmark
from stiction.comparisons.judge.truth_folder import VERSION, write_sums, write_truth
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.reports.markdown.tables import align_columns
from stiction.reports.run_folder.overwriting import run_folder, write_provenance
from stiction.scenes import load_scene
from stiction.scenes.columns import COLUMNS
from stiction.truths import Tier

MAIN = "README.md"
"""File that marks a folder as a data set; a data set of an earlier call is replaced."""
TEMPLATES = {MAIN: "dataset_readme.md", "CITATION.cff": "dataset_citation.cff"}
"""Text files of a data set, and their templates in this package."""


def write_benchmark(folder: Path) -> None:
    """Write a copy of the friction benchmark to a folder; `run_folder` refuses folders whose content would be lost."""
    with run_folder(folder, MAIN) as partial:
        copy_benchmark(partial)
        write_provenance(partial, {"benchmark": BENCHMARK})


def write_dataset(
    folder: Path, names: Iterable[str], on_scene: Callable[[str], None] = lambda name: None
) -> pd.DataFrame:
    """Write the truths of scenes to a folder, and return the index, which has one row for each scene.

    Scenes without a truth, or whose only truth is a run of the reference, are left out.

    Parameters
    ----------
    folder : Path
        Folder to write; `run_folder` refuses folders whose content would be lost.
    names : iterable of str
        Names of scenes of the catalogue.
    on_scene : callable
        Called with the name of each scene when it is finished.
    """
    package = distribution("stiction")
    words = {
        "version": package.version,
        "format": VERSION,
        "source": source_digest()[:12],
        "licence": package.metadata["License-Expression"],
    }
    with run_folder(folder, MAIN) as partial:
        rows = []
        for name in names:
            row = _write_scene(partial, name)
            if row is not None:
                rows.append(row)
            on_scene(name)
        index = pd.DataFrame(rows)
        index.to_csv(partial / "index.csv", index=False)
        tables = {"columns": _table_of_columns(), "scenes": _table_of_scenes(index)}
        for name, template in TEMPLATES.items():
            text = resources.files("stiction.reports").joinpath(template).read_text("utf-8")
            (partial / name).write_text(text.format(**words, **tables), encoding="utf-8")
        (partial / "LICENSE").write_text(_licence(), encoding="utf-8")
        write_sums(partial)
        write_provenance(partial, words)
    return index


def _licence() -> str:
    """Return the licence: part of the metadata of an installation, a file in a checkout."""
    installed = distribution("stiction").read_text("licenses/LICENSE")
    if installed:
        return installed
    return (Path(__file__).parent.parent / "LICENSE").read_text("utf-8")


def _table_of_columns() -> str:
    """Return a Markdown table of the columns that the tables of the data set may have."""
    rows = [
        (
            ", ".join(f"`{column.owner}.{name}`" for name in column.names),
            column.unit,
            column.meaning,
        )
        for column in COLUMNS
        # Drift is a property of runs; a truth satisfies the constraints.
        if column.owner != "drift"
    ]
    return align_columns(("column", "unit", "what"), rows, [False] * 3)


def _table_of_scenes(index: pd.DataFrame) -> str:
    """Return a Markdown table of the scenes of the data set."""
    rows = [
        (
            row["scene"],
            row["what"],
            f"{row['t_end [s]']:g}",
            Tier(row["tier"]).label,
            str(row["events"]),
            f"{row['position uncertainty [m]']:.1g}",
        )
        for row in index.to_dict("records")
    ]
    heads = ("folder", "what", "t_end [s]", "tier", "events", "positions known to [m]")
    return align_columns(heads, rows, [False, False, True, False, True, True])


def _write_scene(folder: Path, name: str) -> dict[str, Any] | None:
    """Write the truth of a scene to a subfolder, and return its row of the index; None if it is left out."""
    scene = load_scene(name)
    truth = ground_truth(scene)
    if truth.tier in (Tier.OWN_RUN, Tier.NONE):
        return None
    (folder / name).mkdir(parents=True)
    description = write_truth(scene, truth, folder / name)
    # Between two rows, a reader of the table interpolates, which adds to the uncertainty.
    position_uncertainties = [
        uncertainty + description["uncertainty between rows"].get(column, 0.0)
        for column, uncertainty in description["uncertainty"].items()
        if column.endswith((".x", ".y"))
    ]
    return {
        "scene": name,
        "what": scene.title,
        "t_end [s]": description["t_end [s]"],
        "tier": description["tier"],
        "tier of forces": description["tier of forces"],
        "events": description["events"],
        "position uncertainty [m]": max(position_uncertainties),
        "event time uncertainty [s]": truth.uncertainty.get("event time"),
        "certificate": (folder / name / "certificate.json.gz").is_file(),
    }
