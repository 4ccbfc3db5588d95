"""Every number of a scene is reached by a key; effects are added and removed."""

import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stiction.scenes import (
    SceneError,
    catalogue,
    load_scene,
    parse_override,
    scene_from_dict,
    vary,
)
from stiction.scenes.model import Scene

CASE = "slider-bar-case-1"


def found(scene, path):
    """The value at a path of attributes, names and indices."""
    value = scene
    for part in path.split("."):
        value = (
            value[int(part)]
            if isinstance(value, tuple)
            else value[part]
            if isinstance(value, dict)
            else getattr(value, part)
        )
    return value


@pytest.mark.parametrize(
    ("key", "value", "path"),
    [
        ("F0", 4.2, "forces.load.law.amplitude"),
        ("L", "2*pi", "parameters.L"),
        ("guide.mu", 0.02, "joints.guide.mu"),
        ("motor.rate", 1, "drives.motor.law.rate"),
        ("motor.law.rate", 1, "drives.motor.law.rate"),
        ("motor.offset", 0.1, "drives.motor.law.offset"),
        ("load.phase", "pi/2", "forces.load.law.phase"),
        ("bar.position.0", 3, "bodies.bar.position.0"),
        ("pin.points.0.1", 0.1, "joints.pin.points.0.1"),
        # what the file leaves to its default
        ("slider.velocity.0", 0.3, "bodies.slider.velocity.0"),
        ("bar.angle", 0.3, "bodies.bar.angle"),
        ("spring.damping", 0.5, "springs.spring.damping"),
        ("guide.point.1", 2, "joints.guide.point.1"),
        ("spring.axis", [1, 0], "springs.spring.axis"),
        ("load.point.1", 0.2, "forces.load.point.1"),
    ],
)
def test_keys(key, value, path):
    scene = load_scene(CASE, {key: value})
    expected = (
        {"2*pi": 2 * np.pi, "pi/2": np.pi / 2}.get(value, value)
        if isinstance(value, str)
        else value
    )
    assert found(scene, path) == (tuple(expected) if isinstance(expected, list) else expected)
    assert vary(load_scene(CASE), {key: value}) == scene
    assert vary(scene, {"title": "x"}).title == "x" and found(
        vary(scene, {"title": "x"}), path
    ) == found(scene, path)


def numbers(raw, path=()):
    """Paths of all numbers and arithmetic in a scene's tables."""
    for key, value in raw.items() if isinstance(raw, dict) else enumerate(raw):
        if isinstance(value, (dict, list, tuple)):
            yield from numbers(value, (*path, str(key)))
        elif isinstance(value, (int, float)):
            yield ".".join((*path, str(key)))


@pytest.mark.parametrize("name", catalogue())
def test_every_number_of_every_scene_is_reached_by_its_path(name):
    scene = load_scene(name)
    reached = 0
    for path in numbers(scene.model_dump(exclude_unset=True)):
        try:
            assert found(vary(scene, {path: 0.37}), path) == 0.37
            reached += 1
        except SceneError as error:  # only for the sake of another key that it contradicts
            contradiction = (
                ("mus", (".mu", ".mus")),
                ("friction", (".friction", ".static_friction")),
                # the start of a held pendulum, whose weight must be able to reach its load
                ("parameters.start", (".g", ".m", ".l", ".tau", ".part", ".limit", ".s")),
            )
            assert any(key in str(error) and path.endswith(ends) for key, ends in contradiction), (
                error
            )
    assert reached >= 8


@settings(deadline=None)
@given(st.floats(0.01, 100), st.floats(-100, 100), st.floats(1, 50))
def test_values_arrive_exactly_and_the_scene_stays_what_it_was(mass, rate, force):
    scene = load_scene(CASE)
    before = scene.to_toml()
    varied = vary(
        scene,
        {
            "m1": mass,
            "motor.rate": rate,
            "F0": np.float32(force),
            "bar.position": np.array([rate, 1.0]),
        },
    )
    assert (varied.bodies["bar"].mass, varied.drives["motor"].law.rate) == (mass, rate)
    assert varied.bodies["bar"].inertia == mass * 2.0**2 / 12
    assert varied.forces["load"].law.amplitude == float(np.float32(force)) and varied.bodies[
        "bar"
    ].position == (rate, 1.0)
    assert scene.to_toml() == before
    assert scene_from_dict(tomllib.loads(varied.to_toml())) == varied


@pytest.mark.parametrize("text", ["2*\tF0", "(\nF0)*2", "2*\uff260"])
def test_what_mentions_a_parameter_follows_it_however_it_is_written(text):
    tables = {
        "parameters": {"F0": 2.0, "k": text},
        "bodies": {"bar": {"mass": text, "inertia": 1.0}},
    }
    changed = vary(scene_from_dict(tables), {"F0": 5.0})
    assert changed.bodies["bar"].mass == changed.parameters["k"] == 10.0
    assert changed == scene_from_dict(tables, overrides={"F0": 5.0})


