"""N four-bars in a row (IFToMM benchmark A02), which by symmetry move as one pendulum.

All N + 1 uprights (uniform, mass m, length L, pinned to the ground) have the same angle. The N couplers (mass m)
translate with the tips. With the angle th of the uprights above the horizontal

    T = (m L^2 / 2) ((N + 1)/3 + N) th'^2 ,   V = m g L ((N + 1)/2 + N) sin th
    =>  psi'' = -w^2 sin psi ,  psi = th + pi/2 ,  w^2 = (g/L) ((N + 1)/2 + N) / ((N + 1)/3 + N) ,

the closed form of `pendulum.py`. The reactions are not determined: the constraints are redundant.
"""

from __future__ import annotations

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Revolute
from stiction.truths.closed_form.pendulum import SAMPLES, elliptic_rounding, pendulum_angle
from stiction.truths.structure import NEGATIVE, Part, Structure
from stiction.truths.truth import Truth, body_columns

_UNIFORM = 1e-12
"""Largest difference, kg m^2, of a moment of inertia from that of a uniform bar: rounding of a scene's number."""


def _row(loops: int, length: float) -> Structure:
    """Return the structure of a row of `loops` four-bars, whose bars have the same length (m)."""
    start, end = (-length / 2, 0), (length / 2, 0)
    uprights = [f"upright-{i}" for i in range(loops + 1)]
    couplers = [f"coupler-{i + 1}" for i in range(loops)]
    pins = {
        f"foot of {upright}": Part(Revolute, upright, GROUND, points=(start, (i * length, 0)))
        for i, upright in enumerate(uprights)
    }
    for coupler, left, right in zip(couplers, uprights, uprights[1:]):
        pins |= {
            f"left pin of {coupler}": Part(Revolute, coupler, left, points=(start, end)),
            f"right pin of {coupler}": Part(Revolute, coupler, right, points=(end, end)),
        }
    return Structure("a row of four-bars", (*uprights, *couplers), pins, gravity=(0, NEGATIVE))


def four_bar_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the motion of identical uniform bars `upright-0` .. `upright-N` and `coupler-1` .. `coupler-N`."""
    t_end = scene.t_end if t_end is None else t_end
    # The number of loops and the length of a bar are read from the scene. They determine the structure
    # that the scene has to match.
    loops = (len(scene.bodies) - 1) // 2
    arms = [abs(pin.points[0][0]) for pin in scene.joints.values() if isinstance(pin, Revolute)]
    length = 2 * max(arms, default=0.0)
    row = _row(loops, length)
    row.match(scene)
    bar = scene.bodies["upright-0"]
    g = -(scene.gravity or (0.0, 0.0))[1]
    uniform = bar.mass * length**2 / 12
    for body in scene.bodies.values():
        if body.mass != bar.mass or abs(body.inertia - uniform) >= _UNIFORM:
            raise row.misfit(
                scene, f"bodies: expected uniform bars alike, of {bar.mass:g} kg and {length:g} m"
            )
    w = float(np.sqrt(g / length * ((loops + 1) / 2 + loops) / ((loops + 1) / 3 + loops)))

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        # Every upright is the same pendulum. `tip` is relative to the foot; the centre is halfway.
        psi, omega, alpha = pendulum_angle(t, w, bar.angle + np.pi / 2, bar.angular_velocity)
        th = psi - np.pi / 2
        along = np.array([np.cos(th), np.sin(th)])
        across = np.array([-np.sin(th), np.cos(th)])
        tip = length * along
        tip_v = length * omega * across
        tip_a = length * (alpha * across - omega**2 * along)
        values: dict[str, np.ndarray] = {}
        zero = np.zeros_like(t)
        for i in range(loops + 1):
            centre = np.array([[i * length], [0]]) + tip / 2
            values |= body_columns(
                f"upright-{i}", (*centre, th), (*tip_v / 2, omega), (*tip_a / 2, alpha)
            )
        # Couplers translate with the tips.
        for i in range(loops):
            centre = np.array([[(i + 0.5) * length], [0]]) + tip
            values |= body_columns(
                f"coupler-{i + 1}", (*centre, zero), (*tip_v, zero), (*tip_a, zero)
            )
        return values

    return Truth.of_formulas(scene, t_end, columns, elliptic_rounding(w * t_end), SAMPLES)
