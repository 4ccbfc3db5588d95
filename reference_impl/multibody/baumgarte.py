"""Baumgarte's stabilization: `Phi'' + 2 alpha Phi' + beta^2 Phi = 0` in the place of `Phi'' = 0`, compiled.

Baumgarte (1972), and eqs. (25), (31) of the paper. With Phi'' = J q'' + gamma the constraint rows ask for

    J q'' = -gamma - 2 alpha Phi' - beta^2 Phi.

`Arrays` has the `coefficients`, zero without this stabilization.
"""

from __future__ import annotations

from stiction.reference_impl.compiled.kernel import kernel

PAPERS = 90.0, 10.0
"""The paper's alpha and beta (1/s), where a scene declares none."""


def coefficients(alpha: float, beta: float) -> dict[str, float]:
    """Return 2 alpha and beta^2 (1/s, 1/s^2), by their names in `Arrays`."""
    return {"baumgarte_2alpha": 2.0 * alpha, "baumgarte_beta2": beta**2}


@kernel(inline=True)
def required(m, w, r):
    """Return what row r of J q'' must be: (25), (31)."""
    return -w.gamma[r] - m.baumgarte_2alpha * w.phi_dot[r] - m.baumgarte_beta2 * w.phi[r]


@kernel(inline=True)
def terms(m, w, r):
    """Return 2 alpha Phi' + beta^2 Phi of row r."""
    return m.baumgarte_2alpha * w.phi_dot[r] + m.baumgarte_beta2 * w.phi[r]


@kernel
def leave_out(w, r):
    """Take the terms out of row r of the workspace, where more guides hold a mechanism than it has freedoms.

    There they ask redundant rows for accelerations that contradict each other, and what is held has no drift to be
    taken back.
    """
    w.right[r] += w.stabilizing[r]
    w.stabilizing[r] = 0.0


@kernel
def is_used(m):
    """Return True where the terms are in the equations."""
    return m.baumgarte_2alpha > 0.0 or m.baumgarte_beta2 > 0.0
