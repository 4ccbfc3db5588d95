"""The section of a study in Markdown: question, answer, findings, figures, tables and notes."""

from __future__ import annotations

from collections.abc import Mapping

from stiction.comparisons.bench.presentation.table_view import BRIEF_ROWS, TableView
from stiction.comparisons.bench.study import Study
from stiction.reports.figures.style import Drawing
from stiction.reports.markdown.tables import align_columns
from stiction.reports.text import Section


def study_section(study: Study, section: Section, drawings: Mapping[str, Drawing]) -> str:
    """Return the Markdown of a section; its tables have their first rows and their brief columns.

    A figure that is not in `drawings` is left out.
    """
    figures = [
        figure_markdown(drawings[figure.name])
        for figure in section.figures
        if figure.name in drawings
    ]
    tables = [
        table_with_caption(view)
        for view in section.tables
        if view.in_report and not view.frame.empty
    ]
    notes = "\n".join(f"- {note}" for note in section.notes)
    parts = [
        f"## {study.question}",
        section.answer,
        *section.findings,
        *figures,
        *tables,
        notes,
    ]
    return "\n\n".join(part for part in parts if part)


def figure_markdown(drawing: Drawing) -> str:
    """Return the Markdown of a figure: the picture, its caption, and a link to its PDF."""
    file = f"figures/{drawing.name}"
    return f"![{drawing.name}]({file}.svg)\n\n{drawing.caption} ([PDF]({file}.pdf))"


def table_with_caption(view: TableView) -> str:
    """Return the Markdown of a table: its caption, its first rows, and where the other rows are."""
    return f"*{view.caption}*\n\n{brief_table(view)}{remaining_rows_note(view)}"


def brief_table(view: TableView) -> str:
    """Return the first rows of a table, with its brief columns and a heading before each group of rows."""
    rows: list[list[str]] = []
    last_group = None
    for number, cells in enumerate(view.cells(brief=True)[:BRIEF_ROWS]):
        if view.group:
            group = view.frame[view.group][number]
            if group != last_group:
                rows.append([f"*{group}*", *[""] * (len(cells) - 1)])
                last_group = group
        rows.append(cells)
    return align_columns(view.heads(brief=True), rows, view.right(brief=True))


def remaining_rows_note(view: TableView) -> str:
    """Return a paragraph that links to all rows of a table; empty if the first rows are all."""
    if len(view.frame) <= BRIEF_ROWS:
        return ""
    file = f"data/{view.source}.csv"
    return f"\n\nThe first {BRIEF_ROWS} of {len(view.frame)} rows; all are in [{file}]({file})."
