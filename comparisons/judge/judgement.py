"""Judgement of a table of results of any program: errors against the truth of a scene, and other findings.

The measures are the same as in comparisons of engines. Positions alone are enough; every other column of the table is
judged as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.judge.consistency import inconsistencies
from stiction.comparisons.judge.prescribed_coordinates import prescribed
from stiction.comparisons.judge.table_trajectory import derived_columns, rows_until, trajectory_of
from stiction.comparisons.judge.truth_cache import CachedColumns
from stiction.comparisons.judge.truth_folder import is_truth_folder, read_truth
from stiction.comparisons.measures.accuracy import errors, size_of
from stiction.comparisons.measures.completed_motion import Completion, energy_of_motion
from stiction.comparisons.measures.drift import drift
from stiction.comparisons.measures.other_parameters import COLUMNS as OTHER
from stiction.comparisons.measures.other_parameters import explanations
from stiction.comparisons.measures.result_errors import column_errors
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.measures.steady_stretch import stick_intervals
from stiction.comparisons.measures.torque_jumps import SAMPLES_PER_SIDE, jump_rows
from stiction.engines.examined import POSITIONS, RESIDUALS
from stiction.reference_impl.energies import needed_columns, unaccounted_energy
from stiction.scenes import InputError, Scene, Trajectory, load_scene, vary
from stiction.scenes.column_file import JoinedColumns, TransformedColumns
from stiction.scenes.result_table import ResultTable, result_table
from stiction.truths import Tier, Truth

LARGEST_GAP = 0.1
"""Largest interval between two rows for which a table covers the run, as a fraction of the time of the scene."""
STILL = 1e-3
"""Slip speed below which a sample is at rest, as a fraction of the largest slip speed of the truth."""
ROUNDED = 1e-6
"""Slip speed that is rounding, in units of the mechanism's size over the time of the scene."""
RESOLVED = 3
"""Least number of samples in a stick phase that can be judged: the first and the last may belong to its ends."""
SOLVED = 2**14
"""Largest number of instants at which a truth is computed in one call: truths keep the columns of their last call."""
RUN = 2**18
"""The same for a truth that is our own run, which is integrated anew at each call."""
READING = 0.2
"""Fraction of the time that reading a long table takes, for reports of progress."""
COMPARING = 0.5
"""Fraction of the time that comparing it with the truth takes."""
FOUND = "found"
"""Verdict on a stick phase of the truth in which all inner samples are at rest."""
MISSED = "missed"
"""Verdict on a stick phase of the truth in which an inner sample slips."""
UNRESOLVED = "too short for the samples"
"""Verdict on a stick phase of the truth with fewer than `RESOLVED` samples."""
INVENTED = "the truth slips"
"""Verdict on an interval in which the table is at rest and the truth is not."""
PHASE = ["guide", "begin", "end", "duration", "samples", "verdict", "fastest_slip"]
"""Columns of the table of stick phases."""


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
        step = (1 + 1e-6) * min(sample_distance(t), LARGEST_GAP * end)
        return bool(t[0] <= step and t[-1] + step >= end)

    @property
    def widest_gap(self) -> float:
        """Longest interval between two consecutive instants of the table, s."""
        return float(np.max(np.diff(self.trajectory.t)))

    @property
    def is_covered(self) -> bool:
        """Whether no interval between consecutive instants exceeds a tenth of the scene's time."""
        return self.widest_gap <= LARGEST_GAP * self.scene.t_end * (1 + 1e-6)

    @cached_property
    def held(self) -> tuple[str, ...]:
        """The judged position columns that drives and joints prescribe, whatever forces act.

        Empty if they prescribe the whole motion, because positions are then the only thing that can be wrong.
        """
        return tuple(sorted(self._judged_positions & prescribed(self.scene, self.truth)))

    @property
    def says_nothing(self) -> bool:
        """Whether all judged positions are in `held`, so that the table shows nothing about the solver."""
        return self._judged_positions <= set(self.held)

    @property
    def _judged_positions(self) -> set[str]:
        """Names of the columns of positions and angles whose error is known."""
        is_judged = self.in_metres("error").notna()
        return set(self.tables["errors"].loc[is_judged, "column"])

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

    def __repr__(self) -> str:
        """Return the names of the table and of the scene with the error, as an interactive session shows them."""
        error = "unknown" if self.error is None else f"{self.error:.3g} m"
        return f"Judgement({self.table.origin!r} on {self.scene.name!r}, error: {error})"

    def __str__(self) -> str:
        """Return the largest error of each kind, the summary, what explains the errors, and the findings as text."""
        title = f"{self.table.origin} on {self.scene.name}; truth: {self.truth.tier.label}"
        # Each number is formatted by itself: in a format for all, the small ones would vanish.
        summary = {
            name: f"{value:.6g}" if isinstance(value, float) else str(value)
            for name, value in self._numbers().items()
        }
        parts = [title, pd.Series(summary).to_frame().to_string(header=False)]
        tried = self.tables["other-parameters"]
        is_named = tried["named"].astype(bool)
        sections = {
            "largest errors": self.worst[
                ["column", "error", "uncertainty", "unit", "error_time", "hint"]
            ],
            "errors explained by": tried.loc[is_named, ["hypothesis", "value"]],
            "faults": self.tables["findings"],
        }
        for name, section in sections.items():
            if len(section):
                parts.append(f"{name}\n{section.to_string(index=False)}")
        return "\n\n".join(parts)

    def _numbers(self) -> dict[str, Any]:
        """Return the numbers of the summary that are known, and counts of stick phases and jumps."""
        summary = self.tables["summary"].loc[0].dropna()
        numbers = dict(summary[summary != ""])
        for verdict, phases in self.tables["stick-phases"].groupby("verdict", sort=False):
            numbers[f"stick phases, {verdict}"] = len(phases)
        jumps = self.tables["jumps"]
        if len(jumps):
            numbers["jumps, read"] = f"{jumps['resolved'].sum()} of {len(jumps)}"
        return numbers


