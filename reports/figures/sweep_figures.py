"""Figures of a sweep: curves over one axis, maps over two axes with the stick threshold on them, and maps of bands."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace

import matplotlib
import numpy as np
import pandas as pd
from matplotlib import patheffects
from matplotlib.axes import Axes

from stiction.comparisons.bench.presentation.cells import intervals_of
from stiction.comparisons.bench.quantities import Quantity, quantity_of
from stiction.comparisons.sweep.points import ALL_BANDS, STICK_BANDS, THRESHOLD_COLUMN
from stiction.comparisons.sweep.sweep import Sweep
from stiction.engines.status import Status
from stiction.reports.figures.style import COLORS, Drawing, make_panels
from stiction.scenes import Scene
from stiction.scenes.value_units import unit_of_value
from stiction.truths.bands import BandKind

COLOR_SCALE = "cividis"
"""Scale of the maps. Its lightness increases, also for the colour-blind (Nunez et al. 2018)."""
MISSING_COLOR = "#FFFFFF"
"""Colour of a point without a number, which the scale does not contain; captions call it white."""
TICK_COLOR = "#888888"
"""Colour of the ticks of a map: grey is seen on the darkest and on the lightest colour of the scale."""
THRESHOLD_COLOR = COLORS[1]
"""Colour of the line of the stick threshold: orange, which is far from the blue to yellow of the scale."""
CURVE_HEIGHT = 2.8
"""Height of a curve, inches."""
MAP_HEIGHT = 4.2
"""Height of a map, inches: more than a curve's, as both of its axes are read."""
CURVE_WIDTH = 1.0
"""Line width of a curve, points."""
MARKER_SIZE = 3
"""Diameter of the marker of a run on a curve, points."""
THRESHOLD_WIDTH = 1.4
"""Line width of the stick threshold, points."""
OUTLINE_WIDTH = 2.8
"""Line width of the white line below the threshold, points: it leaves half of this on each side."""
COLORBAR_PAD = 0.02
"""Distance of the colour bar from a map, as a part of the width of the map."""

BAND_COLORS: Mapping[BandKind, str] = {
    BandKind.REST: "#332288",
    BandKind.STICK: "#0072B2",
    BandKind.SLIP: "#E2E2E2",
    BandKind.UNSETTLED: "#E69F00",
    BandKind.UNKNOWN: "#FFFFFF",
}
"""Colours of the kinds of bands: the more rest, the darker; they differ in lightness, also in print without colours."""
COLUMN_GAP = 0.12
"""Part of the distance of two columns of a map of bands that is left white: bands were computed in columns alone."""


def sweep_drawings(sweep: Sweep) -> Iterator[Drawing]:
    """Yield a drawing for each measure of a sweep, for its stick threshold and its bands. Draw under `style.rc()`.

    A table over one axis is drawn as a curve, and one over two axes as a map. Other tables have no drawing.
    """
    scene = sweep.specification.scene
    for measure in sweep.specification.run_measures:
        subject = measure.subject(scene)
        name = f"{measure.name} of {subject}" if subject else measure.name
        yield from _drawing(sweep, sweep.map, measure.quantity, name)
    threshold = replace(quantity_of(THRESHOLD_COLUMN), unit=sweep.specification.varied_unit)
    yield from _drawing(sweep, sweep.threshold, threshold, "stick threshold")
    yield from _band_drawing(sweep)


def _drawing(
    sweep: Sweep, table: pd.DataFrame | None, quantity: Quantity, name: str
) -> Iterator[Drawing]:
    """Yield the drawing of a quantity of a table, if the table has numbers of it, and one axis or two."""
    if table is None or table[quantity.key].isna().all():
        return
    axes = [axis.key for axis in sweep.specification.axes if axis.key in table]
    if len(axes) == 1:
        yield _curve(sweep, table, axes[0], quantity, name)
    elif len(axes) == 2:
        yield _map(sweep, table, (axes[0], axes[1]), quantity, name)


def _caption(sweep: Sweep, table: pd.DataFrame, name: str, runs: str) -> str:
    """Return the subject and the method of a drawing, and the number of points without a value by reason."""
    specification = sweep.specification
    scene = specification.scene
    run = specification.run
    engine = "the reference"
    if run.engine != "reference":
        engine = f"{run.engine}, {run.fidelity.label}"
    step = run.step(scene)
    method = f"relative tolerance {run.rtol:g}" if step is None else f"dt = {step:g} s at most"
    caption = (
        f"{scene.title or scene.name}: {name} in the steady state, "
        f"{runs} runs of {engine}, {method}"
    )
    failed = table.loc[table["status"] != Status.OK, "status"].value_counts()
    if failed.empty:
        return caption
    reasons = [f"{count} {Status(status).label}" for status, count in failed.items()]
    return f"{caption}; points without a number: {', '.join(reasons)}"


def _curve(sweep: Sweep, table: pd.DataFrame, axis: str, quantity: Quantity, name: str) -> Drawing:
    """Draw a quantity over the only axis of a table."""
    points = table.sort_values(axis)
    figure, [[ax]] = make_panels(1, 1, CURVE_HEIGHT)
    ax.plot(
        points[axis],
        points[quantity.key],
        "o-",
        color=COLORS[0],
        markersize=MARKER_SIZE,
        linewidth=CURVE_WIDTH,
    )
    ax.set(xlabel=_label(sweep.specification.scene, axis), ylabel=quantity.head)
    caption = _caption(sweep, table, name, str(len(points)))
    return Drawing(f"curve-{_file_name(quantity)}", f"{caption}.", figure)


