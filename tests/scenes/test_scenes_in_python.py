"""Scenes that are built from the public classes are those of files, with the same checks."""

import copy
import math
import pickle
import tomllib

import pytest

import stiction
from stiction import Body, Revolute, Scene, SceneError, Translational, laws
from stiction.scenes import catalogue, load_scene, scene_from_dict
from stiction.scenes.digest import scene_digest
from stiction.scenes.fields import Part

SECTIONS = ("bodies", "joints", "drives", "springs", "forces")
BLOCK = {"block": Body(mass=2.0, inertia=0.1)}


def rebuilt(value):
    """The same value, with every part of a scene built by a call of its class, as a user would."""
    if isinstance(value, Part):
        keys = value.model_fields_set - {"parameters"}
        tag = {"type", "method"} if type(value).__name__ != "Drive" else set()
        return type(value)(**{key: rebuilt(getattr(value, key)) for key in keys - tag})
    if isinstance(value, dict):
        return {key: rebuilt(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(map(rebuilt, value))
    return value


@pytest.mark.parametrize("name", [*catalogue(), *catalogue("hard")])
def test_every_scene_of_the_catalogue(name):
    scene = load_scene(name)
    built = rebuilt(scene)
    assert all(getattr(built, section) == getattr(scene, section) for section in SECTIONS)
    assert (built.gravity, built.stabilization) == (scene.gravity, scene.stabilization)
    assert scene_digest(built) == scene_digest(scene)
    from_file = scene_from_dict(tomllib.loads(built.to_toml()))
    assert from_file == built and scene_digest(from_file) == scene_digest(scene)
    assert from_file == pickle.loads(pickle.dumps(built)) == copy.deepcopy(built)


def problems(make):
    with pytest.raises(SceneError) as caught:
        make()
    return [(found.key, found.found, found.expected) for found in caught.value.problems]


@pytest.mark.parametrize(
    ("section", "make", "keys"),
    [
        ("bodies", Body, {"mass": -1.0, "inertia": 0.1}),
        ("bodies", Body, {"inertia": float("inf"), "position": (1.0,)}),
        ("bodies", Body, {"mass": 1.0, "inertia": "m*2", "velocty": (1.0, 0.0)}),
        ("joints", Translational, {"slider": "block", "mu": 0.3, "mus": 0.2}),
        ("joints", Translational, {"slider": "block", "direction": (0.0, 0.0)}),
        ("joints", Translational, {"slider": "block", "width": 0.1, "restitution": 2.0}),
        ("joints", Revolute, {"bodies": ("block",), "friction": "one"}),
        ("forces", stiction.Force, {"body": "block", "direction": (1.0, 0.0), "law": 3.0}),
        ("forces", stiction.Torque, {"body": "block", "law": {"type": "sin", "amplitude": 1.0}}),
        ("springs", stiction.LinearSpring, {"bodies": ("block", "ground"), "rest_length": -1.0}),
    ],
)
def test_one_element_has_the_problems_of_its_table(section, make, keys):
    from_python = problems(lambda: make(**keys))
    tag = {} if make is Body else {"type": make.model_fields["type"].default}
    raw = {"bodies": {"block": {"mass": 2.0, "inertia": 0.1}}}
    raw.setdefault(section, {})["e"] = {**tag, **keys}
    prefix = f"{section}.e."
    assert from_python == [
        (key.removeprefix(prefix), found, expected)
        for key, found, expected in problems(lambda: scene_from_dict(raw))
    ]


@pytest.mark.parametrize(
    "tables",
    [
        {"joints": {"guide": Translational(slider="blok")}},
        {"joints": {"pin": Revolute(bodies=("block", "block"))}, "t_end": -1.0},
        {"joints": {"block": Translational(slider="block")}, "gravitation": (0.0, -9.81)},
        {"forces": {"pull": {"type": "torque", "body": "ground", "law": laws.Constant(value=1.0)}}},
        {"parameters": {"mu": "1/0"}, "joints": {"guide": {"type": "translational"}}},
        {"bodies": {}},
    ],
)
def test_a_scene_has_the_problems_of_its_file(tables):
    tables = {"bodies": BLOCK, **tables}

    def plain(value):
        if isinstance(value, Part):
            value = value.declared()
        return (
            {key: plain(item) for key, item in value.items()} if isinstance(value, dict) else value
        )

    found = problems(lambda: Scene(**tables))
    assert found and found == problems(lambda: scene_from_dict(plain(tables)))


def test_parameters_are_those_of_dictionaries():
    scene = Scene(
        parameters={"mu": 0.25},
        bodies=BLOCK,
        joints={"guide": {"type": "translational", "slider": "block", "mu": "2*mu"}},
    )
    assert scene.guides["guide"].mu == 0.5
    assert stiction.scenes.vary(scene, {"mu": 0.1}).guides["guide"].mu == 0.2


def test_the_tables_of_a_scene_are_a_copy():
    scene = Scene(bodies=BLOCK)
    scene.to_dict()["bodies"]["block"]["mass"] = 7.0
    assert scene.to_dict()["bodies"]["block"]["mass"] == scene.bodies["block"].mass == 2.0


def test_a_loop_is_closed(compiled):
    """A rod on a pin at the origin, given 1 mm beside it."""
    rod = Body(mass=1.0, inertia=0.1, position=(0.5, 1e-3))
    pin = Revolute(bodies=("rod", "ground"), points=((-0.5, 0.0), (0.0, 0.0)))
    scene = Scene(bodies={"rod": rod}, joints={"pin": pin})
    closed = stiction.assembled(scene).bodies["rod"]
    (x, y), angle = closed.position, closed.angle
    assert math.hypot(x - 0.5 * math.cos(angle), y - 0.5 * math.sin(angle)) < 1e-12
