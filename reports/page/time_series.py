"""The time series of a run for its page: values and differences from the truth of all variants, and the mechanism that moves with them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.results import Results
from stiction.comparisons.truth import Truth
from stiction.comparisons.variants import Record
from stiction.comparisons.studies.paper_figures import stick_phases
from stiction.comparisons.methods import one_per_variant, run_label
from stiction.reports.figures.style import Look, looks_of, variants_of
from stiction.reports.page.document import View
from stiction.reports.run_folder.data import truth_frame
from stiction.scenes import Scene, load_scene
from stiction.scenes.columns import unit_of
from stiction.scenes.pictures.geometry import poses_at, view_of
from stiction.scenes.pictures.web import LONG, Columns, force_columns, load_signs, mechanism, pose_columns

SAMPLE = 0.02
"""s; samples shown, besides both sides of every event and what lines between them would leave out."""
VISIBLE = 0.005
"""Of the range of a panel: what a line between two samples may leave out."""
SMALLEST, DECADE = 1e-17, 0.02
"""Smaller differences are none and have no logarithm; to how much logarithms are kept (half of it: 2 %)."""
RESOLUTION = 1e-3
"""Of the range of a panel, or of a column that moves the mechanism: numbers are kept to half of it, less than a line is wide."""
MOST_PANELS = 12
TRUTH_LABEL = "truth"
QUANTITIES = {r"\.displacement$": "position along", r"\.slip_velocity$": "slip velocity along", r"^slider\.ax$": "acceleration of", r"\.F[1-4]$": "corner force",
              r"\.effort$": "effort of"}
"""Columns that have a panel, and what they are called."""
TRUTH_LOOK = Look("#000000", (0, (1, 1.2)), "")
DASH = 1.5
"""px per point of a line, of which a look gives the lengths of dashes."""
VALUES, DIFFERENCES = "values", "differences from the truth"


@dataclass(frozen=True, eq=False)
class Curve:
    """A line in all panels: a run, or the truth."""

    label: str
    frame: pd.DataFrame
    look: Look
    shown: bool
    truth: Truth | None = None


def time_series(validation: Results) -> Iterator[View]:
    """A view per scene that has anything to draw."""
    for name in dict.fromkeys(record.scene for record in validation.records):
        records = one_per_variant(record for record in validation.records if record.scene == name)
        if len(curves := list(_curves(validation, name, records))) and (panels := _panels(scene := load_scene(name), curves)):
            yield _view(name, scene, validation.truths.get(name), curves, panels)


def _curves(validation: Results, scene: str, records: Sequence[Record]) -> Iterator[Curve]:
    if truth := validation.truths.get(scene):
        yield Curve(TRUTH_LABEL, truth_frame(truth), TRUTH_LOOK, True)
    styles, truths = looks_of(_drawn(validation)), _truths(validation)
    for record in sorted(records, key=lambda record: record.variant.engine != "reference"):
        shown = record.variant.engine != "reference" or record.trajectory.settings.get("method") == "event"
        yield Curve(run_label(record), record.trajectory.to_frame(events=True), styles[record.variant.label], shown, truths.get(record.key, truth))


def _drawn(results: Results) -> dict[str, tuple[str, str]]:
    """Engine and fidelity of the variants that have curves, by label."""
    there = {record.variant.label for record in one_per_variant(results.records)}
    return {label: about for label, about in variants_of(results).items() if label in there}


def _truths(validation: Results) -> dict[str, Truth]:
    """By key of a run what it is compared with: the physics that it has."""
    table = validation.tables.get("accuracy", pd.DataFrame())
    return {row["key"]: validation.truths[row["truth"]] for row in table.to_dict("records") if row.get("truth") in validation.truths}


def _panels(scene: Scene, curves: Sequence[Curve]) -> dict[str, str]:
    """By column the words above its panel."""
    columns = dict.fromkeys(column for curve in curves for column in curve.frame)
    return {column: f"{words} {column.rpartition('.')[0] if not words.startswith('corner') else column} [{unit_of(column, scene)}]"
            for pattern, words in QUANTITIES.items() for column in columns if re.search(pattern, column)}


def _view(name: str, scene: Scene, truth: Truth | None, curves: Sequence[Curve], panels: Mapping[str, str]) -> View:
    block, columns = Columns(), list(panels)[:MOST_PANELS]
    ranges = {column: _range(column, curves) for column in columns}
    series, runs, common = [], [], {}
    poses, forces = pose_columns(scene), force_columns(scene)
    drawn = [curve for curve in curves if set(poses) <= set(curve.frame)]
    grids: dict[bytes, int] = {}

    def times(t: np.ndarray) -> int:
        return grids[t.tobytes()] if t.tobytes() in grids else grids.setdefault(t.tobytes(), block.add(t, LONG))

    for curve in curves:
        frame = decimated(curve.frame, ranges)
        t = frame["t"].to_numpy()
        at = times(t)
        places = {column: block.add(_clipped(frame[column].to_numpy(), ranges[column]), step=RESOLUTION * (ranges[column][1] - ranges[column][0])) for column in columns if column in frame}
        differences = difference(curve, columns)
        compared = None if differences.empty else times(differences["t"].to_numpy())
        series.append({
            "name": curve.label, "color": "ink" if curve.look.color == "#000000" else curve.look.color, "dash": [] if curve.look.dashes == "-" else [DASH * length for length in curve.look.dashes[1]],
            "marker": False, "shown": curve.shown, "x": [at, compared],
            "y": [[places.get(column) for column in columns],
                  [block.add(differences[column], step=DECADE) if column in differences else None for column in columns]]})
        if curve in drawn:
            own = {column: places[column] if column in places and _whole(frame[column], ranges[column]) else block.add(frame[column], step=RESOLUTION * _spread(frame[column]))
                   for column in (*poses, *forces) if column in frame}
            runs.append({"name": curve.label, "t": at, "columns": own})
            if at not in common:
                common[at] = {load: block.add(signs) for load, signs in load_signs(scene, t).items()}
    end = max(float(curve.frame["t"].iloc[-1]) for curve in curves)
    logarithms = _range_of_differences(curves, columns)
    content = {
        "x": {"label": "t [s]", "range": [0.0, end], "snap": SAMPLE}, "series": series, "shades": stick_phases(truth),
        "modes": [{"name": VALUES, "digits": 3, "panels": [{"label": panels[column], "log": False, "range": ranges[column]} for column in columns]},
                  {"name": DIFFERENCES, "digits": 2,
                   "panels": [{"label": f"|difference| of {panels[column]}", "log": True, "range": logarithms[column]} for column in columns]}],
        **({"film": _film(scene, drawn[0].frame, runs, common)} if drawn else {})}
    return View((name,), content, block)


def _film(scene: Scene, frame: pd.DataFrame, runs: list[dict[str, Any]], common: Mapping[int, Mapping[str, int]]) -> dict[str, Any]:
    """The mechanism, in a view of all of the motion of a frame, whose largest corner force is the longest arrow."""
    columns = {column: frame[column].to_numpy() for column in frame if column != "tier"}
    seen = view_of(scene, [poses_at(scene, columns, row) for row in range(0, len(frame), max(1, len(frame) // 200))])
    largest = max((float(np.nanmax(columns[column], initial=0.0)) for column in force_columns(scene) if column in columns), default=1.0) or 1.0
    return {"mechanism": mechanism(scene, seen), "runs": runs, "common": common, "largest": largest}


def _range(column: str, curves: Sequence[Curve]) -> list[float]:
    """Of the first curve that knows the column, truth or best run: spikes of an engine leave the panel, they do not flatten it."""
    values = next((known for curve in curves if column in curve.frame and len(known := curve.frame[column].dropna())), np.zeros(1))
    low, high = float(values.min()), float(values.max())
    room = 0.12 * (high - low) or 1.0
    return [low - room, high + room]


def _clipped(values: np.ndarray, shown: Sequence[float]) -> np.ndarray:
    """What lies beyond ten times the range of its panel is kept at that: the other numbers keep their digits."""
    room = 10 * (shown[1] - shown[0])
    return np.clip(values, shown[0] - room, shown[1] + room)


def _spread(values: pd.Series) -> float:
    """Between the smallest and the largest but spikes; 1 where there is none."""
    low, high = values.quantile([0.01, 0.99]) if values.notna().any() else (0.0, 0.0)
    return float(high - low) or 1.0


def _whole(values: pd.Series, shown: Sequence[float]) -> bool:
    return bool((_clipped(values.to_numpy(), shown) == values.to_numpy()).all())


def decimated(frame: pd.DataFrame, ranges: Mapping[str, Sequence[float]]) -> pd.DataFrame:
    """The rows that a screen shows: one per `SAMPLE`, both sides of every event, and peaks between them that are larger than `VISIBLE`."""
    t = frame["t"].to_numpy()
    twice = np.flatnonzero(np.diff(t) == 0.0)
    kept = np.unique([*_one_per_sample(t), *twice, *(twice + 1), len(t) - 1])
    for _ in range(2):
        missed = np.zeros(len(t))
        for column, (low, high) in ranges.items():
            if column in frame:
                values = frame[column].to_numpy()
                missed = np.fmax(missed, np.abs(values - np.interp(np.arange(len(t)), kept, values[kept])) / (high - low))
        between = np.searchsorted(kept, np.arange(len(t)))
        worst = pd.Series(missed).groupby(between).idxmax()
        kept = np.unique([*kept, *worst[missed[worst] > VISIBLE]])
    return frame.iloc[kept]


def _one_per_sample(t: np.ndarray) -> np.ndarray:
    """The first row of each `SAMPLE`."""
    return np.unique(np.floor(t / SAMPLE + 1e-6), return_index=True)[1]


def difference(curve: Curve, columns: Sequence[str]) -> pd.DataFrame:
    """``t`` and logarithms (base 10) of sizes of differences from the truth, one per `SAMPLE` of the times of both; no rows without a truth."""
    if curve.truth is None:
        return pd.DataFrame({"t": []})
    truth = truth_frame(curve.truth)
    ours, theirs = (_samples(frame) for frame in (curve.frame, truth))
    rows = pd.merge_asof(ours, theirs, on="t", tolerance=1e-9, direction="nearest", suffixes=("", " of the truth"))
    rows = rows[rows[[name for name in rows if name.endswith(" of the truth")]].notna().any(axis=1)]
    rows = rows.iloc[_one_per_sample(rows["t"].to_numpy())]
    both = {column: np.abs(rows[column] - rows[f"{column} of the truth"]) for column in columns if f"{column} of the truth" in rows}
    return pd.DataFrame({"t": rows["t"], **{column: np.log10(sizes.where(sizes > SMALLEST)) for column, sizes in both.items()}})


def _samples(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows that are no side of an event, where the values are not of one time only."""
    return frame[~frame["t"].duplicated(keep=False)]


def _range_of_differences(curves: Sequence[Curve], columns: Sequence[str]) -> dict[str, list[float]]:
    """Whole decades that hold all but the largest and smallest hundredth of what is shown at first."""
    found = {}
    frames = [difference(curve, columns) for curve in curves if curve.shown]
    for column in columns:
        values = np.concatenate([frame[column].to_numpy() for frame in frames if column in frame] or [np.zeros(1)])
        values = values[np.isfinite(values)]
        low, high = np.quantile(values, [0.01, 0.999]) if len(values) else (0.0, 0.0)
        found[column] = [float(np.floor(low)), float(max(np.ceil(high), np.floor(low) + 1))]
    return found
