"""Tables as data: which columns of a study's table are shown, under which label, in which unit, with which uncertainty."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stiction.comparisons.presentation.cells import cell, is_missing
from stiction.comparisons.uncertain import Uncertain

BRIEF_ROWS = 30
"""Rows of a table in a report that is read from top to bottom; pages and prints have all of them."""


@dataclass(frozen=True)
class Column:
    """A column of a table as it is shown.

    Attributes
    ----------
    name : str
        Of the frame's column.
    label : str
        Heading, without unit; the name if not given.
    unit : str
        Of the value, after `scale`.
    uncertainty : str
        Name of the frame's column with the uncertainty, in the unit of the value; none if empty.
    form : str
        Format of a number, such as ``".3g"``; two digits for errors, else by the column's name, if empty.
    interval : bool
        A number with a sign, always written with its uncertainty: ``-0.035 ± 0.063``, not ``< 0.098``.
    scale : float
        Factor from the frame's unit to the unit shown: 1000 for s shown in ms.
    brief : bool
        Whether it stands in the report, too; pages and prints have every column.
    beside : str
        Name of the frame's column of a second number, in the same unit, that stands behind in brackets: ``55 (46)``; none if empty.
    bound : str
        Name of the frame's column that is true where the value is an upper bound: ``≤ 55``; none if empty.
    """

    name: str
    label: str = ""
    unit: str = ""
    uncertainty: str = ""
    form: str = ""
    interval: bool = False
    scale: float = 1.0
    brief: bool = True
    beside: str = ""
    bound: str = ""

    @property
    def head(self) -> str:
        """The label with its unit in brackets."""
        return (self.label or self.name) + (f" [{self.unit}]" if self.unit else "")

    def text(self, row: dict[str, object]) -> str:
        """The cell of a row of the frame, with what stands before and behind its value."""
        text = self._value(row)
        second = row.get(self.beside)
        if not is_missing(second):
            text += f" ({cell(self.name, self.scale * float(second))})"
        return f"≤ {text}" if row.get(self.bound) else text

    def _value(self, row: dict[str, object]) -> str:
        value = row[self.name]
        if is_missing(value) or isinstance(value, (str, bool, np.bool_)):
            return cell(self.name, value)
        unsure = row.get(self.uncertainty)
        if self.uncertainty and not is_missing(unsure):
            number = Uncertain(self.scale * float(value), self.scale * float(unsure))
            return number.both() if self.interval else str(number)
        if self.form:
            return format(self.scale * float(value), self.form)
        return cell(self.name, self.scale * value if self.scale != 1 else value)


@dataclass(frozen=True)
class TableView:
    """A table as it is shown, and the rows of the data behind each of its rows.

    Attributes
    ----------
    name : str
        Of its files, unique in a report.
    caption : str
    frame : DataFrame
        Full precision; a row per row shown, uncertainties in columns of their own.
    columns : tuple of Column
        Those shown, in their order; columns without any value are left out.
    source : str
        Name of the table of the data that the rows come from.
    rows : tuple of tuple of int
        Numbers, from 1, of the rows of `source` behind each row.
    group : str
        Column of the frame whose value stands as a heading above rows that share it; none if empty.
    in_report : bool
        Whether it stands in the report and in print; the page and the folder of tables have all.
    """

    name: str
    caption: str
    frame: pd.DataFrame
    columns: tuple[Column, ...]
    source: str
    rows: tuple[tuple[int, ...], ...]
    group: str = ""
    in_report: bool = True

    def shown(self, brief: bool = False) -> list[Column]:
        """The columns that hold anything; `brief`: those of the report alone."""
        return [column for column in self.columns if (column.brief or not brief) and column.name in self.frame
                and not all(is_missing(value) for value in self.frame[column.name])]

    def heads(self, brief: bool = False) -> list[str]:
        return [column.head for column in self.shown(brief)]

    def cells(self, brief: bool = False) -> list[list[str]]:
        """Text, row by row."""
        columns = self.shown(brief)
        return [[column.text(row) for column in columns] for row in self.frame.to_dict("records")]

    def right(self, brief: bool = False) -> list[bool]:
        """Which columns hold numbers, which stand to the right."""
        return [pd.api.types.is_numeric_dtype(self.frame[column.name]) and self.frame[column.name].dtype != bool
                for column in self.shown(brief)]


def view(name: str, caption: str, frame: pd.DataFrame, columns: Iterable[Column], *, source: str = "",
         rows: Sequence[Sequence[int]] | None = None, group: str = "", in_report: bool = True) -> TableView:
    """A `TableView` of the rows of a table of the data, whose index counts from 0, or of rows that sum up several (`rows`)."""
    behind = [(number + 1,) for number in frame.index] if rows is None else rows
    return TableView(name, caption, frame.reset_index(drop=True), tuple(columns), source or name,
                     tuple(tuple(int(number) for number in each) for each in behind), group,
                     in_report)
