"""The page on hard cases: where each method breaks down and the HLCP does not, by topic, by case and in words."""

from __future__ import annotations

import textwrap

import pandas as pd

from comparisons.hard import METHODS, hard_cell, hard_matrix
from reports.tables import markdown

WORDS = 160
"""Characters of a reason; all of it is in the data."""
RIGHT = "right"


def hard_page(table: pd.DataFrame) -> str:
    """Methods against each other, topics, the matrix of verdicts, what is not right in words, what must be true of every case."""
    cases = table.drop_duplicates("case")[["case", "scene", "must"]]
    return "\n\n".join([
        "**Where other methods break down.** Cases on which the event-driven HLCP is right and another way to find the contact forces "
        "is not:", markdown(breakdowns(table)),
        "**By topic.** Cases that are right, of those that a method accepted; in brackets those that it refused:", markdown(by_topic(table)),
        "**Every case.**", markdown(hard_matrix(table).drop(columns="topic")),
        "**Not right, in words.** In brackets after a case: its size.", markdown(not_right(table)),
        "**What must be true**, derived in the scene's file:", markdown(cases)])


def breakdowns(table: pd.DataFrame) -> pd.DataFrame:
    """The suite's own methods on the cases on which the first is right and another is not."""
    first, *others = [name for name in METHODS if name in set(table["variant"])]
    cells = table[table["variant"].isin([first, *others])].pivot(index="case", columns="variant", values="verdict")
    lost = [case for case in table["case"].unique()
            if cells.loc[case, first] == RIGHT and (cells.loc[case, others] != RIGHT).any()]
    rows = table[table["case"].isin(lost) & table["variant"].isin(others)]
    words = rows.assign(cell=[RIGHT if row["verdict"] == RIGHT else f"{hard_cell(row)}: {_short(row['about'])}" for row in rows.to_dict("records")])
    return words.pivot(index="case", columns="variant", values="cell").loc[lost, others].reset_index()


def by_topic(table: pd.DataFrame) -> pd.DataFrame:
    """One row per topic and one for all, one column per variant: how many cases are right."""
    def count(rows: pd.DataFrame) -> str:
        refused = int((rows["verdict"] == "refused").sum())
        return f"{int((rows['verdict'] == RIGHT).sum())}/{len(rows) - refused}" + (f" ({refused})" if refused else "")

    variants = list(dict.fromkeys(table["variant"]))
    parts = [*table.groupby("topic", sort=False), ("all", table)]
    return pd.DataFrame([{"topic": topic, **{variant: count(rows[rows["variant"] == variant]) for variant in variants}}
                         for topic, rows in parts])


def not_right(table: pd.DataFrame) -> pd.DataFrame:
    """One row per variant, verdict and reason: the cases, each with its size."""
    rows = table[table["verdict"] != RIGHT]
    named = rows.assign(about=[_short(words) for words in rows["about"]],
                        cases=[case if pd.isna(size) else f"{case} ({size:.1g})" for case, size in zip(rows["case"], rows["size"])])
    return named.groupby(["variant", "verdict", "about"], sort=False)["cases"].agg(", ".join).reset_index()


def _short(words: str) -> str:
    return textwrap.shorten(words, WORDS, placeholder=" ...")


def hard_sentence(table: pd.DataFrame) -> str:
    """Who is right on how many cases, in one sentence."""
    cases = table["case"].nunique()
    counts = table.groupby("variant", sort=False)["verdict"].value_counts().unstack(fill_value=0)
    parts = [f"{variant} {', '.join(f'{word} {count}' for word, count in row.items() if count)}" for variant, row in counts.iterrows()]
    return f"Of {cases} hard cases: {'; '.join(parts)}."
