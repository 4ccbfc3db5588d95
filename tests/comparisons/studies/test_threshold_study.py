"""The threshold of stick phases: attractors, return maps, settling, and rows without a number."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_runs import wrongly_written

from stiction.comparisons.bench.presentation.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import Variant
from stiction.comparisons.measures.settling import NotSettled
from stiction.comparisons.studies.threshold import (
    AGAIN,
    CHANGE,
    ERROR,
    FIRST_STEP,
    SCAN_END,
    SCAN_STEP,
    SCAN_WIDTH,
    SCANNED,
    STUDY,
    UNCERTAINTY,
    Search,
    StickProbe,
    _ends,
    around,
    bands_above,
    measure_series,
    measure_threshold,
    present,
)
from stiction.reports.text import section_of
from stiction.scenes import load_scene, vary
from stiction.truths import StickThreshold, Tier, stick_threshold
from stiction.truths.reduced import steady_state as steady_states
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.steady_state import NoSteadyState, steady_state

TWO_ATTRACTORS = {
    "L": 1.4690166001538274,
    "w0": 0.4919565038887755,
    "m1": 0.320486885826721,
    "m2": 0.42174247201658416,
    "k": 0.45938292515284157,
    "Omega": 0.983913007777551,
    "mu": 0.15979780148323217,
    "mus": 0.2810304430192479,
    "guide.length": 1.7453495966764414,
    "guide.width": 0.061743221619308494,
}


# in every run: `test_near_its_end_a_steady_state_attracts_from_near_only`, of two that coexist
@pytest.mark.long
@pytest.mark.parametrize("xtol", [2e-3, 1e-11])
def test_of_two_attractors_that_of_the_start_counts(xtol):
    """From rest the slider stays at rest up to 1.9945997 N; a sliding motion goes on further down."""
    found = stick_threshold(vary(load_scene("slider-bar-case-1"), TWO_ATTRACTORS), xtol)
    assert abs(found.F0 - 1.9945997) < 1e-7 + found.uncertainty  # the digits given
    assert "coexist" in found.note and found.uncertainty < max(
        xtol, 1e-8
    )  # it is halved until 1e-9 of F0 at best


JUMPS = {
    "L": 1.2107657869453687,
    "w0": 1.3944665313870996,
    "m1": 2.0341567919297834,
    "m2": 1.8343378363765146,
    "k": 0.6170698448694683,
    "Omega": 0.6972332656935498,
    "mu": 0.02863651875660524,
    "mus": 0.02863651875660524,
    "guide.length": 1.467779153638543,
    "guide.width": 0.2684877064376431,
}
ENDS = {
    "L": 1.6431183669637377,
    "w0": 1.7264482736601212,
    "m1": 2.358155793168875,
    "m2": 1.6157125430783632,
    "k": 0.5854351471498169,
    "Omega": 0.8632241368300606,
    "mu": 0.04451367005503198,
    "mus": 0.04496911251750421,
    "guide.length": 1.6296838156309752,
    "guide.width": 0.3345233913882335,
}
"""The sliding steady state ends at 3.5759309 N, where the slider comes to rest within a slip phase."""


def reference_bracket(scene, near):
    found = measure_threshold(
        scene,
        "reference",
        {"rtol": 1e-9, "stabilization": "projection"},
        Search(0.97 * near, 1.03 * near, 1e-6 * near, near),
    )
    return found.with_stick, found.without_stick


@pytest.mark.parametrize(
    "overrides, F0, note",
    [(JUMPS, 1.489268813, ""), pytest.param(ENDS, 3.57595145, "coexist", marks=pytest.mark.long)],
)
def test_thresholds_where_the_sliding_steady_state_ends(overrides, F0, note):
    """Held by bisection of long motions of the reference, which knows no return map; its own error is 1e-7 of F0."""
    scene = vary(load_scene("slider-bar-case-1"), overrides)
    found = stick_threshold(scene)
    assert abs(found.F0 - F0) < 1e-8 + found.uncertainty < 2e-6 * F0 and note in found.note
    low, high = reference_bracket(scene, found.F0)
    assert low - 1e-7 * F0 - found.uncertainty <= found.F0 <= high + 1e-7 * F0 + found.uncertainty


def test_near_its_end_a_steady_state_attracts_from_near_only():
    """3e-6 above its end the sliding one is stable; the start leads to one of two periods with a stick phase."""
    mechanism = replace(
        SliderBar.from_scene(vary(load_scene("slider-bar-case-1"), ENDS)), F0=3.57594
    )
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
    assert (
        isinstance(found, StickThreshold) and found.F0 is None and "no steady state" in found.note
    )


def test_a_measurement_that_does_not_settle_says_so(monkeypatch):
    monkeypatch.setattr("stiction.comparisons.studies.threshold.settled", lambda *_: None)
    monkeypatch.setattr("stiction.comparisons.studies.threshold.MOST_SETTLING", 30)
    found = measure_threshold(
        load_scene("slider-bar-case-1"), "reference", {"rtol": 1e-6}, Search(4.0, 4.5, 0.1)
    )
    assert found.with_stick is None and "not settled after 30 periods" in found.remark


@pytest.mark.parametrize(
    "step, change, is_off, words",
    [
        (2.5e-3, 0.01, True, "Exudyn, contact (-0.16 ± 0.02 N)"),
        (5e-3, 0.01, False, "Exudyn, contact (-0.16 ± 0.02 N)"),
        (2.5e-3, 0.0525, False, "Exudyn, contact (-0.16 ± 0.07 N)"),
        (2.5e-3, np.nan, False, "Exudyn, contact"),
    ],
)
def test_a_method_is_off_only_if_its_finest_step_is_that_of_all_and_hardly_moves_it(
    step, change, is_off, words
):
    """An error of 0.16 N, at a step twice as long as others', or after a refinement that changed it by a third, may vanish."""
    rows = [("pymunk", 2.5e-3, -0.005, 0.0), ("Exudyn, contact", step, -0.16, change)]
    table = pd.DataFrame(
        [
            {
                "variant": variant,
                "fidelity": "contact",
                "parameter": "dt",
                "step": dt,
                "status": "ok",
                "mus": 0.03,
                "true_threshold": 4.2,
                "true_threshold_uncertainty": 1e-9,
                ERROR: error,
                CHANGE: moved,
                UNCERTAINTY: 0.01 + np.nan_to_num(moved),
            }
            for variant, dt, error, moved in rows
        ]
    )
    results = Results((), {}, {"threshold": table})
    section, shown = section_of(STUDY, results), present(results).rows
    off, inconclusive = ([one["variant"] for one in shown[of]] for of in ("off", "inconclusive"))
    assert (off, inconclusive) == (["Exudyn, contact"], [])[:: 1 if is_off else -1]
    [one] = shown["off"] + shown["inconclusive"]
    assert float(one["error"]) == -0.16
    assert words in section.answer and len(section.answer) <= ANSWER_LENGTH
    assert ("No method deviates clearly" in section.answer) != is_off
    assert not wrongly_written(section, results)
    assert all(each.caption for each in (*section.tables, *section.figures))
    [headline] = section.headlines
    assert list(headline.cells) == ["pymunk", "Exudyn, contact"]
    assert headline.cells["Exudyn, contact"] in section.answer


