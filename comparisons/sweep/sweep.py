"""Maps of a scene's parameters: one run of an engine per point of a grid, and the stick threshold along it.

Points are tasks of `stiction.engines.isolation`: one that crashes, or takes too long, is a row with its reason. Points
that are done are kept as runs of `stiction validate` are (`stiction.comparisons.bench.store`), so that an
interrupted sweep goes on where it was.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from stiction.comparisons.bench.environment import source_digest, versions
from stiction.comparisons.bench.identity import engine_identity
from stiction.comparisons.bench.presentation.cells import intervals_text
from stiction.comparisons.bench.runner import TIME_LIMIT, prepare
from stiction.comparisons.bench.store import kept_runs
from stiction.comparisons.measures.engine_threshold import StickProbe
from stiction.comparisons.measures.reference_bands import (
    AMPLITUDE,
    USUAL_VALUES,
    Variation,
    bands_from_own_start,
)
from stiction.comparisons.measures.settling import NoCommonPeriod, NotSettled, common_period
from stiction.comparisons.measures.steady_state_measures import (
    MEASURES,
    Measure,
    SteadyRun,
    measure_of,
    steady_window,
)
from stiction.comparisons.studies.threshold import AGAIN, SCANNED, WITH_STICK, WITHOUT_STICK
from stiction.engines import EngineMissing, Isolate, Outcome, Refused, Task, isolate, load_engine
from stiction.engines.status import Status
from stiction.reference_impl.multibody.initial_state import with_consistent_start
from stiction.scenes import InputError, Scene, SceneError, scene_to_toml, vary
from stiction.scenes.atomic_files import make_folder, whole_file, write_text
from stiction.scenes.digest import digest
from stiction.scenes.expressions import evaluate
from stiction.truths.bands import Band, BandKind, Range, find_bands, stick_bands, threshold_of

THRESHOLD = "threshold"
"""The measure that is a search over the amplitude and not a run."""
THRESHOLD_COLUMN = "threshold"
"""Column of the upper end of the band with stick next to the scene's own amplitude."""
STICK_BANDS = "stick_bands"
"""Column of all bands with stick within the range, as pairs of amplitudes."""
WINDOW_START = "window_begin"
"""Column of the start of a run's window."""
SEARCH = (0.25, 4.0)
"""Multiples of the scene's own amplitude between which the threshold is searched if the amplitude is no axis; else from
end to end of the axis."""
BRACKET = 2.5e-3
"""Largest width to which the ends of bands are halved, as a part of the range in which they are searched."""
REFERENCE_BRACKET = 1e-5
"""The same for the event-driven reference, whose runs cost a hundredth of those of an engine."""
ENGINE_VALUES = 24
"""Amplitudes in the range at which a method is asked whose motion is sampled; `USUAL_VALUES` for the event-driven
reference."""
FAILURES = {
    NotSettled: Status.NO_STEADY_STATE,
    NoCommonPeriod: Status.NO_STEADY_STATE,
    SceneError: Status.REFUSED,
    Refused: Status.REFUSED,
    EngineMissing: Status.MISSING,
    Exception: Status.FAILED,
}
USUAL_PERIODS = 30
"""Periods of loads and drives in a run without a given end: as many as a stick threshold takes at first."""
MAX_POINTS = 1_000_000
Numbers = Callable[[Scene, SteadyRun, Any], dict[str, Any]]
"""Numbers of a scene by column, or why there are none."""
SPECIFICATION = "sweep.json"
"""File that makes a folder the folder of a sweep."""


class SweepRefused(InputError):
    """The folder holds something else than this sweep."""


@dataclass(frozen=True)
class SweepAxis:
    """A value of the scene, by its key as in `vary`, and the values it takes."""

    key: str
    values: tuple[float, ...]


def parse_axis(text: str) -> SweepAxis:
    """An axis of ``KEY=FROM:TO:COUNT`` (equal distances, both ends included) or ``KEY=A,B,..``, with arithmetic.

    Raises
    ------
    InputError
        If it is neither, values repeat, or COUNT is not a whole number of at least 2. A single value must be
        written as a number: the arithmetic in ``F0=3-6``, which is -3, is most likely meant as a range.
    """
    key, equals, given = (part.strip() for part in text.partition("="))
    if not (key and equals and given):
        raise InputError(
            f"axis: found {text!r}; expected KEY=FROM:TO:COUNT or KEY=A,B,.. such as F0=0.5:6:100"
        )
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
            raise InputError(
                f"axis {key}: found {parts[2].strip()!r} values; expected a whole number from 2 to "
                f"{MAX_POINTS}"
            )
        numbers = [_short(value) for value in np.linspace(low, high, int(count)).tolist()]
    if len(numbers) == 1 and not _is_number(given):
        raise InputError(
            f"axis {key}: found {given!r}, which is the single value {numbers[0]:g}; expected a range "
            "FROM:TO:COUNT, or values A,B,.."
        )
    if len(set(numbers)) < len(numbers):
        raise InputError(
            f"axis {key}: found {given!r}; expected values that differ from each other"
        )
    return SweepAxis(key, tuple(numbers))


