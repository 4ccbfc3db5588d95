"""Drift suppression as a choice of its own: none, Baumgarte, projection after each step; cost, drift and error side by side.

The two ways of the reference take each choice at equal rtol or step; nothing else differs between the rows.
"""

from __future__ import annotations

from collections.abc import Callable

import pandas as pd

from comparisons.accuracy import errors, size_of
from comparisons.cost import OUTPUT_STEP, Timing, cost_of, timed_record, timed_run
from comparisons.drift import drift
from comparisons.ground import ground_truth
from comparisons.variants import Record, Variant, job, scaled, time_factor
from engines.isolation import Isolate, Outcome, Task, isolate
from engines.reference import compile_kernels
from scenes import Scene

CHOICES = ("none", "baumgarte", "projection")
WAYS = (("event-driven", "rtol", (1e-6, 1e-9)), ("paper's scheme", "dt", (1e-2, 1e-3)))


def suppression_variants() -> tuple[Variant, ...]:
    """Both ways of the reference with each choice, at two tolerances or steps."""
    return tuple(Variant(f"{way}, {choice}", "reference", parameter, ladder, settings={
        "method": "event" if parameter == "rtol" else "paper", "stabilization": choice})
        for way, parameter, ladder in WAYS for choice in CHOICES)


def suppression_table(scene: Scene, *, t_end: float | None = None, repeats: int = 5, workers: int | None = 1,
                      timeout_s: float = 240.0, on_start: Callable[[int], None] | None = None,
                      on_result: Callable[[Outcome], None] | None = None,
                      on_record: Callable[[Record], None] | None = None, isolated: Isolate = isolate) -> pd.DataFrame:
    """One row per way, choice and rung; see `comparisons.cost.work_precision` for the arguments.

    Baumgarte's alpha and beta are the scene's or, where it declares none, the paper's; they stand in the column settings.
    """
    compile_kernels()
    truth, size = ground_truth(scene, t_end), size_of(scene)
    rungs = [(variant, step) for variant in scaled(suppression_variants(), scene, t_end) for step in variant.ladder]
    tasks = []
    for variant, step in rungs:
        run = job(scene, variant, step, t_end=t_end, output_step=OUTPUT_STEP * time_factor(scene, t_end))
        tasks.append(Task(run.label, timed_run, (run.engine, run.scene, dict(run.arguments), repeats)))
    if on_start is not None:
        on_start(len(tasks))
    rows = []
    for (variant, step), outcome in zip(rungs, isolated(tasks, workers=workers, timeout_s=timeout_s, on_result=on_result)):
        timing: Timing | None = outcome.value
        record = timed_record(scene, variant, step, outcome)
        if on_record is not None:
            on_record(record)
        rows.append({**record.describe(), "suppression": variant.settings["stabilization"], **cost_of(timing),
                     **drift(record.trajectory), **errors(record.trajectory, truth, size)})
    return pd.DataFrame(rows)
