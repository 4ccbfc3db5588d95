"""The paper's statements about its example: which hold, on the truth and on its own scheme; `paper_claims` measures them."""

from __future__ import annotations

from typing import Any

import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison, side_by_side
from stiction.comparisons.campaigns.participants import extent
from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.presentation.table_view import Column, view
from stiction.comparisons.presentation.traced_text import TracedText, count, listed, traced
from stiction.comparisons.results import Results
from stiction.comparisons.studies import stick_threshold
from stiction.comparisons.studies.stabilization_drift import drift_study_comparison
from stiction.comparisons.studies.paper_claims import VERDICTS, claims_comparison, drift_claims, sensitivity_comparison
from stiction.comparisons.studies.study import Scope, Study, Tables

PLURAL = {"holds": "hold", "holds in the steady state only": "hold in the steady state only", "does not hold": "do not hold", "contradicts itself": "contradict themselves",
          "partly": "hold partly", "not testable": "are not testable"}
SINGULAR = {"partly": "holds partly", "not testable": "is not testable"}
MARGIN = "margin, "


def plan(scope: Scope) -> Comparison[Tables]:
    """The statements about the motion, those about drift on the runs of the drift study, and where the depth says so the choices that the paper leaves open."""
    cases = dict(enumerate(scope.scenes, 1))
    parts: list[Comparison[Any]] = [claims_comparison(cases, scope.known[stick_threshold.TRUTH][True]), drift_study_comparison(cases, scope.depth)]
    if extent(scope.depth).sensitivity:
        parts.append(sensitivity_comparison(cases))

    def tables(found: list[Any]) -> Tables:
        motion, drift, *open_choices = found
        about_drift = pd.DataFrame(drift_claims(drift.tables["study"], scope.scenes[0].name)).assign(status="ok", reason="")
        claims = pd.concat([motion, about_drift], ignore_index=True)
        return Tables({"claims": claims} | ({"sensitivity": open_choices[0]} if open_choices else {}))

    return side_by_side(parts, tables)


def present(results: Results) -> Presentation:
    """How many statements hold; all of them in full, the rarest verdicts first."""
    table = results.table("claims")
    if table.empty:
        return Presentation()
    there = [verdict for verdict in VERDICTS if (table["verdict"] == verdict).any()]
    parts = [traced("{} {}", count("claims", table, verdict=verdict), _words(verdict, int((table["verdict"] == verdict).sum()))) for verdict in there]
    answer = traced("Of {} statements of the paper {}.", count("claims", table), listed(parts))
    rarest = table.assign(place_of_verdict=table["verdict"].map(table["verdict"].value_counts())).sort_values("place_of_verdict", kind="stable")
    stretches = [column for column in table if str(column).startswith(MARGIN)]
    rarest["margins"] = ["; ".join(f"{name.removeprefix(MARGIN)}: {row[name]:.2g}" for name in stretches if pd.notna(row[name])) for row in rarest.to_dict("records")]
    columns = (Column("case"), Column("verdict"), Column("claim", "statement"), Column("place", "where", brief=False), Column("margins", brief=False),
               Column("run needed [s]", "run needed", "s", brief=False), Column("step needed [s]", "step needed", "s", brief=False))
    tables = [view("claims", "The paper's statements about its example (Sect. 5), the rarest verdicts first.", rarest, columns)]
    findings, choices = [], results.table("sensitivity")
    if len(choices):
        findings.append(_sensitivity(choices))
        tables.append(view("sensitivity", "What the paper leaves open, decided otherwise: the truth's numbers, and statements whose verdict changes.", choices,
                           [Column(str(name)) for name in choices if name not in ("status", "reason")], in_report=False))
    return Presentation(answer, tuple(findings), (), tuple(tables), (), ("A margin is how far a statement is from failing; negative where it fails.",))


def _words(verdict: str, number: int) -> str:
    """The verdict after a number: ``13 hold``, ``1 contradicts itself``."""
    return SINGULAR.get(verdict, verdict) if number == 1 else PLURAL.get(verdict, verdict)


def _sensitivity(choices: pd.DataFrame) -> TracedText:
    said = choices.get("claims that change")
    changing = 0 if said is None else int((said.notna() & (said != "none")).sum())
    return traced("Of {} choices that the paper leaves open, {} change a verdict.", count("sensitivity", choices), str(changing))


STUDY = Study("claims", "The paper", "Does what the paper says hold?", 9, present, plan, stick_threshold.STUDY.requires, seconds=5.5, compared=False)
