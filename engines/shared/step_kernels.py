"""What adapters call at each step of their engine, compiled: balance of momentum, friction bound, forward kinematics.

An engine's step of a small mechanism takes ten microseconds, as long as a few operations on small arrays in Python. The kernels stand
in one file because the cache of `kernel` looks at the file of the function that is called.
"""

from __future__ import annotations

from math import copysign, cos, sin
from typing import Any

import numpy as np
from numba import types
from numba.experimental import structref

from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import eliminate, minimum_norm
from stiction.reference_impl.multibody.dynamics import applied_forces, row_form
from stiction.reference_impl.multibody.kinematics import rotate

SATURATED = 1.0 - 1e-6
"""Of the cap: friction above it slips. Above the engines' solver residuals (1e-9), below any load that matters."""
LOOK_AHEAD = 1.5
"""A reversal is expected within this many steps at the last step's change of velocity."""

GUIDE = np.dtype([("mu", float), ("mus", float), ("length", float), ("width", float),
                  ("normal_force", float), ("moment", float), ("friction", float), ("stuck", np.int64), ("landed", np.int64),
                  ("slip_speed", float), ("slip_speed_before", float), ("change", float), ("mode_before", np.int64),
                  ("coefficient", float), ("cap", float)])
"""A frictional guide (m; length 0: without) and what the last step told of it: N, N m, m/s; `change` of the slip speed in it."""


class _Data(types.StructRef):
    """Type of what kernels hold together: one argument of a call from Python, where its fields would be some thirty arrays."""

    def preprocess_fields(self, fields: Any) -> Any:
        return tuple((name, types.unliteral(kind)) for name, kind in fields)


@structref.register
class _BalanceType(_Data):
    pass


class Balance(structref.StructRefProxy):
    """A scene: `m`, `w` (arrays and workspace of the reference), masses, bodies of each row, room for q and v."""


structref.define_constructor(Balance, _BalanceType, ["m", "w", "mass", "bodies", "q", "v"])
structref.define_boxing(_BalanceType, Balance)


@structref.register
class _CapType(_Data):
    pass


class Cap(structref.StructRefProxy):
    """Guides whose friction is capped: balance, table of `GUIDE`, attempts at an undecided step, attempts left, first steps left."""


structref.define_constructor(Cap, _CapType, ["balance", "guides", "passes", "left", "first"])
structref.define_boxing(_CapType, Cap)


@structref.register
class _TreeType(_Data):
    pass


class Tree(structref.StructRefProxy):
    """Tables of the links of `stiction.engines.shared.link_tree`, and the link of each body."""


structref.define_constructor(Tree, _TreeType, ["parent", "slides", "axis", "anchor", "point", "angle", "order"])
structref.define_boxing(_TreeType, Tree)


@kernel(allocates=True)
def make_balance(m, w, mass, bodies, q, v):
    return Balance(m, w, mass, bodies, q, v)


@kernel(allocates=True)
def applied_loads(balance, t, q, v, ahead, loads):
    """Applied forces without weight into loads (3 * bodies,), at q + ahead v."""
    m, w, place, rate = balance.m, balance.w, balance.q, balance.v
    for i in range(len(q)):
        place[i], rate[i] = q[i] + ahead * v[i], v[i]
    rotate(m, w, place)
    applied_forces(m, w.rotation, t, place, rate, loads)
    for i in range(len(loads)):
        loads[i] -= m.weight[i]


@kernel(allocates=True)
def assemble(balance, t, q, v, ahead, loads):
    """Rows and forces at q + ahead v; applied forces without weight into loads (3 * bodies,)."""
    m, w, place, rate = balance.m, balance.w, balance.q, balance.v
    for i in range(len(q)):
        place[i], rate[i] = q[i] + ahead * v[i], v[i]
    row_form(m, w, t, place, rate)
    for i in range(len(loads)):
        loads[i] = w.free[i] * balance.mass[i] - m.weight[i]


@kernel(allocates=True)
def row_product(balance, r, v):
    """J v of one row."""
    J, product = balance.w.J, 0.0
    for side in range(2):
        body = balance.bodies[r, side]
        if body >= 0:
            for i in range(3):
                product += J[6 * r + 3 * side + i] * v[3 * body + i]
    return product


