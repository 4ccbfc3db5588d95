"""The paper's Fig. 14: residuals of the constraints over time, without and with stabilization, and those of the engines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from comparisons.validation import Validation
from comparisons.variants import Record
from reports.figures.selection import one_per_variant
from reports.figures.style import TIME, Drawing, Look, looks, legend, letter, panels
from reports.tables import setting_of

ROWS = (("drift.position", r"$\|\Phi\|$ [m]"), ("drift.velocity", r"$\|\dot\Phi\|$ [m/s]"))
SHARE = 1 / 200
"""Of the time: residuals at rounding level are noise, of which the largest in each such piece is drawn."""
FLOOR = 1e-17
"""Smaller residuals, zero among them, are drawn here: below the rounding of coordinates of the order of 1 m."""


def drift_figures(validation: Validation) -> Iterator[Drawing]:
    """One drawing for the reference in all its stabilizations (the paper's Fig. 14), one for the engines."""
    styles = looks(validation.records)
    for name, own, caption in (
            ("fig14-drift", True, "Constraint drift without and with Baumgarte stabilization (the paper's Fig. 14), and with projection"),
            ("drift-engines", False, "Constraint drift of the engines, residuals of the same constraint equations")):
        records = [record for record in validation.records if (record.variant.engine == "reference") == own]
        shown = [record for record in records if record.trajectory is not None]
        if shown:
            yield Drawing(name, "drift", f"{caption}; largest value in every {SHARE:g} of the time, drawn at {FLOOR:g} "
                          "where it is smaller.", _figure(shown, styles))


def _figure(records: list[Record], styles: dict[str, Look]) -> Figure:
    scenes = list(dict.fromkeys(record.scene for record in records))
    figure, axes = panels(len(ROWS), len(scenes), 4.3, sharex="col", sharey="row")
    handles: dict[str, Line2D] = {}
    for j, scene in enumerate(scenes):
        for record in one_per_variant(record for record in records if record.scene == scene):
            style = styles[record.variant.label].line()
            for i, (column, label) in enumerate(ROWS):
                ax = axes[i, j]
                if column in record.trajectory:
                    ax.plot(*_envelope(record.trajectory.t, record.trajectory[column]), **style)
                ax.set_ylabel(label if j == 0 else "")
            handles.setdefault(f"{record.variant.label} ({setting_of(record.variant.parameter, record.step)})", Line2D([], [], **style))
        axes[0, j].set_title(scene)
        axes[-1, j].set_xlabel(TIME)
        axes[-1, j].set_xlim(0.0, max(record.trajectory.t[-1] for record in records if record.scene == scene))
    for ax in axes[:, 0]:
        ax.set_yscale("log")
        ax.yaxis.set_major_locator(LogLocator(numticks=8))
    letter(axes.flat)
    legend(figure, handles, columns=2 if len(handles) <= 4 else 3)
    return figure


def _envelope(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest value in each `SHARE` of the time, and its time."""
    piece = np.minimum(((t - t[0]) / (t[-1] - t[0]) / SHARE).astype(int), round(1 / SHARE) - 1) if t[-1] > t[0] else np.zeros(len(t), int)
    table = pd.DataFrame({"piece": piece, "value": np.maximum(values, FLOOR)}).dropna()
    rows = table.groupby("piece")["value"].idxmax().to_numpy()
    return t[rows], table["value"].loc[rows].to_numpy()
