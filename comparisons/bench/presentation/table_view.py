"""Tables as data: the columns of a study's table that are shown, with label, unit and uncertainty."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.presentation.cells import cell, is_missing
from stiction.comparisons.bench.quantities import Quantity, quantity_of
from stiction.uncertain import Uncertain, bounded

BRIEF_ROWS = 30
"""Rows of a table in a report that is read from top to bottom; pages and prints have all of them."""


@dataclass(frozen=True)
class Column:
    """A column of a table as it is shown: a quantity, and what this table shows of it in another way.

    Attributes
    ----------
    name, uncertainty, second, bound : str
        Columns of the frame: the value; its uncertainty, that of the quantity if empty; a second number of the same
        unit, in brackets where it is another: ``55 (46)``; the signs of a value that is a bound or unsure: ``≤ 55``,
        ``≥ ~55``. One without an uncertainty is rounded as its sign says.
    label : str
        Heading without unit; that of the quantity if empty.
    unit : str
        The unit after `scale`; that of the quantity if empty.
    form : str
        Format of a number, such as ``".3g"``; if empty, the digits of the kind of quantity.
    of : str
        Key of the quantity that the column shows; its own `name` if empty. Columns that a table is pivoted to have
        names of their own, such as a column for each scene.
    interval : bool
        True for a number with a sign and always with its uncertainty: ``-0.035 ± 0.063``, not ``< 0.098``.
    scale : float
        Factor from the frame's unit to the unit shown: 1000 for s shown in ms.
    brief : bool
        True if it stands in the report, too; pages and prints have every column.
    """

    name: str
    label: str = ""
    unit: str = ""
    uncertainty: str = ""
    form: str = ""
    interval: bool = False
    scale: float = 1.0
    brief: bool = True
    second: str = ""
    bound: str = ""
    of: str = ""

    @property
    def quantity(self) -> Quantity:
        """What the column shows."""
        return quantity_of(self.of or self.name)

    @property
    def head(self) -> str:
        """The label with its unit in brackets."""
        unit = self.unit or self.quantity.unit
        return (self.label or self.quantity.label) + (f" [{unit}]" if unit else "")

    def text(self, row: Mapping[str, Any]) -> str:
        """The cell of a row of the frame."""
        text, sign, second = self._value(row), row.get(self.bound), row.get(self.second)
        if isinstance(sign, str) and sign:
            text = (
                f"{sign}{text}"
                if self.interval
                else bounded(self.scale * float(row[self.name]), sign)
            )
        if second is not None and not is_missing(second) and second != row[self.name]:
            text += f" ({cell(self.quantity, self.scale * float(second))})"
        return text

    def _value(self, row: Mapping[str, Any]) -> str:
        value = row[self.name]
        if is_missing(value) or isinstance(value, (str, bool, np.bool_)):
            return cell(self.quantity, value)
        unsure = row.get(self.uncertainty or ("" if self.form else self.quantity.uncertainty))
        if unsure is not None and not is_missing(unsure):
            number = Uncertain(self.scale * float(value), self.scale * float(unsure))
            return number.both() if self.interval else str(number)
        if self.form:
            return format(self.scale * float(value), self.form)
        return cell(self.quantity, self.scale * value if self.scale != 1 else value)


METHOD = Column("variant", "method")
"""What a row is of, in the words of a reader."""
REFINED_BY = Column("parameter", "refined by")
"""The parameter along a refinement series."""


@dataclass(frozen=True)
class TableView:
    """A table as it is shown, and the rows of the data behind each of its rows.

    Attributes
    ----------
    name : str
        Names its files, unique in a report.
    frame : DataFrame
        Full precision; a row per row shown, uncertainties in columns of their own.
    columns : tuple of Column
        Those without any value are not shown.
    source : str
        Name of the table of the data that the rows come from.
    rows : tuple of tuple of int
        Numbers, from 1, of the rows of `source` behind each row.
    group : str
        Column of the frame whose value stands as a heading above rows that share it, or first in each row; none if
        empty.
    in_report : bool
        True if it stands in the report and in print; the page and the folder of tables have all.
    caption : str
        Comes from the study's template when the section is written.
    """

    name: str
    frame: pd.DataFrame
    columns: tuple[Column, ...]
    source: str
    rows: tuple[tuple[int, ...], ...]
    group: str = ""
    in_report: bool = True
    caption: str = ""

    def shown(self, brief: bool = False) -> list[Column]:
        """The columns that hold anything; `brief`: those of the report alone, which has groups as headings of rows."""
        first = (Column(self.group),) if self.group and not brief else ()
        return [
            column
            for column in (*first, *self.columns)
            if (column.brief or not brief)
            and column.name in self.frame
            and not all(is_missing(value) for value in self.frame[column.name])
        ]

    def heads(self, brief: bool = False) -> list[str]:
        return [column.head for column in self.shown(brief)]

    def cells(self, brief: bool = False) -> list[list[str]]:
        """Text, row by row."""
        columns = self.shown(brief)
        return [[column.text(row) for column in columns] for row in self.frame.to_dict("records")]

    def right(self, brief: bool = False) -> list[bool]:
        """True for columns of numbers, which stand to the right."""
        return [
            pd.api.types.is_numeric_dtype(self.frame[column.name])
            and self.frame[column.name].dtype != bool
            for column in self.shown(brief)
        ]


def view(
    name: str,
    frame: pd.DataFrame | Iterable[tuple[Mapping[str, Any], pd.DataFrame]],
    columns: Iterable[Column],
    *,
    source: str = "",
    rows: Sequence[Sequence[int]] | None = None,
    group: str = "",
    in_report: bool = True,
    caption: str = "",
) -> TableView:
    """Return a `TableView` of a table of the data, or of a part of it, whose index counts from 0.

    Parameters
    ----------
    frame
        Rows of the data; or pairs of a row and the rows of the data that it sums up.
    rows
        Rows of `source` behind each row of a frame, from 1, where they are not its own.
    """
    if not isinstance(frame, pd.DataFrame):
        pairs = list(frame)
        frame, rows = (
            pd.DataFrame([row for row, _ in pairs]),
            [behind.index + 1 for _, behind in pairs],
        )
    behind = [(number + 1,) for number in frame.index] if rows is None else rows
    return TableView(
        name,
        frame.reset_index(drop=True),
        tuple(columns),
        source or name,
        tuple(tuple(int(number) for number in each) for each in behind),
        group,
        in_report,
        caption,
    )
