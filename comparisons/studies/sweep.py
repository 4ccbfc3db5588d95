"""Maps of a scene's parameters: one run of the reference per point of a grid, and the stick threshold along it.

The grid is cut into chunks of points that do not depend on who computes them. A chunk's rows are written as one Parquet
file, atomically and marked with the digest of the specification, so that an interrupted sweep goes on where it was and
the table is the same for any number of workers.
"""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from stiction.comparisons.atomic_files import make_folder, whole_file, write_text
from stiction.comparisons.environment import source_digest
from stiction.comparisons.studies.steady_state_measures import CONTRACTION, MEASURES, REPEATS, SAMPLE_STEP, STEP_LIMIT, Measure, SteadyWindow, steady_window
from stiction.comparisons.studies.stick_threshold import NoCommonPeriod, NotSettled, common_period, measure_threshold
from stiction.engines.reference.engine import compile_kernels
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import InputError, Scene, SceneError, scene_to_toml, vary
from stiction.scenes.expressions import evaluate

THRESHOLD, AMPLITUDE = "threshold", "F0"
"""The measure that is a bisection and not a run, and the parameter on which the threshold is."""

SEARCH = (0.25, 4.0)
"""Of the scene's own amplitude: where the threshold is searched if the amplitude is no axis; else from end to end of the axis."""
BRACKET = 2.5e-3
"""Width of a threshold's bracket as a part of the range in which it is searched."""
PROBES = 9
"""Amplitudes from end to end of the search at which a stick phase is looked for before the bisection."""
NO_STEADY_STATE = "no steady state"
"""Status of a point whose motion neither rests nor repeats itself; it has no numbers."""

USUAL_PERIODS = 30
"""Of loads and drives, that a run takes where nobody says how long: as many as a stick threshold takes at first."""

