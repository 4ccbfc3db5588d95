"""Type and colours of all pictures; files that are the same bytes for the same data."""

from __future__ import annotations

import io
import math
import re
from contextlib import AbstractContextManager
from pathlib import Path

from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

MM_PER_INCH = 25.4
"""Millimetres in an inch."""
WIDTH = 174 / MM_PER_INCH
"""Inches: both columns of a journal page."""
DPI = 150
MOST_TRIES = 6
"""Layouts of a figure at most, until no label is longer than its room."""
# of Okabe & Ito's palette (the purple darker), which the colour-blind can distinguish
COLORS = {
    "ink": "#000000",
    "quiet": "#888888",
    "paper": "#FFFFFF",
    "body": "#D9E4EC",
    "shade": "#E2E2E2",
    "drive": "#D55E00",
    "spring": "#009E73",
    "load": "#0072B2",
    "corner": "#A03A7B",
}
CYCLE = ("#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#666666")

RC = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "font.size": 8,
    "axes.labelsize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.6,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "legend.frameon": False,
    "hatch.linewidth": 0.4,
    "svg.hashsalt": "stiction",
    # TrueType, so that a publisher's tools can read and search the text
    "pdf.fonttype": 42,
}
_UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {"Software": None}}
"""Metadata with which the same data give the same bytes."""


def rc() -> AbstractContextManager[None]:
    """Context with type and lines of these pictures, whatever the user has set."""
    return style.context(["default", RC])


class Picture(Figure):
    """A matplotlib figure that Jupyter shows without pyplot; width and height in inches."""

    def __init__(self, height: float, width: float = WIDTH, dpi: int = DPI):
        super().__init__(figsize=(width, height), dpi=dpi, layout="constrained")
        FigureCanvasAgg(self)

    def write(self, file: str | Path) -> None:
        """Write it as SVG, PDF or PNG, by the ending of the name, without a date."""
        with rc():
            write_figure(self, Path(file))

    def svg(self) -> str:
        """Return it as an SVG element to put into a page."""
        with rc():
            text = content(self, "svg").decode()
        return text[text.index("<svg") :]

    def _repr_png_(self) -> bytes:
        with rc():
            return content(self, "png")


def write_figure(figure: Figure, file: Path) -> None:
    """Write a figure under the settings in force; the ending says as what."""
    file.write_bytes(content(figure, file.suffix.lower().removeprefix(".")))


def content(figure: Figure, kind: str) -> bytes:
    """Content of a file, made in memory: matplotlib's writers have own errors for a full disk."""
    file = io.BytesIO()
    figure.savefig(file, format=kind, dpi="figure", metadata=_UNDATED[kind])
    return file.getvalue()


def fit_labels(figure: Figure) -> None:
    """Break labels of axes and titles that are longer than their room into lines, and lay the figure out again.

    The room of a label beside an axis is the length of that axis, so that the labels of neighbours do not touch; below
    an axis that has no neighbours at its sides, and for its title, it reaches to the edges of the figure.
    """
    words: dict[Text, str] = {}
    widths: dict[Text, int] = {}
    for _ in range(MOST_TRIES):
        # lines take room from the axes, which may then be too short for other labels
        figure.draw_without_rendering()
        axes = [ax for ax in figure.axes if ax.axison]
        boxes = {ax: ax.get_window_extent() for ax in axes}
        broken = False
        for ax, box in boxes.items():
            alone = not any(
                other.y0 < box.y1 and other.y1 > box.y0
                for one, other in boxes.items()
                if one is not ax
            )
            middle, whole = 0.5 * (box.x0 + box.x1), figure.bbox.width
            below = 2 * min(middle, whole - middle) if alone else box.width
            above = whole - box.x0 if alone else box.width
            for text, room in (
                (ax.yaxis.label, box.height),
                (ax.xaxis.label, below),
                (ax.title, above),
                (ax._left_title, above),  # type: ignore[attr-defined]
            ):
                extent = text.get_window_extent()
                taken = extent.height if text is ax.yaxis.label else extent.width
                if taken > room > 0:
                    before = text.get_text()
                    longest = max(map(len, before.split("\n")))
                    widths[text] = max(
                        1, min(widths.get(text, longest) - 1, math.floor(longest * room / taken))
                    )
                    text.set_text(_broken(words.setdefault(text, before), widths[text]))
                    broken |= text.get_text() != before
        if not broken:
            return
    figure.draw_without_rendering()


def _broken(text: str, width: int) -> str:
    """The text in lines of at most so many signs, broken at spaces, or within names that are longer than that."""
    pieces = re.split(r"(?<= )", text)
    if max(len(piece.rstrip()) for piece in pieces) > width:
        pieces = re.split(r"(?<=[ ._/,])", text)
    lines = [""]
    for piece in pieces:
        if lines[-1] and len((lines[-1] + piece).rstrip()) > width:
            lines.append("")
        lines[-1] += piece
    return "\n".join(line.rstrip() for line in lines)
