"""The start, and constraints that say the same twice."""

import numpy as np
import pytest
from reference_checks import along, guide_scene, simulate

from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import SceneError, load_scene, scene_from_dict


def test_consistent_start_is_left_alone():
    for name in ("slider-bar-case-1", "four-bar", "slider-crank", "pendulum"):
        mechanism = Mechanism(load_scene(name))
        q, v = consistent_start(mechanism)
        np.testing.assert_array_equal((q, v), mechanism.initial_state())


def test_inconsistent_start_is_refused_with_its_residuals():
    scene = load_scene("slider-bar-case-1", {"bar.position.0": 1.3, "slider.velocity.1": 0.5})
    with pytest.raises(SceneError) as refused:
        ReferenceEngine().simulate(scene, t_end=1)
    text = str(refused.value)
    assert "pin.fx" in text and "position residual 0.05" in text
    assert "guide.normal_force" in text and "velocity residual 0.5" in text
    assert "motor" not in text  # that one is met


def test_start_is_assembled_on_request():
    scene = load_scene("slider-bar-case-1", {"bar.position.0": 1.3, "slider.velocity.1": 0.5})
    trajectory = simulate(scene, t_end=1, rtol=1e-9, assemble=True)
    assert trajectory["drift.position"][0] < 1e-14 and trajectory["drift.velocity"][0] < 1e-13
    # the least correction in the metric of the masses: 0.05 m shared by 2 kg (held by the motor's angle) and 1 kg
    assert trajectory["bar.x"][0] == pytest.approx(1.3 - 0.05 / 3, abs=1e-12)
    assert trajectory["slider.x"][0] == pytest.approx(0.25 + 0.05 * 2 / 3, abs=1e-12)


def test_impossible_assembly_is_an_error():
    """A bar of 1 m between pins 3 m apart."""
    scene = scene_from_dict(
        {
            "bodies": {"bar": {"mass": 1, "inertia": 1}},
            "joints": {
                "left": {
                    "type": "revolute",
                    "bodies": ["bar", "ground"],
                    "points": [[-0.5, 0], [0, 0]],
                },
                "right": {
                    "type": "revolute",
                    "bodies": ["bar", "ground"],
                    "points": [[0.5, 0], [3, 0]],
                },
            },
        }
    )
    with pytest.raises(SceneError, match="could not be assembled"):
        ReferenceEngine().simulate(scene, t_end=1, assemble=True)


def incline(guides, **friction):
    angle = np.deg2rad(-20)
    joint = {
        "type": "translational",
        "slider": "slider",
        "direction": [np.cos(angle), np.sin(angle)],
        "angle": angle,
        **friction,
    }
    return scene_from_dict(
        {
            "gravity": [0, -9.81],
            "bodies": {"slider": {"mass": 1, "inertia": 0.1, "angle": angle}},
            "joints": {f"guide-{i}": joint for i in range(guides)},
        }
    )


@pytest.mark.parametrize(
    "friction", [{}, {"mu": 0.2}, {"mu": 0.5}, {"mu": 0.2, "mus": 0.3, "length": 0.6, "width": 0.1}]
)
@pytest.mark.parametrize("settings", [{"rtol": 1e-10}, {"dt": 0.01}])
def test_guides_on_the_same_line_share_the_load(friction, settings):
    one, three = (simulate(incline(count, **friction), t_end=1, **settings) for count in (1, 3))
    # accelerations of 10 m/s^2, loads shared with a compliance of 1e-10
    np.testing.assert_allclose(three["slider.x"], one["slider.x"], atol=1e-8)
    total = sum(three[f"guide-{i}.normal_force"] for i in range(3))
    np.testing.assert_allclose(total, one["guide-0.normal_force"], rtol=1e-8)
    if friction:
        total = sum(three[f"guide-{i}.friction"] for i in range(3))
        np.testing.assert_allclose(total, one["guide-0.friction"], atol=1e-7)


def parallelogram(cranks, angle=60.0, drive=False):
    """A coupler of 2 kg on parallel cranks of 1 m; from the third on they are redundant."""
    a = np.deg2rad(angle)
    e, n = np.array([np.cos(a), np.sin(a)]), np.array([-np.sin(a), np.cos(a)])
    bodies, joints = {}, {}
    for i in range(cranks):
        bodies[f"crank-{i}"] = {
            "mass": 1,
            "inertia": 1 / 12,
            "position": list(np.array([i, 0]) + e / 2),
            "angle": a,
            "velocity": list(n / 2),
            "angular_velocity": 1,
        }
        joints[f"foot-{i}"] = {
            "type": "revolute",
            "bodies": [f"crank-{i}", "ground"],
            "points": [[-0.5, 0], [i, 0]],
        }
        joints[f"head-{i}"] = {
            "type": "revolute",
            "bodies": [f"crank-{i}", "coupler"],
            "points": [[0.5, 0], [i - (cranks - 1) / 2, 0]],
        }
    middle = np.array([(cranks - 1) / 2, 0])
    bodies["coupler"] = {"mass": 2, "inertia": 1, "position": list(middle + e), "velocity": list(n)}
    law = {"type": "linear", "offset": a, "rate": 1}
    drives = (
        {"motor": {"type": "angle", "bodies": ["crank-0", "ground"], "law": law}} if drive else {}
    )
    return scene_from_dict(
        {"gravity": [0, -9.81], "bodies": bodies, "joints": joints, "drives": drives}
    )


