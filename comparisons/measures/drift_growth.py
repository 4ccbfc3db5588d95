"""Growth of a residual: a power of time, fitted to root mean squares over octaves of time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from stiction.comparisons.measures.power_law import CONFIDENCE, fitted_exponent

GROWS = "grows"
"""Verdict: the exponent is significantly above zero."""
BOUNDED = "bounded"
"""Verdict: the residual changes less, and its exponent is smaller, than those of a random walk."""
ROUNDED = "rounding"
"""Verdict: the residual is not larger than rounding errors."""
INCONCLUSIVE = "inconclusive"
"""Verdict: the run is too short for any other."""
WALKS = 2000
"""Number of random walks from which `walk_spread` is computed."""
PER_OCTAVE = 32
"""Number of samples of a random walk in each octave."""
FEWEST = 3
"""Smallest number of octaves for a fit with a confidence interval."""
WALK = 0.5
"""Exponent of a random walk, which is the slowest growth of accumulated integration errors."""
ROUNDING = 1e-9
"""Relative tolerance of the end of an octave, so that rounding does not exclude the shortest
one."""


@dataclass(frozen=True)
class Growth:
    """The power law value ~ time^exponent of a residual.

    Attributes
    ----------
    verdict : str
        `BOUNDED` if `spread` is below 1 and the confidence interval of the exponent is below 1/2;
        otherwise `GROWS` if this interval is above zero; otherwise `INCONCLUSIVE`. `ROUNDED` if no
        octaves are above rounding, or only the first ones, and these are too few for a fit.
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
    octaves: list[tuple[float, float]] = []
    above: list[bool] = []
    end = float(t[-1]) if len(t) else 0.0
    limit = np.broadcast_to(rounding, np.shape(values))
    # Root mean square of each octave, from the last one backwards, and whether it is above
    # rounding.
    while end / 2 >= first * (1 - ROUNDING) > 0:
        within = (t > end / 2) & (t <= end)
        inside = values[within]
        if len(inside) == 0 or not np.all(np.isfinite(inside)):
            break
        octaves.insert(0, (end, float(np.sqrt(np.mean(inside**2)))))
        above.insert(0, octaves[0][1] > np.sqrt(np.mean(limit[within] ** 2)))
        end /= 2

    # If only the first octaves are above rounding, the residual has decayed and does not grow.
    measured = [octave for octave, is_above in zip(octaves, above) if is_above]
    are_successive = all(above[: len(measured)])
    rounding_follows = are_successive and len(measured) < len(octaves)
    if len(values) and np.all(values <= limit) or rounding_follows and len(measured) < FEWEST:
        return Growth(ROUNDED, tuple(octaves))

    # Fit a power law to the octaves above rounding, which must be successive.
    ends, sizes = np.reshape(measured, (-1, 2)).T
    law = fitted_exponent([(ends, sizes)]) if len(measured) >= FEWEST and are_successive else None
    if law is None:
        return Growth(INCONCLUSIVE, tuple(octaves))
    exponent, uncertainty = law.value, law.uncertainty

    # A residual is bounded if both its spread and its exponent are below those of a random walk.
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

    The slowest growth that errors of integration can have is that of independent ones, directly in
    the residual: a random walk, ~ time^(1/2) in the mean. A single walk may for a while seem to be
    bounded: octave by octave it is one draw, not a mean. A residual is called bounded only where a
    walk would hardly ever stay as steady. The instants of the `WALKS` walks do not matter: Brownian
    motion is the same on all scales.
    """
    random = np.random.default_rng(0)
    times = 2.0 ** (np.arange(octaves * PER_OCTAVE + 1) / PER_OCTAVE)
    steps = random.normal(size=(WALKS, len(times))) * np.sqrt(np.diff(times, prepend=0.0))
    walks = np.cumsum(steps, axis=1)[:, 1:].reshape(WALKS, octaves, PER_OCTAVE)
    weights = np.diff(times).reshape(octaves, PER_OCTAVE)
    sizes = np.sqrt(np.sum(walks**2 * weights, axis=2) / np.sum(weights, axis=1))
    return float(np.quantile(np.ptp(np.log(sizes), axis=1), (1 - CONFIDENCE) / 2))
