"""Models that are written for an engine's users: engines alone read them and make the motion of their adapters."""

import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.engines import load_engine
from stiction.engines.assembly import Assembly
from stiction.engines.exudyn.engine import scene_as_script
from stiction.engines.mujoco.engine import scene_as_mjcf
from stiction.engines.pybullet.urdf import urdf
from stiction.engines.shared.joint_coordinates import motor_link
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.step_kernels import Balance, applied_loads
from stiction.scenes import load_scene
from stiction.scenes.laws import evaluate_law

FLOATING = """gravity = [0.0, -9.81]
[bodies]
arm = { mass = 2, inertia = 0.3, position = [1.0, 2.0], velocity = [1.0, 0.5], angular_velocity = 1.0 }
tip = { mass = 1, inertia = 0.1, position = [1.5, 2.2], velocity = [0.7, 1.0], angular_velocity = 1.5 }
[joints]
pin = { type = "revolute", bodies = ["arm", "tip"], points = [[0.5, 0.0], [0.0, -0.2]] }
[springs]
stay = { type = "linear", bodies = ["tip", "ground"], points = [[0.1, 0.2], [0.5, 0.0]], stiffness = 40, damping = 0.7, rest_length = 1.5 }
rail = { type = "linear", bodies = ["arm", "ground"], points = [[-0.3, 0.1], [0.2, 0.4]], axis = [3.0, 4.0], stiffness = 30, damping = 0.9, rest_length = -0.4 }
twist = { type = "torsional", bodies = ["tip", "arm"], stiffness = 5, damping = 0.2, rest_angle = -1.0 }
[forces]
push = { type = "force", body = "arm", direction = [1, 1], point = [0.3, 0.0], law = { type = "sine", amplitude = 3, frequency = 2 } }
turn = { type = "torque", body = "tip", law = { type = "linear", rate = 0.3 } }
"""
"""Two bodies that nothing holds, with a spring of each kind, dampers, and a load off the centre of mass."""
FOLLOWING = """
[bodies]
slider = { mass = 2, inertia = 0.1 }
bar = { mass = 1, inertia = 0.1, position = [0.5, 0.0], angular_velocity = 0.6, velocity = [0.0, 0.3] }
[joints]
guide = { type = "translational", slider = "slider" }
pin = { type = "revolute", bodies = ["slider", "bar"], points = [[0.0, 0.0], [-0.5, 0.0]] }
[drives]
motor = { type = "angle", bodies = ["slider", "bar"], law = { type = "sine", amplitude = -0.3, frequency = 2 } }
[springs]
across = { type = "linear", bodies = ["slider", "ground"], axis = [-1.0, 0.0], points = [[0.2, 0.1], [0.7, 0.3]], stiffness = 9, rest_length = -0.2 }
"""
"""A motor whose law is no line, against the direction of its joint, and a spring against the direction of its guide."""
WRITTEN = {"floating": FLOATING, "following": FOLLOWING}


def _scene(name, folder):
    if name not in WRITTEN:
        return load_scene(name)
    file = folder / f"{name}.toml"
    file.write_text(WRITTEN[name])
    return load_scene(file)


def _recorded(engine, scene, fidelity, steps, bounds):
    """The tree of a scene, the motion of an engine's adapter, and the bounds of each step's last pass."""
    tree, settings, motion = LinkTree(scene, fidelity), [], []
    with engine.stepper(
        Assembly(scene), STEP, engine.default_settings(fidelity), fidelity
    ) as stepper:
        stepper.compile()
        advance = stepper.advance

        def advance_once(caps):
            advance(caps)
            last[:] = [bounds(stepper, caps)]

        last, stepper.advance = [], advance_once
        for _ in range(steps):
            stepper.step()
            settings += last
            motion.append(stepper.position.copy())
    return tree, np.array(motion), settings


