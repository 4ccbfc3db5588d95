"""Proofs for complementarity problems: an exact solution, or a certificate that there is none.

The problem is

    A0 y = A1 x + b ,   y >= 0 ,  x >= 0 ,  y^T x = 0 .

The stored floats are rational numbers, and all computations use rational arithmetic.

- If a pair has the same column in A0 and in A1, only the difference u = y_i - x_i occurs in the
  equations. It may have any sign: it is the reaction of a pin or a motor, split into two parts.
  Such unknowns are eliminated by row reduction, and no choice is needed for their pairs.
- In each other pair one of the two unknowns is zero. A choice for all pairs leaves a linear system,
  and a nonnegative solution of it solves the problem. If it is positive and the system is regular,
  this solution is isolated, that is, a neighbourhood of it contains no other.
- A choice for some of the pairs leaves a set of columns c. A vector l with l^T c <= 0 for all of
  them and l^T b > 0 proves that there is no solution with this choice (Farkas' lemma; A. Schrijver,
  Theory of Linear and Integer Programming, 1986, sect. 7.3). Branch and bound over the choices ends
  when a solution is found or all branches are refuted.

`holds` checks a proof independently of the way in which it was found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq, fmpq_mat

from stiction.comparisons.bench.complementarity.problems import Problem

SOLVED = "solution"
"""Decision: there is a solution."""
NONE = "no solution"
"""Decision: there is no solution."""
OPEN = "not decided"
"""Decision: neither a solution nor a proof was found."""
_MOST_CHOICES = 300
"""Number of branches after which a problem is left open."""
_MOST_PIVOTS = 40
"""Largest number of steps from a choice to a solution near it."""


@dataclass(frozen=True)
class Decision:
    """A decision on a problem, with its proof.

    Attributes
    ----------
    decided : str
        `SOLVED`, `NONE` or `OPEN`.
    y, x : tuple of fmpq
        Exact solution, if `SOLVED`.
    isolated : bool
        True if the solution is proven to be isolated: in each pair that is not eliminated one
        unknown is positive, and the linear system is regular.
    refutations : tuple of Refutation
        If `NONE`, refutations of branches that together contain all choices.
    """

    decided: str
    y: tuple[fmpq, ...] = ()
    x: tuple[fmpq, ...] = ()
    isolated: bool = False
    refutations: tuple[Refutation, ...] = ()


@dataclass(frozen=True)
class Refutation:
    """A proof that there is no solution with a choice.

    Attributes
    ----------
    zero : tuple of (int, int)
        Pairs, each with the unknown that is zero: 1 for y, -1 for x. Pairs that are not listed are
        not restricted.
    vector : tuple of fmpq, n elements
        The vector l of Farkas' lemma.
    """

    zero: tuple[tuple[int, int], ...]
    vector: tuple[fmpq, ...]


def _matrix(values: np.ndarray) -> fmpq_mat:
    """Return a matrix of floats as rational numbers, without rounding."""
    return fmpq_mat([[fmpq(*x.as_integer_ratio()) for x in row] for row in values.tolist()])


Y_IS_ZERO = 1
"""Choice for a pair whose y is zero, so that x remains."""
X_IS_ZERO = -1
"""Choice for a pair whose x is zero, so that y remains."""
Choice = dict[int, int]
"""`Y_IS_ZERO` or `X_IS_ZERO` by pair, for all pairs or some."""


class _Reduced:
    """The problem with the unknowns of arbitrary sign eliminated.

    Attributes
    ----------
    n : int
        Number of pairs.
    free : list of int
        Pairs with the same column in A0 and A1, whose difference y_i - x_i may have any sign.
    pairs : list of int
        All other pairs.
    y, x : list of list of fmpq
        Columns of y and x in A0 y - A1 x = b, by pair.
    b : fmpq_mat, shape (n, 1)
    rows : fmpq_mat, shape (rows, n)
        Combinations of the equations in which the pairs `free` do not occur.
    columns : dict
        Columns of these combinations for the unknown that remains, by pair and choice.
    right : fmpq_mat, shape (rows, 1)
        Right side of these combinations.
    """

    def __init__(self, problem: Problem):
        self.n = len(problem.b)
        numbers = range(self.n)
        self.free = [i for i in numbers if np.array_equal(problem.A0[:, i], problem.A1[:, i])]
        self.pairs = [i for i in numbers if i not in self.free]
        on_y = _matrix(problem.A0)
        on_x = _matrix(-problem.A1)
        self.b = _matrix(problem.b[:, None])
        self.y = on_y.transpose().tolist()
        self.x = on_x.transpose().tolist()

        # Row reduction of (free columns | identity): a row whose left part is zero has on its right
        # a combination of the equations without the free unknowns.
        k = len(self.free)
        augmented = []
        for r in numbers:
            unit = [int(r == j) for j in numbers]
            augmented.append([self.y[i][r] for i in self.free] + unit)
        form, _ = fmpq_mat(augmented).rref()
        combinations = [row[k:] for row in form.tolist() if not any(row[:k])]
        self.rows = fmpq_mat(len(combinations), self.n, sum(combinations, []))

        self.right = self.rows * self.b
        rows_on_x = (self.rows * on_x).tolist()
        rows_on_y = (self.rows * on_y).tolist()
        self.columns: dict[tuple[int, int], list[fmpq]] = {}
        for i in self.pairs:
            self.columns[i, Y_IS_ZERO] = [row[i] for row in rows_on_x]
            self.columns[i, X_IS_ZERO] = [row[i] for row in rows_on_y]

    def remaining_column(self, pair: int, choice: int) -> list[fmpq]:
        """Return the column of A0 y - A1 x = b that belongs to the unknown of a pair that is not zero."""
        return self.x[pair] if choice == Y_IS_ZERO else self.y[pair]


def decide(problem: Problem) -> Decision:
    """Find a solution of a problem, or a proof that there is none, as the module describes."""
    reduced = _Reduced(problem)
    if len(problem.y):
        # The choice of the stored solution in floats, or one near it, usually has an exact
        # solution.
        choice = {}
        for i in reduced.pairs:
            choice[i] = Y_IS_ZERO if problem.x[i] >= problem.y[i] else X_IS_ZERO
        solution = _solution_near(reduced, choice)
        if solution is not None:
            return solution
    return _search(reduced)


def _solution_near(reduced: _Reduced, choice: Choice) -> Decision | None:
    """Return a solution with a choice or one near it; None if none is found.

    Unknowns that would be negative become zero, and the other unknowns of their pairs take their
    places. This is done for all negative ones at once as long as their number decreases, and
    otherwise for the last one (block pivoting; K. G. Murty, Linear Complementarity, 1988, sect.
    4.1).
    """
    fewest = len(reduced.pairs) + 1
    for _ in range(_MOST_PIVOTS):
        values, is_regular = _values(reduced, choice)
        if values is None:
            return None
        negative = [i for i in reduced.pairs if values[i] < 0]
        if not negative:
            is_isolated = is_regular and all(values[i] > 0 for i in reduced.pairs)
            differences = [choice.get(i, X_IS_ZERO) * value for i, value in enumerate(values)]
            return _solution(differences, is_isolated)
        exchanged = negative if len(negative) < fewest else negative[-1:]
        fewest = min(fewest, len(negative))
        choice = {i: -side if i in exchanged else side for i, side in choice.items()}
    return None


def _values(reduced: _Reduced, choice: Choice) -> tuple[list[fmpq] | None, bool]:
    """Solve the linear system of a choice for all pairs.

    Returns
    -------
    values : list of fmpq or None
        The remaining unknown of each pair, y_i - x_i of the pairs `free`; None if there is no
        solution.
    is_regular : bool
        True if the system is regular.
    """
    columns = [reduced.remaining_column(i, choice.get(i, X_IS_ZERO)) for i in range(reduced.n)]
    try:
        return fmpq_mat(columns).transpose().solve(reduced.b).entries(), True
    except ZeroDivisionError:
        pass  # singular
    # The free unknowns come first: those of the pairs that depend on them become zero.
    order = [*reduced.free, *reduced.pairs]
    values_in_order = _particular_solution([columns[i] for i in order], reduced.b.entries())
    if values_in_order is None:
        return None, False
    value_of = dict(zip(order, values_in_order))
    return [value_of[i] for i in range(reduced.n)], False


def _particular_solution(columns: list[list[fmpq]], right: list[fmpq]) -> list[fmpq] | None:
    """Return a solution of a linear system, None if there is none.

    The unknown of a column is zero if the column is a combination of the columns before it.
    """
    count = len(columns)
    # reduced row echelon form of the system with its right side as the last column
    augmented = [[*(column[r] for column in columns), value] for r, value in enumerate(right)]
    form, rank = fmpq_mat(augmented).rref()
    values = [fmpq(0)] * count
    for row in form.tolist()[:rank]:
        pivot = next(j for j, value in enumerate(row) if value != 0)
        if pivot == count:
            return None  # the row is the equation 0 = 1
        values[pivot] = row[count]
    return values


def _solution(differences: list[fmpq], isolated: bool = False) -> Decision:
    """Return the decision for a solution, given x_i - y_i of all pairs; one of x_i and y_i is zero."""
    zero = fmpq(0)
    y = tuple(max(-difference, zero) for difference in differences)
    x = tuple(max(difference, zero) for difference in differences)
    return Decision(SOLVED, y, x, isolated)


def _search(reduced: _Reduced) -> Decision:
    """Decide a problem by branch and bound over the choices, in depth-first order."""
    refutations: list[Refutation] = []
    choices: list[Choice] = [{}]
    for _ in range(_MOST_CHOICES):
        if not choices:
            return Decision(NONE, refutations=tuple(refutations))
        # Without the condition y^T x = 0, a branch is a linear program: its columns are those that
        # its choice leaves, with nonnegative weights. If it is infeasible, the branch is refuted.
        choice = choices.pop()
        allowed = [(i, side) for i, side in reduced.columns if choice.get(i, side) == side]
        point, vector = _feasible([reduced.columns[key] for key in allowed], reduced.right)
        if vector is not None:
            full = fmpq_mat([vector]) * reduced.rows
            refutations.append(Refutation(tuple(sorted(choice.items())), tuple(full.entries())))
            continue

        # The larger unknown of each pair at the feasible point is a guess of the whole choice.
        values = dict(zip(allowed, point))
        x_of = {i: values.get((i, Y_IS_ZERO), fmpq(0)) for i in reduced.pairs}
        y_of = {i: values.get((i, X_IS_ZERO), fmpq(0)) for i in reduced.pairs}
        guess = {i: Y_IS_ZERO if x_of[i] > y_of[i] else X_IS_ZERO for i in reduced.pairs}
        solution = _solution_near(reduced, guess)
        if solution is not None:
            return solution
        # A point with at most one positive unknown in each pair is a solution itself. Otherwise
        # branch on the first pair with two. The last choice is examined first: the guess.
        with_both = [i for i in reduced.pairs if x_of[i] > 0 and y_of[i] > 0]
        if not with_both:
            return _completed(reduced, values)
        pair = with_both[0]
        choices.append({**choice, pair: -guess[pair]})
        choices.append({**choice, pair: guess[pair]})
    return Decision(OPEN)


def _feasible(columns: list[list[fmpq]], right: fmpq_mat) -> tuple[list[fmpq], list[fmpq] | None]:
    """Find nonnegative weights with which columns sum to the right side, or a proof that there are none.

    The method is phase 1 of the simplex method with Bland's rule, in rational numbers. The row of
    costs is at all times the sum of the artificial variables' rows plus a combination l of the
    given rows, which can be read off its columns of the artificial variables.

    Returns
    -------
    weights : list of fmpq
        Empty if there are none.
    vector : list of fmpq or None
        The vector of Farkas' lemma, if there are no weights.
    """
    count, n = right.nrows(), len(columns)
    # Tableau: the right sides are made nonnegative, and each row has an artificial variable. These
    # are the first basis. Phase 1 minimizes their sum; the costs are therefore the sum of the rows.
    signs = [-1 if right[r, 0] < 0 else 1 for r in range(count)]
    rows = []
    for r, sign in enumerate(signs):
        unit = [fmpq(int(r == k)) for k in range(count)]
        rows.append([sign * column[r] for column in columns] + unit + [sign * right[r, 0]])
    costs = [sum((row[j] for row in rows), fmpq(0)) for j in range(n + count + 1)]
    basis = list(range(n, n + count))
    while True:
        # Bland's rule, which prevents cycles: the first column with a positive cost enters, and of
        # the rows with the smallest ratio the one whose basic variable has the smallest number is
        # the pivot.
        entering = next((j for j in range(n) if costs[j] > 0), None)
        if entering is None:
            break
        _, _, pivot = min(
            (rows[r][-1] / rows[r][entering], basis[r], r)
            for r in range(count)
            if rows[r][entering] > 0
        )
        scale = 1 / rows[pivot][entering]
        rows[pivot] = [scale * value for value in rows[pivot]]
        nonzero = [(j, value) for j, value in enumerate(rows[pivot]) if value != 0]
        for row in (*rows[:pivot], *rows[pivot + 1 :], costs):
            factor = row[entering]
            if factor != 0:
                for j, value in nonzero:
                    row[j] -= factor * value
        basis[pivot] = entering
    # If the minimum of the sum of artificial variables is positive, there are no weights. Then the
    # multipliers of the rows, with the signs of the rows, are the vector of Farkas' lemma.
    if costs[-1] > 0:
        return [], [sign * value for sign, value in zip(signs, costs[n : n + count])]
    weights = [fmpq(0)] * n
    for r, j in enumerate(basis):
        if j < n:
            weights[j] = rows[r][-1]
    return weights, None


def _completed(reduced: _Reduced, values: dict[tuple[int, int], fmpq]) -> Decision:
    """Return the solution with given unknowns of the pairs, by pair and choice; the free unknowns are computed."""
    rest = reduced.b.entries()
    for (i, side), value in values.items():
        column = reduced.remaining_column(i, side)
        rest = [b - value * c for b, c in zip(rest, column)]
    free_values = _particular_solution([reduced.y[i] for i in reduced.free], rest)
    if free_values is None:
        raise ArithmeticError(
            "values of the pairs: found none for the unknowns of any sign; expected a solution"
        )
    differences = [fmpq(0)] * reduced.n
    for i, value in zip(reduced.free, free_values):
        differences[i] = -value
    for (i, side), value in values.items():
        differences[i] += side * value
    return _solution(differences)


def holds(problem: Problem, decision: Decision) -> bool:
    """Return whether the proof of a decision is valid, which is checked with the numbers of the problem alone."""
    if decision.decided == SOLVED:
        return _is_solution(problem, decision)
    if decision.decided == NONE:
        are_valid = all(_is_valid(problem, refutation) for refutation in decision.refutations)
        return are_valid and _are_complete([dict(each.zero) for each in decision.refutations])
    return True


def _is_solution(problem: Problem, decision: Decision) -> bool:
    """Return whether y and x satisfy the equations, and are nonnegative and complementary."""
    n = len(problem.b)
    left = _matrix(problem.A0) * fmpq_mat(n, 1, decision.y)
    right = _matrix(problem.A1) * fmpq_mat(n, 1, decision.x) + _matrix(problem.b[:, None])
    are_nonnegative = all(value >= 0 for value in (*decision.y, *decision.x))
    are_complementary = all(y * x == 0 for y, x in zip(decision.y, decision.x))
    return left == right and are_nonnegative and are_complementary


def _is_valid(problem: Problem, refutation: Refutation) -> bool:
    """Return whether l^T b > 0, and l^T c <= 0 for all columns c that the choice leaves."""
    vector = fmpq_mat([list(refutation.vector)])
    if not (vector * _matrix(problem.b[:, None]))[0, 0] > 0:
        return False
    on_y = vector * _matrix(problem.A0)
    on_x = vector * _matrix(-problem.A1)
    choice = dict(refutation.zero)
    for i in range(len(problem.b)):
        if choice.get(i) != Y_IS_ZERO and on_y[0, i] > 0:
            return False
        if choice.get(i) != X_IS_ZERO and on_x[0, i] > 0:
            return False
    return True


def _are_complete(choices: list[Choice]) -> bool:
    """Return whether any full choice contains one of these choices.

    This is the case if one of them is empty. Otherwise some pair must occur in all of them, and
    both the choices with its y zero and those with its x zero must be complete, without this pair.
    """
    if {} in choices:
        return True
    if not choices:
        return False

    def without(pair: int, side: int) -> list[Choice]:
        """Return the choices with a side of a pair, with the pair removed."""
        return [
            {i: s for i, s in choice.items() if i != pair}
            for choice in choices
            if choice[pair] == side
        ]

    common_pairs = set.intersection(*map(set, choices))
    return any(
        _are_complete(without(pair, Y_IS_ZERO)) and _are_complete(without(pair, X_IS_ZERO))
        for pair in sorted(common_pairs)
    )
