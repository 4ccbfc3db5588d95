"""Numbers of the recommendation on page one: errors and times of our own solvers, and errors of the engines."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import grouped_methods, made_methods, methods, same_work
from stiction.comparisons.bench.participants import PAPERS_SCHEME, REFERENCE
from stiction.comparisons.bench.presentation import row_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import truth_key
from stiction.comparisons.studies.paper_figures import stick_phases
from stiction.engines.registry import own_methods
from stiction.reference_impl.multibody.equation_summary import is_prescribed
from stiction.scenes import Scene
from stiction.scenes.fidelity import Fidelity
from stiction.truths import Tier, Truth
from stiction.uncertain import rounded_up

POSITION = "position_error"
"""Column of the largest position error of a run, m."""
TARGET_ERROR = 1e-3
"""Position error for which page one states the CPU time, m."""
SAMPLES = 2401
"""Number of samples of a truth from which the slider's stroke is computed: one every 10 ms in 24 s."""


def mechanism(results: Results) -> dict[str, object] | None:
    """Return what page one says about the paper's mechanism, or None if none of its cases has a truth.

    Returns
    -------
    dict
        ``guide``: ``mu`` and ``mus`` of the first guide with friction, or None; ``cases``: number of
        scenes; ``t_end``: longest simulated time, s; ``strokes``: stroke of the slider in each scene, m;
        ``tiers``: names of the tiers of the truths; ``uncertainty``: uncertainty of the position, m.
    """
    scenes = [
        name
        for name in results.compared_scenes
        if results.is_of_paper(name) and name in results.truths
    ]
    first = results.scene(scenes[0]) if scenes else None
    if first is None or not results.is_about_paper:
        return None
    coefficients = None
    guides = list(first.frictional_guides.values())
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


def own_mechanisms(results: Results) -> list[dict[str, object]]:
    """Return what page one says about each scene, unless all of them are cases of the paper.

    Returns
    -------
    list of dict
        ``scene``: name; ``t_end``: simulated time, s; ``counts``: numbers of bodies, pins, guides, drives,
        springs and loads; ``friction``: name, ``mu`` and ``mus`` of each guide with friction;
        ``stick``: name, number of stick phases and fraction of the time (0 to 1) in them, of each guide with
        friction; ``tier`` and ``note`` of its truth; ``uncertainty``: uncertainty of its positions, m, or None;
        ``is_own``: whether the truth is a run of the reference; ``is_prescribed``: whether drives prescribe the
        motion completely; ``has_runs``: whether runs are recorded, which have a truth or not.
    """
    if results.is_about_paper:
        return []
    rows: list[dict[str, object]] = []
    for name in results.compared_scenes:
        scene = results.scene(name)
        if scene is not None:
            rows.append(
                {
                    **_described_scene(scene),
                    **_described_truth(scene, results.truths),
                    "has_runs": bool(results.records),
                }
            )
    return rows


def _described_scene(scene: Scene) -> dict[str, object]:
    """Return the entries of `own_mechanisms` that depend on the scene alone."""
    counts = {
        "bodies": len(scene.bodies),
        "pins": len(scene.pins),
        "guides": len(scene.guides),
        "drives": len(scene.drives),
        "springs": len(scene.springs),
        "loads": len(scene.forces),
    }
    friction = [
        {"guide": name, "mu": guide.kinetic_coefficient, "mus": guide.static_coefficient}
        for name, guide in scene.frictional_guides.items()
    ]
    return {
        "scene": scene.name,
        "t_end": scene.t_end,
        "counts": counts,
        "friction": friction,
        "is_prescribed": is_prescribed(scene),
    }


def _described_truth(scene: Scene, truths: Mapping[str, Truth]) -> dict[str, object]:
    """Return the entries of `own_mechanisms` that depend on the truth of a scene."""
    # Without the truth for the scene's own coefficients there may be one for mus = mu, or one with clearance.
    names = [
        truth_key(scene.name, static_coefficient, has_gaps)
        for has_gaps in (False, True)
        for static_coefficient in (True, False)
    ]
    truth = next((truths[name] for name in names if name in truths), None)
    if truth is None:
        return {"tier": None, "is_own": False, "note": "", "uncertainty": None, "stick": []}
    stick = []
    for guide in scene.frictional_guides:
        phases = stick_phases(truth, guide)
        share = sum(end - begin for begin, end in phases) / truth.t_end
        stick.append({"guide": guide, "phases": len(phases), "share": share})
    uncertainties = [
        uncertainty
        for column, uncertainty in truth.uncertainty.items()
        if column.endswith((".x", ".y"))
    ]
    return {
        "tier": truth.tier.label,
        "is_own": truth.tier == Tier.OWN_RUN,
        "note": truth.note,
        "uncertainty": rounded_up(max(uncertainties)) if uncertainties else None,
        "stick": stick,
    }


def is_relative_to_own_run(results: Results) -> bool:
    """Return whether errors of at least one run are only known relative to a run of the reference."""
    table = results.table("accuracy")
    return "truth_tier" in table and bool((table["truth_tier"] == Tier.OWN_RUN).any())


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

    scheme = own_method(PAPERS_SCHEME) if PAPERS_SCHEME in worst else None
    return {
        "cases": table["scene"].nunique(),
        "scene": table["scene"].iloc[0],
        "reference": own_method(REFERENCE),
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
