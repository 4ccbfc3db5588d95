"""Tables as people read them: columns chosen and rounded for display; full precision is in the data."""

from __future__ import annotations

import math
import re
import textwrap
from bisect import bisect_left
from collections.abc import Iterable
from functools import partial
from numbers import Real

import numpy as np
import pandas as pd

from stiction.comparisons.uncertain import ERROR_DIGITS, Uncertain, plain
from stiction.comparisons.variants import OWN_CPU
from stiction.reports.run_folder.again import AGAIN
from stiction.reports.run_folder.data import TRAJECTORY

RUN_COLUMNS = ("scene", "variant", "engine", "version", "fidelity", "parameter", "step", "status", "reason", "cpu [s]", OWN_CPU,
               "settings", "key", TRAJECTORY, AGAIN)
"""What a row says about the run itself; every other column is a quantity."""
MISSING, NULL = "–", "null (figure lost in the text we have)"
_ERROR = re.compile(r"error|distance|drift|uncertainty|residual|creep|cpu|wall|change|order|convergence")
_EXACT = re.compile(r"F0|truth \[N\]|event time \[s\]")
_EXACT_DIGITS, _DIGITS = 10, 6  # a threshold is known to 1e-8


ROWS, WIDTH = 10, 100
"""Rows and characters of a line of a table in a report, at most."""
_PADDED = 40
"""Width up to which the cells of a column are padded to the same."""
_LEAST = 24
"""Characters that words keep when a table is made to fit."""


def uncertainty_of(column: str) -> str:
    """The column that holds the uncertainty of another, by name: ``position error [m]`` has ``position uncertainty [m]``."""
    return re.sub(r"(error|distance)(, L1 mean)?", "uncertainty", column, count=1)


def with_uncertainty(table: pd.DataFrame) -> pd.DataFrame:
    """The table with `Uncertain` numbers in place of pairs of columns, number and uncertainty."""
    pairs = {column: uncertainty_of(column) for column in table if uncertainty_of(str(column)) != column and uncertainty_of(str(column)) in table}
    shown = table.drop(columns=list(set(pairs.values())))
    for column, unsure in pairs.items():
        shown[column] = [value if _missing(value) or _missing(u) else Uncertain(float(value), float(u))
                         for value, u in zip(table[column], table[unsure])]
    return shown


def is_numeric(column: pd.Series) -> bool:
    """Whether a column holds numbers, with or without uncertainty."""
    return pd.api.types.is_numeric_dtype(column) and column.dtype != bool or any(isinstance(value, Uncertain) for value in column)


def quantities(table: pd.DataFrame) -> list[str]:
    return [column for column in table if column not in RUN_COLUMNS]


def setting_of(parameter: str, step: float) -> str:
    """``dt = 0.001 s`` or ``rtol = 1e-09``; nothing where there is no step."""
    if _missing(step):
        return ""
    return f"dt = {step:g} s" if parameter == "dt" else f"{parameter} = {step:g}"


def worst_per_run(table: pd.DataFrame) -> pd.DataFrame:
    """Of a table with a row per run and jump one row per run: jumps, those resolved, the largest of each error."""
    rows = []
    if table.empty:
        return table
    for _, group in table.groupby("key", sort=False):
        row = group.iloc[0][[column for column in RUN_COLUMNS if column in group]].to_dict()
        errors = [column for column in quantities(group) if "error" in column]
        unsure = [uncertainty_of(column) for column in errors if uncertainty_of(column) in group]
        if group[errors].notna().any(axis=None):
            row["jumps"] = len(group)
            row |= {"resolved": int(group["resolved"].eq(True).sum())} if "resolved" in group else {}
        rows.append({**row, **{f"largest {column}": worst(group[column]) for column in (*errors, *unsure)}})
    return pd.DataFrame(rows)


def markdown(table: pd.DataFrame) -> str:
    """Any table; numbers rounded by what their column is, without index."""
    if table.empty:
        return "(no rows)"
    table = with_uncertainty(table)
    # a bar would end the cell
    cells = [[str(name), *(cell(name, value).replace("|", "\\|") for value in column)] for name, column in table.items()]
    right = [is_numeric(table[name]) for name in table]
    widths = [min(max(map(len, column)), _PADDED) for column in cells]
    padded = [[text.rjust(width) if numeric else text.ljust(width) for text in column] for column, numeric, width in zip(cells, right, widths)]
    rule = ["-" * max(width - 1, 1) + ":" if numeric else ":" + "-" * max(width - 1, 1) for numeric, width in zip(right, widths)]
    head, *rows = zip(*padded)
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, rule, *rows))


def fitted(table: pd.DataFrame, rows: int = ROWS, width: int = WIDTH) -> str:
    """`markdown` of the first rows in lines of at most `width` characters: words are cut, then columns left out from the right, which is told below the table."""
    if table.empty:
        return markdown(table)
    for count in range(table.shape[1], 0, -1):
        render = partial(_cut, table.iloc[:rows, :count])
        sizes = range(width, _LEAST - 1, -2)  # of a word; the shorter, the narrower is the table
        fits = bisect_left(sizes, True, key=lambda most: max(map(len, render(most).splitlines())) <= width)
        if fits < len(sizes):
            break
    return render(sizes[min(fits, len(sizes) - 1)]) + _left_out(table.columns[count:])


def _cut(table: pd.DataFrame, most: int) -> str:
    """`markdown` of the table with words of at most `most` characters."""
    return markdown(table.map(lambda value: textwrap.shorten(value, most, placeholder="..") if isinstance(value, str) and len(value) > most else value))


def _left_out(columns: Iterable[object]) -> str:
    """The sentence below a table; empty where it has all columns."""
    names = ", ".join(f"*{name}*" for name in columns)
    return f"\n\nNot shown for want of room, but in the data: {names}." if names else ""


def all_rows(name: str, count: int) -> str:
    """Where all rows of a table are."""
    return f"All {count} rows: [data/{name}.csv](data/{name}.csv)."


def cell(column: str, value: object) -> str:
    """A value as it stands in a column of this name."""
    if _missing(value):
        return NULL if re.fullmatch(r"paper( \[.*\])?", column.lower()) else MISSING
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, Uncertain):
        return str(value)
    if isinstance(value, Real):
        whole = float(value).is_integer() and abs(value) < 1e6
        digits = ERROR_DIGITS if _ERROR.search(column) else _EXACT_DIGITS if _EXACT.search(column) else _DIGITS
        text = f"{int(value)}" if whole else f"{value:.{digits}g}"
        return plain(text) if digits == ERROR_DIGITS else text
    return re.sub(r"\s+", " ", str(value))


def worst(values: Iterable[object]) -> float:
    """The largest size among numbers, nan without any: what stands for a group of errors."""
    return max((abs(float(value)) for value in values if not _missing(value)), default=math.nan)


def _missing(value: object) -> bool:
    return value is None or value is pd.NA or (isinstance(value, float) and math.isnan(value)) or value == ""
