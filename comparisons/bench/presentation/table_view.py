"""Tables as data: which columns of a table are shown, with which label, unit and uncertainty."""

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
"""Largest number of rows of a table in the Markdown report; the page and the paper show all
rows."""


@dataclass(frozen=True)
class Column:
    """A column of a table as it is shown.

    Attributes
    ----------
    name : str
        Column of the frame with the values.
    label : str
        Heading without unit; the label of the quantity if empty.
    unit : str
        Unit of the numbers shown, that is, after `scale`; the unit of the quantity if empty.
    uncertainty : str
        Column of the frame with the uncertainty; the one of the quantity if empty.
    form : str
        Format of a number, such as ``".3g"``; if empty, the kind of quantity determines the digits.
    interval : bool
        True to write a number with its sign and its uncertainty in any case: ``-0.035 ± 0.063``,
        not ``< 0.098``.
    scale : float
        Factor from the frame's unit to the unit shown, for example 1000 to show s in ms.
    brief : bool
        True if the Markdown report contains the column; the page and the paper contain all columns.
    second : str
        Column of the frame with a second number of the same unit, which is written in brackets if
        it differs from the first: ``55 (46)``.
    bound : str
        Column of the frame with the sign of values that are bounds or uncertain: ``≤ 55``, ``≥
        ~55``. A bound is rounded up or down according to its sign.
    of : str
        Key of the quantity; `name` if empty. It is needed for tables that are pivoted, for example
        to one column for each scene.
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
        """The quantity of the values."""
        return quantity_of(self.of or self.name)

    @property
    def head(self) -> str:
        """The label, followed by the unit in brackets."""
        label = self.label or self.quantity.label
        unit = self.unit or self.quantity.unit
        return f"{label} [{unit}]" if unit else label

    def text(self, row: Mapping[str, Any]) -> str:
        """Return the text of the cell in a row of the frame."""
        text = self._value_text(row)
        sign = row.get(self.bound)
        if isinstance(sign, str) and sign:
            if self.interval:
                text = f"{sign}{text}"
            else:
                text = bounded(self.scale * float(row[self.name]), sign)
        second = row.get(self.second)
        if second is not None and not is_missing(second) and second != row[self.name]:
            text += f" ({cell(self.quantity, self.scale * float(second))})"
        return text

    def _value_text(self, row: Mapping[str, Any]) -> str:
        """Return the text of the value in a row, with its uncertainty."""
        value = row[self.name]
        if is_missing(value) or isinstance(value, (str, bool, np.bool_)):
            return cell(self.quantity, value)
        # With a format, only an uncertainty that the column names itself is written.
        column = self.uncertainty
        if not column and not self.form:
            column = self.quantity.uncertainty
        uncertainty = row.get(column)
        if uncertainty is not None and not is_missing(uncertainty):
            number = Uncertain(self.scale * float(value), self.scale * float(uncertainty))
            return number.both() if self.interval else str(number)
        if self.form:
            return format(self.scale * float(value), self.form)
        return cell(self.quantity, self.scale * value if self.scale != 1 else value)


METHOD = Column("variant", "method")
"""Column with the label of the variant, which readers know as a method."""
REFINED_BY = Column("parameter", "refined by")
"""Column with the parameter that is refined."""


@dataclass(frozen=True)
class TableView:
    """A table as it is shown, with references to the rows of the table of results that it was computed from.

    Attributes
    ----------
    name : str
        Name of its files, unique in a report.
    frame : DataFrame
        The values in full precision, with uncertainties in separate columns; one row for each row
        shown.
    columns : tuple of Column
        Columns without any value are not shown.
    source : str
        Name of the table of results that the rows come from.
    rows : tuple of tuple of int
        For each row, the numbers of the rows of `source` that it was computed from, counted from 1.
    group : str
        Column of the frame by which rows are grouped. Its value is shown as a heading above the
        rows of a group, or as the first column. No groups if empty.
    in_report : bool
        True if the report and the paper contain the table; the page and the folder of tables
        contain all tables.
    caption : str
        Filled in from the study's template when the section is written.
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
        """Return the columns that contain any value, for the Markdown report if `brief`.

        The report shows groups by headings. Otherwise the first column is that of the group.
        """
        columns = list(self.columns)
        if brief:
            columns = [column for column in columns if column.brief]
        elif self.group:
            columns.insert(0, Column(self.group))
        return [column for column in columns if self._has_values(column)]

    def _has_values(self, column: Column) -> bool:
        """Return whether any row has a value in a column."""
        if column.name not in self.frame:
            return False
        return not all(is_missing(value) for value in self.frame[column.name])

    def heads(self, brief: bool = False) -> list[str]:
        """Return the headings of the columns that `shown` returns."""
        return [column.head for column in self.shown(brief)]

    def cells(self, brief: bool = False) -> list[list[str]]:
        """Return the text of the cells, row by row."""
        columns = self.shown(brief)
        return [[column.text(row) for column in columns] for row in self.frame.to_dict("records")]

    def right(self, brief: bool = False) -> list[bool]:
        """Return for each column whether it contains numbers, which are aligned to the right."""
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
    """Return a `TableView` of a table of results, of a part of it, or of rows computed from it.

    Parameters
    ----------
    name, columns, group, in_report, caption
        Fields of `TableView`.
    frame : DataFrame or iterable of (Mapping, DataFrame)
        Rows of the table of results, with the index of the whole table, which is counted from 0; or
        pairs of a computed row and the rows that it was computed from.
    source : str
        Name of the table of results; `name` if empty.
    rows : sequence of sequence of int, optional
        If given with a DataFrame, the field `rows` of the view. By default, each row refers to
        itself.
    """
    if not isinstance(frame, pd.DataFrame):
        pairs = list(frame)
        frame = pd.DataFrame([row for row, _ in pairs])
        rows = [source_rows.index + 1 for _, source_rows in pairs]
    elif rows is None:
        rows = [(number + 1,) for number in frame.index]
    return TableView(
        name,
        frame.reset_index(drop=True),
        tuple(columns),
        source or name,
        tuple(tuple(int(number) for number in numbers) for numbers in rows),
        group,
        in_report,
        caption,
    )
