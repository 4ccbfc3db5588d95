"""Load by other processes while a run is timed, and doubts about its time."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import psutil

from stiction.comparisons.timing.intervals import CONFIDENCE, median_interval

if TYPE_CHECKING:
    from stiction.comparisons.timing.rounds import Sample

WIDE = 0.25
"""Width of an interval, in units of the median, from which on a time is called unsure."""
BUSY = 0.25
"""Cores kept busy by others from which on that is reported: a system that idles stays below a tenth of one."""
SWING = 0.1
"""Part of its median by which the calibration kernel's time may differ between rounds before that is reported."""
SHORTEST = 0.5
"""s; times of a system are counted in steps of 10 ms, one per core: a shorter load is not known."""


@dataclass(frozen=True)
class Load:
    """CPU seconds up to an instant.

    Attributes
    ----------
    at : float
        The instant, s.
    busy_s : float
        Used by all processes of the machine.
    own_s : float
        Used by this process and its children, those that ended included.
    """

    at: float
    busy_s: float
    own_s: float


def load() -> Load:
    """Load up to now, time that a host took from a virtual machine included."""
    times, own = psutil.cpu_times(), 0.0
    # a guest's time is in the user's as well
    idle = sum(getattr(times, name, 0.0) for name in ("idle", "iowait", "guest", "guest_nice"))
    for process in (ours := psutil.Process(), *ours.children(recursive=True)):
        with suppress(psutil.NoSuchProcess):  # it has just ended: its parent has its times
            used = process.cpu_times()
            own += sum(getattr(used, name, 0.0) for name in ("user", "system", "children_user", "children_system"))
    return Load(time.monotonic(), sum(times) - idle, own)


def others(before: Load, after: Load) -> float:
    """Cores kept busy between two instants by other processes than this one and its children; nan below `SHORTEST`."""
    wall = after.at - before.at
    if wall < SHORTEST:
        return float("nan")
    return max(0.0, (after.busy_s - before.busy_s - after.own_s + before.own_s) / wall)


def doubts(samples: Sequence[Sample], others: Sequence[float]) -> list[str]:
    """Reasons why a time is unsure."""
    if not samples:
        return []
    found, words = median_interval([sample.own_s for sample in samples]), []
    if found.level < CONFIDENCE:
        words.append(f"{found.samples} rounds are too few for an interval" if found.samples > 1 else "timed once")
    elif found.width > WIDE:
        low, high = found.low / found.value, found.high / found.value
        words.append(f"unsure: {low:.2f} to {high:.2f} of the median after {found.samples} rounds")
    loads = np.array(others[:len(samples)], dtype=float)
    if (busy := int(np.sum(loads > BUSY))):
        words.append(f"others kept up to {np.nanmax(loads):.1f} cores busy in {busy} of {len(samples)} rounds")
    kernel = np.array([sample.kernel_s for sample in samples])
    if (swing := float(np.ptp(kernel) / np.median(kernel))) > SWING:
        words.append(f"the machine's speed changed by {100 * swing:.0f} % between rounds")
    return words
