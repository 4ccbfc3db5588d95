"""The threshold of stick: how far each variant is from it, a line of the figure per variant."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from stiction.comparisons.campaigns.validation import Validation
from stiction.comparisons.variants import MUS_EQUALS_MU
from stiction.reports.figures.selection import groups
from stiction.reports.figures.style import Drawing, Look, legend, looks, panels

ERROR, UNCERTAINTY = "error [N]", "uncertainty [N]"
APART = 0.22
"""Between the rungs of a variant, where variants are 1 apart."""


def threshold_figure(validation: Validation) -> Drawing | None:
    """Distance from the truth with its uncertainty; what is smaller than its uncertainty is an arrow to the left, from what it is at most."""
    table = validation.tables.get("threshold", pd.DataFrame())
    if not {ERROR, UNCERTAINTY, "truth [N]", "mu", "mus"} <= set(table.columns):
        return None
    known = table.dropna(subset=[ERROR, UNCERTAINTY])
    if known.empty:
        return None
    known = with_truth(known)
    lines = [(name, variant, ladder.sort_values("step", ascending=False)) for name, rows in groups(known)
             for variant, ladder in rows.groupby("variant", sort=False)]
    figure, [[ax]] = panels(1, 1, 0.9 + 0.27 * (len(lines) + known[["fidelity", "truth"]].drop_duplicates().shape[0]))
    places, labels, place, before = [], [], 0.0, None
    styles = looks(validation.records)
    for name, variant, ladder in lines:
        if name != before:
            ax.text(0.01, place + 0.35, name, transform=ax.get_yaxis_transform(), fontsize=7, fontstyle="italic", va="center")
            place, before = place - 0.6, name
        _rungs(ax, place, ladder, styles[variant])
        places, labels = [*places, place], [*labels, variant]
        place -= 1.0
    ax.set(xscale="log", xlabel=r"distance of the threshold on $F_0$ from the truth [N]", ylim=(place + 0.3, 1.0))
    ax.set_yticks(places, labels)
    ax.tick_params(axis="y", right=False, length=0)
    ax.grid(axis="x", color="#DDDDDD", linewidth=0.4)
    steps = sorted(known.loc[known["parameter"] == "dt", "step"].unique(), reverse=True)
    legend(figure, {"error and its uncertainty": Line2D([], [], color="#000000", marker="o", markersize=3.5, linewidth=0.9),
                    "less than its uncertainty": Line2D([], [], color="#000000", marker=r"$\leftarrow$", markersize=8, linestyle="none")}, columns=2)
    truths = "; ".join(f"{truth:.{_digits(truth, unsure)}f} N for mus {'=' if mus == mu else '>'} mu" for truth, unsure, mus, mu in
                       known[["truth [N]", "truth uncertainty [N]", "mus", "mu"]].drop_duplicates().itertuples(index=False))
    order = f" The steps of a variant, from above: the coarsest first ({', '.join(f'{1e3 * step:g}' for step in steps)} ms)." if steps else ""
    return Drawing("threshold", "threshold", f"Largest load amplitude F0 with a stick phase in the steady state, distance from that of the independent solution "
                   f"({truths}).{order}", figure)


def with_truth(table: pd.DataFrame) -> pd.DataFrame:
    """The table of thresholds with the column ``truth`` that other tables have, for `groups`."""
    return table.assign(truth=["" + (MUS_EQUALS_MU if mus == mu else "") for mus, mu in zip(table["mus"], table["mu"])])


def _rungs(ax: Axes, place: float, ladder: pd.DataFrame, look: Look) -> None:
    for number, (error, unsure) in enumerate(zip(ladder[ERROR].abs(), ladder[UNCERTAINTY])):
        y = place + APART * ((len(ladder) - 1) / 2 - number)
        if error <= unsure:
            ax.plot(error + unsure, y, color=look.color, marker=r"$\leftarrow$", markersize=8, linestyle="none")
            ax.plot(error + unsure, y, color=look.color, marker="|", markersize=5, linestyle="none")
        else:
            ax.plot([error - unsure, error + unsure], [y, y], color=look.color, linewidth=0.9)
            ax.plot(error, y, linestyle="none", **look.points())


def _digits(value: float, unsure: float) -> int:
    """Decimals that are known."""
    return max(0, int(np.floor(-np.log10(unsure)))) if unsure > 0 else 12
