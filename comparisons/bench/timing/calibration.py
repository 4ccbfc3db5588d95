"""Relative times of nightly runs: CPU times divided by the time of a calibration kernel.

The ratio depends less on the speed of the machine than the time itself. Both times are the shortest
of their samples, because other processes make a time longer, but never shorter. A run longer than
`ONCE` is timed once a night, and its repeats are other nights.

The ratio still depends on the machine. The kernel is sensitive to the clock frequency and to
disturbances of any work, but not to other differences between processors: the ratio of the
reference to an earlier kernel was 4.1 on one processor and 5.7 on another. It is also less
sensitive than a run to processes that share caches or a core, which changed the ratio by up to a
factor of 1.46. Therefore relative times are only shown; regressions are detected by
`stiction.comparisons.regression.older_code`, which times two versions of the code side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from stiction.comparisons.bench.timing.calibration_kernel import calibration_kernel
from stiction.comparisons.bench.timing.visits import block, in_rounds, seconds_of

TIME = "relative_time"
"""Key of the quantity: CPU time of one simulation divided by the CPU time of one call of the
kernel.

If the kernel or the measurement is changed, the key must be changed too, because values before and
after the change cannot be compared."""
SHARE = 0.5
"""Time for which the kernel is called before a run, relative to the time of the run. With similar
lengths, a disturbance of some duration affects both in a similar way."""
ONCE = 0.5
"""CPU time above which a run is timed once a night, s."""


def relative_time(call: Callable[[], Any], rounds: int) -> tuple[float, float | None]:
    """Return the relative time of a call, and its uncertainty.

    Call and kernel are timed alternately; the shortest sample of each is used. A call that takes
    longer than `ONCE` is timed once.

    Parameters
    ----------
    call : callable
        The simulation.
    rounds : int
        Number of samples.

    Returns
    -------
    ratio : float
        Shortest CPU time of the call divided by the shortest CPU time of the kernel.
    uncertainty : float or None
        Difference between the second shortest and the shortest time of the call, divided by the
        time of the kernel; None if the call was timed once.
    """
    # A sample of the kernel consists of so many calls that it takes `SHARE` of the time of the run.
    kernel = calibration_kernel()
    kernel_s = min(seconds for _, seconds in block(kernel))
    _, first_s = seconds_of(call)
    count = max(1, round(SHARE * first_s / kernel_s))

    def time_kernel() -> float:
        _, seconds = seconds_of(lambda: [kernel() for _ in range(count)])
        return seconds / count

    def time_run() -> float:
        return min(seconds for _, seconds in block(call))

    if first_s > ONCE:
        return first_s / time_kernel(), None
    timers = {"kernel": time_kernel, "run": time_run}
    samples = in_rounds(list(timers), lambda keys: {key: timers[key]() for key in keys}, rounds)
    shortest_kernel = min(samples["kernel"])
    runs = sorted(samples["run"])
    uncertainty = None
    if len(runs) > 1:
        uncertainty = (runs[1] - runs[0]) / shortest_kernel
    return runs[0] / shortest_kernel, uncertainty
