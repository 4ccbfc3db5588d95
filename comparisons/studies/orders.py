"""Observed orders of convergence with their intervals, only where the errors are in the asymptotic range.

On a stretch without events every method has the order of its integrator. Across a break-away, which it notices up to a
step late, the paper's scheme is of first order. The event-driven reference has a tolerance instead of a step: its steps
are its time over their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd

from stiction.comparisons.bench.presentation import (
    LIMIT,
    Axis,
    Chart,
    Column,
    Panel,
    Presentation,
    Series,
    row_of,
    view,
)
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.measures.accuracy import errors
from stiction.comparisons.measures.power_law import fitted_exponent
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.measures.work_precision import FLOOR
from stiction.engines.isolation import Outcome, Task
from stiction.engines.reference.engine import ReferenceEngine
from stiction.engines.status import UNMADE
from stiction.scenes import Scene, Trajectory, vary
from stiction.truths import Truth, slider_bar_truth

FEWEST = 4
"""Least number of runs that an order is fitted to: two for the line, two for its uncertainty."""
ALIKE = 0.25
"""Part of the order by which the slopes between neighbouring runs of the asymptotic range may differ.

The next term of the error is then at most a quarter of the leading one at the coarser of two steps in ratio 2.
"""
SMOOTH = 80.0
"""s; of a stretch without events: the slider-bar without friction."""
STEPS = (0.08, 0.04, 0.02, 0.01, 0.005)
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
AFTER = 1.2
"""s; ends before the first change of corners."""
HALVES = (10, 20, 40, 80, 160)
"""Whole steps before the break-away, which comes half a step later: it is then noticed half a step late."""
ERROR, UNSURE = "position_error", "position_uncertainty"
STEP, ORDER, OBSERVED = "mean_step", "promised_order", "observed_order"
HALF = "observed_order_uncertainty"
COLUMNS = (
    "scene",
    "method",
    STEP,
    ERROR,
    UNSURE,
    ORDER,
    OBSERVED,
    HALF,
    "runs",
    "why_none",
    "status",
    "reason",
)


@dataclass(frozen=True)
class Refined:
    """A refinement series.

    Attributes
    ----------
    order : int
        The order that its method promises.
    look : str
        Variant whose look the series has.
    event_driven : bool
        True for the reference by tolerance, False for the paper's scheme by step.
    across_a_break_away : bool
        True where the runs go over a break-away, False on a stretch without events.
    """

    order: int
    look: str
    event_driven: bool = False
    across_a_break_away: bool = False


METHODS = {
    "reference": Refined(8, "reference", event_driven=True),
    "paper's scheme": Refined(4, "paper's scheme"),
    "paper's scheme, across a break-away": Refined(1, "trial and error", across_a_break_away=True),
}
"""Refinement series by their labels."""


@dataclass(frozen=True)
class Order:
    """An observed order, half its interval, and the number of runs it is from; without an order, the reason."""

    order: float
    uncertainty: float
    runs: int
    reason: str = ""


def observed_order(
    step: Sequence[float], error: Sequence[float], uncertainty: Sequence[float]
) -> Order:
    """Fit the order over the longest part of a refinement series in which neighbouring slopes are alike.

    Parameters
    ----------
    step, error : sequences of float
        From coarse to fine.
    uncertainty : sequence of float
        The truth's, in the unit of the error; runs with an error below `FLOOR` times it are left out.
    """
    h, e, u = (np.asarray(values, dtype=float) for values in (step, error, uncertainty))
    good = np.isfinite(e) & (e > FLOOR * u) & (e > 0)
    h, e = h[good], e[good]
    if len(h) < FEWEST:
        return Order(
            np.nan,
            np.nan,
            len(h),
            f"{len(h)} runs above the uncertainty of the truth; {FEWEST} are needed",
        )
    slopes = np.diff(np.log(e)) / np.diff(np.log(h))
    parts = [
        (first, last)
        for first, last in combinations(range(len(slopes) + 1), 2)
        if np.ptp(slopes[first:last]) <= ALIKE * abs(slopes[first:last].mean())
        and slopes[first:last].mean() > 0
    ]
    first, last = max(
        parts, key=lambda part: (part[1] - part[0], part), default=(0, 0)
    )  # the finer of two as long
    runs = last - first + 1
    if runs < FEWEST:
        return Order(
            np.nan,
            np.nan,
            runs,
            "slopes between neighbouring runs differ: not in the asymptotic range "
            f"({', '.join(f'{slope:.2g}' for slope in slopes)})",
        )
    fit = fitted_exponent([(h[first : last + 1], e[first : last + 1])])
    return (
        Order(np.nan, np.nan, runs, "too few runs")
        if fit is None
        else Order(fit.value, fit.uncertainty, runs)
    )


def order_rows(scene: Scene, method: str) -> list[dict[str, object]]:
    """One row per run of a method on a scene: error over step; the fitted order in every row."""
    truth, runs = (
        _across_a_break_away(scene)
        if METHODS[method].across_a_break_away
        else _without_events(scene, METHODS[method].event_driven)
    )
    found = [(step, errors(run, truth)) for step, run in runs]
    fit = observed_order(
        [step for step, _ in found], *([row[name] for _, row in found] for name in (ERROR, UNSURE))
    )
    return [
        {
            "method": method,
            STEP: step,
            ERROR: row[ERROR],
            UNSURE: row[UNSURE],
            ORDER: METHODS[method].order,
            OBSERVED: fit.order,
            HALF: fit.uncertainty,
            "runs": fit.runs,
            "why_none": fit.reason,
        }
        for step, row in found
    ]


def _without_events(
    scene: Scene, event_driven: bool
) -> tuple[Truth, list[tuple[float, Trajectory]]]:
    """The truth without friction, and runs with their mean steps."""
    engine, smooth = ReferenceEngine(), vary(scene, {"guide.mu": 0.0, "guide.mus": None})
    if event_driven:
        made = [
            engine.simulate(
                smooth, t_end=SMOOTH, rtol=rtol, output_step=SMOOTH / 80, stabilization="projection"
            )
            for rtol in TOLERANCES
        ]
        runs = [(SMOOTH / run.cost.counters["steps"], run) for run in made]
    else:
        runs = [
            (
                dt,
                engine.simulate(
                    smooth, t_end=SMOOTH, dt=dt, output_step=SMOOTH / 80, stabilization="none"
                ),
            )
            for dt in STEPS
        ]
    return ground_truth(smooth, SMOOTH), runs


def _across_a_break_away(scene: Scene) -> tuple[Truth, list[tuple[float, Trajectory]]]:
    engine, instant = ReferenceEngine(), slider_bar_truth(scene, 1.0).events[0].time
    steps = [instant / (n + 0.5) for n in HALVES]
    runs = [
        (
            dt,
            engine.simulate(
                scene, t_end=dt * round(AFTER / dt), dt=dt, output_step=dt, stabilization="none"
            ),
        )
        for dt in steps
    ]
    return ground_truth(scene, AFTER + steps[0]), runs


def plan(scope: Scope) -> Comparison[Tables]:
    """The rows of all `METHODS` on the first scene; a method that failed is a row with its reason."""
    scene = scope.scenes[0]

    def tabulate(outcomes: Sequence[Outcome]) -> Tables:
        return Tables(
            {
                "orders": pd.DataFrame(
                    [
                        {
                            "scene": scene.name,
                            **row,
                            "status": outcome.status,
                            "reason": outcome.reason,
                        }
                        for (method, refined), outcome in zip(
                            METHODS.items(), outcomes, strict=True
                        )
                        for row in outcome.value
                        or [
                            {
                                "method": method,
                                ORDER: refined.order,
                                "runs": 0,
                                "why_none": outcome.status,
                            }
                        ]
                    ],
                    columns=COLUMNS,
                )
            }
        )

    return Comparison(
        tuple(
            Task(f"orders/{scene.name}/{method}", order_rows, (scene, method)) for method in METHODS
        ),
        tabulate,
    )


def present(results: Results) -> Presentation:
    """The observed order of each method, and the one that its theory promises."""
    table = results.table("orders")
    if table.empty:
        return Presentation()
    known = table[table[ERROR].notna()]
    lost = table[table[ERROR].isna() & ~table["status"].isin(UNMADE)]
    failed = [method for method in lost["method"].unique() if method not in set(known["method"])]
    if known.empty:
        return Presentation(rows={"methods": [], "failed": failed} if failed else {})
    parts = [(runs.iloc[0], runs) for _, runs in known.groupby("method", sort=False)]
    rows = {
        "methods": [row_of("orders", table, first.name) for first, _ in parts],
        "failed": failed,
    }
    columns = (
        Column("method"),
        Column(ORDER, "theoretical order"),
        Column(OBSERVED, "order observed (95 %)", interval=True),
        Column("runs"),
        Column("why_none"),
    )
    return Presentation(rows=rows, tables=[view("orders", parts, columns)], figures=[_chart(known)])


def _chart(known: pd.DataFrame) -> Chart:
    """Error over step of each method, and a line of the promised slope through its finest run."""
    series = []
    for method, runs in known.groupby("method", sort=False):
        step, error = runs[STEP].to_numpy(), runs[ERROR].to_numpy()
        promised = error[-1] * (step / step[-1]) ** float(runs[ORDER].iloc[0])
        look = METHODS[method].look if method in METHODS else ""
        series += [
            Series(method, step, error, look=look, line=False, points=True),
            Series("", step, promised, look=LIMIT),
        ]
    panel = Panel(
        "",
        Axis(quantity_of(STEP).head, log=True),
        Axis(quantity_of(ERROR).head, log=True),
        series,
    )
    return Chart("convergence", [panel], columns=1, height=3.0)


STUDY = Study(
    "orders",
    "Convergence",
    "Do our solvers converge with the theoretical order?",
    present,
    plan,
    seconds=0.7,
    on_page_one=False,
    compared=False,
    tables={
        "orders": "Observed orders of convergence",
    },
)
