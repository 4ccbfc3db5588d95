"""Times as multiples of a calibration kernel that is timed in turns with them, so that the machine's own speed cancels.

The kernel is the independent integrator of the reduced slider-bar (`comparisons.reduced_integrator`): compiled arithmetic as in
the reference, adaptive, with events, and nothing of the reference in it. Whoever changes what it computes gives `TIME` another
name, because times before and after do not compare.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import Any

from scenes import load_scene

TIME = "cpu per calibration [-]"
"""Name of the quantity: CPU time of one simulation over that of one integration of case 1 over 24 s at rtol 1e-9."""
SHARE = 0.5
"""Of the time of a call, how long the kernel is timed before and after it: the noise of both is then alike."""
SHORT = 5e-3
"""CPU seconds over which a call is averaged at least; one of half a millisecond was seen to take 1.6 times its median."""
LONG = 1.0
"""CPU seconds; a call that takes longer averages over what disturbs it by itself, and is timed once."""


def relative_times(call: Callable[[], Any], repeats: int) -> list[float]:
    """CPU time of this process in a call over that in the calibration kernel right before and after it, once per repeat.

    A short call is made several times for each. The first calls are not counted: they load what has to be loaded, and tell how
    often call and kernel are to be called.
    """
    kernel = calibration_kernel()
    first = _timed(call, 1)
    if first <= LONG:
        first = _timed(call, 1)
    calls = max(1, round(SHORT / first))
    count = max(1, round(SHARE * calls * first / _timed(kernel, 1)))
    ratios = []
    for _ in range(1 if first > LONG else repeats):
        before, seconds, after = _timed(kernel, count), _timed(call, calls), _timed(kernel, count)
        ratios.append(2 * seconds / (before + after))
    return ratios


def _timed(call: Callable[[], Any], count: int) -> float:
    """Mean CPU seconds of a call."""
    started = time.process_time()
    for _ in range(count):
        call()
    return (time.process_time() - started) / count


@cache
def calibration_kernel() -> Callable[[], Any]:
    """The kernel, compiled or loaded from the cache on disk."""
    from comparisons.reduced_integrator import integrate, parameters

    p = parameters(load_scene("slider-bar-case-1"))
    integrate(p, 24.0, 1e-9)  # compiles
    return lambda: integrate(p, 24.0, 1e-9)
