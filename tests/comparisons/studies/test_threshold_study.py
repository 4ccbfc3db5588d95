"""The threshold of stick phases: attractors, return maps, settling, and rows without a number."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import called_here
from hypothesis import given
from hypothesis import strategies as st
from made_up_runs import wrongly_written

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.presentation.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Scope, planned
from stiction.comparisons.bench.variants import Variant
from stiction.comparisons.measures.engine_bands import (
    EngineBands,
    Verdict,
    main_search,
    other_ends,
    scanned_values,
)
from stiction.comparisons.measures.engine_threshold import (
    FIRST_STEP,
    Search,
    StickProbe,
    Threshold,
    around,
    measure_series,
    measure_threshold,
)
from stiction.comparisons.measures.reference_bands import Variation
from stiction.comparisons.measures.settling import NotSettled, common_period
from stiction.comparisons.measures.true_bands import TrueBands
from stiction.comparisons.studies.threshold import (
    STUDY,
    reason_against,
    true_thresholds,
    variation_in,
)
from stiction.comparisons.studies.threshold_presentation import ThresholdVerdict, present
from stiction.comparisons.studies.threshold_tables import (
    AGAIN,
    CHANGE,
    ERROR,
    SCANNED,
    UNCERTAINTY,
    band_table,
    threshold_table,
)
from stiction.engines.isolation import Outcome
from stiction.engines.registry import load_engine
from stiction.engines.status import Status
from stiction.reference_impl.multibody.initial_state import with_consistent_start
from stiction.reports.markdown.failures import failed_runs
from stiction.reports.text import section_of
from stiction.scenes import InputError, SceneError, load_scene, scene_from_dict, vary
from stiction.truths import StickThreshold, Tier, stick_threshold
from stiction.truths.bands import Band, BandKind, Range
from stiction.truths.physics import physics_over_values
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
    monkeypatch.setattr(
        "stiction.comparisons.measures.engine_threshold.settled", lambda *_, **__: None
    )
    monkeypatch.setattr("stiction.comparisons.measures.engine_threshold.MOST_SETTLING", 30)
    found = measure_threshold(
        load_scene("slider-bar-case-1"), "reference", {"rtol": 1e-6}, Search(4.0, 4.5, 0.1)
    )
    assert found.with_stick is None and "not settled after 30 periods" in found.remark


def swinging(P):
    """A block that rests on a floor, coupled by a spring to a lightly damped body that a load excites in resonance.

    The body swings up within some 100 s, 40 periods, to P/(c w). Its spring then pulls the block loose, which has been
    at rest until then.
    """
    own, between, damping = 4.0, 2.0, 0.02
    translational = {"type": "translational", "direction": [1, 0]}
    linear = {"type": "linear", "axis": [1, 0]}
    return scene_from_dict(
        {
            "t_end": 20.0,
            "gravity": [0, -9.81],
            "parameters": {"P": P},
            "bodies": {
                "block": {"mass": 1.0, "inertia": 1.0},
                "swing": {"mass": 1.0, "inertia": 1.0, "position": [0, 1.0]},
            },
            "joints": {
                "floor": {**translational, "slider": "block", "mu": 0.01, "mus": 0.5},
                "rail": {**translational, "slider": "swing", "point": [0, 1.0]},
            },
            "springs": {
                "own": {
                    **linear,
                    "bodies": ["swing", "ground"],
                    "points": [[0, 0], [0, 1.0]],
                    "stiffness": own,
                    "damping": damping,
                },
                "between": {**linear, "bodies": ["swing", "block"], "stiffness": between},
            },
            "forces": {
                "load": {
                    "type": "force",
                    "body": "swing",
                    "direction": [1, 0],
                    "law": {
                        "type": "sine",
                        "amplitude": "P",
                        "frequency": float(np.sqrt(own + between)),
                    },
                }
            },
        },
        "swinging",
    )


def test_a_slider_that_rests_at_first_has_not_settled_while_another_body_has_not():
    """It breaks away after 63 periods: the 30 periods of rest before, by its place alone, are no steady state."""
    scene = swinging(0.15)
    period = common_period(scene)
    run = load_engine("reference").simulate(scene, t_end=80 * period, rtol=1e-9, output_step=period)
    assert np.ptp(run["floor.displacement"][:60]) < 1e-12 < 0.1 < abs(run["floor.displacement"][-1])
    probe = StickProbe(scene, "reference", {"rtol": 1e-9}, "P", "floor")
    with pytest.raises(NotSettled, match="not settled after 960 periods"):
        probe.sticks(0.15)
    # Below the break-away load the block rests for ever, and that is known.
    assert probe.sticks(0.05) and probe.settle_periods > 63


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
    assert ("Clear deviations" in section.answer) == is_off
    assert ("Different at the" in section.answer) != is_off
    # The table says the same; a run with one step has no change from a coarser one.
    finest = next(table for table in section.tables if table.name == "threshold").frame
    verdict = finest.set_index("variant").loc["Exudyn, contact", "verdict"]
    if is_off:
        expected = ThresholdVerdict.DEVIATES
    elif np.isnan(change):
        expected = ThresholdVerdict.ONE_STEP
    elif step > 0.0025:
        expected = ThresholdVerdict.COARSER
    else:
        expected = ThresholdVerdict.NOT_CONVERGED
    assert verdict == expected
    is_explained = any("with a single step" in finding for finding in section.findings)
    assert is_explained == (expected == ThresholdVerdict.ONE_STEP)
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


MU_0015 = (
    Band(0.0, 0.8106, BandKind.REST, 0.0, 1e-6),
    Band(0.8106, 3.2372, BandKind.STICK, 1e-6, 1e-9),
    Band(3.2372, 3.7688, BandKind.SLIP, 1e-9, 1e-9),
    Band(3.7688, 4.5484, BandKind.STICK, 1e-9, 1e-9),
    Band(4.5484, 12.0, BandKind.SLIP, 1e-9, 0.0),
)
"""Of case 1 with mu = 0.015."""
VARIATION = Variation("F0", "guide", Range(0.0, 12.0, 0.1), 3.0)


def test_engines_search_for_every_end_within_its_own_bands():
    main = main_search(MU_0015, VARIATION, 3.2372, 0.01)
    assert (main.low, main.near) == (1.5, 3.0) and 3.2372 < main.high < 3.7688
    lower, upper = other_ends(MU_0015, 3.2372, 0.01)
    assert lower.value == 3.7688 and lower.search.is_lower_end
    assert upper.value == 4.5484 and not upper.search.is_lower_end
    for end in (lower, upper):
        assert end.search.low < end.value < end.search.high
    scanned = scanned_values(MU_0015, VARIATION, 0)
    for low, high in ((0.0, 3.2372), (3.2372, 3.7688), (3.7688, 4.5484), (4.5484, 12.0)):
        assert any(low < value < high for value in scanned)


@pytest.mark.parametrize(
    ("sticks", "ends", "verdicts"),
    [
        (lambda F0: F0 < 3.2372 or 3.7688 < F0 < 4.5484, (3.2372, 3.7688, 4.5484), ["found"] * 2),
        (lambda F0: F0 < 3.2, (3.2, None, None), ["shifted", "missed"]),
        (lambda F0: F0 < 3.2372 or 3.6 < F0 < 4.5484, (3.2372, 3.6, 4.5484), ["found", "shifted"]),
        (lambda F0: F0 < 4.5484, (None, None, 4.5484), ["missed", "missed", "invented"]),
        (
            lambda F0: F0 < 3.2372 or 3.7688 < F0 < 4.5484 or F0 > 10,
            (3.2372, 3.7688, 4.5484),
            ["found", "found", "invented"],
        ),
    ],
)
def test_bands_are_found_shifted_missed_or_invented(sticks, ends, verdicts):
    """By an engine that sticks as it is given, and brackets the ends to 1e-3 N."""

    def bracket(end, is_lower):
        if end is None:
            return Threshold(None, None, 1, "none")
        sides = (end + 5e-4, end - 5e-4) if is_lower else (end - 5e-4, end + 5e-4)
        return Threshold(*sides, 1)

    values = scanned_values(MU_0015, VARIATION, 8)
    engine = EngineBands(
        (bracket(ends[0], False),),
        tuple((value, sticks(value)) for value in values),
        ((3.7688, bracket(ends[1], True)), (4.5484, bracket(ends[2], False))),
    )
    threshold = StickThreshold(3.2372, 1e-9, (3.2, 3.3))
    true = {True: TrueBands(threshold, MU_0015, Tier.HIGH_PRECISION)}
    variant = Variant("one", "reference", "rtol", (1e-9,))
    table = band_table(
        load_scene("slider-bar-case-1"),
        VARIATION,
        [variant],
        [Outcome("one", Status.OK, engine)],
        true,
    )
    rows = table[table["variant"] == "one"]
    seen = list(rows["verdict"])
    assert seen[:2] == [Verdict(verdict) for verdict in verdicts[:2]]
    assert set(seen[2:]) == {Verdict(verdict) for verdict in verdicts[2:]}
    assert list(table.loc[table["variant"] == "truth", "band_kind"]) == [
        band.kind for band in MU_0015
    ]


def test_bands_appear_in_the_section():
    """With the range and its resolution, and where the start decides."""
    bands = [
        replace(MU_0015[0], coexisting=(BandKind.STICK,), is_confirmed=True),
        *MU_0015[1:],
    ]
    threshold = StickThreshold(None, None, (np.nan, np.nan), "none")
    true = {True: TrueBands(threshold, tuple(bands), Tier.HIGH_PRECISION)}
    table = band_table(load_scene("slider-bar-case-1"), VARIATION, [], [], true)
    results = Results((), {}, {"threshold": pd.DataFrame(), "bands": table})
    section, shown = section_of(STUDY, results), present(results).rows
    assert len(shown["bands"]) == 5 and len(shown["start_dependent"]) == 1
    assert [row for row in section.findings if "resolution of 0.1 N" in row]
    assert [row for row in section.findings if "depends on the start" in row]
    assert not wrongly_written(section, results)


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
        assert sum(words in finding for finding in section.findings) == 1
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


def test_the_default_depth_has_half_the_values_unless_a_resolution_is_given():
    scenes = (load_scene("slider-bar-case-1"),)
    counts = {
        depth: len(variation_in(Scope(scenes, depth), scenes[0]).searched.values())
        for depth in (Depth.QUICK, Depth.DEFAULT, Depth.FULL)
    }
    assert counts == {Depth.QUICK: 121, Depth.DEFAULT: 61, Depth.FULL: 121}
    asked = Scope(scenes, Depth.DEFAULT, options={"range": (1.0, 2.0), "resolution": 0.1})
    assert len(variation_in(asked, scenes[0]).searched.values()) == 11


def test_a_scene_with_constant_loads_has_bands_and_no_engines():
    """A mass on a belt: the bands are those of the reference, and each engine has a row with the reason."""
    scope = Scope(
        (load_scene("mass-on-belt"),),
        Depth.QUICK,
        options={"parameter": "spring.stiffness", "range": (5.0, 50.0), "resolution": 15.0},
    )
    tables = planned({STUDY: scope})[STUDY].make(isolated=called_here).tables
    assert set(tables["threshold"]["status"]) == {Status.REFUSED}
    assert tables["threshold"]["reason"].str.contains("expected a periodic excitation").all()
    true = tables["bands"][tables["bands"]["variant"] == "truth"]
    # It sticks with its mus = 0.3 > mu = 0.2, and never comes to rest on the belt with mus = mu.
    assert list(true.sort_values("mus")["band_kind"]) == [BandKind.SLIP, BandKind.STICK]
    assert set(true["varied"]) == {"spring.stiffness"} and set(true["varied_unit"]) == {"N/m"}


def test_no_common_period_is_one_line_of_reason():
    scene = load_scene("slider-bar-case-1", {"Omega": 1.2345})
    reason = STUDY.applies(Scope((scene,), Depth.QUICK))
    assert "have no common period" in reason and "\n" not in reason
    with pytest.raises(InputError, match="no common period"):
        variation_in(Scope((scene,), Depth.QUICK), scene)


def test_tables_about_another_parameter_name_it_and_its_unit():
    """A column never names F0 or newtons: both are data of each row."""
    scene = load_scene("slider-bar-case-1")
    variation = Variation("k", "guide", Range(0.5, 4.0, 0.5), 1.0)
    bands = (Band(0.5, 3.2, BandKind.STICK, 0.0, 1e-9), Band(3.2, 4.0, BandKind.SLIP, 1e-9, 0.0))
    true = {
        True: TrueBands(StickThreshold(3.2, 1e-9, (3.1, 3.3)), bands, Tier.HIGH_PRECISION),
    }
    variant = Variant("one", "reference", "rtol", (1e-9,))
    engine = EngineBands((Threshold(3.19, 3.21, 5),))
    arguments = scene, variation, [variant], [Outcome("one", Status.OK, engine)], true
    table = threshold_table(*arguments)
    assert not [name for name in table if "F0" in name]
    assert (table["varied"][0], table["varied_unit"][0]) == ("k", "N/m")
    results = Results((), {}, {"threshold": table, "bands": band_table(*arguments)})
    section = section_of(STUDY, results)
    heads = [column.head for view in section.tables for column in view.columns]
    assert "from [N/m]" in heads and not [head for head in heads if "[N]" in head]
    assert "k = 3.2" in section.answer and "N/m" in section.answer


@pytest.mark.parametrize("mu", [0.01, 0.03, 0.06])
def test_without_a_static_coefficient_static_friction_follows_the_varied_one(mu):
    """Also where the scene's own static coefficient is smaller than the new kinetic one."""
    scene = load_scene("slider-bar-case-1")
    varied = vary(physics_over_values(scene, False), {"mu": mu})
    assert varied.guides["guide"].static_coefficient == mu
    assert physics_over_values(scene, True) is scene


