"""Common style of figures: sizes, fonts, colours, markers, legends, and the files that are written.

The colours can be distinguished by people with colour-vision deficiency. Legends are outside the data.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from stiction.child_processes import child_context
from stiction.comparisons.bench.results import Results
from stiction.scenes import InputError
from stiction.scenes.atomic_files import whole_file
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.pictures.picture import RC, Picture, fit_labels, write_figure

_MM_PER_INCH = 25.4
COLUMNS = {"single": 84 / _MM_PER_INCH, "double": 174 / _MM_PER_INCH}
"""Widths of figures, inches: one column (84 mm) or two (174 mm) of a journal page.

Figures are printed in these widths, so that the font sizes are those of the page.
"""
TALLEST = 200 / _MM_PER_INCH
"""Largest height of a figure in one column, inches: with its caption it fits on a page of A4 or letter."""
DPI = 200
"""Resolution of the parts of a figure that are bitmaps, dots per inch."""
KINDS = ("svg", "pdf")
"""File formats of a figure: SVG for reports and pages, PDF for papers."""
MIN_FIGURES_PER_PROCESS = 4
"""Number of figures whose saving takes longer than the start of a process."""
MIN_TICK_RATIO = 2.0
"""Smallest ratio of two ticks of a logarithmic axis whose labels do not touch."""
LEGEND_ROWS = 3
"""Number of rows of a legend for which the heights of figures leave room."""

COLORS = ("#332288", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#666666")
"""Colours of engines: the palette of Okabe & Ito, changed where a colour was not usable here.

