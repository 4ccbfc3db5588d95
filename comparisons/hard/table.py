"""The table of hard cases: every case through the reference's methods and every engine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd

from comparisons.hard.case import HardCase
from comparisons.hard.cases import hard_cases
from comparisons.hard.examination import Verdict, examine, judge
from comparisons.problems import Problem
from comparisons.variants import EXTERNAL, MOREAU, OWN_CPU, TRIAL, Variant
from engines.isolation import Isolate, Outcome, Task, isolate
from engines.moreau import compile_kernels as compile_moreau
from engines.reference import compile_kernels
from engines.registry import engine_names

TIME_LIMIT = 60.0
"""Seconds for one case through one variant; the longest that comes out, 1e5 s by the reference, takes some 13 s of an idle core."""

REFERENCE = (
    Variant("reference", "reference", "rtol", (1e-10,), settings={"stabilization": "projection"}),
    Variant("paper's scheme", "reference", "dt", (), settings={"method": "paper"}),
    replace(TRIAL, ladder=(1e-10,)),
)
"""The methods of the reference. Fixed steps are those of the cases."""

METHODS = (*(variant.label for variant in REFERENCE), MOREAU.label)
"""The suite's own ways to find contact forces, the event-driven HLCP first; Moreau's is an engine of its own."""


def hard_variants(engines: Iterable[str] | None = None) -> tuple[Variant, ...]:
    """The reference's methods and the external engines, limited to those named where `engines` is given."""
    chosen = [name for name in (engine_names() if engines is None else engines) if name != "reference"]
    known = {variant.engine for variant in EXTERNAL}
    return (*REFERENCE, *(variant for variant in EXTERNAL if variant.engine in chosen),
            *(Variant(name, name, "dt", ()) for name in chosen if name not in known))


@dataclass(frozen=True)
class HardComparison:
    """`table`: one row per case and variant; `problems`: the complementarity problems that the reference met."""

    table: pd.DataFrame
    problems: tuple[Problem, ...]


def compare_hard(*, quick: bool = False, engines: Iterable[str] | None = None, workers: int | None = None,
               timeout_s: float = TIME_LIMIT, on_start: Callable[[int], None] | None = None,
               on_result: Callable[[Outcome], None] | None = None, isolated: Isolate = isolate) -> HardComparison:
    """Every case through every variant: what must be true, the verdict, what it is about, its size and the limit.

    Parameters
    ----------
    quick
        A third of the cases.
    engines
        As in `hard_variants`.
    isolated
        How the runs are made.
    """
    compile_kernels()
    if "moreau" in (engine_names() if engines is None else engines):
        compile_moreau()
    cases, variants = hard_cases(quick), hard_variants(engines)
    tasks = [Task(f"{case.name}/{variant.label}", examine, (case.name, variant)) for case in cases for variant in variants]
    if on_start is not None:
        on_start(len(tasks))
    outcomes = isolated(tasks, workers=workers, timeout_s=timeout_s, on_result=on_result)
    met = [problem for outcome in outcomes if outcome.value for problem in outcome.value.problems]
    rest = iter(outcomes)
    return HardComparison(pd.DataFrame([_row(case, variant, next(rest)) for case in cases for variant in variants]), tuple(met))


def hard_runs(engines: Iterable[str] | None, quick: bool) -> int:
    """The number of results of `compare_hard`."""
    return len(hard_cases(quick)) * len(hard_variants(engines))


def _row(case: HardCase, variant: Variant, outcome: Outcome) -> dict[str, Any]:
    verdict: Verdict = judge(case, variant, outcome)
    value = outcome.value
    step = case.dt if variant.parameter == "dt" else variant.ladder[-1]
    return {"topic": case.topic, "case": case.name, "scene": case.scene, "must": case.must, "variant": variant.label,
            "engine": variant.engine, "version": value.version if value else None, "fidelity": variant.fidelity,
            "parameter": variant.parameter, "step": step, "verdict": verdict.word, "about": verdict.about, "size": verdict.size,
            "limit": verdict.limit, "cpu [s]": value.cpu_s if value else None,
            OWN_CPU: value.engine_s if value else None}


def hard_matrix(table: pd.DataFrame) -> pd.DataFrame:
    """One row per case, one column per variant: the verdict and its size, or the start of the words."""
    cells = table.assign(cell=[hard_cell(row) for row in table.to_dict("records")])
    matrix = cells.pivot(index=["topic", "case"], columns="variant", values="cell")
    order = table[["topic", "case"]].drop_duplicates()
    return matrix.loc[list(order.itertuples(index=False, name=None)), list(dict.fromkeys(table["variant"]))].reset_index()


def hard_cell(row: Mapping[str, Any]) -> str:
    """The verdict and its size."""
    return row["verdict"] if pd.isna(row["size"]) or not row["size"] else f"{row['verdict']} {row['size']:.1g}"
