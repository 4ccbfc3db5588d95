"""Figures as data: panels of series over axes, heat maps, mechanisms; renderers know these kinds alone.

The caption of a figure comes from the study's template when the section is written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

TRUTH = "truth"
"""Look of a series that is the truth: black."""
LIMIT = "limit"
"""Look of a series or line that is no result: thin, grey, dotted."""
OTHER, CHOSEN, BETTER = "other", "chosen", "better"
"""Looks of points that are of no variant: small and grey, an empty diamond, a filled one."""


@dataclass(frozen=True, eq=False)
class Series:
    """Points, a line through them, or both.

    Attributes
    ----------
    label : str
        Its words in the legend, which has none if empty.
    x, y : ndarray, shape (n,)
    low, high : ndarray, optional
        Ends of the interval of each y, or of each x in a horizontal panel; shape (n,).
    look : str
        Label of a variant, whose look is the same in all figures; or a look of this module; or another word, which
        has a look of its own in its figure.
    line, points, hollow : bool
        True for a line, markers, and markers without fill.
    """

    label: str
    x: np.ndarray
    y: np.ndarray
    low: np.ndarray | None = None
    high: np.ndarray | None = None
    look: str = ""
    line: bool = True
    points: bool = False
    hollow: bool = False


@dataclass(frozen=True)
class Axis:
    """Label with unit; logarithmic or not; ticks at these values, words at them on an axis of categories; ends."""

    label: str = ""
    log: bool = False
    ticks: Sequence[float] = ()
    words: Sequence[str] = ()
    limits: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """Series over two axes.

    Attributes
    ----------
    horizontal : bool
        True if the intervals of series are of x, over categories y.
    shades : sequence of (float, float)
        Parts of the x axis in grey: stick phases.
    lines : sequence of float
        Vertical lines at these x: instants, thresholds, limits of stability.
    """

    title: str
    x: Axis
    y: Axis
    series: Sequence[Series]
    horizontal: bool = False
    shades: Sequence[tuple[float, float]] = ()
    lines: Sequence[float] = ()


@dataclass(frozen=True, eq=False)
class Chart:
    """Panels in rows of `columns`, each row `height` inches high; all with one legend, on common axes where shared."""

    name: str
    panels: Sequence[Panel]
    columns: int = 3
    height: float = 2.2
    share_x: bool = False
    share_y: bool = False
    caption: str = ""


@dataclass(frozen=True, eq=False)
class HeatMap:
    """A grid of categories: a colour and a sign for each.

    Attributes
    ----------
    cells : sequence of sequence of str
        Categories, row by row; empty where there is none.
    categories : Mapping[str, tuple[str, str]]
        Sign and colour (hexadecimal) of each category, best first.
    groups : Mapping[str, int]
        Number of rows that follow each heading.
    """

    name: str
    rows: Sequence[str]
    columns: Sequence[str]
    cells: Sequence[Sequence[str]]
    categories: Mapping[str, tuple[str, str]]
    groups: Mapping[str, int] = field(default_factory=dict)
    caption: str = ""


@dataclass(frozen=True, eq=False)
class MechanismPicture:
    """The mechanism of a scene at its start, with dimensions and the numbers of corners."""

    name: str
    scene: str
    caption: str = ""


Figure = Chart | HeatMap | MechanismPicture