def crank(speed):
    """A crank that a motor turns at `speed`, and a slider in a guide with friction, beside it on a driven spring.

    The spring is fixed to the pin of the crank, and the start is given for 2 rad/s alone.
    """
    return scene_from_dict(
        {
            "t_end": 10.0,
            "gravity": [0, -9.81],
            "parameters": {"speed": speed},
            "bodies": {
                "crank": {
                    "mass": 0.5,
                    "inertia": 0.01,
                    "position": [0.05, 0],
                    "velocity": [0, 0.1],
                    "angular_velocity": 2.0,
                },
                "block": {"mass": 1.0, "inertia": 1.0, "position": [1.0, 0]},
            },
            "joints": {
                "pin": {
                    "type": "revolute",
                    "bodies": ["crank", "ground"],
                    "points": [[-0.05, 0], [0, 0]],
                },
                "floor": {
                    "type": "translational",
                    "slider": "block",
                    "direction": [1, 0],
                    "mu": 0.1,
                    "mus": 0.12,
                },
            },
            "springs": {
                "spring": {
                    "type": "linear",
                    "axis": [1, 0],
                    "bodies": ["crank", "block"],
                    "points": [[0.05, 0], [0, 0]],
                    "stiffness": 40.0,
                    "damping": 0.5,
                    "rest_length": 1.0,
                }
            },
            "drives": {
                "motor": {
                    "type": "angle",
                    "bodies": ["crank", "ground"],
                    "law": {"type": "linear", "rate": "speed"},
                }
            },
        },
        "crank",
    )


