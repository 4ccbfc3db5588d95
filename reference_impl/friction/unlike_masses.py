"""Forces and accelerations of a contact mode together, for masses that are unlike, compiled.

With bodies of masses m << M the entries of G = J M^-1 J^T are sums 1/m + 1/M. A solution needs their difference 1/M: it
is wrong by M/m roundings, and the acceleration of the light body, a small difference of large forces over m, as well.
The equations (24) and (25) of Zhuang & Wang (2014) before q'' is eliminated from them,

    M q'' - J^T force = Q,    J q'' = -gamma,

hold each mass by itself, and elimination with pivots of unit size takes a light body's forces from its balance, and its
motion from its constraints. They are a system of three times the size, so only mechanisms that need them are solved
that way (`Arrays.unlike`).
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, IntegerTable, Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import eliminate
from stiction.reference_impl.friction.coulomb import friction_coefficients, sticks
from stiction.reference_impl.friction.frozen_mode import friction_of
from stiction.reference_impl.multibody import baumgarte
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

REGULAR = 0.0
"""Tolerance of pivots, which are as unlike as the masses: that the rows are independent is known from G."""


@kernel(allocates=True)
def solve_with_motion(
    m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable, motion: Reals
) -> bool:
    """Solve for row forces of the mode, into w.force, and q'', into `motion`, as `solve_mode` and `acceleration`.

    False if there is no solution.
    """
    n, nr, nf = len(m.inverse_mass), m.rows, len(m.friction)

    # unknowns: q'', forces of the constraint rows, frictions of the guides that stick
    column, size = np.zeros(nf, dtype=np.int64), n + nr
    for f in range(nf):
        if sticks(m, slip, f):
            column[f] = size
            size += 1
    A, x, unit = np.zeros((size, size)), np.zeros(size), np.zeros(2 * size)

    # M q'' = Q, and the right-hand sides of J q'' = -gamma
    for i in range(n):
        A[i, i] = 1.0 / m.inverse_mass[i]
        x[i] = w.free[i] / m.inverse_mass[i]
    for r in range(nr):
        x[n + r] = baumgarte.required(m, w, r)
    for f in range(nf):
        if sticks(m, slip, f):
            x[column[f]] = -w.gamma[nr + f]

    # J and -J^T, block by block. A guide that slips has no equation of its own: its friction c_R R + c_T T acts through
    # the columns of R and T, its constant part is an applied force.
    for b in range(len(m.block)):
        at, row, k = np.int64(m.block[b, 0]), np.int64(m.block[b, 1]), np.int64(m.block[b, 2])
        g = row - nr  # the guide of a tangential row
        for c in range(3):
            if g < 0 or sticks(m, slip, g):
                j = n + row if g < 0 else column[g]
                A[j, k + c] += w.J[at + c]
                A[k + c, j] -= w.J[at + c]
            elif slip[g] != 0:
                normal = n + m.friction[g].row
                c_R, c_T = friction_coefficients(
                    m, g, slip[g], corner[g, 0], corner[g, 1], m.friction[g].mu
                )
                A[k + c, normal] -= c_R * w.J[at + c]
                A[k + c, normal + 1] -= c_T * w.J[at + c]
                x[k + c] -= slip[g] * m.friction[g].bound * w.J[at + c]
    if not eliminate(A, x, unit, size, size, REGULAR):
        return False
    for i in range(n):
        motion[i] = x[i]
    for r in range(nr):
        w.force[r] = x[n + r]
    for f in range(nf):
        if sticks(m, slip, f):
            w.force[nr + f] = x[column[f]]
        elif slip[f] != 0:
            w.force[nr + f] = friction_of(m, f, slip, corner, w.force)
        else:
            w.force[nr + f] = 0.0
    return True
