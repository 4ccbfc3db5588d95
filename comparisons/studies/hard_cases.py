"""Hard cases: where methods break down, case by case and counted; `comparisons.hard` has the cases and their judges."""

from __future__ import annotations


import numpy as np
import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.hard import hard_comparison
from stiction.comparisons.hard.examination import (DECLINED, DECLINED_BY_ADAPTER, DEGRADED, FAILED, IMPULSIVE, INEXPRESSIBLE, NOT_INSTALLED, NOT_RUN, RIGHT,
                                                   UNREAD, WRONG)
from stiction.comparisons.methods import called
from stiction.comparisons.presentation.charts import HeatMap
from stiction.comparisons.presentation.presentation import Headline, Presentation
from stiction.comparisons.presentation.table_view import Column, view
from stiction.comparisons.presentation.traced_text import TracedText, count, listed, traced
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Scope, Study, Tables
from stiction.engines.registry import OWN_METHODS

HOSTILE = "hostile scenes"
"""Topic of the cases that are about the reader of scene files, not about a method."""
NOT_ATTEMPTED = frozenset({DECLINED, DECLINED_BY_ADAPTER, INEXPRESSIBLE, IMPULSIVE, UNREAD})
"""Verdicts on cases of which a method claims no motion: by its own word or our adapter's, or because it goes on by impulses."""
LOST = frozenset({WRONG, FAILED})
COUNTED = {"right": frozenset({RIGHT}), "declined": NOT_ATTEMPTED, "degraded": frozenset({DEGRADED}), "wrong": LOST}
"""Headings of the counts, and the verdicts that each counts."""
SIGNS = {RIGHT: ("+", "#009E73"), DEGRADED: ("~", "#E69F00"), DECLINED: ("o", "#56B4E9"), DECLINED_BY_ADAPTER: ("a", "#9CCBEA"),
         INEXPRESSIBLE: (".", "#DDDDDD"), UNREAD: ("-", "#DDDDDD"), IMPULSIVE: ("i", "#CC79A7"), WRONG: ("x", "#D55E00"), FAILED: ("!", "#8B0000")}
SHORT = 80
"""Characters of a reason in a table."""


def plan(scope: Scope) -> Comparison[Tables]:
    """Every case through the reference's methods and every engine."""
    found = hard_comparison(depth=scope.depth, engines=scope.engines)
    return found.then(lambda hard: Tables({"hard": hard.table}, problems=hard.problems))


def present(results: Results) -> Presentation:
    """Counts of right, declined, degraded and wrong answers of every installed method over the same mechanical cases."""
    table = results.table("hard")
    tried = table[~table["verdict"].isin([NOT_INSTALLED, NOT_RUN])] if len(table) else table
    mechanical, hostile = (tried[(tried["topic"] == HOSTILE) == whether] if len(tried) else tried for whether in (False, True))
    if mechanical.empty:
        return Presentation()
    variants = list(dict.fromkeys(mechanical["variant"]))
    topics = frozenset(mechanical["topic"])
    counts = {variant: tuple(count("hard", table, variant=variant, topic=topics, verdict=verdicts) for verdicts in COUNTED.values()) for variant in variants}
    cells = {variant: traced("/".join("{}" for _ in COUNTED), *numbers) for variant, numbers in counts.items()}
    first = variants[0]
    answer = traced("Right/declined/degraded/wrong of {} mechanical cases: {} {}{}.", count("hard", table, variant=first, topic=topics), called(first), cells[first],
                    _engines(mechanical, cells))
    lost = mechanical[mechanical["verdict"].isin([DEGRADED, *LOST])]
    shown = (_counts(table, counts), _topics(mechanical, variants), _reasons(lost), _cases(table))
    notes = ("Declined: by the method's own word or our adapter's, not expressible with the engine, or continued by impulses where no motion with finite forces exists.",
             "Degraded: less accurate than the method should be. Errors are relative to the size of what is measured.",
             *(_hostile(hostile),))
    return Presentation(answer, (), (Headline("hard cases: right/declined/ degraded/wrong", cells),), shown, (_heat_map(mechanical, variants),), tuple(filter(None, notes)))


