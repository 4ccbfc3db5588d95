"""Masses that are unlike by many powers of ten."""

import numpy as np
import pytest
from fuzz.slider_bars import difference
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mechanism_families import barred_chain, closed_loop
from random_mechanisms import SeededDice, moderate_scene
from reference_checks import simulate

from stiction.engines import load_engine
from stiction.reference_impl.friction.frozen_mode import solve_mode
from stiction.reference_impl.friction.unlike_masses import solve_with_motion
from stiction.reference_impl.multibody.dynamics import acceleration, row_form
from stiction.reference_impl.multibody.mechanism import UNLIKE, Mechanism, workspace
from stiction.scenes import load_scene, scene_from_dict, vary
from stiction.truths import slider_bar_truth

T_END = 8.0


@pytest.mark.parametrize("light", [1e-9, 1e-8, 1e-7, 1e-6, 1e-4])
@pytest.mark.parametrize("which", ["m1", "m2"])
def test_a_light_body_costs_no_digits(which, light):
    """The reduced equation of the slider-bar has the sum of the masses in it, so that its truth does not notice.

    1e-10 is what rtol 1e-12 leaves of 8 s with masses that are alike, times ten; a ratio below `UNLIKE`, which is not looked at, leaves 1e-9.
    """
    scene = vary(
        load_scene("slider-bar-case-1"), {"m1": 3.0 - light, "m2": 3.0 - light} | {which: light}
    )
    error, where = difference(
        simulate(scene, t_end=T_END, rtol=1e-12, stabilization="projection"),
        slider_bar_truth(scene, T_END),
    )
    assert error < (1e-10 if light * UNLIKE < 1 else 1e-9), where


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_with_masses_that_are_alike_both_ways_agree(seed):
    """Forces and accelerations of drawn mechanisms, states and contact modes; 1e-9 is rounding times a condition of G of some 1e5."""
    scene, random = scene_from_dict(moderate_scene(SeededDice(seed))), np.random.default_rng(seed)
    mechanism = Mechanism(scene)
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    q, v = (x + 0.01 * random.normal(size=len(x)) for x in mechanism.initial_state())
    slip, corner = (
        random.integers(-1, 2, size=len(m.friction)),
        random.choice([-1, 1], size=(len(m.friction), 4)),
    )
    row_form(m, w, 0.3, q, v)
    assume(solve_mode(m, w, slip, corner))
    expected, found, force = np.zeros(len(q)), np.zeros(len(q)), w.force.copy()
    acceleration(m, w, w.force, expected)
    assert solve_with_motion(m, w, slip, corner, found)
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-9 * max(1.0, np.max(np.abs(expected)))
    )
    np.testing.assert_allclose(w.force, force, rtol=0, atol=1e-9 * max(1.0, np.max(np.abs(force))))


@pytest.mark.parametrize("masses", [{}, {"m1": 1e-6}])
def test_where_a_mechanism_stands_makes_nothing_unlike(masses):
    """The slow way is for masses: not for a scene a kilometre from the origin, nor for a chain that is long."""
    scene = vary(load_scene("slider-bar-case-1"), masses)
    unlike = Mechanism(scene).arrays.unlike
    assert unlike == bool(masses)
    raw = dict(scene._raw) | {
        "bodies": {
            name: body
            | {
                "position": [
                    f"{x} + 1000" if isinstance(x, str) else x + 1000.0
                    for x in body.get("position", [0, 0])
                ]
            }
            for name, body in scene._raw["bodies"].items()
        }
    }
    assert Mechanism(scene_from_dict(raw)).arrays.unlike == unlike


@pytest.mark.parametrize("family", [barred_chain, closed_loop])
def test_a_long_chain_has_masses_that_are_alike(family):
    assert not Mechanism(family(120)).arrays.unlike


@pytest.mark.parametrize("light", [1e-2, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
def test_sliders_that_a_light_link_joins_move_as_one_or_the_run_says_why_not(light):
    """Two sliders on one line hold one motion: how they share it is open, and rounding beside the light link must not take one of them for slipping while it is at rest.

    Pushed by 8 N sin 3t they move as one block of their mass, with the means of their coefficients.
    """
    push = {
        "type": "force",
        "direction": [1, 0],
        "law": {"type": "sine", "amplitude": 8, "frequency": 3},
    }
    guide, slider = {"type": "translational", "length": 0.2, "width": 0.1}, {"inertia": 0.02}
    linked = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "forces": {"push": {**push, "body": "b"}},
            "bodies": {
                "b": {**slider, "mass": 1},
                "b2": {**slider, "mass": 1, "position": [0.5, 0]},
                "link": {"mass": light, "inertia": light / 48, "position": [0.25, 0]},
            },
            "joints": {
                "g": {**guide, "slider": "b", "mu": 0.1, "mus": 0.15},
                "g2": {**guide, "slider": "b2", "mu": 0.3, "mus": 0.35},
                "p": {"type": "revolute", "bodies": ["link", "b"], "points": [[-0.25, 0], [0, 0]]},
                "p2": {"type": "revolute", "bodies": ["link", "b2"], "points": [[0.25, 0], [0, 0]]},
            },
        }
    )
    block = scene_from_dict(
        {
            "gravity": [0, -9.81],
            "forces": {"push": {**push, "body": "b"}},
            "bodies": {"b": {**slider, "mass": 2 + light}},
            "joints": {"g": {**guide, "slider": "b", "mu": 0.2, "mus": 0.25}},
        }
    )
    found, expected = (
        load_engine("reference").simulate(scene, t_end=2.0) for scene in (linked, block)
    )
    assert found.termination == "end" or light < 1 / UNLIKE
    assert np.abs(found["b.x"] - expected["b.x"][: len(found.t)]).max() < 1e-7
