"""Laws of time, constraints Phi, their rows J, and gamma of Phi'' = J q'' + gamma, compiled."""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np

from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.multibody.mechanism import (
    ANGLE,
    AXIS,
    DISTANCE,
    LAW_PIECES,
    LAW_POLYNOMIAL,
    LAW_SINE,
    LAW_SPLINE,
    LAW_SUM,
    NO_ROW,
    PIECE_AMPLITUDE,
    PIECE_BEGIN,
    PIECE_COEFFICIENTS,
    PIECE_FREQUENCY,
    PIECE_ORIGIN,
    REVOLUTE,
    Arrays,
)


@kernel
def law_at(m: Arrays, i: int, t: float) -> tuple[float, float, float]:
    """Return value, rate and second derivative of law i at time t.

    The compiled twin of `stiction.scenes.laws.evaluate_law`.
    """
    if m.law[i].kind != LAW_SUM:
        return _term_at(m, i, t)
    value, rate, second_rate = 0.0, 0.0, 0.0
    for term in range(int(m.law[i].first), int(m.law[i].second)):
        own_value, own_rate, own_second_rate = _term_at(m, term, t)
        value += own_value
        rate += own_rate
        second_rate += own_second_rate
    return value, rate, second_rate


@kernel
def _term_at(m, i, t):
    """Return value, rate and second derivative at time t of a law that is no sum."""
    law, knots = m.law[i], m.knots
    kind, a, b = law.kind, law.first, law.second
    if kind == LAW_POLYNOMIAL:
        return a + b * t, b, 0.0
    if kind == LAW_SINE:
        frequency, phase = law.frequency, law.phase
        s, c = sin(frequency * t + phase), cos(frequency * t + phase)
        return a + b * s, b * frequency * c, -b * frequency * frequency * s
    first, last = int(a), int(b) - 1
    if kind == LAW_PIECES:
        while m.piece[last, PIECE_BEGIN] > t:
            last -= 1
        return _piece_at(m.piece[last], t)
    cubic = kind == LAW_SPLINE
    if t < knots[first, 0] or t >= knots[last, 0]:
        outer = first if t < knots[first, 0] else last
        inner = first + 1 if t < knots[first, 0] else last - 1
        if not cubic:
            return knots[outer, 1], 0.0, 0.0
        h = knots[inner, 0] - knots[outer, 0]
        rate = (knots[inner, 1] - knots[outer, 1]) / h - h / 6.0 * (
            2.0 * knots[outer, 2] + knots[inner, 2]
        )
        return knots[outer, 1] + rate * (t - knots[outer, 0]), rate, 0.0
    i, after = first, last
    while after - i > 1:
        middle = (i + after) // 2
        i, after = (middle, after) if knots[middle, 0] <= t else (i, middle)
    h = knots[after, 0] - knots[i, 0]
    u, w = t - knots[i, 0], knots[after, 0] - t
    a, b = knots[i, 2], knots[after, 2]
    slope = (knots[after, 1] - knots[i, 1]) / h
    value = (
        (a * w**3 + b * u**3) / (6.0 * h)
        + (knots[i, 1] / h - a * h / 6.0) * w
        + (knots[after, 1] / h - b * h / 6.0) * u
    )
    return (
        value,
        (b * u * u - a * w * w) / (2.0 * h) + slope - h / 6.0 * (b - a),
        (a * w + b * u) / h,
    )


@kernel
def _piece_at(piece, t):
    """Return value, rate and second derivative of a piece of a move at time t, by Horner's rule."""
    u = t - piece[PIECE_ORIGIN]
    value, rate, half_second_rate = 0.0, 0.0, 0.0
    for k in range(len(piece) - 1, PIECE_COEFFICIENTS - 1, -1):
        half_second_rate = half_second_rate * u + rate
        rate = rate * u + value
        value = value * u + piece[k]
    amplitude, frequency = piece[PIECE_AMPLITUDE], piece[PIECE_FREQUENCY]
    if amplitude != 0.0:
        sine, cosine = amplitude * sin(frequency * u), amplitude * cos(frequency * u)
        value += sine
        rate += frequency * cosine
        half_second_rate -= 0.5 * frequency * frequency * sine
    return value, rate, 2.0 * half_second_rate


