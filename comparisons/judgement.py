"""Judgement of a table of results that anybody's program has made: errors against the truth, and what else it shows.

The measures are those by which engines are compared. Positions alone are enough; every other column is judged where it
is there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.measures.accuracy import EVENT_WINDOW, errors, size_of
from stiction.comparisons.measures.drift import drift
from stiction.comparisons.measures.energy_balance import energy_balance
from stiction.comparisons.measures.result_errors import TURN, column_errors
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.measures.steady_stretch import stick_intervals
from stiction.comparisons.measures.torque_jumps import SAMPLES, torque_table
from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.truth import NO_TRUTH, Truth
from stiction.comparisons.truth.truth import Columns
from stiction.comparisons.truth_folder import is_truth_folder, read_truth
from stiction.comparisons.variants import Record, Variant
from stiction.engines import coherence
from stiction.engines.examined import ACCELERATIONS, POSITIONS, VELOCITIES, Examined, Predicate
from stiction.engines.isolation import Outcome
from stiction.reference_impl.energies import needed_columns
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.trajectory_columns import build_columns
from stiction.scenes import Event, InputError, Scene, Trajectory, load_scene, vary
from stiction.scenes.columns import columns_of, unit_of
from stiction.scenes.result_table import ResultTable, result_table
from stiction.scenes.trajectory import rows_of, stacked

FEW = 0.1
"""Part of the time of a scene that a step may take at most, for a table to cover it."""
STILL = 1e-3
"""Part of the largest true slip speed below which a sample is at rest."""
ROUNDED = 1e-6
"""Slip speeds below this part of the mechanism's size over the time of the scene are rounding."""
RESOLVED = 3
"""Samples within a stick phase, at least, for a table to show it: the first and the last may belong to its ends."""
PHASE = ["guide", "begin [s]", "end [s]", "duration [s]", "samples", "verdict", "fastest slip [m/s]"]
"""Columns of a stick phase."""
FOUND, MISSED, UNRESOLVED, INVENTED = "found", "missed", "too short for the samples", "the truth slips"


@dataclass(frozen=True)
class Judgement:
    """What a table of results is worth.

    Attributes
    ----------
    scene : Scene
    table : ResultTable
    truth : Truth
    tables : Mapping[str, DataFrame]
        ``errors`` (a row per column), ``summary`` (one row), ``stick-phases``, ``jumps``, ``findings``: rows may be
        none.
    trajectory : Trajectory
        The table, one row per instant, both sides of jumps as events, with displacements, slip velocities and drift
        that follow from its columns.
    """

    scene: Scene
    table: ResultTable
    truth: Truth
    tables: Mapping[str, pd.DataFrame]
    trajectory: Trajectory

    @property
    def error(self) -> float | None:
        """Largest error of positions, m, angles times the size of the mechanism; None where none is known."""
        return self._largest("error")

    @property
    def uncertainty(self) -> float | None:
        """Uncertainty of the truth of those positions, m."""
        return self._largest("uncertainty")

    @property
    def is_complete(self) -> bool:
        """True where the table goes from 0 to the end of the scene, but for a step."""
        t, end = self.trajectory.t, self.scene.t_end
        step = (1 + 1e-6) * min(_step(self.trajectory), FEW * end)
        return bool(t[0] <= step and t[-1] + step >= end)

    @property
    def hints(self) -> dict[str, list[str]]:
        """Columns by the likely cause of their errors."""
        table = self.tables["errors"]
        hinted = table[table["hint"] != ""] if len(table) else table
        return {str(cause): list(rows["column"]) for cause, rows in hinted.groupby("hint", sort=False)} if len(
            hinted) else {}

    @property
    def is_misread(self) -> bool:
        """True where columns seem to have other units, signs or origins than the scene: the numbers mean little."""
        table = self.tables["errors"]
        return bool(len(table) and table["is input"].any())

    @cached_property
    def presentation(self) -> Presentation:
        """The same in words, tables and figures."""
        from stiction.comparisons.judgement_in_words import presentation

        return presentation(self)

    def __str__(self) -> str:
        said = self.presentation
        return "\n".join(part.text for part in (said.answer, *said.findings))

    def _largest(self, column: str) -> float | None:
        table, scale = self.tables["errors"], {"m": 1.0, "rad": size_of(self.scene)}
        known = table[table["unit"].isin(list(scale))] if len(table) else table
        return float((known[column] * known["unit"].map(scale)).max()) if len(known) else None


