"""Linear solves, compiled: elimination of dense and banded matrices, and the minimum-norm solution where that fails."""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import product

RANK_TOLERANCE = 1e-11
"""A pivot below this times the largest one counts as zero. Rank decisions on exactly redundant
constraints leave pivots of 1e-16 to 1e-14; a mechanism 1e-5 rad from a singular position leaves 1e-10."""

ELIMINATION = 1e-6
"""A pivot of G = J M^-1 J^T of constraints alone, relative to the largest one, below which forces are found from J
M^-1/2 instead: elimination leaves an error of rounding over pivot, 1e-10; one 1e-3 rad from a singular position is of
this size."""

CONTRADICTION = 1e-3
"""Part of the largest right-hand side that no x can give, beyond which redundant equations contradict each other, as
those of two drives of one coordinate do. Consistent ones leave rounding over RANK_TOLERANCE, 1e-5; contradictory ones
of the order of 1."""


@kernel(inline=True)
def _first(i, band, n):
    """Return the first place of row i within the band; that of a dense matrix is known to the compiler."""
    return max(0, i - band) if band < n else 0


@kernel(inline=True)
def _end(i, band, n):
    """Return the place behind the last of row i within the band."""
    return min(n, i + band + 1) if band < n else n


@kernel(inline=True)
def eliminate(A, x, unit, n, band, tolerance=RANK_TOLERANCE):
    """Solve the leading n x n part of A for x in place, by elimination with partial pivoting.

    A is zero, or not filled, more than `band` places from its diagonal; a dense one has band n.
    Pivots are chosen and judged as if rows and columns had unit size, so that units and masses do not decide what is
    singular; `unit` is scratch, of length 2 n at least. Returns False, with A and x destroyed, if a pivot is below
    `tolerance` times the largest one before.
    """
    filled = 2 * band if band < n else n  # places beyond the diagonal, by exchanges of rows
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
        unit[k] = 1.0 / A[k, k]
        for i in range(k + 1, low):
            factor = A[i, k] * unit[k]
            if factor != 0.0:
                for j in range(k + 1, high):
                    A[i, j] -= factor * A[k, j]
                x[i] -= factor * x[k]
    for k in range(n - 1, -1, -1):
        total = x[k]
        for j in range(k + 1, _end(k, filled, n)):
            total -= A[k, j] * x[j]
        x[k] = total * unit[k]
    return True


@kernel
def eliminate_columns(A: Table, B: Table, n: int, k: int, band: int) -> bool:  # noqa: C901 - loops of an elimination
    """Solve A X = B (leading n rows, k right sides) in place of B; partial pivoting on rows of unit size.

    A is zero more than `band` places from its diagonal.
    Returns False, with A and B destroyed, if a pivot is below RANK_TOLERANCE or not finite.
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
        for j in range(high, min(n, high + band)):
            A[i, j] = 0.0
        for j in range(k):
            B[i, j] *= inverse
    for c in range(n):
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
    """`eliminate`, called where its machine code is: for whatever is not in the innermost loop."""
    return eliminate(A, x, unit, n, band, tolerance)


@kernel(allocates=True)
def decompose(A: Table) -> tuple[Table, Reals, Table]:
    """Singular values of a finite matrix, decreasing; left vectors as rows, right vectors as columns."""
    U, s, Vt = np.linalg.svd(A, False)
    return U.T, s, Vt.T


@kernel(allocates=True)
def add_shortest(A: Table, b: Reals, x: Reals) -> None:
    """Add to x the shortest of those that minimize |A x - b|; singular values below RANK_TOLERANCE count as zero."""
    left_of, s, right_of = decompose(A)
    for k in range(len(s)):
        if s[k] > RANK_TOLERANCE * s[0]:
            part = product(left_of[k], b)
            for i in range(A.shape[1]):
                x[i] += right_of[i, k] * (part / s[k])


@kernel(allocates=True)
def minimum_norm(A: Table, b: Reals, n: int) -> float:
    """Put in place of b the shortest x among those that minimize |A x - b|, of the leading n x n part of A.

    Equations and unknowns are measured by the square roots of the diagonal of A: units do not enter the solution. x is
    nan where A or b is not finite. Returns the largest residual over the largest right-hand side, so measured: above
    CONTRADICTION there is no solution.
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
