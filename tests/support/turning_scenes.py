"""Sliders at rest under forces that turn fast, while nothing moves but what a drive turns or moves: random scenes and their break-aways.

The slider stays where it is until friction no longer holds it, so that every force on it is an explicit function of time. With the sum of
all forces but the guide's, (X, Y) along and across a guide of length a (no width), and their moment T about the slider's centre of mass, it
holds while

    mus max(|Y|, (2/a) |T|) - |X| > 0 .

A slider that rests on an arm, which a drive turns, has X and Y in the axes of the arm, less its centripetal and tangential inertia. The
functions here are written from positions, Hooke's law and Newton's law in NumPy; splines are SciPy's. The first zero is found on a grid of
64 points for each period of the fastest product of factors, each of its minima refined (`first_break_away`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydantic import TypeAdapter
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, minimize_scalar

from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import scene_from_dict
from stiction.scenes.laws import Law, evaluate_law

G = 9.81
KINDS = ("axis", "distance", "rim", "unbalanced", "free", "two rotors", "passing", "arm")
LAWS = ("linear", "linear", "table", "cubic", "sine")
POINTS, MOST_POINTS = 64, 3_000_000
GRAZING = 1e-7
"""Part of the forces by which a minimum must differ from zero for rounding not to decide whether there is an event."""


@dataclass
class Drawn:
    """A scene, as the tables of a file, and its truth: `gap` is what is left of friction at given times, `size` a force it is measured by."""

    kinds: tuple[str, ...]
    tables: dict[str, Any]
    gap: Callable[[np.ndarray], np.ndarray]
    t_end: float
    fastest: float
    size: float
    is_free: bool
    rtol: float = 1e-9
    output_step: float = 1.0
    turns: float = 0.0


@dataclass
class Angle:
    """An angle that a law gives: the law for a scene, and the angle, its rate and its acceleration in NumPy."""

    law: dict[str, Any]
    at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
    fastest: float


@dataclass
class _Parts:
    """What a scene is put together of."""

    mus: float
    length: float | None
    mass: float
    gravity: float
    t_end: float
    tables: dict[str, Any] = field(
        default_factory=lambda: {
            name: {} for name in ("bodies", "joints", "drives", "springs", "forces")
        }
    )
    forces: list[Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]] = field(
        default_factory=list
    )
    fastest: float = 0.0


def turned(angle, point):
    """A vector of a body, in ground axes."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * point[0] - s * point[1], s * point[0] + c * point[1]])


def moment(arm, force):
    return arm[0] * force[1] - arm[1] * force[0]


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1]


def across(vector):
    """A quarter turn to the left: the rate of a vector that turns with 1 rad/s."""
    return np.stack([-vector[1], vector[0]])


def even(offset, rate):
    return Angle(
        {"type": "linear", "offset": offset, "rate": rate},
        lambda t: (offset + rate * t, rate + 0 * t, 0 * t),
        abs(rate),
    )


def drawn_angle(rng, rate, t_end, kind):
    """An angle that turns with about `rate` rad/s."""
    offset = rng.uniform(0, 2 * np.pi)
    if kind == "linear":
        return even(offset, rate)
    if kind == "sine":
        f = abs(rate) / rng.uniform(20, 200)
        a, phase = rate / f, rng.uniform(0, 2 * np.pi)
        law = {"type": "sine", "offset": offset, "amplitude": a, "frequency": f, "phase": phase}
        return Angle(
            law,
            lambda t: (
                offset + a * np.sin(f * t + phase),
                a * f * np.cos(f * t + phase),
                -a * f * f * np.sin(f * t + phase),
            ),
            abs(rate),
        )
    if kind == "table":
        return Angle(
            {
                "type": "table",
                "times": [0, 2 * t_end],
                "values": [offset, offset + 2 * rate * t_end],
                "interpolation": "cubic",
            },
            even(offset, rate).at,
            abs(rate),
        )
    times = np.linspace(0, 1.01 * t_end, int(rng.integers(3, 8)))
    values = offset + rate * times + rate * times[1] * rng.uniform(-0.15, 0.15, len(times))
    spline = CubicSpline(times, values, bc_type="natural")
    law = {
        "type": "table",
        "times": times.tolist(),
        "values": values.tolist(),
        "interpolation": "cubic",
    }
    return Angle(
        law,
        lambda t: (spline(t), spline(t, 1), spline(t, 2)),
        float(np.abs(spline(np.linspace(0, t_end, 1000), 1)).max()),
    )


