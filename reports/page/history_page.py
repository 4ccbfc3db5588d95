"""The page over the history: each number's course over the nights, the nights with their verdicts, and what failed."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
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
"""Colours by variant, the first again after the last."""
DASHES = ((), (6, 3), (2, 3), (8, 3, 2, 3), (14, 4), (14, 4, 2, 4))
"""Dashes of lines, px, by step size or tolerance of a variant."""
HINT = "Drag to zoom, double-click to reset; with the keyboard +, - and 0."
MOST_FAILED = 200
"""Kinds of failures are listed up to this number, the latest first."""
SHOWN_SEVERITIES = (REGRESSION, COULD_NOT_RUN, BETTER)
"""Severities of findings that the page opens on."""


@dataclass(frozen=True)
class _Night:
    """What the folder of a night says, as `stiction.reports.markdown.regression_report` wrote it.

    `regressions` are metric and key of what has become worse, without a metric where the whole run has; `worst` those
    of the worst finding. All of it is empty where there is no such folder beside the history.
    """

    lines: tuple[str, ...] = ()
    worst: tuple[str, str] | None = None
    worst_words: str = ""
    regressions: frozenset[tuple[str, str]] = frozenset()
    report: Path | None = None


def write_history_page(history: Path, file: Path) -> None:
    """Write the page of a history; the same history gives the same bytes. HistoryRefused if `history` is none.

    Verdicts in words and regressions are those of the folders of nights beside the history.
    """
    with open_history(history, write=False) as opened:
        nights = pd.read_sql(
            "SELECT night, campaign, machine, commit_hash, finished, verdict FROM nights "
            "ORDER BY night",
            opened.connection,
        )
        rows = pd.read_sql(f"SELECT * FROM history WHERE {NO_DRAW}", opened.connection)
        names = list(nights["night"])
        changed = _changes(opened, names)
    told = {night: _read(history.parent / night.replace(":", "")) for night in names}
    rows[Status.FAILED] = (rows["status"] != Status.OK) | (rows["reason"] != "")
    sections: dict[str, list[str]] = {}
    if names:
        sections["The newest night"] = _newest(
            names[-1], nights["verdict"].iloc[-1], told[names[-1]], changed[names[-1]], file
        )
    if rows["value"].notna().any():
        sections["Course over the nights"] = _course(rows, nights, told)
    sections["Nights"] = [_nights_table(rows, nights, changed, told, file)]
    if failures := _failures(rows):
        sections["What failed"] = failures
    runs = rows["key"].nunique()
    subtitle = (
        f"{len(nights)} night{'s' * (len(nights) != 1)}, {runs} run{'s' * (runs != 1)} each at most"
    )
    write_text(file, document("History of the nights", subtitle, sections))


def _read(folder: Path) -> _Night:
    """What a night's folder says, if it is there."""
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return _Night()
    shown = [finding for finding in summary["findings"] if finding["severity"] in SHOWN_SEVERITIES]
    worse = frozenset(
        (finding["metric"], finding["key"])
        for finding in shown
        if finding["severity"] == REGRESSION
    )
    worst = (shown[0]["metric"], shown[0]["key"]) if shown else None
    words = ""
    if shown:
        what = quantity_of(shown[0]["metric"]).head if shown[0]["metric"] else shown[0]["kind"]
        words = " of ".join(filter(None, (what, shown[0]["key"])))
    return _Night(tuple(summary.get("lines", ())), worst, words, worse, folder / REPORT)


def _changes(history: History, nights: Sequence[str]) -> dict[str, str]:
    """What changed since the night before, of each night."""
    found = dict.fromkeys(nights, "")
    for before, night in pairwise(nights):
        found[night] = (
            "; ".join(
                environment_changes(
                    history.origin(before),
                    history.origin(night),
                    history.engines(before),
                    history.engines(night),
                )
            )
            or "nothing"
        )
    return found


def _newest(night: str, verdict: str | None, told: _Night, changed: str, file: Path) -> list[str]:
    """What is to be known of the newest night: its five lines, and the way to its report."""
    lines = told.lines or (
        f"**{verdict or 'not finished'}**",
        f"Environment: since the night before: {changed or 'there is none'}",
    )
    blocks = [markdown(night), markdown("\n".join(f"- {line}" for line in lines))]
    if told.report is not None:
        blocks.append(link("Report of this night", _path(told.report, file)))
    return blocks


def _path(target: Path, page: Path) -> str:
    """The way from a page to a file, as a link."""
    return quote(Path(os.path.relpath(target.absolute(), page.absolute().parent)).as_posix())


def _course(rows: pd.DataFrame, nights: pd.DataFrame, told: Mapping[str, _Night]) -> list[str]:
    """The chart of all numbers, what the worst finding of the newest night is about first."""
    names, known = list(nights["night"]), rows[rows["value"].notna()]
    commits = (
        rows.dropna(subset="commit_hash").drop_duplicates("night").set_index("night")["commit_hash"]
    )
    notes = [f"commit {commit}" for commit in commits.reindex(names).fillna("–")]
    views = [
        _view(str(metric), str(scene), part, names, notes, told)
        for (metric, scene), part in known.groupby(["metric", "scene"], sort=False)
    ]
    if (worst := told[names[-1]].worst) is not None:
        metric, key = worst
        shown_as = quantity_of(metric).head
        scene = rows.loc[rows["key"] == key, "scene"].head(1).to_list()

        def distance(view: View) -> int:
            """0 for the view of the worst finding; where it has no metric, for those of its scene."""
            return (view.labels[1] not in scene) + 2 * (metric != "" and view.labels[0] != shown_as)

        views.sort(key=distance)
    return [
        markdown(
            "One line per variant and step size or tolerance; a red ring is a regression. Errors, drift and "
            "times are drawn in logarithms where all are > 0; a gap is a night in which the run failed. "
            "Times of different machines are different lines."
        ),
        chart("course", ("Metric", "Scene"), views, HINT),
    ]