def test_many_methods_that_are_off_are_counted_in_the_answer():
    """The line of the answer has the largest error by its size; the table names the methods."""
    table = pd.DataFrame(
        [
            {
                "variant": f"engine {number}, contact",
                "fidelity": "contact",
                "parameter": "dt",
                "step": 2.5e-3,
                "status": "ok",
                "mus": 0.03,
                "true_threshold": 4.2,
                "true_threshold_uncertainty": 1e-9,
                ERROR: error,
                CHANGE: 1e-3,
                UNCERTAINTY: 0.01,
            }
            for number, error in enumerate((0.1, -0.3, 0.2))
        ]
    )
    results = Results((), {}, {"threshold": table})
    section, shown = section_of(STUDY, results), present(results).rows
    assert [float(one["error"]) for one in shown["off"]] == [0.1, 0.2, -0.3]
    assert "3 methods" in section.answer and "by up to 0.30 ± 0.01 N" in section.answer
    assert len(section.answer) <= ANSWER_LENGTH and not wrongly_written(section, results)


def test_a_proven_threshold_is_enclosed_and_methods_without_one_are_named():
    """Bounds of a theorem are decimals: they are written as they were proven, rounded outwards where they are longer."""
    about = {"fidelity": "joint", "parameter": "dt", "step": 1e-3, "status": "ok"}
    true = {"true_threshold": 4.21195626635, "true_threshold_uncertainty": 5e-11}
    measured = {ERROR: 0.0, CHANGE: np.nan, UNCERTAINTY: 0.01}
    rows = [
        {"variant": "a", **about, "mus": 0.04, **true, "truth_tier": Tier.PROVEN, **measured},
        {"variant": "b", **about, "mus": 0.03, **true, "truth_tier": Tier.HIGH_PRECISION},
        {"variant": "c", **about, "status": "missing", "mus": 0.04, "truth_tier": Tier.PROVEN},
    ]
    results = Results((), {}, {"threshold": pd.DataFrame(rows)})
    section, shown = section_of(STUDY, results), present(results).rows
    assert shown["without"] == ["b"] and not shown["off"] and not shown["inconclusive"]
    [proven] = shown["proven"]
    assert float(proven["mus"]) == 0.04 and float(proven["true_threshold"]) == 4.21195626635
    [text] = [finding for finding in section.findings if "proven" in finding]
    assert "4.2119562663 N and 4.2119562664 N" in text
    assert not wrongly_written(section, results)


