"""Proven first zeros of functions that are Taylor polynomials of balls."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

from flint import arb, arb_poly

from stiction.truths.proof.enclosures import NotProven

_MOST_PIECES = 4000
"""Largest number of pieces of a stretch; the sign of a function is undecided if more are needed."""
_MOST_NEWTON = 60
"""Largest number of interval Newton steps; each at least halves the bracket, and most square its width."""


class Undecided(NotProven):
    """The sequence of events cannot be proven in ball arithmetic, for a reason and at a time (s)."""

    def __init__(self, reason: str, time: arb):
        low, high = float(time.lower()), float(time.upper())
        super().__init__(f"undecided at t = [{low:.12g}, {high:.12g}] s: {reason}")
        self.time, self.reason = time, reason


@dataclass(frozen=True)
class Zero:
    """The instant at which the largest function of a group falls through zero.

    Attributes
    ----------
    tau : arb
        Time since the start of the stretch, s.
    group, function
        Name of the group, and index of the function, all others of which are negative.
    """

    tau: arb
    group: Hashable
    function: int


def first_zero(
    groups: Mapping[Hashable, Sequence[arb_poly]], t: arb, h: arb, zeros: Mapping[Hashable, int]
) -> Zero | None:
    """Return the first instant in (0, h] at which the largest function of a group becomes negative; None without one.

    The functions are enclosures by polynomials: each coefficient a ball, the last one Lagrange's remainder. Their
    formal derivatives then enclose the derivatives. t is the time of 0 in the motion. `zeros` contains, for groups of
    one function, the number of first derivatives, including the value, that are zero at 0.

    Raises
    ------
    Undecided
        If a group is neither proven to be positive nor to cross zero with a slope, or if two groups cross at once.
    """
    first: Zero | None = None
    for name, group in groups.items():
        # Only zeros before the first one that is known so far are sought.
        reach = h if first is None else first.tau.upper()
        crossing = _scan(group, t, reach, zeros.get(name, 0))
        if crossing is not None:
            tau, function = crossing
            zero = Zero(tau, name, function)
            if first is not None and zero.tau.overlaps(first.tau):
                raise Undecided(
                    "two changes of mode whose order is open", t + zero.tau.union(first.tau)
                )
            first = zero
    return first


def _scan(group: Sequence[arb_poly], t: arb, h: arb, zeros: int) -> tuple[arb, int] | None:
    """Return the first zero of the largest function of a group and the index of that function, see `first_zero`."""
    slopes = [f.derivative() for f in group]
    leading = group[0]
    for _ in range(zeros):
        leading = leading.derivative()
    # Bisection from the left, with a stack: a piece is finished if one of three proofs succeeds.
    pieces = [(arb(0), h)]
    count = 0
    while pieces:
        low, high = pieces.pop()
        middle = ((low + high) / 2).mid()
        piece = low.union(high)
        steepness = [slope(piece) for slope in slopes]
        # 1. A function of the group is positive on the whole piece (mean value form).
        if any(f(middle) + slope * (piece - middle) > 0 for f, slope in zip(group, steepness)):
            continue
        # 2. The function is zero at 0, but its first derivative that is not zero there is positive
        # (Taylor's theorem).
        if zeros and low == 0 and leading(piece) > 0:
            continue
        # 3. A function falls through zero exactly once in the piece, and all others are negative there.
        for j, (f, slope) in enumerate(zip(group, steepness)):
            if slope < 0 and f(low) > 0 and f(high) < 0:
                root = newton(f, piece)
                if all(other(root) < 0 for k, other in enumerate(group) if k != j):
                    return root, j
        count += 1
        if count > _MOST_PIECES or not (low < middle < high):
            raise Undecided(
                "a function that decides the contact mode is neither proven to keep its sign nor to cross "
                "zero with a slope (grazing)",
                t + piece,
            )
        pieces += [(middle, high), (low, middle)]
    return None


def newton(function: arb_poly, bracket: arb) -> arb:
    """Return the zero of a function in a bracket in which its slope has one sign, by interval Newton steps."""
    slope = function.derivative()
    root = bracket
    for _ in range(_MOST_NEWTON):
        # N(X) = m - f(m)/f'(X) contains every zero in X (R. E. Moore, Interval Analysis, 1966).
        middle = root.mid()
        step = middle - function(middle) / slope(root)
        if not step.overlaps(root):
            raise ArithmeticError(f"no zero in {bracket.str(10)}")
        narrower = root.intersection(step)
        # If the bracket is no longer halved, it is as narrow as the balls of the function allow.
        if not narrower.rad() < root.rad() / 2:
            return narrower if narrower.rad() < root.rad() else root
        root = narrower
    return root
