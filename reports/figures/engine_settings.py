"""Settings of the engines, a panel per method of an engine: on one scene error against the engine's own time, on several both in units of the default's."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from stiction.comparisons.studies.engine_settings import (DEFAULT, ERROR, ERROR_RATIO, ON_FRONT, SETTING, SUBJECT, TIME_RATIO, TIME_RATIO_ENDS, against_defaults,
                                                          better_everywhere)
from stiction.comparisons.studies.work_precision import HIGH, LOW, came_out
from stiction.comparisons.variants import OWN_CPU
from stiction.reports.figures.style import COLORS, TRUTH_COLOR, Drawing, legend, letter, panels, tick_at

_COLUMNS = 4
"""Panels beside each other."""
_LOOKS = {"another choice": {"color": TRUTH_COLOR, "marker": ".", "linestyle": ""}, "on the front": {"color": COLORS[2], "marker": "o", "linestyle": ""},
          "better everywhere": {"color": COLORS[2], "marker": "o", "linestyle": ""}, "loses a run": {"color": TRUTH_COLOR, "marker": "x", "linestyle": ""},
          DEFAULT: {"color": COLORS[1], "marker": "D", "markerfacecolor": "none", "markersize": 6, "linestyle": ""}}
_ENDS = 0.5, 200.0
"""Of the axis of errors in units of the default's: what lies beyond stands on the edge."""
_TIMES = 0.25, 0.5, 1.0, 2.0, 4.0
"""Ticks of the axis of times in units of the default's."""


def settings_figure(table: pd.DataFrame) -> Drawing | None:
    """Of a table of `stiction.comparisons.studies.engine_settings`: each choice and the defaults; None without a run."""
    if ERROR not in table:
        return None
    drawn = table[came_out(table) & table[ERROR].gt(0)]
    if table["scene"].nunique() > 1:
        found = against_defaults(table)
        return None if found.empty else Drawing("engine-settings", "settings", *_over_scenes(found, table))
    return None if drawn.empty else Drawing("engine-settings", "settings", *_on_one_scene(drawn))


def _over_scenes(found: pd.DataFrame, table: pd.DataFrame) -> tuple[str, Figure]:
    """Each choice once, as `against_defaults` finds it in the table."""
    figure, axes = _panels(found[SUBJECT].unique(), "largest error, of the default's", "time, of the default's")
    for (subject, rows), ax in zip(found.groupby(SUBJECT, sort=False), axes):
        better = better_everywhere(table[table[SUBJECT] == subject])
        for row in rows.to_dict("records"):
            look = DEFAULT if row[SETTING] == DEFAULT else "loses a run" if row["lost"] else "better everywhere" if row[SETTING] in better else "another choice"
            size = float(np.clip(row[ERROR_RATIO], *_ENDS))
            ax.plot([row[end] for end in TIME_RATIO_ENDS], [size] * 2, color=TRUTH_COLOR, linewidth=0.5, zorder=1)
            ax.plot(row[TIME_RATIO], size, **_LOOKS[look])
        ax.set(xlim=(_TIMES[0] / 1.2, _TIMES[-1] * 1.2), ylim=(_ENDS[0] / 1.5, _ENDS[1] * 1.5))
        tick_at(ax.xaxis, _TIMES)
    legend(figure, {label: Line2D([], [], **_LOOKS[label]) for label in (DEFAULT, "another choice", "better everywhere", "loses a run")})
    return ("Settings of the engines, one changed at a time, over all scenes and steps of the study, in units of the default: the largest error, of position or torque, or drift, and the "
            f"geometric mean of the engine's own CPU time, with the least and the most. Errors beyond {_ENDS[0]:g} and {_ENDS[1]:g} stand there. A choice at the left of the default and above it "
            "is faster on the whole and less accurate somewhere.", figure)


def _on_one_scene(drawn: pd.DataFrame) -> tuple[str, Figure]:
    """Each choice at each step, and the front."""
    figure, axes = _panels(drawn[SUBJECT].unique(), ERROR, "CPU inside the engine [s]")
    for (subject, rows), ax in zip(drawn.groupby(SUBJECT, sort=False), axes):
        for label, part in (("another choice", rows[~rows[ON_FRONT]]), ("on the front", rows[rows[ON_FRONT]]), (DEFAULT, rows[rows[SETTING] == DEFAULT])):
            ax.plot(part[OWN_CPU], part[ERROR], **_LOOKS[label])
        for row in rows.to_dict("records"):
            ax.plot([row[LOW], row[HIGH]], [row[ERROR]] * 2, color=TRUTH_COLOR, linewidth=0.5, zorder=1)
    legend(figure, {label: Line2D([], [], **_LOOKS[label]) for label in ("another choice", "on the front", DEFAULT)})
    return (f"{drawn['scene'].iloc[0]}. Settings of the engines, one changed at a time, at steps of {', '.join(f'{step:g}' for step in sorted(drawn['step'].unique()))} s: "
            "error against the engine's own CPU time, the bar from the fastest to the slowest repeat. On the front no other choice is clearly better, in position, torque, drift and time.", figure)


def _panels(titles: Iterable[str], error: str, time: str) -> tuple[Figure, list[Axes]]:
    """A panel per title on logarithmic axes."""
    titles = list(titles)
    columns = min(len(titles), _COLUMNS)
    figure, grid = panels(-(-len(titles) // columns), columns, 1.9 * -(-len(titles) // columns))
    axes = list(grid.flat[:len(titles)])
    for unused in grid.flat[len(titles):]:
        unused.set_axis_off()
    for ax in grid[:, 0]:
        ax.set_ylabel(error)
    for ax, title in zip(axes, titles):
        ax.set(xscale="log", yscale="log", xlabel=time, title=title)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_minor_formatter(NullFormatter())
    letter(axes)
    return figure, axes
