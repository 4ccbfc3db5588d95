"""Observed orders of convergence with their intervals, only where the errors are in the asymptotic range.

On a stretch without events every method shows the order of its integrator; across a break-away the paper's scheme, which notices it up to a step late, is of
first order. The event-driven reference has a tolerance instead of a step: its steps are its time over their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import t as student

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.measures.accuracy import errors
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.presentation.charts import LIMIT, Axis, Chart, Panel, Series
from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.presentation.table_view import Column, view
from stiction.comparisons.presentation.traced_text import TracedText, interval, listed, traced, value
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Scope, Study, Tables
from stiction.comparisons.studies.work_precision import FLOOR
from stiction.comparisons.truth import Truth, slider_bar_truth
from stiction.engines.isolation import Outcome, Task
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import Scene, Trajectory, vary

RUNGS = 4
"""Least number of rungs that an order is fitted to: two for the line, two for what it is unsure of."""
ALIKE = 0.25
"""Part of the order by which the slopes between neighbouring rungs of the asymptotic range may differ: the next term of the error is then at most
a quarter of the leading one in the coarsest of two rungs a factor of two apart."""
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Order:
    """An observed order, half its interval of `CONFIDENCE`, and the number of rungs it is from; without an order, `reason` says why."""

    order: float
    uncertainty: float
    rungs: int
    reason: str = ""


def observed_order(step: Sequence[float], error: Sequence[float], uncertainty: Sequence[float]) -> Order:
    """The order of a ladder: least squares in logarithms over the longest part of it in which neighbouring slopes are alike.

    Parameters
    ----------
    step, error : sequences of float
        From coarse to fine.
    uncertainty : sequence of float
        Of the truth, in the unit of the error; rungs with an error below `FLOOR` times it are left out.
    """
    h, e, u = (np.asarray(values, dtype=float) for values in (step, error, uncertainty))
    good = np.isfinite(e) & (e > FLOOR * u) & (e > 0)
    if good.sum() < RUNGS:
        return Order(np.nan, np.nan, int(good.sum()), f"{int(good.sum())} rungs above the uncertainty of the truth; {RUNGS} are needed")
    x, y = np.log(h[good]), np.log(e[good])
    slopes = np.diff(y) / np.diff(x)
    best = (0, 0)
    for first in range(len(slopes)):
        for last in range(first + 1, len(slopes) + 1):
            part = slopes[first:last]
            if np.ptp(part) <= ALIKE * abs(part.mean()) and part.mean() > 0 and last - first >= best[1] - best[0]:  # the finer of two as long
                best = first, last
    rungs = best[1] - best[0] + 1
    if rungs < RUNGS:
        return Order(np.nan, np.nan, rungs, "slopes between neighbouring rungs differ: not in the asymptotic range "
                     f"({', '.join(f'{slope:.2g}' for slope in slopes)})")
    x, y = x[best[0]:best[1] + 1], y[best[0]:best[1] + 1]
    x = x - x.mean()
    order = float(x @ y / (x @ x))
    spread = np.sqrt(np.sum((y - y.mean() - order * x) ** 2) / (rungs - 2) / (x @ x))
    return Order(order, float(student.ppf((1 + CONFIDENCE) / 2, rungs - 2) * spread), rungs)


SMOOTH = 80.0
"""s; of a stretch without events: the slider-bar without friction."""
STEPS = (0.08, 0.04, 0.02, 0.01, 0.005)
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
AFTER = 1.2
"""s; ends before the first change of corners."""
HALVES = (10, 20, 40, 80, 160)
"""Whole steps before the break-away, which comes half a step later: it is then noticed half a step late."""


METHODS = {"event-driven, no events": 8, "paper's scheme, no events": 4, "paper's scheme, across a break-away": 1}
"""Ladders of the reference, each with the order of its method."""


def order_rows(scene: Scene, method: str) -> list[dict[str, object]]:
    """One row per rung of one of the ladders of `METHODS` on a scene: error over step; the fitted order in every row."""
    truth, runs = _across_a_break_away(scene) if method.endswith("break-away") else _without_events(scene, method.startswith("event-driven"))
    found = [(step, errors(run, truth)) for step, run in runs]
    fit = observed_order([step for step, _ in found], [row["position error [m]"] for _, row in found],
                         [row["position uncertainty [m]"] for _, row in found])
    return [{"method": method, "mean step [s]": step, "position error [m]": row["position error [m]"],
             "position uncertainty [m]": row["position uncertainty [m]"], "order of the method [-]": METHODS[method], "observed order [-]": fit.order,
             "interval of the order [-]": fit.uncertainty, "rungs": fit.rungs, "why none": fit.reason} for step, row in found]


def _without_events(scene: Scene, event_driven: bool) -> tuple[Truth, list[tuple[float, Trajectory]]]:
    engine, smooth = ReferenceEngine(), vary(scene, {"guide.mu": 0.0, "guide.mus": None})
    if event_driven:
        runs = [engine.simulate(smooth, t_end=SMOOTH, rtol=rtol, output_step=SMOOTH / 80, stabilization="projection") for rtol in TOLERANCES]
        ladder = [(SMOOTH / run.cost.counters["steps"], run) for run in runs]
    else:
        ladder = [(dt, engine.simulate(smooth, t_end=SMOOTH, dt=dt, output_step=SMOOTH / 80, stabilization="none")) for dt in STEPS]
    return ground_truth(smooth, SMOOTH), ladder


def _across_a_break_away(scene: Scene) -> tuple[Truth, list[tuple[float, Trajectory]]]:
    engine, instant = ReferenceEngine(), slider_bar_truth(scene, 1.0).events[0].time
    steps = [instant / (n + 0.5) for n in HALVES]
    return ground_truth(scene, AFTER + steps[0]), [
        (dt, engine.simulate(scene, t_end=dt * round(AFTER / dt), dt=dt, output_step=dt, stabilization="none")) for dt in steps]


def orders_comparison(scene: Scene) -> Comparison[pd.DataFrame]:
    """The rows of all ladders of `METHODS`; a ladder that did not come out is a row with its reason."""
    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        return pd.DataFrame([{"scene": scene.name, **row, "status": outcome.status, "reason": outcome.reason}
                             for (method, order), outcome in zip(METHODS.items(), outcomes, strict=True)
                             for row in outcome.value or [{
                                 "method": method, "mean step [s]": np.nan, "position error [m]": np.nan, "position uncertainty [m]": np.nan,
                                 "order of the method [-]": order, "observed order [-]": np.nan, "interval of the order [-]": np.nan, "rungs": 0,
                                 "why none": outcome.status}]])

    return Comparison(tuple(Task(f"orders/{scene.name}/{method}", order_rows, (scene, method)) for method in METHODS), tabulate)


def plan(scope: Scope) -> Comparison[Tables]:
    """The refinement series of `METHODS` on the first scene."""
    return orders_comparison(scope.scenes[0]).then(lambda table: Tables({"orders": table}))


def present(results: Results) -> Presentation:
    """The observed order of each method beside the one that its theory promises."""
    table = results.table("orders")
    known = table[table["position error [m]"].notna()] if len(table) else table
    if known.empty:
        return Presentation()
    first = known.drop_duplicates("method")
    parts = [_order(table, label) for label in first.index]
    answer = traced("Observed orders (promised): {}.", listed(parts))
    columns = (Column("method"), Column("order of the method [-]", "order promised"),
               Column("observed order [-]", "order observed (95 %)", uncertainty="interval of the order [-]", interval=True), Column("rungs", "runs"), Column("why none"))
    rows = [np.flatnonzero(table["method"] == method) + 1 for method in first["method"]]
    shown = view("orders", "Observed orders of the reference, fitted where neighbouring slopes agree.", first, columns, rows=rows)
    return Presentation(answer, (), (), (shown,), (_figure(known),))


def _order(table: pd.DataFrame, label: int) -> TracedText:
    row = table.loc[label]
    if np.isnan(row["observed order [-]"]):
        return TracedText(f"{row['method']} none ({row['why none']})")
    promised = value("orders", table, label, "order of the method [-]", "g")
    return traced("{} {} ({})", row["method"], interval("orders", table, label, "observed order [-]", "interval of the order [-]"), promised)


def _figure(known: pd.DataFrame) -> Chart:
    series = []
    for method, ladder in known.groupby("method", sort=False):
        step, error = ladder["mean step [s]"].to_numpy(), ladder["position error [m]"].to_numpy()
        promised = float(ladder["order of the method [-]"].iloc[0])
        series += [Series(method, step, error, look=LOOKS.get(method, ""), line=False, points=True),
                   Series("", step, error[-1] * (step / step[-1]) ** promised, look=LIMIT)]
    panel = Panel("", Axis("mean step [s]", log=True), Axis("position error [m]", log=True), series)
    return Chart("orders", "Position error of the reference over its step. Dotted, through the finest run: the order that each method promises.", (panel,), columns=1, height=3.0)


LOOKS = {"event-driven, no events": "reference", "paper's scheme, no events": "paper's scheme", "paper's scheme, across a break-away": "trial and error"}
"""Variants whose looks the series have."""

STUDY = Study("orders", "Convergence", "Does the reference converge as its methods promise?", 10, present, plan, seconds=0.7, on_page_one=False, compared=False)
