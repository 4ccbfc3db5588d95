"""Hard cases: verdicts on every method, case by case and counted; `comparisons.hard` has the cases and their judges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import pandas as pd

from stiction.comparisons.bench.participants import REFERENCE
from stiction.comparisons.bench.presentation import (
    METHOD,
    Column,
    Headline,
    HeatMap,
    Presentation,
    TableView,
    view,
)
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.hard import hard_comparison
from stiction.comparisons.hard.examination import (
    DECLINED,
    DECLINED_BY_ADAPTER,
    DEGRADED,
    FAILED,
    IMPULSIVE,
    INEXPRESSIBLE,
    NOT_INSTALLED,
    NOT_RUN,
    RIGHT,
    UNREAD,
    WRONG,
)
from stiction.engines.registry import own_methods

HOSTILE = "hostile scenes"
"""Topic of the cases that are about the reader of scene files, not about a method."""
COUNTED = {
    "right": frozenset({RIGHT}),
    "declined": frozenset({DECLINED}),
    "not judged": frozenset({DECLINED_BY_ADAPTER, INEXPRESSIBLE, IMPULSIVE, UNREAD}),
    "degraded": frozenset({DEGRADED}),
    "wrong": frozenset({WRONG, FAILED}),
}
"""Headings of the counts, and the verdicts that each counts."""
JUDGED = COUNTED["right"] | COUNTED["degraded"] | COUNTED["wrong"]
SIGNS = {
    "right": ("+", "#009E73"),
    "declined": ("o", "#56B4E9"),
    "not judged": (".", "#DDDDDD"),
    "degraded": ("~", "#E69F00"),
    "wrong": ("x", "#D55E00"),
}


def plan(scope: Scope) -> Comparison[Tables]:
    """Every case through the reference's methods and every engine."""
    return hard_comparison(scope.depth, scope.engines)


def present(results: Results) -> Presentation:
    """Counts of `COUNTED` for every installed method on the same mechanical cases."""
    table = results.table("hard")
    tried = table[~table["verdict"].isin([NOT_INSTALLED, NOT_RUN])] if len(table) else table
    mechanical = tried[tried["topic"] != HOSTILE] if len(tried) else tried
    if mechanical.empty:
        return Presentation()
    counts = {
        variant: _counts(rows["verdict"])
        for variant, rows in mechanical.groupby("variant", sort=False)
    }
    headline = Headline(
        "hard cases: right/declined/ not judged/degraded/ wrong",
        {variant: "/".join(map(str, numbers.values())) for variant, numbers in counts.items()},
    )
    own = mechanical.loc[mechanical["engine"].isin(own_methods()), "variant"]
    return Presentation(
        rows={
            "own": _judged(mechanical, own.iloc[0]) if len(own) else None,
            "engines": _least_and_most_often_wrong(mechanical),
            "hostile": _hostile(tried[tried["topic"] == HOSTILE]),
        },
        headlines=[headline],
        tables=_tables(table, mechanical, counts),
        figures=[_heat_map(mechanical, list(counts))],
    )


def _counts(verdicts: pd.Series) -> dict[str, int]:
    """The numbers of verdicts by heading."""
    return {name: int(verdicts.isin(counted).sum()) for name, counted in COUNTED.items()}


def _judged(mechanical: pd.DataFrame, variant: str) -> dict[str, object]:
    """The numbers of wrong answers of a method, and of those that are judged."""
    verdicts = mechanical.loc[mechanical["variant"] == variant, "verdict"]
    return {
        "variant": variant,
        "wrong": int(verdicts.isin(COUNTED["wrong"]).sum()),
        "judged": int(verdicts.isin(JUDGED).sum()),
    }


def _least_and_most_often_wrong(mechanical: pd.DataFrame) -> list[dict[str, object]]:
    """The engines with the smallest and the largest part of wrong answers among those that are judged, by fidelity."""
    of_engines = ~mechanical["engine"].isin(own_methods())
    judged = mechanical[mechanical["verdict"].isin(JUDGED) & of_engines]
    ends = []
    for fidelity, rows in judged.groupby("fidelity", sort=False):
        share = rows["verdict"].isin(COUNTED["wrong"]).groupby(rows["variant"], sort=False).mean()
        variants = dict.fromkeys((share.idxmin(), share.idxmax()))
        methods = [_judged(mechanical, variant) for variant in variants]
        ends.append({"fidelity": fidelity, "methods": methods})
    return ends


