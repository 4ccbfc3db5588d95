"""Measurement of time by `validate`, `compare`, every night and in checks.

`Engine.run` is timed with start and end as its only output, in CPU time of the process that does the work. The cost is
that of the motion, not of the table of it, nor of the gate that the run has passed before. All runs that are to be
compared are timed in rounds, one at a time, in turns forwards and backwards. So a machine that becomes slower does so
for all. A visit repeats a short run for `BLOCK` seconds, and its sample is their median. Runs beyond the budget of
their refinement series are timed once, beside each other, and their times are unsure.

The calibration kernel is timed in each visit, 2 ms in all before and after the run. It tells which are
`disturbed_visits`: `timed_runs.time_runs` repeats these after the rounds. No time is corrected by it. The load by
others is reported.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from statistics import median
from time import process_time
from typing import Any, TypeVar

import psutil

from stiction.comparisons.bench.timing.calibration_kernel import calibration_kernel
from stiction.comparisons.bench.timing.intervals import CONFIDENCE, Interval, median_interval
from stiction.engines.protocol import Engine
from stiction.engines.registry import load_engine
from stiction.scenes import Cost, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity

K = TypeVar("K")
S = TypeVar("S")
T = TypeVar("T")

BLOCK, REPEATS = 0.02, 40
"""CPU seconds for which a visit repeats a run, and the largest number of repeats."""
LONG = 0.03
"""CPU seconds; a longer run is made once a visit, its first call included: of runs of 15 to 100 ms the first call took
0.87 to 1.34 times as long as later ones, 1.00 in the median."""
KERNELS = 3
"""Times that the calibration kernel is run before and after a run."""
SLOW, TRIES = 1.2, 3
"""Time of the calibration kernel, in units of its median over all visits, above which a visit is disturbed, and how
often that is repeated. Of 905 visits 93 % of those with a faster kernel were within a tenth of the run's median, and
26 % of those with a slower one. Where a host serves others, slow ones come in spells of seconds."""
WIDE = 0.25
"""Width of an interval, in units of the median, from which on a time is unsure."""
SHORTEST = 0.5
"""s; times of a system are counted in steps of 10 ms, one per core: a shorter load is not known."""


@dataclass(frozen=True)
class VisitTimes:
    """Result of a visit: medians over its `runs`, CPU seconds.

    `setup_s`, `stepping_s` and `own_s` are those of `stiction.scenes.Cost`, `kernel_s` is that of the calibration
    kernel in the same visit. `others` are the cores that other work kept busy in its round, nan where it was too short.
    """

    setup_s: float
    stepping_s: float
    own_s: float
    kernel_s: float
    runs: int
    others: float = math.nan


def visit(engine: str, scene: Scene, arguments: Mapping[str, Any]) -> VisitTimes:
    """Time a run that has succeeded before, for arguments of `Engine.simulate`; meant for a child process by itself.

    Times are those that the engine states (set-up, stepping), of the whole run where it states none.
    """

    def stated(run: Trajectory, seconds: float) -> Cost:
        return run.cost if run.cost != Cost() else Cost(stepping_s=seconds)

    def counted(run: Trajectory, seconds: float) -> float:
        return stated(run, seconds).setup_s + stated(run, seconds).stepping_s

    # The kernel on both sides of the runs: a slow spell that begins or ends during them is seen as
    # well.
    call, kernel = bare_run(load_engine(engine), scene, arguments), calibration_kernel()
    kernels = [seconds_of(kernel)[1] for _ in range(KERNELS)]
    costs = [stated(*run_and_seconds) for run_and_seconds in block(call, counted)]
    kernels += [seconds_of(kernel)[1] for _ in range(KERNELS)]
    setup, stepping, own = (
        median(getattr(cost, name) for cost in costs) for name in ("setup_s", "stepping_s", "own_s")
    )
    return VisitTimes(setup, stepping, own, median(kernels), len(costs))


def bare_run(
    engine: Engine, scene: Scene, arguments: Mapping[str, Any]
) -> Callable[[], Trajectory]:
    """Return the call that is timed, for arguments of `Engine.simulate` that have passed it once."""
    settings = dict(arguments)
    t_end = settings.pop("t_end", None) or scene.t_end
    settings.pop("output_step", None)
    options = {name: settings.pop(name, None) for name in ("dt", "rtol")}
    fidelity = settings.pop("fidelity", Fidelity.JOINT)
    settings = engine.settings_of_run(settings, fidelity=fidelity, **options)
    return lambda: engine.run(
        scene, t_end=t_end, fidelity=fidelity, output_step=t_end, settings=settings, **options
    )


def block(
    call: Callable[[], T], counted: Callable[[T, float], float] = lambda result, seconds: seconds
) -> list[tuple[T, float]]:
    """Return results and CPU seconds of a call that is repeated for `BLOCK` seconds.

    The first call counts if it takes longer than `LONG`: then it is the only one. `counted` has the seconds that are
    compared with it, since the first run of a process loads compiled kernels besides.
    """
    first = seconds_of(call)
    if counted(*first) > LONG:
        return [first]
    # The first call of a short run is dropped: that of a process loads compiled kernels besides.
    repeats = [seconds_of(call)]
    while len(repeats) < REPEATS and sum(seconds for _, seconds in repeats) < BLOCK:
        repeats.append(seconds_of(call))
    return repeats


def seconds_of(call: Callable[[], T]) -> tuple[T, float]:
    """Return the result of a call and its CPU seconds, with those of programs that it ran and waited for."""
    started = _cpu_s()
    result = call()
    return result, _cpu_s() - started


def _cpu_s() -> float:
    """CPU seconds of this process and of the processes that it has waited for."""
    if sys.platform == "win32":  # which runs no programs as engines
        return process_time()
    from resource import RUSAGE_CHILDREN, getrusage

    children = getrusage(RUSAGE_CHILDREN)
    return process_time() + children.ru_utime + children.ru_stime


def in_rounds(
    keys: Sequence[K], one_round: Callable[[Sequence[K]], Mapping[K, S]], rounds: int
) -> dict[K, list[S]]:
    """Return samples of several runs that are timed in turns, by key and round.

    `one_round` visits each key that it is given once, in that order. A key that it has no sample of is not visited
    again.
    """
    samples: dict[K, list[S]] = {key: [] for key in keys}
    left = list(keys)
    for _ in range(rounds):
        made = one_round(left)
        for key, sample in made.items():
            samples[key].append(sample)
        left = [key for key in reversed(left) if key in made]
    return samples


def disturbed_visits(samples: Mapping[K, Sequence[VisitTimes]]) -> dict[K, list[int]]:
    """Return the numbers of the samples in whose visits the machine was slow, by key; keys without any are left out."""
    kernels = [visit.kernel_s for visits in samples.values() for visit in visits]
    usual = median(kernels) if kernels else 0.0
    slow = {
        key: [i for i, visit in enumerate(visits) if visit.kernel_s > SLOW * usual]
        for key, visits in samples.items()
    }
    return {key: numbers for key, numbers in slow.items() if numbers}


@dataclass(frozen=True)
class Load:
    """CPU seconds up to an instant `at` (s): of all processes of the machine, and of this one and its children."""

    at: float
    busy_s: float
    own_s: float


def load() -> Load:
    """Return the load up to now, time that a host took from a virtual machine included."""
    times = psutil.cpu_times()
    # a guest's time is in the user's as well
    idle = sum(getattr(times, name, 0.0) for name in ("idle", "iowait", "guest", "guest_nice"))
    own = 0.0
    this_process = psutil.Process()
    for process in (this_process, *this_process.children(recursive=True)):
        # the times of a process that has just ended are in its parent's
        with suppress(psutil.NoSuchProcess):
            times_of_process = process.cpu_times()
            # user and system code, its own and that of children it has waited for
            own += sum(times_of_process[:4])
    return Load(time.monotonic(), sum(times) - idle, own)


def others(before: Load, after: Load) -> float:
    """Cores kept busy between two instants by other processes than this one and its children; nan below `SHORTEST`."""
    wall, busy = after.at - before.at, after.busy_s - before.busy_s - (after.own_s - before.own_s)
    return max(0.0, busy / wall) if wall >= SHORTEST else math.nan


@dataclass(frozen=True)
class Timing:
    """A run as it was requested, with the medians of its samples as cost; the reason why rounds are missing."""

    trajectory: Trajectory
    samples: tuple[VisitTimes, ...] = ()
    reason: str = ""

    def interval(self, name: str) -> Interval:
        """Interval of `VisitTimes.setup_s`, `stepping_s`, `own_s` or `kernel_s`."""
        return median_interval([getattr(sample, name) for sample in self.samples])

    @property
    def note(self) -> str:
        """Reasons why the time is unsure; empty where it is not."""
        return "; ".join(filter(None, [self.reason, doubt(self.interval("own_s"))]))


def doubt(time: Interval) -> str:
    """Return the reason why a median of times is unsure; empty where it is not, and without samples.

    Load by others and a machine whose speed changes count by what they do to the interval: CPU time does not run while
    others do. With 1.0 to 1.9 of two cores busy with others, medians of 147 runs differed by 2 % on average, by 11 % at
    most. Where cores share a pipeline it may be more: the load is reported.
    """
    if not time.samples:
        return ""
    if time.samples == 1:
        return "timed once"
    if time.level < CONFIDENCE:
        return f"{time.samples} rounds are too few for an interval"
    if time.width <= WIDE:
        return ""
    low, high = time.low / time.value, time.high / time.value
    return f"unsure: {low:.2f} to {high:.2f} of the median after {time.samples} rounds"
