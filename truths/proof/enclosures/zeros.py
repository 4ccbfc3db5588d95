"""The first zero of functions that are Taylor polynomials of balls: found with a proof, or not decided."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

from flint import arb, arb_poly

from stiction.truths.proof.enclosures import NotProven

_MOST_PIECES = 4000
"""Pieces of a stretch after which the sign of a function counts as not decided."""
_MOST_NEWTON = 60
"""Interval Newton steps; each at least halves the bracket, and most square its width."""


class Undecided(NotProven):
    """A course of events that cannot be proven in ball arithmetic: what was to be proven, and the time in s."""

    def __init__(self, reason: str, time: arb):
        low, high = float(time.lower()), float(time.upper())
        super().__init__(f"undecided at t = [{low:.12g}, {high:.12g}] s: {reason}")
        self.time, self.reason = time, reason


@dataclass(frozen=True)
class Zero:
    """The instant where the largest function of a group falls through zero, all others negative there."""

    tau: arb
    group: Hashable
    function: int


def first_zero(
    groups: Mapping[Hashable, Sequence[arb_poly]], t: arb, h: arb, zeros: Mapping[Hashable, int]
) -> Zero | None:
    """The first instant in (0, h] at which the largest function of some group becomes negative; None if none does.

    The functions are enclosures by polynomials: each coefficient a ball, the last one Lagrange's remainder. Their
    formal derivatives then enclose the derivatives. t is the time of 0 in the motion. `zeros` says by group (of one
    function) how many of the first derivatives, the value included, are zero at 0.

    Raises Undecided where a group neither is proven positive nor to cross zero with a slope, or two cross at once.
    """
    first: Zero | None = None
    for name, group in groups.items():
        # Behind the first zero known so far nothing matters.
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
    """Find the first zero of the largest function of a group and the number of that function; `zeros` as above."""
    slopes = [f.derivative() for f in group]
    leading = group[0]
    for _ in range(zeros):
        leading = leading.derivative()
    # Bisection from the left, by a stack: a piece is done with once one of three proofs goes
    # through.
    pieces, count = [(arb(0), h)], 0
    while pieces:
        low, high = pieces.pop()
        middle, piece = ((low + high) / 2).mid(), low.union(high)
        steepness = [slope(piece) for slope in slopes]
        # 1. A function of the group is positive on the whole piece (mean value form).
        if any(f(middle) + slope * (piece - middle) > 0 for f, slope in zip(group, steepness)):
            continue
        # 2. At 0 the function starts at zero, but its first derivative that does not is positive
        # (Taylor's theorem).
        if zeros and low == 0 and leading(piece) > 0:
            continue
        # 3. A function falls through zero exactly once in the piece, and there all others are
        # negative.
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
    """The zero of a function in a bracket on which its slope has one sign, by interval Newton steps."""
    slope, root = function.derivative(), bracket
    for _ in range(_MOST_NEWTON):
        # N(X) = m - f(m)/f'(X) contains every zero in X (R. E. Moore, Interval Analysis, 1966).
        middle = root.mid()
        step = middle - function(middle) / slope(root)
        if not step.overlaps(root):
            raise ArithmeticError(f"no zero in {bracket.str(10)}")
        narrower = root.intersection(step)
        # what no longer halves is as narrow as the function's own balls allow
        if not narrower.rad() < root.rad() / 2:
            return narrower if narrower.rad() < root.rad() else root
        root = narrower
    return root
