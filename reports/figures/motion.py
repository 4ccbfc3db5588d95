"""The paper's Figs. 5-13: slider, corner forces and driving moment of each case, engines over the reference.

The reference is the black line, its jumps vertical; an engine is a thin line below it, seen where it departs, and markers
above it, those of different engines taking turns. Left all of the time, right a close-up of one event.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from comparisons.truth import Truth
from comparisons.validation import CASES, Validation
from comparisons.variants import Record
from reports.figures.selection import one_per_variant
from reports.figures.style import SHADE, TIME, Drawing, Look, looks, legend, letter, panels
from reports.tables import setting_of

BASE = {"color": "#000000", "linewidth": 0.9, "zorder": 3}
ENGINE = {"linewidth": 0.6, "zorder": 2}
_MARKERS, _CLOSE_MARKERS = 8, 5  # per engine, left and right
_MARGIN = 0.12  # of the reference's range, above and below
_BEFORE, _AFTER = 0.35, 0.35  # of the close-up: share of the stick phase shown on either side of it
_LONE_JUMP = 0.01  # of the run: half-width of the close-up of a jump, if nothing sticks


@dataclass(frozen=True)
class Quantity:
    """A panel: column, label with unit."""

    column: str
    label: str


SETS = (
    ("velocity-acceleration", "velocity and acceleration of the slider",
     (Quantity("slider.vx", r"$\dot x_2$ [m/s]"), Quantity("slider.ax", r"$\ddot x_2$ [m/s$^2$]"))),
    ("corner-forces", "normal forces on the corners of the slider",
     tuple(Quantity(f"guide.F{i}", f"$F_{i}$ [N]") for i in (1, 2, 3, 4))),
    ("driving-moment", "driving moment", (Quantity("motor.effort", r"$\lambda_D$ [N m]"),)),
)
FIRST_FIGURE = 5
"""The paper's number of the first figure of the first case; then in the order of `SETS`, case by case."""


def motion_figures(validation: Validation) -> Iterator[Drawing]:
    """A drawing per scene and set of `SETS`, where there is anything to draw."""
    styles = looks(validation.records)
    for scene in dict.fromkeys(record.scene for record in validation.records):
        base = _base(validation, scene)
        overlays = _overlays([record for record in validation.records if record.scene == scene])
        stick = _stick_phases(validation.truths.get(scene))
        close = _close_up(validation.truths.get(scene), stick)
        for place, (name, what, quantities) in enumerate(SETS):
            number = FIRST_FIGURE + len(SETS) * CASES.index(scene) + place if scene in CASES else None
            figure = _figure(quantities, base, overlays, stick, close, styles)
            if figure is not None:
                yield Drawing(f"fig{number:02d}-{scene}-{name}" if number else f"{scene}-{name}", "paper",
                              f"{scene}: {what}" + (f" (the paper's Fig. {number})" if number else "")
                              + (f". Right: close-up of {'a stick phase' if stick else 'a reversal'}" if close else "") + ".", figure)


def _base(validation: Validation, scene: str) -> tuple[str, pd.DataFrame] | None:
    """What the engines are drawn over: the event-driven reference at its tightest, else the truth."""
    runs = [record for record in validation.records if record.scene == scene and record.trajectory is not None
            and record.trajectory.settings.get("method") == "event" and record.trajectory.termination == "end"]
    if runs:
        best = min(runs, key=lambda record: record.step)
        return f"{best.variant.label} ({setting_of(best.variant.parameter, best.step)})", best.trajectory.to_frame(events=True)
    truth = validation.truths.get(scene)
    if truth is None:
        return None
    sides = [pd.DataFrame({"t": event.time, **side}, index=[0]) for event in truth.events for side in (event.before, event.after)]
    t = np.linspace(0.0, truth.t_end, 2401)
    frame = pd.concat([pd.DataFrame({"t": t, **truth(t)}), *sides])
    return "independent solution", frame.sort_values("t", kind="stable", ignore_index=True)


def _overlays(records: list[Record]) -> list[Record]:
    """The external engines; contact fidelity first, so that it lies below."""
    return sorted((record for record in one_per_variant(records) if record.variant.engine != "reference"),
                  key=lambda record: record.variant.fidelity != "contact")


def _stick_phases(truth: Truth | None) -> list[tuple[float, float]]:
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


