"""Creep of a capsule held between two pads in MuJoCo, compared with published values.

This comparison is independent of the suite, because the model, the numbers and the engine are by
other authors. They are listed with their sources in ``comparisons/data/published_creep.toml``.
Values that the sources do not contain were chosen such that some of the published numbers are
reproduced; they are the table ``matched``.
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
"""Name of the engine whose creep was published."""
PUBLISHED = "published_creep"
"""Column: published creep, um/s downwards; nan if only the load was published."""
CREEP = "creep_um"
"""Column: creep in the simulation, um/s downwards."""
UNCERTAINTY = "creep_um_uncertainty"
"""Column: difference of two estimates of the creep over the same 2 s, by the ends and by least
squares, um/s. They differ if the capsule rocks."""
MATCHED = "matched"
"""Column: True if the case was used to choose values that the sources do not contain."""


def published_creep() -> pd.DataFrame:
    """Simulate all published cases in MuJoCo, which takes some seconds.

    Returns
    -------
    DataFrame
        One row for each case, with the columns ``case``, `PUBLISHED`, `CREEP`, `UNCERTAINTY`,
        ``load_N`` (load of both pads) and ``published_load``, ``margin`` (limit of static friction
        divided by weight), `MATCHED`, ``source`` and ``version`` of the engine.

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
