"""Judgement of a table of results that anybody's program has made: errors against the truth, and what else it shows.

The measures are those by which engines are compared. Positions alone are enough; every other column is judged where it
is there.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.judge.truth_folder import is_truth_folder, read_truth
from stiction.comparisons.measures.accuracy import EVENT_WINDOW, errors, size_of
from stiction.comparisons.measures.completed_motion import Completion, energy_of_motion, slips
from stiction.comparisons.measures.drift import drift
from stiction.comparisons.measures.other_parameters import COLUMNS as OTHER
from stiction.comparisons.measures.other_parameters import explanations
from stiction.comparisons.measures.result_errors import TURN, column_errors
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.measures.steady_stretch import stick_intervals
from stiction.comparisons.measures.torque_jumps import SAMPLES, jump_rows
from stiction.engines import coherence
from stiction.engines.examined import (
    ACCELERATIONS,
    POSITIONS,
    VELOCITIES,
    Examined,
    Predicate,
    changed_modes,
)
from stiction.reference_impl.energies import needed_columns, unaccounted_energy
from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.trajectory_columns import build_columns
from stiction.scenes import Event, InputError, Scene, Trajectory, load_scene, vary
from stiction.scenes.column_file import (
    ColumnFile,
    JoinedColumns,
    TransformedColumns,
    compute_in_parts,
    row_slices,
)
from stiction.scenes.columns import columns_of, unit_of
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.result_table import ResultTable, result_table
from stiction.scenes.trajectory import stacked
from stiction.truths import Tier, Truth
from stiction.truths.truth import Columns

FEW = 0.1
"""Part of the time of a scene that a step may take at most, for a table to cover it."""
STILL, ROUNDED = 1e-3, 1e-6
"""A sample is at rest below this part of the largest true slip speed; a speed below that part of the mechanism's size
over the time of the scene is rounding."""
RESOLVED = 3
"""Samples within a stick phase, at least, for a table to show it: the first and the last may belong to its ends."""
PLACES, HELD = 21, 1e-6
"""Instants at which the free motions of a mechanism are looked at, and the part of one in them up to which a coordinate
is held: a truth without some of the bodies' angles leaves rounding, a free coordinate has a thousandth and more."""
CORNERS, EDGE = ("F1", "F2", "F3", "F4"), 3
"""Corner forces of a guide, and rows on either side of a part of a table that checks of neighbours look at."""
AT_ONCE = 2**16
"""Instants of a table that are looked at together, at most: all columns of a mechanism there take some 20 MB."""
SOLVED, RUN = 2**14, 2**18
"""Instants at which a truth is found together, at most: a truth keeps its columns at the last ones that it was asked
for, and one that is our own run is integrated anew each time."""
READING, COMPARING = 0.2, 0.5
"""Parts of the time that reading a long table, and comparing it with the truth, take."""
FOUND, MISSED, UNRESOLVED, INVENTED = (
    "found",
    "missed",
    "too short for the samples",
    "the truth slips",
)
"""Verdicts on a stick phase."""
PHASE = ["guide", "begin", "end", "duration", "samples", "verdict", "fastest_slip"]
"""Columns of a stick phase."""