STEP = 1e-3
ROUNDING = 1e-9
"""m, rad: a thousand times what a step of 1e4 rounds, for motions that do not part of themselves."""
TURNED = 5e-8
"""m, rad: a motor of 10 N m moves the rotor of a drive, 1e10 kg m^2, by 1e-9 rad/s^2 times half the square of 8 s."""


@pytest.mark.parametrize(
    ("name", "fidelity", "t_end", "off"),
    [
        ("slider-bar-case-1", "joint", 8.0, TURNED),
        ("slider-bar-case-3", "joint", 8.0, TURNED),
        ("coulomb-oscillator", "joint", 4.0, ROUNDING),
        ("elliptic-trammel", "joint", 4.0, ROUNDING),
        ("mass-on-belt", "joint", 4.0, TURNED),
        ("slider-on-moving-guide", "joint", 8.0, ROUNDING),
        ("hard/start-on-corner", "joint", 0.4, ROUNDING),
        ("hard/kink-at-break-away", "joint", 2.0, ROUNDING),
        ("floating", "joint", 2.0, ROUNDING),
        ("following", "joint", 4.0, ROUNDING),
        ("slider-bar-case-1", "contact", 8.0, TURNED),
        ("slider-bar-case-3", "contact", 4.0, TURNED),
        ("hard/weightless-instants", "contact", 2.0, ROUNDING),
    ],
)
def test_the_mjcf_makes_the_motion_of_the_adapter(name, fidelity, t_end, off, tmp_path):
    """Plain MuJoCo steps the file, given what its header names: laws of time, and what the adapter set of friction."""
    mujoco = pytest.importorskip("mujoco")
    scene, steps = _scene(name, tmp_path), round(t_end / STEP)
    frictions = ("dof_frictionloss", "pair_friction", "pair_solreffriction")
    _, motion, settings = _recorded(
        load_engine("mujoco"),
        scene,
        fidelity,
        steps,
        lambda stepper, caps: [getattr(stepper.model, name).copy() for name in frictions],
    )
    text = scene_as_mjcf(scene, STEP, fidelity)
    header = text[: text.index("-->")]
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    set_by_hand = {name: load for name, load in scene.forces.items() if load.law.type != "constant"}
    followed = {
        name: drive
        for name, drive in scene.drives.items()
        if drive.law.type not in ("constant", "linear")
    }
    assert all(f'"{name}' in header for name in (*set_by_hand, *followed, *scene.frictional_guides))
    assert "bodies goes into xfrc_applied: nothing" in header
    worst = 0.0
    for k in range(steps):
        for friction, values in zip(frictions, settings[k]):
            getattr(model, friction)[:] = values
        for actuator, load in set_by_hand.items():
            data.ctrl[model.actuator(actuator).id] = evaluate_law(load.law, k * STEP)[0]
        for (
            actuator,
            drive,
        ) in followed.items():
            # of "following": its joint turns against the law, from 0
            rate = (-evaluate_law(drive.law, (k + 1) * STEP)[0] - data.qpos[1]) / STEP
            data.ctrl[model.actuator(actuator).id] = (rate - data.qvel[1]) / STEP
        mujoco.mj_step(model, data)
        worst = max(worst, np.abs(data.qpos - motion[k]).max())
    assert worst < off and np.ptp(motion, axis=0).max() > 0.01


