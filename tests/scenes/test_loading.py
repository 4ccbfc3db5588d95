"""Whatever is in a file, loading gives a scene or a `SceneError` that names file, key, value and expectation."""

import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from stiction.scenes import SceneError, catalogue, load_scene, scene_from_dict
from stiction.scenes.loading import MAX_FILE_SIZE

BODIES = """
[bodies.bar]
mass = 2
inertia = 1
[bodies.slider]
mass = 1
inertia = 1
"""
PIN = '[joints.pin]\ntype = "revolute"\nbodies = ["bar", "slider"]\n'
GUIDE = '[joints.guide]\ntype = "translational"\nslider = "slider"\n'
MOTOR = '[drives.motor]\nbodies = ["bar", "slider"]\n'
TABLE = 'law = { type = "table", times = %s, values = %s }\n'

BROKEN = [  # file, then for each problem: key, value found, words of what was expected
    # not a scene at all
    ("", [("bodies", "nothing", "required")]),
    ("bodies = 3", [("bodies", "3", "a table")]),
    ("[[bodies]]\nmass = 1", [("bodies", "[a table]", "a table")]),
    ("[bodies]", [("bodies", "a table", "at least 1")]),
    ("mass = = 2", [("file", "line 1", "TOML")]),
    (BODIES + "[bodies.bar]\nmass = 3", [("file", "twice", "TOML")]),
    ("t_end = 1" + "0" * 5000, [("file", "thousands of digits", "1.8e308")]),
    ("x = " + "[" * 10_000, [("file", "nested too deep", "at most")]),
    ("x = " + "{a = " * 500 + "1" + "}" * 500, [("file", "nested too deep", "at most")]),
    (".".join("a" * 100_000) + " = 1", [("file", "nested too deep", "at most")]),
    (".".join(['"a.=,"'] * 20_000) + " = 1", [("file", "nested too deep", "at most")]),
    # numbers
    (
        "[bodies.bar]\nmass = -2\ninertia = 0",
        [("bodies.bar.mass", "-2", "number > 0"), ("bodies.bar.inertia", "0", "number > 0")],
    ),
    (
        "[bodies.bar]\nmass = 1e308\ninertia = 1e-308",
        [
            ("bodies.bar.mass", "1e+308", "1e-60 .. 1e+60"),
            ("bodies.bar.inertia", "1e-308", "1e-60 .. 1e+60"),
        ],
    ),
    (
        "[bodies.bar]\nmass = nan\ninertia = inf",
        [("bodies.bar.mass", "nan", "finite"), ("bodies.bar.inertia", "inf", "finite")],
    ),
    (
        "[bodies.bar]\nmass = true\ninertia = 2020-01-01",
        [("bodies.bar.mass", "true", "a number"), ("bodies.bar.inertia", "2020-01-01", "a number")],
    ),
    (
        "[bodies.bar]\nmass = [1]\ninertia = {}",
        [("bodies.bar.mass", "[1]", "a number"), ("bodies.bar.inertia", "a table", "a number")],
    ),
    ("t_end = 0x" + "f" * 5000 + BODIES, [("t_end", "huge integer", "too large")]),
    ("t_end = '9^9^9^9'" + BODIES, [("t_end", "'9^9^9^9'", "too large")]),
    ("t_end = '1e999'" + BODIES, [("t_end", "'1e999'", "finite")]),
    ("t_end = '1/(2-2)'" + BODIES, [("t_end", "'1/(2-2)'", "divides by zero")]),
    ("t_end = 'sqrt(1-2)'" + BODIES, [("t_end", "'sqrt(1-2)'", "sqrt(-1) is not a real number")]),
    ("t_end = 'sqrt((0-1)^0.5)'" + BODIES, [("t_end", "^0.5", "not a real number")]),
    ("t_end = '__import__(\"os\")'" + BODIES, [("t_end", "__import__", "unknown name")]),
    ("t_end = '1 +'" + BODIES, [("t_end", "'1 +'", "arithmetic")]),
    ("t_end = '" + "(" * 240 + "1" + ")" * 240 + "'" + BODIES, [("t_end", "((", "arithmetic")]),
    ("t_end = '" + "-" * 501 + "1'" + BODIES, [("t_end", "--", "500 characters")]),
    ("gravity = 9.81" + BODIES, [("gravity", "9.81", "a list")]),
    ("gravity = [0, 0, -9.81]" + BODIES, [("gravity", "[0, 0, -9.81]", "a list of 2")]),
    ("gravity = []" + BODIES, [("gravity", "[]", "a list of 2")]),
    # parameters
    (
        "t_end = '2*omeg'\n[parameters]\nomega = 2" + BODIES,
        [("t_end", "'2*omeg'", "did you mean 'omega'?")],
    ),
    (
        "[parameters]\na = 'b'\nb = 'a'" + BODIES,
        [("parameters.a", "'b'", "may use those above it")],
    ),
    (
        "[parameters]\npi = 3\nlambda = 1\n'm 1' = 1" + BODIES,
        [
            ("parameters", "'pi'", "word"),
            ("parameters", "'lambda'", "word"),
            ("parameters", "'m 1'", "letter"),
        ],
    ),
    ("parameters = 3" + BODIES, [("parameters", "3", "a table")]),
    (
        "[parameters]\na = 'x + 1'\nc = [2]\n[bodies.bar]\nmass = 'c*y'\ninertia = 'z'",
        [
            ("parameters.a", "'x + 1'", "unknown name 'x'"),
            ("parameters.c", "[2]", "a number"),
            ("bodies.bar.mass", "'c*y'", "unknown name 'y'"),
            ("bodies.bar.inertia", "'z'", "unknown name 'z'"),
        ],
    ),
    # keys and types
    (BODIES + "weight = 3", [("bodies.slider.weight", "3", "expected one of: mass, inertia")]),
    (BODIES + "t_end = 3", [("bodies.slider.t_end", "3", "at the top of the file")]),
    (BODIES + "[joint]", [("joint", "a table", "did you mean 'joints'?")]),
    ("title = 3" + BODIES, [("title", "3", "text")]),
    ("[bodies.bar]\nmass = 1", [("bodies.bar.inertia", "nothing", "required")]),
    (
        BODIES + "[bodies.'a b']\nmass = 1\ninertia = 1",
        [("bodies.a b", "the name 'a b'", "letter")],
    ),
    (BODIES + "[joints]\npin = 3", [("joints.pin", "3", "a table")]),
    (
        BODIES + PIN.replace("revolute", "revolut"),
        [("joints.pin.type", "'revolut'", "did you mean 'revolute'?")],
    ),
    (
        BODIES + "[joints.pin]\nbodies = ['bar', 'slider']",
        [("joints.pin.type", "nothing", "'revolute' or 'translational'")],
    ),
    (
        BODIES + "[joints.pin]\ntype = [1]",
        [("joints.pin.type", "[1]", "'revolute' or 'translational'")],
    ),
    (BODIES + PIN + "points = [[0, 0], [1]]", [("joints.pin.points.1", "[1]", "a list of 2")]),
    (
        BODIES + PIN + "points = [[0, 0], [1, 'q']]",
        [("joints.pin.points.1.1", "'q'", "unknown name")],
    ),
    (BODIES + GUIDE + "muu = 0.1", [("joints.guide.muu", "0.1", "did you mean 'mu'?")]),
    (
        BODIES + "[stabilization]\nmethod = 'baumgart'",
        [("stabilization.method", "'baumgart'", "did you mean 'baumgarte'?")],
    ),
    (
        BODIES + "[stabilization]\nmethod = 'baumgarte'\nalpha = -1\ngamma = 2",
        [
            ("stabilization.alpha", "-1", ">= 0"),
            ("stabilization.beta", "nothing", "required"),
            ("stabilization.gamma", "2", "unknown"),
        ],
    ),
    # elements named like types and keys
    (
        BODIES + "[joints.law]\ntype = 'revolut'",
        [("joints.law.type", "'revolut'", "'revolute' or")],
    ),
    (
        BODIES + PIN.replace("pin", "law") + "x = 1",
        [("joints.law.x", "1", "expected one of: type, bodies, points")],
    ),
    (
        BODIES
        + "[forces.law]\ntype = 'torque'\nbody = 'bar'\nx = 1\nlaw = { type = 'constant', value = 1, y = 2 }",
        [
            ("forces.law.law.y", "2", "expected one of: type, value"),
            ("forces.law.x", "1", "one of: type, body, law"),
        ],
    ),
    (
        BODIES + "[joints.revolute]\ntype = 'revolute'\nbodies = ['bar']",
        [("joints.revolute.bodies", "['bar']", "a list of 2")],
    ),
    # what an element declares does not fit together
    (
        BODIES + GUIDE + "mus = 0.1\nwidth = 0.2",
        [("joints.guide.width", "0.2", "length"), ("joints.guide.mus", "0.1", "mu too")],
    ),
    (BODIES + GUIDE + "mu = 0.2\nmus = 0.1", [("joints.guide.mus", "0.1", "at least mu = 0.2")]),
    (
        BODIES + GUIDE + "direction = [0, 0]",
        [("joints.guide.direction", "[0, 0]", "a vector with a length")],
    ),
    (
        BODIES + GUIDE + "direction = [1e200, 0]",
        [("joints.guide.direction", "[1e+200, 0]", "a vector with a length")],
    ),
    (
        BODIES + MOTOR + "type = 'angel'\nlaw = { type = 'linear', rate = 1 }",
        [("drives.motor.type", "'angel'", "did you mean 'angle'?")],
    ),
    (BODIES + MOTOR + "type = 'angle'", [("drives.motor.law", "nothing", "required")]),
    (BODIES + MOTOR + "type = 'angle'\nlaw = 3", [("drives.motor.law", "3", "a table")]),
    (
        BODIES + MOTOR + "type = 'angle'\nlaw = { type = 'linaer', rate = 1 }",
        [("drives.motor.law.type", "'linaer'", "did you mean 'linear'?")],
    ),
    (
        BODIES + MOTOR + "type = 'angle'\nlaw = { type = 'linear', value = 1 }",
        [
            ("drives.motor.law.rate", "nothing", "required"),
            ("drives.motor.law.value", "1", "unknown key"),
        ],
    ),
    (
        BODIES + MOTOR + "type = 'angle'\naxis = [1, 0]\nlaw = { type = 'linear', rate = 1 }",
        [("drives.motor.axis", "[1.0, 0.0]", "distance drive only")],
    ),
    (
        BODIES + MOTOR + "type = 'distance'\nlaw = { type = 'linear', rate = 1 }",
        [("drives.motor.law", "0.0", "distance")],
    ),
    (
        BODIES + MOTOR + "type = 'angle'\n" + TABLE % ("[0, 1]", "[0, 1]"),
        [("drives.motor.law.interpolation", "'linear'", "'cubic'")],
    ),
    (
        BODIES + MOTOR + "type = 'angle'\n" + TABLE % ("[0, 2, 1, 0]", "[0, 1]"),
        [
            ("drives.motor.law.values", "[0.0, 1.0]", "as many as times: 4"),
            ("drives.motor.law.times.2", "1.0", "time before it, 2"),
        ],
    ),
    (
        BODIES + "[springs.s]\ntype = 'linear'\nbodies = ['bar', 'slider']\nrest_length = -1",
        [("springs.s.rest_length", "-1", "a distance >= 0")],
    ),
    # references
    (
        BODIES + PIN.replace("bar", "baar"),
        [("joints.pin.bodies.0", "'baar'", "did you mean 'bar'?")],
    ),
    (
        BODIES + PIN.replace("bar", "slider"),
        [("joints.pin", "'slider' twice", "two different bodies")],
    ),
    (
        BODIES + GUIDE + "guide = 'slider'",
        [("joints.guide", "'slider' twice", "two different bodies")],
    ),
    (
        BODIES + GUIDE.replace('r = "slider"', 'r = "ground"'),
        [
            ("joints.guide.slider", "'ground'", "can move"),
            ("joints.guide", "'ground' twice", "two different bodies"),
        ],
    ),
    (
        BODIES
        + "[forces.f]\ntype = 'torque'\nbody = 'ground'\nlaw = { type = 'constant', value = 1 }",
        [("forces.f.body", "'ground'", "can move")],
    ),
    (
        BODIES + "[bodies.ground]\nmass = 1\ninertia = 1",
        [("bodies.ground", "'ground'", "fixed body")],
    ),
    (
        BODIES + PIN.replace("joints.pin", "joints.bar"),
        [("joints.bar", "the name of bodies.bar", "a name of its own")],
    ),
    (
        BODIES + PIN + "friction = 2\nstatic_friction = 1",
        [("joints.pin.static_friction", "1", "expected at least friction = 2")],
    ),
    (
        BODIES + PIN + "static_friction = 1",
        [("joints.pin.static_friction", "1", "expected the bound in slip, friction, too")],
    ),
    (BODIES + PIN + "friction = -1", [("joints.pin.friction", "-1", ">= 0")]),
    (BODIES + PIN + "damping = -1", [("joints.pin.damping", "-1", ">= 0")]),
    (
        BODIES + PIN.replace("bar", "crank") + "diameter = 1\n[bodies.x]\nmass = 'q'\ninertia = 1",
        [
            ("bodies.x.mass", "'q'", "unknown name"),
            ("joints.pin.diameter", "1", "unknown key"),
            (
                "joints.pin.bodies.0",
                "'crank'",
                "expected a body of the scene: bar, slider, x, ground",
            ),
        ],
    ),
    # base
    ("base = 'pendulumm'", [("base", "'pendulumm'", "did you mean 'pendulum'?")]),
    ("base = 'scene.toml'", [("base", "scene -> scene", "does not lead back")]),
    (
        "base = 3\nset = 3\nunset = [1]\ngravity = [0, 0]",
        [
            ("gravity", "[0, 0]", "beside base"),
            ("base", "3", "name or path"),
            ("set", "3", "a table"),
            ("unset", "[1]", "a list of keys"),
        ],
    ),
    (
        "base = 'pendulum'\nset = { masss.mass = 3 }\nunset = ['mass.inertai']",
        [
            ("mass.inertai", "nothing to remove", "did you mean 'inertia'?"),
            ("masss.mass", "no such key", "did you mean 'mass'?"),
        ],
    ),
]