@dataclass(frozen=True)
class Judgement:
    """The judgement of a table of results. Printing it shows a summary.

    Attributes
    ----------
    scene : Scene
        The scene.
    table : ResultTable
        The table as it was read, in SI units.
    truth : Truth
        The solution with which the table was compared. If the table has more than some ten thousand instants, it
        contains only the table's columns and those that can be computed from them.
    tables : Mapping[str, DataFrame]
        ``errors`` (one row per column of the table), ``summary`` (one row), ``stick-phases``, ``jumps``, ``findings``
        and ``other-parameters`` (one row per hypothesis that was tested). A table without findings has no rows.
    trajectory : Trajectory
        The table with one row per instant; both sides of a jump are an event. Displacements, slip velocities and drift
        computed from its columns are added.
    """

    scene: Scene
    table: ResultTable
    truth: Truth
    tables: Mapping[str, pd.DataFrame]
    trajectory: Trajectory

    @property
    def error(self) -> float | None:
        """Largest error of positions, m; angles count times the size of the mechanism. None if no error is known."""
        return self._largest("error")

    @property
    def uncertainty(self) -> float | None:
        """Largest uncertainty of the truth at these positions, m; None if none is known."""
        return self._largest("uncertainty")

    def _largest(self, column: str) -> float | None:
        metres = self.in_metres(column)
        return None if metres.isna().all() else float(metres.max())

    def in_metres(self, column: str) -> pd.Series:
        """Return a column of the table ``errors`` in m, with angles multiplied by the size of the mechanism.

        Rows of quantities other than positions and angles are NaN.
        """
        table = self.tables["errors"]
        return table[column] * table["unit"].map({"m": 1.0, "rad": size_of(self.scene)})

    @property
    def is_complete(self) -> bool:
        """Whether the table covers the run from 0 to the end of the scene, up to one step."""
        t, end = self.trajectory.t, self.scene.t_end
        step = (1 + 1e-6) * min(_step(t), FEW * end)
        return bool(t[0] <= step and t[-1] + step >= end)

    @property
    def widest_gap(self) -> float:
        """Longest interval between two consecutive instants of the table, s."""
        return float(np.max(np.diff(self.trajectory.t)))

    @property
    def is_covered(self) -> bool:
        """Whether no interval between consecutive instants exceeds a tenth of the scene's time."""
        return self.widest_gap <= FEW * self.scene.t_end * (1 + 1e-6)

    @cached_property
    def held(self) -> tuple[str, ...]:
        """The judged position columns that drives and joints prescribe whatever forces act.

        Empty if they prescribe the whole motion, because positions are then the only thing that can be wrong.
        """
        known = self.in_metres("error").notna()
        judged = list(self.tables["errors"].loc[known, "column"])
        return tuple(sorted({*judged} & prescribed(self.scene, self.truth)))

    @property
    def says_nothing(self) -> bool:
        """Whether all judged positions are in `held`, so that the table shows nothing about the solver."""
        return set(self.tables["errors"].loc[self.in_metres("error").notna(), "column"]) <= {
            *self.held
        }

    @property
    def hints(self) -> dict[str, list[str]]:
        """Names of columns, grouped by the likely cause of their errors."""
        table = self.tables["errors"]
        return {
            str(cause): list(rows["column"])
            for cause, rows in table.groupby("hint", sort=False)
            if cause
        }

    @property
    def is_misread(self) -> bool:
        """Whether columns seem to have other units, signs or origins than the scene; errors then mean little."""
        return bool(self.tables["errors"]["is_input"].any())

    @property
    def worst(self) -> pd.DataFrame:
        """For each unit, the row of the table ``errors`` with the largest error."""
        table = self.tables["errors"]
        return table.loc[table.dropna(subset="error").groupby("unit", sort=False)["error"].idxmax()]

    def __str__(self) -> str:
        """Tables: the largest error of each kind, numbers of the whole, what explains the errors, and faults."""
        summary, jumps = self.tables["summary"].loc[0].dropna(), self.tables["jumps"]
        numbers = dict(summary[summary != ""])
        for verdict, phases in self.tables["stick-phases"].groupby("verdict", sort=False):
            numbers[f"stick phases, {verdict}"] = len(phases)
        if len(jumps):
            numbers["jumps, read"] = f"{jumps['resolved'].sum()} of {len(jumps)}"
        # written one by one: a common format would leave nothing of the small ones
        written = {
            name: f"{value:.6g}" if isinstance(value, float) else str(value)
            for name, value in numbers.items()
        }
        tried = self.tables["other-parameters"]
        explained = tried.loc[tried["named"].astype(bool), ["hypothesis", "value"]]
        errors = self.worst[["column", "error", "uncertainty", "unit", "error_time", "hint"]]
        title = f"{self.table.origin} on {self.scene.name}; truth: {self.truth.tier.label}"
        parts = [title, pd.Series(written).to_frame().to_string(header=False)]
        for name, part in (
            ("largest errors", errors),
            ("errors explained by", explained),
            ("faults", self.tables["findings"]),
        ):
            if len(part):
                parts.append(f"{name}\n{part.to_string(index=False)}")
        return "\n\n".join(parts)


