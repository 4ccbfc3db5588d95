"""The truths' own equations of motion beside those of the reference, which are another derivation."""

import numpy as np
import pytest
from random_mechanisms import (
    SeededDice,
    add_constant_friction,
    extreme_scene,
    moderate_scene,
)

from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.scenes import load_scene, scene_from_dict
from stiction.truths.dense_equations import DenseEquations

TERMS = {"QE": "Q"} | {
    name: name for name in ("phi", "phi_dot", "gamma", "J", "W", "w", "slip_speed")
}


def largest_difference(scene, rng):
    """Of any term at three instants, anywhere near the start, relative to the largest of its kind."""
    theirs, mine = EquationsOfMotion(scene), DenseEquations(scene)
    q, v = mine.start()
    np.testing.assert_array_equal((q, v), theirs.start())
    np.testing.assert_array_equal(mine.mass, theirs.mass)
    first = {name: "normal_force" if name in scene.guides else "fx" for name in mine.frictional}
    assert mine.first_row == [theirs.rows.index(f"{name}.{row}") for name, row in first.items()]
    assert mine.pins == {
        row.removesuffix(".fx"): i for i, row in enumerate(theirs.rows) if row.endswith(".fx")
    }
    size = np.max(np.abs(q)) + 0.1
    t = np.array([0.1, 0.2, 0.7])
    q = q + 0.1 * size * rng.normal(size=(3, len(q)))
    v = v + (np.max(np.abs(v)) + 0.1) * rng.normal(size=(3, len(v)))
    many, true = mine.at(t, q, v), theirs.at(t, q, v)
    one = mine.at(t[1], q[1], v[1])
    errors = [0.0]
    for their_name, name in TERMS.items():
        expected, found = getattr(true, their_name), getattr(many, name)
        assert found.shape == expected.shape
        np.testing.assert_allclose(getattr(one, name), found[1], rtol=1e-12, atol=1e-12 * size)
        if expected.size:
            errors.append(np.max(np.abs(found - expected)) / (np.max(np.abs(expected)) + 1e-300))
    return max(errors)


@pytest.mark.parametrize(
    "name",
    [
        "slider-bar-case-1",
        "four-bar",
        "slider-crank",
        "elliptic-trammel",
        "slider-on-moving-guide",
        "mass-on-belt",
        "coulomb-oscillator",
        "pendulum",
        "hard/oblique-trammel-comes-to-rest",
    ],
)
def test_scenes_of_the_catalogue(name):
    assert largest_difference(load_scene(name), np.random.default_rng(1)) < 1e-13


@pytest.mark.parametrize("i", range(20))
def test_random_scenes(i):
    rng = np.random.default_rng([2, i])
    raw = moderate_scene(SeededDice((5, i)))
    assert largest_difference(scene_from_dict(raw), rng) < 1e-13
    add_constant_friction(raw, rng)
    assert largest_difference(scene_from_dict(raw), rng) < 1e-13
    assert largest_difference(scene_from_dict(extreme_scene(rng)), rng) < 1e-13


@pytest.mark.parametrize("axis", [None, [0.6, 0.8]])
@pytest.mark.parametrize("kind", ["springs", "drives"])
def test_distances_and_angles(kind, axis):
    """Between two free bodies: along the line of two points, or an axis that turns; a twist; loads of both kinds."""
    along = {} if axis is None else {"axis": axis}
    ends = {"bodies": ["one", "other"], "points": [[0.1, 0.2], [-0.3, 0.1]]}
    q = {"one": ([0.2, 1.5], 0.4), "other": ([-0.7, 0.3], -1.1)}
    places = []
    for body, point in zip(ends["bodies"], ends["points"]):
        (x, y), angle = q[body]
        places.append(complex(x, y) + complex(*point) * np.exp(1j * angle))
    between = places[0] - places[1]
    turned = complex(*(axis or [0, 0])) * np.exp(1j * q["other"][1])
    length = abs(between) if axis is None else (np.conj(turned) * between).real
    elements = {
        "springs": {
            "straight": {"type": "linear", **ends, **along, "stiffness": 3, "damping": 0.7, "rest_length": 0.4},
            "twist": {"type": "torsional", "bodies": ["other", "one"], "stiffness": 2, "damping": 0.1, "rest_angle": 0.3},
        },
        "drives": {
            "straight": {"type": "distance", **ends, **along, "law": {"type": "sine", "offset": length, "amplitude": 0.1, "frequency": 2}},
            "twist": {"type": "angle", "bodies": ["other", "one"], "law": {"type": "linear", "offset": -1.5, "rate": 0.2}},
        },
    }  # fmt: skip
    bodies = {
        name: {"mass": 1.5, "inertia": 0.2, "position": place, "angle": angle}
        for name, (place, angle) in q.items()
    }
    forces = {
        "push": {"type": "force", "body": "one", "point": [0.2, -0.1], "direction": [3, -4], "law": {"type": "sine", "amplitude": 2, "frequency": 5}},
        "turn": {"type": "torque", "body": "other", "law": {"type": "constant", "value": 0.7}},
    }  # fmt: skip
    raw = {"gravity": [1.0, -9.81], "bodies": bodies, "forces": forces, kind: elements[kind]}
    if kind == "drives":  # a start that the laws allow
        rate = 0.1 * 2
        direction = between / length if axis is None else turned
        bodies["one"]["velocity"] = [rate * direction.real, rate * direction.imag]
        bodies["other"]["angular_velocity"] = 0.0
        raw[kind]["twist"]["law"] = {"type": "constant", "value": -1.5}
    scene = scene_from_dict(raw)
    assert largest_difference(scene, np.random.default_rng(3)) < 1e-13
