"""Columns of a long table in a temporary file, of which memory holds only the part in use."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from typing import IO

import numpy as np

from stiction.scenes.base_errors import StictionError

REAL = np.dtype(float)
"""Type of all numbers in the file."""
FILE_THRESHOLD_BYTES = 2**25
"""Size of all columns above which they are stored in a file: a tenth of the memory of the program itself."""


class NoRoom(StictionError):
    """The temporary folder has no room for a long table."""


class ColumnFile(Mapping[str, np.ndarray]):
    """Columns of real numbers, each of shape (rows,), in an unnamed temporary file.

    Each access maps the column anew, read-only. The memory of a map is released as soon as nothing refers to the map.
    Callers therefore take one column, or one part of a column, after another. The file is deleted together with the
    last reference to this object. The object cannot be pickled.

    Parameters
    ----------
    rows
        The length of all columns. It may be reduced by `shorten` as long as nothing has been read.
    """

    def __init__(self, rows: int):
        self._file: IO[bytes] = tempfile.TemporaryFile(prefix="stiction-")
        # Columns lie one behind the other, each with room for `_capacity` rows. `_slots` has the
        # place of each column; the place of a dropped column is not used again.
        self._capacity = rows
        self._rows = rows
        self._slots: dict[str, int] = {}
        self._next_slot = 0

    def write(self, name: str, begin: int, values: np.ndarray) -> None:
        """Write values to a column from row `begin` on; a new name adds a column.

        Raises
        ------
        ValueError
            If the values reach beyond the last row, where the next column begins.
        NoRoom
            If the file cannot be written.
        """
        if begin < 0 or begin + len(values) > self._capacity:
            raise ValueError(
                f"{name}: found values for the rows {begin} to {begin + len(values) - 1}; expected "
                f"rows from 0 to {self._capacity - 1}"
            )
        if name not in self._slots:
            self._slots[name] = self._next_slot
            self._next_slot += 1
        try:
            self._file.seek(self._offset_bytes(name) + begin * REAL.itemsize)
            self._file.write(np.ascontiguousarray(values, dtype=REAL).data)
            self._file.flush()
        except OSError as error:
            column_megabytes = self._capacity * REAL.itemsize / 1e6
            raise NoRoom(
                f"temporary file in {tempfile.gettempdir()}: {error.strerror or error}; expected "
                f"room for {column_megabytes:.3g} MB a column; the environment variable TMPDIR "
                "names another folder"
            ) from None

    def shorten(self, rows: int) -> None:
        """Keep only the first `rows` rows."""
        self._rows = rows

    def drop(self, name: str) -> None:
        """Remove a column. Its place in the file remains empty."""
        del self._slots[name]

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a new, read-only map of a column, shape (rows,)."""
        # A map that the object kept would keep all pages in memory that were ever read through it.
        mapped = np.memmap(
            self._file,
            dtype=REAL,
            mode="r",
            offset=self._offset_bytes(name),
            shape=(self._rows,),
        )
        return mapped.view(np.ndarray)

    def __contains__(self, name: object) -> bool:
        return name in self._slots

    def __iter__(self) -> Iterator[str]:
        return iter(self._slots)

    def __len__(self) -> int:
        return len(self._slots)

    def _offset_bytes(self, name: str) -> int:
        """Return the place in the file of the first row of a column."""
        return self._slots[name] * self._capacity * REAL.itemsize


class TransformedColumns(Mapping[str, np.ndarray]):
    """Columns computed from other columns at each access, for example a subset of their rows.

    Results are not cached.

    Parameters
    ----------
    columns
        The columns from which these are computed.
    transform
        Called with the name and the values of a column; returns the new values.
    """

    def __init__(
        self, columns: Mapping[str, np.ndarray], transform: Callable[[str, np.ndarray], np.ndarray]
    ):
        self._columns = columns
        self._transform = transform

    def __getitem__(self, name: str) -> np.ndarray:
        return self._transform(name, self._columns[name])

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)


class JoinedColumns(Mapping[str, np.ndarray]):
    """Columns of several mappings; where several have a name, the first of them supplies its column.

    `collections.ChainMap` looks up in the same way. It needs mutable mappings, however, which columns of a run are not,
    and it lists the names of the last mapping first, whereas tables and reports keep the order given here.
    """

    def __init__(self, *mappings: Mapping[str, np.ndarray]):
        self._mappings = mappings

    def __getitem__(self, name: str) -> np.ndarray:
        for mapping in self._mappings:
            if name in mapping:
                return mapping[name]
        raise KeyError(name)

    def __contains__(self, name: object) -> bool:
        return any(name in mapping for mapping in self._mappings)

    def __iter__(self) -> Iterator[str]:
        return iter(self._unique_names())

    def __len__(self) -> int:
        return len(self._unique_names())

    def _unique_names(self) -> dict[str, None]:
        """Return each name once, in the order of the mappings."""
        unique: dict[str, None] = {}
        for mapping in self._mappings:
            unique |= dict.fromkeys(mapping)
        return unique


def row_slices(rows: int, max_rows: int) -> Iterator[slice]:
    """Yield consecutive slices of at most `max_rows` rows that together cover `rows` rows."""
    for begin in range(0, rows, max_rows):
        yield slice(begin, min(begin + max_rows, rows))


def compute_in_parts(
    rows: int, max_rows: int, compute: Callable[[slice], Mapping[str, np.ndarray]]
) -> Mapping[str, np.ndarray]:
    """Compute columns for at most `max_rows` rows at a time.

    Parameters
    ----------
    rows
        The number of all rows.
    max_rows
        The largest number of rows in one call of `compute`.
    compute
        Returns the columns of some rows, which its argument selects.

    Returns
    -------
    Mapping
        What `compute` returned where one call was enough; otherwise a `ColumnFile`.
    """
    if rows <= max_rows:
        return compute(slice(0, rows))
    columns = ColumnFile(rows)
    for part in row_slices(rows, max_rows):
        for name, values in compute(part).items():
            columns.write(name, part.start, values)
    return columns
