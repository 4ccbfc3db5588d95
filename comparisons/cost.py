"""What accuracy costs: error against CPU time along the ladder of every variant.

A ladder is a sequence of runs from coarse to fine steps or tolerances. Per ladder: observed order, Richardson extrapolation
and grid convergence index (Roache 1994; ASME V&V 20-2009, Sect. 2; Celik et al., J. Fluids Eng. 130 (2008) 078001), and the
CPU time at which the ladder reaches a given error: engines are compared at equal error, not at equal step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

import numpy as np
import pandas as pd

from comparisons.accuracy import errors
from comparisons.ground import ground_truth
from comparisons.truth import Truth
from comparisons.variants import Record, Variant, has_static_coefficient, job, physics_of
from engines.isolation import Outcome, Task, isolate
from engines.registry import load_engine
from scenes import Scene, Trajectory

TARGETS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)
"""Position errors (m) at which variants are compared."""

SAFETY = 1.25
"""Factor of the grid convergence index for three rungs or more (Roache)."""

FLOOR = 100.0
"""Errors below this many times the truth's own uncertainty are not differences of the method any more."""


@dataclass(frozen=True)
class Timing:
    """CPU seconds of the repeats of a run, by phase; `trajectory` is that of the last one, its cost their medians."""

    trajectory: Trajectory
    stepping_s: tuple[float, ...]


def timed_run(engine: str, scene: Scene, arguments: dict[str, Any], repeats: int) -> Timing:
    """Simulate `repeats` times in this process after one run that is not counted (compiling, loading).

    Of a run that takes longer than a second the uncounted one is counted as the only one.
    """
    solver = load_engine(engine)
    warm = solver.simulate(scene, **arguments)
    runs = [warm] if warm.cost.stepping_s > 1.0 else [solver.simulate(scene, **arguments) for _ in range(repeats)]
    cost = replace(warm.cost, setup_s=median(run.cost.setup_s for run in runs),
                   stepping_s=median(run.cost.stepping_s for run in runs))
    return Timing(replace(runs[-1], cost=cost), tuple(run.cost.stepping_s for run in runs))


def work_precision(scene: Scene, variants: Sequence[Variant], *, t_end: float | None = None, repeats: int = 5,
                   workers: int | None = 1, timeout_s: float = 240.0, on_start: Callable[[int], None] | None = None,
                   on_result: Callable[[Outcome], None] | None = None) -> pd.DataFrame:
    """Run every rung of every ladder and measure error and cost; one row per rung, failures included.

    Parameters
    ----------
    repeats
        Timed repeats per rung; times are medians.
    workers
        Children at a time. One by default, so that runs do not take the machine from each other while they are timed.
    """
    static = {variant.label: has_static_coefficient(variant) for variant in variants}
    truths = {has_mus: ground_truth(physics_of(scene, has_mus), t_end) for has_mus in set(static.values())}
    rungs = [(variant, step) for variant in variants for step in variant.ladder]
    tasks = []
    for variant, step in rungs:
        run = job(physics_of(scene, static[variant.label]), variant, step, t_end=t_end, output_step=0.01)
        tasks.append(Task(run.label, timed_run, (run.engine, run.scene, dict(run.arguments), repeats)))
    if on_start is not None:
        on_start(len(tasks))
    rows = []
    for (variant, step), outcome in zip(rungs, isolate(tasks, workers=workers, timeout_s=timeout_s, on_result=on_result)):
        timing: Timing | None = outcome.value
        record = Record(outcome.label, scene.name, variant, step, replace(outcome, value=timing.trajectory if timing else None))
        rows.append({**record.describe(), **_cost(timing), **errors(record.trajectory, truths[static[variant.label]]),
                     **_end_state(record.trajectory)})
    return _with_orders(pd.DataFrame(rows))


def _cost(timing: Timing | None) -> dict[str, Any]:
    if timing is None:
        return {}
    cost, spread = timing.trajectory.cost, timing.stepping_s
    return {"set-up [s]": cost.setup_s, "compile [s]": cost.compile_s, "stepping [s]": cost.stepping_s,
            "stepping, fastest [s]": min(spread), "stepping, slowest [s]": max(spread), "repeats": len(spread),
            **{f"{name} [-]": count for name, count in cost.counters.items()}}


