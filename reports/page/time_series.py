"""The time series of a run for its page: values, differences from the truth, and the mechanism that moves with them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import one_per_variant, run_label
from stiction.comparisons.bench.results import Results
from stiction.comparisons.studies.paper_figures import stick_phases
from stiction.reports.figures.style import Look, looks_of, variants_of
from stiction.reports.page.document import View
from stiction.reports.run_folder.data import truth_frame
from stiction.scenes import Scene, load_scene
from stiction.scenes.columns import unit_of
from stiction.scenes.pictures.geometry import poses_at, view_of
from stiction.scenes.pictures.web import (
    LONG,
    Columns,
    force_columns,
    largest_force,
    load_signs,
    mechanism,
    pose_columns,
)
from stiction.truths import Truth

SAMPLE = 0.02
"""s; samples shown, besides both sides of every event and what lines between them would leave out."""
VISIBLE = 0.005
"""Share of the range of a panel that a line between two samples may leave out."""
APART = 0.04
"""s; between two differences from the truth."""
SMALLEST, DECADE = 1e-17, 0.02
"""Smaller differences are none and have no logarithm; to how much logarithms are kept (half of it: 2 %)."""
RESOLUTION = 1e-3
"""Share of the range of a panel, or of a column that moves the mechanism; numbers are kept to half of it."""
MOST_PANELS = 12
TRUTHS = " of the truth"
"""Ending of a truth's columns beside those of a run."""
CORNER = "corner force"
QUANTITIES = {
    r"\.displacement$": "position along",
    r"\.slip_velocity$": "slip velocity along",
    r"^slider\.ax$": "acceleration of",
    r"\.F[1-4]$": CORNER,
    r"\.effort$": "effort of",
}
"""Columns that have a panel, and what they are called."""
TRUTH_LOOK = Look("#000000", (0, (1, 1.2)), "")
DASH = 1.5
"""px per point of a line, of which a look gives the lengths of dashes."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A line in all panels: a run, or the truth."""

    label: str
    frame: pd.DataFrame
    look: Look
    shown: bool
    truth: Truth | None = None


def time_series(results: Results) -> Iterator[View]:
    """Yield a view per scene that has anything to draw."""
    for name in dict.fromkeys(record.scene for record in results.records):
        curves = list(_curves(results, name))
        if curves and (panels := _panels(scene := load_scene(name), curves)):
            yield _view(scene, results.truths.get(name), curves, panels)


def _curves(results: Results, scene: str) -> Iterator[Curve]:
    if truth := results.truths.get(scene):
        yield Curve("truth", truth_frame(truth), TRUTH_LOOK, True)
    labels = {record.variant.label for record in one_per_variant(results.records)}
    looks = looks_of(
        {label: about for label, about in variants_of(results).items() if label in labels}
    )
    compared = {key: results.truths.get(name) for key, name in results.truth_of_runs().items()}
    records = one_per_variant(record for record in results.records if record.scene == scene)
    for record in sorted(records, key=lambda record: record.variant.engine != "reference"):
        shown = record.variant.engine != "reference" or record.run.settings.get("method") == "event"
        frame = record.run.to_frame(events=True, interpolated=True)
        yield Curve(
            run_label(record),
            frame,
            looks[record.variant.label],
            shown,
            compared.get(record.key) or truth,
        )


def _panels(scene: Scene, curves: Sequence[Curve]) -> dict[str, str]:
    """Words above the panel of each column, at most `MOST_PANELS`."""
    columns = dict.fromkeys(column for curve in curves for column in curve.frame)
    panels = {
        column: f"{words} {column if words == CORNER else column.rpartition('.')[0]} [{unit_of(column, scene)}]"
        for pattern, words in QUANTITIES.items()
        for column in columns
        if re.search(pattern, column)
    }
    return dict(list(panels.items())[:MOST_PANELS])


