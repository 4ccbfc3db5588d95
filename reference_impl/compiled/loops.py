"""Loops over arrays that kernels call in place of array expressions.

numba takes 0.2 to 2 s to compile each array expression, and much less for a loop.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.kernel import kernel


@kernel
def copy(source, target):
    """Copy `source`, shape (n,), to the beginning of `target`."""
    for i in range(len(source)):
        target[i] = source[i]


@kernel
def are_equal(first, second):
    """Return True if two arrays of shape (n,) have the same elements."""
    for i in range(len(first)):
        if first[i] != second[i]:
            return False
    return True


@kernel
def is_finite(values):
    """Return True if an array of shape (n,) contains neither nan nor inf."""
    for i in range(len(values)):
        if not np.isfinite(values[i]):
            return False
    return True


@kernel
def product(a, b):
    """Return the scalar product of `b` and the beginning of `a`.

    Terms are added in the order of the components, so that the result does not depend on the processor.
    """
    total = 0.0
    for i in range(len(b)):
        total += a[i] * b[i]
    return total


@kernel
def subtract(part, a, b):
    """Subtract ``part * a`` from `b` in place."""
    for i in range(len(b)):
        b[i] -= part * a[i]


@kernel(allocates=True)
def taken(values, places):
    """Return the elements of an array of one dimension with the indices `places`."""
    elements = np.empty(len(places), values.dtype)
    for i in range(len(places)):
        elements[i] = values[places[i]]
    return elements


@kernel(allocates=True)
def taken_rows(values, places):
    """Return the rows of an array of two dimensions with the indices `places`."""
    rows = np.empty((len(places), values.shape[1]), values.dtype)
    for i in range(len(places)):
        copy(values[places[i]], rows[i])
    return rows