Its yellow is too light for a line on white, and its black is the colour of the truth.
"""
TRUTH_COLOR = "#999999"
"""Colour of limits and of lines for comparison."""
SHADE = "#E2E2E2"
"""Colour of the background of stick phases."""
DASHES: Sequence[Any] = (
    "-",
    (0, (5, 1.5)),
    (0, (5, 1.5, 1, 1.5)),
    (0, (1, 1.2)),
    (0, (5, 1.2, 1, 1.2, 1, 1.2)),
    (0, (9, 2)),
    (0, (9, 1.5, 2, 1.5)),
    (0, (2, 2)),
    (0, (7, 1, 1, 1, 1, 1, 1, 1)),
    (0, (4, 4)),
)
"""Line styles of the variants of an engine, as matplotlib takes them: offset and lengths, points."""
MARKERS = "osD^vPX<>*hpd8"
"""Markers of variants, as matplotlib names them."""
FILLS = {Fidelity.JOINT: ("full", "left"), Fidelity.CONTACT: ("none", "top")}
"""Fill styles of markers by fidelity; the second one is used after all `MARKERS` have the first one."""

LINE_WIDTH = 0.9
"""Width of a curve, points."""
MARKER_SIZE = 3.5
"""Size of a marker, points."""
MARKER_EDGE_WIDTH = 0.8
"""Width of the outline of a marker, points."""

_RC = {
    **RC,
    "axes.titlesize": 8,
    "xtick.top": True,
    "ytick.right": True,
    "legend.handlelength": 2.2,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
    # Text in an SVG file stays text, which can be selected and searched.
    "svg.fonttype": "none",
}


@dataclass(frozen=True)
class Drawing:
    """A figure that is drawn.

    Attributes
    ----------
    name : str
        Name of its files, without folder and ending.
    caption : str
        Its caption, Markdown on one line.
    figure : Figure
        The figure of matplotlib.
    """

    name: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Look:
    """Colour, line style and marker of a variant, the same in all figures.

    Attributes
    ----------
    color : str
        Colour of line and marker, ``#RRGGBB``.
    dashes : str or tuple
        Line style, as matplotlib takes it.
    marker : str
        Marker, as matplotlib names it; empty for none.
    fill : str
        Fill style of the marker; ``none`` for a white marker with a coloured outline.
    """

    color: str
    dashes: Any
    marker: str
    fill: str = "full"

    def line(self) -> dict[str, Any]:
        """Return the options of `Axes.plot` for the line."""
        return {"color": self.color, "linestyle": self.dashes, "linewidth": LINE_WIDTH}

    def points(self) -> dict[str, Any]:
        """Return the options of `Axes.plot` for the markers."""
        options: dict[str, Any] = {
            "marker": self.marker,
            "markeredgecolor": self.color,
            "markersize": MARKER_SIZE,
            "markeredgewidth": MARKER_EDGE_WIDTH,
        }
        if self.fill == "none":
            return {**options, "markerfacecolor": "white"}
        return {
            **options,
            "markerfacecolor": self.color,
            "markerfacecoloralt": "white",
            "fillstyle": self.fill,
        }


def rc(column: str = "double") -> AbstractContextManager[None]:
    """Return a context in which figures are made and saved in the common style.

    `column` is the width of the figures, a name in `COLUMNS`.
    """
    return style.context(
        ["default", {**_RC, "figure.figsize": (COLUMNS[column], COLUMNS["single"])}]
    )


def figure_width() -> float:
    """Return the width of figures in the current context of `rc`, inches."""
    return matplotlib.rcParams["figure.figsize"][0]


def is_one_column() -> bool:
    """Return whether figures in the current context have the width of one column of a page.

    Such figures have room for one panel in a row.
    """
    return figure_width() <= COLUMNS["single"]


def looks_of(variants: Mapping[str, tuple[str, Fidelity]]) -> dict[str, Look]:
    """Choose the look of each variant so that all variants can be distinguished.

    An engine has one colour. Variants of the same colour differ in their dashes, and all variants differ
    in their marker or its fill; the fidelity determines the fill.

    Parameters
    ----------
    variants : mapping of str to (str, Fidelity)
        Engine and fidelity of each variant, by the label of the variant.

    Raises
    ------
    InputError
        If there are more variants than looks that can be distinguished.
    """
    engines = list(dict.fromkeys(engine for engine, _ in variants.values()))
    variants_by_color = Counter[str]()
    variants_by_fidelity = Counter[str]()
    looks: dict[str, Look] = {}
    for label, (engine, fidelity) in variants.items():
        color = COLORS[engines.index(engine) % len(COLORS)]
        fills = FILLS[fidelity]
        max_markers = len(fills) * len(MARKERS)
        if variants_by_color[color] == len(DASHES) or variants_by_fidelity[fidelity] == max_markers:
            raise InputError(
                f"figures: found {len(variants)} variants; expected at most {len(DASHES)} of a colour, "
                f"and {max_markers} of a fidelity, which are as many as can be distinguished"
            )
        # All markers with the first fill are used before any marker with the second one.
        fill, marker = divmod(variants_by_fidelity[fidelity], len(MARKERS))
        dashes = DASHES[variants_by_color[color]]
        looks[label] = Look(color, dashes, MARKERS[marker], fills[fill])
        variants_by_color[color] += 1
        variants_by_fidelity[fidelity] += 1
    return looks


def variants_of(results: Results) -> dict[str, tuple[str, Fidelity]]:
    """Return engine and fidelity of every variant of a run, by label.

    Variants that occur in a table only, and not among the runs, come last.
    """
    variants = {
        record.variant.label: (record.variant.engine, record.variant.fidelity)
        for record in results.records
    }
    for table in results.tables.values():
        if {"variant", "engine", "fidelity"} <= set(table):
            rows = table.drop_duplicates("variant")
            for label, engine, fidelity in zip(rows["variant"], rows["engine"], rows["fidelity"]):
                variants.setdefault(label, (engine, Fidelity(fidelity)))
    return variants


def make_panels(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, Any]:
    """Return a figure of `figure_width` and of a height in inches, and its axes.

    The axes are an array of shape (rows, columns). `options` are passed to `Figure.subplots`.
    """
    # With the resolution of the files, hinted text has the same width here and in the files.
    figure = Picture(height, figure_width(), DPI)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def add_legend(figure: Figure, handles: Mapping[str, Artist], columns: int = 4) -> None:
    """Add a legend above the axes, with as many columns (at most `columns`) as fit in the width.

    The figures leave room for `LEGEND_ROWS` rows, and become higher by the other rows.
    """
    for count in range(min(columns, len(handles)), 0, -1):
        # matplotlib fills a legend column by column; this order makes it read row by row
        labels = [label for column in range(count) for label in list(handles)[column::count]]
        legend = figure.legend(
            [handles[label] for label in labels], labels, loc="outside upper center", ncols=count
        )
        box = legend.get_window_extent()
        if count == 1 or box.width <= figure.bbox.width:
            rows = math.ceil(len(handles) / count)
            extra_height = max(0, rows - LEGEND_ROWS) * box.height / figure.dpi / rows
            figure.set_figheight(figure.get_figheight() + extra_height)
            return
        legend.remove()


def set_log_ticks(axis: Axis, values: Iterable[float]) -> None:
    """Set the ticks of a logarithmic axis at given values, and omit those whose labels would touch."""
    ticks: list[float] = []
    for value in sorted(set(values)):
        if not ticks or value >= MIN_TICK_RATIO * ticks[-1]:
            ticks.append(value)
    axis.set_ticks(ticks, [f"{value:g}" for value in ticks])
    axis.set_minor_formatter(NullFormatter())


def letter_panels(axes: Sequence[Axes]) -> None:
    """Write (a), (b), .. above the upper left corners of the panels, if there are several."""
    if len(axes) < 2:
        return
    for number, ax in enumerate(axes):
        ax.set_title(f"({chr(ord('a') + number)}) {ax.get_title()}".strip(), loc="left")
        ax.set_title("", loc="center")


def save_all(
    drawings: Sequence[Drawing], folder: Path, column: str = "double", kinds: Sequence[str] = KINDS
) -> None:
    """Write the files of figures that were made under ``rc(column)``, in parallel if they are many."""
    save_one = partial(save, folder=folder, column=column, kinds=kinds)
    workers = min(os.cpu_count() or 1, len(drawings) // MIN_FIGURES_PER_PROCESS)
    if workers < 2:
        for drawing in drawings:
            save_one(drawing)
        return
    with ProcessPoolExecutor(workers, child_context()) as pool:
        # `list` waits for all figures, and raises the first error.
        list(pool.map(save_one, drawings))


def save(
    drawing: Drawing, folder: Path, column: str = "double", kinds: Iterable[str] = KINDS
) -> None:
    """Write the files of a figure, without dates, so that the same data give the same bytes."""
    with rc(column):
        fit_labels(drawing.figure)
        # The layout is computed; computing it again for each file would double the time.
        drawing.figure.set_layout_engine(None)
        for kind in kinds:
            with whole_file(folder / f"{drawing.name}.{kind}") as file:
                write_figure(drawing.figure, file)
