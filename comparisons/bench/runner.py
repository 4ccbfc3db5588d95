"""Execution of comparisons: their runs are executed in child processes, and their results are tabulated.

A `Comparison` is a plan. `make` executes the runs of any number of comparisons together, so that
all processors are used, and executes a run only once if several comparisons need it. Runs whose
times are measured are executed again afterwards, one at a time, in rounds over all comparisons
(`bench.timing.visits`). A computation that belongs to several comparisons is timed once, so that
all tables contain the same time.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from stiction.comparisons.bench.timing.timed_runs import affordable, call_of, time_runs, with_time
from stiction.comparisons.bench.variants import Record, Variant, has_static_coefficient, job
from stiction.engines import (
    Engine,
    EngineMissing,
    Isolate,
    Outcome,
    Task,
    isolate,
    load_engine,
    simulation,
)
from stiction.engines.reference.engine import compile_kernels
from stiction.scenes import Scene
from stiction.truths.physics import physics_of

S = TypeVar("S")
T = TypeVar("T")

TIME_LIMIT = 240.0
"""Default time limit of one run or measurement, s."""
PREPARATION_LIMIT = 600.0
"""Time limit for compiling the kernels of one engine, which are then stored on disk, s."""


@dataclass(frozen=True)
class Comparison(Generic[T]):
    """A plan: tasks, and a function that computes the result of the comparison from their outcomes.

    Attributes
    ----------
    tasks : tuple of Task
    tabulate : callable
        Computes the result from the outcomes, which are in the order of the tasks.
    variants : tuple of Variant
        The variants whose engines must be prepared before the tasks.
    rounds : int
        Minimum number of timing rounds; 0 if times are not measured. If it is not 0, all tasks are
        simulations, and the value of each outcome is a `bench.timing.visits.Timing` instead of a
        trajectory.
    ladders : tuple of str
        Name of the refinement series of each task, if `rounds` is not 0. The tasks of a series go
        from coarse to fine.
    budget_s : float
        CPU time for the rounds of one series, s. Runs that exceed it are timed once.
    """

    tasks: tuple[Task, ...]
    tabulate: Callable[[Sequence[Outcome]], T]
    variants: tuple[Variant, ...] = ()
    rounds: int = 0
    ladders: tuple[str, ...] = ()
    budget_s: float = math.inf

    def then(self, convert: Callable[[T], S]) -> Comparison[S]:
        """Return a comparison of the same runs whose result is `convert` of this one's result."""
        return Comparison(
            self.tasks,
            lambda outcomes: convert(self.tabulate(outcomes)),
            self.variants,
            self.rounds,
            self.ladders,
            self.budget_s,
        )

    def make(self, **options: Any) -> T:
        """Execute the runs and return the result; `options` are those of the function `make`."""
        return make([self], **options)[0]


def side_by_side(parts: Sequence[Comparison[S]], combine: Callable[[list[S]], T]) -> Comparison[T]:
    """Return several comparisons as one, whose result is `combine` of the list of their results.

    The rounds and the budget of the first one apply to all.
    """

    def tabulate(outcomes: Sequence[Outcome]) -> T:
        results = []
        first = 0
        for part in parts:
            end = first + len(part.tasks)
            results.append(part.tabulate(outcomes[first:end]))
            first = end
        return combine(results)

    variants = {variant.label: variant for part in parts for variant in part.variants}
    return Comparison(
        tuple(task for part in parts for task in part.tasks),
        tabulate,
        tuple(variants.values()),
        parts[0].rounds,
        tuple(name for part in parts for name in part.ladders),
        parts[0].budget_s,
    )


def records_comparison(
    scenes: Sequence[Scene], variants: Sequence[Variant], t_end: float | None = None
) -> Comparison[tuple[Record, ...]]:
    """Return the comparison of all steps of all variants on all scenes; its result is the records.

    Records are ordered by scene, variant and step. Engines without a static coefficient simulate
    the scene with mus = mu.
    """
    runs = [
        (scene, variant, step)
        for scene in scenes
        for variant in variants
        for step in variant.ladder
    ]
    tasks = [
        simulation(
            job(physics_of(scene, has_static_coefficient(variant)), variant, step, t_end=t_end)
        )
        for scene, variant, step in runs
    ]

    # The finest steps, which take longest, are executed first. Otherwise one of them might begin
    # last and keep all but one processor idle.
    def parameter_and_step(i: int) -> tuple[str, float]:
        _, variant, step = runs[i]
        return variant.parameter, step

    order = sorted(range(len(runs)), key=parameter_and_step)

    def tabulate(outcomes: Sequence[Outcome]) -> tuple[Record, ...]:
        outcome_of_run = dict(zip(order, outcomes))
        records = []
        for i, (scene, variant, step) in enumerate(runs):
            outcome = outcome_of_run[i]
            records.append(Record(outcome.label, scene.name, variant, step, outcome))
        return tuple(records)

    return Comparison(tuple(tasks[i] for i in order), tabulate, tuple(variants))


