"""Numbers of the recommendation on page one: errors and times of our own solvers, and errors of the engines."""

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
"""Column of the largest position error of a run, m."""
TARGET_ERROR = 1e-3
"""Position error for which page one states the CPU time, m."""
SAMPLES = 2401
"""Number of samples of a truth from which the slider's stroke is computed: one every 10 ms in 24 s."""


def mechanism(results: Results) -> dict[str, object] | None:
    """Return what page one says about the mechanism, or None if no scene of the catalogue has a truth.

    Returns
    -------
    dict
        ``guide``: ``mu`` and ``mus`` of the first guide with friction, or None; ``cases``: number of
        scenes; ``t_end``: longest simulated time, s; ``strokes``: stroke of the slider in each scene, m;
        ``tiers``: names of the tiers of the truths; ``uncertainty``: uncertainty of the position, m.
    """
    scenes = [
        name
        for name in dict.fromkeys(record.scene for record in results.records)
        if name in catalogue() and name in results.truths
    ]
    if not scenes:
        return None
    coefficients = None
    guides = list(load_scene(scenes[0]).frictional_guides.values())
    if guides:
        coefficients = {"mu": guides[0].mu, "mus": guides[0].static_coefficient}
    truths = [results.truths[name] for name in scenes]
    strokes = []
    for truth in truths:
        motion = truth(np.linspace(0.0, truth.t_end, SAMPLES))
        if "slider.x" in motion:
            strokes.append(float(np.ptp(motion["slider.x"])))
    uncertainty = max(truth.uncertainty.get("slider.x", 0.0) for truth in truths)
    return {
        "guide": coefficients,
        "cases": len(scenes),
        "t_end": max(truth.t_end for truth in truths),
        "strokes": strokes,
        "tiers": list(dict.fromkeys(truth.tier.label for truth in truths)),
        "uncertainty": rounded_up(uncertainty),
    }


def recommendation(results: Results) -> dict[str, object]:
    """Return the errors and CPU times of the reference and of the paper's scheme, and the errors of engines.

    A method counts only if its runs succeeded in every case. Engines are compared only if they have the
    same coefficients of friction and compute the same part of the motion themselves.
    """
    table = results.table("accuracy")
    worst: dict[str, int] = {}
    if POSITION in table:
        compared = made_methods(table, methods(results), POSITION)
        worst = {
            variant: method.worst_row for variant, method in compared.items() if method.is_ranked
        }
    if REFERENCE not in worst:
        return {"reference": None, "scheme": None, "engines": []}

    def own_method(variant: str) -> dict[str, object]:
        """Return the largest error and the CPU times of one of our own solvers."""
        row = row_of("accuracy", table, worst[variant])
        return {"error": row[POSITION], "times": _times(results, variant)}

    scheme = None
    is_better = False
    if PAPERS_SCHEME in worst:
        scheme = own_method(PAPERS_SCHEME)
        is_better = bool(
            table.at[worst[REFERENCE], POSITION] < table.at[worst[PAPERS_SCHEME], POSITION]
        )
    return {
        "cases": table["scene"].nunique(),
        "scene": table["scene"].iloc[0],
        "reference": {**own_method(REFERENCE), "is_better": is_better},
        "scheme": scheme,
        "engines": list(_engines(results, table, worst)),
    }


def _engines(
    results: Results, table: pd.DataFrame, worst: dict[str, int]
) -> Iterator[dict[str, object]]:
    """Yield for each fidelity the engines with the smallest and the largest error in each group.

    The engines of a group do the same work. At the fidelity of contacts, our own solvers are listed
    beside them, each as a group of its own.

    Parameters
    ----------
    worst : dict
        By method, the row of `table` with its largest error.
    """

    def method_and_error(row: int) -> dict[str, object]:
        """Return the name of the method in a row of the table, and its error."""
        cells = row_of("accuracy", table, row)
        return {"variant": cells["variant"], "error": cells[POSITION]}

    for fidelity in Fidelity:
        # Entries by the coefficients of friction, since errors for different physics are not comparable
        parts: dict[str, list[dict[str, object]]] = defaultdict(list)
        has_engines = False
        for group, variants in grouped_methods(results, same_work):
            if group.fidelity != fidelity:
                continue
            rows = [worst[variant] for variant in variants if variant in worst]
            own_rows = [row for row in rows if table.at[row, "engine"] in own_methods()]
            engine_rows = [row for row in rows if row not in own_rows]
            if engine_rows:
                has_engines = True
                errors = table.loc[engine_rows, POSITION]
                closest = int(errors.idxmin())
                farthest = int(errors.idxmax())
                parts[group.coefficients].append(
                    {
                        "closest": method_and_error(closest),
                        "farthest": None if farthest == closest else method_and_error(farthest),
                        "is_own": False,
                    }
                )
            # The text lists the solvers of this suite with ideal guides in sentences of their own.
            if fidelity == Fidelity.CONTACT:
                for row in own_rows:
                    parts[group.coefficients].append(
                        {"closest": method_and_error(row), "farthest": None, "is_own": True}
                    )
        if has_engines:
            yield {
                "fidelity": fidelity,
                "groups": [
                    {"coefficients": coefficients, "parts": entries}
                    for coefficients, entries in parts.items()
                    if entries
                ],
            }


def _times(results: Results, variant: str) -> dict[str, object] | None:
    """Return the shortest and the longest CPU time for `TARGET_ERROR`, over the cases where it is known.

    Returns
    -------
    dict or None
        ``from`` and ``to``: the two times (``to`` is None if only one case is known), with their signs
        ``≤`` and ``~`` in ``from_sign`` and ``to_sign``; ``only_in``: the cases, if these are not all.
    """
    table = results.table("equal-error")
    if table.empty:
        return None
    rows = table[
        (table["variant"] == variant)
        & (table["error"] == TARGET_ERROR)
        & (table["quantity"] == "position")
        & table["cpu_time"].notna()
    ]
    if rows.empty:
        return None
    times = rows["cpu_time"].astype(float)
    shortest = times.idxmin()
    longest = times.idxmax()

    def sign(label: object) -> str:
        """Return ``≤`` for a time that is an upper bound, followed by ``~`` if it is not certain."""
        row = rows.loc[label]
        bound = "≤ " if row["is_bound"] else ""
        approximate = "~" if row.get("timing") else ""
        return bound + approximate

    is_single = shortest == longest
    is_known_everywhere = len(rows) == table["scene"].nunique()
    return {
        "from": row_of("equal-error", table, shortest)["cpu_time"],
        "from_sign": sign(shortest),
        "to": None if is_single else row_of("equal-error", table, longest)["cpu_time"],
        "to_sign": sign(longest),
        "only_in": [] if is_known_everywhere else list(rows["scene"]),
    }
