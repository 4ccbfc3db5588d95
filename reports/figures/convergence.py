"""What accuracy costs: errors of motion and torque jumps over step size and CPU time; the threshold on F0."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from comparisons.validation import Validation
from comparisons.variants import OWN_CPU, Record
from reports.figures.style import TRUTH_COLOR, Drawing, Look, beside, figures_of, legend, letter, looks, panels
from reports.tables import worst_per_run

BRACKET = ("F0 with stick [N]", "F0 without stick [N]")
ORDER_LOOKS = (Look("#000000", "-", "o"), Look("#D55E00", "-", "s", True), Look("#0072B2", "-", "D"))
ACROSS = {"step": "step size [s]", OWN_CPU: "CPU time inside the engine [s]"}


@dataclass(frozen=True)
class Row:
    """A row of panels: column of the errors, its label, column to draw them over."""

    column: str
    label: str
    across: str


def accuracy_figures(validation: Validation) -> Iterator[Drawing]:
    """Per scene: error of position over step and over cost, error of velocity over cost."""
    position, velocity = "position error [m]", "velocity error [m/s]"
    return _errors(
        "accuracy", "Largest errors of position and velocity over step size and CPU time. Dotted: first order.",
        (Row(position, position, "step"), Row(position, position, OWN_CPU), Row(velocity, velocity, OWN_CPU)),
        validation.tables.get("accuracy", pd.DataFrame()), validation.records)


def torque_figures(validation: Validation) -> Iterator[Drawing]:
    """Per scene: the largest error of size and of time of the driving torque's jumps over cost."""
    return _errors(
        "torque", "Largest errors of size and time of the jumps of the driving torque over CPU time, jumps that a "
        "run does not resolve left out. The time of a jump read off samples is known to half their distance.",
        (Row("largest jump error [N m]", "jump error [N m]", OWN_CPU),
         Row("largest time error [s]", "time error [s]", OWN_CPU)),
        worst_per_run(validation.tables.get("torque", pd.DataFrame())), validation.records)


def threshold_figure(validation: Validation) -> Drawing | None:
    """(a) the bracket of each variant over its step with the truth as a line, (b) its distance from the truth."""
    table = validation.tables.get("threshold", pd.DataFrame())
    if not {*BRACKET, "truth [N]", "parameter"} <= set(table.columns):
        return None
    known = table.dropna(subset=[*BRACKET, "truth [N]"])
    if known.empty:
        return None
    low, high, truth = (known[name].astype(float) for name in (*BRACKET, "truth [N]"))
    known = known.assign(middle=(low + high) / 2, half=(high - low).abs() / 2, error=((low + high) / 2 - truth).abs())
    figure, (left, right) = beside(2, 3.1)
    handles: dict[str, Line2D] = {}
    for variant, look in _looks_of(known, validation.records).items():
        part = known[known["variant"] == variant].sort_values("step")
        stepped = part[part["parameter"] == "dt"]
        style = look.line()
        if len(stepped):
            style |= look.points()
            left.errorbar(stepped["step"], stepped["middle"], yerr=stepped["half"], capsize=2, **style)
            right.plot(stepped["step"], stepped["error"], **style)
        else:  # no step: the tightest run as a line; within its bracket nothing smaller can be said
            right.axhline(max(part[["error", "half"]].iloc[0]), **style)
        handles[variant] = Line2D([], [], **style)
    handles["independent solution"] = Line2D([], [], color=TRUTH_COLOR, linewidth=1.6)
    physics = known["mus"] if "mus" in known else pd.Series(np.nan, known.index)
    for value, mus in dict(zip(truth, physics)).items():
        left.axhline(value, color=TRUTH_COLOR, linewidth=1.6, zorder=1)
        text = f"{value:.8g} N" + ("" if pd.isna(mus) else rf" ($\mu_s$ = {mus:g})")
        left.text(0.98, value, text, transform=left.get_yaxis_transform(), ha="right", va="bottom", fontsize=7)
    left.set(xscale="log", xlabel=ACROSS["step"], ylabel="threshold of stick on $F_0$ [N]")
    left.margins(y=0.1)
    right.set(xscale="log", yscale="log", xlabel=ACROSS["step"], ylabel="error of the threshold [N]")
    letter((left, right))
    legend(figure, handles)
    caption = ("Largest load amplitude with a stick phase in the steady state over step size; bars: bracket. Lines "
               "across (b): runs by tolerance, the tightest.")
    return Drawing("threshold", "threshold", caption, figure)


