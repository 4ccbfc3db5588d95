"""What page one recommends: the accuracy and the times of our own solvers and of existing engines, as rows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import grouped_methods, made_methods, methods, same_work
from stiction.comparisons.bench.participants import PAPERS_SCHEME, REFERENCE
from stiction.comparisons.bench.presentation import row_of
from stiction.comparisons.bench.results import Results
from stiction.engines.registry import own_methods
from stiction.scenes import catalogue, load_scene
from stiction.scenes.fidelity import Fidelity
from stiction.uncertain import rounded_up

POSITION = "position_error"
TARGET = 1e-3
"""Metres: the error for which page one says the CPU time."""
SAMPLES = 2401
"""Samples of a truth, to find the slider's stroke: every 10 ms of 24 s."""


def mechanism(results: Results) -> dict[str, object] | None:
    """Return the parameters of the mechanism, its strokes and the truths; None where there is no truth."""
    scenes = [
        name
        for name in dict.fromkeys(record.scene for record in results.records)
        if name in catalogue() and name in results.truths
    ]
    if not scenes:
        return None
    truths = [results.truths[name] for name in scenes]
    guide = next(iter(load_scene(scenes[0]).frictional_guides.values()), None)
    motions = [truth(np.linspace(0.0, truth.t_end, SAMPLES)) for truth in truths]
    unsure = max(truth.uncertainty.get("slider.x", 0.0) for truth in truths)
    return {
        "guide": guide and {"mu": guide.mu, "mus": guide.static_coefficient},
        "cases": len(scenes),
        "t_end": max(truth.t_end for truth in truths),
        "strokes": [float(np.ptp(each["slider.x"])) for each in motions if "slider.x" in each],
        "tiers": list(dict.fromkeys(truth.tier.label for truth in truths)),
        "uncertainty": rounded_up(unsure),
    }


def recommendation(results: Results) -> dict[str, object]:
    """Return the accuracy and times of the reference and of the paper's scheme, and the accuracy of engines.

    Methods count whose runs succeeded in every case. Engines are compared only where mus and mu are
    the same and the same part of the work is theirs.
    """
    nothing: dict[str, object] = {"reference": None, "scheme": None, "engines": []}
    table = results.table("accuracy")
    if POSITION not in table:
        return nothing
    made = made_methods(table, methods(results), POSITION)
    worst = {variant: method.worst_row for variant, method in made.items() if method.is_ranked}
    if REFERENCE not in worst:
        return nothing

    def own(variant: str) -> dict[str, object]:
        row = row_of("accuracy", table, worst[variant])
        return {"error": row[POSITION], "times": _times(results, variant)}

    scheme = None
    is_better = False
    if PAPERS_SCHEME in worst:
        scheme = own(PAPERS_SCHEME)
        is_better = bool(
            table.at[worst[REFERENCE], POSITION] < table.at[worst[PAPERS_SCHEME], POSITION]
        )
    return {
        "cases": table["scene"].nunique(),
        "scene": table["scene"].iloc[0],
        "reference": {**own(REFERENCE), "is_better": is_better},
        "scheme": scheme,
        "engines": list(_engines(results, table, worst)),
    }


def _engines(
    results: Results, table: pd.DataFrame, worst: dict[str, int]
) -> Iterator[dict[str, object]]:
    """Yield, by fidelity, the closest and the farthest engine of each group that does the same work.

    With contacts our own solver is named beside them, as a group of one.
    """

    def named(row: int) -> dict[str, object]:
        found = row_of("accuracy", table, row)
        return {"variant": found["variant"], "error": found[POSITION]}

    for fidelity in Fidelity:
        parts: dict[str, list[dict[str, object]]] = defaultdict(list)
        has_engines = False
        for group, variants in grouped_methods(results, same_work):
            if group.fidelity != fidelity:
                continue
            rows = [worst[variant] for variant in variants if variant in worst]
            own = [row for row in rows if table.at[row, "engine"] in own_methods()]
            theirs = [row for row in rows if row not in own]
            if theirs:
                has_engines = True
                errors = table.loc[theirs, POSITION]
                closest, farthest = int(errors.idxmin()), int(errors.idxmax())
                parts[group.coefficients].append(
                    {
                        "closest": named(closest),
                        "farthest": named(farthest) if farthest != closest else None,
                        "is_own": False,
                    }
                )
            if fidelity == Fidelity.CONTACT:
                parts[group.coefficients] += [
                    {"closest": named(row), "farthest": None, "is_own": True} for row in own
                ]
        if has_engines:
            yield {
                "fidelity": fidelity,
                "groups": [
                    {"coefficients": coefficients, "parts": found}
                    for coefficients, found in parts.items()
                    if found
                ],
            }


def _times(results: Results, variant: str) -> dict[str, object] | None:
    """Return the shortest and the longest CPU time to an error of 1 mm, over the cases in which it is known."""
    table = results.table("equal-error")
    if table.empty:
        return None
    rows = table[
        (table["variant"] == variant)
        & (table["error"] == TARGET)
        & (table["quantity"] == "position")
        & table["cpu_time"].notna()
    ]
    if rows.empty:
        return None
    times = rows["cpu_time"].astype(float)
    shortest, longest = times.idxmin(), times.idxmax()

    def sign(label: object) -> str:
        row = rows.loc[label]
        return ("≤ " if row["is_bound"] else "") + ("~" if row.get("timing") else "")

    is_one = shortest == longest
    is_everywhere = len(rows) == table["scene"].nunique()
    return {
        "from": row_of("equal-error", table, shortest)["cpu_time"],
        "from_sign": sign(shortest),
        "to": None if is_one else row_of("equal-error", table, longest)["cpu_time"],
        "to_sign": sign(longest),
        "only_in": [] if is_everywhere else list(rows["scene"]),
    }
