"""Type and colours of all pictures; files that are the same bytes for the same data."""

from __future__ import annotations

import io
from contextlib import AbstractContextManager
from pathlib import Path

from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

WIDTH = 174 / 25.4
"""Inches: both columns of a journal page."""
DPI = 150
# of Okabe & Ito's palette (the purple darker), which the colour-blind can distinguish
COLORS = {"ink": "#000000", "quiet": "#888888", "paper": "#FFFFFF", "body": "#D9E4EC", "shade": "#E2E2E2",
          "drive": "#D55E00", "spring": "#009E73", "load": "#0072B2", "corner": "#A03A7B"}
CYCLE = ("#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#666666")

RC = {"font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"], "mathtext.fontset": "dejavusans",
      "font.size": 8, "axes.labelsize": 8, "legend.fontsize": 7, "xtick.labelsize": 7, "ytick.labelsize": 7,
      "axes.linewidth": 0.6, "xtick.direction": "in", "ytick.direction": "in", "legend.frameon": False,
      "hatch.linewidth": 0.4, "svg.hashsalt": "stiction",
      "pdf.fonttype": 42}  # TrueType, so that a publisher's tools can read and search the text
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
        return text[text.index("<svg"):]

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
