"""The folder of a paper: its figures, tables and text for LaTeX, and a PDF, which Typst typesets."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.bench.presentation import TableView
from stiction.comparisons.bench.study import Study
from stiction.reports.figures.charts import draw_figures, in_one_column
from stiction.reports.figures.style import rc, save_all
from stiction.reports.page_one import answers, page_one, title_of
from stiction.reports.paper import latex
from stiction.reports.paper.methods import methods, tracing
from stiction.reports.report import Report, report_of
from stiction.reports.run_folder.overwriting import run_folder, write_provenance
from stiction.reports.run_folder.reproduce import FOLDER as REPRODUCE
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import keys, sources_of
from stiction.reports.text import Section

MAIN = "paper.pdf"
"""File that marks a folder as the folder of a paper."""
MAX_UNBROKEN_TEXT = 24
"""Largest number of characters in a text cell that is not broken into lines."""
PAGE_CHARACTERS = 118
"""Number of characters in a line of 174 mm, the width of the page, with a font size of 7 points."""
AUTHORS = ("the stiction authors",)
"""Default authors, as in ``CITATION.cff``."""


def write_paper(
    run: StoredRun, folder: str | Path, column: str = "double", authors: Sequence[str] = AUTHORS
) -> Path:
    """Write the folder of a paper, complete or not at all, and return the path of ``paper.pdf``.

    The folder contains ``figures/*.pdf``, ``tables/*.tex`` and ``*.csv``, ``methods.tex``,
    ``references.bib``, ``paper.tex`` with all of these, ``trace.csv``, ``paper.pdf`` with its source for
    Typst (``paper.typ``, ``paper.json``), and ``reproduce/`` and ``provenance.json`` of the run.

    Parameters
    ----------
    run : StoredRun
        The run.
    folder : str or Path
        The folder to write.
    column : str
        Width of the figures, a name in `stiction.reports.figures.style.COLUMNS`.
    authors : sequence of str
        Names below the title.

    Raises
    ------
    FolderRefused
        If content of the folder would be lost.
    """
    report = fit_figures(report_of(run.validation()), column)
    content = paper_content(run, report, column, authors)
    with run_folder(folder, MAIN, run.folder) as partial:
        _write_figures(report, partial, column)
        _write_tables(run, report, partial)
        _write_texts(content, partial)
        _typeset(partial)
        shutil.copytree(run.folder / REPRODUCE, partial / REPRODUCE)
        write_provenance(partial, run.origin)
    return Path(folder) / MAIN


def _write_figures(report: Report, folder: Path, column: str) -> None:
    """Write the figures of a report as PDF."""
    (folder / "figures").mkdir()
    with rc(column):
        drawings = list(draw_figures(report.figures, report.results))
    save_all(drawings, folder / "figures", column, ("pdf",))


def _write_tables(run: StoredRun, report: Report, folder: Path) -> None:
    """Write each table of a report as LaTeX and as CSV, and the sources of all their rows."""
    (folder / "tables").mkdir()
    for view in report.tables:
        text = latex.table(lay_out_table(view))
        (folder / "tables" / f"{view.name}.tex").write_text(text, encoding="utf-8")
        frame = view.frame.assign(key=keys(view))
        frame.to_csv(folder / "tables" / f"{view.name}.csv", index=False)
    trace_table(run, report.tables).to_csv(folder / "trace.csv", index=False)


def _write_texts(content: dict[str, Any], folder: Path) -> None:
    """Write the text of a paper for LaTeX and for Typst, and the references."""
    texts = {
        "methods.tex": latex.paragraphs(content["methods"]),
        "paper.tex": latex.paper(content),
        "paper.json": json.dumps(content, indent=1, ensure_ascii=False) + "\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name in ("paper.typ", "references.bib"):
        (folder / name).write_bytes((files("stiction.reports.paper") / name).read_bytes())


def _typeset(folder: Path) -> None:
    """Typeset ``paper.typ`` to `MAIN`, with the fonts that Typst brings, so that the PDF is reproducible."""
    import typst

    typst.compile(
        str(folder / "paper.typ"),
        str(folder / MAIN),
        root=str(folder),
        ignore_system_fonts=True,
    )


def fit_figures(report: Report, column: str) -> Report:
    """Return a report whose figures fit a width of `COLUMNS`; figures higher than a page are divided."""
    if column == "double":
        return report
    sections = {}
    for study, section in report.sections.items():
        figures = [part for figure in section.figures for part in in_one_column(figure)]
        sections[study] = replace(section, figures=figures)
    return replace(report, sections=sections)


def paper_content(
    run: StoredRun, report: Report, column: str, authors: Sequence[str]
) -> dict[str, Any]:
    """Return the text and tables of a paper, which ``paper.typ`` and the module `latex` typeset."""
    origin = run.origin
    date = datetime.fromisoformat(origin["date"])
    content = {
        "title": title_of(report.results),
        "authors": list(authors),
        "origin": f"stiction {origin['versions']['stiction']}, run of {date:%Y-%m-%d %H:%M} UTC",
        "software": f"Made by stiction from the run of {origin['date']}",
        "date": {
            "year": date.year,
            "month": date.month,
            "day": date.day,
            "hour": date.hour,
            "minute": date.minute,
            "second": date.second,
        },
        "columns": 1 if column == "double" else 2,
        "summary": summary(report),
        "methods": methods(run, report.results),
        "tracing": [tracing()],
        "sections": [
            _section_content(study, section) for study, section in report.sections.items()
        ],
    }
    return _with_curly_quotes(content)


def _section_content(study: Study, section: Section) -> dict[str, Any]:
    """Return the title, text, figures and tables of a section."""
    return {
        "title": study.question,
        "text": _section_text(section),
        "figures": [{"name": figure.name, "caption": figure.caption} for figure in section.figures],
        "tables": [lay_out_table(view) for view in section.tables if view.in_report],
    }


def summary(report: Report) -> list[str]:
    """Return the recommendation and the answers of page one, as items of a list."""
    page = page_one(report)
    items = list(page.recommendation)
    for title, answer in answers(report):
        items.append(f"**{title}.** {answer}")
    if not report.results.is_about_paper:
        # A paper about other mechanisms begins with a description of them.
        items.insert(0, page.mechanism)
    return items


def lay_out_table(view: TableView) -> dict[str, Any]:
    """Return a table as it is printed.

    If a page has no room for all columns, only the brief columns are printed. Since long texts are
    broken into lines, a column counts as at most `MAX_UNBROKEN_TEXT` characters wide. A column that
    contains the group of a row may precede the others, and the key of the row is the last column.

    Returns
    -------
    dict
        ``name`` and ``caption``; ``head`` and ``rows``: text; ``right``: whether each column is aligned
        to the right; ``wide``: whether it contains long texts, which share the remaining width.
    """
    # The numbers of characters estimate whether all columns fit.
    columns = zip(view.heads(), *view.cells())
    width = sum(min(MAX_UNBROKEN_TEXT, max(map(len, column))) for column in columns)
    is_brief = width > PAGE_CHARACTERS
    head = [*view.heads(is_brief), "key"]
    right = [*view.right(is_brief), False]
    rows = [[*cells, key] for cells, key in zip(view.cells(is_brief), keys(view), strict=True)]
    # The brief columns do not include the group of a row.
    if is_brief and view.group:
        head = [view.group, *head]
        right = [False, *right]
        rows = [[group, *row] for group, row in zip(view.frame[view.group], rows, strict=True)]
    wide = []
    for column, is_right in enumerate(right):
        longest = max((len(row[column]) for row in rows), default=0)
        wide.append(not is_right and longest > MAX_UNBROKEN_TEXT)
    return {
        "name": view.name,
        "caption": view.caption,
        "head": head,
        "right": right,
        "wide": wide,
        "rows": rows,
    }


def trace_table(run: StoredRun, views: Sequence[TableView]) -> pd.DataFrame:
    """Return a row for each row of the tables: its key and table, and the data it was computed from.

    These are the rows of the data, and the keys, engines, versions, settings and files of their runs.
    """
    rows = []
    for view in views:
        for key, source in sources_of(run, view):
            rows.append(
                {
                    "key": key,
                    "table": f"tables/{view.name}.tex",
                    "data": source.place,
                    "runs": _distinct_values(source.rows, "key"),
                    "engine": _distinct_values(source.rows, "engine"),
                    "version": _distinct_values(source.rows, "version"),
                    "settings": _distinct_values(source.rows, "settings"),
                    "files": "; ".join(source.files),
                }
            )
    return pd.DataFrame(rows)


def _distinct_values(rows: pd.DataFrame, column: str) -> str:
    """Return the distinct values of a column as text; empty if there is no such column."""
    if column not in rows:
        return ""
    return "; ".join(map(str, rows[column].dropna().unique()))


def _section_text(section: Section) -> str:
    """Return the answer, findings and notes of a section, with references to its figures and tables."""
    figures = [f"[#fig:{figure.name}]" for figure in section.figures]
    tables = [f"[#tab:{view.name}]" for view in section.tables if view.in_report]
    references = []
    for word, marks in (("Fig", figures), ("Table", tables)):
        if marks:
            plural = "s" if len(marks) > 1 else ""
            references.append(f"{word}{plural} {', '.join(marks)}")
    sentence = f"See {' and '.join(references)}." if references else ""
    parts = [section.answer, *section.findings, sentence, *section.notes]
    return " ".join(part for part in parts if part)


def _with_curly_quotes(content: Any) -> Any:
    """Return content of `paper_content` with opening and closing quotation marks in all its texts."""
    if isinstance(content, dict):
        return {name: _with_curly_quotes(entry) for name, entry in content.items()}
    if isinstance(content, list):
        return [_with_curly_quotes(entry) for entry in content]
    return latex.quoted(content) if isinstance(content, str) else content
