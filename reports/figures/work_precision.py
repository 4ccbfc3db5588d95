"""Work and precision: error against the CPU time that it takes, one line per ladder."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from stiction.comparisons.studies.work_precision import came_out
from stiction.comparisons.variants import OWN_CPU, Record, Variant
from stiction.engines.isolation import Outcome
from stiction.comparisons.methods import case_of, groups
from stiction.reports.figures.style import TRUTH_COLOR, Drawing, Look, figures_of, legend, letter, looks, panels
from stiction.reports.markdown.cost_page import HIGH, LOW
from stiction.reports.markdown.ladder_ends import POSITION, UNCERTAINTY, ladder_ends


def work_precision_figures(table: pd.DataFrame, records: Iterable[Record] = ()) -> Iterator[Drawing]:
    """Per scene: position error over the engines' own CPU time of a table of `stiction.comparisons.studies.work_precision.work_precision`.

    A panel per group of variants that may be ranked; looks as in the figures of `records`.
    """
    if not {OWN_CPU, POSITION, LOW, HIGH} <= set(table):
        return
    drawn = table[came_out(table) & table[POSITION].gt(0) & table[OWN_CPU].gt(0)]
    own = [Record("", row.scene, Variant(row.variant, row.engine, row.parameter, (), row.fidelity), row.step, Outcome("", row.status))
           for row in table.drop_duplicates("variant").itertuples()]
    styles = looks([*records, *own])
    for scene, rows in drawn.groupby("scene", sort=False):
        parts = dict(groups(rows))
        ends = {end.variant: f"{end.variant}: {end.error:.1e} m, {end.limit}" for end in ladder_ends(table[table["scene"] == scene])}
        caption = (f"Position error over CPU time inside the engine's own calls, {case_of(scene)}, a line per ladder of steps, tolerances or iterations: down and to the left is "
                   "better. Bars: the intervals of the medians. The legend has the smallest error of each ladder, rungs that were not timed among them, and its limit, see the table; truth: it is not "
                   "above what the truth is unsure by (dotted).")
        for ending, names in figures_of(list(parts)):
            name = f"work-precision{'' if scene == drawn['scene'].iloc[0] else '-' + scene}{ending.translate(_PLAIN)}"
            yield Drawing(name, "cost", caption, _figure({group: parts[group] for group in names}, styles, ends))


_PLAIN = str.maketrans({",": "", " ": "-", "=": "equals", ">": "above"})
"""For names of files."""


def _figure(parts: dict[str, pd.DataFrame], styles: dict[str, Look], ends: dict[str, str]) -> Figure:
    figure, axes = panels(1, len(parts), 4.4, sharex=True, sharey=True, width_ratios=[3 + rows["variant"].nunique() for rows in parts.values()])
    handles: dict[str, Line2D] = {}
    for ax, (group, rows) in zip(axes.flat, parts.items()):
        for variant, ladder in rows.groupby("variant", sort=False):
            look = styles[variant]
            spread = np.array([ladder[OWN_CPU] - ladder[LOW], ladder[HIGH] - ladder[OWN_CPU]]).clip(min=0.0)
            ax.errorbar(ladder[OWN_CPU], ladder[POSITION], xerr=spread, elinewidth=0.7, capsize=1.5, **look.line(), **look.points())
            handles[ends[variant]] = Line2D([], [], **look.line(), **look.points())
        floor = float(rows[UNCERTAINTY].max())
        if floor > rows[POSITION].min() / 10:
            ax.axhline(floor, color=TRUTH_COLOR, linewidth=0.9, linestyle=":", zorder=1)
        ax.set(xscale="log", yscale="log", title=group)
        ax.xaxis.set_minor_formatter(NullFormatter())
    axes[0, 0].set_ylabel(POSITION)
    figure.supxlabel("CPU time inside the engine [s]", fontsize="medium")
    letter(axes.flat)
    legend(figure, handles, columns=2)
    return figure
