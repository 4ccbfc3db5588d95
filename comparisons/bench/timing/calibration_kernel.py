"""The calibration kernel: compiled arithmetic whose CPU time measures the speed of the machine.

It shares no code with the reference, so that a change of the reference does not change its time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

STEPS = 6200
"""Time steps in one call, which takes about 0.3 ms: much longer than the resolution of the
clock."""


def calibration_kernel() -> Callable[[], float]:
    """Return the kernel, ready to be timed: its first call, which compiles or loads it, has been made."""
    _dry_oscillator(STEPS)
    return lambda: _dry_oscillator(STEPS)


@njit(cache=True)
def _acceleration(t: float, x: float, v: float) -> float:
    """Return x'' of an oscillator with dry friction at time t, position x and velocity v."""
    return np.sin(0.7 * t) - x - 0.2 * np.sign(v)


@njit(cache=True)
def _dry_oscillator(steps: int) -> float:
    """Return x after some steps of 1 ms from rest, where x'' = sin(0.7 t) - x - 0.2 sgn x'.

    The method is the Runge-Kutta-Nystroem form of the classical method of order 4.
    """
    t, x, v, h = 0.0, 0.0, 0.0, 1e-3
    for _ in range(steps):
        a1 = _acceleration(t, x, v)
        a2 = _acceleration(t + h / 2, x + h / 2 * v, v + h / 2 * a1)
        a3 = _acceleration(t + h / 2, x + h / 2 * v + h**2 / 4 * a1, v + h / 2 * a2)
        a4 = _acceleration(t + h, x + h * v + h**2 / 2 * a2, v + h * a3)
        x += h * v + h**2 / 6 * (a1 + a2 + a3)
        v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        t += h
    return x
