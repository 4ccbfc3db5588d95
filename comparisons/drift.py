"""Constraint drift: residuals of Phi and Phi' over time (the paper's Fig. 14 and beyond)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from comparisons.variants import Record
from scenes import Trajectory

GROWTH = 2.0
"""A residual whose largest value in the last third of the run exceeds that of the first third by this factor grows. Drift that
is linear in time gives 3, quadratic 9; a bounded one that has settled within the first third gives 1."""

ROUNDING = 1e-13
"""Residuals below this, m: rounding of coordinates of some metres (eps * 1 m = 2e-16, summed over some hundred steps'
noise); no growth is read from them."""


def drift_table(records: Iterable[Record]) -> pd.DataFrame:
    """One row per run: size and growth of the residuals of the scene's constraints.

    Residuals are recomputed from the states by the same constraint equations for every engine; the engine's own
    formulation may satisfy others better. At contact fidelity they contain the penetration and clearance of the contacts.
    """
    return pd.DataFrame([{**record.describe(), **drift(record.trajectory)} for record in records])


def drift(trajectory: Trajectory | None) -> dict[str, Any]:
    """Drift of one run; empty values where there is no run. The numbers are exact for the states, up to rounding."""
    row: dict[str, Any] = {"truth tier": "closed form"}
    if trajectory is None or len(trajectory.t) < 3:
        return row
    t, position, velocity = trajectory.t, trajectory["drift.position"], trajectory["drift.velocity"]
    first, last = t <= t[-1] / 3, t >= 2 * t[-1] / 3
    begin, end = float(np.max(position[first])), float(np.max(position[last]))
    row.update({
        "position drift, max [m]": float(np.max(position)), "position drift, first third [m]": begin,
        "position drift, last third [m]": end, "position drift, end [m]": float(position[-1]),
        "velocity drift, max [m/s]": float(np.max(velocity)), "velocity drift, end [m/s]": float(velocity[-1]),
        "bounded": bool(end <= GROWTH * begin or end <= ROUNDING), "uncertainty [m]": ROUNDING})
    return row
