"""Solvers over a stored set of complementarity problems: the unit of comparison for changes of a solver.

A solver is a function of ``(M, q)`` that returns ``(w, z)`` with w = M z + q, w, z >= 0, w^T z = 0, or of ``(A0, A1,
b)`` that returns ``(y, x)`` (`stiction.comparisons.bench.complementarity.problems`); None where it finds none.
"""

from __future__ import annotations

import inspect
import time
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
ACCURATE = 1e-9
"""Residual relative to the largest term, and wrong sign or product relative to the largest variable, of a solution."""
OUTCOMES = ("solved", "wrong", "none found", "rightly none", "not an LCP", "raised")


def lemke(M: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Lemke's method of the reference with a covering vector of ones; None on a ray."""
    from stiction.reference_impl.friction.lemke import lemke as pivot
    from stiction.reference_impl.friction.outcomes import SOLVED as FOUND

    w, z, outcome, _ = pivot(M, q, np.ones(len(q)))
    return (w, z) if outcome == FOUND else None


def load_solver(address: str) -> Solver:
    """Import the function at ``"module:function"``; InputError if there is none, or it takes other arguments."""
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
    """2 for a solver of LCPs, 3 for one of HLCPs."""
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
    """Answer of a solver to one problem: one of `OUTCOMES`, its residual, seconds, the error that it raised."""

    kind: str
    outcome: str
    residual: float = np.nan
    seconds: float = np.nan
    reason: str = ""


def answer(solver: Solver, problem: Problem) -> Answer:
    """Judge a solver by one problem; nothing that the solver raises ends a replay."""
    arguments: tuple[np.ndarray, ...] = (problem.A0, problem.A1, problem.b)
    if _arity(solver) == 2:
        if not problem.lcp:
            return Answer(problem.kind, "not an LCP")
        # A0 y = A1 x + b with a regular A0: w = y, z = x, M = A0^-1 A1, q = A0^-1 b
        right = np.linalg.solve(problem.A0, np.column_stack([problem.A1, problem.b]))
        arguments = np.ascontiguousarray(right[:, :-1]), np.ascontiguousarray(right[:, -1])
    # copies, as the solver may write into them
    arguments = tuple(np.array(value) for value in arguments)
    solution, reason, started = None, "", time.perf_counter()
    try:
        solution = solver(*arguments)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - started
    if solution is None:
        if reason:
            outcome = "raised"
        else:
            outcome = "none found" if problem.outcome == SOLVED else "rightly none"
        return Answer(problem.kind, outcome, seconds=seconds, reason=reason)
    # What it found is judged by the problem itself: any solution counts, not only the stored one.
    try:
        y, x = (np.asarray(part, dtype=float) for part in solution)
    except (TypeError, ValueError):  # not two parts, or parts that are no numbers
        reason = f"returned {type(solution).__name__}; expected None or a pair of vectors (w, z)"
        return Answer(problem.kind, "wrong", np.inf, seconds, reason)
    complete = y.shape == x.shape == problem.b.shape and np.all(np.isfinite([y, x]))
    left = residual(problem.A0, problem.A1, problem.b, y, x) if complete else np.inf
    return Answer(problem.kind, "solved" if left <= ACCURATE else "wrong", left, seconds)


def _answers(address: str, path: str | None, kind: str) -> list[Answer]:
    """Answer all problems of a class; the first one twice: a compiled solver compiles at its first call."""
    solver = load_solver(address)
    problems = [problem for problem in read_problems(path) if problem.kind == kind]
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
    """Run a solver, ``"module:function"``, over a set (`read_problems`), each class in a child process.

    The table has one row per class: problems, numbers by outcome, largest residual of those solved, median time, reason
    of a failure.
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
    answers: Sequence[Answer] = outcome.value or ()
    timed = [each.seconds for each in answers if each.outcome != "not an LCP"]
    reasons = [each.reason for each in answers if each.reason]
    return {
        "class": kind,
        "problems": len(answers),
        **{name: sum(each.outcome == name for each in answers) for name in OUTCOMES},
        "largest_residual": max(
            (each.residual for each in answers if each.outcome == "solved"), default=np.nan
        ),
        "median_time": 1e6 * float(np.median(timed)) if timed else np.nan,
        "reason": outcome.reason if outcome.status != Status.OK else next(iter(reasons), ""),
    }
