"""The threshold of stick: how far each variant is from it, a line of the figure per variant."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from stiction.comparisons.results import Results
from stiction.comparisons.uncertain import Uncertain
from stiction.comparisons.variants import MUS_EQUALS_MU
from stiction.comparisons.methods import groups
from stiction.reports.figures.style import TRUTH_COLOR, Drawing, Look, legend, looks, narrow, panels
from stiction.comparisons.methods import MISSING_ENGINE

ERROR, UNCERTAINTY = "error [N]", "uncertainty [N]"
APART = 0.25
"""Between the rungs of a variant, where variants are 1 apart."""


def threshold_figure(validation: Results) -> Drawing | None:
    """Signed distance from the truth with its uncertainty, rungs of a variant from coarse to fine below each other; in words that of the finest."""
    table = validation.tables.get("threshold", pd.DataFrame())
    if not {ERROR, UNCERTAINTY, "truth [N]", "mu", "mus"} <= set(table.columns) or table[ERROR].isna().all():
        return None
    table = with_truth(table[table["truth [N]"].notna()])
    parts = [(name, list(rows.groupby("variant", sort=False))) for name, rows in groups(table)]
    figure, [[ax]] = panels(1, 1, 1.0 + 0.24 * sum(len(ladders) + 1 for _, ladders in parts))
    places: dict[float, str] = {}
    styles, place = looks(validation.records), 0.0
    for name, ladders in parts:
        ax.text(0.01, place, name, transform=ax.get_yaxis_transform(), fontsize=7, fontstyle="italic", va="center")
        for variant, ladder in ladders:
            place -= 1.0
            places[place] = variant
            _rungs(ax, place, ladder.sort_values("step", ascending=False), styles[variant])
        place -= 1.0
    ax.axvline(0.0, color=TRUTH_COLOR, linewidth=1.2, zorder=1)
    far = 1.15 * float(np.nanmax(table[ERROR].abs() + table[UNCERTAINTY]))
    ax.set(xlabel="threshold on $F_0$, less that of the truth [N]", ylim=(place + 0.4, 0.7), xlim=(-far, far * (2.2 if narrow() else 1.4)))
    ax.set_yticks(list(places), list(places.values()))
    ax.tick_params(axis="y", left=False, right=False)
    legend(figure, {"a rung and its uncertainty": Line2D([], [], color="#000000", marker="o", markersize=3.5, linewidth=0.9),
                    "independent solution": Line2D([], [], color=TRUTH_COLOR, linewidth=1.2)}, columns=2)
    truths = " and ".join(f"{known(truth, unsure)} N ({'mus = mu' if mus == mu else 'mus > mu'})" for truth, unsure, mus, mu in
                          table[["truth [N]", "truth uncertainty [N]", "mus", "mu"]].drop_duplicates().itertuples(index=False))
    return Drawing("threshold", "threshold", f"Largest load amplitude F0 with a stick phase in the steady state, less that of the independent solution, {truths}. Rungs of a variant "
                   "stand below each other, the coarsest first; at the right the finest, N. The uncertainty holds the change from rung to rung.", figure)


def with_truth(table: pd.DataFrame) -> pd.DataFrame:
    """The table of thresholds with the column ``truth`` that other tables have, for `groups`."""
    return table.assign(truth=[MUS_EQUALS_MU if mus == mu else "" for mus, mu in zip(table["mus"], table["mu"])])


def known(value: float, unsure: float) -> str:
    """A number with as many decimals as are known of it."""
    return f"{value:.{max(0, int(np.floor(-np.log10(2 * unsure)))) if unsure > 0 else 12}f}"


def _rungs(ax: Axes, place: float, ladder: pd.DataFrame, look: Look) -> None:
    for number, (error, unsure) in enumerate(zip(ladder[ERROR], ladder[UNCERTAINTY])):
        y = place + APART * ((len(ladder) - 1) / 2 - number)
        ax.plot([error - unsure, error + unsure], [y, y], color=look.color, linewidth=0.9)
        ax.plot(error, y, linestyle="none", **look.points())
    finest = ladder.iloc[-1]
    words = ("not installed" if finest["status"] == MISSING_ENGINE else "no bracket") if pd.isna(finest[ERROR]) else str(Uncertain(finest[ERROR], finest[UNCERTAINTY]))
    ax.text(0.99, place, words, transform=ax.get_yaxis_transform(), fontsize=7, ha="right", va="center")
