"""Recommendation of page one, in three sentences, from the tables of accuracy and of cost."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import (
    called,
    case_of,
    grouped_methods,
    made_methods,
    methods,
    same_work,
)
from stiction.comparisons.bench.presentation.traced_text import (
    TracedText,
    length,
    listed,
    scaled_value,
    traced,
)
from stiction.comparisons.bench.results import Results
from stiction.engines.registry import own_methods
from stiction.scenes import catalogue, load_scene
from stiction.uncertain import rounded_up

POSITION = "position_error"
CARDINALS = {1: "One", 2: "Two", 3: "Three"}
SAMPLES = 2401
"""Samples of a truth, to find the slider's stroke: every 10 ms of 24 s."""


def mechanism_in_words(results: Results) -> str:
    """Describe what was simulated, in two lines; empty where no truth is there."""
    scenes = [
        name
        for name in dict.fromkeys(record.scene for record in results.records)
        if name in catalogue() and name in results.truths
    ]
    if not scenes:
        return ""
    truths = [results.truths[name] for name in scenes]
    guide = next(iter(load_scene(scenes[0]).frictional_guides.values()), None)
    columns = [truth(np.linspace(0.0, truth.t_end, SAMPLES)) for truth in truths]
    strokes = [f"{np.ptp(each['slider.x']):.2g}" for each in columns if "slider.x" in each]
    friction = (
        "" if guide is None else f" (mu {guide.mu:g}, static mus {guide.static_coefficient:g})"
    )
    end = max(truth.t_end for truth in truths)
    count = CARDINALS.get(len(scenes), len(scenes))
    moved = f", strokes {', '.join(strokes)} m" if strokes else ""
    unsure = max(truth.uncertainty.get("slider.x", 0.0) for truth in truths)
    tiers = " or ".join(dict.fromkeys(truth.tier for truth in truths))
    return (
        f"A motor turns a bar on a spring-held slider that sticks and slips in its guide{friction}. "
        f"{count} case{'s' if len(scenes) > 1 else ''} of {end:g} s{moved}. "
        f"Truth: a separate solution of the reduced equations, {tiers}, its uncertainty at most "
        f"{rounded_up(unsure)} m. The paper's own numbers are missing from our copy of it."
    )


def recommendation(results: Results) -> list[TracedText]:
    """Return the accuracy of the reference, that of existing engines with ideal joints and with contacts, and our own.

    Methods count whose runs succeeded in every case. Engines are compared only where mus and mu are the same and the
    same part of the work is theirs.
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

    cases = table["scene"].nunique()
    where = (
        f"all {CARDINALS.get(cases, str(cases)).lower()} cases"
        if cases > 1
        else case_of(table["scene"].iloc[0])
    )
    answers = [
        traced(
            "Our reference solver is right to {} in {}{}.",
            error(ranked["reference"]),
            where,
            _time(results, "reference"),
        )
    ]
    if (paper := "paper's scheme") in ranked:
        best = table.at[ranked["reference"], POSITION] < table.at[ranked[paper], POSITION]
        answers.append(
            traced(
                "Accuracy: {}the paper's scheme is right to {}{}.",
                "use the reference; " if best else "",
                error(ranked[paper]),
                _time(results, paper),
            )
        )
    for heading, fidelity in (
        ("Existing engines, ideal joints", "joint"),
        ("Existing engines, real contacts", "contact"),
    ):
        parts: dict[str, list[TracedText]] = defaultdict(list)
        engines = False
        for group, variants in grouped_methods(results, same_work):
            if group.fidelity != fidelity:
                continue
            rows = [ranked[variant] for variant in variants if variant in ranked]
            own = [row for row in rows if table.at[row, "engine"] in own_methods()]
            theirs = [row for row in rows if row not in own]
            engines = engines or bool(theirs)
            said = [_span(table, theirs)] if theirs else []
            said += [
                traced("our {} {}", called(table.at[row, "variant"], False), error(row))
                for row in own
                if fidelity == "contact"
            ]
            if said:
                parts[group.coefficients] += said
        if engines:
            answers.append(
                traced(
                    "{}: {}.",
                    heading,
                    listed(
                        [
                            traced(
                                "{}{}",
                                listed(said, last=", "),
                                f" ({label})" if len(parts) > 1 else "",
                            )
                            for label, said in parts.items()
                        ],
                        "; ",
                        "; ",
                    ),
                )
            )
    return answers


def _span(table: pd.DataFrame, rows: list[int]) -> TracedText:
    """Return the methods of one group with the smallest and the largest error."""
    errors = table.loc[rows, POSITION]
    return listed(
        [
            traced(
                "{} {}",
                called(table.at[row, "variant"], False),
                length("accuracy", table, row, POSITION),
            )
            for row in dict.fromkeys((errors.idxmin(), errors.idxmax()))
        ],
        " to ",
        " to ",
    )


def _time(results: Results, variant: str) -> TracedText:
    """``; 1 mm takes 1.2 to 3 ms of CPU``: total times to an error of 1 mm, over all cases in which they are known."""
    table = results.table("equal-error")
    if table.empty:
        return TracedText("")
    there = table.index[
        (table["variant"] == variant)
        & (table["error"] == 1e-3)
        & (table["quantity"] == "position")
        & table["cpu_time"].notna()
    ]
    if not len(there):
        return TracedText("")
    times, ends = table.loc[there, "cpu_time"].astype(float), list[TracedText]()
    for row in dict.fromkeys((int(times.idxmin()), int(times.idxmax()))):
        sign = ("≤ " if table.at[row, "is_bound"] else "") + (
            "~" if table.loc[row].get("timing") else ""
        )
        ends.append(traced("{}", scaled_value("equal-error", table, row, "cpu_time", sign)))
    where = (
        ""
        if len(there) == table["scene"].nunique()
        else traced(" in {}", listed([case_of(scene) for scene in table.loc[there, "scene"]]))
    )
    return traced("; 1 mm takes {} ms of CPU{}", listed(ends, last=" to "), where)
