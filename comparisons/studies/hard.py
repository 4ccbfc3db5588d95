"""Hard cases: the verdicts on every method, counted and case by case.

`stiction.comparisons.hard` defines the cases and judges the runs.
"""

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
"""Topic of the cases that test the reader of scene files and not a method."""
COUNTED = {
    "right": frozenset({RIGHT}),
    "declined": frozenset({DECLINED}),
    "not judged": frozenset({DECLINED_BY_ADAPTER, INEXPRESSIBLE, IMPULSIVE, UNREAD}),
    "degraded": frozenset({DEGRADED}),
    "wrong": frozenset({WRONG, FAILED}),
}
"""Headings of the counts, and the verdicts that are counted under each."""
JUDGED = COUNTED["right"] | COUNTED["degraded"] | COUNTED["wrong"]
"""Verdicts on an answer that was compared with the truth."""
SIGNS = {
    "right": ("+", "#009E73"),
    "declined": ("o", "#56B4E9"),
    "not judged": (".", "#DDDDDD"),
    "degraded": ("~", "#E69F00"),
    "wrong": ("x", "#D55E00"),
}
"""Sign and colour of each heading in the heat map: grey and colour-blind safe colours of Okabe and Ito."""


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan every case with the methods of the reference and with every engine."""
    return hard_comparison(scope.depth, scope.engines)


def _reason_against(scope: Scope) -> str:
    """Return why hard cases are not part of a campaign on other scenes than the paper's."""
    if scope.is_of_paper:
        return ""
    return "the hard cases are scenes of the suite; `stiction compare hard` runs them"


def present(results: Results) -> Presentation:
    """Present the counts of verdicts on every installed method in the same mechanical cases."""
    table = results.table("hard")
    if table.empty:
        return Presentation()
    tried = table[~table["verdict"].isin([NOT_INSTALLED, NOT_RUN])]
    mechanical = tried[tried["topic"] != HOSTILE]
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
    """Return the numbers of verdicts by heading."""
    return {heading: int(verdicts.isin(counted).sum()) for heading, counted in COUNTED.items()}


def _judged(mechanical: pd.DataFrame, variant: str) -> dict[str, object]:
    """Return the numbers of wrong and of all judged answers of a method."""
    verdicts = mechanical.loc[mechanical["variant"] == variant, "verdict"]
    return {
        "variant": variant,
        "wrong": int(verdicts.isin(COUNTED["wrong"]).sum()),
        "judged": int(verdicts.isin(JUDGED).sum()),
    }


def _least_and_most_often_wrong(mechanical: pd.DataFrame) -> list[dict[str, object]]:
    """Return for each fidelity the engines with the smallest and the largest share of wrong among judged answers."""
    is_engine = ~mechanical["engine"].isin(own_methods())
    judged = mechanical[mechanical["verdict"].isin(JUDGED) & is_engine]
    extremes = []
    for fidelity, rows in judged.groupby("fidelity", sort=False):
        is_wrong = rows["verdict"].isin(COUNTED["wrong"])
        share = is_wrong.groupby(rows["variant"], sort=False).mean()
        variants = dict.fromkeys((share.idxmin(), share.idxmax()))
        methods = [_judged(mechanical, variant) for variant in variants]
        extremes.append({"fidelity": fidelity, "methods": methods})
    return extremes


def _hostile(hostile: pd.DataFrame) -> dict[str, object] | None:
    """Return the numbers of cases of the file reader: all, refused, and answered wrongly by each method."""
    if hostile.empty:
        return None
    is_wrong = hostile["verdict"].isin(COUNTED["wrong"])
    wrong = hostile[is_wrong].groupby("variant", sort=False).size()
    return {
        "cases": hostile["case"].nunique(),
        "refused": hostile.loc[hostile["verdict"] == UNREAD, "case"].nunique(),
        "wrong": [{"variant": variant, "cases": number} for variant, number in wrong.items()],
    }


def _heat_map(mechanical: pd.DataFrame, variants: list[str]) -> HeatMap:
    """Return the map of verdicts by heading: a row per case, grouped by topic, and a column per method."""
    heading_of = {verdict: heading for heading, verdicts in COUNTED.items() for verdict in verdicts}
    headings = mechanical.replace({"verdict": heading_of})
    wide = headings.pivot(index="case", columns="variant", values="verdict").fillna("")
    cases_by_topic = {
        str(topic): list(dict.fromkeys(rows["case"]))
        for topic, rows in mechanical.groupby("topic", sort=False)
    }
    order = [case for cases in cases_by_topic.values() for case in cases]
    return HeatMap(
        "hard-cases",
        order,
        variants,
        wide.loc[order, variants].to_numpy().tolist(),
        SIGNS,
        {topic: len(cases) for topic, cases in cases_by_topic.items()},
    )


def _tables(
    table: pd.DataFrame, mechanical: pd.DataFrame, counts: Mapping[str, Mapping[str, int]]
) -> list[TableView]:
    """Return the tables of counts by method and by topic, of reasons for bad answers, and of all cases."""
    cases = view(
        "hard-cases",
        table.drop_duplicates("case"),
        (Column("case"), Column("topic"), Column("must", "must be true")),
        source="hard",
        in_report=False,
    )
    return [
        _by_method(table, counts),
        _by_topic(mechanical, list(counts)),
        _reasons(mechanical),
        cases,
    ]


def _by_method(table: pd.DataFrame, counts: Mapping[str, Mapping[str, int]]) -> TableView:
    """Return the table of the counts of verdicts, a row per method."""
    rows = [
        ({"variant": variant, **numbers}, table[table["variant"] == variant])
        for variant, numbers in counts.items()
    ]
    return view("hard-counts", rows, (METHOD, *map(Column, COUNTED)), source="hard")


def _by_topic(mechanical: pd.DataFrame, variants: list[str]) -> TableView:
    """Return the table of the numbers of right answers, a row per topic, a column per method."""
    rows = []
    for topic, runs in mechanical.groupby("topic", sort=False):
        variants_of_right = runs.loc[runs["verdict"] == RIGHT, "variant"]
        right = variants_of_right.value_counts().reindex(variants, fill_value=0)
        row = {"topic": topic, "cases": runs["case"].nunique(), **right}
        rows.append((row, runs))
    columns = map(Column, ("topic", "cases", *variants))
    return view("hard-topics", rows, columns, source="hard", in_report=False)


def _reasons(mechanical: pd.DataFrame) -> TableView:
    """Return the table of degraded and wrong answers, a row per method, verdict and reason."""
    bad = mechanical[mechanical["verdict"].isin(COUNTED["degraded"] | COUNTED["wrong"])]
    rows = []
    for (variant, verdict, reason), runs in bad.groupby(
        ["variant", "verdict", "about"], sort=False
    ):
        row = {
            "variant": variant,
            "verdict": verdict,
            "reason": reason,
            "cases": ", ".join(runs["case"]),
        }
        rows.append((row, runs))
    columns = (
        METHOD,
        Column("verdict"),
        Column("cases"),
        Column("reason", brief=False),
    )
    return view("hard-reasons", rows, columns, source="hard", in_report=False)


def failures_of_reference(results: Results) -> Iterator[str]:
    """Yield a line for each hard case in which the reference fails or gives a wrong answer."""
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
    applies=_reason_against,
    takes=frozenset({"engines", "problems"}),
    tables={
        "hard": "Hard cases: verdict on every method",
    },
    failures_of_reference=failures_of_reference,
)
