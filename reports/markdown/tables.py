"""Tables of a Markdown report: rounded cells, lines of a given width; full precision is in the data."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import product

import pandas as pd

from stiction.comparisons.bench.presentation.cells import cell, is_numeric, with_uncertainty
from stiction.comparisons.bench.quantities import quantity_of

ROWS, WIDTH = 10, 100
"""Rows of a table that is made to fit, and characters of its lines, at most."""
LONGEST = (48, 36, 24)
"""Characters of its words, at most: the shorter, the narrower is the table."""
PADDED = 8
"""Width up to which the cells of a column are padded to the same: most numbers line up, and words waste no room."""


def markdown(table: pd.DataFrame) -> str:
    """Write any table; numbers rounded by what their column is, without index."""
    if table.empty:
        return "(no rows)"
    table = with_uncertainty(table)
    quantities = [quantity_of(str(name)) for name in table]
    rows = [
        [cell(quantity, value) for quantity, value in zip(quantities, row)]
        for row in table.itertuples(index=False, name=None)
    ]
    return aligned(
        [quantity.head for quantity in quantities],
        rows,
        [is_numeric(table[name]) for name in table],
    )


def aligned(
    heads: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[bool], padded: int = PADDED
) -> str:
    """Write text in columns, numbers to the right; cells longer than `padded` stand out of their column."""
    lines = [
        [text.replace("|", "\\|") for text in line] for line in (heads, *rows)
    ]  # a bar would end the cell
    widths = [min(max(map(len, column)), padded) for column in zip(*lines)]
    shown = [
        [
            text.rjust(width) if numbers else text.ljust(width)
            for text, width, numbers in zip(line, widths, right)
        ]
        for line in lines
    ]
    rules = ["-" * max(width - 1, 1) for width in widths]
    rule = [f"{dashes}:" if numbers else f":{dashes}" for dashes, numbers in zip(rules, right)]
    return "\n".join(f"| {' | '.join(line)} |" for line in (shown[0], rule, *shown[1:]))


def fitted(table: pd.DataFrame) -> str:
    """Write the first rows in lines of at most `WIDTH`: words are cut, columns left out from the right are named."""
    for count, most in product(range(table.shape[1], -1, -1), LONGEST):
        text = markdown(
            table.iloc[:ROWS, :count].map(
                lambda value: (
                    textwrap.shorten(value, most, placeholder="..")
                    if isinstance(value, str) and len(value) > most
                    else value
                )
            )
        )
        if max(map(len, text.splitlines())) <= WIDTH:
            break
    left_out = ", ".join(f"*{name}*" for name in table.columns[count:])
    return text + (
        f"\n\nNot shown for want of room, but in the data: {left_out}." if left_out else ""
    )
