"""Times as multiples of a calibration kernel that is timed in turns with them, so that the machine's own speed cancels.

The kernel is the independent integrator of the reduced slider-bar (`stiction.comparisons.timing.reduced_integrator`): compiled arithmetic as in
the reference, adaptive, with events, and nothing of the reference in it. What cancels is the clock and what disturbs both alike. What
processors differ in beyond their speed does not: the ratio of the reference to the kernel was 4.1 on one processor and 5.7 on another,
and for some runs 1.9 times as much. Nor does a neighbour that shares caches
or the core: 1.46 times was seen. So it is kept and told, and no verdict rests on it; `stiction.comparisons.timing.older_code` has what does.

Both times are the shortest of their repeats: whatever else runs on the machine makes a time longer, never shorter. Whoever changes what
the kernel computes, or how the number is made, gives `TIME` another name, because times before and after do not compare.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from stiction.comparisons.timing.timed_run import seconds_of, timed
from stiction.scenes import load_scene

TIME = "least cpu per calibration [-]"
"""Name of the quantity: CPU time of one simulation over that of one integration of case 1 over 24 s at rtol 1e-9."""
SHARE = 0.5
"""Of the time of a call, how long the kernel is timed before it: what disturbs both is then alike."""


def relative_time(call: Callable[[], Any], least: int) -> tuple[float, float | None]:
    """CPU time of a call over that of the calibration kernel, timed in turns (see `stiction.comparisons.timing.timed_run`), each the shortest of its repeats.

    Parameters
    ----------
    least
        Repeats at least.

    Returns
    -------
    ratio : float
    uncertainty : float or None
        How far the second shortest call is above the shortest, in kernels; None where there is only one.
    """
    kernel = calibration_kernel()
    kernel_s = seconds_of(kernel)[1]

    def beside(seconds: float) -> float:
        count = max(1, round(SHARE * seconds / kernel_s))
        return seconds_of(lambda: [kernel() for _ in range(count)])[1] / count

    found = timed(call, least, beside)
    least_s = min(found.beside)
    return min(found.seconds) / least_s, None if len(found.seconds) == 1 else (sorted(found.seconds)[1] - min(found.seconds)) / least_s


@cache
def calibration_kernel() -> Callable[[], Any]:
    """The kernel, compiled or loaded from the cache on disk."""
    from stiction.comparisons.timing.reduced_integrator import integrate, parameters

    p = parameters(load_scene("slider-bar-case-1"))
    integrate(p, 24.0, 1e-9)  # compiles
    return lambda: integrate(p, 24.0, 1e-9)
