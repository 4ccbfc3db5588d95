"""Settings of the engines: error against the engine's own time, a panel per method of an engine."""

from __future__ import annotations

import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from stiction.comparisons.studies.engine_settings import DEFAULT, ERROR, ON_FRONT, SETTING, SUBJECT
from stiction.comparisons.studies.work_precision import HIGH, LOW, came_out
from stiction.comparisons.variants import OWN_CPU
from stiction.reports.figures.style import COLORS, TRUTH_COLOR, Drawing, legend, letter, panels

_COLUMNS = 4
"""Panels beside each other."""


def settings_figure(table: pd.DataFrame) -> Drawing | None:
    """Of a table of `stiction.comparisons.studies.engine_settings.settings_comparison`, of its first scene: each choice, the front, the defaults; None without a run."""
    drawn = table[came_out(table) & table[ERROR].gt(0)] if ERROR in table else table.iloc[:0]
    if drawn.empty:
        return None
    drawn = drawn[drawn["scene"] == drawn["scene"].iloc[0]]
    parts = list(drawn.groupby(SUBJECT, sort=False))
    columns = min(len(parts), _COLUMNS)
    figure, grid = panels(-(-len(parts) // columns), columns, 1.9 * -(-len(parts) // columns))
    axes = list(grid.flat[:len(parts)])
    for unused in grid.flat[len(parts):]:
        unused.set_axis_off()
    looks = {"another choice": {"color": TRUTH_COLOR, "marker": ".", "linestyle": ""}, "on the front": {"color": COLORS[2], "marker": "o", "linestyle": ""},
             "default": {"color": COLORS[1], "marker": "D", "markerfacecolor": "none", "markersize": 6, "linestyle": ""}}
    for ax in grid[:, 0]:
        ax.set_ylabel(ERROR)
    for ax, (subject, rows) in zip(axes, parts):
        for label, part in (("another choice", rows[~rows[ON_FRONT]]), ("on the front", rows[rows[ON_FRONT]]), ("default", rows[rows[SETTING] == DEFAULT])):
            ax.plot(part[OWN_CPU], part[ERROR], **looks[label])
        for row in rows.to_dict("records"):
            ax.plot([row[LOW], row[HIGH]], [row[ERROR]] * 2, color=TRUTH_COLOR, linewidth=0.5, zorder=1)
        ax.set(xscale="log", yscale="log", xlabel="CPU inside the engine [s]", title=subject)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_minor_formatter(NullFormatter())
    letter(axes)
    legend(figure, {label: Line2D([], [], **look) for label, look in looks.items()})
    return Drawing("engine-settings", "settings", f"{drawn['scene'].iloc[0]}. Settings of the engines, one changed at a time, at steps of "
                   f"{', '.join(f'{step:g}' for step in sorted(drawn['step'].unique()))} s: error against the engine's own CPU time, the bar from the fastest "
                   "to the slowest repeat. On the front no other choice is clearly better, in position, torque and time.", figure)
