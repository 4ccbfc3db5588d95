"""Forces and residuals near singular positions, where rows of J become linearly dependent, compiled.

Rounding errors are divided by the singular values of J there. ``docs/theory/event-driven.md`` derives how large the
errors are, and why residuals are not corrected and errors along another branch of motion are not estimated near such a
position.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import CONTRADICTION, decompose, solve_in_place
from stiction.reference_impl.compiled.loops import is_finite, product, subtract
from stiction.reference_impl.multibody.dynamics import roots_of_mobility, unit_rows
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

SINGULAR_POSITION = 1e-5
"""Singular value of J M^-1/2, with rows of unit size, that counts as zero, relative to the largest one. Nearer to the
singular position, a state with a rounding error e in its constraints belongs to motions that turn away at a distance of
sqrt(e)."""

NEARLY_DEPENDENT = 5e-4
"""Singular value of J, relative to the largest one, below which residuals are not corrected. Above it, a correction
changes y' by less than e/NEARLY_DEPENDENT^2, about 1e-9. In a chain with `mechanism.MOST_ROWS` rows the ratio is
pi/4000, without a singular position."""

ALWAYS_DEPENDENT = 1e-9
"""Singular value of J, relative to the largest one, below which rows are dependent in all positions, such as those of a
repeated joint. Rounding leaves about 1e-16 of them."""

BRANCH_RATIO = 0.02
"""Singular value of J, relative to the largest one, below which its direction is that of another branch of motion."""

REGULAR_RATIO = 0.2
"""Singular value of J, relative to the largest one, above which a step that ends there does not come near a singular
position. It is ten times `BRANCH_RATIO`, as the stages of a step extend over a part of the motion."""


@kernel(allocates=True)
def singular_rows(m: Arrays, w: Workspace, unit: Reals) -> tuple[Reals, Table, Reals, Table]:
    """Compute the singular value decomposition of the constraint rows, each divided by its size.

    The coordinates are divided by `unit`, shape (3 * bodies,).

    Returns the sizes of the rows, shape (rows,), and the result of `linear_algebra.decompose`. If an element is not
    finite, all sizes are NaN, and the rows are replaced by zeros.
    """
    J, size = unit_rows(m, w, m.rows, unit)
    finite = True
    for r in range(m.rows):
        finite = finite and is_finite(J[r])
    if not finite:
        J = np.zeros(J.shape)
        for r in range(m.rows):
            size[r] = np.nan
    left_of, s, right_of = decompose(J)
    return size, left_of, s, right_of


@kernel(allocates=True)
def lengths(m):
    """Return the unit of each coordinate, shape (3 * bodies,): 1 m, or the angle (rad) that moves a point by 1 m."""
    unit = np.zeros(len(m.inverse_mass))
    for i in range(len(unit)):
        unit[i] = 1.0 / m.length_scale if i % 3 == 2 else 1.0
    return unit


@kernel(allocates=True)
def shortest_forces(m: Arrays, w: Workspace) -> None:
    """Write the forces of the constraint rows without friction to w.force: the least-squares solution of least norm.

    Rows are divided by their size in J M^-1/2, and singular values up to SINGULAR_POSITION count as zero. The forces
    are NaN if J is not finite, or if the constraints contradict each other.
    """
    force, right, rest = np.zeros(m.rows), np.zeros(m.rows), np.zeros(m.rows)
    size, left_of, s, _ = singular_rows(m, w, roots_of_mobility(m))
    largest, worst = 0.0, 0.0
    for r in range(m.rows):
        right[r] = w.right[r] / size[r]
        rest[r] = right[r]
        largest = max(largest, abs(right[r]))
    for k in range(len(s)):
        if s[k] > SINGULAR_POSITION * s[0]:
            part = product(left_of[k], right)
            subtract(-part / s[k] ** 2, left_of[k], force)
            subtract(part, left_of[k], rest)
    for r in range(m.rows):
        w.force[r] = force[r] / size[r]
        worst = max(worst, abs(rest[r]))
    if not is_finite(right) or largest > 0.0 and not worst / largest <= CONTRADICTION:
        for r in range(m.rows):
            w.force[r] = np.nan


@kernel(allocates=True)
def remove_nearly_dependent(m: Arrays, w: Workspace, residual: Reals) -> None:
    """Remove the components of a residual that belong to singular values of J below NEARLY_DEPENDENT, in place.

    The singular values are those of J, which depend on the geometry alone. Those of J M^-1/2 may also be small because
    masses are unequal, and such components must be corrected.
    """
    size, left_of, s, _ = singular_rows(m, w, lengths(m))
    scaled = np.zeros(m.rows)
    for r in range(m.rows):
        scaled[r] = residual[r] / size[r]
    for k in range(len(s)):
        if not s[k] > NEARLY_DEPENDENT * s[0]:
            subtract(product(left_of[k], scaled), left_of[k], scaled)
    for r in range(m.rows):
        residual[r] = scaled[r] * size[r]


@kernel
def smallest_ratio(s):
    """Return the smallest singular value over the largest, without those of rows that are always dependent."""
    for k in range(len(s) - 1, 0, -1):
        if s[k] > ALWAYS_DEPENDENT * s[0]:
            return s[k] / s[0]
    return 1.0


@kernel
def pivots_are_above(m, w, tolerance):
    """Return True if no pivot of G of the constraint rows is below `tolerance`; w.A and w.x are overwritten."""
    for r in range(m.rows):
        w.x[r] = 0.0
        for c in range(m.rows):
            w.A[r, c] = w.G[r, c]
    return solve_in_place(w.A, w.x, w.unit, m.rows, m.rows, tolerance)
