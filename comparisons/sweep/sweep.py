"""Sweeps: measures of a scene's steady state at every point of a grid of its parameters, and the stick bands there.

Points are tasks of `stiction.engines.isolation`: one that crashes, or takes too long, is a row with its reason.
Finished points are stored as runs of `stiction validate` are (`stiction.comparisons.bench.store`), so that an
interrupted sweep is resumed.
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

import pandas as pd
import pyarrow as pa

from stiction.comparisons.bench.environment import source_digest, versions
from stiction.comparisons.bench.identity import engine_identity
from stiction.comparisons.bench.runner import TIME_LIMIT, prepare
from stiction.comparisons.bench.store import kept_runs
from stiction.comparisons.measures.reference_bands import AMPLITUDE
from stiction.comparisons.measures.settling import NoCommonPeriod, common_period
from stiction.comparisons.measures.steady_state_measures import (
    MEASURES,
    Measure,
    SteadyRun,
    measure_of,
)
from stiction.comparisons.studies.threshold_tables import (
    AGAIN,
    SCANNED,
    VARIED,
    VARIED_UNIT,
    WITH_STICK,
    WITHOUT_STICK,
)
from stiction.comparisons.sweep.axes import MAX_POINTS, SweepAxis
from stiction.comparisons.sweep.points import (
    ALL_BANDS,
    STICK_BANDS,
    THRESHOLD,
    THRESHOLD_COLUMN,
    WINDOW_START,
    BandSearch,
    Numbers,
    band_search_of,
    is_threshold,
    map_numbers,
    point_row,
    threshold_numbers,
)
from stiction.engines import Isolate, Outcome, Task, isolate, load_engine
from stiction.scenes import InputError, Scene, SceneError, vary
from stiction.scenes.atomic_files import make_folder, whole_file, write_text
from stiction.scenes.digest import digest
from stiction.scenes.value_units import unit_of_value

MAP = "map"
"""Name of the table of the measures of runs; that of bands is `THRESHOLD`."""
USUAL_PERIODS = 30
"""Periods of loads and drives in a run without a given end: the paper's case 1 contracts by half in each."""
SPECIFICATION = "sweep.json"
"""File that makes a folder the folder of a sweep."""


class SweepRefused(InputError):
    """The error of a folder that contains something else than this sweep."""


def usual_end(scene: Scene) -> float:
    """Return the usual end of the runs of a sweep, s: twice the scene's own, and at least `USUAL_PERIODS`."""
    try:
        return max(2 * scene.t_end, USUAL_PERIODS * common_period(scene))
    except NoCommonPeriod:
        return 2 * scene.t_end


