"""The paper's Figs. 5-13: slider, corner forces and driving moment of each case, engines over the reference.

The reference is the black line, its jumps vertical; an engine is a thin line below it, seen where it departs, and
markers above it, those of different engines taking turns. Left all of the time, right a close-up of one event.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from stiction.comparisons.campaigns.validation import Validation
from stiction.comparisons.truth import Truth
from stiction.comparisons.variants import Record
from stiction.reports.figures.selection import one_per_variant, run_label
from stiction.reports.figures.style import SHADE, TIME, Drawing, Look, figures_of, legend, letter, looks, panels
from stiction.reports.run_folder.data import truth_frame

BASE = {"color": "#000000", "linewidth": 0.9, "zorder": 3}
ENGINE = {"linewidth": 0.6, "zorder": 2}
_MARKERS, _CLOSE_MARKERS = 8, 5  # per engine, left and right
_MARGIN = 0.12  # of the range of the base, above and below it
_BESIDE_STICK = 0.35  # of a stick phase: shown on either side of it in the close-up
_BESIDE_JUMP = 0.01  # of the run: shown on either side of a jump, if nothing sticks

Interval = tuple[float, float]


@dataclass(frozen=True)
class Quantity:
    """A row of panels: column, label with unit, and the same in words."""

    column: str
    label: str
    words: str


@dataclass(frozen=True)
class Curves:
    """What a run, or the truth, has to draw."""

    label: str
    frame: pd.DataFrame


SETS = (
    ("velocity-acceleration", "velocity and acceleration of the slider",
     (Quantity("slider.vx", r"$\dot x_2$ [m/s]", "velocity [m/s]"), Quantity("slider.ax", r"$\ddot x_2$ [m/s$^2$]", "acceleration [m/s²]"))),
    ("corner-forces", "normal forces on the corners of the slider",
     tuple(Quantity(f"guide.F{i}", f"$F_{i}$ [N]", f"corner force F{i} [N]") for i in (1, 2, 3, 4))),
    ("driving-moment", "driving moment", (Quantity("motor.effort", r"$\lambda_D$ [N m]", "driving moment [N m]"),)),
)
CASES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3")
"""In the order of the paper's figures."""
FIRST_FIGURE = 5
"""The paper's number of the first figure of its first case; then in the order of `SETS`, case by case."""


def motion_figures(validation: Validation) -> Iterator[Drawing]:
    """A drawing per scene and set of `SETS`, where there is anything to draw."""
    styles = looks(validation.records)
    for scene in dict.fromkeys(record.scene for record in validation.records):
        records = [record for record in validation.records if record.scene == scene]
        truth = validation.truths.get(scene)
        base = _base(records, truth)
        engines = {record.variant.label: Curves(run_label(record), record.trajectory.to_frame())
                   for record in one_per_variant(records) if record.variant.engine != "reference"}
        stick = stick_phases(truth)
        close = close_up(truth)
        sticks = close and any(close[0] < start and end < close[1] for start, end in stick)
        of = f"close-up of a {'stick phase' if sticks else 'reversal'}"
        everything = [*([base] if base else []), *engines.values()]
        for place, (name, what, quantities) in enumerate(SETS):
            known = [quantity for quantity in quantities if any(quantity.column in curves.frame for curves in everything)]
            if not known:
                continue
            windows = {"whole": (0.0, max(float(curves.frame["t"].iloc[-1]) for curves in everything))}
            windows |= {"close-up": close} if close else {}
            name, caption = f"{scene}-{name}", f"{scene}: {what}"
            if scene in CASES:
                number = FIRST_FIGURE + len(SETS) * CASES.index(scene) + place
                name, caption = f"fig{number:02d}-{name}", f"{caption} (the paper's Fig. {number})"
            for ending, shown in figures_of(list(windows)):
                told = f". Right: {of}." if len(shown) == 2 else f", {of}." if "close-up" in shown else "."
                yield Drawing(name + ending, "paper", caption + told,
                              _figure(known, base, engines, stick, {window: windows[window] for window in shown}, styles))


def stick_phases(truth: Truth | None) -> list[Interval]:
    """Begin and end of each, s; one that lasts to the end ends there."""
    if truth is None:
        return []
    phases, since = [], 0.0 if truth(0.0).get("guide.mode", np.ones(1))[0] == 0 else None
    for event in truth.events:
        if event.kind == "stick":
            since = event.time
        elif event.kind == "slip" and since is not None:
            phases.append((since, event.time))
            since = None
    return phases if since is None else [*phases, (since, truth.t_end)]