def orders_figure(table: pd.DataFrame) -> Drawing | None:
    """Error over step of the reference's two ways, with a line of the order that each method has."""
    table = table[table["position error [m]"].notna()] if len(table) else table
    if table.empty:
        return None
    figure, (ax,) = beside(1, 3.2)
    handles: dict[str, Line2D] = {}
    for look, (method, ladder) in zip(ORDER_LOOKS, table.groupby("method", sort=False)):
        step, error = ladder["mean step [s]"].to_numpy(), ladder["position error [m]"].to_numpy()
        order, half = ladder["observed order [-]"].iloc[0], ladder["interval of the order [-]"].iloc[0]
        found = "no order" if np.isnan(order) else f"order {order:.3g} ± {half:.1g}"
        ax.plot(step, error, **look.line() | {"linestyle": "none"}, **look.points())
        expected = ladder["order of the method [-]"].iloc[0]
        ax.plot(step, error[-1] * (step / step[-1]) ** expected, color=TRUTH_COLOR, linewidth=0.9, linestyle=":", zorder=1)
        handles[f"{method}: {found}"] = Line2D([], [], **look.line() | {"linestyle": "none"}, **look.points())
    ax.set(xscale="log", yscale="log", xlabel="mean step [s]", ylabel="position error [m]")
    legend(figure, handles, columns=1)
    return Drawing("orders", "orders", "Observed orders with their intervals of 95 %, fitted where neighbouring slopes agree. Dotted, through the finest rung: orders 8, 4 and 1.",
                   figure)


def _errors(topic: str, caption: str, rows: tuple[Row, ...], table: pd.DataFrame, records: tuple[Record, ...],
            ) -> Iterator[Drawing]:
    rows = tuple(row for row in rows if {row.column, row.across} <= set(table) and table[row.column].notna().any())
    for ending, scenes in figures_of(list(dict.fromkeys(table["scene"]))) if rows else ():
        yield Drawing(topic + ending, topic, f"{scenes[0]}: {caption}" if ending else caption,
                      _error_panels(rows, scenes, table, records))


def _error_panels(rows: tuple[Row, ...], scenes: list[str], table: pd.DataFrame, records: tuple[Record, ...]) -> Figure:
    figure, axes = panels(len(rows), len(scenes), 0.7 + 1.75 * len(rows), sharey="row", sharex="row")
    handles: dict[str, Line2D] = {}
    for j, scene in enumerate(scenes):
        for ax, row in zip(axes[:, j], rows):
            there = table[(table["scene"] == scene) & (table[row.column] > 0) & (table[row.across] > 0)]
            if row.across == "step":
                there = there[there["parameter"] == "dt"]
                _first_order(ax, there["step"].to_numpy(float), there[row.column].to_numpy(float))
            for variant, look in _looks_of(there, records).items():
                part = there[there["variant"] == variant].sort_values("step")
                ax.plot(part[row.across], part[row.column], **look.line(), **look.points())
                handles.setdefault(variant, Line2D([], [], **look.line(), **look.points()))
            ax.set(xscale="log", yscale="log", ylabel=row.label if j == 0 else "", xlabel=ACROSS[row.across])
        axes[0, j].set_title(scene)
    letter(axes.flat)
    legend(figure, {variant: handles[variant] for variant in looks(records) if variant in handles})
    return figure


def _looks_of(table: pd.DataFrame, records: tuple[Record, ...]) -> dict[str, Look]:
    """Looks of the variants of a table, in the order of the records."""
    present = set(table["variant"])
    return {variant: look for variant, look in looks(records).items() if variant in present}


def _first_order(ax: Axes, steps: np.ndarray, errors: np.ndarray) -> None:
    """A dotted line of slope one through the middle of the points."""
    if len(steps):
        level = np.exp(np.mean(np.log(errors / steps)))
        ends = np.array([steps.min(), steps.max()])
        ax.plot(ends, level * ends, color=TRUTH_COLOR, linewidth=0.9, linestyle=":", zorder=1)
