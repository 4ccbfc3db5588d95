"""Models that are written for an engine's users: engines read them back, and find the masses and places of the scene."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from stiction.engines import load_engine
from stiction.engines.exudyn.engine import scene_as_script
from stiction.engines.pybullet.urdf import urdf
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import load_scene
from stiction.cli.app import app


@pytest.mark.parametrize("name", ["slider-bar-case-1", "block-on-incline", "slider-on-moving-guide", "mass-on-belt"])
def test_pybullet_reads_the_urdf(name, tmp_path):
    pybullet = pytest.importorskip("pybullet")
    load_engine("pybullet")
    scene = load_scene(name)
    tree = LinkTree(scene)
    file = tmp_path / "model.urdf"
    file.write_text(urdf(scene))
    client = pybullet.connect(pybullet.DIRECT)
    try:
        model = pybullet.loadURDF(str(file), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
        links = {pybullet.getJointInfo(model, i, physicsClientId=client)[12].decode(): i for i in range(pybullet.getNumJoints(model, physicsClientId=client))}
        position, _ = tree.coordinates(scene)
        names = [link.body or f"{link.joint or 'free'}-{i}" for i, link in enumerate(tree.links)]
        for value, link in zip(position, names):
            pybullet.resetJointState(model, links[link], value, 0.0, physicsClientId=client)
        for body, data in scene.bodies.items():
            mass, _, inertia, *_ = pybullet.getDynamicsInfo(model, links[body], physicsClientId=client)
            assert mass == data.mass and inertia[2] == pytest.approx(data.inertia, rel=1e-15)
            place = pybullet.getLinkState(model, links[body], computeForwardKinematics=True, physicsClientId=client)[0]
            np.testing.assert_allclose(place[:2], data.position, atol=1e-8)  # starts are declared to 1e-9
    finally:
        pybullet.disconnect(client)


def test_command_writes_what_mujoco_reads(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    file = tmp_path / "model.xml"
    ended = CliRunner().invoke(app, ["export", "slider-bar-case-1", "--to", "mjcf", "--out", str(file)])
    assert ended.exit_code == 0, ended.output
    assert mujoco.MjModel.from_xml_path(str(file)).nv == 2


def test_command_writes_the_contacts_that_mujoco_runs(tmp_path):
    """In plain MuJoCo, without the adapter: a box on an incline below its angle of friction stays, to what its corners sink and friction gives way."""
    mujoco = pytest.importorskip("mujoco")
    scene, file = tmp_path / "box.toml", tmp_path / "box.xml"
    scene.write_text("""gravity = [2.0, -9.0]
[bodies.slider]
mass = 2
inertia = 0.1
[joints.guide]
type = "translational"
slider = "slider"
length = 0.6
width = 0.4
mu = 0.3
""")
    ended = CliRunner().invoke(app, ["export", str(scene), "--fidelity", "contact", "--out", str(file)])
    assert ended.exit_code == 0, ended.output
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(300):
        mujoco.mj_step(model, data)
    assert model.nv == 3 and model.npair == 4 and np.abs(data.qpos).max() < 5e-5
    model.pair_friction[:, :2] = 0.1
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert data.qvel[0] == pytest.approx((2.0 - 0.1 * 9.0) * 0.02, rel=0.02)  # so slow that friction recruits no normal force


@pytest.mark.parametrize(("arguments", "code", "words"), [
    (["four-bar", "--fidelity", "contact"], 1, "no translational joint"), (["pendulum", "--fidelity", "point"], 2, "found 'point'; expected joint or contact"),
    (["slider-bar-case-1", "--to", "urdf", "--fidelity", "contact"], 2, "found 'contact'; expected joint with --to urdf"),
    (["four-bar", "--to", "urdf"], 1, "closes a loop"), (["pendulum", "--to", "mjcf"], 1, "drives distances only along a guide"),
    (["four-bar", "--to", "sdf"], 2, "found 'sdf'; expected mjcf, urdf, exudyn"),
    (["slider-on-moving-guide", "--to", "exudyn"], 1, "springs.spring: Exudyn has no item for it"),
    (["hard/kink-at-break-away", "--to", "exudyn"], 1, "a law by table is not written as a script"), (["five-bar", "--to", "mjcf"], 2, "did you mean 'four-bar'?")])
def test_what_a_format_cannot_say_is_refused(arguments, code, words):
    ended = CliRunner().invoke(app, ["export", *arguments])
    assert ended.exit_code == code and words in ended.output + ended.stderr


@pytest.mark.parametrize("name", ["slider-bar-case-1", "slider-bar-case-3", "slider-crank", "four-bar", "mass-on-belt", "block-on-incline"])
def test_the_script_makes_the_motion_of_the_adapter(name, tmp_path):
    """Run by a Python that finds no stiction, it ends where the adapter does."""
    scene = load_scene(name, {"t_end": 2.0})
    file = tmp_path / "model.py"
    file.write_text(scene_as_script(scene))
    ran = subprocess.run([sys.executable, "-I", file], capture_output=True, text=True, cwd=tmp_path, timeout=300)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    end = {line.partition(":")[0]: np.array(line.partition(":")[2].split(), float) for line in ran.stdout.splitlines()[1:]}
    assert end.keys() == scene.bodies.keys() and "stiction" not in re.sub('"""[^"]*"""', "", file.read_text())
    run = load_engine("exudyn").simulate(scene, **({"method": "bristles"} if scene.frictional_guides else {}))
    for body, state in end.items():
        # the same items, settings and steps; redundant constraints are solved by another order of operations
        np.testing.assert_allclose(state, [run[f"{body}.{column}"][-1] for column in ("x", "y", "angle", "vx", "vy", "omega")], atol=1e-9)


@pytest.mark.parametrize("arguments", [["pulled sled.toml"], ["pulled sled.toml", "--set", "sled.mass=3", "--set", "gravity=[0, -1.6]"], ["hard/sliding-rod"]])
def test_the_command_that_the_script_quotes_runs(arguments, tmp_path, monkeypatch, in_this_process):
    monkeypatch.chdir(tmp_path)
    CliRunner().invoke(app, ["new", "pulled sled.toml"])
    script = CliRunner().invoke(app, ["export", *arguments, "--to", "exudyn"])
    assert script.exit_code == 0, script.output
    quoted = shlex.split(re.search(r"`stiction ([^`]*)`", script.output)[1])
    assert quoted[:1] + arguments == quoted[:len(arguments) + 1]
    ended = CliRunner().invoke(app, quoted)
    assert ended.exit_code == 0, ended.output
