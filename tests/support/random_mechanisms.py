"""Random mechanisms: bodies put together joint by joint with consistent starts; a generator of moderate ones, one of
extreme ones.

A moderate scene has an arm on a pin or a driven turntable or neither, frictional sliders on the ground, on the arm or
on each other, pendulums, springs, dampers, loads and perhaps a drive. Friction and levers are small (mu <= 0.2, mus <=
0.28, mu * width < length / 2), so that nearly all have one motion; where several guides carry each other the equations
may still have two solutions or none (Painleve).

An extreme scene has one to six frictional guides, on the ground, on a turning arm or on each other, and any of: pins,
pendulums, drives, springs, dampers, loads, weight; masses over eight powers of ten, sizes over six, friction from none
to far beyond what leaves a unique motion, sliders wider than long, guides on the same line, bodies at rest beside fast
ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


class SeededDice:
    """Independent uniform draws of a seed; numbers have six decimals, so that a scene prints as it is."""

    def __init__(self, seed: int | Sequence[int] | np.random.Generator):
        self._random = np.random.default_rng(seed)

    def number(self, low: float, high: float) -> float:
        return round(float(self._random.uniform(low, high)), 6)

    def integer(self, low: int, high: int) -> int:
        return int(self._random.integers(low, high + 1))

    def chance(self) -> bool:
        return bool(self._random.random() < 0.5)

    def one_of(self, options: Sequence[T]) -> T:
        return options[self.integer(0, len(options) - 1)]


def turn(angle, vector):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


class Assembly:
    """Bodies with consistent starts, joint by joint."""

    def __init__(self, gravity):
        self.raw = {
            "gravity": list(gravity),
            "bodies": {},
            "joints": {},
            "drives": {},
            "springs": {},
            "forces": {},
        }

    def place(self, name, mass, inertia, position, angle, velocity, omega):
        self.raw["bodies"][name] = {
            "mass": mass,
            "inertia": inertia,
            "position": list(position),
            "angle": angle,
            "velocity": list(velocity),
            "angular_velocity": omega,
        }

    def state(self, name):
        if name == "ground":
            return np.zeros(2), 0.0, np.zeros(2), 0.0
        body = self.raw["bodies"][name]
        return (
            np.array(body["position"]),
            body["angle"],
            np.array(body["velocity"]),
            body["angular_velocity"],
        )

    def at(self, name, point):
        """Position and velocity of a body's point."""
        x, angle, v, omega = self.state(name)
        arm = turn(angle, point)
        return x + arm, v + omega * np.array([-arm[1], arm[0]])

    def slide(self, name, guide, direction, point, angle, s, u, mass, inertia, **friction):
        """A slider at the coordinate s of a guide, with rate u."""
        d = np.array([np.cos(direction), np.sin(direction)])
        _, turned, _, omega = self.state(guide)
        x, v = self.at(guide, np.array(point) + s * d)
        self.place(name, mass, inertia, x, turned + angle, v + u * turn(turned, d), omega)
        self.raw["joints"][f"guide-{name}"] = {
            "type": "translational",
            "slider": name,
            "guide": guide,
            "direction": list(d),
            "point": list(point),
            "angle": angle,
            **friction,
        }

    def pin(self, name, base, base_point, own_point, angle, omega, mass, inertia):
        """A body pinned to another."""
        x, v = self.at(base, base_point)
        arm = turn(angle, own_point)
        self.place(
            name, mass, inertia, x - arm, angle, v - omega * np.array([-arm[1], arm[0]]), omega
        )
        self.raw["joints"][f"pin-{name}"] = {
            "type": "revolute",
            "bodies": [name, base],
            "points": [list(own_point), list(base_point)],
        }

    def repeat(self, joint: str, name: str) -> None:
        """A joint a second time: the same constraint, redundant."""
        self.raw["joints"][name] = dict(self.raw["joints"][joint])


