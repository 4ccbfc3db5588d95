"""Taylor coefficients by automatic differentiation in ball arithmetic: power series in time, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from flint import arb, arb_mat, arb_series, ctx

from stiction.truths.proof.enclosures import NotProven

Value = Any
"""A power series in time, alone (`arb_series`) or with its derivatives (`Jet`)."""
Equation = Callable[[Sequence[Value], Sequence[Value]], Sequence[Value]]
"""q'' of q and q'; what depends on time alone is in it."""
Timed = Callable[[arb_series], Equation]
"""The equation with time as a power series about an instant; all series of it get as many coefficients."""


@contextmanager
def working(bits: int, order: int) -> Iterator[None]:
    """Set the bits of balls and the number of coefficients of power series within a context."""
    before = ctx.prec, ctx.cap
    ctx.prec, ctx.cap = bits, order
    try:
        yield
    finally:
        ctx.prec, ctx.cap = before


class TooLong(NotProven):
    """No enclosure over a stretch of this length, or a remainder larger than requested."""


def quotient(numerator: Value, denominator: Value) -> Value:
    """Return the quotient of two values; raise TooLong if the denominator is not proven to differ from zero."""
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
            return Jet(
                self.value + other.value, [a + b for a, b in zip(self.gradient, other.gradient)]
            )
        return Jet(self.value + other, self.gradient)

    def __neg__(self) -> Jet:
        return Jet(-self.value, [-g for g in self.gradient])

    def __sub__(self, other: Value) -> Jet:
        return self + -other

    def __rsub__(self, other: Value) -> Jet:
        return -self + other

    def __mul__(self, other: Value) -> Jet:
        if isinstance(other, Jet):
            pairs = zip(self.gradient, other.gradient)
            return Jet(
                self.value * other.value, [self.value * b + other.value * a for a, b in pairs]
            )
        return self._map(self.value * other, other)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Value) -> Jet:
        if isinstance(other, Jet):
            # (a/b)' = (a' - (a/b) b') / b
            ratio = self.value / other.value
            return Jet(
                ratio,
                [(a - ratio * b) / other.value for a, b in zip(self.gradient, other.gradient)],
            )
        return Jet(self.value / other, [g / other for g in self.gradient])

    def sin(self) -> Jet:
        return self._map(self.value.sin(), self.value.cos())

    def cos(self) -> Jet:
        return self._map(self.value.cos(), -self.value.sin())


def halves(state: list[Any]) -> tuple[list[Any], list[Any]]:
    """Return q and v of a state."""
    return state[: len(state) // 2], state[len(state) // 2 :]


def identity(size: int) -> arb_mat:
    """Return the unit matrix."""
    return arb_mat(size, size, 1)


def constants(values: Sequence[arb]) -> list[arb_series]:
    """Return power series of one coefficient."""
    return [arb_series([value], 1) for value in values]


def time_series(t: arb, order: int) -> arb_series:
    """Return the time as a power series about an instant."""
    return arb_series([t, 1], order)


def partials(
    function: Callable[..., Sequence[Value]], state: Sequence[arb_series]
) -> tuple[list[arb_series], list[tuple[arb_series, ...]]]:
    """Return functions of (q, v) along power series, and their derivatives by the 2n components of the state."""
    # seeds: the derivative of each component by itself is 1
    order, indices = state[0].prec, range(len(state))
    jets = [
        Jet(series, [arb_series([int(i == j)], order) for j in indices])
        for i, series in zip(indices, state)
    ]
    results = function(*halves(jets))
    # a function that does not depend on the state is a plain series
    zero = (arb_series([0]),) * len(state)
    return (
        [f.value if isinstance(f, Jet) else f for f in results],
        [f.gradient if isinstance(f, Jet) else zero for f in results],
    )


class Expansion:
    """Taylor coefficients 0 .. order of the solution of an equation from (q, v) at an instant, about that.

    `t` is time as a power series. `state` is by component of (q, v) and power of time; `variation`, the derivatives of
    the state by the start, by power of time, and empty if it is not requested by its own start.

    From coefficients 0 .. k of q and v the equation gives coefficient k of q'', which is k + 1 times coefficient k + 1
    of v (R. E. Moore, Interval Analysis, 1966, ch. 11). The variational equation E' = B E, B = [[0, 1], df/d(q, v)], is
    linear: with the partial derivatives as power series along the solution,
    (k + 1) E[k + 1] = B[0] E[k] + ... + B[k] E[0].
    """

    def __init__(
        self,
        timed: Timed,
        t: arb,
        start: Sequence[arb],
        order: int,
        variation: arb_mat | None = None,
    ):
        self.t = time_series(t, order + 1)
        self.equation = timed(self.t)
        self.state = [[value] for value in start]
        self.variation: list[arb_mat] = []
        # One coefficient more in each pass: with k + 1 of the state the equation gives coefficient
        # k of q''.
        for k in range(order):
            accelerations = self.equation(*halves(self.series(k + 1)))
            for position, velocity, acceleration in zip(*halves(self.state), accelerations):
                position.append(velocity[k] / (k + 1))
                velocity.append(acceleration[k] / (k + 1))
        if variation is not None:
            self._expand_variation(variation, order)

    def _expand_variation(self, start: arb_mat, order: int) -> None:
        """Add the coefficients of the variational equation, whose coefficients are those of the solution."""
        E, size = self.variation, len(self.state)
        n = size // 2
        _, gradients = partials(self.equation, self.series(order))
        # B = [[0, 1], df/d(q, v)]: the upper rows do not depend on time, and have coefficient 0
        # only
        speeds, nothing = identity(size).tolist()[n:], [[0] * size] * n
        B = [
            arb_mat(
                (nothing if k else speeds) + [[g[k] for g in gradient] for gradient in gradients]
            )
            for k in range(order)
        ]
        E.append(start)
        for k in range(order):
            products = (B[i] * E[k - i] for i in range(k + 1))
            E.append(sum(products, arb_mat(size, size)) * (arb(1) / (k + 1)))

    def series(self, order: int) -> list[arb_series]:
        """Return the state as power series of `order` coefficients."""
        return [arb_series(coefficients, order) for coefficients in self.state]
