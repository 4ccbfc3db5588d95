"""The friction benchmark: a frozen set of scenes with their truths, which is part of the installation."""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pandas as pd

NAME = "friction-benchmark 1"
"""Name and version of the set."""
FOLDER = Path(__file__).parent.parent / "data" / "friction-benchmark-1"
"""Folder of the set. Its files never change; another set gets another version."""
SCENES = "scenes"
"""Subfolder with a folder for each scene, which `truth_folder.read_truth` reads."""
TABLE = "scenes"
"""Name of the table of all scenes, without its extension."""
UNCERTAINTIES = "uncertainties"
"""Name of the table of the uncertainties of all columns, without its extension."""
EVENTS = "events"
"""Name of the table of all events, without its extension."""
MAIN = "README.md"
"""File that a folder with a copy of the set contains."""


class BenchmarkScene(NamedTuple):
    """What the rule book states about a scene.

    Attributes
    ----------
    name : str
        Name of the scene.
    position_bound : float
        Bound of the largest position error, m.
    effort_bound : float or None
        Bound of the mean error of efforts, N m or N, if the drives prescribe the motion.
    rest_speed : float or None
        Speed below which a joint is at rest, m/s (pins: rad/s); None for a scene without friction.
    max_step : float
        Largest distance of the rows of a result, s.
    """

    name: str
    position_bound: float
    effort_bound: float | None
    rest_speed: float | None
    max_step: float

    @property
    def folder(self) -> Path:
        """Folder of the scene and its truth."""
        return FOLDER / SCENES / self.name


@cache
def benchmark_scenes() -> tuple[BenchmarkScene, ...]:
    """Return the scenes of the benchmark, in the order of its table."""
    table = pd.read_csv(FOLDER / f"{TABLE}.csv")
    columns = table[["scene", "position_bound", "effort_bound", "rest_speed", "max_step"]]
    # A scene without drives that prescribe the motion, or without friction, has an empty cell.
    with_none = columns.astype(object).where(columns.notna(), None)
    return tuple(BenchmarkScene(*row) for row in with_none.itertuples(index=False))


def copy_benchmark(folder: Path) -> None:
    """Copy all files of the set to an existing folder."""
    shutil.copytree(FOLDER, folder, dirs_exist_ok=True)