def _view(
    scene: Scene, truth: Truth | None, curves: Sequence[Curve], panels: Mapping[str, str]
) -> View:
    block, grids = Columns(), dict[bytes, int]()
    ranges = {column: _range(column, curves) for column in panels}
    poses, moving = pose_columns(scene), [*pose_columns(scene), *force_columns(scene)]
    drawn = [curve for curve in curves if set(poses) <= set(curve.frame)]
    series, runs, common = [], [], {}

    def times(t: np.ndarray) -> int:
        if t.tobytes() not in grids:
            grids[t.tobytes()] = block.add(t, LONG)
        return grids[t.tobytes()]

    compared = {curve: difference(curve, list(panels)) for curve in curves}
    for curve in curves:
        frame, differences = decimated(curve.frame, ranges), compared[curve]
        at = times(frame["t"].to_numpy())
        places = {
            column: block.add(
                _clipped(frame[column].to_numpy(), shown), step=RESOLUTION * (shown[1] - shown[0])
            )
            for column, shown in ranges.items()
            if column in frame
        }
        instants = None if differences.empty else times(differences["t"].to_numpy())
        sizes = {
            column: block.add(differences[column], step=DECADE)
            for column in panels
            if column in differences
        }
        dashes = (
            [] if curve.look.dashes == "-" else [DASH * length for length in curve.look.dashes[1]]
        )
        series.append(
            {
                "name": curve.label,
                "color": "ink" if curve.look.color == "#000000" else curve.look.color,
                "dash": dashes,
                "marker": False,
                "shown": curve.shown,
                "x": [at, instants],
                "y": [
                    [places.get(column) for column in panels],
                    [sizes.get(column) for column in panels],
                ],
            }
        )
        if curve in drawn:
            own = {
                column: places[column]
                if column in places and _whole(frame[column], ranges[column])
                else block.add(frame[column], step=RESOLUTION * _spread(frame[column]))
                for column in moving
                if column in frame
            }
            runs.append({"name": curve.label, "t": at, "columns": own})
            if at not in common:
                signs = load_signs(scene, frame["t"].to_numpy())
                common[at] = {load: block.add(sign) for load, sign in signs.items()}
    end = max(float(curve.frame["t"].iloc[-1]) for curve in curves)
    logarithms = _range_of_differences(
        [compared[curve] for curve in curves if curve.shown], list(panels)
    )
    shown_as = [
        {"label": words, "log": False, "range": ranges[column]} for column, words in panels.items()
    ]
    errors = [
        {"label": f"|difference| of {words}", "log": True, "range": logarithms[column]}
        for column, words in panels.items()
    ]
    content: dict[str, Any] = {
        "x": {"label": "t [s]", "range": [0.0, end], "snap": SAMPLE},
        "series": series,
        "shades": stick_phases(truth),
        "modes": [
            {"name": "values", "digits": 3, "panels": shown_as},
            {"name": "differences from the truth", "digits": 2, "panels": errors},
        ],
    }
    if drawn:  # in a view of all of the motion of the first
        columns = {column: drawn[0].frame[column].to_numpy() for column in drawn[0].frame}
        rows = range(0, len(drawn[0].frame), max(1, len(drawn[0].frame) // 200))
        seen = view_of(scene, [poses_at(scene, columns, row) for row in rows])
        content["film"] = {
            "mechanism": mechanism(scene, seen),
            "largest": largest_force(scene, columns),
            "runs": runs,
            "common": common,
        }
    return View((scene.name,), content, block)


def _range(column: str, curves: Sequence[Curve]) -> list[float]:
    """The range of the first curve that knows the column, truth or best run: spikes of an engine leave the panel."""
    known = (curve.frame[column].dropna() for curve in curves if column in curve.frame)
    values = next(filter(len, known), np.zeros(1))
    low, high = float(values.min()), float(values.max())
    room = 0.12 * (high - low) or 1.0
    return [low - room, high + room]


def _clipped(values: np.ndarray, shown: Sequence[float]) -> np.ndarray:
    """Values kept within ten times the range of their panel: the other numbers keep their digits."""
    room = 10 * (shown[1] - shown[0])
    return np.clip(values, shown[0] - room, shown[1] + room)


def _spread(values: pd.Series) -> float:
    """Between the smallest and the largest but spikes; 1 where there is none."""
    low, high = values.quantile([0.01, 0.99]) if values.notna().any() else (0.0, 0.0)
    return float(high - low) or 1.0


def _whole(values: pd.Series, shown: Sequence[float]) -> bool:
    return bool((_clipped(values.to_numpy(), shown) == values.to_numpy()).all())


def decimated(frame: pd.DataFrame, ranges: Mapping[str, Sequence[float]]) -> pd.DataFrame:
    """Keep a row per `SAMPLE`, both sides of every event, and peaks between them that are larger than `VISIBLE`."""
    t = frame["t"].to_numpy()
    rows = np.arange(len(t))
    twice = np.flatnonzero(np.diff(t) == 0.0)
    kept = np.unique([*_one_per(SAMPLE, t), *twice, *(twice + 1), len(t) - 1])
    for _ in range(2):
        missed = np.zeros(len(t))
        for column, (low, high) in ranges.items():
            if column in frame:
                values = frame[column].to_numpy()
                missed = np.fmax(
                    missed, np.abs(values - np.interp(rows, kept, values[kept])) / (high - low)
                )
        worst = pd.Series(missed).groupby(np.searchsorted(kept, rows)).idxmax()
        kept = np.unique([*kept, *worst[missed[worst] > VISIBLE]])
    return frame.iloc[kept]


def _one_per(step: float, t: np.ndarray) -> np.ndarray:
    return np.unique(np.floor(t / step + 1e-6), return_index=True)[1]


def difference(curve: Curve, columns: Sequence[str]) -> pd.DataFrame:
    """Return ``t`` and logarithms (base 10) of sizes of differences from the truth, if any, one per `APART`."""
    if curve.truth is None:
        return pd.DataFrame({"t": []})
    ours, theirs = _samples(curve.frame), _samples(truth_frame(curve.truth)).add_suffix(TRUTHS)
    rows = pd.merge_asof(
        ours, theirs, left_on="t", right_on="t" + TRUTHS, tolerance=1e-9, direction="nearest"
    )
    rows = rows[rows["t" + TRUTHS].notna()]
    rows = rows.iloc[_one_per(APART, rows["t"].to_numpy())]
    found = {"t": rows["t"]}
    for column in columns:
        if column + TRUTHS in rows and column in rows:
            sizes = np.abs(rows[column] - rows[column + TRUTHS])
            found[column] = np.log10(sizes.where(sizes > SMALLEST))
    return pd.DataFrame(found)


def _samples(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows that are no side of an event, where the values are not of one time only."""
    return frame[~frame["t"].duplicated(keep=False)]


def _range_of_differences(
    differences: Sequence[pd.DataFrame], columns: Sequence[str]
) -> dict[str, list[float]]:
    """Whole decades that hold all but the largest and smallest hundredth of what is shown at first."""
    found, shown = {}, pd.concat(differences)
    for column in columns:
        values = shown[column].dropna() if column in shown else np.zeros(0)
        low, high = np.quantile(values, [0.01, 0.999]) if len(values) else (0.0, 0.0)
        found[column] = [float(np.floor(low)), float(max(np.ceil(high), np.floor(low) + 1))]
    return found
