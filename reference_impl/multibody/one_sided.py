"""Springs and dampers that act on one side only: end stops, bumpers and cables; compiled.

With the coordinate d of a spring, its rest value d0, stiffness k and damping c, the tension is

    T = k (d - d0) + c d' .

A spring that can only push acts while d < d0, and never pulls: its tension is min(T, 0) there, and 0 elsewhere. One
that can only pull acts while d > d0, with max(T, 0). With the sign s = -1 of a pushing and 1 of a pulling spring,

    depth = s (d - d0),    pressure = s T,    tension = T if depth > 0 and pressure > 0, else 0 .

So it is in one of three states, in each of which its tension is smooth:

    FREE      depth <= 0: there is a gap;
    ACTS      depth > 0 and pressure > 0;
    CLAMPED   depth > 0, and the damper would make it act in the other direction: the bodies part from it.

Without damping FREE and ACTS are the only ones. With damping the tension jumps from 0 to c d' at contact, and is
continuous at all other changes. An integration keeps the state of each spring constant between events
(`Workspace.acting`), so that its right-hand side is smooth; elsewhere positions and velocities tell the state.

Names. Kernels take the mechanism m; k is the number of a spring in `Arrays.one_sided`.
"""

from __future__ import annotations

from math import sqrt

from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.multibody.kinematics import direction_at, point_at
from stiction.reference_impl.multibody.mechanism import ANGLE, AXIS

BY_STATE, FREE, ACTS, CLAMPED = range(4)
"""States of a spring; BY_STATE: that of the positions and velocities of the instant."""
AT_CONTACT = 1e-9
"""Depth, relative to the size of the mechanism, up to which a spring is at its contact: states have some roundings."""
FUNCTIONS = 3
"""Event functions of each spring, as many as each frictional guide has."""


@kernel
def coordinate_of(m, rotation, q, v, k):
    """Return the coordinate of a spring between two points and its geometry.

    Returns
    -------
    d, rate : float
        The coordinate, m, and its rate, m/s.
    ux, uy : float
        Direction of a tension on body b, in ground axes; zero where the points of a spring without an axis meet.
    rax, ray, rbx, rby : float
        Arms of the two points, m; that on b is beside the point of a for a spring with an axis, so that action and
        reaction share a line.
    """
    spring = m.one_sided[k]
    rax, ray, xa, ya, vxa, vya, _, _ = point_at(rotation, q, v, spring.a, spring.ax, spring.ay)
    rbx, rby, xb, yb, vxb, vyb, _, _ = point_at(rotation, q, v, spring.b, spring.bx, spring.by)
    dx, dy, ex, ey = xa - xb, ya - yb, vxa - vxb, vya - vyb
    if spring.kind == AXIS:
        ux, uy, omega = direction_at(rotation, v, spring.b, spring.ux, spring.uy)
        rate = ux * ex + uy * ey + omega * (ux * dy - uy * dx)
        return ux * dx + uy * dy, rate, ux, uy, rax, ray, rbx + dx, rby + dy
    d = sqrt(dx * dx + dy * dy)
    if d == 0.0:
        return 0.0, 0.0, 0.0, 0.0, rax, ray, rbx, rby
    return d, (dx * ex + dy * ey) / d, dx / d, dy / d, rax, ray, rbx, rby


@kernel
def angle_of(m, q, v, k):
    """Return the angle of a torsional spring, rad, and its rate, rad/s."""
    a, b = m.one_sided[k].a, m.one_sided[k].b
    angle, rate = 0.0, 0.0
    if a >= 0:
        angle += q[3 * a + 2]
        rate += v[3 * a + 2]
    if b >= 0:
        angle -= q[3 * b + 2]
        rate -= v[3 * b + 2]
    return angle, rate


@kernel
def measured(m, rotation, q, v, k):
    """Return the coordinate of a spring, m or rad, its rate, and the metres that count for a unit of it.

    An angle counts at the distance `length_scale`.
    """
    if m.one_sided[k].kind == ANGLE:
        angle, rate = angle_of(m, q, v, k)
        return angle, rate, m.length_scale
    d, rate, _, _, _, _, _, _ = coordinate_of(m, rotation, q, v, k)
    return d, rate, 1.0


@kernel
def depth_and_pressure(m, k, d, rate):
    """Return depth (m or rad) and pressure (N or N m) of a spring with the coordinate d."""
    spring = m.one_sided[k]
    stretch = d - spring.rest
    tension = spring.stiffness * stretch + spring.damping * rate
    return spring.sign * stretch, spring.sign * tension