def pendulum_angle(cranks, t):
    """The one degree of freedom: (cranks/3 + 2) phi'' = -(cranks/2 + 2) g cos phi, by a fine integration of its own."""
    from scipy.integrate import solve_ivp

    def rate(_, y):
        return y[1], -(cranks / 2 + 2) * 9.81 * np.cos(y[0]) / (cranks / 3 + 2)

    return solve_ivp(
        rate, (0, t[-1]), (np.deg2rad(60), 1.0), t_eval=t, method="DOP853", rtol=1e-12, atol=1e-13
    ).y[0]


@pytest.mark.parametrize("cranks", [2, 3, 5])
@pytest.mark.parametrize("stabilization", ["none", "projection", "baumgarte"])
def test_redundant_cranks_do_not_change_the_motion(cranks, stabilization):
    trajectory = simulate(parallelogram(cranks), t_end=0.7, rtol=1e-10, stabilization=stabilization)
    # integration error; that the mechanism is short of its flat position keeps it from growing
    np.testing.assert_allclose(
        trajectory["crank-0.angle"], pendulum_angle(cranks, trajectory.t), atol=1e-8
    )
    assert np.max(np.abs(trajectory["coupler.angle"])) < 1e-9
    assert trajectory.cost.counters["steps"] < 500


def test_motor_drives_redundant_cranks():
    scene = parallelogram(3, drive=True)
    trajectory = simulate(scene, t_end=0.8, rtol=1e-10)
    moment = (3 / 2 + 2) * 9.81 * np.cos(np.deg2rad(60) + trajectory.t)
    np.testing.assert_allclose(trajectory["motor.effort"], moment, atol=1e-7)


@pytest.mark.parametrize("cranks", [2, 3, 4])
def test_flat_position_is_passed_with_projection(cranks):
    """All bars in line: the mechanism could branch, J loses rank. Steps of a moderate tolerance jump over it."""
    trajectory = simulate(parallelogram(cranks), t_end=3, rtol=1e-9, stabilization="projection")
    # the forces near the singular position amplify the residuals of the state; further off nothing is to be had
    np.testing.assert_allclose(
        trajectory["crank-0.angle"], pendulum_angle(cranks, trajectory.t), atol=3e-5
    )
    assert np.max(np.abs(trajectory["coupler.angle"])) < 1e-5


@pytest.mark.parametrize("stabilization", ["none", "projection", "baumgarte"])
def test_flat_position_never_hangs(stabilization):
    """Where steps cannot become small enough, or redundant constraints contradict each other since the state is off them,
    the run ends at a flat position, soon, and says so; what it has written until then is the motion."""
    run = ReferenceEngine().simulate(
        parallelogram(3), t_end=5, rtol=1e-12, stabilization=stabilization
    )
    assert run.cost.counters["steps"] + run.cost.counters["rejected"] < 10_000  # some thousand
    np.testing.assert_allclose(
        run["crank-0.angle"], pendulum_angle(3, run.t), atol=3e-5
    )  # as for the passage above
    if run.breakdown is None:
        assert (
            run.t[-1] == 5 and np.ptp(np.sign(np.sin(run["crank-0.angle"]))) == 2
        )  # it passed at least one
    else:
        assert run.breakdown.kind in ("step too small", "crawl", "not finite")
        # forces grow with one over the distance and the state is exact to 1e-12: nothing happens further off than 0.01 rad
        assert abs(np.sin(pendulum_angle(3, np.array([0.0, run.breakdown.time]))[-1])) < 0.01


def test_rest_of_a_motor_that_holds_a_sticking_slider():
    """Motor and friction hold the same freedom: nothing moves, and nothing tells how they share the load of 1 N."""
    raw = guide_scene(
        guide={"mu": 0.2},
        drives={
            "motor": {
                "type": "distance",
                "bodies": ["slider", "ground"],
                "axis": [1, 0],
                "law": {"type": "constant", "value": 0},
            }
        },
        forces={"load": along([1, 0], type="constant", value=1)},
    )
    trajectory = simulate(scene_from_dict(raw), t_end=1)
    assert np.all(np.abs(trajectory["slider.x"]) < 1e-14)  # rounding
    assert np.all(trajectory["guide.mode"] == 0) and trajectory.events == ()
    for column in ("guide.friction", "motor.effort"):
        assert np.isnan(trajectory[column]).all()
    np.testing.assert_allclose(
        trajectory["guide.normal_force"], trajectory["guide.normal_force"][0], atol=1e-9
    )
    assert trajectory.alternatives == {}  # an interval, no list


def test_driven_slider_reverses_without_rest():
    """A sine drive takes it through zero velocity: friction changes its sign at once."""
    raw = guide_scene(
        {"velocity": [2, 0]},
        {"mu": 0.2, "mus": 0.3},
        drives={
            "motor": {
                "type": "distance",
                "bodies": ["slider", "ground"],
                "axis": [1, 0],
                "law": {"type": "sine", "amplitude": 1, "frequency": 2},
            }
        },
    )
    trajectory = simulate(scene_from_dict(raw), t_end=4, rtol=1e-10)
    assert [event.kind for event in trajectory.events] == ["reversal"] * 3
    times = [event.time for event in trajectory.events]
    np.testing.assert_allclose(times, np.pi / 4 + np.pi / 2 * np.arange(3), atol=1e-9)
    for event in trajectory.events:
        assert abs(event.jump("motor.effort")) == pytest.approx(4, abs=1e-8)  # 2 mu m g
