"""The mechanism, and the paper's Figs. 5-13: slider, corner forces and driving moment of each case, jumps vertical."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import case_of, run_label, title_of
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
from stiction.scenes.pictures.mechanism import parameters_in_words
from stiction.truths import Truth

TIME = "$t$ [s]"
SAMPLES = 2401
"""Samples of a truth, over the whole of its time: every 10 ms of 24 s."""
CASES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3")
"""In the order of the paper's figures."""
FIRST_FIGURE = 5
"""The paper's number of the first figure of its first case; then in the order of `SETS`, case by case."""
SETS = {
    "velocity-acceleration": (
        "velocity and acceleration of the slider",
        {"slider.vx": r"$\dot x_2$ [m/s]", "slider.ax": r"$\ddot x_2$ [m/s$^2$]"},
    ),
    "corner-forces": (
        "normal forces on the corners of the slider",
        {f"guide.F{i}": f"$F_{i}$ [N]" for i in (1, 2, 3, 4)},
    ),
    "driving-moment": ("driving moment", {"motor.effort": r"$\lambda_D$ [N m]"}),
}
"""Figures of a case by the ending of their names: subject, and by column the label of its panel."""


def present(results: Results) -> Presentation:
    """Each distinct mechanism once, as cases that differ in loads alone look the same; then the time series."""
    names, shapes, mechanisms = (
        list(dict.fromkeys(record.scene for record in results.records)),
        [],
        [],
    )
    for name, scene in {name: load_scene(name) for name in names if name in catalogue()}.items():
        if (shape := (scene.bodies, scene.joints)) not in shapes:
            shapes.append(shape)
            given = f" In SI units: {parameters_in_words(scene)}." if scene.parameters else ""
            mechanisms.append(
                MechanismPicture(
                    f"mechanism-{name}",
                    name,
                    caption=f"The mechanism of {case_of(name)} at t = 0, the corners of its slider numbered "
                    f"as in the paper.{given}",
                )
            )
    return Presentation(
        figures=[*mechanisms, *(chart for name in names for chart in _time_series(results, name))]
    )


def _time_series(results: Results, scene: str) -> Iterator[Chart]:
    truth = results.truths.get(scene)
    label, frame = _reference(
        [record for record in results.records if record.scene == scene], truth
    )
    for place, (ending, (subject, labels)) in enumerate(SETS.items()):
        known = {column: words for column, words in labels.items() if column in frame}
        if not known:
            continue
        name, caption = f"{scene}-{ending}", f"{title_of(scene)}: {subject}"
        if scene in CASES:
            number = FIRST_FIGURE + len(SETS) * CASES.index(scene) + place
            name, caption = f"fig{number:02d}-{name}", f"{caption} (the paper's Fig. {number})"
        t = frame["t"].to_numpy()
        time, shades = Axis(TIME, limits=(0.0, float(t[-1]))), stick_phases(truth)
        panels = [
            Panel(
                "", time, Axis(words), [Series(label, t, frame[column].to_numpy())], shades=shades
            )
            for column, words in known.items()
        ]
        shaded = "Grey: stick phases of the truth." if shades else "There are no stick phases."
        yield Chart(
            name,
            panels,
            columns=2 if len(panels) > 2 else 1,
            height=1.35,
            caption=f"{caption}. {shaded}",
        )


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
