"""Times as multiples of a calibration kernel that is timed in turns with them, so that the machine's own speed cancels.

The kernel is the independent integrator of the reduced slider-bar (`comparisons.reduced_integrator`): compiled arithmetic as in
the reference, adaptive, with events, and nothing of the reference in it. What cancels is the clock and what disturbs both alike. What
processors differ in beyond their speed does not: the ratio of the reference to the kernel was 4.1 on one processor and 5.7 on another,
and for some runs 1.9 times as much. Nor does a neighbour that shares caches
or the core: 1.46 times was seen. So it is kept and told, and no verdict rests on it; `comparisons.control` has what does.

Both times are the shortest of their repeats: whatever else runs on the machine makes a time longer, never shorter. Whoever changes what
the kernel computes, or how the number is made, gives `TIME` another name, because times before and after do not compare.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from time import process_time
from typing import Any

from scenes import load_scene

TIME = "least cpu per calibration [-]"
"""Name of the quantity: CPU time of one simulation over that of one integration of case 1 over 24 s at rtol 1e-9."""
SHARE = 0.5
"""Of the time of a call, how long the kernel is timed before it: what disturbs both is then alike."""
SHORT = 5e-3
"""CPU seconds that a repeat of a short call stands for: it is timed so many times more often, each call by itself."""
LONG = 1.0
"""CPU seconds; a call that takes longer is timed once."""


def relative_time(call: Callable[[], Any], repeats: int) -> tuple[float, float | None]:
    """CPU time of this process in a call over that in the calibration kernel, timed in turns, each the shortest of its repeats.

    The first calls are not counted: they load what has to be loaded, and tell how often call and kernel are to be called.

    Returns
    -------
    ratio : float
    uncertainty : float or None
        How far the second shortest call is above the shortest, in kernels; None where there is only one.
    """
    kernel = calibration_kernel()
    first = _timed(call, 1)
    if first <= LONG:
        first = _timed(call, 1)
    turns = 1 if first > LONG else repeats * max(1, round(SHORT / first))
    count = max(1, round(SHARE * first / _timed(kernel, 1)))
    kernels, calls = zip(*((_timed(kernel, count), _timed(call, 1)) for _ in range(turns)))
    least = min(kernels)
    return min(calls) / least, None if turns == 1 else (sorted(calls)[1] - min(calls)) / least


def _timed(call: Callable[[], Any], count: int) -> float:
    """Mean CPU seconds of a call."""
    started = process_time()
    for _ in range(count):
        call()
    return (process_time() - started) / count


@cache
def calibration_kernel() -> Callable[[], Any]:
    """The kernel, compiled or loaded from the cache on disk."""
    from comparisons.reduced_integrator import integrate, parameters

    p = parameters(load_scene("slider-bar-case-1"))
    integrate(p, 24.0, 1e-9)  # compiles
    return lambda: integrate(p, 24.0, 1e-9)
