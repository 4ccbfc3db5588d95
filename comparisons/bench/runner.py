"""Runs are planned, made in child processes, and turned into something, a table mostly: the way of every command.

A comparison only plans. `make` makes the runs of any number of comparisons, so that all that may share the machine
shares it. A run that several of them request is made once. Timed runs are made again afterwards, one at a time with
nothing else, in rounds over the runs of all comparisons (`bench.timing.visits`). A computation that
several comparisons have is timed once, and has one time in all tables.
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
"""Seconds that one run or measurement may take."""
PREPARATION_LIMIT = 600.0
"""Seconds that an engine may take to compile what it keeps on disk."""


@dataclass(frozen=True)
class Comparison(Generic[T]):
    """Runs, and what becomes of them: `tabulate` makes the yield from the outcomes of the tasks, in their order.

    The engines of the variants are prepared first. Where there are `rounds`, the tasks are simulations, which are timed
    in so many at least; the values of their outcomes are `bench.timing.visits.Timing`. `ladders` names
    the refinement series of each, with steps from coarse to fine. The rounds of one series may take `budget_s` CPU
    seconds. Finer steps are timed once.
    """

    tasks: tuple[Task, ...]
    tabulate: Callable[[Sequence[Outcome]], T]
    variants: tuple[Variant, ...] = ()
    rounds: int = 0
    ladders: tuple[str, ...] = ()
    budget_s: float = math.inf

    def then(self, convert: Callable[[T], S]) -> Comparison[S]:
        """Return a comparison of the same runs whose yield is converted."""
        return Comparison(
            self.tasks,
            lambda outcomes: convert(self.tabulate(outcomes)),
            self.variants,
            self.rounds,
            self.ladders,
            self.budget_s,
        )

    def make(self, **options: Any) -> T:
        """Make the runs and return the yield; options of `make`."""
        return make([self], **options)[0]


def side_by_side(parts: Sequence[Comparison[S]], combine: Callable[[list[S]], T]) -> Comparison[T]:
    """Return comparisons as one, timed in the same rounds with the same budget, whose yields are combined."""

    def tabulate(outcomes: Sequence[Outcome]) -> T:
        rest = iter(outcomes)
        return combine([part.tabulate([next(rest) for _ in part.tasks]) for part in parts])

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
    """Return the comparison of every variant with every step on every scene; it yields the records in this order.

    Engines without a static coefficient run the scene with mus = mu. The finest steps are begun first, so that no core
    waits for another at the end.
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
    order = sorted(range(len(runs)), key=lambda i: (runs[i][1].parameter, runs[i][2]))

    def tabulate(outcomes: Sequence[Outcome]) -> tuple[Record, ...]:
        by_run = dict(zip(order, outcomes))
        return tuple(
            Record(by_run[i].label, scene.name, variant, step, by_run[i])
            for i, (scene, variant, step) in enumerate(runs)
        )

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
    """Make all runs of comparisons, and return their yields.

    Parameters
    ----------
    workers, timeout_s
        As of `stiction.engines.isolate`; the rounds of those that are timed go one by one.
    on_start, on_result
        Called with the number of runs, those of the rounds that are sure to come included, and each outcome.
    isolated, timed_by
        Make the runs, and those that are timed again, on this machine; `stiction.engines.isolate` where None.
        `checkpoint.KeptRuns.isolate` keeps each outcome, `executors.open_isolate` has one for a cluster.
    """
    isolated = isolated or isolate
    prepare(variant.engine for comparison in comparisons for variant in comparison.variants)
    least = max((comparison.rounds for comparison in comparisons), default=0)
    tasks = [task for comparison in comparisons for task in comparison.tasks]
    if on_start is not None:
        timed = sum(len(comparison.tasks) for comparison in comparisons if comparison.rounds)
        on_start(len(tasks) + least * timed)

    # All runs of all comparisons together, so that equal ones are made once; then each comparison
    # takes its own back.
    outcomes = iter(_outcomes(tasks, isolated, on_result, workers=workers, timeout_s=timeout_s))
    pairs = [[(task, next(outcomes)) for task in comparison.tasks] for comparison in comparisons]

    # Those that are timed have run once before: only what succeeded is timed, and what it costs is
    # known.
    to_time = [
        run
        for comparison, part in zip(comparisons, pairs)
        if comparison.rounds
        for run in affordable(part, comparison.ladders, least, comparison.budget_s)
    ]
    times = time_runs(to_time, least, timed_by or isolated, timeout_s, on_result, workers)
    return [
        comparison.tabulate(
            [with_time(task, outcome, times, comparison.rounds > 0) for task, outcome in part]
        )
        for comparison, part in zip(comparisons, pairs)
    ]


def _outcomes(
    tasks: Sequence[Task],
    isolated: Isolate,
    on_result: Callable[[Outcome], None] | None,
    **options: Any,
) -> list[Outcome]:
    """Return the outcome of each task. Equal tasks are made once, under whatever labels; CPU time counts once."""
    calls = [call_of(task) for task in tasks]
    alike: dict[str, list[Task]] = defaultdict(list)
    for call, task in zip(calls, tasks):
        alike[call].append(task)
    # The first of equal tasks is made; the others wait for its outcome, by its label.
    others: dict[str, list[Task]] = defaultdict(list)
    for first, *rest in alike.values():
        others[first.label] += rest

    def report(outcome: Outcome) -> None:
        if on_result is not None:
            on_result(outcome)
            for task in others.pop(outcome.label, ()):
                on_result(replace(outcome, label=task.label, cpu_s=0.0))

    if not tasks:
        return []
    outcomes = isolated([first for first, *_ in alike.values()], on_result=report, **options)
    by_call = dict(zip(alike, outcomes, strict=True))
    return [replace(by_call[call], label=task.label) for call, task in zip(calls, tasks)]


def prepare(engines: Iterable[str]) -> None:
    """Have kernels compiled before any run has a time limit; other engines' in children, as all that is theirs."""
    compile_kernels()
    names = [name for name in dict.fromkeys(engines) if name != "reference" and _compiles(name)]
    if names:  # whatever fails here fails in the runs as well, whose rows say why
        isolate([Task(name, _prepare, (name,)) for name in names], timeout_s=PREPARATION_LIMIT)


def _compiles(engine: str) -> bool:
    try:
        return type(load_engine(engine)).prepare is not Engine.prepare
    except EngineMissing:  # the rows of its runs say so
        return False


def _prepare(engine: str) -> None:
    load_engine(engine).prepare()
