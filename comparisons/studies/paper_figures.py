"""Pictures of the mechanisms, and the paper's Figs. 5-13, redrawn from our results.

The figures show velocity and acceleration of the slider, the corner forces and the driving moment of each case. Unlike
in the paper's figures, jumps are vertical.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import run_label
from stiction.comparisons.bench.presentation import (
    Axis,
    Chart,
    MechanismPicture,
    Panel,
    Presentation,
    Series,
)
from stiction.comparisons.bench.results import PAPERS_CASES, Results
from stiction.comparisons.bench.study import Study
from stiction.comparisons.bench.variants import Record
from stiction.comparisons.measures.steady_stretch import stick_intervals
from stiction.truths import Truth

TIME = "time [s]"
"""Label of the time axes."""
SAMPLES = 2401
"""Number of samples of a truth over the whole of its time: every 10 ms of the 24 s of the paper's cases."""
ROW_HEIGHT = 1.35
"""Height of a row of panels, inches: those of two columns of panels fit on a page."""
FIRST_FIGURE = 5
"""Number of the paper's first figure of its first case.

The figures follow case by case, within a case in the order of `SETS`.
"""
SETS = {
    "velocity-acceleration": {
        "slider.vx": "velocity [m/s]",
        "slider.ax": "acceleration [m/s²]",
    },
    "corner-forces": {f"guide.F{i}": f"corner force F{i} [N]" for i in (1, 2, 3, 4)},
    "driving-moment": {"motor.effort": "driving torque [N m]"},
}
"""Figures of a case by the ending of their names; each maps the column that a panel shows to the label of the panel."""


def present(results: Results) -> Presentation:
    """Present a picture of each distinct mechanism, and the time series of each scene."""
    names = dict.fromkeys(record.scene for record in results.records)
    papers_cases = [name for name in names if results.is_of_paper(name)]
    mechanisms = _distinct_mechanisms(results, papers_cases)
    figures = [figure for name in papers_cases for figure in _time_series(results, name)]
    if not mechanisms and not figures:
        return Presentation()
    rows = {
        "mechanisms": [described(picture) for picture in mechanisms],
        "series": [figure.described() for figure in figures],
    }
    return Presentation(rows=rows, figures=[*mechanisms, *(figure.chart for figure in figures)])


def _distinct_mechanisms(results: Results, names: Sequence[str]) -> list[MechanismPicture]:
    """Return a picture of each scene whose bodies and joints differ from those before.

    Scenes that differ only in their loads look the same.
    """
    shapes, pictures = [], []
    for name in names:
        scene = results.scene(name)
        if scene is None:
            continue
        shape = scene.bodies, scene.joints
        if shape not in shapes:
            shapes.append(shape)
            pictures.append(MechanismPicture(f"mechanism-{name}", scene))
    return pictures


def described(picture: MechanismPicture) -> dict[str, object]:
    """Return what the caption of a picture of a mechanism mentions."""
    scene = picture.scene
    return {
        "figure": picture.name,
        "scene": scene.name,
        "parameters": scene.parameters,
        # The corners of a slider are drawn if it has a length.
        "has_corners": any(guide.length is not None for guide in scene.guides.values()),
    }


@dataclass(frozen=True, eq=False)
class TimeSeries:
    """A figure of one of the `SETS`.

    Attributes
    ----------
    scene : str
        Name of the scene.
    subject : str
        Key in `SETS`.
    number : int or None
        The paper's number of the figure; None if the scene is not one of its cases.
    has_stick_phases : bool
        True if the panels show stick phases in grey.
    chart : Chart
        The figure.
    """

    scene: str
    subject: str
    number: int | None
    has_stick_phases: bool
    chart: Chart

    def described(self) -> dict[str, object]:
        """Return what the caption of the figure mentions."""
        return {
            "figure": self.chart.name,
            "scene": self.scene,
            "subject": self.subject,
            "number": self.number,
            "has_stick_phases": self.has_stick_phases,
        }


def _time_series(results: Results, scene: str) -> Iterator[TimeSeries]:
    """Yield the figures of a scene for those `SETS` of whose columns there are values."""
    truth = results.truths.get(scene)
    records = [record for record in results.records if record.scene == scene]
    label, frame = drawn_motion(records, truth)
    shades = stick_phases(truth)
    for place, (subject, labels) in enumerate(SETS.items()):
        shown = {column: words for column, words in labels.items() if column in frame}
        if not shown:
            continue
        name = f"{scene}-{subject}"
        number = None
        if scene in PAPERS_CASES:
            number = FIRST_FIGURE + len(SETS) * PAPERS_CASES.index(scene) + place
            name = f"fig{number:02d}-{name}"
        t = frame["t"].to_numpy()
        time = Axis(TIME, limits=(0.0, float(t[-1])))
        panels = [
            Panel(
                "", time, Axis(words), [Series(label, t, frame[column].to_numpy())], shades=shades
            )
            for column, words in shown.items()
        ]
        chart = Chart(name, panels, columns=2 if len(panels) > 2 else 1, height=ROW_HEIGHT)
        yield TimeSeries(scene, subject, number, bool(shades), chart)


def drawn_motion(records: list[Record], truth: Truth | None) -> tuple[str, pd.DataFrame]:
    """Return label and samples of the event-driven run with the tightest tolerance, or else of the truth."""
    completed = [
        (record, record.trajectory)
        for record in records
        if record.trajectory is not None
        and record.trajectory.settings.get("method") == "event"
        and record.trajectory.termination == "end"
    ]
    if completed:
        tightest, run = min(completed, key=lambda pair: pair[0].step)
        return run_label(tightest), run.to_frame(events=True, interpolated=True)
    if truth is None:
        return "", pd.DataFrame()
    t = np.linspace(0.0, truth.t_end, SAMPLES)
    return "truth", pd.DataFrame({"t": t, **truth(t)})


def stick_phases(truth: Truth | None, guide: str = "guide") -> list[tuple[float, float]]:
    """Return begin and end (s) of each stick phase of a guide; the last one may end with the truth.

    The list is empty without a truth.
    """
    if truth is None:
        return []
    columns = truth(0.0)
    mode = f"{guide}.mode"
    starts_at_rest = mode in columns and bool(columns[mode][0] == 0)
    events = [event for event in truth.events if event.joint == guide]
    return stick_intervals(events, 0.0, truth.t_end, starts_at_rest)


STUDY = Study("paper", "", "The paper's figures, redrawn", present, compared=False)
