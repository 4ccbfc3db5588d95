"""Failed runs: those that are not ok or ended early, each with its reason; an engine that is not installed has none."""

from __future__ import annotations

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import succeeded
from stiction.comparisons.bench.results import Results
from stiction.engines.status import Status
from stiction.reports.run_folder.data import tables_of

ROWS_OF = {"choice": "variant", "method": "variant", "claim": "variant", "mean_step": "step"}
"""Columns of tables whose rows are no variants: what they are called here."""
CHOICES = {"variant": {"none": "no stabilization"}}
"""Choices in words."""
NO_REASON = "(no reason given)"
_COLUMNS = ["scene", "variant", "parameter", "step", "status", "reason"]


def failed_runs(results: Results) -> pd.DataFrame:
    """Return a row per failed run: ``scene, variant, parameter, step, status, reason, table, row``.

    `table` and `row` (from 1) are where it stands: ``runs``, or the comparison that made runs of its own. A run that
    ended early, or a bracket without an end, has the status ``incomplete``.
    """
    parts = [pd.DataFrame(columns=[*_COLUMNS, "table", "row"])]
    for name, table in tables_of(results).items():
        if {"status", "reason"} <= set(table.columns):
            reason = table["reason"].fillna("")
            failed = ~succeeded(table) & (table["status"] != Status.MISSING)
            rows = table if "variant" in table else table.rename(columns=ROWS_OF).replace(CHOICES)
            rows = rows.assign(
                status=rows["status"].replace(Status.OK, Status.INCOMPLETE),
                reason=reason.replace("", NO_REASON),
            )
            parts.append(
                rows.loc[failed]
                .reindex(columns=_COLUMNS)
                .assign(table=name, row=np.flatnonzero(failed) + 1)
            )
    found = pd.concat([part for part in parts if len(part)] or parts, ignore_index=True)
    # runs come first: what failed there is missing from every table made of them
    return found.drop_duplicates(_COLUMNS, ignore_index=True)


def grouped(failed: pd.DataFrame) -> pd.DataFrame:
    """Return the failures of one variant for one reason as one row: ``variant, status, reason, runs`` and where."""
    rows = []
    for names, group in failed.groupby(["variant", "status", "reason"], sort=False, dropna=False):
        where = [
            f"{scene}: {', '.join(f'{step:g}' for step in part['step'].dropna().unique())}".removesuffix(
                ": "
            )
            for scene, part in group.groupby("scene", sort=False)
        ]
        rows.append((*names, len(group), "; ".join(where) or group["table"].iloc[0]))
    return pd.DataFrame(
        rows, columns=["variant", "status", "reason", "runs", "where (scene: step)"]
    )
