"""Complementarity problems decided with a proof: an exact solution, or a certificate that there is none.

    A0 y = A1 x + b ,   y >= 0 ,  x >= 0 ,  y^T x = 0 ,

with the stored floats taken as the rational numbers that they are, and everything that is claimed computed in rational arithmetic.

- A pair whose columns in A0 and A1 are the same is y_i - x_i = u, a number of any sign (the reaction of a pin or a motor, split in two):
  such unknowns are eliminated by rational row reduction, without asking who of the pair is zero.
- Of each other pair one of the two is zero. A choice for all pairs leaves a linear system, and a solution of it that is nonnegative
  solves the problem; where it is positive and the system regular, no other solution is near: it is the only one with this choice
  and in a neighbourhood.
- A choice for some of the pairs leaves a cone of columns. A vector l with l^T c <= 0 for each column c of it and l^T b > 0 proves that no
  solution has that choice (Farkas; A. Schrijver, Theory of Linear and Integer Programming, 1986, sect. 7.3). Choices are branched
  on until each branch is solved or refuted.

Linear programs in floats only propose: where to look, and which l. Whether l is one is tested in rationals.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import fmpq, fmpq_mat
from scipy.optimize import linprog

from comparisons.problems import Problem

SOLVED, NONE, OPEN = "solution", "no solution", "not decided"
_MOST_NODES = 2000
_LARGE = 10 ** 15
"""Denominator up to which a proposed certificate is rounded."""


@dataclass(frozen=True)
class Verdict:
    """What is proven of a problem.

    Attributes
    ----------
    decided : str
        `SOLVED`, `NONE` or `OPEN`.
    y, x : tuple of fmpq
        An exact solution; empty if there is none.
    isolated : bool
        Whether no other solution is near it: one of each pair is positive (of those not eliminated) and its system regular.
    refutations : tuple of Refutation
        Where there is no solution: their branches together are all choices.
    reason : str
        Why it is not decided.
    """

    decided: str
    y: tuple[fmpq, ...] = ()
    x: tuple[fmpq, ...] = ()
    isolated: bool = False
    refutations: tuple[Refutation, ...] = ()
    reason: str = ""


@dataclass(frozen=True)
class Refutation:
    """A choice of who is zero, by pair (1: y, -1: x), and the vector l (n numbers) that refutes it."""

    zero: tuple[tuple[int, int], ...]
    vector: tuple[fmpq, ...]


def rational(value: float) -> fmpq:
    """The number that a float is."""
    exact = Fraction(value)
    return fmpq(exact.numerator, exact.denominator)


def _matrix(values: np.ndarray) -> fmpq_mat:
    return fmpq_mat([[rational(float(x)) for x in row] for row in values])


class _Reduced:
    """The problem without the unknowns of any sign: rows that combine the given ones so that these drop out."""

    def __init__(self, problem: Problem):
        A0, A1, b = problem.A0, problem.A1, problem.b
        self.n = len(b)
        self.free = [i for i in range(self.n) if np.array_equal(A0[:, i], A1[:, i])]
        self.pairs = [i for i in range(self.n) if i not in self.free]
        self.y, self.x, self.b = _matrix(A0), _matrix(-A1), _matrix(b[:, None])
        identity = fmpq_mat(self.n, self.n, [int(i == j) for i in range(self.n) for j in range(self.n)])
        if self.free:
            columns = [[self.y[r, i] for i in self.free] + [identity[r, j] for j in range(self.n)] for r in range(self.n)]
            reduced, rank = fmpq_mat(columns).rref()
            k = len(self.free)
            rows = [r for r in range(self.n) if all(reduced[r, j] == 0 for j in range(k))]
            self.rows = fmpq_mat([[reduced[r, k + j] for j in range(self.n)] for r in rows]) if rows else None
        else:
            self.rows = identity
        if self.rows is None:
            self.columns, self.right = {}, fmpq_mat(0, 1)
            return
        Y, X = self.rows * self.y, self.rows * self.x
        count = self.rows.nrows()
        self.columns = {(i, side): [matrix[r, i] for r in range(count)] for i in self.pairs for side, matrix in ((1, X), (-1, Y))}
        self.right = self.rows * self.b


Choice = dict[int, int]
"""By pair: 1 where y is zero (x is left), -1 where x is zero."""


def decide(problem: Problem) -> Verdict:
    """Decide a problem; see the module's text."""
    reduced = _Reduced(problem)
    for choice in _proposed(problem, reduced):
        found = _solution(reduced, choice)
        if found is not None:
            return found
    return _search(reduced)