@kernel(allocates=True)
def row_forces(balance, a, friction):
    """Row forces with G force = J (a - M^-1 Q); the last rows are the frictions, solved for where NaN."""
    m, w = balance.m, balance.w
    rows, size = m.rows, m.rows + len(friction)
    excess = a - w.free
    right = np.empty(size)
    for r in range(size):
        right[r] = row_product(balance, r, excess)
    if not np.isfinite(right).all():
        return np.full(size, np.nan)
    force, index, unknown = np.zeros(size), np.empty(size, dtype=np.int64), 0
    for r in range(size):
        if r >= rows and not np.isnan(friction[r - rows]):
            force[r] = friction[r - rows]
        else:
            index[unknown] = r
            unknown += 1
    system, solution = np.empty((unknown, unknown)), np.empty(unknown)
    for i in range(unknown):
        solution[i] = right[index[i]]
        for j in range(rows, size):
            solution[i] -= w.G[index[i], j] * force[j]
        for j in range(unknown):
            system[i, j] = w.G[index[i], index[j]]
    least_squares = solution.copy()
    if not eliminate(system.copy(), solution, np.empty(2 * unknown), unknown):
        solution = least_squares
        minimum_norm(system, solution, unknown)
    for i in range(unknown):
        force[index[i]] = solution[i]
    return force


@kernel(allocates=True)
def make_cap(balance, guides, passes, first):
    return Cap(balance, guides, passes, 0, first)


@kernel
def _sign(value):
    return copysign(1.0, value) if value != 0.0 else 0.0


@kernel
def _undecided(guide):
    """Whether the next step may begin, end or contain stick."""
    return guide.stuck != 0 or guide.slip_speed * (guide.slip_speed + LOOK_AHEAD * guide.change) <= 0.0


@kernel
def choose(guides):
    """Set the coefficients of the step that begins; returns whether any guide is undecided."""
    open_ = False
    for i in range(len(guides)):
        guide = guides[i]
        undecided = _undecided(guide)
        open_ = open_ or undecided
        guide.coefficient = guide.mus if undecided else guide.mu
        guide.slip_speed_before = guide.slip_speed
        guide.mode_before = 0 if guide.stuck else int(_sign(guide.slip_speed))
    return open_


@kernel
def _set_caps(guides):
    for i in range(len(guides)):
        guide = guides[i]
        load, c = abs(guide.normal_force), guide.coefficient
        if guide.length > 0.0:
            direction = -_sign(guide.friction) if guide.stuck else _sign(guide.slip_speed)
            surfaces = guide.width / 2 * direction * c * guide.normal_force
            load = max(load, 2 / guide.length * abs(guide.moment + surfaces))
        guide.cap = c * load


@kernel(allocates=True)
def prepare(cap, t, q, v, ahead, loads):
    """Begin a step: balance of momentum at its instant, coefficients, caps, number of attempts."""
    assemble(cap.balance, t, q, v, ahead, loads)
    undecided = choose(cap.guides)
    cap.left = cap.passes if undecided or cap.first > 0 else 1
    cap.first = max(cap.first - 1, 0)
    _set_caps(cap.guides)


@kernel(allocates=True)
def judge(cap, a, slip_speed, held):
    guides, m = cap.guides, cap.balance.m
    known = np.empty(len(guides))
    for i in range(len(guides)):
        guide = guides[i]
        guide.stuck, guide.slip_speed = int(held[i] < guide.cap * SATURATED), slip_speed[i]
        known[i] = np.nan if guide.stuck else -_sign(guide.slip_speed) * guide.cap
    force = row_forces(cap.balance, a, known)
    for i in range(len(guides)):
        guide, row = guides[i], m.friction[i].row
        guide.normal_force, guide.moment, guide.friction = force[row], force[row + 1], force[m.rows + i]
    cap.left -= 1
    repeat = cap.left > 0
    if cap.left == 0:  # what did not stick with the static coefficient slips with the kinetic one
        for i in range(len(guides)):
            guide = guides[i]
            if not guide.stuck and guide.coefficient != guide.mu:
                guide.coefficient = guide.mu
                repeat = True
    if repeat:
        _set_caps(guides)
        return True
    for i in range(len(guides)):
        guides[i].change = guides[i].slip_speed - guides[i].slip_speed_before
    return False