def _hostile(hostile: pd.DataFrame) -> dict[str, object] | None:
    """The cases of the file reader, those that it refuses, and the wrong answers to others by method."""
    if hostile.empty:
        return None
    wrong = hostile[hostile["verdict"].isin(COUNTED["wrong"])].groupby("variant", sort=False).size()
    return {
        "cases": hostile["case"].nunique(),
        "refused": hostile.loc[hostile["verdict"] == UNREAD, "case"].nunique(),
        "wrong": [{"variant": variant, "cases": number} for variant, number in wrong.items()],
    }


def _heat_map(mechanical: pd.DataFrame, variants: list[str]) -> HeatMap:
    """The verdicts by heading: a row a case, by topic, and a column a method."""
    headings = {verdict: name for name, verdicts in COUNTED.items() for verdict in verdicts}
    wide = (
        mechanical.replace({"verdict": headings})
        .pivot(index="case", columns="variant", values="verdict")
        .fillna("")
    )
    cases = {
        str(topic): list(dict.fromkeys(rows["case"]))
        for topic, rows in mechanical.groupby("topic", sort=False)
    }
    order = [case for names in cases.values() for case in names]
    return HeatMap(
        "hard-cases",
        order,
        variants,
        wide.loc[order, variants].to_numpy().tolist(),
        SIGNS,
        {topic: len(names) for topic, names in cases.items()},
    )


def _tables(
    table: pd.DataFrame, mechanical: pd.DataFrame, counts: Mapping[str, Mapping[str, int]]
) -> list[TableView]:
    """Counts by method and by topic, the reasons for all answers that are not right, and the truth of each case."""
    by_method = [
        ({"variant": variant, **numbers}, table[table["variant"] == variant])
        for variant, numbers in counts.items()
    ]
    topics = []
    for topic, rows in mechanical.groupby("topic", sort=False):
        right = (
            rows.loc[rows["verdict"] == RIGHT, "variant"]
            .value_counts()
            .reindex(list(counts), fill_value=0)
        )
        topics.append(({"topic": topic, "cases": rows["case"].nunique(), **right}, rows))
    bad = mechanical[mechanical["verdict"].isin(COUNTED["degraded"] | COUNTED["wrong"])]
    reasons = [
        (
            {
                "variant": variant,
                "verdict": verdict,
                "reason": about,
                "cases": ", ".join(rows["case"]),
            },
            rows,
        )
        for (variant, verdict, about), rows in bad.groupby(
            ["variant", "verdict", "about"], sort=False
        )
    ]
    return [
        view(
            "hard-counts",
            by_method,
            (METHOD, *map(Column, COUNTED)),
            source="hard",
        ),
        view(
            "hard-topics",
            topics,
            map(Column, ("topic", "cases", *counts)),
            source="hard",
            in_report=False,
        ),
        view(
            "hard-reasons",
            reasons,
            (
                METHOD,
                Column("verdict"),
                Column("cases"),
                Column("reason", brief=False),
            ),
            source="hard",
            in_report=False,
        ),
        view(
            "hard-cases",
            table.drop_duplicates("case"),
            (Column("case"), Column("topic"), Column("must", "must be true")),
            source="hard",
            in_report=False,
        ),
    ]


def failures_of_reference(results: Results) -> Iterator[str]:
    """Yield the hard cases that the reference fails, or in which its answer is wrong."""
    for row in results.table("hard").itertuples():
        if row.variant == REFERENCE and row.verdict in COUNTED["wrong"]:
            yield f"{row.case}: {row.verdict}: {row.about}"


STUDY = Study(
    "hard",
    "Hard cases",
    "Where do methods break down?",
    present,
    plan,
    seconds=0.15,
    takes_scene=False,
    takes=frozenset({"engines", "problems"}),
    tables={
        "hard": "Hard cases: verdict on every method",
    },
    failures_of_reference=failures_of_reference,
)