def judge(scene: Scene | str | Path, frame: Any, mapping: Mapping[str, str] | None = None,
          units: Mapping[str, float] | None = None, t_end: float | None = None) -> Judgement:
    """Judge the results of anybody's program on a scene.

    Parameters
    ----------
    scene
        A scene, the name of one of the catalogue, a TOML file, or the folder of a scene in a data set of truths, whose
        truth is then read and not solved.
    frame
        A CSV or Parquet file, a DataFrame, a mapping of arrays or a Trajectory: a time column ``t`` and one or more of
        the scene's columns.
    mapping
        Name in the table -> the scene's column, ``"-slider.x"`` with the other sign, ``""`` to leave it out.
    units
        Size in SI by what is measured: ``{"length": 1e-3, "angle": pi/180}``; also ``"time"`` and ``"force"``.
    t_end
        Seconds that the results should cover; the scene's own if None.

    Raises
    ------
    InputError
        For a scene that cannot be used, and for a table that cannot be a result of it.
    """
    truth = None
    if isinstance(scene, Scene):
        loaded = scene
    elif is_truth_folder(scene):
        loaded, truth = read_truth(Path(scene))
    else:
        loaded = load_scene(scene)
    if t_end is not None:
        if truth is not None and t_end > truth.t_end:
            raise InputError(f"t_end: found {t_end:g} s; expected at most {truth.t_end:g} s, the end of the truth in "
                             f"{scene}")
        loaded = vary(loaded, {"t_end": t_end})
    if isinstance(frame, (str, Path)):
        table = read_result(frame, loaded, mapping, units)
    else:
        given = frame
        if isinstance(frame, Trajectory):  # events of independent parts have the columns of their part alone
            given = frame.to_frame(events=all(event.before.keys() == frame.columns.keys() for event in frame.events))
        table = result_table(given, loaded, mapping, units)
    return judged(loaded, table, truth or ground_truth(loaded))


def judged(scene: Scene, table: ResultTable, truth: Truth) -> Judgement:
    """Judge a table by a truth of the scene."""
    table = _within(table, min(scene.t_end, truth.t_end))
    truth = replace(truth, columns=_remembering(truth.columns))
    trajectory = trajectory_of(scene, table, truth)
    derived = _derived(scene, trajectory)
    full = replace(trajectory, columns={**derived, **trajectory.columns})
    record = Record(f"{scene.name}/{table.origin}", scene.name, Variant("table", "table", "dt", (_step(full),)),
                    _step(full), Outcome("table", "ok", trajectory))
    known = truth.tier != NO_TRUTH
    jumps = [_jumps(record, full, truth, f"{drive}.effort") for drive in scene.drives
             if known and f"{drive}.effort" in trajectory]
    tables = {
        "errors": column_errors(table, trajectory, truth, scene) if known else pd.DataFrame(),
        "summary": pd.DataFrame([_summary(scene, table, replace(full, columns={**full.columns, **derived}), truth)]),
        "stick-phases": pd.DataFrame([row for name in scene.frictional_guides if known
                                      for row in _stick_phases(scene, full, truth, name)], columns=PHASE),
        "jumps": pd.concat(jumps, ignore_index=True) if jumps else pd.DataFrame(),
        "findings": pd.DataFrame({"finding": list(_findings(scene, full, set(trajectory.columns)))}, dtype=object)}
    return Judgement(scene, table, truth, tables, full)


