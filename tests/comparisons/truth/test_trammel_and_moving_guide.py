"""Trammel and turning arm: Newton and Euler for every body, energy, friction law, special cases."""

import copy

import numpy as np
import pytest
from truth_checks import balance, check_contact, check_derivatives, check_energy, cross, vector

from stiction.comparisons.truth import moving_guide_truth, trammel_truth
from stiction.scenes import load_scene, scene_from_dict, vary


def guide_force(c, guide, direction):
    """Force of a guide on its slider."""
    normal = np.array([-direction[1], direction[0]])
    return c[f"{guide}.friction"] * direction + c[f"{guide}.normal_force"] * normal


LOADED = {"phi": "deg(50)", "w": 0, "T": 0, "mu": 0.1, "mus": 0.15}


def rocking_trammel():
    """The catalogue's trammel from rest, with a spring and a sine force, so that it comes to rest again and again."""
    raw = copy.deepcopy(vary(load_scene("elliptic-trammel"), LOADED)._raw)
    raw["springs"] = {"spring": {"type": "linear", "bodies": ["slider-x", "ground"], "axis": [1, 0], "stiffness": 40}}
    raw["forces"]["load"] = {"type": "force", "body": "slider-x", "direction": [1, 0],
                             "law": {"type": "sine", "amplitude": 10, "frequency": 4}}
    return scene_from_dict(raw, "rocking")


@pytest.fixture(scope="module", params=["turning", "rocking"])
def trammel(request):
    scene = load_scene("elliptic-trammel") if request.param == "turning" else rocking_trammel()
    return scene, trammel_truth(scene, 4.0)


def test_trammel_obeys_newton_and_euler(trammel):
    scene, truth = trammel
    t = np.linspace(0, 4, 1001)
    c = truth(t)
    pins = {axis: vector(c, f"pin-{axis}.f") for axis in "xy"}
    load = np.array([10 * np.sin(4 * t) - 40 * c["slider-x.x"], 0 * t]) if scene.springs else 0.0
    # 1e-10: rounding of forces of up to 1e3 N
    np.testing.assert_allclose(balance(scene, "bar", c), pins["x"] + pins["y"], atol=1e-10)
    for axis, direction, extra in (("x", (1.0, 0.0), load), ("y", (0.0, 1.0), 0.0)):
        force = guide_force(c, f"guide-{axis}", np.array(direction)[:, None]) - pins[axis] + extra
        np.testing.assert_allclose(balance(scene, f"slider-{axis}", c), force, atol=1e-10)
        check_contact(c, f"guide-{axis}", scene.guides[f"guide-{axis}"], 1e-11)
    arm = 0.5 * np.array([np.cos(c["bar.angle"]), np.sin(c["bar.angle"])])
    moment = cross(arm, pins["x"]) - cross(arm, pins["y"]) + scene.forces["torque"].law.value
    np.testing.assert_allclose(scene.bodies["bar"].inertia * c["bar.alpha"], moment, atol=1e-10)
    np.testing.assert_allclose(vector(c, "bar.") + arm, vector(c, "slider-x."), atol=1e-13)
    np.testing.assert_allclose(vector(c, "bar.") - arm, vector(c, "slider-y."), atol=1e-13)
    assert np.all(c["slider-x.y"] == 0) and np.all(c["slider-y.x"] == 0)


def test_trammel_moves_as_it_accelerates(trammel):
    _, truth = trammel
    # h^4/30 times a fifth derivative of up to 12^5
    check_derivatives(truth, [("bar.angle", "bar.omega"), ("bar.omega", "bar.alpha"), ("slider-x.x", "slider-x.vx"),
                              ("slider-y.vy", "slider-y.ay"), ("bar.vx", "bar.ax")], 1500, 1e-6)


def test_trammel_balances_its_energy(trammel):
    scene, truth = trammel
    spring, load = (20, 10) if scene.springs else (0, 0)

    def energy(c):
        kinetic = sum(body.mass * ((c[f"{name}.vx"] ** 2 + c[f"{name}.vy"] ** 2) / 2 + 9.81 * c[f"{name}.y"])
                      for name, body in scene.bodies.items())
        return kinetic + scene.bodies["bar"].inertia * c["bar.omega"] ** 2 / 2 + spring * c["slider-x.x"] ** 2

    def power(c, t):
        return ((c["guide-x.friction"] + load * np.sin(4 * t)) * c["slider-x.vx"]
                + c["guide-y.friction"] * c["slider-y.vy"] + scene.forces["torque"].law.value * c["bar.omega"])

    check_energy(truth, energy, power, 1e-10)  # rounding of powers of up to 1e3 W


def test_trammel_events(trammel):
    scene, truth = trammel
    found = {(event.kind, event.joint) for event in truth.events}
    if scene.springs:
        assert {("stick", "guide-x"), ("stick", "guide-y"), ("slip", "guide-x"), ("slip", "guide-y")} <= found
    else:
        assert {("reversal", "guide-x"), ("reversal", "guide-y")} <= found
        for event in truth.events:
            if event.kind == "reversal":  # each slider reverses at its dead point while the bar goes on
                assert abs(event.before[f"{event.joint}.slip_velocity"]) < 1e-12
                assert abs(event.before["bar.omega"]) > 1
    assert max(truth.uncertainty.values()) < 1e-10