def _engines(mechanical: pd.DataFrame, cells: dict[str, TracedText]) -> TracedText:
    """The engines with the most and the fewest right answers, at each fidelity."""
    engines = mechanical[~mechanical["engine"].isin(OWN_METHODS)]
    parts = []
    for fidelity, rows in engines.groupby("fidelity", sort=False):
        right = rows["verdict"].eq(RIGHT).groupby(rows["variant"], sort=False).sum()
        ends = dict.fromkeys((right.idxmax(), right.idxmin()))
        said = listed([traced("{} {}", called(variant, False), cells[variant]) for variant in ends], " to ", " to ")
        parts.append(traced("{} {}", f"{fidelity}s", said))
    return traced("; {}", listed(parts, "; ", "; ")) if parts else TracedText("")


def _counts(table: pd.DataFrame, counts: dict[str, tuple]) -> object:
    frame = pd.DataFrame([{"variant": variant, **{heading: int(number.text) for heading, number in zip(COUNTED, numbers)}} for variant, numbers in counts.items()])
    rows = [np.flatnonzero(table["variant"] == variant) + 1 for variant in frame["variant"]]
    return view("hard-counts", "Mechanical hard cases by method.", frame, (Column("variant", "method"), *(Column(heading) for heading in COUNTED)), source="hard", rows=rows)


def _topics(mechanical: pd.DataFrame, variants: list[str]) -> object:
    """Right answers by topic, of its cases."""
    groups = list(mechanical.groupby("topic", sort=False))
    frame = pd.DataFrame([{"topic": topic, "cases": rows["case"].nunique(), **{
        variant: int(((rows["variant"] == variant) & (rows["verdict"] == RIGHT)).sum()) for variant in variants}} for topic, rows in groups])
    return view("hard-topics", "Right answers by topic.", frame, (Column("topic"), Column("cases"), *(Column(variant) for variant in variants)), source="hard",
                rows=[rows.index + 1 for _, rows in groups], in_report=False)


def _reasons(lost: pd.DataFrame) -> object:
    """One row per method, verdict and reason: its cases."""
    groups = list(lost.groupby(["variant", "verdict", "about"], sort=False))
    frame = pd.DataFrame([{"variant": variant, "verdict": verdict, "reason": about, "cases": ", ".join(rows["case"])} for (variant, verdict, about), rows in groups],
                         columns=["variant", "verdict", "reason", "cases"])
    return view("hard-reasons", "What is not right, and why.", frame, (Column("variant", "method"), Column("verdict"), Column("cases"), Column("reason", brief=False)),
                source="hard", rows=[rows.index + 1 for _, rows in groups], in_report=False)


def _cases(table: pd.DataFrame) -> object:
    """What must be true of each case."""
    first = table.drop_duplicates("case")
    return view("hard-cases", "What must be true of each case, as derived in its scene's file.", first, (Column("case"), Column("topic"), Column("must", "must be true")),
                source="hard", in_report=False)


def _hostile(hostile: pd.DataFrame) -> str:
    """The cases of the file reader, apart from those of the methods."""
    if hostile.empty:
        return ""
    cases = hostile["case"].nunique()
    refused = hostile[hostile["verdict"] == UNREAD]["case"].nunique()
    lost = listed([f"{variant} {len(rows)}" for variant, rows in hostile[hostile["verdict"].isin(LOST)].groupby("variant", sort=False)])
    wrong = f" Wrong on the others: {lost.text}." if lost else ""
    return (f"Hostile files are {cases} more: our reader refuses {refused} of them before any method sees them, so that no method is credited with them.{wrong}")


def _heat_map(mechanical: pd.DataFrame, variants: list[str]) -> HeatMap:
    """Verdicts: a row a case by topic, a column a method."""
    wide = mechanical.pivot(index="case", columns="variant", values="verdict")
    cases = {topic: list(dict.fromkeys(rows["case"])) for topic, rows in mechanical.groupby("topic", sort=False)}
    order = [case for names in cases.values() for case in names]
    cells = [[verdict if isinstance(verdict, str) else "" for verdict in wide.loc[case, variants]] for case in order]
    return HeatMap("hard-cases", "Verdicts on the mechanical hard cases, by topic: a row a case, a column an installed method.", order, variants, cells, SIGNS,
                   {topic: len(names) for topic, names in cases.items()})


STUDY = Study("hard", "Hard cases", "Where do methods break down?", 6, present, plan, seconds=0.15, takes_scene=False, takes=frozenset({"engines", "problems"}))
