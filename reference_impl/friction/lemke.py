"""Lemke's complementary pivoting for w = M z + q, w >= 0, z >= 0, w^T z = 0: eqs. (37)-(38), made of (36) by `hlcp`.

Source: Lemke (1978); Cottle, Pang & Stone, The Linear Complementarity Problem (1992), Algorithm 4.4.5, with the
lexicographic ratio test of Sect. 4.9 that rules out cycling.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.friction.outcomes import PIVOT_LIMIT, RAY, SOLVED

TIE = 1e-12
"""Ratios closer than this, relatively, count as tied and are decided lexicographically."""
SMALLEST_PIVOT = 1e-11
"""Entries of the entering column up to this count as zero: they are rounding, in a system whose rows have unit size."""
MOST_PIVOTS, MOST_PIVOTS_PER_ROW = 100, 50
"""Pivots after which the method is given up, at all and for each row. A path to a solution usually takes about n."""


@kernel(allocates=True)
def lemke(M: Table, q: Reals, d: Reals) -> tuple[Reals, Reals, int, int]:
    """Solve the linear complementarity problem w = M z + q along the path w = M z + q + d z0, z0 -> 0.

    w, z are y, x of (38): corner forces (1)-(2), surfaces at rest (7), (15), bilateral forces (29)-(30); `hlcp` has
    their order.

    `M` (n, n), or with more columns, which are not read; `q` (n,); `d` (n,): the covering vector, positive. Returns w,
    z, the outcome and the number of pivots. Outcomes are SOLVED; RAY: a secondary ray (for the matrices of Coulomb
    friction: no solution was found on this path); PIVOT_LIMIT.
    """
    n = len(q)
    w, z = np.zeros(n), np.zeros(n)

    # w = q, z = 0 is the solution if q is nowhere negative; else the row that needs the largest z0 leaves first
    scale, row, is_solved = 0.0, 0, True
    for i in range(n):
        scale = max(scale, abs(q[i]))
        is_solved = is_solved and q[i] >= 0.0
        if q[i] / d[i] < q[row] / d[row]:
            row = i
    if is_solved:
        for i in range(n):
            w[i] = q[i]
        return w, z, SOLVED, 0

    # The tableau I w - M z - d z0 = q, with q divided by its largest entry. Columns: w (0..n-1), z (n..2n-1), covering
    # variable z0 (2n), right-hand side (2n+1).
    T = np.zeros((n, 2 * n + 2))
    basis = np.zeros(n, dtype=np.int64)
    for i in range(n):
        basis[i] = i
        T[i, i] = 1.0
        for j in range(n):
            T[i, n + j] = -M[i, j]
        T[i, 2 * n] = -d[i]
        T[i, 2 * n + 1] = q[i] / scale

    # the covering variable enters first; then always the complement of the variable that left, until z0 leaves
    entering = 2 * n
    limit = MOST_PIVOTS_PER_ROW * n + MOST_PIVOTS
    for pivot in range(limit):
        leaving = basis[row]
        _pivot(T, row, entering)
        basis[row] = entering
        if leaving == 2 * n:
            # z0 = 0: the basic variables are the solution; rounding below zero is zero
            for i in range(n):
                value = max(T[i, 2 * n + 1], 0.0) * scale
                if basis[i] < n:
                    w[basis[i]] = value
                else:
                    z[basis[i] - n] = value
            return w, z, SOLVED, pivot + 1
        entering = leaving + n if leaving < n else leaving - n
        row = _leaving_row(T, basis, entering, n)
        if row < 0:
            return w, z, RAY, pivot + 1
    return w, z, PIVOT_LIMIT, limit


@kernel
def _pivot(T, row, column):
    """Exchange the basic variable of a row for that of a column: a step of Gauss-Jordan elimination, in place."""
    pivot = T[row, column]
    for j in range(T.shape[1]):
        T[row, j] /= pivot
    for i in range(len(T)):
        if i != row and T[i, column] != 0.0:
            factor = T[i, column]
            for j in range(T.shape[1]):
                T[i, j] -= factor * T[row, j]
            T[i, column] = 0.0


@kernel
def _leaving_row(T, basis, entering, n):
    """Row of the smallest ratio; among tied rows that of the covering variable, else the lexicographically smallest."""
    best = -1
    best_ratio = 0.0
    for i in range(n):
        rate = T[i, entering]
        if rate <= SMALLEST_PIVOT:
            continue  # this basic variable does not fall as the entering one grows
        ratio = T[i, 2 * n + 1] / rate
        if best < 0 or ratio < best_ratio - TIE * (1.0 + abs(best_ratio)):
            best, best_ratio = i, ratio
        elif ratio <= best_ratio + TIE * (1.0 + abs(best_ratio)):
            # the covering variable is preferred, as the method ends when it leaves
            if basis[best] == 2 * n:
                continue
            if basis[i] == 2 * n or _lexicographically_smaller(T, i, best, entering, n):
                best, best_ratio = i, min(ratio, best_ratio)
    return best


@kernel
def _lexicographically_smaller(T, i, k, entering, n):
    """Return True where row i, divided by its entry of the entering column, comes before row k."""
    for j in range(n):
        difference = T[i, j] / T[i, entering] - T[k, j] / T[k, entering]
        if difference < -TIE:
            return True
        if difference > TIE:
            return False
    return False
