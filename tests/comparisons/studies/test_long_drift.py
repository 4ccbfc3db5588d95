"""Stabilization over long runs: the plan, levels of rounding, and text whose numbers are cells of the table."""

from itertools import product

import numpy as np
import pytest
from made_up_runs import wrongly_written
from report_material import study_tables

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import validation_campaign
from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Scope
from stiction.comparisons.measures.drift_growth import BOUNDED, GROWS, ROUNDED
from stiction.comparisons.studies import studies
from stiction.comparisons.studies.long_drift import (
    CHOICES,
    DRIFT_RATIO,
    ERROR,
    ERROR_RATIO,
    IN_SHORT,
    NONE,
    PAPERS,
    PROJECTION,
    STEPS,
    STUDY,
    drift_study,
    long_runs,
    rounding_level,
)
from stiction.engines.isolation import Outcome
from stiction.engines.reference.engine import ReferenceEngine
from stiction.reports.text import section_of
from stiction.scenes import load_scene

CASES = {case: load_scene(f"slider-bar-case-{case}") for case in (1, 2, 3)}
DRIFT = {NONE: 1e-11, PAPERS: 1e-6, PROJECTION: 1e-12}
"""m, at a step of 1 s for the paper's terms."""


def test_stability_of_the_papers_choice():
    """lambda = -179.44 and -0.557 1/s; on the negative real axis the method of order 4 is stable up to
    h |lambda| = 2.7853 (Hairer & Wanner, Sect. IV.2)."""
    assert PAPERS.largest_step() == pytest.approx(
        2.785293563 / (90 + np.sqrt(90**2 - 10**2)), rel=1e-8
    )
    assert PAPERS.amplification(1.5e-2) < 1 < PAPERS.amplification(1.6e-2)
    for choice in CHOICES[1:-1]:
        assert choice.amplification(1e-9) == pytest.approx(1.0, abs=1e-6)
    assert np.isnan(NONE.amplification(1e-3)) and PROJECTION.largest_step() == np.inf


def test_the_plan_grows_with_the_depth():
    quick, default, full = (long_runs(CASES, depth) for depth in Depth)
    assert {run.t_end for run in full} == {240.0, 2400.0} and {run.t_end for run in quick} == {
        240.0
    }
    assert {run.t_end for run in default if run.scene is CASES[1]} == {240.0}
    assert {run.t_end for run in default if run.scene is CASES[3]} == {24.0}
    names = [{run.name for run in part} for part in (quick, default, full)]
    assert names[0] < names[1] < names[2]
    assert {(run.choice, run.step) for run in default} >= set(product((NONE, PAPERS), STEPS))
    assert sum(run.t_end / run.step for run in default) < 0.1 * sum(
        run.t_end / run.step for run in full
    )


def drift_of(turns, step):
    """Drift of 24 s of the scheme with the paper's choice after so many turns of the bar, and its rounding level."""
    angle = 2 * np.pi * turns
    scene = load_scene(
        "slider-bar-case-1", {"bodies.bar.angle": angle, "drives.motor.law.offset": angle}
    )
    run = ReferenceEngine().simulate(
        scene, t_end=24.0, dt=step, output_step=0.05, stabilization="baumgarte", event_values=False
    )
    late = run.t > 12
    return np.sqrt(np.mean(run["drift.position"][late] ** 2)), np.max(
        rounding_level(scene, PAPERS, step, run)[late]
    )


def test_drift_at_small_steps_is_that_of_the_angle_not_of_time(compiled):
    """The same 24 s after 300 turns, as many as 2400 s have: at 1 ms 100 times as large at once, at 10 ms the same."""
    (early, small), (late, large) = drift_of(0, 1e-3), drift_of(300, 1e-3)
    assert late > 100 * early and early < small and late < large < 10 * late
    (early, small), (late, _) = drift_of(0, 1e-2), drift_of(300, 1e-2)
    assert late == pytest.approx(early, rel=0.01) and small < 1e-3 * early


