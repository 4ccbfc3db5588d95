"""Block on an incline, whose motion is rest or an exact parabola.

With d the direction of the guide, n its normal, G = m (g.d) and R = -m (g.n), the block obeys
x'' = (G - mu N sgn x')/m along the guide. A block at rest stays there if |G| <= mus N, and otherwise starts along
sgn G. On a guide at the angle beta to the horizontal, it sticks if tan(beta) <= mus, and slides with
g (sin beta - mu cos beta).

A constant bound of friction F adds to mu N, and F_s to mus N. On a vertical guide N = 0: the block stays at rest if
m g <= F_s, and otherwise sinks with the acceleration g - F/m.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Translational
from stiction.truths.reduced.slider_contact import Contact
from stiction.truths.structure import ANY, CENTRE, Condition, Part, Structure
from stiction.truths.truth import EPS, Truth, body_columns

INCLINE = Structure(
    "a block on an incline",
    ("block",),
    {
        "guide": Part(
            Translational,
            "block",
            GROUND,
            slider_point=CENTRE,
            frictional=True,
            friction=ANY,
            static_friction=ANY,
        ),
    },
    gravity=Condition("a vector", lambda gravity: gravity is not None),
    any_names=True,
)


_ROUNDING = 8 * EPS
"""Relative rounding of the columns: a parabola takes some eight operations."""
_SAMPLES = 200
"""Number of instants at which the magnitude of columns is taken; it scales the rounding, and need not be exact."""


class _Phase(NamedTuple):
    """A phase of constant acceleration along the guide.

    Attributes
    ----------
    start, x, v : float
        Time (s), position (m) and velocity (m/s) at the start.
    a : float
        Acceleration, m/s^2.
    slip : int
        Direction of slip, 0 at rest.
    """

    start: float
    x: float
    v: float
    a: float
    slip: int


def incline_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the motion of a block on a straight fixed guide with friction, under gravity alone."""
    match = INCLINE.match(scene)
    name, guide = match.name("guide"), match["guide"]
    block = match.bodies["block"]
    body = scene.bodies[block]
    contact = Contact.of(guide)
    t_end = scene.t_end if t_end is None else t_end
    direction = np.array(guide.direction) / np.hypot(*guide.direction)
    across = np.array([-direction[1], direction[0]])
    gravity = np.array(scene.gravity)
    pull = body.mass * gravity @ direction
    R = -body.mass * gravity @ across

    has_bound = guide.friction is not None
    if has_bound and guide.length is not None:
        raise INCLINE.misfit(
            scene, f"{name}: expected no length beside a constant bound of friction"
        )
    bound, static_bound = guide.bounds
    kinetic_friction = bound + float(contact.capacity(R, 0.0, contact.mu))
    static_friction = static_bound + float(contact.capacity(R, 0.0, contact.mus))

    def begin_phase(start: float, x: float, v: float) -> _Phase:
        """Return the phase that begins in a state."""
        # From rest the block starts along the pull if static friction does not suffice.
        slip = int(np.sign(v))
        if slip == 0 and abs(pull) > static_friction:
            slip = int(np.sign(pull))
        if v == 0 and slip:
            contact.require_unique_slip(start)
        a = (pull - slip * kinetic_friction) / body.mass if slip else 0.0
        return _Phase(start, x, v, a, slip)

    # All forces are constant, so that there are two phases at most: a block that is decelerated stops
    # once, and then rests or slides back for good.
    position = np.array(body.position) - np.array(guide.point)
    speed_at_start = float(np.array(body.velocity) @ direction)
    first = begin_phase(0.0, float(position @ direction), speed_at_start)
    motion = [first]
    if first.v * first.a < 0:
        stop = first.x - first.v * first.v / (2 * first.a)
        motion.append(begin_phase(-first.v / first.a, stop, 0.0))

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        owner = np.searchsorted(
            [later.start for later in motion[1:]], t, side="right" if side == "after" else "left"
        )
        start, x, speed, a, slip = (np.array(column)[owner] for column in zip(*motion))
        since = t - start
        s = x + speed * since + a * since**2 / 2
        v = speed + a * since
        # Friction follows from Coulomb's law in slip, and from equilibrium at rest.
        friction = np.where(slip != 0, -slip * kinetic_friction, -pull)
        # A guide with a constant bound has no length, and no friction of its surfaces that phi would
        # divide.
        phi = 0.0 * t if has_bound else contact.mobilization(R, 0.0, friction)
        offset = np.array(guide.point) + (position @ across) * across
        d = direction[:, None]
        values = body_columns(block, offset[:, None] + d * s, d * v, d * a) | contact.columns(
            name,
            np.full(len(t), R),
            np.zeros(len(t)),
            phi,
            slip.astype(float),
            displacement=s,
            slip_velocity=v,
        )
        if has_bound:
            values[f"{name}.friction"] = friction
        return values

    switches = [
        (later.start, "reversal" if later.slip else "stick", name)
        for later in motion[1:]
        if later.start < t_end
    ]
    return Truth.of_formulas(scene, t_end, columns, _ROUNDING, _SAMPLES, switches)