@pytest.mark.parametrize(
    ("name", "t_end"),
    [
        ("slider-bar-case-1", 4.5),
        ("slider-bar-case-3", 2.5),
        ("coulomb-oscillator", 4.0),
        ("block-on-incline", 2.0),
        ("mass-on-belt", 4.0),
        ("slider-on-moving-guide", 4.0),
        ("hard/weightless-instants", 2.0),
        ("floating", 2.0),
    ],
)
def test_the_urdf_makes_the_motion_of_the_adapter(name, t_end, tmp_path, capfd):
    """Plain PyBullet reads the file without a warning and steps it, given what its header names."""
    pybullet = pytest.importorskip("pybullet")
    scene, steps = _scene(name, tmp_path), round(t_end / STEP)
    engine = load_engine("pybullet")
    tree, motion, bounds = _recorded(
        engine, scene, "joint", steps, lambda stepper, caps: list(zip(stepper.friction_links, caps))
    )
    file = tmp_path / "model.urdf"
    file.write_text(urdf(scene))
    header = file.read_text()[: file.read_text().index("-->")]
    named = (*scene.drives, *scene.forces, *scene.springs, *scene.frictional_guides)
    assert all(f'"{name}"' in header for name in named)
    client = pybullet.connect(pybullet.DIRECT)
    here, balance = {"physicsClientId": client}, Balance.of(Assembly(scene).whole)
    try:
        capfd.readouterr()
        model = pybullet.loadURDF(
            str(file), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE, **here
        )
        assert "arning" not in "".join(capfd.readouterr())
        links = range(pybullet.getNumJoints(model, **here))
        joints = {pybullet.getJointInfo(model, i, **here)[12].decode(): i for i in links}
        order = [
            joints[link.body or f"{link.joint or 'free'}-{i}"] for i, link in enumerate(tree.links)
        ]
        for body, data in scene.bodies.items():
            mass, _, inertia, *_ = pybullet.getDynamicsInfo(model, joints[body], **here)
            assert mass == data.mass and inertia[2] == pytest.approx(data.inertia, rel=1e-15)
        pybullet.setTimeStep(STEP, **here)
        iterations = engine.default_settings("joint")["iterations"]
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=iterations, solverResidualThreshold=0.0, **here
        )
        pybullet.setGravity(*(scene.gravity or (0.0, 0.0)), 0.0, **here)

        def move(link, rate, force):
            pybullet.setJointMotorControl2(
                model,
                order[link],
                pybullet.VELOCITY_CONTROL,
                targetVelocity=rate,
                force=force,
                **here,
            )

        for link, start in enumerate(zip(*tree.coordinates(scene))):
            pybullet.changeDynamics(
                model,
                order[link],
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                maxJointVelocity=1e9,
                **here,
            )
            move(link, 0.0, 0.0)
            pybullet.resetJointState(model, order[link], *start, **here)
        for drive in scene.drives.values():  # lines, all of them
            link, sign = motor_link(scene, tree, drive)
            move(link, sign * evaluate_law(drive.law, 0.0)[1], 1e9)
        for k in range(steps):
            states = np.array([pybullet.getJointState(model, joint, **here)[:2] for joint in order])
            for joint, state in zip(order, states):
                # else forces act where the links were a step before
                pybullet.resetJointState(model, joint, *state, **here)
            for link, cap in bounds[k]:
                move(link, 0.0, cap)
            q, v, _ = tree.motion(*states.T.copy(), np.zeros(len(order)))
            applied_loads(balance, k * STEP, q, v, 0.0)
            for body, place, load in zip(
                scene.bodies, q.reshape(-1, 3), balance.loads.reshape(-1, 3)
            ):
                pybullet.applyExternalForce(
                    model,
                    joints[body],
                    [*load[:2], 0.0],
                    [*place[:2], 0.0],
                    pybullet.WORLD_FRAME,
                    **here,
                )
                pybullet.applyExternalTorque(
                    model, joints[body], [0.0, 0.0, load[2]], pybullet.WORLD_FRAME, **here
                )
            pybullet.stepSimulation(**here)
            ends = np.array([pybullet.getJointState(model, joint, **here)[0] for joint in order])
            assert np.abs(ends - motion[k]).max() < ROUNDING
    finally:
        pybullet.disconnect(client)


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
    ended = CliRunner().invoke(
        app, ["export", str(scene), "--fidelity", "contact", "--out", str(file)]
    )
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
    assert data.qvel[0] == pytest.approx(
        (2.0 - 0.1 * 9.0) * 0.02, rel=0.02
    )  # so slow that friction recruits no normal force


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["four-bar", "--fidelity", "contact"], 1, "no translational joint"),
        (["pendulum", "--fidelity", "point"], 2, "found 'point'; expected joint or contact"),
        (
            ["slider-bar-case-1", "--to", "urdf", "--fidelity", "contact"],
            2,
            "found 'contact'; expected joint with --to urdf",
        ),
        (["four-bar", "--to", "urdf"], 1, "closes a loop"),
        (["pendulum", "--to", "mjcf"], 1, "drives distances only along a guide"),
        (["four-bar", "--to", "sdf"], 2, "found 'sdf'; expected mjcf, urdf, exudyn"),
        (
            ["slider-on-moving-guide", "--to", "exudyn"],
            1,
            "springs.spring: Exudyn has no item for it",
        ),
        (
            ["hard/kink-at-break-away", "--to", "exudyn"],
            1,
            "a law by table is not written as a script",
        ),
        (["five-bar", "--to", "mjcf"], 2, "did you mean 'four-bar'?"),
    ],
)
def test_what_a_format_cannot_say_is_refused(arguments, code, words):
    ended = CliRunner().invoke(app, ["export", *arguments])
    assert ended.exit_code == code and words in ended.output + ended.stderr


