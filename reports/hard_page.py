"""The page on hard cases: who is right on what, and everything that is not right in words and figures."""

from __future__ import annotations

import textwrap

import pandas as pd

from comparisons.hard import hard_matrix
from reports.tables import markdown

WORDS = 240
"""Characters of a reason; all of it is in the data."""


def hard_page(table: pd.DataFrame) -> str:
    """What must be true of every case, the matrix of verdicts, and the rows that are not right."""
    cases = table.drop_duplicates("case")[["case", "scene", "must"]]
    return "\n\n".join([markdown(hard_matrix(table).drop(columns="topic")), "What must be true, derived in the scene's file:",
                        markdown(cases), "Not right:", markdown(not_right(table))])


def not_right(table: pd.DataFrame) -> pd.DataFrame:
    """One row per case and variant that is not right: verdict, what it is about, its size and the limit for right."""
    rows = table.loc[table["verdict"] != "right", ["case", "variant", "verdict", "about", "size", "limit"]]
    return rows.assign(about=[textwrap.shorten(words, WORDS, placeholder=" ...") for words in rows["about"]]).rename(
        columns={"size": "size (relative error)"})


def hard_sentence(table: pd.DataFrame) -> str:
    """Who is right on how many cases, in one sentence."""
    cases = table["case"].nunique()
    counts = table.groupby("variant", sort=False)["verdict"].value_counts().unstack(fill_value=0)
    parts = [f"{variant} {', '.join(f'{word} {count}' for word, count in row.items() if count)}" for variant, row in counts.iterrows()]
    return f"Of {cases} hard cases: {'; '.join(parts)}."
