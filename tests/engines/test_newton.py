"""Newton's solvers, judged by closed forms; what a solver ignores is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stiction.comparisons.measures.accuracy import errors, rounding_effect
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines import EngineFailure, Refused, load_engine
from stiction.engines.newton import stepper as stepper_module
from stiction.engines.newton.engine import NewtonEngine, effect_of_rounding
from stiction.engines.newton.model import Jitter
from stiction.engines.newton.solvers import DVI_ITERATIONS, KINDS
from stiction.engines.protocol import NEGLECTED, PRECISION
from stiction.scenes import InputError, load_scene, scene_from_dict
from stiction.scenes.fidelity import Fidelity

pytest.importorskip("newton")
G = 9.81
STEP = 1e-3
SOLVERS = list(KINDS)
WITH_JOINT_FRICTION = ["kamino", "mujoco"]
WITHOUT_JOINT_FRICTION = [name for name in SOLVERS if name not in WITH_JOINT_FRICTION]
SINGLE = float(np.finfo(np.float32).eps)


@pytest.fixture(scope="module")
def newton():
    return load_engine("newton")


def run(newton, scene, **arguments):
    return newton.simulate(scene, **{"dt": STEP, "rounding": "off"} | arguments)


def stone(**further):
    body = {"mass": 2.0, "inertia": 0.3, "velocity": [3.0, 4.0], "angular_velocity": 5.0}
    return scene_from_dict(
        {"t_end": 0.5, "gravity": [0.5, -G], "bodies": {"stone": body}, **further}
    )


def pendulum(**pin):
    """A rod of 1 kg on a pin 0.5 m from its centre of mass."""
    return scene_from_dict(
        {
            "t_end": 2.0,
            "gravity": [0.0, -G],
            "bodies": {
                "rod": {
                    "mass": 1.0,
                    "inertia": 0.1,
                    "position": [0.0, -0.5],
                    "velocity": [0.5, 0.0],
                    "angular_velocity": 1.0,
                }
            },
            "joints": {
                "pin": {
                    "type": "revolute",
                    "bodies": ["rod", "ground"],
                    "points": [[0.0, 0.5], [0.0, 0.0]],
                    **pin,
                }
            },
        }
    )


def arm(torque, bound=2.0, rate=0.0):
    """The hinge of the published trial: inertia 0.1 kg m^2 under a torque, with a bound of friction."""
    return scene_from_dict(
        {
            "t_end": 0.5,
            "bodies": {"arm": {"mass": 1.0, "inertia": 0.1, "angular_velocity": rate}},
            "joints": {"pin": {"type": "revolute", "bodies": ["arm", "ground"], "friction": bound}},
            "forces": {
                "motor": {
                    "type": "torque",
                    "body": "arm",
                    "law": {"type": "constant", "value": torque},
                }
            },
        }
    )


def incline(mu, angle=0.3):
    return load_scene("block-on-incline", {"incline": angle, "mu": mu, "mus": mu})


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_stone_falls_as_by_symplectic_euler(newton, solver):
    """n steps of v += h a, q += h v lead to q = v0 t + a t (t + h)/2; single precision adds its rounding."""
    got = run(newton, stone(), solver=solver)
    t = got.t
    # Rounding of the coordinates, half a unit in the last place of 3 m in each of 500 steps. VBD's velocities are
    # differences of them: a random walk of steps of this unit, divided by h.
    limit = 500 * 3 * SINGLE
    if solver == "vbd":
        limit = 3 * math.sqrt(500) * 3 * SINGLE / STEP * 0.5
    for name, v, a in (("x", 3.0, 0.5), ("y", 4.0, -G)):
        exact = v * t + 0.5 * a * t * (t + STEP)
        assert np.abs(got[f"stone.{name}"] - exact).max() < limit
    # The integrators turn by atan(omega h/2) in half a step.
    angle = 2 * math.atan(5.0 * STEP / 2) / STEP * t
    assert np.abs(got["stone.angle"] - angle).max() < limit


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_pendulum_converges_to_the_truth(newton, solver):
    """Errors at 2 ms and 1 ms: of first order or better, but of solvers whose joints are springs."""
    scene = pendulum()
    truth = ground_truth(scene)
    coarse, fine = (
        errors(run(newton, scene, solver=solver, dt=dt), truth)["position_error"]
        for dt in (2e-3, 1e-3)
    )
    if solver == "semi_implicit":
        # The joint is a spring of 1e4 N/m, which the weight and the rotation stretch by m (g + r omega^2)/k, within
        # an oscillation of the same size.
        assert fine < 2 * (G + 0.5) / 1e4
    else:
        assert fine < 2e-3 and fine < 0.6 * coarse


@pytest.mark.parametrize("solver", SOLVERS)
def test_loads_are_applied(newton, solver):
    """A constant force off the centre of mass and a torque: v = v0 + F t/m, omega = omega0 + T t/I."""
    scene = stone(
        forces={
            "push": {
                "type": "force",
                "body": "stone",
                "direction": [1.0, 0.0],
                "law": {"type": "constant", "value": 6.0},
            },
            "twist": {
                "type": "torque",
                "body": "stone",
                "law": {"type": "constant", "value": -0.6},
            },
        }
    )
    got = run(newton, scene, solver=solver)
    tolerance = 5e-3 if KINDS[solver].rounds_positions else 1e-4
    assert got["stone.vx"][-1] == pytest.approx(3.0 + (0.5 + 3.0) * 0.5, rel=tolerance)
    assert got["stone.omega"][-1] == pytest.approx(5.0 - 2.0 * 0.5, rel=tolerance)


def test_published_hinge(newton):
    """A hinge at 30 % of its bound: Kamino holds it, MuJoCo creeps by the law of its soft constraint."""
    held = run(newton, arm(0.6), solver="kamino")["arm.omega"][-1]
    assert abs(held) < 1e-6
    # MuJoCo's defaults: d = 0.9, b = 2/(0.95 0.02 s): v = A T (1 - d)/(d b)
    creep = 0.6 / 0.1 * (1 - 0.9) / (0.9 * 2 / (0.95 * 0.02))
    assert run(newton, arm(0.6), solver="mujoco")["arm.omega"][-1] == pytest.approx(creep, rel=1e-4)


@pytest.mark.parametrize("solver", WITHOUT_JOINT_FRICTION)
def test_a_solver_without_joint_friction_refuses_it(newton, solver):
    with pytest.raises(
        Refused, match=r"joints\.pin\.friction: .* ignores .* expected solver=kamino"
    ):
        run(newton, arm(0.6), solver=solver)
    with pytest.raises(Refused, match=r"joints\.guide\.mu: .* ignores"):
        run(newton, incline(0.1), solver=solver)


@pytest.mark.parametrize("solver", WITHOUT_JOINT_FRICTION)
def test_its_motion_without_friction_is_typed(newton, solver):
    """As if there were no friction: omega = T t/I. The trajectory says so."""
    got = run(newton, arm(0.6), solver=solver, ignored_friction="run")
    assert got["arm.omega"][-1] == pytest.approx(0.6 * 0.5 / 0.1, rel=1e-3)
    assert got.settings[NEGLECTED] == ["joints.pin.friction"]
    assert got.settings["friction_supplied_by"] == "nobody"
    assert (got["pin.friction"] == 0.0).all() and (got["pin.mode"][1:] == 1).all()


@pytest.mark.parametrize("solver", WITH_JOINT_FRICTION)
def test_joint_friction_brakes_with_its_bound(newton, solver):
    """An arm that turns is braked by tau/I = 20 rad/s^2, to rest at 0.25 s."""
    got = run(newton, arm(0.0, rate=5.0), solver=solver, output_step=STEP)
    turning = got.t < 0.2
    assert np.allclose(got["arm.omega"][turning], 5.0 - 20.0 * got.t[turning], atol=2e-3)
    assert np.allclose(got["pin.friction"][turning][1:], -2.0, rtol=2e-3)
    assert abs(got["arm.omega"][-1]) < 1e-3
    assert got.settings["friction_supplied_by"] == "engine"


@pytest.mark.parametrize("solver", WITH_JOINT_FRICTION)
@pytest.mark.parametrize("name", ["coulomb-oscillator", "slider-bar-case-1", "pendulum-dry-pin"])
def test_friction_by_a_bound_converges(newton, solver, name):
    scene = load_scene(name)
    truth = ground_truth(scene)
    coarse, fine = (
        errors(run(newton, scene, solver=solver, dt=dt, t_end=2.0), truth)["position_error"]
        for dt in (4e-3, 1e-3)
    )
    # MuJoCo's friction is soft by a time constant of 0.02 s, whose error does not vanish with the step.
    assert fine < 3e-3 and (fine < 0.7 * coarse or solver == "mujoco")


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("shape", ["spheres", "box"])
def test_a_box_slides_with_coulombs_deceleration(newton, solver, shape):
    """x'' = g (sin - mu cos) on an incline of 0.3 rad; MuJoCo's contacts that slide also separate, and brake more."""
    settings = {"solver": solver, "shape": shape, "fidelity": "contact"}
    if solver == "kamino" and shape == "box":
        settings["dynamics"] = (
            "padmm"  # dvi shares the load unequally, so that the box leaves the plane
        )
    got = run(newton, incline(0.1), t_end=1.0, **settings)
    exact = G * (math.sin(0.3) - 0.1 * math.cos(0.3))
    assert got["guide.slip_velocity"][-1] == pytest.approx(
        exact, rel=0.1 if solver == "mujoco" else 0.01
    )


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_box_below_its_cone(newton, solver):
    """mu = 0.5 holds a box on 0.3 rad: at rest with Kamino and VBD, a creep of less than 1 cm/s with the others."""
    got = run(newton, incline(0.5), solver=solver, fidelity="contact", t_end=1.0)
    last = got.t > 0.5
    shift = np.ptp(got["guide.displacement"][last])
    limit = 1e-5 if solver in ("kamino", "vbd") else 1e-2
    assert shift < 0.5 * limit


