"""Exact numbers of a scene, as they are written: 0.1 is one tenth and "pi/4" a quarter of pi.

Almost every number of a scene has the form q pi^k with rational q and whole k. This form is stored besides a ball, so
that two numbers can be compared: mus = mu, a start at rest, a common period of two frequencies. Products of such a
number with sines and cosines of such numbers are stored too, for a force along a guide of direction
(cos(slope), sin(slope)).
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import isqrt
from typing import Any

from flint import arb, fmpq

from stiction.scenes import Scene
from stiction.scenes.expressions import evaluate
from stiction.scenes.fields import Model
from stiction.truths.proof.enclosures import NotProven

_MOST_FACTORS = 64
"""Largest whole exponent of an exact power, which multiplies the length of numerators."""


class NotComparable(NotProven):
    """Two numbers of a scene may be equal, because their balls overlap."""


@dataclass(frozen=True)
class Exact:
    """A real number.

    Attributes
    ----------
    ball : arb
        A ball that contains the number, at the precision with which it was made.
    product : tuple or None
        q, k and the sorted names of sines and cosines, if the number is such a product. Equal products are equal
        numbers; numbers with different sines may be equal too.
    """

    ball: arb
    product: tuple[fmpq, int, tuple[str, ...]] | None = None

    @classmethod
    def of(
        cls,
        q: fmpq | Fraction | int,
        k: int = 0,
        waves: tuple[str, ...] = (),
        ball: arb | None = None,
    ) -> Exact:
        """Return q pi^k, multiplied by sines and cosines if there are any; `ball` then contains the product."""
        q = fmpq(q.numerator, q.denominator)
        if waves and q != 0:
            return cls(ball, (q, k, waves))
        return cls(arb(q) * arb.pi() ** k, (q, k if q != 0 else 0, ()))

    @property
    def factors(self) -> tuple[fmpq, int] | None:
        """q and k of a number q pi^k; None for any other number."""
        return self.product[:2] if self.product and not self.product[2] else None

    @property
    def _zero(self) -> bool:
        return self.factors is not None and self.factors[0] == 0

    def __add__(self, other: Exact) -> Exact:
        if self._zero or other._zero:
            return other if self._zero else self
        ball = self.ball + other.ball
        # A sum is a product only if both terms have the same powers of pi and the same sines.
        if self.product and other.product and self.product[1:] == other.product[1:]:
            return Exact.of(self.product[0] + other.product[0], *self.product[1:], ball)
        return Exact(ball)

    def __neg__(self) -> Exact:
        return Exact(-self.ball, self.product and (-self.product[0], *self.product[1:]))

    def __sub__(self, other: Exact) -> Exact:
        return self + -other

    def __mul__(self, other: Exact) -> Exact:
        if self._zero or other._zero:
            return ZERO
        ball = self.ball * other.ball
        if self.product and other.product:
            (p, j, waves), (q, k, other_waves) = self.product, other.product
            return Exact.of(p * q, j + k, tuple(sorted(waves + other_waves)), ball)
        return Exact(ball)

    def __truediv__(self, other: Exact) -> Exact:
        if other.factors and not other._zero:
            return self * Exact.of(1 / other.factors[0], -other.factors[1])
        return Exact(self.ball / other.ball)

    def power(self, other: Exact) -> Exact:
        """Return the power, which is exact for whole exponents up to 64."""
        if self.factors and other.factors and other.factors[1] == 0 and other.factors[0].q == 1:
            n = int(other.factors[0].p)
            if abs(n) <= _MOST_FACTORS:
                return Exact.of(self.factors[0] ** n, self.factors[1] * n)
        return Exact(self.ball**other.ball)

    def sqrt(self) -> Exact:
        """Return the square root, which is exact if q and pi^k are squares."""
        if self.factors and self.factors[1] % 2 == 0 and self.factors[0] >= 0:
            p, q = int(self.factors[0].p), int(self.factors[0].q)
            if isqrt(p) ** 2 == p and isqrt(q) ** 2 == q:
                return Exact.of(fmpq(isqrt(p), isqrt(q)), self.factors[1] // 2)
        return Exact(self.ball.sqrt())

    def equals(self, other: Exact) -> bool:
        """Return True if the two numbers are equal; raise NotComparable if this is unknown."""
        if self is other:
            return True
        if self.factors and other.factors:  # pi is transcendental: q pi^k determines q and k
            return self.factors == other.factors
        if self.product and self.product == other.product:
            return True
        if not self.ball.overlaps(other.ball):
            return False
        raise NotComparable(
            f"found {self.ball.str(20)} and {other.ball.str(20)}; "
            "expected numbers q pi^k, or such that differ"
        )

    @property
    def is_zero(self) -> bool:
        """True if the number is 0; raises NotComparable if this is unknown."""
        return self.equals(ZERO)


def _wave(name: str, ball: arb, x: Exact) -> Exact:
    """Return a sine or cosine of x, with its name if x is a product."""
    return Exact(ball, x.product and (fmpq(1), 0, (f"{name} {x.product}",)))


_FUNCTIONS = {
    "sqrt": Exact.sqrt,
    "deg": lambda x: x * Exact.of(Fraction(1, 180), 1),
    "sin": lambda x: ZERO if x._zero else _wave("sin", x.ball.sin(), x),
    "cos": lambda x: ONE if x._zero else _wave("cos", x.ball.cos(), x),
    "tan": lambda x: Exact(x.ball.tan()),
    "atan": lambda x: Exact(x.ball.atan()),
}
_BINARY = {
    ast.Add: Exact.__add__,
    ast.Sub: Exact.__sub__,
    ast.Mult: Exact.__mul__,
    ast.Div: Exact.__truediv__,
    ast.Pow: Exact.power,
}
ZERO: Exact = Exact.of(0)
ONE: Exact = Exact.of(1)


def exact(value: float | int | str, names: Mapping[str, Exact]) -> Exact:
    """Return the exact number that `stiction.scenes.expressions.evaluate` rounds; raise ValueError as there."""
    if not isinstance(value, str):
        return Exact.of(Fraction(repr(value)))
    text = value.strip().replace("^", "**")
    # The evaluation in floats is only for its errors: it rejects everything that is not in the
    # language of scenes.
    evaluate(value, {name: float(number.ball.mid()) for name, number in names.items()})
    return _exact(ast.parse(text, mode="eval").body, text, names)


def _exact(node: ast.expr, text: str, names: Mapping[str, Exact]) -> Exact:
    # A number counts as it is written: 0.1 is one tenth, not the float next to it.
    if isinstance(node, ast.Constant):
        written = ast.get_source_segment(text, node) or repr(node.value)
        return Exact.of(node.value if isinstance(node.value, int) else Fraction(written))
    if isinstance(node, ast.Name):
        return names.get(node.id, Exact.of(1, 1))
    if isinstance(node, ast.BinOp):
        return _BINARY[type(node.op)](
            _exact(node.left, text, names), _exact(node.right, text, names)
        )
    if isinstance(node, ast.UnaryOp):
        inner = _exact(node.operand, text, names)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return _FUNCTIONS[node.func.id](_exact(node.args[0], text, names))
    raise ValueError(
        f"found {ast.unparse(node)!r}; expected numbers, names, arithmetic and functions"
    )


class ExactPart:
    """A part of a scene as its model has it, with exact numbers: those that are written, else the model's defaults."""

    def __init__(self, written: Any, model: Any, parameters: Mapping[str, Exact]):
        self._written, self._model, self._parameters = written, model, parameters

    def __getitem__(self, key: str | int) -> Any:
        """Return a field or an item: a part, an exact number, or None where the scene has none."""
        value = (
            getattr(self._model, str(key)) if isinstance(self._model, Model) else self._model[key]
        )
        try:
            written = self._written[key]
        except (KeyError, IndexError, TypeError):
            written = value
        if isinstance(value, Model | Mapping | tuple):
            return ExactPart(written, value, self._parameters)
        return None if value is None else exact(written, self._parameters)

    def __getattr__(self, name: str) -> Any:
        return self[name]


def exact_parameters(scene: Scene) -> dict[str, Exact]:
    """Return the parameters of a scene, at the working precision."""
    parameters: dict[str, Exact] = {}
    # in their order: a parameter may use those before it
    for name, value in scene._raw.get("parameters", {}).items():
        parameters[name] = exact(value, parameters)
    return parameters


def exact_scene(scene: Scene) -> ExactPart:
    """Return a scene with exact numbers, at the working precision."""
    return ExactPart(scene._raw, scene, exact_parameters(scene))
