"""How fast the errors of the reference's two ways fall with the step."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from stiction.comparisons.uncertain import Uncertain
from stiction.reports.figures.style import COLORS, TRUTH_COLOR, Drawing, Look, beside, legend

LOOKS = (Look(COLORS[0], "-", "o"), Look(COLORS[1], "-", "s", "none"), Look(COLORS[2], "-", "D"))


def orders_figure(table: pd.DataFrame) -> Drawing | None:
    """Error over step of the reference's two ways, with a line of the order that each method has."""
    table = table[table["position error [m]"].notna()] if len(table) else table
    if table.empty:
        return None
    figure, (ax,) = beside(1, 3.2)
    handles: dict[str, Line2D] = {}
    for number, (method, ladder) in enumerate(table.groupby("method", sort=False)):
        look = LOOKS[number]
        step, error = ladder["mean step [s]"].to_numpy(), ladder["position error [m]"].to_numpy()
        order, half = ladder["observed order [-]"].iloc[0], ladder["interval of the order [-]"].iloc[0]
        found = "no order" if np.isnan(order) else f"order {Uncertain(order, half).both()}"
        ax.plot(step, error, **look.line() | {"linestyle": "none"}, **look.points())
        expected = ladder["order of the method [-]"].iloc[0]
        ax.plot(step, error[-1] * (step / step[-1]) ** expected, color=TRUTH_COLOR, linewidth=0.9, linestyle=":", zorder=1)
        handles[f"{method}: {found}"] = Line2D([], [], **look.line() | {"linestyle": "none"}, **look.points())
    ax.set(xscale="log", yscale="log", xlabel="mean step [s]", ylabel="position error [m]")
    legend(figure, handles, columns=1)
    return Drawing("orders", "orders", "Observed orders with their intervals of 95 %, fitted where neighbouring slopes agree. Dotted, through the finest rung: orders 8, 4 and 1.",
                   figure)
