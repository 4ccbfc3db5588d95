"""Random mechanisms with several freedoms, and runs of the reference beside their motion by `enumerated_motion`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from typing import Any

import numpy as np
from random_mechanisms import (
    SeededDice,
    add_constant_friction,
    add_friction_of_pins_under_load,
    add_stribeck_curves,
    moderate_scene,
)

from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.scenes import Scene, Trajectory, scene_from_dict
from stiction.truths.enumerated_motion import TOLERANCE, Motion

RESERVE = 1e3
"""How much larger than the tolerance of a step the error of a motion may be: a hundred steps, amplified by ten."""


def random_scene(seed: int, i: int, guides: tuple[int, int] = (2, 3)) -> Scene:
    """Scene i of a seed: moderate, with two or three frictional guides."""
    return scene_from_dict(
        moderate_scene(SeededDice((seed, i)), guides), f"random scene {i} of seed {seed}"
    )


def scene_with_constant_bounds(seed: int, i: int) -> Scene:
    """Scene i of a seed with friction of constant bounds in pins and guides, and damping in some of these.

    In a third of the scenes no friction depends on a load, in a third guides have both kinds.
    """
    raw = moderate_scene(SeededDice((seed, i)), (1, 2))
    keeps_mu = (0.0, 0.5, 1.0)[i % 3]
    share = 1.0 if keeps_mu == 0.0 else 0.7
    add_constant_friction(raw, np.random.default_rng((seed, i)), share, keeps_mu)
    return scene_from_dict(raw, f"random scene {i} of seed {seed} with constant bounds")


def scene_with_limited_drives(seed: int, i: int) -> Scene:
    """Scene i of a seed with one or two drives of limited effort, and friction in some pins.

    The drives of the moderate scene get a limit. Others are added: to a pin by an angle, to a guide by the coordinate
    along its axis or by the distance of a point of its guide. Half of these begin at the rate of their law.
    """
    dice = SeededDice((seed, i))
    raw = moderate_scene(dice, (1, 2))
    random = np.random.default_rng((seed, i))
    if random.random() < 0.5:
        add_constant_friction(raw, random, 0.5, 0.5)
    for drive in raw["drives"].values():
        drive["effort_limit"] = dice.number(0.2, 5.0)
    joints = list(raw["joints"])
    for k in range(dice.integer(1, 2)):
        name = dice.one_of(joints)
        raw["drives"][f"limited-{k}"] = _limited_drive(raw, dice, raw["joints"][name])
    return scene_from_dict(raw, f"random scene {i} of seed {seed} with limited drives")


def scene_with_one_sided_springs(seed: int, i: int) -> Scene:
    """Scene i of a seed whose springs act on one side only, some with damping, and more of these.

    The springs of the moderate scene push or pull, or are left as they are. Each slider gets a stop on its guide, each
    pin a stop of its angle, now and then a slider a cable to the ground.
    """
    dice = SeededDice((seed, i))
    raw = moderate_scene(dice, (1, 2))
    random = np.random.default_rng((seed, i))
    if random.random() < 0.5:
        add_constant_friction(raw, random, 0.5, 0.5)
    for spring in raw["springs"].values():
        side = dice.one_of(["push", "pull", None])
        if side is not None and (side == "pull" or "axis" in spring or spring["type"] != "linear"):
            spring["acts"] = side
    for name, joint in list(raw["joints"].items()):
        stop: dict[str, Any] = {"acts": dice.one_of(["push", "pull"])}
        stop["damping"] = dice.one_of([0.0, dice.number(0.0, 3.0)])
        if joint["type"] == "revolute":
            bodies = joint["bodies"]
            angles = [raw["bodies"][body]["angle"] if body != "ground" else 0.0 for body in bodies]
            stop |= {"type": "torsional", "bodies": bodies, "stiffness": dice.number(2.0, 60.0)}
            stop["rest_angle"] = round(angles[0] - angles[1] + dice.number(-0.3, 0.3), 6)
        else:
            bodies = [joint["slider"], joint["guide"]]
            stop |= {"type": "linear", "bodies": bodies, "points": [[0.0, 0.0], joint["point"]]}
            stop |= {"axis": joint["direction"], "stiffness": dice.number(50.0, 2000.0)}
            stop["rest_length"] = dice.number(-0.4, 0.4)
        raw["springs"][f"stop-{name}"] = stop
    if dice.chance():
        slider = next(body for body in raw["bodies"] if body != "arm")
        anchor = [dice.number(-1.0, 1.0), dice.number(-1.0, 1.0)]
        way = np.array(raw["bodies"][slider]["position"]) - anchor
        raw["springs"]["cable"] = {
            "type": "linear",
            "bodies": [slider, "ground"],
            "points": [[dice.number(-0.1, 0.1), 0.0], anchor],
            "stiffness": dice.number(20.0, 500.0),
            "damping": dice.one_of([0.0, 1.0]),
            "rest_length": round(float(np.hypot(*way)) * dice.number(0.9, 1.1) + 0.05, 6),
            "acts": "pull",
        }
    return scene_from_dict(raw, f"random scene {i} of seed {seed} with one-sided springs")


def _limited_drive(raw: dict[str, Any], dice: SeededDice, joint: dict[str, Any]) -> dict[str, Any]:
    """Draw a drive with a limit of the coordinate that a joint leaves free."""
    drive: dict[str, Any]
    if joint["type"] == "revolute":
        drive = {"type": "angle", "bodies": joint["bodies"]}
        limit = dice.number(0.1, 4.0)
    else:
        # a point of the guide that the slider does not come near, or the axis of the guide
        across = np.array([-joint["direction"][1], joint["direction"][0]])
        drive = {"type": "distance", "bodies": [joint["slider"], joint["guide"]]}
        drive["points"] = [[0.0, 0.0], list(np.array(joint["point"]) + 0.6 * across)]
        if dice.chance():
            drive["axis"] = joint["direction"]
        limit = dice.number(1.0, 20.0)
    drive["effort_limit"] = limit

    # The rate that the coordinate has at the start, which half of the laws begin with unless it is zero: a drive that
    # rests beside a guide at rest shares its load, which the second method refuses.
    drive["law"] = {"type": "constant", "value": 0.0}
    equations = EquationsOfMotion(scene_from_dict({**raw, "drives": {"probe": drive}}))
    rate = float(equations.at(0.0, *equations.start()).slip_speed[-1])
    if dice.chance() or abs(rate) < 1e-9:
        rate = dice.number(-1.5, 1.5)
    if dice.chance():
        drive["law"] = {"type": "linear", "offset": dice.number(-1, 1), "rate": rate}
    else:
        frequency, phase = dice.number(2, 9), dice.number(-1, 1)
        drive["law"] = {
            "type": "sine",
            "amplitude": rate / (frequency * np.cos(phase)),
            "frequency": frequency,
            "phase": phase,
        }
    return drive


def scene_with_stribeck_curves(seed: int, i: int) -> Scene:
    """Scene i of a seed whose friction falls with the speed of slip; in every second one of joints with constant bounds."""
    raw = moderate_scene(SeededDice((seed, i)), (1, 2))
    random = np.random.default_rng((seed, i))
    if i % 2:
        keeps_mu = (0.0, 0.5, 1.0)[i % 3]
        add_constant_friction(raw, random, 1.0 if keeps_mu == 0.0 else 0.7, keeps_mu)
    add_stribeck_curves(raw, random)
    return scene_from_dict(raw, f"random scene {i} of seed {seed} with Stribeck's curves")


def scene_with_pins_under_load(seed: int, i: int) -> Scene:
    """Scene i of a seed, with a pin at least, and friction of pins by the forces in them.

    In every second scene joints have friction with constant bounds too, and in every third friction falls with speed.
    """
    for attempt in count():
        raw = moderate_scene(SeededDice((seed, i, attempt)), (1, 2))
        if any(joint["type"] == "revolute" for joint in raw["joints"].values()):
            break
    random = np.random.default_rng((seed, i))
    if i % 2:
        add_constant_friction(raw, random, 0.5)
    add_friction_of_pins_under_load(raw, random)
    if i % 3 == 0:
        add_stribeck_curves(raw, random)
    return scene_from_dict(raw, f"random scene {i} of seed {seed} with pins under load")


def differences(scene: Scene, motion: Motion, run: Trajectory, rtol: float) -> list[str]:
    """Events and end state in which a run of the reference, of tolerance `rtol`, is another than the second method's
    motion.

    Margins and states may differ by RESERVE times the larger tolerance, relative to the largest force or coordinate; an
    event may be shifted by what such a difference of its margin shifts it. Where one of both stops, they are compared
    until then.
    """
    tolerance = RESERVE * max(rtol, TOLERANCE)
    stopped = [found.time for found in (run.breakdown, motion.breakdown) if found is not None]
    until = min(stopped) - 1e3 * tolerance if stopped else np.inf
    found = list(_event_differences(scene, motion, run, tolerance, until))
    if stopped:
        return found
    size = max(1.0, np.max(np.abs(motion.q)), np.max(np.abs(motion.v)))
    for body, q, v in zip(scene.bodies, motion.q[-1].reshape(-1, 3), motion.v[-1].reshape(-1, 3)):
        for label, value in zip(("x", "y", "angle", "vx", "vy", "omega"), (*q, *v)):
            error = abs(run[f"{body}.{label}"][-1] - value)
            if not error <= tolerance * size:
                found.append(f"{body}.{label} at the end differs by {error:.2g}")
    return found


def _event_differences(
    scene: Scene, motion: Motion, run: Trajectory, tolerance: float, until: float
) -> Iterator[str]:
    """What differs in the events of each guide before `until`, in order."""
    for name in [*scene.bounded_elements, *scene.one_sided_springs]:
        expected = [event for event in motion.events if event.joint == name and event.time < until]
        found = [event for event in run.events if event.joint == name and event.time < until]
        for mine, its in zip(expected, found):
            window = tolerance * max(1.0, motion.force) / mine.rate
            if mine.kind != its.kind or not abs(mine.time - its.time) <= window:
                expectation = f"{mine.kind} at {mine.time:.9g} s within {window:.1g} s"
                yield f"{name}: {its.kind} at {its.time:.9g} s, expected {expectation}"
                break
        else:
            for event in expected[len(found) :]:
                yield f"{name}: no {event.kind} at {event.time:.9g} s"
            for event in found[len(expected) :]:
                yield f"{name}: {event.kind} at {event.time:.9g} s that is none"