@pytest.mark.parametrize(
    ("text", "expected"),
    BROKEN,
    ids=[problems[0][0] + f"-{i}" for i, (_, problems) in enumerate(BROKEN)],
)
def test_every_problem_is_named_with_key_value_and_expectation(tmp_path, text, expected):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    problems = caught.value.problems
    assert [problem.key for problem in problems] == [key for key, _, _ in expected], caught.value
    for problem, (_, found, words) in zip(problems, expected):
        assert found in problem.found and words in problem.expected
    message = str(caught.value)
    assert message.startswith(f"{path}: {len(problems)} problem")
    assert all(len(line) < 400 and line.isprintable() for line in message.splitlines())
    assert "Input should" not in message and "pydantic" not in message


@pytest.mark.parametrize(
    "content", [bytes(range(256)), b"title = '\xff'", "title = 'x'".encode("utf-16")]
)
def test_bytes_that_are_not_utf8(tmp_path, content):
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    with pytest.raises(SceneError, match="not UTF-8; expected TOML in UTF-8"):
        load_scene(path)


def test_byte_order_mark_is_no_error(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(BODIES, encoding="utf-8-sig")
    assert set(load_scene(path).bodies) == {"bar", "slider"}


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("slider-bar-case-4", "did you mean 'slider-bar-case-"),
        ("", "a folder"),
        (".", "a folder"),
        ("no/such/file.toml", "no such file"),
        ("/dev/null", "no such file"),
        ("a\0b", "null byte"),
        ("x" * 5000, "too long"),
        ("\udcff", "no such file"),
    ],
)
def test_names_and_paths_that_are_no_file(name, words):
    with pytest.raises(SceneError) as caught:
        load_scene(name)
    assert words in str(caught.value) and "block-on-incline" in str(caught.value)
    str(caught.value).encode()  # can be printed


