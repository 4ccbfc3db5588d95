"""Compiled arithmetic of each step of an adapter: balance of momentum, friction bound, forward kinematics.

An engine's step of a small mechanism takes some microseconds, as long as a few operations on small arrays in Python. So
a step has one kernel, which ends it and begins the next one. The kernels are in one file because the cache of `kernel`
depends on the file of the function that is called.

Symbols of the kernels: `m` are the arrays of the mechanism and `w` is its workspace (`Arrays` and `Workspace` of
`stiction.reference_impl.multibody.mechanism`), `q`, `v`, `a` are coordinates, velocities and accelerations, `t` is the
time and `h` the step. `w.J` is the Jacobian J of the constraint rows and of the rows along frictional guides, `w.G` is
J M^-1 J^T, and `w.free` the acceleration M^-1 Q by the applied forces alone.
"""

from __future__ import annotations

from math import copysign, cos, isfinite, sin
from typing import Annotated

import numpy as np

from stiction.reference_impl.compiled.bundle import (
    Bundle,
    Integers,
    IntegerTable,
    Reals,
    Record,
    Table,
)
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import eliminate, minimum_norm
from stiction.reference_impl.compiled.loops import copy
from stiction.reference_impl.friction.coulomb import normal_load
from stiction.reference_impl.multibody.dynamics import applied_forces, row_form
from stiction.reference_impl.multibody.kinematics import rotate
from stiction.reference_impl.multibody.mechanism import Arrays, Mechanism, Workspace, workspace
from stiction.reference_impl.multibody.one_sided import add_one_sided

SATURATED = 1.0 - 1e-6
"""Part of the cap above which a guide slips. The distance from 1 is above the residuals of the engines' solvers (1e-9),
and below any difference of loads that matters."""
FIRST_PASSES = 3
"""Least number of attempts at each of the first steps, which have no reactions of a step before. With two, the friction
of two guides that load each other is off by the root of the step."""
LOOK_AHEAD = 1.5
"""A reversal is expected within this many steps at the last step's change of velocity. One step is the time until the
next sample; half a step is a margin for a change that grows."""

GUIDE = np.dtype(
    [
        *(
            (name, float)
            for name in (
                "mu",
                "mus",
                "length",
                "width",
                "normal_force",
                "moment",
                "friction",
                "held",
                "slip_speed",
                "slip_speed_before",
                "change",
                "coefficient",
                "cap",
                "bound",
                "static_bound",
                "constant",
                "radius",
            )
        ),
        *((name, np.int64) for name in ("stuck", "landed", "mode", "mode_before")),
    ]
)
"""A frictional joint (m; length 0 where it has none) and its state in the last step (N, N m, m/s; N m, rad/s of a pin).

`held` is the magnitude of its friction, as the engine has it, `cap` the largest that it may have: the bound of its
joint, or the sum of those of its contacts. `bound` and `static_bound` are the parts of its cap in slip and at rest that
do not depend on its load, and `constant` is that part in the present attempt, as `coefficient` is the coefficient.
`radius` is the distance (m) at which the balance of momentum has the friction of a pin as a force; 1 for a guide.
`change` is that of the slip speed in the step; `mode` is -1, 0 (stick) or 1 in it, `mode_before` in the one before."""
Guides = Annotated[np.ndarray, GUIDE, 1]


class Attempts(Record):
    """Number of attempts left for a step, and number of steps that still count as first ones."""

    left: int
    first: int


