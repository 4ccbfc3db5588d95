"""Sentences whose numbers are cells of the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import pandas as pd

from stiction.comparisons.bench.presentation.cells import cell
from stiction.comparisons.bench.quantities import Kind, quantity_of
from stiction.uncertain import Uncertain, bounded

MILLIMETRES = 1e-6
"""Metres; lengths from here on are written in mm."""


@dataclass(frozen=True)
class Number:
    """A number in a sentence, and where it comes from.

    Attributes
    ----------
    text : str
        With its uncertainty, or with its interval in brackets.
    table, column : str
        The table is ``data/TABLE.csv``; a count, of the rows with the values `where`, has no column.
    rows : tuple of int
        From 1, the heading not counted; none for a count. Of two it is the cell of the first over that of the second.
    where : Mapping
        The values of the rows that are counted, by column; a set where there are several.
    factor : float
        Multiplies the cell: 1000 for a time in ms.
    """

    text: str
    table: str
    column: str
    rows: tuple[int, ...] = ()
    where: Mapping[str, object] = field(default_factory=dict)
    factor: float = 1.0


@dataclass(frozen=True)
class TracedText:
    """Words with the numbers in them, in their order."""

    text: str = ""
    numbers: tuple[Number, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.text)


Part = TracedText | Number | str


def traced(template: str, *parts: Part) -> TracedText:
    """Return the template with a part in place of each ``{}``."""
    numbers: list[Number] = []
    for part in parts:
        numbers += (
            [part]
            if isinstance(part, Number)
            else part.numbers
            if isinstance(part, TracedText)
            else []
        )
    return TracedText(template.format(*map(_text, parts)), tuple(numbers))


def _text(part: Part) -> str:
    return part if isinstance(part, str) else part.text


def sentence(template: str, *parts: Part) -> TracedText:
    """Return `traced`, or nothing where one of the parts is empty."""
    return traced(template, *parts) if all(map(_text, parts)) else TracedText()


def listed(parts: Sequence[Part], separator: str = ", ", last: str = " and ") -> TracedText:
    """``a, b and c``; nothing of no parts."""
    if not parts:
        return TracedText()
    *first, end = parts
    return traced(separator.join("{}" for _ in first) + (last if first else "") + "{}", *first, end)


def joined(*sentences: TracedText) -> TracedText:
    """Put sentences behind each other; empty ones are left out."""
    return listed(list(filter(None, sentences)), " ", " ")


def value(
    table: str, rows: pd.DataFrame, label: int, column: str, form: str = "", unsure: str = ""
) -> Number:
    """Return the cell of a row, an error or a jump by its size, with its uncertainty where the table has one.

    Parameters
    ----------
    rows
        With the labels 0, 1, .. of the rows of the whole table.
    form
        Format of a number that is not written as in tables.
    unsure
        The column of its uncertainty, if it is not that of the quantity.
    """
    quantity = quantity_of(column)
    found, unsure = rows.at[label, column], unsure or quantity.uncertainty
    if quantity.kind in (Kind.ERROR, Kind.JUMP):
        found = abs(found)
    if form:
        text = short(found, form)
    elif unsure in rows and pd.notna(rows.at[label, unsure]):
        text = str(Uncertain(float(found), float(rows.at[label, unsure])))
    else:
        text = cell(quantity, found)
    return Number(text, table, column, (label + 1,))


def scaled_value(table: str, rows: pd.DataFrame, label: int, column: str, sign: str = "") -> Number:
    """Return a cell in a thousandth of its unit, to two digits, behind its sign: a time in ms, a length in mm."""
    return Number(
        bounded(1e3 * rows.at[label, column], sign), table, column, (label + 1,), factor=1e3
    )


def length(name: str, table: pd.DataFrame, row: int, column: str) -> TracedText:
    """A length with its unit: ``0.24 mm``, ``1.3e-11 m``."""
    if abs(table.at[row, column]) < MILLIMETRES:
        return traced("{} m", value(name, table, row, column))
    return traced("{} mm", scaled_value(name, table, row, column))


def interval(table: str, rows: pd.DataFrame, label: int, column: str, unsure: str = "") -> Number:
    """Return the cell of a row with its sign and its uncertainty: ``-0.035 ± 0.063``; arguments as of `value`."""
    number = Uncertain(
        float(rows.at[label, column]),
        float(rows.at[label, unsure or quantity_of(column).uncertainty]),
    )
    return Number(number.both(), table, column, (label + 1,))


def short(number: float, form: str = ".2g") -> str:
    """``980`` where the form alone would say ``9.8e+02``."""
    text = format(number, form)
    return f"{float(text):g}" if form.endswith("g") and abs(number) < 1e6 else text


def count(table: str, rows: pd.DataFrame, **where: object) -> Number:
    """Return the number of rows of the whole table that have these values."""
    found = rows
    for column, wanted in where.items():
        found = found[found[column].isin(wanted if isinstance(wanted, frozenset) else {wanted})]
    return Number(str(len(found)), table, "", where=where)


def within(table: str, rows: pd.DataFrame, label: int, column: str, low: str, high: str) -> Number:
    """Return the cell of a row, and in brackets the ends of its interval, which other columns have.

    A single sample has no interval: ``~19.6``.
    """
    first, *ends = (short(rows.at[label, name], ".3g") for name in (column, low, high))
    if set(ends) == {first}:
        return Number(f"~{first}", table, column, (label + 1,))
    return Number(f"{first} ({' to '.join(ends)})", table, column, (label + 1,))
