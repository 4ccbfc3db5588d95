"""DART at contact fidelity: which corners carry, friction by Coulomb's law, what its solver and its tree are to do, refusals."""

import numpy as np
import pytest

from stiction.comparisons.hard.scaled_scenes import Units, scaled
from stiction.engines import Refused, load_engine
from stiction.scenes import load_scene, scene_from_dict, vary

constraint = pytest.importorskip("dartpy.constraint")
G, MASS, LENGTH, WIDTH, MU = 9.81, 2.0, 0.6, 0.2, 0.2
MIXING = 1e-5
"""DART's own (DART_CFM): the share of what a contact is to stop in a step that is left, at each contact alone."""
SHAPES = pytest.mark.parametrize("settings", [{}, {"shape": "box"}, {"detector": "FCL"}, {"detector": "Bullet"}, {"detector": "DART"}],
                                 ids=["spheres", "box", "FCL", "Bullet", "DART"])


@pytest.fixture(scope="module")
def engine():
    return load_engine("dart")


def box(loads=None, *, torque=0.0, angle=0.0, speed=0.0, mus=MU, gravity=G):
    """A box in a guide at this angle that weighs on the lower surface; `loads`: force, its direction and its point in the guide's axes."""
    c, s = np.cos(angle), np.sin(angle)
    force, (x, y), point = loads or (0.0, (1.0, 0.0), (0.0, 0.0))
    forces = {"push": {"type": "force", "body": "slider", "direction": [c * x - s * y, s * x + c * y], "point": list(point),
                       "law": {"type": "constant", "value": force}},
              "turn": {"type": "torque", "body": "slider", "law": {"type": "constant", "value": torque}}}
    return scene_from_dict({
        "gravity": [s * gravity, -c * gravity],
        "bodies": {"slider": {"mass": MASS, "inertia": MASS * (LENGTH ** 2 + WIDTH ** 2) / 12, "angle": angle, "velocity": [c * speed, s * speed]}},
        "joints": {"guide": {"type": "translational", "slider": "slider", "direction": [c, s], "angle": angle, "length": LENGTH, "width": WIDTH,
                             "mu": MU, "mus": mus}}, "forces": forces})


def corners(run):
    return np.array([run[f"guide.F{k}"][-1] for k in (1, 2, 3, 4)])


@SHAPES
@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi])
def test_a_box_at_rest_carries_its_weight(engine, settings, angle):
    run = engine.simulate(box(angle=angle), t_end=1.0, dt=1e-3, fidelity="contact", **settings)
    weight = MASS * G
    np.testing.assert_allclose(corners(run), [weight / 2, weight / 2, 0, 0], atol=weight * 1e-3)  # it rises by 1 % of what it sank, of h^2 g, each step
    assert abs(run["guide.friction"][-1]) < 1e-3 * weight and run["drift.position"].max() < 3 * G * 1e-6


@SHAPES
@pytest.mark.parametrize("angle", [0.0, 2.5])
def test_a_sliding_box_comes_to_rest(engine, settings, angle):
    """v - mu g t until it rests, and no farther."""
    dt, speed = 1e-3, 0.8
    run = engine.simulate(box(angle=angle, speed=speed), t_end=0.6, dt=dt, fidelity="contact", output_step=0.01, **settings)
    # friction of at most three steps is missing: boxes land first
    np.testing.assert_allclose(run["guide.slip_velocity"], np.maximum(speed - MU * G * run.t, 0), atol=3 * dt * MU * G)
    slides = (run.t > 0.02) & (run.t < speed / (MU * G) - 0.02)
    np.testing.assert_allclose(run["guide.friction"][slides], -MU * MASS * G, rtol=0.03)  # of what it landed with
    assert set(run["guide.mode"][slides]) == {1} and run["guide.mode"][-1] == 0


@pytest.mark.parametrize("height", [0.05, -0.05])
def test_a_push_above_the_centre_loads_the_front(engine, height):
    """Moments about the centre of mass: (a/2) (F2 - F1) = P y + (b/2) f, with the friction f = mu m g of the lower surface."""
    push, weight = 1.5 * MU * MASS * G, MASS * G
    run = engine.simulate(box((push, (1, 0), (0, height))), t_end=0.8, dt=1e-3, fidelity="contact")
    half = (push * height + WIDTH / 2 * MU * weight) / LENGTH
    np.testing.assert_allclose(corners(run), [weight / 2 - half, weight / 2 + half, 0, 0], atol=2e-3 * weight)
    np.testing.assert_allclose(run["guide.slip_velocity"][-1], (push / MASS - MU * G) * 0.8, atol=3e-3 * (push / MASS))


@SHAPES
@pytest.mark.parametrize(("sign", "loaded"), [(1, (1, 0, 1, 0)), (-1, (0, 1, 0, 1))])
def test_a_torque_wedges_opposite_corners(engine, settings, sign, loaded):
    """Without weight two corners carry T/a each, and the box is braked by 2 mu T/a."""
    torque, speed, dt, t_end = 6.0, 3.0, 1e-3, 0.3
    run = engine.simulate(box(torque=sign * torque, speed=speed, gravity=0.0), t_end=t_end, dt=dt, fidelity="contact", **settings)
    np.testing.assert_allclose(corners(run), torque / LENGTH * np.array(loaded), atol=0.02 * torque / LENGTH)
    rate = 2 * MU * torque / LENGTH / MASS
    assert run["guide.slip_velocity"][-1] == pytest.approx(speed - rate * t_end, abs=3 * dt * rate)