@pytest.mark.parametrize("name", ["sled", "slde.toml"])
def test_a_name_that_is_nearly_that_of_a_file(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sled.toml").write_text(BODIES)
    with pytest.raises(SceneError, match=r"no such file.*did you mean 'sled\.toml'"):
        load_scene(name)


def test_file_that_is_too_large_is_not_read(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"#" * (MAX_FILE_SIZE + 1))
    with pytest.raises(
        SceneError, match=f"found {MAX_FILE_SIZE + 1} bytes; expected at most {MAX_FILE_SIZE}"
    ):
        load_scene(path)


def test_base_that_leads_back_through_another_file(tmp_path):
    (tmp_path / "a.toml").write_text("base = 'b.toml'")
    (tmp_path / "b.toml").write_text("base = './a.toml'")
    with pytest.raises(
        SceneError, match="base: found a -> b -> a; expected a base that does not lead back"
    ):
        load_scene(tmp_path / "a.toml")


def test_many_problems_fit_on_a_screen():
    with pytest.raises(SceneError) as caught:
        scene_from_dict({"bodies": {f"b{i}": {"mass": -1, "inertia": 1} for i in range(50)}})
    assert len(caught.value.problems) == 50
    lines = str(caught.value).splitlines()
    assert (
        lines[0] == "<scene>: 50 problems" and lines[-1] == "  ... and 30 more" and len(lines) == 22
    )


def test_ten_thousand_bodies_load_right_or_wrong():
    def chain(mass):
        return {
            "bodies": {
                f"b{i}": {"mass": mass, "inertia": "1/12", "position": [i, 0]}
                for i in range(10_000)
            },
            "joints": {
                f"j{i}": {"type": "revolute", "bodies": [f"b{i}", f"b{i + 1}"]}
                for i in range(9_999)
            },
        }

    assert len(scene_from_dict(chain(1)).joints) == 9_999
    with pytest.raises(SceneError, match="1000 problems or more"):
        scene_from_dict(chain("m"))


def test_error_survives_pickling():
    with pytest.raises(SceneError) as caught:
        scene_from_dict({})
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.origin, again.problems) == (
        str(caught.value),
        "<scene>",
        caught.value.problems,
    )


