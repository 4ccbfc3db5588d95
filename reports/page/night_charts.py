"""Charts of the numbers of nightly runs over the nights."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stiction.comparisons.bench.planned_runs import TRUTH
from stiction.comparisons.bench.presentation.cells import MISSING, setting_of
from stiction.comparisons.bench.quantities import quantity_of
from stiction.reports.page.document import View
from stiction.reports.page.nights import NightFolder, Nights
from stiction.scenes.pictures.picture import CYCLE
from stiction.scenes.pictures.web import LONG, Columns

COLORS = ("ink", *CYCLE[1:])
"""Colours of variants, which are used again, with other dashes, if there are more.

The page defines ``ink`` for light and dark mode.
"""
DASHES = (
    (),
    (6, 3),
    (2, 3),
    (8, 3, 2, 3),
    (14, 4),
    (14, 4, 2, 4),
    (3, 6),
    (8, 3, 2, 3, 2, 3),
    (14, 4, 6, 4),
    (1, 6),
    (20, 4, 2, 4, 2, 4),
    (20, 8),
)
"""Dashes of lines, px; used again if there are more. Methods of equal colour have different dashes for each step."""
DEFAULT_METRIC = "position_error"
"""Metric that a chart shows at first, if it has it."""
CHART_HELP = "Drag to zoom, double-click to reset; with the keyboard +, - and 0."
"""How to use the chart."""
CHART_LEGEND = (
    "One line per variant and step size or tolerance; a variant has the same colour in all charts of a page. "
    "A red ring is a regression. Errors, drift and times are drawn in logarithms where all are > 0; a gap is a "
    "night in which the run failed. Times of different machines are different lines."
)
"""How to read the chart, in Markdown."""
CHART_COLUMNS = (
    "night",
    "machine",
    "key",
    "scene",
    "variant",
    "parameter",
    "step",
    "metric",
    "kind",
    "value",
    "uncertainty",
)
"""Columns of the history that charts need; groups of rows with fewer columns are found faster."""
LOGARITHMIC_KINDS = ("accuracy", "drift", "time")
"""Kinds of metrics that are drawn on logarithmic axes if all values are positive."""
RANGE_MARGIN = 0.05
"""Distance of the values from the ends of an axis, as a fraction of their range."""
CONSTANT_MARGIN = 0.5
"""The same for values that are all equal, in the unit of the axis."""


def night_views(nights: Nights, rows: pd.DataFrame) -> list[View]:
    """Return a view for each metric and scene of some rows of a history, with the labels (metric, scene).

    Those of `DEFAULT_METRIC` are the first.
    Rows without a number are not drawn.
    """
    names = nights.names
    commits = nights.table.set_index("night")["commit_hash"].reindex(names).fillna(MISSING)
    notes = [f"commit {commit}" for commit in commits]
    measured = rows.loc[rows["value"].notna(), list(CHART_COLUMNS)]
    looks = _Looks.of(measured)
    views = {
        (str(metric), str(scene)): _view(
            str(metric), str(scene), part, names, notes, nights.folders, looks
        )
        for (metric, scene), part in measured.groupby(["metric", "scene"], sort=False)
    }
    # Numbers of truths alone, such as the position at the end, come last, because they do not change.
    of_methods = set(measured.loc[measured["variant"] != TRUTH, "metric"])
    order = sorted(
        views, key=lambda place: (place[0] != DEFAULT_METRIC, place[0] not in of_methods)
    )
    return [views[place] for place in order]


@dataclass(frozen=True)
class _Looks:
    """Colours and dashes of lines, which are the same in all charts of a page.

    Attributes
    ----------
    numbers : mapping
        Number of each variant, from 0.
    most_steps : int
        Largest number of steps or tolerances of a variant on a scene.
    """

    numbers: Mapping[str, int]
    most_steps: int

    @classmethod
    def of(cls, rows: pd.DataFrame) -> _Looks:
        """Return the looks of the variants in rows of a history."""
        variants = dict.fromkeys(map(str, rows["variant"]))
        steps = rows.groupby(["variant", "scene"], sort=False)["step"].nunique()
        most_steps = max(1, int(steps.max())) if len(steps) else 1
        return cls({variant: number for number, variant in enumerate(variants)}, most_steps)

    def color(self, variant: str) -> str:
        """Return the colour of a variant."""
        return COLORS[self.numbers[variant] % len(COLORS)]

    def dash(self, variant: str, step_number: int) -> tuple[int, ...]:
        """Return the dashes of a step of a variant; other variants of the same colour have other dashes."""
        variants_before = self.numbers[variant] // len(COLORS)
        return DASHES[(variants_before * self.most_steps + step_number) % len(DASHES)]


def short_names(nights: Sequence[str]) -> list[str]:
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
    folders: Mapping[str, NightFolder],
    looks: _Looks,
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
    looks : _Looks
        Colours and dashes of the lines.
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
        values = _by_night(line.rows, "value", nights)
        uncertainties = _by_night(line.rows, "uncertainty", nights)
        if is_logarithmic:
            # The uncertainty of log10(v) is du / (v ln 10).
            uncertainties = uncertainties / (values * np.log(10))
            values = np.log10(values)
        ends += [np.nanmin(values), np.nanmax(values)]
        name = line.variant
        if line.variant != TRUTH:
            name += f" ({setting_of(first_row['parameter'], first_row['step'])})"
        if names_machine:
            name += f", {first_row['machine']}"
        series.append(
            {
                "name": name,
                "color": looks.color(line.variant),
                "about": line.key,
                "dash": looks.dash(line.variant, line.step_number),
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
            "short": short_names(nights),
            "notes": notes,
        },
        "series": series,
        "shades": [],
        "modes": [{"name": head, "digits": 6, "panels": [panel]}],
    }
    return View((head, scene), content, columns)


def _by_night(rows: pd.DataFrame, column: str, nights: Sequence[str]) -> np.ndarray:
    """Return the values of a column in the order of nights, nan for a night without a row."""
    value_of = dict(zip(rows["night"], rows[column]))
    return np.array([value_of.get(night, np.nan) for night in nights], dtype=float)


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
    step_number : int
        Number of the step size in the variant, from 0.
    rows : DataFrame
        The values, a row for each night.
    """

    variant: str
    key: str
    step_number: int
    rows: pd.DataFrame


def _lines(rows: pd.DataFrame, is_time: bool) -> Iterator[_HistoryLine]:
    """Yield the lines of a chart. Times that were measured on different machines are different lines."""
    keys: list[Hashable] = ["key", "machine"] if is_time else ["key"]
    for variant, variant_rows in rows.groupby("variant", sort=False):
        steps = list(dict.fromkeys(variant_rows["step"]))
        for (key, *_), line_rows in variant_rows.groupby(keys, sort=False):
            step_number = steps.index(line_rows["step"].iloc[0])
            yield _HistoryLine(str(variant), key, step_number, line_rows)


def _nights_with_regression(
    metric: str, key: str, nights: Sequence[str], folders: Mapping[str, NightFolder]
) -> list[int]:
    """Return the numbers of the nights in which a metric of a run, or the whole run, has regressed."""
    subjects = {(metric, key), ("", key)}
    return [number for number, night in enumerate(nights) if subjects & folders[night].regressions]