@pytest.mark.parametrize(("share", "slides"), [(0.98, False), (1.02, True)])
def test_the_static_coefficient_holds_until_its_bound(engine, share, slides):
    mus, t_end, dt = 0.3, 0.5, 1e-3
    push = share * mus * MASS * G
    run = engine.simulate(box((push, (1, 0), (0, 0)), mus=mus), t_end=t_end, dt=dt, fidelity="contact")
    rate = push / MASS - MU * G
    if slides:
        assert run["guide.slip_velocity"][-1] == pytest.approx(rate * t_end, abs=3 * dt * mus * G)
    else:  # its landing and the tilt of it, of h^2 g, rise by a hundredth a step
        assert run["guide.mode"][-1] == 0 and abs(run["guide.slip_velocity"][-1]) < 0.01 * G * dt * np.exp(-0.01 * t_end / dt) + MIXING * rate


def test_the_same_in_other_units(engine):
    """A bar of 1 mm and 2 mg: DART takes impulses below 1e-8 N s for converged, whatever its masses are."""
    scene = load_scene("slider-bar-case-1")
    units = Units(length=1e-3, mass=1e-6, time=np.sqrt(1e-3))
    run = engine.simulate(scene, t_end=1.0, dt=1e-3, fidelity="contact")
    small = engine.simulate(scaled(scene, units), t_end=units.time, dt=1e-3 * units.time, output_step=0.01 * units.time, fidelity="contact")
    np.testing.assert_allclose(small["slider.x"] / units.length, run["slider.x"], atol=1e-6)


def test_the_box_is_where_the_guide_has_it(engine):
    """A slider whose pin and whose guide's point are not its centre of mass: the motion at joint fidelity, which knows no corners."""
    scene = vary(load_scene("slider-bar-case-1"), {"pin.points": [["-L/2", 0], [0.05, 0.02]], "guide.slider_point": [0.1, -0.03], "guide.point": ["L0 + 0.1", -0.03],
                                                   "bar.position": ["L0 + 0.05 + L/2", 0.02]})
    joint, contact = (engine.simulate(scene, t_end=2.0, dt=1e-3, fidelity=fidelity) for fidelity in ("joint", "contact"))
    for column, unit in (("slider.x", 1e-3), ("guide.friction", 0.02), ("motor.effort", 0.05)):
        np.testing.assert_allclose(np.median(np.abs(contact[column] - joint[column])), 0, atol=unit)
    assert contact["drift.position"].max() < 1e-4 and np.ptp(joint["slider.x"]) > 0.3


def test_a_coefficient_that_contacts_ignore_is_refused(engine):
    for coefficient in (1e-3, 1e-9):
        with pytest.raises(Refused, match=f"joints.guide: found a coefficient of friction of {coefficient:g}; DART's contacts have none up to 0.001"):
            engine.simulate(vary(load_scene("slider-bar-case-1"), {"guide.mu": coefficient}), fidelity="contact")
    assert "found a coefficient of friction of 0.0005" in engine.refusal(vary(load_scene("slider-bar-case-1"), {"guide.mu": 0, "guide.mus": 5e-4}), "contact")
    assert engine.refusal(vary(load_scene("slider-bar-case-1"), {"guide.mu": 2e-3}), "contact") is None
    assert engine.refusal(load_scene("slider-bar-case-1-frictionless"), "contact") is None


@pytest.mark.parametrize("fidelity", ["joint", "contact"])
def test_settings_of_the_process_come_back(engine, fidelity):
    """DART has one error reduction for all its loops."""
    loop = constraint.BallJointConstraint
    before = loop.getErrorReductionParameter(), loop.getMaxErrorReductionVelocity()
    engine.simulate(load_scene("elliptic-trammel"), t_end=0.05, dt=1e-3, fidelity=fidelity, erp=0.5)
    assert (loop.getErrorReductionParameter(), loop.getMaxErrorReductionVelocity()) == before


@pytest.mark.parametrize("name", ["trammel-comes-to-rest", "oblique-trammel-comes-to-rest"])
@pytest.mark.parametrize("dt", [2e-3, 5e-4])
def test_joint_friction_that_holds_a_loop_sticks(engine, name, dt):
    """DART's mixing leaves 1e-9 of what friction stops in a step, more than rounding: shares of two guides at rest are open, as for every engine."""
    scene = load_scene(f"hard/{name}")
    run = engine.simulate(scene, dt=dt, output_step=0.1)
    for guide in scene.frictional_guides:
        assert 0 < abs(run[f"{guide}.slip_velocity"][-1]) < 1e-8 * G * dt
        assert run[f"{guide}.mode"][-1] == 0 and np.isnan(run[f"{guide}.friction"][-1])