def _is_number(text: str) -> bool:
    """Return whether a text is a number, as opposed to arithmetic."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _short(value: float) -> float:
    """The number with fewer digits that a value misses by rounding alone: 0.15 for 0.15000000000000002."""
    short = float(f"{value:.14g}")
    return short if abs(short - value) <= 2 * np.spacing(abs(value)) else value


def usual_end(scene: Scene) -> float:
    """End of the runs of a sweep that does not say one, s: twice the scene's own, `USUAL_PERIODS` at least."""
    try:
        return max(2 * scene.t_end, USUAL_PERIODS * common_period(scene))
    except NoCommonPeriod:
        return 2 * scene.t_end


@dataclass(frozen=True)
class Specification:
    """The computation of a sweep.

    Attributes
    ----------
    axes : tuple of SweepAxis
        The last one varies fastest.
    measures : tuple of str
        Names in `MEASURES`, those but ``"event-count"`` also with an element, as in ``"peak-speed:block"``. Or
        ``"threshold"``: upper end of the band of F0, next to the scene's own, with a stick phase, along the axes that
        are not F0.
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
    axes: tuple[SweepAxis, ...]
    measures: tuple[str, ...]
    run: SteadyRun
    timeout_s: float = TIME_LIMIT

    def __post_init__(self) -> None:
        known, scene = (*MEASURES, THRESHOLD), self.scene
        keys = [axis.key for axis in self.axes]
        if not keys or len(set(keys)) < len(keys):
            raise InputError(
                f"axes: found {', '.join(keys) or 'none'}; expected at least one, each key once"
            )
        if math.prod(len(axis.values) for axis in self.axes) > MAX_POINTS:
            raise InputError(f"axes: found more than {MAX_POINTS} points; expected fewer")
        if not self.measures or len(set(self.measures)) < len(self.measures):
            found = ", ".join(self.measures) or "none"
            raise InputError(
                f"measures: found {found}; expected some of {', '.join(known)}, each once"
            )
        settle, t_end = self.run.settle, self.run.t_end
        if not 0 <= settle < t_end:
            raise InputError(
                f"settle, t_end: found {settle:g}, {t_end:g}; expected 0 <= settle < t_end, in seconds"
            )
        engine, fidelity = load_engine(self.run.engine), self.run.fidelity
        if fidelity not in engine.capabilities.fidelities:
            has = " and ".join(engine.capabilities.fidelities)
            raise InputError(f"fidelity: found {str(fidelity)!r}; {engine.name} has {has}")
        engine.check_arguments(dt=self.run.dt, rtol=None, fidelity=fidelity, settings={})
        for measure in self.run_measures:
            if measure.needs and not getattr(scene, measure.needs):
                needed = measure.needs.replace("_", " ")
                raise InputError(f"{measure.name}: found no {needed} in {scene.name}; expected one")
            if measure.element and measure.element not in (choices := measure.choices(scene)):
                raise InputError(
                    f"{measure.name}: found {measure.element!r}; expected one of {', '.join(choices)}"
                )
        if THRESHOLD in self.measures and not (
            scene.frictional_guides and AMPLITUDE in scene.parameters
        ):
            raise InputError(
                f"{THRESHOLD}: expected a frictional guide and a parameter {AMPLITUDE} in {scene.name}"
            )
        for axis in self.axes:
            problems = []
            for value in axis.values:
                try:
                    vary(scene, {axis.key: value})
                    break
                except SceneError as error:
                    problems.append(error)
            else:  # one value at least must give a scene; the points of others are rows with the reason
                raise problems[0]

    @property
    def run_measures(self) -> list[Measure]:
        """The measures that are numbers of a run."""
        return [measure_of(text) for text in self.measures if text != THRESHOLD]

    @property
    def parts(self) -> list[str]:
        """``"threshold"`` and ``"map"``, as far as measures require them."""
        wanted = {
            THRESHOLD: THRESHOLD in self.measures,
            "map": bool(self.run_measures),
        }  # the slowest first
        return [part for part, is_wanted in wanted.items() if is_wanted]

    def grid(self, part: str) -> tuple[SweepAxis, ...]:
        """The axes of ``"map"`` or, without the amplitude, of ``"threshold"``."""
        return tuple(axis for axis in self.axes if part == "map" or axis.key != AMPLITUDE)

    def points(self, part: str) -> list[dict[str, float]]:
        """Values by key of every point of the grid, in order."""
        axes = self.grid(part)
        keys = [axis.key for axis in axes]
        return [dict(zip(keys, values)) for values in product(*(axis.values for axis in axes))]

    @cached_property
    def content(self) -> dict[str, Any]:
        """Everything that the numbers depend on, ready for JSON."""
        return {
            "code": source_digest(),
            "scene": scene_to_toml(self.scene),
            "axes": {axis.key: list(axis.values) for axis in self.axes},
            "measures": list(self.measures),
            "measured": {
                measure.column: measure.subject(self.scene) for measure in self.run_measures
            },
            "settings": {**asdict(self.run), "timeout": self.timeout_s},
            "versions": {**versions(), self.run.engine: load_engine(self.run.engine).version},
            "engine": engine_identity(self.run.engine),
        }

    @cached_property
    def digest(self) -> str:
        return digest(self.content)

    def tasks(self, part: str) -> list[Task]:
        """The row of every point."""
        numbers: Numbers = map_numbers
        about: Any = [text for text in self.measures if text != THRESHOLD]
        if part == THRESHOLD:
            amplitudes = [
                value for axis in self.axes if axis.key == AMPLITUDE for value in axis.values
            ]
            numbers, about = (
                threshold_numbers,
                (min(amplitudes), max(amplitudes)) if amplitudes else None,
            )
        return [
            Task(f"{part} {number}", point_row, (numbers, self.scene, self.run, about, point))
            for number, point in enumerate(self.points(part))
        ]

    def table(self, part: str, rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
        """Rows as a table of the same columns and types whatever has failed in them."""
        keys, text = [axis.key for axis in self.grid(part)], ["status", "reason"]
        numbers = [WINDOW_START, *(measure.column for measure in self.run_measures)]
        if part == THRESHOLD:
            numbers = [THRESHOLD_COLUMN, WITH_STICK, WITHOUT_STICK, SCANNED]
            text += [AGAIN, STICK_BANDS]
        types = dict.fromkeys([*keys, *numbers], float) | dict.fromkeys(text, str)
        table = pd.DataFrame(rows, columns=[*keys, *text, *numbers])
        table[text] = table[text].astype(object).fillna("")
        return table.astype(types)


def point_row(
    numbers: Numbers, scene: Scene, run: SteadyRun, about: Any, point: Mapping[str, float]
) -> dict[str, Any]:
    """The row of a point: its axes, ``status``, ``reason`` and numbers; an exception is its reason."""
    try:
        found = numbers(vary(scene, point), run, about)
    except Exception as error:  # whatever it is, it concerns this point alone, and its row says so
        found = {
            "status": next(status for kind, status in FAILURES.items() if isinstance(error, kind)),
            "reason": " ".join(f"{type(error).__name__}: {error}".split()),
        }
    return {**point, "status": Status.OK, "reason": "", **found}


def map_numbers(scene: Scene, run: SteadyRun, measures: Sequence[str]) -> dict[str, Any]:
    """The numbers of a run."""
    chosen = [measure_of(text) for text in measures]
    window = steady_window(scene, run, chosen)
    return {
        WINDOW_START: window.start,
        **{measure.column: measure.value(window) for measure in chosen},
    }


def threshold_numbers(
    scene: Scene, run: SteadyRun, ends: tuple[float, float] | None
) -> dict[str, Any]:
    """Return the threshold and all bands with stick between two amplitudes (N), or around the scene's own."""
    own = abs(scene.parameters[AMPLITUDE])
    low, high = ends or sorted(factor * own for factor in SEARCH)
    if run.is_event_driven_reference:
        searched = Range(low, high, (high - low) / USUAL_VALUES)
        variation = Variation(AMPLITUDE, list(scene.frictional_guides)[0], searched, own)
        bands = bands_from_own_start(scene, variation, REFERENCE_BRACKET * (high - low)).bands
    else:
        bands = _bands_of_engine(scene, run, Range(low, high, (high - low) / ENGINE_VALUES))

    intervals = stick_bands(bands)
    numbers: dict[str, Any] = {STICK_BANDS: intervals_text(intervals), SCANNED: high}
    sides = threshold_of(bands, own)
    if sides is None:
        reason = f"no stick phase at {AMPLITUDE} = {low:g} N to {high:g} N"
        if intervals:
            reason = f"still a stick phase at {AMPLITUDE} = {intervals[-1][1]:g} N"
        return {**numbers, "status": Status.NOT_FOUND, "reason": reason}
    below, _ = sides
    threshold, uncertainty = below.high, below.high_uncertainty
    return {
        **numbers,
        THRESHOLD_COLUMN: threshold,
        WITH_STICK: threshold - uncertainty,
        WITHOUT_STICK: threshold + uncertainty,
        AGAIN: intervals_text([interval for interval in intervals if interval[0] > threshold]),
    }


