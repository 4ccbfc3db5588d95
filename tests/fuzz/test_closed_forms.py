"""Driven, locked and resting guides with forces in closed form: one mechanism of each kind."""

import numpy as np
import pytest

from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import scene_from_dict


def run_of(raw, **arguments):
    return ReferenceEngine().simulate(scene_from_dict(raw, "scene"), rtol=1e-10, **arguments)


@pytest.mark.parametrize(
    "settings", [{}, {"solver": "lemke"}, {"solver": "enumeration"}, {"solver": "trial"}]
)
@pytest.mark.parametrize("angle", [60, 70, 76, 80])
def test_two_efforts_of_a_strut_that_pulls_a_block_back(settings, angle):
    """A strut at the angle th pulls a block of weight W back, slip in -x: with N = W + P s,

        P c + mu |N| = m a :   P = (m a - mu W) / (c + mu s) if N >= 0,   P = (m a + mu W) / (c - mu s) if N <= 0.

    The second exists where tan th > 1 / mu, beyond the angle of friction: 73.3 degrees.
    """
    mu, W, rate, th = 0.3, 10.0, -1e-3, np.deg2rad(angle)
    c, s = np.cos(th), np.sin(th)
    run = run_of(
        {
            "gravity": [0, -W],
            "bodies": {
                "block": {
                    "mass": 1,
                    "inertia": 1,
                    "position": [c / s, 0],
                    "velocity": [rate / c, 0],
                }
            },
            "joints": {"guide": {"type": "translational", "slider": "block", "mu": mu}},
            "drives": {
                "strut": {
                    "type": "distance",
                    "bodies": ["block", "ground"],
                    "points": [[0, 0], [0, 1]],
                    "law": {"type": "linear", "offset": 1 / s, "rate": rate},
                }
            },
        },
        t_end=0.1,
        output_step=0.05,
        **settings,
    )
    a = (rate**2 - (rate / c) ** 2) / (c / s)  # of x^2 + 1 = L^2
    expected = [
        P
        for P, sign in (((a - mu * W) / (c + mu * s), 1), ((a + mu * W) / (c - mu * s), -1))
        if sign * (W + P * s) >= 0
    ]
    assert len(expected) == (2 if np.tan(th) > 1 / mu else 1)
    if len(expected) == 1:
        assert run["strut.effort"][0] == pytest.approx(expected[0], rel=1e-9)
        assert run.alternatives == {}
        return
    for name in ("strut.effort", "guide.normal_force", "guide.friction"):
        assert np.isnan(run[name]).all()
    assert set(run.alternatives) == {"strut.effort", "guide.normal_force", "guide.friction"}
    np.testing.assert_allclose(
        np.sort(run.alternatives["strut.effort"][0]), np.sort(expected), rtol=1e-9
    )
    np.testing.assert_allclose(
        np.sort(run.alternatives["guide.normal_force"][0]),
        np.sort([W + P * s for P in expected]),
        rtol=1e-9,
    )
    np.testing.assert_allclose(
        run["guide.moment"], 0.0, atol=1e-9
    )  # in both solutions: it is known


@pytest.mark.parametrize("step", [0.5, 0.01])
@pytest.mark.parametrize("mu", [0.4, 0.8, 1.2])
def test_a_strut_from_below_jams_at_the_angle_of_friction(mu, step):
    """A strut from h below the guide shortens and pulls a block of weight W along -x; th is its angle to the guide:

        N = W - P s,   P c + mu N = m a :   P = (m a - mu W) / (c - mu s),

    a pull, as a < 0, that grows without bound where tan th = 1 / mu. Beyond, N < 0 would need W c <= m a s: there are no forces.
    No step of the smooth motion is to go over that, whether rows are close or not.
    """
    h, x0, rate, W = 1.0, 3.0, 0.7, 10.0
    length = float(np.hypot(x0, h))
    run = run_of(
        {
            "gravity": [0, -W],
            "bodies": {
                "block": {
                    "mass": 1,
                    "inertia": 1,
                    "position": [x0, 0],
                    "velocity": [-rate * length / x0, 0],
                }
            },
            "joints": {"guide": {"type": "translational", "slider": "block", "mu": mu}},
            "drives": {
                "strut": {
                    "type": "distance",
                    "bodies": ["block", "ground"],
                    "points": [[0, 0], [0, -h]],
                    "law": {"type": "linear", "offset": length, "rate": -rate},
                }
            },
        },
        t_end=3.0,
        output_step=step,
    )
    assert run.breakdown.kind == "jam" and run.breakdown.guide == "guide"
    assert run.breakdown.time == pytest.approx((length - h * np.sqrt(1 + mu**2)) / rate, abs=1e-7)
    assert np.all(run["strut.effort"] < 0) and run.alternatives == {}


