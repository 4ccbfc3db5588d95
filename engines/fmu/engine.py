"""An FMU as an engine: fmpy steps it by co-simulation, or integrates it by model exchange."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from stiction.engines.fmu.variables import CO_SIMULATION, MODEL_EXCHANGE, FmuDeclared, Map, Variables
from stiction.engines.protocol import EngineFailure, accepted
from stiction.engines.registry import BUILT_IN, EngineMissing
from stiction.engines.shared.declared_engine import (DEFAULT_RTOL, DeclaredEngine, all_columns, read_declaration,
                                                     results_of)
from stiction.engines.shared.fixed_step import Grid, step_of
from stiction.scenes import Cost, Event, FileError, InputError, Problem, Scene, Trajectory
from stiction.scenes.result_table import ResultTable, result_table
from stiction.scenes.trajectory import rows_of
from stiction.scenes.wording import shortened, shown

MAP = ".map.toml"
LOGGING = "logging"
LOG_LINES = 4
"""Messages of an FMU that a reason has: the last ones."""
_KINDS = {CO_SIMULATION: "CoSimulation", MODEL_EXCHANGE: "ModelExchange"}  # as fmpy calls them
_CALLED_BY_CVODE = {"setTime", "setContinuousStates", "getDerivatives", "getContinuousStateDerivatives",
                    "getEventIndicators"}
_ATTRIBUTES = {CO_SIMULATION: "coSimulation", MODEL_EXCHANGE: "modelExchange"}


class FmuError(FileError):
    """An FMU, or the map next to it, that cannot be used."""


class FmuEngine(DeclaredEngine):
    """An FMU (FMI 2 or 3), with the names and capabilities of ``model.map.toml`` next to it, if there is one.

    By co-simulation dt is the communication step, and rtol, if given, goes to the FMU's own solver. By model exchange
    fmpy's CVode integrates to rtol and locates events; where fmpy has no CVode, Euler's method steps by dt.
    Accelerations that the FMU does not give are differences of velocities, and forces follow from the balance of
    momentum. The setting `logging` turns the FMU's debug logging on: what it logs is in the reason of a failed run.

    Raises
    ------
    FmuError
        With what is wrong in the file or in its map.
    EngineMissing
        If fmpy is not installed, or the FMU has no binary for this machine.
    """

    def __init__(self, file: Path):
        import fmpy

        self.file, self.name = file, file.stem
        self._fmpy = accepted("fmpy", fmpy.__version__)
        self.map_file = file.with_name(file.stem + MAP)
        mapped = self.map_file.is_file()
        chosen = read_declaration(self.map_file, Map, FmuError, FmuDeclared) if mapped else Map()
        self.variables, self.interface, binaries = _read(file, chosen, self.map_file)
        if (library := self._library()) not in binaries:
            found = ", ".join(sorted({name.split("/")[1] for name in binaries})) or "none"
            raise EngineMissing(f"{self.name}: found binaries for {found}; expected {library} in the FMU")
        self.solver = "" if self.interface == CO_SIMULATION else "CVode" if has_cvode() else "Euler"
        self.declare(FmuDeclared.model_validate(
            {**chosen.capabilities.model_dump(), "adaptive": chosen.capabilities.adaptive or self.solver == "CVode",
             "locates_events": chosen.capabilities.locates_events and self.solver == "CVode"}))

    def _library(self) -> str:
        """Name in the FMU of its library for this machine."""
        from fmpy import platform, platform_tuple, sharedLibraryExtension

        description = self.variables.description
        identifier = getattr(description, _ATTRIBUTES[self.interface]).modelIdentifier
        folder = platform_tuple if description.fmiMajorVersion == 3 else platform
        return f"binaries/{folder}/{identifier}{sharedLibraryExtension}"

    @property
    def version(self) -> str:
        description = self.variables.description
        own = description.version or description.generationDateAndTime or description.guid
        return f"{shortened(own, 40)} (FMI {description.fmiVersion}, fmpy {self._fmpy})"

    def content(self) -> bytes:
        chosen = self.map_file.read_bytes() if self.map_file.is_file() else b""
        return self.file.read_bytes() + chosen + self.version.encode()

    def default_settings(self, fidelity: str) -> Mapping[str, Any]:
        return {LOGGING: False}

    def check_arguments(self, *, dt: float | None, rtol: float | None, fidelity: str,
                        settings: Mapping[str, Any]) -> None:
        """Refuse what the interface does not take; co-simulation takes both, a step and a tolerance."""
        both = self.interface == CO_SIMULATION
        super().check_arguments(dt=None if both else dt, rtol=None if both else rtol, fidelity=fidelity,
                                settings=settings)
        if not isinstance(chosen := settings.get(LOGGING, False), bool):
            raise InputError(f"{LOGGING}: found {chosen!r}; expected true or false")

    def refusal(self, scene: Scene, fidelity: str) -> str | None:
        """See `Engine.refusal`: another scene than the FMU states, columns that it lacks, friction not declared."""
        if reason := self.variables.refusal(scene):
            return f"{self.name}: {reason}"
        return super().refusal(scene, fidelity)

    def run(self, scene: Scene, *, t_end: float, dt: float | None, rtol: float | None, fidelity: str,
            output_step: float, settings: Mapping[str, Any]) -> Trajectory:
        if self.solver == "CVode" or self.declared.adaptive and dt is None:
            rtol = rtol or DEFAULT_RTOL
            grid = Grid.of(t_end, t_end / math.ceil(t_end / output_step - 1e-9), output_step)
        else:
            grid = Grid.of(t_end, step_of(dt, t_end), output_step)
        values = self.variables.settable(scene)
        logging = {**self.default_settings(fidelity), **settings}[LOGGING]
        rows, setup, stepping = self._simulate(scene, grid, rtol, values, logging)
        table = self._table(scene, t_end, rows)
        columns, made = all_columns(scene, table, self.name)
        last, until, by_steps = table.last, float(table.t[-1]), self.solver != "CVode"
        chosen = {"dt": grid.dt if by_steps else None, "rtol": rtol, "interface": self.interface,
                  "solver": f"{self.solver} (fmpy)" if self.solver else None, LOGGING: logging,
                  "parameters": " ".join(f"{name}={value:.12g}" for name, value in values.items()), **made,
                  "friction_law": self.capabilities.friction_law[fidelity]}
        return Trajectory(
            scene=scene.name, engine=self.name, version=self.version, fidelity=fidelity, t=table.t[last],
            columns={name: found[last] for name, found in columns.items()},
            events=tuple(self._events(scene, table, columns)),
            termination="end" if until > (grid.last - 0.5) * grid.dt else f"the FMU ended the run at t = {until:.9g} s",
            settings={key: value for key, value in chosen.items() if value is not None},
            cost=Cost(setup, 0.0, stepping, {"steps": grid.last} if by_steps else {}))

    def _simulate(self, scene: Scene, grid: Grid, rtol: float | None, values: Mapping[str, float],
                  logging: bool) -> tuple[np.ndarray, float, float]:
        """Rows that fmpy has recorded, and CPU seconds before the first step and from there on."""
        from fmpy import extract, instantiate_fmu, simulate_fmu

        description, began = self.variables.description, process_time()
        said: list[str] = []
        failures: list[Exception] = []
        names = [source.removeprefix("-") for source in self.variables.sources(scene).values()
                 if isinstance(source, str)]
        with TemporaryDirectory(prefix="stiction-fmu-", ignore_cleanup_errors=True) as folder:
            try:
                extract(self.file, folder)
                fmu = instantiate_fmu(folder, description, _KINDS[self.interface], debug_logging=logging,
                                      logger=_logger(said))
                for call in _CALLED_BY_CVODE & set(dir(fmu)):
                    setattr(fmu, call, _noted(getattr(fmu, call), failures))
                started = process_time()
                rows = simulate_fmu(
                    folder, fmu_instance=fmu, model_description=description, fmi_type=_KINDS[self.interface],
                    start_time=0.0, stop_time=grid.last * grid.dt, step_size=grid.dt, output_interval=grid.dt,
                    solver=self.solver, relative_tolerance=rtol, record_events=self.declared.locates_events,
                    start_values=dict(values), output=names,
                    step_finished=_thinned(grid.every) if self.interface == CO_SIMULATION else None)
                if failures:
                    raise failures[0]
                fmu.freeInstance()  # only here: after an error nothing is safe to call
            except Exception as error:  # fmpy raises Exception itself
                first = failures[0] if failures else error
                what = str(first) or type(first).__name__
                raise EngineFailure(f"{self.name}: {what} {_words(said, logging)}") from error
        if self.solver == "Euler":
            rows = rows[::grid.every]
        return rows, started - began, process_time() - started

    def _table(self, scene: Scene, t_end: float, rows: np.ndarray) -> ResultTable:
        handed = scene.model_copy(update={"t_end": t_end})
        with results_of(self.name):
            return result_table(self.variables.columns(scene, rows), handed, origin=self.name)

    def _events(self, scene: Scene, table: ResultTable, columns: Mapping[str, np.ndarray]) -> Iterator[Event]:
        """Events of the FMU that change a guide's mode."""
        for first, last in zip(table.first, table.last):
            if first == last:
                continue
            before, after = rows_of({name: values[[first, last]] for name, values in columns.items()})
            for guide in scene.frictional_guides:
                old, new = (side[f"{guide}.mode"] for side in (before, after))
                if old != new:
                    kind = "slip" if old == 0 else "stick" if new == 0 else "reversal"
                    yield Event(float(table.t[first]), kind, guide, before, after)


