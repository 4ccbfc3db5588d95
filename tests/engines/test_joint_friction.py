"""Dry friction with constant bounds, and damping, in joints of engines at joint fidelity, against closed forms."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from conftest import installed

from stiction.engines import load_engine
from stiction.engines.mujoco.engine import scene_as_mjcf
from stiction.engines.protocol import FRICTION_SUPPLIED_BY, Refused
from stiction.scenes import Scene, Trajectory, load_scene, scene_from_dict, vary
from stiction.truths.closed_form.dry_friction import (
    MassesInSeries,
    RampedStart,
    pendulum_turning_angles,
)

INERTIA = 0.1
"""Moment of inertia of the arm, kg m^2."""
BOUND = 2.0
"""Bound of friction in its pin, N m."""
STEP = 1e-3


class Method(NamedTuple):
    """An engine with its settings, who supplies its law, and the speed with which it creeps.

    `creep` is that of a joint that friction holds, relative to the speed that its load would give it in a step;
    `switches` tells whether the adapter changes the bounds where that at rest is larger.
    """

    engine: str
    supplier: str
    creep: float
    settings: dict[str, Any] = {}
    switches: bool = True

    def run(self, scene: Scene, t_end: float, dt: float = STEP) -> Trajectory:
        """Run a scene; every step is a sample."""
        simulate = load_engine(self.engine).simulate
        return simulate(scene, t_end=t_end, dt=dt, output_step=dt, **self.settings)

    def __str__(self) -> str:
        return "-".join([self.engine, *map(str, self.settings.values())])


METHODS = [
    Method("pymunk", "engine", 1e-12),
    Method("pybullet", "engine", 1e-12),
    Method("mujoco", "engine", 1e-9),
    Method("dart", "engine", 1.01e-9),  # DART_CFM
    Method("drake", "adapter", 1.01 / (2 * np.pi / 0.1) ** 2),  # the largest gain of its servos
    Method("exudyn", "adapter", 1e-12),
    Method("exudyn", "engine", 1e-6, {"method": "bristles"}, switches=False),
    Method("siconos", "engine", 1e-9, {"fidelity": "contact"}),
]
OWN = [method for method in METHODS if method.supplier == "engine"]
"""Methods whose friction is the engine's own."""
PACKAGES = {"drake": "pydrake", "dart": "dartpy"}
"""Packages of engines that have another name than the engine."""


@pytest.fixture(params=METHODS, ids=str)
def method(request):
    engine = request.param.engine
    if engine == "siconos":
        installed(engine)  # by the system, for another Python
    else:
        pytest.importorskip(PACKAGES.get(engine, engine))
    return request.param


def arm(torque: float, **pin: float) -> Scene:
    """Return an arm whose centre of mass is in its pin, under a constant torque."""
    return scene_from_dict(
        {
            "title": "Arm",
            "t_end": 1.0,
            "bodies": {"arm": {"mass": 1.0, "inertia": INERTIA}},
            "joints": {"pin": {"type": "revolute", "bodies": ["arm", "ground"], **pin}},
            "forces": {
                "motor": {
                    "type": "torque",
                    "body": "arm",
                    "law": {"type": "constant", "value": torque},
                }
            },
        }
    )


def slider(push: dict[str, Any], velocity: float = 0.0, **guide: float) -> Scene:
    """Return a slider of 2 kg on a level guide, pushed along it by a law."""
    return scene_from_dict(
        {
            "title": "Slider",
            "t_end": 1.0,
            "gravity": [0.0, -9.81],
            "bodies": {"slider": {"mass": 2.0, "inertia": 0.1, "velocity": [velocity, 0.0]}},
            "joints": {"guide": {"type": "translational", "slider": "slider", **guide}},
            "forces": {
                "push": {"type": "force", "body": "slider", "direction": [1, 0], "law": push}
            },
        }
    )


