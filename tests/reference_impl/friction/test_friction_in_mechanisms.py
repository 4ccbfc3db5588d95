"""Energy, rest with shared friction, and what a stuck guide must not do, on mechanisms with friction."""

import numpy as np
import pytest
from reference_checks import balance_residual, energy_defect, errors, same_events, simulate, states
from truth_checks import rocking_trammel

from stiction.comparisons.hard.checks import friction_excess
from stiction.scenes import load_scene, scene_from_dict
from stiction.truths import moving_guide_truth, slider_bar_truth, trammel_truth


@pytest.mark.parametrize(
    ("name", "t_end"),
    [
        ("elliptic-trammel", 4),
        ("slider-on-moving-guide", 6),
        ("slider-bar-case-1", 8),
        ("slider-bar-case-3", 4),
        ("mass-on-belt", 6),
        ("slider-crank", 1),
        ("pendulum", 3),
    ],
)
def test_energy_balance_and_action_equals_reaction(name, t_end):
    scene = load_scene(name)
    # integration error at the tight setting, accumulated over some hundred steps
    assert energy_defect(scene, t_end, 1e-12) < 1e-9
    trajectory = simulate(scene, t_end=t_end, rtol=1e-12, stabilization="projection")
    assert (
        balance_residual(scene, trajectory.t, trajectory.columns) < 1e-11
    )  # rounding of the linear solves
    assert friction_excess(scene, trajectory.columns) < 1e-12


MOTION = ("x", "y", "angle", "vx", "vy", "omega", "ax", "ay", "alpha")


def motion(trajectory, truth):
    """Errors of the motion alone: at rest the share of each guide in the friction is open."""
    names = [name for name in truth(0.0) if name.rpartition(".")[2] in MOTION]
    return states(errors(trajectory, truth, names))


@pytest.mark.parametrize(
    "changes",
    [
        {"w": 0, "T": 0, "mu": 0.6, "mus": 0.8},  # never moves
        {"w": 0, "T": 0, "mu": 0.3, "mus": 0.4},
        {"w": 1, "T": 0, "mu": 0.6, "mus": 0.7},  # stops, for good
        {"w": 1, "T": 6, "mu": 0.5, "mus": 0.6},  # past dead points, then stops
    ],
)
def test_trammel_that_comes_to_rest(changes):
    scene = load_scene("elliptic-trammel", changes)
    truth = trammel_truth(scene, 2.0)
    trajectory = simulate(scene, t_end=2, rtol=1e-12, stabilization="projection")
    same_events(trajectory, truth, 1e-9)
    assert motion(trajectory, truth) < 1e-9
    # at rest nothing is to be integrated: no step may be refused for the rounding of zero accelerations
    assert trajectory.cost.counters["steps"] < 100


def test_trammel_that_rests_and_breaks_away():
    scene = rocking_trammel()
    truth = trammel_truth(scene, 4.0)
    trajectory = simulate(scene, t_end=4, rtol=1e-12, stabilization="projection")
    same_events(trajectory, truth, 1e-9)
    assert {event.kind for event in trajectory.events} >= {"stick", "slip", "reversal"}
    assert motion(trajectory, truth) < 1e-9
    friction = {name: trajectory[f"{name}.friction"] for name in scene.guides}
    for name, guide in scene.guides.items():  # the share shown is admissible
        load = sum(trajectory[f"{name}.F{i}"] for i in (1, 2, 3, 4))
        assert np.all(np.abs(friction[name]) <= guide.mus * load * (1 + 1e-9) + 1e-9)


@pytest.mark.parametrize("stabilization", ["none", "baumgarte", "projection"])
@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_tolerance_is_kept_for_every_stabilization(stabilization, rtol):
    scene = load_scene("slider-on-moving-guide")
    truth = moving_guide_truth(scene, 6.0)
    trajectory = simulate(scene, t_end=6, rtol=rtol, stabilization=stabilization)
    same_events(trajectory, truth, 30 * rtol)  # local errors of about 50 steps
    names = ("slider.x", "slider.y", "slider.angle", "arm.angle", "arm.omega")
    assert max(errors(trajectory, truth, names).values()) < 100 * rtol


def two_on_an_arm(mu):
    """A turning arm that carries a slider which moves and one that is stuck."""
    angle, arm = (
        np.deg2rad(20),
        {"mass": 3, "inertia": 1, "angle": np.deg2rad(20), "angular_velocity": 1},
    )
    along, across = (
        np.array([np.cos(angle), np.sin(angle)]),
        np.array([-np.sin(angle), np.cos(angle)]),
    )

    def slider(d, u):
        return {
            "mass": 1,
            "inertia": 0.01,
            "position": list(d * along),
            "velocity": list(u * along + d * across),
            "angle": angle,
            "angular_velocity": 1,
        }

    def guide(name, **friction):
        return {
            "type": "translational",
            "slider": name,
            "guide": "arm",
            "length": 0.2,
            "width": 0.1,
            **friction,
        }

    return scene_from_dict(
        {
            "gravity": [0, -9.81],
            "bodies": {"arm": arm, "moving": slider(0.5, 0.4), "stuck": slider(-0.3, 0)},
            "joints": {
                "pivot": {"type": "revolute", "bodies": ["arm", "ground"]},
                "first": guide("moving", mu=0.1, mus=0.15),
                "second": guide("stuck", mu=mu),
            },
            "springs": {
                "spring": {
                    "type": "linear",
                    "bodies": ["moving", "arm"],
                    "axis": [1, 0],
                    "stiffness": 30,
                    "rest_length": 0.5,
                },
                "twist": {"type": "torsional", "bodies": ["arm", "ground"], "stiffness": 20},
            },
        }
    )


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
def test_events_elsewhere_do_not_shake_a_stuck_slider_loose(rtol):
    """Its slip velocity drifts at the level of the tolerance, which is no motion."""
    trajectory = simulate(two_on_an_arm(0.9), t_end=4, rtol=rtol)
    assert trajectory.events and {event.joint for event in trajectory.events} == {"first"}
    assert np.all(trajectory["second.mode"] == 0)


def test_tolerance_and_error_go_together():
    """Error over tolerance stays within two decades from 1e-4 to 1e-12: order 8 across located events."""
    scene = load_scene("slider-bar-case-3")
    truth = slider_bar_truth(scene, 8.0)
    ratios = [
        states(errors(simulate(scene, t_end=8, rtol=rtol, stabilization="projection"), truth))
        / rtol
        for rtol in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
    ]
    assert max(ratios) < 100 and max(ratios) < 300 * min(ratios)
