"""Moreau's time stepping with unilateral contacts at a small clearance, compiled.

The method before bilateral guides with friction (Flores, Leine & Glocker, Modeling and analysis of planar rigid
multibody systems with translational clearance joints based on the non-smooth dynamics approach, Multibody Syst. Dyn. 23
(2010) 165-190). Each corner of a slider may touch the surface of the guide beside it, at the gap g; a guide without
length has its point between two surfaces. With clearance c the slider can move by +-c across its guide. A step from (q,
v) to (q+, v+), with q_M = q + dt/2 v:

    M (v+ - v) = dt Q(t_M, q_M, v) + J^T P + W_N P_N + W_T P_T ,    q+ = q_M + dt/2 v+
    J v+ + Phi_t = -Phi/dt                       pins, drives, angle of a slider without length, all at (t_M, q_M)
    0 <= P_N  _|_  W_N^T v+ + e W_N^T v >= 0     contacts with g(q_M) <= 0; e: Newton's coefficient of restitution
    P_T in mu P_N [-1, 1],  -W_T^T v+ in its normal cone     Coulomb's law; there is one coefficient, mus is not used

Beyond that paper: joints whose friction has a constant bound F of its own (`Arrays.friction`), of pins and guides, have
a direction W_C each, which is always closed, with impulses P_C in F dt [-1, 1]; there is one bound, the static one is
not used. A drive with a limit is such a direction, whose velocity is W_C^T v+ minus the rate of its law at t_M.

Bilateral impulses are eliminated. What is left is a linear complementarity problem with P_T = b1 - b2 and the largest
slip l of a contact (Stewart & Trinkle, Int. J. Numer. Methods Eng. 39 (1996) 2673-2691, one direction in the plane),
copositive, so that Lemke's method finds a solution wherever some velocity is admissible:

    w_N = D_NN P_N + D_NT (b1 - b2) + c_N      w_i = +-(D_TN P_N + D_TT (b1 - b2) + c_T) + l      w_l = mu P_N - b1 - b2

with w_l = F dt - b1 - b2 for a constant bound.

The right side -Phi/dt takes back the drift of the last step; contacts keep their penetration, at most that of one step.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from stiction.reference_impl.compiled.bundle import Bundle, Integers, Reals, Record, Table
from stiction.reference_impl.compiled.kernel import clock, kernel
from stiction.reference_impl.compiled.linear_algebra import eliminate_columns
from stiction.reference_impl.compiled.loops import copy, is_finite, product
from stiction.reference_impl.friction.hlcp import COMPLIANCE
from stiction.reference_impl.friction.lemke import lemke
from stiction.reference_impl.friction.outcomes import BREAKDOWNS, DONE, NOT_FINITE, SINGULAR, SOLVED
from stiction.reference_impl.friction.solver_names import named
from stiction.reference_impl.integration.result import Run, Samples
from stiction.reference_impl.integration.step_audit import GOLDEN
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.kinematics import direction_at, point_at, row_along
from stiction.reference_impl.multibody.mechanism import (
    NO_LAW,
    Arrays,
    Mechanism,
    Workspace,
    workspace,
)
from stiction.reference_impl.multibody.trajectory_columns import build_columns
from stiction.scenes import Breakdown, Cost

CONTACT = np.dtype(
    [
        *((name, np.int64) for name in ("guide", "corner", "row", "friction", "a", "b")),
        *(
            (name, float)
            for name in (
                "ax",
                "ay",
                "bx",
                "by",
                "ux",
                "uy",
                "side",
                "along",
                "across",
                "offset",
                "mu",
                "restitution",
            )
        ),
    ]
)
"""Corner 0 .. 3 (lower rear, lower front, upper front, upper rear) at (ax, ay) of body a, against the guide at (bx, by)
of body b along (ux, uy); the row of the guide's normal force, and its number among the frictional ones or -1; side 1:
the lower surface, which pushes along the normal; (along, across): the place seen from the slider's point, by which
forces turn it, 0 where its angle is held; gap = side * coordinate + offset; mu: the coefficient of friction,
restitution: Newton's coefficient."""
AT_REST = 1e-10
"""Slip speed of a loaded contact, relative to the largest speed, that counts as none: Lemke's zeros are rounding."""


class Work(Record):
    """Counters of a run: steps, contacts that were closed in them, pivots."""

    steps: int
    contacts: int
    pivots: int


class Contacts(Bundle):
    """The unilateral part of a mechanism, and the numbers of the constraint rows that stay.

    `dry` are the numbers of the frictional joints with a constant bound.
    """

    contact: Annotated[np.ndarray, CONTACT, 1]
    bilateral: Integers
    dry: Integers


