"""Exponents of power laws, fitted in logarithms."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from stiction.uncertain import Uncertain

CONFIDENCE = 0.95
"""Level of the confidence interval of an exponent."""


def fitted_exponent(series: Sequence[tuple[np.ndarray, np.ndarray]]) -> Uncertain | None:
    """Fit sizes = constant * steps^exponent by least squares in logarithms.

    Parameters
    ----------
    series : sequence of (ndarray, ndarray)
        Steps and sizes, positive. All series have the same exponent, and each has a constant of its
        own.

    Returns
    -------
    Uncertain or None
        The exponent, with half the width of its confidence interval as uncertainty, which is
        computed from the scatter about the fit by Student's distribution. None if there are not
        more points than unknowns.
    """
    degrees_of_freedom = sum(len(steps) for steps, _ in series) - len(series) - 1
    if degrees_of_freedom < 1:
        return None
    # With the mean of each series subtracted, the constants vanish from the fit.
    x = np.concatenate([np.log(steps) - np.log(steps).mean() for steps, _ in series])
    y = np.concatenate([np.log(sizes) - np.log(sizes).mean() for _, sizes in series])
    exponent = float(x @ y / (x @ x))
    residual_square = float(np.sum((y - exponent * x) ** 2))
    standard_error = math.sqrt(residual_square / degrees_of_freedom / float(x @ x))
    quantile = float(student.ppf((1 + CONFIDENCE) / 2, degrees_of_freedom))
    return Uncertain(exponent, quantile * standard_error)
