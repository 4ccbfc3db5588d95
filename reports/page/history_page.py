"""The web page of a history of nightly runs: charts of all numbers, the verdicts, and the failures."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

import pandas as pd

from stiction.comparisons.bench.presentation.cells import MISSING, is_missing
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.regression.night_changes import short_commit
from stiction.engines.status import Status
from stiction.reports.page.document import (
    Abbreviation,
    Cell,
    Link,
    View,
    chart,
    document,
    link,
    markdown,
    table,
)
from stiction.reports.page.night_charts import CHART_HELP, CHART_LEGEND, night_views
from stiction.reports.page.nights import (
    HAS_FAILED,
    IS_REFUSED,
    VERDICTS,
    Nights,
    read_nights,
    status_in_words,
)
from stiction.scenes.atomic_files import write_text

MAX_FAILURES = 200
"""Largest number of rows in the table of failures, which begins with the latest."""


def write_history_page(history: Path, file: Path) -> None:
    """Write the page of a history; the same history gives the same bytes.

    The summaries and regressions of the nights are read from their folders beside the history.

    Raises
    ------
    HistoryRefused
        If `history` is not a history.
    """
    nights = read_nights(history)
    sections = history_sections(nights, file)
    write_text(file, document("History of the nights", extent_of(nights), sections.items()))


def extent_of(nights: Nights) -> str:
    """Return the number of nights, and the number of runs of the whole history, as text."""
    number_of_nights = _count(len(nights.names), "night")
    return f"{number_of_nights}, {_count(nights.rows['key'].nunique(), 'run')} each at most"


def history_sections(nights: Nights, file: Path) -> dict[str, list[str]]:
    """Return the sections of the page of a history: heading, and blocks of HTML with links relative to `file`."""
    sections: dict[str, list[str]] = {}
    if nights.names:
        sections["The newest night"] = _newest_night(nights, file)
    if nights.rows["value"].notna().any():
        sections["Course over the nights"] = _course(nights)
    sections["Nights"] = [_table_of_nights(nights, file)]
    failures = _failures(nights.rows)
    if failures:
        sections["What failed"] = failures
    refused = nights.rows[nights.rows[IS_REFUSED]]
    if not refused.empty:
        sections["Not applicable"] = [not_applicable_table(refused)]
    return sections


def _count(number: int, word: str) -> str:
    """Return a number with a word in the singular or plural, such as ``2 nights``."""
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _newest_night(nights: Nights, file: Path) -> list[str]:
    """Return the HTML of the summary of the newest night, and of a link to its report."""
    night = nights.names[-1]
    lines = nights.folders[night].lines
    if not lines:
        verdict = nights.table["verdict"].iloc[-1]
        changes = nights.changes[night]
        lines = (
            f"**{'not finished' if is_missing(verdict) else VERDICTS.get(verdict, verdict)}**",
            f"Environment: since the night before: {changes or 'there is none'}",
        )
    blocks = [markdown(night), markdown("\n".join(f"- {line}" for line in lines))]
    report = nights.folders[night].report
    if report is not None:
        blocks.append(link("Report of this night", _relative_link(report, file)))
    return blocks


def _relative_link(target: Path, page: Path) -> str:
    """Return a link from a page to a file."""
    path = os.path.relpath(target.absolute(), page.absolute().parent)
    return quote(Path(path).as_posix())


def _course(nights: Nights) -> list[str]:
    """Return the HTML of the chart of all numbers; it shows the worst finding of the newest night at first."""
    views = night_views(nights, nights.rows)
    worst = nights.folders[nights.names[-1]].worst
    if worst is not None:
        views = _with_worst_first(views, worst, nights.rows)
    return [markdown(CHART_LEGEND), chart("course", ("Metric", "Scene"), views, CHART_HELP)]


def _with_worst_first(
    views: Sequence[View], worst: tuple[str, str], rows: pd.DataFrame
) -> list[View]:
    """Return the views with those of the worst finding first: metric and scene, metric, scene, others.

    A finding about a whole run has no metric; then the views of its scene come first.
    """
    metric, key = worst
    head = quantity_of(metric).head
    scenes = rows.loc[rows["key"] == key, "scene"].head(1).to_list()

    def rank(view: View) -> tuple[bool, bool]:
        """Return a key for sorting; False precedes True."""
        view_metric, view_scene = view.labels
        has_other_metric = metric != "" and view_metric != head
        return has_other_metric, view_scene not in scenes

    return sorted(views, key=rank)


def _table_of_nights(nights: Nights, file: Path) -> str:
    """Return the HTML of the table of nights, the latest first, with links to their reports."""
    runs = nights.rows.drop_duplicates(["night", "key"]).groupby("night")
    failed = runs[HAS_FAILED].sum()
    refused = runs[IS_REFUSED].sum()
    table_rows = nights.table.fillna(MISSING).iloc[::-1].copy()
    names = list(table_rows["night"])
    table_rows["verdict"] = table_rows["verdict"].replace(VERDICTS)
    table_rows["worst finding"] = [nights.folders[night].worst_in_words for night in names]
    table_rows["changed since the night before"] = [nights.changes[night] for night in names]
    counts = {
        "runs": runs.size(),
        "complete": runs.size() - failed - refused,
        "not applicable": refused,
        "failed": failed,
    }
    for column, count in counts.items():
        table_rows[column] = table_rows["night"].map(count).fillna(0).astype(int).map(str)
    rows: list[list[Cell]] = []
    for record in table_rows.to_dict("records"):
        name, commit = str(record["night"]), str(record["commit_hash"])
        report = nights.folders[name].report
        cells: dict[str, Cell] = {str(column): str(value) for column, value in record.items()}
        if report is not None:
            cells["night"] = Link(name, _relative_link(report, file))
        if commit != MISSING:
            cells["commit_hash"] = Abbreviation(short_commit(commit), commit)
        rows.append(list(cells.values()))
    return table(
        "The nights, the latest first, each with a link to its report. Complete: runs that reached their end; not "
        "applicable: the engine or its adapter cannot represent the scene; failed: all others, among them those of "
        "engines that are not installed.",
        ["commit" if column == "commit_hash" else column for column in table_rows],
        rows,
        [column in counts for column in table_rows],
    )


def _failures(rows: pd.DataFrame) -> list[str]:
    """Return the HTML of a line with the engines that are not installed, and of a table of failures."""
    runs = rows.drop_duplicates(["night", "key"])
    blocks = []
    missing = runs[runs["status"] == Status.MISSING]
    if not missing.empty:
        engines = [
            f"{engine} ({_count(part['key'].nunique(), 'run')} a night)"
            for engine, part in missing.groupby("engine", sort=False)
        ]
        blocks.append(
            markdown(f"Engines not available in some of the nights: {', '.join(engines)}.")
        )
    failed = runs[runs[HAS_FAILED] & (runs["status"] != Status.MISSING)]
    if failed.empty:
        return blocks
    # A run that fails for the same reason in several nights has one row, with its latest night.
    table_rows = [
        (
            part["night"].max(),
            str(part["night"].nunique()),
            key,
            status_in_words(status, reason),
            reason,
        )
        for (key, status, reason), part in failed.groupby(["key", "status", "reason"], sort=False)
    ]
    table_rows.sort(key=lambda row: row[0], reverse=True)
    shown_rows = table_rows[:MAX_FAILURES]
    caption = (
        f"{len(failed)} failures of {len(table_rows)} kinds, the latest {len(shown_rows)} of these; "
        "the first column has the latest night of each."
    )
    heads = ["night", "nights", "key", "status", "reason"]
    blocks.append(table(caption, heads, shown_rows, [False, True, False, False, False]))
    return blocks


def not_applicable_table(refused: pd.DataFrame) -> str:
    """Return the HTML of the table of runs that were refused, one row for each reason.

    `refused` has rows of the history; a run that was refused in several nights is counted once.
    """
    runs = refused.drop_duplicates("key")
    rows = [
        [
            str(reason),
            "; ".join(dict.fromkeys(part["variant"])),
            "; ".join(dict.fromkeys(part["scene"])),
            str(len(part)),
        ]
        for reason, part in runs.groupby("reason", sort=False)
    ]
    caption = (
        "Runs that the engine or its adapter refuses, because it cannot represent the scene. "
        "They are no failures."
    )
    return table(
        caption, ("reason", "methods", "scenes", "runs"), rows, (False, False, False, True)
    )
