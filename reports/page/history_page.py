"""The web page of a history of nightly runs: charts of all numbers, the verdicts, and the failures."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd

from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.regression.check import BETTER, COULD_NOT_RUN, REGRESSION
from stiction.comparisons.regression.history import NO_DRAW, History, open_history
from stiction.comparisons.regression.night_changes import environment_changes
from stiction.engines.status import Status
from stiction.reports.markdown.regression_report import REPORT, SUMMARY
from stiction.reports.page.document import View, chart, document, link, markdown, table
from stiction.scenes.atomic_files import write_text
from stiction.scenes.pictures.picture import CYCLE
from stiction.scenes.pictures.web import LONG, Columns

COLORS = ("ink", *CYCLE[1:])
"""Colours of variants, which are used again if there are more; the page defines ``ink`` for light and dark mode."""
DASHES = ((), (6, 3), (2, 3), (8, 3, 2, 3), (14, 4), (14, 4, 2, 4))
"""Dashes of the step sizes or tolerances of a variant, px; used again if there are more."""
CHART_HELP = "Drag to zoom, double-click to reset; with the keyboard +, - and 0."
"""How to use the chart."""
MAX_FAILURES = 200
"""Largest number of rows in the table of failures, which begins with the latest."""
SHOWN_SEVERITIES = (REGRESSION, COULD_NOT_RUN, BETTER)
"""Severities of the findings for which the page selects a chart at first."""
LOGARITHMIC_KINDS = ("accuracy", "drift", "time")
"""Kinds of metrics that are drawn on logarithmic axes if all values are positive."""
RANGE_MARGIN = 0.05
"""Distance of the values from the ends of an axis, as a fraction of their range."""
CONSTANT_MARGIN = 0.5
"""The same for values that are all equal, in the unit of the axis."""
HAS_FAILED = "has_failed"
"""Column that this module adds to the rows of the history: whether the run failed or ended early."""
NO_VALUE = "–"
"""Text of a cell without a value."""


@dataclass(frozen=True)
class _Night:
    """Content of the folder of a night, which `stiction.reports.markdown.regression_report` has written.

    All of it is empty if there is no such folder beside the history.

    Attributes
    ----------
    lines : tuple of str
        The summary, in Markdown.
    worst : (str, str) or None
        Metric and key of the worst finding; the metric is empty if the finding is about the whole run.
    worst_in_words : str
        The worst finding as text.
    regressions : frozenset of (str, str)
        Metric and key of each regression.
    report : Path or None
        The report of the night.
    """

    lines: tuple[str, ...] = ()
    worst: tuple[str, str] | None = None
    worst_in_words: str = ""
    regressions: frozenset[tuple[str, str]] = frozenset()
    report: Path | None = None


def write_history_page(history: Path, file: Path) -> None:
    """Write the page of a history; the same history gives the same bytes.

    The summaries and regressions of the nights are read from their folders beside the history.

    Raises
    ------
    HistoryRefused
        If `history` is not a history.
    """
    with open_history(history, write=False) as opened:
        nights = pd.read_sql(
            "SELECT night, campaign, machine, commit_hash, finished, verdict FROM nights "
            "ORDER BY night",
            opened.connection,
        )
        rows = pd.read_sql(f"SELECT * FROM history WHERE {NO_DRAW}", opened.connection)
        names = list(nights["night"])
        changes = _changes(opened, names)
    rows[HAS_FAILED] = (rows["status"] != Status.OK) | (rows["reason"] != "")
    folders = {night: _read_night(history.parent / night.replace(":", "")) for night in names}
    sections: dict[str, list[str]] = {}
    if names:
        newest = names[-1]
        verdict = nights["verdict"].iloc[-1]
        sections["The newest night"] = _newest_night(
            newest, verdict, folders[newest], changes[newest], file
        )
    if rows["value"].notna().any():
        sections["Course over the nights"] = _course(rows, nights, folders)
    sections["Nights"] = [_table_of_nights(rows, nights, changes, folders, file)]
    failures = _failures(rows)
    if failures:
        sections["What failed"] = failures
    counts = f"{_count(len(nights), 'night')}, {_count(rows['key'].nunique(), 'run')} each at most"
    write_text(file, document("History of the nights", counts, sections.items()))


def _count(number: int, word: str) -> str:
    """Return a number with a word in the singular or plural, such as ``2 nights``."""
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _read_night(folder: Path) -> _Night:
    """Read the folder of a night; if it does not exist, the result is empty."""
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return _Night()
    findings = [
        finding for finding in summary["findings"] if finding["severity"] in SHOWN_SEVERITIES
    ]
    regressions = frozenset(
        (finding["metric"], finding["key"])
        for finding in findings
        if finding["severity"] == REGRESSION
    )
    worst = None
    worst_in_words = ""
    if findings:
        # Findings are sorted by severity, the worst first.
        metric, key, kind = (findings[0][name] for name in ("metric", "key", "kind"))
        worst = (metric, key)
        subject = quantity_of(metric).head if metric else kind
        worst_in_words = " of ".join(part for part in (subject, key) if part)
    lines = tuple(summary.get("lines", ()))
    return _Night(lines, worst, worst_in_words, regressions, folder / REPORT)


def _changes(history: History, nights: Sequence[str]) -> dict[str, str]:
    """Return for each night what has changed in the environment since the night before."""
    changes = dict.fromkeys(nights, "")
    for before, night in pairwise(nights):
        parts = environment_changes(
            history.origin(before),
            history.origin(night),
            history.engines(before),
            history.engines(night),
        )
        changes[night] = "; ".join(parts) or "nothing"
    return changes


def _newest_night(
    night: str, verdict: str | None, folder: _Night, changes: str, file: Path
) -> list[str]:
    """Return the HTML of the summary of the newest night, and of a link to its report.

    Parameters
    ----------
    night, verdict : str
        Name and verdict of the night; the verdict is None if the night is not finished.
    folder : _Night
        The content of its folder.
    changes : str
        What has changed since the night before.
    file : Path
        The page.
    """
    lines = folder.lines
    if not lines:
        lines = (
            f"**{verdict or 'not finished'}**",
            f"Environment: since the night before: {changes or 'there is none'}",
        )
    blocks = [markdown(night), markdown("\n".join(f"- {line}" for line in lines))]
    if folder.report is not None:
        blocks.append(link("Report of this night", _relative_link(folder.report, file)))
    return blocks


def _relative_link(target: Path, page: Path) -> str:
    """Return a link from a page to a file."""
    path = os.path.relpath(target.absolute(), page.absolute().parent)
    return quote(Path(path).as_posix())


def _course(rows: pd.DataFrame, nights: pd.DataFrame, folders: Mapping[str, _Night]) -> list[str]:
    """Return the HTML of the chart of all numbers; it shows the worst finding of the newest night at first."""
    names = list(nights["night"])
    commits = (
        rows.dropna(subset="commit_hash").drop_duplicates("night").set_index("night")["commit_hash"]
    )
    notes = [f"commit {commit}" for commit in commits.reindex(names).fillna(NO_VALUE)]
    measured = rows[rows["value"].notna()]
    views = [
        _view(str(metric), str(scene), part, names, notes, folders)
        for (metric, scene), part in measured.groupby(["metric", "scene"], sort=False)
    ]
    worst = folders[names[-1]].worst
    if worst is not None:
        views = _with_worst_first(views, worst, rows)
    return [
        markdown(
            "One line per variant and step size or tolerance; a red ring is a regression. Errors, drift and "
            "times are drawn in logarithms where all are > 0; a gap is a night in which the run failed. "
            "Times of different machines are different lines."
        ),
        chart("course", ("Metric", "Scene"), views, CHART_HELP),
    ]


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


def _table_of_nights(
    rows: pd.DataFrame,
    nights: pd.DataFrame,
    changes: Mapping[str, str],
    folders: Mapping[str, _Night],
    file: Path,
) -> str:
    """Return the HTML of the table of nights, the latest first, with links to their reports."""
    failed = rows.drop_duplicates(["night", "key"]).groupby("night")[HAS_FAILED]
    table_rows = nights.fillna(NO_VALUE).iloc[::-1].copy()
    names = list(table_rows["night"])
    table_rows["worst finding"] = [folders[night].worst_in_words for night in names]
    table_rows["changed since the night before"] = [changes[night] for night in names]
    counts = {"runs": failed.size(), "whole": failed.size() - failed.sum()}
    for column, count in counts.items():
        table_rows[column] = table_rows["night"].map(count).fillna(0).astype(int).map(str)
    links = []
    for night in names:
        report = folders[night].report
        links.append("" if report is None else _relative_link(report, file))
    return table(
        "The nights, the latest first, each with a link to its report; whole: runs that succeeded and reached "
        "their end.",
        list(table_rows),
        table_rows.itertuples(index=False),
        [column in counts for column in table_rows],
        links,
        linked_column=0,
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
        (part["night"].max(), str(part["night"].nunique()), *names)
        for names, part in failed.groupby(["key", "status", "reason"], sort=False)
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


def _short_names(nights: Sequence[str]) -> list[str]:
    """Return names of nights for an axis: the day, or day and time if a day has several nights.

    The name of a night is a time in the format of ISO 8601. Seconds are shown if necessary.
    """
    days = Counter(night[:10] for night in nights)
    minutes = Counter(night[:16] for night in nights)
    names = []
    for night in nights:
        if days[night[:10]] == 1:
            names.append(night[:10])
        elif minutes[night[:16]] == 1:
            names.append(f"{night[5:10]} {night[11:16]}")
        else:
            names.append(f"{night[5:10]} {night[11:23]}")
    return names


def _view(
    metric: str,
    scene: str,
    rows: pd.DataFrame,
    nights: list[str],
    notes: list[str],
    folders: Mapping[str, _Night],
) -> View:
    """Return the view of a metric on a scene, with one line for each run of a variant.

    Parameters
    ----------
    rows : DataFrame
        The values of the metric on this scene in all nights.
    nights, notes : list of str
        Names of the nights, and a note about each.
    folders : mapping
        Content of the folder of each night.
    """
    head = quantity_of(metric).head
    columns = Columns()
    x_column = columns.add(np.arange(len(nights)), LONG)
    is_time = bool((rows["kind"] == "time").all())
    is_logarithmic = bool((rows["value"] > 0).all()) and rows["kind"].iloc[0] in LOGARITHMIC_KINDS
    names_machine = is_time and rows["machine"].nunique() > 1
    series = []
    ends: list[float] = []
    for line in _lines(rows, is_time):
        first_row = line.rows.iloc[0]
        course = line.rows.set_index("night").reindex(nights)
        values = course["value"].to_numpy(float)
        uncertainties = course["uncertainty"].to_numpy(float)
        if is_logarithmic:
            # The uncertainty of log10(v) is du / (v ln 10).
            uncertainties = uncertainties / (values * np.log(10))
            values = np.log10(values)
        ends += [np.nanmin(values), np.nanmax(values)]
        name = line.variant
        if line.variant != "truth":
            name += f" ({setting_of(first_row['parameter'], first_row['step'])})"
        if names_machine:
            name += f", {first_row['machine']}"
        series.append(
            {
                "name": name,
                "color": COLORS[line.variant_number % len(COLORS)],
                "about": line.key,
                "dash": DASHES[line.step_number % len(DASHES)],
                "marker": True,
                "shown": True,
                "flags": _nights_with_regression(metric, line.key, nights, folders),
                "x": [x_column],
                "y": [[columns.add(values, LONG)]],
                # Error bars are drawn for times, which scatter; other numbers are reproducible.
                "error": [[columns.add(uncertainties)]] if is_time else None,
            }
        )
    panel = {"label": head, "log": is_logarithmic, "range": _range_with_margin(ends)}
    content = {
        "x": {
            "label": "night",
            # Nights are numbered; the range leaves room for markers at its ends.
            "range": [-0.3, len(nights) - 0.7],
            "names": nights,
            "short": _short_names(nights),
            "notes": notes,
        },
        "series": series,
        "shades": [],
        "modes": [{"name": head, "digits": 6, "panels": [panel]}],
    }
    return View((head, scene), content, columns)


def _range_with_margin(ends: Sequence[float]) -> list[float]:
    """Return the range of an axis that contains some values, with a margin on both sides."""
    low = min(ends)
    high = max(ends)
    margin = RANGE_MARGIN * (high - low) or CONSTANT_MARGIN
    return [low - margin, high + margin]


@dataclass(frozen=True, eq=False)
class _HistoryLine:
    """A line of a chart: the values of a run in all nights.

    Attributes
    ----------
    variant, key : str
        The variant and the key of the run.
    variant_number, step_number : int
        Numbers of the variant in the chart and of the step size in the variant, from 0.
    rows : DataFrame
        The values, a row for each night.
    """

    variant: str
    key: str
    variant_number: int
    step_number: int
    rows: pd.DataFrame


def _lines(rows: pd.DataFrame, is_time: bool) -> Iterator[_HistoryLine]:
    """Yield the lines of a chart. Times that were measured on different machines are different lines."""
    keys: list[Hashable] = ["key", "machine"] if is_time else ["key"]
    for variant_number, (variant, variant_rows) in enumerate(rows.groupby("variant", sort=False)):
        steps = list(dict.fromkeys(variant_rows["step"]))
        for (key, *_), line_rows in variant_rows.groupby(keys, sort=False):
            step_number = steps.index(line_rows["step"].iloc[0])
            yield _HistoryLine(str(variant), key, variant_number, step_number, line_rows)


def _nights_with_regression(
    metric: str, key: str, nights: Sequence[str], folders: Mapping[str, _Night]
) -> list[int]:
    """Return the numbers of the nights in which a metric of a run, or the whole run, has regressed."""
    subjects = {(metric, key), ("", key)}
    return [number for number, night in enumerate(nights) if subjects & folders[night].regressions]
