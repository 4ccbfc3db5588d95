"""Rows of tables that a text mentions, whose numbers carry their quantity and their place in the table."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
import pandas as pd

from stiction.comparisons.bench.presentation.cells import cell, is_missing
from stiction.comparisons.bench.quantities import Kind, Quantity, quantity_of
from stiction.uncertain import Uncertain


@dataclass(frozen=True)
class Cell:
    """A number in a table, which is stored as ``data/TABLE.csv``.

    A cell is true even if its value is 0: ``{% if row.creep %}`` in a template tests whether there
    is a number.

    Attributes
    ----------
    value : float
        In the unit of the quantity.
    quantity : Quantity
        Its key is the name of the column.
    uncertainty : float or None
        In the same unit; None if the table does not contain it.
    table : str
        Name of the table.
    row : int
        Number of the row, counted from 1 without the heading.
    """

    value: float
    quantity: Quantity
    uncertainty: float | None
    table: str
    row: int

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        """Return the number as it is written in tables, without unit; errors and jumps without sign."""
        value = self.value
        if self.quantity.kind in (Kind.ERROR, Kind.JUMP):
            value = abs(value)
        if self.uncertainty is None:
            return cell(self.quantity, value)
        return str(Uncertain(value, self.uncertainty))


class Row:
    """A row of a table, whose values templates read as ``row.position_error`` or ``row["events:guide.slip"]``.

    Numbers are returned as `Cell`, words and flags as they are, missing values as None. A column
    that does not exist raises KeyError, so that a misspelt name in a template is an error.

    Parameters
    ----------
    table : str
        Name of the table.
    frame : DataFrame
        The table, or some of its rows with the labels of the whole table, which are counted from 0.
    label : int
        Label of the row.
    """

    def __init__(self, table: str, frame: pd.DataFrame, label: int):
        self._table = table
        self._frame = frame
        self._label = label

    def __getitem__(self, column: str) -> Cell | str | bool | None:
        value = self._frame.at[self._label, column]
        if is_missing(value):
            return None
        if isinstance(value, (bool, np.bool_)):
            return bool(value)
        if not isinstance(value, Real):
            return str(value)
        quantity = quantity_of(column)
        uncertainty = None
        if quantity.uncertainty in self._frame:
            half_width = self._frame.at[self._label, quantity.uncertainty]
            uncertainty = None if is_missing(half_width) else float(half_width)
        return Cell(
            float(value),
            quantity,
            uncertainty,
            self._table,
            self._label + 1,
        )

    def number(self, column: str) -> Cell:
        """Return the number in a column; ValueError if there is none."""
        value = self[column]
        if not isinstance(value, Cell):
            raise ValueError(f"{column}: found {value!r}; expected a number")
        return value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Row) and self._place == other._place

    def __hash__(self) -> int:
        return hash(self._place)

    @property
    def _place(self) -> tuple[str, int]:
        """Name of the table and label, which identify a row."""
        return self._table, self._label


def row_of(table: str, frame: pd.DataFrame, label: object) -> Row:
    """Return a row by its label, which may have any type that pandas returns, for example by ``idxmax``."""
    return Row(table, frame, int(label))  # type: ignore[call-overload]
