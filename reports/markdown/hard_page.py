"""The page on hard cases: where each method breaks down and the HLCP does not, by topic, by case and in words."""

from __future__ import annotations

import textwrap

import pandas as pd

from stiction.comparisons.hard import METHODS, NOT_BEGUN, UNJUDGED, hard_cell, hard_matrix
from stiction.comparisons.hard.examination import DECLINED, DEGRADED, FAILED, IMPULSIVE, RIGHT, WRONG
from stiction.comparisons.presentation.cells import MISSING
from stiction.reports.markdown.tables import fitted, markdown

WORDS = 160
"""Characters of a reason; all of it is in the data."""
SYMBOLS = {RIGHT: "+", DEGRADED: "~", DECLINED: "o", IMPULSIVE: "i", WRONG: "x", FAILED: "!"}
"""A verdict's sign in a matrix; a cell of one that was not begun (`NOT_BEGUN`) has none."""


def hard_section(table: pd.DataFrame) -> list[str]:
    """The matrix of verdicts, a symbol a cell, and what the symbols mean."""
    heads = {variant: str(number) for number, variant in enumerate(dict.fromkeys(table["variant"]), 1)}
    matrix = hard_signs(table).rename(columns=heads).fillna(MISSING).reset_index()
    return ["Cases and the ways through them: " + ", ".join(f"**{head}** {variant}" for variant, head in heads.items()) + ". "
            + ", ".join(f"{symbol} {verdict}" for verdict, symbol in SYMBOLS.items()) + ". A declined case ends by the method's own word; an impulsive one has no motion with "
            "finite forces, and a scheme of impulses goes on; a failed one ends without a result. What must be true of each case, and what is not right in words: [hard.md](hard.md).", fitted(matrix, len(matrix))]


def hard_signs(table: pd.DataFrame) -> pd.DataFrame:
    """Signs of the verdicts: a row a case, a column a variant, both in the table's order; missing where a run was not begun."""
    wide = table.assign(sign=table["verdict"].map(SYMBOLS)).pivot(index="case", columns="variant", values="sign")
    return wide.loc[list(dict.fromkeys(table["case"])), list(dict.fromkeys(table["variant"]))]


def hard_page(table: pd.DataFrame) -> str:
    """The page of its own: methods against each other, topics, the matrix with sizes, what is not right in words, what must be true of every case."""
    cases = table.drop_duplicates("case")[["case", "scene", "must"]]
    return "\n\n".join([
        "# Hard cases",
        "Every case through the reference's methods and every engine: *right*; *degraded*, less accurate than the method should be; *declined*, by its own word; "
        "*declined by adapter*, by our code in the name of an engine that was not asked; *impulsive*, goes on by impulses where there is no motion with finite forces; *wrong*; *failed*, "
        "without a result; *refused by reader*, the file, for all methods alike. Numbers are errors relative to the size of what is measured, of the worst measure (a count for events). The complementarity problems that the reference "
        "met are in `data/hard-problems.parquet`, for `stiction replay --problems`.",
        "**Where other methods break down.** Cases on which the event-driven HLCP is right and another of the suite's own methods begins "
        f"and is not ({MISSING}: it cannot represent the case):", markdown(breakdowns(table)),
        "**By topic.** Cases that are right, of those on which a method claims a motion or a stop; in brackets the others:", markdown(by_topic(table)),
        "**Every case.**", markdown(hard_matrix(table).drop(columns="topic")),
        "**Not right, in words.** In brackets after a case its size: relative error, number of events, or seconds.", markdown(not_right(table)),
        "**What must be true**, derived in the scene's file:", markdown(cases)]) + "\n"


def breakdowns(table: pd.DataFrame) -> pd.DataFrame:
    """The suite's own methods on the cases on which the first is right and another, once begun, is not."""
    first, *others = [name for name in METHODS if name in set(table["variant"])]
    begun = ~table["verdict"].isin([IMPULSIVE, *NOT_BEGUN])
    right = set(table.loc[(table["variant"] == first) & (table["verdict"] == RIGHT), "case"])
    lost = table["variant"].isin(others) & (table["verdict"] != RIGHT) & begun & table["case"].isin(right)
    rows = table[table["variant"].isin(others) & table["case"].isin(table.loc[lost, "case"])]
    words = [f"{hard_cell(row)}: {_short(row['about'])}" if is_lost else RIGHT if row["verdict"] == RIGHT else MISSING
             for row, is_lost in zip(rows.to_dict("records"), lost[rows.index])]
    wide = rows.assign(cell=words).pivot(index="case", columns="variant", values="cell")
    return wide.loc[list(dict.fromkeys(rows["case"])), [name for name in others if name in wide]].reset_index()


def by_topic(table: pd.DataFrame) -> pd.DataFrame:
    """One row per topic and one for all, one column per variant: how many cases are right."""
    def count(rows: pd.DataFrame) -> str:
        others = int(rows["verdict"].isin(UNJUDGED).sum())
        return f"{int((rows['verdict'] == RIGHT).sum())}/{len(rows) - others}" + (f" ({others})" if others else "")

    variants = list(dict.fromkeys(table["variant"]))
    parts = [*table.groupby("topic", sort=False), ("all", table)]
    return pd.DataFrame([{"topic": topic, **{variant: count(rows[rows["variant"] == variant]) for variant in variants}}
                         for topic, rows in parts])


def not_right(table: pd.DataFrame) -> pd.DataFrame:
    """One row per variant, verdict and reason: the cases, each with its size."""
    rows = table[table["verdict"] != RIGHT]
    named = rows.assign(about=[_short(words) for words in rows["about"]],
                        cases=[case if pd.isna(size) else f"{case} ({size:.1g})" for case, size in zip(rows["case"], rows["size"])])
    order = {variant: i for i, variant in enumerate(dict.fromkeys(table["variant"]))}
    return named.groupby(["variant", "verdict", "about"], sort=False)["cases"].agg(", ".join).reset_index().sort_values(
        ["variant", "verdict"], key=lambda names: names.map(order) if names.name == "variant" else names, kind="stable", ignore_index=True)


def _short(words: str) -> str:
    return textwrap.shorten(words, WORDS, placeholder=" ...")
