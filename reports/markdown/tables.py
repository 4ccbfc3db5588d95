"""Tables of a Markdown report: numbers are rounded, and lines have a limited width.

The data of the run contain the numbers in full precision.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import pandas as pd

from stiction.comparisons.bench.presentation.cells import cell, is_numeric, with_uncertainty
from stiction.comparisons.bench.quantities import quantity_of

ROWS = 10
"""Largest number of rows of a table that is made to fit."""
WIDTH = 100
"""Largest number of characters in a line of a table that is made to fit."""
TEXT_WIDTHS = (48, 36, 24)
"""Largest numbers of characters in a text cell, in the order in which they are tried."""
PADDED_WIDTH = 8
"""Width to which cells are padded, characters: enough to align most numbers without wasting room on text."""


def markdown(table: pd.DataFrame) -> str:
    """Return a table in Markdown, without its index; the quantity of a column determines its number format."""
    if table.empty:
        return "(no rows)"
    table = with_uncertainty(table)
    quantities = [quantity_of(str(name)) for name in table]
    rows = [
        [cell(quantity, value) for quantity, value in zip(quantities, row)]
        for row in table.itertuples(index=False, name=None)
    ]
    heads = [quantity.head for quantity in quantities]
    return align_columns(heads, rows, [is_numeric(table[name]) for name in table])


def align_columns(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    right: Sequence[bool],
    padded_width: int = PADDED_WIDTH,
) -> str:
    """Return a Markdown table of text cells.

    Parameters
    ----------
    heads, rows : sequences of str
        The heading of each column, and the cells of each row.
    right : sequence of bool
        Whether each column is aligned to the right, as numbers are.
    padded_width : int
        Cells are padded to the width of their column, but at most to this width, characters.
    """
    # An unescaped bar would end the cell.
    lines = [[text.replace("|", "\\|") for text in line] for line in (heads, *rows)]
    widths = [min(max(map(len, column)), padded_width) for column in zip(*lines)]
    padded_lines = [
        [_pad(text, width, is_right) for text, width, is_right in zip(line, widths, right)]
        for line in lines
    ]
    # The colon in the line below the heading determines the alignment.
    rule = []
    for width, is_right in zip(widths, right):
        dashes = "-" * max(width - 1, 1)
        rule.append(f"{dashes}:" if is_right else f":{dashes}")
    heading, *body = padded_lines
    return "\n".join(f"| {' | '.join(line)} |" for line in (heading, rule, *body))


def _pad(text: str, width: int, is_right: bool) -> str:
    """Pad a text to a width with spaces, which precede the text if it is aligned to the right."""
    return text.rjust(width) if is_right else text.ljust(width)


def fit_table(table: pd.DataFrame) -> str:
    """Return the first `ROWS` rows of a table, in lines of at most `WIDTH` characters.

    Long texts are shortened, first. If that does not suffice, columns are left out from the right; a
    sentence below the table names them.
    """
    text = ""
    left_out: list[str] = []
    for count in range(table.shape[1], -1, -1):
        left_out = [str(name) for name in table.columns[count:]]
        for text_width in TEXT_WIDTHS:
            columns = table.iloc[:ROWS, :count]
            text = markdown(columns.map(_shorten, width=text_width))
            if max(map(len, text.splitlines())) <= WIDTH:
                return text + _left_out_note(left_out)
    return text + _left_out_note(left_out)


def _shorten(value: Any, width: int) -> Any:
    """Shorten a text to a width at the end of a word; other values are returned unchanged."""
    if isinstance(value, str) and len(value) > width:
        return textwrap.shorten(value, width, placeholder="..")
    return value


def _left_out_note(names: Sequence[str]) -> str:
    """Return a paragraph that names the columns that a table does not show; empty if it shows all."""
    if not names:
        return ""
    columns = ", ".join(f"*{name}*" for name in names)
    return f"\n\nNot shown for want of room, but in the data: {columns}."