def has_cvode() -> bool:
    """Return True where fmpy has a library of CVode for this machine."""
    try:
        import fmpy.sundials  # noqa: F401 - loads it
    except OSError:
        return False
    return True


def _read(file: Path, chosen: Map, map_file: Path) -> tuple[Variables, str, list[str]]:
    """Variables and interface of an FMU, and the names of its binaries.

    Raises
    ------
    FmuError
    """
    from fmpy import read_model_description

    if file.stem in BUILT_IN:
        raise FmuError(str(file), [Problem("name", shown(file.stem), "expected another name: an engine of the suite "
                                           "has it")])
    try:
        with ZipFile(file) as archive:
            binaries = [name for name in archive.namelist() if name.startswith("binaries/") and name.count("/") == 2]
        description = read_model_description(file, validate=False)
    except (OSError, BadZipFile, KeyError) as error:
        raise FmuError(str(file), [Problem("file", shortened(str(getattr(error, "strerror", None) or error), 160),
                                           "expected an FMU: an archive with modelDescription.xml")]) from None
    except Exception as error:  # fmpy raises Exception itself, for versions and references
        raise FmuError(str(file), [Problem("modelDescription.xml", shortened(str(error), 160),
                                           "expected a model description of FMI 2 or 3")]) from error
    have = [interface for interface, name in _ATTRIBUTES.items() if getattr(description, name) is not None]
    if description.fmiMajorVersion not in (2, 3) or not have:
        raise FmuError(str(file), [Problem("modelDescription.xml", f"FMI {description.fmiVersion}, "
                                           f"{' and '.join(have) or 'no interface'}", "expected co-simulation or model "
                                           "exchange of FMI 2 or 3")])
    if chosen.interface and chosen.interface not in have:
        raise FmuError(str(map_file), [Problem("interface", shown(chosen.interface), f"expected {' or '.join(have)}: "
                                               "the FMU has no other")])
    interface = chosen.interface or have[0]
    if chosen.capabilities.locates_events and interface == CO_SIMULATION:
        raise FmuError(str(map_file), [Problem("capabilities.locates_events", "true", "expected false: "
                                               "co-simulation does not stop at events")])
    variables = Variables(description, chosen, map_file.name)
    if problems := list(variables.problems()):
        raise FmuError(str(map_file), problems)
    return variables, interface, binaries


