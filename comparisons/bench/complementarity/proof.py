"""Complementarity problems decided with a proof: an exact solution, or a certificate that there is none.

    A0 y = A1 x + b ,   y >= 0 ,  x >= 0 ,  y^T x = 0 ,

with the stored floats taken as the rational numbers that they are, and everything that is claimed computed in rational
arithmetic.

- A pair whose columns in A0 and A1 are the same is y_i - x_i = u, a number of any sign (the reaction of a pin or a
  motor, split in two): such unknowns are eliminated by rational row reduction, without asking who of the pair is zero.
- Of each other pair one of the two is zero. A choice for all pairs leaves a linear system, and a solution of it that is
  nonnegative solves the problem; where it is positive and the system regular, no other solution is near: it is the only
  one with this choice and in a neighbourhood.
- A choice for some of the pairs leaves a cone of columns. A vector l with l^T c <= 0 for each column c of it and
  l^T b > 0 proves that no solution has that choice (Farkas; A. Schrijver, Theory of Linear and Integer Programming,
  1986, sect. 7.3). Choices are branched on until each branch is solved or refuted.

`holds` tests all that by the problem alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq, fmpq_mat

from stiction.comparisons.bench.complementarity.problems import Problem

SOLVED, NONE, OPEN = "solution", "no solution", "not decided"
_MOST_CHOICES, _MOST_PIVOTS = 300, 40
"""Branches that are tried before a problem is left open, and steps of the search near a choice."""


@dataclass(frozen=True)
class Decision:
    """A decision on a problem, `SOLVED`, `NONE` or `OPEN`, with its proof.

    Either an exact solution y, x, `isolated` where no other one is near: one of each pair is positive (of those not
    eliminated) and its system regular. Or refutations, whose branches together are all choices.
    """

    decided: str
    y: tuple[fmpq, ...] = ()
    x: tuple[fmpq, ...] = ()
    isolated: bool = False
    refutations: tuple[Refutation, ...] = ()


@dataclass(frozen=True)
class Refutation:
    """A choice of who is zero, by pair (1: y, -1: x), and the vector l (n numbers) that refutes it."""

    zero: tuple[tuple[int, int], ...]
    vector: tuple[fmpq, ...]


def _matrix(values: np.ndarray) -> fmpq_mat:
    """The rational numbers that floats are."""
    return fmpq_mat([[fmpq(*x.as_integer_ratio()) for x in row] for row in values.tolist()])


class _Reduced:
    """The problem without the unknowns of any sign: rows that combine the given ones so that these drop out.

    `y` and `x` are the columns of y and x in A0 y - A1 x = b; `columns` those of the rows that are left, by pair and
    side (1: x, -1: y).
    """

    def __init__(self, problem: Problem):
        n = self.n = len(problem.b)
        self.free = [i for i in range(n) if np.array_equal(problem.A0[:, i], problem.A1[:, i])]
        self.pairs = [i for i in range(n) if i not in self.free]
        y, x, self.b = _matrix(problem.A0), _matrix(-problem.A1), _matrix(problem.b[:, None])
        self.y, self.x = y.transpose().tolist(), x.transpose().tolist()
        k, units = len(self.free), [[int(r == j) for j in range(n)] for r in range(n)]
        form, _ = fmpq_mat(
            [[self.y[i][r] for i in self.free] + unit for r, unit in enumerate(units)]
        ).rref()
        rows = [row[k:] for row in form.tolist() if not any(row[:k])]
        self.rows = fmpq_mat(len(rows), n, sum(rows, []))
        self.right, sides = self.rows * self.b, ((1, self.rows * x), (-1, self.rows * y))
        self.columns = {
            (i, side): [row[i] for row in matrix.tolist()]
            for i in self.pairs
            for side, matrix in sides
        }


Choice = dict[int, int]
"""1 by pair where y is zero (x is left), -1 where x is zero."""


def decide(problem: Problem) -> Decision:
    """Decide a problem; see the module's text."""
    reduced = _Reduced(problem)
    if len(problem.y):
        stored = {i: 1 if problem.x[i] >= problem.y[i] else -1 for i in reduced.pairs}
        # The stored solution in floats says who is zero: mostly its choice, or one near it, has an
        # exact solution.
        solution = _pivoted(reduced, stored)
        if solution is not None:
            return solution
    return _search(reduced)