def made_up(failed=()):
    """Without stabilization all runs grow; with the paper's terms three of four are bounded and one stops early.

    The paper's terms make the position error of case 3 forty times as large.
    """
    runs = [
        run
        for run in long_runs({1: CASES[1], 3: CASES[3]})
        if run.choice in DRIFT and run.step in STEPS
    ]
    outcomes = []
    for run in runs:
        size = DRIFT[run.choice] * (run.step if run.choice == PAPERS else 1.0)
        early = run.choice == PAPERS and run.step == STEPS[-1]
        law = {NONE: GROWS, PAPERS: BOUNDED, PROJECTION: ROUNDED}[run.choice]
        worse = 40.0 if run.choice == PAPERS and run.scene is CASES[3] else 1.0
        row = {
            "reason": "modes follow each other" if early else "",
            IN_SHORT: size,
            ERROR: 1e-5 * worse,
            "position_uncertainty": 1e-12,
            "position_drift": 10 * size,
            "velocity_drift": size,
            "growth_240s": None if early else law,
            "growth_exponent_240s": 1.5 + 0.1 * STEPS.index(run.step),
            "growth_exponent_uncertainty_240s": 0.2,
        }
        octaves = () if early else ((60.0, size), (120.0, size), (240.0, size))
        outcomes.append(
            Outcome(run.name, "timed out", None, "made up")
            if run.name in failed
            else Outcome(run.name, "ok", (row, octaves))
        )
    return Results((), {}, dict(drift_study(runs, outcomes).tables))


def laws_of(results):
    """What is told of the growth of drift, by method of stabilization."""
    return {law["method"]: law for law in STUDY.presented(results).rows["laws"]}


def pairs_of(results, name, column):
    """Scene, step and the numbers of a column without stabilization and with the paper's terms."""
    return [
        (pair["papers"]["scene"], float(pair["papers"]["step"]))
        + tuple(float(pair[choice][column]) for choice in ("none", "papers"))
        for pair in STUDY.presented(results).rows[name]
    ]


def test_all_long_runs_are_counted():
    results = made_up()
    laws = laws_of(results)
    assert list(laws) == ["none", "baumgarte", "projection"]
    verdicts = ("grows", "bounded", "rounded", "inconclusive", "unknown")
    counts = {method: [law[verdict] for verdict in verdicts] for method, law in laws.items()}
    assert counts == {
        "none": [8, 0, 0, 0, 0],
        "baumgarte": [0, 6, 0, 0, 2],
        "projection": [0, 0, 8, 0, 0],
    }
    for law in laws.values():
        assert (law["runs"], law["length"]) == (8, 240.0)
        assert law["scenes"] == ["slider-bar-case-1", "slider-bar-case-3"]
        assert [float(step) for step in law["steps"]] == [1e-3, 1e-2]
    assert [float(power) for power in laws["none"]["powers"]] == pytest.approx([1.5, 1.8])
    assert laws["baumgarte"]["powers"] == laws["projection"]["powers"] == []


def test_drift_is_compared_at_both_ends_of_the_steps_and_errors_where_they_are_worst():
    """Both ends, as the paper's terms help at one and do harm at the other."""
    results = made_up()
    case_1, case_3 = "slider-bar-case-1", "slider-bar-case-3"
    assert pairs_of(results, "compared", IN_SHORT) == [
        (case_1, 1e-3, 1e-11, 1e-9),
        (case_1, 1e-2, 1e-11, 1e-8),
    ]
    assert pairs_of(results, "harmed", ERROR) == [
        (case_3, 1e-3, 1e-5, 4e-4),
        (case_1, 1e-3, 1e-5, 1e-5),
    ]
    section = section_of(STUDY, results)
    assert not wrongly_written(section, results)
    texts = [number.text for number in section.numbers]
    answer = ["1e-11", "1e-09", "1", "1e-11", "1e-08", "10"]
    laws = ["1.5", "1.8", "1", "10", "1", "10", "1", "10"]
    harmed = ["40", "1e-05", "0.0004", "1", "1", "1e-05", "1e-05", "1"]
    assert texts == answer + laws + harmed
    assert 0 < len(section.answer) <= ANSWER_LENGTH and len(section.findings) == 4


def test_drift_by_rounding_is_0():
    results = made_up()
    study = results.tables["study"]
    study.loc[study["choice"] == NONE.label, IN_SHORT] = 1e-16
    sizes = pairs_of(results, "compared", IN_SHORT)
    assert [without for _, _, without, _ in sizes] == [0.0, 0.0]


