"""Slip of a held slider: steady creep, landing, break-away under a slow ramp, and what follows it.

A run is reduced to a few numbers, a truth in the same way, so that what the definitions themselves take is in both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.stats import theilslopes

from stiction.uncertain import Uncertain

LANDING = 0.1
"""Seconds after the start in which a slider settles on its contacts; its displacement until then is no creep."""
LET_GO = 1e-3
"""m/s: a slider has let go once it is faster. That is what it gains in the first step of 1 ms, g (mus - mu) dt with
coefficients of 0.3 and 0.2; a load that creeps as fast is not held."""
AFTER = 0.05
"""Seconds after letting go over which the acceleration is taken."""
INSTANTS = 300
"""At most, for a slope: it is the median over all pairs."""
STEADY = 1.5
"""Ratio of the speed at the end to the creep from which on it is no steady one: of constant acceleration it is 1.8."""
SURE = 5.0
"""Standard deviations of medians beyond which a mean speed is another than the slope."""
LEVEL = 0.95
"""Level of the interval of a slope."""
TENTH = 10
"""A mean speed is that between medians of a part of the instants, their number over this."""
LAST = 0.95
"""Part of the run behind which the speed is that at the end."""
NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""
MEDIANS = 1.2533
"""Standard deviation of a median over that of a mean, sqrt(pi / 2), of normal samples."""
ROUNDING = 1e-9
"""Relative rounding of times, so that an instant at the end of an interval belongs to it."""


@dataclass(frozen=True)
class Slip:
    """Numbers of the slip of one run.

    Attributes
    ----------
    creep : Uncertain
        Steady slip velocity after the landing, m/s; 0 where the displacement does not exceed its rounding.
    lets_go : bool
        Whether the slider is fast at the end, and faster there than steady creep is.
    landing : float
        Displacement during the landing, m.
    let_go : float or None
        Time at which the slider is faster than `LET_GO` for the first time after the landing, s; None if never.
    acceleration : float or None
        Mean over `AFTER` from then on, m/s^2.
    """

    creep: Uncertain
    lets_go: bool
    landing: float
    let_go: float | None
    acceleration: float | None


def slip_of(
    t: np.ndarray,
    displacement: np.ndarray,
    velocity: np.ndarray,
    rounding: float = 0.0,
    *,
    landed: float = LANDING,
    period: float | None = None,
) -> Slip:
    """Reduce a motion along a guide to the numbers of its slip.

    The creep is the slope of Theil and Sen: the median of the slopes between all pairs of instants after the landing. A
    few outliers do not change it. Its uncertainty is half of the longer side of the interval of `LEVEL` (Sen 1968, J.
    Am. Stat. Assoc. 63, 1379-1389), and the rounding. Where the mean speed in the second half, between medians of a
    tenth, is farther off, as of a slider that lets go late, that is the creep, and the distance its uncertainty. Under
    a load of this period the slope is of means over it.

    Parameters
    ----------
    t : ndarray, shape (n,)
        s, from the start on.
    displacement, velocity : ndarray, shape (n,)
        m and m/s, positive along the load.
    rounding : float
        Bound of what rounding adds to a displacement over the run, m.
    landed : float
        Seconds that the landing takes.
    period : float, optional
        Seconds; the instants after the landing span more than it.
    """
    after = t >= landed * (1 - ROUNDING)
    times, place = t[after], displacement[after]
    first = float(place[0])
    if period is not None:
        # Means over one period from each instant on: what a periodic load moves to and fro cancels.
        integral = cumulative_trapezoid(place - first, times, initial=0.0)
        starts = times[times + period <= times[-1] * (1 + ROUNDING)]
        over_period = np.interp(starts + period, times, integral) - np.interp(
            starts, times, integral
        )
        place = first + over_period / period
        times = starts
    floor = rounding / float(times[-1] - times[0])
    creep, steady = Uncertain(0.0, floor), 0.0
    if np.ptp(place) > rounding:
        every = math.ceil(len(times) / INSTANTS)
        slope, _, low, high = theilslopes(place[::every], times[::every], LEVEL)
        steady = abs(float(slope))
        creep = Uncertain(float(slope), max(float(high - slope), float(slope - low)) + floor)

        # Is the slope that of the second half, too? Its mean speed is that between the medians of
        # two tenths of the instants; what a tenth scatters about the slope says how well that mean
        # is known.
        tenth = math.ceil(len(times) / TENTH)
        half, rest = len(times) // 2, place - slope * times
        early, late = slice(half, half + tenth), slice(-tenth, None)
        begins, ends = float(np.median(times[early])), float(np.median(times[late]))
        gained = float(np.median(rest[late])) - float(np.median(rest[early]))
        mean = float(slope) + gained / (ends - begins)
        scatter = NORMAL * float(np.median(np.abs(rest - np.median(rest))))
        of_medians = MEDIANS * scatter * math.sqrt(2 / tenth) / (ends - begins)
        if abs(mean - creep.value) > creep.uncertainty + SURE * of_medians:
            creep = Uncertain(mean, abs(mean - creep.value))

    # A slider that creeps fast is not one that lets go: at the end it must be faster than its own
    # creep.
    at_end = float(np.median(np.abs(velocity[t >= LAST * t[-1]])))
    lets_go = at_end > max(LET_GO, STEADY * steady)
    let_go = _let_go(t[after], np.abs(velocity[after]))
    acceleration = None
    if let_go is not None and let_go + AFTER <= t[-1]:
        acceleration = (abs(float(np.interp(let_go + AFTER, t, velocity))) - LET_GO) / AFTER
    return Slip(creep, lets_go, first - float(displacement[0]), let_go, acceleration)


def _let_go(t: np.ndarray, speed: np.ndarray) -> float | None:
    """The first instant at which the speed exceeds `LET_GO`, between samples by a straight line."""
    fast = np.flatnonzero(speed > LET_GO)
    if not len(fast):
        return None
    i = int(fast[0])
    if i == 0:
        return float(t[0])
    return float(np.interp(LET_GO, speed[i - 1 : i + 1], t[i - 1 : i + 1]))
