"""The figures of a report: the paper's Figs. 5-14 with the engines over them, and what the comparisons add."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from comparisons.validation import Validation
from reports.figures.convergence import accuracy_figures, orders_figure, threshold_figure, torque_figures
from reports.figures.drift import drift_figures
from reports.figures.motion import motion_figures
from reports.figures.style import Drawing, save_all
from reports.figures.work_precision import work_precision_figure

__all__ = ["Drawing", "drawings", "figures_of_runs", "figures_of_times", "save_all"]


def drawings(validation: Validation) -> Iterator[Drawing]:
    """All figures for which there are data, one after the other; draw under `style.rc()`."""
    yield from figures_of_runs(validation)
    yield from figures_of_times(validation)


def figures_of_runs(validation: Validation) -> Iterator[Drawing]:
    """Those that show no times."""
    yield from motion_figures(validation)
    yield from drift_figures(validation)
    yield from accuracy_figures(validation)
    yield from filter(None, [orders_figure(validation.tables.get("orders", pd.DataFrame()))])
    yield from filter(None, [threshold_figure(validation)])
    yield from torque_figures(validation)


def figures_of_times(validation: Validation) -> Iterator[Drawing]:
    """The rest."""
    yield from filter(None, [work_precision_figure(validation.tables.get("cost", pd.DataFrame()), validation.records)])
