"""The paper's Fig. 14: residuals of the constraints over time, without and with stabilization, and those of the engines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from comparisons.validation import Validation
from comparisons.variants import Record
from reports.figures.selection import one_per_variant
from reports.figures.style import TIME, Drawing, Look, all_looks, legend, letter, panels
from reports.tables import setting_of

ROWS = (("drift.position", r"$\|\Phi\|$ [m]"), ("drift.velocity", r"$\|\dot\Phi\|$ [m/s]"))
FLOOR = 1e-17
"""Smaller residuals, zero among them, are drawn here: below the rounding of coordinates of the order of 1 m."""


def drift_figures(validation: Validation) -> Iterator[Drawing]:
    """One drawing for the reference in all its stabilizations (the paper's Fig. 14), one for the engines."""
    styles = all_looks(validation.records)
    for name, own, caption in (
            ("fig14-drift", True, "Constraint drift without and with Baumgarte stabilization (the paper's Fig. 14), and with projection"),
            ("drift-engines", False, "Constraint drift of the engines, residuals of the same constraint equations")):
        records = [record for record in validation.records if (record.variant.engine == "reference") == own]
        shown = [record for record in records if record.trajectory is not None]
        if shown:
            yield Drawing(name, f"{caption}; values below {FLOOR:g} are drawn there.", _figure(shown, styles))


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
                    ax.plot(record.trajectory.t, np.maximum(record.trajectory[column], FLOOR), **style)
                ax.set_ylabel(label if j == 0 else "")
            handles.setdefault(f"{record.variant.label} ({setting_of(record.variant.parameter, record.step)})", Line2D([], [], **style))
        axes[0, j].set_title(scene)
        axes[-1, j].set_xlabel(TIME)
        axes[-1, j].set_xlim(left=0.0)
    for ax in axes[:, 0]:
        ax.set_yscale("log")
        ax.yaxis.set_major_locator(LogLocator(numticks=8))
    letter(axes.flat)
    legend(figure, handles, columns=3)
    return figure
