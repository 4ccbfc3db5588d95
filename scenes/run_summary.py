"""A run in brief, as tables for a terminal and for Jupyter: its end, forces and drift over time, events."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from stiction.scenes.columns import unit_of
from stiction.scenes.trajectory import Event, Trajectory

STATE = ("x", "y", "angle", "vx", "vy", "omega")
EVENTS_SHOWN = 20
DIGITS = 9
"""Of the numbers of a run."""
ROUNDING = 1e-13
"""Of the largest value of a kind: what some hundred roundings of double precision come to."""


def run_title(run: Trajectory) -> str:
    """Scene, engine, and how far the run came, in a line."""
    times = f"t = 0 .. {run.t[-1]:g} s" if len(run.t) > 1 else "no motion"
    return f"{run.scene}: {run.engine} {run.version}, {run.fidelity}, {times}, {len(run.t)} rows"


def run_tables(run: Trajectory) -> Iterator[tuple[Sequence[str], list[tuple[str, ...]]]]:
    """Yield heads and rows of each table; those of events with jumps of the efforts that an event has values of."""
    digits = _above_noise(run)
    bodies = [name.removesuffix(".omega") for name in run.columns if name.endswith(".omega")]
    yield (
        ("end state [m, rad, s]", *STATE),
        [
            (body, *(digits(name, run[name][-1]) for name in (f"{body}.{key}" for key in STATE)))
            for body in bodies
        ],
    )
    shown = [
        name
        for name in run.columns
        if name.rpartition(".")[2] in ("effort", "normal_force", "friction")
        or name.startswith("drift.")
    ]
    yield (
        ("over time", "smallest", "largest", "at the end"),
        [
            (
                name,
                *(
                    "left open" if np.isnan(value) else digits(name, value)
                    for value in (
                        np.fmin.reduce(run[name]),
                        np.fmax.reduce(run[name]),
                        run[name][-1],
                    )
                ),
            )
            for name in shown
        ],
    )
    if run.alternatives:
        yield (
            (
                "force that is not unique",
                "instants",
                "from [s]",
                "to [s]",
                "values at the first of them",
            ),
            [_not_unique(run, name, digits) for name in run.alternatives],
        )
    efforts = [name for name in run.columns if name.endswith(".effort")]
    several = any(event.other_modes for event in run.events)
    yield (
        (
            "event [s]",
            "kind",
            "joint",
            *(f"jump of {name}" for name in efforts),
            *(["other consistent modes"] * several),
        ),
        [
            (
                f"{event.time:.9f}",
                event.kind,
                event.joint,
                *(_jump(event, name, digits) for name in efforts),
                *([str(event.other_modes)] * several),
            )
            for event in run.events[:EVENTS_SHOWN]
        ],
    )


def _jump(event: Event, name: str, digits: Callable[[str, float], str]) -> str:
    """Jump of a column at an event; empty for one of another part of the scene, or that is left open."""
    if name not in event.before or np.isnan(event.jump(name)):
        return ""
    return digits(name, event.jump(name))


def _not_unique(run: Trajectory, name: str, digits: Callable[[str, float], str]) -> tuple[str, ...]:
    """A row for a column of which Coulomb's law allows several values: how often, from when to when, and which."""
    values = run.alternatives[name]
    rows = np.flatnonzero(~np.isnan(values).all(axis=1))
    first = values[rows[0]]
    return (
        name,
        str(len(rows)),
        f"{run.t[rows[0]]:.9g}",
        f"{run.t[rows[-1]]:.9g}",
        ", ".join(digits(name, value) for value in first[~np.isnan(first)]),
    )


def more_events(run: Trajectory) -> str:
    """Say how many events are not shown; empty if all are."""
    more = len(run.events) - EVENTS_SHOWN
    return f"... and {more} more events" if more > 0 else ""


def _above_noise(run: Trajectory) -> Callable[[str, float], str]:
    """Digits of a value of a column, or 0 where rounding, or drift that digits do not show, makes as much.

    As in the norms of the drift, lengths and angles count together, and so do forces and moments.
    """
    # A value counts as zero if it is rounding of the largest of its kind, or below the drift of
    # that kind, as long as that is less than the digits show.
    same = {"rad": "m", "rad/s": "m/s", "N m": "N", "N m or N": "N"}
    kinds = {name: same.get(unit := unit_of(name), unit) for name in run.columns}
    sizes = {name: np.nanmax(np.abs(values), initial=0.0) for name, values in run.columns.items()}
    drifts = {"m": "drift.position", "m/s": "drift.velocity"}
    noise = {}
    for kind in set(kinds.values()):
        size = max(
            (sizes[name] for name in kinds if kinds[name] == kind and name not in drifts.values()),
            default=0.0,
        )
        drift = sizes.get(drifts.get(kind, ""), 0.0)
        noise[kind] = size * max(ROUNDING, min(drift / (size or 1.0), 10.0**-DIGITS))
    return lambda name, value: "0" if abs(value) <= noise[kinds[name]] else f"{value:.{DIGITS}g}"
