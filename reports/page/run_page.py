"""The web page of a run: page one, its time series, the sections of the studies, and the origin of all numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from html import escape
from pathlib import Path

import pandas as pd

from stiction.comparisons.bench.presentation import TableView
from stiction.comparisons.bench.presentation.cells import AGAIN
from stiction.reports.page.document import (
    Cell,
    Link,
    anchor_of,
    chart,
    details,
    document,
    markdown,
    table,
)
from stiction.reports.page.time_series import time_series
from stiction.reports.page_one import INTERRUPTED, answers, headline_table, page_one, title_of
from stiction.reports.report import Report, report_of
from stiction.reports.run_folder.provenance import commit_in_words
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import Source, keys, sources_of
from stiction.reports.text import Section
from stiction.scenes import InputError
from stiction.scenes.atomic_files import write_text
from stiction.scenes.pictures.web import compressed

TIME_SERIES_HELP = (
    "Move the pointer over the chart to choose a time, at which the mechanism is shown. Drag to zoom and double-click "
    "to reset; with the keyboard, use +, - and 0. Grey: stick phases of the truth. Differences are those from the "
    "truth with the same coefficients of friction at the same time; differences of zero are not drawn."
)
"""How to use the chart of the time series."""


MAX_COMMANDS = 5
"""Largest number of commands that are listed for a key; a row may summarize many runs."""


def write_run_page(run: StoredRun, file: Path) -> None:
    """Write the page of a run; the same run gives the same bytes.

    Raises
    ------
    InputError
        If the run folder lacks the picture of a figure.
    """
    report = report_of(run.validation())
    sections = run_sections(run, report)
    write_text(file, document(title_of(report.results), run_line(run), sections))


def run_line(run: StoredRun) -> str:
    """Return the version of stiction and the date of a run as text."""
    return f"stiction {run.origin['versions']['stiction']}, run of {run.origin['date']}"


def run_sections(
    run: StoredRun, report: Report, files_note: str = ""
) -> Iterator[tuple[str, list[str]]]:
    """Yield the heading of each section of the page, and its blocks of HTML.

    `files_note` is that of `origin_paragraphs`.
    """
    yield "Answer", list(answer_blocks(report))
    views = list(time_series(report.results))
    if views:
        yield "Time series", [chart("time-series", ("Scene",), views, TIME_SERIES_HELP)]
    # The sections of the studies are closed at first.
    for study, section in report.sections.items():
        content = "\n".join(section_blocks(run, section))
        yield study.question, [details(section.answer or study.question, content)]
    origins = details(
        "Every key of the tables", "".join(origin_paragraphs(run, report.tables, files_note))
    )
    yield "Where numbers come from", [origins]
    rows = list(provenance_rows(run))
    yield "Provenance", [table("Provenance of the run.", ("what", "value"), rows, (False, False))]


def answer_blocks(report: Report) -> Iterator[str]:
    """Yield the HTML of page one: recommendation, table of all methods, answers, and the runs they are based on."""
    page = page_one(report)
    if report.results.settings.get("interrupted"):
        yield markdown(f"**{INTERRUPTED}**")
    yield markdown(page.mechanism)
    for item in page.recommendation:
        yield markdown(item)
    headlines = headline_table(report)
    if headlines.groups:
        yield table(page.how_to_read, headlines.heads, headlines.plain_rows, headlines.right)
    yield markdown("\n".join(f"- **{title}.** {answer}" for title, answer in answers(report)))
    yield markdown(f"{page.runs} {page.not_installed}".strip())
    yield markdown("\n".join(f"- {line}" for line in page.not_applicable))


def section_blocks(run: StoredRun, section: Section) -> Iterator[str]:
    """Yield the HTML of the findings, notes, figures and tables of a section."""
    for finding in section.findings:
        yield markdown(finding)
    yield markdown("\n".join(f"- {note}" for note in section.notes))
    for figure in section.figures:
        yield figure_html(run, figure.name, figure.caption)
    for view in section.tables:
        yield table_html(view)


def figure_html(run: StoredRun, name: str, caption: str) -> str:
    """Return the HTML of a figure: its SVG, compressed, which ``page.js`` shows, and its caption."""
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


def table_html(view: TableView) -> str:
    """Return the HTML of a table with all rows and columns; the last cell of a row links to its origin.

    The rows of each group are below a heading.
    """
    columns = view.shown()
    # The column of the group, if the table has one, is the first.
    is_grouped = bool(columns) and columns[0].name == view.group
    first_column = 1 if is_grouped else 0
    rows: list[list[Cell]] = []
    row_ids = []
    last_group = ""
    for cells, key in zip(view.cells(), keys(view), strict=True):
        if is_grouped and cells[0] != last_group:
            last_group = cells[0]
            rows.append([last_group])
            row_ids.append("")
        rows.append([*cells[first_column:], Link(key, f"#{key_anchor(key)}")])
        row_ids.append(row_anchor(key))
    heads = [*view.heads()[first_column:], "key"]
    right = [*view.right()[first_column:], False]
    return table(view.caption, heads, rows, right, row_ids)


def row_anchor(key: str) -> str:
    """Return the identifier of the row of a table with a key."""
    return f"row-{anchor_of(key)}"


def key_anchor(key: str) -> str:
    """Return the identifier of the paragraph about the origin of a key."""
    return f"key-{anchor_of(key)}"


def origin_paragraphs(
    run: StoredRun, tables: Iterable[TableView], files_note: str = ""
) -> Iterator[str]:
    """Yield a paragraph for each key of the tables: rows of the data, versions, files or runs, and how to repeat them.

    Parameters
    ----------
    run : StoredRun
        The run that contains the data.
    tables : iterable of TableView
        The tables.
    files_note : str
        Where the files of trajectories and truths are found, in parentheses after their names.
    """
    sources = {key: source for view in tables for key, source in sources_of(run, view)}
    commands = _commands_by_run(run)
    for key, source in sources.items():
        origin = escape("; ".join(_origins(run, source, files_note)))
        repeat = _repeat(source, commands, run.origin.get("command", ""))
        yield f'<p id="{key_anchor(key)}"><strong>{escape(key)}</strong>: {origin}{repeat}</p>\n'


def _origins(run: StoredRun, source: Source, files_note: str) -> list[str]:
    """Return the rows of a source, its engines, and its files, or its runs if no trajectory is stored."""
    origins = [source.place]
    if "engine" in source.rows:
        engines = dict.fromkeys(source.rows["engine"].dropna())
        versions = run.origin["engines"]
        origins += [f"engine {name} {versions.get(name, 'of unknown version')}" for name in engines]
    if source.files:
        files = ", ".join(source.files)
        origins.append(f"{files} ({files_note})" if files_note else files)
    elif "key" in source.rows:
        origins += dict.fromkeys(source.rows["key"].dropna())
    return origins


def _commands_by_run(run: StoredRun) -> dict[str, str]:
    """Return the command that repeats a run, by the key of the run; only runs that have a command are included."""
    runs = run.tables.get("runs", pd.DataFrame())
    if not {"key", AGAIN} <= set(runs.columns):
        return {}
    known = runs[runs[AGAIN].notna()]
    return dict(zip(known["key"], known[AGAIN], strict=True))


def _repeat(source: Source, commands: Mapping[str, str], campaign: str) -> str:
    """Return the HTML of the commands that repeat the runs of a source.

    Searches, such as that of a stick limit, and runs of earlier versions have no commands of their own; then it is
    the command of the whole campaign. The text is empty if that is not known either.
    """
    repeated: list[str] = []
    if AGAIN in source.rows:
        repeated += list(source.rows[AGAIN].dropna())
    elif "key" in source.rows:
        repeated += [commands[key] for key in source.rows["key"].dropna() if key in commands]
    shown = list(dict.fromkeys(repeated))
    if not shown:
        return f". Repeat all runs with <code>{escape(campaign)}</code>" if campaign else ""
    lines = "; ".join(f"<code>{escape(command)}</code>" for command in shown[:MAX_COMMANDS])
    more = f"; and {len(shown) - MAX_COMMANDS} more" if len(shown) > MAX_COMMANDS else ""
    return f". Repeat with {lines}{more}"


def provenance_rows(run: StoredRun) -> Iterator[tuple[str, str]]:
    """Yield the entries of the provenance as (name, value)."""
    yield "date", run.origin["date"]
    for part in ("versions", "engines", "machine", "campaign", "choices"):
        for name, value in run.origin[part].items():
            yield f"{part}: {name}", str(value)
    yield "commit", commit_in_words(run.origin)
