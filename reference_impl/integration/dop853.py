"""One step of the explicit Runge-Kutta method of order 8(5,3), with its dense output of order 7, compiled.

Source: Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I (1993), Sect. II.5, II.6 (DOP853).
"""

from __future__ import annotations

import tomllib
from importlib import resources

import numpy as np

from stiction.reference_impl.compiled.kernel import kernel

STAGES, EXTRA = 12, 3
"""Stages of a step, without the derivative at its end, and those of the dense output beyond it."""
_TABLE = {
    name: np.array(numbers)
    for name, numbers in tomllib.loads(
        resources.files(__package__).joinpath("dop853.toml").read_text("utf-8")
    ).items()
}
A, C = _TABLE["A"][: STAGES + 1, :STAGES].copy(), _TABLE["C"][: STAGES + 1]
"""Weights of the stages and, last, of the step; times of the stages and of its end as fractions of the step."""
A_EXTRA, C_EXTRA = _TABLE["A"][STAGES + 1 :], _TABLE["C"][STAGES + 1 :]
"""Those of the extra stages, (EXTRA, STAGES + 1 + EXTRA) and (EXTRA,)."""
E3, E5, D = (_TABLE[name] for name in ("E3", "E5", "D"))
"""Weights of the error estimates of orders 3 and 5, and of the last four terms of the dense output."""
BY_TIME = np.append(-1, np.argsort(np.argsort(C[1:], kind="stable")))
"""Place of each stage but the first in the order of their times."""


@kernel
def combine(K, row, count, h, y, out):
    """Put y + h sum_j row[j] K[j] into out; the terms in their order, without those of weight 0.

    Parameters
    ----------
    K : ndarray, shape (stages, n)
    row : ndarray
        Weights.
    count : int
        Number of stages that they are of.
    """
    for i in range(len(y)):
        out[i] = 0.0
    for j in range(count):
        if row[j] != 0.0:
            for i in range(len(y)):
                out[i] += row[j] * K[j, i]
    for i in range(len(y)):
        out[i] = y[i] + h * out[i]


@kernel
def error_norm(K, h, scale, bodies):
    """Estimate the local error in units of `scale`: 1 is at the tolerance; inf if a component is not finite.

    It is an error of order 5 times its ratio to one of order 3, each the largest of a group of components: of all, or,
    if it is not 0, of each of so many bodies. Where one body turns fast, its error of order 3 hides an error of
    another, which goes straight on.
    """
    n = K.shape[1] // 2
    worst = 0.0
    for group in range(max(bodies, 1)):
        # largest errors of orders 5 and 3 in the group: of a body its three coordinates and its three speeds
        worst5, worst3 = 0.0, 0.0
        for place in range(6 if bodies > 0 else K.shape[1]):
            i = place
            if bodies > 0:
                i = 3 * group + place % 3 + (n if place > 2 else 0)
            if scale[i] == 0.0:
                continue
            e5, e3 = 0.0, 0.0
            for j in range(STAGES + 1):
                e5 += E5[j] * K[j, i]
                e3 += E3[j] * K[j, i]
            if not np.isfinite(e5 + e3):
                return np.inf  # max would drop a nan
            worst5 = max(worst5, abs(e5) / scale[i])
            worst3 = max(worst3, abs(e3) / scale[i])
        if worst5 != 0.0 or worst3 != 0.0:
            worst = max(
                worst, abs(h) * worst5 * worst5 / np.sqrt(worst5 * worst5 + 0.01 * worst3 * worst3)
            )
    return worst


@kernel
def dense_coefficients(K, h, y, y_new, F):
    """Fill F (7, n) with the coefficients of the interpolating polynomial; K holds all 16 stages."""
    for i in range(len(y)):
        change = y_new[i] - y[i]
        F[0, i] = change
        F[1, i] = h * K[0, i] - change
        F[2, i] = 2.0 * change - h * (K[STAGES, i] + K[0, i])
        for k in range(4):
            total = 0.0
            for j in range(STAGES + 1 + EXTRA):
                total += D[k, j] * K[j, i]
            F[3 + k, i] = h * total


@kernel
def dense_at(F, y, x, out):
    """Evaluate the state at the fraction x of the step, into out, by Horner's scheme in x and 1 - x in turns."""
    for i in range(len(y)):
        value = 0.0
        for k in range(7):
            value = (value + F[6 - k, i]) * (x if k % 2 == 0 else 1.0 - x)
        out[i] = y[i] + value
