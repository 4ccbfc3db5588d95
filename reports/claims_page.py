"""The paper's claims and the study of drift as people read them: margins in one cell, laws of growth as powers of time."""

from __future__ import annotations

import pandas as pd

from comparisons.drift_study import drift_words, longest
from reports.tables import cell, markdown

MARGIN, FOUND = "margin, ", "found, "


def claims_shown(claims: pd.DataFrame) -> pd.DataFrame:
    """One row per claim with its number; the margins of all stretches in one column."""
    table = claims.copy()
    stretches = [column.removeprefix(MARGIN) for column in claims if str(column).startswith(MARGIN)]
    if stretches:
        table["margins"] = ["; ".join(f"{name}: {row[MARGIN + name]:.2g}" for name in stretches if pd.notna(row[MARGIN + name]))
                            or (row.get("why") if isinstance(row.get("why"), str) else "") for row in claims.to_dict("records")]
    return table


def claims_page(claims: pd.DataFrame) -> str:
    """The table of verdicts, and per claim what was found on each stretch of motion."""
    if not any(str(column).startswith(MARGIN) for column in claims):
        return markdown(claims)
    shown = claims_shown(claims)
    table = shown[[name for name in ("case", "place", "claim", "verdict", "why", "run needed [s]", "step needed [s]") if name in shown]]
    table.insert(0, "number", range(1, len(table) + 1))
    parts = [markdown(table), "What each margin is, and what was found (truth: the independent solution; HLCP: the paper's scheme):"]
    for number, row in enumerate(claims.to_dict("records"), 1):
        lines = [f"  - {name.removeprefix(FOUND)}: {_margin(row, name.removeprefix(FOUND))}{row[name]}" for name in row
                 if str(name).startswith(FOUND) and isinstance(row[name], str)]
        if lines:
            parts.append(f"- {number}. {row['margin is']}\n" + "\n".join(lines))
    return "\n\n".join(parts)


def _margin(row: dict, stretch: str) -> str:
    value = row.get(MARGIN + stretch)
    return "" if value is None or pd.isna(value) else f"{cell('margin', float(f'{value:.3g}'))}; "


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


def study_page(study: pd.DataFrame) -> str:
    """The paragraph and the table."""
    columns = ("scene", "choice", "step", "time [s]", "reason", "amplification per step [-]", "position drift to 24 s, max [m]", "position drift, max [m]",
               "law of growth", "drift, of that without [-]", "less drift than without from [s]", "position error [m]", "position uncertainty [m]",
               "error, of that without [-]")
    shown = study_shown(study)
    return "\n\n".join(filter(None, [drift_words(study), markdown(shown[[name for name in columns if name in shown]])]))
