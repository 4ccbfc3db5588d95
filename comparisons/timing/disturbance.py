"""What else the machine does while something is timed, and what that makes of a time."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import psutil

from stiction.comparisons.timing.intervals import CONFIDENCE, median_interval

if TYPE_CHECKING:
    from stiction.comparisons.timing.rounds import Sample

WIDE = 0.25
"""Width of an interval, in units of the median, from which on a time is said to be unsure."""
BUSY = 0.25
"""Cores that others may keep busy before it is told: a system that idles, with a terminal and a clock, stays below a tenth of one."""
SWING = 0.1
"""Part of its median by which the calibration kernel's time may differ between rounds before it is told."""
SHORTEST = 0.5
"""s; times of a system are counted in steps of 10 ms, one per core: over less than fifty of them nothing is told."""


@dataclass(frozen=True)
class Load:
    """What all processes of the machine together have used up to an instant, CPU seconds, and the instant, s."""

    at: float
    busy_s: float


def load() -> Load:
    """Now; of all processors, of all processes, time that a host took from a virtual machine included."""
    times = psutil.cpu_times()
    idle = sum(getattr(times, name, 0.0) for name in ("idle", "iowait", "guest", "guest_nice"))  # a guest's time is in the user's as well
    return Load(time.monotonic(), sum(times) - idle)


def others(before: Load, after: Load, own_s: float) -> float:
    """Cores that were kept busy by others between two instants, when our own processes used `own_s` CPU seconds; nan over less than `SHORTEST`."""
    wall = after.at - before.at
    return max(0.0, (after.busy_s - before.busy_s - own_s) / wall) if wall >= SHORTEST else float("nan")


def doubts(samples: Sequence[Sample], others: Sequence[float]) -> list[str]:
    """What makes a time unsure, in words."""
    if not samples:
        return []
    found, words = median_interval([sample.own_s for sample in samples]), []
    if found.level < CONFIDENCE:
        words.append(f"{found.samples} rounds are too few for an interval" if found.samples > 1 else "timed once")
    elif found.width > WIDE:
        words.append(f"unsure: {found.low / found.value:.2f} to {found.high / found.value:.2f} of the median after {found.samples} rounds")
    loads = np.array(others[:len(samples)], dtype=float)
    if (busy := int(np.sum(loads > BUSY))):
        words.append(f"others kept up to {np.nanmax(loads):.1f} cores busy in {busy} of {len(samples)} rounds")
    kernel = np.array([sample.kernel_s for sample in samples])
    if (swing := float(np.ptp(kernel) / np.median(kernel))) > SWING:
        words.append(f"the machine's speed changed by {100 * swing:.0f} % between rounds")
    return words