def _proposed(problem: Problem, reduced: _Reduced) -> Iterator[Choice]:
    """Who is zero in the stored solution."""
    if len(problem.y):
        yield {i: 1 if problem.x[i] >= problem.y[i] else -1 for i in reduced.pairs}


def _solution(reduced: _Reduced, choice: Choice) -> Verdict | None:
    """The solution with a full choice; None if there is none or it is not regular."""
    n = reduced.n
    system = fmpq_mat([[(reduced.x if choice.get(i) == 1 else reduced.y)[r, i] for i in range(n)] for r in range(n)])
    try:
        values = system.solve(reduced.b)
    except ZeroDivisionError:
        return _dependent(reduced, choice, system)
    return _accepted(reduced, choice, [values[i, 0] for i in range(n)], True)


def _dependent(reduced: _Reduced, choice: Choice, system: fmpq_mat) -> Verdict | None:
    """A solution of a singular system: that with zeros where its columns depend on those before them."""
    n = reduced.n
    order = [*reduced.free, *reduced.pairs]
    extended = fmpq_mat([[system[r, i] for i in order] + [reduced.b[r, 0]] for r in range(n)])
    form, rank = extended.rref()
    values = [fmpq(0)] * n
    for r in range(rank):
        pivot = next(j for j in range(n + 1) if form[r, j] != 0)
        if pivot == n:
            return None
        values[order[pivot]] = form[r, n]
    return _accepted(reduced, choice, values, False)


def _accepted(reduced: _Reduced, choice: Choice, values: list[fmpq], regular: bool) -> Verdict | None:
    if any(values[i] < 0 for i in reduced.pairs):
        return None
    y = [fmpq(0)] * reduced.n
    x = [fmpq(0)] * reduced.n
    for i, value in enumerate(values):
        (x if choice.get(i) == 1 or i in reduced.free and value < 0 else y)[i] = abs(value)
    return Verdict(SOLVED, tuple(y), tuple(x), regular and all(values[i] > 0 for i in reduced.pairs))


def _search(reduced: _Reduced) -> Verdict:
    """Branch on who is zero."""
    refutations, nodes, left = [], [({})], None
    for count in range(_MOST_NODES):
        if not nodes:
            break
        choice = nodes.pop()
        kind, proposal = _program(reduced, choice)
        if kind == "refuted":
            refutations.append(Refutation(tuple(sorted(choice.items())), proposal))
            continue
        open_pairs = [i for i in reduced.pairs if i not in choice]
        if kind == "point":
            if (found := _solution(reduced, {i: 1 if proposal[i, 1] >= proposal[i, -1] else -1 for i in reduced.pairs})) is not None:
                return found
        if not open_pairs:
            left = choice
            continue
        clash = max(open_pairs, key=lambda i: min(proposal[i, 1], proposal[i, -1])) if kind == "point" else open_pairs[0]
        nodes += [{**choice, clash: 1}, {**choice, clash: -1}]
    if nodes:
        return Verdict(OPEN, reason=f"more than {_MOST_NODES} choices")
    if left is not None:
        return Verdict(OPEN, reason="a choice for all pairs is neither solved nor refuted: its system is singular, or nearly so")
    return Verdict(NONE, refutations=tuple(refutations))


