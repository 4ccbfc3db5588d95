"""Frictionless slider-crank at constant speed: kinematics and inverse dynamics in closed form.

The crank (radius r, pivot at p) has the angle th = th0 + w t, the rod (length l) the angle phi, the guide is the line
y = h along x:

    l sin phi = h - p_y - r sin th ,  phi_th = dphi/dth = -r cos th / (l cos phi) ,  phi' = w phi_th ,
    phi'' = (r w^2 sin th + l phi'^2 sin phi) / (l cos phi) .

Every centre of mass lies at p + sum of lengths times unit vectors e(th), e(phi); its derivative by th is its partial
velocity u, and the power of all inertia and weight forces per unit of th' is the motor's torque:

    tau = sum over bodies of m (a - g).u + I alpha dangle/dth .

Reactions: the slider needs m_s (a - g) along x from the rod, the rod's moments about the crank pin give the force
across.
"""

from __future__ import annotations

import numpy as np

from stiction.comparisons.truth.truth import CLOSED_FORM, NotThisMechanism, Truth
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Linear
from stiction.scenes.model import Revolute, Translational


def slider_crank_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Motion, motor torque and reactions of bodies `crank`, `rod`, `slider` (joints and drive by what they connect).

    Raises
    ------
    NotThisMechanism
        If the scene is not a slider-crank with a linear angle drive, a horizontal frictionless guide, points along the
        bars' x axes and l > r + |h - p_y|.
    """
    t_end = scene.t_end if t_end is None else t_end
    p, h, r1, r, l1, l, th0, w, motor, guide, pin, elbow = _parameters(scene)
    gravity = np.array(scene.gravity or (0.0, 0.0))[:, None]
    bodies = {name: scene.bodies[name] for name in ("crank", "rod", "slider")}

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        th = th0 + w * t
        sin_phi = (h - p[1] - r * np.sin(th)) / l
        cos_phi = elbow * np.sqrt(1 - sin_phi ** 2)
        phi = np.arctan2(sin_phi, cos_phi)
        phi_th = -r * np.cos(th) / (l * cos_phi)
        omega = w * phi_th
        alpha = (r * w * w * np.sin(th) + l * omega ** 2 * sin_phi) / (l * cos_phi)
        zero = np.zeros_like(t)
        angles = {"crank": (th, zero + w, zero, 1.0), "rod": (phi, omega, alpha, phi_th),
                  "slider": (zero, zero, zero, 0.0)}
        arms = {"crank": (r1, 0.0), "rod": (r, l1), "slider": (r, l)}
        values: dict[str, np.ndarray] = {}
        torque, inertia_force = zero.copy(), {}
        for name, (on_crank, on_rod) in arms.items():
            position = p[:, None] + on_crank * _unit(th) + on_rod * _unit(phi)
            partial = on_crank * _normal(th) + on_rod * phi_th * _normal(phi)
            a = -on_crank * w * w * _unit(th) + on_rod * (alpha * _normal(phi) - omega ** 2 * _unit(phi))
            angle, rate, acceleration, by_th = angles[name]
            for i, c in enumerate("xy"):
                values |= {f"{name}.{c}": position[i], f"{name}.v{c}": w * partial[i], f"{name}.a{c}": a[i]}
            values |= {f"{name}.angle": angle, f"{name}.omega": rate, f"{name}.alpha": acceleration}
            inertia_force[name] = bodies[name].mass * (a - gravity)
            torque += np.sum(inertia_force[name] * partial, axis=0) + bodies[name].inertia * acceleration * by_th
        fx = -inertia_force["slider"][0]
        moment = bodies["rod"].inertia * alpha + l1 * (np.cos(phi) * inertia_force["rod"][1]
                                                       - np.sin(phi) * inertia_force["rod"][0])
        fy = (moment / l + np.sin(phi) * fx) / np.cos(phi)
        sign = 1 if pin[1] == "rod" else -1
        return values | {f"{motor}.effort": torque, f"{guide}.normal_force": fy + inertia_force["slider"][1],
                         f"{pin[0]}.fx": sign * fx, f"{pin[0]}.fy": sign * fy}

    sample = columns(np.linspace(0, t_end, 1000), "after")
    rounding = 20 * np.finfo(float).eps * (1 + abs(w) * t_end)  # th carries the rounding of w t
    uncertainty = {name: rounding * float(1 + np.max(np.abs(value))) for name, value in sample.items()}
    return Truth(scene.name, CLOSED_FORM, t_end, columns, uncertainty)


def _unit(angle: np.ndarray) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def _normal(angle: np.ndarray) -> np.ndarray:
    return np.array([-np.sin(angle), np.cos(angle)])


def _parameters(scene: Scene):
    def require(condition: bool, text: str) -> None:
        if not condition:
            raise NotThisMechanism(f"{scene.name} is not a slider-crank at constant speed: {text}")

    require(set(scene.bodies) == {"crank", "rod", "slider"}, f"bodies: found {', '.join(scene.bodies)}; "
                                                              "expected crank, rod, slider")
    require(not scene.springs and not scene.forces, "springs, forces: expected none")
    pins = {frozenset(joint.bodies): (name, joint) for name, joint in scene.joints.items()
            if isinstance(joint, Revolute)}
    pairs = [frozenset(("crank", GROUND)), frozenset(("rod", "crank")), frozenset(("rod", "slider"))]
    require(set(pins) == set(pairs), "joints: expected pins of crank and ground, rod and crank, rod and slider")
    guides = [(name, joint) for name, joint in scene.joints.items() if isinstance(joint, Translational)]
    require(len(guides) == 1 and guides[0][1].bodies == ("slider", GROUND) and not guides[0][1].mu
            and guides[0][1].direction[0] > 0 and guides[0][1].direction[1] == 0 and guides[0][1].angle == 0
            and guides[0][1].slider_point == (0, 0), "joints: expected the slider on a frictionless guide along (1, 0)")
    drives = [(name, drive) for name, drive in scene.drives.items()]
    require(len(drives) == 1 and drives[0][1].type == "angle" and drives[0][1].bodies == ("crank", GROUND)
            and isinstance(drives[0][1].law, Linear), "drives: expected a linear angle drive of crank against ground")

    def point(pair: frozenset, body: str) -> tuple[float, float]:
        joint = pins[pair][1]
        return joint.points[joint.bodies.index(body)]

    local = {"pivot": point(pairs[0], "crank"), "crank pin": point(pairs[1], "crank"),
             "rod's start": point(pairs[1], "rod"), "rod's end": point(pairs[2], "rod")}
    require(all(y == 0 for _, y in local.values()) and point(pairs[2], "slider") == (0, 0),
            f"joints: found {local}; expected points on the x axes of crank and rod, and the slider's centre")
    r1, r = -local["pivot"][0], local["crank pin"][0] - local["pivot"][0]
    l1, l = -local["rod's start"][0], local["rod's end"][0] - local["rod's start"][0]
    p, h = np.array(point(pairs[0], GROUND)), guides[0][1].point[1]
    require(l > abs(r) + abs(h - p[1]), f"rod of {l:g} m is too short for a crank of {r:g} m; expected a full turn")
    law = drives[0][1].law
    pin_name, pin = pins[pairs[2]]
    elbow = 1.0 if np.cos(scene.bodies["rod"].angle) > 0 else -1.0
    return (p, h, r1, r, l1, l, law.offset, law.rate, drives[0][0], guides[0][0], (pin_name, pin.bodies[0]), elbow)
