"""The main job: the paper's three cases through every variant, and the comparisons on them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import pandas as pd

from comparisons.accuracy import accuracy_table, size_of
from comparisons.claims import claims_table, sensitivity_table
from comparisons.cost import cost_variants, work_precision
from comparisons.drift import drift_table
from comparisons.drift_study import drift_study, drift_tasks
from comparisons.effects import effects_table, toggles
from comparisons.hard import compare_hard, hard_runs
from comparisons.orders import orders_table
from comparisons.problems import Problem
from comparisons.suppression import suppression_table, suppression_variants
from comparisons.threshold import threshold_table, threshold_tasks, true_thresholds
from comparisons.torque import torque_table
from comparisons.truth import Truth, slider_bar_truth
from comparisons.variants import Record, has_static_coefficient, job, physics_of, truth_key, variants
from engines.isolation import Isolate, Outcome, isolate, simulation
from engines.moreau import compile_kernels as compile_moreau
from engines.reference import compile_kernels
from scenes import Scene, load_scene

CASES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3")
THRESHOLD_CASE = COST_CASE = CASES[0]

THRESHOLD_LADDERS = {
    "reference": (1e-9,),
    "Exudyn": (1e-2, 5e-3), "Exudyn, contact": (1e-2, 5e-3),
    "pymunk": (1e-2, 2.5e-3, 1e-3), "pymunk, contact": (1e-2, 2.5e-3),
    "PyBullet": (1e-2, 2.5e-3, 1e-3), "PyBullet, contact": (1e-2, 2.5e-3),
}
"""Steps of the threshold measurements: some ten simulations of 40 s each, so coarser than the runs."""

THRESHOLD_WIDTH = {True: 2e-2, False: 1e-3}
"""N; bracket of the engines' thresholds, quick and full."""

TIME_LIMIT = {True: 60.0, False: 240.0}
"""Seconds that one run or measurement may take, quick and full."""


@dataclass(frozen=True)
class Validation:
    """What the main job yields.

    Attributes
    ----------
    records : tuple of Record
        Every run, failures included.
    truths : Mapping[str, Truth]
        By name of the scene; with the ending `variants.MUS_EQUALS_MU`, of the scene with mus = mu.
    tables : Mapping[str, DataFrame]
        ``accuracy``, ``drift``, ``study`` and ``octaves`` of drift over long runs, ``orders``, ``threshold``, ``torque``, ``claims`` and, unless quick, their ``sensitivity``,
        ``hard``; of `COST_CASE` ``cost``, ``effects``, ``suppression``.
    settings : Mapping
        Of the campaign: quick or not, engines, time limit, workers.
    wall_s, cpu_s : float
    timed : tuple of Record
        The runs behind ``cost``, ``effects`` and ``suppression``, failures included.
    problems : tuple of Problem
        The complementarity problems that the reference met in the hard cases.
    """

    records: tuple[Record, ...]
    truths: Mapping[str, Truth]
    tables: Mapping[str, pd.DataFrame]
    settings: Mapping[str, object] = field(default_factory=dict)
    wall_s: float = 0.0
    cpu_s: float = 0.0
    timed: tuple[Record, ...] = ()
    problems: tuple[Problem, ...] = ()


