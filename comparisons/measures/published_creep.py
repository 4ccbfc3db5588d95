"""Creep of a capsule between two pads, as MuJoCo has it here and as others published it.

It is an anchor outside of this suite: its model, its numbers and its engine are not ours. The listing of the model and
the numbers are in ``comparisons/data/published_creep.toml`` with their sources; what could not be read there, and was
chosen to meet some of the numbers, is named there as matched.
"""

from __future__ import annotations

import tomllib
from decimal import Decimal
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from stiction.engines.isolation import Task
from stiction.engines.mujoco.grasp import creep_and_load
from stiction.engines.registry import load_engine

PUBLISHED, CREEP, UNCERTAINTY, MATCHED = "published [um/s]", "creep [um/s]", "uncertainty [um/s]", "matched"


def last_digit(published: float) -> float:
    """Return one unit of the last digit of a printed number that is not 0: of 1500 it is 100, of 1.4 it is 0.1."""
    return float(Decimal(1).scaleb(int(Decimal(repr(published)).normalize().as_tuple().exponent)))


def published_creep() -> pd.DataFrame:
    """Run all published cases in MuJoCo; some seconds.

    Returns
    -------
    DataFrame
        A row a case: `case`, `published [um/s]` with `last digit [um/s]`, `creep [um/s]` downwards with its
        `uncertainty [um/s]` (between ends and least squares of the same 2 s, which differ by what rocks), `ratio` of
        creep to published, `load [N]` of both pads and `published load [N]`, `margin` (Coulomb's limit over weight),
        `matched` (True where the case had part in the choice of what the source does not say), `source`, `version`.

    Raises
    ------
    EngineMissing
        If MuJoCo is not installed.
    """
    data = _data()
    version = load_engine(data["engine"]).version
    model = data["model"] | data["matched"]
    rows = []
    for case in data["cases"]:
        published = case.get("published_um_s", np.nan)
        creep, uncertainty, load = creep_and_load(model, **case["options"])
        rows.append({"case": case["name"], PUBLISHED: published,
                     "last digit [um/s]": last_digit(published) if published > 0 else np.nan, CREEP: creep,
                     UNCERTAINTY: uncertainty, "ratio": creep / published, "load [N]": load,
                     "published load [N]": case.get("published_N", np.nan),
                     "margin": model["friction"][0] * load / (model["capsule_mass"] * model["gravity"]),
                     MATCHED: case.get("matched", False), "source": case["source"], "version": version})
    return pd.DataFrame(rows)


def published_engine() -> str:
    """Return the engine whose creep was published."""
    return str(_data()["engine"])


def _data() -> dict[str, Any]:
    file = resources.files("stiction.comparisons") / "data" / "published_creep.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def published_creep_task() -> Task:
    """Return `published_creep` as a task of the runner."""
    return Task("hold/published creep", published_creep)
