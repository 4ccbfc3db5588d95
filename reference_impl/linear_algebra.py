"""Small dense linear solves, compiled: elimination, and the minimum-norm solution where that fails."""

from __future__ import annotations

import numpy as np
from reference_impl.compiling import kernel

RANK_TOLERANCE = 1e-11
"""A pivot below this times the largest one counts as zero. Rank decisions on exactly redundant
constraints leave pivots of 1e-16 to 1e-14; a mechanism 1e-5 rad from a singular position leaves 1e-10."""


@kernel
def eliminate(A, x, n):
    """Solve the leading n x n part of A for x in place, by elimination with partial pivoting.

    Returns False, with A and x destroyed, if a pivot is below RANK_TOLERANCE times the largest one before.
    """
    largest = 0.0
    for k in range(n):
        p, size = k, abs(A[k, k])
        for i in range(k + 1, n):
            if abs(A[i, k]) > size:
                p, size = i, abs(A[i, k])
        largest = max(largest, size)
        if not size > RANK_TOLERANCE * largest:
            return False
        if p != k:
            for j in range(k, n):
                A[k, j], A[p, j] = A[p, j], A[k, j]
            x[k], x[p] = x[p], x[k]
        inverse = 1.0 / A[k, k]
        for i in range(k + 1, n):
            factor = A[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, n):
                    A[i, j] -= factor * A[k, j]
                x[i] -= factor * x[k]
    for k in range(n - 1, -1, -1):
        total = x[k]
        for j in range(k + 1, n):
            total -= A[k, j] * x[j]
        x[k] = total / A[k, k]
    return True


@kernel(allocates=True)
def eliminate_columns(A, B):
    """Solve A X = B in place of B (n, k), by Gauss-Jordan elimination with partial pivoting on rows of unit size.

    Returns False, with A and B destroyed, if a pivot is below RANK_TOLERANCE or not finite.
    """
    n, k = B.shape
    for i in range(n):
        size = np.max(np.abs(A[i]))
        if not 0.0 < size < np.inf:
            return False
        A[i] /= size
        B[i] /= size
    for c in range(n):
        p = c
        for i in range(c + 1, n):
            if abs(A[i, c]) > abs(A[p, c]):
                p = i
        if not abs(A[p, c]) > RANK_TOLERANCE:
            return False
        if p != c:
            for j in range(c, n):
                A[c, j], A[p, j] = A[p, j], A[c, j]
            for j in range(k):
                B[c, j], B[p, j] = B[p, j], B[c, j]
        inverse = 1.0 / A[c, c]
        for j in range(c, n):
            A[c, j] *= inverse
        for j in range(k):
            B[c, j] *= inverse
        for i in range(n):
            factor = A[i, c]
            if i != c and factor != 0.0:
                for j in range(c, n):
                    A[i, j] -= factor * A[c, j]
                for j in range(k):
                    B[i, j] -= factor * B[c, j]
    return True


@kernel(allocates=True)
def minimum_norm(A, b):
    """Put in place of b the shortest x among those that minimize |A x - b|, by singular values."""
    U, s, Vt = np.linalg.svd(A.copy())
    x = np.zeros(len(b))
    for k in range(len(s)):
        if s[k] > RANK_TOLERANCE * s[0]:
            x += Vt[k] * (np.dot(U[:, k], b) / s[k])
    b[:] = x
