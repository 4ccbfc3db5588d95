"""The page over the history: each number's course over the nights, the nights with their verdicts, and what failed."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd

from stiction.comparisons.atomic_files import write_text
from stiction.comparisons.campaigns.history import open_history
from stiction.comparisons.presentation.cells import setting_of
from stiction.reports.page.document import View, chart, document, paragraph, table
from stiction.scenes.pictures.picture import CYCLE
from stiction.scenes.pictures.web import LONG, Columns

COLORS = ("ink", *CYCLE[1:])
"""Colours by variant, the first again after the last."""
DASHES = ((), (6, 3), (2, 3), (8, 3, 2, 3), (14, 4), (14, 4, 2, 4))
"""Dashes of lines, px, by step size or tolerance of a variant."""
HINT = "Drag to zoom, double-click to reset; with the keyboard +, - and 0."
MOST_FAILED = 200
"""Failed runs are listed up to this number, the latest first."""


def write_history_page(history: Path, file: Path) -> None:
    """Write the page of a history; the same history gives the same bytes. HistoryRefused if `history` is none."""
    with open_history(history, write=False):
        pass  # it is one, of this format
    with closing(sqlite3.connect(f"{history.absolute().as_uri()}?mode=ro", uri=True)) as connection:
        rows = pd.read_sql("SELECT * FROM history", connection)
        nights = pd.read_sql("SELECT night, campaign, machine, commit_hash, finished, verdict FROM nights "
                             "ORDER BY night", connection)
    rows["failed"] = (rows["status"] != "ok") | (rows["reason"] != "")
    runs = rows.drop_duplicates(["night", "key"])
    sections = {}
    known = rows[rows["value"].notna()]
    if len(known):
        commits = rows.dropna(subset="commit_hash").drop_duplicates("night").set_index("night")["commit_hash"]
        notes = [f"commit {commit}" for commit in commits.reindex(nights["night"]).fillna("–")]
        views = [_view(tuple(map(str, labels)), part, list(nights["night"]), notes)
                 for labels, part in known.groupby(["metric", "scene"], sort=False)]
        sections["Course over the nights"] = [
            paragraph("One line per variant and step size or tolerance. Errors, drift and times are drawn in "
                      "logarithms where all are > 0; a gap is a night in which the run failed. Times of different "
                      "machines are different lines."),
            chart("course", ("Metric", "Scene"), views, HINT)]
    made, shown = runs.groupby("night")["failed"], nights.fillna("–").iloc[::-1]
    counts = {"runs": made.size(), "whole": made.size() - made.sum()}
    for name, count in counts.items():
        shown[name] = shown["night"].map(count).fillna(0).astype(int).map(str)
    sections["Nights"] = [table("The nights, the latest first; whole: runs that succeeded and reached their end.",
                                list(shown), shown.itertuples(index=False), [name in counts for name in shown])]
    failed = runs.loc[runs["failed"], ["night", "key", "status", "reason"]]
    if len(failed):
        shown = failed.sort_values("night", ascending=False, kind="stable").head(MOST_FAILED)
        caption = f"{len(failed)} runs, the latest {len(shown)} of them."
        sections["What failed"] = [table(caption, list(shown), shown.itertuples(index=False), [False] * 4)]
    subtitle = f"{len(nights)} nights, {rows['key'].nunique()} runs each at most"
    write_text(file, document("History of the nights", subtitle, sections))


def _view(labels: tuple[str, ...], rows: pd.DataFrame, nights: list[str], notes: list[str]) -> View:
    """The course of a metric on a scene."""
    block, series, ends = Columns(), [], []
    timed = (rows["kind"] == "time").all()
    logarithmic = bool((rows["value"] > 0).all()) and rows["kind"].iloc[0] in ("accuracy", "drift", "time")
    number = block.add(np.arange(len(nights)), LONG)
    several = timed and rows["machine"].nunique() > 1
    for place, (variant, lines) in enumerate(rows.groupby("variant", sort=False)):
        steps = list(dict.fromkeys(lines["step"]))
        for (key, machine), line in lines.groupby(["key", lines["machine"] if timed else "scene"], sort=False):
            first, course = line.iloc[0], line.set_index("night").reindex(nights)
            values, unsure = course["value"].to_numpy(float), course["uncertainty"].to_numpy(float)
            if logarithmic:  # of a logarithm the relative uncertainty
                values, unsure = np.log10(values), unsure / (values * np.log(10))
            ends += [np.nanmin(values), np.nanmax(values)]
            name = variant if variant == "truth" else f"{variant} ({setting_of(first['parameter'], first['step'])})"
            series.append({
                "name": f"{name}, {machine}" if several else name, "color": COLORS[place % len(COLORS)], "about": key,
                "dash": DASHES[steps.index(first["step"]) % len(DASHES)], "marker": True, "shown": True, "x": [number],
                "y": [[block.add(values, LONG)]], "error": [[block.add(unsure)]] if timed else None})
    low, high = min(ends), max(ends)
    room = 0.05 * (high - low) or 0.5
    panel = {"label": labels[0], "log": logarithmic, "range": [low - room, high + room]}
    return View(labels, {"x": {"label": "night", "range": [-0.3, len(nights) - 0.7], "names": nights, "notes": notes},
                         "series": series, "shades": [],
                         "modes": [{"name": labels[0], "digits": 6, "panels": [panel]}]}, block)
