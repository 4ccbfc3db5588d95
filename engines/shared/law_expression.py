"""Laws of time as Python expressions, for model files and scripts."""

from __future__ import annotations

from stiction.scenes.laws import Constant, Law, Linear, Sine


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
    return None, None
