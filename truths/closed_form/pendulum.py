"""Pendulum equation psi'' = -w^2 sin psi in closed form: Jacobi's elliptic functions.

With k^2 = sin^2(psi0/2) + (psi0'/(2 w))^2:

- k < 1, swinging:   sin(psi/2) = k sn(w t + u0, k^2),   psi' = 2 w k cn(w t + u0, k^2);
- k > 1, rotating:   psi/2 = d am(k w t + u0, 1/k^2),    psi' = 2 d w k dn(k w t + u0, 1/k^2), d = sgn psi0'.

Source: E. T. Whittaker, Analytical Dynamics, sect. 44.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ellipj, ellipkinc

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant
from stiction.scenes.model import Drive
from stiction.truths.structure import ANY, CENTRE, NEGATIVE, Part, Structure
from stiction.truths.truth import EPS, NotThisMechanism, Truth, body_columns

PENDULUM = Structure(
    "a pendulum",
    ("mass",),
    {
        "rod": Part(
            Drive, "mass", GROUND, type="distance", points=(CENTRE, ANY), axis=None, law=Constant
        ),
    },
    gravity=(0, NEGATIVE),
    any_names=True,
)


SAMPLES = 500
"""Number of instants at which the magnitude of columns is taken; it scales the rounding, and need not be exact."""
_SEPARATRIX = 1e-9
"""Distance of k from 1 within which the period, which grows as -log|k - 1|, depends on the last digits of the start."""
_FUNCTION_ROUNDING = 10
"""Roundings of an elliptic function, which scipy computes by some ten steps of the arithmetic-geometric mean."""


def pendulum_angle(
    t: np.ndarray, w: float, angle: float, rate: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the angle from the lowest position, its rate and acceleration at times t, each of shape (n,).

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times, s.
    w : float
        Frequency of small swings, rad/s.
    angle, rate : float
        Angle (rad, |angle| <= pi) and rate (rad/s) at t = 0.

    Raises
    ------
    NotThisMechanism
        On the separatrix (k = 1 to 1e-9), where the closed form degenerates.
    """
    k = np.hypot(np.sin(angle / 2), rate / (2 * w))
    if abs(k - 1) < _SEPARATRIX:
        raise NotThisMechanism(
            "the pendulum moves on its separatrix (k = 1); expected it to swing or to rotate"
        )
    if k == 0:
        return (np.zeros_like(t),) * 3
    if k < 1:
        # u0 follows from sn(u0) = sin(psi0/2)/k and cn(u0) = psi0'/(2 w k): its amplitude is the angle
        # of the point (cn, sn).
        start = ellipkinc(np.arctan2(rate / (2 * w), np.sin(angle / 2)) * -1 + np.pi / 2, k * k)
        sn, cn, _, _ = ellipj(w * t + start, k * k)
        psi = 2 * np.arcsin(k * sn)
        psi_t = 2 * w * k * cn
    else:
        # The amplitude that ellipj returns grows beyond pi, so that the angle counts all turns.
        turn = np.sign(rate)
        start = ellipkinc(turn * angle / 2, 1 / k**2)
        _, _, dn, amplitude = ellipj(k * w * t + start, 1 / k**2)
        psi = 2 * turn * amplitude
        psi_t = 2 * turn * w * k * dn
    return psi, psi_t, -w * w * np.sin(psi)


def pendulum_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the motion of a point mass at constant distance from a point of the ground."""
    match = PENDULUM.match(scene)
    t_end = scene.t_end if t_end is None else t_end
    name = match.bodies["mass"]
    rod = match["rod"]
    body = scene.bodies[name]
    length = rod.law.value
    pivot = np.array(rod.points[1])
    g = -(scene.gravity or (0.0, 0.0))[1]
    # The rate of the angle is the moment of the velocity about the pivot, divided by length^2.
    arm = np.array(body.position) - pivot
    angle = float(np.arctan2(arm[0], -arm[1]))
    rate = (arm[0] * body.velocity[1] - arm[1] * body.velocity[0]) / length**2
    w = float(np.sqrt(g / length))

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        psi, psi_t, psi_tt = pendulum_angle(t, w, angle, rate)
        sin, cos = np.sin(psi), np.cos(psi)
        values = body_columns(
            name,
            (pivot[0] + length * sin, pivot[1] - length * cos),
            (length * psi_t * cos, length * psi_t * sin),
            (length * (psi_tt * cos - psi_t**2 * sin), length * (psi_tt * sin + psi_t**2 * cos)),
        )
        # The tension of the rod is the centripetal force plus the weight along the rod.
        tension = body.mass * (length * psi_t**2 + g * cos)
        return values | {f"{match.name('rod')}.effort": -tension}

    return Truth.of_formulas(scene, t_end, columns, elliptic_rounding(w * t_end), SAMPLES)


def elliptic_rounding(phase: float) -> float:
    """Return the relative rounding of an elliptic function at the argument w t = `phase`."""
    return _FUNCTION_ROUNDING * EPS * (1 + phase)
