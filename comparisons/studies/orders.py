"""Observed orders of convergence with their confidence intervals.

An order is only fitted to errors in the asymptotic range. On a stretch without events, every method has the order of
its integrator. Across a break-away, which it notices up to a step late, the paper's scheme is of first order. The
event-driven reference is refined by its tolerance; its mean step is the simulated time over the number of steps.
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
from stiction.comparisons.bench.study import Scope, Study, Tables, only_cases_of_paper
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
"""Smallest number of runs to which an order is fitted: two for the line, two for its uncertainty."""
ALIKE = 0.25
"""Largest difference between the slopes of neighbouring runs in the asymptotic range, relative to the order.

The next term of the error is then at most a quarter of the leading one at the coarser of two steps in ratio 2.
"""
SMOOTH = 80.0
"""Length of the stretch without events, s: the slider-bar without friction."""
OUTPUT_STEP = SMOOTH / 80
"""Time between output samples on the stretch without events, s."""
STEPS = (0.08, 0.04, 0.02, 0.01, 0.005)
"""Steps of the paper's scheme on the stretch without events, s."""
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
"""Relative tolerances of the reference on the stretch without events."""
AFTER = 1.2
"""End of the runs across the break-away, s: before the first change of corners."""
STEPS_BEFORE_BREAK_AWAY = (10, 20, 40, 80, 160)
"""Numbers of whole steps before the break-away, which happens half a step later and is noticed half a step late."""
ERROR = "position_error"
"""Column: position error, m."""
UNCERTAINTY = "position_uncertainty"
"""Column: uncertainty of the position error, m."""
STEP = "mean_step"
"""Column: mean step, s."""
ORDER = "promised_order"
"""Column: order of the method in theory."""
OBSERVED = "observed_order"
"""Column: order fitted to the errors."""
HALF_INTERVAL = "observed_order_uncertainty"
"""Column: half of the confidence interval of the observed order."""
COLUMNS = (
    "scene",
    "method",
    STEP,
    ERROR,
    UNCERTAINTY,
    ORDER,
    OBSERVED,
    HALF_INTERVAL,
    "runs",
    "why_none",
    "status",
    "reason",
)
"""Columns of the table of orders, which has a row per run."""


@dataclass(frozen=True)
class RefinementSeries:
    """How the runs of a refinement series are made, and which order they should have.

    Attributes
    ----------
    order : int
        Order of the method in theory.
    look : str
        Variant whose look the series has in the figure.
    event_driven : bool
        True for the reference, refined by its tolerance; False for the paper's scheme, refined by its step.
    across_a_break_away : bool
        True if the runs include a break-away, False on a stretch without events.
    """

    order: int
    look: str
    event_driven: bool = False
    across_a_break_away: bool = False


METHODS = {
    "reference": RefinementSeries(8, "reference", event_driven=True),
    "paper's scheme": RefinementSeries(4, "paper's scheme"),
    "paper's scheme, across a break-away": RefinementSeries(
        1, "trial and error", across_a_break_away=True
    ),
}
"""Refinement series by their labels."""


