"""Table of hard cases: each case with the methods of the reference and with all engines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import pandas as pd

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import variants
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Tables
from stiction.comparisons.bench.variants import OWN_CPU, Variant
from stiction.comparisons.hard.case import HardCase, hard_cases
from stiction.comparisons.hard.examination import examine, judge
from stiction.engines.isolation import Outcome, Task
from stiction.engines.registry import label_of

REFERENCE = (
    Variant("reference", "reference", "rtol", (1e-10,), settings={"stabilization": "projection"}),
    Variant("paper's scheme", "reference", "dt", (), settings={"method": "paper"}),
    Variant(
        "trial and error",
        "reference",
        "rtol",
        (1e-10,),
        settings={"solver": "trial", "stabilization": "projection"},
    ),
)
"""The methods of the reference. A method with fixed steps has no series of steps: each case has its own step."""


def hard_variants(engines: Iterable[str] | None = None) -> tuple[Variant, ...]:
    """Return the methods of the reference, followed by those of the external engines.

    Parameters
    ----------
    engines
        Names of the external engines; all of them if None.
    """
    external = [variant for variant in variants(engines) if variant.engine != "reference"]
    return (*REFERENCE, *external)


def hard_comparison(
    depth: Depth = Depth.FULL, engines: Iterable[str] | None = None
) -> Comparison[Tables]:
    """Return the examination of the cases of a depth with every variant.

    Its table ``"hard"`` has a row for each case and variant: what must be true, the verdict, its reason, size and
    limit. The complementarity problems that the reference solved are returned beside the table.
    """
    chosen = hard_variants(engines)
    runs = [(case, variant) for case in hard_cases(depth) for variant in chosen]

    def tabulate(outcomes: Sequence[Outcome]) -> Tables:
        rows = []
        problems = []
        for (case, variant), outcome in zip(runs, outcomes, strict=True):
            rows.append(_row(case, variant, outcome))
            # A run that failed has no value, and so no problems.
            if outcome.value:
                problems += outcome.value.problems
        return Tables({"hard": pd.DataFrame(rows)}, problems=tuple(problems))

    tasks = tuple(
        Task(f"{case.name}/{variant.label}", examine, (case.name, variant))
        for case, variant in runs
    )
    return Comparison(tasks, tabulate, chosen)


def _row(case: HardCase, variant: Variant, outcome: Outcome) -> dict[str, Any]:
    """Return the row of a case and a variant: what was run, the verdict on its outcome, and what it cost.

    ``step`` is the step (s) or the relative tolerance, as ``parameter`` says.
    """
    verdict = judge(case, variant, outcome)
    value = outcome.value
    # A case asks whether a method can represent a mechanism, and not how its error falls. Adaptive
    # methods therefore run once, at the tightest tolerance of their ladder, which comes last.
    step = case.dt if variant.parameter == "dt" else variant.ladder[-1]
    return {
        "topic": case.topic,
        "case": case.name,
        "scene": case.scene,
        "must": case.must,
        "variant": variant.label,
        "engine": label_of(variant.engine),
        "version": value.version if value else None,
        "fidelity": variant.fidelity,
        "parameter": variant.parameter,
        "step": step,
        "verdict": verdict.word,
        "about": verdict.about,
        "size": verdict.size,
        "limit": verdict.limit,
        "cpu_time": value.cpu_s if value else None,
        OWN_CPU: value.engine_s if value else None,
    }
