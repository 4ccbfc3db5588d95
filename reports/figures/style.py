"""The common style of figures: sizes, type, colours that the colour-blind can distinguish, legends outside the data."""

from __future__ import annotations

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

COLUMNS = {"single": 84 / 25.4, "double": 174 / 25.4}
"""Widths of figures, inches: one column (84 mm) and both (174 mm) of a journal page; type is printed in its size."""
TALLEST = 200 / 25.4
"""Height of a figure in one column, inches: with its caption it fits on a page of A4 or letter."""
DPI = 200
KINDS = ("svg", "pdf")
"""Kinds of files of a figure: for reports and pages, and for papers."""
SHARE = 4
"""Figures that it takes to keep a process busy for longer than it takes to start."""
SEPARATE = 2.0
"""Ratio of two values of a logarithmic axis whose labels do not touch."""
LEGEND_ROWS = 3
"""Rows of a legend, for which the heights of figures leave room."""

# Okabe & Ito's palette, without its yellow, too light for a line on white, and its black, which is the truth's
COLORS = ("#332288", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#666666")
TRUTH_COLOR, SHADE = "#999999", "#E2E2E2"
DASHES: Sequence[Any] = (
    "-",
    *(
        (0, dashes)
        for dashes in (
            (5, 1.5),
            (5, 1.5, 1, 1.5),
            (1, 1.2),
            (5, 1.2, 1, 1.2, 1, 1.2),
            (9, 2),
            (9, 1.5, 2, 1.5),
            (2, 2),
            (7, 1, 1, 1, 1, 1, 1, 1),
            (4, 4),
        )
    ),
)
MARKERS = "osD^vPX<>*hpd8"
FILLS = {Fidelity.JOINT: ("full", "left"), Fidelity.CONTACT: ("none", "top")}
"""Fills of markers, by fidelity: the second where the first has been used with all `MARKERS`."""

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
    "svg.fonttype": "none",
}  # text as text


@dataclass(frozen=True)
class Drawing:
    """A figure, the name of its files, and the caption that it carries in a paper."""

    name: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Look:
    """Colour, dashes and marker of a variant in all figures; no two have the same marker with the same fill."""

    color: str
    dashes: Any
    marker: str
    fill: str = "full"

    def line(self) -> dict[str, Any]:
        return {"color": self.color, "linestyle": self.dashes, "linewidth": 0.9}

    def points(self) -> dict[str, Any]:
        inside = (
            {"markerfacecolor": "white"}
            if self.fill == "none"
            else {
                "markerfacecolor": self.color,
                "markerfacecoloralt": "white",
                "fillstyle": self.fill,
            }
        )
        return {
            "marker": self.marker,
            "markeredgecolor": self.color,
            "markersize": 3.5,
            "markeredgewidth": 0.8,
            **inside,
        }


def rc(column: str = "double") -> AbstractContextManager[None]:
    """Set type, lines and width (of `COLUMNS`), for figures made and saved within."""
    return style.context(
        ["default", {**_RC, "figure.figsize": (COLUMNS[column], COLUMNS["single"])}]
    )


def width() -> float:
    """Width of figures made here and now, inches."""
    return matplotlib.rcParams["figure.figsize"][0]


def narrow() -> bool:
    """Figures made here and now hold panels below each other only."""
    return width() <= COLUMNS["single"]


def looks_of(variants: Mapping[str, tuple[str, Fidelity]]) -> dict[str, Look]:
    """Choose the look of each variant: colour by engine, dashes within a colour, fill by fidelity, marker in turn.

    No two have the same colour with the same dashes, nor the same marker with the same fill. `variants` has engine and
    fidelity by label; InputError for more than can be distinguished.
    """
    engines = list(dict.fromkeys(engine for engine, _ in variants.values()))
    dashed, marked, found = Counter[str](), Counter[str](), dict[str, Look]()
    for label, (engine, fidelity) in variants.items():
        color, fills = COLORS[engines.index(engine) % len(COLORS)], FILLS[fidelity]
        most = len(fills) * len(MARKERS)
        if dashed[color] == len(DASHES) or marked[fidelity] == most:
            raise InputError(
                f"figures: found {len(variants)} variants; expected at most {len(DASHES)} of a colour, "
                f"and {most} of a fidelity, which are as many as can be distinguished"
            )
        fill, marker = divmod(marked[fidelity], len(MARKERS))
        found[label] = Look(color, DASHES[dashed[color]], MARKERS[marker], fills[fill])
        dashed[color] += 1
        marked[fidelity] += 1
    return found


