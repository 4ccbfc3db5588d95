"""The figures of a report: the paper's Figs. 5-14 as the paper shows them, the engines' differences, and what the comparisons add."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from stiction.comparisons.results import Results
from stiction.reports.figures.differences import difference_figures
from stiction.reports.figures.drift import drift_figures
from stiction.reports.figures.ladders import accuracy_figures, torque_figures
from stiction.reports.figures.mechanism import mechanism_figures
from stiction.reports.figures.engine_settings import settings_figure
from stiction.reports.figures.motion import motion_figures
from stiction.reports.figures.orders import orders_figure
from stiction.reports.figures.style import Drawing, save_all
from stiction.reports.figures.threshold import threshold_figure
from stiction.reports.figures.work_precision import work_precision_figures

__all__ = ["Drawing", "drawings", "save_all"]


def drawings(validation: Results) -> Iterator[Drawing]:
    """All figures for which there are data, one after the other; draw under `style.rc()`."""
    tables = {name: validation.tables.get(name, pd.DataFrame()) for name in ("orders", "cost", "settings")}
    yield from mechanism_figures(validation)
    yield from motion_figures(validation)
    yield from drift_figures(validation)
    yield from difference_figures(validation)
    yield from accuracy_figures(validation)
    yield from filter(None, [orders_figure(tables["orders"]), threshold_figure(validation)])
    yield from torque_figures(validation)
    yield from work_precision_figures(tables["cost"], validation.records)
    yield from filter(None, [settings_figure(tables["settings"])])
