"""The page of a run: page one, its time series to zoom into, and the sections of the studies, closed at first."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import escape
from pathlib import Path

from stiction.comparisons.bench.presentation import TableView
from stiction.reports.page.document import chart, details, document, markdown, table
from stiction.reports.page.time_series import time_series
from stiction.reports.page_one import TITLE, answers, headline_table, page_one
from stiction.reports.report import Report, report_of
from stiction.reports.run_folder.provenance import commit_in_words
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import Source, keys, sources_of
from stiction.scenes import InputError
from stiction.scenes.atomic_files import write_text
from stiction.scenes.pictures.web import compressed

HINT = (
    "The pointer moves the time, and the mechanism follows. Drag to zoom, double-click to reset; with the keyboard "
    "+, - and 0. Grey: stick phases of the truth. A difference is that of two samples of one time, from the truth "
    "of the physics that the run has; none is drawn where it is zero."
)


def write_run_page(run: StoredRun, file: Path) -> None:
    """Write the page; the same run gives the same bytes."""
    report = report_of(run.validation())
    sections = {"Answer": list(_page_one(report))}
    if views := list(time_series(report.results)):
        sections["Time series"] = [chart("time-series", ("Scene",), views, HINT)]
    for study, said in report.sections.items():
        blocks = [
            *map(markdown, said.findings),
            markdown("\n".join(f"- {note}" for note in said.notes)),
            *(_figure(run, figure.name, figure.caption) for figure in said.figures),
            *map(_table, said.tables),
        ]
        sections[study.question] = [details(said.answer or study.question, "\n".join(blocks))]
    sources = {key: source for view in report.tables for key, source in sources_of(run, view)}
    sections["Where numbers come from"] = [
        details(
            "Every key of the tables",
            "".join(_origin_of(key, source) for key, source in sources.items()),
        )
    ]
    origin = [
        ("date", run.origin["date"]),
        *(
            (f"{part}: {name}", str(value))
            for part in ("versions", "engines", "machine", "campaign", "choices")
            for name, value in run.origin[part].items()
        ),
        ("commit", commit_in_words(run.origin)),
    ]
    sections["Provenance"] = [
        table("Provenance of the run.", ("what", "value"), origin, (False, False))
    ]
    subtitle = f"stiction {run.origin['versions']['stiction']}, run of {run.origin['date']}"
    write_text(file, document(TITLE, subtitle, sections))


def _page_one(report: Report) -> Iterator[str]:
    page = page_one(report)
    yield markdown(page.mechanism)
    yield from map(markdown, page.recommendation)
    headlines = headline_table(report)
    if headlines.groups:
        rows = [[text.strip("*") for text in row] for row in headlines.rows]
        yield table(page.how_to_read, headlines.heads, rows, headlines.right)
    yield markdown("\n".join(f"- **{title}.** {answer}" for title, answer in answers(report)))
    yield markdown(page.not_installed)


def _figure(run: StoredRun, name: str, caption: str) -> str:
    """The SVG of the run folder, compressed, as ``page.js`` shows it."""
    path = run.folder / "figures" / f"{name}.svg"
    if not path.is_file():
        raise InputError(
            f"{path}: not part of this folder; expected a run folder of this version of `stiction "
            "validate`"
        )
    return (
        f'<figure><div class="picture" tabindex="0" role="region" aria-label="{escape(name)}">'
        f'<img alt="{escape(caption)}" decoding="async" data-svg="{compressed(path.read_bytes())}"></div>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _table(view: TableView) -> str:
    """All rows and columns; the last cell of a row links to where its numbers come from."""
    cells = [[*row, key] for row, key in zip(view.cells(), keys(view), strict=True)]
    links = [f"#{_anchor(key)}" for key in keys(view)]
    return table(view.caption, [*view.heads(), "key"], cells, [*view.right(), False], links)


def _anchor(key: str) -> str:
    return f"key-{re.sub(r'[^A-Za-z0-9]+', '-', key)}"


def _origin_of(key: str, source: Source) -> str:
    """The rows of the data and the files behind a key, in brief, or the runs where no trajectory is stored."""
    runs = source.rows["key"].dropna() if "key" in source.rows and not source.files else ()
    about = "; ".join([source.place, *source.files, *dict.fromkeys(runs)])
    return f'<p id="{_anchor(key)}"><strong>{escape(key)}</strong>: {escape(about)}</p>\n'
