"""Slider-crank at constant speed with dry or damped pins: kinematics and inverse dynamics in closed form.

The crank (radius r, pivot at p) has the angle th = th0 + w t, the rod (length l) the angle phi, the guide is the line
y = h along x:

    l sin phi = h - p_y - r sin th ,  phi_th = dphi/dth = -r cos th / (l cos phi) ,  phi' = w phi_th ,
    phi'' = (r w^2 sin th + l phi'^2 sin phi) / (l cos phi) .

Every centre of mass lies at p + sum of lengths times unit vectors e(th), e(phi); its derivative by th is its partial
velocity u, and the power of all inertia and weight forces per unit of th' is the motor's torque:

    tau = sum over bodies of m (a - g).u + I alpha dangle/dth .

Pins with dry friction tau_i and damping c_i take power, which the motor gives: with the relative rates w_i,

    w tau += sum over pins of tau_i |w_i| + c_i w_i^2 .

The rates of the pivot and of the crank pin do not change their sign as the rod is longer than the crank; that of the
slider pin is the rod's, and changes it where cos th = 0. There the torque jumps.

Reactions: the slider needs m_s (a - g) along x from the rod, the rod's moments about the crank pin give the force
across; the torques of both of its pins are among these moments.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Linear
from stiction.scenes.model import Drive, Revolute, Translational
from stiction.truths.structure import ANY, CENTRE, FORWARD, Condition, Match, Part, Structure
from stiction.truths.truth import EPS, Truth, body_columns

_DRY_OR_DAMPED: dict[str, Any] = {"friction": ANY, "static_friction": ANY, "damping": ANY}
"""Effects of pins that the torque contains. A pin that turns has its kinetic friction alone."""
PINS = {"pivot": "crank", "crank pin": "rod", "slider pin": "rod"}
"""Pins, and the body whose torque by the pin is counted positive."""
SLIDER_CRANK = Structure(
    "a slider-crank at constant speed",
    ("crank", "rod", "slider"),
    {
        "pivot": Part(Revolute, "crank", GROUND, any_order=True, **_DRY_OR_DAMPED),
        "crank pin": Part(Revolute, "rod", "crank", any_order=True, **_DRY_OR_DAMPED),
        "slider pin": Part(Revolute, "rod", "slider", any_order=True, **_DRY_OR_DAMPED),
        "guide": Part(
            Translational,
            "slider",
            GROUND,
            direction=FORWARD,
            slider_point=CENTRE,
            angle=0,
            mu=Condition("none or 0", lambda mu: not mu),
        ),
        "motor": Part(Drive, "crank", GROUND, type="angle", law=Linear),
    },
)


_ROUNDING = 20 * EPS
"""Relative rounding of the columns: the torque sums some twenty products."""
_SAMPLES = 1000
"""Number of instants at which the magnitude of columns is taken; it scales the rounding, and need not be exact."""


def slider_crank_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return motion, motor torque and reactions of `crank`, `rod`, `slider`, whose pins lie on the bars' x axes."""
    t_end = scene.t_end if t_end is None else t_end
    match = SLIDER_CRANK.match(scene)
    p, r1, r, l1, l = _read_lengths(scene, match)
    h = match["guide"].point[1]
    th0, w = match["motor"].law.offset, match["motor"].law.rate
    # The crank makes full turns, so that the rod points forwards or backwards throughout.
    elbow = 1.0 if np.cos(scene.bodies["rod"].angle) > 0 else -1.0
    motor, guide, pin = match.name("motor"), match.name("guide"), match.name("slider pin")
    pin_sign = 1 if match["slider pin"].bodies[0] == "rod" else -1
    gravity = np.array(scene.gravity or (0.0, 0.0))[:, None]
    arms = {"crank": (r1, 0.0), "rod": (r, l1), "slider": (r, l)}
    # the rod's rate changes its sign where cos th = 0
    turns = _quarter_turns(th0, w, t_end)
    rubs = match["slider pin"].friction is not None

    def signs_of_rod(t: np.ndarray, side: str) -> np.ndarray:
        """Return the signs of the rod's rate, -w cos th cos phi, at times t; at a change of sign those of a side."""
        after = np.searchsorted(turns, t, side="right" if side == "after" else "left")
        first_middle = 0.5 * (turns[0] if turns else t_end)
        at_first = -np.sign(w * r * np.cos(th0 + w * first_middle)) * elbow
        return at_first * (-1.0) ** after

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        # Solve the kinematics of the closed loop.
        th = th0 + w * t
        sin_phi = (h - p[1] - r * np.sin(th)) / l
        cos_phi = elbow * np.sqrt(1 - sin_phi**2)
        phi = np.arctan2(sin_phi, cos_phi)
        phi_th = -r * np.cos(th) / (l * cos_phi)
        omega = w * phi_th
        alpha = (r * w * w * np.sin(th) + l * omega**2 * sin_phi) / (l * cos_phi)
        zero = np.zeros_like(t)
        angles = {
            "crank": (th, zero + w, zero, 1.0),
            "rod": (phi, omega, alpha, phi_th),
            "slider": (zero, zero, zero, 0.0),
        }
        # Compute the motion of each body, and its part of the motor's torque by the principle of
        # virtual power.
        values: dict[str, np.ndarray] = {}
        torque = zero.copy()
        inertia_force = {}
        for name, (on_crank, on_rod) in arms.items():
            body = scene.bodies[name]
            angle, rate, acceleration, by_th = angles[name]
            position = p[:, None] + on_crank * _unit(th) + on_rod * _unit(phi)
            partial = on_crank * _normal(th) + on_rod * phi_th * _normal(phi)
            a = -on_crank * w * w * _unit(th) + on_rod * (
                alpha * _normal(phi) - omega**2 * _unit(phi)
            )
            values |= body_columns(
                name, (*position, angle), (*w * partial, rate), (*a, acceleration)
            )
            inertia_force[name] = body.mass * (a - gravity)
            torque += (
                np.sum(inertia_force[name] * partial, axis=0) + body.inertia * acceleration * by_th
            )
        # The force of the slider on the rod follows along x from the balance of the slider, and across
        # from the rod's moments about the crank pin.
        fx = -inertia_force["slider"][0]
        # Torques of the pins on crank and rods, and the power that the motor gives for them.
        rates = {"pivot": zero + w, "crank pin": omega - w, "slider pin": omega}
        signs = {
            "pivot": np.sign(w) + zero,
            "crank pin": -np.sign(w) + zero,
            "slider pin": signs_of_rod(t, side),
        }
        on_first = {
            label: -signs[label] * match[label].bounds[0] - match[label].damping * rates[label]
            for label in PINS
        }
        for label in PINS if w != 0.0 else ():
            torque -= on_first[label] * rates[label] / w
        moment = scene.bodies["rod"].inertia * alpha + l1 * (
            np.cos(phi) * inertia_force["rod"][1] - np.sin(phi) * inertia_force["rod"][0]
        )
        moment -= on_first["crank pin"] + on_first["slider pin"]
        fy = (moment / l + np.sin(phi) * fx) / np.cos(phi)
        for label, counted in PINS.items():
            if match[label].friction is not None:
                turned = 1.0 if match[label].bodies[0] == counted else -1.0
                name = match.name(label)
                values |= {
                    f"{name}.friction": -turned * signs[label] * match[label].bounds[0],
                    f"{name}.slip_velocity": turned * rates[label],
                    f"{name}.mode": turned * signs[label],
                }
        return values | {
            f"{motor}.effort": torque,
            f"{guide}.normal_force": fy + inertia_force["slider"][1],
            f"{pin}.fx": pin_sign * fx,
            f"{pin}.fy": pin_sign * fy,
        }

    rounding = _ROUNDING * (1 + abs(w) * t_end)  # th carries the rounding of w t
    switches = [(turn, "reversal", pin) for turn in turns] if rubs else []
    return Truth.of_formulas(scene, t_end, columns, rounding, _SAMPLES, switches)


