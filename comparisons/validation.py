"""The main computation: all studies on some scenes, whose runs are executed together."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.environment import load
from stiction.comparisons.bench.participants import extent, validation_campaign, variants
from stiction.comparisons.bench.results import NOT_APPLICABLE, SCENES_OF_PAPER, Results
from stiction.comparisons.bench.runner import Comparison, make
from stiction.comparisons.bench.study import Scope, Study, Tables, planned, selection, union
from stiction.comparisons.bench.timing.timed_runs import machine_while_timing
from stiction.comparisons.studies import studies
from stiction.engines.isolation import Isolate, Outcome
from stiction.engines.status import Status
from stiction.scenes import Scene

TIMED_SECONDS = 0.25
"""Approximate CPU time of a timed run, s. It is used only to estimate how much of the work is done."""


def validate(  # noqa: PLR0913 - all are named
    *,
    scenes: Sequence[Scene] = (),
    depth: Depth = Depth.DEFAULT,
    engines: Sequence[str] | None = None,
    workers: int | None = None,
    on_result: Callable[[Outcome], None] | None = None,
    on_share: Callable[[float], None] | None = None,
    on_study: Callable[[Study, Results], None] | None = None,
    isolated: Isolate | None = None,
    timed_by: Isolate | None = None,
) -> Results:
    """Execute the runs of all studies, and return their tables.

    Parameters
    ----------
    scenes : sequence of Scene
        Scenes with consistent initial states and different names; the paper's three cases if empty.
        The settings of the results contain, under `NOT_APPLICABLE`, why studies were left out.
    depth : Depth
        Which runs are executed.
    engines : sequence of str or None
        External engines that take part; all known ones if None. The reference always takes part.
    workers, on_result, isolated, timed_by
        As for `stiction.comparisons.bench.runner.make`.
    on_share : callable or None
        Called after each run with the fraction of the work that is done, 0 to 1.
    on_study : callable or None
        Called with each study as soon as its runs are complete, and with the results so far.
    """
    load_before = load()
    limits = extent(depth)
    options: dict[str, Any] = {
        "workers": workers,
        "timeout_s": limits.limit,
        "isolated": isolated,
        "timed_by": timed_by,
    }

    papers_cases = tuple(validation_campaign().scenes)
    chosen = tuple(scenes) or papers_cases
    names = None if engines is None else tuple(engines)
    scope = Scope(chosen, depth, names, is_campaign=True)
    selected = selection(scope, studies())
    so_far = _ResultsSoFar(
        chosen,
        {
            SCENES_OF_PAPER: [scene.name for scene in chosen if scene in papers_cases],
            NOT_APPLICABLE: dict(selected.reasons),
        },
    )

    def report(outcome: Outcome) -> None:
        so_far.add(outcome)
        if on_result is not None:
            on_result(outcome)

    plan = planned(selected.scopes, on_result=report, **options)

    def present_study(study: Study, tables: Sequence[Tables]) -> None:
        if on_study is not None:
            on_study(study, so_far.results_of(tables))

    progress = _Progress(plan, on_share or (lambda share: None), present_study)

    def report_progress(outcome: Outcome) -> None:
        report(outcome)
        progress.add(outcome)

    tables = make(
        list(plan.values()), on_start=progress.begin, on_result=report_progress, **options
    )
    # Studies with timed runs are complete only now, all at the same time.
    for study, comparison in plan.items():
        if comparison.rounds and not progress.interrupted:
            present_study(study, tables)
    settings = {
        "scenes": [scene.name for scene in chosen],
        "depth": str(depth),
        "engines": list(dict.fromkeys(variant.engine for variant in variants(engines, depth))),
        "time_limit": limits.limit,
        "workers": workers,
        "trajectories": limits.trajectories,
        "interrupted": progress.interrupted,
        "machine before": load_before,
        "machine while timing": machine_while_timing(union(tables).table("times")),
        "machine after": load(),
    }
    return so_far.results_of(tables, settings)


class _ResultsSoFar:
    """The scenes and settings of a validation, and its wall time and CPU time, those of its runs included.

    Parameters
    ----------
    scenes : sequence of Scene
        The scenes of the validation.
    settings : Mapping
        Settings that are known before the runs.
    """

    def __init__(self, scenes: Sequence[Scene], settings: Mapping[str, object]) -> None:
        self._scenes = tuple(scenes)
        self._settings = dict(settings)
        self._wall_start_s = time.perf_counter()
        self._cpu_start_s = time.process_time()
        self._cpu_of_runs_s = 0.0

    def add(self, outcome: Outcome) -> None:
        """Add the CPU time of a run, which is that of a child process."""
        self._cpu_of_runs_s += outcome.cpu_s or 0.0

    def results_of(
        self, tables: Sequence[Tables], settings: Mapping[str, object] = MappingProxyType({})
    ) -> Results:
        """Return the results of studies with scenes, settings and the times that have elapsed until now."""
        wall_s = time.perf_counter() - self._wall_start_s
        cpu_s = time.process_time() - self._cpu_start_s + self._cpu_of_runs_s
        return union(tables, {**self._settings, **settings}, wall_s, cpu_s, self._scenes)


class _Progress:
    """The fraction of the work that is done, and the tables of the studies whose runs are complete.

    Studies with timed runs are left out: they are complete only at the end, all together. After a run that was not
    executed, `interrupted` is true, and no study is reported any more.

    Parameters
    ----------
    plan : Mapping[Study, Comparison]
        All studies with their runs.
    on_share : callable
        Called after each run with the fraction of the work that is done.
    on_study : callable
        Called with each study as soon as its runs are complete, and with the tables of all studies so far.
    """

    def __init__(
        self,
        plan: Mapping[Study, Comparison[Tables]],
        on_share: Callable[[float], None],
        on_study: Callable[[Study, Sequence[Tables]], None],
    ):
        self.interrupted = False
        self._on_share = on_share
        self._on_study = on_study
        self._plan = {
            study: comparison for study, comparison in plan.items() if not comparison.rounds
        }
        self._outcomes: dict[Study, dict[int, Outcome]] = {study: {} for study in self._plan}
        # Studies, and places among their tasks, that wait for the outcome of a label. Several
        # studies may have runs with the same label; the runner reports an outcome for each.
        self._awaited: dict[str, list[tuple[Study, int]]] = defaultdict(list)
        for study, comparison in self._plan.items():
            for place, task in enumerate(comparison.tasks):
                self._awaited[task.label].append((study, place))
        self._tables: list[Tables] = []
        self._done_s = 0.0
        self._total_s = 0.0

    def begin(self, number: int) -> None:
        """Estimate the whole work from the number of results that will come."""
        counts = {study: len(comparison.tasks) for study, comparison in self._plan.items()}
        untimed_s = sum(study.seconds * count for study, count in counts.items())
        self._total_s = untimed_s + TIMED_SECONDS * (number - sum(counts.values()))

    def add(self, outcome: Outcome) -> None:
        """Take the outcome of a run into account, and report the study that it completes."""
        awaiting = self._awaited[outcome.label]
        study, place = awaiting.pop(0) if awaiting else (None, 0)
        self._done_s += TIMED_SECONDS if study is None else study.seconds
        # There may be more rounds of timing than the estimate assumes.
        self._on_share(min(self._done_s / self._total_s, 1.0))
        if outcome.status == Status.NOT_RUN:
            self.interrupted = True
        if study is None:
            return
        outcomes = self._outcomes[study]
        outcomes[place] = outcome
        comparison = self._plan[study]
        is_complete = len(outcomes) == len(comparison.tasks)
        if is_complete and not self.interrupted:
            in_order = [outcomes[number] for number in range(len(outcomes))]
            self._tables.append(comparison.tabulate(in_order))
            self._on_study(study, self._tables)