class Task(Bundle):
    """Steps of one length dt (s), of which every `every`-th instant is kept."""

    dt: float
    steps: int
    every: int


class State(Bundle):
    """State at the start of a step, v at its end, counters, and what is kept.

    `corners`, (samples, guides, 4, 2): normal force and friction of each corner, N, impulses over dt as all forces are.
    """

    q: Reals
    v: Reals
    v_new: Reals
    law_rate: Reals  # (dry,), rates of the laws of drives with a limit, m/s; 0 of joints
    work: Work
    samples: Samples
    corners: Annotated[np.ndarray, np.float64, 4]


def contacts_of(mechanism: Mechanism, clearance: float) -> Contacts:
    """Return the contacts of all guides; `clearance` (m) is the gap of guides that declare none."""
    m = mechanism.arrays
    contacts: list[tuple[float, ...]] = []
    released: set[int] = set()
    constraints = dict(zip([*mechanism.scene.joints, *mechanism.scene.drives], m.constraint))
    for number, (name, joint) in enumerate(mechanism.scene.guides.items()):
        c, half_a, half_b = (
            constraints[name],
            0.5 * (joint.length or 0.0),
            0.5 * (joint.width or 0.0),
        )
        released.update({c["row"], c["row"] + 1} if half_a else {c["row"]})
        places = (
            [(-half_a, 1), (half_a, 1), (half_a, -1), (-half_a, -1)]
            if half_a
            else [(0.0, 1), (0.0, -1)]
        )
        cos, sin = np.cos(c["offset"]), np.sin(c["offset"])
        ux, uy = (
            cos * c["ux"] + sin * c["uy"],
            cos * c["uy"] - sin * c["ux"],
        )  # the direction in the slider's axes
        for corner, (along, side) in enumerate(places):
            across = -side * half_b
            contacts.append(
                (
                    number,
                    corner,
                    c["row"],
                    c["friction"],
                    c["a"],
                    c["b"],
                    c["ax"] + along * ux - across * uy,
                    c["ay"] + along * uy + across * ux,
                    c["bx"],
                    c["by"],
                    c["ux"],
                    c["uy"],
                    side,
                    along,
                    across if half_a else 0.0,
                    half_b + (joint.clearance or clearance),
                    joint.mu or 0.0,
                    joint.restitution,
                )
            )
    kept = [row for row in range(m.rows) if row not in released]
    return Contacts(
        np.array(contacts, dtype=CONTACT),
        np.array(kept, dtype=np.int64),
        np.flatnonzero(m.friction["bound"] > 0.0).astype(np.int64),
    )