def moderate_scene(dice: SeededDice, guides: tuple[int, int] = (1, 3)) -> dict[str, Any]:
    """The tables of a random scene with a consistent start, with from guides[0] to guides[1] frictional guides."""
    weight, downwards = dice.number(5, 12), dice.number(0, 2 * np.pi)
    a = Assembly(weight * np.array([np.cos(downwards), np.sin(downwards)]))
    bases = ["ground"]
    if dice.chance():
        omega = dice.number(-1.5, 1.5)
        a.pin(
            "arm",
            "ground",
            [dice.number(-1, 1), dice.number(-1, 1)],
            [dice.number(-0.2, 0.2), 0],
            dice.number(-3, 3),
            omega,
            dice.number(1, 4),
            dice.number(0.5, 2),
        )
        bases.append("arm")
        if dice.chance():
            a.raw["drives"]["motor"] = {
                "type": "angle",
                "bodies": ["arm", "ground"],
                "law": {"type": "linear", "offset": a.state("arm")[1], "rate": omega},
            }
    for i in range(dice.integer(*guides)):
        name, guide = f"slider-{i}", dice.one_of(bases)
        # a slider's load far beside the guide that carries it jams that one
        reach = 0.4 if guide in ("ground", "arm") else 0.1
        mu = dice.number(0.02, 0.2)
        friction = {"mu": mu}
        if dice.chance():
            friction["mus"] = round(mu * dice.number(1, 1.4), 6)
        if dice.integer(0, 3):
            friction["length"] = dice.number(0.4, 0.8)
            friction["width"] = round(dice.number(0, 0.5) * friction["length"] / 0.4, 6)
        u = dice.one_of([0.0, 0.0, 1.0]) * dice.number(-1, 1)
        a.slide(
            name,
            guide,
            dice.number(-3.1, 3.1),
            [reach * dice.number(-1, 1), reach * dice.number(-1, 1)],
            dice.number(-1, 1),
            reach * dice.number(-1, 1),
            u,
            dice.number(0.5, 3),
            dice.number(0.05, 0.3),
            **friction,
        )
        joint = a.raw["joints"][f"guide-{name}"]
        a.raw["springs"][f"spring-{i}"] = {
            "type": "linear",
            "bodies": [name, guide],
            "points": [[0, 0], joint["point"]],
            "axis": joint["direction"],
            "stiffness": dice.number(0, 60),
            "damping": dice.number(0, 2),
            "rest_length": dice.number(-0.3, 0.3),
        }
        if dice.chance():
            a.raw["forces"][f"load-{i}"] = {
                "type": "force",
                "body": name,
                "direction": [dice.number(-1, 1), 1],
                "point": [dice.number(-0.05, 0.05), 0],
                "law": {
                    "type": "sine",
                    "offset": dice.number(-5, 5),
                    "amplitude": dice.number(0, 20),
                    "frequency": dice.number(1, 9),
                    "phase": dice.number(0, 6),
                },
            }
        bases.append(name)
    sliders = [name for name in a.raw["bodies"] if name != "arm"]
    for i in range(dice.integer(0, 2)):
        base, length = dice.one_of(sliders), dice.number(0.3, 0.8)
        mass = dice.number(0.1, 0.8)
        a.pin(
            f"bob-{i}",
            base,
            [dice.number(-0.05, 0.05), 0],
            [-length, 0],
            dice.number(-3, 3),
            dice.number(-2, 2),
            mass,
            round(mass * length**2 / 3, 6),
        )
        a.raw["springs"][f"twist-{i}"] = {
            "type": "torsional",
            "bodies": [f"bob-{i}", base],
            "stiffness": dice.number(0, 3),
            "damping": dice.number(0, 0.2),
            "rest_angle": dice.number(-1, 1),
        }
    if len(sliders) > 1 and dice.chance():
        a.raw["springs"]["link"] = {
            "type": "linear",
            "bodies": sliders[:2],
            "points": [[0.1, 0], [0, 0.1]],
            "stiffness": dice.number(1, 20),
            "damping": dice.number(0, 1),
        }
    if "motor" not in a.raw["drives"] and "bob-0" in a.raw["bodies"] and dice.chance():
        base = a.raw["joints"]["pin-bob-0"]["bodies"][1]
        relative = [a.state("bob-0")[k] - a.state(base)[k] for k in (1, 3)]
        a.raw["drives"]["motor"] = {
            "type": "angle",
            "bodies": ["bob-0", base],
            "law": {
                "type": "sine",
                "offset": relative[0],
                "amplitude": relative[1] / 2.5,
                "frequency": 2.5,
            },
        }
    return a.raw


