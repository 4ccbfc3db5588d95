"""Summary of a run as tables, for the terminal and for Jupyter: end state, ranges of forces and drift, events."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from stiction.scenes.columns import unit_of
from stiction.scenes.trajectory import Event, Trajectory

STATE = ("x", "y", "angle", "vx", "vy", "omega")
"""Columns of each body in the table of the end state."""
EVENTS_SHOWN = 20
"""Largest number of events in the table, which then fits on a screen."""
DIGITS = 9
"""Significant digits of the numbers."""
ROUNDING = 1e-13
"""Accumulated rounding error relative to the largest value of the same kind: that of some hundred operations in double
precision."""

Formatter = Callable[[str, float], str]
"""Returns the text of a value of a column; arguments are the name of the column and the value."""
SummaryTable = tuple[Sequence[str], list[tuple[str, ...]]]
"""The headings of a table, and its rows."""


def run_title(run: Trajectory) -> str:
    """Return the scene, the engine and the simulated time in one line."""
    times = f"t = 0 .. {run.t[-1]:g} s" if len(run.t) > 1 else "no motion"
    return f"{run.scene}: {run.engine} {run.version}, {run.fidelity}, {times}, {len(run.t)} rows"


def run_tables(run: Trajectory) -> Iterator[SummaryTable]:
    """Yield the tables of a run that has at least one output time."""
    formatter = _formatter_above_noise(run)
    yield _end_states(run, formatter)
    yield _ranges(run, formatter)
    if run.alternatives:
        yield _forces_not_unique(run, formatter)
    yield _first_events(run, formatter)


def _end_states(run: Trajectory, formatter: Formatter) -> SummaryTable:
    """Return the table of the last position and velocity of each body."""
    rows: list[tuple[str, ...]] = []
    for column in run.columns:
        if column.endswith(".omega"):
            body = column.removesuffix(".omega")
            names = [f"{body}.{key}" for key in STATE]
            rows.append((body, *(formatter(name, run[name][-1]) for name in names)))
    return ("end state [m, rad, s]", *STATE), rows


def _ranges(run: Trajectory, formatter: Formatter) -> SummaryTable:
    """Return the table of the smallest, largest and last values of efforts, guide forces and drift."""
    rows: list[tuple[str, ...]] = []
    for name, column in run.columns.items():
        label = name.rpartition(".")[2]
        is_force = label in ("effort", "normal_force", "friction")
        if is_force or name.startswith("drift."):
            # Forces that are not unique are NaN, which fmin and fmax ignore.
            values = (np.fmin.reduce(column), np.fmax.reduce(column), column[-1])
            texts = ("left open" if np.isnan(value) else formatter(name, value) for value in values)
            rows.append((name, *texts))
    return ("over time", "smallest", "largest", "at the end"), rows


def _forces_not_unique(run: Trajectory, formatter: Formatter) -> SummaryTable:
    """Return the table of columns for which Coulomb's law allows several values: when, and which values."""
    rows: list[tuple[str, ...]] = []
    for name, values in run.alternatives.items():
        instants = np.flatnonzero(~np.isnan(values).all(axis=1))
        first_values = values[instants[0]]
        texts = [formatter(name, value) for value in first_values[~np.isnan(first_values)]]
        first_time, last_time = run.t[instants[0]], run.t[instants[-1]]
        rows.append(
            (name, str(len(instants)), f"{first_time:.9g}", f"{last_time:.9g}", ", ".join(texts))
        )
    headings = (
        "force that is not unique",
        "instants",
        "from [s]",
        "to [s]",
        "values at the first of them",
    )
    return headings, rows


def _first_events(run: Trajectory, formatter: Formatter) -> SummaryTable:
    """Return the table of the first events, with the jumps of the efforts of drives."""
    efforts = [name for name in run.columns if name.endswith(".effort")]
    headings = ["event [s]", "kind", "joint", *(f"jump of {name}" for name in efforts)]
    has_other_modes = any(event.other_modes for event in run.events)
    if has_other_modes:
        headings.append("other consistent modes")
    rows: list[tuple[str, ...]] = []
    for event in run.events[:EVENTS_SHOWN]:
        row = [f"{event.time:.9f}", event.kind, event.joint]
        row += [_jump(event, name, formatter) for name in efforts]
        if has_other_modes:
            row.append(str(event.other_modes))
        rows.append(tuple(row))
    return headings, rows


def _jump(event: Event, name: str, formatter: Formatter) -> str:
    """Return the jump of a column at an event; empty if the event lacks the column or the force is not unique."""
    if name not in event.before or np.isnan(event.jump(name)):
        return ""
    return formatter(name, event.jump(name))


def more_events(run: Trajectory) -> str:
    """Return a line with the number of events that are not shown; empty if all are."""
    more = len(run.events) - EVENTS_SHOWN
    return f"... and {more} more events" if more > 0 else ""


def _formatter_above_noise(run: Trajectory) -> Formatter:
    """Return the formatter for the columns of a run, which shows values as 0 that are not above numerical noise.

    Noise is the larger of two: rounding of the largest value of the same kind, and the drift of this kind as far as the
    digits do not show it. As in the norms of the drift, lengths and angles are of one kind, and so are forces and
    moments.
    """
    merged_units = {"rad": "m", "rad/s": "m/s", "N m": "N", "N m or N": "N"}
    drift_columns = {"m": "drift.position", "m/s": "drift.velocity"}
    kinds = {}
    for name in run.columns:
        unit = unit_of(name)
        kinds[name] = merged_units.get(unit, unit)
    magnitudes = {
        name: np.nanmax(np.abs(values), initial=0.0) for name, values in run.columns.items()
    }
    noise = {}
    for kind in set(kinds.values()):
        names = [name for name in kinds if kinds[name] == kind]
        magnitude = max(
            (magnitudes[name] for name in names if name not in drift_columns.values()), default=0.0
        )
        drift = magnitudes.get(drift_columns.get(kind, ""), 0.0)
        relative_drift = drift / (magnitude or 1.0)
        noise[kind] = magnitude * max(ROUNDING, min(relative_drift, 10.0**-DIGITS))

    def format_value(name: str, value: float) -> str:
        return "0" if abs(value) <= noise[kinds[name]] else f"{value:.{DIGITS}g}"

    return format_value
