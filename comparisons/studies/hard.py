"""Hard cases: verdicts on every method, case by case and counted; `comparisons.hard` has the cases and their judges."""

from __future__ import annotations

import pandas as pd

from stiction.comparisons.bench.methods import called
from stiction.comparisons.bench.presentation import (
    Column,
    Headline,
    HeatMap,
    Number,
    Presentation,
    TableView,
    TracedText,
    count,
    listed,
    sentence,
    traced,
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
NOTES = (
    "Declined: by the method's own word. Not judged: our adapter or our reader declines it, the engine cannot "
    "express it, or goes on by impulses where no motion with finite forces exists.",
    "Degraded: less accurate than the method should be. Errors are relative to the size of what is measured.",
)


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
    topics, counts = frozenset(mechanical["topic"]), {}
    for variant in dict.fromkeys(mechanical["variant"]):
        about = {"variant": variant, "topic": topics}
        counts[variant] = {
            name: count("hard", table, **about, verdict=verdicts)
            for name, verdicts in COUNTED.items()
        }
    first, *_ = counts
    cells = {
        variant: listed(list(numbers.values()), "/", "/") for variant, numbers in counts.items()
    }
    answer = traced(
        "Wrong/judged: {}.",
        listed(
            [
                traced("{} {}", called(first), _wrong(table, mechanical, first)),
                *_others(table, mechanical),
            ],
            "; ",
            "; ",
        ),
    )
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
    verdicts = HeatMap(
        "hard-cases",
        order,
        list(counts),
        wide.loc[order, list(counts)].to_numpy().tolist(),
        SIGNS,
        {topic: len(names) for topic, names in cases.items()},
        caption="Verdicts on the mechanical hard cases, by topic: a row a case, a column an "
        "installed method.",
    )
    return Presentation(
        answer,
        (),
        [Headline("hard cases: right/declined/ not judged/degraded/ wrong", cells)],
        _tables(table, mechanical, counts),
        [verdicts],
        list(filter(None, [*NOTES, _hostile(tried[tried["topic"] == HOSTILE])])),
    )


def _wrong(table: pd.DataFrame, mechanical: pd.DataFrame, variant: str) -> TracedText:
    """``13/41``: the wrong answers of a method, of those that are judged."""
    return traced(
        "{}/{}",
        *(
            count(
                "hard", table, variant=variant, topic=frozenset(mechanical["topic"]), verdict=chosen
            )
            for chosen in (COUNTED["wrong"], JUDGED)
        ),
    )


def _others(table: pd.DataFrame, mechanical: pd.DataFrame) -> list[TracedText]:
    """The engines with the smallest and the largest part of wrong answers among those that are judged, by fidelity."""
    parts, judged = (
        [],
        mechanical[mechanical["verdict"].isin(JUDGED) & ~mechanical["engine"].isin(own_methods())],
    )
    for fidelity, rows in judged.groupby("fidelity", sort=False):
        share = rows["verdict"].isin(COUNTED["wrong"]).groupby(rows["variant"], sort=False).mean()
        ends = dict.fromkeys((share.idxmin(), share.idxmax()))
        said = [
            traced("{} {}", called(variant, False), _wrong(table, mechanical, variant))
            for variant in ends
        ]
        parts.append(traced("{}s {}", str(fidelity), listed(said, " to ", " to ")))
    return parts


def _tables(
    table: pd.DataFrame, mechanical: pd.DataFrame, counts: dict[str, dict[str, Number]]
) -> list[TableView]:
    """Counts by method and by topic, the reasons for all answers that are not right, and the truth of each case."""
    by_method = [
        (
            {"variant": variant, **{name: int(number.text) for name, number in numbers.items()}},
            table[table["variant"] == variant],
        )
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
            (Column("variant", "method"), *map(Column, COUNTED)),
            source="hard",
            caption="Mechanical hard cases by method.",
        ),
        view(
            "hard-topics",
            topics,
            map(Column, ("topic", "cases", *counts)),
            source="hard",
            in_report=False,
            caption="Right answers by topic.",
        ),
        view(
            "hard-reasons",
            reasons,
            (
                Column("variant", "method"),
                Column("verdict"),
                Column("cases"),
                Column("reason", brief=False),
            ),
            source="hard",
            in_report=False,
            caption="Degraded and wrong answers, and their reasons.",
        ),
        view(
            "hard-cases",
            table.drop_duplicates("case"),
            (Column("case"), Column("topic"), Column("must", "must be true")),
            source="hard",
            in_report=False,
            caption="What must be true of each case, as derived in its scene's file.",
        ),
    ]


def _hostile(hostile: pd.DataFrame) -> str:
    """The cases of the file reader, which no method is credited with."""
    if hostile.empty:
        return ""
    refused = hostile.loc[hostile["verdict"] == UNREAD, "case"].nunique()
    wrong = hostile[hostile["verdict"].isin(COUNTED["wrong"])].groupby("variant", sort=False).size()
    others = sentence(
        " Wrong on the others: {}.",
        listed([f"{variant} {number}" for variant, number in wrong.items()]),
    )
    return (
        f"Hostile files are {hostile['case'].nunique()} more: our reader refuses {refused} of them before any "
        f"method sees them, so that no method is credited with them.{others.text}"
    )


STUDY = Study(
    "hard",
    "Hard cases",
    "Where do methods break down?",
    present,
    plan,
    seconds=0.15,
    takes_scene=False,
    takes=frozenset({"engines", "problems"}),
)
