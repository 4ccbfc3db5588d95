"""Bounds on the step by which the forces of a mechanism with frictional guides are resolved.

The error control of a step knows the motion only. Event functions are made of forces, which may
change fast while the motion does not show it. For example, a balanced rotor that a motor turns
evenly moves linearly in time, without any error, while a spring on its rim pulls a slider at rest
to and fro. A step longer than a few half turns then samples the event functions at its stages as a
stroboscope would. So every step of a mechanism with friction is bounded by how fast its geometry
and its laws change: `longest_step` bounds it before it is made, and `limit_ratio` checks it
afterwards.

What enters a force, a reaction or an event function, and what bounds the step for it:

===========================  ======================================================================
sine laws of loads and       phase of the law: part of `PHASE`
drives
tables, linear and cubic     a step ends at each knot (`scenes.laws.law_kinks`); elsewhere, before
                             the first and after the last as well, they are polynomials of time
constant and linear laws     nothing: a polynomial of time is resolved by any step
direction of a guide, of an  turn of the body that carries it: part of `PHASE`
axis of a spring or a drive
arm of a point that is not   turn of the body: part of `PHASE`
the centre of mass: of a
pin, slider, spring, drive
or load
direction of a spring        distance over relative speed: `APPROACH`; nothing for a spring with
between two points, or of a  neither rest length nor damping: its force is linear in the positions
drive of their distance
torsional springs and        nothing: linear in angles and rates, which are the motion
dampers
spring forces along an       linear in positions and speeds apart from the directions above
axis, dampers
centrifugal and Coriolis     products of speeds, which are the motion, with the directions above
terms
lever of a slider along its  linear in the positions; see the limits
guide
Stribeck's curve             change of the slip speed: `CURVE`, by `curve_ratio`
===========================  ======================================================================

Limits. A force is a product of several such factors, and their phases add. The bounds count the
phase of the law and twice that of the fastest body, as in the pull along an axis that turns; they
do not add up bodies. The search resolves a sinusoid whose phase advances by 4.5 pi
(`event_location`). The pull between two rotors has twice as many factors, and is resolved as well.
Where a step comes towards a point, the bound on event functions is right to 2e-6 of the force of
the spring.

Some forces change faster than the motion and all of these, as those that grow without bound near a
singular position or near the loss of uniqueness. They are resolved only as far as the error of the
motion, the audit of steps and the friction gain (`several_motions`) show.
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np

from stiction.reference_impl.compiled.bundle import Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.integration.dop853 import STAGES
from stiction.reference_impl.integration.integration_state import State
from stiction.reference_impl.multibody.mechanism import Arrays

PHASE = np.pi
"""Phase by which the factors of a force may advance within a step, rad: half a period of their
product."""
FACTORS = 2.0
"""Number of times that the direction of a body enters a force.

It enters once by the place of a spring's end or the direction of an arm, and once by the direction
in which the force acts."""
APPROACH = 0.5
"""Part of their distance by which two points may come nearer within a step, where a force acts
along their line.

As functions of time, the distance and the direction of points that pass each other evenly are
singular at complex times, as far from now as distance over speed. Half of that leaves a polynomial
of degree 4 wrong by 3e-4 at most."""
CURVE = 0.5
"""Change of the slip speed within a step, relative to the Stribeck velocity plus the lowest speed in the step.

Friction decays like an exponential of that relative speed x. A step changes x by half of itself from afar, so that a
joint that slows down comes to x = 1 in few steps, of which each sees how much more of the excess returns. Near rest it
changes x by one half, over which a polynomial of degree 8 can be as near to exp(-x) as 4e-14, and one of degree 4, as
that of the stages, as near as 5e-7: 2 (1/8)^(n + 1) / (n + 1)!."""
NEAREST = 1e-9
"""Part of the mechanism's size below which a distance is not told from zero.

Otherwise steps towards an anchor would shrink without end. At a metre per second and a mechanism of
a metre, points are so near for a nanosecond."""
TOLERATED = 1.5
"""Ratio to its limits up to which a step that has been made is accepted.