def start_of(angle):
    """Angle and rate at the start as the scene's law has them, to the last bit."""
    value, rate, _ = evaluate_law(TypeAdapter(Law).validate_python(angle.law), 0.0)
    return float(value), float(rate)


def add_rotor(
    parts, name, angle, on, centre, mass=1.0, arm=(0.0, 0.0), motor: str | None = "ground"
):
    """A rotor whose point `arm` is pinned to a body at `centre`, and its motor."""
    start, rate = start_of(angle)
    lever = turned(start, arm)
    parts.tables["bodies"][name] = {
        "mass": mass,
        "inertia": 0.01,
        "position": [centre[0] - lever[0], centre[1] - lever[1]],
        "angle": start,
        "velocity": [rate * lever[1], -rate * lever[0]],
        "angular_velocity": rate,
    }
    parts.tables["joints"][f"{name}-pin"] = {
        "type": "revolute",
        "bodies": [name, on],
        "points": [list(arm), list(centre)],
    }
    if motor is not None:
        parts.tables["drives"][f"{name}-motor"] = {
            "type": "angle",
            "bodies": [name, motor],
            "law": angle.law,
        }


def spring_along_axis(parts, rng, force, name, angle):
    """From a point of the slider to a rotor beside it, along an axis of the rotor, with a damper perhaps."""
    centre, p, size = np.array([-0.3, rng.uniform(-0.1, 0.1)]), drawn_point(parts, rng), 0.4
    on_rotor, direction = (
        rng.uniform(-0.1, 0.1, 2) * rng.integers(0, 2),
        turned(rng.uniform(0, 6), (1.0, 0.0)),
    )
    k, rest = force / size * rng.uniform(0.5, 1), rng.choice([0.0, rng.uniform(-0.1, 0.1)])
    c = rng.choice([0.0, 0.2 * k / angle.fastest])
    add_rotor(parts, name, angle, "ground", centre)
    parts.tables["springs"][f"{name}-spring"] = {
        "type": "linear",
        "bodies": ["s", name],
        "points": [p.tolist(), on_rotor.tolist()],
        "axis": direction.tolist(),
        "stiffness": k,
        "damping": c,
        "rest_length": rest,
    }

    def act(t):
        theta, omega, _ = angle.at(t)
        u, lever = turned(theta, direction), turned(theta, on_rotor)
        d = (p - centre)[:, None] - lever
        stretching = -omega * dot(u, across(lever)) + omega * dot(across(u), d)
        pull = -(k * (dot(u, d) - rest) + c * stretching) * u
        return *pull, moment(p, pull)

    parts.forces.append(act)


def spring_to_a_rim(parts, rng, force, name, angle):
    """From the slider to a point of a rotor, with a rest length and a damper perhaps."""
    centre, p = np.array([-0.3, rng.uniform(-0.1, 0.1)]), drawn_point(parts, rng)
    nearest = 10 ** rng.uniform(
        -3, -0.3
    )  # part of the distance of the centres that is left where the points pass each other
    radius = (1 - nearest) * np.hypot(*(p - centre))
    parts.fastest = max(parts.fastest, 4 * angle.fastest / nearest)
    rim, rest = radius * turned(rng.uniform(0, 6), (1.0, 0.0)), rng.uniform(0.05, 0.3)
    k = force / 0.3 * rng.uniform(0.5, 1)
    c = rng.choice([0.0, 0.2 * k / angle.fastest])
    add_rotor(parts, name, angle, "ground", centre)
    parts.tables["springs"][f"{name}-spring"] = {
        "type": "linear",
        "bodies": ["s", name],
        "points": [p.tolist(), rim.tolist()],
        "stiffness": k,
        "damping": c,
        "rest_length": rest,
    }

    def act(t):
        theta, omega, _ = angle.at(t)
        lever = turned(theta, rim)
        pull = between_points((p - centre)[:, None] - lever, -omega * across(lever), k, c, rest)
        return *pull, moment(p, pull)

    parts.forces.append(act)


def between_points(d, rate, k, c, rest):
    """Force on the point at the end of d, of a spring and a damper along d."""
    distance = np.hypot(*d)
    return -(k * (distance - rest) + c * dot(d, rate) / distance) * d / distance