@pytest.mark.parametrize(
    ("engine", "arguments"),
    [("reference", {"rtol": 1e-6}), ("reference", {"dt": 1e-3, "method": "paper"})],
)
@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_a_run_starts_assembled_at_its_value_and_has_the_period_of_its_value(
    engine, arguments, speed, monkeypatch
):
    """The crank has 2 rad/s at the start of the scene, which violates its drive at any other speed."""
    scene = crank(2.0)
    with pytest.raises(SceneError):
        with_consistent_start(vary(scene, {"speed": speed}))
    made = []
    engine_type = type(load_engine(engine))
    simulate = engine_type.simulate

    def observed(self, scene, **about):
        made.append((scene, about["t_end"]))
        return simulate(self, scene, **about)

    monkeypatch.setattr(engine_type, "simulate", observed)
    probe = StickProbe(scene, engine, arguments, "speed", "floor")
    probe.sticks(speed)
    started, end = made[0]
    assert with_consistent_start(started) is started
    assert started.bodies["crank"].angular_velocity == pytest.approx(speed, rel=1e-12)
    # A whole number of turns of the crank at its own speed.
    turns = end * speed / (2 * np.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9) and turns > 1


def test_at_a_value_without_a_period_there_is_no_steady_state():
    probe = StickProbe(crank(2.0), "reference", {"rtol": 1e-6}, "speed", "floor")
    with pytest.raises(NotSettled, match="speed = 0"):
        probe.sticks(0.0)
    found = measure_threshold(
        crank(2.0), "reference", {"rtol": 1e-6}, Search(0.0, 1.0, 0.1), "speed", "floor"
    )
    assert found.status == Status.NO_STEADY_STATE and found.with_stick is None


