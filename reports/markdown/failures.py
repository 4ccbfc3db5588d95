"""Failed runs of all tables of a run, each with its reason.

A run that ended early is a failure, too. A run of an engine that is not installed is none.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import succeeded
from stiction.comparisons.bench.results import Results
from stiction.engines.status import Status
from stiction.reports.run_folder.data import tables_of

COMMON_NAMES = {"choice": "variant", "method": "variant", "claim": "variant", "mean_step": "step"}
"""Names in the table of failures for columns of tables whose rows are not variants."""
CHOICES = {"variant": {"none": "no stabilization"}}
"""Descriptions of values, by column, that would not be understood without their table."""
NO_REASON = "(no reason given)"
_COLUMNS = ["scene", "variant", "parameter", "step", "status", "reason"]
"""Columns that identify a failure; two rows that agree in all of them are the same failure."""


def failed_runs(results: Results) -> pd.DataFrame:
    """Return one row per failed run: ``scene, variant, parameter, step, status, reason, table, row``.

    `table` is the table that contains the run, which is ``runs`` or the table of a study that has runs of
    its own, and `row` is the number of the run in it, from 1. The status of a run that ended early is
    ``incomplete``.
    """
    parts = [pd.DataFrame(columns=[*_COLUMNS, "table", "row"])]
    for name, table in tables_of(results).items():
        if {"status", "reason"} <= set(table.columns):
            failures = _failures_of(name, table)
            if len(failures):
                parts.append(failures)
    # pandas would infer other column types if the empty frame were among others.
    failures = pd.concat(parts[1:] or parts, ignore_index=True)
    # The table `runs` comes first. Tables computed from it repeat its failures, which are dropped.
    return failures.drop_duplicates(_COLUMNS, ignore_index=True)


def _failures_of(name: str, table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table that failed, with the columns of `failed_runs`."""
    # That something does not occur is the answer of a run, and no failure.
    is_failed = ~succeeded(table) & ~table["status"].isin([Status.MISSING, Status.NOT_FOUND])
    rows = table
    if "variant" not in table:
        rows = table.rename(columns=COMMON_NAMES).replace(CHOICES)
    rows = rows.assign(
        status=rows["status"].replace(Status.OK, Status.INCOMPLETE),
        reason=table["reason"].fillna("").replace("", NO_REASON),
    )
    failures = rows.loc[is_failed].reindex(columns=_COLUMNS)
    return failures.assign(table=name, row=np.flatnonzero(is_failed) + 1)


def group_failures(failed: pd.DataFrame) -> pd.DataFrame:
    """Return one row for all failures of a variant that have the same status and reason.

    The columns are ``variant, status, reason, runs`` (their number) and the scenes with their step sizes.
    """
    rows = []
    for names, group in failed.groupby(["variant", "status", "reason"], sort=False, dropna=False):
        places = []
        for scene, part in group.groupby("scene", sort=False):
            steps = ", ".join(f"{step:g}" for step in part["step"].dropna().unique())
            places.append(f"{scene}: {steps}" if steps else str(scene))
        # Runs of a study may have no scene; then the table tells where they are.
        rows.append((*names, len(group), "; ".join(places) or group["table"].iloc[0]))
    return pd.DataFrame(
        rows, columns=["variant", "status", "reason", "runs", "where (scene: step)"]
    )