def _logger(said: list[str]) -> Callable[..., None]:
    """Collect what an FMU logs, and print it: an FMU that ends the process has said it."""
    def log(*arguments: Any) -> None:  # FMI 2 has the name of the instance too
        status, _, message = arguments[-3:]
        text = message.decode(errors="replace").strip() if message else ""
        if status and text:  # 0: ok
            said.append(text)
            print(text, file=sys.stderr, flush=True)
    return log


def _noted(function: Callable[..., Any], failures: list[Exception]) -> Callable[..., Any]:
    """Note what a call raises: behind a callback of C nobody else sees it."""
    def call(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except Exception as error:
            failures.append(error)
            raise
    return call


def _words(said: list[str], logging: bool) -> str:
    """Say what an FMU that failed has logged."""
    lines = [shortened(" ".join(text.split()), 200) for text in said[-LOG_LINES:]]
    return (f"It logged: {' | '.join(lines)}" if lines else
            "It logged nothing" + f"; --setting {LOGGING}=true may bring more" * (not logging))


def _thinned(every: int) -> Callable[[float, Any], bool]:
    """Keep every so many steps of what fmpy records; RuntimeError where a step does not advance."""
    latest = -math.inf
    step = 0

    def finished(time: float, recorder: Any) -> bool:
        nonlocal latest, step
        if not time > latest:
            raise RuntimeError(f"the FMU discards the step at t = {time:.9g} s")
        latest, step = time, step + 1
        if step % every:
            recorder.rows.pop()
        return True
    return finished
