"""What accuracy costs: error against CPU time along the ladder of every variant.

A ladder is a sequence of runs from coarse to fine: steps, tolerances or iterations. Per ladder the CPU time at which it reaches
a given error: engines are compared at equal error, not at equal step. Per ladder of steps also observed order, Richardson
extrapolation and grid convergence index (Roache 1994; ASME V&V 20-2009, Sect. 2; Celik et al., J. Fluids Eng. 130 (2008)
078001); a tolerance or a number of iterations is not the step of an error expansion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from comparisons.accuracy import WRONG, errors, graph, size_of, truth_graph
from comparisons.distances import hausdorff
from comparisons.ground import ground_truth
from comparisons.truth import NO_TRUTH, Truth
from comparisons.variants import (OWN_CPU, PAPER_UNSTABILIZED, REFERENCE_BAUMGARTE, REFERENCE_TIGHT, TRIAL, Record, Variant,
                                  has_static_coefficient, job, physics_of, time_factor)
from comparisons.variants import variants as main_variants
from engines.accelerations import METHOD
from engines.isolation import Isolate, Outcome, Task, isolate
from engines.reference import compile_kernels
from engines.registry import load_engine
from scenes import Scene, Trajectory

STEPS = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
"""Seconds; rungs of the ladders of fixed-step variants, as far as they lie within the variant's ladder of the main job."""

TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
"""rtol; rungs of the event-driven reference."""

ITERATED = {"pymunk": "pymunk, iterations at fixed dt", "pybullet": "PyBullet, iterations at fixed dt"}
"""Labels of the ladders of engines that solve a step by a number of iterations."""
ITERATIONS = (2, 5, 10, 50)

ACCELERATIONS = {"pybullet": "PyBullet's accelerations, event-driven", "mujoco": "MuJoCo's accelerations, event-driven"}
"""Labels of the ladders of engines whose accelerations can be had under our own integrator (`engines.accelerations`)."""
ACCELERATION_TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9)

TARGETS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)
"""Position errors (m) at which variants are compared."""

SAFETY = 1.25
"""Factor of the grid convergence index for three rungs or more (Roache)."""

ORDERS = (1e-3, 20.0)
"""Between which an observed order is looked for; no method here exceeds 8."""

FLOOR = 100.0
"""Errors below this many times the truth's own uncertainty are not differences of the method any more."""

FASTEST, SLOWEST = f"{OWN_CPU}, fastest", f"{OWN_CPU}, slowest"
"""Of the repeats, what the engine itself took; engines are ranked by its median, `OWN_CPU`. The reference is counted whole."""

OUTPUT_STEP = 0.01
"""Seconds between the instants at which errors are measured, times `variants.time_factor`."""


