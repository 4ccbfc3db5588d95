"""Inconsistencies between the columns of a table of results, found by the checks that also judge engines."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace

import numpy as np

from stiction.comparisons.judge.table_trajectory import AT_ONCE, has_columns
from stiction.engines import coherence
from stiction.engines.examined import (
    ACCELERATIONS,
    POSITIONS,
    VELOCITIES,
    Examined,
    Predicate,
)
from stiction.scenes import Scene, Trajectory
from stiction.scenes.column_file import JoinedColumns, row_slices
from stiction.scenes.columns import columns_of, unit_of
from stiction.scenes.fidelity import Fidelity

CORNERS = ("F1", "F2", "F3", "F4")
"""Labels of the corner forces of a guide."""
NEIGHBOURS = 3
"""Rows that a part of a table has beyond its ends: checks that compare neighbouring rows look no farther."""


def inconsistencies(
    scene: Scene, run: Trajectory, given: Collection[str], step: float
) -> Iterator[str]:
    """Yield the first fault that each check finds, in words.

    Parameters
    ----------
    run
        The table, with the columns that were computed from it.
    given
        Names of the columns that the table itself contains; they decide which checks apply.
    step
        Distance of the rows, s.
    """
    for check in _applicable_checks(scene, run, given):
        # A long table is checked in parts, whose columns fit into memory.
        parts: Iterable[Trajectory] = [run]
        if len(run.t) > AT_ONCE:
            parts = _parts(scene, run, check)
        for part in parts:
            fault = next(check(_examined(scene, part, run, given, step)), None)
            if fault is not None:
                yield fault
                break


def _applicable_checks(
    scene: Scene, run: Trajectory, given: Collection[str]
) -> Iterator[Predicate]:
    """Yield the checks for which a table has the columns."""
    has_states = has_columns(given, scene, POSITIONS, VELOCITIES)
    has_accelerations = has_states and has_columns(given, scene, ACCELERATIONS)
    has_forces = all(
        name in given for name in columns_of(scene) if unit_of(name, scene) in ("N", "N m")
    )
    applies: dict[Predicate, bool] = {
        coherence.check_start: has_states and run.t[0] == 0,
        coherence.check_residuals: has_states,
        coherence.check_velocities: has_states,
        coherence.check_displacements: has_states,
        coherence.check_dissipation: has_states and has_forces,
        coherence.check_momentum_of_steps: has_accelerations and has_forces,
        coherence.check_balance: has_accelerations and has_forces,
        coherence.check_corner_forces: has_forces,
        coherence.check_modes: True,
        coherence.check_unreported_events: has_states,
        coherence.check_cone: has_states and has_forces,
        coherence.check_continuity: has_states,
    }
    for check, is_applicable in applies.items():
        if is_applicable:
            yield check


def _examined(
    scene: Scene, part: Trajectory, run: Trajectory, given: Collection[str], step: float
) -> Examined:
    """Return a part of a run in the form in which the checks take the run of an engine."""
    columns = part.columns
    if has_columns(given, scene, POSITIONS, VELOCITIES):
        # The check of velocities takes the size of accelerations. A table without them gets
        # difference quotients.
        quotients = {
            f"{body}.{acceleration}": np.gradient(part[f"{body}.{velocity}"], part.t)
            for body in scene.bodies
            for velocity, acceleration in zip(VELOCITIES, ACCELERATIONS)
        }
        columns = JoinedColumns(part.columns, quotients)
    # A table with both sides of events comes from a method that locates them. Without them it is
    # treated like a run with fixed steps, which may be off by a step.
    has_events = bool(run.events)
    settings = {} if has_events else {"dt": step}
    return Examined(
        replace(part, columns=columns, settings=settings),
        scene,
        t_end=float(run.t[-1]),
        dt=None,
        output_step=step,
        fidelity=Fidelity.JOINT,
        locates=lambda _: has_events,
        keeps=lambda _: True,
    )


def _parts(scene: Scene, run: Trajectory, check: Predicate) -> Iterator[Trajectory]:
    """Yield parts of a long run for a check, which together contain all rows.

    There are two exceptions. The check of the start needs only two rows. The check of velocities sums over the whole
    run, and therefore gets every k-th row of it.
    """
    rows = len(run.t)
    if check is coherence.check_velocities:
        stride = -(-rows // AT_ONCE)
        yield _with_rows(run, np.arange(0, rows, stride))
        return
    if check is coherence.check_start:
        yield _with_rows(run, np.arange(2))
        return
    # Checks measure faults relative to the largest values of the run. Each part therefore also
    # contains the rows in which these occur, and the first row, each with its neighbours.
    needed = [0, *_rows_of_largest_values(scene, run)]
    offsets = np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    needed_rows = np.add.outer(needed, offsets).ravel()
    needed_rows = needed_rows[(needed_rows >= 0) & (needed_rows < rows)]
    for part in row_slices(rows, AT_ONCE):
        begin = max(0, part.start - NEIGHBOURS)
        end = min(rows, part.stop + NEIGHBOURS)
        yield _with_rows(run, np.union1d(np.arange(begin, end), needed_rows))


def _rows_of_largest_values(scene: Scene, run: Trajectory) -> Iterator[int]:
    """Yield the row with the largest value of each column, and with the largest load of each guide."""
    for name in run.columns:
        if np.isfinite(run[name]).any():
            yield int(np.nanargmax(np.abs(run[name])))
    for guide in scene.frictional_guides:
        corners = [f"{guide}.{corner}" for corner in CORNERS]
        if all(name in run for name in corners):
            load = np.zeros(len(run.t))
            for name in corners:
                load += np.nan_to_num(np.abs(run[name]))
            yield int(np.argmax(load))


def _with_rows(run: Trajectory, rows: np.ndarray) -> Trajectory:
    """Return a trajectory with some of the rows, and all events."""
    columns = {name: run[name][rows] for name in run.columns}
    return replace(run, t=run.t[rows], columns=columns)