def judge(
    scene: Scene | str | Path,
    frame: Any,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, float] | None = None,
    t_end: float | None = None,
    tell: Callable[[float], None] | None = None,
) -> Judgement:
    """Judge a table of results of any program against the truth of a scene.

    Parameters
    ----------
    scene
        A scene, the name of a scene of the catalogue, the path of a TOML file, or the folder of a scene in a data set
        of truths; in the last case the truth is read from the folder instead of being computed.
    frame
        The results: the path of a CSV or Parquet file, a DataFrame, a mapping of arrays or a Trajectory, with a time
        column ``t`` and one or more of the scene's columns.
    mapping
        Columns of the scene by their names in the table; ``"-slider.x"`` reverses the sign, ``""`` ignores the column.
    units
        Units of the table in SI units, by quantity: ``{"length": 1e-3, "angle": pi/180}`` for millimetres and degrees;
        also ``"time"`` and ``"force"``.
    t_end
        Time that the results should cover, s; that of the scene if None.
    tell
        Called with the completed fraction of the work, greater than 0 and at most 1.

    Returns
    -------
    Judgement
        Errors of all columns, and other findings.

    Raises
    ------
    InputError
        If the scene cannot be used, or if the table cannot be a result of this scene.
    """
    truth = None
    if not isinstance(scene, Scene):
        scene, truth = (
            read_truth(Path(scene)) if is_truth_folder(scene) else (load_scene(scene), None)
        )
    if t_end is not None:
        if truth is not None and t_end > truth.t_end:
            raise InputError(
                f"t_end: found {t_end:g} s; expected at most {truth.t_end:g} s, the end of the truth in "
                "the folder"
            )
        scene = vary(scene, {"t_end": t_end})
    if isinstance(frame, Trajectory):
        frame = frame.to_frame(events=True, interpolated=True)
    done = _forwards(tell or (lambda share: None))
    table = result_table(
        frame, scene, mapping, units, spills=True, tell=lambda share: done(READING * share)
    )
    truth = truth or ground_truth(scene)
    table = _within(table, min(scene.t_end, truth.t_end))
    wanted = {
        *table.columns,
        *(
            f"{joint}.{label}"
            for joint in {**scene.guides, **scene.frictional_joints}
            for label in ("slip_velocity", "mode")
        ),
        *(f"{body}.{label}" for body in scene.bodies for label in POSITIONS),
    }
    compared = Compared(
        truth.columns,
        wanted,
        RUN if truth.tier == Tier.OWN_RUN else SOLVED,
        lambda share: done(READING + COMPARING * share),
    )
    truth = replace(truth, columns=compared)
    given = _trajectory(scene, table, truth)
    derived = _derived(scene, given, truth)
    full = replace(given, columns=JoinedColumns(given.columns, derived))
    errors_of_columns = column_errors(table, given, truth, scene)
    done(READING + COMPARING)
    phases = (
        []
        if truth.tier == Tier.NONE
        else [
            phase
            for guide in scene.frictional_joints
            for phase in _stick_phases(scene, full, truth, guide)
        ]
    )
    # a table that must be read in another way, or is a row late, is explained by that
    others = (
        []
        if truth.tier == Tier.NONE or (errors_of_columns["hint"] != "").any()
        else explanations(scene, table, truth)
    )
    summary = _summary(
        scene, table, replace(full, columns=JoinedColumns(derived, full.columns)), truth
    )
    judged = Judgement(
        scene,
        table,
        truth,
        {
            "errors": errors_of_columns,
            "summary": pd.DataFrame([summary]),
            "stick-phases": pd.DataFrame(phases, columns=PHASE),
            "other-parameters": pd.DataFrame([one.row() for one in others], columns=OTHER),
            "jumps": pd.DataFrame([*_jumps(scene, full, truth)] or {"effort": []}),
            "findings": pd.DataFrame(
                {"finding": list(_findings(scene, full, given.columns))}, dtype=object
            ),
        },
        full,
    )
    done(1.0)
    return judged


