"""Steady states of sampled motions: the period of the excitation, and motions that have come to repeat themselves."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from stiction.scenes import InputError, Scene, StictionError
from stiction.scenes.laws import Linear, Sine, Table

MOST_PERIODS, LEAST_PASSES = 8, 4
"""Highest order of a subharmonic that is looked for; states that show that they repeat."""
SETTLED = 1e-7
"""In units of the range of x: distance from its limit below which a motion is settled, and change from pass to pass
from which on a run at rtol 1e-9 shows its contraction and not its own errors."""
PASSES = 10
"""Changes from pass to pass, at most, over which the contraction is averaged."""
CREEP_TOLERANCE = 1e-4
"""m/s; a sampled motion slower than this is at rest. A slider that reverses with the accelerations of the paper's
example (0.2 m/s^2 and more) is this slow for 1 ms."""
SHORTEST_STICK = 0.002
"""s; a sampled motion must be slow for so long, and for two steps at least, to count as a stick phase.

The duration of a stick phase goes to zero at the end of a band, so that the band of stick phases that must last ends
earlier. Where events are located, any stick event counts, however short."""
MOST_RATIO, RATIONAL = 64, 1e-9
"""Largest denominator of a ratio of frequencies that have a common period, and how near a ratio must be to it."""


class NoCommonPeriod(InputError):
    """The excitation of a scene is not periodic, so that it has no steady state."""


class NotSettled(StictionError):
    """A motion has no steady state, or a very slow transient."""


def excitation_period(scene: Scene, since: float = 0.0) -> float:
    """Return the smallest period (s) of loads and drives from `since` on; inf where they or their rates are constant.

    Raises
    ------
    NoCommonPeriod
        If a law is not periodic, or the frequencies have no common period (ratios up to 64, to 1e-9).
    """
    rates = []
    for name, element in [*scene.forces.items(), *scene.drives.items()]:
        law = element.law
        if isinstance(law, Sine):
            rates.append(abs(law.frequency))
        elif isinstance(law, Linear) and element.type == "angle":
            rates.append(abs(law.rate))
        elif isinstance(law, Linear) and law.rate and element.type != "distance":
            raise NoCommonPeriod(f"{scene.name}: the law of {name} grows for ever")
        elif isinstance(law, Table) and (law.interpolation == "cubic" or law.times[-1] > since):
            raise NoCommonPeriod(
                f"{scene.name}: the law of {name} is a table that has not come to its end"
            )
    changing = tuple(rate for rate in rates if rate > 0)
    if not changing:
        return np.inf
    ratios = [Fraction(rate / changing[0]).limit_denominator(MOST_RATIO) for rate in changing]
    if any(
        abs(rate / changing[0] - ratio) > RATIONAL or not ratio
        for rate, ratio in zip(changing, ratios)
    ):
        raise NoCommonPeriod(
            f"{scene.name}: frequencies {list(changing)} rad/s have no common period"
        )
    # The greatest common divisor of the ratios: all frequencies are multiples of changing[0] *
    # divisor.
    denominator = int(np.lcm.reduce([ratio.denominator for ratio in ratios]))
    numerators = [int(ratio * denominator) for ratio in ratios]
    divisor = Fraction(int(np.gcd.reduce(numerators)), denominator)
    return float(2 * np.pi / (changing[0] * float(divisor)))


def common_period(scene: Scene) -> float:
    """Return `excitation_period`; a constant excitation has none."""
    if (period := excitation_period(scene)) == np.inf:
        raise NoCommonPeriod(
            f"{scene.name}: no sine law or turning drive; expected a periodic excitation"
        )
    return period


@dataclass(frozen=True)
class Settled:
    """A motion at the common period's multiples: its `order` in periods, and the distance that is left to its limit.

    The distance is d / (1 - r) in units of the range. The last change from pass to pass is d; r is the ratio of
    successive changes above a floor.
    """

    order: int
    distance: float


def settled(
    x: np.ndarray,
    distance: float = SETTLED,
    floor: float = SETTLED,
    orders: Iterable[int] = range(1, MOST_PERIODS + 1),
    size: float | None = None,
) -> Settled | None:
    """Find the way in which states at successive multiples of a period repeat themselves; None if they do not.

    Parameters
    ----------
    x : ndarray, shape (n,) or (n, coordinates)
    distance, floor : float
        From the limit, below which they have; and the change that the contraction is measured above.
    orders : iterable of int
        Orders of the subharmonics that are looked for.
    size : float, optional
        Unit of both; the range of x if not given.
    """
    size = size or float(np.ptp(x)) or float(np.max(np.abs(x))) or 1.0
    for order in orders:
        passes = len(x) // order
        if passes < LEAST_PASSES:
            return None
        states = x[-passes * order :].reshape(passes, -1)
        change = np.max(np.abs(np.diff(states, axis=0)), axis=1) / size
        # Contraction from pass to pass: the mean over the last changes that are not a run's own
        # errors.
        above = np.flatnonzero(change > floor)
        last = int(above[-1]) if len(above) else 0
        first = max(last - PASSES, 0)
        ratio = 0.0
        if last > first:
            ratio = float(change[last] / change[first]) ** (1 / (last - first))
        # What is left is a geometric series.
        if ratio < 1 and change[-1] / (1 - ratio) <= distance:
            return Settled(order, float(change[-1]) / (1 - ratio))
    return None
