"""Bad input through the real command: exit code 2, a message of one screen that names the culprit, no traceback."""

import os
import subprocess
import sys

import pytest
from conftest import invoke

from stiction.cli.exit_codes import BAD_INPUT

SCREEN = 30  # lines

SCENE = """
gravity = [0, -9.81]
[parameters]
m = 2
[bodies.sled]
mass = "m"
inertia = 1
[joints.guide]
type = "translational"
slider = "sled"
length = 0.4
mu = 0.2
mus = 0.3
[drives.motor]
type = "distance"
bodies = ["sled", "ground"]
axis = [1, 0]
law = { type = "linear", rate = 1 }
"""

BROKEN_SCENES = {  # what is replaced, by what, what the message must name; `test_loading` has all that can be wrong
    "misspelt key": ("inertia = 1", "inertai = 1", ["inertai", "did you mean 'inertia'"]),
    "inconsistent start": (
        "inertia = 1",
        "inertia = 1\nposition = [0, 0.5]",
        ["guide.normal_force", "residual 0.5", "--assemble"],
    ),
    "key with an umlaut": ("m = 2", "m = 2\nmüh = 3", ["line 5", "a-z, A-Z"]),
    "two at once": (
        "m = 2",
        "m = 0\n[forces.load]\ntype = 'torque'\nbody = 'sledge'",
        ["bodies.sled.mass", "forces.load.body", "forces.load.law"],
    ),
}

BAD_COMMANDS = [  # arguments, what the message must name
    ("run", ["SCENE"]),
    ("run nosuch", ["nosuch", "no such file", "block-on-incline"]),
    ("run .", ["a folder"]),
    ("run pendulm", ["did you mean 'pendulum'"]),
    ("run pendulum --engine pymnk", ["pymnk", "did you mean 'pymunk'"]),
    ("run pendulum --engine os:path", ["os:path", "expected a class derived from"]),
    ("run pendulum --fidelity jont", ["jont", "joint, contact"]),
    ("run pendulum --dt 0.01 --rtol 1e-6", ["--dt, --rtol", "0.01", "1e-06"]),
    ("run pendulum --dt 0", ["--dt", "'0'", "> 0"]),
    ("run pendulum --dt -1e-3", ["--dt", "-1e-3"]),
    ("run pendulum --dt nan", ["--dt", "nan"]),
    ("run pendulum --dt 1 --t-end 0.1", ["dt", "at most t_end"]),
    ("run pendulum --dt 1e-12 --t-end 10", ["dt", "1e-12", "1e+13 steps", "1e-08"]),
    ("run pendulum --dt 1e-12 --t-end 10 --engine pymunk", ["dt", "1e-12", "1e+13 steps", "1e-08"]),
    ("run pendulum --t-end 1e9 --output-step 1e3 --engine pymunk", ["dt", "0.001", "1e+12 steps"]),
    (
        "run pendulum --t-end 1e9 --output-step 1e3 --setting method=paper",
        ["dt", "0.001", "1e+12 steps"],
    ),
    ("run pendulum --rtol 1e-20", ["rtol", "1e-20"]),
    ("run pendulum --rtol 1e-6 --engine pymunk", ["rtol", "pymunk has a fixed step"]),
    ("run pendulum --t-end soon", ["--t-end", "soon"]),
    ("run pendulum --t-end -1", ["--t-end", "-1"]),
    ("run pendulum --output-step 0", ["--output-step", "'0'"]),
    ("run pendulum --timeout inf", ["--timeout", "inf"]),
    ("run pendulum --set gravity", ["'gravity'", "KEY=VALUE"]),
    ("run pendulum --set =3", ["'=3'", "no key"]),
    ("run pendulum --set masss.mass=3", ["masss", "did you mean 'mass'"]),
    ("run pendulum --set mass.mass=heavy", ["bodies.mass.mass", "heavy"]),
    ("run pendulum --set gravity=[0", ["gravity", "TOML list"]),
    ("run pendulum --setting colour=red", ["colour", "stabilization"]),
    ("run pendulum --setting stabilization=glue", ["stabilization", "glue", "projection"]),
    ("run pendulum --setting dt=1", ["--setting", "dt", "which is no setting"]),
    ("run pendulum --setting iterations", ["--setting", "iterations", "KEY=VALUE"]),
    ("run pendulum --engine pymunk --setting iterations=many", ["iterations", "many"]),
    ("run pendulum --out result.xlsx", ["--out", "result.xlsx", ".parquet"]),
    (
        "run pendulum --out nowhere/result.csv",
        ["--out", "nowhere/result.csv", "folder that exists"],
    ),
    ("run pendulum --outt result.csv", ["--outt"]),
    ("run pendulum --plot run.gif", ["'--plot': found 'run.gif'"]),
    ("run pendulum --plot none/run.png", ["none/run.png", "folder"]),
    ("run pendulum --animate run.png", ["--animate: found 'run.png'"]),
    ("draw pendulum -o scene.toml", ["'-o': found 'scene.toml'"]),
    ("new scene.json", ["FILE", "scene.json", ".toml"]),
    ("new none/scene.toml", ["FILE", "folder"]),
    ("new mine.toml --like slider-bra", ["slider-bra", "did you mean"]),
    ("schema --out schema.toml", ["--out", ".json"]),
    ("page nosuch", ["nosuch", "does not exist", "folder of a run"]),
    (
        "check --baseline bad.toml",
        ["format: found nothing; this key is required", "foo: found 1; unknown key"],
    ),
    ("fly pendulum", ["fly"]),
    ("explain nosuch", ["nosuch"]),
    ("compare speed pendulum", ["speed"]),
    ("compare drift nosuch", ["nosuch"]),
    ("compare cost pendulum pendulum", ["pendulum", "different names"]),
    ("compare drift pendulum --engines pymunk,havok", ["havok", "pymunk"]),
    ("compare drift pendulum --set mass.position.0=-2", ["rod.effort", "residual 1", "--assemble"]),
    ("compare drift pendulum --workers 0", ["--workers", "'0'"]),
    ("compare threshold pendulum --out table.doc", ["--out", "table.doc"]),
    ("compare threshold pendulum", ["pendulum", "no joint with friction"]),
    ("compare threshold slider-bar-case-1 --range 3", ["--range", "LOW:HIGH"]),
    ("compare threshold slider-bar-case-1 --range 3:1", ["range", "LOW < HIGH"]),
    ("compare threshold slider-bar-case-1 --range 0:x", ["--range", "x"]),
    ("compare threshold slider-bar-case-1 --resolution 99", ["resolution", "at most"]),
    ("compare threshold slider-bar-case-1 --joint pin", ["joint", "pin", "guide"]),
    ("compare threshold slider-bar-case-1 --parameter nonsense --range 0:1", ["nonsense"]),
    ("compare accuracy slider-bar-case-1 --range 0:1", ["--range", "does not have this option"]),
    ("compare torque four-bar", ["four-bar", "no drive"]),
    ("compare torque slider-bar-case-1 --drive engine", ["drive", "engine", "motor"]),
    ("validate --engines havok", ["havok", "pybullet"]),
    ("validate --workers 1.5", ["--workers", "1.5", "whole number"]),
    ("validate --out full", ["--out", "full", "not empty"]),
]


