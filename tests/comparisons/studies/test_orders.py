"""Observed orders have intervals that hold, and there is none outside of the asymptotic range."""

import numpy as np
import pandas as pd
import pytest
from made_up_runs import wrongly_written

from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Scope
from stiction.comparisons.studies.orders import FEWEST, METHODS, STUDY, observed_order, plan
from stiction.engines import Outcome
from stiction.reports.text import section_of
from stiction.scenes import load_scene

STEP = 0.1 * 2.0 ** -np.arange(6)


@pytest.mark.parametrize("order", [1, 2, 4, 8])
def test_order_of_a_power_law_with_noise(order):
    random = np.random.default_rng(order)
    hits = 0
    for _ in range(200):
        found = observed_order(
            STEP, STEP**order * np.exp(0.02 * random.normal(size=6)), np.zeros(6)
        )
        hits += abs(found.order - order) <= found.uncertainty
    assert 175 <= hits <= 200  # of 95 %: 190, with a standard deviation of 3


def test_runs_outside_of_the_range_are_left_out():
    coarse = STEP**2 * (
        1 + (STEP / 0.05) ** 4
    )  # the second term is the larger one at the coarsest run
    found = observed_order(STEP, coarse, np.zeros(6))
    assert FEWEST <= found.runs < 6 and found.order == pytest.approx(2, abs=0.1)
    step = 0.1 * 2.0 ** -np.arange(8)
    twice = np.where(
        step > 0.01, 1e-3 * step, 100 * step**3
    )  # four runs of each order: the finer ones count
    assert observed_order(step, twice, np.zeros(8)).order == pytest.approx(3, abs=1e-6)
    floor = STEP**4 + 1e-9  # what no step makes smaller
    assert observed_order(STEP, floor, np.full(6, 1e-12)).runs < 6


@pytest.mark.parametrize(
    "error, why",
    [
        ((STEP > 0.04) * 1.0 + 1e-9, "not in the asymptotic range"),
        (STEP**2, "above the uncertainty"),
        (np.full(6, np.nan), "above the uncertainty"),
    ],
)
def test_a_dash_has_its_reason(error, why):
    found = observed_order(STEP, error, np.full(6, 1.0 if "uncertainty" in why else 0.0))
    assert np.isnan(found.order) and why in found.reason


def test_orders_of_the_reference(in_this_process):
    """8 between events, 4 between events, 1 across a break-away, within their intervals, which say something."""
    table = (
        plan(Scope((load_scene("slider-bar-case-1"),)))
        .make()
        .tables["orders"]
        .drop_duplicates("method")
    )
    assert list(table["promised_order"]) == [8, 4, 1]
    for row in table.to_dict("records"):
        order, half = row["promised_order"], row["observed_order_uncertainty"]
        assert abs(row["observed_order"] - order) <= half < 0.25 * order


def made_up(**status):
    """A table of all methods: runs of the promised order, or a status of a task that failed, by position."""
    comparison = plan(Scope((load_scene("slider-bar-case-1"),)))
    outcomes = []
    for number, (method, refined) in enumerate(METHODS.items()):
        runs = [
            {
                "method": method,
                "mean_step": step,
                "position_error": step**refined.order,
                "position_uncertainty": 1e-13,
                "promised_order": refined.order,
                "observed_order": refined.order + 0.02,
                "observed_order_uncertainty": 0.05,
                "runs": len(STEP),
                "why_none": "",
            }
            for step in STEP
        ]
        lost = status.get(f"of_{number}")
        outcomes.append(Outcome("", lost or "ok", None if lost else runs))
    return comparison.tabulate(outcomes).tables["orders"]


def presented(table):
    results = Results((), {}, {"orders": table})
    return STUDY.presented(results), section_of(STUDY, results), results


def test_orders_are_said_with_those_that_are_promised():
    said, section, results = presented(made_up())
    assert not wrongly_written(section, results) and not section.findings
    assert [run["method"] for run in said.rows["methods"]] == list(METHODS)
    for run, refined in zip(said.rows["methods"], METHODS.values(), strict=True):
        assert float(run["promised_order"]) == refined.order
        assert float(run["observed_order"]) == refined.order + 0.02
        assert f"{refined.order}.02 ± 0.05 ({refined.order})" in section.answer
    assert len(f"{STUDY.title}: {section.answer}") <= ANSWER_LENGTH
    [table], [figure] = section.tables, section.figures
    assert table.caption and figure.caption and table.caption != figure.caption
    assert len(table.frame) == len(METHODS)
    points, slope = figure.panels[0].series[:2]
    np.testing.assert_allclose(slope.y, points.y)  # runs of the promised order are on its line


def test_a_method_without_an_order_has_its_reason():
    """Runs that are not in the asymptotic range, and a method whose runs were lost."""
    table = made_up(of_1="timed out")
    first = table["method"] == next(iter(METHODS))
    table.loc[first, ["observed_order", "observed_order_uncertainty"]] = np.nan
    table.loc[first, "why_none"] = "the reason"
    said, section, results = presented(table)
    assert not wrongly_written(section, results)
    first, last = said.rows["methods"]
    assert first["observed_order"] is None and "the reason" in section.findings[0]
    assert float(last["observed_order"]) == 1.02
    assert said.rows["failed"] == ["paper's scheme"]
    assert "paper's scheme" in section.findings[-1]


@pytest.mark.parametrize(("status", "named"), [("timed out", list(METHODS)), ("not run", None)])
def test_failures_are_named_and_what_was_not_run_is_not(status, named):
    table = made_up(of_0=status, of_1=status, of_2=status)
    said, section, _ = presented(table)
    assert said.rows.get("failed") == named and not section.answer and not section.tables
    assert presented(pd.DataFrame())[0].is_empty