def test_trammel_without_friction_keeps_its_energy_and_refuses_jamming_sliders():
    scene = vary(load_scene("elliptic-trammel"), {"mu": 0, "mus": 0, "T": 0})
    c = trammel_truth(scene, 3.0)(np.linspace(0, 3, 100))
    inertia = 2 / 12 + 2 / 4  # bar about the instant centre, L/2 away
    energy = (inertia * c["bar.omega"] ** 2 + c["slider-x.vx"] ** 2 + c["slider-y.vy"] ** 2) / 2 \
        + 9.81 * (2 * c["bar.y"] + c["slider-y.y"])
    np.testing.assert_allclose(energy, energy[0], atol=1e-11)
    with pytest.raises(ValueError, match="mus"):
        trammel_truth(vary(load_scene("elliptic-trammel"), {"mus": 4.0}))


def driven_arm():
    """The arm of the catalogue, turned by a motor instead of swinging."""
    raw = copy.deepcopy(load_scene("slider-on-moving-guide", {"w": 2.0})._raw)
    raw["drives"] = {"motor": {"type": "angle", "bodies": ["arm", "ground"],
                               "law": {"type": "linear", "offset": "phi", "rate": "w"}}}
    del raw["springs"]["twist"]
    return scene_from_dict(raw, "driven arm")


@pytest.fixture(scope="module", params=["free", "driven"])
def arm(request):
    scene = load_scene("slider-on-moving-guide") if request.param == "free" else driven_arm()
    return scene, moving_guide_truth(scene, 6.0)


def test_arm_obeys_newton_and_euler(arm):
    scene, truth = arm
    c = truth(np.linspace(0, 6, 1001))
    direction = np.array([np.cos(c["arm.angle"]), np.sin(c["arm.angle"])])
    spring = -30 * (c["guide.displacement"] - 0.5) * direction
    contact = guide_force(c, "guide", direction)
    np.testing.assert_allclose(balance(scene, "slider", c), contact + spring, atol=1e-11)
    check_contact(c, "guide", scene.guides["guide"], 1e-11)
    np.testing.assert_allclose(scene.bodies["slider"].inertia * c["slider.alpha"], c["guide.moment"], atol=1e-12)
    reaction = -cross(vector(c, "slider."), contact + spring) - c["guide.moment"]
    drive = c["motor.effort"] if scene.drives else -20 * c["arm.angle"]
    np.testing.assert_allclose(scene.bodies["arm"].inertia * c["arm.alpha"], reaction + drive, atol=1e-11)
    weight = scene.bodies["arm"].mass * np.array([[0], [-9.81]])
    np.testing.assert_allclose(vector(c, "pivot.f") - contact - spring + weight, 0, atol=1e-11)
    np.testing.assert_allclose(vector(c, "slider."), c["guide.displacement"] * direction, atol=1e-13)


def test_arm_moves_as_it_accelerates(arm):
    _, truth = arm
    check_derivatives(truth, [("arm.angle", "arm.omega"), ("arm.omega", "arm.alpha"), ("slider.x", "slider.vx"),
                              ("slider.vy", "slider.ay"), ("guide.displacement", "guide.slip_velocity")], 1500, 1e-7)


def test_arm_balances_its_energy(arm):
    scene, truth = arm
    inertia = scene.bodies["arm"].inertia + scene.bodies["slider"].inertia

    def energy(c):
        kinetic = (c["slider.vx"] ** 2 + c["slider.vy"] ** 2 + inertia * c["arm.omega"] ** 2) / 2
        twist = 0.0 if scene.drives else 10 * c["arm.angle"] ** 2
        return kinetic + 15 * (c["guide.displacement"] - 0.5) ** 2 + twist + 9.81 * c["slider.y"]

    def power(c, t):
        return c["guide.friction"] * c["guide.slip_velocity"] + (c["motor.effort"] * 2.0 if scene.drives else 0.0)

    check_energy(truth, energy, power, 1e-11)  # rounding of powers of up to 1e2 W
    if not scene.drives:
        assert "stick" in {event.kind for event in truth.events}
    assert max(truth.uncertainty.values()) < 1e-11


def test_horizontal_arm_without_friction_and_spring_is_a_centrifuge():
    """r'' = w^2 r: r = r0 cosh(w t) + u/w sinh(w t); motor torque 2 m r r' w."""
    t = np.linspace(0, 1, 50)
    c = moving_guide_truth(vary(driven_arm(), {"g": 0.0, "k": 0.0, "mu": 0.0, "mus": 0.0}), 1.0)(t)
    r, rate = 0.5 * np.cosh(2 * t) + 0.2 * np.sinh(2 * t), np.sinh(2 * t) + 0.4 * np.cosh(2 * t)
    np.testing.assert_allclose(c["guide.displacement"], r, atol=1e-13)
    np.testing.assert_allclose(c["motor.effort"], 4 * r * rate, atol=1e-12)


@pytest.mark.parametrize("truth", [trammel_truth, moving_guide_truth])
def test_refuses_what_has_another_structure(truth):
    with pytest.raises(ValueError, match="bodies"):
        truth(load_scene("pendulum"))