class Balance(Bundle):
    """The balance of momentum of a scene at an instant, `M a - Q = J^T lambda + T f`.

    `mass`, `q`, `v` and `loads` (the applied forces without weight) are (3 * bodies,). `bodies` (rows + frictional, 2)
    are the bodies of each row, -1 where there is none. `force` (rows + frictional,) are row forces, then frictions, of
    the last solution. `given_friction` (frictional,) are frictions that are given, NaN where they are to be found. The
    rest is scratch of `row_forces`.
    """

    m: Arrays
    w: Workspace
    mass: Reals
    bodies: IntegerTable
    q: Reals
    v: Reals
    loads: Reals
    force: Reals
    given_friction: Reals
    excess: Reals
    right: Reals
    solution: Reals
    least_squares: Reals
    unit: Reals
    unknown: Integers
    system: Table
    work: Table

    @classmethod
    def of(cls, mechanism: Mechanism) -> Balance:
        """Return the balance of a mechanism, with coordinates and rates at t = 0."""
        m = mechanism.arrays
        frictional, coordinates = len(m.friction), len(m.inverse_mass)
        rows = m.rows + frictional
        balance = cls.zeros(
            m=m,
            w=workspace(m),
            mass=coordinates,
            bodies=(rows, 2),
            given_friction=frictional,
            unit=2 * rows,
            unknown=rows,
            system=(rows, rows),
            work=(rows, rows),
            **dict.fromkeys(("q", "v", "loads", "excess"), coordinates),
            **dict.fromkeys(("force", "right", "solution", "least_squares"), rows),
        )
        balance.q[:], balance.v[:] = mechanism.initial_state()
        balance.mass[:] = 1.0 / m.inverse_mass
        # J has six entries a row, three for each of its two bodies: the place of a block of three
        # among them tells which of the two the body is.
        balance.bodies[:] = -1
        for place, row, coordinate in m.block:
            balance.bodies[row, place % 6 // 3] = coordinate // 3
        return balance


class Cap(Bundle):
    """Joints whose friction is capped, of a balance, with the number of attempts at an undecided step."""

    balance: Balance
    guides: Guides
    passes: int
    attempts: Attempts


class Tree(Bundle):
    """Tables of the links (`link_tree`), the link of each body, and the links' motion.

    q, v, a are (links, 3). `arm` (links, 6) has, in ground axes: from the parent's centre of mass to the joint, along
    the guide, and from the own centre of mass to the joint.
    """

    parent: Integers
    slides: Integers
    axis: Table
    anchor: Table
    point: Table
    angle: Reals
    order: Integers
    arm: Table
    q: Table
    v: Table
    a: Table


class SpaceStep(Bundle):
    """A step of h seconds in the bodies' coordinates.

    Its forces are those at the positions `ahead` seconds after its start, with the velocities at the start: h if the
    engine moves the bodies first, zero if it balances forces first. `loaded` is 1 if anything but weight acts on the
    bodies: `pushed`, (3 * bodies,), for the engine. `present` and `before` (bodies, 6): positions, angles, and their
    rates, as the engine has left them, and at the step's beginning. q, v, a (3 * bodies,): after the last pass, and the
    acceleration of its step.
    """

    cap: Cap
    h: float
    ahead: float
    loaded: int
    pushed: Reals
    present: Table
    before: Table
    q: Reals
    v: Reals
    a: Reals


class SpaceContacts(Bundle):
    """Contacts, by which guides rub, of an engine that reports them two bodies at a time.

    By frictional guide: the body of the slider, the engine's name of it (`identity`), the unit vector of the guide
    (`along`). By pair: names of the two bodies (`touching`), and the `impulse` of the step (N s): x, y, and the
    contact's normal; zero where there is no such pair.
    """

    guides: Guides
    step: SpaceStep
    slider: Integers
    identity: Annotated[np.ndarray, np.uint64, 1]
    along: Table
    touching: Annotated[np.ndarray, np.uint64, 2]
    impulse: Table


class JointStep(Bundle):
    """A step of h seconds in the joint coordinates of a tree, whose forces are those at its start.

    `loaded` is 1 if anything but weight acts on the bodies. `links`, `signs`: of the guides with a cap, and 1, or -1
    where the link's coordinate runs against the displacement. By link: `position`, `velocity` as the engine has left
    them; at the start of the step that is about to be made; at that of the last one, and the acceleration in it.
    q, v, a (3 * bodies,): of the bodies, at `start_position`; `a` is scratch.
    """

    cap: Cap
    h: float
    loaded: int
    tree: Tree
    links: Integers
    signs: Reals
    position: Reals
    velocity: Reals
    start_position: Reals
    start_velocity: Reals
    last_position: Reals
    last_velocity: Reals
    acceleration: Reals
    q: Reals
    v: Reals
    a: Reals


@kernel
def _place(balance, q, v, ahead):
    """Set the state of a balance: q moved on with v for `ahead` seconds, and v."""
    for i in range(len(q)):
        balance.q[i], balance.v[i] = q[i] + ahead * v[i], v[i]


@kernel
def applied_loads(balance: Balance, t: float, q: Reals, v: Reals, ahead: float) -> None:
    """Compute the applied forces without weight at q + ahead v, into the loads of a balance."""
    m, w, loads = balance.m, balance.w, balance.loads
    _place(balance, q, v, ahead)
    rotate(m, w, balance.q)
    applied_forces(m, w.rotation, t, balance.q, balance.v, loads)
    add_one_sided(m, w.rotation, balance.q, balance.v, w.acting, loads)
    # weight is the engine's own gravity
    for i in range(len(loads)):
        loads[i] -= m.weight[i]


@kernel
def assemble(balance: Balance, t: float, q: Reals, v: Reals, ahead: float) -> None:
    """Compute the rows, applied forces and loads of a balance at q + ahead v."""
    m, w, loads = balance.m, balance.w, balance.loads
    _place(balance, q, v, ahead)
    row_form(m, w, t, balance.q, balance.v)
    for i in range(len(loads)):
        loads[i] = w.free[i] * balance.mass[i] - m.weight[i]


@kernel
def _row_product(balance, r, v):
    """Return the product of row r of the Jacobian with v; a row has entries for at most two bodies."""
    J, product = balance.w.J, 0.0
    for side in range(2):
        body = balance.bodies[r, side]
        if body >= 0:
            for i in range(3):
                product += J[6 * r + 3 * side + i] * v[3 * body + i]
    return product


@kernel
def row_forces(balance: Balance, a: Reals) -> None:
    """Solve G force = J (a - M^-1 Q) for the row forces of accelerations a.

    The last rows are the frictions, which are solved for where `given_friction` is NaN.
    """
    m, w, force, given_friction, right = (
        balance.m,
        balance.w,
        balance.force,
        balance.given_friction,
        balance.right,
    )
    rows = m.rows
    size = rows + len(given_friction)
    # The right-hand side: J times the difference between the accelerations and those that the
    # applied forces alone would give. Where a run has diverged, all forces are NaN, which
    # `_set_caps` reports; the solvers below require finite numbers.
    finite = True
    for i in range(len(a)):
        balance.excess[i] = a[i] - w.free[i]
    for r in range(size):
        right[r] = _row_product(balance, r, balance.excess)
        finite = finite and np.isfinite(right[r])
    if not finite:
        for r in range(size):
            force[r] = np.nan
        return
    # Sort the rows: known frictions go to the right-hand side, all others are unknown.
    unknown, system, work = balance.unknown, balance.system, balance.work
    solution, least_squares = balance.solution, balance.least_squares
    n = 0
    for r in range(size):
        if r >= rows and not np.isnan(given_friction[r - rows]):
            force[r] = given_friction[r - rows]
        else:
            force[r] = 0.0
            unknown[n] = r
            n += 1
    # The system of the unknown rows, in two copies: elimination overwrites its own.
    for i in range(n):
        solution[i] = right[unknown[i]]
        for j in range(rows, size):
            solution[i] -= w.G[unknown[i], j] * force[j]
        least_squares[i] = solution[i]
        for j in range(n):
            system[i, j] = w.G[unknown[i], unknown[j]]
            work[i, j] = system[i, j]
    if eliminate(work, solution, balance.unit, n, n):
        for i in range(n):
            force[unknown[i]] = solution[i]
        return
    # Redundant rows: the motion does not determine their forces. Those of minimum norm are taken.
    minimum_norm(system, least_squares, n)
    for i in range(n):
        force[unknown[i]] = least_squares[i]


@kernel
def _sign(value):
    """Return -1, 0 or 1."""
    return copysign(1.0, value) if value != 0.0 else 0.0


@kernel
def _undecided(guide):
    """Return True if the next step may begin, end or contain stick."""
    return (
        guide.stuck != 0 or guide.slip_speed * (guide.slip_speed + LOOK_AHEAD * guide.change) <= 0.0
    )


@kernel
def _has_fixed_cap(guide):
    """Return True if the cap is one positive constant, so that the engine itself decides between stick and slip."""
    return guide.mus == 0.0 and guide.bound > 0.0 and guide.static_bound == guide.bound


@kernel
def _choose_coefficients(guides):
    """Set the coefficients and constants of the step that begins; return whether any cap is undecided."""
    any_undecided = False
    for i in range(len(guides)):
        guide = guides[i]
        undecided = _undecided(guide)
        any_undecided = any_undecided or (undecided and not _has_fixed_cap(guide))
        # Stick is tried first, with what static friction can hold.
        guide.coefficient = guide.mus if undecided else guide.mu
        guide.constant = guide.static_bound if undecided else guide.bound
        guide.slip_speed_before = guide.slip_speed
    return any_undecided


@kernel
def _all_caps_are_fixed(guides):
    """Return True if no cap depends on reactions or modes: then no step needs more than one attempt."""
    for i in range(len(guides)):
        if not _has_fixed_cap(guides[i]):
            return False
    return True


@kernel
def _record_mode(guide):
    """Set the mode of the step that was accepted, and keep the mode before."""
    guide.mode_before = guide.mode
    guide.mode = 0 if guide.stuck else int(_sign(guide.slip_speed))


@kernel
def _set_caps(cap):
    """Set the caps of the attempt that begins; raise FloatingPointError if a reaction is not finite."""
    for i in range(len(cap.guides)):
        guide = cap.guides[i]
        # The load |n1| + |n2| depends on the direction of friction, by the moment of the surfaces
        # (`friction_bound`). Friction that holds a slider opposes the motion that it would have.
        direction = -_sign(guide.friction) if guide.stuck else _sign(guide.slip_speed)
        kappa = -guide.coefficient * direction
        load = normal_load(guide, guide.normal_force, guide.moment, kappa)
        guide.cap = guide.constant + guide.coefficient * load
        if not isfinite(guide.cap):
            raise FloatingPointError("a reaction is not finite")


@kernel
def _begin(cap, loaded, t, q, v, ahead):
    """Begin a step: compute the loads at its instant, and for guides with a cap their balance, caps and attempts."""
    if len(cap.guides) == 0:
        if loaded:
            applied_loads(cap.balance, t, q, v, ahead)
        return
    assemble(cap.balance, t, q, v, ahead)
    # One attempt suffices where all guides slip on: the reactions of the step before are off by
    # O(h), as the step itself. A guide that may stick needs its cap and its reactions to agree.
    attempts = cap.attempts
    attempts.left = cap.passes if _choose_coefficients(cap.guides) else 1
    if attempts.first > 0 and not _all_caps_are_fixed(cap.guides):
        attempts.left = max(cap.passes, FIRST_PASSES)
    attempts.first = max(attempts.first - 1, 0)
    _set_caps(cap)


@kernel
def _judge(cap, a):
    """Evaluate an attempt by its accelerations and by the slip speeds that the guides have.

    Return True if the step is to be repeated.
    """
    guides, balance, m, attempts = cap.guides, cap.balance, cap.balance.m, cap.attempts
    # A guide whose friction stayed below its cap stuck. Its friction is what held it, and is solved
    # for; that of a guide which slipped is the cap.
    for i in range(len(guides)):
        guide = guides[i]
        guide.stuck = int(guide.held < guide.cap * SATURATED)
        balance.given_friction[i] = (
            np.nan if guide.stuck else -_sign(guide.slip_speed) * guide.cap / guide.radius
        )
    # The reactions of this attempt give the caps of the next one.
    row_forces(balance, a)
    for i in range(len(guides)):
        guide, row = guides[i], m.friction[i].row
        guide.normal_force, guide.moment = balance.force[row], balance.force[row + 1]
        guide.friction = balance.force[m.rows + i] * guide.radius
    attempts.left -= 1
    repeat = attempts.left > 0
    if attempts.left == 0:
        # The last attempt decides. A guide that did not stick with the static coefficient slips
        # with the kinetic one, for which the step is repeated once.
        for i in range(len(guides)):
            guide = guides[i]
            has_static_cap = guide.coefficient != guide.mu or guide.constant != guide.bound
            if not guide.stuck and has_static_cap:
                guide.coefficient, guide.constant = guide.mu, guide.bound
                repeat = True
    if repeat:
        _set_caps(cap)
        return True
    # Accepted: record what the next step needs to know of this one.
    for i in range(len(guides)):
        guide = guides[i]
        guide.change = guide.slip_speed - guide.slip_speed_before
        _record_mode(guide)
    return False


@kernel
def begin_contacts(guides: Guides) -> None:
    """Begin the first step of guides whose friction the engine's contacts find."""
    _choose_coefficients(guides)


@kernel
def finish_contacts(guides: Guides) -> None:
    """Evaluate a step by `cap`, `held` and `slip_speed` of the guides, and begin the next one."""
    for i in range(len(guides)):
        guide = guides[i]
        # A box that has not touched its surfaces yet has no friction, and stick is undecided.
        guide.stuck = int(guide.held < guide.cap * SATURATED or not guide.landed)
        guide.landed = int(guide.landed or guide.cap > 0.0)
        guide.change = guide.slip_speed - guide.slip_speed_before
        guide.friction = -_sign(guide.slip_speed) * guide.held
        _record_mode(guide)
    _choose_coefficients(guides)


@kernel
def finish_space_contacts(touch: SpaceContacts) -> None:
    """Evaluate a step by the impulses of its contacts, erase these, and begin the next step."""
    guides, step, touching, impulse = touch.guides, touch.step, touch.touching, touch.impulse
    for i in range(len(guides)):
        guide = guides[i]
        # Normal and tangential impulses (`along` and `across` the normal) of all contacts of the
        # slider. Magnitudes are added: a box may be pressed on by both surfaces.
        along, across = 0.0, 0.0
        for k in range(len(touching)):
            if touching[k, 0] == touch.identity[i] or touching[k, 1] == touch.identity[i]:
                jx, jy, nx, ny = impulse[k, 0], impulse[k, 1], impulse[k, 2], impulse[k, 3]
                along += abs(nx * jx + ny * jy)
                across += abs(nx * jy - ny * jx)
        guide.cap, guide.held = guide.coefficient * along / step.h, across / step.h
        vx = 3 * touch.slider[i]
        guide.slip_speed = touch.along[i, 0] * step.v[vx] + touch.along[i, 1] * step.v[vx + 1]
    # The engine writes pairs that touch only, so those of this step must not remain.
    impulse[:] = 0.0
    finish_contacts(guides)


@kernel
def _read_space(step):
    """Copy coordinates and velocities from the engine's layout, and difference the velocities."""
    present, before = step.present, step.before
    for body in range(len(present)):
        for k in range(3):
            i = 3 * body + k
            step.q[i], step.v[i] = present[body, k], present[body, 3 + k]
            step.a[i] = (step.v[i] - before[body, 3 + k]) / step.h


@kernel
def begin_space(step: SpaceStep, t: float) -> None:
    """Begin a step whose forces are those at t, in the present state."""
    cap = step.cap
    _read_space(step)
    for body in range(len(step.present)):
        for k in range(6):
            step.before[body, k] = step.present[body, k]
    _begin(cap, step.loaded, t, step.q, step.v, step.ahead)
    copy(cap.balance.loads, step.pushed)


@kernel
def finish_space(step: SpaceStep, t: float) -> bool:
    """Evaluate a pass. Return True if the step is to be repeated; otherwise begin the next one, with forces at t."""
    balance, guides = step.cap.balance, step.cap.guides
    _read_space(step)
    for i in range(len(guides)):
        guides[i].slip_speed = _row_product(balance, balance.m.rows + i, step.v)
    if len(guides) and _judge(step.cap, step.a):
        return True
    begin_space(step, t)
    return False


@kernel
def _turned(x, y, angle):
    """Return a vector turned by an angle, counter-clockwise."""
    c, s = cos(angle), sin(angle)
    return c * x - s * y, s * x + c * y


@kernel
def _move(tree, position, velocity, bodies_q, bodies_v):
    """Compute coordinates and velocities of links and bodies from those of the joints.

    A parent comes before its children, so that one pass over the links suffices.
    """
    parent, axis, anchor, point, order = tree.parent, tree.axis, tree.anchor, tree.point, tree.order
    arm, q, v = tree.arm, tree.q, tree.v
    for i in range(len(parent)):
        # (x, y), angle and their rates follow the chain: first the joint's point of the parent,
        # which is at rest on the ground, and otherwise moves with the rigid parent, v + omega x r.
        p = parent[i]
        x, y, angle = anchor[i, 0], anchor[i, 1], 0.0
        vx, vy, omega = 0.0, 0.0, 0.0
        if p >= 0:
            rx, ry = _turned(anchor[i, 0], anchor[i, 1], q[p, 2])
            arm[i, 0], arm[i, 1] = rx, ry
            angle, omega = q[p, 2], v[p, 2]
            x, y = q[p, 0] + rx, q[p, 1] + ry
            vx, vy = v[p, 0] - omega * ry, v[p, 1] + omega * rx
        angle += tree.angle[i]
        # Then the joint's own motion: (u d)' = u d' + d (omega x u) along the axis u, which turns
        # with the parent, or a rotation.
        if tree.slides[i]:
            ux, uy = _turned(axis[i, 0], axis[i, 1], angle)
            arm[i, 2], arm[i, 3] = ux, uy
            d, rate = position[i], velocity[i]
            x, y = x + ux * d, y + uy * d
            vx, vy = vx + ux * rate - uy * omega * d, vy + uy * rate + ux * omega * d
        else:
            angle, omega = angle + position[i], omega + velocity[i]
        # Last the way from the joint to the centre of mass of the link.
        bx, by = _turned(point[i, 0], point[i, 1], angle)
        arm[i, 4], arm[i, 5] = bx, by
        rx, ry = -bx, -by
        q[i, 0], q[i, 1], q[i, 2] = x + rx, y + ry, angle
        v[i, 0], v[i, 1], v[i, 2] = vx - omega * ry, vy + omega * rx, omega
    # Bodies in the scene's order; links without body are left out.
    for b in range(len(order)):
        for i in range(3):
            bodies_q[3 * b + i], bodies_v[3 * b + i] = q[order[b], i], v[order[b], i]


@kernel
def _accelerate(tree, position, velocity, acceleration, bodies_a):
    """Compute accelerations of links and bodies, at the coordinates and velocities that `_move` has set.

    The chain is that of `_move`, differentiated once more.
    """
    parent, order, arm, v, a = tree.parent, tree.order, tree.arm, tree.v, tree.a
    for i in range(len(parent)):
        # the joint's point of the parent: a + alpha x r - omega^2 r
        p = parent[i]
        ax, ay, alpha, omega = 0.0, 0.0, 0.0, 0.0
        if p >= 0:
            rx, ry = arm[i, 0], arm[i, 1]
            omega, alpha = v[p, 2], a[p, 2]
            ax = a[p, 0] - alpha * ry - omega * omega * rx
            ay = a[p, 1] + alpha * rx - omega * omega * ry
        if tree.slides[i]:
            # (u d)'' = u (d'' - omega^2 d) + (k x u) (alpha d + 2 omega d')
            ux, uy = arm[i, 2], arm[i, 3]
            d, rate = position[i], velocity[i]
            along = acceleration[i] - omega * omega * d
            across = alpha * d + 2 * omega * rate
            ax, ay = ax + ux * along - uy * across, ay + uy * along + ux * across
        else:
            omega, alpha = omega + velocity[i], alpha + acceleration[i]
        # from the joint to the centre of mass
        rx, ry = -arm[i, 4], -arm[i, 5]
        a[i, 0] = ax - alpha * ry - omega * omega * rx
        a[i, 1] = ay + alpha * rx - omega * omega * ry
        a[i, 2] = alpha
    for b in range(len(order)):
        for i in range(3):
            bodies_a[3 * b + i] = a[order[b], i]


@kernel
def motion(
    tree: Tree, position: Reals, velocity: Reals, acceleration: Reals, q: Reals, v: Reals, a: Reals
) -> None:
    """Forward kinematics: per body x, y, angle of the centre of mass and their first and second derivatives."""
    _move(tree, position, velocity, q, v)
    _accelerate(tree, position, velocity, acceleration, a)


@kernel
def begin_joints(step: JointStep, t: float) -> None:
    """Begin a step, at t, in the present state."""
    copy(step.position, step.start_position)
    copy(step.velocity, step.start_velocity)
    # Engines in joint coordinates find accelerations at the start of a step. Without loads and
    # guides nothing of the adapter depends on the bodies' state, so it is not computed.
    if len(step.cap.guides) or step.loaded:
        _move(step.tree, step.position, step.velocity, step.q, step.v)
        _begin(step.cap, step.loaded, t, step.q, step.v, 0.0)


@kernel
def finish_joints(step: JointStep, t: float) -> bool:
    """Evaluate a pass. Return True if the step is to be repeated; otherwise begin the next one, at t."""
    guides, before = step.cap.guides, step.start_velocity
    for i in range(len(step.velocity)):
        step.acceleration[i] = (step.velocity[i] - before[i]) / step.h
    if len(guides):
        for i in range(len(guides)):
            guides[i].slip_speed = step.signs[i] * step.velocity[step.links[i]]
        _accelerate(step.tree, step.start_position, before, step.acceleration, step.a)
        if _judge(step.cap, step.a):
            return True
    copy(step.start_position, step.last_position)
    copy(before, step.last_velocity)
    begin_joints(step, t)
    return False
