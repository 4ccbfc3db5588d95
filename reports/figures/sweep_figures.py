"""Figures of a sweep: a curve over one axis, or a map over two axes with the stick threshold drawn on it."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib
import pandas as pd
from matplotlib import patheffects
from matplotlib.axes import Axes

from stiction.comparisons.bench.presentation.cells import intervals_of
from stiction.comparisons.bench.quantities import Quantity, quantity_of
from stiction.comparisons.measures.reference_bands import AMPLITUDE
from stiction.comparisons.sweep.sweep import STICK_BANDS, THRESHOLD_COLUMN, Sweep
from stiction.engines.status import Status
from stiction.reports.figures.style import COLORS, Drawing, make_panels
from stiction.scenes import Scene

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

UNITS = {
    AMPLITUDE: "N",
    "amplitude": "N",
    "frequency": "rad/s",
    "phase": "rad",
    "mass": "kg",
    "inertia": "kg m$^2$",
    "mu": "-",
    "mus": "-",
    "length": "m",
    "width": "m",
}
"""Units by the last part of the key of an axis. The units of a scene's own parameters are not known."""


def sweep_drawings(sweep: Sweep) -> Iterator[Drawing]:
    """Yield a drawing for each measure of a sweep, and for its stick threshold. Draw under `style.rc()`.

    A table over one axis is drawn as a curve, and one over two axes as a map. Other tables have no drawing.
    """
    scene = sweep.specification.scene
    for measure in sweep.specification.run_measures:
        subject = measure.subject(scene)
        name = f"{measure.name} of {subject}" if subject else measure.name
        yield from _drawing(sweep, sweep.map, measure.quantity, name)
    yield from _drawing(sweep, sweep.threshold, quantity_of(THRESHOLD_COLUMN), "stick threshold")


def _drawing(
    sweep: Sweep, table: pd.DataFrame | None, quantity: Quantity, name: str
) -> Iterator[Drawing]:
    """Yield the drawing of a quantity of a table, if the table exists and has one axis or two."""
    if table is None:
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
    # The threshold is a load amplitude, so that only a map with that axis can show it.
    if AMPLITUDE in axes and sweep.threshold is not None:
        _draw_threshold(ax, sweep.threshold, axes)
        figure.legend(loc="outside upper right")
        caption += (
            f"; line: largest {AMPLITUDE}, in the band around the scene's own value, at which the "
            "motion still has a stick phase; drawn where it lies in the range shown"
        )
    scene = sweep.specification.scene
    ax.set(xlabel=_label(scene, right), ylabel=_label(scene, up))
    return Drawing(f"map-{_file_name(quantity)}", f"{caption}.", figure)


def _draw_threshold(ax: Axes, threshold: pd.DataFrame, axes: tuple[str, str]) -> None:
    """Draw the stick threshold on a map over the load amplitude and another axis."""
    right, up = axes
    if right == AMPLITUDE:
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
        (end, row[up if right == AMPLITUDE else right])
        for row in threshold.to_dict("records")
        for interval in intervals_of(row[STICK_BANDS])
        for end in interval
        if end != row[THRESHOLD_COLUMN]
    ]
    if ends:
        amplitudes, others = zip(*ends)
        places = (amplitudes, others) if right == AMPLITUDE else (others, amplitudes)
        ax.plot(
            *places,
            "o",
            color=THRESHOLD_COLOR,
            markersize=MARKER_SIZE,
            markeredgecolor="white",
            label="other ends of stick bands",
        )


def _file_name(quantity: Quantity) -> str:
    """Return the name of a quantity as a part of a file name, for example ``peak-speed-of-block``."""
    return quantity.label.replace(" ", "-")


def _label(scene: Scene, key: str) -> str:
    """Return the label of an axis: its key, with the unit where that is known."""
    unit = _unit(scene, key)
    return key if unit is None else f"{key} [{unit}]"


def _unit(scene: Scene, key: str) -> str | None:
    """Return the unit of a scene's number, or None where it is not known."""
    element, _, field = key.rpartition(".")
    drive = scene.drives.get(element.removeprefix("drives.").removesuffix(".law"))
    if drive is not None and field == "rate":
        return "rad/s" if drive.type == "angle" else "m/s"
    return UNITS.get(field)
