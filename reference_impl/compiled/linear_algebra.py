"""Compiled solution of linear systems.

Systems with dense or banded matrices are solved by Gaussian elimination. If the matrix is singular, the solution of
minimum norm is computed by a singular value decomposition.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import product

RANK_TOLERANCE = 1e-11
"""A pivot below this times the largest one counts as zero. Rank decisions on exactly redundant
constraints leave pivots of 1e-16 to 1e-14; a mechanism 1e-5 rad from a singular position leaves 1e-10."""

ELIMINATION = 1e-6
"""If a pivot of G = J M^-1 J^T, the matrix of the constraints alone, is below this times the largest one, forces are
computed from J M^-1/2 instead. The relative error of elimination is rounding divided by the pivot, here 1e-10. A
mechanism 1e-3 rad from a singular position has pivots of this size."""

CONTRADICTION = 1e-3
"""Redundant equations contradict each other if the part of the right-hand side that no x satisfies is larger than this
times the largest right-hand side. For example, two drives of one coordinate do. Consistent equations leave rounding
divided by RANK_TOLERANCE, 1e-5; contradictory ones leave values of the order of 1."""


@kernel(inline=True)
def _first(i, band, n):
    """Return the first column of row i within the band; the compiler knows that of a dense matrix."""
    return max(0, i - band) if band < n else 0


@kernel(inline=True)
def _end(i, band, n):
    """Return the column behind the last one of row i within the band."""
    return min(n, i + band + 1) if band < n else n


@kernel(inline=True)
def eliminate(A, x, unit, n, band, tolerance=RANK_TOLERANCE):
    """Solve A y = x for the leading n x n part of A, by elimination with partial pivoting; y overwrites x.

    Pivots are selected and judged as if rows and columns were scaled to unit size, so that units and masses do not
    decide whether the matrix is singular.

    Parameters
    ----------
    A : ndarray, shape (m, m), m >= n
        The matrix; overwritten. Elements more than `band` places from the diagonal are not read.
    x : ndarray, shape (m,)
        The right-hand side; overwritten by the solution.
    unit : ndarray, shape (2 n,) or more
        Work space.
    n : int
        Number of equations.
    band : int
        Half the bandwidth; n for a dense matrix.
    tolerance : float
        The smallest pivot, relative to the largest one before it.

    Returns
    -------
    bool
        False if a pivot is smaller, or not finite; the contents of A and x are then meaningless.
    """
    # Exchanges of rows fill up to this many places right of the diagonal.
    filled = 2 * band if band < n else n
    # Scales: unit[n + i] is that of row i, unit[j] the inverse of that of column j.
    for j in range(n):
        unit[j] = 0.0
    for i in range(n):
        size, low, high = 0.0, _first(i, band, n), _end(i, band, n)
        for j in range(low, high):
            size = max(size, abs(A[i, j]))
        if not 0.0 < size < np.inf:
            return False
        unit[n + i] = 1.0 / size
        for j in range(low, high):
            unit[j] = max(unit[j], abs(A[i, j]) * unit[n + i])
        for j in range(high, min(n, high + band)):
            A[i, j] = 0.0
    largest = 0.0
    for k in range(n):
        # The pivot: the largest scaled element of column k, in row p.
        p, size, low, high = k, abs(A[k, k]) * unit[n + k], _end(k, band, n), _end(k, filled, n)
        for i in range(k + 1, low):
            if abs(A[i, k]) * unit[n + i] > size:
                p, size = i, abs(A[i, k]) * unit[n + i]
        size /= unit[k]
        largest = max(largest, size)
        if not size > tolerance * largest:
            return False
        if p != k:
            for j in range(k, high):
                A[k, j], A[p, j] = A[p, j], A[k, j]
            x[k], x[p] = x[p], x[k]
            unit[n + k], unit[n + p] = unit[n + p], unit[n + k]
        # The scale of column k is not needed any more; its place holds the inverse of the pivot.
        unit[k] = 1.0 / A[k, k]
        for i in range(k + 1, low):
            factor = A[i, k] * unit[k]
            if factor != 0.0:
                for j in range(k + 1, high):
                    A[i, j] -= factor * A[k, j]
                x[i] -= factor * x[k]
    # Back substitution.
    for k in range(n - 1, -1, -1):
        total = x[k]
        for j in range(k + 1, _end(k, filled, n)):
            total -= A[k, j] * x[j]
        x[k] = total * unit[k]
    return True


@kernel
def eliminate_columns(A: Table, B: Table, n: int, k: int, band: int) -> bool:  # noqa: C901 - loops of an elimination
    """Solve A X = B for the leading n rows and k right-hand sides, by elimination with partial pivoting.

    Rows are scaled to unit size before.

    Parameters
    ----------
    A : ndarray, shape (m, m), m >= n
        The matrix; overwritten. Elements more than `band` places from the diagonal are not read.
    B : ndarray, shape (m, l), l >= k
        The right-hand sides; overwritten by the solutions.
    n, k : int
        Numbers of equations and of right-hand sides.
    band : int
        Half the bandwidth; n for a dense matrix.

    Returns
    -------
    bool
        False if a pivot is below RANK_TOLERANCE, or not finite; the contents of A and B are then meaningless.
    """
    for i in range(n):
        low, high = max(0, i - band), min(n, i + band + 1)
        size, finite = 0.0, True
        for j in range(low, high):
            size, finite = max(size, abs(A[i, j])), finite and abs(A[i, j]) < np.inf
        if not (size > 0.0 and finite):
            return False
        inverse = 1.0 / size
        for j in range(low, high):
            A[i, j] *= inverse
        # Exchanges of rows fill the places right of the band.
        for j in range(high, min(n, high + band)):
            A[i, j] = 0.0
        for j in range(k):
            B[i, j] *= inverse
    for c in range(n):
        # The pivot: the largest element of column c, in row p.
        p, low, high = c, min(n, c + band + 1), min(n, c + 2 * band + 1)
        for i in range(c + 1, low):
            if abs(A[i, c]) > abs(A[p, c]):
                p = i
        if not abs(A[p, c]) > RANK_TOLERANCE:
            return False
        if p != c:
            for j in range(c, high):
                A[c, j], A[p, j] = A[p, j], A[c, j]
            for j in range(k):
                B[c, j], B[p, j] = B[p, j], B[c, j]
        inverse = 1.0 / A[c, c]
        for i in range(c + 1, low):
            factor = A[i, c] * inverse
            if factor != 0.0:
                for j in range(c + 1, high):
                    A[i, j] -= factor * A[c, j]
                for j in range(k):
                    B[i, j] -= factor * B[c, j]
    # Back substitution.
    for c in range(n - 1, -1, -1):
        for i in range(c + 1, min(n, c + 2 * band + 1)):
            factor = A[c, i]
            if factor != 0.0:
                for j in range(k):
                    B[c, j] -= factor * B[i, j]
        inverse = 1.0 / A[c, c]
        for j in range(k):
            B[c, j] *= inverse
    return True


@kernel
def solve_in_place(
    A: Table, x: Reals, unit: Reals, n: int, band: int, tolerance: float = RANK_TOLERANCE
) -> bool:
    """Call `eliminate`, which is inlined into its callers.

    This kernel is compiled once, for callers whose time does not depend on it.
    """
    return eliminate(A, x, unit, n, band, tolerance)


@kernel(allocates=True)
def decompose(A: Table) -> tuple[Table, Reals, Table]:
    """Return the singular value decomposition of a finite matrix of shape (m, n).

    Returns
    -------
    left : ndarray, shape (min(m, n), m)
        Left singular vectors as rows.
    s : ndarray, shape (min(m, n),)
        Singular values, decreasing.
    right : ndarray, shape (n, min(m, n))
        Right singular vectors as columns.
    """
    U, s, Vt = np.linalg.svd(A, False)
    return U.T, s, Vt.T


@kernel(allocates=True)
def add_shortest(A: Table, b: Reals, x: Reals) -> None:
    """Add to x the vector of minimum norm among those that minimize |A y - b|.

    Singular values below RANK_TOLERANCE times the largest one count as zero.
    """
    left_of, s, right_of = decompose(A)
    for k in range(len(s)):
        if s[k] > RANK_TOLERANCE * s[0]:
            part = product(left_of[k], b)
            for i in range(A.shape[1]):
                x[i] += right_of[i, k] * (part / s[k])


@kernel(allocates=True)
def minimum_norm(A: Table, b: Reals, n: int) -> float:
    """Compute the x of minimum norm among those that minimize |A x - b|, for the leading n x n part of A.

    Equations and unknowns are scaled by the square roots of the diagonal of A, so that the solution does not depend on
    units.

    Parameters
    ----------
    A : ndarray, shape (m, m), m >= n
        The matrix.
    b : ndarray, shape (m,)
        The right-hand side; overwritten by x, which is nan if A or b is not finite.
    n : int
        Number of equations.

    Returns
    -------
    float
        The largest residual divided by the largest right-hand side, both scaled. Above CONTRADICTION there is no
        solution.
    """
    unit, scaled, right, x = np.zeros(n), np.zeros((n, n)), np.zeros(n), np.zeros(n)
    finite, largest = True, 0.0
    for i in range(n):
        unit[i] = 1.0 / np.sqrt(abs(A[i, i])) if A[i, i] != 0.0 else 1.0
    for i in range(n):
        right[i] = b[i] * unit[i]
        finite, largest = finite and np.isfinite(right[i]), max(largest, abs(right[i]))
        for j in range(n):
            scaled[i, j] = A[i, j] * (unit[i] * unit[j])
            finite = finite and np.isfinite(scaled[i, j])
    # The singular value decomposition requires finite elements.
    if not finite:
        for i in range(n):
            b[i] = np.nan
        return np.inf
    add_shortest(scaled, right, x)
    worst = 0.0
    for i in range(n):
        residual = -right[i]
        for j in range(n):
            residual += scaled[i, j] * x[j]
        worst = max(worst, abs(residual))
        b[i] = x[i] * unit[i]
    return worst / largest if largest > 0.0 else 0.0