def _forwards(tell: Callable[[float], None]) -> Callable[[float], None]:
    """Tell of progress only what is more than before: a truth is sought at several sets of instants."""
    furthest = 0.0

    def done(share: float) -> None:
        nonlocal furthest
        if share > furthest:
            furthest = share
            tell(share)

    return done


class Compared:
    """The columns of a truth, `Columns`, for a table that may be long, at whose times they are asked for repeatedly.

    What was found is kept: the truth of our own run is integrated at each call, and every column asks for the same
    times. At more than `most` instants the truth is found part by part, and only the columns `wanted` are kept, in a
    temporary file. `tell` is called with the part of such a search that is done.
    """

    def __init__(
        self, columns: Columns, wanted: Collection[str], most: int, tell: Callable[[float], None]
    ):
        self._columns, self._wanted, self._most, self._tell = columns, wanted, most, tell
        self._found: dict[tuple[bytes, str], Mapping[str, np.ndarray]] = {}

    def __call__(self, t: np.ndarray, side: str) -> Mapping[str, np.ndarray]:
        key = hashlib.sha256(np.ascontiguousarray(t).data).digest(), side
        if key not in self._found:
            self._found[key] = (
                self._columns(t, side) if len(t) <= self._most else self._in_parts(t, side)
            )
        return self._found[key]

    def _in_parts(self, t: np.ndarray, side: str) -> Mapping[str, np.ndarray]:
        def made(part: slice) -> dict[str, np.ndarray]:
            found = self._columns(np.array(t[part]), side)
            self._tell(part.stop / len(t))
            return {name: values for name, values in found.items() if name in self._wanted}

        return compute_in_parts(len(t), self._most, made)


def _within(table: ResultTable, t_end: float) -> ResultTable:
    """The rows until the end; what rounding adds to the last one is taken off, and angles within a turn go on."""
    rows = int(np.count_nonzero(table.t <= t_end * (1 + 1e-9)))  # times are in order
    if rows < 2:
        raise InputError(
            f"{table.origin}: found times from {table.t[0]:g} s on; "
            f"expected two rows within 0 .. {t_end:g} s"
        )
    columns = TransformedColumns(table.columns, lambda name, values: values[:rows])
    angles = [name for name in columns if name.endswith(".angle")]
    wrapped = [name for name in angles if np.ptp(columns[name]) <= TURN * (1 + 1e-6)]
    turned = {name for name in wrapped if np.any(np.abs(np.diff(columns[name])) > np.pi)}
    return replace(
        table,
        t=np.clip(table.t[:rows], 0.0, t_end),
        columns=columns
        if not turned
        else JoinedColumns(_kept(rows, turned, lambda name: np.unwrap(columns[name])), columns),
    )


def _kept(
    rows: int, names: Iterable[str], made: Callable[[str], np.ndarray]
) -> Mapping[str, np.ndarray]:
    """Columns that are made one after another: in memory, or of many rows in a temporary file."""
    if rows <= AT_ONCE:
        return {name: made(name) for name in names}
    kept = ColumnFile(rows)
    for name in names:
        kept.write(name, 0, made(name))
    return kept


def _trajectory(scene: Scene, table: ResultTable, truth: Truth) -> Trajectory:
    """The table with one row per instant; instants within with two rows are events.

    An event is a change of a guide's mode; without one it is what the truth has at the nearest event.
    """
    t, first, last = table.t, table.first, table.last
    events = [
        Event(time, kind, guide, before, after)
        for time, before, after in table.jumps(table.columns)
        if t[0] < time < t[-1]
        for kind, guide in [*changed_modes(scene.frictional_joints, before, after)]
        or _nearest(truth, time)
    ]
    rows = last[(first == last) | (t[last] == t[0]) | (t[last] == t[-1])]
    columns = table.columns
    if len(rows) < len(t):
        columns = _kept(len(rows), table.columns, lambda name: table.columns[name][rows])
    return Trajectory(
        scene.name, "table", "", Fidelity.JOINT, t[rows], columns, tuple(events), mechanism=scene
    )