@kernel(allocates=True)
def judge_velocities(cap, before, after, h, held):
    rows, count = cap.balance.m.rows, len(held)
    slip_speed = np.empty(count)
    for i in range(count):
        slip_speed[i] = row_product(cap.balance, rows + i, after)
    return judge(cap, (after - before) / h, slip_speed, held)


@kernel
def observe(guides, loads, frictions, slip_speeds):
    for i in range(len(guides)):
        guide = guides[i]
        guide.stuck = int(frictions[i] < loads[i] * SATURATED or not guide.landed)
        guide.landed = int(guide.landed or loads[i] > 0.0)
        guide.change, guide.slip_speed = slip_speeds[i] - guide.slip_speed, slip_speeds[i]
        guide.friction = -_sign(slip_speeds[i]) * frictions[i]


@kernel(allocates=True)
def motion(tree, position, velocity, acceleration, bodies_q, bodies_v, bodies_a):
    """Forward kinematics: per body x, y, angle of the centre of mass and their first and second derivatives."""
    parent, slides, axis, anchor, point, angle = tree.parent, tree.slides, tree.axis, tree.anchor, tree.point, tree.angle
    n, order = len(parent), tree.order
    q, v, a = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    for i in range(n):
        x = y = th = vx = vy = om = ax = ay = al = 0.0
        p = parent[i]
        if p >= 0:
            c, s = cos(q[p, 2]), sin(q[p, 2])
            rx, ry = c * anchor[i, 0] - s * anchor[i, 1], s * anchor[i, 0] + c * anchor[i, 1]
            th, om, al = q[p, 2], v[p, 2], a[p, 2]
            x, y = q[p, 0] + rx, q[p, 1] + ry
            vx, vy = v[p, 0] - om * ry, v[p, 1] + om * rx
            ax, ay = a[p, 0] - al * ry - om * om * rx, a[p, 1] + al * rx - om * om * ry
        else:
            x, y = anchor[i]
        th += angle[i]
        if slides[i]:
            c, s = cos(th), sin(th)
            ux, uy = c * axis[i, 0] - s * axis[i, 1], s * axis[i, 0] + c * axis[i, 1]
            d, d1, d2 = position[i], velocity[i], acceleration[i]
            # (u d)'' = u (d'' - omega^2 d) + (k x u) (alpha d + 2 omega d')
            along, across = d2 - om * om * d, al * d + 2 * om * d1
            x, y = x + ux * d, y + uy * d
            vx, vy = vx + ux * d1 - uy * om * d, vy + uy * d1 + ux * om * d
            ax, ay = ax + ux * along - uy * across, ay + uy * along + ux * across
        else:
            th, om, al = th + position[i], om + velocity[i], al + acceleration[i]
        c, s = cos(th), sin(th)
        rx, ry = -(c * point[i, 0] - s * point[i, 1]), -(s * point[i, 0] + c * point[i, 1])
        q[i] = x + rx, y + ry, th
        v[i] = vx - om * ry, vy + om * rx, om
        a[i] = ax - al * ry - om * om * rx, ay + al * rx - om * om * ry, al
    for b in range(len(order)):
        for i in range(3):
            bodies_q[3 * b + i], bodies_v[3 * b + i], bodies_a[3 * b + i] = q[order[b], i], v[order[b], i], a[order[b], i]


@kernel(allocates=True)
def make_tree(parent, slides, axis, anchor, point, angle, order):
    return Tree(parent, slides, axis, anchor, point, angle, order)


@kernel(allocates=True)
def prepare_joints(tree, cap, t, position, velocity, q, loads):
    """As `prepare`, from joint coordinates and velocities; the bodies' coordinates come into q (3 * bodies,)."""
    v, a = np.empty_like(q), np.empty_like(q)
    motion(tree, position, velocity, np.zeros_like(position), q, v, a)
    prepare(cap, t, q, v, 0.0, loads)


@kernel(allocates=True)
def judge_joints(tree, cap, position, before, after, h, slip_speed, held):
    """As `judge`, from joint coordinates before a step and joint velocities before and after it."""
    q, v, a = np.empty_like(cap.balance.q), np.empty_like(cap.balance.q), np.empty_like(cap.balance.q)
    motion(tree, position, before, (after - before) / h, q, v, a)
    return judge(cap, a, slip_speed, held)
