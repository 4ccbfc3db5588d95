"""The folder for an author: figures, tables, methods and a paper, for LaTeX and, through Typst, as a PDF."""

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
from stiction.reports.figures.charts import drawn, in_one_column
from stiction.reports.figures.style import rc, save_all
from stiction.reports.page_one import TITLE, answers, page_one
from stiction.reports.paper import latex
from stiction.reports.paper.methods import methods, tracing
from stiction.reports.report import Report, report_of
from stiction.reports.run_folder.overwriting import run_folder, write_provenance
from stiction.reports.run_folder.reproduce import FOLDER as REPRODUCE
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import keys, sources_of
from stiction.reports.text import Section

MAIN = "paper.pdf"
SHORT, PAGE_SIGNS = 24, 118
"""Signs of a cell that is not broken, and of a line of 174 mm in type of 7 points."""
AUTHORS = ("the stiction authors",)
"""Authors as in ``CITATION.cff``, unless others are named."""


def write_paper(
    run: StoredRun, folder: str | Path, column: str = "double", authors: Sequence[str] = AUTHORS
) -> Path:
    """Write what an author needs of a run, complete or not at all, and return the path of ``paper.pdf``.

    ``figures/*.pdf``, ``tables/*.tex`` and ``*.csv``, ``methods.tex``, ``references.bib``, ``paper.tex`` with all of it
    and the captions, ``trace.csv``; ``paper.pdf`` with its source for Typst, ``paper.typ`` and ``paper.json``;
    ``reproduce/`` and ``provenance.json`` of the run. FolderRefused if writing would lose something. `column`: width of
    the figures, a name of `stiction.reports.figures.style.COLUMNS`.
    """
    import typst

    report = in_width(report_of(run.validation()), column)
    content = paper_content(run, report, column, authors)
    with run_folder(folder, MAIN, run.folder) as partial:
        for name in ("figures", "tables"):
            (partial / name).mkdir()
        with rc(column):
            figures = list(drawn(report.figures, report.results))
        save_all(figures, partial / "figures", column, ("pdf",))
        for view in report.tables:
            (partial / "tables" / f"{view.name}.tex").write_text(
                latex.table(laid_out(view)), encoding="utf-8"
            )
            view.frame.assign(key=keys(view)).to_csv(
                partial / "tables" / f"{view.name}.csv", index=False
            )
        trace_table(run, report.tables).to_csv(partial / "trace.csv", index=False)
        for name, text in {
            "methods.tex": latex.paragraphs(content["methods"]),
            "paper.tex": latex.paper(content),
            "paper.json": json.dumps(content, indent=1, ensure_ascii=False) + "\n",
        }.items():
            (partial / name).write_text(text, encoding="utf-8")
        for name in ("paper.typ", "references.bib"):
            (partial / name).write_bytes((files("stiction.reports.paper") / name).read_bytes())
        typst.compile(
            str(partial / "paper.typ"),
            str(partial / MAIN),
            root=str(partial),
            ignore_system_fonts=True,
        )
        shutil.copytree(run.folder / REPRODUCE, partial / REPRODUCE)
        write_provenance(partial, run.origin)
    return Path(folder) / MAIN


def in_width(report: Report, column: str) -> Report:
    """Return the report with figures for a width; in one column, those that are too high for a page are in parts."""
    if column == "double":
        return report
    return replace(
        report,
        said={
            study: replace(
                said, figures=[part for figure in said.figures for part in in_one_column(figure)]
            )
            for study, said in report.said.items()
        },
    )


def paper_content(
    run: StoredRun, report: Report, column: str, authors: Sequence[str]
) -> dict[str, Any]:
    """Return all words and tables of the paper, which ``paper.typ`` and `latex` set."""
    origin, when = run.origin, datetime.fromisoformat(run.origin["date"])
    sections = [
        {
            "title": study.question,
            "text": _words(said),
            "figures": [
                {"name": figure.name, "caption": figure.caption} for figure in said.figures
            ],
            "tables": [laid_out(view) for view in said.tables if view.in_report],
        }
        for study, said in report.said.items()
    ]
    return _quoted(
        {
            "title": TITLE,
            "authors": list(authors),
            "origin": f"stiction {origin['versions']['stiction']}, run of {when:%Y-%m-%d %H:%M} UTC",
            "software": f"Made by stiction from the run of {origin['date']}",
            "date": {
                name: getattr(when, name)
                for name in ("year", "month", "day", "hour", "minute", "second")
            },
            "columns": 1 if column == "double" else 2,
            "summary": summary(report),
            "methods": methods(run, report.results),
            "tracing": [tracing()],
            "sections": sections,
        }
    )


def summary(report: Report) -> list[str]:
    """Return what page one says, an item each."""
    return [
        *page_one(report).recommendation,
        *(f"**{title}.** {answer}" for title, answer in answers(report)),
    ]


def laid_out(view: TableView) -> dict[str, Any]:
    """Return a table in print: the columns for which a page has room, the key last; `wide` ones share it as words.

    Where not all columns fit, those of the report stand; words may break, so no column counts for more than `SHORT`.
    """
    whole = zip(view.heads(), *view.cells())
    brief = sum(min(SHORT, max(map(len, column))) for column in whole) > PAGE_SIGNS
    groups = (
        [[name] for name in view.frame[view.group]]
        if brief and view.group
        else [[]] * len(view.frame)
    )
    rows = [
        [*group, *row, key]
        for group, row, key in zip(groups, view.cells(brief), keys(view), strict=True)
    ]
    head = [*[view.group] * (brief and bool(view.group)), *view.heads(brief), "key"]
    right = [*[False] * (len(head) - 1 - len(view.heads(brief))), *view.right(brief), False]
    wide = [
        not numbers and max((len(row[i]) for row in rows), default=0) > SHORT
        for i, numbers in enumerate(right)
    ]
    return {
        "name": view.name,
        "caption": view.caption,
        "head": head,
        "right": right,
        "wide": wide,
        "rows": rows,
    }


def trace_table(run: StoredRun, views: Sequence[TableView]) -> pd.DataFrame:
    """Return a row per key of the tables: its table, the rows of the data, runs, engine, version, settings, files."""
    rows = []
    for view in views:
        for key, source in sources_of(run, view):
            known = {
                name: "; ".join(map(str, source.rows[name].dropna().unique()))
                if name in source.rows
                else ""
                for name in ("key", "engine", "version", "settings")
            }
            rows.append(
                {
                    "key": key,
                    "table": f"tables/{view.name}.tex",
                    "data": source.place,
                    "runs": known.pop("key"),
                    **known,
                    "files": "; ".join(source.files),
                }
            )
    return pd.DataFrame(rows)


def _words(said: Section) -> str:
    """Answer and findings of a study, and references to its figures and tables."""
    marks = {
        "Fig": [f"[#fig:{figure.name}]" for figure in said.figures],
        "Table": [f"[#tab:{view.name}]" for view in said.tables if view.in_report],
    }
    places = [
        f"{word}{'s' if len(names) > 1 else ''} {', '.join(names)}"
        for word, names in marks.items()
        if names
    ]
    references = f"See {' and '.join(places)}." if places else ""
    return " ".join(filter(None, (said.answer, *said.findings, references, *said.notes)))


def _quoted(content: Any) -> Any:
    """The same with quotation marks that open and close in place of straight ones."""
    if isinstance(content, dict):
        return {name: _quoted(entry) for name, entry in content.items()}
    if isinstance(content, list):
        return [_quoted(entry) for entry in content]
    return latex.quoted(content) if isinstance(content, str) else content
