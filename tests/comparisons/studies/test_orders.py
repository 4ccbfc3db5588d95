"""Observed orders have intervals that hold, and there is none outside of the asymptotic range."""

import numpy as np
import pytest

from stiction.comparisons.bench.study import Scope
from stiction.comparisons.studies.orders import FEWEST, observed_order, plan
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
