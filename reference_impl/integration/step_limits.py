"""How long a step may be for the forces of a mechanism with frictional guides to be resolved, compiled.

The error control of a step knows the motion only. Event functions are made of forces, and these may change fast while
the motion does not tell: a balanced rotor that a motor turns evenly moves linearly in time, without any error, while a
spring on its rim pulls a slider at rest to and fro. A step longer than a few half turns then sees the event functions
at its stages alone, as a stroboscope does. So every step of a mechanism with friction is bounded by how fast its
geometry and its laws change, before it is made (`longest_step`) and, by what happened in it, afterwards (`excess`).

What enters a force, a reaction or an event function, and what bounds the step for it:

==========================================  ============================================================================
sine laws of loads and drives               phase of the law: part of `PHASE`
tables, linear and cubic                    a step ends at each knot (`scenes.laws.law_kinks`); between knots, before
                                            the first and behind the last they are polynomials
constant and linear laws                    nothing: a polynomial of time is resolved by any step
direction of a guide, of an axis of a       turn of the body that carries it: part of `PHASE`
spring or a drive
arm of a point that is not the centre of    turn of the body: part of `PHASE`
mass: of a pin, slider, spring, drive, load
direction of a spring between two points    distance over relative speed: `APPROACH`. There is none where it has neither
with rest length or damping, or of a drive  rest length nor damping: its force is linear in the positions
of their distance
torsional springs and dampers               nothing: linear in angles and rates, which are the motion
spring forces along an axis, dampers        linear in positions and speeds apart from the directions above
centrifugal and Coriolis terms              products of speeds, which are the motion, with the directions above
lever of a slider along its guide           linear in the positions; see the limits
==========================================  ============================================================================

Limits. A force is a product of several such factors, whose phases add. Two for each turning body are counted, as in
the pull along an axis that turns, and the law's; the bodies are counted by the fastest of them, not added up. The
search resolves a sinusoid whose phase advances by 4.5 pi (`event_location`), so that the pull between two rotors,
with twice as many factors, is resolved as well. Where a step comes towards a point, the bound on event functions is
right to 2e-6 of the force of the spring. What changes faster than the motion and all of these, as forces that grow
without bound near a singular position or beside the loss of uniqueness, is resolved only as far as the error of the
motion, the audit of steps and the friction gain (`several_motions`) tell.
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
"""Phase by which the factors of a force may advance within a step, rad: half a period of what they make together."""
FACTORS = 2.0
"""Times that the direction of a body enters a force: once by where a spring's end is or how an arm stands, and once by
the direction in which the force acts."""
APPROACH = 0.5
"""Part of the distance of two points by which they may come nearer within a step where a force acts along their line.
As functions of time, the distance and the direction of points that pass each other evenly are singular at complex
times, as far from now as distance over speed: half of that leaves a polynomial of degree 4 wrong by 3e-4 at most."""
NEAREST = 1e-9
"""Part of the mechanism's size below which a distance is not told from zero, so that steps towards an anchor do not
shrink for ever: what happens while points are so near lasts for a nanosecond at a metre per second and metre."""
TOLERATED = 1.5
"""Times the limits that a step may have reached when it is looked at behind it: accelerations change within a step, and
the limits have a margin of three."""


@kernel
def longest_step(m: Arrays, s: State, frequency: float) -> float:
    """Length of the longest step from the state of a mechanism with friction, s, by rates and accelerations there.

    frequency : of the fastest sine law, rad/s.
    """
    n, y, dy = len(m.inverse_mass), s.y, s.K[0]

    # the fastest angular velocity and acceleration of bodies whose angles enter forces; a comparison in place of max,
    # which may take a nan for the largest
    velocity, acceleration = 0.0, 0.0
    for i in range(len(m.turning)):
        k = n + 3 * m.turning[i] + 2
        velocity = abs(y[k]) if abs(y[k]) > velocity else velocity
        acceleration = abs(dy[k]) if abs(dy[k]) > acceleration else acceleration

    # the phases of the factors of a force add to rate h + change h^2
    rate, change = frequency + FACTORS * velocity, 0.5 * FACTORS * acceleration
    h = _time_for(PHASE, rate, change)

    # points that come near each other turn the line along which their force acts
    for i in range(len(m.line)):
        h = min(h, _time_to_pass(m, i, y, dy))
    return h


@kernel
def excess(m: Arrays, s: State, frequency: float) -> float:
    """How far a step that has been made exceeds what it may be: the largest of ratios to its limits.

    Angular velocities are those of the stages; points are looked at where the step ends.
    """
    n, h = len(m.inverse_mass), s.attempt.h
    largest = 0.0

    # the phase, by the fastest angular velocity at a stage
    velocity = 0.0
    for i in range(len(m.turning)):
        angle = 3 * m.turning[i] + 2
        for stage in range(STAGES + 1):
            velocity = max(velocity, abs(s.K[stage, angle]))
    if len(m.turning):
        largest = (frequency + FACTORS * velocity) * h / PHASE

    # the approach of points, unless they move along their line, which then does not turn
    for i in range(len(m.line)):
        dx, dy, ex, ey, _, _ = _between(m, i, s.y_new, s.K[STAGES], n)
        distance, speed = sqrt(dx * dx + dy * dy), sqrt(ex * ex + ey * ey)
        nearest = NEAREST * m.length_scale
        if abs(dx * ey - dy * ex) > nearest * speed:
            largest = max(largest, h * speed / max(distance, nearest))
    return largest


@kernel
def _time_for(way, speed, acceleration):
    """Time t in which a way is gone: way = speed t + acceleration t^2; infinite at rest.

    Solved for 1/t, so that nothing cancels and no acceleration is divided by.
    """
    root = speed + sqrt(speed * speed + 4.0 * acceleration * way)
    return 2.0 * way / root if root > 0.0 else np.inf


@kernel
def _time_to_pass(m: Arrays, i: int, y: Reals, dy: Reals) -> float:
    """Length of a step in which two points with a force along their line come nearer by a part of their distance, s.

    Points that move along their line do not turn it. There is no limit then, unless they may pass each other where the
    force has another direction behind: a step does not reach that instant.
    """
    # vector between the points (dx, dy_), its rate (ex, ey) and its second derivative (cx, cy)
    dx, dy_, ex, ey, cx, cy = _between(m, i, y, dy, len(m.inverse_mass))
    nearest = NEAREST * m.length_scale
    distance = sqrt(dx * dx + dy_ * dy_)
    speed = sqrt(ex * ex + ey * ey)
    acceleration = sqrt(cx * cx + cy * cy)

    # The points pass each other beside their line: cross products give the distance at which they do. The speed counts
    # in any direction, as points that go away came from a singular instant that is as near.
    turns = (
        abs(dx * ey - dy_ * ex) > nearest * speed
        or abs(dx * cy - dy_ * cx) > nearest * acceleration
    )
    if turns:
        return _time_for(APPROACH * max(distance, nearest), speed, 0.5 * acceleration)

    # they move along their line: the step ends before they meet, if the force turns round there
    if m.line[i].flips == 0 or distance == 0.0:
        return np.inf
    closing = -(dx * ex + dy_ * ey) / distance
    inward = -(dx * cx + dy_ * cy) / distance
    return _time_for(max(distance, nearest), max(closing, 0.0), 0.5 * max(inward, 0.0))


@kernel
def _between(m, i, y, dy, n):
    """Vector from the point on b of a line to that on a, its rate and its acceleration, in ground axes."""
    line = m.line[i]
    ax, ay, avx, avy, acx, acy = _point(y, dy, n, line.a, line.ax, line.ay)
    bx, by, bvx, bvy, bcx, bcy = _point(y, dy, n, line.b, line.bx, line.by)
    return ax - bx, ay - by, avx - bvx, avy - bvy, acx - bcx, acy - bcy


@kernel
def _point(y, dy, n, body, px, py):
    """Position, velocity and acceleration of a point of a body, or of the ground (-1)."""
    if body < 0:
        return px, py, 0.0, 0.0, 0.0, 0.0
    k = 3 * body
    c, s = cos(y[k + 2]), sin(y[k + 2])
    omega, alpha = y[n + k + 2], dy[n + k + 2]  # angular velocity and acceleration
    rx, ry = c * px - s * py, s * px + c * py  # arm of the point, in ground axes
    return (
        y[k] + rx,
        y[k + 1] + ry,
        y[n + k] - omega * ry,
        y[n + k + 1] + omega * rx,
        dy[n + k] - alpha * ry - omega * omega * rx,
        dy[n + k + 1] + alpha * rx - omega * omega * ry,
    )