@pytest.mark.parametrize("solver", WITH_JOINT_FRICTION)
def test_a_driven_crank_needs_the_torque_of_the_truth(newton, solver):
    """Its motor turns against the coordinate of the link; the loop closes where it should."""
    scene = load_scene("slider-crank")
    got = run(newton, scene, solver=solver, t_end=1.0)
    found = errors(got, ground_truth(scene))
    assert found["position_error"] < 1e-3
    # 0.1 % of the largest torque, which is 80 N m
    assert found["torque_error"] < 0.1


@pytest.mark.parametrize("solver", ["kamino", "mujoco", "featherstone", "vbd"])
def test_a_drive_may_run_against_the_coordinate_of_its_joint(newton, solver):
    """The angle of the ground minus that of a wheel grows by 2 rad/s: the wheel turns by -2 t, more than a turn."""
    scene = scene_from_dict(
        {
            "t_end": 4.0,
            "bodies": {"wheel": {"mass": 1.0, "inertia": 0.1, "angular_velocity": -2.0}},
            "joints": {"pin": {"type": "revolute", "bodies": ["wheel", "ground"]}},
            "drives": {
                "motor": {
                    "type": "angle",
                    "bodies": ["ground", "wheel"],
                    "law": {"type": "linear", "rate": 2.0},
                }
            },
        }
    )
    got = run(newton, scene, solver=solver)
    assert np.allclose(got["wheel.angle"], -2.0 * got.t, atol=1e-3)
    assert np.allclose(got["wheel.omega"], -2.0, atol=5e-3)


