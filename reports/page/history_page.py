"""The page over the history: each number's course over the nights, the nights with their verdicts, and what did not come out."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pandas as pd

from stiction.comparisons.atomic_files import write_text
from stiction.comparisons.campaigns.history import open_history
from stiction.reports.figures.style import COLORS
from stiction.reports.markdown.tables import setting_of
from stiction.reports.page.document import View, chart, document, paragraph, table

RUNGS = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
"""Lines by rung of a variant's ladder."""
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
            chart("course", ("Metric", "Scene"), list(_views(rows, list(nights["night"]))))], **sections}
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
    for (metric, scene), part in known.groupby(["metric", "scene"], sort=False):
        yield View((str(metric), str(scene)), _figure(str(metric), part, nights))


def _figure(metric: str, rows: pd.DataFrame, nights: list[str]):  # noqa: ANN202 - plotly is not imported before it is needed
    from plotly.graph_objects import Figure

    figure = Figure()
    timed = (rows["kind"] == "time").all()
    colors = {variant: COLORS[number % len(COLORS)] for number, variant in enumerate(dict.fromkeys(rows["variant"]))}
    for variant, lines in rows.groupby("variant", sort=False):
        rungs = list(dict.fromkeys(zip(lines["parameter"], lines["step"])))
        for (key, machine), line in lines.groupby(["key", lines["machine"] if timed else "scene"], sort=False):
            first = line.iloc[0]
            course = line.set_index("night").reindex(nights)
            place = rungs.index((first["parameter"], first["step"]))
            name = variant if first["variant"] == "truth" else f"{variant} ({setting_of(first['parameter'], first['step'])})"
            figure.add_scatter(
                x=nights, y=list(course["value"]), mode="lines+markers", connectgaps=False,
                name=f"{name}, {machine}" if timed and rows["machine"].nunique() > 1 else name,
                line={"color": colors[variant], "dash": RUNGS[place % len(RUNGS)], "width": 1.2}, marker={"color": colors[variant], "size": 5},
                text=[f"{key}<br>commit {commit}" for commit in course["commit_hash"].fillna("–")],
                hovertemplate="%{x}<br>%{y:.6g}<br>%{text}<extra></extra>",
                **({"error_y": {"array": list(course["uncertainty"]), "color": colors[variant], "thickness": 1}} if timed else {}))
    logarithmic = (rows["value"] > 0).all() and rows["kind"].iloc[0] in ("accuracy", "drift", "time")
    figure.update_xaxes(type="date", title_text="night", showline=True, ticks="outside")
    figure.update_yaxes(type="log" if logarithmic else "linear", title_text=metric, showline=True, ticks="outside", exponentformat="power")
    figure.update_layout(template="none", height=560, margin={"l": 90, "r": 10, "t": 10, "b": 60}, hovermode="closest")
    return figure
