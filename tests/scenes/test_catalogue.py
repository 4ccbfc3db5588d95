"""Every scene of the catalogue loads, starts on its constraints and is what its name says."""

import tomllib

import numpy as np
import pytest

from stiction.scenes import catalogue, load_scene, scene_from_dict, scene_to_toml, vary
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Linear
from stiction.scenes.model import Revolute

NAMES = {"painleve-rod", "uniqueness-lost", "existence-lost", "slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3",
         *(f"slider-bar-case-{n}-{kind}" for n in (1, 2, 3) for kind in ("mus-equals-mu", "frictionless")),
         "coulomb-oscillator", "block-on-incline", "mass-on-belt", "four-bar", "pendulum", "slider-crank",
         "elliptic-trammel", "slider-on-moving-guide"}


def constraints(scene, t, state):
    """Phi(t, q) by the definitions in `stiction.scenes.model`; complex numbers allowed."""
    def place(body, point):
        if body == GROUND:
            return np.array(point)
        x, y, angle = state[body]
        return np.array([x + np.cos(angle) * point[0] - np.sin(angle) * point[1],
                         y + np.sin(angle) * point[0] + np.cos(angle) * point[1]])

    def angle(body):
        return 0 if body == GROUND else state[body][2]

    def turned(body, vector):
        return place(body, vector) - place(body, (0.0, 0.0))

    phi = []
    for joint in scene.joints.values():
        if isinstance(joint, Revolute):
            phi += list(place(joint.bodies[0], joint.points[0]) - place(joint.bodies[1], joint.points[1]))
        else:
            across = turned(joint.guide, (-joint.direction[1], joint.direction[0]))
            phi += [across @ (place(joint.slider, joint.slider_point) - place(joint.guide, joint.point)),
                    angle(joint.slider) - angle(joint.guide) - joint.angle]
    for drive in scene.drives.values():
        one, other = drive.bodies
        law = drive.law
        assert isinstance(law, (Constant, Linear))
        given = law.value if isinstance(law, Constant) else law.offset + law.rate * t
        between = None if drive.type == "angle" else place(one, drive.points[0]) - place(other, drive.points[1])
        if drive.type == "angle":
            phi.append(angle(one) - angle(other) - given)
        elif drive.axis is None:
            phi.append(np.sqrt(between @ between) - given)
        else:
            phi.append(turned(other, drive.axis) @ between / np.hypot(*drive.axis) - given)
    return np.array(phi)


def test_the_names_are_those_that_are_promised():
    assert set(catalogue()) == NAMES


@pytest.mark.parametrize("name", catalogue())
def test_starts_on_its_constraints(name):
    """Positions, and velocities by the complex step Im Phi(q + i h v)/h, which has no cancellation."""
    scene = load_scene(name)
    h = 1e-30
    state = {key: np.array([*body.position, body.angle]) + 1j * h * np.array([*body.velocity, body.angular_velocity])
             for key, body in scene.bodies.items()}
    phi = constraints(scene, 1j * h, state)
    # rounding of numbers of order 10
    assert np.max(np.abs(phi.real), initial=0.0) < 1e-14
    assert np.max(np.abs(phi.imag), initial=0.0) / h < 1e-14


@pytest.mark.parametrize("name", catalogue())
def test_survives_writing_and_reading(name):
    scene = load_scene(name)
    again = scene_from_dict(tomllib.loads(scene_to_toml(scene)))
    assert again == scene
    assert scene_to_toml(again) == scene_to_toml(scene)


@pytest.mark.parametrize("name", catalogue())
def test_says_what_it_is_and_where_from(name):
    scene = load_scene(name)
    assert scene.name == name and scene.title and scene.source


@pytest.mark.parametrize("case", [1, 2, 3])
def test_variants_of_the_slider_bar_differ_in_friction_only(case):
    scene = load_scene(f"slider-bar-case-{case}")
    one = load_scene(f"slider-bar-case-{case}-mus-equals-mu")
    none = load_scene(f"slider-bar-case-{case}-frictionless")
    guide = scene.guides["guide"]
    assert (guide.mu, guide.mus) == (0.03, 0.04)
    assert (one.guides["guide"].mu, one.guides["guide"].mus) == (0.03, 0.03)
    assert not none.frictional_guides
    assert vary(one, {"guide.mus": 0.04}).joints == scene.joints
    assert vary(none, {"guide.mu": 0.03, "guide.mus": 0.04}).joints == scene.joints
    for variant in (one, none):
        assert (variant.bodies, variant.drives, variant.forces) == (scene.bodies, scene.drives, scene.forces)


def test_cases_of_the_slider_bar_are_the_papers():
    expected = {1: (3, 2, np.pi / 4), 2: (5, 2, np.pi / 4), 3: (1, 4, np.pi)}
    for case, (force, length, speed) in expected.items():
        scene = load_scene(f"slider-bar-case-{case}")
        assert scene.forces["load"].law.amplitude == force
        assert scene.joints["pin"].points[0] == (-length / 2, 0)
        assert scene.bodies["bar"].inertia == 2 * length ** 2 / 12
        assert scene.drives["motor"].law.rate == speed


def test_coulomb_oscillator_has_the_scaling_of_den_hartog():
    scene = load_scene("coulomb-oscillator", {"b": 0.72})
    friction = scene.guides["guide"].mu * scene.bodies["slider"].mass * -scene.gravity[1]
    law = scene.forces["load"].law
    assert friction / law.amplitude == pytest.approx(0.72, rel=1e-15)
    assert law.frequency == 0.7 and law.amplitude == scene.springs["spring"].stiffness == 1
