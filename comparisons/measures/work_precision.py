"""Errors and CPU times of the runs of refinement series, for work-precision diagrams.

A refinement series is a sequence of runs from coarse to fine steps, tolerances or iterations.
`stiction.comparisons.measures.equal_error` computes from it the time to a given error. For series
of steps, the observed order of convergence is computed here.
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

POSITION = "position_error"
"""Column: position error, m."""
ORDER = "position_order"
"""Column: observed order of the position error between a run and the next coarser one."""
FLOOR = 100.0
"""Ratio of an error to the truth's uncertainty above which the order is computed: the uncertainty
changes the error by at most 1 %."""
TOTAL = "cpu_time"
"""Column: median of the CPU time of all steps, including the adapter, s."""
TOTAL_LOW = "cpu_time_low"
"""Column: lower end of the interval of `TOTAL`, s."""
TOTAL_HIGH = "cpu_time_high"
"""Column: upper end of the interval of `TOTAL`, s."""
LOW = "engine_time_low"
"""Column: lower end of the interval of `OWN_CPU`, by which engines are ranked, s."""
HIGH = "engine_time_high"
"""Column: upper end of the interval of `OWN_CPU`, s."""
LEVEL = "interval_level"
"""Column: level of the intervals."""
TIMING = "timing"
"""Column: why the time is uncertain; empty if it is not."""


@dataclass(frozen=True)
class Timed:
    """The result of a comparison with measured times.

    Attributes
    ----------
    table : DataFrame
        One row for each run.
    records : tuple of Record
        The runs.
    samples : DataFrame
        Samples of their times, see `samples_table`.
    """

    table: pd.DataFrame
    records: tuple[Record, ...]
    samples: pd.DataFrame

    def as_tables(self, name: str) -> Tables:
        """Return the table under a name, the samples as ``times``, and the runs, as tables of a study."""
        return Tables({name: self.table, "times": self.samples}, timed=self.records)


@dataclass(frozen=True)
class TimedRun:
    """A run to be timed.

    Attributes
    ----------
    scene : Scene
    variant : Variant
    step : float
        Value of the variant's parameter.
    name : str
        Appended to the key of the run, to distinguish runs that differ in their settings only.
    settings : Mapping
        Settings that differ from those of the variant.
    """

    scene: Scene
    variant: Variant
    step: float
    name: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)


Rows = Callable[[Sequence[Record], Sequence[Timing | None]], Iterable[dict[str, Any]]]
"""A function that computes the rows of a table from runs and their times, which are None for failed
runs."""


def timed_comparison(
    scene: Scene,
    runs: Sequence[TimedRun],
    t_end: float | None,
    repeats: int,
    rows: Rows,
    budget_s: float = math.inf,
) -> Comparison[Timed]:
    """Return the comparison that times runs.

    Parameters
    ----------
    scene : Scene
        The scene whose name the records have.
    runs : sequence of TimedRun
        The runs of a variant go from coarse to fine.
    t_end : float or None
        End of the simulations, s; that of the scene if None.
    repeats : int
        Minimum number of timing rounds.
    rows : callable
        Computes the rows of the table.
    budget_s : float
        CPU time for the rounds of one variant, s. Runs that exceed it are timed once.
    """
    jobs = []
    for run in runs:
        run_job = job(run.scene, run.variant, run.step, t_end=t_end, **run.settings)
        if run.name:
            run_job = replace(run_job, label=f"{run_job.label}/{run.name}")
        jobs.append(run_job)

    def tabulate(outcomes: Sequence[Outcome]) -> Timed:
        records = []
        timings = [outcome.value for outcome in outcomes]
        for run, run_job, outcome, timing in zip(runs, jobs, outcomes, timings):
            with_trajectory = replace(outcome, value=timing.trajectory if timing else None)
            records.append(
                Record(run_job.label, scene.name, run.variant, run.step, with_trajectory)
            )
        samples = samples_table({record.key: timing for record, timing in zip(records, timings)})
        table = pd.DataFrame(list(rows(records, timings)))
        return Timed(table, tuple(records), samples)

    # Labels must be different from those of other comparisons, which may have runs with the same
    # key.
    tasks = tuple(replace(simulation(run_job), label=f"timed/{run_job.label}") for run_job in jobs)
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
    """Return the comparison of errors and times of all runs of refinement series, one row for each run.

    Parameters
    ----------
    scene : Scene
    variants : sequence of Variant
        The ladders are the refinement series.
    t_end, repeats, budget_s
        As of `timed_comparison`.
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
    """Return the columns of the cost of a run, in addition to those of `Record.describe`; none if it failed."""
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
    """Return the table of runs with the column `ORDER`, for runs with a step size."""
    table = table.assign(**{ORDER: np.nan})
    if POSITION not in table:
        return table
    stepped = table[succeeded(table) & (table["parameter"] == "dt")]
    for _, series in stepped.groupby("variant", sort=False):
        step = series["step"].to_numpy(float)
        error = series[POSITION].to_numpy(float)
        uncertainty = series["position_uncertainty"].to_numpy(float)
        # Each pair of neighbours whose finer error is well above the uncertainty of the truth.
        fine = 1 + np.flatnonzero((error[1:] > FLOOR * uncertainty[1:]) & (error[:-1] > 0))
        error_ratio = np.log(error[fine - 1] / error[fine])
        table.loc[series.index[fine], ORDER] = error_ratio / np.log(step[fine - 1] / step[fine])
    return table
