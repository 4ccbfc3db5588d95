"""The page of a run: its time series to zoom into, its figures, its tables with a key per row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from stiction.comparisons.atomic_files import write_text
from stiction.comparisons.campaigns.validation import Validation
from stiction.reports.figures.motion import SETS, stick_phases
from stiction.reports.figures.selection import one_per_variant, run_label
from stiction.reports.figures.style import Look, looks
from stiction.reports.markdown.findings import lines
from stiction.reports.page.document import View, chart, document, image, paragraph, table
from stiction.reports.paper.sheets import KEY, Sheet, sheets
from stiction.reports.run_folder.data import truth_frame
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import Source, resolve
from stiction.scenes import Trajectory

SAMPLE = 0.01
"""s; time series are drawn at steps of this length, where there are shorter ones, and on both sides of every event."""
TRUTH_LABEL = "independent solution"
DASHES = {"-": "solid", "--": "dash", "-.": "dashdot", ":": "dot"}
TITLES = {"paper": "Time series", "cost": "What accuracy costs", "accuracy": "Accuracy", "orders": "Order of convergence", "drift": "Constraint drift",
          "study": "Drift and what is done against it", "sensitivity": "What the paper leaves open",
          "threshold": "Stick threshold on F0", "torque": "Driving-torque jumps", "effects": "Effects of the scene",
          "suppression": "Drift suppression", "claims": "The paper's claims", "failures": "Failures", "variants": "Variants and scenes"}
TABLES_OF = {"variants": ("variants", "parameters")}
"""Sections whose tables are of several topics."""


def write_run_page(run: StoredRun, file: Path) -> None:
    """Write the page; the same run gives the same bytes."""
    validation = run.validation()
    tables = list(sheets(run, validation))
    figures = run.tables["figures"]
    sections = {"Results": [paragraph(f"{number}. {line}") for number, line in enumerate(lines(validation), 1)]}
    for topic, title in TITLES.items():
        blocks = [_time_series(validation)] if topic == "paper" and validation.records else []
        if topic != "paper":
            blocks += [image(run.folder / "figures" / f"{row.name}.png", row.caption)
                       for row in figures[figures["topic"] == topic].itertuples(index=False)]
        blocks += [_table(run, sheet) for sheet in tables if sheet.topic in TABLES_OF.get(topic, (topic,))]
        if blocks:
            sections[title] = blocks
    sections["Provenance"] = [table("Of the run.", ("what", "value"), _origin(run), (False, False))]
    write_text(file, document("Validation report", f"stiction {run.origin['versions']['stiction']}, run of {run.origin['date']}", sections))


def _table(run: StoredRun, sheet: Sheet) -> str:
    keys = list(sheet.frame[KEY])
    return table(sheet.caption, [" ".join(words) for words in sheet.heads()], sheet.cells(), sheet.right(),
                 [f"{sheet.name}-{key}" for key in keys], [_about(resolve(run, key)) for key in keys])


def _about(source: Source) -> str:
    first, last = source.rows.index[0], source.rows.index[-1]
    return f"data/{source.table}.csv, row {first}" + (f" to {last}" if last > first else "") + "".join(f"\n{file}" for file in source.files)


def _origin(run: StoredRun) -> Iterator[tuple[str, str]]:
    origin = run.origin
    yield "date", origin["date"]
    for part in ("versions", "engines", "machine", "campaign", "choices"):
        yield from ((f"{part}: {name}", str(value)) for name, value in origin[part].items())
    if origin["commit"]:
        yield "commit", origin["commit"]["hash"] + (" with uncommitted changes" if origin["commit"]["dirty"] else "")


def _time_series(validation: Validation) -> str:
    views = [_view(validation, scene) for scene in dict.fromkeys(record.scene for record in validation.records)]
    return chart("time-series", ("Scene",), [view for view in views if view])


def _view(validation: Validation, scene: str) -> View | None:
    """One panel per quantity below each other, with one time axis; a name in the legend stands for its lines in all panels."""
    from plotly.subplots import make_subplots

    records = [record for record in validation.records if record.scene == scene]
    truth, styles = validation.truths.get(scene), looks(validation.records)
    curves = {} if truth is None else {TRUTH_LABEL: (truth_frame(truth), Look("#000000", ":", ""), True)}
    for record in sorted(one_per_variant(records), key=lambda record: record.variant.engine != "reference"):
        label = record.variant.label
        shown = record.variant.engine != "reference" or record.trajectory.settings.get("method") == "event"
        curves[run_label(record)] = (_frame(record.trajectory), styles[label], shown)
    quantities = [quantity for *_, group in SETS for quantity in group if any(quantity.column in frame for frame, *_ in curves.values())]
    if not quantities:
        return None
    figure = make_subplots(rows=len(quantities), cols=1, shared_xaxes=True, vertical_spacing=0.14 / len(quantities))
    shared = [frame["t"].to_numpy() for frame, *_ in curves.values()]
    for row, quantity in enumerate(quantities, 1):
        for number, (label, (frame, look, shown)) in reversed(list(enumerate(curves.items()))):  # what comes last is on top
            if quantity.column in frame:
                figure.add_scatter(
                    x=[], y=frame[quantity.column].to_numpy(np.float32), mode="lines", name=label, legendgroup=label, showlegend=row == 1,
                    visible=True if shown else "legendonly", line={"color": look.color, "dash": DASHES.get(look.dashes, "dash"), "width": 1.2},
                    meta=number, row=row, col=1)
        figure.update_yaxes(title_text=quantity.words, range=_range(quantity.column, curves), row=row, col=1)
    for start, end in stick_phases(truth):
        figure.add_vrect(x0=start, x1=end, fillcolor="#888888", opacity=0.2, line_width=0, layer="below")
    end = max(float(t[-1]) for t in shared)
    figure.update_xaxes(range=[0.0, end], showline=True, ticks="outside")
    figure.update_xaxes(title_text="t [s]", row=len(quantities), col=1)
    figure.update_yaxes(showline=True, ticks="outside")
    figure.update_layout(template="none", height=60 + 170 * len(quantities), margin={"l": 80, "r": 10, "t": 10, "b": 50},
                         legend={"orientation": "h", "yanchor": "bottom", "y": 1.01, "traceorder": "reversed", "groupclick": "togglegroup"}, hovermode="closest")
    return View((scene,), figure, shared)


def _frame(trajectory: Trajectory) -> pd.DataFrame:
    """With both sides of every event, and samples no closer than `SAMPLE`."""
    step = max(1, round(SAMPLE / float(np.median(np.diff(trajectory.t))))) if len(trajectory.t) > 1 else 1
    return replace(trajectory, t=trajectory.t[::step],
                   columns={name: values[::step] for name, values in trajectory.columns.items()}).to_frame(events=True)


def _range(column: str, curves: dict[str, tuple[pd.DataFrame, Look, bool]]) -> list[float] | None:
    """Of the first curve that has the column, truth or best run: spikes of an engine leave the panel, they do not flatten it."""
    frame = next(frame for frame, *_ in curves.values() if column in frame)
    low, high = float(frame[column].min()), float(frame[column].max())
    room = 0.12 * (high - low)
    return [low - room, high + room] if room > 0 else None
