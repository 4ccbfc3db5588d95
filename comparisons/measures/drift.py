"""Constraint drift of single runs: size and growth of the residuals of Phi and Phi' (the paper's Fig. 14)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stiction.comparisons.measures.drift_growth import growth
from stiction.scenes import Scene, Trajectory
from stiction.uncertain import Uncertain

ROUNDING = 1e-13
"""Residuals below this, m: rounding of coordinates of some metres (eps * 1 m = 2e-16, summed over some hundred steps'
noise)."""
DECAY_ERROR = "decay_error"
CLEAR = 1e-3
"""Largest part of a start off the constraints that rounding may be, for the decay of the start to be measured."""
SETTLED = 16
"""The growth is measured from the end of the run over this on: over four octaves."""
EQUAL_ROOTS = 1e-8
"""Half the distance of the roots, relative to alpha, in place of none.

The quotient for equal roots is a limit. An error of the square of this, and rounding over it, are
both below 1e-7.
"""
STATE_ROUNDING = 16
"""Roundings of a coordinate that a residual may have: it sums some squares of differences of some products."""


def drift(trajectory: Trajectory | None) -> dict[str, Any]:
    """Return size and growth of the residuals of the scene's constraints in a run; without a run there are none.

    Residuals are recomputed from the states by the same constraint equations for every engine
    (`trajectory_columns.residual_norms`); the engine's own formulation may satisfy others better. At contact fidelity
    they contain the penetration and clearance of contacts. Growth over so short a run is often inconclusive;
    `stiction.comparisons.studies.long_drift` has longer ones.
    """
    row: dict[str, Any] = {"truth_tier": "closed form"}
    if trajectory is None or len(trajectory.t) < 3:
        return row
    t, position, velocity = trajectory.t, trajectory["drift.position"], trajectory["drift.velocity"]
    law = growth(t, position, t[-1] / SETTLED, rounding_of(trajectory))
    return row | {
        "position_drift": float(np.max(position)),
        "position_drift_end": float(position[-1]),
        "velocity_drift": float(np.max(velocity)),
        "velocity_drift_end": float(velocity[-1]),
        "growth": law.verdict,
        "growth_exponent": law.exponent,
        "growth_exponent_uncertainty": law.uncertainty,
        "drift_uncertainty": ROUNDING,
    }


def decay_error(trajectory: Trajectory, scene: Scene) -> Uncertain | None:
    """Compare the decay of a start off the constraints with that of Baumgarte's equation, over its size at the start.

    Phi'' + 2 alpha Phi' + beta^2 Phi = 0 (Baumgarte 1972; eq. (25) of the paper) holds for each row, so that |Phi|
    falls by the same factor in every mechanism where Phi' = 0 at the start. None for a run that stabilizes otherwise,
    and where rounding is more than `CLEAR` of the start.
    """
    law, used = scene.stabilization, trajectory.settings.get("stabilization")
    position, rounding = trajectory["drift.position"], rounding_of(trajectory)
    if law.method != "baumgarte" or not isinstance(used, Mapping) or used["method"] != "baumgarte":
        return None
    if not rounding + trajectory["drift.velocity"][0] < CLEAR * position[0]:
        return None
    # Solution with Phi' = 0 at the start, by the roots of the characteristic polynomial.
    root = np.sqrt(complex(law.alpha**2 - law.beta**2)) or EQUAL_ROOTS * law.alpha
    faster, slower = -law.alpha - root, -law.alpha + root
    modes = slower * np.exp(faster * trajectory.t) - faster * np.exp(slower * trajectory.t)
    factor = modes / (slower - faster)
    error = np.max(np.abs(position / position[0] - np.abs(factor.real)))
    return Uncertain(float(error), rounding / position[0])


def rounding_of(trajectory: Trajectory) -> float:
    """Return a bound of what rounding adds to the residuals of a state: a multiple of eps times its largest coordinate.

    A coordinate is rounded by eps times its size, which for the angle of a turning bar grows.
    """
    states = [
        values
        for name, values in trajectory.columns.items()
        if name.rpartition(".")[2] in ("x", "y", "angle")
    ]
    largest = float(max((np.max(np.abs(values)) for values in states), default=0.0))
    return STATE_ROUNDING * np.finfo(float).eps * largest


def rounding_over(trajectory: Trajectory) -> float:
    """Return a bound of what rounding adds over a run, m: `rounding_of` a state, for each step that it counts."""
    return rounding_of(trajectory) * max(1, trajectory.cost.counters.get("steps", 1))
