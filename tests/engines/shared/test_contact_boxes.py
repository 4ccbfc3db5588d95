"""A box in a guide of the ground, as contacts carry, brake, hold and wedge it: closed forms that know no engine."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from conftest import installed

from stiction.scenes import scene_from_dict

G, MASS, LENGTH, WIDTH, MU, MUS, STEP = 9.81, 2.0, 0.6, 0.2, 0.2, 0.3, 1e-3
WEIGHT = MASS * G


@dataclass(frozen=True)
class Way:
    """An engine with its settings, and how far it may be from the closed forms.

    Attributes
    ----------
    load : float
        Part of a load that is missing once the box has landed.
    late : float
        Steps whose friction is missing, as the box lands first.
    wedged_late : float
        The same where it lands on one corner, then on the other.
    """

    engine: str
    settings: Mapping[str, Any]
    load: float
    late: float
    wedged_late: float


def dart(**settings):
    """A box of DART's rises by 1 % of what it sank, h^2 g, each step, and 1 % less each step: 1e-4 of its weight.

    Twice that leaves room for the mixing, 1e-5 of each contact.
    """
    return Way("dart", {**settings, "dt": STEP}, load=2e-4, late=3, wedged_late=3)


WAYS = {
    # in equilibrium, to what its solver leaves of a load
    "mujoco": Way("mujoco", {"dt": STEP}, load=1e-6, late=2, wedged_late=4),
    # boxes begin in their surfaces, and one step may pass until the surfaces brake
    "drake": Way("drake", {"dt": STEP}, load=1e-6, late=1, wedged_late=1),
    # its error control of 1e-5 instead of steps: 2e-5 m/s are 0.01 STEP mu g
    "continuous": Way(
        "drake", {"method": "continuous", "rtol": 1e-5}, load=1e-5, late=0.01, wedged_late=0.01
    ),
    "dart": dart(),
    "box": dart(shape="box"),
    **{name: dart(detector=name) for name in ("FCL", "Bullet", "DART")},
}
"""Ways of contact: MuJoCo's, Drake's two plants, and DART's shapes and detectors of contacts."""
HELD_AT_ONCE = pytest.mark.parametrize(
    "way", [way for way in WAYS if way != "mujoco"], indirect=True
)
"""A box of MuJoCo's lands and slips first, and then a load beyond the kinetic coefficient moves it; see its own test of a
load that grows."""
SINKS = 3 * G * STEP**2
"""A box falls for a step or two until its surfaces carry it, MuJoCo's sinks by less, and Drake's not at all."""


@pytest.fixture(params=WAYS)
def way(request):
    return WAYS[request.param]


def simulate(way, scene, t_end=0.5):
    return installed(way.engine).simulate(scene, t_end=t_end, fidelity="contact", **way.settings)


def box(push=0.0, height=0.0, *, torque=0.0, angle=0.0, speed=0.0, mus=MUS, gravity=G):
    """A box in a guide at an angle that weighs on the lower surface, pushed along it at a height above its centre."""
    c, s = np.cos(angle), np.sin(angle)
    return scene_from_dict(
        {
            "gravity": [s * gravity, -c * gravity],
            "bodies": {
                "slider": {
                    "mass": MASS,
                    "inertia": 0.1,
                    "angle": angle,
                    "velocity": [c * speed, s * speed],
                }
            },
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "direction": [c, s],
                    "angle": angle,
                    "length": LENGTH,
                    "width": WIDTH,
                    "mu": MU,
                    "mus": mus,
                }
            },
            "forces": {
                "push": {
                    "type": "force",
                    "body": "slider",
                    "direction": [c, s],
                    "point": [0, height],
                    "law": {"type": "constant", "value": push},
                },
                "turn": {
                    "type": "torque",
                    "body": "slider",
                    "law": {"type": "constant", "value": torque},
                },
            },
        }
    )


def corners(run):
    return np.array([run[f"guide.F{k}"][-1] for k in (1, 2, 3, 4)])


def lower_corners(push, height, friction):
    """Moments about the two lower corners, with the friction at the lower surface."""
    half = (push * height + WIDTH / 2 * friction) / LENGTH
    return [WEIGHT / 2 - half, WEIGHT / 2 + half, 0, 0]


@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi])
@pytest.mark.parametrize(("push", "height"), [(0.0, 0.0), (3.0, 0.25), (3.0, -0.25)])
def test_a_box_at_rest_is_carried(way, angle, push, height):
    """By its lower corners, also under an eccentric load of less than mu m g."""
    run = simulate(way, box(push, height, angle=angle))
    np.testing.assert_allclose(
        corners(run), lower_corners(push, height, push), atol=way.load * WEIGHT
    )
    assert run["guide.friction"][-1] == pytest.approx(-push, abs=way.load * WEIGHT)
    assert np.all(run["guide.mode"][1:] == 0)
    assert run["drift.position"].max() < SINKS


