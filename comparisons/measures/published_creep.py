"""Creep of a capsule between two pads, as MuJoCo has it here and as others published it.

It is an anchor outside of this suite: its model, its numbers and its engine are not ours. The listing of the model and
the numbers are in ``comparisons/data/published_creep.toml`` with their sources; what could not be read there, and was
chosen to meet some of the numbers, is named there as matched.
"""

from __future__ import annotations

import tomllib
from importlib import resources

import numpy as np
import pandas as pd

from stiction.engines.registry import experiment, load_engine

_DATA = tomllib.loads(
    (resources.files("stiction.comparisons") / "data" / "published_creep.toml").read_text("utf-8")
)
ENGINE = _DATA["engine"]
"""The engine whose creep was published."""
PUBLISHED, CREEP, UNCERTAINTY, MATCHED = (
    "published_creep",
    "creep_um",
    "creep_um_uncertainty",
    "matched",
)


def published_creep() -> pd.DataFrame:
    """Run all published cases in MuJoCo; some seconds.

    Returns
    -------
    DataFrame
        A row a case: `case`, `published_creep`, `creep_um` downwards with its `creep_um_uncertainty` (between
        ends and least squares of the same 2 s, which differ by what rocks), `load_N` of both pads and
        `published_load`, `margin` (Coulomb's limit over weight), `matched` (True where the case had part in
        the choice of what the source does not say), `source`, `version`.

    Raises
    ------
    EngineMissing
        If MuJoCo is not installed.
    """
    model, version = _DATA["model"] | _DATA["matched"], load_engine(ENGINE).version
    creep_and_load = experiment(ENGINE, _DATA["experiment"])
    rows = []
    for case in _DATA["cases"]:
        creep, uncertainty, load = creep_and_load(model, **case["options"])
        rows.append(
            {
                "case": case["name"],
                PUBLISHED: case.get("published_um_s", np.nan),
                CREEP: creep,
                UNCERTAINTY: uncertainty,
                "load_N": load,
                "published_load": case.get("published_N", np.nan),
                "margin": model["friction"][0] * load / (model["capsule_mass"] * model["gravity"]),
                MATCHED: case.get("matched", False),
                "source": case["source"],
                "version": version,
            }
        )
    return pd.DataFrame(rows)