def _map(
    sweep: Sweep, table: pd.DataFrame, axes: tuple[str, str], quantity: Quantity, name: str
) -> Drawing:
    """Draw a quantity by colours over the two axes of a table, the first to the right and the second up."""
    right, up = axes
    grid = table.pivot(index=up, columns=right, values=quantity.key)
    figure, [[ax]] = make_panels(1, 1, MAP_HEIGHT)
    ax.set_facecolor(MISSING_COLOR)
    mesh = ax.pcolormesh(
        grid.columns,
        grid.index,
        grid.to_numpy(),
        shading="nearest",
        rasterized=True,
        cmap=matplotlib.colormaps[COLOR_SCALE],
    )
    ax.tick_params(color=TICK_COLOR)
    figure.colorbar(mesh, ax=ax, label=quantity.head, pad=COLORBAR_PAD)
    caption = _caption(sweep, table, name, f"{len(grid.columns)} x {len(grid.index)}")
    if grid.isna().to_numpy().any():
        caption += ", white"
    # Only a map with an axis of the searched parameter can show its threshold.
    search = sweep.specification.band_search
    thresholds = sweep.threshold
    if (
        search is not None
        and search.parameter in axes
        and thresholds is not None
        and thresholds[THRESHOLD_COLUMN].notna().any()
    ):
        _draw_threshold(ax, thresholds, axes, search.parameter)
        figure.legend(loc="outside upper right")
        caption += (
            f"; line: largest {search.parameter}, in the band around the scene's own value, at which the "
            "motion still has a stick phase; drawn where it lies in the range shown"
        )
    scene = sweep.specification.scene
    ax.set(xlabel=_label(scene, right), ylabel=_label(scene, up))
    return Drawing(f"map-{_file_name(quantity)}", f"{caption}.", figure)


def _draw_threshold(
    ax: Axes, threshold: pd.DataFrame, axes: tuple[str, str], searched: str
) -> None:
    """Draw the stick threshold on a map over the searched parameter and another axis."""
    right, up = axes
    if right == searched:
        curve = threshold.sort_values(up)
        x, y = curve[THRESHOLD_COLUMN], curve[up]
    else:
        curve = threshold.sort_values(right)
        x, y = curve[right], curve[THRESHOLD_COLUMN]
    ax.plot(
        x,
        y,
        color=THRESHOLD_COLOR,
        linewidth=THRESHOLD_WIDTH,
        label="stick threshold",
        path_effects=[patheffects.withStroke(linewidth=OUTLINE_WIDTH, foreground="white")],
    )
    # The ends of the other bands within the map, as points: they are not one curve.
    ends = [
        (end, row[up if right == searched else right])
        for row in threshold.to_dict("records")
        for interval in intervals_of(row[STICK_BANDS])
        for end in interval
        if end != row[THRESHOLD_COLUMN]
    ]
    if ends:
        values, others = zip(*ends)
        places = (values, others) if right == searched else (others, values)
        ax.plot(
            *places,
            "o",
            color=THRESHOLD_COLOR,
            markersize=MARKER_SIZE,
            markeredgecolor="white",
            label="other ends of stick bands",
        )


def _band_drawing(sweep: Sweep) -> Iterator[Drawing]:
    """Yield the map of the bands over the only axis of the table of thresholds, if it has one axis."""
    search, table = sweep.specification.band_search, sweep.threshold
    if search is None or table is None:
        return
    axes = [axis.key for axis in sweep.specification.axes if axis.key in table]
    if len(axes) != 1:
        return
    [axis] = axes
    points = table.sort_values(axis)
    places = points[axis].to_numpy(float)
    edges = _column_edges(places)
    figure, [[ax]] = make_panels(1, 1, MAP_HEIGHT)
    named_kinds: set[BandKind] = set()
    for (left, right), text in zip(edges, points[ALL_BANDS]):
        for low, high, kind_name in json.loads(text) if text else []:
            kind = BandKind(kind_name)
            # Each kind is named once in the legend.
            label = "" if kind in named_kinds else str(kind)
            named_kinds.add(kind)
            ax.bar(
                left,
                high - low,
                right - left,
                bottom=low,
                align="edge",
                color=BAND_COLORS[kind],
                label=label or None,
            )
    figure.legend(loc="outside upper center", ncols=len(named_kinds))
    ax.set_xlim(edges[0][0], edges[-1][1])
    ax.margins(y=0)
    scene = sweep.specification.scene
    ax.set(xlabel=_label(scene, axis), ylabel=_label(scene, search.parameter))
    name = f"bands of {search.parameter} in which the slider rests, sticks or slips"
    caption = _caption(sweep, table, name, f"{len(places)} columns of")
    yield Drawing("map-bands", f"{caption}.", figure)


def _column_edges(places: np.ndarray) -> list[tuple[float, float]]:
    """Return the left and right edge of the column of each of increasing places; neighbours are a gap apart."""
    if len(places) == 1:
        half = 0.05 * abs(places[0]) or 0.5
        return [(float(places[0]) - half, float(places[0]) + half)]
    middles = 0.5 * (places[1:] + places[:-1])
    lefts = np.concatenate([[2 * places[0] - middles[0]], middles])
    rights = np.concatenate([middles, [2 * places[-1] - middles[-1]]])
    gap = 0.5 * COLUMN_GAP * float(np.min(rights - lefts))
    return [(float(left + gap), float(right - gap)) for left, right in zip(lefts, rights)]


def _file_name(quantity: Quantity) -> str:
    """Return the name of a quantity as a part of a file name, for example ``peak-speed-of-block``."""
    return quantity.label.replace(" ", "-")


def _label(scene: Scene, key: str) -> str:
    """Return the label of an axis: its key, with the unit where that is known; ``-`` is that of a ratio."""
    unit = unit_of_value(scene, key)
    return key if unit is None else f"{key} [{unit or '-'}]"
