"""What to use: the answer of page one, in three sentences, from the tables of accuracy and of cost."""

from __future__ import annotations

import numpy as np
import pandas as pd

from stiction.comparisons.methods import at_equal_step, called, case_of, grouped_methods, largest
from stiction.comparisons.presentation.traced_text import Number, TracedText, listed, traced, value
from stiction.comparisons.results import Results
from stiction.engines.registry import OWN_METHODS
from stiction.scenes import catalogue, load_scene

POSITION = "position error [m]"
SAMPLES = 2401
"""Of a truth, to find the slider's stroke: every 10 ms of 24 s."""


def mechanism_in_words(results: Results) -> str:
    """What was simulated, in two lines; empty where no truth is there."""
    scenes = [name for name in dict.fromkeys(record.scene for record in results.records) if name in catalogue() and name in results.truths]
    if not scenes:
        return ""
    truths = [results.truths[name] for name in scenes]
    guide = next(iter(load_scene(scenes[0]).frictional_guides.values()), None)
    columns = [truth(np.linspace(0.0, truth.t_end, SAMPLES)) for truth in truths]
    strokes = [float(np.ptp(each["slider.x"])) for each in columns if "slider.x" in each]
    friction = "" if guide is None else f" (mu {guide.mu:g}, static mus {guide.static_coefficient:g})"
    cases = f"{_COUNTS.get(len(scenes), len(scenes))} case{'s' if len(scenes) > 1 else ''} of {truths[0].t_end:g} s"
    moved = f", strokes {', '.join(f'{stroke:.2g}' for stroke in strokes)} m" if strokes else ""
    unsure = max((truth.uncertainty.get("slider.x", 0.0) for truth in truths), default=0.0)
    return (f"A motor turns a bar on a spring-held slider that sticks and slips in its guide{friction}. {cases[:1].upper()}{cases[1:]}{moved}. "
            f"Truth: a separate solution of the reduced equations, {truths[0].tier}, its uncertainty at most {unsure:.0e} m. "
            "The paper's own numbers are lost in our text.")


_COUNTS = {1: "one", 2: "two", 3: "three"}


def recommendation(results: Results) -> list[TracedText]:
    """How right the reference is, then which method to use: for accuracy, of the existing engines, with contacts."""
    table = results.table("accuracy")
    if POSITION not in table:
        return []
    worst = {variant: row for _, variants in grouped_methods(results) for variant in variants
             if (row := largest(at_equal_step(table, variant), POSITION)) is not None}
    if "reference" not in worst:
        return []
    first = traced("The reference is right to {} m in its worst case{}.", value("accuracy", table, worst["reference"], POSITION), _time(results, "reference"))
    answers = [first]
    if (paper := "paper's scheme") in worst:
        answers.append(traced("Accuracy: use the reference. The paper's scheme has {} m at equal step{}.", value("accuracy", table, worst[paper], POSITION), _time(results, paper)))
    for heading, fidelity in (("Existing engine, ideal joints", "joint"), ("Existing engine, real contacts", "contact")):
        engines = {variant: row for variant, row in worst.items() if table.at[row, "fidelity"] == fidelity and table.at[row, "engine"] not in OWN_METHODS}
        if engines:
            answers.append(traced("{}: {}.", heading, _ranked(table, engines)))
    return answers


def _ranked(table: pd.DataFrame, engines: dict[str, int]) -> TracedText:
    """The method with the smallest worst error, and the span of the others."""
    order = sorted(engines.values(), key=lambda row: table.at[row, POSITION])
    best, others = order[0], order[1:]
    said = traced("{} has {} m", called(table.at[best, "variant"], False), value("accuracy", table, best, POSITION))
    if not others:
        return said
    ends = [value("accuracy", table, row, POSITION) for row in dict.fromkeys((others[0], others[-1]))]
    return traced("{}, the others {} m", said, listed(ends, " to ", " to "))


def _time(results: Results, variant: str) -> TracedText:
    """``, in 1.2 ms of CPU in case 1``: total time to an error of 1 mm; empty where it is not known."""
    table = results.table("equal-error")
    if table.empty:
        return TracedText("")
    there = table.index[(table["variant"] == variant) & (table["error"] == 1e-3) & (table["quantity"] == "position") & table["cpu [s]"].notna()
                        & (table["scene"] == table["scene"].iloc[0])]
    if not len(there):
        return TracedText("")
    row = int(there[0])
    bound = "at most " if table.at[row, "at most"] else ""
    time = Number(f"{1e3 * table.at[row, 'cpu [s]']:.2g}", "equal-error", "cpu [s]", rows=(row + 1,), factor=1e3)
    return traced("; 1 mm takes {}{} ms of CPU in {}", bound, time, case_of(table.at[row, "scene"]))
