"""Steady states of sampled motions: the period of the excitation, and when a motion has become periodic."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from stiction.scenes import InputError, Scene, StictionError
from stiction.scenes.laws import Linear, Sine, constant_from, law_terms

MOST_PERIODS = 8
"""Highest order of a subharmonic, that is, the largest number of periods of the excitation in a
period of the motion."""
LEAST_PASSES = 4
"""Smallest number of states, one period of the motion apart, from which a steady state can be
recognized."""
SETTLED = 1e-7
"""Largest distance of a steady motion from its limit, relative to the range of x. It is also the
smallest change from period to period that is not attributed to integration errors, which are
smaller at rtol = 1e-9."""
PASSES = 10
"""Largest number of changes from period to period over which the contraction is averaged."""
MOST_RATIO = 64
"""Largest denominator of the ratio of two frequencies with a common period."""
RATIONAL = 1e-9
"""Largest difference of a ratio of frequencies from a rational number."""
CREEP_TOLERANCE = 1e-4
"""Largest speed, m/s, of a sampled motion that is at rest.

A slider that reverses with the accelerations of the paper's example (0.2 m/s^2 and more) is this slow for 1 ms."""
SHORTEST_STICK = 0.002
"""Shortest time, s, for which a sampled motion must be slow to count as a stick phase; at least two steps.

The duration of a stick phase goes to zero at the end of a band, so that the band of stick phases that must last ends
earlier. Where events are located, any stick event counts, however short."""


class NoCommonPeriod(InputError):
    """The error of a scene whose excitation is not periodic, so that there is no steady state."""


class NotSettled(StictionError):
    """The error of a motion that does not reach a steady state, or only after a very long transient."""


def excitation_period(scene: Scene, since: float = 0.0) -> float:
    """Return the smallest common period of loads and drives from a time on, s; inf if they are constant.

    Drives with a constant rate count as constant, except rotating ones.

    Parameters
    ----------
    scene : Scene
    since : float
        Time from which on the laws must be periodic, s.

    Raises
    ------
    NoCommonPeriod
        If a law is not periodic, or the frequencies have no common period (ratios up to 64, to
        1e-9).
    """
    frequencies = []
    for name, element in [*scene.forces.items(), *scene.drives.items()]:
        for law in law_terms(element.law):
            if isinstance(law, Sine):
                frequencies.append(abs(law.frequency))
            elif isinstance(law, Linear) and element.type == "angle":
                frequencies.append(abs(law.rate))
            elif isinstance(law, Linear) and law.rate and element.type != "distance":
                raise NoCommonPeriod(f"{scene.name}: the law of {name} grows for ever")
            elif not isinstance(law, Linear) and constant_from(law) > since:
                raise NoCommonPeriod(
                    f"{scene.name}: the law of {name} is a {law.type} that has not come to its end"
                )
    frequencies = [frequency for frequency in frequencies if frequency > 0]
    if not frequencies:
        return np.inf
    # The frequencies must be rational multiples of the first one.
    first = frequencies[0]
    ratios = []
    for frequency in frequencies:
        ratio = Fraction(frequency / first).limit_denominator(MOST_RATIO)
        if ratio == 0 or abs(frequency / first - ratio) > RATIONAL:
            raise NoCommonPeriod(
                f"{scene.name}: frequencies {frequencies} rad/s have no common period"
            )
        ratios.append(ratio)
    # The fundamental frequency is the first one times the greatest common divisor of the ratios.
    denominator = int(np.lcm.reduce([ratio.denominator for ratio in ratios]))
    numerators = [int(ratio * denominator) for ratio in ratios]
    divisor = Fraction(int(np.gcd.reduce(numerators)), denominator)
    return float(2 * np.pi / (first * float(divisor)))


def common_period(scene: Scene) -> float:
    """Return `excitation_period`, s; NoCommonPeriod also if the excitation is constant."""
    period = excitation_period(scene)
    if period == np.inf:
        raise NoCommonPeriod(
            f"{scene.name}: no sine law or turning drive; expected a periodic excitation"
        )
    return period


@dataclass(frozen=True)
class Settled:
    """A motion that has become periodic.

    Attributes
    ----------
    order : int
        Its period in units of the period of the excitation.
    distance : float
        Estimated distance from its limit, relative to the range: d / (1 - r), where d is the last
        change from period to period and r the ratio of successive changes, which form a geometric
        series.
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
    """Test if states at successive multiples of the excitation's period have become periodic; None if not.

    Parameters
    ----------
    x : ndarray, shape (n,) or (n, coordinates)
        The states.
    distance : float
        Largest distance from the limit, relative to `size`.
    floor : float
        Change from period to period, relative to `size`, above which the ratio of changes is
        computed.
    orders : iterable of int
        Orders of subharmonics that are tried, in ascending order.
    size : float, optional
        The range of x by default.
    """
    size = size or float(np.ptp(x)) or float(np.max(np.abs(x))) or 1.0
    for order in orders:
        passes = len(x) // order
        if passes < LEAST_PASSES:
            return None
        states = x[-passes * order :].reshape(passes, -1)
        change = np.max(np.abs(np.diff(states, axis=0)), axis=1) / size
        # Ratio of successive changes: the geometric mean over the last changes above the floor.
        above = np.flatnonzero(change > floor)
        last = int(above[-1]) if len(above) else 0
        first = max(last - PASSES, 0)
        ratio = 0.0
        if last > first:
            # A motion that begins to change after a time of rest is not about to settle.
            ratio = np.inf
            if change[first] > 0:
                ratio = float(change[last] / change[first]) ** (1 / (last - first))
        # The sum of all further changes is that of a geometric series.
        if ratio < 1 and change[-1] / (1 - ratio) <= distance:
            return Settled(order, float(change[-1]) / (1 - ratio))
    return None
