"""Text of the cells of tables: numbers are rounded according to the kind of their quantity."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from numbers import Real

import numpy as np
import pandas as pd

from stiction.comparisons.bench.quantities import DIGITS, Kind, Quantity, quantity_of
from stiction.scenes import InputError
from stiction.uncertain import ERROR_DIGITS, Uncertain, plain

TRAJECTORY = "trajectory"
"""Column of stored tables: the file of the trajectory of a run, relative to the run folder."""
AGAIN = "rerun_command"
"""Column of stored tables: the command that repeats a run whose trajectory is not stored."""
MISSING = "–"
"""Text of a missing value."""
NULL = "null (figure lost in the text we have)"
"""Text of a missing value of the quantities `UNPRINTED`."""
UNPRINTED = frozenset({"paper_threshold"})
"""Keys of numbers of the paper that are missing in the text available to us."""
END = ".3g"
"""Format of the ends of intervals, whose relative accuracy is some thousandths."""
LARGEST_WHOLE = 1e6
"""Whole numbers are rounded only if they are not smaller than this."""


def with_uncertainty(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table in which pairs of columns, number and uncertainty, are replaced by `Uncertain` numbers."""
    uncertainty_of = {}
    for column in table:
        uncertainty = quantity_of(column).uncertainty
        if uncertainty and uncertainty in table:
            uncertainty_of[column] = uncertainty
    shown = table.drop(columns=list(set(uncertainty_of.values())))
    for column, uncertainty in uncertainty_of.items():
        shown[column] = [
            value
            if is_missing(value) or is_missing(half_width)
            else Uncertain(float(value), float(half_width))
            for value, half_width in zip(table[column], table[uncertainty])
        ]
    return shown


def is_numeric(column: pd.Series) -> bool:
    """Return whether a column contains numbers, with or without uncertainty."""
    is_number = pd.api.types.is_numeric_dtype(column) and column.dtype != bool
    return is_number or any(isinstance(value, Uncertain) for value in column)


def setting_of(parameter: str, step: float) -> str:
    """Return a parameter with its value, ``dt = 0.001 s`` or ``rtol = 1e-09``; empty if there is no value."""
    if is_missing(step):
        return ""
    return f"dt = {step:g} s" if parameter == "dt" else f"{parameter} = {step:g}"


def cell(quantity: Quantity, value: object) -> str:
    """Return the text of a value of a quantity, without unit."""
    if is_missing(value):
        return NULL if quantity.key in UNPRINTED else MISSING
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if quantity.kind == Kind.INTERVALS:
        return "; ".join(intervals_in_words(value))
    if isinstance(value, Uncertain):
        return str(value)
    if isinstance(value, Real):
        return _number_text(quantity, float(value))
    # Line breaks would end a row of a Markdown table.
    return re.sub(r"\s+", " ", quantity.words.get(str(value), str(value)))


def _number_text(quantity: Quantity, number: float) -> str:
    """Return a number with the digits of its quantity; whole numbers with all digits."""
    if number.is_integer() and abs(number) < LARGEST_WHOLE:
        return f"{int(number)}"
    digits = DIGITS.get(quantity.kind, DIGITS[Kind.VALUE])
    text = f"{number:.{digits}g}"
    return plain(text) if digits == ERROR_DIGITS else text


def intervals_text(intervals: Sequence[tuple[float, float]]) -> str:
    """Return intervals as a JSON list, as tables store them; empty if there are none."""
    return json.dumps(intervals) if intervals else ""


def intervals_of(text: object) -> list[tuple[float, float]]:
    """Return the intervals stored in a cell; raises InputError if they are not pairs of numbers."""
    if is_missing(text):
        return []
    try:
        return [(float(low), float(high)) for low, high in json.loads(str(text))]
    except (TypeError, ValueError):
        raise InputError(
            f"found {str(text)!r}; expected pairs of numbers as a JSON list, such as [[3.77, 4.54]]"
        ) from None


def intervals_in_words(text: object) -> list[str]:
    """Return each interval stored in a cell as ``3.77 to 4.54``; as one number if both ends are written alike."""
    words = []
    for low, high in intervals_of(text):
        low_text = f"{low:{END}}"
        high_text = f"{high:{END}}"
        words.append(low_text if low_text == high_text else f"{low_text} to {high_text}")
    return words


def is_missing(value: object) -> bool:
    """Return whether a value is None, nan, or an empty text."""
    return (
        value is None
        or value is pd.NA
        or (isinstance(value, float) and math.isnan(value))
        or value == ""
    )
