"""The page over the history: each number's course over the nights, the nights with their verdicts, and what did not come out."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
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
"""By variant, the first again after the last."""
DASHES = ((), (6, 3), (2, 3), (8, 3, 2, 3), (14, 4), (14, 4, 2, 4))
"""Of lines, px, by rung of a variant's ladder."""
HINT = "Drag to zoom, double-click to reset; with the keyboard +, - and 0."
LOST = 200
"""Runs that did not come out are listed up to this number, the latest first."""


def write_history_page(history: Path, file: Path) -> None:
    """Write the page of a history; the same history gives the same bytes.

    Raises
    ------
    HistoryRefused
        If `history` is none.
    """
    with open_history(history, write=False):
        pass  # it is one, of this format
    with closing(sqlite3.connect(f"{history.absolute().as_uri()}?mode=ro", uri=True)) as connection:
        rows = pd.read_sql("SELECT * FROM history", connection)
        nights = pd.read_sql("SELECT night, campaign, machine, commit_hash, finished, verdict FROM nights ORDER BY night", connection)
    sections = {"Nights": [_nights(nights, rows)]}
    if len(rows) and rows["value"].notna().any():
        sections = {"Course over the nights": [
            paragraph("One line per variant and rung. Errors, drift and times are drawn in logarithms where all are > 0; a gap is a night "
                      "in which the run did not come out. Times of different machines are different lines."),
            chart("course", ("Metric", "Scene"), list(_views(rows, list(nights["night"]))), HINT)], **sections}
    lost = rows[(rows["status"] != "ok") | (rows["reason"] != "")].drop_duplicates(["night", "key"])
    if len(lost):
        shown = lost.sort_values("night", ascending=False, kind="stable")[["night", "key", "status", "reason"]].head(LOST)
        sections["What did not come out"] = [table(f"{len(lost)} runs, the latest {len(shown)} of them.", list(shown),
                                                   shown.itertuples(index=False), [False] * 4)]
    write_text(file, document("History of the nights", f"{len(nights)} nights, {rows['key'].nunique()} runs each at most", sections))


def _nights(nights: pd.DataFrame, rows: pd.DataFrame) -> str:
    runs = rows.drop_duplicates(["night", "key"]).assign(fine=lambda table: (table["status"] == "ok") & (table["reason"] == ""))
    counts = runs.groupby("night")["fine"].agg(["size", "sum"]).reindex(nights["night"], fill_value=0)
    shown = nights.fillna("–").assign(runs=counts["size"].map(str).to_numpy(), whole=counts["sum"].map(str).to_numpy()).iloc[::-1]
    return table("The nights, the latest first; whole: runs that came out and reached their end.", list(shown),
                 shown.itertuples(index=False), [name in ("runs", "whole") for name in shown])


def _views(rows: pd.DataFrame, nights: list[str]) -> Iterator[View]:
    """One per metric and scene that has any number."""
    known = rows[rows["value"].notna()]
    commits = rows.dropna(subset="commit_hash").drop_duplicates("night").set_index("night")["commit_hash"].reindex(nights).fillna("–")
    for (metric, scene), part in known.groupby(["metric", "scene"], sort=False):
        yield _view((str(metric), str(scene)), part, nights, [f"commit {commit}" for commit in commits])


def _view(labels: tuple[str, str], rows: pd.DataFrame, nights: list[str], notes: list[str]) -> View:
    block, series = Columns(), []
    timed = (rows["kind"] == "time").all()
    logarithmic = bool((rows["value"] > 0).all()) and rows["kind"].iloc[0] in ("accuracy", "drift", "time")
    number, low, high = block.add(np.arange(len(nights)), LONG), np.inf, -np.inf
    colors = {variant: COLORS[place % len(COLORS)] for place, variant in enumerate(dict.fromkeys(rows["variant"]))}
    for variant, lines in rows.groupby("variant", sort=False):
        rungs = list(dict.fromkeys(zip(lines["parameter"], lines["step"])))
        for (key, machine), line in lines.groupby(["key", lines["machine"] if timed else "scene"], sort=False):
            first, course = line.iloc[0], line.set_index("night").reindex(nights)
            values = course["value"].to_numpy(float)
            drawn = np.log10(values) if logarithmic else values
            low, high = min(low, np.nanmin(drawn)), max(high, np.nanmax(drawn))
            unsure = course["uncertainty"].to_numpy(float) / (values * np.log(10) if logarithmic else 1.0)  # of a logarithm: relative
            name = variant if first["variant"] == "truth" else f"{variant} ({setting_of(first['parameter'], first['step'])})"
            series.append({"name": f"{name}, {machine}" if timed and rows["machine"].nunique() > 1 else name, "color": colors[variant], "about": key,
                           "dash": DASHES[rungs.index((first["parameter"], first["step"])) % len(DASHES)], "marker": True, "shown": True, "x": [number],
                           "y": [[block.add(drawn, LONG)]], "error": [[block.add(unsure)]] if timed else None})
    room = 0.05 * (high - low) or 0.5
    return View(labels, {"x": {"label": "night", "range": [-0.3, len(nights) - 0.7], "names": nights, "notes": notes}, "series": series, "shades": [],
                         "modes": [{"name": labels[0], "digits": 6, "panels": [{"label": labels[0], "log": logarithmic, "range": [low - room, high + room]}]}]},
                block)
