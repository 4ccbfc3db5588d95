"""Drawing figures that are data: one function for each kind of `stiction.comparisons.presentation.charts`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import singledispatch

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.axis import Axis as MatplotlibAxis
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from stiction.comparisons.presentation.charts import BETTER, CHOSEN, LIMIT, OTHER, TRUTH, Axis, Chart, Figure, HeatMap, MechanismPicture, Panel, Series
from stiction.comparisons.results import Results
from stiction.reports.figures.style import COLORS, SHADE, TRUTH_COLOR, Drawing, Look, legend, letter, looks_of, narrow, panels, tick_at, variants_of, width
from stiction.scenes import load_scene
from stiction.scenes.pictures.mechanism import drawing as mechanism_drawing

OWN_LOOKS = {TRUTH: Look("#000000", "-", ""), LIMIT: Look(TRUTH_COLOR, ":", ""), "": Look("#000000", "-", "o"), OTHER: Look(TRUTH_COLOR, "-", "."),
             CHOSEN: Look(COLORS[1], "-", "D", "none"), BETTER: Look(COLORS[2], "-", "D")}
"""Looks that are no variant's."""
LEGEND, MARGIN = 0.75, 0.45
"""Inches that the legend and the labels of the x axes take."""
CELL = 0.155
"""Inches of a row of a heat map."""
SIGN = 0.052
"""Inches of a sign of the names of its columns, on average."""
TEXT = 1.2
"""Inches of the height of a mechanism's picture that labels take, at every width."""


def drawn(figures: Sequence[Figure], results: Results) -> Iterator[Drawing]:
    """The figures, one after the other, a variant with the same look in all of them; draw under `style.rc()`."""
    used = {series.look for figure in figures if isinstance(figure, Chart) for panel in figure.panels for series in panel.series}
    looks = looks_of({label: about for label, about in variants_of(results).items() if label in used})
    for figure in figures:
        yield draw(figure, looks | _other_looks(figure, looks))


def _other_looks(figure: Figure, looks: Mapping[str, Look]) -> dict[str, Look]:
    """Looks of the series of a chart that are no variant's: settings of one method, say."""
    if not isinstance(figure, Chart):
        return {}
    words = dict.fromkeys(series.look for panel in figure.panels for series in panel.series)
    return looks_of({word: (word, "joint") for word in words if word not in looks and word not in OWN_LOOKS})


@singledispatch
def draw(figure: Figure, looks: Mapping[str, Look]) -> Drawing:
    """A figure of a kind that this renderer knows.

    Raises
    ------
    TypeError
        For another kind.
    """
    raise TypeError(f"found a {type(figure).__name__}; expected Chart, HeatMap or MechanismPicture")


