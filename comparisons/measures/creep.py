"""Slip of a slider that is held by static friction: landing, steady creep, break-away and acceleration after it.

Runs and truths are reduced to numbers by the same functions, so that errors of the definitions
affect both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.stats import theilslopes

from stiction.scenes import Scene, Trajectory
from stiction.scenes.fields import GROUND
from stiction.uncertain import Uncertain

LANDING = 0.1
"""Duration of the landing, s: the slider settles on its contacts, and this displacement is not
creep."""
LET_GO = 1e-3
"""Speed above which a slider has broken away, m/s. It is the speed after the first step of 1 ms, g
(mus - mu) dt with coefficients of 0.3 and 0.2. A slider that creeps at this speed is not held
either."""
AFTER = 0.05
"""Time after the break-away over which the mean acceleration is computed, s."""
INSTANTS = 300
"""Largest number of samples for a slope, which is the median over all pairs of samples."""
STEADY = 1.5
"""Ratio of the final speed to the creep above which the creep is not steady. It is 1.8 for constant
acceleration."""
SURE = 5.0
"""Number of standard deviations above which a mean speed differs significantly from the slope."""
LEVEL = 0.95
"""Level of the confidence interval of a slope."""
TENTH = 10
"""The mean speed is computed between the medians of two groups of samples, each of which is one
tenth of all."""
LAST = 0.95
"""Fraction of the run after which samples count for the final speed."""
NORMAL = 1.4826
"""Standard deviation of a normal distribution divided by its median absolute deviation."""
MEDIANS = 1.2533
"""Standard deviation of the median of normal samples divided by that of their mean, sqrt(pi /
2)."""
ROUNDING = 1e-9
"""Relative tolerance of times, so that a sample at the end of an interval belongs to it in spite of
rounding."""


@dataclass(frozen=True)
class Slip:
    """The slip of one run.

    Attributes
    ----------
    creep : Uncertain
        Steady slip velocity after the landing, m/s; 0 if the displacement does not exceed its
        rounding error.
    lets_go : bool
        True if the final speed is above `LET_GO`, and well above the steady creep.
    landing : float
        Displacement during the landing, m.
    let_go : float or None
        First time after the landing at which the speed exceeds `LET_GO`, s; None if it never does.
    acceleration : float or None
        Mean acceleration over `AFTER` from this time on, m/s^2; None if the run ends before.
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

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times from the start on, s.
    displacement, velocity : ndarray, shape (n,)
        m and m/s, positive in the direction of the load.
    rounding : float
        Bound of the rounding error of a displacement over the run, m.
    landed : float
        Duration of the landing, s.
    period : float, optional
        Period of the load, s, which must be shorter than the time after the landing. The creep is
        then computed from moving averages of the displacement over one period.

    Notes
    -----
    The creep is the Theil-Sen slope, the median of the slopes between all pairs of samples
    after the landing, which is insensitive to a few outliers. Its uncertainty is the longer side of
    its confidence interval (Sen 1968, J. Am. Stat. Assoc. 63, 1379-1389), plus the rounding error.
    If the mean speed in the second half of the run differs from it significantly, for example
    because the slider breaks away late, the creep is this mean speed instead, and its uncertainty
    is the difference.
    """
    after = t >= landed * (1 - ROUNDING)
    times, positions = t[after], displacement[after]
    first = float(positions[0])
    if period is not None:
        times, positions = _moving_average(times, positions, period)
    velocity_rounding = rounding / float(times[-1] - times[0])
    creep, slope = Uncertain(0.0, velocity_rounding), 0.0
    if np.ptp(positions) > rounding:
        creep = _slope(times, positions, velocity_rounding)
        slope = creep.value
        mean = _second_half_speed(times, positions, slope)
        if abs(mean.value - slope) > creep.uncertainty + SURE * mean.uncertainty:
            creep = Uncertain(mean.value, abs(mean.value - slope))

    # A slider that creeps at a high but steady speed has not broken away.
    final_speed = float(np.median(np.abs(velocity[t >= LAST * t[-1]])))
    lets_go = final_speed > max(LET_GO, STEADY * abs(slope))
    let_go = _let_go_time(t[after], np.abs(velocity[after]))
    acceleration = None
    if let_go is not None and let_go + AFTER <= t[-1]:
        acceleration = (abs(float(np.interp(let_go + AFTER, t, velocity))) - LET_GO) / AFTER
    return Slip(creep, lets_go, first - float(displacement[0]), let_go, acceleration)


def joint_displacement(
    scene: Scene, columns: Mapping[str, np.ndarray] | Trajectory, name: str
) -> np.ndarray:
    """Return the displacement of a joint in the columns of a motion: along a guide (m), or the angle of a pin (rad)."""
    if name in scene.guides:
        return columns[f"{name}.displacement"]
    first, second = (
        np.zeros(()) if body == GROUND else columns[f"{body}.angle"]
        for body in scene.pins[name].bodies
    )
    return np.asarray(first - second)


def _moving_average(
    times: np.ndarray, positions: np.ndarray, period: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return times at which a period begins, and the mean position over each of these periods.

    The mean of the oscillation under a periodic load does not depend on the beginning of the
    period.
    """
    first = float(positions[0])
    integral = cumulative_trapezoid(positions - first, times, initial=0.0)
    starts = times[times + period <= times[-1] * (1 + ROUNDING)]
    integral_at_end = np.interp(starts + period, times, integral)
    over_period = integral_at_end - np.interp(starts, times, integral)
    return starts, first + over_period / period


def _slope(times: np.ndarray, positions: np.ndarray, velocity_rounding: float) -> Uncertain:
    """Return the Theil-Sen slope of at most `INSTANTS` samples, m/s."""
    every = math.ceil(len(times) / INSTANTS)
    slope, _, low, high = theilslopes(positions[::every], times[::every], LEVEL)
    longer_side = max(float(high - slope), float(slope - low))
    return Uncertain(float(slope), longer_side + velocity_rounding)


def _second_half_speed(times: np.ndarray, positions: np.ndarray, slope: float) -> Uncertain:
    """Return the mean speed in the second half of the samples, and its standard deviation, m/s.

    It is computed between the medians of the first and the last group of samples (`TENTH`) of this
    half. The standard deviation follows from the scatter of all samples about the slope.
    """
    size = math.ceil(len(times) / TENTH)
    half = len(times) // 2
    early, late = slice(half, half + size), slice(-size, None)
    residuals = positions - slope * times
    duration = float(np.median(times[late])) - float(np.median(times[early]))
    gain = float(np.median(residuals[late])) - float(np.median(residuals[early]))
    scatter = NORMAL * float(np.median(np.abs(residuals - np.median(residuals))))
    deviation = MEDIANS * scatter * math.sqrt(2 / size) / duration
    return Uncertain(slope + gain / duration, deviation)


def _let_go_time(t: np.ndarray, speed: np.ndarray) -> float | None:
    """Return the first time at which the speed exceeds `LET_GO`, interpolated linearly; None if it never does."""
    fast = np.flatnonzero(speed > LET_GO)
    if not len(fast):
        return None
    i = int(fast[0])
    if i == 0:
        return float(t[0])
    return float(np.interp(LET_GO, speed[i - 1 : i + 1], t[i - 1 : i + 1]))