@dataclass(frozen=True)
class Order:
    """An observed order of convergence.

    Attributes
    ----------
    order, uncertainty : float
        The order and half of its confidence interval; nan without an order.
    runs : int
        Number of runs in the asymptotic range.
    reason : str
        Why there is no order; empty otherwise.
    """

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
    step, error : sequence of float
        From coarse to fine.
    uncertainty : sequence of float
        Uncertainty of the truth, in the unit of the error. Runs with an error of less than `FLOOR` times the
        uncertainty are left out.
    """
    h, e, u = (np.asarray(values, dtype=float) for values in (step, error, uncertainty))
    is_measurable = np.isfinite(e) & (e > FLOOR * u) & (e > 0)
    h, e = h[is_measurable], e[is_measurable]
    if len(h) < FEWEST:
        reason = f"{len(h)} runs above the uncertainty of the truth; {FEWEST} are needed"
        return Order(np.nan, np.nan, len(h), reason)
    slopes = np.diff(np.log(e)) / np.diff(np.log(h))
    first, end = _longest_alike(slopes)
    runs = end - first + 1
    if runs < FEWEST:
        reason = (
            "slopes between neighbouring runs differ: not in the asymptotic range "
            f"({', '.join(f'{slope:.2g}' for slope in slopes)})"
        )
        return Order(np.nan, np.nan, runs, reason)
    fit = fitted_exponent([(h[first : end + 1], e[first : end + 1])])
    if fit is None:
        return Order(np.nan, np.nan, runs, "too few runs")
    return Order(fit.value, fit.uncertainty, runs)


def _longest_alike(slopes: np.ndarray) -> tuple[int, int]:
    """Return first index and end of the longest part of positive mean in which slopes differ by at most `ALIKE`.

    If several parts are of the same length, return the finest. If there is none, return (0, 0).
    """
    longest = (0, 0)
    for first, end in combinations(range(len(slopes) + 1), 2):
        part = slopes[first:end]
        is_alike = np.ptp(part) <= ALIKE * abs(part.mean()) and part.mean() > 0
        # Parts come in the order of their begin, so that the finer of two equals replaces the other.
        if is_alike and end - first >= longest[1] - longest[0]:
            longest = (first, end)
    return longest


def order_rows(scene: Scene, method: str) -> list[dict[str, object]]:
    """Return one row per run of a method on a scene with its error and step; the fitted order is in every row."""
    series = METHODS[method]
    if series.across_a_break_away:
        truth, runs = _across_a_break_away(scene)
    else:
        truth, runs = _without_events(scene, series.event_driven)
    steps = [step for step, _ in runs]
    errors_of_runs = [errors(run, truth) for _, run in runs]
    fit = observed_order(
        steps,
        [row[ERROR] for row in errors_of_runs],
        [row[UNCERTAINTY] for row in errors_of_runs],
    )
    return [
        {
            "method": method,
            STEP: step,
            ERROR: row[ERROR],
            UNCERTAINTY: row[UNCERTAINTY],
            ORDER: series.order,
            OBSERVED: fit.order,
            HALF_INTERVAL: fit.uncertainty,
            "runs": fit.runs,
            "why_none": fit.reason,
        }
        for step, row in zip(steps, errors_of_runs, strict=True)
    ]


def _without_events(
    scene: Scene, event_driven: bool
) -> tuple[Truth, list[tuple[float, Trajectory]]]:
    """Return the truth of the scene without friction, and runs with their mean steps (s)."""
    engine = ReferenceEngine()
    smooth = vary(scene, {"guide.mu": 0.0, "guide.mus": None})
    runs = []
    if event_driven:
        for rtol in TOLERANCES:
            run = engine.simulate(
                smooth, t_end=SMOOTH, rtol=rtol, output_step=OUTPUT_STEP, stabilization="projection"
            )
            runs.append((SMOOTH / run.cost.counters["steps"], run))
    else:
        for step in STEPS:
            run = engine.simulate(
                smooth, t_end=SMOOTH, dt=step, output_step=OUTPUT_STEP, stabilization="none"
            )
            runs.append((step, run))
    return ground_truth(smooth, SMOOTH), runs


def _across_a_break_away(scene: Scene) -> tuple[Truth, list[tuple[float, Trajectory]]]:
    """Return the truth of the scene, and runs across its first break-away with their steps (s)."""
    engine = ReferenceEngine()
    break_away = slider_bar_truth(scene, 1.0).events[0].time
    steps = [break_away / (number + 0.5) for number in STEPS_BEFORE_BREAK_AWAY]
    runs = []
    for step in steps:
        t_end = step * round(AFTER / step)
        run = engine.simulate(scene, t_end=t_end, dt=step, output_step=step, stabilization="none")
        runs.append((step, run))
    return ground_truth(scene, AFTER + steps[0]), runs


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan the rows of all `METHODS` on the first scene; a method that fails is a row with the reason."""
    scene = scope.scenes[0]

    def tabulate(outcomes: Sequence[Outcome]) -> Tables:
        rows = []
        for method, outcome in zip(METHODS, outcomes, strict=True):
            failure = {
                "method": method,
                ORDER: METHODS[method].order,
                "runs": 0,
                "why_none": outcome.status,
            }
            for row in outcome.value or [failure]:
                rows.append(
                    {
                        "scene": scene.name,
                        **row,
                        "status": outcome.status,
                        "reason": outcome.reason,
                    }
                )
        return Tables({"orders": pd.DataFrame(rows, columns=COLUMNS)})

    tasks = [
        Task(f"orders/{scene.name}/{method}", order_rows, (scene, method)) for method in METHODS
    ]
    return Comparison(tuple(tasks), tabulate)


def present(results: Results) -> Presentation:
    """Present the observed order of each method, and its order in theory."""
    table = results.table("orders")
    if table.empty:
        return Presentation()
    measured = table[table[ERROR].notna()]
    without_error = table[table[ERROR].isna() & ~table["status"].isin(UNMADE)]
    measured_methods = set(measured["method"])
    failed = [
        method for method in without_error["method"].unique() if method not in measured_methods
    ]
    if measured.empty:
        return Presentation(rows={"methods": [], "failed": failed} if failed else {})
    # The first row of a method and all of its rows; all have the same order.
    parts = [(runs.iloc[0], runs) for _, runs in measured.groupby("method", sort=False)]
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
    return Presentation(
        rows=rows, tables=[view("orders", parts, columns)], figures=[_chart(measured)]
    )


def _chart(measured: pd.DataFrame) -> Chart:
    """Return the chart of error over step of each method, and lines of the theoretical slope through the finest run."""
    series = []
    for method, runs in measured.groupby("method", sort=False):
        step, error = runs[STEP].to_numpy(), runs[ERROR].to_numpy()
        order = float(runs[ORDER].iloc[0])
        theoretical = error[-1] * (step / step[-1]) ** order
        look = METHODS[method].look if method in METHODS else ""
        series += [
            Series(method, step, error, look=look, line=False, points=True),
            Series("", step, theoretical, look=LIMIT),
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
    applies=only_cases_of_paper,
    tables={
        "orders": "Observed orders of convergence",
    },
)
