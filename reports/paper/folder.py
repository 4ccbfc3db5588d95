"""Writes the folder of a paper; the same run gives the same bytes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd

from stiction.reports.figures import Drawing, drawings, save_all
from stiction.reports.figures.style import rc
from stiction.reports.markdown.findings import lines
from stiction.reports.paper import latex
from stiction.reports.paper.methods import methods
from stiction.reports.paper.sheets import KEY, Sheet, sheets
from stiction.reports.run_folder.overwriting import PROVENANCE, run_folder
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import resolve

MAIN = "paper.pdf"
TITLE = "Validation of solvers for mechanisms with dry friction in sliding joints"
TRACING = (
    "The last column of a table is a key. Its letter names a table of the run's data, its number the row, from 1: A12 is row 12 of "
    "data/accuracy.csv, J16-30 are rows 16 to 30 of data/torque.csv, which the numbers here sum up. The command \"stiction trace "
    "RUN KEY\" prints the row in full precision, the files of its trajectories and of the truth, the settings of the engine, versions and "
    "machine; trace.csv has the same for all keys. A threshold sums up runs of which only their number is kept.",)


def write_paper(run: StoredRun, folder: str | Path, column: str = "double") -> Path:
    """Write what an author needs of a run.

    ``figures/*.pdf``, ``tables/*.tex`` and ``*.csv``, ``methods.tex``, ``references.bib``, ``paper.tex`` with all of it and the captions,
    ``trace.csv``; ``paper.pdf`` with its source for Typst, ``paper.typ`` and ``paper.json``; ``provenance.json`` of the run. The folder
    appears complete or not at all.

    Parameters
    ----------
    column : {"double", "single"}
        Width of the figures, see `stiction.reports.figures.style.COLUMNS`.

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
        (partial / "paper.tex").write_text(_main(run, tables, figures, column), encoding="utf-8")
        content = _content(run, lines(validation), texts, tables, figures, column)
        (partial / "paper.json").write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        for name in ("paper.typ", "references.bib"):
            (partial / name).write_bytes((templates / name).read_bytes())
        (partial / MAIN).write_bytes(typst.compile(str(partial / "paper.typ"), root=str(partial), ignore_system_fonts=True))
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


def _main(run: StoredRun, tables: Sequence[Sheet], figures: Sequence[Drawing], column: str) -> str:
    return latex.PAPER % {"title": TITLE, "date": run.origin["date"][:10],
                          "figures": "\n".join(latex.figure(drawing, column == "double") for drawing in figures),
                          "tables": "\n".join(rf"\input{{tables/{sheet.name}}}" for sheet in tables)}


def _content(run: StoredRun, lines: Sequence[str], texts: Sequence[str], tables: Sequence[Sheet], figures: Sequence[Drawing], column: str,
             ) -> dict[str, Any]:
    """What ``paper.typ`` sets."""
    when = datetime.fromisoformat(run.origin["date"])
    return {"title": TITLE, "origin": f"stiction {run.origin['versions']['stiction']}, run of {when:%Y-%m-%d %H:%M} UTC",
            "software": f"Made by stiction from the run of {run.origin['date']}",
            "date": {name: getattr(when, name) for name in ("year", "month", "day", "hour", "minute", "second")},
            "columns": 1 if column == "double" else 2, "summary": list(lines), "methods": list(texts), "tracing": list(TRACING),
            "figures": [{"name": drawing.name, "caption": drawing.caption} for drawing in figures],
            "tables": [{"name": sheet.name, "caption": sheet.caption, "head": sheet.heads(), "right": sheet.right(),
                        "shares": latex.widths(sheet), "rows": sheet.cells()} for sheet in tables]}
