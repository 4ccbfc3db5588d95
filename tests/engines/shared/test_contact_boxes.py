"""A box in a guide of the ground, as contacts carry, brake, hold and wedge it: closed forms that know no engine."""

import numpy as np
import pytest
from conftest import installed

from stiction.scenes import scene_from_dict

G, MASS, LENGTH, WIDTH, MU, MUS, STEP = 9.81, 2.0, 0.6, 0.2, 0.2, 0.3, 1e-3
WEIGHT = MASS * G
WAYS = {"mujoco": {}, "drake": {}, "continuous": {"method": "continuous", "rtol": 1e-5}, "dart": {}, "box": {"shape": "box"},
        **{detector: {"detector": detector} for detector in ("FCL", "Bullet", "DART")}}
"""Ways of contact: MuJoCo's, Drake's two plants, and DART's shapes and detectors of contacts."""
HELD_AT_ONCE = pytest.mark.parametrize("way", [way for way in WAYS if way != "mujoco"])
"""A box of MuJoCo's lands and slips first, and then a load beyond the kinetic coefficient moves it; see its own test of a load that grows."""
LANDED = {"mujoco": 1e-6, "drake": 1e-6, "continuous": 1e-5}
"""Parts of a load that are missing after half a second; a box of DART's rises by 1 % of what it sank, of h^2 g, each step."""


@pytest.fixture(params=WAYS)
def way(request):
    return request.param


def simulate(way, scene, t_end=0.5):
    settings = WAYS[way] if "method" in WAYS[way] else {**WAYS[way], "dt": STEP}
    engine = installed("drake" if way == "continuous" else way if way in ("mujoco", "drake") else "dart")
    return engine.simulate(scene, t_end=t_end, fidelity="contact", **settings)


def box(push=0.0, height=0.0, *, torque=0.0, angle=0.0, speed=0.0, mus=MUS, gravity=G):
    """A box in a guide at an angle that weighs on the lower surface, pushed along it at a height above its centre."""
    c, s = np.cos(angle), np.sin(angle)
    return scene_from_dict({
        "gravity": [s * gravity, -c * gravity],
        "bodies": {"slider": {"mass": MASS, "inertia": 0.1, "angle": angle, "velocity": [c * speed, s * speed]}},
        "joints": {"guide": {"type": "translational", "slider": "slider", "direction": [c, s], "angle": angle, "length": LENGTH, "width": WIDTH, "mu": MU, "mus": mus}},
        "forces": {"push": {"type": "force", "body": "slider", "direction": [c, s], "point": [0, height], "law": {"type": "constant", "value": push}},
                   "turn": {"type": "torque", "body": "slider", "law": {"type": "constant", "value": torque}}}})


def corners(run):
    return np.array([run[f"guide.F{k}"][-1] for k in (1, 2, 3, 4)])


@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi])
def test_a_box_at_rest_is_carried(way, angle):
    run = simulate(way, box(angle=angle))
    np.testing.assert_allclose(corners(run), [WEIGHT / 2, WEIGHT / 2, 0, 0], atol=LANDED.get(way, 7e-3) * WEIGHT)
    assert np.all(run["guide.mode"][1:] == 0) and abs(run["guide.friction"][-1]) < 1e-3 * WEIGHT
    assert run["drift.position"].max() < 1e-4


@pytest.mark.parametrize("angle", [0.0, 2.5])
@pytest.mark.parametrize("speed", [0.8, -0.8])
def test_a_sliding_box_comes_to_rest(way, angle, speed):
    """v - mu g t until it rests, and no farther; steps: friction of at most three is missing, or has mus."""
    run, sense = simulate(way, box(angle=angle, speed=speed)), np.sign(speed)
    expected = sense * np.maximum(abs(speed) - MU * G * run.t, 0)
    np.testing.assert_allclose(run["guide.slip_velocity"], expected, atol=2e-5 if way == "continuous" else 3 * STEP * MUS * G)
    slides = (run.t > 0.02) & (run.t < abs(speed) / (MU * G) - 0.02)
    np.testing.assert_allclose(run["guide.friction"][slides], -sense * MU * WEIGHT, rtol=0.03)  # of what it landed with
    assert set(run["guide.mode"][slides]) == {sense} and run["guide.mode"][-1] == 0


@pytest.mark.parametrize("height", [0.05, -0.15])
def test_a_push_above_what_friction_holds_loads_one_end(way, height):
    """Moments about the two lower corners, with the friction at the lower surface; what is left of the push accelerates the box."""
    push = 0.45 * WEIGHT
    run, half = simulate(way, box(push, height)), (push * height + WIDTH / 2 * MU * WEIGHT) / LENGTH
    np.testing.assert_allclose(corners(run), [WEIGHT / 2 - half, WEIGHT / 2 + half, 0, 0], atol=7e-3 * WEIGHT)
    assert run["guide.slip_velocity"][-1] == pytest.approx((push - MU * WEIGHT) / MASS * 0.5, abs=3 * STEP * MUS * G)


@pytest.mark.parametrize("speed", [4.0, -4.0])
@pytest.mark.parametrize(("torque", "gravity"), [(12.0, G), (-12.0, G), (6.0, 0.0), (-6.0, 0.0)])
def test_a_wedged_box_is_braked_at_the_corners_that_carry_it(way, speed, torque, gravity):
    """Zhuang & Wang 2014, Sect. 5: n1 + n2 = R, n2 - n1 = (2/a) (T + (b/2) s mu R), friction mu (|n1| + |n2|); here T is minus the
    torque, and the difference is the larger."""
    sense, load = np.sign(speed), MASS * gravity
    difference = 2 / LENGTH * (WIDTH / 2 * sense * MU * load - torque)
    run = simulate(way, box(speed=speed, torque=torque, gravity=gravity, mus=MU), 0.3)
    n1, n2 = (load - difference) / 2, (load + difference) / 2
    np.testing.assert_allclose(corners(run), np.maximum([n1, n2, -n2, -n1], 0), atol=0.02 * abs(difference))
    brake = MU * abs(difference) / MASS
    assert run["guide.slip_velocity"][-1] == pytest.approx(speed - sense * brake * run.t[-1], abs=4 * STEP * brake)  # it lands on one corner, then on the other


@HELD_AT_ONCE
@pytest.mark.parametrize(("share", "slides"), [(0.98, False), (1.02, True)])
def test_the_static_coefficient_holds_until_its_bound(way, share, slides):
    push = share * MUS * WEIGHT
    run = simulate(way, box(push))
    if slides:  # with mus for the time in which 2 % of it bring the slider to where regularized friction is whole
        assert run["guide.slip_velocity"][-1] == pytest.approx((push / MASS - MU * G) * 0.5, abs=3 * STEP * MUS * G)
    else:
        assert run["guide.mode"][-1] == 0 and abs(run["guide.slip_velocity"][-1]) < 2e-4
