"""Application of a solver to stored complementarity problems, to compare solvers or versions of a solver.

A solver is a function that returns a solution, or None if it finds none. Its arguments are either
``(M, q)`` of a linear complementarity problem, and it returns ``(w, z)`` with w = M z + q, w >= 0,
z >= 0, w^T z = 0; or they are ``(A0, A1, b)``, and it returns ``(y, x)``, see
`stiction.comparisons.bench.complementarity.problems`.
"""

from __future__ import annotations

import inspect
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.complementarity.problems import SOLVED, Problem, read_problems
from stiction.engines.isolation import Outcome, Task, isolate
from stiction.engines.status import Status
from stiction.reference_impl.friction.hlcp import residual
from stiction.scenes import InputError

Solver = Callable[..., tuple[np.ndarray, np.ndarray] | None]

LEMKE = "stiction.comparisons.bench.complementarity.replay:lemke"
"""Address of `lemke`, the default solver."""
ACCURATE = 1e-9
"""Largest residual of a solution, as defined by `hlcp.residual`: errors of the equations relative
to their largest term, wrong signs and products relative to the largest variable."""
OUTCOMES = ("solved", "wrong", "none found", "rightly none", "not an LCP", "raised")
"""Outcomes of a solver for one problem. "none found" and "rightly none" mean that it returned None,
where the stored outcome is that there is a solution, or that there is none."""


def lemke(M: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the solution by the reference's Lemke method with a covering vector of ones; None on a ray."""
    from stiction.reference_impl.friction.lemke import lemke as solve_by_pivoting
    from stiction.reference_impl.friction.outcomes import SOLVED as FOUND

    w, z, outcome, _ = solve_by_pivoting(M, q, np.ones(len(q)))
    return (w, z) if outcome == FOUND else None


def load_solver(address: str) -> Solver:
    """Return the function at ``"module:function"``; InputError if there is none, or it has other arguments."""
    try:
        function = resolve_name(address)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(
            f"solver: found {address!r} ({error}); expected module:function"
        ) from error
    if not callable(function):
        raise InputError(f"solver: found {address!r}; expected module:function")
    _arity(function)
    return function


def _arity(solver: Solver) -> int:
    """Return the number of arguments, 2 of a solver of LCPs and 3 of a solver of HLCPs; else InputError."""
    required = [
        p
        for p in inspect.signature(solver).parameters.values()
        if p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)
    ]
    if len(required) not in (2, 3):
        raise InputError(
            f"solver: found {len(required)} required arguments; expected (M, q) or (A0, A1, b)"
        )
    return len(required)


@dataclass(frozen=True)
class Answer:
    """The answer of a solver to one problem.

    Attributes
    ----------
    kind : str
        Class of the problem.
    outcome : str
        One of `OUTCOMES`.
    residual : float
        Residual of the solution, see `ACCURATE`; nan if there is none.
    seconds : float
        Wall time of the call, s.
    reason : str
        The exception, or what is wrong with the value returned; empty otherwise.
    """

    kind: str
    outcome: str
    residual: float = np.nan
    seconds: float = np.nan
    reason: str = ""


def answer(solver: Solver, problem: Problem) -> Answer:
    """Return the answer of a solver to a problem; exceptions of the solver become part of it."""
    arguments: tuple[np.ndarray, ...] = (problem.A0, problem.A1, problem.b)
    if _arity(solver) == 2:
        if not problem.lcp:
            return Answer(problem.kind, "not an LCP")
        # A0 y = A1 x + b with a regular A0: w = y, z = x, M = A0^-1 A1, q = A0^-1 b
        M_and_q = np.linalg.solve(problem.A0, np.column_stack([problem.A1, problem.b]))
        arguments = (M_and_q[:, :-1], M_and_q[:, -1])
    # contiguous copies, because the solver may be compiled and may change its arguments
    arguments = tuple(np.array(array, order="C") for array in arguments)

    begin = time.perf_counter()
    try:
        solution = solver(*arguments)
    except Exception as error:
        seconds = time.perf_counter() - begin
        reason = f"{type(error).__name__}: {error}"
        return Answer(problem.kind, "raised", seconds=seconds, reason=reason)
    seconds = time.perf_counter() - begin
    if solution is None:
        outcome = "none found" if problem.outcome == SOLVED else "rightly none"
        return Answer(problem.kind, outcome, seconds=seconds)

    # The residual of the problem is tested instead of the distance from the stored solution,
    # because there may be several solutions.
    try:
        y, x = (np.asarray(part, dtype=float) for part in solution)
    except (TypeError, ValueError):  # not a pair, or not numbers
        reason = f"returned {type(solution).__name__}; expected None or a pair of vectors (w, z)"
        return Answer(problem.kind, "wrong", np.inf, seconds, reason)
    size = np.inf
    if y.shape == x.shape == problem.b.shape and np.all(np.isfinite([y, x])):
        size = residual(problem.A0, problem.A1, problem.b, y, x)
    return Answer(problem.kind, "solved" if size <= ACCURATE else "wrong", size, seconds)


def _answers(address: str, path: str | None, kind: str) -> list[Answer]:
    """Return the answers to all problems of a class; the task of a child process."""
    solver = load_solver(address)
    problems = [problem for problem in read_problems(path) if problem.kind == kind]
    # A solver may compile in its first call, which must not count as its time.
    answer(solver, problems[0])
    return [answer(solver, problem) for problem in problems]


def replay(
    solver: str = LEMKE,
    problems: str | Path | None = None,
    *,
    timeout_s: float = 60.0,
    workers: int | None = None,
    on_start: Callable[[int], None] | None = None,
    on_result: Callable[[Outcome], None] | None = None,
) -> pd.DataFrame:
    """Apply a solver to a set of problems, each class in a child process.

    Parameters
    ----------
    solver : str
        ``"module:function"``.
    problems : str or Path, optional
        The set, see `read_problems`.
    timeout_s : float
        Time limit for the problems of one class, s.
    workers, on_result
        As of `stiction.engines.isolate`.
    on_start : callable, optional
        Called with the number of classes.

    Returns
    -------
    DataFrame
        One row for each class: number of problems, number of each of `OUTCOMES`, largest residual
        of the problems that are solved, median time in us, and the reason of the first failure.
    """
    path = None if problems is None else str(problems)
    load_solver(solver)
    kinds = list(dict.fromkeys(problem.kind for problem in read_problems(path)))
    tasks = [Task(kind, _answers, (solver, path, kind)) for kind in kinds]
    if on_start is not None:
        on_start(len(tasks))
    outcomes = isolate(tasks, workers=workers, timeout_s=timeout_s, on_result=on_result)
    return pd.DataFrame([_row(kind, outcome) for kind, outcome in zip(kinds, outcomes)])


def _row(kind: str, outcome: Outcome) -> dict[str, Any]:
    """Return the row of a class from the outcome of its child process."""
    answers: Sequence[Answer] = outcome.value or ()
    counts = Counter(each.outcome for each in answers)
    residuals = [each.residual for each in answers if each.outcome == "solved"]
    times = [each.seconds for each in answers if each.outcome != "not an LCP"]
    reasons = [each.reason for each in answers if each.reason]
    if outcome.status != Status.OK:
        reasons = [outcome.reason]
    return {
        "class": kind,
        "problems": len(answers),
        **{name: counts[name] for name in OUTCOMES},
        "largest_residual": max(residuals, default=np.nan),
        "median_time": 1e6 * float(np.median(times)) if times else np.nan,
        "reason": reasons[0] if reasons else "",
    }
