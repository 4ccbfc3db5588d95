"""A solver over a stored set of complementarity problems, judged against what is proven of each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from stiction.comparisons.complementarity.problems import UNSOLVABLE, Problem, read_problems
from stiction.comparisons.complementarity.replay import Answer, Solver, answer, load_solver
from stiction.comparisons.proof.complementarity import NONE, OPEN, SOLVED, Verdict, decide, holds
from stiction.scenes import StictionError

JUDGEMENTS = ("right", "misses a solution", "rightly none", "solves what has none", "wrong", "not judged")
"""What becomes of a solver's answer. "wrong": it is not a solution to the accuracy of a replay, whatever is proven."""


class WrongProof(StictionError, AssertionError):
    """A verdict that its own test refutes: an error of this program."""


def judge(given: Answer, verdict: Verdict) -> str:
    """One of `JUDGEMENTS`; a solver that was not asked, raised, or whose problem is not decided is not judged."""
    none_found = given.outcome in ("none found", "rightly none")
    if given.outcome == "wrong":
        return "wrong"
    if verdict.decided == OPEN or not (none_found or given.outcome == "solved"):
        return "not judged"
    if verdict.decided == SOLVED:
        return "misses a solution" if none_found else "right"
    return "rightly none" if none_found else "solves what has none"


def verified(solver: str, problems: str | Path | None = None) -> pd.DataFrame:
    """What is proven of every problem of a set, and what a solver makes of it.

    Parameters
    ----------
    solver : str
        ``"module:function"``, as of `replay`.
    problems
        A file or folder; the set that comes with the suite where None.

    Returns
    -------
    DataFrame
        One row per class: problems; how many have a proven solution (isolated: no other one near), are proven to have none, are not
        decided; how many verdicts contradict the stored outcome; the solver's judgements.

    Raises
    ------
    WrongProof
        If the test of a verdict fails.
    """
    solve = load_solver(solver)
    rows: dict[str, dict[str, Any]] = {}
    for problem in read_problems(problems):
        row = rows.setdefault(problem.kind, {"class": problem.kind, **dict.fromkeys(
            ("problems", "solution", "isolated", "no solution", "not decided", "stored outcome refuted", *JUDGEMENTS), 0)})
        _count(row, problem, solve)
    table = pd.DataFrame(list(rows.values()))
    total = {"class": "all", **table.drop(columns="class").sum().to_dict()}
    return pd.concat([table, pd.DataFrame([total])], ignore_index=True)


def _count(row: dict[str, Any], problem: Problem, solve: Solver) -> None:
    verdict = decide(problem)
    if not holds(problem, verdict):
        raise WrongProof(f"{problem.kind}, {problem.scene}, t = {problem.t:g} s: found a verdict that does not hold: {verdict.decided}")
    row["problems"] += 1
    row[{SOLVED: "solution", NONE: "no solution", OPEN: "not decided"}[verdict.decided]] += 1
    row["isolated"] += verdict.isolated
    row["stored outcome refuted"] += verdict.decided != OPEN and (verdict.decided == NONE) != (problem.outcome == UNSOLVABLE)
    row[judge(answer(solve, problem), verdict)] += 1