@pytest.mark.parametrize(
    ("name", "t_end"),
    [
        ("slider-bar-case-1", 4.5),
        ("slider-bar-case-3", 2.5),
        ("slider-crank", 2.0),
        ("four-bar", 2.0),
        ("mass-on-belt", 2.0),
        ("block-on-incline", 2.0),
        ("pendulum-dry-pin", 2.0),
        ("slider-crank-dry-pins", 0.4),
    ],
)
def test_the_script_makes_the_motion_of_the_adapter(name, t_end, tmp_path):
    """Run by a Python that finds no stiction, it ends where the adapter does."""
    scene = load_scene(name, {"t_end": t_end})
    file = tmp_path / "model.py"
    file.write_text(scene_as_script(scene))
    ran = subprocess.run(
        [sys.executable, "-I", file], capture_output=True, text=True, cwd=tmp_path, timeout=300
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    end = {
        line.partition(":")[0]: np.array(line.partition(":")[2].split(), float)
        for line in ran.stdout.splitlines()[1:]
    }
    assert end.keys() == scene.bodies.keys() and "stiction" not in re.sub(
        '"""[^"]*"""', "", file.read_text()
    )
    run = load_engine("exudyn").simulate(
        scene, **({"method": "bristles"} if scene.frictional_joints else {})
    )
    for body, state in end.items():
        # the same items, settings and steps; what Newton's method leaves of a step, up to its tolerance of 1e-9,
        # depends on where a run was interrupted
        ours = [run[f"{body}.{column}"][-1] for column in ("x", "y", "angle", "vx", "vy", "omega")]
        np.testing.assert_allclose(state, ours, atol=2e-9)


@pytest.mark.parametrize(
    "arguments",
    [
        ["pulled sled.toml"],
        ["pulled sled.toml", "--set", "sled.mass=3", "--set", "gravity=[0, -1.6]"],
        ["hard/sliding-rod"],
    ],
)
def test_the_command_that_the_script_quotes_runs(arguments, tmp_path, monkeypatch, in_this_process):
    monkeypatch.chdir(tmp_path)
    CliRunner().invoke(app, ["new", "pulled sled.toml"])
    script = CliRunner().invoke(app, ["export", *arguments, "--to", "exudyn"])
    assert script.exit_code == 0, script.output
    quoted = shlex.split(re.search(r"`stiction ([^`]*)`", script.output)[1])
    assert quoted[:1] + arguments == quoted[: len(arguments) + 1]
    ended = CliRunner().invoke(app, quoted)
    assert ended.exit_code == 0, ended.output