def load_on_a_rim(parts, rng, force, name, angle):
    """A rotor with its centre on the slider, turned against the slider or the ground, and a load on its rim."""
    pin, rim = (
        drawn_point(parts, rng),
        rng.uniform(0.05, 0.3) * turned(rng.uniform(0, 6), (1.0, 0.0)),
    )
    load, mass = (
        force * rng.uniform(0.3, 1) * turned(rng.uniform(0, 6), (1.0, 0.0)),
        rng.uniform(0.1, 1),
    )
    on_slider = parts.length is not None and rng.integers(0, 2) == 1
    add_rotor(parts, name, angle, "s", pin, mass, motor="s" if on_slider else "ground")
    parts.tables["forces"][f"{name}-load"] = {
        "type": "force",
        "body": name,
        "point": rim.tolist(),
        "direction": load.tolist(),
        "law": {"type": "constant", "value": float(np.hypot(*load))},
    }

    def act(t):
        theta, _, alpha = angle.at(t)
        total = np.stack([load[0] + 0 * t, load[1] - mass * parts.gravity + 0 * t])
        of_motor = 0.01 * alpha - moment(turned(theta, rim), load)
        return *total, moment(pin, total) - (of_motor if on_slider else 0.0)

    parts.forces.append(act)


def unbalanced_rotor(parts, rng, force, name, angle, is_free):
    """A rotor that is pinned to the slider beside its own centre of mass, driven or free: a centrifugal force, and its weight.

    A free one is without weight, and a torque makes it faster or slower.
    """
    mass = rng.uniform(0.05, 0.5)
    eccentricity = force / (mass * angle.fastest**2)
    arm = eccentricity * turned(rng.uniform(0, 6), (1.0, 0.0))
    if is_free:
        offset, begin = rng.uniform(0, 6), angle.fastest * rng.choice([-1, 0.01, 1])
        gain = rng.choice(
            [0.0, (np.sign(begin) * angle.fastest * rng.uniform(-1, 1) - begin) / parts.t_end]
        )
        angle = Angle(
            {"type": "linear", "offset": offset, "rate": begin},
            lambda t: (offset + begin * t + 0.5 * gain * t * t, begin + gain * t, gain + 0 * t),
            angle.fastest,
        )
        parts.tables["forces"][f"{name}-torque"] = {
            "type": "torque",
            "body": name,
            "law": {"type": "constant", "value": gain * (0.01 + mass * eccentricity**2)},
        }
    add_rotor(
        parts,
        name,
        angle,
        "s",
        (0.0, 0.0),
        mass,
        tuple(arm.tolist()),
        None if is_free else "ground",
    )

    def act(t):
        theta, omega, alpha = angle.at(t)
        centre = -turned(theta, arm)
        pull = mass * (omega**2 * centre - alpha * across(centre))
        return pull[0], pull[1] - mass * parts.gravity, 0 * t

    parts.forces.append(act)


def two_rotors(parts, rng, force, name, angle):
    """A spring along an axis of a rotor on the slider, to the rim of another: three factors that turn."""
    other = even(rng.uniform(0, 6), angle.fastest * rng.uniform(-1, 1))
    centre, rim, mass = (
        np.array([-0.3, 0.1]),
        rng.uniform(0.05, 0.3) * turned(rng.uniform(0, 6), (1.0, 0.0)),
        rng.uniform(0.1, 0.5),
    )
    k, direction = force / 0.6, turned(rng.uniform(0, 6), (1.0, 0.0))
    add_rotor(parts, name, angle, "s", (0.0, 0.0), mass)
    add_rotor(parts, f"{name}-other", other, "ground", centre)
    parts.tables["springs"][f"{name}-spring"] = {
        "type": "linear",
        "bodies": [f"{name}-other", name],
        "points": [rim.tolist(), [0, 0]],
        "axis": direction.tolist(),
        "stiffness": k,
    }

    def act(t):
        u = turned(angle.at(t)[0], direction)
        pull = k * dot(u, centre[:, None] + turned(other.at(t)[0], rim)) * u
        return pull[0], pull[1] - mass * parts.gravity, 0 * t

    parts.forces.append(act)
    parts.fastest = max(parts.fastest, 3 * angle.fastest + 2 * other.fastest)


