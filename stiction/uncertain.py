"""Text of numbers with an uncertainty, and rounding that preserves bounds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal

ERROR_DIGITS = 2
"""Number of significant digits of a printed error; only its order of magnitude matters."""
_NEGLIGIBLE = 0.05
"""Largest relative uncertainty that is not printed: it changes the second digit by one at most."""
_MAX_TWO_DIGITS = 3.55
"""Mantissa of an uncertainty from which it has one digit, by the rule of the Particle Data Group."""
_ROUNDING = 1e-12
"""Relative rounding error of the numbers: a bound that exceeds two digits by less is not rounded further."""


@dataclass(frozen=True)
class Uncertain:
    """A number with an uncertainty.

    Attributes
    ----------
    value : float
        The number.
    uncertainty : float
        Bound of its error, in the same unit; zero or NaN if it is not known.
    """

    value: float
    uncertainty: float

    def __str__(self) -> str:
        """Return the number to two digits, with its uncertainty if this is not negligible.

        If the number is not larger than its uncertainty, the text is the bound of their sum, ``< u``.
        """
        size = abs(self.value)
        if 0 < self.uncertainty >= size:
            return f"< {rounded_up(size + self.uncertainty)}"
        if self.uncertainty <= _NEGLIGIBLE * size:
            return plain(f"{self.value:.{ERROR_DIGITS}g}")
        return self.both()

    def both(self) -> str:
        """Return number and uncertainty, ``0.145 ± 0.018`` or ``1.23 ± 0.09``, to the same decimal place.

        The uncertainty has two digits if these are at most 35, and else one digit (rule of the Particle
        Data Group). If it is zero or not known, the number is written alone, to two digits.
        """
        if not self.uncertainty > 0:
            return plain(f"{self.value:.{ERROR_DIGITS}g}")
        mantissa = float(f"{self.uncertainty:.2e}".partition("e")[0])
        uncertainty = rounded_up(self.uncertainty, 2 if mantissa < _MAX_TWO_DIGITS else 1)
        last_place = int(Decimal(uncertainty).as_tuple().exponent)
        size = max(abs(self.value), self.uncertainty)
        if 1e-4 <= size < 1e6:
            number = f"{self.value:z.{max(-last_place, 0)}f}"
        else:
            decimals = max(math.floor(math.log10(size)) - last_place, 0)
            number = f"{self.value:.{decimals}e}"
        return f"{number} ± {uncertainty}"


def rounded_up(value: float, digits: int = 2) -> str:
    """Return an upper bound, rounded up to a number of digits, without trailing zeros."""
    return _rounded(value, digits, math.ceil, 1 - _ROUNDING)


def rounded_down(value: float, digits: int = 2) -> str:
    """Return a lower bound, rounded down to a number of digits, without trailing zeros."""
    return _rounded(value, digits, math.floor, 1 + _ROUNDING)


def bounded(value: float, sign: str) -> str:
    """Return a number after a sign, such as ``≤ 1.1`` or ``> ~100``, to two digits.

    If the sign makes the number a bound, it is rounded so that the bound holds.
    """
    if sign.startswith("≤"):
        return sign + rounded_up(value)
    if sign.startswith((">", "≥")):
        return sign + rounded_down(value)
    return sign + plain(f"{value:.{ERROR_DIGITS}g}")


def _rounded(value: float, digits: int, to_integer: Callable[[float], int], factor: float) -> str:
    """Return a number rounded by `to_integer` in units of its last digit; zero if it is not positive.

    `factor` compensates the rounding error of the number.
    """
    if value <= 0:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return plain(f"{to_integer(value / unit * factor) * unit:.{digits}g}")


def plain(number: str) -> str:
    """Return a number without an exponent where it has up to six digits: ``190`` for ``1.9e+02``."""
    return f"{float(number):g}"


def with_ends(value: float, low: float, high: float, is_single: bool) -> str:
    """Return a number and the ends of its interval to three digits: ``19.6 (19.3 to 20.1)``.

    A single sample has no interval, and is written as ``~19.6``.
    """
    number = plain(f"{value:.3g}")
    if is_single:
        return f"~{number}"
    return f"{number} ({plain(f'{low:.3g}')} to {plain(f'{high:.3g}')})"