def validate(*, quick: bool = False, engines: Sequence[str] | None = None, workers: int | None = None,
             on_start: Callable[[int], None] | None = None, on_result: Callable[[Outcome], None] | None = None,
             on_compared: Callable[[Validation], None] | None = None, isolated: Isolate = isolate) -> Validation:
    """Run the campaign and compare.

    Parameters
    ----------
    quick
        Coarser ladders, shorter time limit.
    engines
        External engines to take part; all known ones where None. The reference always does.
    workers
        Child processes at a time; the number of CPUs where None.
    on_start
        Called once with the number of runs and measurements.
    on_result
        Called with each outcome as it comes in.
    on_compared
        Called in another thread, while runs are still being timed, with everything but the tables of their times.
    isolated
        How the runs are made: `kept.KeptRuns.isolate` keeps each as soon as it is there.
    """
    started, cpu_started = time.perf_counter(), time.process_time()
    compile_kernels()
    chosen = variants(engines, quick)
    if any(variant.engine == "moreau" for variant in chosen):
        compile_moreau()
    static = {variant.label: has_static_coefficient(variant) for variant in chosen}
    scenes = {name: load_scene(name) for name in CASES}
    runs = sorted(((scene, variant, step) for scene in scenes.values() for variant in chosen for step in variant.ladder),
                  key=lambda run: (run[1].parameter, run[2]))
    ladders = {label: steps[:1] if quick else steps for label, steps in THRESHOLD_LADDERS.items()}
    thresholds = true_thresholds(scenes[THRESHOLD_CASE])
    measurements = threshold_tasks(scenes[THRESHOLD_CASE], chosen, static, ladders, thresholds, THRESHOLD_WIDTH[quick])
    numbered = {i + 1: scenes[name] for i, name in enumerate(CASES)}
    studied = drift_tasks(numbered, quick)
    # the longest first, so that no core waits for another at the end
    tasks = [task for *_, task in measurements] + studied + [
        simulation(job(physics_of(scene, static[variant.label]), variant, step)) for scene, variant, step in runs]
    if on_start is not None:
        on_start(len(tasks) + hard_runs(engines, quick) + _timed_runs(scenes[COST_CASE], engines, quick))
    outcomes = isolated(tasks, workers=workers, timeout_s=TIME_LIMIT[quick], on_result=on_result)
    measured = [Record(outcome.label, THRESHOLD_CASE, variant, step, outcome)
                for (variant, step, _), outcome in zip(measurements, outcomes)]
    study, octaves = drift_study(outcomes[len(measured):len(measured) + len(studied)])
    records = tuple(Record(outcome.label, scene.name, variant, step, outcome)
                    for (scene, variant, step), outcome in zip(runs, outcomes[len(measured) + len(studied):], strict=True))
    records = tuple(sorted(records, key=lambda r: (r.scene, chosen.index(r.variant), -r.step)))
    hard = compare_hard(quick=quick, engines=engines, workers=workers, on_result=on_result, isolated=isolated)
    settings = {"quick": quick, "engines": list(dict.fromkeys(v.engine for v in chosen)), "time limit [s]": TIME_LIMIT[quick],
                "workers": workers}
    timed: list[Record] = []

    def compared() -> Validation:
        truths = {key: replace(slider_bar_truth(physics_of(scene, has_mus)), scene=key)
                  for name, scene in scenes.items() for has_mus in sorted(set(static.values()))
                  for key in [truth_key(name, has_mus)]}
        truth_for = {record.key: truths[truth_key(record.scene, static[record.variant.label])] for record in records}
        tables = {
            "accuracy": accuracy_table(records, truth_for, {name: size_of(scene) for name, scene in scenes.items()}),
            "drift": drift_table(records), "study": study, "octaves": octaves,
            "threshold": threshold_table(scenes[THRESHOLD_CASE], measured, static, thresholds),
            "torque": torque_table(records, truth_for),
            "claims": claims_table(numbered, thresholds[True], study), "hard": hard.table, "orders": orders_table(scenes[COST_CASE])}
        if not quick:
            tables["sensitivity"] = sensitivity_table(numbered)
        found = Validation(records, truths, tables, settings, problems=hard.problems)
        if on_compared is not None:
            on_compared(found)
        return found

    with ThreadPoolExecutor(1) as beside:  # one run at a time is timed: another core has nothing to do
        comparing = beside.submit(compared)
        costs = _costs(scenes[COST_CASE], engines, quick, TIME_LIMIT[quick], on_result, timed.append, isolated)
    found = comparing.result()
    cpu = time.process_time() - cpu_started + sum(outcome.cpu_s or 0.0 for outcome in outcomes)
    return replace(found, tables={**found.tables, **costs}, wall_s=time.perf_counter() - started, cpu_s=cpu, timed=tuple(timed))


def _timed_runs(scene: Scene, engines: Sequence[str] | None, quick: bool) -> int:
    """The number of results of `_costs`."""
    ladders = (*cost_variants(engines, quick), *suppression_variants())
    return sum(len(variant.ladder) for variant in ladders) + len(list(toggles(scene)))


def _costs(scene: Scene, engines: Sequence[str] | None, quick: bool, timeout_s: float,
           on_result: Callable[[Outcome], None] | None, on_record: Callable[[Record], None], isolated: Isolate) -> dict[str, pd.DataFrame]:
    """The comparisons that measure time: after all others, one run at a time."""
    options: dict[str, Any] = {"repeats": 1 if quick else 3, "timeout_s": timeout_s, "on_result": on_result,
                               "on_record": on_record, "isolated": isolated}
    return {"cost": work_precision(scene, cost_variants(engines, quick), **options), "effects": effects_table(scene, **options),
            "suppression": suppression_table(scene, **options)}