@pytest.mark.parametrize("solver", ["kamino", "mujoco", "xpbd", "semi_implicit", "vbd"])
def test_loops_are_closed(newton, solver):
    scene = load_scene("four-bar")
    got = run(newton, scene, solver=solver, t_end=0.5)
    assert np.abs(got["drift.position"]).max() < 2e-2
    assert errors(got, ground_truth(scene))["position_error"] < 2e-2


def test_loops_that_a_solver_ignores_are_refused(newton):
    with pytest.raises(Refused, match="closes a loop; Newton's SolverFeatherstone ignores joints"):
        run(newton, load_scene("four-bar"), solver="featherstone")


def test_two_coefficients_are_refused_at_contact_fidelity(newton):
    scene = load_scene("block-on-incline")
    with pytest.raises(Refused, match=r"mus = 0\.3 is not mu = 0\.2"):
        run(newton, scene, fidelity="contact")


def test_settings_are_those_of_the_solver(newton):
    def settings(**given):
        return newton.settings_of_run(given, fidelity=Fidelity.JOINT, dt=None, rtol=None)

    assert settings()["iterations"] == DVI_ITERATIONS
    assert settings(dynamics="padmm")["iterations"] == 200
    assert settings(solver="xpbd")["iterations"] == 20
    assert settings(solver="xpbd", iterations=3)["iterations"] == 3
    with pytest.raises(InputError, match="solver: found 'bullet'"):
        run(newton, pendulum(), solver="bullet")
    with pytest.raises(InputError, match="stabilization: found 1.5"):
        run(newton, pendulum(), stabilization=1.5)


