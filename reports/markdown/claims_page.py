"""The paper's claims and the study of drift as people read them: margins in one cell, laws of growth as powers of time."""

from __future__ import annotations

import pandas as pd

from stiction.comparisons.studies.drift_study import longest

MARGIN = "margin, "


def claims_shown(claims: pd.DataFrame) -> pd.DataFrame:
    """One row per claim with its number; the margins of all stretches in one column."""
    table = claims.copy()
    stretches = [column.removeprefix(MARGIN) for column in claims if str(column).startswith(MARGIN)]
    if stretches:
        table["margins"] = ["; ".join(f"{name}: {row[MARGIN + name]:.2g}" for name in stretches if pd.notna(row[MARGIN + name]))
                            or (row.get("why") if isinstance(row.get("why"), str) else "") for row in claims.to_dict("records")]
    return table


def study_shown(study: pd.DataFrame) -> pd.DataFrame:
    """One row per run, the law of growth in one column."""
    laws = []
    for row in study.to_dict("records"):
        if not any(str(name).startswith("growth, ") and isinstance(value, str) for name, value in row.items()):
            laws.append("")
            continue
        verdict, exponent, half, _, length = longest(row)
        laws.append(verdict + ("" if pd.isna(exponent) else f", t^({exponent:.2f} ± {half:.2f})") + f" over {length:g} s")
    return study.assign(**{"law of growth": laws})