def _bands_of_engine(scene: Scene, run: SteadyRun, searched: Range) -> tuple[Band, ...]:
    """Return the bands by a method other than the event-driven reference."""
    step = run.step(scene)
    arguments: dict[str, Any] = {"rtol": run.rtol} if step is None else {"dt": step}
    probe = StickProbe(
        with_consistent_start(scene, assemble=True),
        run.engine,
        {**arguments, "fidelity": run.fidelity},
    )

    def kind_at(value: float) -> BandKind:
        try:
            return BandKind.STICK if probe.sticks(value) else BandKind.SLIP
        except NotSettled:
            return BandKind.UNSETTLED

    return find_bands(kind_at, searched, BRACKET * (searched.high - searched.low))


@dataclass(frozen=True)
class Sweep:
    """Tables with one row per point, in the order of the grid; None where no measure requires one.

    `map`: axes, ``status``, ``reason``, ``window_begin``, a column per measure. `threshold`: axes that are not F0,
    ``status``, ``reason``, ``sticks_again`` and ``stick_bands`` (the bands with stick above the threshold, and all of
    them, as pairs of amplitudes), the bracket of the threshold and its middle, and the end of the searched range.
    """

    specification: Specification
    map: pd.DataFrame | None
    threshold: pd.DataFrame | None


