"""A table of results as a trajectory with one row per instant, and the columns that can be computed from it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace

import numpy as np

from stiction.comparisons.measures.accuracy import EVENT_WINDOW
from stiction.comparisons.measures.completed_motion import Completion, slips
from stiction.comparisons.measures.result_errors import TURN
from stiction.engines.examined import POSITIONS, VELOCITIES, changed_modes
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.trajectory_columns import build_columns
from stiction.scenes import Event, InputError, Scene, Trajectory
from stiction.scenes.column_file import (
    ColumnFile,
    JoinedColumns,
    TransformedColumns,
    compute_in_parts,
)
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.result_table import ResultTable
from stiction.scenes.trajectory import stacked
from stiction.truths import Truth

AT_ONCE = 2**16
"""Largest number of rows that are processed together. All columns of a mechanism at so many rows take about 20 MB."""
TIME_ROUNDING = 1e-9
"""Relative rounding error of times: a time is within the run if it exceeds the end by no more than this."""


def has_columns(columns: Collection[str], scene: Scene, *labels: tuple[str, ...]) -> bool:
    """Test whether all bodies have the columns with these labels, for example `POSITIONS`."""
    return all(
        f"{body}.{label}" in columns for body in scene.bodies for group in labels for label in group
    )


def rows_until(table: ResultTable, scene: Scene, t_end: float) -> ResultTable:
    """Return the rows of a table up to a time, with continuous angles.

    A last time that exceeds `t_end` (s) by rounding is set to `t_end`. Angles that a program has wrapped to one turn
    are unwrapped.

    Raises
    ------
    InputError
        If fewer than two rows are left.
    """
    # The times of a table do not decrease, so that the rows within the run come first.
    rows = int(np.count_nonzero(table.t <= t_end * (1 + TIME_ROUNDING)))
    if rows < 2:
        raise InputError(
            f"{table.origin}: found times from {table.t[0]:g} s on; "
            f"expected two rows within 0 .. {t_end:g} s"
        )
    t = np.clip(table.t[:rows], 0.0, t_end)
    columns: Mapping[str, np.ndarray] = TransformedColumns(
        table.columns, lambda name, values: values[:rows]
    )
    angles = [f"{body}.angle" for body in scene.bodies if f"{body}.angle" in columns]
    wrapped = [name for name in angles if _is_wrapped(columns[name])]
    if wrapped:
        unwrapped = _compute_each(rows, wrapped, lambda name: np.unwrap(columns[name]))
        columns = JoinedColumns(unwrapped, columns)
    return replace(table, t=t, columns=columns)


def _is_wrapped(angle: np.ndarray) -> bool:
    """Test whether an angle (rad) stays within one turn, but jumps by more than half a turn between rows."""
    if np.ptp(angle) > TURN * (1 + 1e-6):
        return False
    return bool(np.any(np.abs(np.diff(angle)) > np.pi))


def _compute_each(
    rows: int, names: Iterable[str], compute: Callable[[str], np.ndarray]
) -> Mapping[str, np.ndarray]:
    """Compute columns one after another; more than `AT_ONCE` rows are stored in a temporary file."""
    if rows <= AT_ONCE:
        return {name: compute(name) for name in names}
    columns = ColumnFile(rows)
    for name in names:
        columns.write(name, 0, compute(name))
    return columns


def trajectory_of(scene: Scene, table: ResultTable, truth: Truth) -> Trajectory:
    """Return a table as a trajectory with one row per instant.

    An instant with two rows is an event, whose kinds are the changes of modes between the rows. If no mode changes, as
    in a table without modes, its kinds are those of the nearest event of the truth. At the first and the last instant
    the table may have two rows without an event.
    """
    t = table.t
    events = []
    for time, before, after in table.jumps(table.columns):
        if not t[0] < time < t[-1]:
            continue
        kinds = list(changed_modes(scene.bounded_elements, before, after))
        if not kinds:
            kinds = _nearest_kinds(truth, time)
        events += [Event(time, kind, guide, before, after) for kind, guide in kinds]

    # The values at an event are in the event itself; they are no row of the trajectory.
    first, last = table.rows_before, table.rows_after
    is_at_an_end = (t[last] == t[0]) | (t[last] == t[-1])
    rows = last[(first == last) | is_at_an_end]
    columns = table.columns
    if len(rows) < len(t):
        columns = _compute_each(len(rows), table.columns, lambda name: table.columns[name][rows])
    return Trajectory(
        scene.name, "table", "", Fidelity.JOINT, t[rows], columns, tuple(events), mechanism=scene
    )


def _nearest_kinds(truth: Truth, time: float) -> list[tuple[str, str]]:
    """Return kind and guide of each true event that is nearest to a time (s), or one event of an unknown kind."""
    distance = min((abs(event.time - time) for event in truth.events), default=np.inf)
    if distance > EVENT_WINDOW:
        return [("unknown", "")]
    # Several events may take place at the same instant.
    reach = distance + TIME_ROUNDING * truth.t_end
    return [(event.kind, event.joint) for event in truth.events if abs(event.time - time) <= reach]


def derived_columns(scene: Scene, run: Trajectory, truth: Truth) -> Mapping[str, np.ndarray]:
    """Return displacements, slip velocities and drift as far as they follow from the columns of a run.

    If the positions of all bodies are known, all of these are computed from the states. If some coordinates are known
    and determine the others, only slip velocities are: a completed state satisfies the constraints by construction, so
    that its residuals mean nothing. A slip velocity that neither yields is the difference quotient of the displacement.
    """
    columns: Mapping[str, np.ndarray] = {}
    if has_columns(run.columns, scene, POSITIONS):
        columns = _columns_of_states(scene, run)
        if has_columns(run.columns, scene, VELOCITIES):
            return columns
        # Without velocities there is no residual of the velocities, and slip velocities follow below.
        columns = JoinedColumns({"drift.velocity": np.full(len(run.t), np.nan)}, columns)
    else:
        completion = Completion.of(scene, run.columns, truth)
        if completion is not None:
            completed = slips(completion, run.t, run.columns)
            columns = {name: values for name, values in completed.items() if name not in run}
            if columns:
                return columns
    return JoinedColumns(_slip_quotients(scene, run, columns), columns)


def _columns_of_states(scene: Scene, run: Trajectory) -> Mapping[str, np.ndarray]:
    """Compute displacements, slip velocities and drift from positions and, if they are known, velocities."""
    mechanism = Mechanism(scene, stabilization="none")
    names = [
        f"{guide}.{label}" for guide in scene.guides for label in ("displacement", "slip_velocity")
    ]
    names += [f"{pin}.slip_velocity" for pin in scene.pins if pin in scene.frictional_joints]
    names += ["drift.position", "drift.velocity"]
    has_velocities = has_columns(run.columns, scene, VELOCITIES)
    labels = [*POSITIONS, *VELOCITIES] if has_velocities else [*POSITIONS]
    states = [f"{body}.{label}" for body in scene.bodies for label in labels]
    # Accelerations and forces do not enter these columns.
    force_count = len(mechanism.row_names) + len(mechanism.guide_names)

    def compute(part: slice) -> dict[str, np.ndarray]:
        values = {name: run[name][part] for name in states}
        q = stacked(values, scene.bodies, POSITIONS)
        v = stacked(values, scene.bodies, VELOCITIES) if has_velocities else np.zeros_like(q)
        acceleration = np.zeros_like(q)
        force = np.zeros((len(q), force_count))
        return build_columns(mechanism, run.t[part], q, v, acceleration, force, names=names)

    return compute_in_parts(len(run.t), AT_ONCE, compute)


def _slip_quotients(
    scene: Scene, run: Trajectory, computed: Mapping[str, np.ndarray]
) -> Mapping[str, np.ndarray]:
    """Return slip velocities as difference quotients of the displacements in a run or in computed columns."""
    columns = JoinedColumns(run.columns, computed)
    displacements = {
        f"{guide}.slip_velocity": f"{guide}.displacement"
        for guide in scene.guides
        if f"{guide}.displacement" in columns
    }
    return _compute_each(
        len(run.t), displacements, lambda name: np.gradient(columns[displacements[name]], run.t)
    )