def two_in_series(capacities, load, link_mass=0.1):
    """Two sliders of 1 kg on one line, weight 10 N, joined by a rod without weight; the load pulls the first."""
    return {
        "bodies": {
            "one": {"mass": 1, "inertia": 1},
            "two": {"mass": 1, "inertia": 1, "position": [1, 0]},
            "rod": {"mass": link_mass, "inertia": 0.1, "position": [0.5, 0]},
        },
        "joints": {
            **{
                f"guide-{name}": {"type": "translational", "slider": name, "mu": capacity / 10}
                for name, capacity in zip(("one", "two"), capacities)
            },
            **{
                f"pin-{name}": {
                    "type": "revolute",
                    "bodies": ["rod", name],
                    "points": [[x, 0], [0, 0]],
                }
                for name, x in (("one", -0.5), ("two", 0.5))
            },
        },
        "forces": {
            "pull": {"type": "force", "body": "one", "direction": [1, 0], "law": load},
            **{
                f"weight-{name}": {
                    "type": "force",
                    "body": name,
                    "direction": [0, -1],
                    "law": {"type": "constant", "value": 10},
                }
                for name in ("one", "two")
            },
        },
    }


@pytest.mark.parametrize("link_mass", [1e-3, 0.1, 10])
@pytest.mark.parametrize("capacities", [(1.0, 3.0), (3.0, 1.0), (2.0, 2.0)])
def test_two_sliders_in_series(capacities, link_mass):
    """They share equally until the weaker holds all it can, then the other takes the rest; rest ends at the sum of both."""
    run = run_of(
        two_in_series(capacities, {"type": "linear", "rate": 1.0}, link_mass),
        t_end=5.0,
        output_step=0.1,
    )
    assert run.events[0].time == pytest.approx(sum(capacities), abs=1e-7)
    assert {event.joint for event in run.events} == {"guide-one", "guide-two"}
    rests = run.t < sum(capacities) - 1e-9
    t, (c1, c2) = run.t[rests], capacities
    shares = np.where(t / 2 <= min(c1, c2), t / 2, np.where(c1 < c2, c1, t - c2))
    np.testing.assert_allclose(run["guide-one.friction"][rests], -shares, atol=1e-9)
    np.testing.assert_allclose(run["guide-two.friction"][rests], shares - t, atol=1e-9)


def test_locked_guide_on_a_pendulum():
    """A block that a strut locks on a swinging arm: one rigid pendulum, of period from its parts, without any event."""
    arm, block, strut = (2.0, 0.3, (0.0, 0.0)), (1.0, 0.1, (0.5, 0.0)), (0.3, 0.02, (0.25, -0.25))
    half = float(np.sqrt(0.125))
    run = run_of(
        {
            "gravity": [0, -9.81],
            "bodies": {
                name: {"mass": m, "inertia": j, "position": list(x), "angle": angle}
                for name, (m, j, x), angle in (
                    ("arm", arm, 0.0),
                    ("block", block, 0.0),
                    ("strut", strut, np.pi / 4),
                )
            },
            "joints": {
                "pivot": {"type": "revolute", "bodies": ["arm", "ground"]},
                "guide": {
                    "type": "translational",
                    "slider": "block",
                    "guide": "arm",
                    "mu": 0.2,
                    "length": 0.3,
                },
                "p": {
                    "type": "revolute",
                    "bodies": ["strut", "block"],
                    "points": [[half, 0], [0, 0]],
                },
                "q": {
                    "type": "revolute",
                    "bodies": ["strut", "arm"],
                    "points": [[-half, 0], [0, -0.5]],
                },
            },
        },
        t_end=3.0,
    )
    assert run.events == () and not run["guide.mode"].any() and not run["guide.friction"].any()
    inertia = sum(j + m * (x**2 + y**2) for m, j, (x, y) in (arm, block, strut))
    moment = np.array([sum(m * x[k] for m, _, x in (arm, block, strut)) for k in range(2)])
    height = np.sin(run["arm.angle"]) * moment[0] + np.cos(run["arm.angle"]) * moment[1]
    energy = 0.5 * inertia * run["arm.omega"] ** 2 + 9.81 * height
    np.testing.assert_allclose(energy, energy[0], atol=1e-7)