def make(
    comparisons: Sequence[Comparison[Any]],
    *,
    workers: int | None = None,
    timeout_s: float = TIME_LIMIT,
    on_start: Callable[[int], None] | None = None,
    on_result: Callable[[Outcome], None] | None = None,
    isolated: Isolate | None = None,
    timed_by: Isolate | None = None,
) -> list[Any]:
    """Execute all runs of comparisons, and return the results of the comparisons.

    Parameters
    ----------
    comparisons : sequence of Comparison
    workers : int, optional
        Number of child processes at a time, as of `stiction.engines.isolate`. Times are measured
        one at a time.
    timeout_s : float
        Time limit of each run, s.
    on_start : callable, optional
        Called once with the number of runs, including those of the timing rounds that are planned.
    on_result : callable, optional
        Called with each outcome.
    isolated : callable, optional
        Executes the runs; `stiction.engines.isolate` if None. Others are `store.KeptRuns.isolate`,
        which stores each outcome, and those of `executors.open_isolate`.
    timed_by : callable, optional
        Executes the timing rounds, on this machine; `isolated` if None.
    """
    isolated = isolated or isolate
    prepare(variant.engine for comparison in comparisons for variant in comparison.variants)
    rounds = max((comparison.rounds for comparison in comparisons), default=0)
    tasks = [task for comparison in comparisons for task in comparison.tasks]
    if on_start is not None:
        timed = sum(len(comparison.tasks) for comparison in comparisons if comparison.rounds)
        on_start(len(tasks) + rounds * timed)

    # Execute the runs of all comparisons together, so that equal ones are executed once. Then
    # distribute the outcomes to the comparisons.
    outcomes = iter(_outcomes(tasks, isolated, on_result, workers=workers, timeout_s=timeout_s))
    pairs = [[(task, next(outcomes)) for task in comparison.tasks] for comparison in comparisons]

    # Measure the times of the runs that succeeded. Their cost is known from the first execution.
    to_time: list[tuple[Task, Outcome, bool]] = []
    for comparison, part in zip(comparisons, pairs):
        if comparison.rounds:
            to_time += affordable(part, comparison.ladders, rounds, comparison.budget_s)
    times = time_runs(to_time, rounds, timed_by or isolated, timeout_s, on_result, workers)

    results = []
    for comparison, part in zip(comparisons, pairs):
        is_timed = comparison.rounds > 0
        with_times = [with_time(task, outcome, times, is_timed) for task, outcome in part]
        results.append(comparison.tabulate(with_times))
    return results


def _outcomes(
    tasks: Sequence[Task],
    isolated: Isolate,
    on_result: Callable[[Outcome], None] | None,
    **options: Any,
) -> list[Outcome]:
    """Return the outcome of each task, and report each to `on_result`.

    Tasks that differ in their labels only are executed once. The CPU time is reported with the
    first of them, and as zero with the others.
    """
    calls = [call_of(task) for task in tasks]
    equal_tasks: dict[str, list[Task]] = defaultdict(list)
    for call, task in zip(calls, tasks):
        equal_tasks[call].append(task)
    # The first of equal tasks is executed. The others are found by its label when it has finished.
    executed = []
    duplicates: dict[str, list[Task]] = defaultdict(list)
    for first, *rest in equal_tasks.values():
        executed.append(first)
        duplicates[first.label] += rest

    def report(outcome: Outcome) -> None:
        if on_result is not None:
            on_result(outcome)
            for task in duplicates.pop(outcome.label, ()):
                on_result(replace(outcome, label=task.label, cpu_s=0.0))

    if not tasks:
        return []
    outcomes = isolated(executed, on_result=report, **options)
    by_call = dict(zip(equal_tasks, outcomes, strict=True))
    return [replace(by_call[call], label=task.label) for call, task in zip(calls, tasks)]


def prepare(engines: Iterable[str]) -> None:
    """Compile the kernels of the reference and of other engines, so that no run spends its time limit on it.

    Other engines compile in child processes, because they may crash. An error is not reported here:
    it occurs again in the runs of the engine, whose rows give the reason.
    """
    compile_kernels()
    names = [name for name in dict.fromkeys(engines) if name != "reference" and _compiles(name)]
    if names:
        isolate([Task(name, _prepare, (name,)) for name in names], timeout_s=PREPARATION_LIMIT)


def _compiles(engine: str) -> bool:
    """Return whether an engine has kernels to compile; False if it is missing."""
    try:
        return type(load_engine(engine)).prepare is not Engine.prepare
    except EngineMissing:
        return False


def _prepare(engine: str) -> None:
    """Compile the kernels of an engine; the task of a child process."""
    load_engine(engine).prepare()