def _nearest(truth: Truth, time: float) -> list[tuple[str, str]]:
    """Kinds and guides of the true events nearest to an instant."""
    near = min((abs(event.time - time) for event in truth.events), default=np.inf)
    reach = near + 1e-9 * truth.t_end if near <= EVENT_WINDOW else -1.0
    return [
        (event.kind, event.joint) for event in truth.events if abs(event.time - time) <= reach
    ] or [("unknown", "")]


def _has(columns: Collection[str], scene: Scene, *labels: tuple[str, ...]) -> bool:
    """Test if all bodies have these columns."""
    return all(
        f"{body}.{label}" in columns for body in scene.bodies for kind in labels for label in kind
    )


def _derived(scene: Scene, found: Trajectory, truth: Truth) -> Mapping[str, np.ndarray]:
    """Displacements, slip velocities and drift that follow from what is given: from the states of all bodies.

    Without velocities a slip velocity is the difference quotient of displacements. Where some coordinates are given
    and determine the others, slip velocities alone: the residuals of completed states are zero by construction.
    """
    columns: Mapping[str, np.ndarray] = {}
    moves = _has(found.columns, scene, VELOCITIES)
    if _has(found.columns, scene, POSITIONS):
        mechanism = Mechanism(scene, stabilization="none")
        names = [
            f"{guide}.{label}"
            for guide in scene.guides
            for label in ("displacement", "slip_velocity")
        ]
        names += [f"{pin}.slip_velocity" for pin in scene.pins if pin in scene.frictional_joints]

        def made(part: slice) -> dict[str, np.ndarray]:
            here = {
                name: found[name][part]
                for labels in (POSITIONS, VELOCITIES)
                for body in scene.bodies
                for label in labels
                if (name := f"{body}.{label}") in found
            }
            q = stacked(here, scene.bodies, POSITIONS)
            v = stacked(here, scene.bodies, VELOCITIES) if moves else np.zeros_like(q)
            force = np.zeros((len(q), len(mechanism.row_names) + len(mechanism.guide_names)))
            return build_columns(
                mechanism,
                found.t[part],
                q,
                v,
                np.zeros_like(q),
                force,
                names=[*names, "drift.position", "drift.velocity"],
            )

        columns = compute_in_parts(len(found.t), AT_ONCE, made)
        if moves:
            return columns
        columns = JoinedColumns({"drift.velocity": np.full(len(found.t), np.nan)}, columns)
    elif completion := Completion.of(scene, found.columns, truth):
        known = slips(completion, found.t, found.columns)
        columns = {name: values for name, values in known.items() if name not in found}
        if columns:
            return columns
    way = JoinedColumns(found.columns, columns)
    named = [f"{guide}.slip_velocity" for guide in scene.guides if f"{guide}.displacement" in way]
    quotients = _kept(
        len(found.t),
        named,
        lambda name: np.gradient(way[f"{name.rpartition('.')[0]}.displacement"], found.t),
    )
    return JoinedColumns(quotients, columns)


def prescribed(scene: Scene, truth: Truth) -> set[str]:
    """Return the columns of positions that no force moves: their coordinates have no part in any free motion.

    Free motions are the null space of the constraints' Jacobian, J v = 0, in the positions of the start and of the
    truth at `PLACES` instants; a coordinate that a singular position alone holds has a part in another. Empty where
    there is no free motion.
    """
    mechanism, equations = Mechanism(scene, stabilization="none"), EquationsOfMotion(scene)
    start, rates = equations.start()
    names = [f"{body}.{label}" for body in scene.bodies for label in POSITIONS]
    t = np.linspace(0.0, min(scene.t_end, truth.t_end), PLACES)
    q = np.tile(start, (PLACES, 1))
    for place, name in enumerate(names):
        if truth.tier != Tier.NONE and name in (true := truth(t)):
            q[:, place] = true[name]
    free: list[np.ndarray] = []
    scale = np.tile([1.0, 1.0, mechanism.arrays.length_scale], len(scene.bodies))
    for time, here in zip(t, q):
        J = equations.at(float(time), here, rates).J / scale
        _, size, right = np.linalg.svd(J)
        rank = np.count_nonzero(size > HELD * np.max(size, initial=0.0))
        free.append(right[rank:])
    fewest = min(map(len, free))  # in a singular position there are more
    if fewest == 0:
        return set()
    moves = np.max(np.abs([motions for motions in free if len(motions) == fewest]), axis=(0, 1))
    return {name for name, part in zip(names, moves) if part <= HELD}


