"""The runs of variants on scenes, whose records several studies share."""

from __future__ import annotations

from collections.abc import Sequence

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.variants import Record, Variant, has_static_coefficient, job, physics_of
from stiction.engines.isolation import Outcome, simulation
from stiction.scenes import Scene


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
