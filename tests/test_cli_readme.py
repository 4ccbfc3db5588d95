"""What the README shows works, and its tables name every key there is."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from comparisons.campaign import load_campaign
from engines import load_engine
from scenes import load_scene
from scenes.errors import ELEMENTS, LAWS, STABILIZATIONS
from scenes.model import Scene
from stiction.cli.app import app

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
PYTHON = [text for language, text in BLOCKS if language == "python"]
SCENE, CAMPAIGN = (text for language, text in BLOCKS if language == "toml")
COMMANDS = [shlex.split(line.partition("#")[0])[1:] for line in re.findall(r"^    (stiction .*)$", README, re.MULTILINE)]
SHELL = [shlex.split(line.partition("  #")[0])[1:] for language, text in BLOCKS if language in ("sh", "yaml")
         for line in re.findall(r"(?:^|run: )(stiction [^>\n]*)", text, re.MULTILINE)]
SLOW = {"compare", "validate"}


@pytest.fixture(autouse=True)
def in_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


def section(title):
    return README.partition(f"## {title}\n")[2].partition("\n## ")[0]


@pytest.mark.parametrize("text", [text for text in PYTHON if not text.startswith(("# ", "def test"))])
def test_script(text, tmp_path, compiled):
    (tmp_path / "script.py").write_text(text)
    ended = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True, timeout=600)
    assert ended.returncode == 0 and ended.stderr == "", ended.stderr
    assert "failed" not in ended.stdout and len(ended.stdout.splitlines()) > 3


def test_solver(tmp_path, monkeypatch, in_this_process):
    import engines
    from comparisons import replay

    [text] = [text for text in PYTHON if "def solve(" in text]
    name = text.splitlines()[0].removeprefix("# ")
    (tmp_path / name).write_text(text)
    monkeypatch.setattr(replay, "isolate", engines.isolate)
    ended = CliRunner().invoke(app, ["replay", "--solver", f"{name.removesuffix('.py')}:solve", "--out", "table.csv"])
    assert ended.exit_code == 0, ended.output
    table = pd.read_csv("table.csv")
    assert table["solved"].sum() > 50 and table["wrong"].sum() > 0  # it converges on some only


def test_engine(tmp_path, in_this_process, monkeypatch):
    monkeypatch.setattr("comparisons.measurement.relative_time", lambda call, repeats: (1.0, None))  # no test hangs on a time
    [text] = [text for text in PYTHON if "class " in text]
    name = text.splitlines()[0].removeprefix("# ")
    (tmp_path / name).write_text(text)
    (tmp_path / "ball.toml").write_text("""
        t_end = 1
        gravity = [0, -9.81]
        bodies.ball = {mass = 2, inertia = 1, velocity = [3, 4], angular_velocity = 5}""")
    engine = f"{name.removesuffix('.py')}:FreeFlight"
    runner = CliRunner()
    ended = runner.invoke(app, ["run", "ball.toml", "--engine", engine, "--out", "ball.csv"])
    assert ended.exit_code == 0, ended.output
    frame = pd.read_csv("ball.csv")
    t = frame["t"]
    assert np.allclose(frame["ball.y"], 4 * t - 9.81 * t ** 2 / 2) and np.allclose(frame["ball.angle"], 5 * t)
    assert "knows bodies and gravity only" in load_engine(engine).refusal(load_scene("pendulum"), "joint")
    assert runner.invoke(app, ["run", "ball.toml", "--engine", engine, "--setting", "spin=2"]).exit_code == 2
    held_to_a_baseline = [command for command in SHELL if engine in command]
    assert [command[0] for command in held_to_a_baseline] == ["baseline", "check", "nightly"]
    for command in held_to_a_baseline:
        ended = runner.invoke(app, command)
        assert ended.exit_code == 0, ended.output
        assert command[0] == "baseline" or "Nothing changed beyond noise" in ended.output


@pytest.mark.parametrize("command", SHELL, ids=" ".join)
def test_options_of_a_command_exist(command):
    words = [word for word in command if word.isalpha() and word not in ("main",)][:2 if command[0] == "baseline" else 1]
    described = CliRunner().invoke(app, [*words, "--help"], env={"COLUMNS": "200"})
    assert described.exit_code == 0
    assert {word for word in command if word.startswith("--")} <= set(re.findall(r"--[a-z-]+", described.output))


def test_scene(tmp_path, in_this_process):
    (tmp_path / "sled.toml").write_text(SCENE)
    scene = load_scene("sled.toml")
    assert scene.title.startswith("Sled")
    assert CliRunner().invoke(app, ["run", "sled.toml"]).exit_code == 0


def test_campaign(tmp_path):
    (tmp_path / "sled.toml").write_text(SCENE)
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    campaign = load_campaign("campaign.toml")
    assert len(campaign.runs) == 10 and [run.key for run in campaign.check.runs][1:] == [
        "slider-bar-case-1/tight/rtol=1e-06", "slider-bar-case-1/tight/rtol=1e-09"]


@pytest.mark.parametrize(("text", "new"), [
    (CAMPAIGN, set()), (CAMPAIGN.replace('engine = "pymunk"', 'engine = "exudyn"'), {"pymunk"}),
    (CAMPAIGN.replace("tight", "reference").replace('"projection"', '"baumgarte"'), {"reference"})],
    ids=["as it is", "pymunk is exudyn", "reference is Baumgarte"])
def test_campaign_is_no_regression_of_the_suite(text, new, tmp_path, in_this_process):
    """Its variant `pymunk` has the name of one of the suite's baseline, but is that one's `pymunk, contact`; `tight` is its `reference`."""
    (tmp_path / "sled.toml").write_text(SCENE)
    (tmp_path / "campaign.toml").write_text(text.replace('"time"]', "]"))
    ended = CliRunner().invoke(app, ["nightly", "campaign.toml"])
    assert ended.exit_code == 0 and "**fine" in ended.output, ended.output
    [summary] = tmp_path.glob("nightly/*/summary.json")
    findings = json.loads(summary.read_text())["findings"]
    on_the_slider_bar = {finding["key"].split("/")[1] for finding in findings if finding["kind"] == "status" and finding["key"].startswith("slider-bar")}
    assert on_the_slider_bar == new


def test_test_of_a_solver(tmp_path, compiled):
    [text] = [text for text in PYTHON if text.startswith("def test")]
    (tmp_path / "test_it.py").write_text(text)
    (tmp_path / "my_solver.py").write_text("from engines.reference import ReferenceEngine as MySolver")
    ended = subprocess.run([sys.executable, "-m", "pytest", "-q", "test_it.py"], capture_output=True, text=True,
                           timeout=600)
    assert ended.returncode == 0, ended.stdout


@pytest.mark.parametrize("arguments", [pytest.param(arguments, marks=pytest.mark.long if arguments[0] in SLOW else ())
                                       for arguments in COMMANDS], ids=" ".join)
def test_command(arguments, in_this_process):
    if not {"SCENE", "COMMAND", "RUN", "nightly/history.sqlite"} & set(arguments):
        ended = CliRunner().invoke(app, arguments)
        assert ended.exit_code == 0, ended.output


def test_every_key_of_a_scene_is_described():
    described = set(re.findall(r"`([\w]+)`", section("Scenes"))) | set(re.findall(r"`\[(\w+)", section("Scenes")))
    models = [Scene, *(model for table in (*ELEMENTS.values(), LAWS, STABILIZATIONS) for model in table.values())]
    assert {key for model in models for key in model.model_fields} <= described


def test_every_column_is_described():
    described = {name for group in re.findall(r"`(?:BODY|JOINT|DRIVE|drift)(\.[^`]*)`", section("Columns of a trajectory"))
                 for name in re.findall(r"\.(\w+)", group)}
    trajectory = load_engine("reference").simulate(load_scene("slider-bar-case-1"), t_end=0.1)
    assert {name.rpartition(".")[2] for name in trajectory.columns} == described