def sticks_by_the_truth(scene, F0):
    mechanism = replace(SliderBar.from_scene(scene), F0=F0)
    return steady_states.margin(mechanism, steady_state(mechanism)) < 0


@pytest.mark.parametrize(
    ("mu", "threshold", "band"), [(0.015, 3.2371867, (3.77, 4.55)), (0.01, 2.299, (4.33, 4.71))]
)
def test_the_slider_sticks_again_above_its_threshold(mu, threshold, band):
    """A second band of F0, whose ends the return map of the reduced solution confirms: inside it sticks, outside not.

    Next to the lower end of the band of mu = 0.01, at 4.3 N, there is no steady state of up to 8 periods.
    """
    scene = vary(load_scene("slider-bar-case-1"), {"mu": mu, "mus": 0.04})
    found = bands_above(scene, threshold)
    [(low, high)] = found.bands
    width = SCAN_WIDTH * threshold
    assert (low, high) == pytest.approx(band, abs=2 * width)
    assert found.end == pytest.approx(SCAN_END * threshold, abs=found.step)
    inside = (low + width, 0.5 * (low + high), high)
    outside = (
        0.98 * threshold + 0.1,
        0.5 * (threshold + low) if mu > 0.01 else 1.1 * threshold,
        high + 1.1 * width,
        found.end,
    )
    assert all(sticks_by_the_truth(scene, F0) for F0 in inside)
    assert not any(sticks_by_the_truth(scene, F0) for F0 in outside)


@pytest.mark.parametrize(
    ("name", "threshold"),
    [
        ("slider-bar-case-1", 4.2119563),
        ("slider-bar-case-2", 4.2119563),
        ("slider-bar-case-3", None),
        ("slider-bar-case-1-mus-equals-mu", 3.8942035),
    ],
)
def test_the_paper_s_cases_have_no_other_band(name, threshold):
    """In what is scanned: above the threshold, or of case 3, which has none, from its own F0 on."""
    scene = load_scene(name)
    found = bands_above(scene, threshold or scene.parameters["F0"])
    assert found.bands == () and found.unknown == ()


@given(
    st.lists(st.tuples(st.floats(1.0, 2.6), st.floats(0.0, 0.5)), max_size=3),
    st.lists(st.floats(1.0, 2.6), max_size=4),
)
def test_the_scan_finds_every_band_that_is_wider_than_its_step(bands, gaps):
    """And only those; next to an amplitude without a steady state a band ends."""
    bands = [(low, low + width) for low, width in bands]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(StickProbe, "__post_init__", lambda self: None)

        def sticks(self, F0):
            if any(abs(F0 - gap) < 1e-3 for gap in gaps):
                raise NotSettled("here")
            return any(low <= F0 <= high for low, high in bands)

        patch.setattr(StickProbe, "sticks", sticks)
        found = bands_above(None, 1.0)
    assert all(any(low <= end <= high for low, high in bands) for one in found.bands for end in one)
    for low, high in bands:
        seen = np.arange(1.0 + SCAN_STEP, found.end, SCAN_STEP)
        inside = [
            F0 for F0 in seen if low <= F0 <= high and not any(abs(F0 - gap) < 1e-3 for gap in gaps)
        ]
        assert all(
            any(one[0] - 1e-9 <= F0 <= one[1] + 1e-9 for one in found.bands) for F0 in inside
        )


