"""Recommendation of page one, in three sentences, from the tables of accuracy and of cost."""

from __future__ import annotations

import numpy as np
import pandas as pd

from stiction.comparisons.methods import called, case_of, grouped_methods, made_methods, methods, same_work
from stiction.comparisons.presentation.traced_text import Number, TracedText, length, listed, traced
from stiction.comparisons.results import Results
from stiction.comparisons.uncertain import rounded_up
from stiction.engines.registry import OWN_METHODS
from stiction.scenes import catalogue, load_scene

POSITION = "position error [m]"
SAMPLES = 2401
"""Samples of a truth, to find the slider's stroke: every 10 ms of 24 s."""


def mechanism_in_words(results: Results) -> str:
    """Describe what was simulated, in two lines; empty where no truth is there."""
    scenes = [name for name in dict.fromkeys(record.scene for record in results.records)
              if name in catalogue() and name in results.truths]
    if not scenes:
        return ""
    truths = [results.truths[name] for name in scenes]
    guide = next(iter(load_scene(scenes[0]).frictional_guides.values()), None)
    columns = [truth(np.linspace(0.0, truth.t_end, SAMPLES)) for truth in truths]
    strokes = [f"{np.ptp(each['slider.x']):.2g}" for each in columns if "slider.x" in each]
    friction = "" if guide is None else f" (mu {guide.mu:g}, static mus {guide.static_coefficient:g})"
    end = max(truth.t_end for truth in truths)
    count = {1: "One", 2: "Two", 3: "Three"}.get(len(scenes), len(scenes))
    moved = f", strokes {', '.join(strokes)} m" if strokes else ""
    unsure = max(truth.uncertainty.get("slider.x", 0.0) for truth in truths)
    tiers = " or ".join(dict.fromkeys(truth.tier for truth in truths))
    return (f"A motor turns a bar on a spring-held slider that sticks and slips in its guide{friction}. "
            f"{count} case{'s' if len(scenes) > 1 else ''} of {end:g} s{moved}. "
            f"Truth: a separate solution of the reduced equations, {tiers}, its uncertainty at most "
            f"{rounded_up(unsure)} m. The paper's own numbers are missing from our copy of it.")


def recommendation(results: Results) -> list[TracedText]:
    """Return the accuracy of the reference, then that of existing engines, with ideal joints and with contacts.

    Methods count whose runs succeeded in every case. Engines are compared only where mus and mu are the same and the
    same part of the work is theirs. The suite's own contact solver stands behind them, as its own.
    """
    table = results.table("accuracy")
    if POSITION not in table:
        return []
    found = made_methods(table, methods(results), POSITION)
    ranked = {variant: method.worst_row for variant, method in found.items() if method.is_ranked}
    if "reference" not in ranked:
        return []

    def error(row: int) -> TracedText:
        return length("accuracy", table, row, POSITION)

    answers = [traced("The reference is right to {} in its worst case{}.", error(ranked["reference"]),
                      _time(results, "reference"))]
    if (paper := "paper's scheme") in ranked:
        best = table.at[ranked["reference"], POSITION] < table.at[ranked[paper], POSITION]
        answers.append(traced("Accuracy: {}the paper's scheme is right to {}{}.",
                              "use the reference; " if best else "", error(ranked[paper]), _time(results, paper)))
    for heading, fidelity in (("Existing engines, ideal joints", "joint"),
                              ("Existing engines, real contacts", "contact")):
        parts = []
        for _, group in grouped_methods(results, same_work):
            rows = [ranked[variant] for variant in group if variant in ranked]
            if theirs := [row for row in rows if table.at[row, "fidelity"] == fidelity
                          and table.at[row, "engine"] not in OWN_METHODS]:
                parts.append(_span(table, theirs))
        if parts:
            parts += [traced("our {} {}", called(variant, False), error(row)) for variant, row in ranked.items()
                      if table.at[row, "fidelity"] == fidelity == "contact" and table.at[row, "engine"] in OWN_METHODS]
            answers.append(traced("{}: {}.", heading, listed(parts, "; ", "; ")))
    return answers


def _span(table: pd.DataFrame, rows: list[int]) -> TracedText:
    """Return the methods of one group with the smallest and the largest error."""
    errors = table.loc[rows, POSITION]
    return listed([traced("{} {}", called(table.at[row, "variant"], False), length("accuracy", table, row, POSITION))
                   for row in dict.fromkeys((errors.idxmin(), errors.idxmax()))], " to ", " to ")


def _time(results: Results, variant: str) -> TracedText:
    """``; 1 mm takes 1.2 ms of CPU in case 1``: total time to an error of 1 mm; empty where it is not known."""
    table = results.table("equal-error")
    if table.empty:
        return TracedText("")
    there = table.index[(table["variant"] == variant) & (table["error"] == 1e-3) & (table["quantity"] == "position")
                        & table["cpu [s]"].notna() & (table["scene"] == table["scene"].iloc[0])]
    if not len(there):
        return TracedText("")
    row = int(there[0])
    bound = ("at most " if table.at[row, "at most"] else "") + ("about " if table.loc[row].get("timing") else "")
    cpu = Number(f"{1e3 * table.at[row, 'cpu [s]']:.2g}", "equal-error", "cpu [s]", rows=(row + 1,), factor=1e3)
    return traced("; 1 mm takes {}{} ms of CPU in {}", bound, cpu, case_of(table.at[row, "scene"]))
