"""A scene becomes a mechanism once in a run: for the engine, its adapter and the gate."""

import numpy as np
import pytest
from conftest import installed
from mechanism_families import sprung_chain

from stiction.engines.assembly import Assembly, assembly_of
from stiction.engines.registry import ENGINES
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import load_scene, scene_from_dict, vary

SCENE = "slider-bar-case-1-mus-equals-mu"
WITH_ACCELERATIONS = ("pybullet", "mujoco", "drake", "dart")


@pytest.fixture
def made(monkeypatch):
    """Scenes of which mechanisms were made, in their order."""
    scenes, make = [], Mechanism.__init__

    def noting(self, scene, *others, **named):
        scenes.append(scene)
        make(self, scene, *others, **named)

    monkeypatch.setattr(Mechanism, "__init__", noting)
    return scenes


@pytest.mark.parametrize("name", [entry.name for entry in ENGINES])
def test_once_in_a_run_of_every_engine(name, made):
    scene, engine = load_scene(SCENE), installed(name)
    ways = [(fidelity, {}) for fidelity in engine.capabilities.fidelities]
    ways += [("joint", {"method": "accelerations"})] * (name in WITH_ACCELERATIONS)
    ways += [("joint", {"method": "bristles"})] * (name == "exudyn")
    ways += [("contact", {"method": "continuous"})] * (name == "drake")
    if name == "reference":
        ways += [("joint", {"method": "textbook"})]
        ways += [
            ("joint", {"method": method, "stabilization": stabilization})
            for method in ("event", "paper")
            for stabilization in ("none", "baumgarte", "projection")
        ]
    for fidelity, settings in ways:
        made.clear()
        engine.simulate(scene, t_end=0.05, fidelity=fidelity, **settings)
        assert len(made) == 1 and made[0] is scene, (fidelity, settings)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("reference", [("one",), ("other",)]),
        ("pymunk", [("one",), ("one", "other"), ("other",)]),
    ],
)
def test_each_part_and_the_whole_at_most_once(name, expected, made):
    """The reference integrates the parts; an adapter simulates the whole, whose parts the gate looks at."""
    two = {"mass": 1, "inertia": 1}
    scene = scene_from_dict(
        {
            "t_end": 1,
            "gravity": [0, -9.81],
            "bodies": {"one": two, "other": {**two, "position": [0, 5]}},
            "joints": {
                "guide": {"type": "translational", "slider": "one", "mu": 0.1},
                "pin": {
                    "type": "revolute",
                    "bodies": ["other", "ground"],
                    "points": [[1, 0], [1, 5]],
                },
            },
        },
        name="two parts",
    )
    installed(name).simulate(scene, t_end=0.05)
    assert sorted(tuple(each.bodies) for each in made) == expected


def test_a_second_run_assembles_anew(made):
    """Nothing is left of a run: a scene is assembled in each."""
    scene, engine = load_scene(SCENE), installed("reference")
    for count in (1, 2):
        engine.simulate(scene, t_end=0.05)
        assert len(made) == count


def test_an_assembly_is_of_its_scene_alone():
    scene = load_scene(SCENE)
    assembly = Assembly(scene)
    assert assembly_of(scene, assembly) is assembly
    assert assembly_of(scene, None).scene is scene
    with pytest.raises(ValueError, match="expected that of"):
        assembly_of(vary(scene, {"t_end": 1.0}), assembly)


@pytest.mark.parametrize("stabilization", ["scene", "none", "baumgarte", "projection"])
@pytest.mark.parametrize("build", [lambda: load_scene(SCENE), lambda: sprung_chain(6)])
def test_another_stabilization_is_that_of_a_mechanism_made_with_it(build, stabilization):
    scene = build()
    made = Mechanism(scene, stabilization)
    found = Mechanism(scene, "none").stabilized(stabilization)
    assert (found.stabilization, found.projection) == (made.stabilization, made.projection)
    assert (
        len(found.arrays.separate)
        == len(made.arrays.separate)
        == (0 if len(scene.guides) == 1 else 6)
    )
    for one, other in zip(
        (found.arrays, *found.arrays.separate), (made.arrays, *made.arrays.separate)
    ):
        for name, values in zip(other._numba_type_.fields, other):
            if name != "separate":
                np.testing.assert_array_equal(getattr(one, name), values, err_msg=name)
