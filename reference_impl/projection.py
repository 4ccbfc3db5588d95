"""States onto the constraints, in the metric of the mass matrix, compiled.

The correction of least kinetic metric, dq = -M^-1 J^T (J M^-1 J^T)^-1 Phi, and the same for velocities with Phi'
(e.g. Blajer, Comput. Methods Appl. Mech. Engrg. 200 (2011), Sect. 3).
"""

from __future__ import annotations

import numpy as np
from reference_impl.compiling import kernel

from reference_impl.dynamics import add_rows, row_form
from reference_impl.linear_algebra import eliminate, minimum_norm


@kernel(allocates=True)
def _correct(m, w, residual, n, target):
    """Subtract M^-1 J^T G^-1 residual of the first n rows from target."""
    for r in range(n):
        w.x[r] = residual[r]
        for c in range(n):
            w.A[r, c] = w.G[r, c]
    if not eliminate(w.A, w.x, n):
        w.x[:n] = residual[:n]
        minimum_norm(w.G[:n, :n], w.x[:n])
    w.force[:] = 0.0
    w.force[:n] = -w.x[:n]
    add_rows(m, w, w.force, target)


@kernel(allocates=True)
def project_position(m, w, t, q, v, tolerance, limit):
    """Newton's method on Phi(q, t) = 0 from q, in place; returns the largest residual left (m or rad)."""
    for _ in range(limit):
        row_form(m, w, t, q, v)
        worst = 0.0
        for r in range(m.rows):
            worst = max(worst, abs(w.phi[r]))
        if not worst > tolerance:
            return worst
        _correct(m, w, w.phi, m.rows, q)
    row_form(m, w, t, q, v)
    return np.max(np.abs(w.phi)) if m.rows else 0.0


@kernel
def project_velocity(m, w, t, q, v):
    """Velocities onto Phi' = 0, in place; w must belong to (t, q, v) on entry."""
    _correct(m, w, w.phi_dot, m.rows, v)
