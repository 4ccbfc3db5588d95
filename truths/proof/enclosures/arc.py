"""Enclosure of a smooth stretch of a motion by Taylor polynomials of balls with Lagrange's remainder.

On [t0, t0 + h] the solution of q'' = f(t, q, q') from every start of a set exists, is unique and stays in an a-priori
enclosure Y as soon as X + [0, h] f([t0, t0 + h], Y) lies within Y (Picard and Lindeloef with the Banach fixed point
theorem; R. J. Lohner, Enclosing the solutions of ordinary initial and boundary value problems, 1987). Its Taylor
coefficient of order N at any instant of the stretch lies in the coefficient that the recurrence gives on Y, and so does
Lagrange's remainder. The same holds of the variational equation.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

from flint import arb, arb_mat, arb_poly, arb_series

from stiction.truths.proof.enclosures.series import (
    Expansion,
    Timed,
    TooLong,
    Value,
    constants,
    halves,
    identity,
    partials,
    time_series,
)

_PICARD = 30
"""Largest number of Picard iterations; a stretch that needs more is too long."""
_WIDEN = arb(1) / 8
"""Part of its growth by which an enclosure is widened between iterations, so that the next image fits into it."""

Along = Callable[
    [arb_series, Sequence[Value], Sequence[Value], Sequence[Value]],
    Mapping[Hashable, Sequence[Value]],
]
"""Groups of functions of t, q, v and q'', by name."""


def partials_at(
    function: Callable[..., Sequence[Value]], state: Sequence[arb]
) -> tuple[list[arb], list[list[arb]]]:
    """Return the values of functions of (q, v) in a state, and their derivatives by its 2n components."""
    values, gradients = partials(function, constants(state))
    return [f[0] for f in values], [[g[0] for g in gradient] for gradient in gradients]


@dataclass(frozen=True)
class APriori:
    """Balls that contain the state (q, v), and its derivatives by the start, throughout a stretch."""

    state: list[arb]
    variation: arb_mat


def a_priori(timed: Timed, t: arb, h: arb, start: Sequence[arb]) -> APriori:
    """Return an enclosure over [t, t + h] by Picard's iteration; raise TooLong if none is found."""
    # Y is found by iteration from the start: Y -> X + [0, h] f(Y), widened until the image is within
    # Y. This inclusion is also the proof.
    step = arb(0).union(h)
    equation = timed(time_series(t + step, 1))
    old = list(start)
    for _ in range(_PICARD):
        accelerations, slopes = partials_at(equation, old)
        rates = [*halves(old)[1], *accelerations]
        new = [value + step * rate for value, rate in zip(start, rates)]
        if not all(x.is_finite() for x in new):
            break
        if all(outer.contains(inner) for outer, inner in zip(old, new)):
            return APriori(new, _variation(slopes, step))
        old = [_widened(a.union(b), base) for a, b, base in zip(old, new, start)]
    raise TooLong(f"no enclosure over {h.str(3, radius=False)} s")


def _widened(ball: arb, base: arb) -> arb:
    """Return a ball that is wider by a part of its excess over the width of the start."""
    return ball + (ball.rad() - base.rad()) * _WIDEN * arb(0, 1)


def _variation(slopes: list[list[arb]], step: arb) -> arb_mat:
    """Return an enclosure of E with E' = [[0, 1], slopes] E, E(0) = 1, by the same iteration as for the state."""
    n, indices = len(slopes), range(2 * len(slopes))
    E = identity(2 * n).tolist()
    for _ in range(_PICARD):
        rates = E[n:] + [
            [sum((row[k] * E[k][j] for k in indices), arb(0)) for j in indices] for row in slopes
        ]
        new = [[int(i == j) + step * rates[i][j] for j in indices] for i in indices]
        if all(old.contains(fresh) for olds, news in zip(E, new) for old, fresh in zip(olds, news)):
            return arb_mat(new)
        E = [
            [_widened(old.union(fresh), arb(0)) for old, fresh in zip(olds, news)]
            for olds, news in zip(E, new)
        ]
    raise TooLong("no enclosure of the variational equation")


def _closed(fine: Sequence[Any], wide: Sequence[Any]) -> list[Any]:
    """Return the coefficients of a Taylor polynomial, the last one from the whole stretch as Lagrange's remainder."""
    return [*fine[:-1], wide[-1]]


class Arc:
    """All solutions from a set of starts (q, v) at t over h seconds (an upper bound), with remainders of some order.

    They stay in `enclosure`; `wide` is their expansion about any instant of the stretch, `fine` about its start.
    """

    def __init__(self, timed: Timed, t: arb, h: arb, start: Sequence[arb], order: int):
        self.timed, self.t, self.h, self.order = timed, t, h, order
        self.enclosure = a_priori(timed, t, h, start)
        self.wide = Expansion(
            timed, t + arb(0).union(h), self.enclosure.state, order, self.enclosure.variation
        )
        self.fine = Expansion(timed, t, start, order, identity(len(start)))

    def one(self, t: arb, start: Sequence[arb]) -> Expansion:
        """Return the expansion of the solution from a start within the set; t and the start are narrower balls."""
        return Expansion(self.timed, t, start, self.order)

    def remainder(self, groups: Mapping[Hashable, Sequence[arb_poly]]) -> arb:
        """Return an upper bound of the remainders of q, v and functions at the end of the stretch."""
        # Lagrange's remainder is the last coefficient anywhere on the stretch, times the length of the
        # stretch to the power of the order.
        scale = self.h**self.order
        functions = chain.from_iterable(groups.values())
        last = [f[self.order] for f in chain(self.wide.state, functions)]
        return max((abs(term) * scale for term in last), key=lambda ball: float(ball.upper()))

    def polynomials(self, about: Expansion) -> list[arb_poly]:
        """Return the polynomials of the state about an expansion, which is `fine` or that of `one` solution."""
        return [arb_poly(_closed(*pair)) for pair in zip(about.state, self.wide.state)]

    def jacobian(self, tau: arb) -> arb_mat:
        """Return the derivatives of (q, v) at t + tau by the start."""
        powers = _closed(self.fine.variation, self.wide.variation)
        indices = range(len(self.fine.state))
        # `powers` contains a matrix for each power of time; each entry of the matrices is a polynomial.
        return arb_mat(
            [[arb_poly([E[i, j] for E in powers])(tau) for j in indices] for i in indices]
        )

    def functions(self, along: Along, about: Expansion) -> dict[Hashable, list[arb_poly]]:
        """Return the polynomials of groups of functions over the stretch, see `polynomials`."""
        fine = self._coefficients(along, about)
        wide = self._coefficients(along, self.wide)
        return {
            name: [arb_poly(_closed(*pair)) for pair in zip(fine[name], wide[name])]
            for name in fine
        }

    def _coefficients(self, along: Along, expansion: Expansion) -> dict[Hashable, list[list[arb]]]:
        """Return the Taylor coefficients of groups of functions along an expansion."""
        powers = range(self.order + 1)
        q, v = halves(expansion.series(len(powers)))
        groups = along(expansion.t, q, v, expansion.equation(q, v))
        return {name: [[f[k] for k in powers] for f in group] for name, group in groups.items()}
