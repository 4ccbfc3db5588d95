"""Data set of truths for people without stiction: a folder for every scene with an independent truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from importlib import resources
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.bench.environment import source_digest
from stiction.comparisons.judge.truth_folder import VERSION, write_sums, write_truth
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.reports.markdown.tables import aligned
from stiction.reports.run_folder.overwriting import run_folder, write_provenance
from stiction.scenes import load_scene
from stiction.scenes.columns import COLUMNS
from stiction.truths import Tier

MAIN = "README.md"
"""The file by which a folder is known as a data set; one of an earlier call is replaced."""


def write_dataset(
    folder: Path, names: Iterable[str], on_scene: Callable[[str], None] = lambda name: None
) -> pd.DataFrame:
    """Write the truths of scenes of the catalogue; return the index, a row per scene. What it refuses: `run_folder`.

    A scene whose only truth is our own run, or that has none, is left out.
    """
    about, code = distribution("stiction"), resources.files("stiction.reports")
    # of an installation in its metadata, of a checkout a file beside the packages
    licence = about.read_text("licenses/LICENSE") or (
        Path(__file__).parent.parent / "LICENSE"
    ).read_text("utf-8")
    words = {
        "version": about.version,
        "format": VERSION,
        "source": source_digest()[:12],
        "licence": about.metadata["License-Expression"],
    }
    with run_folder(folder, MAIN) as partial:
        index = pd.DataFrame(
            [row for name in names for row in _write_scene(partial, name, on_scene)]
        )
        index.to_csv(partial / "index.csv", index=False)
        columns = [
            (
                ", ".join(f"`{column.owner}.{name}`" for name in column.names),
                column.unit,
                column.meaning,
            )
            for column in COLUMNS
            if column.owner != "drift"
        ]
        scenes = [
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
        tables = {
            "columns": aligned(("column", "unit", "what"), columns, [False] * 3),
            "scenes": aligned(
                ("folder", "what", "t_end [s]", "tier", "events", "positions known to [m]"),
                scenes,
                [False, False, True, False, True, True],
            ),
        }
        for name, template in (
            (MAIN, "dataset_readme.md"),
            ("CITATION.cff", "dataset_citation.cff"),
        ):
            text = (code / template).read_text(encoding="utf-8").format(**words, **tables)
            (partial / name).write_text(text, encoding="utf-8")
        (partial / "LICENSE").write_text(licence, encoding="utf-8")
        write_sums(partial)
        write_provenance(partial, words)
    return index


def _write_scene(
    folder: Path, name: str, on_scene: Callable[[str], None]
) -> Iterator[dict[str, Any]]:
    scene = load_scene(name)
    truth = ground_truth(scene)
    if truth.tier not in (Tier.OWN_RUN, Tier.NONE):
        (folder / name).mkdir(parents=True)
        about = write_truth(scene, truth, folder / name)
        positions = [
            value + about["uncertainty between rows"].get(column, 0.0)
            for column, value in about["uncertainty"].items()
            if column.endswith((".x", ".y"))
        ]
        yield {
            "scene": name,
            "what": scene.title,
            **{key: about[key] for key in ("t_end [s]", "tier", "tier of forces", "events")},
            "position uncertainty [m]": max(positions),
            "event time uncertainty [s]": truth.uncertainty.get("event time"),
            "certificate": (folder / name / "certificate.json.gz").is_file(),
        }
    on_scene(name)
