"""CPU time of a run inside the engine's own calls.

Reading the CPU time of a process takes 0.8 to 7 us where it is a system call (the more, the busier the machine), as
much as a step of a small mechanism; reading the time of day takes 0.05 us. Therefore the time of day is read whenever a
run enters or leaves its engine. Every half a millisecond, the CPU time since the last reading is divided between engine
and adapter in proportion to their times of day. The time of other processes falls on both in the same proportion. A
process that interrupts one of them spoils the proportion of that half a millisecond only.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

INTERVAL = 5e-4
"""Seconds between two readings of the CPU time. A thousandth of it is spent on a reading, and a scheduler lets a
process run for several intervals."""


class EngineClock:
    """CPU time of the engine's calls, without its adapter's; counted from the start.

    Attributes
    ----------
    calls : int
        Calls of the engine since the start.
    """

    def __init__(self) -> None:
        self.start()

    def start(self) -> None:
        """Begin at zero, outside the engine."""
        self.calls, self._engine_s = 0, 0.0
        self._spent = process_time()
        self._begin()

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function of the engine; return its result."""
        self.calls += 1
        self._since = perf_counter()
        result = function(*arguments)
        now = perf_counter()
        self._inside += now - self._since
        if now > self._next_look:
            self._share_out(now)
        return result

    def call_back(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function of the adapter from within a call of the engine; return its result."""
        # The time until here was the engine's, that of the function is not, and from here on it is
        # the engine's again.
        self._inside += perf_counter() - self._since
        result = function(*arguments)
        self._since = now = perf_counter()
        if now > self._next_look:
            self._share_out(now)
        return result

    @property
    def engine_s(self) -> float:
        """CPU seconds inside the engine since the start; to be read outside of the engine."""
        self._share_out(perf_counter())
        return self._engine_s

    def _begin(self) -> None:
        """Begin an interval."""
        self._inside, self._began = 0.0, perf_counter()
        self._since, self._next_look = self._began, self._began + INTERVAL

    def _share_out(self, now: float) -> None:
        """Add the engine's part of the CPU time of the interval that ends; the reading itself is in no interval."""
        spent = process_time()
        if now > self._began:
            self._engine_s += (spent - self._spent) * self._inside / (now - self._began)
        self._spent = spent
        self._begin()
