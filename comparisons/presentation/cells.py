"""Text of table cells: numbers rounded by their column's name, errors to two digits with their uncertainty."""

from __future__ import annotations

import math
import re
from numbers import Real

import numpy as np
import pandas as pd

from stiction.comparisons.uncertain import ERROR_DIGITS, Uncertain, plain

TRAJECTORY = "trajectory"
"""Column of stored tables: the file of a row's trajectory, relative to the run folder."""
AGAIN = "run again"
"""Column of stored tables: the command that repeats a run whose trajectory is not stored."""
MISSING, NULL = "–", "null (figure lost in the text we have)"
_ERROR = re.compile(r"error|distance|drift|uncertainty|residual|creep|cpu|wall|change|order|convergence")
_EXACT = re.compile(r"F0|truth \[N\]|event time \[s\]")
_EXACT_DIGITS, _DIGITS = 10, 6  # a threshold is known to 1e-8


def uncertainty_of(column: str) -> str:
    """Column with the uncertainty of another: ``position uncertainty [m]`` of ``position error [m]``; else ``""``."""
    named = re.sub(r"error(, L1 mean)?", "uncertainty", column, count=1)
    return "" if named == column else named


def unit_of(column: str) -> str:
    """Unit in a column's name: ``m`` of ``position error [m]``; none of a number without dimension."""
    found = re.search(r"\[([^\]]*)\]$", column)
    return "" if found is None or found[1] == "-" else found[1]


def with_uncertainty(table: pd.DataFrame) -> pd.DataFrame:
    """Replace pairs of columns, number and uncertainty, by `Uncertain` numbers."""
    pairs = {column: unsure for column in table if (unsure := uncertainty_of(str(column))) and unsure in table}
    shown = table.drop(columns=list(set(pairs.values())))
    for column, unsure in pairs.items():
        shown[column] = [value if is_missing(value) or is_missing(u) else Uncertain(float(value), float(u))
                         for value, u in zip(table[column], table[unsure])]
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


def cell(column: str, value: object) -> str:
    """Text of a value in a column of this name."""
    if is_missing(value):
        return NULL if re.fullmatch(r"paper( \[.*\])?", column.lower()) else MISSING
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, Uncertain):
        return str(value)
    if isinstance(value, Real):
        number = float(value)
        whole = number.is_integer() and abs(number) < 1e6
        digits = ERROR_DIGITS if _ERROR.search(column) else _EXACT_DIGITS if _EXACT.search(column) else _DIGITS
        text = f"{int(number)}" if whole else f"{number:.{digits}g}"
        return plain(text) if digits == ERROR_DIGITS else text
    return re.sub(r"\s+", " ", str(value))


def is_missing(value: object) -> bool:
    """Nothing to show: None, not a number, or an empty text."""
    return value is None or value is pd.NA or (isinstance(value, float) and math.isnan(value)) or value == ""