def _end_state(trajectory: Trajectory | None) -> dict[str, Any]:
    """The functional of the grid convergence index: the first moving body's x at the end."""
    if trajectory is None or not len(trajectory.t):
        return {}
    name = max((column for column in trajectory.columns if column.endswith(".x")),
               key=lambda column: float(np.ptp(trajectory[column])))
    return {"functional": f"{name}(t_end)", "functional value [m]": float(trajectory[name][-1])}


def _with_orders(table: pd.DataFrame) -> pd.DataFrame:
    """Observed orders between neighbouring rungs and, from three rungs on, Richardson extrapolation and GCI."""
    new = ["order, position [-]", "order, functional [-]", "extrapolated [m]", "grid convergence index [m]"]
    table = table.reindex(columns=[*table.columns, *new])
    if "position error [m]" not in table:
        return table
    for _, ladder in table[table["status"] == "ok"].groupby("variant", sort=False):
        ladder = ladder.sort_values("step", ascending=False)
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

    The order p solves p = |ln|e32/e21| + q(p)| / ln r21, q(p) = ln((r21^p - s)/(r32^p - s)), s = sgn(e32/e21)
    (Celik et al. 2008, eq. 3), e32 = coarse - medium, e21 = medium - fine; the index is SAFETY |e21|/(r21^p - 1).

    Returns
    -------
    Extrapolation or None
        None where the values do not tell: no change between rungs, oscillating ones (s < 0), or no order found.
    """
    (h3, h2, h1), (f3, f2, f1) = step, value
    e32, e21 = f3 - f2, f2 - f1
    if e21 == 0 or e32 == 0 or e32 / e21 <= 0:
        return None
    r21, r32 = h2 / h1, h3 / h2
    p = 1.0
    for _ in range(200):
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            q = np.log((r21 ** p - 1) / (r32 ** p - 1))
            new = abs(np.log(e32 / e21) + q) / np.log(r21)
        if not np.isfinite(new) or new == 0:
            return None
        if abs(new - p) < 1e-10:
            p = float(new)
            ratio = r21 ** p - 1
            return Extrapolation(p, float(f1 - e21 / ratio), float(SAFETY * abs(e21) / ratio))
        p = 0.5 * (p + float(new))
    return None


def time_to_error(table: pd.DataFrame, targets: Iterable[float] = TARGETS, error: str = "position error [m]",
                  cost: str = "stepping [s]") -> pd.DataFrame:
    """CPU seconds that each variant needs for given errors, interpolated on its ladder; one row per variant.

    Between neighbouring rungs log(cost) is linear in log(error). An error that the coarsest rung already meets costs at most
    that rung, which is what stands in the table; one that no rung meets has no value. Nothing is extrapolated.
    """
    rows = []
    for variant, ladder in table.groupby("variant", sort=False):
        good = ladder[(ladder["status"] == "ok") & ladder.get(error, pd.Series(index=ladder.index, dtype=float)).notna()]
        row: dict[str, Any] = {"variant": variant, "rungs": len(ladder), "failed": int((ladder["status"] != "ok").sum()),
                               "smallest error": float(good[error].min()) if len(good) else None}
        for target in targets:
            row[f"{target:g} m"] = _cost_at(good[error].to_numpy(dtype=float), good[cost].to_numpy(dtype=float), target) \
                if len(good) else None
        rows.append(row)
    return pd.DataFrame(rows)


def _cost_at(error: np.ndarray, cost: np.ndarray, target: float) -> float | None:
    """Smallest cost at which the broken line through the rungs, in logarithms, meets the target."""
    order = np.argsort(-error, kind="stable")
    error, cost = np.maximum(error[order], np.finfo(float).tiny), cost[order]
    best = [cost[i] for i in range(len(error)) if error[i] <= target]
    for i in range(1, len(error)):
        if error[i - 1] > target >= error[i]:
            share = np.log(error[i - 1] / target) / np.log(error[i - 1] / error[i])
            best.append(cost[i - 1] ** (1 - share) * cost[i] ** share)
    return float(min(best)) if best else None