@pytest.mark.parametrize("part", [0.1, 0.3, 0.5, 0.9, 0.99])
def test_arm_is_held_below_its_bound(method, part):
    """It rests, or creeps by no more than the method's regularization, and friction is the torque of the motor."""
    run = method.run(arm(part * BOUND, friction=BOUND), 0.3)
    free = part * BOUND / INERTIA * STEP
    assert np.abs(run["arm.omega"][len(run.t) // 2 :]).max() <= method.creep * free + 1e-15
    assert run["pin.friction"][-1] == pytest.approx(-part * BOUND, rel=1e-6)
    assert run.settings[FRICTION_SUPPLIED_BY] == method.supplier


@pytest.mark.parametrize("sense", [1, -1])
def test_arm_turns_beyond_its_bound(method, sense):
    """I omega' = T - tau, in both directions, and friction is the bound."""
    run = method.run(arm(sense * 1.5 * BOUND, friction=BOUND), 0.3)
    expected = sense * 0.5 * BOUND / INERTIA * 0.3
    # pymunk's samples have the velocity of half a step later. Bristles stretch first, by tau/k, for
    # which they take a few steps.
    steps = 20 if "method" in method.settings else 1
    within = steps * STEP * 0.5 * BOUND / INERTIA
    assert run["arm.omega"][-1] == pytest.approx(expected, abs=within)
    assert run["pin.friction"][-1] == pytest.approx(-sense * BOUND, rel=1e-6)
    assert run["pin.mode"][-1] == sense


def test_pendulum_turns_where_the_energy_says(method):
    """The last turning angle, at which it stays, has the error of the step, which falls with it."""
    scene = load_scene("pendulum-dry-pin")
    p = scene.parameters
    angles = pendulum_turning_angles(
        p["m"] * p["g"] * p["l"], p["friction"], p["static_friction"], p["start"]
    )
    errors = []
    for dt in (4e-3, 1e-3):
        run = method.run(scene, scene.t_end, dt)
        errors.append(abs(run["bar.angle"][-1] + np.pi / 2 - angles[-1]))
        assert abs(run["bar.omega"][-1]) < 1e-6
    # Near a turning angle the speed is linear in time, so that an instant off by h moves the angle by
    # h^2 times the largest acceleration, 15 rad/s^2; there are nine turns.
    assert errors[0] < 9 * 15 * 4e-3**2
    assert errors[1] < 9 * 15 * 1e-3**2


def test_vertical_slider_comes_to_rest_and_sinks(method):
    """Upwards it is braked by g + F/m; it then sinks with g - F/m, as its weight exceeds F."""
    scene = vary(load_scene("vertical-slider"), {"static_friction": 15})
    run = method.run(scene, 1.0)
    turn = 3 / (9.81 + 7.5)
    height = 3 * turn / 2 - (9.81 - 7.5) * (1 - turn) ** 2 / 2
    assert run["slider.vy"][-1] == pytest.approx(-(9.81 - 7.5) * (1 - turn), abs=60 * STEP)
    assert run["slider.y"][-1] == pytest.approx(height, abs=40 * STEP)
    assert run["guide.friction"][[1, -1]] == pytest.approx([-15, 15], rel=1e-6)


def two_links(lower: float, upper: float) -> Scene:
    """Return two links; the second, balanced on its pin, is turned by 0.7 N m. Bounds of both pins in N m."""
    return scene_from_dict(
        {
            "title": "Two links",
            "t_end": 0.3,
            "bodies": {
                "first": {"mass": 1.0, "inertia": 0.1, "position": [0.5, 0.0]},
                "second": {"mass": 2.0, "inertia": 0.2, "position": [1.0, 0.0]},
            },
            "joints": {
                "lower": {
                    "type": "revolute",
                    "bodies": ["first", "ground"],
                    "points": [[-0.5, 0], [0, 0]],
                    "friction": lower,
                },
                "upper": {
                    "type": "revolute",
                    "bodies": ["first", "second"],
                    "points": [[0.5, 0], [0, 0]],
                    "friction": upper,
                },
            },
            "forces": {
                "motor": {
                    "type": "torque",
                    "body": "second",
                    "law": {"type": "constant", "value": 0.7},
                },
            },
        }
    )


def test_the_weaker_of_two_pins_gives_way(method):
    """The pin force on a balanced link is zero at first, so that only torques of friction are passed on."""
    coarse = 0.02 if "method" in method.settings else 2 * STEP / 0.3
    run = method.run(two_links(1.0, 0.5), 0.3)
    assert run["second.omega"][-1] == pytest.approx(0.2 / 0.2 * 0.3, rel=coarse)
    assert abs(run["first.omega"][-1]) < 1e-3
    assert run["upper.friction"][-1] == pytest.approx(0.5, rel=1e-6)  # on the first body
    assert run["lower.friction"][-1] == pytest.approx(-0.5, rel=1e-3)
    swapped = method.run(two_links(0.5, 1.0), 0.3)
    inertia = 0.1 + 1.0 * 0.5**2 + 0.2 + 2.0 * 1.0**2
    assert swapped["first.omega"][-1] == pytest.approx(0.2 / inertia * 0.3, rel=max(coarse, 1e-4))
    # the upper pin turns the second link: 0.7 - f = I_2 alpha
    held = 0.7 - 0.2 * 0.2 / inertia
    assert swapped["upper.friction"][-1] == pytest.approx(held, rel=1e-3)


def test_break_away_under_a_ramp(method):
    """Static 5 N, kinetic 0.5 N: who supplies what, the instant of break-away, and the motion after it."""
    push = {"type": "linear", "offset": 0.0, "rate": 10.0}
    scene = slider(push, friction=0.5, static_friction=5.0)
    run = method.run(scene, 0.7)
    truth = RampedStart(2.0, 0.0, 10.0, 0.5, 5.0)
    let_go = run.t[np.argmax(np.abs(run["slider.vx"]) > 1e-3)]
    late = 3 if "method" not in method.settings else 10  # steps
    assert let_go == pytest.approx(truth.break_away, abs=late * STEP)
    after = float(truth.displacement(np.array([0.7]))[0])
    speed = 4.5 / 2 * 0.2 + 5 * 0.2**2 / 2
    assert run["slider.x"][-1] == pytest.approx(after, abs=late * STEP * speed)
    if method.supplier == "engine":
        expected = "engine + adapter" if method.switches else "engine"
        assert run.settings[FRICTION_SUPPLIED_BY] == expected


def test_constant_and_proportional_bounds_add_up(method):
    """m a = P - F - mu m g; the law that depends on the load is the engine's alone at contacts only."""
    scene = slider({"type": "constant", "value": 12.0}, friction=3.0, mu=0.2)
    run = method.run(scene, 0.5)
    acceleration = (12.0 - 3.0 - 0.2 * 2.0 * 9.81) / 2.0
    within = 5 * STEP if "method" not in method.settings else 20 * STEP
    assert run["slider.vx"][-1] == pytest.approx(acceleration * 0.5, abs=within * acceleration)
    assert run["guide.friction"][-1] == pytest.approx(-3.0 - 0.2 * 2.0 * 9.81, rel=1e-6)
    if method.settings.get("fidelity") != "contact":
        assert run.settings[FRICTION_SUPPLIED_BY] != "engine"
    held = method.run(slider({"type": "constant", "value": 6.0}, friction=3.0, mu=0.2), 0.5)
    assert abs(held["slider.vx"][-1]) < 1e-4


@pytest.mark.parametrize("bounds", [(4.0, 6.0), (6.0, 4.0)])
def test_masses_in_series(method, bounds):
    """A guide on a moving body: the smaller of two bounds gives way first."""
    lower, upper = bounds
    truth = MassesInSeries(1.0, 0.5, lower, upper, 10.0)
    guide = {"type": "translational", "direction": [1, 0]}
    scene = scene_from_dict(
        {
            "title": "Series",
            "t_end": 1.0,
            "bodies": {
                "low": {"mass": 1.0, "inertia": 0.1},
                "high": {"mass": 0.5, "inertia": 0.1},
            },
            "joints": {
                "lower": {**guide, "slider": "low", "friction": lower},
                "upper": {**guide, "slider": "high", "guide": "low", "friction": upper},
            },
            "forces": {
                "push": {
                    "type": "force",
                    "body": "high",
                    "direction": [1, 0],
                    "law": {"type": "linear", "offset": 0.0, "rate": 10.0},
                }
            },
        }
    )
    run = method.run(scene, 1.0)
    for name, begin in truth.break_aways().items():
        slips = np.abs(run[f"{name}.slip_velocity"]) > 3e-3
        if np.isinf(begin) or begin > 1.0:
            assert not slips.any()
        else:
            # from rest, a ramp of 10 N/s makes 3e-3 m/s of 1.5 kg in 0.03 s
            assert run.t[np.argmax(slips)] == pytest.approx(begin + 0.015, abs=0.02)


def test_damping_of_joints(method):
    """M x'' = -c x' of a guide, I omega' = T - c omega of a pin."""
    guide = slider({"type": "constant", "value": 0.0}, velocity=1.0, damping=4.0)
    run = method.run(guide, 0.5)
    assert run["slider.vx"][-1] == pytest.approx(np.exp(-2 * 0.5), abs=2 * STEP)
    run = method.run(arm(0.4, damping=0.2), 0.5)
    assert run["arm.omega"][-1] == pytest.approx(2.0 * (1 - np.exp(-2 * 0.5)), abs=4 * STEP)
    assert run.settings[FRICTION_SUPPLIED_BY] == "nobody"


def test_friction_and_damping_of_a_pin_together(method):
    """The steady rate of an arm, (T - tau)/c."""
    scene = arm(BOUND + 0.4, friction=BOUND, damping=2.0)
    assert method.run(scene, 1.0)["arm.omega"][-1] == pytest.approx(0.2, rel=1e-3)


def test_doubled_bounds_change_the_motion(method):
    """What tests above compare depends on the bound: twice as large, it holds the arm."""
    run = method.run(arm(1.5 * BOUND, friction=2 * BOUND), 0.3)
    assert abs(run["arm.omega"][-1]) < 1e-2


def test_rows_of_engines_law():
    """At least six engines supply the law themselves, each by an element of its own."""
    assert len({method.engine for method in OWN}) >= 6


@pytest.mark.parametrize("part", [0.3, 0.9])
def test_creep_of_mujocos_default_reference(part):
    """The steady rate at which a joint creeps with the default ``solreffriction`` and ``solimpfriction``.

    A row of friction has the force f = -(a + b v)/R at the acceleration a and the rate v, where R = (1 - d)/d A, the
    mobility A = 1/I of the joint, the impedance d = 0.9 at zero violation, and b = 2/(0.95 * 0.02 s). At a steady rate
    the force is that of the load, T, so that v = T/I (1 - d)/(d b).
    """
    pytest.importorskip("mujoco")
    settings = {"loss_reference": "default", "noslip": "off", "solver": "Newton"}
    method = Method("mujoco", "engine", np.nan, settings)
    run = method.run(arm(part * BOUND, friction=BOUND), 1.0)
    b = 2 / (0.95 * 0.02)
    expected = part * BOUND / INERTIA * 0.1 / 0.9 / b
    assert run["arm.omega"][-1] == pytest.approx(expected, rel=1e-3)
    assert run.settings[FRICTION_SUPPLIED_BY] == "engine"


def test_mjcf_contains_bound_and_damping():
    """Plain MuJoCo makes the adapter's motion from the file alone, as nothing has to be set in a step."""
    mujoco = pytest.importorskip("mujoco")
    dry = vary(load_scene("pendulum-dry-pin"), {"static_friction": 0.3, "pin.damping": 0.05})
    text = scene_as_mjcf(dry, STEP)
    assert "To be set before each step" in text and "N, N m): nothing" in " ".join(text.split())
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    run = Method("mujoco", "engine", 0.0).run(dry, 3.0)
    angles = []
    for _ in run.t:
        angles.append(data.qpos[0])
        mujoco.mj_step(model, data)
    moved = np.array(angles) - angles[0]
    assert run["bar.angle"] - run["bar.angle"][0] == pytest.approx(moved, abs=1e-9)
    static = scene_as_mjcf(load_scene("pendulum-dry-pin"), STEP)
    assert 'frictionloss of joint "pin", here that of slip, 0.3: 0.35 while it sticks' in static


@pytest.mark.parametrize("engine", ["mujoco", "pybullet", "dart", "drake"])
def test_refusals_of_trees(engine):
    """Friction and motors need a coordinate each, which a tree of links has for its own joints only."""
    pytest.importorskip(PACKAGES.get(engine, engine))
    adapter = load_engine(engine)
    dry = load_scene("slider-crank-dry-pins")
    with pytest.raises(Refused, match="closes a loop and has friction"):
        adapter.simulate(dry, t_end=0.01)
    driven = arm(0.0, friction=BOUND).model_dump(mode="json", exclude_none=True)
    driven["drives"] = {
        "drive": {
            "type": "angle",
            "bodies": ["arm", "ground"],
            "law": {"type": "linear", "rate": 1.0},
        }
    }
    driven["bodies"]["arm"]["angular_velocity"] = 1.0
    with pytest.raises(Refused, match="one motor for each joint, and the pin's friction needs it"):
        adapter.simulate(scene_from_dict(driven), t_end=0.1)


@pytest.mark.parametrize(
    "method",
    [
        Method("pymunk", "engine", 0.0),
        Method("exudyn", "adapter", 0.0),
        Method("exudyn", "engine", 0.0, {"method": "bristles"}),
    ],
    ids=str,
)
def test_driven_slider_crank_with_dry_pins(method):
    """Engines without a tree take friction in every pin, of a driven one too: the torque of the motor."""
    pytest.importorskip(PACKAGES.get(method.engine, method.engine))
    scene = load_scene("slider-crank-dry-pins")
    truth = load_engine("reference").simulate(scene, t_end=0.5, output_step=STEP, rtol=1e-9)
    run = method.run(scene, 0.5)
    assert run.settings[FRICTION_SUPPLIED_BY] == method.supplier
    error = np.abs(np.interp(run.t, truth.t, truth["motor.effort"]) - run["motor.effort"])
    # of 57 N m, and at the dead centre too, where the sense of a pin changes
    assert error.max() < 0.1 * min(pin.friction for pin in scene.pins.values())


def test_accelerations_refuse_constant_bounds():
    pytest.importorskip("mujoco")
    with pytest.raises(Refused, match="method=accelerations"):
        load_engine("mujoco").simulate(arm(1.0, friction=BOUND), t_end=0.1, method="accelerations")


def test_pin_without_turning_bodies_is_refused():
    scene = scene_from_dict(
        {
            "title": "Fixed",
            "t_end": 0.1,
            "bodies": {"a": {"mass": 1, "inertia": 1}, "b": {"mass": 1, "inertia": 1}},
            "joints": {
                "one": {"type": "translational", "slider": "a"},
                "two": {"type": "translational", "slider": "b"},
                "pin": {"type": "revolute", "bodies": ["a", "b"], "friction": 1.0},
            },
        }
    )
    with pytest.raises(Refused, match="neither of its bodies can turn"):
        load_engine("pymunk").simulate(scene)
