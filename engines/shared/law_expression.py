"""Laws of time as Python expressions, for model files and scripts."""

from __future__ import annotations

from collections.abc import Sequence

from stiction.scenes.laws import MOVES, Constant, Law, Linear, Piece, Sine, Sum, pieces


def law_expression(law: Law, derivative: int = 0) -> str | None:
    """Return a law (derivative 0) or its rate (1) as a Python expression of ``t`` and ``math``; None for a table."""
    value, rate = _value_and_rate(law)
    return rate if derivative else value


def _value_and_rate(law: Law) -> tuple[str | None, str | None]:
    """Return the expressions of a law and of its rate."""
    if isinstance(law, Constant):
        return repr(law.value), repr(0.0)
    if isinstance(law, Linear):
        return f"({law.offset!r} + {law.rate!r} * t)", repr(law.rate)
    if isinstance(law, Sine):
        phase = f"({law.frequency!r} * t + {law.phase!r})"
        value = f"({law.offset!r} + {law.amplitude!r} * math.sin{phase})"
        return value, f"{law.amplitude * law.frequency!r} * math.cos{phase}"
    if isinstance(law, MOVES):
        return _of_pieces(pieces(law), 0), _of_pieces(pieces(law), 1)
    if isinstance(law, Sum):
        values, rates = zip(*map(_value_and_rate, law.terms))
        if None in values:
            return None, None
        return f"({' + '.join(values)})", f"({' + '.join(rates)})"
    return None, None


def _of_pieces(parts: Sequence[Piece], derivative: int) -> str:
    """Return a move or its rate as nested conditional expressions, the last piece first."""
    expression = _of_piece(parts[0], derivative)
    for part in parts[1:]:
        expression = f"{_of_piece(part, derivative)} if t >= {part.begin!r} else {expression}"
    return f"({expression})"


def _of_piece(part: Piece, derivative: int) -> str:
    """Return a piece or its rate, the polynomial by Horner's rule."""
    coefficients = list(part.coefficients)
    if derivative:
        coefficients = [k * c for k, c in enumerate(coefficients)][1:] or [0.0]
    u = f"(t - {part.origin!r})"
    expression = repr(coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        expression = f"({coefficient!r} + {u} * {expression})"
    if part.amplitude and derivative:
        expression += f" + {part.amplitude * part.frequency!r} * math.cos({part.frequency!r} * {u})"
    elif part.amplitude:
        expression += f" + {part.amplitude!r} * math.sin({part.frequency!r} * {u})"
    return f"({expression})"
