"""DART: what its solver and its tree are to do at contact fidelity, refusals, joint friction in loops."""

import numpy as np
import pytest

from stiction.comparisons.hard.scaled_scenes import Units, scaled
from stiction.engines import Refused, load_engine
from stiction.scenes import InputError, load_scene, vary

constraint = pytest.importorskip("dartpy.constraint")
G = 9.81


@pytest.fixture(scope="module")
def engine():
    return load_engine("dart")


def test_the_same_in_other_units(engine):
    """A bar of 1 mm and 2 mg: DART takes impulses below 1e-8 N s for converged, whatever its masses are."""
    scene = load_scene("slider-bar-case-1")
    units = Units(length=1e-3, mass=1e-6, time=np.sqrt(1e-3))
    run = engine.simulate(scene, t_end=1.0, dt=1e-3, fidelity="contact")
    small = engine.simulate(
        scaled(scene, units),
        t_end=units.time,
        dt=1e-3 * units.time,
        output_step=0.01 * units.time,
        fidelity="contact",
    )
    np.testing.assert_allclose(small["slider.x"] / units.length, run["slider.x"], atol=1e-6)


def test_the_box_is_where_the_guide_has_it(engine):
    """A slider whose pin and whose guide's point are not its centre of mass: the motion at joint fidelity, which knows no corners."""
    scene = vary(
        load_scene("slider-bar-case-1"),
        {
            "pin.points": [["-L/2", 0], [0.05, 0.02]],
            "guide.slider_point": [0.1, -0.03],
            "guide.point": ["L0 + 0.1", -0.03],
            "bar.position": ["L0 + 0.05 + L/2", 0.02],
        },
    )
    joint, contact = (
        engine.simulate(scene, t_end=2.0, dt=1e-3, fidelity=fidelity)
        for fidelity in ("joint", "contact")
    )
    for column, unit in (("slider.x", 1e-3), ("guide.friction", 0.02), ("motor.effort", 0.05)):
        np.testing.assert_allclose(np.median(np.abs(contact[column] - joint[column])), 0, atol=unit)
    assert contact["drift.position"].max() < 1e-4 and np.ptp(joint["slider.x"]) > 0.3


def test_a_coefficient_that_contacts_ignore_is_refused(engine):
    for coefficient in (1e-3, 1e-9):
        with pytest.raises(
            Refused,
            match=f"joints.guide: found a coefficient of friction of {coefficient:g}; DART's contacts have none up to 0.001",
        ):
            engine.simulate(
                vary(load_scene("slider-bar-case-1"), {"guide.mu": coefficient}), fidelity="contact"
            )
    assert "found a coefficient of friction of 0.0005" in engine.refusal(
        vary(load_scene("slider-bar-case-1"), {"guide.mu": 0, "guide.mus": 5e-4}), "contact"
    )
    assert (
        engine.refusal(vary(load_scene("slider-bar-case-1"), {"guide.mu": 2e-3}), "contact") is None
    )
    assert engine.refusal(load_scene("slider-bar-case-1-frictionless"), "contact") is None


@pytest.mark.parametrize("fidelity", ["joint", "contact"])
def test_settings_of_the_process_come_back(engine, fidelity):
    """DART has one error reduction for all its loops."""
    loop = constraint.BallJointConstraint
    before = loop.getErrorReductionParameter(), loop.getMaxErrorReductionVelocity()
    engine.simulate(load_scene("elliptic-trammel"), t_end=0.05, dt=1e-3, fidelity=fidelity, erp=0.5)
    assert (loop.getErrorReductionParameter(), loop.getMaxErrorReductionVelocity()) == before


@pytest.mark.parametrize("name", ["trammel-comes-to-rest", "oblique-trammel-comes-to-rest"])
@pytest.mark.parametrize("dt", [2e-3, 1e-3])
def test_joint_friction_that_holds_a_loop_sticks(engine, name, dt):
    """DART's mixing leaves 1e-9 of what friction stops in a step, more than rounding: shares of two guides at rest are open, as for every engine."""
    scene = load_scene(f"hard/{name}")
    run = engine.simulate(scene, dt=dt, output_step=0.1)
    for guide in scene.frictional_guides:
        assert 0 < abs(run[f"{guide}.slip_velocity"][-1]) < 1e-8 * G * dt
        assert run[f"{guide}.mode"][-1] == 0 and np.isnan(run[f"{guide}.friction"][-1])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"iterations": 0}, "iterations: found 0; expected a whole number"),
        ({"shape": "capsule"}, "expected one of spheres, box"),
        ({"detector": "bullet"}, "expected one of ODE, FCL, Bullet, DART"),
        ({"passes": 2}, "no such setting at contact"),
    ],
)
def test_bad_settings_of_contacts(engine, settings, words):
    with pytest.raises(InputError, match=words):
        engine.simulate(
            load_scene("slider-bar-case-1-mus-equals-mu"), t_end=0.1, fidelity="contact", **settings
        )
