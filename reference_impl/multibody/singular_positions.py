"""Near a singular position, where rows of J become dependent and two branches of motion meet, compiled.

Let x be the distance to it along the motion and y a coordinate along the other branch. One combination u of the rows is
then Phi = x y to lowest order: its singular value is s = |x|, its direction is y, and with Phi'' = x y'' + 2 x' y' = 0
a perturbation grows as y = c/x. The motion that goes on has y = 0. Three things follow, with e the rounding of
coordinates of the size 1:

- G = J M^-1 J^T has the singular value s^2, so that elimination gives y'' to e/s^2 only; J M^-1/2 itself gives it to
  e/s.
- The correction of Phi moves y by e/s and y' by e/s^2, and the next steps carry that on as c/x. It has to wait until s
  is large again.
- An error of y or y' is corrected by the constraints as soon as s is large, and changes the energy in second order
  only. A step whose estimated error is one of y must not be shortened: the shorter one begins nearer to the position,
  where y' is noise.

What is left is a floor that no tolerance lowers: a step that begins at x0 has y' = e/x0^2, and a stage at x1 makes y''
= 2 x' y'/x1 of it. The force of the constraint, which grows as 1/x1, turns y into an acceleration along the motion.
With x0 of 1e-2 rad, as at tight tolerances, and stages that come as near as 1e-4 by chance, that is 1e-10 to 1e-8 m
over some passages, and more where one is nearer.
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
"""A singular value of J M^-1/2, rows of unit size, that counts as zero, relative to the largest. Nearer to the singular
position a state that is off its constraints by rounding e belongs to motions that turn away at distances of sqrt(e)."""

NEARLY_DEPENDENT = 5e-4
"""Part of the largest singular value of J below which residuals are left uncorrected: above, their noise stays below
e/NEARLY_DEPENDENT^2, some 1e-9 of y'. A chain of the `mechanism.MOST_ROWS` has pi/4000, for no singular position."""

ALWAYS_DEPENDENT = 1e-9
"""Part of the largest singular value of J below which rows are dependent and say nothing of a direction: those of a
joint that is repeated leave 1e-16 everywhere."""

NEAR, AROUND = 0.02, 0.2
"""Parts of the largest singular value of J: below which a direction is that of another branch, and above which at the
end of a step no stage of it is looked at."""


@kernel(allocates=True)
def singular_rows(m: Arrays, w: Workspace, unit: Reals) -> tuple[Reals, Table, Reals, Table]:
    """Singular values of the constraint rows, each of unit size, in coordinates divided by `unit` (3 * bodies,).

    Returns the sizes by which the rows were divided, and what `linear_algebra.decompose` makes of them. Where a row is
    not finite all sizes are nan, and the rows count as zeros.
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
    """Return the unit of length in each coordinate, (3 * bodies,).

    It is 1 m, or the angle that moves a point by 1 m.
    """
    unit = np.zeros(len(m.inverse_mass))
    for i in range(len(unit)):
        unit[i] = 1.0 / m.length_scale if i % 3 == 2 else 1.0
    return unit


@kernel(allocates=True)
def shortest_forces(m: Arrays, w: Workspace) -> None:
    """Forces of the constraint rows without friction into w.force, from J M^-1/2: the shortest of least residual.

    Rows are measured by their size in J M^-1/2; the singular values up to SINGULAR_POSITION are left out. The forces
    are nan where J is not finite, or the constraints contradict each other.
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
def leave_nearly_dependent(m: Arrays, w: Workspace, residual: Reals) -> None:
    """Take the part of singular values of J below NEARLY_DEPENDENT out of a residual, in place.

    It is a matter of the geometry alone: small singular values of J M^-1/2 come from unequal masses too, and are to be
    corrected.
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
def smallest(s):
    """Return the smallest singular value over the largest, but for rows always dependent."""
    for k in range(len(s) - 1, 0, -1):
        if s[k] > ALWAYS_DEPENDENT * s[0]:
            return s[k] / s[0]
    return 1.0


@kernel
def pivots_are_above(m, w, tolerance):
    """Return True where no pivot of G of the constraint rows is below `tolerance`; the scratch is used."""
    for r in range(m.rows):
        w.x[r] = 0.0
        for c in range(m.rows):
            w.A[r, c] = w.G[r, c]
    return solve_in_place(w.A, w.x, w.unit, m.rows, m.rows, tolerance)