@kernel
def point_at(rotation, q, v, body, px, py):
    """Return the arm of a point (px, py) from the centre of mass, and its motion.

    The motion is its position, its velocity, and -omega^2 times the arm.
    """
    if body < 0:
        return 0.0, 0.0, px, py, 0.0, 0.0, 0.0, 0.0
    c, s = rotation[body, 0], rotation[body, 1]
    rx, ry = c * px - s * py, s * px + c * py
    i = 3 * body
    w = v[i + 2]
    return (
        rx,
        ry,
        q[i] + rx,
        q[i + 1] + ry,
        v[i] - w * ry,
        v[i + 1] + w * rx,
        -w * w * rx,
        -w * w * ry,
    )


@kernel
def rotate(m, w, q):
    """Set cosine and sine of the angle of each body."""
    for i in range(len(w.rotation)):
        w.rotation[i, 0], w.rotation[i, 1] = cos(q[3 * i + 2]), sin(q[3 * i + 2])


@kernel
def direction_at(rotation, v, body, ux, uy):
    """Return a direction of a body in ground axes, and the body's angular velocity."""
    if body < 0:
        return ux, uy, 0.0
    c, s = rotation[body, 0], rotation[body, 1]
    return c * ux - s * uy, s * ux + c * uy, v[3 * body + 2]


@kernel
def row_along(J, row, ux, uy, arms, dx, dy):
    """Return the row of the coordinate u . d, d from the point on b to that on a, u fixed in b.

    arms = (rax, ray, rbx, rby). With u' = omega_b (k x u): d(u.d)/d theta_b = (k x u).d - u.(k x r_b).
    """
    rax, ray, rbx, rby = arms
    i = 6 * row
    J[i], J[i + 1], J[i + 2] = ux, uy, uy * rax - ux * ray
    J[i + 3], J[i + 4], J[i + 5] = -ux, -uy, -(uy * rbx - ux * rby) + (ux * dy - uy * dx)


