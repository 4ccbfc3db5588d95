"""The main job: all studies on the paper's three cases, their runs made together."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.environment import load
from stiction.comparisons.bench.participants import extent, validation_campaign, variants
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, make
from stiction.comparisons.bench.study import Scope, Study, Tables, planned, union
from stiction.comparisons.bench.timing.timed_runs import machine_while_timing
from stiction.comparisons.studies import studies
from stiction.engines.isolation import Isolate, Outcome
from stiction.engines.status import Status

TIMED_SECONDS = 0.25
"""CPU seconds that a timed run takes, roughly: for the estimate of the time that is left, and nothing else."""


def validate(
    *,
    depth: Depth = Depth.DEFAULT,
    engines: Sequence[str] | None = None,
    workers: int | None = None,
    on_result: Callable[[Outcome], None] | None = None,
    on_share: Callable[[float], None] | None = None,
    on_study: Callable[[Study, Results], None] | None = None,
    isolated: Isolate | None = None,
    timed_by: Isolate | None = None,
) -> Results:
    """Make the runs of all studies, and their tables; options of `stiction.comparisons.bench.runner.make`.

    The reference and the external engines named take part, all known ones where None. `on_share` is called again and
    again with the part of the work that is done, 0 to 1; `on_study` with each study as soon as its runs are there, and
    the results so far.
    """
    started, cpu_started, load_before = time.perf_counter(), time.process_time(), load()
    limits = extent(depth)
    options: dict[str, Any] = {
        "workers": workers,
        "timeout_s": limits.limit,
        "isolated": isolated,
        "timed_by": timed_by,
    }
    spent = 0.0

    def count(outcome: Outcome) -> None:
        nonlocal spent
        spent += outcome.cpu_s or 0.0
        if on_result is not None:
            on_result(outcome)

    def results(made: Sequence[Tables], **settings: Any) -> Results:
        cpu = time.process_time() - cpu_started + spent
        return union(made, settings, time.perf_counter() - started, cpu)

    scope = Scope(
        tuple(validation_campaign().scenes), depth, None if engines is None else tuple(engines)
    )
    plan = planned(scope, studies(), on_result=count, **options)
    watch = _Watch(
        plan, on_share or (lambda share: None), on_study or (lambda study, so_far: None), results
    )

    def count_and_watch(outcome: Outcome) -> None:
        count(outcome)
        watch.result(outcome)

    made = make(list(plan.values()), on_start=watch.start, on_result=count_and_watch, **options)
    for study, comparison in plan.items():
        if comparison.rounds and not watch.interrupted:
            watch.on_study(study, results(made))
    return results(
        made,
        **{
            "depth": str(depth),
            "engines": list(dict.fromkeys(variant.engine for variant in variants(engines, depth))),
            "time_limit": limits.limit,
            "workers": workers,
            "trajectories": limits.trajectories,
            "interrupted": watch.interrupted,
            "machine before": load_before,
            "machine while timing": machine_while_timing(union(made).table("times")),
            "machine after": load(),
        },
    )


class _Watch:
    """Progress: the part of the work that is done, and each study as soon as all of its runs are.

    Timed studies come last, all of them together. Once runs were left out it is `interrupted`, and reports no study.
    """

    def __init__(
        self,
        plan: Mapping[Study, Comparison[Tables]],
        on_share: Callable[[float], None],
        on_study: Callable[[Study, Results], None],
        results: Callable[[Sequence[Tables]], Results],
    ):
        self.on_study, self._on_share, self._results = on_study, on_share, results
        self._plan = {
            study: comparison for study, comparison in plan.items() if not comparison.rounds
        }
        self._outcomes: dict[Study, dict[int, Outcome]] = {study: {} for study in self._plan}
        self._awaited: dict[str, list[tuple[Study, int]]] = defaultdict(list)
        for study, comparison in self._plan.items():
            for place, task in enumerate(comparison.tasks):
                self._awaited[task.label].append((study, place))
        self._made: list[Tables] = []
        self._done = self._total = 0.0
        self.interrupted = False

    def start(self, number: int) -> None:
        """Take notice of the number of results that will come."""
        counts = {study: len(comparison.tasks) for study, comparison in self._plan.items()}
        seconds = sum(study.seconds * count for study, count in counts.items())
        self._total = seconds + TIMED_SECONDS * (number - sum(counts.values()))

    def result(self, outcome: Outcome) -> None:
        study, place = awaited.pop(0) if (awaited := self._awaited[outcome.label]) else (None, 0)
        self._done += TIMED_SECONDS if study is None else study.seconds
        self._on_share(min(self._done / self._total, 1.0))  # rounds may be more than the least
        self.interrupted |= outcome.status == Status.NOT_RUN
        if study is None:
            return
        outcomes, comparison = self._outcomes[study], self._plan[study]
        outcomes[place] = outcome
        if len(outcomes) == len(comparison.tasks) and not self.interrupted:
            self._made.append(comparison.tabulate([outcomes[i] for i in range(len(outcomes))]))
            self.on_study(study, self._results(self._made))
