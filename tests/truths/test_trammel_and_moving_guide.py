"""Trammel and turning arm: joints, friction law, events, special cases; Newton and Euler in `test_newton_euler`."""

import numpy as np
import pytest
from truth_checks import check_contact, driven_arm, rocking_trammel

from stiction.scenes import load_scene, vary
from stiction.truths import moving_guide_truth, trammel_truth


@pytest.fixture(scope="module", params=["turning", "rocking"])
def trammel(request):
    scene = (
        load_scene("elliptic-trammel")
        if request.param == "turning"
        else rocking_trammel(phi="deg(50)")
    )
    return scene, trammel_truth(scene, 4.0)


def test_trammel_is_joined_and_obeys_coulomb(trammel):
    scene, truth = trammel
    c = truth(np.linspace(0, 4, 1001))
    arm = 0.5 * np.array([np.cos(c["bar.angle"]), np.sin(c["bar.angle"])])
    for axis, sign in (("x", 1), ("y", -1)):
        check_contact(c, f"guide-{axis}", scene.guides[f"guide-{axis}"], 1e-11)
        ends = np.array([c["bar.x"], c["bar.y"]]) + sign * arm
        np.testing.assert_allclose(ends, [c[f"slider-{axis}.x"], c[f"slider-{axis}.y"]], atol=1e-13)
    assert np.all(c["slider-x.y"] == 0) and np.all(c["slider-y.x"] == 0)


def test_trammel_events(trammel):
    scene, truth = trammel
    found = {(event.kind, event.joint) for event in truth.events}
    if scene.springs:
        assert {
            ("stick", "guide-x"),
            ("stick", "guide-y"),
            ("slip", "guide-x"),
            ("slip", "guide-y"),
        } <= found
    else:
        assert {("reversal", "guide-x"), ("reversal", "guide-y")} <= found
        for event in truth.events:
            if event.kind == "reversal":
                # each slider reverses at its dead point while the bar goes on
                assert abs(event.before[f"{event.joint}.slip_velocity"]) < 1e-12
                assert abs(event.before["bar.omega"]) > 1
    assert max(truth.uncertainty.values()) < 1e-10


def test_trammel_without_friction_keeps_its_energy_and_refuses_jamming_sliders():
    scene = vary(load_scene("elliptic-trammel"), {"mu": 0, "mus": 0, "T": 0})
    c = trammel_truth(scene, 3.0)(np.linspace(0, 3, 100))
    inertia = 2 / 12 + 2 / 4  # bar about the instant centre, L/2 away
    energy = (
        inertia * c["bar.omega"] ** 2 + c["slider-x.vx"] ** 2 + c["slider-y.vy"] ** 2
    ) / 2 + 9.81 * (2 * c["bar.y"] + c["slider-y.y"])
    np.testing.assert_allclose(energy, energy[0], atol=1e-11)
    with pytest.raises(ValueError, match="mus"):
        trammel_truth(vary(load_scene("elliptic-trammel"), {"mus": 4.0}))


@pytest.fixture(scope="module", params=["free", "driven"])
def arm(request):
    scene = load_scene("slider-on-moving-guide") if request.param == "free" else driven_arm()
    return scene, moving_guide_truth(scene, 6.0)


def test_arm_carries_its_slider_and_obeys_coulomb(arm):
    scene, truth = arm
    c = truth(np.linspace(0, 6, 1001))
    check_contact(c, "guide", scene.guides["guide"], 1e-11)
    np.testing.assert_allclose(
        [c["slider.x"], c["slider.y"]],
        c["guide.displacement"] * np.array([np.cos(c["arm.angle"]), np.sin(c["arm.angle"])]),
        atol=1e-13,
    )
    assert scene.drives or "stick" in {event.kind for event in truth.events}
    assert max(truth.uncertainty.values()) < 1e-11


def test_horizontal_arm_without_friction_and_spring_is_a_centrifuge():
    """r'' = w^2 r: r = r0 cosh(w t) + u/w sinh(w t); motor torque 2 m r r' w."""
    t = np.linspace(0, 1, 50)
    c = moving_guide_truth(vary(driven_arm(), {"g": 0.0, "k": 0.0, "mu": 0.0, "mus": 0.0}), 1.0)(t)
    r, rate = 0.5 * np.cosh(2 * t) + 0.2 * np.sinh(2 * t), np.sinh(2 * t) + 0.4 * np.cosh(2 * t)
    np.testing.assert_allclose(c["guide.displacement"], r, atol=1e-13)
    np.testing.assert_allclose(c["motor.effort"], 4 * r * rate, atol=1e-12)
