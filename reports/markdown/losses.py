"""Failed runs: those that are not ok or ended early, each with its reason; an engine that is not installed has none."""

from __future__ import annotations

import numpy as np
import pandas as pd

from stiction.comparisons.methods import MISSING_ENGINE, succeeded
from stiction.comparisons.results import Results
from stiction.reports.run_folder.data import tables_of

ROWS_OF = {"choice": "variant", "method": "variant", "claim": "variant", "mean step [s]": "step"}
"""Columns of tables whose rows are no variants: what they are called here."""
NO_REASON = "(no reason given)"
WHERE = "where (scene: step)"


def losses(validation: Results) -> pd.DataFrame:
    """One row per lost run: ``scene, variant, parameter, step, status, reason, table, row``.

    `table` and `row` (its number, from 1) are where it is lost: ``runs``, or the comparison that made runs of its own. What came out with
    a reservation (a run that ended before its time, a bracket without an end) has the status ``incomplete``.
    """
    columns = ["scene", "variant", "parameter", "step", "status", "reason"]
    parts = []
    for name, table in tables_of(validation).items():
        if {"status", "reason"} <= set(table.columns):
            lost = ~succeeded(table) & (table["status"] != MISSING_ENGINE)
            rows = table if "variant" in table else table.rename(columns=ROWS_OF)
            parts.append(rows.loc[lost].reindex(columns=columns).assign(table=name, row=np.flatnonzero(lost) + 1))
    lost = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=[*columns, "table", "row"])
    lost["status"] = lost["status"].where(lost["status"] != "ok", "incomplete")
    lost["reason"] = lost["reason"].fillna("").where(lost["reason"].fillna("") != "", NO_REASON)
    # runs come first: what is lost there is missing from every table made of them
    return lost.drop_duplicates(columns, ignore_index=True)


def grouped(lost: pd.DataFrame) -> pd.DataFrame:
    """Losses of one variant for one reason as one row: ``variant, status, reason, runs`` and `WHERE`."""
    rows = []
    for (variant, status, reason), group in lost.groupby(["variant", "status", "reason"], sort=False, dropna=False):
        where = [f"{scene}: {', '.join(f'{step:g}' for step in part['step'].dropna().unique())}".removesuffix(": ")
                 for scene, part in group.groupby("scene", sort=False)]
        rows.append((variant, status, reason, len(group), "; ".join(where) or group["table"].iloc[0]))
    return pd.DataFrame(rows, columns=["variant", "status", "reason", "runs", WHERE])
