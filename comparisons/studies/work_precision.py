"""Error against CPU time, run by run, along the refinement series of every variant.

A refinement series is a sequence of runs from coarse to fine: steps, tolerances or iterations. The time to a given
error is that of `stiction.comparisons.studies.equal_error`. Per series of steps also observed order, Richardson
extrapolation and grid convergence index (Roache 1994; ASME V&V 20-2009, Sect. 2; Celik et al., J. Fluids Eng. 130
(2008) 078001); a tolerance or a number of iterations is not the step of an error expansion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.measures.accuracy import WRONG, errors, graph, size_of, truth_graph
from stiction.comparisons.measures.distances import hausdorff
from stiction.comparisons.measures.scene_truth import truths_for
from stiction.comparisons.methods import succeeded
from stiction.comparisons.studies.study import Tables
from stiction.comparisons.timing.rounds import Timing
from stiction.comparisons.timing.timed_runs import samples_table
from stiction.comparisons.truth import NO_TRUTH, Truth
from stiction.comparisons.variants import OWN_CPU, Record, Variant, has_static_coefficient, job, physics_of
from stiction.engines.isolation import Outcome, simulation
from stiction.scenes import Scene, Trajectory

SAFETY = 1.25
"""Factor of the grid convergence index for three runs or more (Roache)."""
ORDERS = (1e-3, 20.0)
"""Between which an observed order is looked for; no method here exceeds 8."""
FLOOR = 100.0
"""Multiple of the truth's uncertainty below which errors are not differences of the method any more."""
TOTAL, TOTAL_LOW, TOTAL_HIGH = "cpu [s]", "cpu [s], low", "cpu [s], high"
"""Median of the time of a whole run, the adapter included, and the ends of its interval."""
LOW, HIGH = f"{OWN_CPU}, low", f"{OWN_CPU}, high"
"""Ends of the interval of `OWN_CPU`, by which engines are ranked; the reference is counted whole."""
LEVEL, TIMING = "level of the interval [-]", "timing"
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


def timed_comparison(scene: Scene, runs: Sequence[TimedRun], t_end: float | None, repeats: int, rows: Rows,
                     budget_s: float = math.inf) -> Comparison[Timed]:
    """Time runs in at least `repeats` rounds, those of a variant beyond `budget_s` once; `rows` makes the table."""
    jobs = []
    for run in runs:
        made = job(run.scene, run.variant, run.step, t_end=t_end, **run.settings)
        jobs.append(replace(made, label=made.label + (f"/{run.name}" if run.name else "")))

    def tabulate(outcomes: Sequence[Outcome]) -> Timed:
        timings = [outcome.value for outcome in outcomes]
        made = [replace(outcome, value=timing.trajectory if timing else None)
                for outcome, timing in zip(outcomes, timings)]
        records = tuple(Record(job.label, scene.name, run.variant, run.step, outcome)
                        for run, job, outcome in zip(runs, jobs, made))
        times = samples_table({record.key: timing for record, timing in zip(records, timings)})
        return Timed(pd.DataFrame(list(rows(records, timings))), records, times)

    # a label of its own: another comparison may have a run with the same key
    tasks = tuple(replace(simulation(job), label=f"timed/{job.label}") for job in jobs)
    variants = tuple({run.variant.label: run.variant for run in runs}.values())
    return Comparison(tasks, tabulate, variants, rounds=repeats, budget_s=budget_s,
                      ladders=tuple(f"{scene.name}/{run.variant.label}" for run in runs))


def work_precision(scene: Scene, variants: Sequence[Variant], *, t_end: float | None = None, repeats: int = 5,
                   budget_s: float = math.inf) -> Comparison[Timed]:
    """Error and cost of every run of every refinement series, a row per run, failures included.

    Parameters
    ----------
    repeats
        Rounds in which every run is timed, at least; times are medians.
    budget_s
        CPU seconds that the rounds of one series may take. Finer runs are timed once, as `TIMING` says.
    """
    size = size_of(scene)

    def rows(records: Sequence[Record], timings: Sequence[Timing | None]) -> Iterator[dict[str, Any]]:
        truths = truths_for(scene, records, t_end)
        for record, timing in zip(records, timings):
            run, truth = record.trajectory, truths[record.key]
            row = {**record.describe(), **cost_of(timing), **errors(run, truth, size)}
            if row["status"] != WRONG and run is not None and len(run.t) > 1 and truth.tier != NO_TRUTH:
                row |= _distances(run, truth)
            yield row

    runs = [TimedRun(physics_of(scene, has_static_coefficient(variant)), variant, step)
            for variant in variants for step in variant.ladder]
    found = timed_comparison(scene, runs, t_end, repeats, rows, budget_s)
    return found.then(lambda timed: replace(timed, table=_with_orders(timed.table)))


