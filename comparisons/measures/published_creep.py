"""Creep in MuJoCo of a capsule held between two pads, and of a hinge held by dry friction, beside published values.

Both comparisons are independent of the suite, because the models, the numbers and the engine are by
other authors. They are listed with their sources in ``comparisons/data/published_creep.toml`` and
``published_joint_creep.toml``.
Values that the sources do not contain were chosen such that some of the published numbers are
reproduced; they are the table ``matched``.
"""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from stiction.engines.registry import experiment, load_engine


def _data(name: str) -> dict[str, Any]:
    """Return the content of a file of published values."""
    file = resources.files("stiction.comparisons") / "data" / name
    return tomllib.loads(file.read_text("utf-8"))


_DATA = _data("published_creep.toml")
_JOINT_DATA = _data("published_joint_creep.toml")
ENGINE = _DATA["engine"]
"""Name of the engine whose creep was published."""
PUBLISHED = "published_creep"
"""Column: published creep, um/s downwards; nan if only the load was published."""
CREEP = "creep_um"
"""Column: creep in the simulation, um/s downwards."""
UNCERTAINTY = "creep_um_uncertainty"
"""Column: difference of two estimates of the creep over the same 2 s, by the ends and by least
squares, um/s. They differ if the capsule rocks."""
JOINT_PUBLISHED = "published_joint_creep"
"""Column: published creep of a joint, rad/s; nan if the source says in words that it creeps."""
JOINT_CREEP = "joint_creep_here"
"""Column: speed of the joint in the simulation, rad/s."""
JOINT_UNCERTAINTY = "joint_creep_here_uncertainty"
"""Column: change of that speed in the last fifth of the run, rad/s: large where the joint is accelerated."""
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


def published_joint_creep() -> pd.DataFrame:
    """Simulate all published cases of a hinge in MuJoCo.

    Returns
    -------
    DataFrame
        One row for each case, with the columns ``case``, `JOINT_PUBLISHED`, `JOINT_CREEP`,
        `JOINT_UNCERTAINTY`, `MATCHED`, ``published_statement`` (the source in words), ``moves``
        (whether the joint should move), ``difference`` (from the source), ``source``, and
        ``version`` of the engine.

    Raises
    ------
    EngineMissing
        If MuJoCo is not installed.
    """
    data = _JOINT_DATA
    model, version = data["model"] | data["matched"], load_engine(data["engine"]).version
    measure = experiment(data["engine"], data["experiment"])
    rows = []
    for case in data["cases"]:
        creep, change = measure(model, **case["options"])
        rows.append(
            {
                "case": case["name"],
                JOINT_PUBLISHED: case.get("published_rad_s", np.nan),
                JOINT_CREEP: creep,
                JOINT_UNCERTAINTY: change,
                MATCHED: case.get("matched", False),
                "published_statement": case["claim"],
                "moves": case["moves"],
                "difference": case.get("why", ""),
                "source": case["source"],
                "version": version,
            }
        )
    return pd.DataFrame(rows)
