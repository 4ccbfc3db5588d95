"""What every command does: runs are planned, made in child processes, and turned into something, a table mostly.

A comparison only plans. `make` makes the runs of any number of comparisons, so that all that may share the machine shares it. What is timed
is timed afterwards, one run at a time, with nothing beside it, in rounds over the runs of all comparisons (`stiction.comparisons.timing.rounds`): a computation
that several of them have is timed once, and has one time in all tables.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from stiction.comparisons.variants import Variant
from stiction.comparisons.timing.rounds import Timing
from stiction.comparisons.timing.timed_runs import computation, time_runs, timed, with_cost
from stiction.engines.isolation import Isolate, Outcome, Task, is_simulation, isolate
from stiction.engines.protocol import Engine
from stiction.engines.reference.engine import compile_kernels
from stiction.engines.registry import EngineMissing, load_engine

T = TypeVar("T")

TIME_LIMIT = 240.0
"""Seconds that one run or measurement may take."""
PREPARATION_LIMIT = 600.0
"""Seconds that an engine may take to compile what it keeps on disk."""


@dataclass(frozen=True)
class Comparison(Generic[T]):
    """Runs, and what becomes of them.

    Attributes
    ----------
    tasks : tuple of Task
    tabulate : callable
        What the comparison yields, from the outcomes of its tasks in their order.
    variants : tuple of Variant
        Those that take part: their engines are prepared first.
    rounds : int
        In how many rounds its runs are timed at least; 0: they are not. The tasks of one that is timed are simulations, and the values of their
        outcomes are `stiction.comparisons.timing.rounds.Timing`.
    """

    tasks: tuple[Task, ...]
    tabulate: Callable[[Sequence[Outcome]], T]
    variants: tuple[Variant, ...] = ()
    rounds: int = 0

    def make(self, **options: Any) -> T:
        """What it yields; options of `make`."""
        return make([self], **options)[0]


def make(comparisons: Sequence[Comparison[Any]], *, workers: int | None = None, timeout_s: float = TIME_LIMIT,
         on_start: Callable[[int], None] | None = None, on_result: Callable[[Outcome], None] | None = None,
         isolated: Isolate | None = None, timed_by: Isolate | None = None) -> list[Any]:
    """Make all runs of comparisons, then what each yields.

    Parameters
    ----------
    workers
        Runs at a time, the number of CPUs where None; those that are timed go one by one.
    timeout_s
        Seconds that one run may take.
    on_start, on_result
        Told the number of runs, those of the rounds that are sure to come included, and each outcome as it comes in.
    isolated
        How the runs are made, `stiction.engines.isolate` where None: `checkpoint.KeptRuns.isolate` keeps each as soon as it is there,
        `stiction.comparisons.studies.executors.open_isolate` has one that makes them on a cluster.
    timed_by
        How those that are timed are made again, `isolated` where None: on this machine.
    """
    isolated = isolated or isolate
    prepare([variant for comparison in comparisons for variant in comparison.variants])
    least, timed_runs = max((comparison.rounds for comparison in comparisons), default=0), sum(len(c.tasks) for c in comparisons if c.rounds)
    tasks = [task for comparison in comparisons for task in comparison.tasks]
    if on_start is not None:
        on_start(len(tasks) + least * timed_runs)
    found = iter(isolated(tasks, workers=workers, timeout_s=timeout_s, on_result=on_result) if tasks else [])
    pairs = [[(task, next(found)) for task in comparison.tasks] for comparison in comparisons]
    times = time_runs([pair for comparison, part in zip(comparisons, pairs) if comparison.rounds for pair in part], least, timed_by or isolated, timeout_s, on_result)
    return [comparison.tabulate([timed(task, outcome, times) if comparison.rounds else _with_its_time(task, outcome, times) for task, outcome in part])
            for comparison, part in zip(comparisons, pairs)]


def _with_its_time(task: Task, outcome: Outcome, times: Mapping[str, Timing]) -> Outcome:
    """An outcome whose run, if it is a simulation, has the time that the same computation has elsewhere."""
    if outcome.status != "ok" or not is_simulation(task):
        return outcome
    return replace(outcome, value=with_cost(outcome.value, times.get(computation(*task.args, outcome.value))))


def prepare(variants: Sequence[Variant]) -> None:
    """Have kernels compiled before any run has a time limit; other engines' in children, as all that is theirs."""
    compile_kernels()
    names = []
    for name in dict.fromkeys(variant.engine for variant in variants if variant.engine != "reference"):
        try:
            if type(load_engine(name)).prepare is not Engine.prepare:
                names.append(name)
        except EngineMissing:
            pass  # the rows of its runs say so
    if names:  # whatever fails here fails in the runs as well, whose rows say why
        isolate([Task(name, _prepare, (name,)) for name in names], timeout_s=PREPARATION_LIMIT)


def _prepare(engine: str) -> None:
    load_engine(engine).prepare()
