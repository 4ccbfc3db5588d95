"""The paper's Fig. 14: residuals of the constraints over time, with and without stabilization; those of the engines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from comparisons.validation import Validation
from comparisons.variants import Record
from reports.figures.selection import one_per_variant, run_label
from reports.figures.style import TIME, Drawing, Look, figures_of, legend, letter, looks, panels

ROWS = (("drift.position", r"$\|\Phi\|$ [m]"), ("drift.velocity", r"$\|\dot\Phi\|$ [m/s]"))
PIECES = 200
"""Of the time: residuals at rounding level are noise, of which the largest in each piece is drawn."""
FLOOR = 1e-17
"""Smaller residuals, zero among them, are drawn here: below the rounding of coordinates of the order of 1 m."""


def drift_figures(validation: Validation) -> Iterator[Drawing]:
    """One drawing for the reference in all its stabilizations (the paper's Fig. 14), one for the engines."""
    styles = looks(validation.records)
    how = f"; largest residual in each of {PIECES} pieces of the time, at {FLOOR:g} where it is smaller."
    for name, own, caption in (
            ("fig14-drift", True, "Constraint drift with and without stabilization (the paper's Fig. 14)"),
            ("drift-engines", False, "Constraint drift of the engines, residuals of the same constraint equations")):
        records = [record for record in validation.records
                   if record.trajectory is not None and (record.variant.engine == "reference") == own]
        for ending, scenes in figures_of(list(dict.fromkeys(record.scene for record in records))) if records else ():
            there = [record for record in records if record.scene in scenes]
            yield Drawing(name + ending, "drift", (f"{scenes[0]}: {caption}" if ending else caption) + how, _figure(there, styles))


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
