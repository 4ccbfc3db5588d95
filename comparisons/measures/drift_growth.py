"""Growth of a residual: a power of time, fitted to root mean squares over octaves of time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from stiction.comparisons.measures.power_law import CONFIDENCE, fitted_exponent
from stiction.uncertain import Uncertain

GROWS = "grows"
"""Verdict: the exponent is significantly above zero."""
BOUNDED = "bounded"
"""Verdict: the residual changes less, and its exponent is smaller, than those of a random walk."""
DECAYS = "decays"
"""Verdict: the residual is not bounded, and the exponent is significantly below zero."""
ROUNDED = "rounding"
"""Verdict: the residual is not larger than rounding errors."""
INCONCLUSIVE = "inconclusive"
"""Verdict: the run is too short for any other, or the residual scatters too much."""
WALKS = 2000
"""Number of random walks from which `walk_spread` is computed."""
SAMPLES_PER_OCTAVE = 32
"""Number of samples of a random walk in each octave."""
MIN_OCTAVES = 3
"""Smallest number of octaves for a fit with a confidence interval."""
WALK_EXPONENT = 0.5
"""Exponent of a random walk, which is the slowest growth of accumulated integration errors."""
START_TOLERANCE = 1e-9
"""Relative tolerance of the earliest beginning of an octave, so that rounding does not exclude the shortest one."""


@dataclass(frozen=True)
class Growth:
    """The power law value ~ time^exponent of a residual.

    Attributes
    ----------
    verdict : str
        `BOUNDED` if `spread` is below 1 and the confidence interval of the exponent is below 1/2;
        otherwise `GROWS` if this interval is above zero, `DECAYS` if it is below zero, and
        `INCONCLUSIVE` if it contains zero. `ROUNDED` if no octaves are above rounding, or only the
        first ones, and these are too few for a fit.
    octaves : tuple of (float, float)
        End of each octave (s), and the root mean square of the residual in it.
    exponent, uncertainty : float
        Exponent by least squares in logarithms of the octaves above rounding, and half the width of
        its confidence interval by Student's distribution; nan if there are too few octaves. The
        interval is valid if the octaves scatter independently. This does not apply to the random
        walk of a rate, ~ time^(3/2), for which it contains the exponent in three of four cases.
    spread : float
        Logarithm of the ratio of the largest to the smallest octave, divided by `walk_spread`.
    """

    verdict: str
    octaves: tuple[tuple[float, float], ...]
    exponent: float = np.nan
    uncertainty: float = np.nan
    spread: float = np.nan


@dataclass(frozen=True)
class _Octave:
    """The residual in one octave of time, (end/2, end].

    Attributes
    ----------
    end : float
        s.
    rms : float
        Root mean square of the residual.
    is_above_rounding : bool
        Whether it is larger than the root mean square of what rounding can cause.
    """

    end: float
    rms: float
    is_above_rounding: bool


def growth(
    t: np.ndarray, values: np.ndarray, first: float, rounding: float | np.ndarray = 0.0
) -> Growth:
    """Determine the law of growth of a sampled residual.

    The law is fitted to the root mean squares over the octaves (T/2, T], (T/4, T/2], .. before the
    end T. Unlike the largest value, the mean of a periodic residual does not depend on its phase,
    and that of noise does not depend on the number of samples.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times, s.
    values : ndarray, shape (n,)
        Sizes of the residual, not negative.
    first : float
        Earliest beginning of an octave, s. Earlier values may be transient, and octaves shorter
        than a period of the motion would not be comparable.
    rounding : float or ndarray, shape (n,)
        Size of the residual that rounding can cause, for all samples or for each.
    """
    rounding_sizes = np.broadcast_to(rounding, np.shape(values))
    octaves = _octaves(t, values, first, rounding_sizes)
    results = tuple((octave.end, octave.rms) for octave in octaves)
    measured = [octave for octave in octaves if octave.is_above_rounding]
    are_first_ones = octaves[: len(measured)] == measured
    can_fit = len(measured) >= MIN_OCTAVES

    # A residual that falls below rounding and stays there has decayed and does not grow.
    if len(values) and np.all(values <= rounding_sizes):
        return Growth(ROUNDED, results)
    has_reached_rounding = are_first_ones and len(measured) < len(octaves)
    if has_reached_rounding and not can_fit:
        return Growth(ROUNDED, results)

    # Fit a power law to the octaves above rounding, which must be successive.
    if not (can_fit and are_first_ones):
        return Growth(INCONCLUSIVE, results)
    ends = np.array([octave.end for octave in measured])
    sizes = np.array([octave.rms for octave in measured])
    law = fitted_exponent([(ends, sizes)])
    if law is None:
        return Growth(INCONCLUSIVE, results)
    spread = float(np.ptp(np.log(sizes))) / walk_spread(len(measured))
    return Growth(_verdict(law, spread), results, law.value, law.uncertainty, spread)


def _octaves(
    t: np.ndarray, values: np.ndarray, first: float, rounding_sizes: np.ndarray
) -> list[_Octave]:
    """Return the octaves of a residual in the order of time; the arguments are those of `growth`.

    The octaves are followed from the last one backwards, to the first one that begins before
    `first`, has no samples, or has one that is not finite.
    """
    octaves: list[_Octave] = []
    if len(t) == 0 or first <= 0:
        return octaves
    end = float(t[-1])
    while end / 2 >= first * (1 - START_TOLERANCE):
        is_inside = (t > end / 2) & (t <= end)
        inside = values[is_inside]
        if len(inside) == 0 or not np.all(np.isfinite(inside)):
            break
        rms = float(np.sqrt(np.mean(inside**2)))
        rounding_rms = float(np.sqrt(np.mean(rounding_sizes[is_inside] ** 2)))
        octaves.append(_Octave(end, rms, rms > rounding_rms))
        end /= 2
    octaves.reverse()
    return octaves


def _verdict(law: Uncertain, spread: float) -> str:
    """Return the verdict on a residual with a fitted exponent, and a spread in units of that of a random walk."""
    # A residual is bounded if both its spread and its exponent are below those of a random walk.
    if spread < 1 and law.value + law.uncertainty < WALK_EXPONENT:
        return BOUNDED
    if law.value > law.uncertainty:
        return GROWS
    if law.value < -law.uncertainty:
        return DECAYS
    return INCONCLUSIVE


@cache
def walk_spread(octaves: int) -> float:
    """Return the spread below which random walks stay with probability (1 - `CONFIDENCE`)/2.

    The spread is the logarithm of the ratio of the largest to the smallest root mean square of all
    `octaves`. The slowest growth that independent errors of integration can cause is that of a
    random walk of the residual, whose mean is ~ time^(1/2). A single walk can stay nearly constant
    for some time. A residual is therefore called bounded only if a random walk would hardly ever
    stay as constant. Brownian motion is the same on all time scales, so that the instants of the
    `WALKS` walks do not matter.
    """
    random = np.random.default_rng(0)
    times = 2.0 ** (np.arange(octaves * SAMPLES_PER_OCTAVE + 1) / SAMPLES_PER_OCTAVE)
    steps = random.normal(size=(WALKS, len(times))) * np.sqrt(np.diff(times, prepend=0.0))
    walks = np.cumsum(steps, axis=1)[:, 1:].reshape(WALKS, octaves, SAMPLES_PER_OCTAVE)
    weights = np.diff(times).reshape(octaves, SAMPLES_PER_OCTAVE)
    sizes = np.sqrt(np.sum(walks**2 * weights, axis=2) / np.sum(weights, axis=1))
    return float(np.quantile(np.ptp(np.log(sizes), axis=1), (1 - CONFIDENCE) / 2))
