"""Work and precision: error against the CPU time that it takes, one line per ladder."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pandas as pd
from matplotlib.lines import Line2D

from stiction.comparisons.studies.work_precision import FLOOR, came_out
from stiction.comparisons.variants import OWN_CPU, Record, Variant
from stiction.engines.isolation import Outcome
from stiction.reports.figures.style import TRUTH_COLOR, Drawing, beside, legend, letter, looks

POSITION, UNCERTAINTY, TORQUE = "position error [m]", "position uncertainty [m]", "torque error, L1 mean [N m]"


def work_precision_figure(table: pd.DataFrame, records: Iterable[Record] = ()) -> Drawing | None:
    """Errors over the engines' own CPU time of a table of `stiction.comparisons.studies.work_precision.work_precision`; looks as in the figures of `records`."""
    there = [column for column in (POSITION, TORQUE) if {OWN_CPU, column} <= set(table) and table.loc[came_out(table), column].gt(0).any()]
    if not there:
        return None
    own = [Record("", row.scene, Variant(row.variant, row.engine, row.parameter, (), row.fidelity), row.step, Outcome("", row.status))
           for row in table.drop_duplicates("variant").itertuples()]
    styles = looks([*records, *own])
    figure, axes = beside(len(there), 3.6)
    handles: dict[str, Line2D] = {}
    for ax, column in zip(axes, there):
        drawn = table[came_out(table) & table[column].gt(0) & table[OWN_CPU].gt(0)]
        for variant, ladder in drawn.groupby("variant", sort=False):
            look = styles[variant]
            if (ladder["parameter"] == "iterations").all():
                look = replace(look, dashes=":")
            style = look.line() | look.points()
            ax.plot(ladder["cpu [s]"], ladder[column], color=look.color, linewidth=0.6, alpha=0.5, zorder=1)
            ax.plot(ladder[OWN_CPU], ladder[column], **style)
            handles.setdefault(variant, Line2D([], [], **style))
        ax.set(xscale="log", yscale="log", xlabel="CPU time inside the engine [s]", ylabel=column)
        floor = FLOOR * float(drawn[UNCERTAINTY].max()) if column == POSITION and UNCERTAINTY in drawn else 0.0
        if floor > drawn[column].min() / 10:
            ax.axhline(floor, color=TRUTH_COLOR, linewidth=0.9, linestyle=":", zorder=1)
    letter(axes)
    legend(figure, handles, columns=3)
    caption = ("What accuracy costs: error against CPU time, one line per ladder of steps, tolerances or iterations; down and to the "
               f"left is better. Times are those inside the engine's own calls; the thin line beside is the same with the adapter's work. Dotted: {FLOOR:g} times the uncertainty of the truth. The torque jumps at events: where a run does not "
               "locate them, samples every 10 ms are all that is known of it. Times: medians, one run at a time, without set-up, "
               "compiling or output.")
    return Drawing("work-precision", "cost", f"{', '.join(dict.fromkeys(table['scene']))}. {caption}", figure)
