"""Whether a residual grows, and how fast: a power of time, fitted over octaves of it, with its interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

GROWS, BOUNDED, ROUNDED, NOT_TOLD = "grows", "bounded", "rounding", "not told"
SLOWEST = 0.5
"""Exponent of the slowest growth that errors of integration can have: independent ones, which add up as a random walk, directly in the residual.
In its rate they give 3/2, errors of one sign 1 and 2."""
CONFIDENCE = 0.95
FEWEST = 3
"""Octaves through which a line and its scatter can be found."""


@dataclass(frozen=True)
class Growth:
    """The law value ~ time^exponent.

    Attributes
    ----------
    exponent, uncertainty : float
        Least squares in logarithms, and half its interval of `CONFIDENCE` by Student's distribution; nan where there are too few octaves.
    verdict : str
        `BOUNDED` where the interval lies below `SLOWEST`; `GROWS` where it lies above zero; else `NOT_TOLD`: the run is too short. `ROUNDED`
        where the values are those of rounding, so that no law is read from them.
    octaves : tuple of (float, float)
        End of each octave and the root mean square in it.
    """

    exponent: float
    uncertainty: float
    verdict: str
    octaves: tuple[tuple[float, float], ...]


def growth(t: np.ndarray, values: np.ndarray, first: float, rounding: float = 0.0) -> Growth:
    """The law of growth of sampled values.

    Root mean squares over octaves (T/2, T], (T/4, T/2], .., T the end of the run, down to ones that begin at `first` at the earliest: the
    mean of a periodic residual does not depend on where its largest value is met, and that of noise not on the number of samples.

    Parameters
    ----------
    t, values : ndarray, shape (n,)
        s, and sizes >= 0.
    first : float
        s; what is before it is transient, and an octave that is shorter would not hold a period.
    rounding : float
        Values up to which rounding makes them.
    """
    octaves, end = [], float(t[-1]) if len(t) else 0.0
    while end / 2 >= first * (1 - 1e-9) > 0:
        inside = values[(t > end / 2) & (t <= end)]
        if len(inside) == 0 or not np.all(np.isfinite(inside)):
            break
        octaves.append((end, float(np.sqrt(np.mean(inside ** 2)))))
        end /= 2
    octaves.reverse()
    if len(values) and np.all(values <= rounding):
        return Growth(float("nan"), float("nan"), ROUNDED, tuple(octaves))
    if len(octaves) < FEWEST or min(size for _, size in octaves) <= 0:
        return Growth(float("nan"), float("nan"), NOT_TOLD, tuple(octaves))
    x, y = np.log([time for time, _ in octaves]), np.log([size for _, size in octaves])
    slope, offset = np.polyfit(x, y, 1)
    scatter = float(np.sum((y - slope * x - offset) ** 2)) / (len(x) - 2)
    half = float(student.ppf((1 + CONFIDENCE) / 2, len(x) - 2) * np.sqrt(scatter / np.sum((x - x.mean()) ** 2)))
    verdict = BOUNDED if slope + half < SLOWEST else GROWS if slope - half > 0 else NOT_TOLD
    return Growth(float(slope), half, verdict, tuple(octaves))