def test_a_run_that_failed_counts_among_all():
    results = made_up(failed=("slider-bar-case-1/none/dt=0.001",))
    study = results.tables["study"]
    [row] = study[study["status"] == "timed out"].to_dict("records")
    assert (row["run"], row["time"], row["reason"]) == (
        "slider-bar-case-1/none/dt=0.001",
        2400.0,
        "made up",
    )
    law = laws_of(results)["none"]
    assert (law["grows"], law["unknown"], law["runs"]) == (7, 1, 8)
    assert not wrongly_written(section_of(STUDY, results), results)


def test_the_text_follows_the_data():
    results = made_up()
    study = results.tables["study"]
    study.loc[0, "growth_240s"], study[ERROR_RATIO] = BOUNDED, 1.5
    law = laws_of(results)["none"]
    assert (law["grows"], law["bounded"], law["runs"]) == (7, 1, 8)
    assert pairs_of(results, "harmed", ERROR) == []
    assert len(section_of(STUDY, results).findings) == 3


def test_the_growth_of_one_step_has_one_power_and_one_step():
    results = made_up()
    study = results.tables["study"]
    one = study[study["step"] == STEPS[0]].reset_index(drop=True)
    octaves = results.tables["octaves"]
    section = section_of(STUDY, Results((), {}, {"study": one, "octaves": octaves}))
    assert [number.text for number in section.numbers][:5] == ["1e-11", "1e-09", "1", "1.5", "1"]


def test_the_note_has_the_roots_of_the_papers_terms():
    """s^2 + 180 s + 100 = 0; (exp and R)(-179.44 * 0.01), by hand."""
    papers = STUDY.presented(made_up()).rows["papers"]
    fast, slow = -90 - np.sqrt(8000.0), -90 + np.sqrt(8000.0)
    assert (papers["fast"], papers["slow"]) == pytest.approx((fast, slow), rel=1e-9)
    z = 0.01 * fast
    assert papers["step"] == 10 and papers["exact"] == pytest.approx(np.exp(z), rel=1e-9)
    computed = 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24
    assert papers["computed"] == pytest.approx(computed, rel=1e-9)
    assert papers["unstable"] == pytest.approx(2785.293563 / -fast, rel=1e-8)


def test_ratios_are_to_the_run_without_stabilization_over_the_time_of_the_papers_figure():
    """Over 192 s the made-up drift without stabilization is 2^4.5 times that with it, over 24 s they are equal."""
    study = study_tables()["study"]
    whole = study.groupby("choice")["position_drift"].max()
    assert whole[NONE.label] == pytest.approx(2**4.5 * whole[PAPERS.label])
    ratios = study.set_index("choice")
    assert ratios.loc[PAPERS.label, [DRIFT_RATIO, ERROR_RATIO]].to_numpy().tolist() == [
        [1.0, 2.0],
        [1.0, 2.0],
    ]
    assert ratios.loc[NONE.label, [DRIFT_RATIO, ERROR_RATIO]].isna().all(axis=None)


def test_a_figure_per_scene_shows_drift_over_time_and_over_the_step():
    figures = STUDY.presented(made_up()).figures
    assert [figure.name for figure in figures] == ["fig14-drift", "drift-slider-bar-case-3"]
    assert len(figures[0].panels) == 2 and {
        series.hollow for series in figures[0].panels[0].series
    } == {True, False}
    captions = [figure.caption for figure in section_of(STUDY, made_up()).figures]
    assert "case 1" in captions[0] and "case 3" in captions[1]
    assert all(table.caption for table in section_of(STUDY, made_up()).tables)


def test_the_plan_has_the_papers_cases_alone():
    scenes = tuple(validation_campaign().scenes)
    assert STUDY in studies() and STUDY.plan(Scope(scenes[:1], Depth.QUICK, ())) is None
    comparison = STUDY.plan(Scope(scenes, Depth.QUICK, ()))
    made = comparison.tabulate(
        [Outcome(task.label, "failed", None, "made up") for task in comparison.tasks]
    )
    assert len(made.tables["study"]) == len(comparison.tasks) == len(long_runs(CASES, Depth.QUICK))
    assert STUDY.presented(Results((), {}, made.tables)).is_empty