def sweep(
    specification: Specification,
    folder: str | Path,
    *,
    workers: int | None = None,
    made_by: Isolate = isolate,
    on_start: Callable[[int], None] | None = None,
    on_result: Callable[[Outcome], None] | None = None,
) -> Sweep:
    """Compute the points that the folder does not hold yet.

    Parameters
    ----------
    folder
        Made if it does not exist; see `check_folder`.
    workers, made_by
        Tasks at a time, and their runner: see `stiction.comparisons.bench.executors.open_isolate`.
    on_start, on_result
        Called with the number of points, and with the outcome of each.

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
    write_text(
        folder / SPECIFICATION,
        json.dumps({"digest": specification.digest, **specification.content}, indent=1),
    )
    tables = {part: _written(folder, part) for part in specification.parts}
    missing = [part for part, table in tables.items() if table is None]
    if missing:
        prepare([engine])
        tasks = [task for part in missing for task in specification.tasks(part)]
        if on_start is not None:
            on_start(len(tasks))
        with kept_runs(folder, [engine]) as kept:
            outcomes = iter(
                kept.isolate(
                    tasks,
                    workers=workers,
                    timeout_s=specification.timeout_s,
                    on_result=on_result,
                    made_by=made_by,
                )
            )
            if kept.interrupt is not None:
                raise kept.interrupt
            for part in missing:
                rows = [
                    outcome.value or {**point, "status": outcome.status, "reason": outcome.reason}
                    for point, outcome in zip(specification.points(part), outcomes)
                ]  # it takes no outcome more
                tables[part] = table = specification.table(part, rows)
                for kind, write in (("csv", table.to_csv), ("parquet", table.to_parquet)):
                    with whole_file(folder / f"{part}.{kind}") as path:
                        write(path, index=False)
            kept.finished = True
    return Sweep(specification, tables.get("map"), tables.get(THRESHOLD))


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
        raise SweepRefused(
            f"{folder}: found files but no {SPECIFICATION} of a sweep; expected an empty folder, the "
            "folder of this sweep, or a new name"
        ) from None
    if digest != specification.digest:
        other = (
            ", ".join(_differences(found, json.loads(json.dumps(specification.content))))
            or "its digest"
        )
        raise SweepRefused(
            f"{folder}: found another sweep, which differs in {other}; expected the folder of this "
            "sweep or a new name"
        )


def _differences(found: Mapping[str, Any], own: Mapping[str, Any]) -> Iterator[str]:
    for key, value in own.items():
        other = found.get(key)
        if isinstance(value, dict) and isinstance(other, dict):
            yield from (
                f"{key}.{name}" for name in {**value, **other} if value.get(name) != other.get(name)
            )
        elif value != other:
            yield key
