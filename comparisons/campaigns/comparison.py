"""What every command does: runs are planned, made in child processes, and turned into something, a table mostly.

A comparison only plans. `make` makes the runs of any number of comparisons, so that all that may share the machine shares it, and that what is timed
is timed afterwards, one run at a time, with nothing beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from stiction.comparisons.variants import Variant
from stiction.engines.isolation import Isolate, Outcome, Task, isolate
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
    timed : bool
        Whether its runs are timed.
    """

    tasks: tuple[Task, ...]
    tabulate: Callable[[Sequence[Outcome]], T]
    variants: tuple[Variant, ...] = ()
    timed: bool = False

    def make(self, **options: Any) -> T:
        """What it yields; options of `make`."""
        return make([self], **options)[0]


def make(comparisons: Sequence[Comparison[Any]], *, workers: int | None = None, timeout_s: float = TIME_LIMIT,
         on_start: Callable[[int], None] | None = None, on_result: Callable[[Outcome], None] | None = None,
         isolated: Isolate | None = None) -> list[Any]:
    """Make all runs of comparisons, then what each yields.

    Parameters
    ----------
    workers
        Runs at a time, the number of CPUs where None; those that are timed go one by one.
    timeout_s
        Seconds that one run may take.
    on_start, on_result
        Told the number of runs once, and each outcome as it comes in.
    isolated
        How the runs are made, `stiction.engines.isolate` where None: `kept.KeptRuns.isolate` keeps each as soon as it is there.
    """
    isolated = isolated or isolate
    prepare([variant for comparison in comparisons for variant in comparison.variants])
    if on_start is not None:
        on_start(sum(len(comparison.tasks) for comparison in comparisons))
    outcomes: dict[int, list[Outcome]] = {i: [] for i in range(len(comparisons))}
    for timed in (False, True):
        part = [(i, task) for i, comparison in enumerate(comparisons) if comparison.timed == timed for task in comparison.tasks]
        if part:
            found = isolated([task for _, task in part], workers=1 if timed else workers, timeout_s=timeout_s, on_result=on_result)
            for (i, _), outcome in zip(part, found, strict=True):
                outcomes[i].append(outcome)
    return [comparison.tabulate(outcomes[i]) for i, comparison in enumerate(comparisons)]


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