def threshold_row(variant, status, reason, **measured):
    return {
        "variant": variant,
        "fidelity": "joint",
        "parameter": "dt",
        "step": 1e-3,
        "status": status,
        "reason": reason,
        "mus": 0.03,
        "true_threshold": 4.2,
        "true_threshold_uncertainty": 1e-9,
        **measured,
    }


def test_where_no_method_has_a_threshold_none_is_said_to_agree():
    rows = [
        threshold_row("a", Status.FAILED, "start.motor.effort: found a residual\nand more"),
        threshold_row("b", Status.REFUSED, "no friction in a pin"),
        threshold_row("c", Status.MISSING, "not installed"),
    ]
    true = {True: TrueBands(StickThreshold(4.2, 1e-9, (4.1, 4.3)), MU_0015, Tier.HIGH_PRECISION)}
    bands = band_table(load_scene("slider-bar-case-1"), VARIATION, [], [], true)
    table = pd.DataFrame(rows).assign(scene="slider-bar-case-1", varied="F0", varied_unit="N")
    results = Results((), {}, {"threshold": table, "bands": bands})
    section, shown = section_of(STUDY, results), present(results).rows
    assert shown["measured"] == 0 and "deviates" not in section.answer
    assert shown["unanswered"] == {Status.FAILED: ["a"], Status.REFUSED: ["b"]}
    assert [row["variant"] for row in shown["lacking"]] == ["a", "b"]
    findings = " ".join(section.findings)
    assert "found a residual" in findings and "no friction in a pin" in findings
    assert len(section.answer) <= ANSWER_LENGTH and not wrongly_written(section, results)