def test_a_jitter_moves_by_units_in_the_last_place():
    assert [Jitter(0)(value) for value in (0.1, -3.0)] == [float(np.float32(0.1)), -3.0]
    numbers = np.float32([0.1, -3.0, 1e5, 7e-3] * 20)
    moved = np.float32([*map(jitter := Jitter(2), map(float, numbers))])
    assert (np.abs(moved - numbers) == 2 * np.abs(np.spacing(numbers))).all()
    assert {*np.sign(moved - numbers)} == {-1.0, 1.0}  # some up, some down
    assert jitter(0.0) == 0.0


def test_the_effect_of_rounding_is_measured(newton):
    """It is that of a run with moved inputs, and enters the uncertainty of the errors."""
    scene = pendulum()
    got = newton.simulate(scene, dt=STEP, solver="featherstone")
    moved = run(newton, scene, solver="featherstone", moved_inputs=1)
    effect = got.settings[PRECISION]
    assert effect == effect_of_rounding(got, moved)
    assert SINGLE / 10 < effect["rod.angle"] < 1e-4
    truth = ground_truth(scene)
    uncertainty = errors(got, truth)["position_uncertainty"]
    own = max(truth.uncertainty.get(name, 0.0) for name in ("rod.x", "rod.y"))
    assert uncertainty >= own + max(effect["rod.x"], effect["rod.y"]) * 0.99
    assert PRECISION not in moved.settings and rounding_effect(moved, "rod.x") == 0.0


def test_an_unknown_effect_is_infinite(newton):
    got = run(newton, pendulum(), solver="featherstone", t_end=0.1)
    assert effect_of_rounding(got, None)["rod.x"] == math.inf


def test_a_run_is_repeated_exactly(newton):
    first, second = (run(newton, load_scene("slider-bar-case-1"), t_end=0.2) for _ in range(2))
    for name, column in first.columns.items():
        assert np.array_equal(column, second[name], equal_nan=True)


def test_compilation_is_no_part_of_stepping(newton):
    cost = run(newton, pendulum(), solver="featherstone", t_end=0.1).cost
    assert cost.compile_s > 0.0 and 0.0 < cost.engine_s <= cost.stepping_s
    assert cost.counters["passes"] == cost.counters["steps"] == 101


def test_a_body_that_leaves_the_plane_ends_the_run(newton, monkeypatch):
    monkeypatch.setattr(stepper_module, "OFF_PLANE", -1.0)
    with pytest.raises(EngineFailure, match="a body has left the plane"):
        run(newton, pendulum())


@pytest.mark.parametrize("solver", ["xpbd", "semi_implicit"])
def test_drives_by_angles_up_to_a_turn_are_refused(newton, solver):
    with pytest.raises(Refused, match=r"drives\.motor: .* follows a drive by a spring"):
        run(newton, load_scene("slider-bar-case-1-frictionless"), solver=solver)


def test_a_driven_slider_between_surfaces(newton):
    """Kamino's error in the paper's case 1 is below a millimetre, as DART's; the load changes corners meanwhile."""
    scene = load_scene("slider-bar-case-1-mus-equals-mu")
    got = run(newton, scene, fidelity="contact", t_end=4.0)
    assert errors(got, ground_truth(scene))["position_error"] < 1e-3


def test_who_supplies_the_friction(newton):
    settings = newton.settings_of_run({}, fidelity=Fidelity.JOINT, dt=None, rtol=None)
    assert newton.keeps_cone(Fidelity.JOINT, settings)
    assert not newton.keeps_cone(Fidelity.JOINT, {**settings, NEGLECTED: ["joints.pin.friction"]})
    assert replace(newton.capabilities).static_coefficient[Fidelity.CONTACT] is False
    assert isinstance(newton, NewtonEngine)
