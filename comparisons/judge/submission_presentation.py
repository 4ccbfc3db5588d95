"""Presentation of a judged submission: the rows that its text mentions, and its table.

The text is in ``reports/templates/submission.md``.
"""

from __future__ import annotations

from stiction.comparisons.bench.presentation import Column, Presentation, row_of, view
from stiction.comparisons.judge.benchmark import NAME
from stiction.comparisons.judge.submission import JudgedSubmission, Verdict


def presentation(judged: JudgedSubmission) -> Presentation:
    """Return what the text and the table of a judged submission show."""
    table = judged.table
    has_reason = table["reason"] != ""
    rows = {
        "benchmark": NAME,
        "submission": judged.submission,
        "scenes": len(table),
        "submitted": judged.submitted,
        "within": judged.count(Verdict.WITHIN),
        "reasons": [row_of("scenes", table, label) for label in table.index[has_reason]],
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
        Column("jumps_read", "read"),
    )
    return Presentation(rows=rows, tables=[view("scenes", table, columns)])
