"""Drawing figures that are data: one function for each kind of `stiction.comparisons.bench.presentation.charts`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import singledispatch
from textwrap import fill

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis as MatplotlibAxis
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from stiction.comparisons.bench.presentation import (
    BETTER,
    CHOSEN,
    LIMIT,
    OTHER,
    TRUTH,
    Axis,
    Chart,
    Figure,
    HeatMap,
    MechanismPicture,
    Panel,
)
from stiction.comparisons.bench.results import Results
from stiction.reports.figures.style import (
    COLORS,
    LEGEND_ROWS,
    SHADE,
    TALLEST,
    TRUTH_COLOR,
    Drawing,
    Look,
    legend,
    letter,
    looks_of,
    narrow,
    panels,
    tick_at,
    variants_of,
    width,
)
from stiction.scenes import load_scene
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.pictures.mechanism import drawing as mechanism_drawing

PLAIN = Look("#000000", "-", "o")
OWN_LOOKS = {
    TRUTH: Look("#000000", "-", ""),
    LIMIT: Look(TRUTH_COLOR, ":", ""),
    "": PLAIN,
    OTHER: Look(TRUTH_COLOR, "-", "."),
    CHOSEN: Look(COLORS[1], "-", "D", "none"),
    BETTER: Look(COLORS[2], "-", "D"),
}
"""Looks that are no variant's."""
LEGEND, MARGIN = 0.75, 0.45
"""Inches that the legend and the labels of the x axes take."""
CELL = 0.155
"""Inches of a row of a heat map."""
SIGN = 0.052
"""Inches of a sign of the names of its columns, on average."""
LEGEND_ROW = 0.17
"""Inches of a row of a legend."""
COLUMN_PANEL = 1.65
"""Inches of the height of a panel in one column, at most: its axes are then about as wide as two of its heights."""
LEAST_PANEL = 1.2
"""Inches of the height of a panel that a page of many rows leaves at least: room for four labels of its axis."""
WORDS = 22
"""Signs of a line of the words at an axis of categories in one column: they leave half of the width to the data."""
TEXT = 1.2
"""Inches of the height of a mechanism's picture that labels take, at every width."""


def drawn(figures: Sequence[Figure], results: Results) -> Iterator[Drawing]:
    """Draw the figures, a variant with the same look in all of them; under `style.rc()`."""
    used = {look for figure in figures for look in _looks_used(figure)}
    looks = looks_of(
        {label: about for label, about in variants_of(results).items() if label in used}
    )
    for figure in figures:
        # series that are no variant's: settings of one method, say
        others = {
            look: (look, Fidelity.JOINT)
            for look in _looks_used(figure)
            if look not in looks and look not in OWN_LOOKS
        }
        yield draw(figure, looks | looks_of(others))


def _looks_used(figure: Figure) -> list[str]:
    series = (
        [one for panel in figure.panels for one in panel.series]
        if isinstance(figure, Chart)
        else []
    )
    return list(dict.fromkeys(one.look for one in series))


def in_one_column(figure: Figure) -> list[Figure]:
    """Return the figures that show a figure in one column of a page: itself, or its parts, none above `TALLEST`."""
    if isinstance(figure, Chart):
        height = min(figure.height, COLUMN_PANEL)
        return _named(
            [
                replace(figure, panels=some, columns=1, height=height)
                for some in _panels_of_parts(figure, height)
            ],
            figure,
        )
    if isinstance(figure, HeatMap):
        return _named(list(_parts_of_map(figure)), figure)
    return [figure]


def _named(parts: Sequence[Chart | HeatMap], figure: Chart | HeatMap) -> list[Figure]:
    """Parts with a name and a caption of their own; a single one is the figure itself."""
    if len(parts) <= 1:
        return list(parts or [figure])
    first_sentence, count = figure.caption.partition(". ")[0].rstrip("."), len(parts)
    named: list[Figure] = []
    for number, part in enumerate(parts, 1):
        caption = (
            f"{figure.caption} Part 1 of {count}."
            if number == 1
            else f"{first_sentence}, continued: part {number} of {count}."
        )
        named.append(replace(part, name=f"{figure.name}-{number}", caption=caption))
    return named


