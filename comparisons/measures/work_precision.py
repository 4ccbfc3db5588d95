"""Error against CPU time, run by run, along the refinement series of every variant.

A refinement series is a sequence of runs from coarse to fine: steps, tolerances or iterations. The time to a given
error is that of `stiction.comparisons.measures.equal_error`. Series of steps also have an observed order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import succeeded
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Tables
from stiction.comparisons.bench.timing.timed_runs import samples_table
from stiction.comparisons.bench.timing.visits import Timing
from stiction.comparisons.bench.variants import (
    Record,
    Variant,
    coefficients_of,
    has_static_coefficient,
    job,
)
from stiction.comparisons.measures.accuracy import errors, size_of
from stiction.comparisons.measures.scene_truth import truths_for
from stiction.engines.isolation import Outcome, simulation
from stiction.scenes import Scene
from stiction.truths.physics import physics_of

POSITION, ORDER = "position_error", "position_order"
FLOOR = 100.0
"""Multiple of the truth's uncertainty below which errors are not differences of the method any more."""
TOTAL, TOTAL_LOW, TOTAL_HIGH = "cpu_time", "cpu_time_low", "cpu_time_high"
"""Median of the time of a whole run, the adapter included, and the ends of its interval."""
LOW, HIGH = "engine_time_low", "engine_time_high"
"""Ends of the interval of `OWN_CPU`, by which engines are ranked; the reference is counted whole."""
LEVEL, TIMING = "interval_level", "timing"
"""Probability of the interval, and what makes the time unsure, in words."""


@dataclass(frozen=True)
class Timed:
    """A row per timed run, the runs with their trajectories, and the samples of their times, see `samples_table`."""

    table: pd.DataFrame
    records: tuple[Record, ...]
    samples: pd.DataFrame

    def as_tables(self, name: str) -> Tables:
        """The table under a name, its times, and its runs."""
        return Tables({name: self.table, "times": self.samples}, timed=self.records)


@dataclass(frozen=True)
class TimedRun:
    """A run of a variant at a step on a scene to be timed, with the engine's settings that it changes."""

    scene: Scene
    variant: Variant
    step: float
    name: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)


Rows = Callable[[Sequence[Record], Sequence[Timing | None]], Iterable[dict[str, Any]]]


def timed_comparison(
    scene: Scene,
    runs: Sequence[TimedRun],
    t_end: float | None,
    repeats: int,
    rows: Rows,
    budget_s: float = math.inf,
) -> Comparison[Timed]:
    """Time runs in at least `repeats` rounds, those of a variant beyond `budget_s` once; `rows` makes the table."""
    jobs = []
    for run in runs:
        made = job(run.scene, run.variant, run.step, t_end=t_end, **run.settings)
        jobs.append(replace(made, label=made.label + (f"/{run.name}" if run.name else "")))

    def tabulate(outcomes: Sequence[Outcome]) -> Timed:
        timings = [outcome.value for outcome in outcomes]
        made = [
            replace(outcome, value=timing.trajectory if timing else None)
            for outcome, timing in zip(outcomes, timings)
        ]
        records = tuple(
            Record(job.label, scene.name, run.variant, run.step, outcome)
            for run, job, outcome in zip(runs, jobs, made)
        )
        times = samples_table({record.key: timing for record, timing in zip(records, timings)})
        return Timed(pd.DataFrame(list(rows(records, timings))), records, times)

    # a label of its own: another comparison may have a run with the same key
    tasks = tuple(replace(simulation(job), label=f"timed/{job.label}") for job in jobs)
    variants = tuple({run.variant.label: run.variant for run in runs}.values())
    return Comparison(
        tasks,
        tabulate,
        variants,
        rounds=repeats,
        budget_s=budget_s,
        ladders=tuple(f"{scene.name}/{run.variant.label}" for run in runs),
    )


def work_precision(
    scene: Scene,
    variants: Sequence[Variant],
    *,
    t_end: float | None = None,
    repeats: int = 5,
    budget_s: float = math.inf,
) -> Comparison[Timed]:
    """Error and cost of every run of every refinement series, a row per run, failures included.

    Parameters
    ----------
    repeats
        Rounds in which every run is timed, at least; times are medians.
    budget_s
        CPU seconds that the rounds of one series may take. Finer runs are timed once, as `TIMING` says.
    """
    size = size_of(scene)

    def rows(
        records: Sequence[Record], timings: Sequence[Timing | None]
    ) -> Iterator[dict[str, Any]]:
        truths = truths_for(scene, records, t_end)
        for record, timing in zip(records, timings):
            yield {
                **record.describe(),
                **coefficients_of(record.variant),
                **cost_of(timing),
                **errors(record.trajectory, truths[record.key], size),
            }

    runs = [
        TimedRun(physics_of(scene, has_static_coefficient(variant)), variant, step)
        for variant in variants
        for step in variant.ladder
    ]
    comparison = timed_comparison(scene, runs, t_end, repeats, rows, budget_s)
    return comparison.then(lambda timed: replace(timed, table=_with_orders(timed.table)))


def cost_of(timing: Timing | None) -> dict[str, Any]:
    """The columns of what a run costs, for tables whose rows begin with `Record.describe`."""
    if timing is None:
        return {}
    cost = timing.trajectory.cost
    total, own = timing.interval("stepping_s"), timing.interval("own_s")
    return {
        "setup_time": cost.setup_s,
        "compile_time": cost.compile_s,
        "stepping_time": cost.stepping_s,
        TOTAL_LOW: total.low,
        TOTAL_HIGH: total.high,
        LOW: own.low,
        HIGH: own.high,
        LEVEL: own.level,
        "repeats": own.samples,
        TIMING: timing.note,
        **{f"counter:{name}": count for name, count in cost.counters.items()},
    }


def _with_orders(table: pd.DataFrame) -> pd.DataFrame:
    """Add observed orders between neighbouring steps."""
    table = table.assign(**{ORDER: np.nan})
    if POSITION not in table:
        return table
    stepped = table[succeeded(table) & (table["parameter"] == "dt")]
    for _, series in stepped.groupby("variant", sort=False):
        step, error, unsure = (
            series[name].to_numpy(float) for name in ("step", POSITION, "position_uncertainty")
        )
        # where the finer of two errors is that of the method, not of the truth
        fine = 1 + np.flatnonzero((error[1:] > FLOOR * unsure[1:]) & (error[:-1] > 0))
        ratio = np.log(error[fine - 1] / error[fine])
        table.loc[series.index[fine], ORDER] = ratio / np.log(step[fine - 1] / step[fine])
    return table
