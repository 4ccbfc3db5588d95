"""Applied forces and the row form of the equations of motion, compiled.

With the rows of `kinematics` (constraints, then tangential rows), eq. (33) is q'' = M^-1 (Q + J^T force), where `force`
holds the multipliers and the frictions on the sliders, and eq. (25) becomes G force = right with G = J M^-1 J^T.
The HLCP and the contact modes are formed from G alone.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from stiction.reference_impl.compiled.bundle import Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import product
from stiction.reference_impl.multibody import baumgarte
from stiction.reference_impl.multibody.kinematics import (
    constraints_at,
    direction_at,
    law_at,
    point_at,
)
from stiction.reference_impl.multibody.mechanism import ANGLE, AXIS, Arrays, Workspace
from stiction.reference_impl.multibody.one_sided import add_one_sided
from stiction.reference_impl.multibody.speed_dependence import set_coefficients

ONE, TWO = np.uint64(1), np.uint64(2)
"""To be added to the unsigned indices of `Arrays.block` and `Arrays.pair`: a signed one is looked at whether it counts
from the end."""


@kernel
def _push(Q, body, rx, ry, fx, fy):
    """Add a force at arm r of a body to the generalized forces."""
    if body >= 0:
        Q[3 * body] += fx
        Q[3 * body + 1] += fy
        Q[3 * body + 2] += rx * fy - ry * fx


@kernel(inline=True)
def applied_forces(m, rotation, t, q, v, Q):
    """Fill in the generalized applied forces Q of (21), (3 * bodies,).

    They are weight, springs and dampers, forces and torques. Those of springs that act on one side only are added by
    `one_sided.add_one_sided`. M of (21) is diagonal:
    `Arrays.inverse_mass`.
    """
    for i in range(len(Q)):
        Q[i] = m.weight[i]
    for k in range(len(m.spring)):
        spring = m.spring[k]
        a, b = spring.a, spring.b
        if spring.kind == ANGLE:
            qa, va = (q[3 * a + 2], v[3 * a + 2]) if a >= 0 else (0.0, 0.0)
            qb, vb = (q[3 * b + 2], v[3 * b + 2]) if b >= 0 else (0.0, 0.0)
            torque = -(spring.stiffness * (qa - qb - spring.rest) + spring.damping * (va - vb))
            if a >= 0:
                Q[3 * a + 2] += torque
            if b >= 0:
                Q[3 * b + 2] -= torque
            continue
        rax, ray, xa, ya, vxa, vya, _, _ = point_at(rotation, q, v, a, spring.ax, spring.ay)
        rbx, rby, xb, yb, vxb, vyb, _, _ = point_at(rotation, q, v, b, spring.bx, spring.by)
        dx, dy, ex, ey = xa - xb, ya - yb, vxa - vxb, vya - vyb
        if spring.kind == AXIS:
            ux, uy, omega = direction_at(rotation, v, b, spring.ux, spring.uy)
            rate = ux * ex + uy * ey + omega * (ux * dy - uy * dx)
            tension = spring.stiffness * (ux * dx + uy * dy - spring.rest) + spring.damping * rate
            fx, fy = -tension * ux, -tension * uy
            # the force acts on b at the point beside that of a, so that action and reaction share a line
            _push(Q, a, rax, ray, fx, fy)
            _push(Q, b, rbx + dx, rby + dy, -fx, -fy)
            continue
        fx, fy = -spring.stiffness * dx, -spring.stiffness * dy
        if spring.rest != 0.0 or spring.damping != 0.0:
            d2 = dx * dx + dy * dy
            if d2 > 0.0:
                d = sqrt(d2)
                pull = (
                    spring.stiffness * spring.rest - spring.damping * (dx * ex + dy * ey) / d
                ) / d
                fx += pull * dx
                fy += pull * dy
        _push(Q, a, rax, ray, fx, fy)
        _push(Q, b, rbx, rby, -fx, -fy)
    for k in range(len(m.load)):
        load = m.load[k]
        value, _, _ = law_at(m, load.law, t)
        if load.ux == 0.0 and load.uy == 0.0:
            Q[3 * load.body + 2] += value
        else:
            rx, ry, _, _, _, _, _, _ = point_at(rotation, q, v, load.body, load.px, load.py)
            _push(Q, load.body, rx, ry, value * load.ux, value * load.uy)


@kernel
def row_form(m: Arrays, w: Workspace, t: float, q: Reals, v: Reals) -> None:
    """Fill the workspace at (t, q, v): rows, free acceleration, G and right.

    Coefficients of friction in `m` that depend on the speed of slip become those of this state.
    """
    constraints_at(m, w, t, q, v)
    applied_forces(m, w.rotation, t, q, v, w.free)
    add_one_sided(m, w.rotation, q, v, w.acting, w.free)
    for i in range(len(w.free)):
        w.free[i] *= m.inverse_mass[i]
    for r in range(m.rows):
        w.stabilizing[r], w.right[r] = baumgarte.terms(m, w, r), baumgarte.required(m, w, r)
    for r in range(m.rows, len(w.right)):
        w.right[r] = -w.gamma[r]
    J, JM, G = w.J, w.JM, w.G
    for b in range(len(m.block)):
        i, row, k = m.block[b, 0], m.block[b, 1], m.block[b, 2]
        x, y, z = J[i], J[i + ONE], J[i + TWO]
        JM[i], JM[i + ONE] = x * m.inverse_mass[k], y * m.inverse_mass[k + ONE]
        JM[i + TWO] = z * m.inverse_mass[k + TWO]
        w.right[row] -= x * w.free[k] + y * w.free[k + ONE] + z * w.free[k + TWO]
    row, column, value = np.uint64(0), np.uint64(0), 0.0
    for p in range(len(m.pair)):
        i, j, r, c = m.pair[p, 0], m.pair[p, 1], m.pair[p, 2], m.pair[p, 3]
        value = (value if r == row and c == column else 0.0) + (
            JM[i] * J[j] + JM[i + ONE] * J[j + ONE] + JM[i + TWO] * J[j + TWO]
        )
        G[r, c], G[c, r], row, column = value, value, r, c
    if m.varying > 0:
        set_coefficients(m, w)


@kernel
def largest_force(m, w, force):
    """Return the largest row force times the root of its mobility G_rr, sqrt(kg) m/s^2.

    N and N m have no order; so measured they have one that the unit of length does not enter. Divided by the square
    root of a row's own mobility it is in the unit of that row.
    """
    largest = 0.0
    for r in range(len(force)):
        largest = max(largest, abs(force[r]) * sqrt(w.G[r, r]))
    return largest


@kernel
def largest_term(m, w):
    """Return the largest term that row forces balance, measured as by `largest_force`.

    Terms are applied forces and centripetal terms.
    """
    largest = 0.0
    for k in range(len(w.free)):
        largest = max(largest, abs(w.free[k]) / sqrt(m.inverse_mass[k]))
    for r in range(m.rows):
        if w.G[r, r] > 0.0:
            largest = max(largest, abs(w.gamma[r]) / sqrt(w.G[r, r]))
    return largest


@kernel
def largest_speed(m, v):
    """Return the largest speed in v (3 * bodies,), m/s.

    Turning counts at the distance of the mechanism's size.
    """
    largest = 0.0
    for i in range(len(v)):
        largest = max(largest, abs(v[i]) * (m.length_scale if i % 3 == 2 else 1.0))
    return largest


@kernel
def row_acceleration(w, r, force):
    """Return the acceleration of a row beyond that required of it: G force - right."""
    left = -w.right[r]
    for k in range(len(force)):
        left += w.G[r, k] * force[k]
    return left


@kernel
def acceleration(m, w, force, a):
    """Fill a (3 * bodies,) with q'' = M^-1 (Q + J^T force), eqs. (22)-(24) and (33)."""
    for i in range(len(a)):
        a[i] = w.free[i]
    add_rows(m, w, force, a)


@kernel
def add_rows(m, w, force, a):
    """Add M^-1 J^T force to a (3 * bodies,); force has one value per row, tangential rows included."""
    JM = w.JM
    for b in range(len(m.block)):
        i, value, k = m.block[b, 0], force[m.block[b, 1]], m.block[b, 2]
        a[k] += JM[i] * value
        a[k + ONE] += JM[i + ONE] * value
        a[k + TWO] += JM[i + TWO] * value


@kernel(allocates=True)
def roots_of_mobility(m):
    """Return the diagonal of M^-1/2, (3 * bodies,)."""
    root = np.zeros(len(m.inverse_mass))
    for i in range(len(root)):
        root[i] = np.sqrt(m.inverse_mass[i])
    return root


@kernel(allocates=True)
def unit_rows(m: Arrays, w: Workspace, count: int, unit: Reals) -> tuple[Table, Reals]:
    """Return the first rows of J, each divided by its size, and the sizes.

    Coordinates are divided by `unit` (3 * bodies,).
    """
    row, size = np.zeros((count, len(unit))), np.zeros(count)
    for b in range(len(m.block)):
        i, r, k = np.int64(m.block[b, 0]), np.int64(m.block[b, 1]), np.int64(m.block[b, 2])
        if r < count:
            for c in range(3):
                row[r, k + c] += w.J[i + c] * unit[k + c]
    for j in range(count):
        square = product(row[j], row[j])
        size[j] = np.sqrt(square) if square > 0.0 else 1.0
        for c in range(len(unit)):
            row[j, c] /= size[j]
    return row, size
