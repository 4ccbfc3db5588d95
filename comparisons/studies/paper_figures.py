"""The mechanism, and the paper's Figs. 5-13: slider, corner forces and driving moment of each case, jumps vertical."""

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
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Study
from stiction.comparisons.bench.variants import Record
from stiction.comparisons.measures.steady_stretch import stick_intervals
from stiction.scenes import catalogue, load_scene
from stiction.truths import Truth

TIME = "time [s]"
SAMPLES = 2401
"""Samples of a truth, over the whole of its time: every 10 ms of 24 s."""
CASES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3")
"""In the order of the paper's figures."""
FIRST_FIGURE = 5
"""The paper's number of the first figure of its first case; then in the order of `SETS`, case by case."""
SETS = {
    "velocity-acceleration": {
        "slider.vx": "velocity [m/s]",
        "slider.ax": "acceleration [m/s²]",
    },
    "corner-forces": {f"guide.F{i}": f"corner force F{i} [N]" for i in (1, 2, 3, 4)},
    "driving-moment": {"motor.effort": "driving torque [N m]"},
}
"""Figures of a case by the ending of their names: the label of each panel by the column that it shows."""


def present(results: Results) -> Presentation:
    """Each distinct mechanism once, as cases that differ in loads alone look the same; then the time series."""
    names = list(dict.fromkeys(record.scene for record in results.records))
    mechanisms = _distinct_mechanisms(names)
    series = [one for name in names for one in _time_series(results, name)]
    if not (mechanisms or series):
        return Presentation()
    rows = {
        "mechanisms": [_described(picture) for picture in mechanisms],
        "series": [one.described() for one in series],
    }
    return Presentation(rows=rows, figures=[*mechanisms, *(one.chart for one in series)])


def _distinct_mechanisms(names: Sequence[str]) -> list[MechanismPicture]:
    """A picture of each scene of the catalogue whose bodies and joints are not those of one before."""
    shapes, pictures = [], []
    for name in names:
        if name not in catalogue():
            continue
        scene = load_scene(name)
        shape = scene.bodies, scene.joints
        if shape not in shapes:
            shapes.append(shape)
            pictures.append(MechanismPicture(f"mechanism-{name}", name))
    return pictures


def _described(picture: MechanismPicture) -> dict[str, object]:
    """What the caption of a mechanism mentions; the corners of a slider are drawn where it has a length."""
    scene = load_scene(picture.scene)
    return {
        "figure": picture.name,
        "scene": picture.scene,
        "parameters": scene.parameters,
        "has_corners": any(guide.length is not None for guide in scene.guides.values()),
    }


@dataclass(frozen=True, eq=False)
class TimeSeries:
    """A figure of one of the `SETS`.

    Attributes
    ----------
    number : int or None
        The paper's number of the figure; None of a scene that the paper does not have.
    has_stick_phases : bool
        True if the panels have stick phases in grey.
    """

    scene: str
    subject: str
    number: int | None
    has_stick_phases: bool
    chart: Chart

    def described(self) -> dict[str, object]:
        """What its caption mentions."""
        return {
            "figure": self.chart.name,
            "scene": self.scene,
            "subject": self.subject,
            "number": self.number,
            "has_stick_phases": self.has_stick_phases,
        }


def _time_series(results: Results, scene: str) -> Iterator[TimeSeries]:
    truth = results.truths.get(scene)
    records = [record for record in results.records if record.scene == scene]
    label, frame = _reference(records, truth)
    shades = stick_phases(truth)
    for place, (subject, labels) in enumerate(SETS.items()):
        known = {column: words for column, words in labels.items() if column in frame}
        if not known:
            continue
        name, number = f"{scene}-{subject}", None
        if scene in CASES:
            number = FIRST_FIGURE + len(SETS) * CASES.index(scene) + place
            name = f"fig{number:02d}-{name}"
        t = frame["t"].to_numpy()
        time = Axis(TIME, limits=(0.0, float(t[-1])))
        panels = [
            Panel(
                "", time, Axis(words), [Series(label, t, frame[column].to_numpy())], shades=shades
            )
            for column, words in known.items()
        ]
        chart = Chart(name, panels, columns=2 if len(panels) > 2 else 1, height=1.35)
        yield TimeSeries(scene, subject, number, bool(shades), chart)


def _reference(records: list[Record], truth: Truth | None) -> tuple[str, pd.DataFrame]:
    """Label and samples of the reference at its tightest tolerance, else of the truth."""
    runs = [
        (record, run)
        for record in records
        if (run := record.trajectory) is not None
        and run.settings.get("method") == "event"
        and run.termination == "end"
    ]
    if runs:
        best, run = min(runs, key=lambda pair: pair[0].step)
        return run_label(best), run.to_frame(events=True, interpolated=True)
    if truth is None:
        return "", pd.DataFrame()
    t = np.linspace(0.0, truth.t_end, SAMPLES)
    return "truth", pd.DataFrame({"t": t, **truth(t)})


def stick_phases(truth: Truth | None) -> list[tuple[float, float]]:
    """Begin and end of each, s; one that lasts to the end ends there."""
    if truth is None:
        return []
    starts_at_rest = bool(truth(0.0).get("guide.mode", np.ones(1))[0] == 0)
    return stick_intervals(truth.events, 0.0, truth.t_end, starts_at_rest)


STUDY = Study("paper", "", "The paper's figures, redrawn", present, compared=False)