def cost_of(timing: Timing | None) -> dict[str, Any]:
    """The columns of what a run costs, for tables whose rows begin with `Record.describe`."""
    if timing is None:
        return {}
    cost, total, own = timing.trajectory.cost, timing.interval("stepping_s"), timing.interval("own_s")
    return {"set-up [s]": cost.setup_s, "compile [s]": cost.compile_s, "stepping [s]": cost.stepping_s,
            TOTAL_LOW: total.low, TOTAL_HIGH: total.high, LOW: own.low, HIGH: own.high, LEVEL: own.level,
            "repeats": own.samples, TIMING: timing.note,
            **{f"{name} [-]": count for name, count in cost.counters.items()}}


def _distances(trajectory: Trajectory, truth: Truth) -> dict[str, Any]:
    """Columns of other distances than the largest errors, and the functional of the grid convergence index.

    These are means over the output instants (L1), and the Hausdorff distance of the graphs of the coordinate with the
    largest error: time in seconds, values in units of their range, straight lines between the output instants. The
    functional is x at the end, of the body that moves most along x in truth.
    """
    row: dict[str, Any] = {}
    t, exact = trajectory.t, truth(trajectory.t)
    for label, suffixes, unit in (("position", ("x", "y"), "m"), ("velocity", ("vx", "vy"), "m/s")):
        size = {name: np.abs(trajectory[name] - exact[name]) for name in exact
                if name.rpartition(".")[2] in suffixes and name in trajectory}
        if not size:
            continue
        means = [float(np.trapezoid(error, t)) / (t[-1] - t[0]) for error in size.values()]
        worst = max(size, key=lambda name: float(size[name].max()))
        scale = float(np.ptp(exact[worst])) or 1.0
        distance = hausdorff(graph(trajectory, worst), truth_graph(truth, worst, t), 1.0, scale)
        row |= {f"{label} error, L1 mean [{unit}]": max(means), f"{label} Hausdorff distance [-]": distance.value,
                f"{label} Hausdorff uncertainty [-]": distance.uncertainty}
    name = max((column for column in exact if column.endswith(".x") and column in trajectory),
               key=lambda column: float(np.ptp(exact[column])))
    return row | {"functional": f"{name}(t_end)", "functional value [m]": float(trajectory[name][-1])}


def _with_orders(table: pd.DataFrame) -> pd.DataFrame:
    """Add observed orders between neighbouring steps; of three steps also Richardson extrapolation and GCI."""
    new = ["order, position [-]", "order, functional [-]", "extrapolated [m]", "grid convergence index [m]"]
    table = table.reindex(columns=[*table.columns, *new])
    if "position error [m]" not in table:
        return table
    for _, series in table[succeeded(table) & (table["parameter"] == "dt")].groupby("variant", sort=False):
        step, error, value = (series[name].to_numpy(dtype=float)
                              for name in ("step", "position error [m]", "functional value [m]"))
        floor = FLOOR * series["position uncertainty [m]"].to_numpy(dtype=float)
        for i in range(1, len(series)):
            if error[i] > floor[i] and error[i - 1] > 0:
                order = np.log(error[i - 1] / error[i]) / np.log(step[i - 1] / step[i])
                table.loc[series.index[i], new[0]] = order
        for i in range(2, len(series)):
            found = richardson(step[i - 2:i + 1], value[i - 2:i + 1])
            if found is not None:
                table.loc[series.index[i], new[1:]] = found.order, found.extrapolated, found.index
    return table


@dataclass(frozen=True)
class Extrapolation:
    """Observed order, extrapolated value, and the grid convergence index in the unit of the value."""

    order: float
    extrapolated: float
    index: float


def richardson(step: Sequence[float], value: Sequence[float]) -> Extrapolation | None:
    """Extrapolate from three steps, coarse to fine, with any ratios.

    With e32 = coarse - medium, e21 = medium - fine, r21 and r32 the ratios of the steps, the order p solves
    e32/e21 = r21^p (r32^p - 1)/(r21^p - 1), which is Celik et al. 2008, eq. 3, for steps that differ in one direction.
    The right side increases with p, so that there is one root or none. The index is SAFETY |e21|/(r21^p - 1).

    Returns
    -------
    Extrapolation or None
        None if values are equal, change in opposite directions, or have no order within `ORDERS`.
    """
    (h3, h2, h1), (f3, f2, f1) = step, value
    e32, e21 = f3 - f2, f2 - f1
    if e21 == 0 or e32 / e21 <= 0:
        return None
    r21, r32 = h2 / h1, h3 / h2

    def excess(p: float) -> float:
        return p * np.log(r21) + np.log(np.expm1(p * np.log(r32)) / np.expm1(p * np.log(r21))) - np.log(e32 / e21)

    low, high = ORDERS
    if not excess(low) < 0 < excess(high):
        return None
    p = float(brentq(excess, low, high, xtol=1e-12))
    ratio = r21 ** p - 1
    return Extrapolation(p, float(f1 - e21 / ratio), float(SAFETY * abs(e21) / ratio))
