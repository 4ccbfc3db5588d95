"""Maps of a scene's parameters: one run of an engine per point of a grid, and the stick threshold along it.

Points are tasks of `stiction.engines.isolation`: one that crashes, or takes too long, is a row with its reason. Points
of the reference take milliseconds and share a task, a chunk; the points of a failed chunk are run again one by one.
Chunks that are done are kept as runs of `stiction validate` are (`stiction.comparisons.campaigns.checkpoint`), so that
an interrupted sweep goes on where it was.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from stiction.comparisons.atomic_files import make_folder, whole_file, write_text
from stiction.comparisons.campaigns.checkpoint import kept_runs
from stiction.comparisons.campaigns.comparison import TIME_LIMIT, prepare
from stiction.comparisons.digest import digest
from stiction.comparisons.environment import source_digest, versions
from stiction.comparisons.measures.settling import NoCommonPeriod, NotSettled, common_period
from stiction.comparisons.studies.steady_state_measures import (CONTRACTION, MEASURES, REPEATS, Measure, SteadyRun,
                                                                steady_window)
from stiction.comparisons.studies.stick_threshold import AMPLITUDE, WITH_STICK, WITHOUT_STICK, Search, measure_threshold
from stiction.engines.isolation import Isolate, Outcome, Task, isolate
from stiction.engines.protocol import Refused
from stiction.engines.registry import EngineMissing, load_engine
from stiction.reference_impl.multibody.initial_state import with_consistent_start
from stiction.scenes import InputError, Scene, SceneError, scene_to_toml, vary
from stiction.scenes.expressions import evaluate

THRESHOLD, THRESHOLD_COLUMN, WINDOW_START = "threshold", "threshold [N]", "window from [s]"
"""The measure that is a bisection and not a run, its column, and the column of the start of a run's window."""
SEARCH = (0.25, 4.0)
"""Multiples of the scene's own amplitude between which the threshold is searched if the amplitude is no axis; else from
end to end of the axis."""
BRACKET = 2.5e-3
"""Width of a threshold's bracket as a part of the range in which it is searched."""
PROBES = 9
"""Amplitudes from end to end of the search at which a stick phase is looked for before the bisection."""
NO_STEADY_STATE = "no steady state"
"""Status of a point whose motion neither rests nor repeats itself; it has no numbers."""
FAILURES = {NotSettled: NO_STEADY_STATE, NoCommonPeriod: NO_STEADY_STATE, SceneError: "refused", Refused: "refused",
            EngineMissing: "missing", Exception: "failed"}
USUAL_PERIODS = 30
"""Periods of loads and drives in a run without a given end: as many as a stick threshold takes at first."""
CHUNK = {THRESHOLD: 4, "map": 32}
"""Points of the reference in a chunk, by part, the slowest first: some tenths of a second."""
MAX_POINTS = 1_000_000
SPECIFICATION = "sweep.json"
"""File that makes a folder the folder of a sweep."""


class SweepRefused(InputError):
    """The folder holds something else than this sweep."""


@dataclass(frozen=True)
class Axis:
    """A value of the scene, by its key as in `vary`, and the values it takes."""

    key: str
    values: tuple[float, ...]


def parse_axis(text: str) -> Axis:
    """An axis of ``KEY=FROM:TO:COUNT`` (equal distances, both ends included) or ``KEY=A,B,..``, with arithmetic.

    Raises
    ------
    InputError
        If it is neither, values repeat, or COUNT is not a whole number of at least 2.
    """
    key, equals, given = (part.strip() for part in text.partition("="))
    if not (key and equals and given):
        raise InputError(f"axis: found {text!r}; expected KEY=FROM:TO:COUNT or KEY=A,B,.. such as F0=0.5:6:100")
    parts, numbers = given.split(":" if ":" in given else ","), []
    for part in parts:
        try:
            numbers.append(evaluate(part, {}))
        except InputError as error:
            raise InputError(f"axis {key}: found {part.strip()!r}; {error}") from None
    if ":" in given:
        if len(numbers) != 3:
            raise InputError(f"axis {key}: found {given!r}; expected FROM:TO:COUNT")
        low, high, count = numbers
        if count != int(count) or not 2 <= count <= MAX_POINTS:
            raise InputError(f"axis {key}: found {parts[2].strip()!r} values; expected a whole number from 2 to "
                             f"{MAX_POINTS}")
        numbers = np.linspace(low, high, int(count)).tolist()
    if len(set(numbers)) < len(numbers):
        raise InputError(f"axis {key}: found {given!r}; expected values that differ from each other")
    return Axis(key, tuple(numbers))


