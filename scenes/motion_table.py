"""A motion as a table in order of time, with two rows for each event: the values before and after it.

Between rows, a motion is interpolated on each smooth piece separately: positions by polynomials of degree five that
match the velocities and accelerations of the rows, contact modes by a constant, and all other columns by cubic splines.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pandas as pd

from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.trajectory import Event

POSITIONS, VELOCITIES, ACCELERATIONS = BODY_COLUMNS
_RATES = {**dict(zip(POSITIONS, VELOCITIES)), "displacement": "slip_velocity"}
"""Name of a position -> name of its first derivative in time."""
_SECOND_RATES = dict(zip(POSITIONS, ACCELERATIONS))
"""Name of a position -> name of its second derivative in time."""


def with_sides(
    frame: pd.DataFrame, events: Iterable[Event], interpolates: bool = True
) -> pd.DataFrame:
    """Insert the two rows of each event into the table of a motion.

    Parameters
    ----------
    frame
        Output samples of the motion: the column ``t`` (s), increasing, and others.
    events
        Events of the motion, in order of time.
    interpolates
        An event does not have the columns of mechanically independent parts of the scene. In its rows, these columns
        are interpolated if True, and NaN if False.

    Returns
    -------
    DataFrame
        The same columns with all rows, in order of time.
    """
    # The two rows of each event, with NaN in the columns that it does not have.
    sides = [(event.time, side) for event in events for side in (event.before, event.after)]
    if not sides:
        return frame
    rows = pd.DataFrame([{"t": time, **side} for time, side in sides], columns=frame.columns)
    if not interpolates or len(frame) < 2:
        return _in_order(frame, rows)

    # Find the columns that some events do not have. Columns that are absent in the same rows are
    # interpolated together. NaN also stands for a force that is not unique; it is not interpolated.
    names_by_pattern: dict[bytes, list[str]] = {}
    for name in rows.columns[rows.isna().any() & frame.notna().all()]:
        is_absent = np.array([name not in side for _, side in sides])
        if is_absent.any():
            names_by_pattern.setdefault(is_absent.tobytes(), []).append(name)

    t = rows["t"].to_numpy()
    for pattern, names in names_by_pattern.items():
        is_absent = np.frombuffer(pattern, dtype=bool)
        own_rows = rows.loc[~is_absent, ["t", *names]].dropna()
        columns = interpolated(_in_order(frame[["t", *names]], own_rows))
        before = columns(t[is_absent], "before")
        after = columns(t[is_absent], "after")
        # If events of several parts coincide, rows that follow an event of this part have the
        # values after it.
        last_own_time = np.maximum.accumulate(np.where(is_absent, -np.inf, t))
        follows_own = last_own_time[is_absent] == t[is_absent]
        for name in names:
            rows.loc[is_absent, name] = np.where(follows_own, after[name], before[name])
    return _in_order(frame, rows)


def interpolated(frame: pd.DataFrame) -> Callable[[np.ndarray, str], dict[str, np.ndarray]]:
    """Return a function that interpolates all columns of a table.

    Parameters
    ----------
    frame
        The column ``t`` (s) in order, and others. A time that occurs twice separates two smooth pieces.

    Returns
    -------
    callable
        Takes times (s), shape (n,), and a side, ``"before"`` or ``"after"``, which selects the piece at a time that
        separates two. Returns the columns by name, each of shape (n,).
    """
    t = frame["t"].to_numpy()
    # Pieces begin at the first row and at each repeated time. A piece needs more than one instant.
    edges = [0, *np.flatnonzero(np.diff(t) == 0) + 1, len(t)]
    pieces = [
        frame.iloc[begin:end] for begin, end in zip(edges, edges[1:]) if t[begin] < t[end - 1]
    ]
    starts = np.array([piece["t"].iloc[0] for piece in pieces])
    curves = [_interpolants(piece) for piece in pieces]

    def evaluate_columns(times: np.ndarray, side: str) -> dict[str, np.ndarray]:
        place = np.searchsorted(starts, times, side="right" if side == "after" else "left")
        # The first piece also extrapolates to earlier times.
        piece_of_time = np.maximum(place - 1, 0)
        values = {name: np.empty(len(times)) for name in curves[0]}
        for piece in np.unique(piece_of_time):
            in_piece = piece_of_time == piece
            for name, curve in curves[piece].items():
                values[name][in_piece] = curve(times[in_piece])
        return values

    return evaluate_columns


def _in_order(*parts: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of all parts in order of time; rows of equal time keep the order of the parts."""
    return pd.concat(parts).sort_values("t", kind="stable", ignore_index=True)


def _interpolants(piece: pd.DataFrame) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """Return a function of time for each column of a smooth piece."""
    # Imported here, because it takes longer than most tables.
    from scipy.interpolate import BPoly, CubicSpline, PPoly

    t = piece["t"].to_numpy()
    values = {str(name): column.to_numpy(float) for name, column in piece.items() if name != "t"}
    curves: dict[str, Any] = {}
    for name, column in values.items():
        if name.endswith(".mode"):
            curves[name] = PPoly(column[:1, None], t[[0, -1]])
        else:
            curves[name] = CubicSpline(t, column)
    # If the velocity of a position is in the table too, the position is the polynomial that has the
    # values, velocities and accelerations of the rows, and the velocity is its derivative. Thereby
    # the two agree between the rows.
    for name, position in values.items():
        owner, _, label = name.rpartition(".")
        rate = f"{owner}.{_RATES.get(label)}"
        if rate in values:
            acceleration = values.get(f"{owner}.{_SECOND_RATES.get(label)}", curves[rate](t, 1))
            derivatives = np.stack([position, values[rate], acceleration], axis=1)
            curves[name] = BPoly.from_derivatives(t, derivatives)
            curves[rate] = curves[name].derivative()
    return curves