def add_constant_friction(
    raw: dict[str, Any], random: np.random.Generator, share: float = 0.7, keeps_mu: float = 1.0
) -> None:
    """Give joints of a scene dry friction with a bound of its own, larger at rest, and damping.

    `share`: the probability that a joint gets friction; 0.3 that it is damped. `keeps_mu`: the probability that a guide
    which has got a bound keeps its coefficients of friction.
    """
    for joint in raw["joints"].values():
        if random.random() < share:
            joint["friction"] = round(random.uniform(0.0, 2.0), 6)
            joint["static_friction"] = round(joint["friction"] + random.uniform(0.0, 1.0), 6)
            if random.random() > keeps_mu:
                joint.pop("mu", None)
                joint.pop("mus", None)
        if random.random() < 0.3:
            joint["damping"] = round(random.uniform(0.0, 1.0), 6)


def add_stribeck_curves(
    raw: dict[str, Any], random: np.random.Generator, share: float = 0.8
) -> None:
    """Let the friction of joints of a scene fall with the speed of slip, by speeds over two powers of ten.

    `share`: the probability that a joint with friction does. A guide without a static coefficient gets one.
    """
    for joint in raw["joints"].values():
        if ("mu" in joint or "friction" in joint) and random.random() < share:
            if "mu" in joint and "mus" not in joint:
                joint["mus"] = round(joint["mu"] * random.uniform(1, 1.5), 6)
            joint["stribeck_velocity"] = round(10 ** random.uniform(-2, 0), 6)
            joint["stribeck_shape"] = float(random.choice([1.0, 1.0, 2.0, 1.5]))


def add_friction_of_pins_under_load(
    raw: dict[str, Any], random: np.random.Generator, share: float = 0.8
) -> None:
    """Give pins of a scene dry friction by the force in them, with friction circles of up to some centimetres.

    `share`: the probability that a pin gets it.
    """
    for joint in raw["joints"].values():
        if joint["type"] == "revolute" and random.random() < share:
            joint["mu"] = round(random.uniform(0.05, 0.5), 6)
            joint["mus"] = round(joint["mu"] * random.uniform(1.0, 1.4), 6)
            joint["radius"] = round(random.uniform(0.01, 0.1), 6)