def passing_slider(parts, rng, force, name):
    """Another slider, driven evenly along its own guide past the slider; a spring between points of both."""
    beside, p = 10 ** rng.uniform(-4, -0.5) * rng.choice([-1, 1]), drawn_point(parts, rng)
    begin, speed = rng.uniform(-2, -0.2), rng.uniform(0.5, 3)
    speed *= 1 / parts.t_end
    k, rest = force / 2, rng.choice([0.0, rng.uniform(0.1, 2)])
    c = rng.uniform(0.2, 1) * force / speed if rest == 0.0 or rng.integers(0, 2) else 0.0
    if is_notch := rng.integers(0, 2) == 1:
        # a load balances the damper, but for the instant in which the damper stands across the guide
        k, rest, c = 0.01 * force, 0.0, rng.uniform(0.5, 3) * force / speed
        parts.tables["forces"][f"{name}-load"] = {
            "type": "force",
            "body": "s",
            "direction": [-1, 0],
            "law": {"type": "constant", "value": c * speed},
        }
    parts.tables["bodies"][name] = {
        "mass": 0.5,
        "inertia": 0.01,
        "position": [begin, beside],
        "velocity": [speed, 0],
    }
    parts.tables["joints"][f"{name}-guide"] = {
        "type": "translational",
        "slider": name,
        "point": [0, beside],
    }
    parts.tables["drives"][f"{name}-motor"] = {
        "type": "distance",
        "bodies": [name, "ground"],
        "axis": [1, 0],
        "law": {"type": "linear", "offset": begin, "rate": speed},
    }
    parts.tables["springs"][f"{name}-spring"] = {
        "type": "linear",
        "bodies": ["s", name],
        "points": [p.tolist(), [0, 0]],
        "stiffness": k,
        "damping": c,
        "rest_length": rest,
    }

    def act(t):
        d = np.stack([p[0] - begin - speed * t, p[1] - beside + 0 * t])
        pull = between_points(d, np.array([[-speed], [0.0]]), k, c, rest)
        return pull[0] - is_notch * c * speed, pull[1], moment(p, pull)

    parts.forces.append(act)
    parts.fastest = max(parts.fastest, 10 * speed / max(abs(p[1] - beside), 1e-5))


def drawn_point(parts, rng):
    """A point of the slider; its centre where the guide has no length, and takes any moment."""
    return rng.uniform(-0.05, 0.05, 2) * (parts.length is not None) * rng.integers(0, 2)


def drawn_ramp(rng, t_end, value, kind):
    """A load along the guide that comes to `value` N at about t_end: its law, and itself in NumPy."""
    if kind == "linear":
        return {"type": "linear", "rate": value / t_end}, lambda t: value / t_end * t
    if kind == "sine":
        f = rng.uniform(1, 2) * np.pi / 2 / t_end
        return {"type": "sine", "amplitude": value, "frequency": f}, lambda t: value * np.sin(f * t)
    times = np.array([0, *np.sort(rng.uniform(0.1, 0.9, 3)), 1.05]) * t_end
    values = value * np.array([0, *np.sort(rng.uniform(0, 1, 3)), 1.0])
    at = (
        CubicSpline(times, values, bc_type="natural")
        if kind == "cubic"
        else lambda t: np.interp(t, times, values)
    )
    return {
        "type": "table",
        "times": times.tolist(),
        "values": values.tolist(),
        "interpolation": "cubic" if kind == "cubic" else "linear",
    }, at


def draw(rng: np.random.Generator, kind: str | None = None) -> Drawn | None:
    """A random scene; None where the slider does not rest at the start, or where its truth would be too expensive."""
    kind = str(rng.choice(KINDS)) if kind is None else kind
    rate = 10 ** rng.uniform(1, 4) * rng.choice([-1, 1])
    is_steady = rng.integers(0, 2) == 1  # nothing but what turns tells that something turns
    turns = 10 ** rng.uniform(1.5 if is_steady else 0.3, 3.3)
    t_end = 2 * np.pi * turns / abs(rate) if kind != "passing" else rng.uniform(0.3, 3)
    angle = drawn_angle(
        rng, rate, t_end, "linear" if kind == "free" or is_steady else str(rng.choice(LAWS))
    )
    ramp = "linear" if is_steady else str(rng.choice(["linear", "sine", "table", "cubic"]))
    drawn = (
        _arm(rng, angle, t_end, ramp) if kind == "arm" else _level(rng, kind, angle, t_end, ramp)
    )
    drawn.turns, drawn.rtol = turns, float(10 ** rng.uniform(-12, -6))
    drawn.output_step = float(np.clip(10 ** rng.uniform(-4, 0), t_end / 2e4, t_end))
    return (
        drawn
        if drawn.fastest * t_end / (2 * np.pi) * POINTS < MOST_POINTS
        and drawn.gap(np.zeros(1))[0] > 0.01 * drawn.size
        else None
    )