def _pivoted(reduced: _Reduced, choice: Choice) -> Decision | None:
    """A solution near a choice: who would be negative changes places, all of them while they get fewer, else the last.

    Where a pair is zero to rounding, the exact numbers may require the other choice (K. G. Murty, Linear
    Complementarity, 1988, sect. 4.1).
    """
    fewest = len(reduced.pairs) + 1
    for _ in range(_MOST_PIVOTS):
        values, regular = _values(reduced, choice)
        if values is None:
            return None
        negative = [i for i in reduced.pairs if values[i] < 0]
        if not negative:
            isolated = regular and all(values[i] > 0 for i in reduced.pairs)
            return _solution(
                [choice.get(i, -1) * value for i, value in enumerate(values)], isolated
            )
        flipped = negative if len(negative) < fewest else negative[-1:]
        fewest = min(fewest, len(negative))
        choice = {i: -side if i in flipped else side for i, side in choice.items()}
    return None


def _values(reduced: _Reduced, choice: Choice) -> tuple[list[fmpq] | None, bool]:
    """The unknowns that a full choice leaves, by pair, and whether their system is regular; None without a solution."""
    columns = [(reduced.x if choice.get(i) == 1 else reduced.y)[i] for i in range(reduced.n)]
    try:
        return fmpq_mat(columns).transpose().solve(reduced.b).entries(), True
    except ZeroDivisionError:
        order = [*reduced.free, *reduced.pairs]
    values = _particular([columns[i] for i in order], reduced.b.entries())
    return values and [values[order.index(i)] for i in range(reduced.n)], False


def _particular(columns: list[list[fmpq]], right: list[fmpq]) -> list[fmpq] | None:
    """A solution of a linear system, zero where a column depends on those before it; None if there is none."""
    count = len(columns)
    # reduced row echelon form of the system with its right side as the last column
    form, rank = fmpq_mat(
        [[*(column[r] for column in columns), value] for r, value in enumerate(right)]
    ).rref()
    values = [fmpq(0)] * count
    for row in form.tolist()[:rank]:
        pivot = next(j for j, value in enumerate(row) if value != 0)
        # 0 = 1: a contradiction
        if pivot == count:
            return None
        values[pivot] = row[count]
    return values


def _solution(signed: list[fmpq], isolated: bool = False) -> Decision:
    """The solution with x - y given: one of each pair is zero."""
    zero = fmpq(0)
    return Decision(
        SOLVED, tuple(max(-u, zero) for u in signed), tuple(max(u, zero) for u in signed), isolated
    )


def _search(reduced: _Reduced) -> Decision:
    """Branch on who is zero, where a solution of the linear conditions has both of a pair."""
    refutations: list[Refutation] = []
    choices: list[Choice] = [{}]
    for _ in range(_MOST_CHOICES):
        if not choices:
            return Decision(NONE, refutations=tuple(refutations))
        # The linear conditions of a branch: the columns that its choice leaves, with nonnegative
        # weights.
        choice = choices.pop()
        allowed = [key for key in reduced.columns if choice.get(key[0], key[1]) == key[1]]
        point, vector = _feasible([reduced.columns[key] for key in allowed], reduced.right)
        if vector is not None:
            full = fmpq_mat([vector]) * reduced.rows
            refutations.append(Refutation(tuple(sorted(choice.items())), tuple(full.entries())))
            continue
        # A solution of them that has at most one of each pair solves the problem. Else its larger
        # ones are a guess of the whole choice, and the first pair that has both is branched on, the
        # guess first.
        values = dict(zip(allowed, point))
        guess = {
            i: 1 if values.get((i, 1), 0) > values.get((i, -1), 0) else -1 for i in reduced.pairs
        }
        solution = _pivoted(reduced, guess)
        if solution is not None:
            return solution
        both = [
            i for i in reduced.pairs if values.get((i, 1), 0) > 0 and values.get((i, -1), 0) > 0
        ]
        if not both:
            return _completed(reduced, values)
        choices += [{**choice, both[0]: -guess[both[0]]}, {**choice, both[0]: guess[both[0]]}]
    return Decision(OPEN)


