"""A study in Markdown: question, answer, figures, tables, how to read them."""

from __future__ import annotations

from collections.abc import Mapping

from stiction.comparisons.bench.presentation.table_view import BRIEF_ROWS, TableView
from stiction.comparisons.bench.study import Study
from stiction.reports.figures.style import Drawing
from stiction.reports.markdown.tables import aligned
from stiction.reports.text import Section


def study_section(study: Study, said: Section, drawings: Mapping[str, Drawing]) -> str:
    """Write the section; tables have their first rows and their brief columns."""
    figures = [figure(drawings[each.name]) for each in said.figures if each.name in drawings]
    shown = [view for view in said.tables if view.in_report and len(view.frame)]
    tables = [f"*{view.caption}*\n\n{table(view)}{more(view)}" for view in shown]
    notes = "\n".join(f"- {note}" for note in said.notes)
    return "\n\n".join(
        filter(
            None, (f"## {study.question}", said.answer, *said.findings, *figures, *tables, notes)
        )
    )


def figure(drawing: Drawing) -> str:
    """Write a picture with its caption, and a link to its PDF."""
    file = f"figures/{drawing.name}"
    return f"![{drawing.name}]({file}.svg)\n\n{drawing.caption} ([PDF]({file}.pdf))"


def table(view: TableView) -> str:
    """Write the first rows of a table, its brief columns, and the heading of each group before its rows."""
    rows, before = [], None
    for number, cells in enumerate(view.cells(brief=True)[:BRIEF_ROWS]):
        if view.group and (group := view.frame[view.group][number]) != before:
            rows.append([f"*{group}*", *[""] * (len(cells) - 1)])
            before = group
        rows.append(cells)
    return aligned(view.heads(brief=True), rows, view.right(brief=True))


def more(view: TableView) -> str:
    """Say below a table where the other rows are; empty where all are shown."""
    if len(view.frame) <= BRIEF_ROWS:
        return ""
    file = f"data/{view.source}.csv"
    return f"\n\nThe first {BRIEF_ROWS} of {len(view.frame)} rows; all are in [{file}]({file})."