def test_none_removes_effects():
    scene = load_scene(CASE)
    bare = vary(
        scene,
        {
            "guide.mu": None,
            "guide.mus": None,
            "motor": None,
            "gravity": None,
            "stabilization": None,
            "spring": None,
        },
    )
    assert (
        not bare.frictional_guides and not bare.drives and not bare.springs and bare.gravity is None
    )
    assert bare.stabilization.method == "projection"
    assert vary(scene, {"spring.damping": None}) == scene  # was not there
    again = vary(
        bare,
        {
            "guide.mu": "mu",
            "guide.mus": "mus",
            "gravity": [0, "-g"],
            "drives.motor": scene._raw["drives"]["motor"],
            "springs.spring": scene._raw["springs"]["spring"],
            "stabilization.method": "baumgarte",
            "stabilization.alpha": 90,
            "stabilization.beta": 10,
        },
    )
    assert again == scene


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("mtor.rate", 1, "did you mean 'motor'?"),
        ("F00", 1, "did you mean 'F0'?"),
        ("guide.muu", 0.1, "joints.guide.muu: found 0.1; unknown key (did you mean 'mu'?)"),
        ("motor.ratte", 1, "drives.motor.law.ratte: found 1; unknown key (did you mean 'rate'?)"),
        ("gravity.2", 1, "expected an index from 0 to 1"),
        ("gravity.x", 1, "expected an index"),
        ("bar.mass.x", 1, "no such key"),
        ("guide.muu", None, "nothing to remove"),
        ("bar.mass", None, "bodies.bar.mass: found nothing; this key is required"),
        ("F0", None, "unknown name 'F0'"),
        ("guide.mus", 0.01, "found 0.01; expected at least mu = 0.03"),
        ("", 1, "no such key"),
        ("spring.axis.0", 1, "no such key"),
        ("bar.mass", "m3", "unknown name 'm3'"),
        ("joints", 3, "joints: found 3; expected a table"),
    ],
)
def test_wrong_overrides(key, value, words):
    with pytest.raises(SceneError) as caught:
        load_scene(CASE, {key: value})
    assert words in str(caught.value) and str(caught.value).startswith(CASE)


def test_all_wrong_keys_at_once():
    with pytest.raises(SceneError, match="(?s)2 problems.*first.*second"):
        load_scene(CASE, {"first": 1, "second": 2, "F0": 3})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("F0=3", ("F0", "3")),
        (" guide.mu = mu/2 ", ("guide.mu", "mu/2")),
        ("guide.mu=", ("guide.mu", None)),
        ("gravity=[0, -1.62]", ("gravity", [0, -1.62])),
        ("motor.law={type='linear', rate=1}", ("motor.law", {"type": "linear", "rate": 1})),
    ],
)
def test_overrides_of_a_command_line(text, expected):
    assert parse_override(text) == expected


@pytest.mark.parametrize("text", ["F0", "=3", "", "gravity=[0,", "gravity=" + "[" * 5000])
def test_wrong_overrides_of_a_command_line(text):
    with pytest.raises(SceneError, match="expected"):
        parse_override(text)


def test_base_with_changes(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "own.toml").write_text(
        'base = "slider-bar-case-2"\ntitle = "own"\nunset = ["spring"]\n'
        '[set]\nF0 = 9\nguide.mus = 0.5\n"bar.position" = [0, 1]\n'
    )
    (tmp_path / "derived.toml").write_text('base = "sub/own.toml"\nset = { guide.mus = 0.6 }')
    scene = load_scene(tmp_path / "derived.toml")
    assert (scene.name, scene.title, scene.guides["guide"].mus) == ("derived", "own", 0.6)
    assert (
        scene.forces["load"].law.amplitude == 9
        and not scene.springs
        and scene.bodies["bar"].position == (0, 1)
    )
    assert scene.drives == load_scene("slider-bar-case-2").drives


@pytest.mark.parametrize(
    "change",
    [{"stabilization.method": "none"}, {"motor.law.type": "constant", "motor.law.value": 1}],
)
def test_what_an_override_leaves_of_another_kind_is_told_with_the_way_to_remove_it(change):
    with pytest.raises(SceneError) as caught:
        load_scene("slider-bar-case-1", change)
    [first, *_] = caught.value.problems
    remedy = first.key
    assert f'unset = ["{remedy}"]' in first.expected and f"--set {remedy}=" in first.expected
    removed = {problem.key: None for problem in caught.value.problems}
    assert load_scene("slider-bar-case-1", change | removed)


def test_scenes_compare_by_what_they_declare(tmp_path):
    scene = load_scene("pendulum")
    path = tmp_path / "copy.toml"
    path.write_text(scene.to_toml())
    copy = load_scene(path)
    assert copy == scene and copy.name == "copy" and vary(copy, {"t_end": 9}) != scene
    assert isinstance(copy, Scene) and copy != "pendulum"
