"""What accuracy costs: errors over step and over CPU time; the threshold on F0 over step."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from comparisons.validation import Validation
from reports.figures.style import Drawing, Look, all_looks, legend, letter, panels

STEP, COST = "step size [s]", "CPU time of the run [s]"
ERRORS = (("position error [m]", "position error [m]"), ("torque error, L1 mean [N m]", "mean torque error [N m]"))
BRACKET = ("F0 with stick [N]", "F0 without stick [N]")


def accuracy_figure(validation: Validation) -> Drawing | None:
    """Per scene: error of position over step, the same over cost, mean error of torque over cost."""
    table = validation.tables.get("accuracy", pd.DataFrame())
    errors = [(column, label) for column, label in ERRORS if column in table and table[column].notna().any()]
    if not errors:
        return None
    styles = all_looks(validation.records)
    rows = [(errors[0], "step", STEP), *((error, "cpu [s]", COST) for error in errors)]
    scenes = list(dict.fromkeys(table["scene"]))
    figure, axes = panels(len(rows), len(scenes), 0.7 + 1.75 * len(rows), sharey="row", sharex="row")
    handles: dict[str, Line2D] = {}
    for j, scene in enumerate(scenes):
        for i, ((column, label), across, across_label) in enumerate(rows):
            ax = axes[i, j]
            there = table[(table["scene"] == scene) & (table[column] > 0) & (table[across] > 0)]
            if across == "step":
                there = there[there["parameter"] == "dt"]
            for variant, part in there.sort_values("step").groupby("variant", sort=False):
                _points(ax, part[across], part[column], styles[variant])
                handles.setdefault(variant, Line2D([], [], **_style(styles[variant])))
            if across == "step" and len(there):
                _first_order(ax, there[across], there[column])
            ax.set(xscale="log", yscale="log", ylabel=label if j == 0 else "", xlabel=across_label)
        axes[0, j].set_title(scene)
    letter(axes.flat)
    legend(figure, {variant: handles[variant] for variant in styles if variant in handles}, columns=4)
    return Drawing("accuracy", "Largest error of position over step size (dotted: first order), and errors of position and driving "
                   "torque over CPU time.", figure)


def threshold_figure(validation: Validation) -> Drawing | None:
    """Left the bracket of each variant over its step with the truth as a line, right its distance from the truth."""
    table = validation.tables.get("threshold", pd.DataFrame())
    if not {*BRACKET, "truth [N]", "parameter"} <= set(table.columns):
        return None
    known = table.dropna(subset=[*BRACKET, "truth [N]"])
    if known.empty:
        return None
    low, high, truth = (known[name].astype(float) for name in (*BRACKET, "truth [N]"))
    known = known.assign(middle=(low + high) / 2, half=(high - low).abs() / 2, error=((low + high) / 2 - truth).abs())
    styles = all_looks(validation.records)
    figure, axes = panels(1, 2, 3.1)
    left, right = axes[0]
    handles: dict[str, Line2D] = {}
    for variant, part in known.sort_values("step").groupby("variant", sort=False):
        style = _style(styles[variant])
        handles[variant] = Line2D([], [], **style)
        stepped = part[part["parameter"] == "dt"]
        if len(stepped):
            left.errorbar(stepped["step"], stepped["middle"], yerr=stepped["half"], capsize=2, **style)
            right.plot(stepped["step"], stepped["error"], **style)
        else:  # no step: its tightest run as a line
            best = part.iloc[0]
            right.axhline(max(best["error"], best["half"]), **{**style, "marker": ""})
    for number, value in enumerate(dict.fromkeys(truth)):
        left.axhline(value, color="#999999", linewidth=2.0, zorder=1)
        handles.setdefault("independent solution", Line2D([], [], color="#999999", linewidth=2.0))
    left.set(xscale="log", xlabel=STEP, ylabel="threshold of stick on $F_0$ [N]")
    right.set(xscale="log", yscale="log", xlabel=STEP, ylabel="distance from the independent solution [N]")
    letter(axes.flat)
    legend(figure, handles, columns=4)
    return Drawing("threshold", "Largest load amplitude with a stick phase in the steady state over step size; bars: bracket. Lines "
                   "across the right panel: runs by tolerance, their tightest.", figure)


def _style(look: Look) -> dict:
    return look.line(marker=look.marker, markersize=3.5, markerfacecolor="white" if look.dashes not in ("-",) else look.color,
                     markeredgewidth=0.8)


def _points(ax: Axes, x: pd.Series, y: pd.Series, look: Look) -> None:
    ax.plot(x, y, **_style(look))


def _first_order(ax: Axes, steps: Iterable[float], errors: Iterable[float]) -> None:
    """A dotted line of slope one through the middle of the points."""
    steps, errors = np.asarray(steps, dtype=float), np.asarray(errors, dtype=float)
    level = np.exp(np.mean(np.log(errors / steps)))
    ends = np.array([steps.min(), steps.max()])
    ax.plot(ends, level * ends, color="#999999", linewidth=0.8, linestyle=":", zorder=1)
