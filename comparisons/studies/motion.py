"""The motion of each scene that is not a case of the paper, and the forces of its guides and drives.

Each scene has a picture of its mechanism and three kinds of figures over time: displacement and slip
velocity of its guides, the forces of each guide, and the efforts of its drives. Every engine is one
line; the reference is drawn last, on top of the others. The study makes no runs of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import drawn_runs, run_label
from stiction.comparisons.bench.participants import REFERENCE
from stiction.comparisons.bench.presentation import (
    Axis,
    Chart,
    MechanismPicture,
    Panel,
    Presentation,
    Series,
)
from stiction.comparisons.bench.presentation.charts import ON_TOP
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Study
from stiction.comparisons.bench.variants import Record
from stiction.comparisons.studies.paper_figures import described, drawn_motion, stick_phases
from stiction.scenes import Scene
from stiction.scenes.columns import label_of

TIME = "time $t$ [s]"
"""Label of the time axes."""
MOTION_OF_GUIDE = ("displacement", "slip_velocity")
"""Columns of a guide that are its motion."""
MOTION_OF_BODY = ("x", "y", "angle")
"""Columns of a body, for mechanisms without guides."""
CORNERS = ("F1", "F2", "F3", "F4")
"""Columns of a guide that are the forces of its corners."""
FORCES_OF_GUIDE = ("normal_force", "friction", *CORNERS)
"""Columns of a guide that are forces, as far as it has them."""
MAX_ELEMENTS = 4
"""Largest number of guides, bodies or drives of a scene that are drawn: the figures then fit on a page."""
ROW_HEIGHT = 1.5
"""Height of a row of panels, inches."""
BEYOND = 0.15
"""Distance from the curve of the reference to the ends of the axis, as a fraction of its range.

