"""Plots of the quantities of runs over time, with jumps as vertical lines and shaded stick phases."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from stiction.scenes.columns import label_of, unit_of, words_of
from stiction.scenes.pictures.picture import COLORS, CYCLE, WIDTH, Picture, fit_labels, rc
from stiction.scenes.trajectory import Trajectory

MAX_LINES = 8
"""Largest number of lines in a panel. If there are more columns, the legend contains their number."""
PANEL_HEIGHT = 1.25
"""Height of a panel, inches."""
_DASHES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
"""Line styles of matplotlib. A dashed line over a solid one lets both be seen where they coincide."""
EFFORT = "driving effort"
"""Label of the panel of efforts, to which their units are added."""
# Pattern of the end of a column's name -> label of the panel of these columns.
_PANELS = {
    r"\.displacement": "displacement [m]",
    r"\.slip_velocity": "slip velocity [m/s]",
    r"\.F[1-4]": "corner forces [N]",
    r"\.friction": "friction [N]",
    r"\.effort": EFFORT,
}
_WITHOUT_GUIDES = {
    r"\.[xy]": "position [m]",
    r"\.angle": "angle [rad]",
    r"\.effort": EFFORT,
    r"\.f[xy]": "pin forces [N]",
}


@dataclass(frozen=True)
class _Line:
    """A line of a panel."""

    frame: pd.DataFrame
    """The run, with the column ``t``"""
    column: str
    label: str


@dataclass(frozen=True)
class _Panel:
    """The columns of a panel."""

    columns: list[str]
    label: str


def evolution(
    runs: Sequence[Trajectory], columns: Sequence[str] = (), width: float = WIDTH
) -> Picture:
    """Plot columns of runs over time, one panel for each column, with a line for each run.

    A figure of chosen columns is meant for print: it has no title, and its labels consist of words,
    symbol and unit. The reference is black, and drawn on top of other runs.

    Parameters
    ----------
    runs
        One or more runs.
    columns
        Names of columns. If none are given, there must be one run; panels then show its usual quantities, with a line
        for each column.

    width
        Width of the figure, inches.

    Raises
    ------
    KeyError
        If a run does not have a column.
    """
    # Raises KeyError before anything is drawn.
    for run, name in product(runs, columns):
        run[name]
    first = runs[0]
    has_several_runs = len(runs) > 1
    panels = _usual_panels(first)
    if columns:
        panels = [_Panel([name], _axis_label(name, first)) for name in columns]
    # The last line, that of the reference, is on top of the others.
    runs = sorted(runs, key=lambda run: run.engine == "reference")
    frames = [run.to_frame(events=True, interpolated=True) for run in runs]
    stick_phases = [] if has_several_runs else _stick_phases(frames[0])
    # The legend of several runs, above the panels, is higher than the title of one.
    margin = 0.6 if has_several_runs else 0.4
    with rc():
        picture = Picture(margin + PANEL_HEIGHT * len(panels), width)
        axes = picture.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for ax, panel in zip(axes, panels):
            if has_several_runs:
                column = panel.columns[0]
                lines = [_Line(frame, column, _label_of(run)) for run, frame in zip(runs, frames)]
            else:
                lines = [
                    _Line(frames[0], name, _words_of(name, first))
                    for name in panel.columns[:MAX_LINES]
                ]
            _draw_panel(ax, panel, lines, stick_phases)
            if not columns:
                count = len(panel.columns)
                title = f"{MAX_LINES} of {count}" if count > MAX_LINES else None
                ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), title=title)
        axes[-1].set_xlabel("$t$ [s], shaded: stick" if stick_phases else "$t$ [s]")
        if has_several_runs:
            axes[0].legend(
                loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2 if width >= WIDTH else 1
            )
        elif not columns:
            title = f"{first.scene}: {first.engine} {first.version}, {first.fidelity}"
            axes[0].set_title(title, fontsize=8, parse_math=False)
        fit_labels(picture)
    return picture


def _draw_panel(
    ax: Axes, panel: _Panel, lines: Sequence[_Line], stick_phases: Sequence[tuple[float, float]]
) -> None:
    """Draw the lines of a panel, and shade stick phases, given by their begin and end, s."""
    for number, line in enumerate(lines):
        color = CYCLE[number % len(CYCLE)]
        if len(panel.columns) == 1 and len(lines) > 1:
            # Black, the first colour, is that of the last line.
            color = CYCLE[(number + 1) % len(lines) % len(CYCLE)]
        ax.plot(
            line.frame["t"].to_numpy(),
            line.frame[line.column].to_numpy(),
            color=color,
            linewidth=1.0,
            label=line.label,
            linestyle=_DASHES[number % len(_DASHES)],
        )
    for begin, end in stick_phases:
        ax.axvspan(begin, end, color=COLORS["shade"], linewidth=0, zorder=0)
    ax.set_ylabel(panel.label)
    ax.margins(x=0)


def _axis_label(column: str, run: Trajectory) -> str:
    """Return words, symbol and unit of a column if the scene is known, else its name and unit."""
    if run.mechanism is None:
        return f"{column} [{unit_of(column)}]"
    return label_of(column, run.mechanism)


def _words_of(column: str, run: Trajectory) -> str:
    """Return words, symbol and owner of a column if the scene is known, else its name; for legends."""
    return column if run.mechanism is None else words_of(column, run.mechanism)


def _label_of(run: Trajectory) -> str:
    """Return engine, fidelity, and the step or tolerance of a run, for legends."""
    texts = [run.engine, str(run.fidelity)]
    for key, unit in (("dt", " s"), ("rtol", "")):
        value = run.settings.get(key)
        if isinstance(value, float):
            texts.append(f"{key} = {value:g}{unit}")
    return ", ".join(texts)


def _usual_panels(trajectory: Trajectory) -> list[_Panel]:
    """Return the panels of a run if no columns are selected."""
    has_guides = any(name.endswith(".displacement") for name in trajectory.columns)
    efforts = [name for name in trajectory.columns if name.endswith(".effort")]
    effort_units = dict.fromkeys(unit_of(name, trajectory.mechanism) for name in efforts)
    labels = _PANELS if has_guides else _WITHOUT_GUIDES
    # Pins with friction have columns of the same names as guides, but in N m and rad/s.
    pins = () if trajectory.mechanism is None else trajectory.mechanism.pins
    columns_of_pins = {f"{pin}.{name}" for pin in pins for name in ("friction", "slip_velocity")}
    panels = []
    for pattern, label in labels.items():
        names = [
            name
            for name in trajectory.columns
            if re.search(rf"{pattern}$", name) and name not in columns_of_pins
        ]
        if label == EFFORT:
            label = f"{label} [{', '.join(effort_units)}]"
        if names:
            panels.append(_Panel(names, label))
    return panels


def _stick_phases(frame: pd.DataFrame) -> list[tuple[float, float]]:
    """Return begin and end of each stick phase, s, if exactly one guide has modes.

    With several guides it would not be clear which of them the shading refers to.
    """
    modes = [name for name in frame if name.endswith(".mode")]
    if len(modes) != 1:
        return []
    t = frame["t"].to_numpy()
    sticks = frame[modes[0]].to_numpy() == 0
    # The condition becomes true and false in turns.
    edges = np.flatnonzero(np.diff(np.concatenate([[False], sticks, [False]]).astype(int)))
    phases = [(float(t[begin]), float(t[end - 1])) for begin, end in edges.reshape(-1, 2)]
    return [(begin, end) for begin, end in phases if end > begin]
