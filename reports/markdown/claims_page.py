"""The paper's claims and the study of drift as people read them: margins in one cell, laws of growth as powers of time."""

from __future__ import annotations

import numpy as np
import pandas as pd

from stiction.comparisons.measures.drift_growth import BOUNDED
from stiction.comparisons.studies.constraint_drift import CHOICES, NONE, STEPS, harm, longest
from stiction.comparisons.uncertain import Uncertain

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
    """One row per run, the law of growth in one column; what is bounded grows with no power."""
    laws = []
    for row in study.to_dict("records"):
        if not any(str(name).startswith("growth, ") and isinstance(value, str) for name, value in row.items()):
            laws.append("")
            continue
        verdict, exponent, half, _, length = longest(row)
        laws.append(verdict + ("" if pd.isna(exponent) or verdict == BOUNDED else f", t^({Uncertain(exponent, half).both()})") + f", {length:g} s")
    return study.assign(**{"law of growth": laws})


HARM = {"scene": "scene", "choice": "choice", "drift larger from [s]": "drift [s]", "error twice as large from [s]": "error [s]",
        "largest stable step [s]": "stable [s]", **{f"{name} at {1e3 * STEPS[-1]:g} ms, of that without [-]": f"{name}, {1e3 * STEPS[-1]:g} ms" for name in ("drift", "error")}}
HARM_WORDS = ("Steps from which on a choice does harm in the time of the paper's figures: its drift is larger than without stabilization, its position error twice as large; and the "
              f"step up to which it is stable. ≤: at all steps that were tried. Last, drift and error at {1e3 * STEPS[-1]:g} ms, in units of what they are without.")


def harm_shown(study: pd.DataFrame) -> pd.DataFrame:
    """One row per choice against drift and scene of the study: from which step on it does harm, see `stiction.comparisons.studies.constraint_drift.harm`; under short headings."""
    parts = [harm(study, choice) for choice in CHOICES if choice != NONE]
    found = [part for part in parts if len(part)]
    if not found:
        return pd.DataFrame()
    table = pd.concat(found, ignore_index=True)
    for column in ("drift larger from [s]", "error twice as large from [s]"):
        table[column] = ["" if np.isnan(step) else f"{'≤ ' if step == tried else ''}{step:.2g}" for step, tried in zip(table[column], table["smallest step tried [s]"])]
    return table.rename(columns=HARM)[list(HARM.values())].replace(np.inf, np.nan)
