"""States onto the constraints, in the metric of the mass matrix, compiled.

The correction of least kinetic metric, dq = -M^-1 J^T (J M^-1 J^T)^-1 Phi, and the same for velocities with Phi'
(e.g. Blajer, Comput. Methods Appl. Mech. Engrg. 200 (2011), Sect. 3). Near a singular position what cannot be corrected
without magnifying rounding waits until it can: see `singular_positions`.
"""

from __future__ import annotations

from stiction.reference_impl.compiled.bundle import Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import ELIMINATION, RANK_TOLERANCE, minimum_norm, solve_in_place
from stiction.reference_impl.multibody.banded_systems import solve_bilateral
from stiction.reference_impl.multibody.dynamics import add_rows, row_form
from stiction.reference_impl.multibody.kinematics import Workspace
from stiction.reference_impl.multibody.mechanism import Arrays
from stiction.reference_impl.multibody.singular_positions import leave_nearly_dependent


@kernel
def _correct(m: Arrays, w: Workspace, residual: Reals, n: int, target: Reals) -> None:
    """Subtract M^-1 J^T G^-1 residual of the first n rows from target.

    Nearly dependent rows lose their part of the residual.
    """
    regular = len(m.cell) > 0
    for c in range(len(m.cell)):
        regular = regular and solve_bilateral(m, w, c, residual)
    if regular:
        for r in range(len(w.force)):
            w.force[r] *= -1.0
        add_rows(m, w, w.force, target)
        return
    if len(m.cell) > 0 or not _solve(w, residual, n, ELIMINATION):
        leave_nearly_dependent(m, w, residual)
        if not _solve(w, residual, n, RANK_TOLERANCE):
            for r in range(n):
                w.x[r] = residual[r]
            minimum_norm(w.G, w.x, n)
    for r in range(len(w.force)):
        w.force[r] = -w.x[r] if r < n else 0.0
    add_rows(m, w, w.force, target)


@kernel
def _solve(w, residual, n, tolerance):
    """The leading n x n part of G times w.x = residual.

    False, with w.x destroyed, where a pivot is below the tolerance.
    """
    for r in range(n):
        w.x[r] = residual[r]
        for c in range(n):
            w.A[r, c] = w.G[r, c]
    return solve_in_place(w.A, w.x, w.unit, n, n, tolerance)


@kernel
def project(m: Arrays, w: Workspace, t: float, q: Reals, v: Reals, tolerance: float, limit: int) -> None:
    """Newton's method on Phi(q, t) = 0, in place, down to a `tolerance` (m or rad); then velocities onto Phi' = 0.

    The rows of the workspace (`dynamics.row_form`) must be those of (t, q, v).
    """
    for _ in range(limit):
        worst = 0.0
        for r in range(m.rows):
            worst = max(worst, abs(w.phi[r]))
        if not worst > tolerance:
            break
        _correct(m, w, w.phi, m.rows, q)
        row_form(m, w, t, q, v)
    _correct(m, w, w.phi_dot, m.rows, v)
