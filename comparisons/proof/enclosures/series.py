"""Taylor coefficients by automatic differentiation in ball arithmetic: power series in time, and their derivatives by the start."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from flint import arb, arb_mat, arb_series, ctx

from stiction.scenes import StictionError

Value = Any
"""A power series in time, alone (`arb_series`) or with its derivatives (`Jet`)."""
ZERO = arb_series([0])
Equation = Callable[[Sequence[Value], Sequence[Value]], Sequence[Value]]
"""q'' of q and q'; what depends on time alone is in it."""


@contextmanager
def working(bits: int, order: int) -> Iterator[None]:
    """Precision of balls in bits and number of coefficients of power series; as before on leaving."""
    before = ctx.prec, ctx.cap
    ctx.prec, ctx.cap = bits, order
    try:
        yield
    finally:
        ctx.prec, ctx.cap = before


def sin(x: Value) -> Value:
    return x.sin()


def cos(x: Value) -> Value:
    return x.cos()


class TooLong(StictionError, ArithmeticError):
    """Over a stretch of this length there is no enclosure, or its remainder is larger than asked for."""


def quotient(numerator: Value, denominator: Value) -> Value:
    """Their quotient.

    Raises
    ------
    TooLong
        If the denominator is not proven to differ from zero.
    """
    leading = denominator.value if isinstance(denominator, Jet) else denominator
    if leading[0].contains(0):
        raise TooLong("a denominator is not proven to differ from zero")
    return numerator / denominator


class Jet:
    """A power series in time with its derivatives by some variables: the chain rule, operation by operation."""

    __slots__ = ("value", "gradient")

    def __init__(self, value: arb_series, gradient: Sequence[arb_series]):
        self.value, self.gradient = value, tuple(gradient)

    def _map(self, value: arb_series, slope: Value) -> Jet:
        return Jet(value, [slope * g for g in self.gradient])

    def __add__(self, other: Value) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.value + other.value, [a + b for a, b in zip(self.gradient, other.gradient)])
        return Jet(self.value + other, self.gradient)

    def __neg__(self) -> Jet:
        return Jet(-self.value, [-g for g in self.gradient])

    def __sub__(self, other: Value) -> Jet:
        return self + -other

    def __rsub__(self, other: Value) -> Jet:
        return -self + other

    def __mul__(self, other: Value) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.value * other.value, [self.value * b + other.value * a for a, b in zip(self.gradient, other.gradient)])
        return self._map(self.value * other, other)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Value) -> Jet:
        if isinstance(other, Jet):
            quotient = self.value / other.value
            return Jet(quotient, [(a - quotient * b) / other.value for a, b in zip(self.gradient, other.gradient)])
        return Jet(self.value / other, [g / other for g in self.gradient])

    def sin(self) -> Jet:
        return self._map(self.value.sin(), self.value.cos())

    def cos(self) -> Jet:
        return self._map(self.value.cos(), -self.value.sin())


@dataclass(frozen=True)
class Expansion:
    """Taylor coefficients of a solution of q'' = f(t, q, q') about its start.

    Attributes
    ----------
    q, v : list of list of arb
        By coordinate and power of time.
    dq, dv : list of list of list of arb
        Derivatives by the start (q, v): by coordinate, component of the start and power. Empty if not asked for.
    """

    q: list[list[arb]]
    v: list[list[arb]]
    dq: list[list[list[arb]]]
    dv: list[list[list[arb]]]

    def series(self, order: int) -> tuple[list[arb_series], list[arb_series]]:
        """q and v as power series of `order` coefficients."""
        return [arb_series(c, order) for c in self.q], [arb_series(c, order) for c in self.v]


def expand(equation: Equation, q: Sequence[arb], v: Sequence[arb], order: int,
           variation: Sequence[Sequence[arb]] | None = None) -> Expansion:
    """Coefficients 0 .. order of the solution that starts at (q, v), and with `variation` those of the variational equation.

    From coefficients 0 .. k of q and v the equation gives coefficient k of q'', which is k + 1 times coefficient k + 1 of v
    (R. E. Moore, Interval Analysis, 1966, ch. 11). The variational equation E' = B(t) E is linear: with the partial derivatives of the
    equation as power series along the solution, (k + 1) E[k + 1] = B[0] E[k] + ... + B[k] E[0].

    Parameters
    ----------
    variation
        The derivatives of (q, v) by the start at the start: 2n rows of 2n balls.
    """
    found = Expansion([[value] for value in q], [[value] for value in v], [], [])
    for k in range(order):
        for position, velocity, force in zip(found.q, found.v, equation(*found.series(k + 1))):
            position.append(velocity[k] / (k + 1))
            velocity.append(force[k] / (k + 1))
    if variation is None:
        return found
    n, B, E = len(q), _variational(equation, *found.series(order)), [arb_mat(variation)]
    for k in range(order):
        E.append(sum((B[i] * E[k - i] for i in range(k + 1)), arb_mat(2 * n, 2 * n)) * (arb(1) / (k + 1)))
    rows = [[[power[i, j] for power in E] for j in range(2 * n)] for i in range(2 * n)]
    return Expansion(found.q, found.v, rows[:n], rows[n:])


def _variational(equation: Equation, q: Sequence[arb_series], v: Sequence[arb_series]) -> list[arb_mat]:
    """B by powers of time: of E' = [[0, 1], df/d(q, v)] E."""
    n, order = len(q), q[0].prec
    unit = [[arb_series([int(i == j)], order) for j in range(2 * n)] for i in range(2 * n)]
    jets = [Jet(series, row) for series, row in zip((*q, *v), unit)]
    gradients = [a.gradient if isinstance(a, Jet) else (ZERO,) * (2 * n) for a in equation(jets[:n], jets[n:])]
    return [arb_mat([[int(k == 0 and j == n + i) for j in range(2 * n)] for i in range(n)] + [[g[k] for g in gradient] for gradient in gradients])
            for k in range(order)]
