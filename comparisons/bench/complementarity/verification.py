"""Verification of a solver: its answers to stored complementarity problems are compared with proven ones."""

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

RIGHT = "right"
"""Judgement: the solver returns a solution."""
MISSES_SOLUTION = "misses a solution"
"""Judgement: the solver returns None, but there is a solution."""
RIGHTLY_NONE = "rightly none"
"""Judgement: the solver returns None, and there is no solution."""
SOLVES_UNSOLVABLE = "solves what has none"
"""Judgement: the solver returns a solution to the accuracy of a replay, but there is none in exact
arithmetic."""
WRONG = "wrong"
"""Judgement: the solver returns vectors that are not a solution to the accuracy of a replay."""
NOT_JUDGED = "not judged"
"""Judgement: the problem is not decided, or the solver raised an exception or does not apply to
it."""
JUDGEMENTS = (RIGHT, MISSES_SOLUTION, RIGHTLY_NONE, SOLVES_UNSOLVABLE, WRONG, NOT_JUDGED)
"""All judgements, which are columns of the table of `verified`."""


class WrongProof(StictionError, AssertionError):
    """The error of a proof that its own check refutes, which is an error of this program."""


def judge(answer: Answer, decision: Decision) -> str:
    """Return the judgement of a solver's answer, one of `JUDGEMENTS`."""
    if answer.outcome == "wrong":
        return WRONG
    if answer.outcome not in ("solved", "none found", "rightly none") or decision.decided == OPEN:
        return NOT_JUDGED
    has_answer = answer.outcome == "solved"
    if decision.decided == SOLVED:
        return RIGHT if has_answer else MISSES_SOLUTION
    return SOLVES_UNSOLVABLE if has_answer else RIGHTLY_NONE


def verified(solver: str, problems: str | Path | None = None) -> pd.DataFrame:
    """Decide every problem of a set with a proof, and judge a solver's answers.

    Parameters
    ----------
    solver : str
        ``"module:function"``, see `replay`.
    problems : str or Path, optional
        File or folder of the problems; the set of the suite if None.

    Returns
    -------
    DataFrame
        One row for each class, and a last row for all. The columns count the problems; those with a
        proven solution, and among them those whose solution is isolated, that is, without others in
        a neighbourhood; those that are proven to have no solution, and those not decided; those
        whose stored outcome is refuted; and the judgements.

    Raises
    ------
    WrongProof
        If a decision fails its own check.
    """
    solve = load_solver(solver)
    rows = pd.DataFrame([_row(problem, solve) for problem in read_problems(problems)])
    table = rows.groupby("class", sort=False).sum()
    table.loc["all"] = table.sum()
    return table.reset_index()


def _row(problem: Problem, solve: Solver) -> dict[str, Any]:
    """Return the row of one problem, each of whose counts is 0 or 1."""
    decision = decide(problem)
    if not holds(problem, decision):
        raise WrongProof(
            f"{problem.kind}, {problem.scene}, t = {problem.t:g} s: found a verdict that does not hold: "
            f"{decision.decided}"
        )
    is_unsolvable = decision.decided == NONE
    is_refuted = decision.decided != OPEN and is_unsolvable != (problem.outcome == UNSOLVABLE)
    judgement = judge(answer(solve, problem), decision)
    return {
        "class": problem.kind,
        "problems": 1,
        "solution": int(decision.decided == SOLVED),
        "isolated": int(decision.isolated),
        "no solution": int(is_unsolvable),
        "not decided": int(decision.decided == OPEN),
        "stored outcome refuted": int(is_refuted),
        **{name: int(name == judgement) for name in JUDGEMENTS},
    }
