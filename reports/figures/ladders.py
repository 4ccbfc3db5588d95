"""Errors over the step: motion and torque jumps of each case, a row of panels per group of variants that may be compared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stiction.comparisons.results import Results
from stiction.comparisons.methods import case_of, groups, title_of
from stiction.reports.figures.style import TRUTH_COLOR, Drawing, Look, figures_of, legend, letter, looks, panels, tick_at
from stiction.comparisons.presentation.cells import uncertainty_of, worst_per_run

DODGE = 1.12
"""Factor between the steps at which neighbours are drawn: variants with equal errors stand side by side."""
SEEN = 0.05
"""Part of an error from which on its uncertainty is drawn: below it the bar is not longer than the symbol."""


@dataclass(frozen=True)
class Ladder:
    """A figure: topic and name of its files, column of the errors, label of the axis, caption."""

    topic: str
    name: str
    column: str
    label: str
    caption: str


ACCURACY = (Ladder("accuracy", "accuracy", "position error [m]", "position error [m]", "Largest error of position"),)
TORQUE = (Ladder("torque", "torque", "largest jump error [N m]", "jump error [N m]",
                 "Largest error of the size of the driving torque's jumps, of those jumps that a run resolves"),)


def accuracy_figures(validation: Results) -> Iterator[Drawing]:
    """Error of position over step."""
    yield from _drawings(ACCURACY, validation.tables.get("accuracy", pd.DataFrame()), validation)


def torque_figures(validation: Results) -> Iterator[Drawing]:
    """Error of the driving torque's jumps over step."""
    table = validation.tables.get("torque", pd.DataFrame())
    truths = validation.tables.get("accuracy", pd.DataFrame())
    if len(table):
        table = worst_per_run(table).join(truths.set_index("key")["truth"], on="key")
    yield from _drawings(TORQUE, table, validation)


def _drawings(ladders: tuple[Ladder, ...], table: pd.DataFrame, validation: Results) -> Iterator[Drawing]:
    styles = looks(validation.records)
    for ladder in ladders:
        there = table[(table[ladder.column] > 0) & (table["parameter"] == "dt")] if ladder.column in table else pd.DataFrame()
        for ending, scenes in figures_of(list(dict.fromkeys(there["scene"]))) if len(there) else ():
            caption = (f"{ladder.caption} over the step{', ' + case_of(scenes[0]) if ending else ''}. Each row holds variants that may be compared. Those of one step are "
                       "drawn side by side. Bars: what an error is unsure by, to the lower edge where that is all of it. Dotted: first order. Runs by tolerance have no step; they are "
                       "in the table")
            yield Drawing(ladder.name + ending, ladder.topic, caption + ".", _figure(ladder, there[there["scene"].isin(scenes)], scenes, styles))


def _figure(ladder: Ladder, table: pd.DataFrame, scenes: list[str], styles: dict[str, Look]) -> Figure:
    parts, lowest = list(groups(table)), table[ladder.column].min() / 2
    figure, axes = panels(len(parts), len(scenes), 0.9 + 1.6 * len(parts), sharex=True, sharey=True)
    for row, (name, rows) in zip(axes, parts):
        variants = list(dict.fromkeys(rows["variant"]))
        for ax, scene in zip(row, scenes):
            here = rows[rows["scene"] == scene]
            for number, variant in enumerate(variants):
                part = here[here["variant"] == variant].sort_values("step")
                aside = DODGE ** (number - (len(variants) - 1) / 2)
                ax.errorbar(part["step"] * aside, part[ladder.column], _bars(part, ladder.column, lowest), elinewidth=0.7, capsize=1.5, **styles[variant].line(), **styles[variant].points())
            _first_order(ax, here["step"].to_numpy(float), here[ladder.column].to_numpy(float))
            ax.set(xscale="log", yscale="log", title=f"{title_of(scene)}; {name}")
            tick_at(ax.xaxis, table["step"])
        row[0].set_ylabel(ladder.label)
    for ax in axes[-1]:
        ax.set_xlabel("step [s]")
    letter(axes.flat)
    legend(figure, {variant: Line2D([], [], **styles[variant].line(), **styles[variant].points()) for variant in styles
                    if variant in set(table["variant"])}, columns=4)
    return figure


def _bars(rows: pd.DataFrame, column: str, lowest: float) -> np.ndarray:
    """Down and up from each error by its uncertainty, down to `lowest` at most; none where that is not to be seen. Shape (2, rows)."""
    errors = rows[column].to_numpy(float)
    unsure = rows[uncertainty_of(column)].to_numpy(float) if uncertainty_of(column) in rows else np.full(len(rows), np.nan)
    unsure = np.where(unsure > SEEN * errors, unsure, np.nan)
    return np.array([np.minimum(unsure, errors - lowest), unsure])


def _first_order(ax: Axes, steps: np.ndarray, errors: np.ndarray) -> None:
    """A dotted line of slope one above the points."""
    if len(steps):
        ends = np.array([steps.min(), steps.max()])
        ax.plot(ends, 2 * np.max(errors / steps) * ends, color=TRUTH_COLOR, linewidth=0.9, linestyle=":", zorder=1)