CHUNK = {"map": 32, "threshold": 4}
"""Points of a chunk: a few tenths of a second, what an interruption loses per worker."""
MAX_POINTS = 10_000_000
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
    """An axis of ``KEY=FROM:TO:COUNT`` (equal distances, both ends included) or ``KEY=A,B,..``; arithmetic is understood.

    Raises
    ------
    InputError
        If it is neither, values repeat, or COUNT is not a whole number of at least 2.
    """
    key, equals, given = (part.strip() for part in text.partition("="))
    if not (key and equals and given):
        raise InputError(f"axis: found {text!r}; expected KEY=FROM:TO:COUNT or KEY=A,B,.. such as F0=0.5:6:100")
    parts = given.split(":") if ":" in given else given.split(",")
    numbers = []
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
            raise InputError(f"axis {key}: found {parts[2].strip()!r} values; expected a whole number from 2 to {MAX_POINTS}")
        numbers = [float(value) for value in np.linspace(low, high, int(count))]
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
class Specification:
    """What a sweep computes.

    Attributes
    ----------
    axes : tuple of Axis
        The last one varies fastest.
    measures : tuple of str
        Of `MEASURES`, or ``"threshold"``: largest F0 with a stick phase, along the axes that are not F0.
    settle, t_end : float
        Seconds between which the motion must come to rest or repeat itself; see `steady_state_measures.SteadyWindow`.
    rtol : float

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
    settle: float
    t_end: float
    rtol: float = 1e-6

    def __post_init__(self) -> None:
        known = (*MEASURES, THRESHOLD)
        keys = [axis.key for axis in self.axes]
        if not keys or len(set(keys)) < len(keys):
            raise InputError(f"axes: found {', '.join(keys) or 'none'}; expected at least one, each key once")
        if math.prod(len(axis.values) for axis in self.axes) > MAX_POINTS:
            raise InputError(f"axes: found more than {MAX_POINTS} points; expected fewer")
        if not self.measures or len(set(self.measures)) < len(self.measures) or not set(self.measures) <= set(known):
            raise InputError(f"measures: found {', '.join(self.measures) or 'none'}; expected some of {', '.join(known)}")
        if not 0 <= self.settle < self.t_end:
            raise InputError(f"settle, t_end: found {self.settle:g}, {self.t_end:g}; expected 0 <= settle < t_end, in seconds")
        for measure in self.run_measures:
            if measure.needs and not getattr(self.scene, measure.needs):
                raise InputError(f"{measure.name}: found no {measure.needs.replace('_', ' ')} in {self.scene.name}; expected one")
        if THRESHOLD in self.measures and not (self.scene.frictional_guides and AMPLITUDE in self.scene.parameters):
            raise InputError(f"{THRESHOLD}: expected a frictional guide and a parameter {AMPLITUDE} in {self.scene.name}")
        for axis in self.axes:
            self._check(axis)

    def _check(self, axis: Axis) -> None:
        """One value at least must give a scene; the points of others are rows that say why not."""
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
    def mechanism(self) -> Mechanism:
        """Of the scene; those of points have much in common with it."""
        return Mechanism(self.scene)

    @cached_property
    def content(self) -> dict[str, Any]:
        """Everything that the numbers depend on, ready for JSON."""
        packages = ("stiction", "numpy", "scipy", "numba")
        return {"code": source_digest(), "scene": scene_to_toml(self.scene), "axes": {axis.key: list(axis.values) for axis in self.axes},
                "measures": list(self.measures),
                "settings": {"settle": self.settle, "t_end": self.t_end, "rtol": self.rtol, "sample step": SAMPLE_STEP,
                             "step limit": STEP_LIMIT, "chunk": CHUNK, "repeats": REPEATS,
                             "threshold search": list(SEARCH), "threshold bracket": BRACKET, "threshold probes": PROBES},
                "versions": {"python": platform.python_version(), **{name: version(name) for name in packages}}}

    @cached_property
    def digest(self) -> str:
        return hashlib.sha256(json.dumps(self.content, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class Chunk:
    """Points of consecutive indices of the map or of the threshold."""

    part: str
    number: int
    indices: range

    @property
    def file(self) -> str:
        return f"chunks/{self.part}-{self.number:06d}.parquet"


def chunks(specification: Specification) -> list[Chunk]:
    """All chunks, those of the threshold, whose points take longest, first."""
    wanted = {"threshold": THRESHOLD in specification.measures, "map": bool(specification.run_measures)}
    return [Chunk(part, number, range(first, min(first + CHUNK[part], specification.size(part))))
            for part in wanted if wanted[part]
            for number, first in enumerate(range(0, specification.size(part), CHUNK[part]))]


def run_chunk(specification: Specification, chunk: Chunk) -> list[dict[str, Any]]:
    """The rows of a chunk: axes, ``status``, ``reason`` and numbers; what a point raises is its reason.

    All points of a map go through a stage before one goes on: Python takes half as long again where machine code has run in between.
    """
    points = [specification.point(chunk.part, index) for index in chunk.indices]
    found: list[Any] = points
    for stage in (_begun, _simulated, _measured) if chunk.part == "map" else (_threshold_point,):
        found = [_tried(stage, specification, given) for given in found]
    return [{**point, "status": "ok", "reason": ""} | (_told(row) if isinstance(row, Exception) else row) for point, row in zip(points, found)]


def _tried(stage: Callable[[Specification, Any], Any], specification: Specification, given: Any) -> Any:
    """What a stage makes of what it is given, or what it raises; of what one before it has raised that itself."""
    if isinstance(given, Exception):
        return given
    try:
        return stage(specification, given)
    except Exception as error:  # whatever it is, it concerns this point alone, and is told
        return error


def _told(error: Exception) -> dict[str, str]:
    status = NO_STEADY_STATE if isinstance(error, (NotSettled, NoCommonPeriod)) else "refused" if isinstance(error, SceneError) else "failed"
    return {"status": status, "reason": " ".join(f"{type(error).__name__}: {error}".split())}


def _begun(specification: Specification, point: Mapping[str, float]) -> SteadyWindow:
    return steady_window(vary(specification.scene, point), specification.settle, specification.t_end, specification.rtol,
                         specification.run_measures, specification.mechanism)


def _simulated(_: Specification, window: SteadyWindow) -> SteadyWindow:
    window.integration.step()
    return window


def _measured(specification: Specification, window: SteadyWindow) -> dict[str, Any]:
    return {"window from [s]": window.start, **{measure.column: measure.value(window) for measure in specification.run_measures}}


def _threshold_point(specification: Specification, point: Mapping[str, float]) -> dict[str, Any]:
    scene, rtol = vary(specification.scene, point), specification.rtol
    low, high = _search_range(specification, scene)
    found = measure_threshold(scene, "reference", {"rtol": rtol, "stabilization": "projection", "assemble": True}, 0.0, low, high,
                              BRACKET * (high - low), amplitude=AMPLITUDE, guide=next(iter(scene.frictional_guides)), probes=PROBES,
                              distance=REPEATS * rtol, floor=CONTRACTION * REPEATS * rtol)
    if found.with_stick is None or found.without_stick is None:
        return {"status": "not found", "reason": found.remark}
    return {"threshold [N]": 0.5 * (found.with_stick + found.without_stick),
            "F0 with stick [N]": found.with_stick, "F0 without stick [N]": found.without_stick}


def _search_range(specification: Specification, scene: Scene) -> tuple[float, float]:
    for axis in specification.axes:
        if axis.key == AMPLITUDE:
            return min(axis.values), max(axis.values)
    return SEARCH[0] * abs(scene.parameters[AMPLITUDE]), SEARCH[1] * abs(scene.parameters[AMPLITUDE])


@dataclass(frozen=True)
class Sweep:
    """Tables with one row per point, in the order of the grid; None where no measure asked for one.

    `map`: axes, ``status``, ``reason``, ``window from [s]``, a column per measure. `threshold`: axes that are not F0, ``status``, ``reason``,
    the bracket of the threshold and its middle.
    """

    specification: Specification
    map: pd.DataFrame | None
    threshold: pd.DataFrame | None


def sweep(specification: Specification, executor: Executor, folder: str | Path, *,
          on_start: Callable[[int], None] | None = None, on_result: Callable[[Chunk], None] | None = None) -> Sweep:
    """Compute what the folder does not hold yet.

    Parameters
    ----------
    executor
        Of `concurrent.futures`; see `stiction.comparisons.studies.executors.open_executor`. It only computes, files are written here.
    folder
        Made if it does not exist; see `check_folder`.
    on_start, on_result
        Told the number of chunks that are left, and each one as it comes in.

    Raises
    ------
    SweepRefused
        If the folder belongs to something else.
    """
    folder = Path(folder)
    check_folder(specification, folder)
    make_folder(folder / "chunks")
    write_text(folder / SPECIFICATION, json.dumps({"digest": specification.digest, **specification.content}, indent=1))
    everything = chunks(specification)
    missing = [chunk for chunk in everything if not _computed(specification, folder / chunk.file)]
    if on_start is not None:
        on_start(len(missing))
    if missing:
        compile_kernels()  # here, lest every worker does it
    waiting = {executor.submit(run_chunk, specification, chunk): chunk for chunk in missing}
    for future in as_completed(waiting):
        chunk = waiting[future]
        table = pa.Table.from_pandas(_frame(specification, chunk.part, future.result()), preserve_index=False)
        table = table.replace_schema_metadata({**(table.schema.metadata or {}), b"sweep": specification.digest.encode()})
        with whole_file(folder / chunk.file) as path:
            pq.write_table(table, path)
        if on_result is not None:
            on_result(chunk)
    tables = {part: _assembled(folder, [chunk for chunk in everything if chunk.part == part]) for part in CHUNK}
    for part, table in tables.items():
        if table is not None:
            with whole_file(folder / f"{part}.parquet") as path:
                table.to_parquet(path, index=False)
            with whole_file(folder / f"{part}.csv") as path:
                table.to_csv(path, index=False)
    return Sweep(specification, tables["map"], tables["threshold"])


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
        raise SweepRefused(f"{folder}: found files but no {SPECIFICATION} of a sweep; expected an empty folder, the folder of "
                           "this sweep, or a new name") from None
    if digest != specification.digest:
        other = ", ".join(_differences(found, json.loads(json.dumps(specification.content)))) or "its digest"
        raise SweepRefused(f"{folder}: found another sweep, which differs in {other}; expected the folder of this sweep or a "
                           "new name")


def _differences(found: Mapping[str, Any], own: Mapping[str, Any]) -> Iterator[str]:
    for key, value in own.items():
        other = found.get(key)
        if isinstance(value, dict) and isinstance(other, dict):
            yield from (f"{key}.{name}" for name in {**value, **other} if value.get(name) != other.get(name))
        elif value != other:
            yield key


def _computed(specification: Specification, file: Path) -> bool:
    """Whether a chunk is there, whole and of this specification."""
    try:
        return pq.read_schema(file).metadata.get(b"sweep") == specification.digest.encode()
    except (FileNotFoundError, pa.ArrowInvalid):  # missing, or cut off by a machine that went down
        return False


def _frame(specification: Specification, part: str, rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Rows as a table of the same columns and types whatever has failed in them."""
    numbers = ["window from [s]", *(measure.column for measure in specification.run_measures)] if part == "map" else [
        "threshold [N]", "F0 with stick [N]", "F0 without stick [N]"]
    keys, text = [axis.key for axis in specification.grid(part)], ["status", "reason"]
    types = dict.fromkeys([*keys, *numbers], float) | dict.fromkeys(text, str)
    return pd.DataFrame(rows, columns=[*keys, *text, *numbers]).astype(types)


def _assembled(folder: Path, parts: Sequence[Chunk]) -> pd.DataFrame | None:
    return pd.concat([pd.read_parquet(folder / chunk.file) for chunk in parts], ignore_index=True) if parts else None