@pytest.fixture(autouse=True)
def in_empty_folder(tmp_path, monkeypatch, in_this_process):
    monkeypatch.chdir(tmp_path)


def refused(arguments, culprits):
    result = invoke(*arguments, exit_code=BAD_INPUT)
    assert result.stdout == ""
    assert "Traceback" not in result.output
    assert len(result.output.splitlines()) < SCREEN
    for culprit in culprits:
        assert culprit in result.output


@pytest.mark.parametrize("name", BROKEN_SCENES)
def test_broken_scene(name, tmp_path):
    found, replacement, culprits = BROKEN_SCENES[name]
    assert SCENE.count(found) == 1
    (tmp_path / "broken.toml").write_text(SCENE.replace(found, replacement))
    refused(["run", "broken.toml"], [*culprits, "broken.toml"])


def test_the_scene_that_is_broken_above_is_sound(tmp_path):
    (tmp_path / "sound.toml").write_text(SCENE)
    invoke("explain", "sound.toml")


@pytest.mark.parametrize(("line", "culprits"), BAD_COMMANDS, ids=[line for line, _ in BAD_COMMANDS])
def test_bad_command(line, culprits, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("not a report")
    (tmp_path / "bad.toml").write_text("foo = 1")
    refused(line.split(), culprits)


@pytest.mark.skipif(
    os.name == "nt" or os.geteuid() == 0, reason="needs a folder that this user cannot write"
)
def test_unwritable_folder(tmp_path):
    (tmp_path / "locked").mkdir(mode=0o500)
    refused(["run", "pendulum", "--out", "locked/result.csv"], ["--out", "locked/result.csv"])
    refused(["validate", "--out", "locked/report"], ["--out", "locked"])


@pytest.mark.parametrize(
    "arguments", [["run", "pendulum", "--setting", "colour=red"], ["--nosuch"]]
)
def test_as_a_process(arguments):
    ended = subprocess.run(
        [sys.executable, "-m", "stiction", *arguments], capture_output=True, text=True, timeout=600
    )
    assert ended.returncode == BAD_INPUT
    assert ended.stdout == ""
    assert "Traceback" not in ended.stderr and 0 < len(ended.stderr.splitlines()) < SCREEN
