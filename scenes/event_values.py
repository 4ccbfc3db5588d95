"""Values of columns on both sides of events: arrays, of which each side of an event is a view with names."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiction.scenes.trajectory import Event


class Row(Mapping[str, float]):
    """One row of columns as a mapping, such as a side of an `Event`.

    Parameters
    ----------
    columns : Mapping[str, ndarray]
        By name, of equal length. Rows of the same columns share them.
    place : int
        Number of the row.
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
    length = len(next(iter(columns.values()), ()))
    return [Row(columns, place) for place in range(length)]


class Sides:
    """Both sides of events: the values of a column as one array.

    Attributes
    ----------
    events : sequence of Event
    t : ndarray, shape (2 * events,)
        The time of each event, s, once for the side before it and once for that behind it.
    """

    def __init__(self, events: Sequence[Event]):
        self.events = events
        self.t = np.repeat(np.array([event.time for event in events], dtype=float), 2)
        # Rows of one table are read at once: by table, the places of its rows here and there. Engines may return any
        # other mappings, which are read one by one.
        tables: dict[int, tuple[Mapping[str, np.ndarray], list[int], list[int]]] = {}
        self._others: list[tuple[int, Mapping[str, float]]] = []
        sides = [side for event in events for side in (event.before, event.after)]
        for here, side in enumerate(sides):
            if isinstance(side, Row):
                _, its, theirs = tables.setdefault(id(side.columns), (side.columns, [], []))
                its.append(here)
                theirs.append(side.place)
            else:
                self._others.append((here, side))
        self._tables = [
            (columns, np.array(its), np.array(theirs)) for columns, its, theirs in tables.values()
        ]
        # of the usual table, which has just these rows in their order, columns are read as they are
        self._whole: Mapping[str, np.ndarray] | None = None
        if len(self._tables) == 1 and not self._others:
            columns, _, places = self._tables[0]
            length = len(next(iter(columns.values()), ()))
            if length == len(places) and np.array_equal(places, np.arange(length)):
                self._whole = columns

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, name: str) -> np.ndarray:
        """Values of a column that all events have, shape (2 * events,): before and behind the events in turns."""
        if self._whole is not None:
            return np.asarray(self._whole[name], dtype=float)
        values = np.empty(len(self.t))
        for columns, here, there in self._tables:
            values[here] = columns[name][there]
        for place, side in self._others:
            values[place] = side[name]
        return values

    def are_finite(self) -> np.ndarray:
        """Flags of the sides, (2 * events,), whose values are all finite numbers."""
        flags = np.ones(len(self.t), dtype=bool)
        for columns, here, there in self._tables:
            are_real = all(values.dtype.kind in "fiub" for values in columns.values())
            if not (are_real and np.isfinite(np.array(list(columns.values()), dtype=float)).all()):
                for values in columns.values():
                    flags[here] &= np.isfinite(values[there]) if are_real else False
        for place, side in self._others:
            try:
                # a sum is finite only if all terms are, but for an overflow, and costs a tenth of looking at each
                flags[place] = math.isfinite(sum(side.values()))
            except (TypeError, AttributeError, OverflowError):
                flags[place] = False
        return flags

    def with_columns(self, needed: Collection[str]) -> Sides:
        """Return the sides of the events that have all of these columns."""
        mappings: list[Mapping[str, object]] = [columns for columns, *_ in self._tables]
        mappings += [side for _, side in self._others]
        if all(name in mapping for mapping in mappings for name in needed):
            return self
        return Sides(
            [event for event in self.events if all(name in event.before for name in needed)]
        )

    def label(self, place: int) -> str:
        """Kind, joint, time and side of a value."""
        event, side = self.events[place // 2], ("before", "after")[place % 2]
        return f"{event.kind} of {event.joint} at t = {event.time:.9g} s: {side}"
