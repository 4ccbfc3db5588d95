"""Columns of a long table in a temporary file, of which memory holds only what is being looked at."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from stiction.scenes.base_errors import StictionError

REAL = np.dtype(float)
LARGE = 2**25
"""Bytes of all columns above which they are kept in a file: a tenth of what the program itself takes."""


class NoRoom(StictionError):
    """The temporary folder has no room for a long table."""


class ColumnFile(Mapping[str, np.ndarray]):
    """Columns of real numbers, each of shape (rows,), in an unnamed temporary file.

    Each access maps the column anew, read-only. Memory that was read through a map is free again as soon as nothing
    refers to the map, so that callers take one column, or one part of a column, after another. The file is gone with
    the last reference to this object. It cannot be pickled.

    Parameters
    ----------
    rows
        The length of all columns; may shrink (`shorten`) as long as nothing has been read.
    """

    def __init__(self, rows: int):
        self._file: Any = tempfile.TemporaryFile(prefix="stiction-")
        self._stride = self._rows = rows
        self._place: dict[str, int] = {}
        self._gaps = 0

    def write(self, name: str, begin: int, values: np.ndarray) -> None:
        """Write some rows of a column, from row `begin` on; a new name is a new column.

        Raises
        ------
        NoRoom
            Where the file cannot be written.
        """
        # columns lie one behind the other, each with room for all rows; the place of one that was
        # dropped stays empty
        place = self._place.setdefault(name, len(self._place) + self._gaps)
        try:
            self._file.seek((place * self._stride + begin) * REAL.itemsize)
            self._file.write(np.ascontiguousarray(values, dtype=float).data)
            self._file.flush()
        except OSError as error:
            raise NoRoom(
                f"temporary file in {tempfile.gettempdir()}: {error.strerror or error}; expected room for "
                f"{self._stride * REAL.itemsize / 1e6:.3g} MB a column; the environment variable TMPDIR "
                "names another folder"
            ) from None

    def shorten(self, rows: int) -> None:
        """Leave out all rows from `rows` on."""
        self._rows = rows

    def without(self, name: str) -> ColumnFile:
        """Return the file with one column less."""
        del self._place[name]
        self._gaps += 1
        return self

    def __getitem__(self, name: str) -> np.ndarray:
        # a new map at each access: one that was kept would keep its pages in memory
        place = self._place[name]
        mapped = np.memmap(
            self._file,
            dtype=REAL,
            mode="r",
            offset=place * self._stride * REAL.itemsize,
            shape=(self._rows,),
        )
        return mapped.view(np.ndarray)

    def __contains__(self, name: object) -> bool:
        return name in self._place

    def __iter__(self) -> Iterator[str]:
        return iter(self._place)

    def __len__(self) -> int:
        return len(self._place)


class Changed(Mapping[str, np.ndarray]):
    """Columns that are made from others at each access, such as some of their rows; nothing is kept."""

    def __init__(
        self, columns: Mapping[str, np.ndarray], change: Callable[[str, np.ndarray], np.ndarray]
    ):
        self._columns, self._change = columns, change

    def __getitem__(self, name: str) -> np.ndarray:
        return self._change(name, self._columns[name])

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)


class Joined(Mapping[str, np.ndarray]):
    """Columns of several mappings, of one name those of the first; unlike a dict it does not hold what it was read."""

    def __init__(self, *parts: Mapping[str, np.ndarray]):
        self._parts = parts

    def __getitem__(self, name: str) -> np.ndarray:
        for part in self._parts:
            if name in part:
                return part[name]
        raise KeyError(name)

    def __contains__(self, name: object) -> bool:
        return any(name in part for part in self._parts)

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys(name for part in self._parts for name in part))

    def __len__(self) -> int:
        return len({name for part in self._parts for name in part})


def in_parts(rows: int, most: int) -> Iterator[slice]:
    """Yield the slices, of `most` rows at most, that `rows` rows consist of, in order."""
    return (slice(begin, min(begin + most, rows)) for begin in range(0, rows, most))


def collected(
    rows: int, most: int, made: Callable[[slice], Mapping[str, np.ndarray]]
) -> Mapping[str, np.ndarray]:
    """Return columns that are made part by part, `most` rows at a time; those of one part alone as they are."""
    if rows <= most:
        return made(slice(0, rows))
    kept = ColumnFile(rows)
    for part in in_parts(rows, most):
        for name, values in made(part).items():
            kept.write(name, part.start, values)
    return kept