@pytest.mark.parametrize(
    ("own", "expected"),
    [
        (3.0, (2.0, 3.0)),
        (2.0, (2.0, 3.0)),
        (4.0, (2.0, 3.0)),
        (6.0, (7.0, 8.0)),
        (8.0, (7.0, 8.0)),
        (None, (7.0, 8.0)),
    ],
)
def test_the_band_next_to_the_own_amplitude_is_searched(own, expected):
    """Sticking in 1..2.5 and 5.5..7.5 of 0..8: that of the amplitude itself, else the next one below."""
    low, high = _ends(
        lambda F0: 1 <= F0 <= 2.5 or 5.5 <= F0 <= 7.5, Search(0.0, 8.0, 0.1, probes=9, own=own)
    )
    assert (low, high) == expected


def test_a_band_above_is_taken_where_there_is_none_below():
    assert _ends(lambda F0: 5.5 <= F0 <= 7.5, Search(0.0, 8.0, 0.1, probes=9, own=3.0)) == (
        7.0,
        8.0,
    )
    assert _ends(lambda F0: False, Search(0.0, 8.0, 0.1, probes=9, own=3.0)) == (0.0, 1.0)


def test_the_table_and_the_answer_say_where_it_sticks_again():
    rows = [
        {
            "variant": "pymunk",
            "fidelity": "joint",
            "parameter": "dt",
            "step": 1e-2,
            "status": "ok",
            "mus": 0.04,
            "true_threshold": 3.2,
            "true_threshold_uncertainty": 1e-9,
            ERROR: 0.05,
            CHANGE: np.nan,
            UNCERTAINTY: 0.01,
            AGAIN: again,
            SCANNED: 8.0,
        }
        for again in ("[[3.7712, 4.5481], [5.0, 5.0]]", "")
    ]
    for row, words in zip(
        rows,
        (
            "sticks again at about 3.77 to 4.55 N and 5 N.",
            "up to 8 N",
        ),
    ):
        results = Results((), {}, {"threshold": pd.DataFrame([row])})
        section, shown = section_of(STUDY, results), present(results).rows
        assert [one[AGAIN] for one in shown["again"]] == ([row[AGAIN]] if row[AGAIN] else [])
        assert float(shown["scanned_to"]) == 8.0
        assert [words in finding for finding in section.findings] == [True]
        assert not wrongly_written(section, results)
        assert "sticks_again" in [column.name for column in section.tables[0].columns]


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
    found = [
        measure_threshold(
            load_scene("slider-bar-case-1"),
            "reference",
            {"rtol": 1e-9, "stabilization": "projection"},
            Search(3.6, 4.8, 1e-6, near),
        )
        for near in (None, 4.2119563, 4.0)
    ]
    for one in found:
        assert (
            one.without_stick - one.with_stick <= 1e-6 and abs(one.with_stick - 4.2119563) < 1.5e-6
        )
    assert found[1].runs < found[0].runs / 2


def test_a_finer_step_begins_at_the_bracket_of_the_coarser_one():
    """It ends with the bracket that a search from afar finds, in half as many runs: both halve the same range."""
    scene, search = (
        vary(load_scene("slider-bar-case-1"), {"mus": "mu"}),
        Search(1.5, 6.0, 1e-2, 3.0, 0.06),
    )
    moreau = Variant("Moreau", "moreau", "dt", (1e-2, 2.5e-3), "contact")
    coarse, fine = measure_series(scene, moreau, search)
    afar = measure_threshold(scene, "moreau", {"dt": 2.5e-3, "fidelity": "contact"}, search)
    assert (fine.with_stick, fine.without_stick) == pytest.approx(
        (afar.with_stick, afar.without_stick), abs=1e-12
    )
    assert (
        fine.runs <= afar.runs / 2
        and fine.without_stick - coarse.with_stick < FIRST_STEP * search.width
    )