def _remembering(columns: Columns) -> Columns:
    """Keep what was found: that of our own run is integrated at each call, and every column asks for the same times."""
    known: dict[tuple[bytes, str], dict[str, np.ndarray]] = {}

    def found(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        key = t.tobytes(), side
        if key not in known:
            known[key] = columns(t, side)
        return known[key]

    return found


def _within(table: ResultTable, t_end: float) -> ResultTable:
    """The rows until the end; what rounding adds to the last one is taken off, and angles within a turn go on."""
    kept = table.t <= t_end * (1 + 1e-9)
    if np.count_nonzero(kept) < 2:
        raise InputError(f"{table.origin}: found times from {table.t[0]:g} s on; "
                         f"expected two rows within 0 .. {t_end:g} s")
    t = np.clip(table.t[kept], 0.0, t_end)
    columns = {name: values[kept] for name, values in table.columns.items()}
    wrapped = [name for name in columns if name.endswith(".angle") and np.ptp(columns[name]) <= TURN * (1 + 1e-6)]
    return replace(table, t=t, columns=columns | {name: np.unwrap(columns[name]) for name in wrapped})


def trajectory_of(scene: Scene, table: ResultTable, truth: Truth) -> Trajectory:
    """Return the table with one row per instant; instants within with two rows are events.

    An event is a change of a guide's mode; without one it is what the truth has at the nearest event.
    """
    first, last = table.first, table.last
    inner = np.flatnonzero((first < last) & (first > 0) & (last < len(table.t) - 1))
    sides = [rows_of({name: values[rows[inner]] for name, values in table.columns.items()}) for rows in (first, last)]
    events = [Event(float(table.t[first[i]]), kind, guide, before, after) for i, before, after in zip(inner, *sides)
              for kind, guide in _kinds(scene, truth, float(table.t[first[i]]), before, after)]
    rows = np.delete(last, inner)
    return Trajectory(scene.name, "table", "", "joint", table.t[rows],
                      {name: values[rows] for name, values in table.columns.items()}, tuple(events), mechanism=scene)


def _kinds(scene: Scene, truth: Truth, time: float, before: Mapping[str, float],
           after: Mapping[str, float]) -> list[tuple[str, str]]:
    """Kinds and guides of the events of one instant."""
    modes = {guide: (before.get(f"{guide}.mode"), after.get(f"{guide}.mode")) for guide in scene.frictional_guides}
    changed = [(kind, guide) for guide, (old, new) in modes.items() if old != new
               for kind, fits in coherence.MODES.items() if fits(old, new)]
    nearest = min((abs(event.time - time) for event in truth.events), default=np.inf)
    near = [(event.kind, event.joint) for event in truth.events
            if nearest <= EVENT_WINDOW and abs(event.time - time) <= nearest + 1e-9 * truth.t_end]
    return changed or near or [("unknown", "")]


def _has(columns: Mapping[str, Any] | set[str], scene: Scene, *labels: tuple[str, ...]) -> bool:
    """Test if all bodies have these columns."""
    return all(f"{body}.{label}" in columns for body in scene.bodies for kind in labels for label in kind)


def _derived(scene: Scene, found: Trajectory) -> dict[str, np.ndarray]:
    """Displacements, slip velocities and drift that follow from what is given: from the states of all bodies.

    Without velocities a slip velocity is the difference quotient of displacements.
    """
    if not _has(found.columns, scene, POSITIONS):
        return _rates(scene, found.t, found.columns)
    moves = _has(found.columns, scene, VELOCITIES)
    mechanism = Mechanism(scene, stabilization="none")
    q = np.ascontiguousarray(stacked(found.columns, mechanism.body_names, POSITIONS))
    v = np.ascontiguousarray(stacked(found.columns, mechanism.body_names, VELOCITIES)) if moves else np.zeros_like(q)
    force = np.zeros((len(found.t), len(mechanism.row_names) + len(mechanism.guide_names)))
    names = [f"{guide}.{label}" for guide in scene.guides for label in ("displacement", "slip_velocity")]
    columns = build_columns(mechanism, found.t, q, v, np.zeros_like(q), force, None,
                            [*names, "drift.position", "drift.velocity"])
    if not moves:
        columns |= {**_rates(scene, found.t, columns), "drift.velocity": np.full(len(found.t), np.nan)}
    return columns


def _rates(scene: Scene, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {f"{guide}.slip_velocity": np.gradient(columns[f"{guide}.displacement"], t) for guide in scene.guides
            if f"{guide}.displacement" in columns}


def _step(found: Trajectory) -> float:
    return float(np.median(np.diff(found.t)))


def _summary(scene: Scene, table: ResultTable, full: Trajectory, truth: Truth) -> dict[str, Any]:
    """Sampling, errors of all columns together, drift, energy."""
    row: dict[str, Any] = {
        "rows": len(table.t), "instants": len(table.first), "instants with two sides": len(full.events),
        "begins at [s]": float(table.t[0]), "ends at [s]": float(table.t[-1]), "t_end [s]": scene.t_end,
        "sample distance [s]": _step(full), **errors(full, truth, size_of(scene))}
    if "drift.position" in full and "drift.velocity" in full:
        row |= {name: value for name, value in drift(full).items() if name != "truth tier"}
    if all(name in table for name in needed_columns(scene)):
        energy = energy_balance(scene, table.t, table.columns)
        row |= {"energy error [J]": energy.left_over.value, "energy uncertainty [J]": energy.left_over.uncertainty,
                "energy exchanged [J]": energy.exchanged}
    return row


def _stick_phases(scene: Scene, full: Trajectory, truth: Truth, guide: str) -> Iterator[dict[str, Any]]:
    """Stick phases of the truth as far as the table goes, and rests of the table where the truth slips."""
    true, slip, known = truth(full.t), f"{guide}.slip_velocity", f"{guide}.mode"
    if slip not in true or (slip not in full and known not in full):
        return
    true_speed = np.abs(true[slip])
    slow = STILL * max(float(np.max(true_speed)), ROUNDED * size_of(scene) / scene.t_end)
    rests = full[known] == 0 if known in full else np.abs(full[slip]) <= slow
    slips = true_speed > 2 * slow
    starts_at_rest = bool(truth(0.0).get(f"{guide}.mode", np.ones(1))[0] == 0)
    own = [event for event in truth.events if event.joint == guide]
    for begin, end in stick_intervals(own, 0.0, truth.t_end, starts_at_rest):
        if begin < full.t[0] or end > full.t[-1]:  # cut
            begin, end = max(begin, float(full.t[0])), min(end, float(full.t[-1]))
            if np.count_nonzero((full.t >= begin) & (full.t <= end)) < RESOLVED:
                continue
        inside = np.flatnonzero((full.t >= begin) & (full.t <= end))
        inner = inside[1:-1]
        verdict = UNRESOLVED if len(inside) < RESOLVED else FOUND if rests[inner].all() else MISSED
        fastest = float(np.max(np.abs(full[slip][inner]))) if slip in full and len(inner) else None
        yield dict(zip(PHASE, (guide, begin, end, end - begin, len(inside), verdict, fastest)))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rests & slips, [False]]).astype(int)))
    for first, behind in edges.reshape(-1, 2):
        if behind - first >= RESOLVED:
            begin, end = float(full.t[first]), float(full.t[behind - 1])
            yield dict(zip(PHASE, (guide, begin, end, end - begin, int(behind - first), INVENTED)))


