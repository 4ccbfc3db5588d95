"""The paper's Fig. 14, over a longer time: residuals of the constraints with and without stabilization; those of the engines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from comparisons.drift_study import CHOICES, NONE, PAPERS, STEPS
from comparisons.validation import Validation
from comparisons.variants import Record
from reports.figures.selection import one_per_variant, run_label
from reports.figures.style import TIME, TRUTH_COLOR, Drawing, Look, beside, figures_of, legend, letter, looks, panels

ROWS = (("drift.position", r"$\|\Phi\|$ [m]"), ("drift.velocity", r"$\|\dot\Phi\|$ [m/s]"))
PIECES = 200
"""Of the time: residuals at rounding level are noise, of which the largest in each piece is drawn."""
CHOICE_LOOKS = (Look("#000000", "-", "o"), Look("#D55E00", "--", "s"), Look("#0072B2", "-.", "D"), Look("#009E73", ":", "^"), Look("#CC79A7", (0, (5, 1)), "v"),
                Look("#E69F00", (0, (3, 1, 1, 1)), "P"))
"""Of `comparisons.drift_study.CHOICES`, told apart in grey by dashes and markers."""
FLOOR = 1e-17
"""Smaller residuals, zero among them, are drawn here: below the rounding of coordinates of the order of 1 m."""


def drift_figures(validation: Validation) -> Iterator[Drawing]:
    """The study of the paper's scheme (the paper's Fig. 14), and the engines' residuals."""
    yield from filter(None, [study_figure(validation.tables.get("study", pd.DataFrame()), validation.tables.get("octaves", pd.DataFrame()))])
    styles = looks(validation.records)
    how = f"; largest residual in each of {PIECES} pieces of the time, at {FLOOR:g} where it is smaller."
    caption = "Constraint drift of the engines, residuals of the same constraint equations"
    records = [record for record in validation.records if record.trajectory is not None and record.variant.engine != "reference"]
    for ending, scenes in figures_of(list(dict.fromkeys(record.scene for record in records))) if records else ():
        there = [record for record in records if record.scene in scenes]
        yield Drawing("drift-engines" + ending, "drift", (f"{scenes[0]}: {caption}" if ending else caption) + how, _figure(there, styles))


def study_figure(study: pd.DataFrame, octaves: pd.DataFrame) -> Drawing | None:
    """(a) Drift over time without and with the paper's stabilization and with projection, at the smallest and the largest step of the study;
    (b) drift within 24 s over the step, all choices, and where the paper's becomes unstable; of the first scene."""
    if study.empty or octaves.empty:
        return None
    scene = study["scene"].iloc[0]
    study, octaves = study[study["scene"] == scene], octaves[octaves["scene"] == scene]
    looks_of = {choice.label: CHOICE_LOOKS[number] for number, choice in enumerate(CHOICES)}
    steps = [step for step in STEPS if step in set(octaves["step"])]
    figure, (left, right) = beside(2, 3.4)
    handles: dict[str, Line2D] = {}
    for label in (NONE.label, PAPERS.label, CHOICES[-1].label):
        for step, filled in ((steps[0], False), (steps[-1], True)) if steps else ():
            part = octaves[(octaves["choice"] == label) & (octaves["step"] == step)]
            look = replace(looks_of[label], hollow=not filled)
            left.plot(part["to [s]"], part["position drift, rms [m]"], **look.line(), **look.points())
    if steps:
        left.set_title(f"hollow: {1e3 * steps[0]:g} ms, full: {1e3 * steps[-1]:g} ms")
    for label, look in looks_of.items():
        part = study[(study["choice"] == label) & (study["reason"] == "")].sort_values("step")
        right.plot(part["step"], part["position drift to 24 s, max [m]"], **look.line(), **look.points())
        handles[label] = Line2D([], [], **look.line(), **look.points())
    right.axvline(PAPERS.largest_step(), color=TRUTH_COLOR, linewidth=0.9, linestyle=":", zorder=1)
    left.set(xscale="log", yscale="log", xlabel="time [s]", ylabel=r"$\|\Phi\|$, root mean square of an octave [m]")
    right.set(xscale="log", yscale="log", xlabel="step [s]", ylabel=r"largest $\|\Phi\|$ in 24 s [m]")
    letter((left, right))
    legend(figure, handles, columns=3)
    caption = (f"Constraint drift of the paper's scheme (the paper's Fig. 14), {scene}: (a) over time, (b) over the step. In brackets alpha and beta, 1/s. Dotted: "
               f"the step of {1e3 * PAPERS.largest_step():.3g} ms beyond which the Runge-Kutta method amplifies residuals with the paper's choice.")
    return Drawing("fig14-drift", "study", caption, figure)


def _figure(records: list[Record], styles: dict[str, Look]) -> Figure:
    scenes = list(dict.fromkeys(record.scene for record in records))
    figure, axes = panels(len(ROWS), len(scenes), 4.3, sharex="col", sharey="row")
    handles: dict[str, Line2D] = {}
    for j, scene in enumerate(scenes):
        chosen = one_per_variant(record for record in records if record.scene == scene)
        for record in chosen:
            style = styles[record.variant.label].line()
            handles.setdefault(run_label(record), Line2D([], [], **style))
            for ax, (column, _) in zip(axes[:, j], ROWS):
                if column in record.trajectory:
                    ax.plot(*_envelope(record.trajectory.t, record.trajectory[column]), **style)
        axes[0, j].set_title(scene)
        axes[-1, j].set_xlabel(TIME)
        axes[-1, j].set_xlim(0.0, max(record.trajectory.t[-1] for record in chosen))
    for ax, (_, label) in zip(axes[:, 0], ROWS):
        ax.set(yscale="log", ylabel=label)
        ax.yaxis.set_major_locator(LogLocator(numticks=8))
    letter(axes.flat)
    legend(figure, handles, columns=2 if len(handles) <= 4 else 3)
    return figure


def _envelope(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest value in each of `PIECES` pieces of the time, and when."""
    table = pd.DataFrame({"t": t, "value": np.maximum(values, FLOOR)}).dropna()
    piece = pd.cut(table["t"], PIECES, labels=False) if np.ptp(t) > 0 else np.zeros(len(table))
    largest = table.loc[table.groupby(piece)["value"].idxmax()]
    return largest["t"].to_numpy(), largest["value"].to_numpy()
