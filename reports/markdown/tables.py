"""Tables of a Markdown report: rounded cells, lines of a given width; full precision is in the data."""

from __future__ import annotations

import textwrap
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from functools import partial

import pandas as pd

from stiction.comparisons.presentation.cells import cell, is_numeric, with_uncertainty

ROWS, WIDTH = 10, 100
"""Rows and characters of a line of a table in a report, at most."""
_PADDED = 40
"""Width up to which the cells of a column are padded to the same."""
_LEAST = 24
"""Characters that words keep when a table is made to fit."""


def markdown(table: pd.DataFrame) -> str:
    """Any table; numbers rounded by what their column is, without index."""
    if table.empty:
        return "(no rows)"
    table = with_uncertainty(table)
    rows = [[cell(name, value) for name, value in zip(table, row)] for row in table.itertuples(index=False, name=None)]
    return aligned([str(name) for name in table], rows, [is_numeric(table[name]) for name in table], _PADDED)


def aligned(heads: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[bool], padded: int = 10 ** 6) -> str:
    """A table of text whose columns line up, numbers to the right; cells longer than `padded` stand out of their column."""
    lines = [[text.replace("|", "\\|") for text in heads]]  # a bar would end the cell
    lines += [[text.replace("|", "\\|") for text in row] for row in rows]
    widths = [min(max(map(len, column)), padded) for column in zip(*lines)]
    shown = [[text.rjust(width) if numbers else text.ljust(width) for text, width, numbers in zip(line, widths, right)] for line in lines]
    rule = ["-" * max(width - 1, 1) + ":" if numbers else ":" + "-" * max(width - 1, 1) for numbers, width in zip(right, widths)]
    return "\n".join(f"| {' | '.join(line)} |" for line in (shown[0], rule, *shown[1:]))


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