def _feasible(columns: list[list[fmpq]], right: fmpq_mat) -> tuple[list[fmpq], list[fmpq] | None]:
    """Nonnegative weights of columns that sum to the right side; or else a vector as in Farkas' lemma.

    The simplex method, phase 1, with Bland's rule, in rationals. The row of costs is at all times a combination l of
    the given rows, and l stands in the columns of the artificial variables.
    """
    count, n = right.nrows(), len(columns)
    # Tableau with right sides made nonnegative and one artificial variable for each row, which form
    # the first basis. The costs are the sum of the rows: phase 1 minimizes the sum of the
    # artificial variables.
    signs = [-1 if right[r, 0] < 0 else 1 for r in range(count)]
    rows = [
        [sign * column[r] for column in columns]
        + [fmpq(int(r == k)) for k in range(count)]
        + [sign * right[r, 0]]
        for r, sign in enumerate(signs)
    ]
    costs = [sum((row[j] for row in rows), fmpq(0)) for j in range(n + count + 1)]
    basis = list(range(n, n + count))
    while (enters := next((j for j in range(n) if costs[j] > 0), None)) is not None:
        # ratio test; of equal ratios the row whose basic variable has the smallest number (Bland),
        # so that it cannot cycle
        _, _, pivot = min(
            (rows[r][-1] / rows[r][enters], basis[r], r)
            for r in range(count)
            if rows[r][enters] > 0
        )
        scale = 1 / rows[pivot][enters]
        rows[pivot] = [scale * value for value in rows[pivot]]
        leading = [(j, value) for j, value in enumerate(rows[pivot]) if value != 0]
        for row in (*rows[:pivot], *rows[pivot + 1 :], costs):
            if (factor := row[enters]) != 0:
                for j, value in leading:
                    row[j] -= factor * value
        basis[pivot] = enters
    # No cost can be reduced and artificial variables are left: the columns do not reach the right
    # side. The multipliers of the rows, with their signs undone, are the vector of Farkas' lemma.
    if costs[-1] > 0:
        return [], [sign * value for sign, value in zip(signs, costs[n : n + count])]
    weights = [fmpq(0)] * n
    for r, j in enumerate(basis):
        if j < n:
            weights[j] = rows[r][-1]
    return weights, None


def _completed(reduced: _Reduced, values: dict[tuple[int, int], fmpq]) -> Decision:
    """The solution with given values of the pairs, of which none has both; the unknowns of any sign follow."""
    rest = reduced.b.entries()
    for (i, side), value in values.items():
        column = (reduced.x if side == 1 else reduced.y)[i]
        rest = [b - value * c for b, c in zip(rest, column)]
    unsigned = _particular([reduced.y[i] for i in reduced.free], rest)
    if unsigned is None:
        raise ArithmeticError(
            "values of the pairs: found none for the unknowns of any sign; expected a solution"
        )
    free = dict(zip(reduced.free, unsigned))
    return _solution(
        [
            -free[i] if i in free else values.get((i, 1), fmpq(0)) - values.get((i, -1), fmpq(0))
            for i in range(reduced.n)
        ]
    )


def holds(problem: Problem, verdict: Decision) -> bool:
    """Test a verdict by the problem alone.

    Of a solution the equations, the signs and the products; else that the refutations refute and that their choices
    leave none out.
    """
    n = len(problem.b)
    y, x, b = _matrix(problem.A0), _matrix(problem.A1), _matrix(problem.b[:, None])
    if verdict.decided == SOLVED:
        left, right = y * fmpq_mat(n, 1, verdict.y), x * fmpq_mat(n, 1, verdict.x)
        return (
            left == right + b
            and all(v >= 0 for v in (*verdict.y, *verdict.x))
            and all(v * w == 0 for v, w in zip(verdict.y, verdict.x))
        )
    if verdict.decided != NONE:
        return True
    for refutation in verdict.refutations:
        row, zero = fmpq_mat([list(refutation.vector)]), dict(refutation.zero)
        on_y, on_x = row * y, row * x
        if not (row * b)[0, 0] > 0:
            return False
        if any(
            zero.get(i) != 1 and on_y[0, i] > 0 or zero.get(i) != -1 and -on_x[0, i] > 0
            for i in range(n)
        ):
            return False
    return _complete([dict(refutation.zero) for refutation in verdict.refutations])


def _complete(choices: list[Choice]) -> bool:
    """Return whether choices cover all: some pair splits those that name it in two complete parts, or one is empty."""
    if {} in choices or not choices:
        return bool(choices)

    def rest(i: int, side: int) -> list[Choice]:
        return [
            {k: s for k, s in choice.items() if k != i} for choice in choices if choice[i] == side
        ]

    shared = set.intersection(*map(set, choices))
    return any(_complete(rest(i, 1)) and _complete(rest(i, -1)) for i in sorted(shared))
