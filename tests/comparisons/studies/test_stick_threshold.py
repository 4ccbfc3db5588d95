"""The threshold of stick phases: attractors, return maps, settling, and rows without a number."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction.comparisons.studies.stick_threshold import around, measure_threshold, settled
from stiction.comparisons.truth import StickThreshold, stick_threshold
from stiction.comparisons.truth.reduced import steady_state as steady_states
from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.comparisons.truth.reduced.steady_state import NoSteadyState, steady_state
from stiction.scenes import load_scene, vary

TWO_ATTRACTORS = {"L": 1.4690166001538274, "w0": 0.4919565038887755, "m1": 0.320486885826721, "m2": 0.42174247201658416,
                  "k": 0.45938292515284157, "Omega": 0.983913007777551, "mu": 0.15979780148323217, "mus": 0.2810304430192479,
                  "guide.length": 1.7453495966764414, "guide.width": 0.061743221619308494}


@pytest.mark.parametrize("xtol", [2e-3, pytest.param(1e-11, marks=pytest.mark.long)])
def test_of_two_attractors_that_of_the_start_counts(xtol):
    """From rest the slider stays at rest up to 1.9945997 N; a sliding motion goes on further down."""
    found = stick_threshold(vary(load_scene("slider-bar-case-1"), TWO_ATTRACTORS), xtol)
    assert abs(found.F0 - 1.9945997) < 1e-7 + found.uncertainty  # the digits given
    assert "coexist" in found.note and found.uncertainty < max(xtol, 1e-8)  # it is halved until 1e-9 of F0 at best


def test_a_steady_state_repeats_itself_and_attracts():
    mechanism = SliderBar.from_scene(load_scene("slider-bar-case-1"))
    steady = steady_state(replace(mechanism, F0=5.0))
    assert steady.periods == 1 and not steady.sticks and max(map(abs, steady.multipliers)) < 1
    end = np.concatenate(steady.motion.final_state())
    np.testing.assert_allclose(end, steady.state, atol=1e-11)
    other = steady_state(replace(mechanism, F0=5.0), (steady.state[0] + 0.1, 0.0))
    np.testing.assert_allclose(other.state, steady.state, atol=1e-9)


def test_none_found_is_a_typed_result(monkeypatch):
    monkeypatch.setattr(steady_states, "SETTLING", 1)
    scene = load_scene("slider-bar-case-1")
    with pytest.raises(NoSteadyState, match="within 1 periods"):
        steady_state(SliderBar.from_scene(scene))
    found = stick_threshold(scene)
    assert isinstance(found, StickThreshold) and found.F0 is None and "no steady state" in found.note


@pytest.mark.parametrize("order, ratio", [(1, 0.5), (1, -0.7), (2, 0.6), (8, 0.3), (1, 0.95)])
def test_settled_bounds_the_rest_of_a_transient(order, ratio):
    k = np.arange(401)
    cycle = np.sin(1.0 + 2 * np.pi * (k % order) / order)
    x = cycle + 0.3 * np.sign(ratio) ** k * abs(ratio) ** (k / order)
    found = settled(x)
    assert found.order == order
    assert abs(x[-1] - cycle[-1]) <= found.distance * np.ptp(x) * (1 + 1e-6) + 1e-15


def test_slow_or_wandering_motions_are_not_settled():
    k = np.arange(401)
    assert settled(1 + 0.3 * 0.999 ** k) is None  # 0.2 away from its limit
    assert settled(np.sin(k * np.sqrt(2))) is None
    logistic = [0.3]
    for _ in range(400):
        logistic.append(4 * logistic[-1] * (1 - logistic[-1]))
    assert settled(np.array(logistic)) is None


def test_a_measurement_that_does_not_settle_says_so(monkeypatch):
    monkeypatch.setattr("stiction.comparisons.studies.stick_threshold.settled", lambda *_: None)
    monkeypatch.setattr("stiction.comparisons.studies.stick_threshold.MOST_SETTLING", 30)
    found = measure_threshold(load_scene("slider-bar-case-1"), "reference", {"rtol": 1e-6}, 0.0, 4.0, 4.5, 0.1)
    assert found.with_stick is None and "not settled after 30 periods" in found.remark


@given(st.floats(1.0, 2.0), st.floats(1.0, 2.0), st.floats(1e-4, 0.2))
def test_steps_that_double_enclose_a_threshold(threshold, near, step):
    asked = []

    def stuck(amplitude):
        asked.append(amplitude)
        return amplitude <= threshold

    low, high = around(stuck, near, 0.9, 2.1, step)
    assert 0.9 <= low <= threshold <= high <= 2.1
    off = abs(threshold - near)
    assert len(asked) <= 3 + np.log2(1 + off / step) and high - low <= (2 * off + step) * (1 + 1e-9)


def test_what_no_step_encloses_ends_at_the_limits():
    assert around(lambda amplitude: True, 1.5, 0.9, 2.1, 0.1)[1] == 2.1
    assert around(lambda amplitude: False, 1.5, 0.9, 2.1, 0.1)[0] == 0.9


def test_a_search_from_near_finds_what_halving_the_range_does():
    scene, found = load_scene("slider-bar-case-1"), []
    for near in (None, 4.2119563, 4.0):
        found.append(measure_threshold(scene, "reference", {"rtol": 1e-9, "stabilization": "projection"}, 0.0, 3.6, 4.8, 1e-6, near))
    for one in found:
        assert one.without_stick - one.with_stick <= 1e-6 and abs(one.with_stick - 4.2119563) < 1.5e-6
    assert found[1].runs < found[0].runs / 2
