"""Comparisons on any one scene: failures are rows."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.measures.torque_jumps import torque_table
from stiction.comparisons.variants import Record, Variant, has_static_coefficient, job, physics_of
from stiction.engines.isolation import Outcome, simulation
from stiction.scenes import InputError, Scene


def records_comparison(scenes: Sequence[Scene], variants: Sequence[Variant], t_end: float | None = None) -> Comparison[tuple[Record, ...]]:
    """Every variant at every rung of its ladder on every scene; yields the records in this order.

    Engines without a static coefficient run the scene with mus = mu. The finest steps are begun first, so that no core waits for another
    at the end.
    """
    static = {variant.label: has_static_coefficient(variant) for variant in variants}
    runs = [(scene, variant, step) for scene in scenes for variant in variants for step in variant.ladder]
    order = sorted(range(len(runs)), key=lambda i: (runs[i][1].parameter, runs[i][2]))

    def tabulate(outcomes: Sequence[Outcome]) -> tuple[Record, ...]:
        by_run = dict(zip(order, outcomes))
        return tuple(Record(by_run[i].label, scene.name, variant, step, by_run[i]) for i, (scene, variant, step) in enumerate(runs))

    tasks = [simulation(job(physics_of(scene, static[variant.label]), variant, step, t_end=t_end)) for scene, variant, step in runs]
    return Comparison(tuple(tasks[i] for i in order), tabulate, tuple(variants))


def torque_comparison(scene: Scene, variants: Sequence[Variant], t_end: float | None = None, drive: str | None = None) -> Comparison[pd.DataFrame]:
    """`torque_table` of the scene for the effort of a drive, the first one where None.

    Raises
    ------
    InputError
        If the scene has no such drive.
    """
    if not scene.drives:
        raise InputError(f"{scene.name}: no drive; expected one, whose effort can jump")
    chosen = next(iter(scene.drives)) if drive is None else drive
    if chosen not in scene.drives:
        raise InputError(f"drive: found {drive!r}; expected one of {', '.join(scene.drives)}")
    runs = records_comparison([scene], variants, t_end)

    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        static = {variant.label: has_static_coefficient(variant) for variant in variants}
        truths = {has_mus: ground_truth(physics_of(scene, has_mus), t_end) for has_mus in set(static.values())}
        records = runs.tabulate(outcomes)
        return torque_table(records, {record.key: truths[static[record.variant.label]] for record in records}, f"{chosen}.effort")

    return Comparison(runs.tasks, tabulate, runs.variants)
