"""A resolved scene is valid by its schema, is a scene again, and moves by the same equations."""

import json

import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import Mechanism, workspace
from stiction.reference_impl.multibody.subsystems import independent_parts
from stiction.scenes import SceneError, catalogue, load_scene, scene_from_dict, vary
from stiction.scenes.errors import ELEMENTS, LAWS, STABILIZATIONS
from stiction.scenes.model import Scene
from stiction.scenes.resolved import load_resolved, resolved_scene, resolved_schema, resolved_text

NAMES = [*catalogue(), *catalogue("hard")]
CASE = "slider-bar-case-1"


@pytest.fixture(scope="module")
def validator():
    jsonschema.Draft202012Validator.check_schema(resolved_schema())
    return jsonschema.Draft202012Validator(resolved_schema())


def every_law():
    """A scene with every kind of law, spring, drive and load, and with parameters and arithmetic in all of them."""
    body = {"mass": "m", "inertia": "m*L^2/12", "angle": "deg(30)"}
    table = {"type": "table", "times": [0, "pi", 4], "values": ["L", 0, "sqrt(2)"]}
    return scene_from_dict(
        {
            "parameters": {"m": 2, "L": "m/4"},
            "bodies": {"a": body, "b": body | {"position": ["L", 1]}},
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "a",
                    "angle": "deg(30)",
                    "mu": "m/20",
                    "length": "L",
                }
            },
            "drives": {
                "motor": {
                    "type": "distance",
                    "bodies": ["b", "a"],
                    "axis": [0, "L"],
                    "law": table | {"interpolation": "cubic"},
                }
            },
            "springs": {
                "spring": {"type": "linear", "bodies": ["a", "ground"], "stiffness": "m"},
                "coil": {"type": "torsional", "bodies": ["b", "ground"], "damping": "m"},
            },
            "forces": {
                "one": {
                    "type": "force",
                    "body": "b",
                    "direction": [1, 2],
                    "law": {"type": "sine", "amplitude": "m", "frequency": "2*pi"},
                },
                "two": {"type": "torque", "body": "b", "law": {"type": "linear", "rate": "-m"}},
                "three": {"type": "torque", "body": "a", "law": {"type": "constant", "value": "m"}},
                "four": {"type": "torque", "body": "a", "law": table},
            },
            "stabilization": {"method": "baumgarte", "alpha": "m", "beta": "m^2"},
        },
        name="every-law",
    )


def equations(scene):
    """Masses, contact levers, start, rows, applied and stabilizing forces off the constraints at some instants, by independent part."""
    for part in independent_parts(scene):
        mechanism = Mechanism(part)
        m, w = mechanism.arrays, workspace(mechanism.arrays)
        yield from (m.inverse_mass, m.friction, *mechanism.initial_state())
        for t in (0.0, 0.3, 5.0):
            q, v = (
                values + np.sin(t + np.arange(len(values))) for values in mechanism.initial_state()
            )
            row_form(m, w, t, q, v)
            yield from map(np.copy, (w.J, w.phi, w.free, w.right))


@pytest.mark.parametrize("name", [*NAMES, "every-law"])
def test_valid_and_the_same_equations(name, validator):
    scene = every_law() if name == "every-law" else load_scene(name)
    text = resolved_text(scene)
    assert not list(validator.iter_errors(json.loads(text)))
    again = load_resolved(text)
    assert again.name == scene.name
    assert resolved_scene(again) == resolved_scene(scene)
    for one, other in zip(equations(scene), equations(again), strict=True):
        np.testing.assert_array_equal(one, other)
    for element in ("mu", "static_coefficient", "length"):
        assert [getattr(guide, element) for guide in again.guides.values()] == [
            getattr(guide, element) for guide in scene.guides.values()
        ]


def test_every_kind_of_element_is_in_the_schema(validator):
    models = {
        model.__name__
        for table in (*ELEMENTS.values(), LAWS, STABILIZATIONS)
        for model in table.values()
    }
    assert models == set(resolved_schema()["$defs"])
    assert set(resolved_schema()["properties"]["scene"]["properties"]) == set(
        Scene.model_fields
    ) - {"parameters"}


def test_overrides_and_parameters_are_in_the_numbers():
    scene = resolved_scene(load_scene(CASE, {"F0": 4}))["scene"]
    assert scene["forces"]["load"]["law"]["amplitude"] == 4.0 and "parameters" not in scene


def test_what_is_left_out_has_its_value():
    bare = vary(load_scene(CASE), {"guide.mus": None, "guide.width": None, "gravity": None})
    guide = resolved_scene(bare)["scene"]["joints"]["guide"]
    assert (guide["mus"], guide["width"]) == (guide["mu"], 0.0) and resolved_scene(bare)["scene"][
        "gravity"
    ] == [0.0, 0.0]
    smooth = resolved_scene(load_scene(f"{CASE}-frictionless"))["scene"]["joints"]["guide"]
    assert smooth["mu"] is smooth["mus"] is None


@pytest.mark.parametrize(
    ("change", "loads"),
    [
        (lambda found: found.update(version=2), False),
        (lambda found: found.update(format="stiction scene"), False),
        (lambda found: found.pop("name"), False),
        (lambda found: found.update(scene=[1]), False),
        (lambda found: found["scene"].pop("bodies"), False),
        (lambda found: found["scene"]["bodies"]["bar"].update(mass=-1.0), False),
        (lambda found: found["scene"]["bodies"]["bar"].update(mass="m2"), True),
        (lambda found: found["scene"]["bodies"]["bar"].pop("angle"), True),
        (lambda found: found["scene"].update(parameters={}), True),
    ],
    ids=range(9),
)
def test_refused_by_the_schema_and_unless_a_scene_file_may_have_it_by_the_loader(
    change, loads, validator
):
    found = resolved_scene(load_scene(CASE))
    change(found)
    assert list(validator.iter_errors(found))
    if not loads:
        with pytest.raises(SceneError):
            load_resolved(json.dumps(found))


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000, "null"], ids=range(5))
def test_text_that_is_no_scene(text):
    with pytest.raises(SceneError):
        load_resolved(text)


def test_command(tmp_path):
    shown = CliRunner().invoke(app, ["schema", "--resolved"])
    assert shown.exit_code == 0 and json.loads(shown.stdout) == resolved_schema()
    assert (
        CliRunner()
        .invoke(app, ["schema", "--resolved", "--out", str(tmp_path / "s.json")])
        .exit_code
        == 0
    )
    assert json.loads((tmp_path / "s.json").read_text()) == resolved_schema()
