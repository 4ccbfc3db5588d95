"""The time that is kept of every night: a multiple of the calibration kernel's, so that the machine's speed cancels.

Both times are the shortest of their samples: whatever else runs on the machine makes a time longer, never shorter. The
other nights are also the repeats of a run that takes longer than `ONCE`.

The kernel shows the clock and what disturbs all work alike, not differences between processors beyond their speed: the
ratio of the reference to an earlier kernel was 4.1 on one and 5.7 on another. Nor does it show all of a neighbour that
shares caches or the core: 1.46 times was seen. So no verdict rests on it, and no time is corrected by it; `older_code`
has what a verdict can rest on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from stiction.comparisons.bench.timing.calibration_kernel import calibration_kernel
from stiction.comparisons.bench.timing.visits import block, in_rounds, seconds_of

TIME = "relative_time"
"""Name of the quantity: CPU time of one simulation over that of one call of the kernel.

Another kernel, or another way to make the number, needs another name, because times before and after do not compare."""
SHARE = 0.5
"""Time of the kernel before a call, relative to the call's: what disturbs both is then alike."""
ONCE = 0.5
"""CPU seconds; a longer run is made once a night."""


def relative_time(call: Callable[[], Any], least: int) -> tuple[float, float | None]:
    """Return the CPU time of a call over that of the kernel, timed in turns, each the shortest of its samples.

    A call that takes less than `ONCE` has `least` rounds. With the ratio comes its uncertainty: the difference of the
    second shortest call from the shortest, in kernels; None where there is only one.
    """
    # As many kernels as take a fixed share of the call: what disturbs lasts about as long as both.
    kernel = calibration_kernel()
    kernel_s = min(seconds for _, seconds in block(kernel))
    _, first = seconds_of(call)
    count = max(1, round(SHARE * first / kernel_s))

    def time_kernel() -> float:
        return seconds_of(lambda: [kernel() for _ in range(count)])[1] / count

    if first > ONCE:
        return first / time_kernel(), None
    calls = {"kernel": time_kernel, "run": lambda: min(seconds for _, seconds in block(call))}
    samples = in_rounds(list(calls), lambda keys: {key: calls[key]() for key in keys}, least)
    kernel_least, runs = min(samples["kernel"]), sorted(samples["run"])
    ratio = runs[0] / kernel_least
    return ratio, (runs[1] - runs[0]) / kernel_least if len(runs) > 1 else None
