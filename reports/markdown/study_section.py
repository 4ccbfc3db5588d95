"""A study in Markdown: question, answer, figures, tables, how to read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.presentation.table_view import BRIEF_ROWS, TableView
from stiction.comparisons.studies.study import Study
from stiction.reports.figures.style import Drawing
from stiction.reports.markdown.tables import aligned


def study_section(study: Study, said: Presentation, drawings: Mapping[str, Drawing]) -> str:
    """The section; tables have their first rows and their brief columns."""
    words = " ".join(part.text for part in (said.answer, *said.findings) if part)
    figures = [figure(drawings[each.name]) for each in said.figures]
    tables = [f"*{view.caption}*\n\n{table(view)}{more(view)}" for view in said.tables if view.in_report and len(view.frame)]
    notes = "\n".join(f"- {note}" for note in said.notes)
    return "\n\n".join(filter(None, (f"## {study.question}", words, *figures, *tables, notes)))


def figure(drawing: Drawing) -> str:
    """A picture with its caption, and the way to its PDF."""
    return f"![{drawing.alt}](figures/{drawing.name}.png)\n\n{drawing.caption} ([PDF](figures/{drawing.name}.pdf))"


def table(view: TableView) -> str:
    """The first rows of a table, its brief columns; a row with the heading of each group before its rows."""
    cells, heads, right = view.cells(brief=True)[:BRIEF_ROWS], view.heads(brief=True), view.right(brief=True)
    if view.group:
        cells = list(_with_headings(cells, list(view.frame[view.group])))
    return aligned(heads, cells, right)


def more(view: TableView) -> str:
    """The sentence below a table that says where the other rows are; empty where all are shown."""
    if len(view.frame) <= BRIEF_ROWS:
        return ""
    return f"\n\nThe first {BRIEF_ROWS} of {len(view.frame)} rows; all are in [data/{view.source}.csv](data/{view.source}.csv)."


def _with_headings(rows: Sequence[list[str]], groups: Sequence[str]) -> list[list[str]]:
    found: list[list[str]] = []
    for number, row in enumerate(rows):
        if number == 0 or groups[number] != groups[number - 1]:
            found.append([f"*{groups[number]}*", *[""] * (len(row) - 1)])
        found.append(row)
    return found
