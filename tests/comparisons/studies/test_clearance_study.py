"""The study of clearance: limits by power laws, numbers that steps do not resolve, refusals, and its text."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
from conftest import here, invoke
from made_up_runs import words, wrongly_written

from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.presentation.cells import AGAIN
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Scope, Tables, union
from stiction.comparisons.measures.clearance_effect import GapRun
from stiction.comparisons.measures.corner_flights import Release
from stiction.comparisons.studies import clearance
from stiction.comparisons.studies.claims import FAILS, HOLDS, UNDECIDED
from stiction.comparisons.studies.clearance import (
    SLIDER_CRANK,
    STUDY,
    effect_runs,
    flight_runs,
    load_data,
    methods_of,
    plan,
    scenes_of,
)
from stiction.comparisons.studies.clearance_claims import (
    CONFIGURATIONS,
    MARGINS,
    MEASURES,
    ClaimTables,
    claims_table,
    clearance_claims,
)
from stiction.comparisons.studies.clearance_tables import (
    CLEARANCE,
    EFFORT,
    EFFORT_EXPONENT,
    NO_EFFORT,
    POSITION,
    RESTITUTION,
    SPEED_EXPONENT,
    START,
    TIME_EXPONENT,
    UNRESOLVED,
    WHY_NONE,
    crossing,
    effects_table,
    exponents_table,
    limits_table,
    uncertainty_of,
)
from stiction.engines.status import Status
from stiction.reports.text import section_of
from stiction.scenes import InputError, load_scene

GAPS = (1e-6, 1e-5, 1e-4, 1e-3)
CASES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3")
MOREAU = "Moreau, contact"


def law(clearance, at_limit=2e-4, exponent=2 / 3):
    """An effect that is 1 % at a clearance."""
    return 0.01 * (np.asarray(clearance) / at_limit) ** exponent


def test_the_limit_of_a_power_law_is_exact():
    effect = law(GAPS)
    found = crossing(GAPS, effect, 0.2 * effect, 0.01)
    assert found.clearance == pytest.approx(2e-4)
    # effects that are 20 % larger and smaller reach 1 % at clearances that are smaller and larger by these powers
    assert found.low == pytest.approx(2e-4 * 1.2**-1.5)
    assert found.high == pytest.approx(2e-4 * 0.8**-1.5)
    assert found.why_none == ""


@pytest.mark.parametrize(
    ("effects", "share", "reason"),
    [
        ([0.001, 0.003, math.nan, 0.02], 0.1, "not resolved at a clearance of 0.0001 m"),
        ([0.02, 0.03, 0.04, 0.05], 0.1, "at the smallest clearance, 1e-06 m"),
        ([0.001, 0.002, 0.003, 0.004], 0.1, "at the largest clearance, 0.001 m"),
        # the interval of the last effect contains the limit
        ([0.001, 0.002, 0.003, 0.011], 0.5, "at the largest clearance"),
        ([0.008, 0.012, 0.03, 0.05], 0.5, "at the smallest clearance"),
    ],
)
def test_limits_that_the_grid_does_not_enclose_have_a_reason(effects, share, reason):
    found = crossing(GAPS, effects, share * np.array(effects), 0.01)
    assert math.isnan(found.clearance) and found.why_none.startswith(reason)


def test_an_unresolved_effect_beyond_the_limit_does_not_matter():
    effect = [0.001, 0.005, 0.02, math.nan]
    found = crossing(GAPS, effect, np.zeros(4), 0.01)
    assert found.clearance == pytest.approx(10 ** (-5 + math.log(2) / math.log(4)))


def run_rows(
    effect_of,
    scene=CASES[0],
    steps=(1e-4, 5e-5, 2.5e-5),
    gaps=GAPS,
    restitution=0.0,
    variant=MOREAU,
    **more,
):
    """Rows of runs whose effort changes by an effect of clearance and step, and whose peak is inverse to the step."""
    return [
        {
            "scene": scene,
            "variant": variant,
            "engine": "moreau",
            "fidelity": "contact",
            "parameter": "dt",
            "status": Status.OK,
            "reason": "",
            "cpu_time": 0.1,
            "step": step,
            CLEARANCE: gap,
            RESTITUTION: restitution,
            START: 0,
            EFFORT: effect_of(gap, step),
            POSITION: gap,
            "effort_peak": 1e-3 / step,
            "impact_count": 0,
            "window_begin": 0.2,
            "window_end": 8.0,
            **more,
        }
        for gap in gaps
        for step in steps
    ]


def results_of(rows, flights=(), efforts=()):
    """Results of the study from rows of runs."""
    runs = pd.DataFrame(rows)
    effects = effects_table(runs)
    flown = pd.DataFrame(flights)
    tables = {
        "clearance": effects,
        "clearance-limits": limits_table(effects, 0.01),
        "clearance-claims": claims_table(ClaimTables(effects, limits_table(effects, 0.01), runs)),
        "clearance-flights": flown,
        "clearance-exponents": exponents_table(flown),
        "clearance-efforts": pd.DataFrame(efforts),
        "clearance-runs": runs,
    }
    return union([Tables(tables)])


def converging(gap, step):
    """An effect with an error of first order, 4 % at the step 1e-4 s."""
    return float(law(gap)) * (1 - 400 * step)


def test_numbers_that_the_step_determines_are_not_given():
    table = effects_table(pd.DataFrame(run_rows(converging)))
    assert list(table[CLEARANCE]) == sorted(GAPS, reverse=True)
    assert table["effort_peak"].isna().all()
    assert set(table[UNRESOLVED]) == {"effort_peak"}
    # the uncertainty is the range over the last three steps: 0.96 to 0.99 of the limit
    np.testing.assert_allclose(table[EFFORT], law(table[CLEARANCE]) * 0.99)
    np.testing.assert_allclose(table[uncertainty_of(EFFORT)], 0.03 * law(table[CLEARANCE]))
    assert (table["impact_count"] == 0).all()


def test_the_spread_over_perturbed_starts_is_part_of_the_uncertainty():
    rows = run_rows(converging, gaps=(1e-4,))
    spread = 0.2 * float(law(1e-4))
    perturbed = {**rows[0], START: 1, EFFORT: rows[0][EFFORT] + spread}
    [calm] = effects_table(pd.DataFrame(rows))[uncertainty_of(EFFORT)]
    [shaken] = effects_table(pd.DataFrame([*rows, perturbed]))[uncertainty_of(EFFORT)]
    assert shaken - calm == pytest.approx(spread)


def test_a_single_step_gives_no_number():
    [row] = effects_table(pd.DataFrame(run_rows(converging, steps=(1e-4,), gaps=(1e-4,)))).to_dict(
        "records"
    )
    assert row["status"] == Status.FAILED and EFFORT not in row
    failed = run_rows(converging, gaps=(1e-4,))
    for one in failed[1:]:
        one |= {"status": Status.TIMED_OUT, "reason": "too long", EFFORT: math.nan}
    [row] = effects_table(pd.DataFrame(failed)).to_dict("records")
    assert (row["status"], row["reason"]) == (Status.TIMED_OUT, "too long")


def test_a_failed_step_or_start_is_reported_beside_the_numbers_of_the_others():
    rows = run_rows(converging, gaps=(1e-4,))
    rows[-1] |= {"status": Status.TIMED_OUT, "reason": "too long", EFFORT: math.nan}
    [row] = effects_table(pd.DataFrame(rows)).to_dict("records")
    assert row["status"] == Status.OK and row["step"] == 5e-5 and row[EFFORT] > 0
    assert row["reason"] == "1 of 3 runs failed: too long"


def test_exponents_contain_the_law():
    limits = results_of(run_rows(converging)).table("clearance-limits")
    [row] = limits.to_dict("records")
    assert row[EFFORT_EXPONENT] == pytest.approx(2 / 3)
    # each point within 3 % of itself: by the sum of |x| over that of x^2, with x = -1.5, -0.5, 0.5, 1.5 decades
    by_points = 0.03 / 0.99 * 4.0 / (5.0 * math.log(10))
    assert row[uncertainty_of(EFFORT_EXPONENT)] == pytest.approx(by_points, rel=1e-3)


def flight(gap, ratio=1.0, crowding=0.1, time=1.36, release=Release.ZERO, mobilization=0.0):
    flight_time, speed = 0.05 * (gap / 1e-4) ** (1 / 3), 0.01 * (gap / 1e-4) ** (2 / 3)
    return {
        "scene": CASES[0],
        "variant": MOREAU,
        "engine": "moreau",
        "step": 1e-5,
        CLEARANCE: gap,
        "status": Status.OK,
        "reason": "",
        "event_time": time,
        "joint": "guide",
        "corner": 4,
        "opposite_corner": 1,
        "release": str(release),
        "crowding": crowding,
        "mobilization": mobilization,
        "flight_time": flight_time,
        "impact_speed": speed,
        "flight_time_ratio": ratio,
        "impact_speed_ratio": ratio,
        WHY_NONE: "",
    }


def test_exponents_of_flights_are_those_of_isolated_ones():
    good = [flight(gap) for gap in GAPS] + [flight(gap, time=2.7) for gap in GAPS]
    wrong = [
        flight(1e-3, ratio=2.0, crowding=1.5, time=3.0),
        flight(1e-3, ratio=2.0, release=Release.JUMP, time=4.0),
        flight(1e-3, ratio=2.0, mobilization=1.1, time=5.0),
    ]
    [row] = exponents_table(pd.DataFrame([*good, *wrong])).to_dict("records")
    assert row["flights"] == 2 and row["largest_time_deviation"] == 0
    assert row[TIME_EXPONENT] == pytest.approx(1 / 3)
    assert row[SPEED_EXPONENT] == pytest.approx(2 / 3)
    assert row[WHY_NONE] == ""
    [none] = exponents_table(pd.DataFrame(wrong)).to_dict("records")
    assert none["flights"] == 0 and none[WHY_NONE]
    # one flight at two clearances determines an exponent, but not its uncertainty
    [short] = exponents_table(pd.DataFrame(good[:2])).to_dict("records")
    assert TIME_EXPONENT not in short and short[WHY_NONE]


def sentence(rows):
    results = results_of(rows)
    section = section_of(STUDY, results)
    assert not wrongly_written(section, results)
    assert 0 < len(section.answer) <= ANSWER_LENGTH
    assert all(table.caption for table in section.tables)
    return section


def three_cases(effects):
    return [row for scene, effect in zip(CASES, effects) for row in run_rows(effect, scene)]


def test_the_sentence_of_page_one():
    """It gives the lower end of the interval, rounded down, for each case; a doubled gap halves it."""
    section = sentence(three_cases([converging] * 3))
    low = 2e-4 * 1.02**-1.5
    assert f"below {math.floor(low * 1e5) / 100:g} mm in case 1," in section.answer
    assert section.answer.endswith("by less than 1 % (Moreau, contact; e = 0).")
    # beside it the interpolated clearance explains why the answer is smaller
    assert "lower end of an interval" in section.beside
    assert "the change reaches 1 % at 0.2 mm (0.19 mm to" in section.beside
    assert "perturbed starts" not in section.beside
    halved = sentence(three_cases([lambda gap, step: converging(2 * gap, step)] * 3))
    assert f"below {math.floor(low / 2 * 1e6) / 1000:g} mm in case 1," in halved.answer
    assert halved.answer != section.answer


def test_the_window_is_mentioned_only_if_all_scenes_have_it():
    rows = three_cases([converging] * 3)
    assert "ideal joints from 0.2 to 8 s;" in sentence(rows).beside
    for row in rows:
        if row["scene"] == CASES[2]:
            row["window_end"] = 4.0
    assert "ideal joints; the" in sentence(rows).beside


def test_the_sentence_refuses_what_is_not_resolved():
    def rough(gap, step):
        return float(law(gap)) * (step / 1e-4) ** -0.5

    section = sentence(three_cases([converging, converging, rough]))
    assert section.answer.endswith("Not determined in case 3.")
    assert "Case 3 is not determined: not resolved at a clearance of 1e-06 m." in section.beside


def test_of_several_methods_the_most_sensitive_one_answers():
    def stiff(gap, step):
        return converging(2 * gap, step)

    rows = three_cases([converging] * 3)
    rows += [row for scene in CASES for row in run_rows(stiff, scene, variant="other, contact")]
    # a method with a limit in one case only does not answer for all
    rows += run_rows(lambda gap, step: converging(9 * gap, step), variant="third, contact")
    section = sentence(rows)
    assert section.answer.endswith("(other, contact; e = 0).")


def test_a_scene_without_a_drive_has_no_limit_but_effects():
    rows = run_rows(converging, scene=SLIDER_CRANK)
    for row in rows:
        del row[EFFORT]
    results = results_of(rows)
    assert list(results.table("clearance-limits")[WHY_NONE]) == [NO_EFFORT]
    section = section_of(STUDY, results)
    assert section.answer == "No method gave a clearance that may be neglected."
    assert any(figure.name == "clearance-effect" for figure in section.figures)


def test_no_results():
    assert STUDY.presented(Results((), {}, {})).is_empty


# Published statements


def crank_rows(overlap_of, shares, change=0.03):
    """Rows of the slider-crank at its published clearance and restitution."""
    rows = run_rows(converging, SLIDER_CRANK, gaps=(1e-3,), restitution=0.4)
    for row in rows:
        row[POSITION] = change
        row["largest_overlap"] = overlap_of(row["step"])
        row |= dict(zip(CONFIGURATIONS, shares))
    return rows


def verdicts(rows):
    table = results_of(rows).table("clearance-claims")
    by_measure = {claim.words: claim.measure for claim in clearance_claims() if claim.measure}
    return {
        by_measure[words]: verdict
        for words, verdict in zip(table["claim"], table["verdict"])
        if words in by_measure
    }


def test_verdicts_follow_from_the_measurements():
    cases = three_cases([converging] * 3)
    found = verdicts([*cases, *crank_rows(lambda step: step, (0.5, 0.2, 0.2, 0.1))])
    assert found == {
        "all_configurations": HOLDS,
        "changes_motion": HOLDS,
        "is_negligible": HOLDS,
        "overlap_grows": FAILS,
    }
    other = verdicts(crank_rows(lambda step: 1 / step, (0.5, 0.3, 0.2, 0.0), change=0.0))
    assert other == {
        "all_configurations": "partly",
        "changes_motion": FAILS,
        "is_negligible": UNDECIDED,
        "overlap_grows": HOLDS,
    }


def test_statements_have_sources_and_either_a_measure_or_a_reason():
    for claim in clearance_claims():
        assert claim.source and claim.words
        assert [bool(claim.measure), bool(claim.why), bool(claim.contradiction)].count(True) == 1
    assert set(MEASURES) == set(MARGINS) == {claim.measure for claim in clearance_claims()} - {""}


# The plan


def test_the_plan_of_the_papers_cases():
    scope = Scope((), Depth.DEFAULT, ("moreau",))
    assert [scene.name for scene in scenes_of(scope)] == [*CASES, SLIDER_CRANK]
    crank = load_scene(SLIDER_CRANK)
    [moreau] = methods_of(scope).able
    # the declared restitution, and only gaps at which no drive is needed
    runs = effect_runs(scope, crank, moreau)
    assert {run.restitution for run in runs} == {0.4}
    full = effect_runs(Scope((), Depth.FULL, ("moreau",)), crank, moreau)
    assert {run.restitution for run in full} == {0.0, 0.4}
    assert {run.clearance for run in runs} < {run.clearance for run in full}
    # every gap of every depth has three steps at least, the finest half of the next
    for entry in load_data().effect:
        assert len(entry.steps) >= 3
        np.testing.assert_allclose(np.array(entry.steps[:-1]) / entry.steps[1:], 2)


def test_campaigns_leave_other_engines_to_their_full_depth(monkeypatch):
    monkeypatch.setattr(clearance, "takes_restitution", lambda variant: True)
    scene = load_scene(CASES[0])
    moreau = methods_of(Scope((), engines=("moreau",))).able[0]
    other = dataclasses.replace(moreau, engine="other")
    counts = {}
    for depth in Depth:
        for is_campaign in (True, False):
            scope = Scope((scene,), depth, is_campaign=is_campaign)
            runs = [*effect_runs(scope, scene, other), *flight_runs(scope, scene, other)]
            counts[depth, is_campaign] = len(runs)
    assert counts[Depth.QUICK, True] == counts[Depth.DEFAULT, True] == 0
    assert 0 < counts[Depth.QUICK, False] < counts[Depth.FULL, False]
    assert counts[Depth.FULL, True]


def test_methods_without_contacts_or_restitution_are_refused_in_words(monkeypatch):
    variant = methods_of(Scope((), engines=("moreau",))).able[0]
    joint = clearance.participants(("pymunk",))
    only_joint = [one for one in joint if one.engine == "pymunk" and one.fidelity == "joint"]
    monkeypatch.setattr(clearance, "participants", lambda engines: [variant, *only_joint])
    methods = methods_of(Scope((), engines=("pymunk", "moreau")))
    assert methods.able == (variant,)
    [(refused, status, reason)] = methods.unable
    assert refused.engine == "pymunk"
    assert status == Status.REFUSED and "expected contact fidelity" in reason
    monkeypatch.setattr(clearance, "takes_restitution", lambda variant: False)
    scope = Scope((load_scene(CASES[0]),), Depth.FULL, ("pymunk", "moreau"))
    rows = list(clearance._unable_rows(methods, scope.scenes, scope))
    assert {row[RESTITUTION] for row in rows} == {0.0, 0.4}
    assert all(row["status"] == Status.REFUSED and row["reason"] for row in rows)
    assert not {run.restitution for run in effect_runs(scope, scope.scenes[0], variant)} - {0.0}
    # the table of refusals alone is presented, too
    section = section_of(STUDY, results_of(rows))
    assert "Refused: pymunk: found joint fidelity only" in words(section)


def test_scenes_without_corners_are_refused():
    with pytest.raises(InputError, match="pendulum: joints: found no guide with length and width"):
        plan(Scope((load_scene("pendulum"),)))
    result = invoke("compare clearance pendulum --engines moreau", exit_code=BAD_INPUT)
    assert "found no guide with length and width" in result.output
    assert "found no guide" in STUDY.applies(Scope((load_scene("pendulum"),)))


@pytest.fixture(scope="module")
def made():
    """The study of case 1 until 2 s, at the least depth."""
    with here():
        return union([plan(Scope((load_scene(CASES[0]),), Depth.QUICK, ("moreau",), 2.0)).make()])


def test_the_study_of_case_1(made):
    effects = made.table("clearance")
    assert list(effects[CLEARANCE]) == [1e-3, 1e-4]
    assert (effects["status"] == Status.OK).all()
    assert 0.03 < effects[EFFORT][0] < 0.05
    # over 2 s there is one flight: its steps do not resolve 0.1 mm, and the clearance of 1 % lies beyond
    assert EFFORT in effects[UNRESOLVED][1].split(", ") and math.isnan(effects[EFFORT][1])
    assert all("effort_peak" in names.split(", ") for names in effects[UNRESOLVED])
    [limit] = made.table("clearance-limits").to_dict("records")
    assert limit[WHY_NONE] == "not resolved at a clearance of 0.0001 m"
    flights = made.table("clearance-flights")
    measured = flights[flights["event_time"].between(1.36, 1.37)]
    assert len(measured) == 2
    np.testing.assert_allclose(measured["flight_time_ratio"], 1, atol=0.06)


def test_the_command_of_a_run_repeats_it(made, tmp_path):
    """Moreau's method refuses the mus > mu of case 1, so that the command changes it as the study does."""
    [row] = [
        row
        for row in made.table("clearance-runs").to_dict("records")
        if row[CLEARANCE] == 1e-3 and row["step"] == 2e-4
    ]
    out = tmp_path / "run.parquet"
    program, *words_of_command = row[AGAIN].split()
    assert program == "stiction"
    with here():
        invoke(" ".join(words_of_command), "--output-step", 2e-4, "--out", out)
    [moreau] = methods_of(Scope((), engines=("moreau",))).able
    run = GapRun(load_scene(CASES[0]), 1e-3, 0.0, moreau, 2e-4, 2.0).simulate()
    repeated = pd.read_parquet(out)
    np.testing.assert_allclose(
        repeated["guide.displacement"], run["guide.displacement"], atol=1e-12
    )


def test_text_and_figures_of_case_1(made):
    section = section_of(STUDY, made)
    assert not wrongly_written(section, made)
    assert len(section.answer) <= ANSWER_LENGTH
    assert [figure.name for figure in section.figures] == ["clearance-torque", "clearance-effect"]
    assert all(figure.caption for figure in section.figures)
    assert all(table.caption for table in section.tables)