def test_a_range_without_a_threshold_is_an_answer_and_no_failure():
    """Of 3.5 N to 4 N the slider of case 1 sticks everywhere; of 5 N to 6 N nowhere."""
    scene = load_scene("slider-bar-case-1")
    variant = Variant("one", "reference", "rtol", (1e-9,))
    true = {True: TrueBands(StickThreshold(None, None, (np.nan, np.nan), "none"), (), Tier.NONE)}
    for low, high in ((3.5, 4.0), (5.0, 6.0)):
        series = measure_series(scene, variant, Search(low, high, 0.1))
        assert [threshold.status for threshold in series] == [Status.NOT_FOUND]
        table = threshold_table(
            scene, VARIATION, [variant], [Outcome("one", Status.OK, EngineBands(series))], true
        )
        assert list(table["status"]) == [Status.NOT_FOUND]
        assert failed_runs(Results((), {}, {"threshold": table})).empty


def test_bands_for_one_coefficient_are_found_only_if_a_method_has_one():
    """Of pymunk and the reference both have a static coefficient; Exudyn's contact has one coefficient."""
    scene = load_scene("slider-bar-case-1")

    def labels(engines, scene=scene):
        scope = Scope((scene,), Depth.QUICK, engines)
        return len(true_thresholds(scope).tasks)

    assert labels(("reference",)) == 1
    assert labels(None) == 2
    assert labels(None, vary(scene, {"guide.mus": scene.guides["guide"].mu})) == 1


def test_the_bands_for_one_coefficient_are_named():
    scene = load_scene("slider-bar-case-1")
    guide = scene.guides["guide"]
    one = TrueBands(StickThreshold(3.2372, 1e-9, (3.2, 3.3)), MU_0015, Tier.HIGH_PRECISION)
    for true, single in (({False: one, True: one}, guide.mu), ({True: one}, None)):
        table = band_table(scene, VARIATION, [], [], true)
        shown = present(Results((), {}, {"threshold": pd.DataFrame(), "bands": table})).rows
        if single is None:
            assert shown["subjects"][0]["single"] is None
        else:
            assert float(shown["subjects"][0]["single"]["mus"]) == single


def test_a_campaign_names_the_command_that_searches_over_another_number():
    scope = Scope((crank(2.0),), Depth.DEFAULT, (), is_campaign=True)
    command = "stiction compare threshold SCENE --parameter KEY --range LOW:HIGH"
    assert command in reason_against(scope) and "\n" not in reason_against(scope)
    chosen = replace(scope, options={"parameter": "speed", "range": (1.0, 3.0)})
    assert not reason_against(chosen)


@pytest.mark.parametrize(("of_truth", "is_off"), [(1e-8, True), (1e-5, False)])
def test_a_difference_within_the_uncertainty_of_the_truth_is_none(of_truth, is_off):
    """The band ends of our own runs are known to 1e-6 of the range, and located events to 1e-9."""
    row = threshold_row("reference", Status.OK, "", **{ERROR: -7.6e-7, UNCERTAINTY: 1.5e-8})
    row |= {"parameter": "rtol", "true_threshold_uncertainty": of_truth, CHANGE: np.nan}
    shown = present(Results((), {}, {"threshold": pd.DataFrame([row])})).rows
    assert [one["variant"] for one in shown["off"]] == ["reference"] * is_off
    assert not shown["inconclusive"]
