"""CPU time of a run inside the engine's own calls.

To ask a system for the CPU time of a process takes 0.8 to 7 us where that is a system call (the more, the busier the
machine), as much as a step of a small mechanism; to ask for the time of day takes 0.05 us. So the time of day is looked
at whenever a run goes into its engine or comes out of it. Every half a millisecond the CPU time since is shared out in
the proportion of the two. What other processes take falls on both sides in proportion to their own time. One that comes
in between spoils the proportion for that half a millisecond alone.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

INTERVAL = 5e-4
"""Seconds between two looks at the CPU time: a thousandth of it is spent on them, and a scheduler lets a process run
for several of it."""


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
        """Call a function of the engine; returns what it returns."""
        self.calls += 1
        self._since = perf_counter()
        result = function(*arguments)
        now = perf_counter()
        self._inside += now - self._since
        if now > self._next_look:
            self._share_out(now)
        return result

    def call_back(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function of the adapter from within a call of the engine; returns what it returns."""
        self._inside += perf_counter() - self._since
        result = function(*arguments)
        self._since = now = perf_counter()
        if now > self._next_look:
            self._share_out(now)
        return result

    @property
    def engine_s(self) -> float:
        """CPU seconds inside the engine since the start; asked outside of it."""
        self._share_out(perf_counter())
        return self._engine_s

    def _begin(self) -> None:
        """Begin an interval."""
        self._inside, self._began = 0.0, perf_counter()
        self._since, self._next_look = self._began, self._began + INTERVAL

    def _share_out(self, now: float) -> None:
        """Give the engine its part of the CPU time of the interval that ends; the look itself is in none."""
        spent = process_time()
        if now > self._began:
            self._engine_s += (spent - self._spent) * self._inside / (now - self._began)
        self._spent = spent
        self._begin()