def _close_up(truth: Truth | None, stick: list[tuple[float, float]]) -> tuple[float, float] | None:
    """The last complete stick phase, else the last jump, away from the end of the run."""
    if truth is None:
        return None
    inner = [(start, end) for start, end in stick if 0.0 < start and end < truth.t_end]
    if inner:
        start, end = inner[-1]
        return start - _BEFORE * (end - start), end + _AFTER * (end - start)
    half = _LONE_JUMP * truth.t_end
    jumps = [event.time for event in truth.events if event.kind == "reversal" and half < event.time < truth.t_end - half]
    return (jumps[-1] - half, jumps[-1] + half) if jumps else None


def _figure(quantities: tuple[Quantity, ...], base: tuple[str, pd.DataFrame] | None, overlays: list[Record],
            stick: list[tuple[float, float]], close: tuple[float, float] | None, styles: dict[str, Look]) -> Figure | None:
    frames = {record.key: record.trajectory.to_frame() for record in overlays}
    known = [q for q in quantities if (base is not None and q.column in base[1]) or any(q.column in f for f in frames.values())]
    if not known:
        return None
    figure, axes = panels(len(known), 2 if close else 1, 0.75 + 1.25 * len(known), sharex="col",
                          **({"width_ratios": (2.1, 1)} if close else {}))
    handles: dict[str, Line2D | Patch] = {}
    if base is not None:
        handles[base[0]] = Line2D([], [], **BASE)
    for record in sorted(overlays, key=lambda record: record.variant.fidelity == "contact"):
        look = styles[record.variant.label]
        handles[f"{record.variant.label} ({setting_of(record.variant.parameter, record.step)})"] = Line2D(
            [], [], **{**look.line(), **ENGINE}, **look.points())
    for i, quantity in enumerate(known):
        for j, window in enumerate((None, close)[:axes.shape[1]]):
            ax = axes[i, j]
            if base is not None and quantity.column in base[1]:
                _line(ax, base[1], quantity.column, window, BASE)
                _limit(ax, base[1], quantity.column, window)
            for place, record in enumerate(overlays):
                if quantity.column in frames[record.key]:
                    look = styles[record.variant.label]
                    _line(ax, frames[record.key], quantity.column, window, {**look.line(), **ENGINE})
                    _markers(ax, frames[record.key], quantity.column, window, (place + 0.5) / len(overlays), look)
            for start, end in stick:
                ax.axvspan(start, end, color=SHADE, linewidth=0, zorder=0)
            ax.set_xlim(window or _span(base, frames))
            ax.set_ylabel(quantity.label if j == 0 else "")
    for ax in axes[-1]:
        ax.set_xlabel(TIME)
    if stick:
        handles["stick (independent solution)"] = Patch(color=SHADE, linewidth=0)
    letter(axes.flat)
    legend(figure, handles, columns=3)
    return figure


def _span(base: tuple[str, pd.DataFrame] | None, frames: dict[str, pd.DataFrame]) -> tuple[float, float]:
    ends = [float(frame["t"].iloc[-1]) for frame in ([base[1]] if base is not None else frames.values())]
    return 0.0, max(ends)


def _line(ax: Axes, frame: pd.DataFrame, column: str, window: tuple[float, float] | None, style: dict) -> None:
    t, values = frame["t"].to_numpy(), frame[column].to_numpy()
    if window is not None:
        # one sample more on either side: the line reaches the frame
        first, last = np.searchsorted(t, window)
        t, values = t[max(first - 1, 0):last + 1], values[max(first - 1, 0):last + 1]
    ax.plot(t, values, **style)


def _markers(ax: Axes, frame: pd.DataFrame, column: str, window: tuple[float, float] | None, turn: float, look: Look) -> None:
    """Few samples as markers; `turn`, from 0 to 1, shifts them within their distance."""
    t = frame["t"].to_numpy()
    start, end = window or (t[0], t[-1])
    count = _MARKERS if window is None else _CLOSE_MARKERS
    wanted = start + (np.arange(count) + turn) * (end - start) / count
    at = np.unique(np.minimum(np.searchsorted(t, wanted), len(t) - 1))
    ax.plot(t[at], frame[column].to_numpy()[at], linestyle="none", zorder=4, **look.points())


def _limit(ax: Axes, frame: pd.DataFrame, column: str, window: tuple[float, float] | None) -> None:
    """Limits by the reference: spikes of an engine leave the panel, they do not flatten it."""
    inside = frame if window is None else frame[frame["t"].between(*window)]
    low, high = float(inside[column].min()), float(inside[column].max())
    room = _MARGIN * (high - low) or 1.0
    ax.set_ylim(low - room, high + room)
