"""Shifts that a scene's conditions call invariant leave forces, accelerations and constraints as they are, in the reference's equations."""

import numpy as np
import pytest

from stiction.comparisons.measures.invariant_shifts import invariant_shifts
from stiction.reference_impl.integration.event_driven import Integration
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism, workspace
from stiction.scenes import scene_from_dict

SIZE = 1.0


def train(random):
    """Up to four bodies on rails of the ground and on each other, with pendulums, springs, drives and loads of all kinds.

    One direction is that of most rails, so that many of the mechanisms move on as one.
    """
    way = random.uniform(0, 2 * np.pi) if random.random() < 0.5 else 0.0
    scene = {
        "t_end": 1,
        "gravity": [0, -9.81],
        "bodies": {},
        "joints": {},
        "drives": {},
        "springs": {},
        "forces": {},
    }
    rates, angles = {"ground": np.zeros(2)}, {"ground": 0.0}
    for number in range(random.integers(1, 5)):
        name, place = f"b{number}", random.uniform(-1, 1, 2)
        on = str(random.choice(list(angles))) if random.random() < 0.4 else "ground"
        angle = angles[on] + random.choice([0.0, 0.3])
        turned = way if random.random() < 0.85 else random.uniform(0, 2 * np.pi)
        along = np.array([np.cos(turned), np.sin(turned)])
        own = np.array(
            [[np.cos(angles[on]), np.sin(angles[on])], [-np.sin(angles[on]), np.cos(angles[on])]]
        )  # into the axes of `on`
        origin = np.zeros(2) if on == "ground" else np.array(scene["bodies"][on]["position"])
        rate = random.choice([0.0, 0.3]) if random.random() < 0.5 else None
        guide = {
            "type": "translational",
            "slider": name,
            "guide": on,
            "direction": (own @ along).tolist(),
            "point": (own @ (place - origin)).tolist(),
            "angle": angle - angles[on],
        }
        if random.random() < 0.5:
            guide |= {"mu": 0.2, "mus": 0.3}
            if random.random() < 0.3:
                guide |= {"length": 0.4, "width": 0.1}
        velocity = rates[on] + along * (random.uniform(-1, 1) if rate is None else rate)
        scene["bodies"][name] = {
            "mass": random.uniform(0.5, 2),
            "inertia": 0.3,
            "position": place.tolist(),
            "angle": angle,
            "velocity": velocity.tolist(),
        }
        scene["joints"][f"g{number}"] = guide
        if rate is not None:
            scene["drives"][f"d{number}"] = {
                "type": "distance",
                "bodies": [name, on],
                "axis": guide["direction"],
                "law": {"type": "linear", "offset": float(along @ (place - origin)), "rate": rate},
            }
        rates[name], angles[name] = velocity, angle
    names = list(scene["bodies"])
    if random.random() < 0.4:  # a pendulum, which turns
        on = str(random.choice(names))
        scene["bodies"]["bob"] = {
            "mass": 1,
            "inertia": 0.1,
            "angle": 0.4,
            "velocity": scene["bodies"][on]["velocity"],
            "position": (
                np.array(scene["bodies"][on]["position"])
                + 0.5 * np.array([np.sin(0.4), -np.cos(0.4)])
            ).tolist(),
        }
        scene["joints"]["pin"] = {
            "type": "revolute",
            "bodies": ["bob", on],
            "points": [[0, 0.5], [0, 0]],
        }
        names.append("bob")
    if random.random() < 0.3:  # a wheel, which turns about its centre
        on = str(random.choice(names[:-1] or names))
        scene["bodies"]["wheel"] = {
            "mass": 1,
            "inertia": 0.1,
            "velocity": scene["bodies"][on]["velocity"],
            "position": scene["bodies"][on]["position"],
        }
        scene["joints"]["axle"] = {"type": "revolute", "bodies": ["wheel", on]}
        if random.random() < 0.5:
            scene["springs"]["twist"] = {
                "type": "torsional",
                "bodies": ["wheel", on],
                "damping": 0.1,
                "stiffness": random.choice([0.0, 2.0]),
            }
    for number in range(random.integers(0, 4)):
        pair = random.choice([*names, "ground"], 2, replace=False).tolist()
        spring = {
            "type": "linear",
            "bodies": pair,
            "stiffness": random.choice([0.0, 20.0]),
            "damping": random.choice([0.0, 1.5]),
            "rest_length": 0.1,
            "points": random.choice([0.0, 0.2]) * random.uniform(-1, 1, (2, 2)),
        }
        spring["points"] = spring["points"].tolist()
        if random.random() < 0.7:
            turned = way + random.choice([0.0, np.pi / 2, 0.7]) - angles.get(pair[1], 0.0)
            spring["axis"] = [np.cos(turned), np.sin(turned)]
        scene["springs"][f"s{number}"] = spring
    for number in range(random.integers(0, 3)):
        scene["forces"][f"f{number}"] = {
            "type": "force",
            "body": str(random.choice(names)),
            "direction": random.uniform(-1, 1, 2).tolist(),
            "point": random.uniform(-0.2, 0.2, 2).tolist(),
            "law": {"type": "constant", "value": 2.0},
        }
    return scene_from_dict(scene, "train")


