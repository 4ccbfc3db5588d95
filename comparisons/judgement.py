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

from stiction.comparisons.judgement_in_words import FOUND, INVENTED, MISSED, UNRESOLVED, presentation
from stiction.comparisons.measures.accuracy import EVENT_WINDOW, errors, size_of
from stiction.comparisons.measures.drift import drift
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
from stiction.engines.examined import ACCELERATIONS, POSITIONS, VELOCITIES, Examined, Predicate, changed_modes
from stiction.engines.isolation import Outcome
from stiction.reference_impl.energies import needed_columns, unaccounted_energy
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.trajectory_columns import build_columns
from stiction.scenes import Event, InputError, Scene, Trajectory, load_scene, vary
from stiction.scenes.columns import columns_of, unit_of
from stiction.scenes.result_table import ResultTable, result_table
from stiction.scenes.trajectory import stacked

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
        errors = self.in_metres("error")
        return None if errors.isna().all() else float(errors.max())

    @property
    def uncertainty(self) -> float | None:
        """Uncertainty of the truth of those positions, m."""
        unsure = self.in_metres("uncertainty")
        return None if unsure.isna().all() else float(unsure.max())

    def in_metres(self, column: str) -> pd.Series:
        """Return a column of ``errors``, angles times the size of the mechanism; nan for what is no position."""
        table = self.tables["errors"]
        return table[column] * table["unit"].map({"m": 1.0, "rad": size_of(self.scene)})

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
        return {str(cause): list(rows["column"]) for cause, rows in table.groupby("hint", sort=False) if cause}

    @property
    def is_misread(self) -> bool:
        """True where columns seem to have other units, signs or origins than the scene: the numbers mean little."""
        return bool(self.tables["errors"]["is input"].any())

    @cached_property
    def presentation(self) -> Presentation:
        """The same in words, tables and figures."""
        return presentation(self)

    def __str__(self) -> str:
        said = self.presentation
        return "\n".join(part.text for part in (said.answer, *said.findings))


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
    if not isinstance(scene, Scene):
        scene, truth = read_truth(Path(scene)) if is_truth_folder(scene) else (load_scene(scene), None)
    if t_end is not None:
        if truth is not None and t_end > truth.t_end:
            raise InputError(f"t_end: found {t_end:g} s; expected at most {truth.t_end:g} s, the end of the truth in "
                             "the folder")
        scene = vary(scene, {"t_end": t_end})
    if isinstance(frame, Trajectory):
        frame = frame.to_frame(events=True)
    return judged(scene, result_table(frame, scene, mapping, units), truth or ground_truth(scene))


def judged(scene: Scene, table: ResultTable, truth: Truth) -> Judgement:
    """Judge a table by a truth of the scene."""
    table = _within(table, min(scene.t_end, truth.t_end))
    truth = replace(truth, columns=_remembering(truth.columns))
    trajectory = trajectory_of(scene, table, truth)
    derived = _derived(scene, trajectory)
    full = replace(trajectory, columns={**derived, **trajectory.columns})
    known = truth.tier != NO_TRUTH
    jumps = [_jumps(full, truth, f"{drive}.effort") for drive in scene.drives
             if known and f"{drive}.effort" in trajectory]
    tables = {
        "errors": column_errors(table, trajectory, truth, scene),
        "summary": pd.DataFrame([_summary(scene, table, replace(full, columns={**full.columns, **derived}), truth)]),
        "stick-phases": pd.DataFrame([row for name in scene.frictional_guides if known
                                      for row in _stick_phases(scene, full, truth, name)], columns=PHASE),
        "jumps": pd.concat([pd.DataFrame(columns=["effort"]), *jumps], ignore_index=True),
        "findings": pd.DataFrame({"finding": list(_findings(scene, full, set(trajectory.columns)))}, dtype=object)}
    return Judgement(scene, table, truth, tables, full)


