"""Laws of time, springs, dampers and drives against closed forms."""

import numpy as np
import pytest
from reference_checks import along, guide_scene, law_rates, law_values, simulate

from stiction.reference_impl.integration.coulomb_audit import audit
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import scene_from_dict

TIGHT = {"rtol": 1e-12}


def test_free_flight():
    scene = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "bodies": {
                "stone": {
                    "mass": 2,
                    "inertia": 0.1,
                    "velocity": [3, 4],
                    "angular_velocity": 5,
                    "angle": 1,
                }
            },
        }
    )
    trajectory = simulate(scene, t_end=2, **TIGHT)
    t = trajectory.t
    np.testing.assert_allclose(trajectory["stone.x"], 3 * t, atol=1e-13)
    np.testing.assert_allclose(trajectory["stone.y"], 4 * t - 9.81 / 2 * t**2, atol=1e-13)
    np.testing.assert_allclose(trajectory["stone.angle"], 1 + 5 * t, atol=1e-13)
    assert trajectory.cost.counters["hlcp"] == 0
    assert audit(trajectory, Mechanism(scene)).instants == 0  # nothing to audit


def test_two_free_bodies_on_a_damped_spring():
    """Relative motion of the reduced mass 2/3 kg; the centre of mass keeps its velocity."""
    scene = scene_from_dict(
        {
            "bodies": {
                "a": {"mass": 1, "inertia": 1, "position": [0, 0], "velocity": [1, 0]},
                "b": {"mass": 2, "inertia": 1, "position": [3, 0], "velocity": [0.1, 0]},
            },
            "springs": {
                "s": {
                    "type": "linear",
                    "bodies": ["a", "b"],
                    "stiffness": 20,
                    "damping": 0.5,
                    "rest_length": 2,
                }
            },
        }
    )
    trajectory = simulate(scene, t_end=3, **TIGHT)
    t, m = trajectory.t, 2 / 3
    decay, w = 0.5 / (2 * m), np.sqrt(20 / m - (0.5 / (2 * m)) ** 2)
    x0, v0 = 1.0, -0.9
    stretch = np.exp(-decay * t) * (x0 * np.cos(w * t) + (v0 + decay * x0) / w * np.sin(w * t))
    np.testing.assert_allclose(trajectory["b.x"] - trajectory["a.x"], 2 + stretch, atol=1e-10)
    np.testing.assert_allclose(trajectory["a.vx"] + 2 * trajectory["b.vx"], 1.2, atol=1e-12)


def test_a_force_at_a_point_turns_its_body():
    """I angle'' = -F h cos(angle) of a wheel on a pin with F down at h on its x axis: I angle'^2 / 2 + F h sin(angle) stays, eq. (21)."""
    scene = scene_from_dict(
        {
            "bodies": {"wheel": {"mass": 1, "inertia": 0.2}},
            "joints": {"pin": {"type": "revolute", "bodies": ["wheel", "ground"]}},
            "forces": {
                "weight": {
                    "type": "force",
                    "body": "wheel",
                    "point": [0.5, 0],
                    "direction": [0, -1],
                    "law": {"type": "constant", "value": 4},
                }
            },
        }
    )
    trajectory = simulate(scene, t_end=3, **TIGHT)
    angle, rate = trajectory["wheel.angle"], trajectory["wheel.omega"]
    assert trajectory["wheel.alpha"][0] == pytest.approx(-4 * 0.5 / 0.2, rel=1e-12)
    np.testing.assert_allclose(0.1 * rate**2 + 2 * np.sin(angle), 0.0, atol=1e-10)
    assert np.ptp(angle) > 3  # it swings to the other side


def test_torsional_spring_and_damper():
    scene = scene_from_dict(
        {
            "bodies": {"wheel": {"mass": 1, "inertia": 0.5, "angle": 0.7, "angular_velocity": -1}},
            "joints": {"pin": {"type": "revolute", "bodies": ["wheel", "ground"]}},
            "springs": {
                "s": {
                    "type": "torsional",
                    "bodies": ["wheel", "ground"],
                    "stiffness": 8,
                    "damping": 0.4,
                    "rest_angle": 0.2,
                }
            },
        }
    )
    trajectory = simulate(scene, t_end=4, **TIGHT)
    t, decay = trajectory.t, 0.4
    w = np.sqrt(16 - decay**2)
    expected = 0.2 + np.exp(-decay * t) * (
        0.5 * np.cos(w * t) + (-1 + decay * 0.5) / w * np.sin(w * t)
    )
    np.testing.assert_allclose(trajectory["wheel.angle"], expected, atol=1e-10)


def test_spring_along_an_axis_of_a_turning_body_conserves_momentum():
    """Both forces lie on one line, also where the axis turns: angular momentum about any point stays."""
    scene = scene_from_dict(
        {
            "bodies": {
                "a": {
                    "mass": 1,
                    "inertia": 0.3,
                    "position": [1, 0.2],
                    "velocity": [0.2, 0.5],
                    "angular_velocity": 1,
                },
                "b": {"mass": 2, "inertia": 0.5, "angular_velocity": -0.7},
            },
            "springs": {
                "s": {
                    "type": "linear",
                    "bodies": ["a", "b"],
                    "axis": [0.6, 0.8],
                    "points": [[0.1, 0.3], [0.2, -0.1]],
                    "stiffness": 12,
                    "damping": 0.3,
                    "rest_length": 0.4,
                }
            },
        }
    )
    trajectory = simulate(scene, t_end=3, **TIGHT)
    momentum = sum(
        m
        * (
            trajectory[f"{n}.x"] * trajectory[f"{n}.vy"]
            - trajectory[f"{n}.y"] * trajectory[f"{n}.vx"]
        )
        + inertia * trajectory[f"{n}.omega"]
        for n, m, inertia in (("a", 1, 0.3), ("b", 2, 0.5))
    )
    np.testing.assert_allclose(momentum, momentum[0], atol=1e-11)