def _step(t: np.ndarray) -> float:
    return float(np.median(np.diff(t)))


def _summary(scene: Scene, table: ResultTable, full: Trajectory, truth: Truth) -> dict[str, Any]:
    """Sampling, errors of all columns together, drift, energy."""
    row: dict[str, Any] = {
        "two_sided_instants": len(full.events),
        "table_begin": float(table.t[0]),
        "table_end": float(table.t[-1]),
        "t_end": scene.t_end,
        "sample_distance": _step(full.t),
        **(drift(full) if "drift.position" in full and "drift.velocity" in full else {}),
        **errors(full, truth, size_of(scene)),
    }
    if all(name in table.columns for name in needed_columns(scene)):
        row |= zip(
            ("energy_error", "energy_uncertainty", "energy_exchanged"),
            unaccounted_energy(scene, table.t, table.columns),
        )
        return row
    instants = table.last
    columns = (
        table.columns
        if len(instants) == len(table.t)
        else TransformedColumns(table.columns, lambda name, values: values[instants])
    )
    completion = Completion.of(scene, columns, truth)
    found = completion and energy_of_motion(completion, table.t[instants], columns)
    if found:
        row |= zip(
            (
                "completed_energy_error",
                "completed_energy_uncertainty",
                "completed_energy_exchanged",
            ),
            found,
        )
    return row


def _stick_phases(
    scene: Scene, full: Trajectory, truth: Truth, guide: str
) -> Iterator[tuple[Any, ...]]:
    """Stick phases of the truth as far as the table goes, and rests of the table where the truth slips."""
    t, true, slip, mode = full.t, truth(full.t), f"{guide}.slip_velocity", f"{guide}.mode"
    if slip not in true or (slip not in full and mode not in full):
        return
    true_speed = np.abs(true[slip])
    slow = STILL * max(float(np.max(true_speed)), ROUNDED * size_of(scene) / scene.t_end)
    rests = full[mode] == 0 if mode in full else np.abs(full[slip]) <= slow
    starts_at_rest = bool(truth(0.0).get(mode, np.ones(1))[0] == 0)
    own = [event for event in truth.events if event.joint == guide]
    for first, last in stick_intervals(own, 0.0, truth.t_end, starts_at_rest):
        begin, end = max(first, float(t[0])), min(last, float(t[-1]))
        inside = np.flatnonzero((t >= begin) & (t <= end))
        if len(inside) < RESOLVED and (begin, end) != (first, last):  # cut
            continue
        inner = inside[1:-1]
        verdict = UNRESOLVED if len(inside) < RESOLVED else FOUND if rests[inner].all() else MISSED
        fastest = (
            float(np.max(np.abs(full[slip][inner]))) if slip in full and len(inner) else np.nan
        )
        yield guide, begin, end, end - begin, len(inside), verdict, fastest
    wrong = np.concatenate([[False], rests & (true_speed > 2 * slow), [False]])
    for first, behind in np.flatnonzero(np.diff(wrong.astype(int))).reshape(-1, 2):
        if behind - first >= RESOLVED:
            begin, end = float(t[first]), float(t[behind - 1])
            yield guide, begin, end, end - begin, int(behind - first), INVENTED, np.nan