def _remembering(columns: Columns) -> Columns:
    """Keep what was found: that of our own run is integrated at each call, and every column asks for the same times."""
    known: dict[tuple[bytes, str], dict[str, np.ndarray]] = {}

    def found(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        if (key := (t.tobytes(), side)) not in known:
            known[key] = columns(t, side)
        return known[key]

    return found


def _within(table: ResultTable, t_end: float) -> ResultTable:
    """The rows until the end; what rounding adds to the last one is taken off, and angles within a turn go on."""
    kept = table.t <= t_end * (1 + 1e-9)
    if np.count_nonzero(kept) < 2:
        raise InputError(f"{table.origin}: found times from {table.t[0]:g} s on; "
                         f"expected two rows within 0 .. {t_end:g} s")
    columns = {name: values[kept] for name, values in table.columns.items()}
    wrapped = [name for name in columns if name.endswith(".angle") and np.ptp(columns[name]) <= TURN * (1 + 1e-6)]
    return replace(table, t=np.clip(table.t[kept], 0.0, t_end),
                   columns=columns | {name: np.unwrap(columns[name]) for name in wrapped})


def trajectory_of(scene: Scene, table: ResultTable, truth: Truth) -> Trajectory:
    """Return the table with one row per instant; instants within with two rows are events.

    An event is a change of a guide's mode; without one it is what the truth has at the nearest event.
    """
    t, guides = table.t, scene.frictional_guides
    events = [Event(time, kind, guide, before, after) for time, before, after in table.jumps(table.columns)
              if t[0] < time < t[-1]
              for kind, guide in [*changed_modes(guides, before, after)] or _nearest(truth, time)]
    jumps = (table.first < table.last) & (t[table.last] > t[0]) & (t[table.last] < t[-1])
    rows = table.last[~jumps]
    return Trajectory(scene.name, "table", "", "joint", t[rows],
                      {name: values[rows] for name, values in table.columns.items()}, tuple(events), mechanism=scene)


def _nearest(truth: Truth, time: float) -> list[tuple[str, str]]:
    """Kinds and guides of the true events nearest to an instant."""
    off = [abs(event.time - time) for event in truth.events]
    near = min(off, default=np.inf)
    return [(event.kind, event.joint) for event, one in zip(truth.events, off)
            if near <= EVENT_WINDOW and one <= near + 1e-9 * truth.t_end] or [("unknown", "")]


def _has(columns: Mapping[str, Any] | set[str], scene: Scene, *labels: tuple[str, ...]) -> bool:
    """Test if all bodies have these columns."""
    return all(f"{body}.{label}" in columns for body in scene.bodies for kind in labels for label in kind)


def _derived(scene: Scene, found: Trajectory) -> dict[str, np.ndarray]:
    """Displacements, slip velocities and drift that follow from what is given: from the states of all bodies.

    Without velocities a slip velocity is the difference quotient of displacements.
    """
    columns: dict[str, np.ndarray] = {}
    moves = _has(found.columns, scene, VELOCITIES)
    if _has(found.columns, scene, POSITIONS):
        mechanism = Mechanism(scene, stabilization="none")
        q = np.ascontiguousarray(stacked(found.columns, mechanism.body_names, POSITIONS))
        v = stacked(found.columns, mechanism.body_names, VELOCITIES) if moves else np.zeros_like(q)
        force = np.zeros((len(found.t), len(mechanism.row_names) + len(mechanism.guide_names)))
        names = [f"{guide}.{label}" for guide in scene.guides for label in ("displacement", "slip_velocity")]
        columns = build_columns(mechanism, found.t, q, np.ascontiguousarray(v), np.zeros_like(q), force, None,
                                [*names, "drift.position", "drift.velocity"])
        if moves:
            return columns
        columns["drift.velocity"] = np.full(len(found.t), np.nan)
    way = {**found.columns, **columns}
    return columns | {f"{guide}.slip_velocity": np.gradient(way[f"{guide}.displacement"], found.t)
                      for guide in scene.guides if f"{guide}.displacement" in way}


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
    if all(name in table.columns for name in needed_columns(scene)):
        row |= zip(("energy error [J]", "energy uncertainty [J]", "energy exchanged [J]"),
                   unaccounted_energy(scene, table.t, table.columns))
    return row


def _stick_phases(scene: Scene, full: Trajectory, truth: Truth, guide: str) -> Iterator[dict[str, Any]]:
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
        fastest = float(np.max(np.abs(full[slip][inner]))) if slip in full and len(inner) else None
        yield dict(zip(PHASE, (guide, begin, end, end - begin, len(inside), verdict, fastest)))
    wrong = np.concatenate([[False], rests & (true_speed > 2 * slow), [False]])
    for first, behind in np.flatnonzero(np.diff(wrong.astype(int))).reshape(-1, 2):
        if behind - first >= RESOLVED:
            begin, end = float(t[first]), float(t[behind - 1])
            yield dict(zip(PHASE, (guide, begin, end, end - begin, int(behind - first), INVENTED)))


def _jumps(full: Trajectory, truth: Truth, effort: str) -> pd.DataFrame:
    """Jumps of an effort within the table; ``readable`` are those that its samples, or its two sides, can show."""
    record = Record("table", full.scene, Variant("table", "table", "dt", (_step(full),)), _step(full),
                    Outcome("table", "ok", full))
    table = torque_table([record], {record.key: truth}, effort)
    if "event time [s]" not in table:
        return pd.DataFrame()
    table = table[table["event time [s]"].between(full.t[0], full.t[-1])]
    times = np.array([event.time for event in truth.events])
    room = [np.min(np.abs(times[times != time] - time), initial=truth.t_end) for time in table["event time [s]"]]
    return table.assign(readable=bool(full.events) | (np.array(room) > (min(SAMPLES) + 1) * _step(full)))


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
    found = replace(full, columns=columns, settings={} if full.events else {"dt": _step(full)})
    run = Examined(found, scene, float(full.t[-1]), None, _step(full), "joint",
                   lambda _: bool(full.events), lambda _: True)
    for check, applies in checks.items():
        if applies and (finding := next(check(run), None)):
            yield finding
