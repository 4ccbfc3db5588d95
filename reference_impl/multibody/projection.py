"""States onto the constraints, in the metric of the mass matrix, compiled.

The correction of least kinetic metric, dq = -M^-1 J^T (J M^-1 J^T)^-1 Phi, and the same for velocities with Phi'
(e.g. Blajer, Comput. Methods Appl. Mech. Engrg. 200 (2011), Sect. 3). A guide at rest is one more row: positions are
corrected without moving it, and velocities so that it has none. Where more guides rest than there are freedoms, these
rows are dependent and left out. Near a singular position what cannot be corrected without magnifying rounding waits
until it can: see `singular_positions`.
"""

from __future__ import annotations

from stiction.reference_impl.compiled.bundle import Integers, Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import (
    ELIMINATION,
    RANK_TOLERANCE,
    minimum_norm,
    solve_in_place,
)
from stiction.reference_impl.friction.coulomb import sticks
from stiction.reference_impl.multibody.banded_systems import solve_cell
from stiction.reference_impl.multibody.dynamics import add_rows, row_form
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace
from stiction.reference_impl.multibody.singular_positions import remove_nearly_dependent

MET = 1e-15
"""Residual of a constraint that is met, m or rad, in parts of the mechanism's size."""


@kernel
def _correct(
    m: Arrays,
    w: Workspace,
    residual: Reals,
    rate: float,
    slip: Integers,
    holds: bool,
    target: Reals,
) -> None:
    """Subtract M^-1 J^T G^-1 residual from target; the residual of a guide at rest is `rate` times its slip velocity.

    Nearly dependent rows lose their part of the residual.
    """
    # with the rows of guides at rest if it `holds`; without them where they make the system singular
    regular = len(m.cell) > 0
    for c in range(len(m.cell)):
        regular = regular and (
            holds
            and solve_cell(m, w, c, residual, rate, slip, True)
            or solve_cell(m, w, c, residual, rate, slip, False)
        )
    if len(m.cell) == 0:
        regular = (
            holds
            and _solve(m, w, residual, rate, slip, True, ELIMINATION)
            or _solve(m, w, residual, rate, slip, False, ELIMINATION)
        )

    # A singular position, or redundant rows: what cannot be corrected without magnifying rounding is taken out of the
    # residual, and exactly dependent rows share the rest in the sense of least norm.
    if not regular:
        remove_nearly_dependent(m, w, residual)
        if not _solve(m, w, residual, rate, slip, False, RANK_TOLERANCE):
            for r in range(m.rows):
                w.force[r] = residual[r]
            minimum_norm(w.G, w.force, m.rows)

    for r in range(len(w.force)):
        w.force[r] *= -1.0
    add_rows(m, w, w.force, target)


@kernel
def _solve(m, w, residual, rate, slip, holds, tolerance):
    """Solve G force = residual of the constraint rows; return False where a pivot is small.

    If it `holds`, guides at rest have rows as well.
    """
    size = len(w.force) if holds else m.rows
    for r in range(len(w.force)):
        w.force[r] = 0.0
    for r in range(size):
        f = r - m.rows
        is_active = f < 0 or sticks(m, slip, f)
        # the row of a guide that slips has its diagonal entry alone, so that its force is zero
        for c in range(size):
            w.A[r, c] = w.G[r, c] if is_active or r == c else 0.0
        if f < 0:
            w.force[r] = residual[r]
        else:
            w.force[r] = rate * w.slip_speed[f] if is_active else 0.0
    return solve_in_place(w.A, w.force, w.unit, size, size, tolerance)


@kernel
def project(
    m: Arrays, w: Workspace, t: float, q: Reals, v: Reals, slip: Integers, holds: bool, limit: int
) -> None:
    """Newton's method on Phi(q, t) = 0, in place, down to `MET`, `limit` steps at most; then velocities onto Phi' = 0.

    `holds`: whether guides at rest, of slip 0, count. The rows of the workspace must be those of (t, q, v).
    """
    # positions: the rows are evaluated anew after each step, and are those of (t, q, v) at the end
    for _ in range(limit):
        worst = 0.0
        for r in range(m.rows):
            worst = max(worst, abs(w.phi[r]))
        if not worst > MET * m.length_scale:
            break
        _correct(m, w, w.phi, 0.0, slip, holds, q)
        row_form(m, w, t, q, v)

    # velocities: Phi' is linear in them, so that one step is exact
    _correct(m, w, w.phi_dot, 1.0, slip, holds, v)