def _nights_table(
    rows: pd.DataFrame,
    nights: pd.DataFrame,
    changed: Mapping[str, str],
    told: Mapping[str, _Night],
    file: Path,
) -> str:
    made = rows.drop_duplicates(["night", "key"]).groupby("night")["failed"]
    shown = nights.fillna("–").iloc[::-1].copy()
    shown["worst finding"] = [told[night].worst_words for night in shown["night"]]
    shown["changed since the night before"] = shown["night"].map(changed)
    counts = {"runs": made.size(), "whole": made.size() - made.sum()}
    for name, count in counts.items():
        shown[name] = shown["night"].map(count).fillna(0).astype(int).map(str)
    reports = [told[night].report for night in shown["night"]]
    links = [_path(report, file) if report is not None else "" for report in reports]
    return table(
        "The nights, the latest first, each with a link to its report; whole: runs that succeeded and reached "
        "their end.",
        list(shown),
        shown.itertuples(index=False),
        [name in counts for name in shown],
        links,
        0,
    )


def _failures(rows: pd.DataFrame) -> list[str]:
    """Engines that are not installed, in a line; runs that failed for a reason, with the nights in which they did."""
    runs = rows.drop_duplicates(["night", "key"])
    absent = runs[runs["status"] == Status.MISSING]
    blocks = []
    if len(absent):
        words = [
            f"{engine} ({part['key'].nunique()} run{'s' * (part['key'].nunique() != 1)} a night)"
            for engine, part in absent.groupby("engine", sort=False)
        ]
        blocks.append(markdown(f"Not installed in some of the nights: {', '.join(words)}."))
    failed = runs[runs[Status.FAILED] & (runs["status"] != Status.MISSING)]
    if len(failed):
        lines = [
            (part["night"].max(), str(part["night"].nunique()), *names)
            for names, part in failed.groupby(["key", "status", "reason"], sort=False)
        ]
        lines.sort(key=lambda line: line[0], reverse=True)
        caption = (
            f"{len(failed)} failures of {len(lines)} kinds, the latest {min(len(lines), MOST_FAILED)} of these; "
            "the first column has the latest night of each."
        )
        blocks.append(
            table(
                caption,
                ["night", "nights", "key", "status", "reason"],
                lines[:MOST_FAILED],
                [False, True, False, False, False],
            )
        )
    return blocks


def _short_names(nights: Sequence[str]) -> list[str]:
    """Names of nights at an axis: the day, with the time where the day has several nights."""
    days = Counter(night[:10] for night in nights)
    minutes = Counter(night[:16] for night in nights)
    return [
        night[:10]
        if days[night[:10]] == 1
        else f"{night[5:10]} {night[11 : 16 if minutes[night[:16]] == 1 else 23]}"
        for night in nights
    ]


def _view(
    metric: str,
    scene: str,
    rows: pd.DataFrame,
    nights: list[str],
    notes: list[str],
    told: Mapping[str, _Night],
) -> View:
    """The course of a metric on a scene."""
    head = quantity_of(metric).head
    block, series, ends = Columns(), [], []
    timed = (rows["kind"] == "time").all()
    logarithmic = bool((rows["value"] > 0).all()) and rows["kind"].iloc[0] in (
        "accuracy",
        "drift",
        "time",
    )
    number = block.add(np.arange(len(nights)), LONG)
    several = timed and rows["machine"].nunique() > 1
    for place, (variant, lines) in enumerate(rows.groupby("variant", sort=False)):
        steps = list(dict.fromkeys(lines["step"]))
        for (key, machine), line in lines.groupby(
            ["key", lines["machine"] if timed else "scene"], sort=False
        ):
            first, course = line.iloc[0], line.set_index("night").reindex(nights)
            values, unsure = course["value"].to_numpy(float), course["uncertainty"].to_numpy(float)
            if logarithmic:  # of a logarithm the relative uncertainty
                values, unsure = np.log10(values), unsure / (values * np.log(10))
            flags = [
                place
                for place, night in enumerate(nights)
                if {(metric, key), ("", key)} & told[night].regressions
            ]
            ends += [np.nanmin(values), np.nanmax(values)]
            name = (
                variant
                if variant == "truth"
                else f"{variant} ({setting_of(first['parameter'], first['step'])})"
            )
            series.append(
                {
                    "name": f"{name}, {machine}" if several else name,
                    "color": COLORS[place % len(COLORS)],
                    "about": key,
                    "dash": DASHES[steps.index(first["step"]) % len(DASHES)],
                    "marker": True,
                    "shown": True,
                    "flags": flags,
                    "x": [number],
                    "y": [[block.add(values, LONG)]],
                    "error": [[block.add(unsure)]] if timed else None,
                }
            )
    low, high = min(ends), max(ends)
    room = 0.05 * (high - low) or 0.5
    panel = {"label": head, "log": logarithmic, "range": [low - room, high + room]}
    return View(
        (head, scene),
        {
            "x": {
                "label": "night",
                "range": [-0.3, len(nights) - 0.7],
                "names": nights,
                "short": _short_names(nights),
                "notes": notes,
            },
            "series": series,
            "shades": [],
            "modes": [{"name": head, "digits": 6, "panels": [panel]}],
        },
        block,
    )
