"""Writes the folder of a paper; the same run gives the same bytes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.results import Results
from stiction.reports.figures import Drawing, drawings, save_all
from stiction.reports.figures.style import rc
from stiction.reports.markdown.findings import Finding, findings, limits
from stiction.reports.paper import latex
from stiction.reports.paper.methods import methods
from stiction.reports.paper.sections import Section, in_sections
from stiction.reports.paper.sheets import KEY, Sheet, sheets
from stiction.reports.run_folder.overwriting import PROVENANCE, run_folder
from stiction.reports.run_folder.reproduce import FOLDER as REPRODUCE
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import key_of, resolve

MAIN = "paper.pdf"
AUTHORS = ("the stiction authors",)
"""As in ``CITATION.cff``: those of what wrote it, where nobody else is named."""
TITLE = "Results of solvers for mechanisms with dry friction in sliding joints"
TRACING = (
    "The last column of a table is a key. Its letter names a table of the run's data, its number the row, from 1: A12 is row 12 of "
    "data/accuracy.csv, J16-30 are rows 16 to 30 of data/torque.csv, which the numbers here sum up. The command \"stiction trace "
    "RUN KEY\" prints the row in full precision, the files of its trajectories and of the truth, the settings of the engine, versions and "
    "machine; trace.csv has the same for all keys. A threshold sums up runs of which only their number is kept.",)


def write_paper(run: StoredRun, folder: str | Path, column: str = "double", authors: Sequence[str] = AUTHORS) -> Path:
    """Write what an author needs of a run.

    ``figures/*.pdf``, ``tables/*.tex`` and ``*.csv``, ``methods.tex``, ``references.bib``, ``paper.tex`` with all of it and the captions,
    ``trace.csv``; ``paper.pdf`` with its source for Typst, ``paper.typ`` and ``paper.json``; ``reproduce/`` and ``provenance.json`` of the
    run. The folder appears complete or not at all.

    Parameters
    ----------
    column : {"double", "single"}
        Width of the figures, see `stiction.reports.figures.style.COLUMNS`.
    authors
        Below the title.

    Returns
    -------
    Path
        Of ``paper.pdf``.

    Raises
    ------
    FolderRefused
        If writing would lose something.
    """
    import typst

    validation = run.validation()
    tables, texts = list(sheets(run, validation)), methods(run, validation)
    templates = files("stiction.reports.paper")
    with run_folder(folder, MAIN, run.folder) as partial:
        for name in ("figures", "tables"):
            (partial / name).mkdir()
        with rc(column):
            figures = list(drawings(validation))
        save_all(figures, partial / "figures", column, ("pdf",))
        for sheet in tables:
            (partial / "tables" / f"{sheet.name}.tex").write_text(latex.table(sheet), encoding="utf-8")
            sheet.frame.to_csv(partial / "tables" / f"{sheet.name}.csv", index=False)
        trace_table(run, tables).to_csv(partial / "trace.csv", index=False)
        (partial / "methods.tex").write_text(latex.paragraphs(texts), encoding="utf-8")
        lines, sections = told(validation), _sections(figures, tables)
        (partial / "paper.tex").write_text(_main(run, lines, sections, authors, column), encoding="utf-8")
        content = _content(run, lines, texts, sections, authors, column)
        (partial / "paper.json").write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        for name in ("paper.typ", "references.bib"):
            (partial / name).write_bytes((templates / name).read_bytes())
        (partial / MAIN).write_bytes(typst.compile(str(partial / "paper.typ"), root=str(partial), ignore_system_fonts=True))
        for name in (name for name in run.origin["files"] if name.startswith(f"{REPRODUCE}/")):
            (partial / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(run.folder / name, partial / name)
        written = sorted(path.relative_to(partial).as_posix() for path in partial.rglob("*") if path.is_file())
        text = json.dumps({**run.origin, "files": [*written, PROVENANCE]}, indent=2, ensure_ascii=False)
        (partial / PROVENANCE).write_text(text + "\n", encoding="utf-8")
    return Path(folder) / MAIN


def trace_table(run: StoredRun, tables: Sequence[Sheet]) -> pd.DataFrame:
    """One row per key of the sheets: the file of the table, data and rows behind it, its runs, files, settings and version."""
    rows = []
    for sheet in tables:
        for key in sheet.frame[KEY]:
            source = resolve(run, key)
            about = {name: "; ".join(map(str, dict.fromkeys(source.rows[name].dropna()))) if name in source.rows else ""
                     for name in ("key", "engine", "version", "settings")}
            rows.append({KEY: key, "table": f"tables/{sheet.name}.tex", "data": f"data/{source.table}.csv",
                         "first row": source.rows.index[0], "last row": source.rows.index[-1], "runs": about.pop("key"), **about,
                         "files": "; ".join(source.files)})
    return pd.DataFrame(rows)


def told(validation: Results) -> list[str]:
    """The findings, each with the keys of the rows that its numbers are from."""
    return [f"**{finding.title}.** {finding.told.text}" + (f" ({', '.join(keys)})" if (keys := _keys(finding)) else "")
            for finding in (*findings(validation), *limits(validation))]


def _keys(finding: Finding) -> list[str]:
    """Rows that follow each other in one key."""
    rows: dict[str, set[int]] = {}
    for number in finding.told.numbers:
        rows.setdefault(number.table, set()).update(number.rows)
    keys = []
    for table, places in rows.items():
        apart = [place for place in sorted(places) if place - 1 not in places]
        keys += [key_of(table, [place for place in sorted(places) if begin <= place < after])
                 for begin, after in zip(apart, [*apart[1:], max(places, default=0) + 1])]
    return [*dict.fromkeys(keys)]


def _sections(figures: Sequence[Drawing], tables: Sequence[Sheet]) -> list[tuple[Section, str, list[Drawing], list[Sheet]]]:
    """With each section its text, which refers to all that is in it."""
    return [(section, f"{section.words} {_references(there, below)}", there, below) for section, there, below in in_sections(figures, tables)]


def _references(figures: Sequence[Drawing], tables: Sequence[Sheet]) -> str:
    """``See Figs. [#fig:a] and [#fig:b], and Table [#tab:c].``"""
    parts = []
    for word, kind, items in (("Fig", "fig", figures), ("Table", "tab", tables)):
        numbers = [f"[#{kind}:{item.name}]" for item in items]
        if numbers:
            ending = ("." if word == "Fig" else "") if len(numbers) == 1 else "s." if word == "Fig" else "s"
            parts.append(f"{word}{ending} {', '.join(numbers[:-1])}{' and ' if numbers[:-1] else ''}{numbers[-1]}")
    return f"See {', and '.join(parts)}."


def _main(run: StoredRun, lines: Sequence[str], sections: Sequence[tuple[Section, str, list[Drawing], list[Sheet]]], authors: Sequence[str], column: str) -> str:
    return latex.PAPER % {
        "title": TITLE, "authors": latex.escape(" and ".join(authors)).replace(" and ", r" \and "), "date": run.origin["date"][:10],
        "results": latex.results(lines), "tracing": latex.paragraphs(TRACING),
        "sections": "\n".join(latex.section(section.title, text, there, below, column == "double") for section, text, there, below in sections)}


def _content(run: StoredRun, lines: Sequence[str], texts: Sequence[str], sections: Sequence[tuple[Section, str, list[Drawing], list[Sheet]]],
             authors: Sequence[str], column: str) -> dict[str, Any]:
    """What ``paper.typ`` sets."""
    when = datetime.fromisoformat(run.origin["date"])
    return {"title": TITLE, "authors": list(authors), "origin": f"stiction {run.origin['versions']['stiction']}, run of {when:%Y-%m-%d %H:%M} UTC",
            "software": f"Made by stiction from the run of {run.origin['date']}",
            "date": {name: getattr(when, name) for name in ("year", "month", "day", "hour", "minute", "second")},
            "columns": 1 if column == "double" else 2, "summary": _quoted(lines), "methods": _quoted(texts), "tracing": _quoted(TRACING),
            "sections": [{"title": section.title, "text": latex.quoted(text),
                          "figures": [{"name": drawing.name, "caption": latex.quoted(drawing.caption)} for drawing in there],
                          "tables": [_table(sheet) for sheet in below]} for section, text, there, below in sections]}


def _quoted(texts: Sequence[str]) -> list[str]:
    return [latex.quoted(text) for text in texts]


def _table(sheet: Sheet) -> dict[str, Any]:
    size, shares = latex.widths(sheet)
    return {"name": sheet.name, "caption": latex.quoted(sheet.caption), "head": sheet.heads(), "right": sheet.right(), "shares": shares,
            "size": latex.SIZES[size].letters / latex.SIZES["footnotesize"].letters, "rows": [_quoted(row) for row in sheet.cells()]}
