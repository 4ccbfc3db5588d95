"""Figures as data: charts with series over axes, heat maps, and pictures of mechanisms.

Renderers draw these three kinds of figures. The caption of a figure is filled in from the study's
template when its section is written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stiction.scenes import Scene

TRUTH = "truth"
"""Look of a series that shows the truth: black."""
ON_TOP = "on top"
"""Look of the reference on top of other runs: black and dashed, so that equal runs below it are seen."""
LIMIT = "limit"
"""Look of a line that is not a result: thin, grey, dotted."""
OTHER = "other"
"""Look of points that do not belong to a variant: small and grey."""
CHOSEN = "chosen"
"""Look of points that show the default setting: an empty diamond."""
BETTER = "better"
"""Look of points that show a better setting: a filled diamond."""


@dataclass(frozen=True, eq=False)
class Series:
    """Points, a line through them, or both.

    Attributes
    ----------
    label : str
        Text in the legend; if empty, the series is not in the legend.
    x, y : ndarray, shape (n,)
        In the units of the axes.
    low, high : ndarray, shape (n,), optional
        Ends of the interval of each y, or of each x in a horizontal panel.
    look : str
        Colour and marker: the label of a variant, which looks the same in all figures; or a look of
        this module; or any other name, to which a look is assigned within the figure.
    line, points, hollow : bool
        True to draw a line, markers, and markers without fill.
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
    """An axis of a panel.

    Attributes
    ----------
    label : str
        Label with unit.
    log : bool
        True for a logarithmic scale.
    ticks : sequence of float
        Positions of ticks; chosen by the renderer if empty.
    words : sequence of str
        Labels of the ticks, if these are categories.
    limits : (float, float), optional
        Ends of the axis.
    """

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
        True if the y axis has categories and the intervals of series are intervals of x.
    shades : sequence of (float, float)
        Intervals of x with a grey background, such as stick phases.
    lines : sequence of float
        Positions x of vertical lines, such as instants, thresholds, or limits of stability.
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
    """Panels with a common legend.

    Attributes
    ----------
    name : str
        Name of the files of the figure.
    panels : sequence of Panel
    columns : int
        Number of panels in a row.
    height : float
        Height of a row in inches.
    share_x, share_y : bool
        True if all panels have the same limits of the axis.
    caption : str
        See the module.
    """

    name: str
    panels: Sequence[Panel]
    columns: int = 3
    height: float = 2.2
    share_x: bool = False
    share_y: bool = False
    caption: str = ""


@dataclass(frozen=True, eq=False)
class HeatMap:
    """A grid of cells, each of which shows its category by a sign and a colour.

    Attributes
    ----------
    name : str
        Name of the files of the figure.
    rows, columns : sequence of str
        Labels.
    cells : sequence of sequence of str
        Categories, row by row; an empty text for a cell without a category.
    categories : Mapping[str, tuple[str, str]]
        Sign and colour (hexadecimal) of each category, best first.
    groups : Mapping[str, int]
        Number of rows below each heading.
    caption : str
        See the module.
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
    """A picture of the mechanism of a scene at its start, with dimensions and the numbers of corners."""

    name: str
    scene: Scene
    caption: str = ""


Figure = Chart | HeatMap | MechanismPicture
