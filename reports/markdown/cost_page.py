"""What accuracy costs: times to equal error, and the columns of the tables of cost, effects and drift suppression that are shown."""

from __future__ import annotations

import pandas as pd

from stiction.comparisons.studies.work_precision import HIGH, LOW
from stiction.comparisons.studies.work_precision import TARGETS, time_to_error
from stiction.comparisons.variants import OWN_CPU
from stiction.reports.markdown.tables import uncertainty_of

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


def reached_table(cost: pd.DataFrame) -> pd.DataFrame:
    """`time_to_error` with its times headed as such, errors that nobody reaches left out."""
    table = time_to_error(cost)
    table = table.drop(columns=["engine", *(f"{target:g} m" for target in TARGETS if table[f"{target:g} m"].isna().all())])
    return table.rename(columns={f"{target:g} m": f"{OWN_CPU} to {target:g} m" for target in TARGETS})


def picked(table: pd.DataFrame, name: str) -> pd.DataFrame:
    """The columns of a table that are shown; those without any value left out."""
    both = dict.fromkeys(column for chosen in PICKED[name] for column in (chosen, uncertainty_of(chosen)))
    return table[[column for column in both if column in table and (table[column].notna() & (table[column] != "")).any()]]
