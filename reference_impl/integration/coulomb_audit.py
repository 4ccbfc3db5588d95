"""Audit of a run: the HLCP solved afresh at sampled instants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.reference_impl.friction import hlcp
from stiction.reference_impl.friction.outcomes import PIN_LOADS, SOLVED
from stiction.reference_impl.friction.pins_under_load import (
    BLURRED_RESIDUAL,
    MOST_PASSES,
    take_loads,
)
from stiction.reference_impl.multibody.dynamics import acceleration, row_form
from stiction.reference_impl.multibody.mechanism import (
    Arrays,
    Mechanism,
    Workspace,
    workspace,
)
from stiction.scenes import Trajectory
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.trajectory import stacked


@dataclass(frozen=True)
class Audit:
    """Outcome of an audit."""

    instants: int
    """Instants at which the HLCP was solved."""
    complementarity: float
    """Largest residual of eqs. (37)-(38), relative to the largest term (`hlcp.residual`)."""
    acceleration: float
    """Largest difference between the trajectory's accelerations and those of the HLCP, relative to the largest one or
    to what the applied forces would cause without joints, if that is larger."""
    unsolved: int
    """Instants at which Lemke's method found no solution."""


def _solve(
    m: Arrays, w: Workspace, slip: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Solve the HLCP for the rows in a workspace, with bounds of pins that agree with the forces in them.

    Returns row forces, y, x and the outcome, as `hlcp.solve`.
    """
    for _ in range(MOST_PASSES):
        force, y, x, outcome, *_ = hlcp.solve(m, w, slip)
        w.force[:] = force
        if not m.pins or outcome != SOLVED or take_loads(m, w) <= BLURRED_RESIDUAL:
            return force, y, x, outcome
    return force, y, x, PIN_LOADS


def audit(trajectory: Trajectory, mechanism: Mechanism, instants: int = 1000) -> Audit:
    """Solve the HLCP at evenly spread samples of a reference trajectory, which has the contact modes, and compare.

    The mechanism has the stabilization that the trajectory was computed with.
    """
    mechanism = mechanism.of_one_run()
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    if not m.rows:
        return Audit(0, 0.0, 0.0, 0)
    q, v, a = (stacked(trajectory.columns, mechanism.body_names, labels) for labels in BODY_COLUMNS)
    slip = np.array([trajectory[f"{name}.mode"] for name in mechanism.guide_names], dtype=np.int64)
    slip = slip.reshape(len(m.friction), len(trajectory.t)).T.copy()
    chosen = np.unique(np.linspace(0, len(trajectory.t) - 1, instants).astype(int))
    residual, difference, unsolved, largest = 0.0, 0.0, 0, 0.0
    fresh = np.zeros(len(m.inverse_mass))
    for i in chosen:
        row_form(m, w, trajectory.t[i], q[i], v[i])
        force, y, x, outcome = _solve(m, w, slip[i])
        if outcome != SOLVED:
            unsolved += 1
            continue
        A0, A1, b, *_ = hlcp.assemble(m, w, slip[i])
        residual = max(residual, hlcp.residual(A0, A1, b, y, x))
        acceleration(m, w, force, fresh)
        difference = max(difference, float(np.max(np.abs(fresh - a[i]))))
        largest = max(largest, float(np.max(np.abs(a[i]))), float(np.max(np.abs(w.free))))
    return Audit(len(chosen), residual, difference / largest if largest else difference, unsolved)