Accelerations change within a step, and the limits have a margin of three."""


@kernel
def longest_step(m: Arrays, s: State, frequency: float) -> float:
    """Return the length of the longest step from a state, s, by its rates and accelerations.

    Parameters
    ----------
    m : Arrays
        A mechanism with frictional guides.
    s : State
        State of the run: y has positions and velocities, the first row of K their derivatives.
    frequency : float
        Angular frequency of the fastest sine law, rad/s; 0 without any.
    """
    n = len(m.inverse_mass)
    y = s.y
    y_dot = s.K[0]

    # the fastest angular velocity and acceleration of bodies whose angles enter forces
    velocity = 0.0
    acceleration = 0.0
    for i in range(len(m.turning)):
        k = n + 3 * m.turning[i] + 2
        velocity = _larger_size(velocity, y[k])
        acceleration = _larger_size(acceleration, y_dot[k])

    # in a time h the phases of the factors of a force advance by rate h + change h^2 / 2
    rate = frequency + FACTORS * velocity
    change = FACTORS * acceleration
    h = _time_to_cover(PHASE, rate, change)

    # points that come near each other turn the line along which their force acts
    for i in range(len(m.line)):
        h = min(h, _time_to_pass(m, i, y, y_dot))
    return h


@kernel
def limit_ratio(m: Arrays, s: State, frequency: float) -> float:
    """Return the largest of the ratios of a step that has been made to its limits.

    Angular velocities are taken at the stages of the step, and points where it ends. The parameters
    are those of `longest_step`.
    """
    n = len(m.inverse_mass)
    h = s.attempt.h

    # the phase, by the fastest angular velocity at a stage
    velocity = 0.0
    for i in range(len(m.turning)):
        angle = 3 * m.turning[i] + 2
        for stage in range(STAGES + 1):
            velocity = _larger_size(velocity, s.K[stage, angle])
    largest = (frequency + FACTORS * velocity) * h / PHASE

    # the approach of points, unless they move along their line, which then does not turn
    nearest = NEAREST * m.length_scale
    for i in range(len(m.line)):
        rx, ry, vx, vy, _, _ = _relative_motion(m, i, s.y_new, s.K[STAGES], n)
        distance = sqrt(rx * rx + ry * ry)
        speed = sqrt(vx * vx + vy * vy)
        if abs(rx * vy - ry * vx) > nearest * speed:
            largest = max(largest, h * speed / max(distance, nearest))
    return largest


@kernel
def curve_ratio(m: Arrays, s: State) -> float:
    """Return the largest of the ratios of a step that has been made to `CURVE`, over the joints that slip.

    The first event function of a joint that slips is its speed: at the start of the step and at its stages.
    """
    largest = 0.0
    for f in range(len(m.friction)):
        if m.friction[f].stribeck == 0.0 or s.slip[f] == 0:
            continue
        low, high = s.at_start[3 * f], s.at_start[3 * f]
        for stage in range(STAGES):
            low = min(low, s.at_stages[stage, 3 * f])
            high = max(high, s.at_stages[stage, 3 * f])
        scale = m.friction[f].stribeck + max(low, 0.0)
        largest = max(largest, (high - low) / (CURVE * scale))
    return largest


@kernel
def _larger_size(largest, value):
    """Return the larger of a size and that of a value, which does not count if it is NaN.

    `max` may take a NaN for the largest.
    """
    size = abs(value)
    return size if size > largest else largest


@kernel
def _time_to_cover(distance, speed, acceleration):
    """Return the time t in which distance = speed t + acceleration t^2 / 2; infinite at rest.

    Speed and acceleration are not negative. The equation is solved for 1/t, so that nothing cancels
    and no acceleration is divided by.
    """
    divisor = speed + sqrt(speed * speed + 2.0 * acceleration * distance)
    return 2.0 * distance / divisor if divisor > 0.0 else np.inf


@kernel
def _time_to_pass(m: Arrays, i: int, y: Reals, y_dot: Reals) -> float:
    """Return the time in which the points of line i come nearer by APPROACH of their distance, s.

    Points that move along their line do not turn it. Then there is no limit, unless the points may
    pass each other and their force has another direction afterwards: a step does not reach that
    instant.
    """
    rx, ry, vx, vy, ax, ay = _relative_motion(m, i, y, y_dot, len(m.inverse_mass))
    nearest = NEAREST * m.length_scale
    distance = sqrt(rx * rx + ry * ry)
    speed = sqrt(vx * vx + vy * vy)
    acceleration = sqrt(ax * ax + ay * ay)

    # The points pass each other beside their line: cross products give the distance at which they
    # do. The speed counts in any direction, as points that go away came from a singular instant
    # that is as near.
    turns = (
        abs(rx * vy - ry * vx) > nearest * speed or abs(rx * ay - ry * ax) > nearest * acceleration
    )
    if turns:
        return _time_to_cover(APPROACH * max(distance, nearest), speed, acceleration)

    # they move along their line: the step ends before they meet, if the force turns round there
    if m.line[i].flips == 0 or distance == 0.0:
        return np.inf
    closing_speed = -(rx * vx + ry * vy) / distance
    closing_acceleration = -(rx * ax + ry * ay) / distance
    return _time_to_cover(
        max(distance, nearest), max(closing_speed, 0.0), max(closing_acceleration, 0.0)
    )


@kernel
def _relative_motion(m, i, y, y_dot, n):
    """Return the vector from the point on b of line i to that on a, its rate and its acceleration.

    All are in ground axes, as rx, ry, vx, vy, ax, ay; n is the number of coordinates.
    """
    line = m.line[i]
    rx_a, ry_a, vx_a, vy_a, ax_a, ay_a = _motion_of_point(y, y_dot, n, line.a, line.ax, line.ay)
    rx_b, ry_b, vx_b, vy_b, ax_b, ay_b = _motion_of_point(y, y_dot, n, line.b, line.bx, line.by)
    return rx_a - rx_b, ry_a - ry_b, vx_a - vx_b, vy_a - vy_b, ax_a - ax_b, ay_a - ay_b


@kernel
def _motion_of_point(y, y_dot, n, body, px, py):
    """Return position, velocity and acceleration of a point of a body, or of the ground (-1)."""
    if body < 0:
        return px, py, 0.0, 0.0, 0.0, 0.0
    k = 3 * body
    c = cos(y[k + 2])
    s = sin(y[k + 2])
    omega = y[n + k + 2]  # angular velocity
    alpha = y_dot[n + k + 2]  # angular acceleration
    arm_x = c * px - s * py  # from the centre of mass to the point, in ground axes
    arm_y = s * px + c * py
    return (
        y[k] + arm_x,
        y[k + 1] + arm_y,
        y[n + k] - omega * arm_y,
        y[n + k + 1] + omega * arm_x,
        y_dot[n + k] - alpha * arm_y - omega * omega * arm_x,
        y_dot[n + k + 1] + alpha * arm_x - omega * omega * arm_y,
    )
