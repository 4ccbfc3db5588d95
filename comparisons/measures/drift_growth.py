"""Growth of a residual: a power of time, fitted over octaves of it, with its interval, or a bound."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from stiction.comparisons.measures.power_law import CONFIDENCE, fitted_exponent

GROWS, BOUNDED, ROUNDED, INCONCLUSIVE = "grows", "bounded", "rounding", "inconclusive"
WALKS, PER_OCTAVE = 2000, 32
"""Random walks from which the spread of one is known, and instants of each octave."""
FEWEST = 3
"""Octaves through which a line and its scatter can be found."""
WALK = 0.5
"""Exponent of a random walk, the slowest growth that errors of integration can have."""
ROUNDING = 1e-9
"""Relative rounding of the end of an octave, so that one of just the shortest length counts."""


@dataclass(frozen=True)
class Growth:
    """The law value ~ time^exponent.

    Attributes
    ----------
    exponent, uncertainty : float
        Least squares in logarithms of the octaves above rounding, and half its interval of `CONFIDENCE` by Student's
        distribution; nan where they are too few. The interval holds as often as it says if octaves scatter
        independently. Those of the random walk of a rate, ~ time^(3/2), do not: there it holds in three of four.
    spread : float
        Logarithm of the largest octave over the smallest, in units of its lower limit for a random walk: `walk_spread`.
    verdict : str
        `BOUNDED` where the spread is below 1, and the interval below 1/2; else `GROWS` where the interval
        lies above zero; else `INCONCLUSIVE`: the run is too short. `ROUNDED` where all octaves, or all but the first
        that are too few for a law, are not above what rounding may add.
    octaves : tuple of (float, float)
        End of each octave and the root mean square in it.
    """

    verdict: str
    octaves: tuple[tuple[float, float], ...]
    exponent: float = np.nan
    uncertainty: float = np.nan
    spread: float = np.nan


def growth(
    t: np.ndarray, values: np.ndarray, first: float, rounding: float | np.ndarray = 0.0
) -> Growth:
    """Find the law of growth of sampled values.

    The law is that of root mean squares over octaves (T/2, T], (T/4, T/2], .. before the end T, from `first` on. The
    mean of a periodic residual does not depend on where its largest value is met, that of noise not on the number of
    samples.

    Parameters
    ----------
    t, values : ndarray, shape (n,)
        s, and sizes >= 0.
    first : float
        s; earlier values are transient, and an octave that is shorter would not hold a period.
    rounding : float or ndarray, shape (n,)
        Values up to which rounding may make them, of all samples or of each.
    """
    octaves: list[tuple[float, float]] = []
    above: list[bool] = []
    end = float(t[-1]) if len(t) else 0.0
    limit = np.broadcast_to(rounding, np.shape(values))
    # Octaves from the last one backwards, each with its root mean square and whether that is above
    # rounding.
    while end / 2 >= first * (1 - ROUNDING) > 0:
        within = (t > end / 2) & (t <= end)
        inside = values[within]
        if len(inside) == 0 or not np.all(np.isfinite(inside)):
            break
        octaves.insert(0, (end, float(np.sqrt(np.mean(inside**2)))))
        above.insert(0, octaves[0][1] > np.sqrt(np.mean(limit[within] ** 2)))
        end /= 2

    # Where what is not rounding is followed by rounding, the residual has gone: there is nothing
    # that grows.
    measured = [octave for octave, is_above in zip(octaves, above) if is_above]
    are_successive = all(above[: len(measured)])
    rounding_follows = are_successive and len(measured) < len(octaves)
    if len(values) and np.all(values <= limit) or rounding_follows and len(measured) < FEWEST:
        return Growth(ROUNDED, tuple(octaves))

    # A power law through successive octaves.
    ends, sizes = np.reshape(measured, (-1, 2)).T
    law = fitted_exponent([(ends, sizes)]) if len(measured) >= FEWEST and are_successive else None
    if law is None:
        return Growth(INCONCLUSIVE, tuple(octaves))
    exponent, uncertainty = law.value, law.uncertainty

    # Bounded: steadier than a random walk would be, and slower with the whole interval.
    spread = float(np.ptp(np.log(sizes))) / walk_spread(len(measured))
    if spread < 1 and exponent + uncertainty < WALK:
        verdict = BOUNDED
    elif exponent > uncertainty:
        verdict = GROWS
    else:
        verdict = INCONCLUSIVE
    return Growth(verdict, tuple(octaves), exponent, uncertainty, spread)


@cache
def walk_spread(octaves: int) -> float:
    """Return the spread below which random walks stay with probability (1 - `CONFIDENCE`)/2, over so many octaves.

    The slowest growth that errors of integration can have is that of independent ones, directly in the residual: a
    random walk, ~ time^(1/2) in the mean. A single walk may for a while seem to be bounded: octave by octave it is one
    draw, not a mean. A residual is called bounded only where a walk would hardly ever stay as steady. The instants of
    the `WALKS` walks do not matter: Brownian motion is the same on all scales.
    """
    random = np.random.default_rng(0)
    times = 2.0 ** (np.arange(octaves * PER_OCTAVE + 1) / PER_OCTAVE)
    steps = random.normal(size=(WALKS, len(times))) * np.sqrt(np.diff(times, prepend=0.0))
    walks = np.cumsum(steps, axis=1)[:, 1:].reshape(WALKS, octaves, PER_OCTAVE)
    weights = np.diff(times).reshape(octaves, PER_OCTAVE)
    sizes = np.sqrt(np.sum(walks**2 * weights, axis=2) / np.sum(weights, axis=1))
    return float(np.quantile(np.ptp(np.log(sizes), axis=1), (1 - CONFIDENCE) / 2))
