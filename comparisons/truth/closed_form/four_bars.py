"""N four-bars in a row (IFToMM benchmark A02), any N: by symmetry one pendulum.

All N + 1 uprights (uniform, mass m, length L, pinned to the ground) turn alike, so the N couplers (mass m)
translate with the tips. With the angle th of the uprights above the horizontal

    T = (m L^2 / 2) ((N + 1)/3 + N) th'^2 ,   V = m g L ((N + 1)/2 + N) sin th
    =>  psi'' = -w^2 sin psi ,  psi = th + pi/2 ,  w^2 = (g/L) ((N + 1)/2 + N) / ((N + 1)/3 + N) ,

the closed form of `pendulum.py`. The reactions are not determined: the constraints are redundant.
"""

from __future__ import annotations

import numpy as np

from stiction.comparisons.truth.closed_form.pendulum import elliptic_uncertainty, pendulum_angle
from stiction.comparisons.truth.truth import CLOSED_FORM, NotThisMechanism, Truth
from stiction.scenes import Scene
from stiction.scenes.model import Revolute


def four_bar_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """The motion of bodies `upright-0` .. `upright-N`, `coupler-1` .. `coupler-N`, alike and upright at the start.

    Raises
    ------
    NotThisMechanism
        If the scene has other bodies, unequal ones, or more than gravity and pins.
    """
    t_end = scene.t_end if t_end is None else t_end
    loops = (len(scene.bodies) - 1) // 2
    uprights, couplers = [f"upright-{i}" for i in range(loops + 1)], [f"coupler-{i}" for i in range(1, loops + 1)]
    if (set(scene.bodies) != {*uprights, *couplers} or scene.drives or scene.springs or scene.forces
            or scene.gravity is None):
        raise NotThisMechanism(f"{scene.name} is not a row of four-bars: expected bodies {uprights[0]} .. {uprights[-1]}, "
                         "coupler-1 .., pins and gravity, nothing else")
    bar = scene.bodies[uprights[0]]
    m, g = bar.mass, -scene.gravity[1]
    feet = [joint for joint in scene.joints.values() if "ground" in joint.bodies]
    length = -2 * feet[0].points[0][0] if feet and isinstance(feet[0], Revolute) else 0.0
    alike = all(body.mass == m and abs(body.inertia - m * length ** 2 / 12) < 1e-12 for body in scene.bodies.values())
    if not (alike and len(feet) == len(uprights) and len(scene.joints) == 3 * loops + 1):
        raise NotThisMechanism(f"{scene.name} is not a row of four-bars: expected {3 * loops + 1} pins and "
                         "uniform bars alike")
    w = float(np.sqrt(g / length * ((loops + 1) / 2 + loops) / ((loops + 1) / 3 + loops)))
    start, rate = bar.angle, bar.angular_velocity

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        psi, omega, alpha = pendulum_angle(t, w, start + np.pi / 2, rate)
        th = psi - np.pi / 2
        along, across = np.array([np.cos(th), np.sin(th)]), np.array([-np.sin(th), np.cos(th)])
        tip, tip_v = length * along, length * omega * across
        tip_a = length * (alpha * across - omega ** 2 * along)
        values = {}
        for i, name in enumerate(uprights):
            values |= _planar(name, np.array([[i * length], [0]]) + tip / 2, tip_v / 2, tip_a / 2, th, omega, alpha)
        for i, name in enumerate(couplers):
            centre = np.array([[(i + 0.5) * length], [0]]) + tip
            values |= _planar(name, centre, tip_v, tip_a, *(np.zeros((3, len(t)))))
        return values

    return Truth(scene.name, CLOSED_FORM, t_end, columns, elliptic_uncertainty(columns, w * t_end, t_end))


def _planar(name: str, x: np.ndarray, v: np.ndarray, a: np.ndarray, angle, omega, alpha) -> dict[str, np.ndarray]:
    return {f"{name}.x": x[0], f"{name}.y": x[1], f"{name}.angle": angle, f"{name}.vx": v[0], f"{name}.vy": v[1],
            f"{name}.omega": omega, f"{name}.ax": a[0], f"{name}.ay": a[1], f"{name}.alpha": alpha}