@draw.register
def _(chart: Chart, looks: Mapping[str, Look]) -> Drawing:
    columns = 1 if narrow() else min(chart.columns, len(chart.panels))
    rows = -(-len(chart.panels) // columns)
    figure, axes = panels(rows, columns, LEGEND + MARGIN + rows * chart.height, sharex=chart.share_x, sharey=chart.share_y)
    handles: dict[str, Artist] = {}
    for ax, panel in zip(axes.flat, chart.panels):
        _draw_panel(ax, panel, looks, handles)
    for ax in axes.flat[len(chart.panels):]:
        ax.set_axis_off()
    if chart.share_x:
        for ax in axes[:-1].flat:
            ax.set_xlabel("")
    if chart.share_y:
        for ax in axes[:, 1:].flat:
            ax.set_ylabel("")
    letter(axes.flat[:len(chart.panels)])
    if handles:
        legend(figure, handles)
    return Drawing(chart.name, chart.caption, figure)


def _draw_panel(ax: Axes, panel: Panel, looks: Mapping[str, Look], handles: dict[str, Artist]) -> None:
    """The panel, and what its series add to the legend."""
    for begin, end in panel.shades:
        ax.axvspan(begin, end, color=SHADE, linewidth=0, zorder=0)
    for x in panel.lines:
        ax.axvline(x, zorder=1, **OWN_LOOKS[LIMIT].line())
    for series in panel.series:
        look = looks.get(series.look) or OWN_LOOKS.get(series.look) or OWN_LOOKS[""]
        style = _style(series, look)
        _draw_series(ax, series, style, panel.horizontal)
        if series.label:
            handles.setdefault(series.label, Line2D([], [], **style))
    for axis, about in ((ax.xaxis, panel.x), (ax.yaxis, panel.y)):
        _set_axis(axis, about)
    ax.set(title=panel.title, xlabel=panel.x.label, ylabel=panel.y.label)


def _style(series: Series, look: Look) -> dict[str, object]:
    line = look.line() if series.line else {"color": look.color, "linestyle": "none"}
    marked = replace(look, fill="none") if series.hollow else look
    return {**line, **(marked.points() if series.points else {"marker": ""})}


def _draw_series(ax: Axes, series: Series, style: Mapping[str, object], horizontal: bool) -> None:
    if series.low is None or series.high is None:
        ax.plot(series.x, series.y, **style)
        return
    middle = series.x if horizontal else series.y
    spread = np.array([middle - series.low, series.high - middle]).clip(min=0.0)
    ax.errorbar(series.x, series.y, **{"xerr" if horizontal else "yerr": spread}, elinewidth=0.8, capsize=1.5, **style)


def _set_axis(axis: MatplotlibAxis, about: Axis) -> None:
    if about.log:
        axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    if len(about.words):
        axis.set_ticks(list(about.ticks), list(about.words))
        axis.set_tick_params(which="both", length=0)
    elif len(about.ticks):
        tick_at(axis, about.ticks)
    if about.limits is not None:
        axis.axes.set(**{f"{axis.axis_name}lim": about.limits})


@draw.register
def _(heat: HeatMap, looks: Mapping[str, Look]) -> Drawing:
    lines: list[tuple[str, int | None]] = []  # of the grid, from above: a heading, or a row of cells
    rest = iter(range(len(heat.rows)))
    for heading, count in (heat.groups or {"": len(heat.rows)}).items():
        lines += [(heading, None)] if heading else []
        lines += [(heat.rows[row], row) for row in (next(rest) for _ in range(count))]
    turned = 90.0 if narrow() else 40.0
    above = SIGN * np.sin(np.radians(turned)) * max(map(len, heat.columns), default=0)
    figure, [[ax]] = panels(1, 1, LEGEND + above + CELL * len(lines))
    squares: dict[str, list[Path]] = {}
    for y, (text, row) in enumerate(lines):
        if row is None:
            ax.text(-0.5, y, text, fontsize=6.5, fontstyle="italic", va="center", ha="left")
            continue
        for x, category in enumerate(heat.cells[row]):
            if category:
                sign, color = heat.categories[category]
                squares.setdefault(color, []).append(_square(x, y))
                ax.text(x, y, sign, fontsize=6, va="center", ha="center", color=_contrast(color))
    for color, paths in squares.items():  # one shape for all squares of a colour: a twentieth of the bytes
        ax.add_patch(PathPatch(Path.make_compound_path(*paths), color=color, linewidth=0))
    ax.set(xlim=(-0.5, len(heat.columns) - 0.5), ylim=(len(lines) - 0.5, -0.5))
    ax.set_yticks([y for y, (_, row) in enumerate(lines) if row is not None], [text for text, row in lines if row is not None], fontsize=6)
    ax.set_xticks(range(len(heat.columns)), heat.columns, rotation=turned, ha="left", va="center" if narrow() else "baseline", rotation_mode="anchor", fontsize=6.5)
    ax.xaxis.tick_top()
    ax.tick_params(length=0, which="both")
    ax.spines[:].set_visible(False)
    there = {category for row in heat.cells for category in row}
    handles = {f"{sign}  {category}": Patch(color=color) for category, (sign, color) in heat.categories.items() if category in there}
    legend(figure, handles, columns=6)
    return Drawing(heat.name, heat.caption, figure)


def _square(x: float, y: float) -> Path:
    corners = [(x - 0.46, y - 0.44), (x + 0.46, y - 0.44), (x + 0.46, y + 0.44), (x - 0.46, y + 0.44), (x - 0.46, y - 0.44)]
    return Path(corners, closed=True)


def _contrast(color: str) -> str:
    """Black on light colours, white on dark ones (luma of Rec. 601)."""
    red, green, blue = (int(color[i:i + 2], 16) for i in (1, 3, 5))
    return "#000000" if 0.299 * red + 0.587 * green + 0.114 * blue > 140 else "#FFFFFF"


@draw.register
def _(picture: MechanismPicture, looks: Mapping[str, Look]) -> Drawing:
    figure = mechanism_drawing(load_scene(picture.scene), heading=False)
    own, height = figure.get_size_inches()
    figure.set_size_inches(width(), TEXT + (height - TEXT) * width() / own)
    return Drawing(picture.name, picture.caption, figure)