@kernel
def state_of(depth, pressure):
    """Return the state of a spring by its depth and pressure: FREE, ACTS or CLAMPED."""
    if not depth > 0.0:
        return FREE
    return ACTS if pressure > 0.0 else CLAMPED


@kernel
def add_one_sided(m, rotation, q, v, acting, Q):
    """Add the forces of the springs to the generalized forces Q, (3 * bodies,).

    `acting` has the state of each spring, or BY_STATE.
    """
    for k in range(len(m.one_sided)):
        spring = m.one_sided[k]
        a, b = spring.a, spring.b
        if spring.kind == ANGLE:
            angle, rate = angle_of(m, q, v, k)
            depth, pressure = depth_and_pressure(m, k, angle, rate)
            state = state_of(depth, pressure) if acting[k] == BY_STATE else acting[k]
            if state == ACTS:
                torque = -spring.sign * pressure
                if a >= 0:
                    Q[3 * a + 2] += torque
                if b >= 0:
                    Q[3 * b + 2] -= torque
            continue
        d, rate, ux, uy, rax, ray, rbx, rby = coordinate_of(m, rotation, q, v, k)
        depth, pressure = depth_and_pressure(m, k, d, rate)
        state = state_of(depth, pressure) if acting[k] == BY_STATE else acting[k]
        if state == ACTS:
            tension = spring.sign * pressure
            fx, fy = tension * ux, tension * uy
            if a >= 0:
                Q[3 * a] -= fx
                Q[3 * a + 1] -= fy
                Q[3 * a + 2] -= rax * fy - ray * fx
            if b >= 0:
                Q[3 * b] += fx
                Q[3 * b + 1] += fy
                Q[3 * b + 2] += rbx * fy - rby * fx


@kernel
def watch_springs(m, w, q, v):
    """Fill in the event functions of the springs, behind those of the guides; all are >= 0 while their states last.

    Three for each spring: the distance from the end of its stretch, in metres, the pressure, in newton, whose sign
    tells whether it is clamped, and 1. Without damping the pressure has
    the sign of the depth, and is no function of its own.
    """
    for k in range(len(m.one_sided)):
        spring = m.one_sided[k]
        e = FUNCTIONS * (len(m.friction) + k)
        d, rate, unit = measured(m, w.rotation, q, v, k)
        depth, pressure = depth_and_pressure(m, k, d, rate)
        w.event[e] = -depth * unit if w.acting[k] == FREE else depth * unit
        w.event[e + 1], w.event[e + 2] = 1.0, 1.0
        if spring.damping > 0.0 and w.acting[k] != FREE:
            w.event[e + 1] = (pressure if w.acting[k] == ACTS else -pressure) / unit


@kernel
def largest_tension(m, w, q, v):
    """Return the largest term of the tensions of all springs that are not free, N: rounding is a part of it."""
    largest = 0.0
    for k in range(len(m.one_sided)):
        spring = m.one_sided[k]
        if w.acting[k] == FREE:
            continue
        d, rate, unit = measured(m, w.rotation, q, v, k)
        term = max(abs(spring.stiffness * (d - spring.rest)), abs(spring.damping * rate))
        largest = max(largest, term / unit)
    return largest


@kernel
def begin_springs(m, w, q, v):
    """Set the state of each spring by positions and velocities; one that is touched by what comes closer acts."""
    for k in range(len(m.one_sided)):
        d, rate, _ = measured(m, w.rotation, q, v, k)
        depth, pressure = depth_and_pressure(m, k, d, rate)
        w.acting[k] = state_of(depth, pressure)
        if depth == 0.0 and m.one_sided[k].sign * rate > 0.0:
            w.acting[k] = ACTS


@kernel
def next_state(state, function):
    """Return the state of a spring behind the zero of its event function 0 (the depth) or 1 (the pressure)."""
    if function == 1:
        return CLAMPED if state == ACTS else ACTS
    return ACTS if state == FREE else FREE


@kernel
def touch_at_contact(m, w, q, v):
    """Set damped springs that are at the end of their stretch to the other of their two states there.

    The state by position is that of rounding there: a spring that would be free acts, and one that would act is free.
    Returns whether there is one. The rotations of the workspace are those of the state.
    """
    any_touches = False
    for k in range(len(m.one_sided)):
        spring = m.one_sided[k]
        d, rate, unit = measured(m, w.rotation, q, v, k)
        depth, pressure = depth_and_pressure(m, k, d, rate)
        if spring.damping > 0.0 and abs(depth) * unit <= AT_CONTACT * m.length_scale:
            w.acting[k] = FREE if state_of(depth, pressure) == ACTS else ACTS
            any_touches = True
    return any_touches
