"""A smooth stretch of a motion, enclosed: Taylor polynomials in ball arithmetic whose last coefficient is Lagrange's remainder.

On [t0, t0 + h] the solution of q'' = f(t, q, q') from every start of a set exists, is unique and stays in an a-priori enclosure Y as
soon as X + [0, h] f([t0, t0 + h], Y) lies within Y (Picard and Lindeloef with the Banach fixed point theorem; R. J. Lohner,
Enclosing the solutions of ordinary initial and boundary value problems, 1987). Its Taylor coefficient of order N at any instant
of the stretch lies in the coefficient that the recurrence gives on Y, and so does Lagrange's remainder. The same holds of the variational equation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flint import arb, arb_mat, arb_poly, arb_series

from stiction.comparisons.proof.enclosures.series import Equation, Expansion, Jet, TooLong, Value, expand

_PICARD = 30
_WIDEN = arb(1) / 8


Timed = Callable[[arb, int], Equation]
"""The equation of a mode about an instant, with series of so many coefficients."""


def span(low: arb, high: arb) -> arb:
    """A ball with two others in it."""
    return low.union(high)


def _jets(q: Sequence[arb], v: Sequence[arb]) -> tuple[list[Value], list[Value]]:
    """Constant series with the derivatives by themselves."""
    n = len(q)
    unit = [[arb_series([int(i == j)], 1) for j in range(2 * n)] for i in range(2 * n)]
    return ([Jet(arb_series([x], 1), unit[i]) for i, x in enumerate(q)], [Jet(arb_series([x], 1), unit[n + i]) for i, x in enumerate(v)])


def partials(function: Callable[..., Sequence[Value]], q: Sequence[arb], v: Sequence[arb]) -> tuple[list[arb], list[list[arb]]]:
    """Values of functions of (q, v) and their derivatives by the 2n components."""
    found = function(*_jets(q, v))
    zero = [arb(0)] * (2 * len(q))
    return ([(f.value if isinstance(f, Jet) else f)[0] for f in found],
            [[g[0] for g in f.gradient] if isinstance(f, Jet) else zero for f in found])


@dataclass(frozen=True)
class APriori:
    """Where q, v and the derivatives by the start lie throughout a stretch."""

    q: list[arb]
    v: list[arb]
    variation: list[list[arb]]


def a_priori(timed: Timed, t: arb, h: arb, q: Sequence[arb], v: Sequence[arb]) -> APriori:
    """Enclosure over [t, t + h] by Picard's iteration.

    Raises
    ------
    TooLong
        If none was found.
    """
    n, step = len(q), span(arb(0), h)
    equation = timed(t + step, 1)
    Q, V = list(q), list(v)
    for _ in range(_PICARD):
        A, dA = partials(equation, Q, V)
        newV = [a + step * b for a, b in zip(v, A)]
        newQ = [a + step * b for a, b in zip(q, V)]
        if not all(x.is_finite() for x in newV + newQ):
            break
        if all(old.contains(new) for old, new in zip(Q + V, newQ + newV)):
            return APriori(newQ, newV, _variation(dA, n, step))
        Q, V = ([_widened(span(old, new), base) for old, new, base in zip(olds, news, bases)]
                for olds, news, bases in ((Q, newQ, q), (V, newV, v)))
    raise TooLong(f"no enclosure over {h.str(3, radius=False)} s")


def _widened(ball: arb, base: arb) -> arb:
    return ball + (ball.rad() - base.rad()) * _WIDEN * arb(0, 1)


def _variation(partial: list[list[arb]], n: int, step: arb) -> list[list[arb]]:
    """Enclosure of E with E' = [[0, 1], partial] E, E(0) = 1."""
    E = [[arb(int(i == j)) for j in range(2 * n)] for i in range(2 * n)]
    for _ in range(_PICARD):
        new = [[int(i == j) + step * (E[n + i][j] if i < n else sum((partial[i - n][k] * E[k][j] for k in range(2 * n)), arb(0)))
                for j in range(2 * n)] for i in range(2 * n)]
        if all(old.contains(fresh) for olds, news in zip(E, new) for old, fresh in zip(olds, news)):
            return new
        E = [[_widened(span(old, fresh), arb(0)) for old, fresh in zip(olds, news)] for olds, news in zip(E, new)]
    raise TooLong("no enclosure of the variational equation")


def _closed(series: Sequence[arb], remainder: arb, order: int) -> arb_poly:
    return arb_poly([*series[:order], remainder])


@dataclass(frozen=True)
class Arc:
    """All solutions from a set of starts over a stretch of time, and one of them.

    Attributes
    ----------
    t : arb
        Start of the stretch, for all of the set; h its length (an upper bound).
    order : int
        Of the remainder.
    """

    t: arb
    h: arb
    order: int
    timed: Timed
    wide: Expansion
    enclosure: APriori
    set_: Expansion

    @classmethod
    def of(cls, timed: Timed, t: arb, h: arb, q: Sequence[arb], v: Sequence[arb], order: int) -> Arc:
        """All solutions from the starts in (q, v) over [t, t + h]."""
        n, bound = len(q), a_priori(timed, t, h, q, v)
        unit = [[arb(int(i == j)) for j in range(2 * n)] for i in range(2 * n)]
        extra = order + 1
        wide = expand(timed(t + span(arb(0), h), extra), bound.q, bound.v, order, bound.variation)
        return cls(t, h, order, timed, wide, bound, expand(timed(t, extra), q, v, order, unit))

    def remainder(self) -> arb:
        """The largest remainder of q and v at the end of the stretch (upper bound)."""
        scale = self.h ** self.order
        return max((abs(c[self.order]) * scale for c in (*self.wide.q, *self.wide.v)), key=lambda b: float(b.upper()))

    def polynomials(self, start: Expansion | None = None) -> tuple[list[arb_poly], list[arb_poly]]:
        """q and v of all of the set, or of the solution with another expansion from within it."""
        start, N = start or self.set_, self.order
        return tuple([_closed(c, w[N], N) for c, w in zip(fine, wide)]
                     for fine, wide in ((start.q, self.wide.q), (start.v, self.wide.v)))

    def one(self, t: arb, q: Sequence[arb], v: Sequence[arb]) -> Expansion:
        """Expansion of the solution from a start within the set (t and the start are thinner balls)."""
        return expand(self.timed(t, self.order + 1), q, v, self.order)

    def jacobian(self, tau: arb) -> arb_mat:
        """Derivatives of (q, v) at t + tau by the start."""
        N = self.order
        return arb_mat([[_closed(c, w[N], N)(tau) for c, w in zip(fine, wide)]
                        for fine, wide in zip((*self.set_.dq, *self.set_.dv), (*self.wide.dq, *self.wide.dv))])

    def functions(self, along: Callable[[arb, int, list[Value], list[Value], Sequence[Value]], Sequence[Sequence[arb_series]]],
                  start: Expansion | None = None, t: arb | None = None) -> list[list[arb_poly]]:
        """Groups of functions of (t, q, v, q'') over the stretch, with their remainders."""
        N, groups = self.order, []
        for expansion, instant in ((start or self.set_, self.t if t is None else t), (self.wide, self.t + span(arb(0), self.h))):
            q, v = expansion.series(N + 1)
            equation = self.timed(instant, N + 1)
            groups.append(along(instant, N + 1, q, v, equation(q, v)))
        return [[_closed([f[k] for k in range(N)], w[N], N) for f, w in zip(fine, wide)] for fine, wide in zip(*groups)]
