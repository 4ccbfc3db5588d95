"""Random mechanisms with several freedoms, and runs of the reference beside their motion by `enumerated_motion`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import numpy as np
from random_mechanisms import (
    SeededDice,
    add_constant_friction,
    add_friction_of_pins_under_load,
    add_stribeck_curves,
    moderate_scene,
)

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
    for name in scene.frictional_joints:
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
