"""The paper's Figs. 5-13: slider, corner forces and driving moment of each case, of the reference alone, its jumps vertical.

The engines' differences have figures of their own, `stiction.reports.figures.differences`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from stiction.comparisons.results import Results
from stiction.comparisons.truth import Truth
from stiction.comparisons.variants import Record
from stiction.comparisons.methods import case_of, run_label
from stiction.reports.figures.style import SHADE, TIME, Drawing, legend, letter, narrow, panels
from stiction.reports.run_folder.data import truth_frame

LINE = {"color": "#000000", "linewidth": 0.9, "zorder": 3}

Interval = tuple[float, float]


@dataclass(frozen=True)
class Quantity:
    """A row of panels: column, label with unit, and the same in words."""

    column: str
    label: str
    words: str


@dataclass(frozen=True)
class Curves:
    """What is drawn: a run, or the truth."""

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


def motion_figures(validation: Results) -> Iterator[Drawing]:
    """A drawing per scene and set of `SETS`, where there is anything to draw."""
    for scene in dict.fromkeys(record.scene for record in validation.records):
        truth = validation.truths.get(scene)
        curves = _reference([record for record in validation.records if record.scene == scene], truth)
        for place, (name, what, quantities) in enumerate(SETS if curves else ()):
            known = [quantity for quantity in quantities if quantity.column in curves.frame]
            if not known:
                continue
            name, caption = f"{scene}-{name}", f"{case_of(scene)}: {what}"
            if scene in CASES:
                number = FIRST_FIGURE + len(SETS) * CASES.index(scene) + place
                name, caption = f"fig{number:02d}-{name}", f"{caption} (the paper's Fig. {number})"
            yield Drawing(name, "paper", f"{caption[:1].upper()}{caption[1:]}.", _figure(known, curves, stick_phases(truth)))


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


def _reference(records: list[Record], truth: Truth | None) -> Curves | None:
    """The event-driven reference at its tightest, else the truth."""
    runs = [record for record in records if record.trajectory is not None
            and record.trajectory.settings.get("method") == "event" and record.trajectory.termination == "end"]
    if runs:
        best = min(runs, key=lambda record: record.step)
        return Curves(run_label(best), best.trajectory.to_frame(events=True))
    return None if truth is None else Curves("independent solution", truth_frame(truth))


def _figure(quantities: list[Quantity], curves: Curves, stick: list[Interval]) -> Figure:
    columns = 2 if len(quantities) > 2 and not narrow() else 1
    rows = -(-len(quantities) // columns)
    figure, axes = panels(rows, columns, 0.6 + 1.35 * rows, sharex="col")
    for ax, quantity in zip(axes.flat, quantities):
        ax.plot(curves.frame["t"].to_numpy(), curves.frame[quantity.column].to_numpy(), **LINE)
        for start, end in stick:
            ax.axvspan(start, end, color=SHADE, linewidth=0, zorder=0)
        ax.set(xlim=(0.0, curves.frame["t"].iloc[-1]), ylabel=quantity.label)
    for ax in axes[-1]:
        ax.set_xlabel(TIME)
    letter(axes.flat)
    legend(figure, {curves.label: Line2D([], [], **LINE), **({"slider at rest (independent solution)": Patch(color=SHADE, linewidth=0)} if stick else {})}, columns=2)
    return figure