@dataclass(frozen=True)
class Specification:
    """The definition of a sweep.

    Attributes
    ----------
    scene : Scene
        The scene whose numbers are varied.
    axes : tuple of SweepAxis
        The last one varies fastest.
    measures : tuple of str
        Names in `MEASURES`, those but ``"event-count"`` also with an element, as in ``"peak-speed:block"``. Or
        ``"threshold"``: the bands of F0, and the upper end of the one next to the scene's own value, along the axes
        that are not F0; ``"threshold:KEY"`` of another number of the scene.
    run : SteadyRun
        The run of each point.
    timeout_s : float
        Seconds that a point may take.

    Raises
    ------
    InputError
        If it cannot be computed at any point: unknown or repeated names, a measure for which the scene lacks the part
        that is measured.
    SceneError
        If an axis has a key that the scene does not have, or only values that it cannot have.
    """

    scene: Scene
    axes: tuple[SweepAxis, ...]
    measures: tuple[str, ...]
    run: SteadyRun
    timeout_s: float = TIME_LIMIT

    def __post_init__(self) -> None:
        self._check_axes()
        self._check_run()
        self._check_measures()
        for axis in self.axes:
            self._check_values(axis)

    def _check_axes(self) -> None:
        """Raise InputError unless there is an axis, no two have the same key, and the grid has few enough points."""
        keys = [axis.key for axis in self.axes]
        if not keys or len(set(keys)) < len(keys):
            raise InputError(
                f"axes: found {', '.join(keys) or 'none'}; expected at least one, each key once"
            )
        if math.prod(len(axis.values) for axis in self.axes) > MAX_POINTS:
            raise InputError(f"axes: found more than {MAX_POINTS} points; expected fewer")

    def _check_run(self) -> None:
        """Raise InputError unless the engine can make the run, and its steady state has time."""
        settle, t_end = self.run.settle, self.run.t_end
        if not 0 <= settle < t_end:
            raise InputError(
                f"settle, t_end: found {settle:g}, {t_end:g}; expected 0 <= settle < t_end, in seconds"
            )
        engine, fidelity = load_engine(self.run.engine), self.run.fidelity
        if fidelity not in engine.capabilities.fidelities:
            available = " and ".join(engine.capabilities.fidelities)
            raise InputError(f"fidelity: found {str(fidelity)!r}; {engine.name} has {available}")
        engine.check_arguments(dt=self.run.dt, rtol=None, fidelity=fidelity, settings={})

    def _check_measures(self) -> None:
        """Raise InputError unless there are measures, each once, and the scene has what they measure."""
        names = [THRESHOLD if is_threshold(text) else text for text in self.measures]
        if not names or len(set(names)) < len(names):
            raise InputError(
                f"measures: found {', '.join(self.measures) or 'none'}; expected some of "
                f"{', '.join((*MEASURES, THRESHOLD))}, each once"
            )
        for measure in self.run_measures:
            if measure.needs and not getattr(self.scene, measure.needs):
                needed = measure.needs.replace("_", " ")
                raise InputError(
                    f"{measure.name}: found no {needed} in {self.scene.name}; expected one"
                )
            choices = measure.choices(self.scene)
            if measure.element and measure.element not in choices:
                raise InputError(
                    f"{measure.name}: found {measure.element!r}; expected one of {', '.join(choices)}"
                )
        search = self.band_search
        if search is None:
            return
        if not self.scene.frictional_guides or self._lacks_amplitude(search):
            raise InputError(
                f"{THRESHOLD}: expected a frictional guide and a parameter {AMPLITUDE} in "
                f"{self.scene.name}, or {THRESHOLD}:KEY with another number of the scene"
            )
        try:
            search.variation(self.scene)
        except InputError as error:
            raise InputError(f"{THRESHOLD}: {error}") from None

    def _lacks_amplitude(self, search: BandSearch) -> bool:
        """Return True if a search is about F0, and the scene has no such parameter."""
        return search.parameter == AMPLITUDE and AMPLITUDE not in self.scene.parameters

    def _check_values(self, axis: SweepAxis) -> None:
        """Raise SceneError unless at least one value of an axis gives a scene; the others are rows with the reason."""
        problems = []
        for value in axis.values:
            try:
                vary(self.scene, {axis.key: value})
                return
            except SceneError as error:
                problems.append(error)
        raise problems[0]

    @property
    def run_measures(self) -> list[Measure]:
        """The measures that are numbers of a run."""
        return [measure_of(text) for text in self.measures if not is_threshold(text)]

    @property
    def band_search(self) -> BandSearch | None:
        """The search of bands; None unless `THRESHOLD` is among the measures."""
        ranges = {axis.key: (min(axis.values), max(axis.values)) for axis in self.axes}
        return band_search_of(self.measures, ranges)

    @property
    def varied_unit(self) -> str:
        """The unit of the parameter along which bands are searched; empty if it is not known, or without a search."""
        search = self.band_search
        return "" if search is None else unit_of_value(self.scene, search.parameter) or ""

    @property
    def parts(self) -> list[str]:
        """The tables that the measures require, the slowest one first."""
        parts = []
        if self.band_search is not None:
            parts.append(THRESHOLD)
        if self.run_measures:
            parts.append(MAP)
        return parts

    def grid(self, part: str) -> tuple[SweepAxis, ...]:
        """Return the axes of a table: all of them for `MAP`; for `THRESHOLD` all but the one that is searched."""
        search = self.band_search
        if part == MAP or search is None:
            return self.axes
        return tuple(axis for axis in self.axes if axis.key != search.parameter)

    def points(self, part: str) -> list[dict[str, float]]:
        """Return the values by key of every point of the grid of a table, in order."""
        axes = self.grid(part)
        keys = [axis.key for axis in axes]
        return [dict(zip(keys, values)) for values in product(*(axis.values for axis in axes))]

    @cached_property
    def content(self) -> dict[str, Any]:
        """Everything that the numbers depend on, ready for JSON."""
        return {
            "code": source_digest(),
            "scene": self.scene.to_toml(),
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
        """The digest of `content`, by which a folder is recognized as that of this sweep."""
        return digest(self.content)

    def tasks(self, part: str) -> list[Task]:
        """Return the tasks of a table, one for each point; the value of each is a row."""
        numbers: Numbers = map_numbers
        about: Any = [text for text in self.measures if not is_threshold(text)]
        if part == THRESHOLD:
            numbers, about = threshold_numbers, self.band_search
        return [
            Task(f"{part} {number}", point_row, (numbers, self.scene, self.run, about, point))
            for number, point in enumerate(self.points(part))
        ]

    def table(self, part: str, rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
        """Return rows as a table, which has the same columns and types whatever has failed in them."""
        keys = [axis.key for axis in self.grid(part)]
        texts = ["status", "reason"]
        numbers = [WINDOW_START, *(measure.column for measure in self.run_measures)]
        if part == THRESHOLD:
            numbers = [THRESHOLD_COLUMN, WITH_STICK, WITHOUT_STICK, SCANNED]
            texts += [VARIED, VARIED_UNIT, AGAIN, STICK_BANDS, ALL_BANDS]
        table = pd.DataFrame(rows, columns=[*keys, *texts, *numbers])
        table[texts] = table[texts].astype(object).fillna("")
        return table.astype(dict.fromkeys([*keys, *numbers], float) | dict.fromkeys(texts, str))


@dataclass(frozen=True)
class Sweep:
    """The tables of a sweep, with one row per point in the order of the grid.

    Attributes
    ----------
    specification : Specification
        The definition of the sweep.
    map : DataFrame or None
        Axes, ``status``, ``reason``, ``window_begin``, and a column per measure of a run; None without such a measure.
    threshold : DataFrame or None
        Axes without the searched parameter, ``status``, ``reason``, the parameter and its unit, its bands
        (``sticks_again``, ``stick_bands``, ``all_bands``), the bracket of the threshold and its middle, and the end of
        the searched range; None without this measure.
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
    """Compute the points that the folder does not contain yet, and write the tables there.

    Parameters
    ----------
    specification : Specification
        The definition of the sweep.
    folder : path
        It is made if it does not exist; see `check_folder`.
    workers, made_by
        Number of tasks at a time, and the function that executes them: see
        `stiction.comparisons.bench.executors.open_isolate`.
    on_start, on_result : callable, optional
        Called with the number of points, and with the outcome of each.

    Returns
    -------
    Sweep

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
    tables = {part: _written_table(folder, part) for part in specification.parts}
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
                # The outcomes of all tables follow each other. `zip` ends with the points of this one
                # before it takes the first outcome of the next.
                rows = []
                for point, outcome in zip(specification.points(part), outcomes):
                    lost = {**point, "status": outcome.status, "reason": outcome.reason}
                    rows.append(outcome.value or lost)
                table = specification.table(part, rows)
                tables[part] = table
                for kind, write in (("csv", table.to_csv), ("parquet", table.to_parquet)):
                    with whole_file(folder / f"{part}.{kind}") as path:
                        write(path, index=False)
            kept.finished = True
    return Sweep(specification, tables.get(MAP), tables.get(THRESHOLD))


def _written_table(folder: Path, part: str) -> pd.DataFrame | None:
    """Return a table that an earlier sweep has written; None if it is missing or not whole."""
    try:
        return pd.read_parquet(folder / f"{part}.parquet")
    except (FileNotFoundError, pa.ArrowInvalid):  # missing, or cut off when a machine stopped
        return None


def check_folder(specification: Specification, folder: Path) -> None:
    """Raise SweepRefused unless the folder does not exist, is empty, or contains this very sweep."""
    if folder.exists() and not folder.is_dir():
        raise SweepRefused(f"{folder}: found a file; expected a folder, or nothing")
    if not folder.exists() or not any(folder.iterdir()):
        return
    try:
        stored = json.loads((folder / SPECIFICATION).read_text())
        digest_stored = stored.pop("digest")
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError, AttributeError):
        raise SweepRefused(
            f"{folder}: found files but no {SPECIFICATION} of a sweep; expected an empty folder, the "
            "folder of this sweep, or a new name"
        ) from None
    if digest_stored == specification.digest:
        return
    own = json.loads(json.dumps(specification.content))
    differences = ", ".join(_differences(stored, own)) or "its digest"
    raise SweepRefused(
        f"{folder}: found another sweep, which differs in {differences}; expected the folder of this "
        "sweep or a new name"
    )


def _differences(stored: Mapping[str, Any], own: Mapping[str, Any]) -> Iterator[str]:
    """Yield the keys in which two contents differ; of nested tables, the path of the key."""
    for key, value in own.items():
        other = stored.get(key)
        if isinstance(value, dict) and isinstance(other, dict):
            for name in {**value, **other}:
                if value.get(name) != other.get(name):
                    yield f"{key}.{name}"
        elif value != other:
            yield key
