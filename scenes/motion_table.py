"""A motion as a table in order of time, with two rows, before and after, for an instant at which it jumps.

Between its rows a motion is interpolated, on each smooth piece by itself: positions by polynomials of degree five that
have the velocities and accelerations of the rows, modes by their first value, everything else by cubic splines.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pandas as pd

from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.trajectory import Event

POSITIONS, VELOCITIES, ACCELERATIONS = BODY_COLUMNS
_RATES = {**dict(zip(POSITIONS, VELOCITIES)), "displacement": "slip_velocity"}
_SECOND_RATES = dict(zip(POSITIONS, ACCELERATIONS))


def with_sides(
    frame: pd.DataFrame, events: Iterable[Event], interpolates: bool = True
) -> pd.DataFrame:
    """Return a table of a motion, column ``t`` and others, with the two rows of each event.

    An event of one of several independent parts does not have the columns of the others: there they are interpolated,
    or NaN if told not to.
    """
    events = tuple(events)
    sides = pd.DataFrame(
        [{"t": event.time, **side} for event in events for side in (event.before, event.after)],
        columns=frame.columns,
    )
    if not interpolates:
        return _in_order(frame, sides) if len(sides) else frame
    # Columns that an event does not have; a force that is left open is nan, and stays so. Columns
    # that are absent in the same rows are interpolated together.
    absent = [side.keys() for event in events for side in (event.before, event.after)]
    groups: dict[bytes, list[str]] = {}
    for name in sides.columns[sides.isna().any() & frame.notna().all() & (len(frame) > 1)]:
        lacks = np.array([name not in columns for columns in absent])
        if lacks.any():
            groups.setdefault(lacks.tobytes(), []).append(name)
    t = sides["t"].to_numpy()
    for pattern, names in groups.items():
        lacks = np.frombuffer(pattern, dtype=bool)
        columns = interpolated(
            _in_order(frame[["t", *names]], sides.loc[~lacks, ["t", *names]].dropna())
        )
        before, after = (columns(t[lacks], side) for side in ("before", "after"))
        # Of several events at one instant one may be of this part: rows behind it have the values
        # after it.
        passed = np.maximum.accumulate(np.where(lacks, -np.inf, t))[lacks] == t[lacks]
        sides.loc[lacks, names] = np.array(
            [np.where(passed, after[name], before[name]) for name in names]
        ).T
    return _in_order(frame, sides) if len(sides) else frame


def interpolated(frame: pd.DataFrame) -> Callable[[np.ndarray, str], dict[str, np.ndarray]]:
    """Return the columns of a table between its rows, by times (n,) and the side, ``"before"`` or ``"after"``.

    Times that occur twice separate its smooth pieces.
    """
    t = frame["t"].to_numpy()
    edges = [0, *np.flatnonzero(np.diff(t) == 0) + 1, len(t)]
    pieces = [
        frame.iloc[first:behind]
        for first, behind in zip(edges, edges[1:])
        if t[first] < t[behind - 1]
    ]
    starts = np.array([piece["t"].iloc[0] for piece in pieces])
    curves = [_curves(piece) for piece in pieces]

    def columns(at: np.ndarray, side: str) -> dict[str, np.ndarray]:
        number = np.maximum(
            np.searchsorted(starts, at, side="right" if side == "after" else "left") - 1, 0
        )
        values = {name: np.empty(len(at)) for name in curves[0]}
        for piece in np.unique(number):
            in_piece = number == piece
            for name, curve in curves[piece].items():
                values[name][in_piece] = curve(at[in_piece])
        return values

    return columns


def _in_order(*parts: pd.DataFrame) -> pd.DataFrame:
    return pd.concat(parts).sort_values("t", kind="stable", ignore_index=True)


def _curves(piece: pd.DataFrame) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """A function of time for each column of a smooth piece."""
    from scipy.interpolate import (  # takes longer to import than most tables to make
        BPoly,
        CubicSpline,
        PPoly,
    )

    t = piece["t"].to_numpy()
    values = {str(name): column.to_numpy(float) for name, column in piece.items() if name != "t"}
    curves = {
        name: PPoly(column[:1, None], t[[0, -1]])
        if name.endswith(".mode")
        else CubicSpline(t, column)
        for name, column in values.items()
    }
    # A position whose velocity is in the table: a polynomial with value, velocity and acceleration
    # of both ends, and the velocity as its derivative, so that the two agree in between.
    for name, position in values.items():
        owner, _, label = name.rpartition(".")
        rate = f"{owner}.{_RATES.get(label)}"
        if rate in values:
            second = values.get(f"{owner}.{_SECOND_RATES.get(label)}", curves[rate](t, 1))
            curves[name] = BPoly.from_derivatives(
                t, np.stack([position, values[rate], second], axis=1)
            )
            curves[rate] = curves[name].derivative()
    return curves
