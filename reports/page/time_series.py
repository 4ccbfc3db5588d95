"""The time series of a run for its web page: values, differences from the truth, and moving mechanisms.

The page contains fewer samples and digits than the run: those that can be seen.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
from stiction.scenes import Scene
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

SAMPLE_STEP = 0.02
"""Time between two samples of a line, s. The rows of events and peaks between samples are kept, too."""
MAX_DEVIATION = 0.005
"""Largest deviation from a row that is left out to the line between samples, as a fraction of the axis."""
REFINEMENTS = 2
"""Number of times that a row is added between samples; further ones would add little."""
DIFFERENCE_STEP = 0.04
"""Time between two differences from the truth, s."""
MIN_DIFFERENCE = 1e-17
"""Differences up to this one are rounding errors, and have no logarithm."""
LOGARITHM_STEP = 0.02
"""Step to which logarithms of differences are rounded: differences are then known to 2 %."""
RESOLUTION = 1e-3
"""Step to which values are rounded, as a fraction of the range of their axis."""
MAX_PANELS = 12
"""Largest number of panels of a scene."""
AXIS_MARGIN = 0.12
"""Distance of the values from the ends of an axis, as a fraction of their range."""
CLIP_FACTOR = 10
"""Values farther from the axis than this multiple of its range are clipped."""
POSES_FOR_VIEW = 200
"""Number of instants, about, from which the extent of a moving mechanism is computed."""
SPIKE_FRACTION = 0.01
"""Fraction of the values of a column at each end that may be spikes."""
TRUTHS = " of the truth"
"""Ending of the columns of a truth where they are beside those of a run."""
CORNER = "corner force"
QUANTITIES = {
    r"\.displacement$": "position along",
    r"\.slip_velocity$": "slip velocity along",
    r"^slider\.ax$": "acceleration of",
    r"\.F[1-4]$": CORNER,
    r"\.effort$": "effort of",
}
"""Columns that have a panel, as regular expressions, and the name of their quantity."""
BLACK = "#000000"
"""Colour of the reference and the truth; the page replaces it by ``ink``, which suits light and dark mode."""
TRUTH_LOOK = Look(BLACK, (0, (1, 1.2)), "")
PX_PER_POINT = 1.5
"""Pixels per point; looks give the lengths of dashes in points."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A run, or the truth, which is a line in each panel.

    Attributes
    ----------
    label : str
        Text in the legend.
    frame : DataFrame
        Column ``t`` and the columns of the motion, with two rows for each event.
    look : Look
        Colour and dashes.
    is_shown : bool
        Whether the line is shown at first.
    truth : Truth or None
        The truth with which the run is compared.
    """

    label: str
    frame: pd.DataFrame
    look: Look
    is_shown: bool
    truth: Truth | None = None


def time_series(results: Results) -> Iterator[View]:
    """Yield a view of each scene whose runs have columns in `QUANTITIES`."""
    for name in dict.fromkeys(record.scene for record in results.records):
        curves = list(_curves(results, name))
        if not curves:
            continue
        scene = results.scene(name)
        panels = _panels(scene, curves) if scene is not None else {}
        if scene is not None and panels:
            yield _view(scene, results.truths.get(name), curves, panels)


def _curves(results: Results, scene: str) -> Iterator[Curve]:
    """Yield the truth of a scene and one run of each variant, those of the reference first."""
    truth = results.truths.get(scene)
    if truth:
        yield Curve("truth", truth_frame(truth), TRUTH_LOOK, is_shown=True)
    labels = {record.variant.label for record in one_per_variant(results.records)}
    looks = looks_of(
        {label: variant for label, variant in variants_of(results).items() if label in labels}
    )
    # A run of an engine without static friction has a truth of its own.
    truths = {key: results.truths.get(name) for key, name in results.truth_of_runs().items()}
    records = one_per_variant(record for record in results.records if record.scene == scene)
    for record in sorted(records, key=lambda record: record.variant.engine != "reference"):
        # Of the variants of the reference, only event-driven integration is shown at first.
        is_engine = record.variant.engine != "reference"
        is_shown = is_engine or record.run.settings.get("method") == "event"
        yield Curve(
            run_label(record),
            record.run.to_frame(events=True, interpolated=True),
            looks[record.variant.label],
            is_shown,
            truths.get(record.key) or truth,
        )


def _panels(scene: Scene, curves: Sequence[Curve]) -> dict[str, str]:
    """Return the columns that have a panel, at most `MAX_PANELS`, and the titles of the panels."""
    columns = dict.fromkeys(column for curve in curves for column in curve.frame)
    panels: dict[str, str] = {}
    for pattern, quantity in QUANTITIES.items():
        for column in columns:
            if re.search(pattern, column):
                # Corners have numbers, so that the element alone would not identify them.
                element = column if quantity == CORNER else column.rpartition(".")[0]
                panels[column] = f"{quantity} {element} [{unit_of(column, scene)}]"
    return dict(list(panels.items())[:MAX_PANELS])


class _Numbers:
    """The compressed columns of a view.

    Time columns that several lines share are stored once.
    """

    def __init__(self) -> None:
        self.columns = Columns()
        self._time_columns: dict[bytes, int] = {}

    def add_times(self, t: np.ndarray) -> int:
        """Store times in seconds, if they are not stored yet, and return the number of their column."""
        key = t.tobytes()
        if key not in self._time_columns:
            self._time_columns[key] = self.columns.add(t, LONG)
        return self._time_columns[key]


def _view(
    scene: Scene, truth: Truth | None, curves: Sequence[Curve], panels: Mapping[str, str]
) -> View:
    """Return the view of a scene: the values, the differences from the truth, and a film.

    Parameters
    ----------
    truth : Truth or None
        Truth whose stick phases are marked.
    curves : sequence of Curve
        The truth and the runs.
    panels : mapping of str to str
        Title of each panel, by the column that it shows.
    """
    numbers = _Numbers()
    ranges = {column: _range(column, curves) for column in panels}
    differences = {curve: difference(curve, list(panels)) for curve in curves}
    series = []
    film = _Film(scene, numbers, ranges)
    for curve in curves:
        frame = decimate(curve.frame, ranges)
        line = _series(curve, frame, differences[curve], ranges, numbers)
        series.append(line)
        if film.can_show(curve):
            film.add(curve, frame, line)
    shown_differences = [differences[curve] for curve in curves if curve.is_shown]
    decades = _ranges_of_differences(shown_differences, list(panels))
    value_panels = [
        {"label": title, "log": False, "range": ranges[column]} for column, title in panels.items()
    ]
    difference_panels = [
        {"label": f"|difference| of {title}", "log": True, "range": decades[column]}
        for column, title in panels.items()
    ]
    end = max(float(curve.frame["t"].iloc[-1]) for curve in curves)
    content: dict[str, Any] = {
        "x": {"label": "t [s]", "range": [0.0, end], "snap": SAMPLE_STEP},
        "series": series,
        "shades": stick_phases(truth),
        "modes": [
            {"name": "values", "digits": 3, "panels": value_panels},
            {"name": "differences from the truth", "digits": 2, "panels": difference_panels},
        ],
    }
    if film.curves:
        content["film"] = film.content()
    return View((scene.name,), content, numbers.columns)


def _series(
    curve: Curve,
    frame: pd.DataFrame,
    differences: pd.DataFrame,
    ranges: Mapping[str, Sequence[float]],
    numbers: _Numbers,
) -> dict[str, Any]:
    """Return a line of all panels as ``chart.js`` reads it, and store its numbers.

    Parameters
    ----------
    frame : DataFrame
        The rows of the curve that are shown.
    differences : DataFrame
        Logarithms of its differences from the truth, or an empty table.
    ranges : mapping
        Range of the axis of each panel, by column.
    """
    t = numbers.add_times(frame["t"].to_numpy())
    values: list[int | None] = []
    for column, (low, high) in ranges.items():
        if column in frame:
            clipped = _clip(frame[column].to_numpy(), (low, high))
            values.append(numbers.columns.add(clipped, step=RESOLUTION * (high - low)))
        else:
            values.append(None)
    t_of_differences = None
    if not differences.empty:
        t_of_differences = numbers.add_times(differences["t"].to_numpy())
    logarithms: list[int | None] = []
    for column in ranges:
        if column in differences:
            logarithms.append(numbers.columns.add(differences[column], step=LOGARITHM_STEP))
        else:
            logarithms.append(None)
    dashes = []
    if curve.look.dashes != "-":
        _, lengths = curve.look.dashes
        dashes = [PX_PER_POINT * length for length in lengths]
    return {
        "name": curve.label,
        "color": "ink" if curve.look.color == BLACK else curve.look.color,
        "dash": dashes,
        "marker": False,
        "shown": curve.is_shown,
        "x": [t, t_of_differences],
        "y": [values, logarithms],
    }


class _Film:
    """The film of a scene, in which the mechanism moves as in one of the runs.

    The page shows the film of a run only if the run has the positions of all bodies.
    """

    def __init__(self, scene: Scene, numbers: _Numbers, ranges: Mapping[str, Sequence[float]]):
        self.curves: list[Curve] = []
        self._scene = scene
        self._numbers = numbers
        self._ranges = ranges
        self._runs: list[dict[str, Any]] = []
        self._signs_of_loads: dict[int, dict[str, int]] = {}

    def can_show(self, curve: Curve) -> bool:
        """Return whether a curve has the positions of all bodies."""
        return set(pose_columns(self._scene)) <= set(curve.frame)

    def add(self, curve: Curve, frame: pd.DataFrame, line: Mapping[str, Any]) -> None:
        """Add a run to the film.

        Parameters
        ----------
        curve : Curve
            The run.
        frame : DataFrame
            Its rows that are shown.
        line : mapping
            The line of the run in the panels, whose numbers the film shares where possible.
        """
        values_in_panels = dict(zip(self._ranges, line["y"][0]))
        columns = {}
        for name in (*pose_columns(self._scene), *force_columns(self._scene)):
            if name not in frame:
                continue
            # Numbers of a panel may be clipped, which the mechanism must not be.
            if name in self._ranges and _is_complete(frame[name], self._ranges[name]):
                columns[name] = values_in_panels[name]
            else:
                step = RESOLUTION * _spread(frame[name])
                columns[name] = self._numbers.columns.add(frame[name], step=step)
        time_column = line["x"][0]
        self.curves.append(curve)
        self._runs.append({"name": curve.label, "t": time_column, "columns": columns})
        # Loads depend on time alone, so that runs with the same times share their signs.
        if time_column not in self._signs_of_loads:
            signs = load_signs(self._scene, frame["t"].to_numpy())
            self._signs_of_loads[time_column] = {
                load: self._numbers.columns.add(sign) for load, sign in signs.items()
            }

    def content(self) -> dict[str, Any]:
        """Return the film as ``player.js`` reads it; its section of the plane fits the first run."""
        frame = self.curves[0].frame
        columns = {name: frame[name].to_numpy() for name in frame}
        rows = range(0, len(frame), max(1, len(frame) // POSES_FOR_VIEW))
        view = view_of(self._scene, [poses_at(self._scene, columns, row) for row in rows])
        return {
            "mechanism": mechanism(self._scene, view),
            "largest": largest_force(self._scene, columns),
            "runs": self._runs,
            "common": self._signs_of_loads,
        }


def _range(column: str, curves: Sequence[Curve]) -> list[float]:
    """Return the range of an axis, which fits the first curve that has values.

    This is the truth or the best run. Spikes of an engine may therefore leave the panel.
    """
    values: np.ndarray | pd.Series = np.zeros(1)
    for curve in curves:
        if column in curve.frame and curve.frame[column].notna().any():
            values = curve.frame[column].dropna()
            break
    low = float(values.min())
    high = float(values.max())
    margin = AXIS_MARGIN * (high - low) or 1.0
    return [low - margin, high + margin]


def _clip(values: np.ndarray, axis: Sequence[float]) -> np.ndarray:
    """Clip values that are far outside of the range of an axis, so that the others keep their digits."""
    low, high = axis
    distance = CLIP_FACTOR * (high - low)
    return np.clip(values, low - distance, high + distance)


def _spread(values: pd.Series) -> float:
    """Return the difference between the largest and the smallest value without spikes, or 1 if it is zero."""
    if not values.notna().any():
        return 1.0
    low, high = values.quantile([SPIKE_FRACTION, 1.0 - SPIKE_FRACTION])
    return float(high - low) or 1.0


def _is_complete(values: pd.Series, axis: Sequence[float]) -> bool:
    """Return whether all values are numbers that are not clipped."""
    return bool((_clip(values.to_numpy(), axis) == values.to_numpy()).all())


def decimate(frame: pd.DataFrame, ranges: Mapping[str, Sequence[float]]) -> pd.DataFrame:
    """Return the rows of a motion that a chart needs.

    These are a row per `SAMPLE_STEP`, both rows of each event, the last row, and between them the rows
    that deviate by more than `MAX_DEVIATION` from a straight line.

    Parameters
    ----------
    frame : DataFrame
        Column ``t`` and the columns of the motion.
    ranges : mapping
        Range of the axis of each column that is shown.
    """
    t = frame["t"].to_numpy()
    rows = np.arange(len(t))
    before_event = np.flatnonzero(np.diff(t) == 0.0)
    kept = np.unique(
        [*_first_per_step(SAMPLE_STEP, t), *before_event, *(before_event + 1), len(t) - 1]
    )
    # A chart draws straight lines between rows. Where a line deviates visibly from the motion, the worst
    # row between two rows is added.
    for _ in range(REFINEMENTS):
        # Largest deviation of each row in any column, as a fraction of the axis
        deviation = np.zeros(len(t))
        for column, (low, high) in ranges.items():
            if column in frame:
                values = frame[column].to_numpy()
                line = np.interp(rows, kept, values[kept])
                deviation = np.fmax(deviation, np.abs(values - line) / (high - low))
        # The row with the largest deviation between each two rows that are kept
        worst = pd.Series(deviation).groupby(np.searchsorted(kept, rows)).idxmax()
        kept = np.unique([*kept, *worst[deviation[worst] > MAX_DEVIATION]])
    return frame.iloc[kept]


def _first_per_step(step: float, t: np.ndarray) -> np.ndarray:
    """Return the index of the first time in each interval of length `step`, s."""
    # Times that are multiples of the step may be slightly smaller due to rounding.
    rounding = 1e-6
    return np.unique(np.floor(t / step + rounding), return_index=True)[1]


def difference(curve: Curve, columns: Sequence[str]) -> pd.DataFrame:
    """Return ``t`` and, for each column, log10 of the magnitude of the difference from the truth.

    There is a row per `DIFFERENCE_STEP` at which both the curve and the truth have a sample. Columns that
    one of them lacks are left out. The table is empty without a truth.
    """
    if curve.truth is None:
        return pd.DataFrame({"t": []})
    samples = _samples(curve.frame)
    truth_samples = _samples(truth_frame(curve.truth)).add_suffix(TRUTHS)
    time_of_truth = "t" + TRUTHS
    rows = pd.merge_asof(
        samples,
        truth_samples,
        left_on="t",
        right_on=time_of_truth,
        # s: only samples of the same time, apart from rounding, are compared
        tolerance=1e-9,
        direction="nearest",
    )
    rows = rows[rows[time_of_truth].notna()]
    rows = rows.iloc[_first_per_step(DIFFERENCE_STEP, rows["t"].to_numpy())]
    logarithms = {"t": rows["t"]}
    for column in columns:
        if column in rows and column + TRUTHS in rows:
            magnitudes = np.abs(rows[column] - rows[column + TRUTHS])
            logarithms[column] = np.log10(magnitudes.where(magnitudes > MIN_DIFFERENCE))
    return pd.DataFrame(logarithms)


def _samples(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a motion without those of events, at whose times it has several values."""
    return frame[~frame["t"].duplicated(keep=False)]


def _ranges_of_differences(
    differences: Iterable[pd.DataFrame], columns: Sequence[str]
) -> dict[str, list[float]]:
    """Return the ranges of the logarithmic axes, in whole decades.

    They contain the differences without the smallest 1 % and the largest 0.1 %, which may be zero
    crossings and spikes.
    """
    frames = list(differences)
    # Without curves there are no differences; each axis then has one decade.
    rows = pd.concat(frames) if frames else pd.DataFrame()
    ranges = {}
    for column in columns:
        low, high = 0.0, 0.0
        if column in rows and rows[column].notna().any():
            low, high = np.quantile(rows[column].dropna(), [0.01, 0.999])
        first_decade = np.floor(low)
        last_decade = max(np.ceil(high), first_decade + 1)
        ranges[column] = [float(first_decade), float(last_decade)]
    return ranges