def _panels_of_parts(chart: Chart, height: float) -> Iterator[list[Panel]]:
    """The panels of each part, whole rows of the chart where they fit.

    Each panel has the labels of its row and column, which stand at the edges of the chart alone.
    """
    across = min(chart.columns, len(chart.panels)) or 1
    labelled = []
    for number, panel in enumerate(chart.panels):
        first = chart.panels[number - number % across]
        last = chart.panels[number + across * ((len(chart.panels) - 1 - number) // across)]
        y_label = "" if len(panel.y.words) else panel.y.label or first.y.label
        labelled.append(
            replace(
                panel,
                x=replace(panel.x, label=panel.x.label or last.x.label),
                y=replace(panel.y, label=y_label),
            )
        )
    labels = {one.label for panel in chart.panels for one in panel.series if one.label}
    room = TALLEST - LEGEND - MARGIN - LEGEND_ROW * max(0, len(labels) - LEGEND_ROWS)
    most = max(1, int(room / height))
    size, rows = (
        (most // across * across, [labelled])
        if across <= most
        else (most, [labelled[start : start + across] for start in range(0, len(labelled), across)])
    )
    for row in rows:
        for start in range(0, len(row), size):
            yield row[start : start + size]


def _parts_of_map(heat: HeatMap) -> Iterator[HeatMap]:
    """Parts of a map, each of so many rows as fit; a group that is divided has its heading in both."""
    most = int((TALLEST - LEGEND - SIGN * max(map(len, heat.columns), default=0)) / CELL)
    taken: list[int] = []
    groups: dict[str, int] = {}
    number = 0
    for heading, count in (heat.groups or {"": len(heat.rows)}).items():
        for _ in range(count):
            if len(taken) + len(groups) + (heading not in groups) >= most:
                yield _rows_of(heat, taken, groups)
                taken, groups = [], {}
            taken.append(number)
            groups[heading] = groups.get(heading, 0) + 1
            number += 1
    yield _rows_of(heat, taken, groups)


def _rows_of(heat: HeatMap, rows: Sequence[int], groups: Mapping[str, int]) -> HeatMap:
    return replace(
        heat,
        rows=[heat.rows[row] for row in rows],
        cells=[heat.cells[row] for row in rows],
        groups=dict(groups) if heat.groups else {},
    )


@singledispatch
def draw(figure: Figure, looks: Mapping[str, Look]) -> Drawing:
    """Draw a figure of a kind that this renderer knows; TypeError for another kind."""
    raise TypeError(f"found a {type(figure).__name__}; expected Chart, HeatMap or MechanismPicture")


@draw.register
def _(chart: Chart, looks: Mapping[str, Look]) -> Drawing:
    columns = 1 if narrow() else min(chart.columns, len(chart.panels))
    rows = -(-len(chart.panels) // columns)
    room = max(LEAST_PANEL, (TALLEST - LEGEND - MARGIN) / max(rows, 1))
    height = LEGEND + MARGIN + rows * min(chart.height, room)
    figure, axes = panels(rows, columns, height, sharex=chart.share_x, sharey=chart.share_y)
    handles: dict[str, Artist] = {}
    for ax, panel in zip(axes.flat, chart.panels):
        _draw_panel(ax, panel, looks, handles)
    for ax in axes.flat[len(chart.panels) :]:
        ax.set_axis_off()
    for ax in axes[:-1].flat if chart.share_x else ():
        ax.set_xlabel("")
    for ax in axes[:, 1:].flat if chart.share_y else ():
        ax.set_ylabel("")
    letter(list(axes.flat[: len(chart.panels)]))
    if handles:
        legend(figure, handles)
    return Drawing(chart.name, chart.caption, figure)


def _draw_panel(
    ax: Axes, panel: Panel, looks: Mapping[str, Look], handles: dict[str, Artist]
) -> None:
    """Draw the panel, and add to the handles of the legend what its series add."""
    for begin, end in panel.shades:
        ax.axvspan(begin, end, color=SHADE, linewidth=0, zorder=0)
    for x in panel.lines:
        ax.axvline(x, zorder=1, **OWN_LOOKS[LIMIT].line())
    for series in panel.series:
        look = looks.get(series.look) or OWN_LOOKS.get(series.look, PLAIN)
        line = look.line() if series.line else {"color": look.color, "linestyle": "none"}
        marked = replace(look, fill="none") if series.hollow else look
        style = {**line, **(marked.points() if series.points else {"marker": ""})}
        if series.low is None or series.high is None:
            ax.plot(series.x, series.y, **style)
        else:
            middle = series.x if panel.horizontal else series.y
            spread = np.array([middle - series.low, series.high - middle]).clip(min=0.0)
            ax.errorbar(
                series.x,
                series.y,
                xerr=spread if panel.horizontal else None,
                yerr=None if panel.horizontal else spread,
                elinewidth=0.8,
                capsize=1.5,
                **style,
            )
        if series.label:
            handles.setdefault(series.label, Line2D([], [], **style))
    _set_axis("x", ax.xaxis, panel.x)
    _set_axis("y", ax.yaxis, panel.y)
    ax.set(title=panel.title, xlabel=panel.x.label, ylabel=panel.y.label)


def _set_axis(name: str, axis: MatplotlibAxis, about: Axis) -> None:
    if about.log:
        axis.axes.set(**{f"{name}scale": "log"})
    if len(about.words):
        words = (
            [fill(word, WORDS, break_on_hyphens=False) for word in about.words]
            if narrow()
            else list(about.words)
        )
        axis.set_ticks(list(about.ticks), words)
        axis.set_tick_params(which="both", length=0)
    elif len(about.ticks):
        tick_at(axis, about.ticks)
    if about.limits is not None:
        axis.axes.set(**{f"{name}lim": about.limits})


@draw.register
def _(heat: HeatMap, looks: Mapping[str, Look]) -> Drawing:
    lines: list[
        tuple[str, int | None]
    ] = []  # of the grid, from above: a heading, or a row of cells
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
                corners = [
                    (x - 0.46, y - 0.44),
                    (x + 0.46, y - 0.44),
                    (x + 0.46, y + 0.44),
                    (x - 0.46, y + 0.44),
                ]
                squares.setdefault(color, []).append(Path([*corners, corners[0]], closed=True))
                ax.text(x, y, sign, fontsize=6, va="center", ha="center", color=_contrast(color))
    for (
        color,
        paths,
    ) in squares.items():
        # one shape for all squares of a colour: a twentieth of the bytes
        ax.add_patch(PathPatch(Path.make_compound_path(*paths), color=color, linewidth=0))
    ax.set(xlim=(-0.5, len(heat.columns) - 0.5), ylim=(len(lines) - 0.5, -0.5))
    rows = {y: text for y, (text, row) in enumerate(lines) if row is not None}
    ax.set_yticks(list(rows), list(rows.values()), fontsize=6)
    ax.set_xticks(
        range(len(heat.columns)),
        heat.columns,
        rotation=turned,
        ha="left",
        va="center" if narrow() else "baseline",
        rotation_mode="anchor",
        fontsize=6.5,
    )
    ax.xaxis.tick_top()
    ax.tick_params(length=0, which="both")
    ax.spines[:].set_visible(False)
    there = {category for row in heat.cells for category in row}
    handles = {
        f"{sign}  {category}": Patch(color=color)
        for category, (sign, color) in heat.categories.items()
        if category in there
    }
    legend(figure, handles, columns=6)
    return Drawing(heat.name, heat.caption, figure)


def _contrast(color: str) -> str:
    """Black on light colours, white on dark ones (luma of Rec. 601)."""
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return "#000000" if 0.299 * red + 0.587 * green + 0.114 * blue > 140 else "#FFFFFF"


@draw.register
def _(picture: MechanismPicture, looks: Mapping[str, Look]) -> Drawing:
    figure = mechanism_drawing(load_scene(picture.scene), heading=False)
    own, height = figure.get_size_inches()
    figure.set_size_inches(width(), TEXT + (height - TEXT) * width() / own)
    return Drawing(picture.name, picture.caption, figure)
