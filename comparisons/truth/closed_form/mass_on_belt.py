"""Mass on a belt: the closed forms of its stick-slip cycle (mus > mu).

A spring k holds a mass m that rests with normal force N on a belt of speed v0; D = (mus - mu) N, w = sqrt(k/m). In
stick the spring is stretched at the rate v0 from (mu N - D)/k to (mu N + D)/k; in slip the mass swings about mu N / k,
from displacement D/k and velocity v0 until its velocity is v0 again. The motion itself: `oscillator.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class StickSlipCycle:
    """The steady cycle.

    Attributes
    ----------
    stick_time, slip_time : float
        Seconds.
    amplitude : float
        Of the swing about mu N / k, m.
    """

    stick_time: float
    slip_time: float
    amplitude: float


def stick_slip_cycle(mass: float, stiffness: float, speed: float, mu: float, mus: float,
                     normal: float) -> StickSlipCycle:
    """Closed form of the cycle: 2 D/(k v0), (2/w)(pi - arctan(w D/(k v0))), sqrt((D/k)^2 + (v0/w)^2).

    Raises
    ------
    ValueError
        Without mus > mu or without a moving belt: there is no cycle.
    """
    if not (mus > mu >= 0 and speed != 0):
        raise ValueError(f"found mu = {mu:g}, mus = {mus:g}, speed = {speed:g}; "
                         "a cycle needs mus > mu and a moving belt")
    w, stretch = np.sqrt(stiffness / mass), (mus - mu) * normal / stiffness
    v0 = abs(speed)
    return StickSlipCycle(float(2 * stretch / v0), float(2 / w * (np.pi - np.arctan(w * stretch / v0))),
                          float(np.hypot(stretch, v0 / w)))