def cost_variants(engines: Iterable[str] | None = None, quick: bool = False) -> tuple[Variant, ...]:
    """The variants of the main job over longer ladders, those whose ladder is a number of iterations, and engines' accelerations.

    Parameters
    ----------
    engines, quick
        As for `comparisons.variants.variants`; quick takes the coarser half of every ladder.
    """
    found = []
    for variant in main_variants(engines):
        if variant in (PAPER_UNSTABILIZED, TRIAL):
            # errors and costs are those of the stabilized scheme (its drift is `compare_suppression`'s), and of the reference
            continue
        steps = TOLERANCES if variant in (REFERENCE_TIGHT, REFERENCE_BAUMGARTE) else \
            tuple(step for step in STEPS if variant.ladder[-1] <= step <= variant.ladder[0])
        found.append(replace(variant, ladder=steps))
        if variant.engine in ITERATED and variant.fidelity == "joint":
            found.append(Variant(ITERATED[variant.engine], variant.engine, "iterations", ITERATIONS, settings={"dt": 2e-3}))
        if variant.engine in ACCELERATIONS and variant.fidelity == "joint":
            found.append(Variant(ACCELERATIONS[variant.engine], variant.engine, "rtol", ACCELERATION_TOLERANCES,
                                 settings={"method": METHOD}))
    return tuple(replace(v, ladder=v.ladder[:(len(v.ladder) + 1) // 2]) for v in found) if quick else tuple(found)


@dataclass(frozen=True)
class Timing:
    """A run and what it costs: `trajectory` as it was asked for, its cost the medians of `stepping_s` and `own_s`.

    CPU seconds of each repeat: of stepping, and of that inside the engine's own calls (`scenes.Cost.own_s`).
    """

    trajectory: Trajectory
    stepping_s: tuple[float, ...]
    own_s: tuple[float, ...]


OWN_TIMING = 0.2
"""Seconds of stepping per repeat asked for."""


def timed_run(engine: str, scene: Scene, arguments: dict[str, Any], repeats: int) -> Timing:
    """Simulate once for the result, which also warms up, then `repeats` times for the time, in this process.

    The timed runs have start and end as their only output: what they cost is the motion, not the table of it. Times are
    medians, counters those of a timed run. A run that takes longer than `OWN_TIMING` is not repeated; it is its own timing.
    """
    solver = load_engine(engine)
    result = solver.simulate(scene, **arguments)
    bare = arguments | {"output_step": arguments.get("t_end") or scene.t_end}
    runs = [result] if result.cost.stepping_s > OWN_TIMING * repeats else [solver.simulate(scene, **bare) for _ in range(repeats)]
    seconds, own = (tuple(getattr(run.cost, name) for run in runs) for name in ("stepping_s", "own_s"))
    cost = replace(result.cost, setup_s=median(run.cost.setup_s for run in runs), stepping_s=median(seconds), engine_s=median(own),
                   counters=runs[-1].cost.counters)
    return Timing(replace(result, cost=cost), seconds, own)


def timed_record(scene: Scene, variant: Variant, step: float, outcome: Outcome) -> Record:
    """The record of a run from the outcome of its `timed_run`."""
    timing: Timing | None = outcome.value
    return Record(outcome.label, scene.name, variant, step, replace(outcome, value=timing.trajectory if timing else None))


def work_precision(scene: Scene, variants: Sequence[Variant], *, t_end: float | None = None, repeats: int = 5,
                   workers: int | None = 1, timeout_s: float = 240.0, on_start: Callable[[int], None] | None = None,
                   on_result: Callable[[Outcome], None] | None = None,
                   on_record: Callable[[Record], None] | None = None, isolated: Isolate = isolate) -> pd.DataFrame:
    """Run every rung of every ladder and measure error and cost; one row per rung, failures included.

    Parameters
    ----------
    repeats
        Timed repeats per rung; times are medians.
    workers
        Children at a time. One by default, so that runs do not take the machine from each other while they are timed.
    on_record
        Called with each run, whose trajectory the table does not hold.
    isolated
        How the runs are made.
    """
    compile_kernels()  # here, lest the first child does it within its time limit
    static = {variant.label: has_static_coefficient(variant) for variant in variants}
    truths = {has_mus: ground_truth(physics_of(scene, has_mus), t_end) for has_mus in set(static.values())}
    size = size_of(scene)
    rungs = [(variant, step) for variant in variants for step in variant.ladder]
    tasks = []
    for variant, step in rungs:
        run = job(physics_of(scene, static[variant.label]), variant, step, t_end=t_end, output_step=OUTPUT_STEP * time_factor(scene, t_end))
        tasks.append(Task(run.label, timed_run, (run.engine, run.scene, dict(run.arguments), repeats)))
    if on_start is not None:
        on_start(len(tasks))
    rung_of = {task.label: rung for task, rung in zip(tasks, rungs, strict=True)}
    rows: dict[str, Future[dict[str, Any]]] = {}

    def row(record: Record, timing: Timing | None) -> dict[str, Any]:
        truth = truths[static[record.variant.label]]
        found = {**record.describe(), **cost_of(timing), **errors(record.trajectory, truth, size)}
        if found["status"] == WRONG:
            return found
        return {**found, **_distances(record.trajectory, truth), **_end_state(record.trajectory, truth)}

    with ThreadPoolExecutor(1) as beside:  # while the next run is timed

        def settle(outcome: Outcome) -> None:
            timing: Timing | None = outcome.value
            record = timed_record(scene, *rung_of[outcome.label], outcome)
            rows[outcome.label] = beside.submit(row, record, timing)
            if on_record is not None:
                on_record(record)
            if on_result is not None:
                on_result(outcome)

        isolated(tasks, workers=workers, timeout_s=timeout_s, on_result=settle)
    return _with_orders(pd.DataFrame([rows[task.label].result() for task in tasks]))


def came_out(table: pd.DataFrame) -> pd.Series:
    """Which rows are runs that reached their end: one that stopped early is cheap and may not have met what is hard."""
    return (table["status"] == "ok") & (table["reason"].fillna("") == "")


def cost_of(timing: Timing | None) -> dict[str, Any]:
    if timing is None:
        return {}
    cost, spread, own = timing.trajectory.cost, timing.stepping_s, timing.own_s
    return {"set-up [s]": cost.setup_s, "compile [s]": cost.compile_s, "stepping [s]": cost.stepping_s,
            "stepping, fastest [s]": min(spread), "stepping, slowest [s]": max(spread), FASTEST: min(own), SLOWEST: max(own),
            "repeats": len(spread),
            **{f"{name} [-]": count for name, count in cost.counters.items()}}


def _distances(trajectory: Trajectory | None, truth: Truth) -> dict[str, Any]:
    """Distances of the motion beside the largest errors: mean over time (L1), and Hausdorff distance between graphs.

    The mean is over the output instants. The graphs are those of the coordinate with the largest error, time in seconds,
    values in units of their range; its uncertainty is that of straight lines between the output instants.
    """
    row: dict[str, Any] = {}
    if trajectory is None or len(trajectory.t) < 2 or truth.tier == NO_TRUTH:
        return row
    t = trajectory.t
    exact = truth(t)
    for label, suffixes, unit in (("position", ("x", "y"), "m"), ("velocity", ("vx", "vy"), "m/s")):
        size = {name: np.abs(trajectory[name] - exact[name]) for name in exact
                if name.rpartition(".")[2] in suffixes and name in trajectory}
        if not size:
            continue
        row[f"{label} error, L1 mean [{unit}]"] = max(float(np.trapezoid(error, t)) / (t[-1] - t[0]) for error in size.values())
        worst = max(size, key=lambda name: float(size[name].max()))
        distance = hausdorff(graph(trajectory, worst), truth_graph(truth, worst, t), 1.0, float(np.ptp(exact[worst])) or 1.0)
        row |= {f"{label} Hausdorff distance [-]": distance.value, f"{label} Hausdorff uncertainty [-]": distance.uncertainty}
    return row


def _end_state(trajectory: Trajectory | None, truth: Truth) -> dict[str, Any]:
    """The functional of the grid convergence index: x at the end, of the body that moves most along x in truth."""
    if trajectory is None or not len(trajectory.t) or truth.tier == NO_TRUTH:
        return {}
    exact = truth(trajectory.t)
    name = max((column for column in exact if column.endswith(".x") and column in trajectory),
               key=lambda column: float(np.ptp(exact[column])))
    return {"functional": f"{name}(t_end)", "functional value [m]": float(trajectory[name][-1])}


def _with_orders(table: pd.DataFrame) -> pd.DataFrame:
    """Of ladders of steps observed orders between neighbouring rungs; from three rungs on Richardson extrapolation and GCI."""
    new = ["order, position [-]", "order, functional [-]", "extrapolated [m]", "grid convergence index [m]"]
    table = table.reindex(columns=[*table.columns, *new])
    if "position error [m]" not in table:
        return table
    for _, ladder in table[came_out(table) & (table["parameter"] == "dt")].groupby("variant", sort=False):
        step, error, value = (ladder[name].to_numpy(dtype=float) for name in ("step", "position error [m]", "functional value [m]"))
        floor = FLOOR * ladder["position uncertainty [m]"].to_numpy(dtype=float)
        for i in range(1, len(ladder)):
            if error[i] > floor[i] and error[i - 1] > 0:
                table.loc[ladder.index[i], new[0]] = np.log(error[i - 1] / error[i]) / np.log(step[i - 1] / step[i])
        for i in range(2, len(ladder)):
            found = richardson(step[i - 2:i + 1], value[i - 2:i + 1])
            if found is not None:
                table.loc[ladder.index[i], new[1:]] = found.order, found.extrapolated, found.index
    return table


@dataclass(frozen=True)
class Extrapolation:
    """Observed order, extrapolated value, and the grid convergence index in the unit of the value."""

    order: float
    extrapolated: float
    index: float


def richardson(step: Sequence[float], value: Sequence[float]) -> Extrapolation | None:
    """Extrapolation from three rungs, coarse to fine, with any ratios of their steps.

    With e32 = coarse - medium, e21 = medium - fine, r21 and r32 the ratios of the steps, the order p solves
    e32/e21 = r21^p (r32^p - 1)/(r21^p - 1), which is Celik et al. 2008, eq. 3, for steps that differ in one direction. The right
    side increases with p, so that there is one root or none. The index is SAFETY |e21|/(r21^p - 1).

    Returns
    -------
    Extrapolation or None
        None where the values do not tell: no change between rungs, changes of opposite signs, or no order within `ORDERS`.
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


def time_to_error(table: pd.DataFrame, targets: Iterable[float] = TARGETS, error: str = "position error [m]",
                  cost: str = OWN_CPU) -> pd.DataFrame:
    """CPU seconds of the engines that each variant needs for given errors, interpolated on its ladder; one row per variant.

    Between neighbouring rungs log(cost) is linear in log(error). An error that the coarsest rung already meets has the cost of
    that rung, an upper bound, and is named in the column ``at most``; one that no rung meets has no value. Nothing is
    extrapolated, and runs that did not come out, or not to their end, only count as failed.
    """
    targets, rows = tuple(targets), []
    for variant, ladder in table.groupby("variant", sort=False):
        known = ladder[error].notna() if error in ladder else pd.Series(False, index=ladder.index)
        good = ladder[came_out(ladder) & known]
        sizes, costs = ((good[name] if len(good) else good["step"]).to_numpy(dtype=float) for name in (error, cost))
        row: dict[str, Any] = {"variant": variant, "engine": ladder["engine"].iloc[0], "rungs": len(ladder), "failed": int((~came_out(ladder)).sum()),
                               "smallest error": float(sizes.min()) if len(good) else np.nan}
        row |= {f"{target:g} m": cost_at(sizes, costs, target) for target in targets}
        row["at most"] = ", ".join(f"{target:g} m" for target in targets if len(good) and sizes[0] <= target)
        rows.append(row)
    return pd.DataFrame(rows)


def cost_at(error: np.ndarray, cost: np.ndarray, target: float) -> float:
    """Smallest cost at which the broken line through the rungs, coarse to fine, in logarithms, meets the target; nan if nowhere."""
    error = np.maximum(error, np.finfo(float).tiny)
    best = [float(price) for size, price in zip(error, cost) if size <= target]
    for i in range(1, len(error)):
        if error[i - 1] > target > error[i]:
            share = np.log(error[i - 1] / target) / np.log(error[i - 1] / error[i])
            best.append(float(cost[i - 1] ** (1 - share) * cost[i] ** share))
    return min(best, default=np.nan)
