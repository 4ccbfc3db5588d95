"""The main job: the paper's three cases through every variant, and the comparisons on them."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison, make
from stiction.comparisons.campaigns.measurement import NOT_RUN
from stiction.comparisons.campaigns.participants import cost_variants, extent, threshold_variants, validation_campaign, variants
from stiction.comparisons.campaigns.single_scene import records_comparison
from stiction.comparisons.depth import Depth
from stiction.comparisons.environment import load
from stiction.comparisons.hard import hard_comparison
from stiction.comparisons.measures.accuracy import accuracy_table, errors, size_of
from stiction.comparisons.measures.convergence_orders import orders_comparison
from stiction.comparisons.measures.drift import drift_table
from stiction.comparisons.measures.scene_truth import truth_for
from stiction.comparisons.measures.torque_jumps import torque_table
from stiction.comparisons.results import Results
from stiction.comparisons.studies.constraint_drift import drift_study_comparison
from stiction.comparisons.studies.drift_suppression import suppression_comparison
from stiction.comparisons.studies.equal_error import SCENES, equal_error, equal_error_comparison
from stiction.comparisons.studies.effects import effects_comparison
from stiction.comparisons.studies.engine_settings import load_study, settings_study
from stiction.comparisons.studies.paper_claims import claims_comparison, drift_claims, sensitivity_comparison
from stiction.comparisons.studies.stick_threshold import threshold_comparison, true_thresholds
from stiction.comparisons.studies.work_precision import work_precision
from stiction.comparisons.timing.timed_runs import machine_while_timing
from stiction.comparisons.truth import NO_TRUTH, Truth
from stiction.comparisons.variants import Record, has_static_coefficient
from stiction.engines.isolation import Isolate, Outcome
from stiction.scenes import load_scene

SECONDS = {"claims": 5.5, "threshold": 3.0, "sensitivity": 18.0, "study": 1.2, "orders": 0.7, "hard": 0.15, "accuracy": 0.6}
"""What a run of each comparison takes on one core, roughly: for the estimate of the time that is left, and nothing else."""
TIMED_SECONDS = 0.25
"""The same of what is timed, with nothing beside it."""


def validate(*, depth: Depth = Depth.DEFAULT, engines: Sequence[str] | None = None, workers: int | None = None,
             on_result: Callable[[Outcome], None] | None = None, on_share: Callable[[float], None] | None = None, on_table: Callable[[str, pd.DataFrame], None] | None = None,
             isolated: Isolate | None = None, timed_by: Isolate | None = None) -> Results:
    """Run the campaign and compare.

    Parameters
    ----------
    depth
        How far it goes: `stiction.comparisons.campaigns.participants.extent`.
    engines
        External engines to take part; all known ones where None. The reference always does.
    workers, on_result, isolated, timed_by
        See `stiction.comparisons.campaigns.comparison.make`.
    on_share
        Told again and again which part of the work is done, 0 to 1.
    on_table
        Told each table, or the rows of it about a scene, as soon as the runs behind it are there, by name; of ``accuracy`` the finest run
        of each variant. ``truth`` has the threshold of the independent solution.
    """
    started, cpu_started, load_before = time.perf_counter(), time.process_time(), load()
    scenes = {scene.name: scene for scene in validation_campaign().scenes}
    cases = dict(enumerate(scenes.values(), 1))
    first, limits, chosen = cases[1], extent(depth), variants(engines, depth)
    static = {variant.label: has_static_coefficient(variant) for variant in chosen}
    spent = 0.0

    def count(outcome: Outcome) -> None:
        nonlocal spent
        spent += outcome.cpu_s or 0.0
        if on_result is not None:
            on_result(outcome)

    sizes, measured = {name: size_of(scene) for name, scene in scenes.items()}, dict[str, Mapping[str, Any]]()

    def compared_with(record: Record) -> Truth:
        return truth_for(scenes[record.scene], [record], static_coefficient=static[record.variant.label])

    def errors_of(record: Record) -> Mapping[str, Any]:
        """Found while other runs are made: a run that has been timed since has another cost, and the same motion."""
        if record.key not in measured:
            measured[record.key] = errors(record.trajectory, compared_with(record), sizes[record.scene])
        return measured[record.key]

    def finest(records: Sequence[Record]) -> pd.DataFrame:
        table = accuracy_table(records, errors_of)
        return table[[record.step == record.variant.ladder[-1] for record in records]]

    tell = on_table or (lambda name, table: None)
    options: dict[str, Any] = {"workers": workers, "timeout_s": limits.limit, "isolated": isolated, "timed_by": timed_by}
    [true] = make([true_thresholds(first)], on_result=count, **options)
    tell("truth", pd.DataFrame([{"threshold [N]": one.F0, "uncertainty [N]": one.uncertainty, "reason": one.note} for one in (true[True],)]))
    studied = [name for name in load_study().engines if engines is None or name in engines]
    elsewhere = [load_scene(name) for name in SCENES if name != first.name]
    plan = [
        _Part("claims", claims_comparison(cases, true[True])),  # the longest first: no core waits for them in the end
        *(_Part("accuracy", records_comparison([scene], chosen), finest) for scene in scenes.values()),
        _Part("threshold", threshold_comparison(first, threshold_variants(engines, depth), limits.bracket, true)),
        _Part("study", drift_study_comparison(cases, depth), lambda study: study.table),
        *([_Part("sensitivity", sensitivity_comparison(cases))] if limits.sensitivity else []),
        _Part("hard", hard_comparison(depth=depth, engines=engines), lambda hard: hard.table),
        _Part("orders", orders_comparison(first)),
        _Part("cost", work_precision(first, cost_variants(engines, depth), repeats=limits.repeats, budget_s=limits.ladder), lambda timed: timed.table),
        _Part("effects", effects_comparison(first, repeats=limits.repeats), lambda timed: timed.table),
        _Part("suppression", suppression_comparison(first, repeats=limits.repeats), lambda timed: timed.table),
        *([_Part("equal-error", equal_error_comparison(elsewhere, cost_variants(engines, depth), limits.repeats, limits.ladder), lambda found: found.table)]
          if limits.equal_error else []),
        *([_Part("settings", settings_study(studied, repeats=limits.repeats))] if limits.settings and studied else []),
    ]
    watch = _Watch(plan, on_share or (lambda share: None), tell)

    def count_and_tell(outcome: Outcome) -> None:
        count(outcome)
        watch.result(outcome)

    made = make([part.comparison for part in plan], on_start=watch.start, on_result=count_and_tell, **options)
    found: dict[str, list[Any]] = defaultdict(list)
    for part, value in zip(plan, made, strict=True):
        found[part.name].append(value)
        if part.comparison.rounds and not watch.interrupted:
            tell(part.name, part.shown(value))
    records = tuple(record for part in found["accuracy"] for record in part)
    [study], [hard], [cost], [effects], [suppression] = (found[name] for name in ("study", "hard", "cost", "effects", "suppression"))
    truths_by_key = {record.key: compared_with(record) for record in records}
    samples = pd.concat([part.samples for part in (cost, effects, suppression, *found["equal-error"])], ignore_index=True)
    equal = pd.concat([equal_error(cost.table, cost.samples), *(part.table for part in found["equal-error"])], ignore_index=True)
    tables = {
        "accuracy": accuracy_table(records, errors_of), "drift": drift_table(records), "study": study.table, "octaves": study.octaves,
        **{name: found[name][0] for name in ("orders", "threshold")}, "torque": torque_table(records, truths_by_key),
        "claims": pd.concat([found["claims"][0], pd.DataFrame(drift_claims(study.table, first.name)).assign(status="ok", reason="")], ignore_index=True),
        "hard": hard.table, "cost": cost.table, "effects": effects.table, "suppression": suppression.table,
        "times": samples, "equal-error": equal, **{name: tables[0] for name, tables in found.items() if name in ("sensitivity", "settings")}}
    settings = {"depth": str(depth), "engines": list(dict.fromkeys(variant.engine for variant in chosen)), "time limit [s]": limits.limit,
                "workers": workers, "trajectories": limits.trajectories, "interrupted": watch.interrupted, "machine before": load_before,
                "machine while timing": machine_while_timing(samples), "machine after": load()}
    truths = {truth.scene: truth for truth in truths_by_key.values() if truth.tier != NO_TRUTH}
    return Results(records, truths, tables, settings, time.perf_counter() - started, time.process_time() - cpu_started + spent,
                      cost.records + effects.records + suppression.records, hard.problems)


@dataclass(frozen=True)
class _Part:
    """A comparison of the campaign: the name of its table, and what is shown of what it yields."""

    name: str
    comparison: Comparison[Any]
    shown: Callable[[Any], pd.DataFrame] = lambda table: table


class _Watch:
    """Tells how much is done, and each comparison as soon as all of its runs are; what is timed comes last, all of it together.

    Attributes
    ----------
    interrupted : bool
        Whether there are runs that were not made: then nothing more is told, and the report has what was done.
    """

    def __init__(self, plan: Sequence[_Part], on_share: Callable[[float], None], on_table: Callable[[str, pd.DataFrame], None]):
        self._on_share, self._on_table = on_share, on_table
        self._plan = [part for part in plan if not part.comparison.rounds]
        self._outcomes: list[dict[int, Outcome]] = [{} for _ in self._plan]
        self._awaited: dict[str, list[tuple[int, int]]] = defaultdict(list)
        for number, part in enumerate(self._plan):
            for place, task in enumerate(part.comparison.tasks):
                self._awaited[task.label].append((number, place))
        self._done = self._total = 0.0
        self.interrupted = False

    def start(self, number: int) -> None:
        """Of results that will come."""
        counts = [len(part.comparison.tasks) for part in self._plan]
        self._total = sum(SECONDS[part.name] * count for part, count in zip(self._plan, counts)) + TIMED_SECONDS * (number - sum(counts))

    def result(self, outcome: Outcome) -> None:
        number, place = awaited.pop(0) if (awaited := self._awaited[outcome.label]) else (None, 0)
        self._done += TIMED_SECONDS if number is None else SECONDS[self._plan[number].name]
        self._on_share(min(self._done / self._total, 1.0))  # rounds may be more than the least
        self.interrupted |= outcome.status == NOT_RUN
        if number is not None:
            part, outcomes = self._plan[number], self._outcomes[number]
            outcomes[place] = outcome
            if len(outcomes) == len(part.comparison.tasks) and not self.interrupted:
                self._on_table(part.name, part.shown(part.comparison.tabulate([outcomes[i] for i in range(len(outcomes))])))