def generators(shifts):
    """Invariant shifts with their times, (shifts, positions + 1): the null space of the conditions; of length 1 m or s."""
    matrix = np.column_stack([shifts.rows, -shifts.rates])
    matrix = np.vstack([matrix, np.zeros((max(0, matrix.shape[1] - len(matrix)), matrix.shape[1]))])
    _, sizes, directions = np.linalg.svd(matrix)
    return directions[sizes < 1e-9]


def forces(integration, mechanism, t, q, v):
    """Accelerations, event functions, efforts, and residuals of what is held in position and velocity."""
    held = workspace(mechanism.arrays)
    row_form(mechanism.arrays, held, t, q, v)
    efforts = [row for row, name in enumerate(mechanism.row_names) if name.endswith(".effort")]
    accelerations, events, rows = integration.forces_at(t, q, v)
    return np.concatenate([accelerations, events, rows[efforts], held.phi, held.phi_dot])


@pytest.mark.parametrize("seed", range(60))
def test_an_invariant_shift_leaves_forces_as_they_are(seed, compiled):
    random = np.random.default_rng(seed)
    scene = train(random)
    mechanism = Mechanism(scene, "projection")
    q, v = consistent_start(mechanism)
    integration = Integration(mechanism, q, v, np.zeros(1), 1.0, 1e-6)
    shifts = invariant_shifts(scene, SIZE)
    here = forces(integration, mechanism, 0.0, q, v)
    assert np.all(np.isfinite(here))
    for shift in generators(shifts):
        there = forces(integration, mechanism, 3 * shift[-1], q + 3 * shift[:-1], v)
        np.testing.assert_allclose(there, here, rtol=0, atol=1e-9 * max(1.0, np.max(np.abs(here))))


def test_most_of_the_mechanisms_move_on_together():
    """Or the test above would be of nothing."""
    counts = [
        len(generators(invariant_shifts(train(np.random.default_rng(seed)), SIZE)))
        for seed in range(60)
    ]
    assert np.mean(np.array(counts) > 0) > 0.3


PULLED = {
    "bodies": {name: {"mass": 1, "inertia": 1, "velocity": [0.1, 0]} for name in ("block", "hand")},
    "joints": {
        "floor": {"type": "translational", "slider": "block", "mu": 0.3},
        "track": {"type": "translational", "slider": "hand"},
    },
    "drives": {
        "pull": {
            "type": "distance",
            "bodies": ["hand", "ground"],
            "axis": [1, 0],
            "law": {"type": "linear", "rate": 0.1},
        }
    },
    "springs": {
        "spring": {"type": "linear", "bodies": ["block", "hand"], "axis": [1, 0], "stiffness": 5}
    },
}


def pulled(**springs):
    return scene_from_dict(PULLED | {"springs": PULLED["springs"] | springs}, "pulled")


def test_block_and_hand_move_on_together():
    """By the hand's way, and in no other way; a spring to the ground ends that, a damper does not."""
    [shift] = generators(invariant_shifts(pulled(), SIZE))
    np.testing.assert_allclose(shift / shift[-1], [0.1, 0, 0, 0.1, 0, 0, 1], atol=1e-12)
    to_ground = {"type": "linear", "bodies": ["block", "ground"], "axis": [1, 0]}
    assert (
        len(generators(invariant_shifts(pulled(wall={**to_ground, "stiffness": 1e-3}), SIZE))) == 0
    )
    assert len(generators(invariant_shifts(pulled(oil={**to_ground, "damping": 1}), SIZE))) == 1


def test_the_nearest_shift_is_the_exact_one():
    shifts = invariant_shifts(pulled(), SIZE)
    change = np.array([0.2 + 3e-6, 1e-7, 1e-7, 0.2 - 1e-6, 0, -1e-7])
    nearest = shifts.nearest(2.0, change, np.ones(6))
    np.testing.assert_allclose(nearest, [0.2, 0, 0, 0.2, 0, 0], atol=1e-12)