@pytest.mark.parametrize("angle", [0.0, 2.5])
@pytest.mark.parametrize("speed", [0.8, -0.8])
def test_a_sliding_box_comes_to_rest(way, angle, speed):
    """v - mu g t until it rests after v^2/(2 mu g), and no farther."""
    run, sense, stop = (
        simulate(way, box(angle=angle, speed=speed)),
        np.sign(speed),
        abs(speed) / (MU * G),
    )
    expected = sense * np.maximum(abs(speed) - MU * G * run.t, 0)
    np.testing.assert_allclose(run["guide.slip_velocity"], expected, atol=way.late * STEP * MU * G)
    # what is late slides at its first speed meanwhile; velocities and positions of a step may differ by half of it
    assert run["guide.displacement"][-1] == pytest.approx(
        speed * stop / 2, abs=max(way.late, 1) * STEP * abs(speed)
    )
    slides, rests = (run.t > 0.02) & (run.t < stop - 0.02), run.t > stop + 0.01
    np.testing.assert_allclose(run["guide.friction"][slides], -sense * MU * WEIGHT, rtol=way.load)
    assert set(run["guide.mode"][slides]) == {sense} and set(run["guide.mode"][rests]) == {0}
    assert (
        np.ptp(run["guide.displacement"][rests]) < 1e-6
    )  # creep at 1e-5 m/s, the tolerance of stick, for 0.1 s


@pytest.mark.parametrize("height", [0.05, -0.15])
def test_a_push_above_what_friction_holds_loads_one_end(way, height):
    """What is left of the push accelerates the box; friction has mus until a step has found that it slips."""
    push = 0.45 * WEIGHT
    run = simulate(way, box(push, height))
    np.testing.assert_allclose(
        corners(run), lower_corners(push, height, MU * WEIGHT), atol=way.load * WEIGHT
    )
    speed, late = (push - MU * WEIGHT) / MASS * 0.5, max(way.late, 1) * STEP
    assert run["guide.slip_velocity"][-1] == pytest.approx(speed, abs=late * MUS * G)


@pytest.mark.parametrize("speed", [4.0, -4.0])
@pytest.mark.parametrize(("torque", "gravity"), [(12.0, G), (-12.0, G), (6.0, 0.0), (-6.0, 0.0)])
def test_a_wedged_box_is_braked_at_the_corners_that_carry_it(way, speed, torque, gravity):
    """Zhuang & Wang 2014, Sect. 5: n1 + n2 = R, n2 - n1 = (2/a) (T + (b/2) s mu R), friction mu (|n1| + |n2|); here T is minus the
    torque, and the difference is the larger."""
    sense, load = np.sign(speed), MASS * gravity
    difference = 2 / LENGTH * (WIDTH / 2 * sense * MU * load - torque)
    run = simulate(way, box(speed=speed, torque=torque, gravity=gravity, mus=MU), 0.3)
    n1, n2 = (load - difference) / 2, (load + difference) / 2
    np.testing.assert_allclose(
        corners(run), np.maximum([n1, n2, -n2, -n1], 0), atol=way.load * abs(difference)
    )
    brake = MU * abs(difference) / MASS
    left = speed - sense * brake * run.t[-1]
    assert run["guide.slip_velocity"][-1] == pytest.approx(left, abs=way.wedged_late * STEP * brake)


@HELD_AT_ONCE
@pytest.mark.parametrize("height", [0.0, 0.25, -0.25])
@pytest.mark.parametrize(("share", "slides"), [(0.98, False), (1.02, True)])
def test_the_static_coefficient_holds_until_its_bound(way, share, slides, height):
    push = share * MUS * WEIGHT
    run = simulate(way, box(push, height))
    if slides:  # with mus for the time in which 2 % of it bring the slider to where regularized friction is whole
        assert run["guide.slip_velocity"][-1] == pytest.approx(
            (push / MASS - MU * G) * 0.5, abs=3 * STEP * MUS * G
        )
    else:  # creep: ten times the tolerance of regularized friction, 1e-5 m/s; 1e-5 of what DART stops in a step
        creep = 1e-7 if way.engine == "dart" else 1e-4
        assert run["guide.mode"][-1] == 0 and abs(run["guide.slip_velocity"][-1]) < creep
        np.testing.assert_allclose(
            corners(run), lower_corners(push, height, push), atol=way.load * WEIGHT
        )
