"""The paper's Fig. 14, over a longer time: residuals of the constraints with and without stabilization; those of the engines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stiction.comparisons.results import Results
from stiction.comparisons.studies.constraint_drift import CHOICES, NONE, PAPERS, STEPS
from stiction.comparisons.variants import Record
from stiction.reports.figures.differences import PIECES, labelled, panel_of
from stiction.comparisons.methods import case_of, one_per_variant, representatives
from stiction.reports.figures.style import COLORS, DASHES, TRUTH_COLOR, Drawing, Look, beside, legend, letter, narrow, panels, tick_at

RESIDUAL = r"$\|\Phi\|$ [m, rad]"
"""Of gaps in metres and angles in radians, whose squares are added as they are (Zhuang & Wang 2014, Fig. 14)."""
MIXED = "The norm adds the squares of gaps in metres and of angles in radians, as the paper's does."
CHOICE_LOOKS = (Look(COLORS[0], DASHES[0], "o"), Look(COLORS[1], DASHES[1], "s"), Look(COLORS[2], DASHES[2], "D"), Look(COLORS[3], DASHES[3], "^"),
                Look(COLORS[4], DASHES[4], "v"), Look(COLORS[6], DASHES[0], "P"))
"""Of `stiction.comparisons.studies.constraint_drift.CHOICES`, told apart in grey by markers and dashes."""
FLOOR = 1e-17
"""Smaller residuals, zero among them, are drawn here: below the rounding of coordinates of the order of 1 m."""
FIDELITIES = {"joint": (COLORS[0], DASHES[0]), "contact": (COLORS[1], DASHES[1])}


def drift_figures(validation: Results) -> Iterator[Drawing]:
    """The study of the paper's scheme (the paper's Fig. 14), and the engines' residuals."""
    study, octaves = (validation.tables.get(name, pd.DataFrame()) for name in ("study", "octaves"))
    for scene in dict.fromkeys(study["scene"]) if len(study) and len(octaves) else ():
        yield _study(study[study["scene"] == scene], octaves[octaves["scene"] == scene], scene, scene == study["scene"].iloc[0])
    records = [record for record in validation.records if record.trajectory is not None and record.variant.engine != "reference"]
    for scene in dict.fromkeys(record.scene for record in records):
        yield Drawing(f"drift-engines-{scene}", "drift", f"Constraint drift of the engines, {case_of(scene)}, residuals of the same constraint equations: the largest in each of "
                      f"{PIECES} pieces of the time, at {FLOOR:g} where it is smaller. {MIXED} At contact fidelity it holds what the contacts penetrate.",
                      _engines([record for record in records if record.scene == scene]))


def _study(study: pd.DataFrame, octaves: pd.DataFrame, scene: str, first: bool) -> Drawing:
    """(a) Drift over time without and with the paper's stabilization, at the smallest and the largest step of the study; (b) drift within 24 s over the step,
    all choices, and where the paper's becomes unstable."""
    looks_of = {choice.label: CHOICE_LOOKS[number] for number, choice in enumerate(CHOICES)}
    steps = [step for step in STEPS if step in set(octaves["step"])]
    figure, (left, right) = beside(2, 3.2)
    handles: dict[str, Line2D] = {}
    for label in (NONE.label, PAPERS.label, CHOICES[-1].label):
        for step, fill in dict(zip(steps[:1] + steps[-1:], ("none", "full"))).items():
            part = octaves[(octaves["choice"] == label) & (octaves["step"] == step)]
            look = replace(looks_of[label], fill=fill)
            left.plot(part["to [s]"], part["position drift, rms [m]"], **look.line(), **look.points())
    if len(steps) > 1:
        left.set_title(f"hollow: {1e3 * steps[0]:g} ms, full: {1e3 * steps[-1]:g} ms")
    for label, look in looks_of.items():
        part = study[(study["choice"] == label) & (study["reason"] == "")].sort_values("step")
        if len(part):
            right.plot(part["step"], part["position drift to 24 s, max [m]"], **look.line(), **look.points())
            handles[label] = Line2D([], [], **look.line(), **look.points())
    right.axvline(PAPERS.largest_step(), color=TRUTH_COLOR, linewidth=0.9, linestyle=":", zorder=1)
    left.set(xscale="log", yscale="log", xlabel="time [s]", ylabel=f"{RESIDUAL}, rms of an octave")
    right.set(xscale="log", yscale="log", xlabel="step [s]", ylabel=f"{RESIDUAL}, largest in 24 s")
    tick_at(left.xaxis, octaves["to [s]"])
    tick_at(right.xaxis, study["step"])
    letter((left, right))
    legend(figure, handles, columns=3)
    papers = " (the paper's Fig. 14)" if first else ""
    caption = (f"Constraint drift of the paper's scheme{papers}, {case_of(scene)}: (a) over time, (b) over the step. In brackets alpha and beta, 1/s. "
               f"{MIXED} Dotted: the step of {1e3 * PAPERS.largest_step():.3g} ms beyond which the Runge-Kutta method amplifies residuals with the paper's choice.")
    return Drawing("fig14-drift" if first else f"drift-{scene}", "study", caption, figure)


def _engines(records: list[Record]) -> Figure:
    chosen: dict[str, list[Record]] = {}
    for record in representatives(one_per_variant(records)):
        chosen.setdefault(panel_of(record), []).append(record)
    columns = min(2 if narrow() else 3, len(chosen))
    rows = -(-len(chosen) // columns)
    figure, axes = panels(rows, columns, 0.7 + 1.3 * rows, sharex=True, sharey=True)
    for ax, (panel, runs) in zip(axes.flat, chosen.items()):
        for record in runs:
            color, dashes = FIDELITIES[record.variant.fidelity]
            ax.plot(*_envelope(record.trajectory.t, record.trajectory["drift.position"]), color=color, linestyle=dashes, linewidth=0.9)
        ax.set(yscale="log", title=panel)
    labelled(figure, axes, len(chosen), RESIDUAL)
    there = {record.variant.fidelity for runs in chosen.values() for record in runs}
    legend(figure, {name: Line2D([], [], color=color, linestyle=dashes, linewidth=0.9) for name, (color, dashes) in FIDELITIES.items() if name in there})
    return figure


def _envelope(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest value in each of `PIECES` pieces of the time, and when."""
    table = pd.DataFrame({"t": t, "value": np.maximum(values, FLOOR)}).dropna()
    piece = pd.cut(table["t"], PIECES, labels=False) if np.ptp(t) > 0 else np.zeros(len(table))
    largest = table.loc[table.groupby(piece)["value"].idxmax()]
    return largest["t"].to_numpy(), largest["value"].to_numpy()
