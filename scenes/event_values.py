"""Values of columns before and after events.

The sides of events are rows of arrays (`Row`), so that `Sides` can read a column of all events at once.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiction.scenes.trajectory import Event

_NUMBER_KINDS = "fiub"
"""NumPy's kinds of types of real numbers: floats, integers, unsigned integers, and truth values."""


class Row(Mapping[str, float]):
    """One row of columns as a mapping from names to values, such as one side of an `Event`.

    Parameters
    ----------
    columns : Mapping[str, ndarray]
        Columns by name, of equal length. They are not copied: all rows of a table share them.
    place : int
        Index of the row.
    """

    __slots__ = ("columns", "place")

    def __init__(self, columns: Mapping[str, np.ndarray], place: int):
        self.columns = columns
        self.place = place

    def __getitem__(self, name: str) -> float:
        return float(self.columns[name][self.place])

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return len(self.columns)

    def __repr__(self) -> str:
        return repr(dict(self))


def rows_of(columns: Mapping[str, np.ndarray]) -> list[Row]:
    """Return the rows of columns of equal length, in their order."""
    return [Row(columns, place) for place in range(_length_of(columns))]


def _length_of(columns: Mapping[str, np.ndarray]) -> int:
    """Return the common length of columns; 0 if there are none."""
    for values in columns.values():
        return len(values)
    return 0


@dataclass(frozen=True)
class _SharedColumns:
    """The sides of events that are rows of the same columns."""

    columns: Mapping[str, np.ndarray]
    sides: np.ndarray
    """Indices of these sides among all sides of the events, int, shape (k,)"""
    rows: np.ndarray
    """The row of each of these sides in `columns`, int, shape (k,)"""

    @property
    def is_complete(self) -> bool:
        """True if the sides are all rows of the columns, in their order."""
        length = _length_of(self.columns)
        return len(self.rows) == length and np.array_equal(self.rows, np.arange(length))

    def are_finite(self) -> np.ndarray:
        """Return for each side whether all of its values are finite numbers; bool, shape (k,)."""
        values = list(self.columns.values())
        if not all(column.dtype.kind in _NUMBER_KINDS for column in values):
            return np.zeros(len(self.rows), dtype=bool)
        # Usually everything is finite, which one pass over a single array finds fastest.
        if np.isfinite(np.array(values, dtype=float)).all():
            return np.ones(len(self.rows), dtype=bool)
        return np.all([np.isfinite(column[self.rows]) for column in values], axis=0)


class Sides:
    """The two sides of each event, from which a column is read as one array.

    Sides are ordered by event; the side before an event precedes the side after it.

    Attributes
    ----------
    events : sequence of Event
        The events.
    t : ndarray, shape (2 * events,)
        The time of each side, s: that of the event for the side after it, and the floating-point number below it for
        the side before it. A law of time that jumps at the event has its limits from both sides there.
    """

    def __init__(self, events: Sequence[Event]):
        self.events = events
        self.t = np.repeat(np.array([event.time for event in events], dtype=float), 2)
        self.t[::2] = np.nextafter(self.t[::2], -np.inf)
        # Group the sides that are rows of the same columns. Engines may also return other mappings,
        # which are read one by one.
        groups: dict[int, list[tuple[int, Row]]] = {}
        self._other_mappings: list[tuple[int, Mapping[str, float]]] = []
        sides = [side for event in events for side in (event.before, event.after)]
        for place, side in enumerate(sides):
            if isinstance(side, Row):
                groups.setdefault(id(side.columns), []).append((place, side))
            else:
                self._other_mappings.append((place, side))
        self._shared = [
            _SharedColumns(
                columns=members[0][1].columns,
                sides=np.array([place for place, _ in members]),
                rows=np.array([row.place for _, row in members]),
            )
            for members in groups.values()
        ]
        # The usual case: the sides are the rows of one table, whose columns need not be copied.
        self._whole: Mapping[str, np.ndarray] | None = None
        if len(self._shared) == 1 and not self._other_mappings and self._shared[0].is_complete:
            self._whole = self._shared[0].columns

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the values of a column that all events have, shape (2 * events,)."""
        if self._whole is not None:
            return np.asarray(self._whole[name], dtype=float)
        values = np.empty(len(self.t))
        for shared in self._shared:
            values[shared.sides] = shared.columns[name][shared.rows]
        for place, side in self._other_mappings:
            values[place] = side[name]
        return values

    def are_finite(self) -> np.ndarray:
        """Return for each side whether all of its values are finite numbers; bool, shape (2 * events,)."""
        flags = np.empty(len(self.t), dtype=bool)
        for shared in self._shared:
            flags[shared.sides] = shared.are_finite()
        for place, side in self._other_mappings:
            try:
                # A sum is finite only if all of its terms are, and takes a tenth of the time of a
                # check of each term. Finite terms whose sum overflows are reported as not finite.
                flags[place] = math.isfinite(sum(side.values()))
            except (TypeError, AttributeError, OverflowError):
                flags[place] = False
        return flags

    def with_columns(self, needed: Collection[str]) -> Sides:
        """Return the sides of those events that have all of the needed columns."""
        mappings: list[Mapping[str, object]] = [shared.columns for shared in self._shared]
        mappings += [side for _, side in self._other_mappings]
        if all(name in mapping for mapping in mappings for name in needed):
            return self
        return Sides(
            [event for event in self.events if all(name in event.before for name in needed)]
        )

    def label(self, place: int) -> str:
        """Return a text for messages with the kind, joint and time of an event, and which side of it is meant."""
        event = self.events[place // 2]
        side = "before" if place % 2 == 0 else "after"
        return f"{event.kind} of {event.joint} at t = {event.time:.9g} s: {side}"
