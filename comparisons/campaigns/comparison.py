"""What every command does: runs are planned, made in child processes, and turned into something, a table mostly.

A comparison only plans. `make` makes the runs of any number of comparisons, so that all that may share the machine shares it; a run that several of
them ask for alike is made once. What is timed is timed afterwards, one run at a time, with nothing beside it, in rounds over the runs of all comparisons
(`stiction.comparisons.timing.rounds`): a computation that several of them have is timed once, and has one time in all tables.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from stiction.comparisons.variants import Variant
from stiction.comparisons.timing.rounds import Timing
from stiction.comparisons.timing.timed_runs import call_of, computation, time_runs, timed, with_cost
from stiction.engines.isolation import Isolate, Outcome, Task, is_simulation, isolate
from stiction.engines.protocol import Engine
from stiction.engines.reference.engine import compile_kernels
from stiction.engines.registry import EngineMissing, load_engine

S, T = TypeVar("S"), TypeVar("T")

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
    ladders : tuple of str
        By task that is timed, the name of its ladder, whose rungs come from coarse to fine.
    budget_s : float
        CPU seconds that the rounds of one ladder may take: what is finer is not timed, and its `Timing` says so.
    """

    tasks: tuple[Task, ...]
    tabulate: Callable[[Sequence[Outcome]], T]
    variants: tuple[Variant, ...] = ()
    rounds: int = 0
    ladders: tuple[str, ...] = ()
    budget_s: float = math.inf

    def then(self, convert: Callable[[T], S]) -> Comparison[S]:
        """The same runs; it yields what `convert` makes of what this one yields."""
        return replace(self, tabulate=lambda outcomes: convert(self.tabulate(outcomes)))

    def make(self, **options: Any) -> T:
        """What it yields; options of `make`."""
        return make([self], **options)[0]


def side_by_side(parts: Sequence[Comparison[S]], combine: Callable[[list[S]], T]) -> Comparison[T]:
    """Comparisons that are timed in the same rounds and with the same budget, as one; `combine`: what it yields, from what each of them yields."""
    def tabulate(outcomes: Sequence[Outcome]) -> T:
        rest = iter(outcomes)
        return combine([part.tabulate([next(rest) for _ in part.tasks]) for part in parts])

    variants = {variant.label: variant for part in parts for variant in part.variants}
    return replace(parts[0], tasks=tuple(task for part in parts for task in part.tasks), tabulate=tabulate, variants=tuple(variants.values()),
                   ladders=tuple(ladder for part in parts for ladder in part.ladders))


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
    prepare(variant.engine for comparison in comparisons for variant in comparison.variants)
    least, timed_runs = max((comparison.rounds for comparison in comparisons), default=0), sum(len(c.tasks) for c in comparisons if c.rounds)
    tasks = [task for comparison in comparisons for task in comparison.tasks]
    if on_start is not None:
        on_start(len(tasks) + least * timed_runs)
    found = iter(_outcomes(tasks, isolated, on_result, workers=workers, timeout_s=timeout_s))
    pairs = [[(task, next(found)) for task in comparison.tasks] for comparison in comparisons]
    times = time_runs([pair for comparison, part in zip(comparisons, pairs) for pair in _affordable(comparison, part, least)], least, timed_by or isolated,
                      timeout_s, on_result)
    return [comparison.tabulate([timed(task, outcome, times, comparison.budget_s) if comparison.rounds else _with_its_time(task, outcome, times) for task, outcome in part])
            for comparison, part in zip(comparisons, pairs)]


def _outcomes(tasks: Sequence[Task], isolated: Isolate, on_result: Callable[[Outcome], None] | None, **options: Any) -> list[Outcome]:
    """The outcome of each task. Equal tasks, under whatever labels, are made once; the others have the same outcome, for no CPU time."""
    first: dict[str, Task] = {}
    calls = [call_of(task) for task in tasks]
    others: dict[str, list[str]] = defaultdict(list)
    for call, task in zip(calls, tasks):
        if first.setdefault(call, task) is not task:
            others[first[call].label].append(task.label)

    def tell(outcome: Outcome) -> None:
        on_result(outcome)
        for label in others.pop(outcome.label, ()):
            on_result(replace(outcome, label=label, cpu_s=0.0))

    found = isolated(list(first.values()), on_result=on_result and tell, **options) if first else []
    made = dict(zip(first, found, strict=True))
    return [replace(made[call], label=task.label) for call, task in zip(calls, tasks)]


def _affordable(comparison: Comparison[Any], pairs: Sequence[tuple[Task, Outcome]], rounds: int) -> Iterator[tuple[Task, Outcome]]:
    """Of the runs of a comparison those that are timed: of each ladder, from the coarsest rung on, what its rounds may take; two rungs at least."""
    if not comparison.rounds:
        return
    spent: dict[str, float] = defaultdict(float)
    rungs: Counter[str] = Counter()
    for (task, outcome), ladder in zip(pairs, comparison.ladders or map(str, range(len(pairs)))):
        if outcome.status != "ok":
            continue
        cost = outcome.value.cost
        spent[ladder] += rounds * (cost.setup_s + cost.stepping_s or outcome.cpu_s or 0.0)  # an engine need not state its own
        rungs[ladder] += 1
        if rungs[ladder] <= 2 or spent[ladder] <= comparison.budget_s:
            yield task, outcome


def _with_its_time(task: Task, outcome: Outcome, times: Mapping[str, Timing]) -> Outcome:
    """An outcome whose run, if it is a simulation, has the time that the same computation has elsewhere."""
    if outcome.status != "ok" or not is_simulation(task):
        return outcome
    return replace(outcome, value=with_cost(outcome.value, times.get(computation(*task.args, outcome.value))))


def prepare(engines: Iterable[str]) -> None:
    """Have kernels compiled before any run has a time limit; other engines' in children, as all that is theirs."""
    compile_kernels()
    names = []
    for name in dict.fromkeys(name for name in engines if name != "reference"):
        try:
            if type(load_engine(name)).prepare is not Engine.prepare:
                names.append(name)
        except EngineMissing:
            pass  # the rows of its runs say so
    if names:  # whatever fails here fails in the runs as well, whose rows say why
        isolate([Task(name, _prepare, (name,)) for name in names], timeout_s=PREPARATION_LIMIT)


def _prepare(engine: str) -> None:
    load_engine(engine).prepare()