@kernel(allocates=True)
def _active_rows(
    m: Arrays, w: Workspace, contacts: Contacts, q: Reals, v: Reals
) -> tuple[Integers, Table]:
    """Return the numbers of the closed contacts, and their rows (2 * closed + dry, 3 * bodies).

    Rows of the normals come first, then those of the tangents, then the directions of dry friction.
    """
    rows, closed, n = (
        np.zeros((len(contacts.contact), 12)),
        np.zeros(len(contacts.contact), dtype=np.int64),
        0,
    )
    for k in range(len(contacts.contact)):
        contact = contacts.contact[k]
        rax, ray, xa, ya, _, _, _, _ = point_at(w.rotation, q, v, contact.a, contact.ax, contact.ay)
        rbx, rby, xb, yb, _, _, _, _ = point_at(w.rotation, q, v, contact.b, contact.bx, contact.by)
        ux, uy, _ = direction_at(w.rotation, v, contact.b, contact.ux, contact.uy)
        dx, dy, arms = xa - xb, ya - yb, (rax, ray, rbx, rby)
        if contact.side * (ux * dy - uy * dx) + contact.offset <= 0.0:
            row_along(rows[k], 0, -contact.side * uy, contact.side * ux, arms, dx, dy)
            row_along(rows[k], 1, ux, uy, arms, dx, dy)
            closed[n] = k
            n += 1
    W = np.zeros((2 * n + len(contacts.dry), len(q)))
    for b in range(len(m.block)):
        at, row, column = np.int64(m.block[b, 0]), np.int64(m.block[b, 1]), np.int64(m.block[b, 2])
        for i in range(len(contacts.dry)):
            if contacts.dry[i] == row - m.rows:
                for c in range(3):
                    W[2 * n + i, column + c] = w.J[at + c]
    for i in range(2 * n):
        k, half = closed[i % n], 6 * (i // n)
        a, b = contacts.contact[k].a, contacts.contact[k].b
        for c in range(3):
            if a >= 0:
                W[i, 3 * a + c] = rows[k, half + c]
            if b >= 0:
                W[i, 3 * b + c] = rows[k, half + 3 + c]
    return closed[:n], W


@kernel(allocates=True)
def _bilateral(
    m: Arrays, w: Workspace, contacts: Contacts, W: Table, dt: float
) -> tuple[Table, Table]:
    """Return J (rows, 3 * bodies) of the bilateral rows, and their answer X to contact impulses.

    X has the shape (rows, 1 + contacts). To contact impulses P_c, the impulses of the rows are
    X[:, 0] - X[:, 1:] P_c. X has no rows if they cannot be solved for.
    """
    kept = contacts.bilateral
    n, place = len(kept), np.zeros(len(w.G), dtype=np.int64)
    J, A, X, largest = np.zeros((n, W.shape[1])), np.zeros((n, n)), np.zeros((n, 1 + len(W))), 0.0
    for i in range(n):
        place[kept[i]] = i + 1
        largest = max(largest, w.G[kept[i], kept[i]])
    for b in range(len(m.block)):
        at, row, k = np.int64(m.block[b, 0]), place[m.block[b, 1]] - 1, np.int64(m.block[b, 2])
        if row >= 0:
            for c in range(3):
                J[row, k + c] = w.J[at + c]
    for compliance in (0.0, COMPLIANCE * largest):
        for i in range(n):
            r, free = kept[i], 0.0
            for j in range(n):
                A[i, j] = w.G[r, kept[j]]
            A[i, i] += compliance
            for c in range(W.shape[1]):
                free += J[i, c] * w.free[c]
            X[i, 0] = -free * dt - w.phi_dot[r] - w.phi[r] / dt
            for j in range(len(W)):
                X[i, 1 + j] = _across(m, J, i, W, j)
        if eliminate_columns(A, X, n, X.shape[1], n):
            return J, X
    return J, X[:0]


@kernel
def _across(m, rows, i, others, j):
    """Return row i of one table times M^-1 times row j of another."""
    total = 0.0
    for c in range(rows.shape[1]):
        total += rows[i, c] * m.inverse_mass[c] * others[j, c]
    return total


@kernel(allocates=True)
def _contact_matrix(m: Arrays, W: Table, J: Table, X: Table) -> Table:
    """Return the velocities of the closed contacts per contact impulse.

    They include what the bilateral rows answer.
    """
    D = np.zeros((len(W), len(W)))
    for i in range(len(W)):
        for j in range(len(W)):
            D[i, j] = _across(m, W, i, W, j)
        for r in range(len(J)):
            joint = _across(m, W, i, J, r)
            for j in range(len(W)):
                D[i, j] -= joint * X[r, 1 + j]
    return D


@kernel(allocates=True)
def _contact_impulses(D: Table, c: Reals, mu: Reals, limit: Reals, P: Reals) -> tuple[int, int]:
    """Solve the complementarity problem of the closed contacts for P = (P_N, P_T, P_C); returns outcome and pivots.

    D (2n + d, 2n + d) is velocity per impulse, c (2n + d,) the velocities without contact impulses, restitution
    included. `mu` (n,): coefficients of the contacts; `limit` (d,): constant bounds of impulses, N s.
    """
    n, tangents = len(mu), len(mu) + len(limit)
    size = 1e-300
    for i in range(n + tangents):
        size = max(size, D[i, i])
    count = n + 3 * tangents
    A, b, cover = np.zeros((count, count)), np.zeros(count), np.zeros(count)
    for i in range(count):
        # Lemke's covering vector, spread over 1 .. 1.5: the two corners on one surface have one tangent, and with equal
        # weights their ties led his method to a ray within seconds of the paper's example
        cover[i] = 1.0 + 0.5 * (GOLDEN * (i + 1) % 1.0)
    # places of b1, b2 and l behind those of P_N
    one, two, slip = n, n + tangents, n + 2 * tangents
    for i in range(n):
        for j in range(n):
            A[i, j] = D[i, j] / size
        for j in range(tangents):
            NT, TN = D[i, n + j] / size, D[n + j, i] / size
            A[i, one + j], A[i, two + j] = NT, -NT
            A[one + j, i], A[two + j, i] = TN, -TN
        b[i] = c[i]
    for i in range(tangents):
        for j in range(tangents):
            T = D[n + i, n + j] / size
            A[one + i, one + j], A[one + i, two + j] = T, -T
            A[two + i, one + j], A[two + i, two + j] = -T, T
        A[one + i, slip + i], A[two + i, slip + i] = 1.0, 1.0
        A[slip + i, one + i], A[slip + i, two + i] = -1.0, -1.0
        b[one + i], b[two + i] = c[n + i], -c[n + i]
        if i < n:
            A[slip + i, i] = mu[i]
        else:
            b[slip + i] = limit[i - n] * size
    _, z, outcome, pivots = lemke(A, b, cover)
    for i in range(n):
        P[i] = z[i] / size
    for i in range(tangents):
        P[n + i] = (z[one + i] - z[two + i]) / size
    return outcome, pivots


@kernel
def _read_law_rates(m, w, contacts, s, W, n):
    """Fill `State.law_rate` for n closed contacts: the rate of a law is W v minus the slip speed."""
    for i in range(len(contacts.dry)):
        f = contacts.dry[i]
        s.law_rate[i] = 0.0
        if m.friction[f].law != NO_LAW:
            s.law_rate[i] = product(W[2 * n + i], s.v) - w.slip_speed[f]


@kernel(allocates=True)
def _step(
    m: Arrays, w: Workspace, contacts: Contacts, s: State, task: Task, t: float, row: int
) -> int:
    """Make one step from (t, q, v), and return the outcome.

    q becomes q+. v+ goes to v_new, and the forces to a row of the samples.
    """
    dt, q, v, v_new, force = task.dt, s.q, s.v, s.v_new, s.samples.force[row]
    for k in range(len(q)):
        q[k] += 0.5 * dt * v[k]
    row_form(m, w, t + 0.5 * dt, q, v)
    closed, W = _active_rows(m, w, contacts, q, v)
    n, impulses = len(closed), len(W)
    _read_law_rates(m, w, contacts, s, W, n)
    J, X = _bilateral(m, w, contacts, W, dt)
    if len(X) < len(J):
        return SINGULAR
    for k in range(len(v)):
        impulse = 0.0
        for r in range(len(J)):
            impulse += J[r, k] * X[r, 0]
        v_new[k] = v[k] + dt * w.free[k] + m.inverse_mass[k] * impulse
    P = np.zeros(impulses)
    if impulses:
        c, mu, limit = np.zeros(impulses), np.zeros(n), np.zeros(len(contacts.dry))
        restitution = np.zeros(n)
        for i in range(n):
            contact = contacts.contact[closed[i]]
            mu[i], restitution[i] = contact.mu, contact.restitution
        for i in range(impulses):
            for k in range(len(v)):
                c[i] += W[i, k] * (v_new[k] + (restitution[i] * v[k] if i < n else 0.0))
        for i in range(len(limit)):
            limit[i] = m.friction[contacts.dry[i]].bound * dt
            c[2 * n + i] -= s.law_rate[i]
        outcome, pivots = _contact_impulses(_contact_matrix(m, W, J, X), c, mu, limit, P)
        s.work.pivots += pivots
        if outcome != SOLVED:
            return outcome
        for k in range(len(v)):
            impulse = 0.0
            for i in range(impulses):
                impulse += W[i, k] * P[i]
            for r in range(len(J)):
                impulse -= J[r, k] * product(X[r, 1:], P)
            v_new[k] += m.inverse_mass[k] * impulse
    s.work.contacts += n
    for r in range(len(force)):
        force[r] = 0.0
    for i in range(len(contacts.bilateral)):
        force[contacts.bilateral[i]] = (X[i, 0] - product(X[i, 1:], P)) / dt
    for i in range(impulses):
        P[i] /= dt
    _reactions(m, w, contacts, s, closed, W, P, row)
    for k in range(len(q)):
        q[k] += 0.5 * dt * v_new[k]
    return SOLVED


@kernel(allocates=True)
def _reactions(m, w, contacts, s, closed, W, P, row):
    """Return forces of the guides' rows and corners, and directions of slip.

    They follow from the forces P of the closed contacts.
    """
    v_new, force, slip, corner = s.v_new, s.samples.force[row], s.samples.slip[row], s.corners[row]
    n, speed, heaviest = len(closed), 0.0, np.zeros(len(corner))
    for k in range(len(v_new)):
        speed = max(speed, abs(v_new[k]))
    for g in range(len(corner)):
        for k in range(4):
            corner[g, k, 0], corner[g, k, 1] = 0.0, 0.0
    for f in range(len(slip)):
        slip[f] = 1 if w.slip_speed[f] > 0.0 else -1
    for i in range(len(contacts.dry)):
        force[m.rows + contacts.dry[i]] += P[2 * n + i]
        slip_speed = product(W[2 * n + i], v_new) - s.law_rate[i]
        slip[contacts.dry[i]] = _direction(slip_speed, max(speed, abs(s.law_rate[i])))
    for i in range(n):
        contact, normal, friction = contacts.contact[closed[i]], P[i], P[n + i]
        corner[contact.guide, contact.corner, 0], corner[contact.guide, contact.corner, 1] = (
            normal,
            friction,
        )
        force[contact.row] += contact.side * normal
        force[contact.row + 1] += contact.along * contact.side * normal - contact.across * friction
        if contact.friction < 0:
            continue
        force[m.rows + contact.friction] += friction
        if normal > heaviest[contact.guide]:
            heaviest[contact.guide] = normal
            slip[contact.friction] = _direction(product(W[n + i], v_new), speed)


@kernel
def _direction(velocity, speed):
    """Return the direction of a slip velocity: 0 where it is rounding of the largest speed."""
    if abs(velocity) <= AT_REST * speed:
        return 0
    return 1 if velocity > 0.0 else -1


@kernel
def march(
    m: Arrays, w: Workspace, contacts: Contacts, s: State, task: Task
) -> tuple[int, int, float]:
    """March through the steps; return the outcome, the samples and the time reached.

    A sample holds the state at its instant and the impulses of the step that begins there. Every step writes one; those
    that are not kept are overwritten by the next, so that there must be room for one more.
    """
    written = 0
    for step in range(task.steps + 1):
        motion = s.samples.motion[written]
        copy(s.q, motion[0])
        copy(s.v, motion[1])
        outcome = _step(m, w, contacts, s, task, step * task.dt, written)
        if outcome == SOLVED and not is_finite(s.v_new):
            outcome = NOT_FINITE
        if outcome != SOLVED:
            return outcome, written, step * task.dt
        for k in range(len(s.v)):
            motion[2, k] = (s.v_new[k] - s.v[k]) / task.dt
        copy(s.v_new, s.v)
        s.work.steps += 1
        written += 1 if step % task.every == 0 else 0
    return DONE, written, task.steps * task.dt


def simulate_moreau(
    mechanism: Mechanism,
    q: np.ndarray,
    v: np.ndarray,
    dt: float,
    steps: int,
    every: int,
    clearance: float,
) -> Run:
    """March a mechanism from t = 0 with clearance in its guides.

    `q` and `v` (3 * bodies,): the state there, on the constraints, every slider in the middle of its guide. `dt`: the
    step (s); of `steps` every `every`-th instant is kept. `clearance`: gap (m) between a slider in the middle and each
    surface, of guides that declare none, > 0: opposite corners without any would press each other.

    Columns are as of the other methods; corner forces are impulses over dt, ``drift`` includes the motion within the
    clearance.
    """
    started = clock()
    m, w, contacts = (
        mechanism.arrays,
        workspace(mechanism.arrays),
        contacts_of(mechanism, clearance),
    )
    kept, n, guides = steps // every + 2, len(q), mechanism.scene.guides
    samples = Samples.room(m, kept)
    state = State.zeros(
        q=n,
        v=n,
        v_new=n,
        law_rate=len(contacts.dry),
        work=(),
        samples=samples,
        corners=(kept, len(guides), 4, 2),
    )
    state.q[:], state.v[:] = q, v
    task, prepared = Task(dt, steps, every), clock()
    code, written, reached = march(m, w, contacts, state, task)
    stepped = clock()
    t, motion, corners = (
        np.arange(written) * (every * dt),
        samples.motion[:written],
        state.corners[:written],
    )
    columns = build_columns(
        mechanism,
        t,
        motion[:, 0],
        motion[:, 1],
        motion[:, 2],
        samples.force[:written],
        samples.slip[:written],
    )
    for i, (name, guide) in enumerate(guides.items()):
        if guide.length is not None:
            columns |= {f"{name}.F{k + 1}": corners[:, i, k, 0] for k in range(4)}
        if guide.length is not None and guide.frictional:
            lower, upper = corners[:, i, :2, 1].sum(axis=1), corners[:, i, 2:, 1].sum(axis=1)
            if guide.bounds[1] > 0.0:
                # what is not friction of contacts has the constant bound, of which each surface has half
                constant = 0.5 * (columns[f"{name}.friction"] - lower - upper)
                lower, upper = lower + constant, upper + constant
            columns |= {f"{name}.friction_lower": lower, f"{name}.friction_upper": upper}
    breakdown = (
        None
        if code == DONE
        else Breakdown(BREAKDOWNS[code][0], float(reached), BREAKDOWNS[code][1])
    )
    return Run(
        t,
        columns,
        (),
        Cost(prepared - started, 0.0, stepped - prepared, named(state.work)),
        breakdown,
    )
