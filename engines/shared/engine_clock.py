"""Measurement of the CPU time that a run spends in the engine's own calls.

Reading the CPU time of a process takes 0.8 to 7 us if it is a system call (more on a busy machine), which is as long
as a step of a small mechanism; reading the wall clock takes 0.05 us. Therefore the wall clock is read whenever a run
enters or leaves its engine. Every half a millisecond, the CPU time since the last reading is divided between engine and
adapter in proportion to their wall times. The time of other processes affects both in the same proportion. A process
that interrupts one of them affects the proportion of that half a millisecond only.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

INTERVAL = 5e-4
"""Seconds between two readings of the CPU time. A reading takes a thousandth of it, and a scheduler lets a process run
for several intervals."""


class EngineClock:
    """Clock of the CPU time of an engine's calls since `start`, without the time of its adapter.

    Attributes
    ----------
    calls : int
        Number of calls of the engine since the start.
    """

    def __init__(self) -> None:
        self.start()

    def start(self) -> None:
        """Begin at zero, outside the engine."""
        self.calls = 0
        self._engine_s = 0.0
        self._cpu_s = process_time()
        self._begin_interval()

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function of the engine; return its result."""
        self.calls += 1
        self._since = perf_counter()
        result = function(*arguments)
        now = perf_counter()
        self._inside_s += now - self._since
        if now > self._next_reading:
            self._divide(now)
        return result

    def call_back(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function of the adapter from within a call of the engine; return its result."""
        # The time before and after the call of the function belongs to the engine.
        self._inside_s += perf_counter() - self._since
        result = function(*arguments)
        now = perf_counter()
        self._since = now
        if now > self._next_reading:
            self._divide(now)
        return result

    @property
    def engine_s(self) -> float:
        """CPU seconds inside the engine since the start; to be read outside of the engine."""
        self._divide(perf_counter())
        return self._engine_s

    def _begin_interval(self) -> None:
        """Begin an interval between two readings of the CPU time."""
        now = perf_counter()
        self._inside_s = 0.0
        self._began = now
        self._since = now
        self._next_reading = now + INTERVAL

    def _divide(self, now: float) -> None:
        """End the interval, and add the engine's part of its CPU time.

        The time of the reading itself belongs to no interval.
        """
        cpu_s = process_time()
        if now > self._began:
            self._engine_s += (cpu_s - self._cpu_s) * self._inside_s / (now - self._began)
        self._cpu_s = cpu_s
        self._begin_interval()
