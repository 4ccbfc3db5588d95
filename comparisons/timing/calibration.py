"""The calibration kernel: work of known size, timed together with a run so that a change of the machine's speed shows.

It is the independent integrator of the reduced slider-bar (`stiction.comparisons.timing.reduced_integrator`): compiled
arithmetic as in the reference, adaptive, with events, and nothing of the reference in it. It shows the clock and what
disturbs all work alike. It does not show differences between processors beyond their speed: the ratio of the reference
to the kernel was 4.1 on one and 5.7 on another, and for some runs 1.9 times as much. Nor does it show all of a
neighbour that shares caches or the core: 1.46 times was seen. So no verdict rests on it, and no time is corrected by
it; `stiction.comparisons.timing.older_code` has what a verdict can rest on.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from stiction.scenes import load_scene

T_END, RTOL = 24.0, 1e-9
"""Seconds and tolerance of the integration of case 1 that the kernel is."""


@cache
def calibration_kernel() -> Callable[[], Any]:
    """Return the kernel, compiled or loaded from the cache on disk."""
    from stiction.comparisons.timing.reduced_integrator import integrate, parameters

    p = parameters(load_scene("slider-bar-case-1"))
    integrate(p, T_END, RTOL)  # compiles
    return lambda: integrate(p, T_END, RTOL)