@pytest.mark.parametrize(
    "raw",
    [
        {1: 2},
        {"bodies": {1: {"mass": 1}}},
        {"bodies": {"a": {"mass": object(), "inertia": b"1"}}},
        {"bodies": {"a": {"mass": 1, "inertia": 1, "position": np.zeros((2, 2))}}},
        {
            "joints": {"a": {"type": "revolute", "bodies": [{}, []]}},
            "bodies": [],
            "parameters": {"a": None},
        },
    ],
)
def test_dictionaries_that_no_file_could_give(raw):
    with pytest.raises(SceneError):
        scene_from_dict(raw)


def test_dictionary_that_contains_itself():
    raw = {"bodies": {}}
    raw["bodies"]["bodies"] = raw["bodies"]
    with pytest.raises(SceneError, match="nested too deep"):
        scene_from_dict(raw)


VALID = (
    """title = "t"
gravity = [0, "-g"]
[parameters]
g = 9.81
"""
    + BODIES
    + PIN
    + GUIDE
    + """mu = "g/100"
length = 1
[drives.motor]
type = "angle"
bodies = ["bar", "slider"]
law = { type = "table", times = [0, 1], values = [0, "pi/4"], interpolation = "cubic" }
[springs.spring]
type = "linear"
bodies = ["slider", "ground"]
stiffness = 1e3
[stabilization]
method = "none"
"""
)
PIECES = st.binary(max_size=3) | st.sampled_from(
    [
        b"",
        b"nan",
        b"-1",
        b"[",
        b"]",
        b"{}",
        b'"',
        b".",
        b"=",
        b"1e999",
        b"ground",
        b"bar",
        b"\n",
        b"^",
    ]
)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    edits=st.lists(
        st.tuples(st.integers(0, len(VALID)), st.integers(0, 12), PIECES), min_size=1, max_size=4
    )
)
@example(edits=[])
def test_random_edits_of_a_file_give_a_scene_or_a_scene_error(tmp_path, edits):
    content = VALID.encode()
    for position, length, replacement in edits:
        content = content[:position] + replacement + content[position + length :]
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    try:
        load_scene(path)
    except SceneError as error:
        assert edits and error.problems
        str(error).encode()


