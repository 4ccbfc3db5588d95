"""Exponents of power laws, fitted in logarithms."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from stiction.uncertain import Uncertain

CONFIDENCE = 0.95
"""Probability of the interval of an exponent."""


def fitted_exponent(series: Sequence[tuple[np.ndarray, np.ndarray]]) -> Uncertain | None:
    """Fit sizes ~ constant * steps^exponent by least squares: one exponent for all series, a constant for each.

    Parameters
    ----------
    series
        Pairs of steps and sizes, positive.

    Returns
    -------
    Uncertain or None
        With half the width of its interval of `CONFIDENCE`, by Student's distribution, from the scatter about the
        fit. None with no more points than the fit has unknowns.
    """
    free = sum(len(steps) for steps, _ in series) - len(series) - 1
    if free < 1:
        return None
    x, y = (
        np.concatenate([np.log(part) - np.log(part).mean() for part in parts])
        for parts in zip(*series)
    )
    exponent = float(x @ y / (x @ x))
    scatter = math.sqrt(float(np.sum((y - exponent * x) ** 2)) / free / float(x @ x))
    return Uncertain(exponent, float(student.ppf((1 + CONFIDENCE) / 2, free)) * scatter)
