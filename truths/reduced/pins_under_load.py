"""Forces in mechanisms whose pins have friction under load, by balances of each body and root finding.

The friction of a pin that turns is a torque mu r |R| against its rotation, with the force R in it: mu r is the radius
of its friction circle. The balances of force and moment of each body are written out body by body, without a constraint
Jacobian, and are not linear in the forces. `scipy.optimize.root` solves them. Motions of driven mechanisms are known,
so that accelerations and directions of slip are given (inverse dynamics); at the limit of rest they are zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, root

_XTOL = 1e-15
"""Relative change of the forces at which the root finding ends: a few roundings."""
_RESIDUAL = 1e-11
"""Largest remainder of the balances, relative to the largest force, of a root."""


@dataclass(frozen=True)
class BodyInMotion:
    """A body of a planar mechanism at one instant.

    Attributes
    ----------
    mass, inertia : float
        Mass (kg) and moment of inertia about the centre of mass (kg m^2).
    position : tuple of float
        Centre of mass, m.
    acceleration : tuple of float
        Its acceleration, m/s^2.
    angular_acceleration : float
        rad/s^2.
    """

    mass: float
    inertia: float
    position: tuple[float, float]
    acceleration: tuple[float, float]
    angular_acceleration: float


@dataclass(frozen=True)
class LoadedPin:
    """A pin at one instant.

    Attributes
    ----------
    bodies : tuple of str
        The two bodies; one may be ``"ground"``.
    place : tuple of float
        Where the pin is, m.
    circle : float
        Radius of its friction circle, m.
    direction : int
        Sign of the angular velocity of the first body relative to the second.
    """

    bodies: tuple[str, str]
    place: tuple[float, float]
    circle: float
    direction: int


@dataclass(frozen=True)
class LevelGuide:
    """A guide along x that keeps the angle of its slider; friction by a coefficient acts on its centre of mass.

    Attributes
    ----------
    slider : str
        The sliding body.
    coefficient : float
        Coefficient of friction.
    direction : int
        Sign of the velocity of the slider.
    """

    slider: str
    coefficient: float
    direction: int


def inverse_dynamics(
    bodies: Mapping[str, BodyInMotion],
    pins: Mapping[str, LoadedPin],
    guides: Mapping[str, LevelGuide],
    motor: tuple[str, str],
    gravity: tuple[float, float] = (0.0, 0.0),
) -> dict[str, float]:
    """Return the forces of a driven mechanism at an instant, and the torque of its motor.

    Parameters
    ----------
    bodies, pins, guides : Mapping
        The mechanism, by names.
    motor : tuple of str
        The two bodies between which the motor acts.
    gravity : tuple of float
        m/s^2.

    Returns
    -------
    dict
        ``NAME.fx`` and ``NAME.fy`` (N, on the first body) and ``NAME.friction`` (N m, on the first body) of pins,
        ``NAME.normal_force`` and ``NAME.friction`` (N) of guides, and ``effort``, the torque of the motor (N m).

    Raises
    ------
    ValueError
        If no root is found.
    """
    names = list(bodies)
    unknowns = 2 * len(pins) + 2 * len(guides) + 1

    def balances(force: np.ndarray) -> np.ndarray:
        """Return what is left of force and moment of each body."""
        left = {name: np.zeros(3) for name in names}
        for name in names:
            body = bodies[name]
            left[name][:2] = body.mass * (np.subtract(gravity, body.acceleration))
            left[name][2] = -body.inertia * body.angular_acceleration
        for i, pin in enumerate(pins.values()):
            fx, fy = force[2 * i : 2 * i + 2]
            torque = -pin.direction * pin.circle * np.hypot(fx, fy)
            for sign, name in zip((1.0, -1.0), pin.bodies):
                if name in bodies:
                    x, y = np.subtract(pin.place, bodies[name].position)
                    left[name] += sign * np.array([fx, fy, x * fy - y * fx + torque])
        for i, guide in enumerate(guides.values(), len(pins)):
            normal, moment = force[2 * i : 2 * i + 2]
            friction = -guide.direction * guide.coefficient * abs(normal)
            left[guide.slider] += np.array([friction, normal, moment])
        for sign, name in zip((1.0, -1.0), motor):
            if name in bodies:
                left[name][2] += sign * force[-1]
        return np.concatenate([left[name] for name in names])

    start = np.linalg.lstsq(_slopes(balances, unknowns), -balances(np.zeros(unknowns)))[0]
    solution = root(balances, start, method="hybr", options={"xtol": _XTOL})
    force = solution.x
    # one more step of Newton's method, as the root finding ends by its own estimate of rounding
    force = force - np.linalg.solve(_slopes(balances, unknowns, force), balances(force))
    if not np.max(np.abs(balances(force))) <= _RESIDUAL * max(1.0, np.max(np.abs(force))):
        raise ValueError(f"balances: found {solution.message}; expected a root")
    forces = {}
    for i, (name, pin) in enumerate(pins.items()):
        fx, fy = force[2 * i : 2 * i + 2]
        forces[f"{name}.fx"], forces[f"{name}.fy"] = fx, fy
        forces[f"{name}.friction"] = -pin.direction * pin.circle * np.hypot(fx, fy)
    for i, (name, guide) in enumerate(guides.items(), len(pins)):
        normal = force[2 * i]
        forces[f"{name}.normal_force"] = normal
        forces[f"{name}.friction"] = -guide.direction * guide.coefficient * abs(normal)
    return forces | {"effort": force[-1]}


def _slopes(balances, count: int, place: np.ndarray | None = None) -> np.ndarray:
    """Return the derivatives of the balances by the forces, by central differences of one newton."""
    place = np.zeros(count) if place is None else place
    step = 1e-3 * max(1.0, float(np.max(np.abs(place))))
    columns = [
        (balances(place + step * unit) - balances(place - step * unit)) / (2 * step)
        for unit in np.eye(count)
    ]
    return np.stack(columns, -1)


def toggle_limits(
    angle: float, length: float, thrust: float, circles: Sequence[float]
) -> tuple[float, float]:
    """Return the loads on the middle pin of a toggle at which it begins to stretch, and to fold.

    Two links of one length, from a fixed pin A to the pin B and on to the pin C of a slider on the line A C, make the
    angle `angle` with it. The `thrust` pushes the slider towards A, the load presses B, on the first link, towards the
    line. In the friction-circle method the force in a link does not go through its pins but along a tangent of their
    friction circles: on the second link from C to B

        l sin(psi) = +-(rho_B + rho_C) ,    S_2 = thrust / cos(angle +- psi) ,

    and on the first, whose ends have the forces S_1 and the frictions rho_A S_1 and rho_B S_2,

        l S_1 sin(theta - angle) = +-(rho_A S_1 + rho_B S_2) ,    S_1 cos(theta) = thrust ,

    with the load thrust (tan theta + tan(angle +- psi)). Between the two limits the toggle rests. If that of folding is
    negative it is self-locking: no thrust folds it.

    Parameters
    ----------
    angle : float
        rad, between 0 and pi/2.
    length : float
        Length l of each link, m.
    thrust : float
        Force on the slider, N.
    circles : sequence of float
        Radii of the friction circles of A, B and C, m.

    Returns
    -------
    tuple of float
        The largest load and the smallest load of rest, N.
    """
    at_a, at_b, at_c = circles
    loads = []
    for sign in (1.0, -1.0):
        second = angle + sign * np.arcsin((at_b + at_c) / length)
        force = thrust / np.cos(second)

        def moment(theta: float, sign: float = sign, force: float = force) -> float:
            """Return what is left of the moment of the first link, N m."""
            own = thrust / np.cos(theta)
            return length * own * np.sin(theta - angle) - sign * (at_a * own + at_b * force)

        first = brentq(moment, -1.5, 1.5, xtol=_XTOL, rtol=1e-15)
        loads.append(thrust * (np.tan(first) + np.tan(second)))
    return loads[0], loads[1]


def toggle_limit_with_guide(
    angle: float,
    length: float,
    thrust: float,
    circles: Sequence[float],
    coefficient: float,
    direction: int,
) -> float:
    """Return the load at which a toggle as of `toggle_limits`, whose guide has friction too, begins to move.

    The balances of both links and of the slider at the limit, with all frictions against the motion that begins: forces
    in A, B and C, normal force of the guide and load are the unknowns. The moment of the guide follows from them.

    Parameters
    ----------
    angle, length, thrust, circles : see `toggle_limits`
    coefficient : float
        Static coefficient of friction of the guide, which has no length.
    direction : int
        1 where it stretches, -1 where it folds.

    Raises
    ------
    ValueError
        If no root is found.
    """
    x, y = length * np.cos(angle), length * np.sin(angle)

    def balances(unknown: np.ndarray) -> list[float]:
        """Return what is left of forces (N) and of moments about A and B (N m).

        Forces are those on the first link in A, on the second link in B and on the slider in C; torques likewise.
        """
        ax, ay, bx, by, cx, cy, normal, load = unknown
        at_a = direction * circles[0] * np.hypot(ax, ay)
        at_b = -direction * circles[1] * np.hypot(bx, by)
        at_c = direction * circles[2] * np.hypot(cx, cy)
        return [
            ax - bx,
            ay - by - load,
            -x * (by + load) + y * bx + at_a - at_b,
            bx - cx,
            by - cy,
            -x * cy - y * cx + at_b - at_c,
            cx - thrust - direction * coefficient * abs(normal),
            cy + normal,
        ]

    slope = y / x * thrust
    start = [thrust, slope, thrust, -slope, thrust, -slope, slope, 2 * slope]
    solution = root(balances, start, method="hybr", options={"xtol": _XTOL})
    if not np.max(np.abs(balances(solution.x))) <= _RESIDUAL * np.max(np.abs(solution.x)):
        raise ValueError(f"balances: found {solution.message}; expected a root")
    return float(solution.x[-1])
