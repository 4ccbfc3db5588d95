"""What accuracy costs: times to equal error, what is said of the settings of the engines, and the columns of the tables of cost, effects and drift suppression that are shown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from stiction.comparisons.studies.work_precision import HIGH, LOW, TIMING
from stiction.comparisons.uncertain import Uncertain
from stiction.comparisons.variants import OWN_CPU
from stiction.comparisons.presentation.cells import MISSING, uncertainty_of

COLUMN = "ms to "
"""Begins the heading of a time, before the error that it is to."""
MILLI = 1e3
"""Milliseconds in a second."""
MOST = 3
"""Errors beside each other in a report."""
WORDS = ("CPU time in ms inside the engine's own calls, its adapter apart (the reference is counted whole), until the error is below that of the heading: interpolated between the rungs "
         "of a ladder, never extrapolated; medians, with the farther end of their interval where that is not negligible. ≤: the coarsest rung already meets the error, and the time "
         f"is that of the fastest that does. {MISSING}: not reached by any rung that was timed.")
IN_BRIEF = """ms to E: CPU time in ms inside the engine's own calls until the error is below E (m, N m, s); not extrapolated.
≤: the coarsest run already meets it. ends at: the smallest error of the runs. limit: what keeps it there: integration (finer
runs would go on), model (contacts have clearance or give way), adapter (what the suite adds to the engine), truth (its
uncertainty), inconclusive."""
"""What the columns of `times_table` are, on a terminal."""
SETTINGS_WORDS = ("One setting changed at a time, on all scenes and steps of the study. The default is on the front where no other choice is clearly faster with no larger error of position or torque and no more drift, or "
                  "clearly more accurate and no slower. It is one for all mechanisms: what is *better everywhere* is no worse on any scene and step, and clearly better on one. "
                  "Beside it the largest gain in time at no larger errors; the engine's page in the documentation says why a default is kept all the same.")
PICKED = {
    "effects": ("variant", "parameter", "step", "effect", "status", "reason", "slip events", "stick events", "reversal events", "corner events",
                "first event [s]", "position change [m]", "velocity change [m/s]", "effort change, L1 mean [N, N m]", "cpu [s]", OWN_CPU,
                "cpu, of baseline [-]", "rhs [-]", "hlcp [-]", "pivots [-]"),
    "suppression": ("variant", "parameter", "step", "status", "reason", "cpu [s]", OWN_CPU, "steps [-]", "rhs [-]", "hlcp [-]", "projections [-]",
                    "position drift, max [m]", "velocity drift, max [m/s]", "position error [m]"),
    "cost": ("variant", "parameter", "step", "status", "reason", "cpu [s]", OWN_CPU, "repeats", TIMING,
             "position error [m]", "order, position [-]", "order, functional [-]", "grid convergence index [m]", "torque error, L1 mean [N m]", "event time error [s]"),
}


def times_table(equal: pd.DataFrame, most: int | None = None) -> pd.DataFrame:
    """Of a table of `stiction.comparisons.studies.equal_error.equal_error` a row per ladder and quantity: times beside each other, where the ladder ends, and what limits it.

    Parameters
    ----------
    most
        Errors beside each other at most, the largest of those that two ladders reach (one, where there is no second); all of them where None.

    Returns
    -------
    DataFrame
        ``scene``, ``fidelity``, ``variant``, ``quantity``; per error `COLUMN` and the error in the quantity's unit, the time to it as text; ``ends at``, in the unit, and
        ``limit``.
    """
    reached = equal[equal[OWN_CPU].notna()]
    counts = reached["error"].value_counts().sort_index(ascending=False)
    if most is not None and len(counts):
        counts = counts[counts >= min(2, counts.max())]
    errors, ladder = list(counts.index[:most]), ["scene", "fidelity", "variant", "quantity"]
    rows = []
    for _, part in equal.groupby(ladder, sort=False):
        times = {row["error"]: time_of(row, MILLI) for row in part.to_dict("records")}
        rows.append({**part.iloc[0][ladder], **{f"{COLUMN}{error:g}": times.get(error, "") for error in errors},
                     "ends at": part["ladder ends at"].iloc[0], "limit": part["because"].iloc[0]})
    return pd.DataFrame(rows, columns=[*ladder, *(f"{COLUMN}{error:g}" for error in errors), "ends at", "limit"])


def time_of(row: Mapping[str, Any], factor: float = 1.0) -> str:
    """The time to an error as text, of a row of `stiction.comparisons.studies.equal_error.equal_error`, in seconds times a factor; empty where it is not reached."""
    if pd.isna(row[OWN_CPU]):
        return ""
    farther = max(row[HIGH] - row[OWN_CPU], row[OWN_CPU] - row[LOW])
    return ("≤ " if row["at most"] else "") + str(Uncertain(factor * row[OWN_CPU], factor * farther))


def picked(table: pd.DataFrame, name: str) -> pd.DataFrame:
    """The columns of a table that are shown; those without any value left out."""
    both = dict.fromkeys(column for chosen in PICKED[name] for column in (chosen, uncertainty_of(chosen)))
    return table[[column for column in both if column in table and (table[column].notna() & (table[column] != "")).any()]]
