"""Drawing of the figures that studies present as data: charts, heat maps and pictures of mechanisms.

`draw` has one implementation for each class of `stiction.comparisons.bench.presentation.charts`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from textwrap import fill
from typing import Any

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
    Series,
)
from stiction.comparisons.bench.presentation.charts import ON_TOP
from stiction.comparisons.bench.results import Results
from stiction.reports.figures.style import (
    COLORS,
    LEGEND_ROWS,
    SHADE,
    TALLEST,
    TRUTH_COLOR,
    Drawing,
    Look,
    add_legend,
    figure_width,
    is_one_column,
    letter_panels,
    looks_of,
    make_panels,
    set_log_ticks,
    variants_of,
)
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.pictures.mechanism import drawing as mechanism_drawing

BLACK = "#000000"
WHITE = "#FFFFFF"
PLAIN = Look(BLACK, "-", "o")
OWN_LOOKS = {
    TRUTH: Look(BLACK, "-", ""),
    ON_TOP: Look(BLACK, (0, (4, 2)), ""),
    LIMIT: Look(TRUTH_COLOR, ":", ""),
    "": PLAIN,
    OTHER: Look(TRUTH_COLOR, "-", "."),
    CHOSEN: Look(COLORS[1], "-", "D", "none"),
    BETTER: Look(COLORS[2], "-", "D"),
}
"""Looks of series that do not belong to a variant, by the look that the series names."""
LEGEND_HEIGHT = 0.75
"""Height of the legend, inches."""
MARGIN = 0.45
"""Height of the labels below the x axes, inches."""
CELL = 0.155
"""Height of a row of a heat map, inches."""
CHARACTER_WIDTH = 0.052
"""Average width of a character in the column names of a heat map, inches."""
COLUMN_NAME_ANGLE = 40.0
"""Angle of the column names of a heat map, degrees."""
NARROW_COLUMN_NAME_ANGLE = 90.0
"""The same in one column of a page, where names at an angle would exceed the width."""
LEGEND_ROW = 0.17
"""Height of a row of a legend, inches."""
MAX_COLUMN_PANEL = 1.65
"""Largest height of a panel in one column of a page, inches: its axes are then about twice as wide as high."""
MIN_PANEL = 1.2
"""Smallest height of a panel in a figure with many rows, inches: it has room for four labels of its axis."""
CATEGORY_WIDTH = 22
"""Longest line of a category at an axis in one column, characters: half of the width is left to the data."""
PICTURE_TEXT_HEIGHT = 1.2
"""Height of the text in the picture of a mechanism, inches: the text does not scale with the picture."""
LIGHT_LUMA = 140
"""Luma, 0 to 255, above which the text on a colour is black: a little above the middle."""


def draw_figures(figures: Sequence[Figure], results: Results) -> Iterator[Drawing]:
    """Yield a drawing of each figure. A variant has the same look in all of them. Call it within `style.rc()`."""
    used = {look for figure in figures for look in _looks_used(figure)}
    variants = {label: variant for label, variant in variants_of(results).items() if label in used}
    looks = looks_of(variants)
    for figure in figures:
        # A look that is not a variant's belongs to this figure alone, for example to a setting.
        others = {
            look: (look, Fidelity.JOINT)
            for look in _looks_used(figure)
            if look not in looks and look not in OWN_LOOKS
        }
        yield draw(figure, looks | looks_of(others))


def _looks_used(figure: Figure) -> list[str]:
    """Return the names of the looks in a figure, each once."""
    if not isinstance(figure, Chart):
        return []
    return list(dict.fromkeys(series.look for panel in figure.panels for series in panel.series))


def in_one_column(figure: Figure) -> list[Figure]:
    """Return a figure for one column of a page, divided into parts that are not higher than `TALLEST`."""
    if isinstance(figure, Chart):
        height = min(figure.height, MAX_COLUMN_PANEL)
        charts = [
            replace(figure, panels=panels, columns=1, height=height)
            for panels in _panels_of_parts(figure, height)
        ]
        return _name_parts(charts, figure)
    if isinstance(figure, HeatMap):
        return _name_parts(list(_parts_of_map(figure)), figure)
    return [figure]


def _name_parts(parts: Sequence[Chart | HeatMap], figure: Chart | HeatMap) -> list[Figure]:
    """Return the parts of a figure with numbered names and captions; a single part keeps those of the figure."""
    if not parts:
        return [figure]
    if len(parts) == 1:
        return list(parts)
    first_sentence = figure.caption.partition(". ")[0].rstrip(".")
    count = len(parts)
    numbered: list[Figure] = []
    for number, part in enumerate(parts, 1):
        caption = f"{first_sentence}, continued: part {number} of {count}."
        if number == 1:
            caption = f"{figure.caption} Part 1 of {count}."
        numbered.append(replace(part, name=f"{figure.name}-{number}", caption=caption))
    return numbered


def _panels_of_parts(chart: Chart, height: float) -> Iterator[list[Panel]]:
    """Yield the panels of each part of a chart, below each other, each panel `height` inches high.

    If a row of the chart fits into a part, parts consist of whole rows; otherwise each row is divided.
    """
    panels = _labelled_panels(chart)
    row_length = min(chart.columns, len(panels)) or 1
    labels = {series.label for panel in panels for series in panel.series if series.label}
    # In one column the legend may have one label in a row.
    extra_legend_height = LEGEND_ROW * max(0, len(labels) - LEGEND_ROWS)
    height_for_panels = TALLEST - LEGEND_HEIGHT - MARGIN - extra_legend_height
    max_panels = max(1, int(height_for_panels / height))
    if row_length <= max_panels:
        groups = [panels]
        part_length = max_panels // row_length * row_length
    else:
        groups = [panels[start : start + row_length] for start in range(0, len(panels), row_length)]
        part_length = max_panels
    for group in groups:
        for start in range(0, len(group), part_length):
            yield group[start : start + part_length]


def _labelled_panels(chart: Chart) -> list[Panel]:
    """Return the panels of a chart, each with the labels of its axes.

    In the chart, the first panel of a row may carry the y label for the row, and the last panel of a
    column the x label for the column. The words of a category axis replace its y label.
    """
    row_length = min(chart.columns, len(chart.panels)) or 1
    labelled = []
    for number, panel in enumerate(chart.panels):
        first_of_row = chart.panels[number - number % row_length]
        rows_below = (len(chart.panels) - 1 - number) // row_length
        last_of_column = chart.panels[number + row_length * rows_below]
        y_label = ""
        if not len(panel.y.words):
            y_label = panel.y.label or first_of_row.y.label
        x_label = panel.x.label or last_of_column.x.label
        labelled.append(
            replace(panel, x=replace(panel.x, label=x_label), y=replace(panel.y, label=y_label))
        )
    return labelled


def _parts_of_map(heat: HeatMap) -> Iterator[HeatMap]:
    """Yield the parts of a heat map, each with as many rows as fit into a page.

    A group of rows that is divided has its heading in each part.
    """
    names_height = CHARACTER_WIDTH * max(map(len, heat.columns), default=0)
    max_lines = int((TALLEST - LEGEND_HEIGHT - names_height) / CELL)
    rows: list[int] = []
    groups: dict[str, int] = {}
    next_row = 0
    for heading, count in (heat.groups or {"": len(heat.rows)}).items():
        for _ in range(count):
            # A heading takes a line like a row of cells.
            headings = len(groups)
            if heading not in groups:
                headings += 1
            if len(rows) + headings >= max_lines:
                yield _rows_of(heat, rows, groups)
                rows = []
                groups = {}
            rows.append(next_row)
            groups[heading] = groups.get(heading, 0) + 1
            next_row += 1
    yield _rows_of(heat, rows, groups)


def _rows_of(heat: HeatMap, rows: Sequence[int], groups: Mapping[str, int]) -> HeatMap:
    """Return a heat map with some of its rows; `groups` has the number of these rows by heading."""
    return replace(
        heat,
        rows=[heat.rows[row] for row in rows],
        cells=[heat.cells[row] for row in rows],
        groups=dict(groups) if heat.groups else {},
    )


@singledispatch
def draw(figure: Figure, looks: Mapping[str, Look]) -> Drawing:
    """Return a drawing of a figure, with the look of each series by its name.

    Raises
    ------
    TypeError
        For a class of figures that this renderer does not know.
    """
    raise TypeError(f"found a {type(figure).__name__}; expected Chart, HeatMap or MechanismPicture")


@draw.register
def _draw_chart(chart: Chart, looks: Mapping[str, Look]) -> Drawing:
    """Draw the panels of a chart on a grid, with one legend for all of them."""
    columns = 1 if is_one_column() else min(chart.columns, len(chart.panels))
    rows = math.ceil(len(chart.panels) / columns)
    height_of_row = (TALLEST - LEGEND_HEIGHT - MARGIN) / max(rows, 1)
    panel_height = min(chart.height, max(MIN_PANEL, height_of_row))
    height = LEGEND_HEIGHT + MARGIN + rows * panel_height
    figure, axes = make_panels(rows, columns, height, sharex=chart.share_x, sharey=chart.share_y)
    handles: dict[str, Artist] = {}
    for ax, panel in zip(axes.flat, chart.panels):
        _draw_panel(ax, panel, looks, handles)
    # The last row of the grid may have more places than panels.
    for ax in axes.flat[len(chart.panels) :]:
        ax.set_axis_off()
    # A shared axis has its label at the edge of the grid only.
    if chart.share_x:
        for ax in axes[:-1].flat:
            ax.set_xlabel("")
    if chart.share_y:
        for ax in axes[:, 1:].flat:
            ax.set_ylabel("")
    letter_panels(list(axes.flat[: len(chart.panels)]))
    if handles:
        add_legend(figure, handles)
    return Drawing(chart.name, chart.caption, figure)


def _draw_panel(
    ax: Axes, panel: Panel, looks: Mapping[str, Look], handles: dict[str, Artist]
) -> None:
    """Draw a panel, and add a handle for each new label of its series to those of the legend."""
    for begin, end in panel.shades:
        ax.axvspan(begin, end, color=SHADE, linewidth=0, zorder=0)
    for x in panel.lines:
        ax.axvline(x, zorder=1, **OWN_LOOKS[LIMIT].line())
    for series in panel.series:
        style = _series_style(series, looks)
        _draw_series(ax, series, style, panel.horizontal)
        if series.label:
            handles.setdefault(series.label, Line2D([], [], **style))
    _set_axis("x", ax.xaxis, panel.x)
    _set_axis("y", ax.yaxis, panel.y)
    ax.set(xlabel=panel.x.label, ylabel=panel.y.label)
    # Titles contain titles of scenes, in which a dollar sign is no mathematics.
    ax.set_title(panel.title, parse_math=False)


def _series_style(series: Series, looks: Mapping[str, Look]) -> dict[str, Any]:
    """Return the options of `Axes.plot` for a series: its line and its markers, or none."""
    look = looks.get(series.look) or OWN_LOOKS.get(series.look, PLAIN)
    style: dict[str, Any] = {"color": look.color, "linestyle": "none"}
    if series.line:
        style = look.line()
    if not series.points:
        return {**style, "marker": ""}
    if series.hollow:
        look = replace(look, fill="none")
    return {**style, **look.points()}


def _draw_series(ax: Axes, series: Series, style: Mapping[str, Any], is_horizontal: bool) -> None:
    """Draw a series, with error bars if it has bounds; these are of x if `is_horizontal`, else of y."""
    if series.low is None or series.high is None:
        ax.plot(series.x, series.y, **style)
        return
    middle = series.x if is_horizontal else series.y
    # Rounding may put a bound on the wrong side of the number, which matplotlib refuses.
    lengths = np.array([middle - series.low, series.high - middle]).clip(min=0.0)
    ax.errorbar(
        series.x,
        series.y,
        xerr=lengths if is_horizontal else None,
        yerr=None if is_horizontal else lengths,
        elinewidth=0.8,
        capsize=1.5,
        **style,
    )


def _set_axis(name: str, axis: MatplotlibAxis, properties: Axis) -> None:
    """Set scale, ticks and limits of the axis with the name ``x`` or ``y``."""
    if properties.log:
        axis.axes.set(**{f"{name}scale": "log"})
    if len(properties.words):
        words = list(properties.words)
        if is_one_column():
            words = [fill(word, CATEGORY_WIDTH, break_on_hyphens=False) for word in words]
        axis.set_ticks(list(properties.ticks), words)
        axis.set_tick_params(which="both", length=0)
    elif len(properties.ticks):
        set_log_ticks(axis, properties.ticks)
    if properties.limits is not None:
        axis.axes.set(**{f"{name}lim": properties.limits})


@dataclass(frozen=True)
class _Line:
    """A line of a heat map: the heading of a group, or a row of cells.

    Attributes
    ----------
    text : str
        The heading, or the name of the row.
    row : int or None
        Index of the row in the heat map; None for a heading.
    """

    text: str
    row: int | None


def _lines_of_map(heat: HeatMap) -> list[_Line]:
    """Return the lines of a heat map from top to bottom, each group of rows below its heading."""
    lines: list[_Line] = []
    next_row = 0
    for heading, count in (heat.groups or {"": len(heat.rows)}).items():
        if heading:
            lines.append(_Line(heading, None))
        for row in range(next_row, next_row + count):
            lines.append(_Line(heat.rows[row], row))
        next_row += count
    return lines


@draw.register
def _draw_map(heat: HeatMap, looks: Mapping[str, Look]) -> Drawing:
    """Draw a heat map: coloured squares with signs, rows by groups, and a legend of its categories."""
    lines = _lines_of_map(heat)
    angle = NARROW_COLUMN_NAME_ANGLE if is_one_column() else COLUMN_NAME_ANGLE
    longest_name = max(map(len, heat.columns), default=0)
    names_height = CHARACTER_WIDTH * np.sin(np.radians(angle)) * longest_name
    figure, [[ax]] = make_panels(1, 1, LEGEND_HEIGHT + names_height + CELL * len(lines))
    _draw_squares(ax, heat, lines)
    # Cells have the width and height 1, and their centres have whole numbers as coordinates.
    ax.set(xlim=(-0.5, len(heat.columns) - 0.5), ylim=(len(lines) - 0.5, -0.5))
    row_names = {y: line.text for y, line in enumerate(lines) if line.row is not None}
    ax.set_yticks(list(row_names), list(row_names.values()), fontsize=6)
    ax.set_xticks(
        range(len(heat.columns)),
        heat.columns,
        rotation=angle,
        ha="left",
        va="center" if is_one_column() else "baseline",
        rotation_mode="anchor",
        fontsize=6.5,
    )
    ax.xaxis.tick_top()
    ax.tick_params(length=0, which="both")
    ax.spines[:].set_visible(False)
    used_categories = {category for row in heat.cells for category in row}
    handles = {
        f"{sign}  {category}": Patch(color=color)
        for category, (sign, color) in heat.categories.items()
        if category in used_categories
    }
    add_legend(figure, handles, columns=6)
    return Drawing(heat.name, heat.caption, figure)


def _draw_squares(ax: Axes, heat: HeatMap, lines: Sequence[_Line]) -> None:
    """Draw the headings of a heat map, and a square with a sign for each cell that has a category."""
    squares: dict[str, list[Path]] = {}
    for y, line in enumerate(lines):
        if line.row is None:
            ax.text(-0.5, y, line.text, fontsize=6.5, fontstyle="italic", va="center", ha="left")
            continue
        for x, category in enumerate(heat.cells[line.row]):
            if not category:
                continue
            sign, color = heat.categories[category]
            squares.setdefault(color, []).append(_square(x, y))
            ax.text(x, y, sign, fontsize=6, va="center", ha="center", color=_text_color(color))
    for color, paths in squares.items():
        # One shape for all squares of a colour makes the file twenty times smaller.
        ax.add_patch(PathPatch(Path.make_compound_path(*paths), color=color, linewidth=0))


def _square(x: float, y: float) -> Path:
    """Return the outline of a cell of a heat map, with a small gap to its neighbours."""
    half_width = 0.46
    half_height = 0.44
    corners = [
        (x - half_width, y - half_height),
        (x + half_width, y - half_height),
        (x + half_width, y + half_height),
        (x - half_width, y + half_height),
    ]
    return Path([*corners, corners[0]], closed=True)


def _text_color(background: str) -> str:
    """Return black for a light background and white for a dark one, by the luma of Rec. ITU-R BT.601."""
    red, green, blue = (int(background[i : i + 2], 16) for i in (1, 3, 5))
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    return BLACK if luma > LIGHT_LUMA else WHITE


@draw.register
def _draw_mechanism(picture: MechanismPicture, looks: Mapping[str, Look]) -> Drawing:
    """Draw a mechanism, scaled to the width of figures; the size of its text does not change."""
    figure = mechanism_drawing(picture.scene, heading=False)
    width, height = figure.get_size_inches()
    scale = figure_width() / width
    scaled_height = PICTURE_TEXT_HEIGHT + (height - PICTURE_TEXT_HEIGHT) * scale
    if is_one_column():
        # Entries that stand beside each other on a page are below each other in a column.
        for legend in list(figure.legends):
            handles = [handle for handle in legend.legend_handles if handle is not None]
            labels = [text.get_text() for text in legend.get_texts()]
            legend.remove()
            figure.legend(handles, labels, loc="outside lower center", ncols=1)
            scaled_height += LEGEND_ROW * (len(labels) - 1)
    figure.set_size_inches(figure_width(), scaled_height)
    return Drawing(picture.name, picture.caption, figure)
