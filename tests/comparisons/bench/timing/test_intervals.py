"""Intervals of medians cover as often as they say, for any distribution. No clock."""

import numpy as np
import pytest

from stiction.comparisons.bench.timing.intervals import CONFIDENCE, median_interval, ratio_interval

RUNS = 4000


@pytest.mark.parametrize(
    "draw, median",
    [
        (lambda random, shape: random.lognormal(0.0, 1.0, shape), 1.0),
        (lambda random, shape: random.exponential(1.0, shape), np.log(2)),
        (lambda random, shape: 1 + random.pareto(1.5, shape), 2 ** (1 / 1.5)),
    ],
)
@pytest.mark.parametrize("n", [5, 6, 8, 11, 15])
def test_interval_covers_the_median_as_often_as_it_says(draw, median, n):
    found = [median_interval(samples) for samples in draw(np.random.default_rng(n), (RUNS, n))]
    level = found[0].level
    covered = np.mean([interval.low <= median <= interval.high for interval in found])
    assert level >= CONFIDENCE and covered == pytest.approx(
        level, abs=4 * np.sqrt(level * (1 - level) / RUNS)
    )


@pytest.mark.parametrize(
    "n, level",
    [(0, 0.0), (1, 0.0), (2, 0.5), (3, 0.75), (4, 0.875), (5, 0.9375), (8, 1 - 2 * 9 / 256)],
)
def test_level_is_that_of_order_statistics(n, level):
    found = median_interval(range(n))
    assert found.level == pytest.approx(level) and found.samples == n
    assert n < 5 and found.width == np.inf or n >= 5 and found.width < np.inf


def test_a_machine_that_slows_down_cancels_from_a_ratio():
    slower = np.linspace(1.0, 3.0, 9) * (1 + 1e-3 * np.random.default_rng(0).normal(size=9))
    found = ratio_interval(2.0 * slower, slower)
    assert (found.value, found.low, found.high) == pytest.approx(
        (2.0, 2.0, 2.0)
    ) and found.level >= CONFIDENCE
    by_round = ratio_interval([3.0, 1.0, 2.0, 5.0, 4.0], [1.0, 2.0, 3.0, 4.0, 5.0])
    # of each round, not of sorted times, which would all be 1
    assert (by_round.low, by_round.value, by_round.high) == (0.5, 0.8, 3.0)
    assert (
        median_interval(2.0 * slower).low < median_interval(slower).high
    )  # as times they say nothing