def judge(
    scene: Scene | str | Path,
    frame: Any,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, float] | None = None,
    t_end: float | None = None,
    tell: Callable[[float], None] | None = None,
    rest_speed: float | None = None,
    has_map_option: bool = True,
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
    rest_speed
        Slip speed up to which a joint is at rest, m/s (pins: rad/s); a fraction (`STILL`) of the largest one of each
        joint if None.
    has_map_option
        Whether messages may refer to the option ``--map``.

    Returns
    -------
    Judgement
        Errors of all columns, and other findings.

    Raises
    ------
    InputError
        If the scene cannot be used, or if the table cannot be a result of this scene.
    """
    progress = _Progress(tell)
    loaded, truth = _scene_and_truth(scene, t_end)

    # Read the table, and cut it off at the end of the run.
    if isinstance(frame, Trajectory):
        frame = frame.to_frame(events=True, interpolated=True)
    table = result_table(
        frame,
        loaded,
        mapping,
        units,
        has_map_option=has_map_option,
        spills=True,
        tell=progress.stage(0.0, READING),
    )
    if truth is None:
        truth = ground_truth(loaded)
    table = rows_until(table, loaded, min(loaded.t_end, truth.t_end))

    # All measures share the truth at the instants of the table, and what follows from its columns.
    truth = replace(
        truth, columns=_cached_columns(loaded, table, truth, progress.stage(READING, COMPARING))
    )
    given = trajectory_of(loaded, table, truth)
    derived = derived_columns(loaded, given, truth)
    run = replace(given, columns=JoinedColumns(given.columns, derived))

    # Measure the errors first: they tell whether the table must be read in another way.
    errors_table = column_errors(table, given, truth, loaded)
    progress.advance(READING + COMPARING)
    is_explained = bool((errors_table["hint"] != "").any())
    # In the summary, a computed column takes precedence over that of the table.
    recomputed = replace(run, columns=JoinedColumns(derived, run.columns))
    step = sample_distance(run.t)
    tables = {
        "errors": errors_table,
        "summary": pd.DataFrame([_summary(loaded, table, recomputed, truth)]),
        "stick-phases": _stick_phase_table(loaded, run, truth, rest_speed),
        "other-parameters": _other_parameters_table(loaded, table, truth, is_explained),
        "jumps": _jump_table(loaded, run, truth),
        "findings": pd.DataFrame(
            {"finding": list(inconsistencies(loaded, run, given.columns, step))}, dtype=object
        ),
    }
    judgement = Judgement(loaded, table, truth, tables, run)
    progress.advance(1.0)
    return judgement


class _Progress:
    """Reports the completed fraction of the work, which never decreases although the truth is computed repeatedly."""

    def __init__(self, report: Callable[[float], None] | None):
        self._report = report
        self._reported = 0.0

    def advance(self, fraction: float) -> None:
        """Report a fraction, unless an equal or larger one has been reported."""
        if self._report is not None and fraction > self._reported:
            self._reported = fraction
            self._report(fraction)

    def stage(self, begin: float, length: float) -> Callable[[float], None]:
        """Return a function that takes the completed fraction of a stage of the work, which begins at `begin`."""
        return lambda fraction: self.advance(begin + length * fraction)


def _scene_and_truth(scene: Scene | str | Path, t_end: float | None) -> tuple[Scene, Truth | None]:
    """Return the scene that is meant, until `t_end` (s), and its truth if the scene is the folder of a truth."""
    truth = None
    if isinstance(scene, Scene):
        loaded = scene
    elif is_truth_folder(scene):
        loaded, truth = read_truth(Path(scene))
    else:
        loaded = load_scene(scene)
    if t_end is None:
        return loaded, truth
    if truth is not None and t_end > truth.t_end:
        raise InputError(
            f"t_end: found {t_end:g} s; expected at most {truth.t_end:g} s, the end of the truth in "
            "the folder"
        )
    return vary(loaded, {"t_end": t_end}), truth


def _cached_columns(
    scene: Scene, table: ResultTable, truth: Truth, report: Callable[[float], None]
) -> CachedColumns:
    """Return the columns of a truth that the measures need, which are computed once for each set of instants."""
    slipping_joints = {**scene.guides, **scene.bounded_elements}
    names = {
        *table.columns,
        *(f"{body}.{label}" for body in scene.bodies for label in POSITIONS),
        *(f"{joint}.slip_velocity" for joint in slipping_joints),
        *(f"{joint}.mode" for joint in slipping_joints),
    }
    max_instants = RUN if truth.tier == Tier.OWN_RUN else SOLVED
    return CachedColumns(truth.columns, names, max_instants, report)


def sample_distance(t: np.ndarray) -> float:
    """Return the median distance of consecutive times, s."""
    return float(np.median(np.diff(t)))


def _summary(scene: Scene, table: ResultTable, run: Trajectory, truth: Truth) -> dict[str, Any]:
    """Return a row with the sampling, the errors of all columns together, the drift and the energy balance."""
    row: dict[str, Any] = {
        "two_sided_instants": len(run.events),
        "table_begin": float(table.t[0]),
        "table_end": float(table.t[-1]),
        "t_end": scene.t_end,
        "sample_distance": sample_distance(run.t),
    }
    if all(name in run for name in RESIDUALS):
        row |= drift(run)
    row |= errors(run, truth, size_of(scene))
    row |= _energy(scene, table, truth)
    return row


def _energy(scene: Scene, table: ResultTable, truth: Truth) -> dict[str, float]:
    """Return the energy (J) that a table does not account for, its uncertainty, and the energy exchanged.

    If columns are missing, the balance is that of the completed motion (`energy_of_motion`), under names of its own.
    The result is empty if the columns do not determine the motion.
    """
    if all(name in table.columns for name in needed_columns(scene)):
        error, uncertainty, exchanged = unaccounted_energy(scene, table.t, table.columns)
        return {
            "energy_error": error,
            "energy_uncertainty": uncertainty,
            "energy_exchanged": exchanged,
        }
    # A completed motion has one row per instant: the one after an event.
    rows = table.rows_after
    columns = table.columns
    if len(rows) < len(table.t):
        columns = TransformedColumns(table.columns, lambda name, values: values[rows])
    completion = Completion.of(scene, columns, truth)
    if completion is None:
        return {}
    balance = energy_of_motion(completion, table.t[rows], columns)
    if balance is None:
        return {}
    error, uncertainty, exchanged = balance
    return {
        "completed_energy_error": error,
        "completed_energy_uncertainty": uncertainty,
        "completed_energy_exchanged": exchanged,
    }


def _other_parameters_table(
    scene: Scene, table: ResultTable, truth: Truth, is_explained: bool
) -> pd.DataFrame:
    """Return one row per hypothesis about parameters with which the table may have been computed.

    Nothing is tested without a truth, or if the errors are explained by units, signs or a shift by a row.
    """
    tested = []
    if truth.tier != Tier.NONE and not is_explained:
        tested = explanations(scene, table, truth)
    return pd.DataFrame([explanation.row() for explanation in tested], columns=OTHER)


def _stick_phase_table(
    scene: Scene, run: Trajectory, truth: Truth, rest_speed: float | None
) -> pd.DataFrame:
    """Return the stick phases of the truth that the table covers, and those of the table where the truth slips.

    There is one row per phase, with the columns `PHASE`; none without a truth. `rest_speed` as in `judge`.
    """
    phases: list[dict[str, Any]] = []
    if truth.tier != Tier.NONE:
        for joint in scene.frictional_joints:
            phases += _stick_phases(scene, run, truth, joint, rest_speed)
    return pd.DataFrame(phases, columns=PHASE)


def _stick_phases(
    scene: Scene, run: Trajectory, truth: Truth, guide: str, rest_speed: float | None
) -> Iterator[dict[str, Any]]:
    """Yield the stick phases of a guide, if the table contains its slip velocity or its mode."""
    slip, mode = f"{guide}.slip_velocity", f"{guide}.mode"
    true = truth(run.t)
    if slip not in true or (slip not in run and mode not in run):
        return
    # If the slider always rests in the truth, its largest slip speed is no measure of rest.
    true_speed = np.abs(true[slip])
    rounding = ROUNDED * size_of(scene) / scene.t_end
    speed_limit = STILL * max(float(np.max(true_speed)), rounding)
    if rest_speed is not None:
        speed_limit = rest_speed
    if mode in run:
        is_at_rest = run[mode] == 0
    else:
        is_at_rest = np.abs(run[slip]) <= speed_limit
    yield from _true_stick_phases(run, truth, guide, is_at_rest)
    yield from _invented_stick_phases(run.t, guide, is_at_rest & (true_speed > 2 * speed_limit))


def _true_stick_phases(
    run: Trajectory, truth: Truth, guide: str, is_at_rest: np.ndarray
) -> Iterator[dict[str, Any]]:
    """Yield the stick phases of the truth; `is_at_rest`, shape (n,), tells of each row whether the slider rests."""
    t, slip, mode = run.t, f"{guide}.slip_velocity", f"{guide}.mode"
    initial = truth(0.0)
    starts_at_rest = mode in initial and bool(initial[mode][0] == 0)
    events = [event for event in truth.events if event.joint == guide]
    for true_begin, true_end in stick_intervals(events, 0.0, truth.t_end, starts_at_rest):
        begin = max(true_begin, float(t[0]))
        end = min(true_end, float(t[-1]))
        samples = np.flatnonzero((t >= begin) & (t <= end))
        is_cut = (begin, end) != (true_begin, true_end)
        if is_cut and len(samples) < RESOLVED:
            continue
        # The first and the last sample may belong to the slip before and after the phase.
        inner = samples[1:-1]
        if len(samples) < RESOLVED:
            verdict = UNRESOLVED
        elif is_at_rest[inner].all():
            verdict = FOUND
        else:
            verdict = MISSED
        fastest_slip = np.nan
        if slip in run and len(inner):
            fastest_slip = float(np.max(np.abs(run[slip][inner])))
        yield {
            "guide": guide,
            "begin": begin,
            "end": end,
            "duration": end - begin,
            "samples": len(samples),
            "verdict": verdict,
            "fastest_slip": fastest_slip,
        }


def _invented_stick_phases(
    t: np.ndarray, guide: str, is_invented: np.ndarray
) -> Iterator[dict[str, Any]]:
    """Yield each interval of at least `RESOLVED` rows at rest while the truth slips; `is_invented` has shape (n,)."""
    # The difference of the padded flags is not 0 at the first row of each interval and behind its last.
    padded = np.concatenate([[False], is_invented, [False]])
    ends = np.flatnonzero(np.diff(padded.astype(int)))
    for first, behind in ends.reshape(-1, 2):
        if behind - first < RESOLVED:
            continue
        begin, end = float(t[first]), float(t[behind - 1])
        yield {
            "guide": guide,
            "begin": begin,
            "end": end,
            "duration": end - begin,
            "samples": int(behind - first),
            "verdict": INVENTED,
            "fastest_slip": np.nan,
        }


def _jump_table(scene: Scene, run: Trajectory, truth: Truth) -> pd.DataFrame:
    """Return the jumps of efforts within the time of the table, one row per jump of the truth."""
    rows = list(_jumps(scene, run, truth))
    return pd.DataFrame(rows if rows else {"effort": []})


def _jumps(scene: Scene, run: Trajectory, truth: Truth) -> Iterator[dict[str, Any]]:
    """Yield the jumps; ``readable`` ones are those that the samples, or the two rows of an instant, can show."""
    event_times = np.array([event.time for event in truth.events])
    # A jump is extrapolated from the samples on either side, among which there must be no other event.
    needed_distance = (min(SAMPLES_PER_SIDE) + 1) * sample_distance(run.t)
    for drive in scene.drives:
        effort = f"{drive}.effort"
        if effort not in run:
            continue
        for row in jump_rows(run, truth, effort):
            time = row["event_time"]
            if not run.t[0] <= time <= run.t[-1]:
                continue
            others = event_times[event_times != time]
            distance = np.min(np.abs(others - time), initial=truth.t_end)
            is_readable = bool(run.events) or bool(distance > needed_distance)
            yield {**row, "readable": is_readable}