def _jumps(record: Record, full: Trajectory, truth: Truth, effort: str) -> pd.DataFrame:
    """Jumps of an effort within the table; ``readable`` are those that its samples, or its two sides, can show."""
    table = torque_table([record], {record.key: truth}, effort)
    if "event time [s]" not in table:
        return pd.DataFrame()
    table = table[table["event time [s]"].between(full.t[0], full.t[-1])]
    times = np.array([event.time for event in truth.events])
    room = [np.min(np.abs(times[times != time] - time), initial=truth.t_end) for time in table["event time [s]"]]
    return table.assign(readable=bool(full.events) | (np.array(room) > (SAMPLES + 1) * _step(full)))


def _findings(scene: Scene, full: Trajectory, given: set[str]) -> Iterator[str]:
    """What the gate finds of the columns that are given: the first fault of each of its checks."""
    states = _has(given, scene, POSITIONS, VELOCITIES)
    forces = {name for name in columns_of(scene) if unit_of(name, scene) in ("N", "N m")} <= given
    checks: dict[Predicate, bool] = {
        coherence.start: states and full.t[0] == 0, coherence.residuals: states, coherence.velocities: states,
        coherence.displacements: states, coherence.balance: states and forces and _has(given, scene, ACCELERATIONS),
        coherence.corner_forces: forces, coherence.modes: True, coherence.unreported_events: states,
        coherence.cone: states and forces, coherence.continuity: states}
    columns = dict(full.columns)
    if states:
        for body in scene.bodies:
            for rate, second in zip(VELOCITIES, ACCELERATIONS):  # of which the check of velocities takes the size
                columns.setdefault(f"{body}.{second}", np.gradient(columns[f"{body}.{rate}"], full.t))
    settings = {} if full.events else {"dt": _step(full)}
    run = Examined(replace(full, columns=columns, settings=settings), scene, float(full.t[-1]), None, _step(full),
                   "joint", lambda _: bool(full.events), lambda _: True)
    for check, applies in checks.items():
        if applies and (finding := next(check(run), None)):
            yield finding
