"""What an author takes from a run: figures, tables, methods and a paper around them, for LaTeX and, through Typst, as a PDF."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.presentation.table_view import TableView
from stiction.comparisons.presentation.traced_text import TracedText
from stiction.comparisons.recommendation import recommendation
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Study
from stiction.reports.figures.charts import drawn
from stiction.reports.figures.style import Drawing, rc, save_all
from stiction.reports.page_one import TITLE, bullets
from stiction.reports.paper import latex
from stiction.reports.paper.methods import methods
from stiction.reports.presentations import presentations
from stiction.reports.run_folder.overwriting import PROVENANCE, run_folder
from stiction.reports.run_folder.reproduce import FOLDER as REPRODUCE
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import key_of, resolve

MAIN = "paper.pdf"
AUTHORS = ("the stiction authors",)
"""As in ``CITATION.cff``: those of what wrote it, where nobody else is named."""
TRACING = (
    "The last column of a table is a key. Its letter names a table of the run's data, its numbers the rows, from 1: A12 is row 12 of "
    "data/accuracy.csv, J16-30 are rows 16 to 30 of data/torque.csv, which the numbers here sum up. The command \"stiction trace "
    "RUN KEY\" prints the rows in full precision, the files of trajectories and truth, the settings of the engine, versions and "
    "machine; trace.csv has the same for all keys. Tables with every row of the data are in the folder tables.",)


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

    results = run.validation()
    said, texts = presentations(results), methods(run, results)
    views = [view for presentation in said.values() for view in presentation.tables]
    templates = files("stiction.reports.paper")
    with run_folder(folder, MAIN, run.folder) as partial:
        for name in ("figures", "tables"):
            (partial / name).mkdir()
        with rc(column):
            figures = list(drawn([each for presentation in said.values() for each in presentation.figures], results))
        save_all(figures, partial / "figures", column, ("pdf",))
        for view in views:
            (partial / "tables" / f"{view.name}.tex").write_text(latex.table(view, keys(view)), encoding="utf-8")
            view.frame.assign(key=keys(view)).to_csv(partial / "tables" / f"{view.name}.csv", index=False)
        trace_table(run, views).to_csv(partial / "trace.csv", index=False)
        (partial / "methods.tex").write_text(latex.paragraphs(texts), encoding="utf-8")
        summary, drawings = summarized(results, said), {drawing.name: drawing for drawing in figures}
        (partial / "paper.tex").write_text(_main(run, summary, said, drawings, authors, column), encoding="utf-8")
        content = _content(run, summary, texts, said, authors, column)
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


def keys(view: TableView) -> list[str]:
    """The key of each row of a table."""
    return [key_of(view.source, rows) for rows in view.rows]


def trace_table(run: StoredRun, views: Sequence[TableView]) -> pd.DataFrame:
    """One row per key of the tables: the file of the table, the rows of the data behind it, its runs, files, settings and version."""
    rows = []
    for view in views:
        for key in keys(view):
            source = resolve(run, key)
            about = {name: "; ".join(map(str, dict.fromkeys(source.rows[name].dropna()))) if name in source.rows else ""
                     for name in ("key", "engine", "version", "settings")}
            rows.append({"key": key, "table": f"tables/{view.name}.tex", "data": source.place, "runs": about.pop("key"), **about, "files": "; ".join(source.files)})
    return pd.DataFrame(rows)


def summarized(results: Results, said: Mapping[Study, Presentation]) -> list[str]:
    """What page one says, each sentence with the keys of the rows that its numbers are from."""
    lines = [_with_keys("", part) for part in recommendation(results)]
    return [*lines, *(_with_keys(f"**{title}.** ", answer) for title, answer in bullets(said))]


def _with_keys(title: str, part: TracedText) -> str:
    rows: dict[str, set[int]] = {}
    for number in part.numbers:
        if number.rows:
            rows.setdefault(number.table, set()).update(number.rows)
    found = ", ".join(key_of(table, places) for table, places in rows.items())
    return f"{title}{part.text}" + (f" ({found})" if found else "")


def _words(said: Presentation) -> str:
    """Answer and findings of a study, and references to its figures and tables."""
    figures = [f"[#fig:{figure.name}]" for figure in said.figures]
    tables = [f"[#tab:{view.name}]" for view in said.tables if view.in_report]
    places = [f"{word}{'s' if len(names) > 1 else ''} {', '.join(names)}" for word, names in (("Fig", figures), ("Table", tables)) if names]
    references = f"See {' and '.join(places)}." if places else ""
    return " ".join(filter(None, (*(part.text for part in (said.answer, *said.findings)), references, *said.notes)))


def _main(run: StoredRun, summary: Sequence[str], said: Mapping[Study, Presentation], drawings: Mapping[str, Drawing], authors: Sequence[str], column: str) -> str:
    sections = [latex.section(study.question, _words(each), [drawings[figure.name] for figure in each.figures],
                              [view for view in each.tables if view.in_report], column == "double") for study, each in said.items()]
    return latex.PAPER % {
        "title": latex.escape(TITLE), "authors": latex.escape(" and ".join(authors)).replace(" and ", r" \and "), "date": run.origin["date"][:10],
        "results": latex.results(summary), "tracing": latex.paragraphs(TRACING), "sections": "\n".join(sections)}


def _content(run: StoredRun, summary: Sequence[str], texts: Sequence[str], said: Mapping[Study, Presentation], authors: Sequence[str],
             column: str) -> dict[str, Any]:
    """What ``paper.typ`` sets."""
    when = datetime.fromisoformat(run.origin["date"])
    sections = [{"title": study.question, "text": latex.quoted(_words(each)),
                 "figures": [{"name": figure.name, "caption": latex.quoted(figure.caption)} for figure in each.figures],
                 "tables": [_table(view) for view in each.tables if view.in_report]} for study, each in said.items()]
    return {"title": TITLE, "authors": list(authors), "origin": f"stiction {run.origin['versions']['stiction']}, run of {when:%Y-%m-%d %H:%M} UTC",
            "software": f"Made by stiction from the run of {run.origin['date']}",
            "date": {name: getattr(when, name) for name in ("year", "month", "day", "hour", "minute", "second")},
            "columns": 1 if column == "double" else 2, "summary": _quoted(summary), "methods": _quoted(texts), "tracing": _quoted(TRACING), "sections": sections}


def _quoted(texts: Sequence[str]) -> list[str]:
    return [latex.quoted(text) for text in texts]


def _table(view: TableView) -> dict[str, Any]:
    layout = latex.laid_out(view, keys(view))
    return {"name": view.name, "caption": latex.quoted(view.caption), "head": layout.heads, "right": layout.right, "wide": layout.wide,
            "rows": [_quoted(row) for row in layout.rows]}