Single samples of engines with contacts may be many times larger, and would hide all other curves.
"""
MIN_RANGE = 1e-9
"""Smallest range of a curve that determines an axis; a smaller one is rounding of a constant."""


@dataclass(frozen=True, eq=False)
class _Curve:
    """A run, or the truth, as a line in all panels.

    Attributes
    ----------
    label, look : str
        Text in the legend, and the look of the line.
    frame : DataFrame
        Column ``t`` and the columns of the motion, with two rows for each event.
    """

    label: str
    look: str
    frame: pd.DataFrame


@dataclass(frozen=True, eq=False)
class _Figure:
    """A figure, and what its caption mentions.

    Attributes
    ----------
    chart : Chart
        The figure.
    scene : str
        Name of the scene.
    subject : str
        ``motion``, ``forces`` or ``efforts``.
    of : sequence of str
        Names of the guides, bodies or drives.
    others : int
        Number of further ones that are not drawn.
    has_stick_phases : bool
        True if the panels show stick phases in grey.
    """

    chart: Chart
    scene: str
    subject: str
    of: Sequence[str]
    others: int = 0
    has_stick_phases: bool = False

    def described(self) -> dict[str, object]:
        """Return what the caption mentions."""
        return {
            "figure": self.chart.name,
            "scene": self.scene,
            "subject": self.subject,
            "of": list(self.of),
            "others": self.others,
            "has_stick_phases": self.has_stick_phases,
        }


@dataclass(frozen=True, eq=False)
class _DrawnScene:
    """A scene with the curves of its figures and the stick phases of its guides.

    Attributes
    ----------
    name : str
        Name of the scene.
    scene : Scene
        The scene.
    curves : sequence of _Curve
        The engines, followed by the reference.
    stick : mapping
        Begin and end (s) of the stick phases of each guide.
    """

    name: str
    scene: Scene
    curves: Sequence[_Curve]
    stick: Mapping[str, list[tuple[float, float]]] = field(default_factory=dict)

    def figures(self) -> Iterator[_Figure]:
        """Yield the figures of the scene, without those of which there are no values."""
        guides = list(self.scene.guides)[:MAX_ELEMENTS]
        if guides:
            columns = [f"{guide}.{name}" for guide in guides for name in MOTION_OF_GUIDE]
            others = len(self.scene.guides) - len(guides)
            yield from self._figure("motion", columns, guides, others, len(MOTION_OF_GUIDE))
        else:
            bodies = list(self.scene.bodies)[:MAX_ELEMENTS]
            columns = [f"{body}.{name}" for body in bodies for name in MOTION_OF_BODY]
            others = len(self.scene.bodies) - len(bodies)
            yield from self._figure("motion", columns, bodies, others, len(MOTION_OF_BODY))
        for guide in guides:
            columns = [f"{guide}.{name}" for name in FORCES_OF_GUIDE]
            yield from self._figure("forces", columns, [guide])
        drives = list(self.scene.drives)[:MAX_ELEMENTS]
        columns = [f"{drive}.effort" for drive in drives]
        yield from self._figure("efforts", columns, drives, len(self.scene.drives) - len(drives), 1)

    def _figure(
        self,
        subject: str,
        columns: Sequence[str],
        of: Sequence[str],
        others: int = 0,
        panels_in_row: int = 2,
    ) -> Iterator[_Figure]:
        """Yield the figure with a panel for each column that a curve has; none without panels."""
        shown = [
            column
            for column in columns
            if any(has_values(curve, column) for curve in self.curves)
            # The corners of a slider that is pressed to one side all the time carry nothing.
            and not (is_corner(column) and is_zero(self.curves[-1], column))
        ]
        if not shown:
            return
        name = f"{subject}-{self.name}"
        if subject == "forces":
            name = f"{name}-{of[0]}"
        panels = [self._panel(column) for column in shown]
        chart = Chart(name, panels, min(panels_in_row, len(panels)), ROW_HEIGHT)
        has_stick_phases = any(panel.shades for panel in panels)
        yield _Figure(chart, self.name, subject, of, others, has_stick_phases)

    def _panel(self, column: str) -> Panel:
        """Return the panel of a column; only panels of guides have stick phases."""
        drawn = [curve for curve in self.curves if has_values(curve, column)]
        series = [
            Series(
                curve.label,
                curve.frame["t"].to_numpy(float),
                curve.frame[column].to_numpy(float),
                look=curve.look,
            )
            for curve in drawn
        ]
        end = max(float(curve.frame["t"].iloc[-1]) for curve in drawn)
        y = Axis(label_of(column, self.scene), limits=limits_of(series[-1].y))
        owner = column.rpartition(".")[0]
        return Panel("", Axis(TIME, limits=(0.0, end)), y, series, shades=self.stick.get(owner, ()))


def present(results: Results) -> Presentation:
    """Present a picture and the motion of each scene that is not a case of the paper."""
    pictures = []
    figures: list[_Figure] = []
    for name in dict.fromkeys(record.scene for record in results.records):
        scene = results.scene(name)
        if scene is None or results.is_of_paper(name):
            continue
        pictures.append(MechanismPicture(f"mechanism-{name}", scene))
        figures += drawn_scene(results, scene).figures()
    if not pictures:
        return Presentation()
    rows = {
        "mechanisms": [described(picture) for picture in pictures],
        "series": [figure.described() for figure in figures],
    }
    return Presentation(rows=rows, figures=[*pictures, *(figure.chart for figure in figures)])


def drawn_scene(results: Results, scene: Scene) -> _DrawnScene:
    """Return a scene with one curve for each engine and fidelity, and the reference as the last one."""
    truth = results.truths.get(scene.name)
    curves = [
        _Curve(run_label(record), record.variant.label, record.run.to_frame(events=True))
        for record in drawn_runs(results)
        if record.scene == scene.name and record.variant.engine != REFERENCE
    ]
    records: list[Record] = [record for record in results.records if record.scene == scene.name]
    label, frame = drawn_motion(records, truth)
    if not frame.empty:
        curves.append(_Curve(label, ON_TOP, frame))
    stick = {guide: stick_phases(truth, guide) for guide in scene.frictional_guides}
    return _DrawnScene(scene.name, scene, curves, stick)


def has_values(curve: _Curve, column: str) -> bool:
    """Return whether a curve has a column with at least one value."""
    return column in curve.frame and bool(curve.frame[column].notna().any())


def is_corner(column: str) -> bool:
    """Return whether a column is the force of a corner."""
    return column.rpartition(".")[2] in CORNERS


def is_zero(curve: _Curve, column: str) -> bool:
    """Return whether a curve has a column, and the column is zero at all times."""
    return column in curve.frame and bool((curve.frame[column] == 0.0).all())


def limits_of(values: np.ndarray) -> tuple[float, float] | None:
    """Return the ends of an axis around a curve; None if the curve is constant or has no values."""
    known = values[np.isfinite(values)]
    if len(known) == 0 or np.ptp(known) < MIN_RANGE * max(1.0, float(np.max(np.abs(known)))):
        return None
    margin = BEYOND * float(np.ptp(known))
    return float(known.min()) - margin, float(known.max()) + margin


STUDY = Study(
    "motion",
    "",
    "How does the mechanism move, and with which forces?",
    present,
    compared=False,
)
