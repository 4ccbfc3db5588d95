"""Random mechanisms with frictional guides that geometry locks, and near misses, whose guides can move.

A frame is a block in a guide of a host, held by a rod (a strut) that is pinned to the block and to the host: three links
and no freedom, so that the block cannot move in its guide. The host moves as it likes, or stands on the ground. Expected:

- the motion, the events and all frictions of other guides are those of the same scene without friction in locked guides;
- a locked guide has mode 0, no event, and no friction, which is inside any cone;
- momentum is balanced, and energy where nothing but weight and springs acts.

Near misses look locked: in a dead centre at the start the rows of the guide depend on those of the joints, as in a
locked frame, and in a parallelogram joints are redundant. Their guides must be found free, or driven.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fuzz.dense_mechanics import (
    Dense,
    Dice,
    NotAssembled,
    add_loads,
    assembled,
    pin,
    place_of,
    rod,
    slider_on,
    tables,
)
from stiction.reference_impl.multibody.guide_freedom import GuideFreedom, guide_freedoms
from stiction.scenes import InputError, Scene, Trajectory, scene_from_dict

T_END = 0.5
ROWS = 20
SAME_MOTION = 1e-9
"""Relative to the size, 1 m, and to the largest speed."""


@dataclass(frozen=True)
class Drawn:
    """A scene, its family, and the guides that cannot move."""

    family: str
    scene: Scene
    locked: tuple[str, ...]


def frame(dice: Dice, raw: dict, host: str, block: str) -> str:
    """A block on a guide of a host that a strut locks; returns the name of its guide."""
    slider_on(
        dice,
        raw,
        block,
        host,
        dice.number(-3, 3),
        dice.number(-0.2, 0.2),
        dice.number(-1, 1),
        dice.friction(1.0),
    )
    guide = raw["joints"][f"guide-{block}"]
    own = dice.point(0.1)
    while True:
        foot = dice.point(0.6)
        end = place_of(raw, block, own)
        way = place_of(raw, host, foot) - end
        line = place_of(raw, host, guide["direction"]) - place_of(raw, host, [0, 0])
        # neither along nor across the guide, where a small motion would be possible
        if np.hypot(*way) > 0.1 and 0.2 < abs(way @ line) / np.hypot(*way):
            break
    rod(dice, raw, f"strut-{block}", ((block, own, end), (host, foot, place_of(raw, host, foot))))
    return f"guide-{block}"


def pendulum(dice: Dice, raw: dict) -> tuple[str, dict[str, float]]:
    raw["bodies"]["arm"] = dice.body([0, 0], dice.number(-3, 3))
    raw["joints"]["pivot"] = pin("arm", "ground", dice.point(0.4), [0, 0])
    return "arm", {"arm.omega": dice.number(-2, 2)}


def standing(dice: Dice, raw: dict) -> tuple[str, dict[str, float]]:
    return "ground", {}


def four_bar(dice: Dice, raw: dict) -> tuple[str, dict[str, float]]:
    a, b = np.array([0.0, 0.0]), np.array([dice.number(0.7, 1.2), 0.0])
    top_a = a + dice.number(0.25, 0.4) * np.array(dice.unit())
    top_b = b + dice.number(0.6, 0.9) * np.array([0.0, 1.0])
    raw["bodies"]["crank"] = dice.body((a + top_a) / 2, np.arctan2(*(top_a - a)[::-1]))
    raw["joints"]["a"] = pin("crank", "ground", [-np.hypot(*(top_a - a)) / 2, 0], a)
    raw["bodies"]["rocker"] = dice.body((b + top_b) / 2, np.arctan2(*(top_b - b)[::-1]))
    raw["joints"]["b"] = pin("rocker", "ground", [-np.hypot(*(top_b - b)) / 2, 0], b)
    rod(
        dice,
        raw,
        "coupler",
        (
            ("crank", [np.hypot(*(top_a - a)) / 2, 0], top_a),
            ("rocker", [np.hypot(*(top_b - b)) / 2, 0], top_b),
        ),
    )
    if dice.chance(0.3):
        rate = dice.number(-3, 3)
        raw["drives"]["motor"] = {
            "type": "angle",
            "bodies": ["crank", "ground"],
            "law": {"type": "linear", "rate": rate},
        }
        return dice.one_of(["crank", "rocker", "coupler"]), {}
    return dice.one_of(["crank", "rocker", "coupler"]), {"crank.omega": dice.number(-3, 3)}


def sliding(dice: Dice, raw: dict) -> tuple[str, dict[str, float]]:
    """A carriage on the ground, with friction of its own now and then."""
    along = dice.number(-3, 3)
    friction = (
        {"mu": dice.number(0.02, 0.3), "length": 0.5, "width": 0.1} if dice.chance() else None
    )
    slider_on(dice, raw, "carriage", "ground", along, 0.0, dice.number(-1, 1), friction)
    raw["springs"]["back"] = {
        "type": "linear",
        "bodies": ["carriage", "ground"],
        "points": [[0, 0], dice.point(1)],
        "stiffness": dice.number(5, 60),
    }
    return "carriage", {"carriage.vx": dice.number(-1, 1)} if dice.chance(0.7) else {}


HOSTS = (pendulum, standing, four_bar, sliding)


def draw(seed: int, index: int) -> Drawn:
    """The scene of a seed and an index, with one or two locked guides."""
    dice = Dice(2, seed, index)
    while True:
        host = dice.one_of(HOSTS)
        raw = tables(dice, T_END, 0.8)
        body, rates = host(dice, raw)
        locked = [frame(dice, raw, body, "block")]
        if dice.chance(0.3):
            # a second frame, on the host or on a member of the first
            locked.append(frame(dice, raw, dice.one_of([body, "block", "strut-block"]), "other"))
        if dice.chance(0.7):
            add_loads(dice, raw, 20.0, 0.4, 0.2)
        try:
            scene = assembled(raw, rates)
        except (NotAssembled, InputError):
            continue
        dense = Dense(scene)
        sized = (jacobian := dense.equations.at(0.0, *dense.equations.start()).J) / np.linalg.norm(
            jacobian, axis=1
        )[:, None]
        if np.linalg.svd(sized, compute_uv=False)[-1] > 1e-2:
            return Drawn(host.__name__, scene, tuple(locked))


def without_friction(drawn: Drawn) -> Scene:
    """The same scene with mu = 0 in the locked guides."""
    raw = {
        **drawn.scene._raw,
        "joints": {
            name: {**joint, **({"mu": 0.0, "mus": 0.0} if name in drawn.locked else {})}
            for name, joint in drawn.scene._raw["joints"].items()
        },
    }
    return scene_from_dict(raw, drawn.scene.name)


def check(drawn: Drawn, run: Trajectory, smooth: Trajectory) -> list[str]:
    """What is wrong with the run of a scene, beside that without friction in the locked guides."""
    found, dense = [], Dense(drawn.scene)
    kinds = guide_freedoms(drawn.scene, 1.0).freedom
    found += [
        f"{name} is found {kinds[name].name}"
        for name in drawn.locked
        if kinds[name] != GuideFreedom.LOCKED
    ]
    if (run.breakdown is None) != (smooth.breakdown is None):
        return [*found, f"ends with {run.termination}; without friction with {smooth.termination}"]
    if run.breakdown is not None:
        return found
    for name in drawn.locked:
        if np.any(run[f"{name}.mode"]) or np.any(run[f"{name}.friction"]):
            found.append(
                f"{name}: modes {set(run[f'{name}.mode'].tolist())}, friction up to {np.max(np.abs(run[f'{name}.friction'])):.3g} N"
            )
        if events := [event for event in run.events if event.joint == name]:
            found.append(
                f"{name}: {len(events)} events, the first {events[0].kind} at {events[0].time:.6g} s"
            )
    (q, v), (q0, v0) = dense.states(run), dense.states(smooth)
    error = max(np.max(np.abs(q - q0)), np.max(np.abs(v - v0)) / max(1.0, np.max(np.abs(v0))))
    if not error <= SAME_MOTION:
        found.append(f"motion off by {error:.2g}")
    if [(event.kind, event.joint) for event in run.events] != [
        (event.kind, event.joint) for event in smooth.events
    ]:
        found.append(f"{len(run.events)} events, {len(smooth.events)} without friction")
    elif any(abs(a.time - b.time) > SAME_MOTION for a, b in zip(run.events, smooth.events)):
        found.append("events at other times than without friction")
    if not (residual := dense.balance(run.t, run)) < 1e-9:
        found.append(f"momentum is not balanced: {residual:.2g}")
    if not (drift := energy_drift(drawn.scene, q, v)) < 1e-7:
        found.append(f"energy changes by {drift:.2g} of itself")
    return found


def energy_drift(scene: Scene, q: np.ndarray, v: np.ndarray) -> float:
    """Change of kinetic and potential energy relative to the largest kinetic one and its changes; 0 where it is not kept."""
    if (
        scene.drives
        or scene.forces
        or any(spring.damping or spring.type == "torsional" for spring in scene.springs.values())
        or any(guide.mu and name.endswith("carriage") for name, guide in scene.guides.items())
    ):
        return 0.0
    equations = Dense(scene).equations
    gravity = np.resize([*(scene.gravity or (0.0, 0.0)), 0.0], len(equations.mass))
    kinetic = 0.5 * np.sum(equations.mass * v**2, -1)
    potential = -np.sum(equations.mass * gravity * q, -1)
    for spring in scene.springs.values():
        ends = []
        for body, point in zip(spring.bodies, spring.points):
            if body == "ground":
                ends.append(np.zeros((len(q), 2)) + point)
                continue
            i = 3 * list(scene.bodies).index(body)
            c, s = np.cos(q[:, i + 2]), np.sin(q[:, i + 2])
            ends.append(
                q[:, i : i + 2]
                + np.stack([c * point[0] - s * point[1], s * point[0] + c * point[1]], -1)
            )
        potential += (
            0.5 * spring.stiffness * (np.hypot(*(ends[0] - ends[1]).T) - spring.rest_length) ** 2
        )
    size = np.max(kinetic) + np.ptp(potential)
    return float(np.ptp(kinetic + potential) / size) if size > 1e-12 else 0.0


def near_miss(seed: int, index: int) -> tuple[str, Scene, GuideFreedom]:
    """A scene whose guide looks locked and is not: its family, and what its guide must be found to be."""
    dice = Dice(3, seed, index)
    while True:
        raw = tables(dice, 0.05, 0.8)
        body, rates = dice.one_of([pendulum, standing])(dice, raw)
        family = dice.one_of(
            ["dead centre", "parallelogram", "nearly locked", "driven dead centre"]
        )
        along = dice.number(-3, 3)
        slider_on(dice, raw, "block", body, along, 0.0, dice.number(-1, 1), dice.friction(0.3))
        raw["joints"]["guide-block"]["slider_point"] = [0.0, 0.0]
        line = raw["joints"]["guide-block"]
        start, direction = np.array(line["point"]), np.array(line["direction"])
        raw["bodies"]["block"]["position"] = place_of(raw, body, start).tolist()

        def on_host(
            along: float, across: float = 0.0, start=start, direction=direction
        ) -> list[float]:
            return (
                start + along * direction + across * np.array([-direction[1], direction[0]])
            ).tolist()

        def link(
            name: str,
            one: str,
            at_one: list[float],
            two: str,
            at_two: list[float],
            raw=raw,
            dice=dice,
        ) -> float:
            a, b = place_of(raw, one, at_one), place_of(raw, two, at_two)
            rod(dice, raw, name, ((one, at_one, a), (two, at_two, b)))
            return float(np.hypot(*(b - a)) / 2)

        r, length = dice.number(0.1, 0.3), dice.number(0.4, 0.9)
        if "dead" in family:
            # block, connecting rod and crank on one line, stretched
            crank = place_of(raw, body, on_host(length + r)), place_of(raw, body, on_host(length))
            middle, way = (crank[0] + crank[1]) / 2, crank[1] - crank[0]
            raw["bodies"]["crank"] = dice.body(middle, np.arctan2(*way[::-1]))
            raw["joints"]["base"] = pin("crank", body, [-r / 2, 0], on_host(length + r))
            link("rod", "block", [0.0, 0.0], "crank", [r / 2, 0])
            rates["crank.omega"] = dice.number(0.5, 3)
            if family.startswith("driven"):
                raw["drives"]["motor"] = {
                    "type": "angle",
                    "bodies": ["crank", body],
                    "law": {"type": "linear", "rate": 1.5},
                }
        elif family == "parallelogram":
            # a platform on three equal cranks, redundant, moves the block by a rod
            turn = dice.number(0.6, 2.5)
            arm = r * np.array([np.cos(turn), np.sin(turn)])
            feet = [on_host(length + x, -0.2) for x in (0.0, 0.3, 0.7)]
            tops = [(np.array(foot) + arm).tolist() for foot in feet]
            places = [place_of(raw, body, top) for top in tops]
            raw["bodies"]["platform"] = dice.body(
                places[0], np.arctan2(*(places[2] - places[0])[::-1])
            )
            for k, foot in enumerate(feet):
                link(
                    f"leg-{k}",
                    body,
                    foot,
                    "platform",
                    [float(np.hypot(*(places[k] - places[0]))), 0.0],
                )
            link("rod", "block", [0.0, 0.0], "platform", [0.0, 0.0])
        else:
            # two links, a thousandth longer than the way between their ends, in place of a strut
            a, b = np.array([0.0, 0.0]), np.array(dice.unit()) * length
            foot = (start + b).tolist()
            knee = 0.4 * b + 0.03 * np.array(
                [-b[1], b[0]]
            )  # (1 + 0.03^2 (1/.4 + 1/.6) / 2 ..): a thousandth and a half
            raw["bodies"]["knee"] = dice.body(
                place_of(raw, body, (start + (a + knee) / 2).tolist()), 0.0
            )
            host_angle = 0.0 if body == "ground" else raw["bodies"][body]["angle"]
            raw["bodies"]["knee"]["angle"] = float(host_angle + np.arctan2(*knee[::-1]))
            half = float(np.hypot(*knee) / 2)
            raw["joints"]["hip"] = pin("knee", "block", [-half, 0], [0, 0])
            link("shin", "knee", [half, 0], body, foot)
        wanted = GuideFreedom.DRIVEN if "motor" in raw["drives"] else GuideFreedom.FREE
        try:
            return family, assembled(raw, rates), wanted
        except (NotAssembled, InputError):
            continue