def test_table_of_straight_lines():
    """A force of ramps on a smooth slider: cubic polynomials, exact to rounding if the kinks are met exactly."""
    times, values = np.array([0.0, 0.313, 0.77, 1.9, 2.2]), np.array([1.0, -2.0, 3.0, 3.0, -1.0])
    scene = scene_from_dict(
        guide_scene(
            gravity=(0, 0),
            forces={"load": along([1, 0], type="table", times=list(times), values=list(values))},
        )
    )
    trajectory = simulate(scene, t_end=3, output_step=0.05, **TIGHT)
    x, v, expected = 0.0, 0.0, np.empty(len(trajectory.t))
    for a, b, fa, fb in zip(times, [*times[1:], 3.0], values, [*values[1:], values[-1]]):
        inside = (trajectory.t >= a) & (trajectory.t <= b + 1e-12)
        s, slope = trajectory.t[inside] - a, (fb - fa) / (b - a)
        expected[inside] = x + v * s + fa * s**2 / 2 + slope * s**3 / 6
        h = b - a
        x, v = x + v * h + fa * h**2 / 2 + slope * h**3 / 6, v + fa * h + slope * h**2 / 2
    np.testing.assert_allclose(trajectory["slider.x"], expected, atol=1e-13)
    assert (
        trajectory.cost.counters["steps"] < 30
    )  # polynomials: what limits the step is its growth after a kink


@pytest.mark.parametrize("kind", ["distance", "angle"])
def test_drive_along_a_cubic_table(kind):
    """The coordinate follows the spline; the effort is m or I times its second derivative, weight aside."""
    law = {
        "type": "table",
        "times": [0, 0.4, 1, 1.7, 2],
        "values": [0, 0.5, 0.2, 0.9, 1],
        "interpolation": "cubic",
    }
    drive = {"type": kind, "bodies": ["slider", "ground"], "law": law}
    raw = {
        "gravity": [0, -10],
        "bodies": {"slider": {"mass": 3, "inertia": 2}},
        "drives": {"motor": drive},
    }
    if kind == "distance":
        drive["axis"] = [1, 0]
        raw["joints"] = {"guide": {"type": "translational", "slider": "slider"}}
    else:
        raw["joints"] = {"guide": {"type": "revolute", "bodies": ["slider", "ground"]}}
    scene = scene_from_dict(raw)
    rate = law_rates(scene.drives["motor"].law, [0.0])[0]
    raw["bodies"]["slider"] |= (
        {"velocity": [rate, 0]} if kind == "distance" else {"angular_velocity": rate}
    )
    scene = scene_from_dict(raw)
    trajectory = simulate(scene, t_end=2.5, **TIGHT)
    place, acceleration = (
        ("slider.x", "slider.ax") if kind == "distance" else ("slider.angle", "slider.alpha")
    )
    np.testing.assert_allclose(
        trajectory[place], law_values(scene.drives["motor"].law, trajectory.t), atol=1e-12
    )
    inertia = 3 if kind == "distance" else 2
    np.testing.assert_allclose(
        trajectory["motor.effort"], inertia * trajectory[acceleration], atol=1e-11
    )


def test_distance_drive_conserves_angular_momentum():
    """A point drawn out on a line from the origin at constant rate: theta' = L/r^2, theta = (L/u)(1/r0 - 1/r)."""
    scene = scene_from_dict(
        {
            "bodies": {
                "bob": {"mass": 2, "inertia": 1, "position": [1, 0], "velocity": [0.5, 1.2]}
            },
            "drives": {
                "winch": {
                    "type": "distance",
                    "bodies": ["bob", "ground"],
                    "law": {"type": "linear", "offset": 1, "rate": 0.5},
                }
            },
        }
    )
    trajectory = simulate(scene, t_end=4, stabilization="projection", **TIGHT)
    r = 1 + 0.5 * trajectory.t
    theta = 1.2 / 0.5 * (1 - 1 / r)
    np.testing.assert_allclose(trajectory["bob.x"], r * np.cos(theta), atol=1e-10)
    np.testing.assert_allclose(trajectory["bob.y"], r * np.sin(theta), atol=1e-10)
    np.testing.assert_allclose(trajectory["winch.effort"], -2 * 1.2**2 / r**3, atol=1e-10)


def test_sine_force_on_a_smooth_slider():
    load = along([1, 0], type="sine", offset=1, amplitude=2, frequency=3, phase=0.5)
    scene = scene_from_dict(guide_scene(forces={"load": load}))
    trajectory = simulate(scene, t_end=5, **TIGHT)
    t = trajectory.t
    expected = t**2 / 2 + 2 / 3 * (np.cos(0.5) * t - (np.sin(3 * t + 0.5) - np.sin(0.5)) / 3)
    np.testing.assert_allclose(trajectory["slider.x"], expected, atol=1e-10)
    assert trajectory.cost.counters["hlcp"] == 0
    found = audit(
        trajectory, Mechanism(scene), 50
    )  # the HLCP of a smooth scene has bilateral rows only
    assert found.complementarity < 1e-12 and found.acceleration < 1e-12 and found.unsolved == 0
