"""The columns of a truth at the instants of a table, computed once."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping

import numpy as np

from stiction.scenes.column_file import compute_in_parts
from stiction.truths.truth import Columns


class CachedColumns:
    """The columns of a truth (`Columns`), which are stored for all instants at which they were computed.

    Each measure asks for the truth at the instants of the table, and a truth that is our own run is integrated anew at
    each call. If there are more than `max_instants` instants, they are computed in parts, and only `names` are stored,
    in a temporary file.

    Parameters
    ----------
    columns
        The columns of the truth.
    names
        Columns that are stored if they are computed in parts.
    max_instants
        Largest number of instants in one call of `columns`.
    report
        Called with the completed fraction of a computation in parts.
    """

    def __init__(
        self,
        columns: Columns,
        names: Collection[str],
        max_instants: int,
        report: Callable[[float], None],
    ):
        self._columns = columns
        self._names = names
        self._max_instants = max_instants
        self._report = report
        self._cache: dict[tuple[bytes, str], Mapping[str, np.ndarray]] = {}

    def __call__(self, t: np.ndarray, side: str) -> Mapping[str, np.ndarray]:
        key = (hashlib.sha256(np.ascontiguousarray(t).data).digest(), side)
        if key not in self._cache:
            if len(t) <= self._max_instants:
                self._cache[key] = self._columns(t, side)
            else:
                self._cache[key] = self._in_parts(t, side)
        return self._cache[key]

    def _in_parts(self, t: np.ndarray, side: str) -> Mapping[str, np.ndarray]:
        def compute(part: slice) -> dict[str, np.ndarray]:
            columns = self._columns(np.array(t[part]), side)
            self._report(part.stop / len(t))
            return {name: values for name, values in columns.items() if name in self._names}

        return compute_in_parts(len(t), self._max_instants, compute)
