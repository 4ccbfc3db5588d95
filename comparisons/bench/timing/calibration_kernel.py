"""Compiled arithmetic of known size, with nothing of the reference in it: its CPU time says how fast the machine is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

STEPS = 6200
"""Steps of a call: about a third of a millisecond, long beside the resolution of the clock."""


def calibration_kernel() -> Callable[[], float]:
    """Return the kernel, compiled or loaded from the cache on disk."""
    _dry_oscillator(STEPS)
    return lambda: _dry_oscillator(STEPS)


@njit(cache=True)
def _acceleration(t: float, x: float, v: float) -> float:
    return np.sin(0.7 * t) - x - 0.2 * np.sign(v)


@njit(cache=True)
def _dry_oscillator(steps: int) -> float:
    """Displacement of x'' = sin(0.7 t) - x - 0.2 sgn x' from rest after steps of 1 ms, by the classic Runge-Kutta."""
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