def usual_end(scene: Scene) -> float:
    """End of the runs of a sweep that does not say one, s: twice the scene's own, `USUAL_PERIODS` at least."""
    try:
        return max(2 * scene.t_end, USUAL_PERIODS * common_period(scene))
    except NoCommonPeriod:
        return 2 * scene.t_end


@dataclass(frozen=True)
class Chunk:
    """Points of consecutive indices of the map or of the threshold."""

    part: str
    indices: range


@dataclass(frozen=True)
class Specification:
    """The computation of a sweep.

    Attributes
    ----------
    axes : tuple of Axis
        The last one varies fastest.
    measures : tuple of str
        Of `MEASURES`, or ``"threshold"``: largest F0 with a stick phase, along the axes that are not F0.
    run : SteadyRun
        The run of each point.
    timeout_s : float
        Seconds that a point may take.

    Raises
    ------
    InputError
        If it cannot be computed at any point: unknown or repeated names, a measure that the scene has nothing for.
    SceneError
        If an axis has a key that the scene does not have, or only values that it cannot have.
    """

    scene: Scene
    axes: tuple[Axis, ...]
    measures: tuple[str, ...]
    run: SteadyRun
    timeout_s: float = TIME_LIMIT

    def __post_init__(self) -> None:
        known, scene = (*MEASURES, THRESHOLD), self.scene
        keys = [axis.key for axis in self.axes]
        if not keys or len(set(keys)) < len(keys):
            raise InputError(f"axes: found {', '.join(keys) or 'none'}; expected at least one, each key once")
        if self.size("map") > MAX_POINTS:
            raise InputError(f"axes: found more than {MAX_POINTS} points; expected fewer")
        if not self.measures or len(set(self.measures)) < len(self.measures) or not set(self.measures) <= set(known):
            found = ", ".join(self.measures) or "none"
            raise InputError(f"measures: found {found}; expected some of {', '.join(known)}")
        settle, t_end = self.run.settle, self.run.t_end
        if not 0 <= settle < t_end:
            raise InputError(f"settle, t_end: found {settle:g}, {t_end:g}; expected 0 <= settle < t_end, in seconds")
        engine, fidelity = load_engine(self.run.engine), self.run.fidelity
        if fidelity not in engine.capabilities.fidelities:
            has = " and ".join(engine.capabilities.fidelities)
            raise InputError(f"fidelity: found {fidelity!r}; {engine.name} has {has}")
        engine.check_arguments(dt=self.run.dt, rtol=None, fidelity=fidelity, settings={})
        for measure in self.run_measures:
            if measure.needs and not getattr(scene, measure.needs):
                needed = measure.needs.replace("_", " ")
                raise InputError(f"{measure.name}: found no {needed} in {scene.name}; expected one")
        if THRESHOLD in self.measures and not (scene.frictional_guides and AMPLITUDE in scene.parameters):
            raise InputError(f"{THRESHOLD}: expected a frictional guide and a parameter {AMPLITUDE} in {scene.name}")
        for axis in self.axes:
            self._check(axis)

    def _check(self, axis: Axis) -> None:
        """One value at least must give a scene; the points of others are rows with the reason."""
        problem: SceneError | None = None
        for value in axis.values:
            try:
                vary(self.scene, {axis.key: value})
                return
            except SceneError as error:
                problem = problem or error
        raise problem

    @property
    def run_measures(self) -> list[Measure]:
        """Those that are numbers of a run."""
        return [MEASURES[name] for name in self.measures if name != THRESHOLD]

    @property
    def parts(self) -> list[str]:
        """``"threshold"`` and ``"map"``, as far as measures require them."""
        return [part for part in CHUNK if (THRESHOLD in self.measures if part == THRESHOLD else self.run_measures)]

    def grid(self, part: str) -> tuple[Axis, ...]:
        """The axes of ``"map"`` or, without the amplitude, of ``"threshold"``."""
        return tuple(axis for axis in self.axes if part == "map" or axis.key != AMPLITUDE)

    def size(self, part: str) -> int:
        return math.prod(len(axis.values) for axis in self.grid(part))

    def point(self, part: str, index: int) -> dict[str, float]:
        """Values by key of a point of the grid."""
        axes = self.grid(part)
        places = np.unravel_index(index, [len(axis.values) for axis in axes]) if axes else ()
        return {axis.key: axis.values[place] for axis, place in zip(axes, places)}

    @cached_property
    def content(self) -> dict[str, Any]:
        """Everything that the numbers depend on, ready for JSON."""
        return {"code": source_digest(), "scene": scene_to_toml(self.scene),
                "axes": {axis.key: list(axis.values) for axis in self.axes},
                "measures": list(self.measures),
                "settings": {**asdict(self.run), "timeout": self.timeout_s},
                "versions": {**versions(), self.run.engine: load_engine(self.run.engine).version}}

    @cached_property
    def digest(self) -> str:
        return digest(self.content)

    def chunks(self, part: str) -> list[Chunk]:
        """All points of a part: one by one, or several where a run takes no longer than to begin it in a child."""
        size, count = self.size(part), CHUNK[part] if self.run.is_event_driven_reference else 1
        return [Chunk(part, range(first, min(first + count, size))) for first in range(0, size, count)]

    def task(self, chunk: Chunk) -> Task:
        """The rows of a chunk: axes, ``status``, ``reason`` and numbers; an exception of a point is its reason."""
        points = [self.point(chunk.part, index) for index in chunk.indices]
        label = f"{chunk.part} {chunk.indices[0]} .. {chunk.indices[-1]}"
        if chunk.part == "map":
            names = [measure.name for measure in self.run_measures]
            return Task(label, map_rows, (self.scene, self.run, names, points))
        amplitudes = [value for axis in self.axes if axis.key == AMPLITUDE for value in axis.values]
        search = (min(amplitudes), max(amplitudes)) if amplitudes else None
        return Task(label, threshold_rows, (self.scene, self.run, search, points))

    def table(self, part: str, rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
        """Rows as a table of the same columns and types whatever has failed in them."""
        keys, text = [axis.key for axis in self.grid(part)], ["status", "reason"]
        numbers = [WINDOW_START, *(measure.column for measure in self.run_measures)]
        if part == THRESHOLD:
            numbers = [THRESHOLD_COLUMN, WITH_STICK, WITHOUT_STICK]
        types = dict.fromkeys([*keys, *numbers], float) | dict.fromkeys(text, str)
        return pd.DataFrame(rows, columns=[*keys, *text, *numbers]).astype(types)


def map_rows(scene: Scene, run: SteadyRun, measures: Sequence[str],
             points: Sequence[Mapping[str, float]]) -> list[dict[str, Any]]:
    """Rows of points of the map, with the numbers of their runs."""
    chosen = [MEASURES[name] for name in measures]

    def numbers(point: Mapping[str, float]) -> dict[str, Any]:
        window = steady_window(vary(scene, point), run, chosen)
        return {WINDOW_START: window.start, **{measure.column: measure.value(window) for measure in chosen}}

    return [_row(point, numbers) for point in points]


def threshold_rows(scene: Scene, run: SteadyRun, search: tuple[float, float] | None,
                   points: Sequence[Mapping[str, float]]) -> list[dict[str, Any]]:
    """Rows of points of the threshold, searched between two amplitudes (N), or around the scene's own where None."""
    def numbers(point: Mapping[str, float]) -> dict[str, Any]:
        varied = vary(scene, point)
        low, high = search or sorted(factor * abs(varied.parameters[AMPLITUDE]) for factor in SEARCH)
        step = run.step(varied)
        accuracy = {"rtol": run.rtol} if step is None else {"dt": step}
        if run.is_event_driven_reference:
            given, arguments = varied, {**accuracy, "stabilization": "projection", "assemble": True}
        else:
            given, arguments = with_consistent_start(varied, assemble=True), {**accuracy, "fidelity": run.fidelity}
        distance = REPEATS * run.rtol
        found = measure_threshold(given, run.engine, arguments,
                                  Search(low, high, BRACKET * (high - low), probes=PROBES), distance,
                                  CONTRACTION * distance)
        if found.with_stick is None or found.without_stick is None:
            return {"status": "not found", "reason": found.remark}
        return {THRESHOLD_COLUMN: 0.5 * (found.with_stick + found.without_stick), WITH_STICK: found.with_stick,
                WITHOUT_STICK: found.without_stick}

    return [_row(point, numbers) for point in points]


def _row(point: Mapping[str, float], numbers: Callable[[Mapping[str, float]], dict[str, Any]]) -> dict[str, Any]:
    try:
        found = numbers(point)
    except Exception as error:  # whatever it is, it concerns this point alone, and its row says so
        found = {"status": next(status for kind, status in FAILURES.items() if isinstance(error, kind)),
                 "reason": " ".join(f"{type(error).__name__}: {error}".split())}
    return {**point, "status": "ok", "reason": "", **found}


@dataclass(frozen=True)
class Sweep:
    """Tables with one row per point, in the order of the grid; None where no measure requires one.

    `map`: axes, ``status``, ``reason``, ``window from [s]``, a column per measure. `threshold`: axes that are not F0,
    ``status``, ``reason``, the bracket of the threshold and its middle.
    """

    specification: Specification
    map: pd.DataFrame | None
    threshold: pd.DataFrame | None


def sweep(specification: Specification, folder: str | Path, *, workers: int | None = None, made_by: Isolate = isolate,
          on_start: Callable[[int], None] | None = None, on_result: Callable[[Outcome], None] | None = None) -> Sweep:
    """Compute the points that the folder does not hold yet.

    Parameters
    ----------
    folder
        Made if it does not exist; see `check_folder`.
    workers, made_by
        Tasks at a time, and their runner: see `stiction.comparisons.studies.executors.open_isolate`.
    on_start, on_result
        Called with the number of tasks, also when there are more of them, and with each outcome as it comes in.

    Raises
    ------
    SweepRefused
        If the folder belongs to something else.
    KeptRefused
        If another process computes this sweep.
    """
    folder, engine = Path(folder), specification.run.engine
    check_folder(specification, folder)
    make_folder(folder)
    write_text(folder / SPECIFICATION, json.dumps({"digest": specification.digest, **specification.content}, indent=1))
    tables = {part: _written(folder, part) for part in specification.parts}
    missing = [part for part, table in tables.items() if table is None]
    if missing:
        prepare([engine])
        total = 0
        with kept_runs(folder, [engine]) as kept:
            def outcomes(tasks: Sequence[Task]) -> list[Outcome]:
                nonlocal total
                total += len(tasks)
                if on_start is not None:
                    on_start(total)
                found = kept.isolate(tasks, workers=workers, timeout_s=specification.timeout_s, on_result=on_result,
                                     made_by=made_by)
                if kept.interrupt is not None:
                    raise kept.interrupt
                return found

            rows = _rows(specification, [chunk for part in missing for chunk in specification.chunks(part)], outcomes)
            for part in missing:
                in_order = [rows[part, index] for index in range(specification.size(part))]
                tables[part] = specification.table(part, in_order)
                for kind, write in (("csv", tables[part].to_csv), ("parquet", tables[part].to_parquet)):
                    with whole_file(folder / f"{part}.{kind}") as path:
                        write(path, index=False)
            kept.finished = True
    return Sweep(specification, tables.get("map"), tables.get(THRESHOLD))


def _rows(specification: Specification, chunks: Sequence[Chunk],
          outcomes: Callable[[Sequence[Task]], Sequence[Outcome]]) -> dict[tuple[str, int], dict[str, Any]]:
    """Rows by part and index; the points of a failed chunk are run again one by one."""
    rows, alone = {}, []
    for chunk, outcome in zip(chunks, outcomes([specification.task(chunk) for chunk in chunks]), strict=True):
        part, indices = chunk.part, chunk.indices
        if outcome.status != "ok" and len(indices) > 1:
            alone += [Chunk(part, range(index, index + 1)) for index in indices]
            continue
        failed = {"status": outcome.status, "reason": outcome.reason}
        found = outcome.value or [{**specification.point(part, indices[0]), **failed}]
        rows |= {(part, index): row for index, row in zip(indices, found, strict=True)}
    return rows | (_rows(specification, alone, outcomes) if alone else {})


def _written(folder: Path, part: str) -> pd.DataFrame | None:
    """The table of a part, if it is there and whole."""
    try:
        return pd.read_parquet(folder / f"{part}.parquet")
    except (FileNotFoundError, pa.ArrowInvalid):  # missing, or cut off by a machine that went down
        return None


def check_folder(specification: Specification, folder: Path) -> None:
    """Raise SweepRefused unless the folder does not exist, is empty, or holds this very sweep."""
    if folder.exists() and not folder.is_dir():
        raise SweepRefused(f"{folder}: found a file; expected a folder, or nothing")
    if not folder.exists() or not any(folder.iterdir()):
        return
    try:
        found = json.loads((folder / SPECIFICATION).read_text())
        digest = found.pop("digest")
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError, AttributeError):
        raise SweepRefused(f"{folder}: found files but no {SPECIFICATION} of a sweep; expected an empty folder, the "
                           "folder of this sweep, or a new name") from None
    if digest != specification.digest:
        other = ", ".join(_differences(found, json.loads(json.dumps(specification.content)))) or "its digest"
        raise SweepRefused(f"{folder}: found another sweep, which differs in {other}; expected the folder of this "
                           "sweep or a new name")


def _differences(found: Mapping[str, Any], own: Mapping[str, Any]) -> Iterator[str]:
    for key, value in own.items():
        other = found.get(key)
        if isinstance(value, dict) and isinstance(other, dict):
            yield from (f"{key}.{name}" for name in {**value, **other} if value.get(name) != other.get(name))
        elif value != other:
            yield key