@kernel(inline=True)
def constraints_at(m, w, t, q, v):
    """Fill rotation, J, phi, phi_dot, gamma and slip_speed of the workspace at (t, q, v): eqs. (8), (18)-(20).

    A drive with a limit has a tangential row in place of its constraint: its slip is the rate of its coordinate minus
    that of its law, so that gamma has the law's acceleration.

    gamma of u . d with u fixed in body b: u.(c_a - c_b) + 2 omega (k x u).d' - omega^2 u.d, where c are the
    centripetal accelerations of the points; of the distance |d| with e = d/|d|:
    e.(c_a - c_b) + (|d'|^2 - (e.d')^2)/|d|; nan where it is driven to zero or below, which no distance is.
    """
    rotate(m, w, q)
    for k in range(len(m.constraint)):
        constraint = m.constraint[k]
        kind, r, a, b = constraint.kind, constraint.row, constraint.a, constraint.b
        if kind == ANGLE:
            s, s1, s2 = law_at(m, constraint.law, t)
            qa, va = (q[3 * a + 2], v[3 * a + 2]) if a >= 0 else (0.0, 0.0)
            qb, vb = (q[3 * b + 2], v[3 * b + 2]) if b >= 0 else (0.0, 0.0)
            if r == NO_ROW:
                f, radius = constraint.friction, m.length_scale
                z = 6 * (m.rows + f)
                w.J[z + 2], w.J[z + 5] = radius, -radius
                w.slip_speed[f] = radius * (va - vb - s1)
                w.gamma[m.rows + f] = -radius * s2
                continue
            w.J[6 * r + 2], w.J[6 * r + 5] = 1.0, -1.0
            w.phi[r], w.phi_dot[r], w.gamma[r] = qa - qb - s, va - vb - s1, -s2
            continue
        rax, ray, xa, ya, vxa, vya, cxa, cya = point_at(
            w.rotation, q, v, a, constraint.ax, constraint.ay
        )
        rbx, rby, xb, yb, vxb, vyb, cxb, cyb = point_at(
            w.rotation, q, v, b, constraint.bx, constraint.by
        )
        dx, dy, ex, ey, cx, cy = xa - xb, ya - yb, vxa - vxb, vya - vyb, cxa - cxb, cya - cyb
        if kind == REVOLUTE:
            x, y = 6 * r, 6 * r + 6
            w.J[x], w.J[x + 2], w.J[x + 3], w.J[x + 5] = 1.0, -ray, -1.0, rby
            w.J[y + 1], w.J[y + 2], w.J[y + 4], w.J[y + 5] = 1.0, rax, -1.0, -rbx
            w.phi[r], w.phi_dot[r], w.gamma[r] = dx, ex, cx
            w.phi[r + 1], w.phi_dot[r + 1], w.gamma[r + 1] = dy, ey, cy
            f = constraint.friction
            if f >= 0:
                # relative rotation as slip at the distance `length_scale`; it has no centripetal part
                radius, z = m.length_scale, 6 * (m.rows + f)
                w.J[z + 2], w.J[z + 5] = radius, -radius
                omega_a = v[3 * a + 2] if a >= 0 else 0.0
                omega_b = v[3 * b + 2] if b >= 0 else 0.0
                w.slip_speed[f] = radius * (omega_a - omega_b)
                w.gamma[m.rows + f] = 0.0
            continue
        arms = (rax, ray, rbx, rby)
        if kind == DISTANCE:
            s, s1, s2 = law_at(m, constraint.law, t)
            d = sqrt(dx * dx + dy * dy)
            ux, uy = dx / d, dy / d
            rate = ux * ex + uy * ey
            remainder = ux * cx + uy * cy + (ex * ex + ey * ey - rate * rate) / d - s2
            if r == NO_ROW:
                f = constraint.friction
                row_along(w.J, m.rows + f, ux, uy, arms, dx, dy)
                w.slip_speed[f] = rate - s1
                w.gamma[m.rows + f] = remainder
                continue
            row_along(w.J, r, ux, uy, arms, dx, dy)
            w.phi[r], w.phi_dot[r] = d - s, rate - s1
            w.gamma[r] = remainder if s > 0.0 else np.nan
            continue
        ux, uy, omega = direction_at(w.rotation, v, b, constraint.ux, constraint.uy)
        along, across = ux * dx + uy * dy, ux * dy - uy * dx
        along_rate = ux * ex + uy * ey + omega * across
        along_gamma = ux * cx + uy * cy + 2.0 * omega * (ux * ey - uy * ex) - omega * omega * along
        if kind == AXIS:
            s, s1, s2 = law_at(m, constraint.law, t)
            if r == NO_ROW:
                f = constraint.friction
                row_along(w.J, m.rows + f, ux, uy, arms, dx, dy)
                w.slip_speed[f] = along_rate - s1
                w.gamma[m.rows + f] = along_gamma - s2
                continue
            row_along(w.J, r, ux, uy, arms, dx, dy)
            w.phi[r], w.phi_dot[r], w.gamma[r] = along - s, along_rate - s1, along_gamma - s2
            continue
        row_along(w.J, r, -uy, ux, arms, dx, dy)
        w.phi[r], w.phi_dot[r] = across, ux * ey - uy * ex - omega * along
        w.gamma[r] = ux * cy - uy * cx - 2.0 * omega * (ux * ex + uy * ey) - omega * omega * across
        w.J[6 * r + 8], w.J[6 * r + 11] = 1.0, -1.0
        qb = q[3 * b + 2] if b >= 0 else 0.0
        w.phi[r + 1], w.gamma[r + 1] = q[3 * a + 2] - qb - constraint.offset, 0.0
        w.phi_dot[r + 1] = v[3 * a + 2] - omega
        f = constraint.friction
        if f >= 0:
            row_along(w.J, m.rows + f, ux, uy, arms, dx, dy)
            w.slip_speed[f] = along_rate
            w.gamma[m.rows + f] = along_gamma
