"""The threshold of stick phases: attractors, return maps, settling, and rows without a number."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_runs import wrong_numbers

from stiction.comparisons.presentation.presentation import ANSWER_LENGTH
from stiction.comparisons.results import Results
from stiction.comparisons.studies.stick_threshold import (CHANGE, ERROR, FIRST_STEP, UNCERTAINTY, Search, around,
                                                          measure_series, measure_threshold, present)
from stiction.comparisons.truth import StickThreshold, stick_threshold
from stiction.comparisons.truth.reduced import steady_state as steady_states
from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.comparisons.truth.reduced.steady_state import NoSteadyState, steady_state
from stiction.comparisons.variants import Variant
from stiction.scenes import load_scene, vary

TWO_ATTRACTORS = {"L": 1.4690166001538274, "w0": 0.4919565038887755, "m1": 0.320486885826721,
                  "m2": 0.42174247201658416, "k": 0.45938292515284157, "Omega": 0.983913007777551,
                  "mu": 0.15979780148323217, "mus": 0.2810304430192479, "guide.length": 1.7453495966764414,
                  "guide.width": 0.061743221619308494}


# in every run: `test_near_its_end_a_steady_state_attracts_from_near_only`, of two that coexist
@pytest.mark.long
@pytest.mark.parametrize("xtol", [2e-3, 1e-11])
def test_of_two_attractors_that_of_the_start_counts(xtol):
    """From rest the slider stays at rest up to 1.9945997 N; a sliding motion goes on further down."""
    found = stick_threshold(vary(load_scene("slider-bar-case-1"), TWO_ATTRACTORS), xtol)
    assert abs(found.F0 - 1.9945997) < 1e-7 + found.uncertainty  # the digits given
    assert "coexist" in found.note and found.uncertainty < max(xtol, 1e-8)  # it is halved until 1e-9 of F0 at best


JUMPS = {"L": 1.2107657869453687, "w0": 1.3944665313870996, "m1": 2.0341567919297834, "m2": 1.8343378363765146,
         "k": 0.6170698448694683, "Omega": 0.6972332656935498, "mu": 0.02863651875660524, "mus": 0.02863651875660524,
         "guide.length": 1.467779153638543, "guide.width": 0.2684877064376431}
ENDS = {"L": 1.6431183669637377, "w0": 1.7264482736601212, "m1": 2.358155793168875, "m2": 1.6157125430783632,
        "k": 0.5854351471498169, "Omega": 0.8632241368300606, "mu": 0.04451367005503198, "mus": 0.04496911251750421,
        "guide.length": 1.6296838156309752, "guide.width": 0.3345233913882335}
"""The sliding steady state ends at 3.5759309 N, where the slider comes to rest within a slip phase."""


def reference_bracket(scene, near):
    found = measure_threshold(scene, "reference", {"rtol": 1e-9, "stabilization": "projection"},
                              Search(0.97 * near, 1.03 * near, 1e-6 * near, near))
    return found.with_stick, found.without_stick


@pytest.mark.parametrize("overrides, F0, note", [
    (JUMPS, 1.489268813, ""),
    pytest.param(ENDS, 3.57595145, "coexist", marks=pytest.mark.long)])
def test_thresholds_where_the_sliding_steady_state_ends(overrides, F0, note):
    """Held by bisection of long motions of the reference, which knows no return map; its own error is 1e-7 of F0."""
    scene = vary(load_scene("slider-bar-case-1"), overrides)
    found = stick_threshold(scene)
    assert abs(found.F0 - F0) < 1e-8 + found.uncertainty < 2e-6 * F0 and note in found.note
    low, high = reference_bracket(scene, found.F0)
    assert low - 1e-7 * F0 - found.uncertainty <= found.F0 <= high + 1e-7 * F0 + found.uncertainty


def test_near_its_end_a_steady_state_attracts_from_near_only():
    """3e-6 above its end the sliding one is stable; the start leads to one of two periods with a stick phase."""
    mechanism = replace(SliderBar.from_scene(vary(load_scene("slider-bar-case-1"), ENDS)), F0=3.57594)
    reached = steady_state(mechanism)
    assert reached.periods == 2 and reached.sticks and max(map(abs, reached.multipliers)) < 1


def test_a_steady_state_repeats_itself_and_attracts():
    mechanism = SliderBar.from_scene(load_scene("slider-bar-case-1"))
    steady = steady_state(replace(mechanism, F0=5.0))
    assert steady.periods == 1 and not steady.sticks and max(map(abs, steady.multipliers)) < 1
    end = np.concatenate(steady.motion.final_state())
    np.testing.assert_allclose(end, steady.state, atol=1e-11)
    other = steady_state(replace(mechanism, F0=5.0, x=steady.state[0] + 0.1, v=0.0))
    np.testing.assert_allclose(other.state, steady.state, atol=1e-9)


def test_none_found_is_a_typed_result(monkeypatch):
    monkeypatch.setattr(steady_states, "SETTLING", 1)
    scene = load_scene("slider-bar-case-1")
    with pytest.raises(NoSteadyState, match="within 1 periods"):
        steady_state(SliderBar.from_scene(scene))
    found = stick_threshold(scene)
    assert isinstance(found, StickThreshold) and found.F0 is None and "no steady state" in found.note


def test_a_measurement_that_does_not_settle_says_so(monkeypatch):
    monkeypatch.setattr("stiction.comparisons.studies.stick_threshold.settled", lambda *_: None)
    monkeypatch.setattr("stiction.comparisons.studies.stick_threshold.MOST_SETTLING", 30)
    found = measure_threshold(load_scene("slider-bar-case-1"), "reference", {"rtol": 1e-6}, Search(4.0, 4.5, 0.1))
    assert found.with_stick is None and "not settled after 30 periods" in found.remark


@pytest.mark.parametrize("step, change, words", [
    (2.5e-3, 0.01, "Clearly off: Exudyn with contact (-0.16 ± 0.02 N)."),
    (5e-3, 0.01, "No method is clearly off. Inconclusive at its finest step: Exudyn with contact (-0.16 ± 0.02 N)."),
    (2.5e-3, 0.0525, "No method is clearly off. Inconclusive at its finest step: Exudyn with contact (-0.16 ± 0.07 N)."),
    (2.5e-3, np.nan, "No method is clearly off. Inconclusive")])
def test_a_method_is_off_only_if_its_finest_step_is_that_of_all_and_hardly_moves_it(step, change, words):
    """An error of 0.16 N, at a step twice as long as others', or after a refinement that changed it by a third, may vanish."""
    rows = [("pymunk", 2.5e-3, -0.005, 0.0), ("Exudyn, contact", step, -0.16, change)]
    table = pd.DataFrame([{"variant": variant, "fidelity": "contact", "parameter": "dt", "step": dt, "status": "ok", "mus": 0.03,
                           "truth [N]": 4.2, "truth uncertainty [N]": 1e-9, ERROR: error, CHANGE: moved,
                           UNCERTAINTY: 0.01 + np.nan_to_num(moved)} for variant, dt, error, moved in rows])
    said = present(Results((), {}, {"threshold": table}))
    assert words in said.answer.text and len(said.answer.text) <= ANSWER_LENGTH and not wrong_numbers(said, Results((), {}, {"threshold": table}))


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
    assert around(lambda amplitude: True, near, 0.9, 2.1, step)[1] == 2.1
    assert around(lambda amplitude: False, near, 0.9, 2.1, step)[0] == 0.9