def _level(rng, kind, angle, t_end, ramp_kind):
    """A slider on a level guide, with one kind of forces or two."""
    gravity = 0.0 if kind == "free" else G
    parts = _Parts(
        float(rng.uniform(0.1, 0.6)),
        rng.choice([None, float(rng.uniform(0.2, 0.6))]),
        float(rng.uniform(0.5, 3)),
        gravity,
        t_end,
    )
    press = float(rng.uniform(10, 30))
    strength = parts.mus * press * rng.uniform(0.1, 0.7)
    parts.fastest = 4 * angle.fastest
    kinds = [kind]
    if kind not in ("free", "passing") and rng.integers(0, 3) == 0:
        kinds.append(str(rng.choice(["axis", "distance", "rim", "unbalanced", "two rotors"])))
    for i, name in enumerate(kinds):
        own = (parts, rng, strength / len(kinds), f"r{i}")
        if name == "passing":
            passing_slider(*own)
            parts.fastest -= 4 * angle.fastest
        elif name in ("free", "unbalanced"):
            unbalanced_rotor(*own, angle, name == "free")
        else:
            {
                "axis": spring_along_axis,
                "distance": spring_to_a_rim,
                "rim": load_on_a_rim,
                "two rotors": two_rotors,
            }[name](*own, angle)
    law, ramp = drawn_ramp(rng, t_end, parts.mus * press * rng.uniform(0.6, 2), ramp_kind)
    tables = parts.tables
    tables["bodies"]["s"] = {"mass": parts.mass, "inertia": 0.1}
    tables["joints"]["guide"] = {
        "type": "translational",
        "slider": "s",
        "mu": 0.9 * parts.mus,
        "mus": parts.mus,
        **({"length": parts.length} if parts.length else {}),
    }
    tables["forces"]["ramp"] = {"type": "force", "body": "s", "direction": [1, 0], "law": law}
    tables["forces"]["press"] = {
        "type": "force",
        "body": "s",
        "direction": [0, -1],
        "law": {"type": "constant", "value": press},
    }

    def gap(t):
        X, Y, T = ramp(t), -press - parts.mass * gravity + 0 * t, 0 * t
        for act in parts.forces:
            x, y, m = act(t)
            X, Y, T = X + x, Y + y, T + m
        load = (
            np.abs(Y)
            if parts.length is None
            else np.maximum(np.abs(Y), 2 / parts.length * np.abs(T))
        )
        return parts.mus * load - np.abs(X)

    return Drawn(
        tuple(kinds),
        {"gravity": [0, -gravity], **tables},
        gap,
        t_end,
        parts.fastest,
        parts.mus * press,
        kind == "free",
    )


def _arm(rng, angle, t_end, ramp_kind):
    """A slider that rests on an arm, near its pivot, pressed onto it by a spring across the arm."""
    mass, mus, press, gravity = (
        float(rng.uniform(0.5, 3)),
        float(rng.uniform(0.1, 0.6)),
        float(rng.uniform(30, 80)),
        float(rng.choice([0.0, G])),
    )
    along = rng.uniform(0, 0.3) * mus * press / (mass * angle.fastest**2)
    law, ramp = drawn_ramp(rng, t_end, mus * press * rng.uniform(0.6, 2), ramp_kind)
    direction = turned(rng.uniform(0, 6), (1.0, 0.0))
    start, rate = start_of(angle)
    place = turned(start, (along, 0.0))
    tables: dict[str, Any] = {
        "gravity": [0, -gravity],
        "bodies": {
            "s": {
                "mass": mass,
                "inertia": 0.02,
                "position": place.tolist(),
                "angle": start,
                "velocity": (rate * across(place)).tolist(),
                "angular_velocity": rate,
            },
            "arm": {"mass": 1.0, "inertia": 0.05, "angle": start, "angular_velocity": rate},
        },
        "joints": {
            "guide": {
                "type": "translational",
                "slider": "s",
                "guide": "arm",
                "mu": 0.9 * mus,
                "mus": mus,
            },
            "pivot": {"type": "revolute", "bodies": ["arm", "ground"]},
        },
        "drives": {"motor": {"type": "angle", "bodies": ["arm", "ground"], "law": angle.law}},
        "springs": {
            "press": {
                "type": "linear",
                "bodies": ["s", "arm"],
                "axis": [0, 1],
                "stiffness": press / 0.1,
                "rest_length": -0.1,
            }
        },
        "forces": {
            "ramp": {"type": "force", "body": "s", "direction": direction.tolist(), "law": law}
        },
    }

    def gap(t):
        theta, omega, alpha = angle.at(t)
        u = turned(theta, (1.0, 0.0))
        load = np.stack([ramp(t) * direction[0], ramp(t) * direction[1] - mass * gravity])
        X, Y = (
            dot(u, load) + mass * omega**2 * along,
            dot(across(u), load) - press - mass * alpha * along,
        )
        return mus * np.abs(Y) - np.abs(X)

    return Drawn(("arm",), tables, gap, t_end, 4 * angle.fastest, mus * press, False)


