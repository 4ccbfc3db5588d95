"""Depths of the main job: each has all of the one before; finished studies are reported at once."""

import pandas as pd
import pytest
from conftest import invoke
from hypothesis import given
from hypothesis import strategies as st

from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench.depth import Depth, limit_refinement
from stiction.comparisons.bench.participants import cost_variants, threshold_variants, variants
from stiction.comparisons.bench.presentation import Presentation
from stiction.comparisons.bench.runner import Comparison, records_comparison
from stiction.comparisons.bench.study import Study, Tables, union
from stiction.comparisons.bench.timing.timed_runs import call_of
from stiction.comparisons.bench.variants import COMMON_STEP, job
from stiction.comparisons.hard import hard_cases
from stiction.comparisons.measures.work_precision import work_precision
from stiction.comparisons.validation import _Progress
from stiction.engines import Outcome, Task
from stiction.scenes import load_scene


@pytest.mark.parametrize("ways", [variants, cost_variants, threshold_variants])
def test_each_depth_has_the_rungs_of_the_one_before(ways):
    quick, default, full = (
        {(variant.label, rung) for variant in ways(None, depth) for rung in variant.ladder}
        for depth in Depth
    )
    assert quick < default < full


def test_methods_side_by_side_are_sampled_alike_at_every_depth():
    """The jumps of page one were read off samples every 2 ms by default and every 10 ms in full: 0.19 and 0.93 N m."""
    scene = load_scene("slider-bar-case-1")
    for depth in (Depth.DEFAULT, Depth.FULL):
        there = [
            variant
            for variant in variants(None, depth)
            if COMMON_STEP in variant.ladder and variant.parameter == "dt"
        ]
        assert len(there) > 5
        assert {job(scene, variant, COMMON_STEP).arguments["output_step"] for variant in there} == {
            0.002
        }


@pytest.mark.parametrize("depth", [Depth.DEFAULT, Depth.FULL])
def test_a_step_of_the_cost_ladder_that_is_compared_too_is_run_once(depth):
    """Asked for with the same output and end: they were made twice, PyBullet's contacts alone for 8 s."""
    scene = load_scene("slider-bar-case-1")
    compared = {
        task.label: task for task in records_comparison([scene], variants(None, depth)).tasks
    }
    timed = {
        task.label.removeprefix("timed/"): task
        for task in work_precision(scene, cost_variants(None, depth)).tasks
    }
    shared = [(compared[key], timed[key]) for key in compared.keys() & timed.keys()]
    # the finest of one ladder need not be that of the other
    alike = [pair for pair in shared if len({task.args[2]["output_step"] for task in pair}) == 1]
    assert alike and all(call_of(one) == call_of(other) for one, other in alike)


def test_each_depth_has_the_hard_cases_of_the_one_before():
    quick, default, full = ({case.name for case in hard_cases(depth)} for depth in Depth)
    assert quick < default < full


def test_the_default_leaves_out_rungs_and_no_variant():
    for ways in (variants, threshold_variants):
        default, full = (
            [variant.label for variant in ways(None, depth)]
            for depth in (Depth.DEFAULT, Depth.FULL)
        )
        assert default == full
    left_out = {variant.label: variant.parameter for variant in cost_variants()}
    for variant in cost_variants(None, Depth.DEFAULT):
        del left_out[variant.label]
    assert set(left_out.values()) == {"iterations"}
    # the change from the coarser step is part of the uncertainty
    for variant in threshold_variants(None, Depth.DEFAULT):
        assert len(variant.ladder) > 1 or variant.parameter == "rtol", variant.label


@given(
    st.lists(st.floats(1e-12, 1e3), min_size=1, unique=True),
    st.floats(1e-12, 1e3),
    st.sampled_from(("dt", "rtol", "iterations")),
)
def test_rungs_down_to_the_finest(rungs, finest, parameter):
    ladder = tuple(sorted(rungs, reverse=parameter != "iterations"))
    found = limit_refinement(ladder, parameter, {parameter: finest})
    assert (
        found == ladder[: len(found)] and limit_refinement(ladder, parameter, {}) == ladder
    )  # the coarse part of it
    finer = [rung > finest if parameter == "iterations" else rung < finest for rung in ladder]
    assert finer == [False] * len(found) + [True] * (len(ladder) - len(found))


def test_one_depth_at_a_time():
    ended = invoke("validate", "--quick", "--full", exit_code=BAD_INPUT)
    assert "--quick, --full" in ended.output


def plan():
    """Three studies; the last is timed."""

    def comparison(name, *labels, rounds=0):
        return Comparison(
            tuple(Task(label, len) for label in labels),
            lambda outcomes: Tables({name: pd.DataFrame({"label": [o.label for o in outcomes]})}),
            rounds=rounds,
        )

    made = {
        "accuracy": comparison("accuracy", "run 1", "run 2"),
        "hard": comparison("hard", "case"),
        "cost": comparison("cost", "timed/run 1", rounds=1),
    }
    return {
        Study(name, name, name, lambda results: Presentation()): each for name, each in made.items()
    }


@pytest.mark.parametrize("order", [["run 2", "case", "run 1"], ["case", "run 1", "run 2"]])
def test_a_study_is_told_with_the_last_of_its_runs(order):
    shares, told = [], []
    progress = _Progress(
        plan(),
        shares.append,
        lambda study, tables: told.append(
            (study.name, list(union(tables).table(study.name)["label"]), len(shares))
        ),
    )
    progress.begin(4)
    for label in (*order, "timed/run 1"):
        progress.add(Outcome(label, "ok"))
    assert sorted(told) == [
        ("accuracy", ["run 1", "run 2"], 1 + max(order.index("run 1"), order.index("run 2"))),
        ("hard", ["case"], 1 + order.index("case")),
    ]
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1)


def test_after_an_interrupt_nothing_more_is_told():
    told = []
    progress = _Progress(plan(), lambda share: None, lambda study, tables: told.append(study.name))
    progress.begin(4)
    for label, status in (
        ("case", "ok"),
        ("run 1", "ok"),
        ("run 2", "not run"),
        ("timed/run 1", "not run"),
    ):
        progress.add(Outcome(label, status))
    assert told == ["hard"] and progress.interrupted
