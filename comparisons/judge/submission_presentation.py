"""Presentation of a judged submission: the rows that its text mentions, and its table.

The text is in ``reports/templates/submission.md``.
"""

from __future__ import annotations

from collections.abc import Iterator

from stiction.comparisons.bench.presentation import Column, Presentation, row_of, view
from stiction.comparisons.judge.benchmark import NAME, benchmark_scenes
from stiction.comparisons.judge.submission import JudgedSubmission, Verdict, unknown_columns

SENTENCE_ENDS = (".", "?", "!")
"""Characters behind which a sentence gets no full stop."""


def presentation(judged: JudgedSubmission) -> Presentation:
    """Return what the text and the table of a judged submission show."""
    table = judged.table
    rows = {
        "benchmark": NAME,
        "submission": judged.submission,
        "scenes": len(benchmark_scenes()),
        "submitted": judged.submitted,
        "submitted_scenes": judged.submitted_scenes,
        "within": judged.count(Verdict.WITHIN),
        "reasons": list(_reasons(judged)),
        "declined": _declined(judged),
        "missing": list(table.loc[table["verdict"] == Verdict.MISSING, "scene"]),
        "unknown_columns": list(_unknown_columns(judged)),
    }
    columns = (
        Column("scene"),
        Column("verdict"),
        Column("position_error"),
        Column("position_bound", "bound"),
        Column("velocity_error"),
        Column("torque_error", "mean error of efforts", "N m or N"),
        Column("stick_phases"),
        Column("stick_found", "found"),
        Column("stick_missed", "missed"),
        Column("stick_invented", "invented"),
        Column("jumps"),
        Column("jumps_read", "jumps read"),
    )
    return Presentation(rows=rows, tables=[view("scenes", table, columns)])


def _end_of_sentence(text: str) -> str:
    """Return the full stop that a sentence needs; empty if it has an end."""
    return "" if text.endswith(SENTENCE_ENDS) else "."


def _reasons(judged: JudgedSubmission) -> Iterator[dict[str, object]]:
    """Yield the row of each submitted table that is not within bounds, with the end of its reason."""
    table = judged.table
    is_submitted = ~table["verdict"].isin([Verdict.DECLINED, Verdict.MISSING])
    for label in table.index[is_submitted & (table["reason"] != "")]:
        end = _end_of_sentence(table.at[label, "reason"])
        yield {"row": row_of("scenes", table, label), "end": end}


def _declined(judged: JudgedSubmission) -> list[dict[str, object]]:
    """Return the declined scenes, grouped by their reasons."""
    table = judged.table
    declined = table[table["verdict"] == Verdict.DECLINED]
    return [
        {"reason": str(reason).rstrip("."), "scenes": list(rows["scene"])}
        for reason, rows in declined.groupby("reason", sort=False)
    ]


def _unknown_columns(judged: JudgedSubmission) -> Iterator[dict[str, str]]:
    """Yield the sentence about columns that a scene does not have, unless it is part of the reason."""
    verdicts = judged.table.set_index("scene")["verdict"]
    for scene, judgement in judged.judgements.items():
        if verdicts[scene] == Verdict.NOT_JUDGED:
            continue
        for sentence in unknown_columns(judgement):
            yield {"scene": scene, "sentence": sentence, "end": _end_of_sentence(sentence)}
