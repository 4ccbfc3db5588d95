"""Medians of times with intervals that assume no distribution, and ratios of them.

For independent samples of one continuous distribution the k-th smallest and the k-th largest of n enclose its median
with probability 1 - 2 P(B <= k - 1), B binomial with n trials of 1/2 (David & Nagaraja, Order Statistics, 3rd ed.,
2003, Sect. 7.1). Five samples have 0.9375 by their smallest and largest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

CONFIDENCE = 0.9
"""Least level of an interval that separates two medians; five samples reach it, four do not."""


@dataclass(frozen=True)
class Interval:
    """Interval of a median, in the unit of the samples; nan without any.

    The level is the probability with which it encloses the median: at least `CONFIDENCE` where there are enough
    samples; 0 for one.
    """

    value: float
    low: float
    high: float
    level: float
    samples: int

    @property
    def width(self) -> float:
        """Width in units of the median; infinite where the level is below `CONFIDENCE`."""
        if self.level < CONFIDENCE or not self.value > 0:
            return math.inf
        return (self.high - self.low) / self.value


def median_interval(samples: Sequence[float]) -> Interval:
    """Return the median with the narrowest interval of `CONFIDENCE` by order statistics, else the widest."""
    n, ordered = len(samples), np.sort(np.asarray(samples, dtype=float))
    if n == 0 or not np.all(np.isfinite(ordered)):
        return Interval(math.nan, math.nan, math.nan, 0.0, n)
    k, level = _rank(n)
    return Interval(
        float(np.median(ordered)), float(ordered[k - 1]), float(ordered[n - k]), level, n
    )


@cache
def _rank(n: int) -> tuple[int, float]:
    """Rank k of the narrowest interval of n samples that reaches `CONFIDENCE`, else of the widest, and its level."""
    # 1 - 2 P(B <= k - 1); it falls with k, as the interval becomes narrower
    levels = {
        k: max(0.0, 1 - 2 * sum(math.comb(n, below) for below in range(k)) / 2**n)
        for k in range(1, (n + 1) // 2 + 1)
    }
    narrowest = max((k for k, level in levels.items() if level >= CONFIDENCE), default=1)
    return narrowest, levels[narrowest]


def ratio_interval(over: Sequence[float], under: Sequence[float]) -> Interval:
    """Interval of the ratio of two times, from the ratio of each round: what slows a machine down slows down both.

    Rounds that only one of them has are left out.
    """
    return median_interval([a / b for a, b in zip(over, under)])