def test_a_search_from_near_finds_what_halving_the_range_does():
    found = [measure_threshold(load_scene("slider-bar-case-1"), "reference",
                               {"rtol": 1e-9, "stabilization": "projection"}, Search(3.6, 4.8, 1e-6, near))
             for near in (None, 4.2119563, 4.0)]
    for one in found:
        assert one.without_stick - one.with_stick <= 1e-6 and abs(one.with_stick - 4.2119563) < 1.5e-6
    assert found[1].runs < found[0].runs / 2


def test_a_finer_step_begins_at_the_bracket_of_the_coarser_one():
    """It ends with the bracket that a search from afar finds, in half as many runs: both halve the same range."""
    scene, search = vary(load_scene("slider-bar-case-1"), {"mus": "mu"}), Search(1.5, 6.0, 1e-2, 3.0, 0.06)
    moreau = Variant("Moreau", "moreau", "dt", (1e-2, 2.5e-3), "contact")
    coarse, fine = measure_series(scene, moreau, search)
    afar = measure_threshold(scene, "moreau", {"dt": 2.5e-3, "fidelity": "contact"}, search)
    assert (fine.with_stick, fine.without_stick) == pytest.approx((afar.with_stick, afar.without_stick), abs=1e-12)
    assert fine.runs <= afar.runs / 2 and fine.without_stick - coarse.with_stick < FIRST_STEP * search.width
