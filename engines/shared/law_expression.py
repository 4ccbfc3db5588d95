"""Laws of time as arithmetic that a reader, or Python, can evaluate."""

from __future__ import annotations

from stiction.scenes.laws import Constant, Law, Linear, Sine


def law_expression(law: Law, derivative: int = 0) -> str | None:
    """Return a law (derivative 0) or its rate (1) as a Python expression of ``t`` and ``math``; None for a table."""
    if isinstance(law, Constant):
        return repr((law.value, 0.0)[derivative])
    if isinstance(law, Linear):
        return (f"({law.offset!r} + {law.rate!r} * t)", repr(law.rate))[derivative]
    if isinstance(law, Sine):
        phase = f"({law.frequency!r} * t + {law.phase!r})"
        return (
            f"({law.offset!r} + {law.amplitude!r} * math.sin{phase})",
            f"{law.amplitude * law.frequency!r} * math.cos{phase}",
        )[derivative]
    return None
