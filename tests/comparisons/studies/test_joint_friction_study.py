"""The study of joint friction: its cases, orders, the order of its rows, and its text."""

import numpy as np
import pandas as pd
import pytest
from conftest import here, installed
from made_up_runs import wrongly_written

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.study import Scope, union
from stiction.comparisons.bench.variants import FRICTION_BY
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.studies.joint_friction import (
    CASE,
    ERROR,
    ORDER,
    STUDY,
    UNCERTAINTY,
    load_data,
    measure_error,
    plan,
    present,
    with_orders,
)
from stiction.engines.joint_effects import has_constant_bounds
from stiction.reports.text import section_of
from stiction.scenes import vary
from stiction.truths import Tier
from stiction.truths.closed_form.dry_friction import RampedStart

CASES = {case.title: case for case in load_data().scenes}


@pytest.mark.parametrize("title", CASES)
def test_cases_have_a_truth_and_constant_bounds(title):
    scene = CASES[title].load()
    assert has_constant_bounds(scene)
    assert ground_truth(scene).tier != Tier.NONE


@pytest.mark.parametrize("title", ["arm under a ramp", "arm whose friction drops"])
def test_truth_of_the_arm_is_the_closed_form(title):
    scene = CASES[title].load()
    p = scene.parameters
    bound, static = scene.joints["pin"].bounds
    exact = RampedStart(p["I"], p["part"] * p["limit"], p["ramp"] * p["limit"], bound, static)
    t = np.linspace(0, scene.t_end, 50)
    angle = ground_truth(scene)(t)["arm.angle"]
    np.testing.assert_allclose(angle, exact.displacement(t), rtol=0, atol=1e-9)


def test_error_of_a_wrong_bound():
    """The reference has no error to speak of; with a bound that is 10 % too small it has one."""
    scene = CASES["vertical slider"].load()
    right, _ = measure_error("reference", scene, "position", True, {"rtol": 1e-10})
    assert right[ERROR] < 1e-8
    truth = ground_truth(scene)(np.array([scene.t_end]))["guide.displacement"]
    wrong = vary(scene, {"friction": 13.5, "static_friction": 13.5})
    moved = ground_truth(wrong)(np.array([scene.t_end]))["guide.displacement"]
    assert abs(moved - truth) > 0.1


def rows(*runs):
    return pd.DataFrame(
        [
            {CASE: "c", "variant": name, "step": step, ERROR: error, UNCERTAINTY: 0.0}
            for name, step, error in runs
        ]
    )


def test_orders():
    steps = (4e-3, 1e-3, 2.5e-4)
    table = rows(
        *(("first", step, 2 * step) for step in steps),
        *(("second", step, 5 * step**2) for step in steps),
        *(("stays", step, 0.02 - 1e-3 * i) for i, step in enumerate(steps)),
        *(("grows", step, 1e-3 / step) for step in steps),
        *(("exact", step, 1e-14 * step) for step in steps),
        ("one run", 1e-3, 1e-3),
    )
    orders = with_orders(table).groupby("variant")[ORDER].first()
    assert orders["first"] == pytest.approx(1) and orders["second"] == pytest.approx(2)
    assert orders[["stays", "grows", "exact", "one run"]].isna().all()


@pytest.fixture(scope="module")
def study():
    for name in ("pymunk", "exudyn"):
        installed(name)
    with here():
        return plan(Scope((), Depth.QUICK, ("pymunk", "exudyn"))).make()


def test_laws_of_engines_come_first(study):
    results = union([study])
    presentation = present(results)
    for view in presentation.tables[:-1]:
        laws = list(view.frame[FRICTION_BY])
        order = ["engine", "engine + adapter", "adapter"]
        assert laws == sorted(laws, key=order.index) and len(laws) > 1
    assert set(presentation.rows["own"]) == {"exudyn", "pymunk"}


def test_errors_fall_with_the_step(study):
    table = study.tables["joint-friction"]
    pymunk = table[table["variant"] == "pymunk"]
    # of first order at least; between two steps, the place of an event within its step is left
    assert set(pymunk[CASE]) == set(CASES) and (pymunk[ORDER] > 0.5).all()


def test_text(study):
    results = union([study])
    section = section_of(STUDY, results)
    assert not wrongly_written(section, results)
    assert 0 < len(section.answer) <= ANSWER_LENGTH
    assert all(view.caption for view in section.tables)


def test_campaigns_leave_it_to_the_night():
    assert plan(Scope((), Depth.DEFAULT, is_campaign=True)) is None
