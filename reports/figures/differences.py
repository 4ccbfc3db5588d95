"""How far each engine is from the truth over time: a panel per engine, so that engines that agree do not hide each other."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stiction.comparisons.results import Results
from stiction.comparisons.truth import Truth
from stiction.comparisons.variants import MUS_EQUALS_MU, Record
from stiction.comparisons.methods import case_of, groups, one_per_variant, representatives
from stiction.reports.figures.style import COLORS, DASHES, TIME, TRUTH_COLOR, Drawing, legend, letter, narrow, panels
from stiction.reports.run_folder.data import SAMPLES
from stiction.scenes import Trajectory

PIECES = 120
"""Of the time: of a difference that changes sign all the time the largest in each piece is drawn."""
QUANTITIES = (("slider.x", "position", "m"), ("motor.effort", "driving-moment", "N m"))
PHYSICS = {"joint, mus > mu": (COLORS[0], DASHES[0]), "joint, mus = mu": (COLORS[2], DASHES[3]),
           "contact, mus > mu": (COLORS[1], DASHES[1]), "contact, mus = mu": (COLORS[2], DASHES[2])}
"""By what may be compared with each other, see `groups`: colour and dashes."""
FAR_BELOW = 10.0
"""Times by which the truth's uncertainty must be below the smallest difference not to be drawn."""
UNSURE = {"color": TRUTH_COLOR, "linestyle": ":", "linewidth": 0.9, "zorder": 1}


def difference_figures(validation: Results) -> Iterator[Drawing]:
    """Per scene and quantity: the size of the difference from the truth of the physics that an engine has, a panel per engine."""
    accuracy = validation.tables.get("accuracy", pd.DataFrame())
    physics = {variant: name for name, rows in groups(accuracy) for variant in rows["variant"]} if len(accuracy) else {}
    for scene in dict.fromkeys(record.scene for record in validation.records):
        chosen: dict[str, dict[str, Record]] = {}
        for record in representatives(one_per_variant(record for record in validation.records if record.scene == scene)):
            if record.variant.label in physics:
                chosen.setdefault(panel_of(record), {})[physics[record.variant.label]] = record
        for column, name, unit in QUANTITIES:
            curves = {panel: found for panel, records in chosen.items() if (found := _curves(records, scene, column, validation.truths))}
            if curves:
                caption = (f"{name.replace('-', ' ')}: distance of each engine from the independent solution, {case_of(scene)}, at the step nearest to "
                           f"1 ms or the tightest tolerance; the largest in each of {PIECES} pieces of the time. A method that does not locate an event has the jump as its difference there. Dotted, where it is not far below: what the truth is unsure by")
                yield Drawing(f"difference-{name}-{scene}", "accuracy", f"{caption[:1].upper()}{caption[1:]}.", _figure(curves, unit))


def panel_of(record: Record) -> str:
    """One panel for all fidelities of an engine; ways of the reference have panels of their own."""
    label = record.variant.label
    return label if record.variant.engine == "reference" else re.split(r", | \+ ", label)[0]


@dataclass(frozen=True)
class Curve:
    """Times (s), sizes of differences, and what the truth is unsure by, nan where that is not known; all but times in the unit of the quantity."""

    t: np.ndarray
    size: np.ndarray
    unsure: float

    @property
    def near_truth(self) -> bool:
        """Whether the truth's uncertainty is not far below the smallest difference."""
        return bool(len(self.size)) and self.unsure > self.size.min() / FAR_BELOW


def _curves(records: Mapping[str, Record], scene: str, column: str, truths: Mapping[str, Truth]) -> dict[str, Curve]:
    found = {}
    for physics, record in records.items():
        truth = truths.get(scene + (MUS_EQUALS_MU if physics.endswith("= mu") else ""))
        if truth is not None and column in record.trajectory:
            found[physics] = Curve(*largest_differences(record.trajectory, truth, column), truth.uncertainty.get(column, np.nan))
    return found


def largest_differences(trajectory: Trajectory, truth: Truth, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and sizes of the largest difference in each of `PIECES` pieces of the time.

    Differences are taken at the instants at which a stored truth is known, `stiction.reports.run_folder.data.SAMPLES` of its time, where the
    run has a sample: a stored run and the run itself give the same figure.
    """
    known = np.linspace(0.0, truth.t_end, SAMPLES)
    nearest = np.minimum(np.searchsorted(known, trajectory.t - 1e-9), SAMPLES - 1)
    at = np.abs(known[nearest] - trajectory.t) < 1e-9
    t = known[nearest[at]]
    size = pd.Series(np.abs(trajectory[column][at] - truth(t)[column]))
    piece = pd.Series(np.minimum((t / truth.t_end * PIECES).astype(int), PIECES - 1))
    seen = size > 0  # a logarithmic axis has no zero
    top = size[seen].groupby(piece[seen]).idxmax().to_numpy()
    return t[top], size[top].to_numpy()


def _figure(curves: Mapping[str, Mapping[str, Curve]], unit: str) -> Figure:
    columns = min(2 if narrow() else 4, len(curves))
    rows = -(-len(curves) // columns)
    figure, axes = panels(rows, columns, 0.7 + 1.3 * rows, sharex=True, sharey=True)
    there = list(dict.fromkeys(physics for lines in curves.values() for physics in lines))
    for ax, (panel, lines) in zip(axes.flat, curves.items()):
        for physics, curve in lines.items():
            color, dashes = PHYSICS[physics]
            ax.plot(curve.t, curve.size, color=color, linestyle=dashes, linewidth=0.9)
            if curve.near_truth:
                ax.axhline(curve.unsure, **UNSURE)
        ax.set(yscale="log", title=panel)
    labelled(figure, axes, len(curves), f"difference [{unit}]")
    handles = {physics: Line2D([], [], color=PHYSICS[physics][0], linestyle=PHYSICS[physics][1], linewidth=0.9) for physics in there}
    if any(curve.near_truth for lines in curves.values() for curve in lines.values()):
        handles["uncertainty of the truth"] = Line2D([], [], **UNSURE)
    legend(figure, handles, columns=len(handles))
    return figure


def labelled(figure: Figure, axes: np.ndarray, count: int, label: str) -> None:
    """One label for all panels, which share their axes; those beyond `count` of an incomplete last row stay empty, and the panels above them have the times."""
    for ax in axes.flat[count:]:
        ax.set_axis_off()
    for ax in axes.flat[max(count - axes.shape[1], 0):count]:
        ax.tick_params(labelbottom=True)
    figure.supxlabel(TIME, fontsize="medium")
    figure.supylabel(label, fontsize="medium")
    letter(axes.flat[:count])
