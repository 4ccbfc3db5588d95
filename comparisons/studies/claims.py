"""The paper's statements about its example, and which hold on the truth and on its own scheme (`paper_claims`)."""

from __future__ import annotations

from typing import Any

import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison, side_by_side
from stiction.comparisons.campaigns.participants import extent
from stiction.comparisons.presentation import Column, Presentation, count, listed, traced, view
from stiction.comparisons.results import Results
from stiction.comparisons.studies import stick_threshold
from stiction.comparisons.studies.paper_claims import (CONTRADICTS, FAILS, HOLDS, NOT_TESTABLE, PARTLY, STEADY,
                                                       UNDECIDED, claims_comparison, drift_claims,
                                                       sensitivity_comparison)
from stiction.comparisons.studies.stabilization_drift import drift_study_comparison
from stiction.comparisons.studies.study import Scope, Study, Tables

WORDS = {HOLDS: ("holds", "hold"), STEADY: ("holds in the steady state only", "hold in the steady state only"),
         PARTLY: ("holds partly", "hold partly"), CONTRADICTS: ("contradicts itself", "contradict themselves"),
         FAILS: ("does not hold", "do not hold"), NOT_TESTABLE: ("is not testable", "are not testable"),
         UNDECIDED: ("is not decided", "are not decided")}
"""Each verdict after 1 and after another number."""
MARGIN = "margin, "


def plan(scope: Scope) -> Comparison[Tables]:
    """Statements about the motion, about drift on the runs of its study, and at full depth about open choices."""
    cases = dict(enumerate(scope.scenes, 1))
    parts: list[Comparison[Any]] = [claims_comparison(cases, scope.known[stick_threshold.TRUTH][True]),
                                    drift_study_comparison(cases, scope.depth)]
    if extent(scope.depth).sensitivity:
        parts.append(sensitivity_comparison(cases))

    def tables(found: list[Any]) -> Tables:
        motion, drift, *open_choices = found
        about_drift = pd.DataFrame(drift_claims(drift.tables["study"],
                                                scope.scenes[0].name)).assign(status="ok", reason="")
        claims = pd.concat([motion, about_drift], ignore_index=True)
        return Tables({"claims": claims, **dict(zip(["sensitivity"], open_choices))})

    return side_by_side(parts, tables)


def present(results: Results) -> Presentation:
    """The number of statements with each verdict; in the report those that do not simply hold, in full."""
    table = results.table("claims")
    if table.empty:
        return Presentation()
    numbers = {verdict: count("claims", table, verdict=verdict) for verdict in WORDS}
    said = [traced("{} {}", number, words[number.text != "1"]) for words, number in
            zip(WORDS.values(), numbers.values()) if number.text != "0"]
    answer = traced("Of {} statements of the paper {}.", count("claims", table), listed(said))
    rarest = table.sort_values("verdict", key=lambda verdicts: verdicts.map(verdicts.value_counts()), kind="stable")
    stretches = [str(column) for column in table if str(column).startswith(MARGIN)]
    rarest["margins"] = ["; ".join(f"{name.removeprefix(MARGIN)}: {row[name]:.2g}" for name in stretches
                                   if pd.notna(row[name])) for row in rarest.to_dict("records")]
    short = (Column("case"), Column("verdict"), Column("claim", "statement"))
    columns = (*short, Column("place", "where"), Column("margins"), Column("run needed [s]", "run needed"),
               Column("step needed [s]", "step needed"))
    tables = [view("claims-open", "The paper's statements about its example (Sect. 5) that do not simply hold.",
                   rarest[rarest["verdict"] != HOLDS], short, source="claims"),
              view("claims", "All statements of the paper about its example, the rarest verdicts first.", rarest,
                   columns, in_report=False)]
    findings, choices = [], results.table("sensitivity")
    if len(choices):
        changed = choices.get("claims that change", pd.Series(dtype=object)).dropna()
        findings.append(traced("Of {} choices that the paper leaves open, {} change a verdict.",
                               count("sensitivity", choices), str((changed != "none").sum())))
        every = [Column(str(name)) for name in choices if name not in ("status", "reason")]
        tables.append(view("sensitivity", "What the paper leaves open, decided otherwise: the truth's numbers, and "
                           "statements whose verdict changes.", choices, every, in_report=False))
    return Presentation(answer, tuple(findings), (), tuple(tables), (),
                        ("A margin is how far a statement is from failing; negative where it fails.",))


STUDY = Study("claims", "The paper", "Does what the paper says hold?", 9, present, plan, stick_threshold.STUDY.requires,
              seconds=5.5, compared=False)
