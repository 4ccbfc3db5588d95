"""What all figures share: sizes, type, colours that the colour-blind can tell apart, legends outside of the data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from comparisons.variants import Record, Variant

WIDTH = 7.0
"""Inches: both columns of a journal page; type of 8 pt is then printed as 8 pt."""
DPI = 200

OKABE_ITO = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
BASE_COLOR, SHADE = "#000000", "#DDDDDD"
FIDELITY_DASHES: Mapping[str, Any] = {"joint": "-", "contact": (0, (4, 1.5))}
MARKERS = "osD^vPX"
TIME = "$t$ [s]"

_RC = {
    "font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"], "font.size": 8, "axes.titlesize": 8, "axes.labelsize": 8,
    "legend.fontsize": 7, "xtick.labelsize": 7, "ytick.labelsize": 7, "axes.linewidth": 0.6, "lines.linewidth": 1.0,
    "xtick.direction": "in", "ytick.direction": "in", "xtick.top": True, "ytick.right": True, "xtick.major.width": 0.6,
    "ytick.major.width": 0.6, "xtick.major.size": 3, "ytick.major.size": 3, "xtick.minor.size": 1.5, "ytick.minor.size": 1.5,
    "legend.frameon": False, "legend.handlelength": 2.2, "axes.formatter.useoffset": False, "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True, "axes.grid": False, "mathtext.fontset": "dejavusans",
    # TrueType, so that a publisher's tools can read and search the text
    "pdf.fonttype": 42, "ps.fonttype": 42, "path.simplify": True, "path.simplify_threshold": 0.2,
}


@dataclass(frozen=True)
class Drawing:
    """A figure, the name of its files and the caption it carries in a paper."""

    name: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Look:
    """How a variant is drawn everywhere."""

    color: str
    dashes: Any
    marker: str

    def line(self, **changes: Any) -> dict[str, Any]:
        return {"color": self.color, "linestyle": self.dashes, "linewidth": 0.8, **changes}


def rc() -> AbstractContextManager[None]:
    """Type and lines of these figures, for figures made and saved within."""
    return mpl.rc_context({**mpl.rcParamsDefault, "backend": mpl.rcParams["backend"], **_RC})


def looks(variants: Iterable[Variant]) -> dict[str, Look]:
    """By label: an engine keeps its colour and marker, a fidelity its dashes, variants of one engine beyond that get others."""
    found: dict[str, Look] = {}
    engines: list[str] = []
    own = 0
    for variant in variants:
        if variant.label in found:
            continue
        if variant.engine == "reference":
            color, dashes = (("#000000", "-"), ("#56B4E9", "-"), ("#0072B2", "--"), ("#D55E00", "-."), ("#CC79A7", ":"))[min(own, 4)]
            found[variant.label] = Look(color, dashes, "*hpdH"[min(own, 4)])
            own += 1
            continue
        if variant.engine not in engines:
            engines.append(variant.engine)
        number = engines.index(variant.engine)
        found[variant.label] = Look(OKABE_ITO[number % len(OKABE_ITO)], FIDELITY_DASHES.get(variant.fidelity, ":"),
                                    MARKERS[number % len(MARKERS)])
    return found


def all_looks(records: Iterable[Record]) -> dict[str, Look]:
    return looks(record.variant for record in records)


def panels(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, Any]:
    """A figure of full width and its axes, shape (rows, columns)."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def legend(figure: Figure, handles: Mapping[str, Artist], columns: int = 4) -> None:
    """One legend for the figure, above its axes."""
    if handles:
        figure.legend(list(handles.values()), list(handles), loc="outside upper center", ncols=min(columns, len(handles)))


def letter(axes: Iterable[Axes]) -> None:
    """(a), (b), .. at the panels' upper left corners, outside of the data."""
    for number, ax in enumerate(axes):
        ax.set_title(f"({chr(ord('a') + number)})" + (f" {title}" if (title := ax.get_title()) else ""), loc="left")
        ax.set_title("", loc="center")


def save(drawing: Drawing, folder: Path) -> None:
    """PNG and PDF; without dates, so that the same data give the same bytes."""
    drawing.figure.savefig(folder / f"{drawing.name}.png", dpi=DPI, metadata={"Software": None})
    drawing.figure.savefig(folder / f"{drawing.name}.pdf", metadata={"CreationDate": None})