WORDS = ["revolute", "translational", "linear", "table", "bar", "slider", "ground", "pi"]
TABLES = st.sampled_from(["type", "law", "bodies", "bar", "guide", "points", "rate", "mass"])
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(WORDS),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TABLES, inner, max_size=3),
    max_leaves=6,
)
KEYS = st.sampled_from(
    [
        "g",
        "t_end",
        "gravity",
        "gravity.1",
        "bodies",
        "bodies.bar",
        "bar.mass",
        "pin.type",
        "pin.bodies",
        "pin.points.0",
        "guide.mu",
        "guide.slider",
        "joints",
        "motor.law",
        "motor.type",
        "motor.law.times",
        "motor.rate",
        "forces",
        "springs.spring.type",
        "stabilization",
        "stabilization.method",
        "parameters",
        "title",
        "guide.direction.0",
    ]
)


@settings(max_examples=200)  # each of 25 keys with each of eight kinds of values, on average
@given(overrides=st.dictionaries(KEYS | st.text(max_size=6), VALUES, max_size=4))
def test_any_value_at_any_key_gives_a_scene_or_a_scene_error(overrides):
    try:
        load_scene("slider-bar-case-1", overrides)
    except SceneError as error:
        assert error.problems
        str(error).encode()


def test_the_file_that_is_edited_above_is_valid(tmp_path):
    (tmp_path / "scene.toml").write_text(VALID)
    assert load_scene(tmp_path / "scene.toml").drives["motor"].law.values == (0, np.pi / 4)


def test_catalogue_names_go_before_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pendulum").write_text("nonsense")
    assert load_scene("pendulum").title == "Simple pendulum" and "pendulum" in catalogue()