def first_break_away(drawn: Drawn) -> tuple[float | None, bool]:
    """First time at which friction no longer holds the slider, None if it does; and whether that is clear beside rounding."""
    t = np.linspace(0, drawn.t_end, int(POINTS * (20 + drawn.fastest * drawn.t_end / (2 * np.pi))))
    g, zero = drawn.gap(t), GRAZING * drawn.size
    below = np.flatnonzero(g < 0)
    last = below[0] if len(below) else len(t) - 1
    # minima that parabolas through neighbours may bring below zero
    inner = np.flatnonzero((g[1:-1] <= g[:-2]) & (g[1:-1] <= g[2:])) + 1
    inner = inner[
        (inner <= last) & (g[inner] - np.maximum(g[inner - 1], g[inner + 1]) + g[inner] < 2 * zero)
    ]
    for i in inner:
        found = minimize_scalar(
            lambda x: float(drawn.gap(np.array([x]))[0]),
            bounds=(t[i - 1], t[i + 1]),
            method="bounded",
            options={"xatol": 1e-15},
        )
        if abs(found.fun) < zero:
            return None, False
        if found.fun < 0:
            return _zero(drawn, t[i - 1], found.x), True
    if not len(below):
        return None, abs(g[-1]) > zero
    return _zero(drawn, t[last - 1], t[last]), True


def _zero(drawn, low, high):
    return float(
        brentq(lambda x: float(drawn.gap(np.array([x]))[0]), low, high, xtol=1e-300, rtol=1e-15)
    )


@dataclass
class Verdict:
    """What a run says of a drawn scene: "right", "typed" where it ends with a reason, or "wrong", and the times expected and found."""

    word: str
    expected: float | None
    found: float | None
    termination: str


def judged(drawn: Drawn, rng: np.random.Generator) -> Verdict | None:
    """Run a drawn scene to a little behind its break-away; None where rounding decides whether it has one.

    Right is a break-away before which friction was never exceeded, and at which it is, both in parts of the forces: 1e-8, and what the
    tolerance lets a rotor that no motor turns lag behind.
    """
    expected, is_clear = first_break_away(drawn)
    if not is_clear:
        return None
    end = (
        drawn.t_end
        if expected is None
        else min(drawn.t_end, expected + rng.uniform(0.001, 3) * drawn.t_end / drawn.turns)
    )
    scene = scene_from_dict({"t_end": end, **drawn.tables}, "turning")
    run = ReferenceEngine().simulate(
        scene, rtol=drawn.rtol, output_step=min(drawn.output_step, end)
    )
    found = next(
        (event.time for event in run.events if event.kind == "slip" and event.joint == "guide"),
        None,
    )
    if found is None or expected is None:
        word = "right" if found is expected else "wrong"
        # one that ends before its time says so; one that has not seen the event does not
        word = (
            "typed"
            if run.termination != "end" and run.breakdown.time <= (expected or np.inf)
            else word
        )
        return Verdict(word, expected, found, run.termination)
    part = 1e-8 + 100 * drawn.rtol * (max(1.0, drawn.turns) if drawn.is_free else 1.0)
    until = drawn.gap(np.append(np.linspace(min(expected, found), found, 1001), found))
    return Verdict(
        "right"
        if abs(until[-1]) < part * drawn.size and until.min() > -part * drawn.size
        else "wrong",
        expected,
        found,
        run.termination,
    )