def _program(reduced: _Reduced, choice: Choice):
    """("refuted", l), ("point", values by column) or ("unknown", None)."""
    allowed = [key for key in reduced.columns if choice.get(key[0], key[1]) == key[1]]
    count = reduced.right.nrows()
    if count == 0:
        return "point", dict.fromkeys(reduced.columns, 0.0)
    A = np.array([[float(Fraction(int(c.p), int(c.q))) for c in reduced.columns[key]] for key in allowed]).reshape(len(allowed), count).T
    b = np.array([float(Fraction(int(reduced.right[r, 0].p), int(reduced.right[r, 0].q))) for r in range(count)])
    rows = np.maximum(np.max(np.abs(np.column_stack([A, b])), axis=1), 1e-300)
    A, b = A / rows[:, None], b / rows
    sizes = np.maximum(np.max(np.abs(A), axis=0, initial=0.0), 1e-300)
    # l with l^T b = 1, as negative on the columns as possible; bounded, since the columns may not span
    lengths = np.append(np.zeros(count), -1.0)
    farkas = linprog(lengths, A_ub=np.column_stack([(A / sizes).T, np.ones(len(allowed))]) if allowed else None,
                     b_ub=np.zeros(len(allowed)) if allowed else None, A_eq=[[*(b / max(np.max(np.abs(b)), 1e-300)), 0.0]], b_eq=[1.0],
                     bounds=[(-1e6, 1e6)] * count + [(0.0, 1.0)], method="highs")
    if farkas.status == 0 and np.any(b):
        vector = [Fraction(value / row).limit_denominator(_LARGE) for value, row in zip(farkas.x[:-1], rows)]
        exact = [fmpq(v.numerator, v.denominator) for v in vector]
        if _refutes(reduced, exact, allowed):
            full = fmpq_mat([exact]) * reduced.rows
            return "refuted", tuple(full[0, j] for j in range(reduced.n))
    point = linprog(np.ones(len(allowed)), A_eq=A / sizes, b_eq=b, method="highs") if allowed else None
    if point is not None and point.status == 0:
        values = dict.fromkeys(reduced.columns, 0.0)
        values |= {key: value / size for key, value, size in zip(allowed, point.x, sizes)}
        return "point", values
    return "unknown", None


def _refutes(reduced: _Reduced, vector: list[fmpq], allowed: list[tuple[int, int]]) -> bool:
    def dot(column) -> fmpq:
        return sum((a * b for a, b in zip(vector, column)), fmpq(0))

    return dot([reduced.right[r, 0] for r in range(reduced.right.nrows())]) > 0 and all(dot(reduced.columns[key]) <= 0 for key in allowed)


def holds(problem: Problem, verdict: Verdict) -> bool:
    """Whether what a verdict claims is so, by the problem alone: the equations, the signs, the products; or that its refutations refute and
    that their choices leave none out."""
    n = len(problem.b)
    y, x, b = _matrix(problem.A0), _matrix(problem.A1), _matrix(problem.b[:, None])
    if verdict.decided == SOLVED:
        left, right = y * fmpq_mat(n, 1, verdict.y), x * fmpq_mat(n, 1, verdict.x)
        return (all(left[r, 0] == right[r, 0] + b[r, 0] for r in range(n)) and all(v >= 0 for v in (*verdict.y, *verdict.x))
                and all(v * w == 0 for v, w in zip(verdict.y, verdict.x)))
    if verdict.decided != NONE:
        return True
    for refutation in verdict.refutations:
        row, zero = fmpq_mat([list(refutation.vector)]), dict(refutation.zero)
        on_y, on_x = row * y, row * x
        if not (row * b)[0, 0] > 0:
            return False
        if any(zero.get(i) != 1 and on_y[0, i] > 0 or zero.get(i) != -1 and -on_x[0, i] > 0 for i in range(n)):
            return False
    return _complete([dict(refutation.zero) for refutation in verdict.refutations])


def _complete(choices: list[Choice]) -> bool:
    """Whether choices cover all: some pair splits those that name it in two complete parts, or one names none."""
    if any(not choice for choice in choices):
        return True
    if not choices:
        return False
    shared = set.intersection(*(set(choice) for choice in choices))
    for i in sorted(shared):
        parts = [[{k: s for k, s in choice.items() if k != i} for choice in choices if choice[i] == side] for side in (1, -1)]
        if all(_complete(part) for part in parts):
            return True
    return False
