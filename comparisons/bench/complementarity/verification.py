"""A solver over a stored set of complementarity problems, judged against what is proven of each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.bench.complementarity.problems import UNSOLVABLE, Problem, read_problems
from stiction.comparisons.bench.complementarity.proof import (
    NONE,
    OPEN,
    SOLVED,
    Decision,
    decide,
    holds,
)
from stiction.comparisons.bench.complementarity.replay import Answer, Solver, answer, load_solver
from stiction.scenes import StictionError

JUDGEMENTS = (
    "right",
    "misses a solution",
    "rightly none",
    "solves what has none",
    "wrong",
    "not judged",
)
"""Judgements of a solver's answer. "wrong": it is not a solution to the accuracy of a replay, whatever is proven."""


class WrongProof(StictionError, AssertionError):
    """A verdict that its own test refutes: an error of this program."""


def judge(given: Answer, verdict: Decision) -> str:
    """One of `JUDGEMENTS`; a solver that was not asked, raised, or whose problem is not decided is not judged."""
    right, misses, rightly_none, solves_none, wrong, not_judged = JUDGEMENTS
    if given.outcome == "wrong":
        return wrong
    if verdict.decided == OPEN or given.outcome not in ("solved", "none found", "rightly none"):
        return not_judged
    if verdict.decided == SOLVED:
        return right if given.outcome == "solved" else misses
    return solves_none if given.outcome == "solved" else rightly_none


def verified(solver: str, problems: str | Path | None = None) -> pd.DataFrame:
    """Decide every problem of a set with a proof, and judge a solver, ``"module:function"``, by that.

    `problems` is a file or folder, None the set that comes with the suite. The table has one row per class: problems;
    how many have a proven solution (isolated: no other one near), are proven to have none, are not decided; how many
    verdicts contradict the stored outcome; the solver's judgements. Raises WrongProof if a verdict fails its own test.
    """
    solve = load_solver(solver)
    rows = pd.DataFrame([_row(problem, solve) for problem in read_problems(problems)])
    table = rows.groupby("class", sort=False).sum()
    table.loc["all"] = table.sum()
    return table.reset_index()


def _row(problem: Problem, solve: Solver) -> dict[str, Any]:
    """The table's counts for one problem."""
    verdict = decide(problem)
    if not holds(problem, verdict):
        raise WrongProof(
            f"{problem.kind}, {problem.scene}, t = {problem.t:g} s: found a verdict that does not hold: "
            f"{verdict.decided}"
        )
    contradicted = verdict.decided != OPEN and (verdict.decided == NONE) != (
        problem.outcome == UNSOLVABLE
    )
    judgement = judge(answer(solve, problem), verdict)
    return {
        "class": problem.kind,
        "problems": 1,
        "solution": int(verdict.decided == SOLVED),
        "isolated": int(verdict.isolated),
        "no solution": int(verdict.decided == NONE),
        "not decided": int(verdict.decided == OPEN),
        "stored outcome refuted": int(contradicted),
        **{name: int(name == judgement) for name in JUDGEMENTS},
    }
