"""Axes of a sweep: the numbers of a scene that are varied, and their values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.scenes import InputError
from stiction.scenes.expressions import evaluate

MAX_POINTS = 1_000_000
"""Largest number of points of a sweep, and of values of an axis: more is a mistake, and takes days."""


@dataclass(frozen=True)
class SweepAxis:
    """A number of the scene that a sweep varies.

    Attributes
    ----------
    key : str
        Its key, as in `vary`.
    values : tuple of float
        The values that it takes.
    """

    key: str
    values: tuple[float, ...]


def parse_axis(text: str) -> SweepAxis:
    """Return the axis that ``KEY=FROM:TO:COUNT`` (equal distances, both ends included) or ``KEY=A,B,..`` describes.

    The numbers may be arithmetic.

    Raises
    ------
    InputError
        If it is neither, values repeat, or COUNT is not a whole number of at least 2. A single value must be
        written as a number: the arithmetic in ``F0=3-6``, which is -3, is most likely meant as a range.
    """
    key, _, description = (part.strip() for part in text.partition("="))
    if not key or not description:
        raise InputError(
            f"axis: found {text!r}; expected KEY=FROM:TO:COUNT or KEY=A,B,.. such as F0=0.5:6:100"
        )
    is_range = ":" in description
    parts = description.split(":" if is_range else ",")
    numbers = []
    for part in parts:
        try:
            numbers.append(evaluate(part, {}))
        except InputError as error:
            raise InputError(f"axis {key}: found {part.strip()!r}; {error}") from None
    if is_range:
        if len(numbers) != 3:
            raise InputError(f"axis {key}: found {description!r}; expected FROM:TO:COUNT")
        low, high, count = numbers
        if count != int(count) or not 2 <= count <= MAX_POINTS:
            raise InputError(
                f"axis {key}: found {parts[2].strip()!r} values; expected a whole number from 2 to "
                f"{MAX_POINTS}"
            )
        numbers = [
            _without_rounding(value) for value in np.linspace(low, high, int(count)).tolist()
        ]
    if len(numbers) == 1 and not _is_number(description):
        raise InputError(
            f"axis {key}: found {description!r}, which is the single value {numbers[0]:g}; expected a range "
            "FROM:TO:COUNT, or values A,B,.."
        )
    if len(set(numbers)) < len(numbers):
        raise InputError(
            f"axis {key}: found {description!r}; expected values that differ from each other"
        )
    return SweepAxis(key, tuple(numbers))


def _is_number(text: str) -> bool:
    """Return True if a text is a number, as opposed to arithmetic."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _without_rounding(value: float) -> float:
    """Return the number with fewer digits that a value misses by rounding alone: 0.15 for 0.15000000000000002."""
    short = float(f"{value:.14g}")
    return short if abs(short - value) <= 2 * np.spacing(abs(value)) else value
