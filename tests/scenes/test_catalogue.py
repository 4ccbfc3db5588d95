"""Every scene of the catalogue loads, starts on its constraints and is what its name says."""

import tomllib

import numpy as np
import pytest

from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.scenes import catalogue, load_scene, scene_from_dict, vary

NAMES = {
    "painleve-rod",
    "uniqueness-lost",
    "vertical-slider",
    "winch",
    "ball-on-stop",
    "existence-lost",
    "slider-bar-case-1",
    "slider-bar-case-2",
    "slider-bar-case-3",
    *(
        f"slider-bar-case-{n}-{kind}"
        for n in (1, 2, 3)
        for kind in ("mus-equals-mu", "frictionless")
    ),
    "coulomb-oscillator",
    "block-on-incline",
    "mass-on-belt",
    "mass-stribeck",
    "four-bar",
    "pendulum",
    "pendulum-dry-pin",
    "slider-crank",
    "slider-crank-dry-pins",
    "slider-crank-clearance",
    "elliptic-trammel",
    "toggle-pins-under-load",
    "slider-on-moving-guide",
    "block-pulled-by-strut",
    *(f"hold-{name}" for name in ("level", "incline", "bar", "moment", "turning-bar", "vibration")),
    *(f"held-{name}" for name in ("arm", "weight", "pendulum", "arm-drops")),
}


def test_the_names_are_those_that_are_promised():
    assert set(catalogue()) == NAMES


@pytest.mark.parametrize("name", catalogue())
def test_starts_on_its_constraints(name):
    equations = EquationsOfMotion(load_scene(name))
    terms = equations.at(0.0, *equations.start())
    # rounding of numbers of order 10
    assert (
        max(np.max(np.abs(residual), initial=0.0) for residual in (terms.phi, terms.phi_dot))
        < 1e-14
    )


@pytest.mark.parametrize("name", catalogue())
def test_survives_writing_and_reading(name):
    scene = load_scene(name)
    again = scene_from_dict(tomllib.loads(scene.to_toml()))
    assert again == scene
    assert again.to_toml() == scene.to_toml()


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
        assert (variant.bodies, variant.drives, variant.forces) == (
            scene.bodies,
            scene.drives,
            scene.forces,
        )


def test_cases_of_the_slider_bar_are_the_papers():
    expected = {1: (3, 2, np.pi / 4), 2: (5, 2, np.pi / 4), 3: (1, 4, np.pi)}
    for case, (force, length, speed) in expected.items():
        scene = load_scene(f"slider-bar-case-{case}")
        assert scene.forces["load"].law.amplitude == force
        assert scene.joints["pin"].points[0] == (-length / 2, 0)
        assert scene.bodies["bar"].inertia == 2 * length**2 / 12
        assert scene.drives["motor"].law.rate == speed


def test_coulomb_oscillator_has_the_scaling_of_den_hartog():
    scene = load_scene("coulomb-oscillator", {"b": 0.72})
    friction = scene.guides["guide"].mu * scene.bodies["slider"].mass * -scene.gravity[1]
    law = scene.forces["load"].law
    assert friction / law.amplitude == pytest.approx(0.72, rel=1e-15)
    assert law.frequency == 0.7 and law.amplitude == scene.springs["spring"].stiffness == 1
