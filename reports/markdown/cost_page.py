"""What accuracy costs, on a page of its own: three sentences, the times to equal error, effects, drift suppression."""

from __future__ import annotations

import numpy as np
import pandas as pd

from stiction.comparisons.studies.effects import BASELINE
from stiction.comparisons.studies.work_precision import FASTEST as LOW
from stiction.comparisons.studies.work_precision import SLOWEST as HIGH
from stiction.comparisons.studies.work_precision import TARGETS, came_out, time_to_error
from stiction.comparisons.variants import OWN_CPU
from stiction.reports.markdown.tables import cell, markdown, uncertainty_of

WORDS = ("CPU seconds inside the engine's own calls, its adapter apart (the reference is counted whole), until the position error is below that of the heading; a variant is interpolated on its ladder, never extrapolated. `at most`: errors that its coarsest rung already "
         "meets; the time is then that rung's. A dash: not reached by any rung.")
PICKED = {
    "effects": ("variant", "parameter", "step", "effect", "status", "reason", "slip events", "stick events", "reversal events", "corner events",
                "first event [s]", "position change [m]", "velocity change [m/s]", "effort change, L1 mean [N, N m]", "cpu [s]", OWN_CPU,
                "cpu, of baseline [-]", "rhs [-]", "hlcp [-]", "pivots [-]"),
    "suppression": ("variant", "parameter", "step", "status", "reason", "cpu [s]", OWN_CPU, "steps [-]", "rhs [-]", "hlcp [-]", "projections [-]",
                    "position drift, max [m]", "velocity drift, max [m/s]", "position error [m]"),
    "cost": ("variant", "parameter", "step", "status", "reason", "cpu [s]", OWN_CPU, "position error [m]", "order, position [-]",
             "order, functional [-]", "grid convergence index [m]", "torque error, L1 mean [N m]", "event time error [s]"),
}


def cost_page(cost: pd.DataFrame, effects: pd.DataFrame, suppression: pd.DataFrame, figure: str = "") -> list[str]:
    """Paragraphs of Markdown; `figure` stands below the sentences."""
    if cost.empty:
        return ["(not compared in this run)"]
    reached = reached_table(cost)
    parts = ["\n".join(f"{number}. {line}" for number, line in enumerate(sentences(cost, effects, suppression), 1)),
             *([figure] if figure else []), WORDS, markdown(reached),
             "Every rung, failures included:", markdown(picked(cost, "cost"))]
    if len(effects):
        parts += ["What each effect of the scene does and costs, against the scene as declared:", markdown(picked(effects, "effects"))]
    if len(suppression):
        parts += ["Drift suppression, all else equal (drift at the output instants; between its steps, where a projection puts the "
                  "state onto the constraints, the event-driven way interpolates):", markdown(picked(suppression, "suppression"))]
    return parts


def reached_table(cost: pd.DataFrame) -> pd.DataFrame:
    """`time_to_error` with its times headed as such, errors that nobody reaches left out."""
    table = time_to_error(cost)
    table = table.drop(columns=["engine", *(f"{target:g} m" for target in TARGETS if table[f"{target:g} m"].isna().all())])
    return table.rename(columns={f"{target:g} m": f"{OWN_CPU} to {target:g} m" for target in TARGETS})


def picked(table: pd.DataFrame, name: str) -> pd.DataFrame:
    """The columns of a table that are shown; those without any value left out."""
    both = dict.fromkeys(column for chosen in PICKED[name] for column in (chosen, uncertainty_of(chosen)))
    return table[[column for column in both if column in table and (table[column].notna() & (table[column] != "")).any()]]


def sentences(cost: pd.DataFrame, effects: pd.DataFrame, suppression: pd.DataFrame) -> list[str]:
    """Who is fastest at which error; who reaches how little error; what an effect costs most."""
    return [_fastest(time_to_error(cost)), _reach(time_to_error(cost)), _dearest(effects, suppression)]


def _fastest(reached: pd.DataFrame) -> str:
    parts = []
    for target in TARGETS:
        column = f"{target:g} m"
        order = reached.dropna(subset=[column]).sort_values(column, kind="stable")
        own = order["engine"] == "reference"
        if order.empty:
            continue
        first = order.iloc[0]
        text = f"{column}: {first['variant']} ({_milliseconds(first[column])}"
        rivals = order[~own]
        if bool(own.iloc[0]) and len(rivals):
            text += f"; {rivals.iloc[0]['variant']} takes {cell('', float(f'{rivals.iloc[0][column] / first[column]:.2g}'))} times that"
        parts.append(text + ")")
    return f"Least CPU time of the engine itself for a position error of {', '.join(parts)}." if parts else "No run came out with a known error."


def _reach(reached: pd.DataFrame) -> str:
    known = reached.dropna(subset=["smallest error"]).sort_values("smallest error", kind="stable")
    parts = [f"{row['variant']} {cell('error', row['smallest error'])} m" for row in known.to_dict("records")]
    failed = int(reached["failed"].sum())
    lost = f"; {failed} of {int(reached['rungs'].sum())} rungs did not come out" if failed else ""
    return f"The smallest error on each ladder, whatever it takes: {', '.join(parts) or 'none'}{lost}."


def _dearest(effects: pd.DataFrame, suppression: pd.DataFrame) -> str:
    parts = []
    ratio = "cpu, of baseline [-]"
    if ratio in effects:
        own = effects[came_out(effects) & (effects["effect"] != BASELINE) & (effects["engine"] == "reference")].dropna(subset=[ratio])
        if len(own):
            row = own.loc[own[ratio].idxmin()]
            parts.append(f"of all effects that the scene declares, changing one saves the reference most at \"{row['effect']}\": it then "
                         f"takes {100 * row[ratio]:.0f} % of the time")
        free = own[own["effect"] == "no friction"]
        if len(free) and "hlcp [-]" in free:
            parts.append(f"without friction it solves {int(free['hlcp [-]'].iloc[0])} complementarity problems")
    if {"suppression", "parameter", "cpu [s]"} <= set(suppression):
        tight = suppression[came_out(suppression) & (suppression["parameter"] == "rtol")]
        tight = tight[tight["step"] == tight["step"].min()].set_index("suppression")
        drift = "position drift, max [m]"
        if {"none", "baumgarte", "projection"} <= set(tight.index):
            parts.append(f"at rtol {tight['step'].iloc[0]:g} the event-driven reference takes {_milliseconds(tight.at['none', 'cpu [s]'])} without "
                         "drift suppression, " + ", ".join(f"{_milliseconds(tight.at[choice, 'cpu [s]'])} with {word} (drift {cell('drift', tight.at[choice, drift])} m)"
                                     for choice, word in (("projection", "projection"), ("baumgarte", "Baumgarte's"))))
    text = "; ".join(parts)
    return text[:1].upper() + text[1:] + "." if parts else "What the effects cost was not measured."


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.2g} ms" if np.isfinite(seconds) and seconds < 1 else f"{seconds:.2g} s"
