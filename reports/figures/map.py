"""A sweep over one axis as a curve; over two as a map, with the stick threshold drawn on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import matplotlib
import pandas as pd
from matplotlib import patheffects

from stiction.comparisons.bench.quantities import Quantity, quantity_of
from stiction.comparisons.studies.threshold import AMPLITUDE
from stiction.comparisons.sweep.sweep import THRESHOLD_COLUMN, Sweep
from stiction.engines.status import Status
from stiction.reports.figures.style import COLORS, Drawing, panels
from stiction.scenes import Scene

SCALE, MISSING = "cividis", "#FFFFFF"
"""Colours whose lightness increases, for the colour-blind (Nunez et al. 2018); colour of a point without a number."""

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
"""Units by the last part of an axis' key; those of a scene's parameters are not known."""


def sweep_drawings(sweep: Sweep) -> Iterator[Drawing]:
    """A drawing per measure of a sweep over one axis or two; none for other sweeps. Draw under `style.rc()`."""
    scene = sweep.specification.scene
    measured = [
        (
            sweep.map,
            measure.quantity,
            f"{measure.name} of {subject}" if (subject := measure.subject(scene)) else measure.name,
        )
        for measure in sweep.specification.run_measures
    ]
    for table, quantity, name in (
        *measured,
        (sweep.threshold, quantity_of(THRESHOLD_COLUMN), "stick threshold"),
    ):
        axes = (
            []
            if table is None
            else [axis.key for axis in sweep.specification.axes if axis.key in table]
        )
        if len(axes) in (1, 2):
            yield (_curve if len(axes) == 1 else _map)(sweep, table, axes, quantity, name)


def _caption(sweep: Sweep, table: pd.DataFrame, name: str, runs: str) -> str:
    """The subject of a drawing, and how many points have no number for which reason."""
    specification, scene = sweep.specification, sweep.specification.scene
    run = specification.run
    method = (
        f"relative tolerance {run.rtol:g}"
        if (step := run.step(scene)) is None
        else f"dt = {step:g} s at most"
    )
    engine = "the reference" if run.engine == "reference" else f"{run.engine}, {run.fidelity.label}"
    caption = f"{scene.title or scene.name}: {name} in the steady state, {runs} runs of {engine}, {method}"
    failed = table.loc[table["status"] != Status.OK, "status"].value_counts()
    missing = [f"{count} {Status(status).label}" for status, count in failed.items()]
    return caption + (f"; points without a number: {', '.join(missing)}" if missing else "")


def _curve(
    sweep: Sweep, table: pd.DataFrame, axes: Sequence[str], quantity: Quantity, name: str
) -> Drawing:
    [key] = axes
    points = table.sort_values(key)
    figure, [[ax]] = panels(1, 1, 2.8)
    ax.plot(points[key], points[quantity.key], "o-", color=COLORS[0], markersize=3, linewidth=1.0)
    ax.set(xlabel=_label(sweep.specification.scene, key), ylabel=quantity.head)
    return Drawing(
        f"curve-{_file_name(quantity)}",
        _caption(sweep, table, name, str(len(points))) + ".",
        figure,
    )


def _map(
    sweep: Sweep, table: pd.DataFrame, axes: Sequence[str], quantity: Quantity, name: str
) -> Drawing:
    across, up = axes
    grid = table.pivot(index=up, columns=across, values=quantity.key)
    figure, [[ax]] = panels(1, 1, 4.2)
    ax.set_facecolor(MISSING)
    mesh = ax.pcolormesh(
        grid.columns,
        grid.index,
        grid.to_numpy(),
        shading="nearest",
        rasterized=True,
        cmap=matplotlib.colormaps[SCALE],
    )
    ax.tick_params(color="#888888")
    figure.colorbar(mesh, ax=ax, label=quantity.head, pad=0.02)
    caption = _caption(sweep, table, name, f"{len(grid.columns)} x {len(grid.index)}")
    if grid.isna().to_numpy().any():
        caption += ", white"
    if AMPLITUDE in (across, up) and sweep.threshold is not None:
        other = up if across == AMPLITUDE else across
        curve = sweep.threshold.sort_values(other)
        x, y = ("threshold", other) if across == AMPLITUDE else (other, "threshold")
        ax.plot(
            curve[x],
            curve[y],
            color=COLORS[1],
            linewidth=1.4,
            label="stick threshold",
            path_effects=[patheffects.withStroke(linewidth=2.8, foreground="white")],
        )
        figure.legend(loc="outside upper right")
        caption += (
            f"; line: upper end of the band of {AMPLITUDE}, next to the scene's own, with a stick phase, where "
            "the range shown contains it"
        )
    ax.set(
        xlabel=_label(sweep.specification.scene, across),
        ylabel=_label(sweep.specification.scene, up),
    )
    return Drawing(f"map-{_file_name(quantity)}", caption + ".", figure)


def _file_name(quantity: Quantity) -> str:
    """A measure in the name of a file: ``peak-speed-of-block``."""
    return quantity.label.replace(" ", "-")


def _label(scene: Scene, key: str) -> str:
    element, _, field = key.rpartition(".")
    drive = scene.drives.get(element.removeprefix("drives.").removesuffix(".law"))
    unit = (
        ("rad/s" if drive.type == "angle" else "m/s")
        if drive and field == "rate"
        else UNITS.get(field)
    )
    return f"{key} [{unit}]" if unit else key
