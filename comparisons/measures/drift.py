"""Constraint drift of single runs: size and growth of the residuals of Phi and Phi', as in Fig. 14 of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stiction.comparisons.measures.drift_growth import growth
from stiction.scenes import Scene, Trajectory
from stiction.uncertain import Uncertain

ROUNDING = 1e-13
"""Size of residuals that rounding can cause, m: coordinates of some metres, each rounded by about
2e-16 m, accumulated over some hundred steps."""
DECAY_ERROR = "decay_error"
"""Column: see `decay_error`."""
CLEAR = 1e-3
"""Largest ratio of rounding to the initial residual at which its decay is measured."""
SETTLED = 16
"""The growth is measured from t_end / SETTLED on, that is, over four octaves."""
EQUAL_ROOTS = 1e-8
"""Half the difference of the roots of Baumgarte's equation, relative to alpha, that replaces 0 if
the roots are equal.

The formula for different roots can then be used. Its relative error is the square of this number,
and its rounding error is that of a float divided by this number; both are below 1e-7.
"""
STATE_ROUNDING = 16
"""Rounding error of a residual in units of that of the largest coordinate: a residual is a norm of
sums of some products."""


def drift(trajectory: Trajectory | None) -> dict[str, Any]:
    """Return size and growth of the residuals of the constraints in a run, as columns of a table.

    There are none if the run failed (None). The residuals of all engines are computed from the
    states by the constraint equations of the suite (`trajectory_columns.residual_norms`); an engine
    may satisfy the constraints more accurately in its own formulation. At contact fidelity, they
    include the penetration and clearance of contacts. The growth in so short a run is often
    inconclusive; `stiction.comparisons.studies.long_drift` measures longer ones.
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
    """Return the largest error of the decay of an initial constraint violation, relative to the violation.

    With Baumgarte's stabilization, Phi'' + 2 alpha Phi' + beta^2 Phi = 0 (Baumgarte 1972; eq. (25)
    of the paper) for each constraint. If Phi' = 0 at the start, |Phi| therefore decays by the same
    factor in every mechanism.

    Returns None if the scene or the run has another stabilization, or if rounding or Phi' at the
    start exceed `CLEAR` times the violation.
    """
    law = scene.stabilization
    used = trajectory.settings.get("stabilization")
    if law.method != "baumgarte" or not isinstance(used, Mapping) or used["method"] != "baumgarte":
        return None
    position = trajectory["drift.position"]
    rounding = rounding_of(trajectory)
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
    """Return a bound of the rounding error of the residuals of a state, m.

    It is proportional to the largest coordinate, which may be the growing angle of a rotating bar.
    """
    coordinates = [
        values
        for name, values in trajectory.columns.items()
        if name.rpartition(".")[2] in ("x", "y", "angle")
    ]
    largest = float(max((np.max(np.abs(values)) for values in coordinates), default=0.0))
    return STATE_ROUNDING * np.finfo(float).eps * largest


def rounding_over(trajectory: Trajectory) -> float:
    """Return a bound of the rounding error accumulated over a run, m: `rounding_of` times the number of steps."""
    return rounding_of(trajectory) * max(1, trajectory.cost.counters.get("steps", 1))
