"""Text of table cells: numbers rounded by the kind of their quantity, errors to two digits with their uncertainty."""

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
"""Column of stored tables: the file of a row's trajectory, relative to the run folder."""
AGAIN = "rerun_command"
"""Column of stored tables: the command that repeats a run whose trajectory is not stored."""
MISSING, NULL = "–", "null (figure lost in the text we have)"
UNPRINTED = frozenset({"paper_threshold"})
"""Keys of numbers of the paper that are lost in the text we have: missing ones are `NULL`."""
END = ".3g"
"""Format of the ends of intervals, which are known to a few thousandths of themselves."""
LARGEST_WHOLE = 1e6
"""Size from which on whole numbers are rounded, too."""


def with_uncertainty(table: pd.DataFrame) -> pd.DataFrame:
    """Replace pairs of columns, number and uncertainty, by `Uncertain` numbers."""
    pairs = {
        column: unsure
        for column in table
        if (unsure := quantity_of(column).uncertainty) and unsure in table
    }
    shown = table.drop(columns=list(set(pairs.values())))
    for column, unsure in pairs.items():
        shown[column] = [
            value if is_missing(value) or is_missing(u) else Uncertain(float(value), float(u))
            for value, u in zip(table[column], table[unsure])
        ]
    return shown


def is_numeric(column: pd.Series) -> bool:
    """Test if a column holds numbers, with or without uncertainty."""
    is_number = pd.api.types.is_numeric_dtype(column) and column.dtype != bool
    return is_number or any(isinstance(value, Uncertain) for value in column)


def setting_of(parameter: str, step: float) -> str:
    """``dt = 0.001 s`` or ``rtol = 1e-09``; nothing where there is no step."""
    if is_missing(step):
        return ""
    return f"dt = {step:g} s" if parameter == "dt" else f"{parameter} = {step:g}"


def cell(quantity: Quantity, value: object) -> str:
    """Text of a value of a quantity."""
    if is_missing(value):
        return NULL if quantity.key in UNPRINTED else MISSING
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if quantity.kind == Kind.INTERVALS:
        return "; ".join(intervals_in_words(value))
    if isinstance(value, Uncertain):
        return str(value)
    if isinstance(value, Real):
        number = float(value)
        if number.is_integer() and abs(number) < LARGEST_WHOLE:
            return f"{int(number)}"
        digits = DIGITS.get(quantity.kind, DIGITS[Kind.VALUE])
        text = f"{number:.{digits}g}"
        return plain(text) if digits == ERROR_DIGITS else text
    return re.sub(r"\s+", " ", quantity.words.get(str(value), str(value)))


def intervals_text(intervals: Sequence[tuple[float, float]]) -> str:
    """Return intervals as a table of the data holds them; empty where there are none."""
    return json.dumps(intervals) if intervals else ""


def intervals_of(text: object) -> list[tuple[float, float]]:
    """Return the intervals in a cell of the data. Raises InputError where these are no pairs of numbers."""
    if is_missing(text):
        return []
    try:
        return [(float(low), float(high)) for low, high in json.loads(str(text))]
    except (TypeError, ValueError):
        raise InputError(
            f"found {str(text)!r}; expected pairs of numbers as a JSON list, such as [[3.77, 4.54]]"
        ) from None


def intervals_in_words(text: object) -> list[str]:
    """Write each interval in a cell of the data: ``3.77 to 4.54``; one number where both ends are the same."""
    ends = [[f"{end:{END}}" for end in interval] for interval in intervals_of(text)]
    return [low if low == high else f"{low} to {high}" for low, high in ends]


def is_missing(value: object) -> bool:
    """Nothing to show: None, not a number, or an empty text."""
    return (
        value is None
        or value is pd.NA
        or (isinstance(value, float) and math.isnan(value))
        or value == ""
    )
