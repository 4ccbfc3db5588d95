"""Measurement of the CPU time of runs.

`Engine.run` is timed, with output only at the start and at the end. So the time is that of the
simulation; it contains neither the output nor the checks of `Engine.simulate`, which the run has
passed before. It is the CPU time of the process that executes the run.

Runs that are compared are timed in rounds. In each round every run is visited once; one run is
executed at a time, and the order of the runs is reversed from round to round. A change of the
machine's speed then affects all runs alike. A visit repeats a short run for `BLOCK` seconds, and
its sample is the median of the repeats. Runs that exceed the budget of their refinement series are
timed once, in parallel, and their times are less certain.

In each visit the calibration kernel is timed as well, for 2 ms in all before and after the run. A
visit in which the kernel is slow is disturbed (`disturbed_visits`), and `timed_runs.time_runs`
repeats it after the rounds. Times are not corrected by the time of the kernel. The load by other
processes is reported.
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

BLOCK = 0.02
"""CPU time for which a visit repeats a run, s."""
REPEATS = 40
"""Largest number of repeats of a run in a visit."""
LONG = 0.03
"""CPU time above which a run is executed once in a visit, s. This is then its first call in the
process: for runs of 15 to 100 ms it took 0.87 to 1.34 times as long as later calls, with a median
of 1.00."""
KERNELS = 3
"""Number of calls of the calibration kernel before a run, and after it."""
SLOW = 1.2
"""Time of the calibration kernel, relative to its median over all visits, above which a visit is
disturbed. In a measurement with 905 visits, the time of a run was within 10 % of its median in 93 %
of the visits with a faster kernel, and in 26 % of those with a slower one."""
TRIES = 3
"""Number of passes in which disturbed visits are repeated, one visit of each run in a pass. One
pass is not enough, because disturbances by other virtual machines last for seconds."""
WIDE = 0.25
"""Width of an interval, relative to the median, above which a time is reported as uncertain."""
SHORTEST = 0.5
"""Shortest time over which the load by other processes is computed, s: the system counts it in
steps of 10 ms for each core."""


@dataclass(frozen=True)
class VisitTimes:
    """The sample of one visit: medians over the repeats of the run, CPU time in s.

    Attributes
    ----------
    setup_s, stepping_s, own_s : float
        As of `stiction.scenes.Cost`.
    kernel_s : float
        Time of one call of the calibration kernel.
    runs : int
        Number of repeats.
    others : float
        Number of cores that other processes kept busy in the round of the visit; nan if the round
        was too short.
    """

    setup_s: float
    stepping_s: float
    own_s: float
    kernel_s: float
    runs: int
    others: float = math.nan


def visit(engine: str, scene: Scene, arguments: Mapping[str, Any]) -> VisitTimes:
    """Time a run, which must have succeeded before; this is the task of a child process.

    Parameters
    ----------
    engine : str
        Name of the engine.
    scene : Scene
    arguments : Mapping
        Arguments of `Engine.simulate`.
    """
    call = bare_run(load_engine(engine), scene, arguments)
    kernel = calibration_kernel()
    # The kernel is timed before and after the repeats, because a disturbance may begin or end
    # during them.
    kernels = [seconds_of(kernel)[1] for _ in range(KERNELS)]
    repeats = block(call, _seconds_of_cost)
    kernels += [seconds_of(kernel)[1] for _ in range(KERNELS)]
    costs = [_cost_of(run, seconds) for run, seconds in repeats]
    return VisitTimes(
        setup_s=median(cost.setup_s for cost in costs),
        stepping_s=median(cost.stepping_s for cost in costs),
        own_s=median(cost.own_s for cost in costs),
        kernel_s=median(kernels),
        runs=len(costs),
    )


def _cost_of(run: Trajectory, seconds: float) -> Cost:
    """Return the cost that the engine reports; the time of the whole run if it reports none."""
    return run.cost if run.cost != Cost() else Cost(stepping_s=seconds)


def _seconds_of_cost(run: Trajectory, seconds: float) -> float:
    """Return the time of a run without the loading of kernels, which is not part of its reported cost."""
    cost = _cost_of(run, seconds)
    return cost.setup_s + cost.stepping_s


def bare_run(
    engine: Engine, scene: Scene, arguments: Mapping[str, Any]
) -> Callable[[], Trajectory]:
    """Return a function that calls `Engine.run` for arguments of `Engine.simulate`, without its checks."""
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
    """Repeat a call for `BLOCK` seconds, and return the result and CPU time (s) of each repeat.

    The first call may be slower, because it may load compiled kernels; its result is discarded. If
    it takes longer than `LONG`, however, it is the only one.

    Parameters
    ----------
    call : callable
    counted : callable
        Returns the part of the first call's time that is compared with `LONG`, given its result and
        its CPU time.
    """
    first = seconds_of(call)
    if counted(*first) > LONG:
        return [first]
    repeats = [seconds_of(call)]
    while len(repeats) < REPEATS and sum(seconds for _, seconds in repeats) < BLOCK:
        repeats.append(seconds_of(call))
    return repeats


def seconds_of(call: Callable[[], T]) -> tuple[T, float]:
    """Return the result of a call and its CPU time (s), including programs that it has run to their end."""
    before = _cpu_s()
    result = call()
    return result, _cpu_s() - before


def _cpu_s() -> float:
    """Return the CPU time of this process and of its children that have ended, s."""
    if sys.platform == "win32":
        # Programs as engines, whose processes would be counted, are not supported on Windows.
        return process_time()
    from resource import RUSAGE_CHILDREN, getrusage

    children = getrusage(RUSAGE_CHILDREN)
    return process_time() + children.ru_utime + children.ru_stime


def in_rounds(
    keys: Sequence[K], one_round: Callable[[Sequence[K]], Mapping[K, S]], rounds: int
) -> dict[K, list[S]]:
    """Return samples by key, one for each round; the order of the keys is reversed from round to round.

    Parameters
    ----------
    keys : sequence
    one_round : callable
        Visits the given keys in their order, and returns a sample for each that succeeds. The
        others are not visited again.
    rounds : int
    """
    samples: dict[K, list[S]] = {key: [] for key in keys}
    remaining = list(keys)
    for _ in range(rounds):
        samples_of_round = one_round(remaining)
        for key, sample in samples_of_round.items():
            samples[key].append(sample)
        remaining = [key for key in reversed(remaining) if key in samples_of_round]
    return samples


def disturbed_visits(samples: Mapping[K, Sequence[VisitTimes]]) -> dict[K, list[int]]:
    """Return, by key, the numbers of the samples that are disturbed; keys without any are left out."""
    kernels = [sample.kernel_s for of_key in samples.values() for sample in of_key]
    limit = SLOW * median(kernels) if kernels else 0.0
    disturbed = {}
    for key, of_key in samples.items():
        numbers = [i for i, sample in enumerate(of_key) if sample.kernel_s > limit]
        if numbers:
            disturbed[key] = numbers
    return disturbed


@dataclass(frozen=True)
class Load:
    """CPU time that has been used up to an instant.

    Attributes
    ----------
    at : float
        The instant, s.
    busy_s : float
        CPU time of all processes since the start of the machine, s.
    own_s : float
        CPU time of this process and its children, s.
    """

    at: float
    busy_s: float
    own_s: float


def load() -> Load:
    """Return the CPU times used up to now. Time taken by the host of a virtual machine counts as busy."""
    times = psutil.cpu_times()
    # the times of guests are contained in the time of users as well
    not_counted = ("idle", "iowait", "guest", "guest_nice")
    busy_s = sum(times) - sum(getattr(times, name, 0.0) for name in not_counted)
    own_s = 0.0
    this_process = psutil.Process()
    for process in (this_process, *this_process.children(recursive=True)):
        # A process that has ended since is counted by its parent.
        with suppress(psutil.NoSuchProcess):
            # user and system time of the process, and of its children that have ended
            own_s += sum(process.cpu_times()[:4])
    return Load(time.monotonic(), busy_s, own_s)


def others(before: Load, after: Load) -> float:
    """Return how many cores other processes kept busy on average between two loads; nan below `SHORTEST`."""
    wall_s = after.at - before.at
    if wall_s < SHORTEST:
        return math.nan
    own_s = after.own_s - before.own_s
    others_s = after.busy_s - before.busy_s - own_s
    return max(0.0, others_s / wall_s)


@dataclass(frozen=True)
class Timing:
    """A run with the samples of its time.

    Attributes
    ----------
    trajectory : Trajectory
        The run with the output that was requested; `timed_runs.with_time` replaces its cost by the
        medians.
    samples : tuple of VisitTimes
        One for each round in which the run was timed.
    reason : str
        Why samples are missing; empty if they are not.
    """

    trajectory: Trajectory
    samples: tuple[VisitTimes, ...] = ()
    reason: str = ""

    def interval(self, name: str) -> Interval:
        """Return the median and interval of a field of `VisitTimes`, such as ``"stepping_s"``."""
        return median_interval([getattr(sample, name) for sample in self.samples])

    @property
    def note(self) -> str:
        """Reasons why the time is uncertain; empty if it is not."""
        reasons = (self.reason, doubt(self.interval("own_s")))
        return "; ".join(reason for reason in reasons if reason)


def doubt(time: Interval) -> str:
    """Return the reason why a median of times is uncertain; empty if it is not, or if there are no samples.

    The load by other processes is no reason by itself, because CPU time does not elapse while other
    processes run. With other processes on 1.0 to 1.9 of two cores, the medians of 147 runs changed
    by 2 % on average and by 11 % at most. The change may be larger if cores share a pipeline; in
    any case it makes the interval wider.
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
