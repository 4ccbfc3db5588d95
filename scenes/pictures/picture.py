"""Fonts, colours and files of all pictures. The same data result in the same bytes of a file."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

MM_PER_INCH = 25.4
"""Millimetres in an inch."""
WIDTH = 174 / MM_PER_INCH
"""Width of a picture, inches: both columns of a journal page."""
DPI = 150
"""Resolution of bitmaps, pixels per inch."""
MAX_LAYOUTS = 6
"""Largest number of layouts in which labels are broken into shorter lines."""
# The colours are those of Okabe & Ito, which the colour-blind can distinguish; the purple is darker.
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
"""Metadata by format; without dates and versions, the same data result in the same bytes."""


def rc() -> AbstractContextManager[None]:
    """Return a context with the fonts and lines of these pictures in place of the user's settings."""
    return style.context(["default", RC])


class Picture(Figure):
    """A matplotlib figure that Jupyter shows without pyplot; width and height are in inches."""

    def __init__(self, height: float, width: float = WIDTH, dpi: int = DPI):
        super().__init__(figsize=(width, height), dpi=dpi, layout="constrained")
        FigureCanvasAgg(self)

    def write(self, file: str | Path) -> None:
        """Write the picture to a file, whose extension (.svg, .pdf or .png) determines the format."""
        with rc():
            write_figure(self, Path(file))

    def svg(self) -> str:
        """Return the picture as an SVG element of an HTML page."""
        with rc():
            text = content(self, "svg").decode()
        return text[text.index("<svg") :]

    def _repr_png_(self) -> bytes:
        with rc():
            return content(self, "png")


def write_figure(figure: Figure, file: Path) -> None:
    """Write a figure with the current settings of matplotlib; the extension of the file determines the format."""
    file.write_bytes(content(figure, file.suffix.lower().removeprefix(".")))


def content(figure: Figure, kind: str) -> bytes:
    """Return the content of a file with a figure; `kind` is ``"svg"``, ``"pdf"`` or ``"png"``.

    It is made in memory, so that a full disk causes an OSError. The writers of matplotlib raise other errors.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, dpi="figure", metadata=_UNDATED[kind])
    return buffer.getvalue()


def fit_labels(figure: Figure) -> None:
    """Break the labels of axes and titles that are too long into lines, and lay the figure out again.

    The room of a label beside an axis is the length of this axis, so that the labels of neighbouring panels do not
    overlap. A label below an axis, or a title, may extend to the edges of the figure if no other axes are at its sides.
    """
    original_texts: dict[Text, str] = {}
    widths: dict[Text, int] = {}
    # Additional lines reduce the size of the axes, which may then be too short for other labels.
    for _ in range(MAX_LAYOUTS):
        figure.draw_without_rendering()
        has_changed = False
        for text, is_vertical, room in _labels_with_room(figure):
            extent = text.get_window_extent()
            needed = extent.height if is_vertical else extent.width
            if not needed > room > 0:
                continue
            before = text.get_text()
            original = original_texts.setdefault(text, before)
            # Reduce the number of characters in proportion, and at least by one.
            longest = max(map(len, before.split("\n")))
            in_proportion = math.floor(longest * room / needed)
            widths[text] = max(1, min(widths.get(text, longest) - 1, in_proportion))
            text.set_text(_break_lines(original, widths[text]))
            has_changed |= text.get_text() != before
        if not has_changed:
            return
    figure.draw_without_rendering()


def _labels_with_room(figure: Figure) -> Iterator[tuple[Text, bool, float]]:
    """Yield each label of a figure, whether it is vertical, and the length that is available to it, pixels."""
    axes = [ax for ax in figure.axes if ax.axison]
    boxes = {ax: ax.get_window_extent() for ax in axes}
    figure_width = figure.bbox.width
    for ax, box in boxes.items():
        has_neighbour = any(
            other.y0 < box.y1 and other.y1 > box.y0
            for other_axes, other in boxes.items()
            if other_axes is not ax
        )
        below = above = box.width
        if not has_neighbour:
            # The label below is centred; the title begins at the left end of the axis.
            middle = 0.5 * (box.x0 + box.x1)
            below = 2 * min(middle, figure_width - middle)
            above = figure_width - box.x0
        yield ax.yaxis.label, True, box.height
        yield ax.xaxis.label, False, below
        yield ax.title, False, above
        yield ax._left_title, False, above  # type: ignore[attr-defined]


def _break_lines(text: str, width: int) -> str:
    """Return a text in lines of at most `width` characters, if possible.

    Lines are broken at spaces. If a word is longer, they are also broken behind dots, underscores, slashes and commas.
    """
    pieces = re.split(r"(?<= )", text)
    if max(len(piece.rstrip()) for piece in pieces) > width:
        pieces = re.split(r"(?<=[ ._/,])", text)
    lines = [""]
    for piece in pieces:
        if lines[-1] and len((lines[-1] + piece).rstrip()) > width:
            lines.append("")
        lines[-1] += piece
    return "\n".join(line.rstrip() for line in lines)
