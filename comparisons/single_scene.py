"""One comparison on any one scene: the variants run in child processes, and failures are rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pandas as pd

from comparisons.drift import drift_table
from comparisons.ground import ground_truth
from comparisons.threshold import threshold_table, threshold_tasks, true_thresholds
from comparisons.torque import torque_table
from comparisons.validation import THRESHOLD_LADDERS, THRESHOLD_WIDTH
from comparisons.variants import Record, Variant, has_static_coefficient, job, physics_of
from engines.isolation import Outcome, Task, isolate, simulation
from engines.reference import compile_kernels
from scenes import InputError, Scene

OTHER_LADDER = (1e-2, 2.5e-3)
"""Seconds; steps of the threshold measurements of engines that the main job has none for."""


@dataclass(frozen=True)
class Campaign:
    """How the variants are run; for the fields see `engines.isolate`. `on_start` is told the number of runs."""

    timeout_s: float
    workers: int | None = None
    on_start: Callable[[int], None] | None = None
    on_result: Callable[[Outcome], None] | None = None

    def run(self, tasks: Sequence[Task]) -> list[Outcome]:
        """Kernels are compiled here first, lest every child does it within its time limit."""
        compile_kernels()
        if self.on_start is not None:
            self.on_start(len(tasks))
        return isolate(tasks, workers=self.workers, timeout_s=self.timeout_s, on_result=self.on_result)


def compare_drift(scene: Scene, variants: Sequence[Variant], campaign: Campaign, t_end: float | None = None) -> pd.DataFrame:
    """`drift_table` of the scene."""
    return drift_table(_records(scene, variants, campaign, t_end))


def compare_torque(scene: Scene, variants: Sequence[Variant], campaign: Campaign, t_end: float | None = None,
                   drive: str | None = None) -> pd.DataFrame:
    """`torque_table` of the scene for the effort of a drive, the first one where None.

    Raises
    ------
    InputError
        If the scene has no such drive.
    """
    if not scene.drives:
        raise InputError(f"{scene.name}: no drive; expected one, whose effort can jump")
    drive = next(iter(scene.drives)) if drive is None else drive
    if drive not in scene.drives:
        raise InputError(f"drive: found {drive!r}; expected one of {', '.join(scene.drives)}")
    static = {variant.label: has_static_coefficient(variant) for variant in variants}
    truths = {has_mus: ground_truth(physics_of(scene, has_mus), t_end) for has_mus in set(static.values())}
    records = _records(scene, variants, campaign, t_end)
    return torque_table(records, {record.key: truths[static[record.variant.label]] for record in records}, f"{drive}.effort")


def compare_threshold(scene: Scene, variants: Sequence[Variant], campaign: Campaign, quick: bool = False) -> pd.DataFrame:
    """`threshold_table` of the scene, with the steps of the main job.

    Raises
    ------
    InputError
        If the scene is not the slider-bar: only its reduced solution has a threshold to compare with.
    """
    static = {variant.label: has_static_coefficient(variant) for variant in variants}
    true = true_thresholds(scene)
    ladders = {variant.label: OTHER_LADDER for variant in variants if variant.engine != "reference"} | THRESHOLD_LADDERS
    ladders = {label: steps[:1] if quick else steps for label, steps in ladders.items()}
    measurements = threshold_tasks(scene, variants, static, ladders, true, THRESHOLD_WIDTH[quick])
    outcomes = campaign.run([task for *_, task in measurements])
    records = [Record(outcome.label, scene.name, variant, step, outcome)
               for (variant, step, _), outcome in zip(measurements, outcomes)]
    return threshold_table(scene, records, static, true)


def _records(scene: Scene, variants: Sequence[Variant], campaign: Campaign, t_end: float | None) -> list[Record]:
    rungs = [(variant, step) for variant in variants for step in variant.ladder]
    end = {} if t_end is None else {"t_end": t_end}
    outcomes = campaign.run([simulation(job(physics_of(scene, has_static_coefficient(variant)), variant, step, **end))
                             for variant, step in rungs])
    return [Record(outcome.label, scene.name, variant, step, outcome) for (variant, step), outcome in zip(rungs, outcomes)]