def close_up(truth: Truth | None) -> Interval | None:
    """Times around the last complete stick phase, else around the last reversal that is not at the end of the run."""
    if truth is None:
        return None
    inner = [(start, end) for start, end in stick_phases(truth) if 0.0 < start and end < truth.t_end]
    if inner:
        start, end = inner[-1]
        beside = _BESIDE_STICK * (end - start)
        return start - beside, end + beside
    beside = _BESIDE_JUMP * truth.t_end
    reversals = [event.time for event in truth.events
                 if event.kind == "reversal" and beside < event.time < truth.t_end - beside]
    return (reversals[-1] - beside, reversals[-1] + beside) if reversals else None


def _base(records: list[Record], truth: Truth | None) -> Curves | None:
    """What the engines are drawn over: the event-driven reference at its tightest, else the truth."""
    runs = [record for record in records if record.trajectory is not None
            and record.trajectory.settings.get("method") == "event" and record.trajectory.termination == "end"]
    if runs:
        best = min(runs, key=lambda record: record.step)
        return Curves(run_label(best), best.trajectory.to_frame(events=True))
    if truth is None:
        return None
    return Curves("independent solution", truth_frame(truth))


def _figure(quantities: list[Quantity], base: Curves | None, engines: dict[str, Curves], stick: list[Interval],
            windows: dict[str, Interval], styles: dict[str, Look]) -> Figure:
    figure, axes = panels(len(quantities), len(windows), 0.75 + 1.25 * len(quantities), sharex="col",
                          width_ratios=(2.1, 1)[:len(windows)])
    for i, quantity in enumerate(quantities):
        for j, (name, window) in enumerate(windows.items()):
            ax = axes[i, j]
            count = _MARKERS if name == "whole" else _CLOSE_MARKERS
            for place, (variant, curves) in enumerate(engines.items()):
                if quantity.column in curves.frame:
                    _line(ax, curves.frame, quantity.column, window, {**styles[variant].line(), **ENGINE})
                    turn = (place + 0.5) / len(engines)
                    _markers(ax, curves.frame, quantity.column, window, count, turn, styles[variant])
            if base and quantity.column in base.frame:
                _line(ax, base.frame, quantity.column, window, BASE)
                _limit(ax, base.frame, quantity.column, window)
            for start, end in stick:
                ax.axvspan(start, end, color=SHADE, linewidth=0, zorder=0)
            ax.set_xlim(window)
        axes[i, 0].set_ylabel(quantity.label)
    for ax in axes[-1]:
        ax.set_xlabel(TIME)
    letter(axes.flat)
    legend(figure, _handles(base, engines, bool(stick), styles), columns=3)
    return figure


def _handles(base: Curves | None, engines: dict[str, Curves], stick: bool, styles: dict[str, Look],
             ) -> dict[str, Artist]:
    handles: dict[str, Artist] = {base.label: Line2D([], [], **BASE)} if base else {}
    for variant in sorted(engines, key=lambda variant: styles[variant].hollow):
        look = styles[variant]
        handles[engines[variant].label] = Line2D([], [], **{**look.line(), **ENGINE}, **look.points())
    return {**handles, "stick (independent solution)": Patch(color=SHADE, linewidth=0)} if stick else handles


def _line(ax: Axes, frame: pd.DataFrame, column: str, window: Interval, style: dict) -> None:
    # one sample more on either side: the line reaches the frame
    first, last = np.searchsorted(frame["t"], window, side="left")
    part = frame.iloc[max(first - 1, 0):last + 1]
    ax.plot(part["t"].to_numpy(), part[column].to_numpy(), **style)


def _markers(ax: Axes, frame: pd.DataFrame, column: str, window: Interval, count: int, turn: float, look: Look) -> None:
    """`count` samples as markers; `turn`, from 0 to 1, shifts them within their distance."""
    start, end = window
    wanted = start + (np.arange(count) + turn) * (end - start) / count
    at = np.searchsorted(frame["t"], wanted)
    part = frame.iloc[np.unique(at[at < len(frame)])]
    ax.plot(part["t"].to_numpy(), part[column].to_numpy(), linestyle="none", zorder=4, **look.points())


def _limit(ax: Axes, frame: pd.DataFrame, column: str, window: Interval) -> None:
    """Limits by the base: spikes of an engine leave the panel, they do not flatten it."""
    values = frame.loc[frame["t"].between(*window), column]
    low, high = float(values.min()), float(values.max())
    room = _MARGIN * (high - low) or 1.0
    ax.set_ylim(low - room, high + room)