def _jumps(scene: Scene, full: Trajectory, truth: Truth) -> Iterator[dict[str, Any]]:
    """Jumps of efforts within the table; ``readable`` are those that its samples, or its two sides, can show."""
    times = np.array([event.time for event in truth.events])
    for effort in (f"{drive}.effort" for drive in scene.drives):
        for row in jump_rows(full, truth, effort) if effort in full else ():
            time = row["event_time"]
            room = np.min(np.abs(times[times != time] - time), initial=truth.t_end)
            if full.t[0] <= time <= full.t[-1]:
                yield {
                    **row,
                    "readable": bool(full.events or room > (min(SAMPLES) + 1) * _step(full.t)),
                }


def _findings(scene: Scene, full: Trajectory, given: Collection[str]) -> Iterator[str]:
    """What the gate finds of the columns that are given: the first fault of each of its checks."""
    states = _has(given, scene, POSITIONS, VELOCITIES)
    forces = all(
        name in given for name in columns_of(scene) if unit_of(name, scene) in ("N", "N m")
    )
    rates = states and _has(given, scene, ACCELERATIONS)
    checks: dict[Predicate, bool] = {
        coherence.start: states and full.t[0] == 0,
        coherence.residuals: states,
        coherence.velocities: states,
        coherence.displacements: states,
        coherence.dissipation: states and forces,
        coherence.momentum_of_steps: rates and forces,
        coherence.balance: rates and forces,
        coherence.corner_forces: forces,
        coherence.modes: True,
        coherence.unreported_events: states,
        coherence.cone: states and forces,
        coherence.continuity: states,
    }
    step = _step(full.t)
    settings = {} if full.events else {"dt": step}
    for check, applies in checks.items():
        if not applies:
            continue
        for found in _looked_at(scene, full, check) if len(full.t) > AT_ONCE else [full]:
            # of accelerations that are not given the check of velocities takes the size
            second = (
                {
                    f"{body}.{label}": np.gradient(found[f"{body}.{rate}"], found.t)
                    for body in scene.bodies
                    for rate, label in zip(VELOCITIES, ACCELERATIONS)
                }
                if states
                else {}
            )
            found = replace(found, columns=JoinedColumns(found.columns, second), settings=settings)
            run = Examined(
                found,
                scene,
                float(full.t[-1]),
                None,
                step,
                Fidelity.JOINT,
                lambda _: bool(full.events),
                lambda _: True,
            )
            if finding := next(check(run), None):
                yield finding
                break


def _looked_at(scene: Scene, full: Trajectory, check: Predicate) -> Iterator[Trajectory]:
    """The rows of a long table that a check looks at together: all of them, `AT_ONCE` at a time.

    Checks measure faults in parts of the largest values of a run, so that every part also has the rows with the
    largest value of each column and of each guide's load, their neighbours, and the first two rows. What sums over all
    of a run, the check of velocities, has every k-th row instead.
    """
    rows = len(full.t)
    if check is coherence.velocities:
        yield _rows(full, np.arange(0, rows, -(-rows // AT_ONCE)))
        return
    if check is coherence.start:
        yield _rows(full, np.arange(2))
        return
    largest = [
        0,
        *(
            int(np.nanargmax(np.abs(full[name])))
            for name in full.columns
            if np.isfinite(full[name]).any()
        ),
    ]
    for guide in scene.frictional_guides:
        if all(f"{guide}.{corner}" in full for corner in CORNERS):
            largest.append(
                int(
                    np.nanargmax(
                        sum(np.nan_to_num(np.abs(full[f"{guide}.{corner}"])) for corner in CORNERS)
                    )
                )
            )
    for part in row_slices(rows, AT_ONCE):
        begin, end = max(0, part.start - EDGE), min(rows, part.stop + EDGE)
        beside = [row + shift for row in largest for shift in range(-EDGE, EDGE + 1)]
        extra = np.array(
            [row for row in beside if 0 <= row < rows and not begin <= row < end], dtype=int
        )
        yield _rows(full, np.unique(np.concatenate([extra, np.arange(begin, end)])))


def _rows(full: Trajectory, rows: np.ndarray) -> Trajectory:
    """Some rows of a trajectory, all of its events."""
    return replace(full, t=full.t[rows], columns={name: full[name][rows] for name in full.columns})
