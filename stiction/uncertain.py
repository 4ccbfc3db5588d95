"""Numbers that are known to some accuracy, as people read them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal

ERROR_DIGITS = 2
"""Digits of a printed error: its size matters."""
_NEGLIGIBLE = 0.05
"""Largest uncertainty, as a part of its number, that is not printed: it changes the second digit by one at most."""


@dataclass(frozen=True)
class Uncertain:
    """A number and a bound of its error, in the same unit."""

    value: float
    uncertainty: float

    def __str__(self) -> str:
        """``< u`` where the number is not larger than its uncertainty: only the bound of their sum is known."""
        size = abs(self.value)
        if 0 < self.uncertainty >= size:
            return f"< {rounded_up(size + self.uncertainty)}"
        if self.uncertainty <= _NEGLIGIBLE * size:
            return plain(f"{self.value:.{ERROR_DIGITS}g}")
        return self.both()

    def both(self) -> str:
        """``0.145 ± 0.018``, ``1.23 ± 0.09``: both end at the same decimal.

        The uncertainty has two digits up to 35, one from there on (rule of the Particle Data Group). The number stands
        alone where its uncertainty is zero or unknown.
        """
        if not self.uncertainty > 0:
            return plain(f"{self.value:.{ERROR_DIGITS}g}")
        size = max(abs(self.value), self.uncertainty)
        unsure = rounded_up(
            self.uncertainty, 2 if float(f"{self.uncertainty:.2e}"[:4]) < 3.55 else 1
        )
        last = int(Decimal(unsure).as_tuple().exponent)
        if 1e-4 <= size < 1e6:
            return f"{self.value:z.{max(-last, 0)}f} ± {unsure}"
        return f"{self.value:.{max(math.floor(math.log10(size)) - last, 0)}e} ± {unsure}"


def rounded_up(value: float, digits: int = 2) -> str:
    """Round up to so many digits, so that a bound stays one; zeros at the end are left out."""
    return _rounded(value, digits, math.ceil, 1 - 1e-12)


def rounded_down(value: float, digits: int = 2) -> str:
    """Round down, so that a lower bound stays one."""
    return _rounded(value, digits, math.floor, 1 + 1e-12)


def bounded(value: float, sign: str) -> str:
    """``≤ 1.1``, ``> ~100``: a number behind a sign, rounded so that a bound stays one; else to the nearest."""
    rounding = {"≤": rounded_up, ">": rounded_down, "≥": rounded_down}.get(sign[:1])
    return sign + (rounding(value) if rounding else plain(f"{value:.{ERROR_DIGITS}g}"))


def _rounded(value: float, digits: int, whole: Callable[[float], int], factor: float) -> str:
    if value <= 0:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return plain(f"{whole(value / unit * factor) * unit:.{digits}g}")


def plain(number: str) -> str:
    """``190`` for ``1.9e+02``."""
    return f"{float(number):g}"


def with_ends(value: float, low: float, high: float, is_single: bool) -> str:
    """``19.6 (19.3 to 20.1)``: a number with the ends of its interval, to three digits.

    ``~19.6`` for a single sample, which has no interval.
    """
    number, *ends = (plain(f"{each:.3g}") for each in (value, low, high))
    return f"~{number}" if is_single else f"{number} ({' to '.join(ends)})"