def extreme_scene(random: np.random.Generator) -> dict[str, Any]:
    """The tables of a random scene with a consistent start; not necessarily one that has a motion, or only one."""

    def chance(p: float) -> bool:
        return bool(random.random() < p)

    def between(low: float, high: float) -> float:
        return float(random.uniform(low, high))

    size, mass, rate = 10 ** between(-3, 3), 10 ** between(-2, 2), 10 ** between(-1, 2)
    spread = between(0, 3) if chance(0.3) else 0.3

    def some_mass() -> float:
        return mass * 10 ** between(-spread, spread)

    def point(reach: float) -> list[float]:
        return [size * reach * between(-1, 1), size * reach * between(-1, 1)]

    g = 0.0 if chance(0.15) else size * rate**2 * 10 ** between(-1, 1)
    down = between(0, 2 * np.pi)
    a = Assembly(g * np.array([np.cos(down), np.sin(down)]))
    bases = ["ground"]
    if chance(0.5):
        m = some_mass()
        omega = rate * between(-1, 1)
        a.pin(
            "arm",
            "ground",
            point(1),
            [0.2 * size * between(-1, 1), 0.0],
            between(-3, 3),
            omega,
            m,
            m * size**2 * between(0.1, 1),
        )
        bases.append("arm")
        if chance(0.5):
            a.raw["drives"]["motor"] = {
                "type": "angle",
                "bodies": ["arm", "ground"],
                "law": {"type": "linear", "offset": a.state("arm")[1], "rate": omega},
            }
    at_rest = chance(0.4)
    for i in range(int(random.choice([1, 2, 3, 4, 5, 6], p=[0.35, 0.25, 0.18, 0.1, 0.07, 0.05]))):
        name, m = f"slider-{i}", some_mass()
        mu = 0.0 if chance(0.05) else 10 ** between(-3, 0.3)
        friction: dict[str, Any] = {"mu": mu}
        if chance(0.6):
            friction["mus"] = mu * (10.0 if chance(0.1) else between(1, 1.5)) if chance(0.8) else mu
        if chance(0.75):
            friction["length"] = size * 10 ** between(-1, 0) * (1e-4 if chance(0.03) else 1.0)
            wide = chance(0.9)
            friction["width"] = (
                friction["length"] * (between(1, 5) if chance(0.1) else between(0, 1))
                if wide
                else 0.0
            )
        u = 0.0 if at_rest or chance(0.5) else size * rate * between(-1, 1)
        direction, angle = (0.0, 0.0) if chance(0.2) else (between(-3, 3), between(-1, 1))
        a.slide(
            name,
            str(random.choice(bases)),
            direction,
            point(0.3),
            angle,
            size * between(-0.3, 0.3),
            u,
            m,
            m * size**2 * 10 ** between(-3, 0),
            **friction,
        )
        joint = a.raw["joints"][f"guide-{name}"]
        if chance(0.06):
            a.repeat(f"guide-{name}", f"again-{name}")
        if chance(0.5):
            stiffness = m * rate**2 * 10 ** (between(4, 8) if chance(0.05) else between(-1, 2))
            a.raw["springs"][f"spring-{i}"] = {
                "type": "linear",
                "bodies": [name, joint["guide"]],
                "points": [[0, 0], joint["point"]],
                "axis": joint["direction"],
                "stiffness": stiffness,
                "damping": m * rate * between(0, 1),
                "rest_length": size * between(-0.3, 0.3),
            }
        if chance(0.6):
            force = m * size * rate**2 * 10 ** between(-1, 1.5)
            a.raw["forces"][f"load-{i}"] = {
                "type": "force",
                "body": name,
                "direction": [between(-1, 1), between(-1, 1)],
                "point": point(0.2),
                "law": {
                    "type": "sine",
                    "offset": force * between(-1, 1),
                    "amplitude": force,
                    "frequency": rate * between(0.5, 5),
                    "phase": between(0, 6),
                }
                if chance(0.7)
                else {"type": "constant", "value": force},
            }
        bases.append(name)
    sliders = [name for name in a.raw["bodies"] if name != "arm"]
    for i in range(int(random.integers(0, 3))):
        length, m = size * between(0.1, 1), some_mass()
        a.pin(
            f"bob-{i}",
            str(random.choice(sliders)),
            point(0.1),
            [-length, 0.0],
            between(-3, 3),
            rate * between(-1, 1),
            m,
            m * length**2 / 3,
        )
    if "motor" not in a.raw["drives"] and "bob-0" in a.raw["bodies"] and chance(0.4):
        base = a.raw["joints"]["pin-bob-0"]["bodies"][1]
        angle, omega = (a.state("bob-0")[k] - a.state(base)[k] for k in (1, 3))
        a.raw["drives"]["motor"] = {
            "type": "angle",
            "bodies": ["bob-0", base],
            "law": {"type": "sine", "offset": angle, "amplitude": omega / rate, "frequency": rate},
        }
    a.raw["t_end"] = 1.0 / rate
    return a.raw