def variants_of(results: Results) -> dict[str, tuple[str, Fidelity]]:
    """Return engine and fidelity of every variant of a run, by label, those that only a table has included."""
    found = {
        record.variant.label: (record.variant.engine, record.variant.fidelity)
        for record in results.records
    }
    for table in results.tables.values():
        if {"variant", "engine", "fidelity"} <= set(table):
            rows = table.drop_duplicates("variant")
            found = (
                found
                | dict(zip(rows["variant"], zip(rows["engine"], map(Fidelity, rows["fidelity"]))))
                | found
            )
    return found


def panels(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, Any]:
    """Make a figure of `width` and its axes, shape (rows, columns)."""
    figure = Picture(height, width(), DPI)  # hinted text is as wide as in the file
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def legend(figure: Figure, handles: Mapping[str, Artist], columns: int = 4) -> None:
    """Put one legend above the axes, of at most so many columns as fit in the width.

    The figure grows by what the legend has beyond `LEGEND_ROWS` rows.
    """
    for count in range(min(columns, len(handles)), 0, -1):
        # matplotlib fills column by column; people read row by row
        labels = [label for column in range(count) for label in list(handles)[column::count]]
        made = figure.legend(
            [handles[label] for label in labels], labels, loc="outside upper center", ncols=count
        )
        box = made.get_window_extent()
        if count == 1 or box.width <= figure.bbox.width:
            rows = -(-len(handles) // count)
            more = max(0, rows - LEGEND_ROWS) * box.height / figure.dpi / rows
            figure.set_figheight(figure.get_figheight() + more)
            return
        made.remove()


def tick_at(axis: Axis, values: Iterable[float]) -> None:
    """Set ticks of a logarithmic axis at the values drawn, from the smallest on, as far as their labels have room."""
    shown: list[float] = []
    for value in sorted(set(values)):
        if not shown or value >= SEPARATE * shown[-1]:
            shown.append(value)
    axis.set_ticks(shown, [f"{value:g}" for value in shown])
    axis.set_minor_formatter(NullFormatter())


def letter(axes: Sequence[Axes]) -> None:
    """Write (a), (b), .. at the panels' upper left corners, outside of the data, where there are several."""
    for number, ax in enumerate(axes if len(axes) > 1 else ()):
        ax.set_title(f"({chr(ord('a') + number)}) {ax.get_title()}".strip(), loc="left")
        ax.set_title("", loc="center")


def save_all(
    drawings: Sequence[Drawing], folder: Path, column: str = "double", kinds: Sequence[str] = KINDS
) -> None:
    """Write files of figures made under ``rc(column)``, in other processes where they are many."""
    one = partial(save, folder=folder, column=column, kinds=kinds)
    workers = min(os.cpu_count() or 1, len(drawings) // SHARE)
    if workers < 2:
        for drawing in drawings:
            one(drawing)
        return
    with ProcessPoolExecutor(workers, child_context()) as pool:
        list(pool.map(one, drawings))


def save(
    drawing: Drawing, folder: Path, column: str = "double", kinds: Iterable[str] = KINDS
) -> None:
    """Write one figure; without dates, so that the same data give the same bytes."""
    with rc(column):
        fit_labels(drawing.figure)
        drawing.figure.set_layout_engine(
            None
        )  # positions are found; finding them again for each file doubles the time
        for kind in kinds:
            with whole_file(folder / f"{drawing.name}.{kind}") as file:
                write_figure(drawing.figure, file)