def _quarter_turns(th0: float, w: float, t_end: float) -> list[float]:
    """Return the times in (0, t_end) at which the crank of angle th0 + w t stands across: cos th = 0."""
    if w == 0.0:
        return []
    low, high = sorted((th0, th0 + w * t_end))
    first = int(np.ceil(low / np.pi - 0.5))
    last = int(np.floor(high / np.pi - 0.5))
    times = [((k + 0.5) * np.pi - th0) / w for k in range(first, last + 1)]
    return sorted(time for time in times if 0.0 < time < t_end)


def _unit(angle: np.ndarray) -> np.ndarray:
    """Return the unit vectors e(angle), shape (2, n)."""
    return np.array([np.cos(angle), np.sin(angle)])


def _normal(angle: np.ndarray) -> np.ndarray:
    """Return the derivatives of the unit vectors by the angle, shape (2, n)."""
    return np.array([-np.sin(angle), np.cos(angle)])


def _read_lengths(scene: Scene, match: Match) -> tuple[np.ndarray, float, float, float, float]:
    """Return p, r1, r, l1, l (m): the pivot, and the distances of each bar's centre and end from its beginning."""

    def point(pin: str, body: str) -> tuple[float, float]:
        """Return the point of a pin in the axes of one of its bodies."""
        return match[pin].points[match[pin].bodies.index(body)]

    ends = [
        point("pivot", "crank"),
        point("crank pin", "crank"),
        point("crank pin", "rod"),
        point("slider pin", "rod"),
    ]
    if any(y for _, y in ends) or point("slider pin", "slider") != (0, 0):
        raise SLIDER_CRANK.misfit(
            scene,
            f"pins: found {ends} on the bars; expected points of the bars' x axes and the "
            "slider's centre",
        )
    crank_begin, crank_end, rod_begin, rod_end = (x for x, _ in ends)
    r = crank_end - crank_begin
    l = rod_end - rod_begin
    p = np.array(point("pivot", GROUND))
    # The crank makes a full turn if |h - p_y - r sin th| < l for all th.
    if not l > abs(r) + abs(match["guide"].point[1] - p[1]):
        raise SLIDER_CRANK.misfit(
            scene, f"rod of {l:g} m is too short for a crank of {r:g} m; expected a full turn"
        )
    return p, -crank_begin, r, -rod_begin, l
