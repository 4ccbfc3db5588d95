"""Block on an incline: rest or an exact parabola.

With d the direction of the guide, n its normal, G = m (g.d) and R = -m (g.n): x'' = (G - mu N sgn x')/m along the
guide; at rest it stays where |G| <= mus N, else it starts along sgn G. On a guide at angle beta to gravity's
horizontal this is: it sticks where tan(beta) <= mus, and slides with g (sin beta - mu cos beta).
"""

from __future__ import annotations

import numpy as np

from stiction.comparisons.truth.closed_form.truth_of_formulas import EPS, truth_of_formulas
from stiction.comparisons.truth.reduced.slider_contact import Contact
from stiction.comparisons.truth.structure import CENTRE, Condition, Part, Structure
from stiction.comparisons.truth.truth import Truth
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Translational

INCLINE = Structure("a block on an incline", ("block",), {
    "guide": Part(Translational, "block", GROUND, slider_point=CENTRE, frictional=True),
}, gravity=Condition("a vector", lambda gravity: gravity is not None), any_names=True)


def incline_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """The motion of a block that nothing but gravity and a straight fixed guide with friction acts on.

    Raises
    ------
    NotThisMechanism
        If the scene has another structure.
    NoMotion
        Where a self-locking guide can slip or jam.
    """
    found = INCLINE.match(scene)
    name, guide, body_name = found.name("guide"), found["guide"], found.bodies["block"]
    body = scene.bodies[body_name]
    t_end = scene.t_end if t_end is None else t_end
    direction = np.array(guide.direction) / np.hypot(*guide.direction)
    across = np.array([-direction[1], direction[0]])
    gravity, contact = np.array(scene.gravity), Contact.of(guide)
    pull, R = body.mass * gravity @ direction, -body.mass * gravity @ across

    def capacity(coefficient: float) -> float:
        return float(contact.capacity(R, 0.0, coefficient))

    def phase(start: float, x: float, v: float) -> tuple[float, float, float, float, int]:
        slip = int(np.sign(v)) or (int(np.sign(pull)) if abs(pull) > capacity(contact.mus) else 0)
        if v == 0 and slip:
            contact.require_unique_slip(start)
        a = (pull - slip * capacity(contact.mu)) / body.mass if slip else 0.0
        return start, x, v, a, slip

    position = np.array(body.position) - np.array(guide.point)
    motion = [phase(0.0, float(position @ direction), float(np.array(body.velocity) @ direction))]
    start, x, v, a, _ = motion[0]
    if v * a < 0:
        stop = -v / a
        motion.append(phase(stop, x - v * v / (2 * a), 0.0))

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        owner = np.searchsorted([p[0] for p in motion[1:]], t, side="right" if side == "after" else "left")
        start, x0, v0, a, slip = (np.array(column)[owner] for column in zip(*motion))
        since = t - start
        s, v = x0 + v0 * since + a * since ** 2 / 2, v0 + a * since
        friction = np.where(slip != 0, -slip * capacity(contact.mu), -pull)
        phi = contact.mobilization(R, 0.0, friction)
        joint = contact.columns(name, np.full(len(t), R), np.zeros(len(t)), phi, slip.astype(float), displacement=s,
                                slip_velocity=v)
        offset = np.array(guide.point) + (position @ across) * across
        values = {f"{body_name}.{c}": offset[i] + direction[i] * s for i, c in enumerate("xy")}
        values |= {f"{body_name}.v{c}": direction[i] * v for i, c in enumerate("xy")}
        values |= {f"{body_name}.a{c}": direction[i] * a for i, c in enumerate("xy")}
        return values | joint

    switches = [(time, "reversal" if slip else "stick", name) for time, *_, slip in motion[1:] if time < t_end]
    return truth_of_formulas(scene, t_end, columns, 8 * EPS, 200, switches)
