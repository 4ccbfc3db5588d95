"""Rows of the data that a text mentions: each number knows what it is and which cell it is from."""

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
    """A number of the data.

    Attributes
    ----------
    value : float
        In the unit of the quantity.
    quantity : Quantity
        What it is: label, unit, and the kind that decides how it is written.
    uncertainty : float or None
        In the same unit; None where the table has none.
    table, row
        The cell is in the row `row` (from 1, the heading not counted) of ``data/TABLE.csv``, in the
        column that is named by the key of the quantity.

    A cell is true in a condition whatever its value, 0 included: ``{% if row.creep %}`` asks whether there is a number.
    """

    value: float
    quantity: Quantity
    uncertainty: float | None
    table: str
    row: int

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        """The number as tables write it, without unit; an error or a jump by its size."""
        value = abs(self.value) if self.quantity.kind in (Kind.ERROR, Kind.JUMP) else self.value
        if self.uncertainty is None:
            return cell(self.quantity, value)
        return str(Uncertain(value, self.uncertainty))


class Row:
    """A row of a table of the data, whose cells templates read: ``row.position_error``, ``row["events:guide.slip"]``.

    A number is a `Cell`; words and flags are themselves; what is missing is None. A column that the
    table does not have raises KeyError, so that a misspelt name in a template is an error.

    Parameters
    ----------
    table : str
        Name of the table: the row is in ``data/TABLE.csv``.
    frame : DataFrame
        The table, or some of its rows with the labels 0, 1, .. that they have in the whole table.
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
            unsure = self._frame.at[self._label, quantity.uncertainty]
            uncertainty = None if is_missing(unsure) else float(unsure)
        return Cell(
            float(value),
            quantity,
            uncertainty,
            self._table,
            self._label + 1,
        )

    def number(self, column: str) -> Cell:
        """Return the number in a column; ValueError where there is none."""
        cell = self[column]
        if not isinstance(cell, Cell):
            raise ValueError(f"{column}: found {cell!r}; expected a number")
        return cell

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Row) and self._place == other._place

    def __hash__(self) -> int:
        return hash(self._place)

    @property
    def _place(self) -> tuple[str, int]:
        return self._table, self._label


def row_of(table: str, frame: pd.DataFrame, label: object) -> Row:
    """Return a row by its label; `label` is what pandas returns, such as by ``idxmax``."""
    return Row(table, frame, int(label))  # type: ignore[call-overload]
