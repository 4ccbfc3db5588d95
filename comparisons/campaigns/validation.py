"""The main job: the paper's three cases through every variant, and the comparisons on them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import pandas as pd

from stiction.comparisons.campaigns.comparison import make
from stiction.comparisons.campaigns.participants import cost_variants, threshold_variants, validation_campaign, variants
from stiction.comparisons.campaigns.single_scene import records_comparison
from stiction.comparisons.complementarity.problems import Problem
from stiction.comparisons.environment import load
from stiction.comparisons.hard import hard_comparison
from stiction.comparisons.measures.accuracy import accuracy_table, size_of
from stiction.comparisons.measures.convergence_orders import orders_comparison
from stiction.comparisons.measures.drift import drift_table
from stiction.comparisons.measures.torque_jumps import torque_table
from stiction.comparisons.studies.drift_study import drift_study_comparison
from stiction.comparisons.studies.drift_suppression import suppression_comparison
from stiction.comparisons.studies.equal_error import SCENES, equal_error, equal_error_comparison
from stiction.comparisons.studies.effects import effects_comparison
from stiction.comparisons.studies.paper_claims import claims_table, sensitivity_comparison
from stiction.comparisons.studies.stick_threshold import THRESHOLD_WIDTH, threshold_comparison
from stiction.comparisons.studies.work_precision import work_precision
from stiction.comparisons.timing.rounds import LEAST
from stiction.comparisons.timing.timed_runs import machine_while_timing
from stiction.comparisons.truth import Truth, slider_bar_truth
from stiction.comparisons.variants import Record, has_static_coefficient, physics_of, truth_key
from stiction.engines.isolation import Isolate, Outcome
from stiction.scenes import load_scene

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
        ``accuracy``, ``drift``, ``study`` and ``octaves`` of drift over long runs, ``threshold``, ``torque``, ``claims`` and, unless quick,
        their ``sensitivity``, ``hard``; of the first scene ``orders``, ``cost``, ``effects``, ``suppression``, and ``times``: the samples behind
        all times; ``equal error`` of the first scene and, unless quick, of all of `stiction.comparisons.studies.equal_error.SCENES`.
    settings : Mapping
        Of the campaign: quick or not, engines, time limit, workers, and the machine's load before, while timing and after.
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
             isolated: Isolate | None = None) -> Validation:
    """Run the campaign and compare; for the last four parameters see `stiction.comparisons.campaigns.comparison.make`.

    Parameters
    ----------
    quick
        Coarser ladders, shorter time limit.
    engines
        External engines to take part; all known ones where None. The reference always does.
    """
    started, cpu_started, load_before = time.perf_counter(), time.process_time(), load()
    scenes = {scene.name: scene for scene in validation_campaign().scenes}
    cases = dict(enumerate(scenes.values(), 1))
    first = cases[1]
    chosen, repeats = variants(engines, quick), 1 if quick else LEAST
    more = {} if quick else {
        "sensitivity": sensitivity_comparison(cases),
        "equal error": equal_error_comparison([load_scene(name) for name in SCENES if name != first.name], cost_variants(engines), repeats)}
    spent = 0.0

    def count(outcome: Outcome) -> None:
        nonlocal spent
        spent += outcome.cpu_s or 0.0
        if on_result is not None:
            on_result(outcome)

    thresholds, study, records, hard, orders, cost, effects, suppression, *found = make([
        threshold_comparison(first, threshold_variants(engines, quick), THRESHOLD_WIDTH[quick]),  # the longest first, so that no core waits for another
        drift_study_comparison(cases, quick),
        records_comparison(list(scenes.values()), chosen),
        hard_comparison(quick=quick, engines=engines),
        orders_comparison(first),
        work_precision(first, cost_variants(engines, quick), repeats=repeats),
        effects_comparison(first, repeats=repeats),
        suppression_comparison(first, repeats=repeats),
        *more.values(),
    ], workers=workers, timeout_s=TIME_LIMIT[quick], on_start=on_start, on_result=count, isolated=isolated)
    static = {variant.label: has_static_coefficient(variant) for variant in chosen}
    truths = {truth_key(name, has_mus): replace(slider_bar_truth(physics_of(scene, has_mus)), scene=truth_key(name, has_mus))
              for name, scene in scenes.items() for has_mus in sorted(set(static.values()))}
    truth_for = {record.key: truths[truth_key(record.scene, static[record.variant.label])] for record in records}
    extra = dict(zip(more, found))
    wider = [extra.pop("equal error")] if "equal error" in extra else []
    samples = pd.concat([cost.samples, effects.samples, suppression.samples, *(part.samples for part in wider)], ignore_index=True)
    tables = {
        "accuracy": accuracy_table(records, truth_for, {name: size_of(scene) for name, scene in scenes.items()}),
        "drift": drift_table(records), "study": study.table, "octaves": study.octaves, "orders": orders,
        "threshold": thresholds.table, "torque": torque_table(records, truth_for),
        "claims": claims_table(cases, thresholds.true[True], study.table), "hard": hard.table,
        "cost": cost.table, "effects": effects.table, "suppression": suppression.table, "times": samples,
        **extra, "equal error": pd.concat([equal_error(cost.table, cost.samples), *(part.table for part in wider)], ignore_index=True)}
    settings = {"quick": quick, "engines": list(dict.fromkeys(variant.engine for variant in chosen)), "time limit [s]": TIME_LIMIT[quick],
                "workers": workers, "machine before": load_before, "machine while timing": machine_while_timing(samples), "machine after": load()}
    return Validation(records, truths, tables, settings, time.perf_counter() - started, time.process_time() - cpu_started + spent,
                      cost.records + effects.records + suppression.records, hard.problems)
