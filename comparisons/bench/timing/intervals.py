"""Medians of measured times, with distribution-free confidence intervals.

Let n samples be independent and have the same continuous distribution. The interval from the k-th
smallest to the k-th largest sample then contains the median of the distribution with probability 1
- 2 P(B <= k - 1), where B is binomial with n trials and probability 1/2 (David & Nagaraja, Order
Statistics, 3rd ed., 2003, Sect. 7.1). For n = 5 and k = 1 this probability is 0.9375.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

CONFIDENCE = 0.9
"""Required level of an interval; five samples reach it, four do not."""


@dataclass(frozen=True)
class Interval:
    """A median with its confidence interval.

    Attributes
    ----------
    value, low, high : float
        Median and ends of the interval, in the unit of the samples; nan if there are no samples.
    level : float
        Probability that the interval contains the median: at least `CONFIDENCE` if there are enough
        samples, 0 for a single sample.
    samples : int
        Number of samples.
    """

    value: float
    low: float
    high: float
    level: float
    samples: int

    @property
    def width(self) -> float:
        """Width relative to the median; inf if the level is below `CONFIDENCE`."""
        if self.level < CONFIDENCE or not self.value > 0:
            return math.inf
        return (self.high - self.low) / self.value


def median_interval(samples: Sequence[float]) -> Interval:
    """Return the median of samples with the narrowest interval that reaches `CONFIDENCE`.

    If there are too few samples, the interval is the widest one, from the smallest to the largest
    sample. If there are none, or if a sample is not finite, all numbers are nan.
    """
    ordered = np.sort(np.asarray(samples, dtype=float))
    n = len(ordered)
    if n == 0 or not np.all(np.isfinite(ordered)):
        return Interval(math.nan, math.nan, math.nan, 0.0, n)
    k, level = _rank_and_level(n)
    low = float(ordered[k - 1])
    high = float(ordered[n - k])
    return Interval(float(np.median(ordered)), low, high, level, n)


@cache
def _rank_and_level(n: int) -> tuple[int, float]:
    """Return the largest k for which the interval of n samples reaches `CONFIDENCE`, else 1, and its level."""
    rank = 1
    level = _level(n, 1)
    # The level decreases with k, because the interval becomes narrower.
    for k in range(2, (n + 1) // 2 + 1):
        if _level(n, k) < CONFIDENCE:
            break
        rank = k
        level = _level(n, k)
    return rank, level


def _level(n: int, k: int) -> float:
    """Return 1 - 2 P(B <= k - 1), or 0 if rounding makes it negative."""
    outside = sum(math.comb(n, below) for below in range(k)) / 2**n
    return max(0.0, 1 - 2 * outside)


def ratio_interval(numerators: Sequence[float], denominators: Sequence[float]) -> Interval:
    """Return the median of the ratio of two times, with its interval, from the ratio in each round.

    The ratios of single rounds are used because a slow machine slows down both times of a round. If
    one sequence is longer, its additional samples are ignored.
    """
    ratios = [numerator / denominator for numerator, denominator in zip(numerators, denominators)]
    return median_interval(ratios)
