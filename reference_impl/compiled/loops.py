"""Loops that kernels have in the place of array expressions, of which numba takes 0.2 to 2 s each to compile."""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.kernel import kernel


@kernel
def copy(source, target):
    """Copy arrays of one dimension."""
    for i in range(len(source)):
        target[i] = source[i]


@kernel
def are_equal(first, second):
    """Compare arrays of one dimension and one length."""
    for i in range(len(first)):
        if first[i] != second[i]:
            return False
    return True


@kernel
def is_finite(values):
    """Return True for an array without nan and inf."""
    for i in range(len(values)):
        if not np.isfinite(values[i]):
            return False
    return True


@kernel
def product(a, b):
    """Scalar product of two vectors, in the order of their components whatever the processor."""
    total = 0.0
    for i in range(len(b)):
        total += a[i] * b[i]
    return total


@kernel
def subtract(part, a, b):
    """b - part a in place of b."""
    for i in range(len(b)):
        b[i] -= part * a[i]


@kernel(allocates=True)
def taken(values, places):
    """Elements of an array of one dimension at some places."""
    found = np.empty(len(places), values.dtype)
    for i in range(len(places)):
        found[i] = values[places[i]]
    return found


@kernel(allocates=True)
def taken_rows(values, places):
    """Rows of an array of two dimensions at some places."""
    found = np.empty((len(places), values.shape[1]), values.dtype)
    for i in range(len(places)):
        copy(values[places[i]], found[i])
    return found
