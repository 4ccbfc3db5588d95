"""An FMU as an engine: fmpy steps it by co-simulation, or integrates it by model exchange."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any
from zipfile import ZipFile

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.examined import changed_modes
from stiction.engines.fmu.variables import CO_SIMULATION, MODEL_EXCHANGE, Map, Variables
from stiction.engines.protocol import EngineFailure, check_version
from stiction.engines.registry import EngineMissing
from stiction.engines.shared.declared_engine import DEFAULT_RTOL, DeclaredEngine, read_declaration
from stiction.engines.shared.fixed_step import Grid, step_of
from stiction.scenes import Cost, Event, FileError, InputError, Problem, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.result_table import result_table
from stiction.scenes.wording import last_lines, shortened, shown

MAP = ".map.toml"
LOGGING = "logging"
_LIBRARIES = (".so", ".dylib", ".dll")
_QUOTIENT_ROUNDING = 1e-9
"""Rounding of t_end divided by an output step, which may be just above a whole number."""
_LONGEST_VERSION = 40
"""Characters of the version that an FMU states."""
_LONGEST_ERROR = 160
"""Characters of fmpy's message about a model description, which may quote it."""


class FmuEngine(DeclaredEngine):
    """An FMU (FMI 2 or 3), with the names and capabilities of ``model.map.toml`` next to it, if there is one.

    By co-simulation dt is the communication step, and rtol, if given, goes to the FMU's own solver. By model exchange
    fmpy's CVode integrates to rtol and locates events; where fmpy has no CVode, Euler's method steps by dt.
    Accelerations that the FMU does not give are differences of velocities, and forces follow from the balance of
    momentum. The setting `logging` turns the FMU's debug logging on: what it logs is in the reason of a failed run.

    Raises
    ------
    FileError
        With what is wrong in the file or in its map.
    EngineMissing
        If fmpy is not installed, or the FMU has no binary for this machine.
    """

    version = ""

    def __init__(self, file: Path):
        import fmpy

        self.file, self.name, self.map_file = file, file.stem, file.with_name(file.stem + MAP)
        used = check_version("fmpy", fmpy.__version__)
        chosen = read_declaration(self.map_file, Map) if self.map_file.is_file() else Map()
        self.variables, self.interface = _read(file, chosen, self.map_file)
        about = self.variables.description
        own = about.version or about.generationDateAndTime or about.guid
        self.version = f"{shortened(own, _LONGEST_VERSION)} (FMI {about.fmiVersion}, fmpy {used})"
        folder = fmpy.platform_tuple if about.fmiMajorVersion == 3 else fmpy.platform
        with ZipFile(file) as archive:
            binaries = [
                name
                for name in archive.namelist()
                if name.startswith("binaries/") and name.endswith(_LIBRARIES)
            ]
        if not any(name.startswith(f"binaries/{folder}/") for name in binaries):
            raise EngineMissing(
                f"{self.name}: found {', '.join(binaries) or 'no binaries'}; expected one in "
                f"binaries/{folder}"
            )
        # A model by co-simulation has a solver of its own. Only CVode adapts its steps and locates
        # events, whatever the map declares.
        self.solver = ""
        if self.interface == MODEL_EXCHANGE:
            self.solver = "CVode" if has_cvode() else "Euler"
        by_cvode = self.solver == "CVode"
        self.declared = chosen.capabilities.model_copy(
            update={
                "adaptive": chosen.capabilities.adaptive or by_cvode,
                "locates_events": chosen.capabilities.locates_events and by_cvode,
            }
        )

    def content(self) -> bytes:
        chosen = self.map_file.read_bytes() if self.map_file.is_file() else b""
        return self.file.read_bytes() + chosen + self.version.encode()

    def default_settings(self, fidelity: Fidelity) -> Mapping[str, Any]:
        return {LOGGING: False}

    def check_arguments(
        self,
        *,
        dt: float | None,
        rtol: float | None,
        fidelity: Fidelity,
        settings: Mapping[str, Any],
    ) -> None:
        """See `Engine.check_arguments`; co-simulation takes both, a step and a tolerance."""
        if self.interface == CO_SIMULATION:
            dt = rtol = None
        super().check_arguments(dt=dt, rtol=rtol, fidelity=fidelity, settings=settings)
        if not isinstance(chosen := settings.get(LOGGING, False), bool):
            raise InputError(f"{LOGGING}: found {chosen!r}; expected true or false")

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        """See `Engine.refusal`: another scene than the FMU states, columns that it lacks, friction not declared."""
        if reason := self.variables.refusal(scene):
            return f"{self.name}: {reason}"
        return super().refusal(scene, fidelity)

    def run(
        self,
        scene: Scene,
        *,
        t_end: float,
        dt: float | None,
        rtol: float | None,
        fidelity: Fidelity,
        output_step: float,
        settings: Mapping[str, Any],
        assembly: Assembly | None = None,
    ) -> Trajectory:
        by_steps = self.solver != "CVode"
        # A run to a tolerance is recorded at the outputs; other runs have steps, of which each
        # `grid.every`-th is an output.
        if not by_steps or self.declared.adaptive and dt is None:
            rtol = rtol or DEFAULT_RTOL
            dt = t_end / math.ceil(t_end / output_step - _QUOTIENT_ROUNDING)
        grid = Grid.of(t_end, step_of(dt, t_end), output_step)
        values, logging = self.variables.settable(scene), settings.get(LOGGING, False)
        rows, setup, stepping = self._simulate(scene, grid, rtol, values, logging)
        with self.reading():
            table = result_table(
                self.variables.columns(scene, rows),
                scene.model_copy(update={"t_end": t_end}),
                origin=self.name,
                has_map_option=False,
            )
        chosen = {
            "dt": grid.dt if by_steps else None,
            "rtol": rtol,
            "interface": self.interface,
            "solver": f"{self.solver} (fmpy)" if self.solver else None,
            LOGGING: logging,
            "parameters": " ".join(f"{name}={value:.12g}" for name, value in values.items()),
            "units without a definition, taken as SI": ", ".join(
                self.variables.undefined_units(scene)
            )
            or None,
        }
        until, cost = (
            float(table.t[-1]),
            Cost(setup, 0.0, stepping, {"steps": grid.last} if by_steps else {}),
        )
        return self.trajectory(
            scene,
            table,
            lambda columns: [
                Event(time, kind, guide, before, after)
                for time, before, after in table.jumps(columns)
                for kind, guide in changed_modes(scene.frictional_guides, before, after)
            ],
            {key: value for key, value in chosen.items() if value is not None},
            cost,
            "end"
            if until > (grid.last - 0.5) * grid.dt
            else f"the FMU ended the run at t = {until:.9g} s",
            assembly,
        )

    def _simulate(
        self,
        scene: Scene,
        grid: Grid,
        rtol: float | None,
        values: Mapping[str, float],
        logging: bool,
    ) -> tuple[np.ndarray, float, float]:
        """Return the rows that fmpy has recorded, and CPU seconds before the first step and from there on."""
        from fmpy import extract, instantiate_fmu, simulate_fmu

        description, began = self.variables.description, process_time()
        logged: list[str] = []
        failures: list[BaseException] = []
        by_steps = self.interface == CO_SIMULATION
        kind = "CoSimulation" if by_steps else "ModelExchange"
        with TemporaryDirectory(prefix="stiction-fmu-", ignore_cleanup_errors=True) as folder:
            try:
                extract(self.file, folder)
                fmu = instantiate_fmu(
                    folder, description, kind, debug_logging=logging, logger=_logger(logged)
                )
                started = process_time()
                with _noting(failures):
                    rows = simulate_fmu(
                        folder,
                        fmu_instance=fmu,
                        model_description=description,
                        fmi_type=kind,
                        start_time=0.0,
                        stop_time=grid.last * grid.dt,
                        step_size=grid.dt,
                        output_interval=grid.dt,
                        solver=self.solver,
                        relative_tolerance=rtol,
                        record_events=self.declared.locates_events,
                        start_values=dict(values),
                        output=self.variables.names(scene),
                        step_finished=_thinned(grid.every) if by_steps else None,
                    )
                if failures:
                    raise failures[0]
                fmu.freeInstance()  # only here: after an error no function is safe to call
            except Exception as error:  # fmpy raises Exception itself
                # The cause is an exception in a callback, if there was one; the FMU's own log may
                # explain it.
                cause, words = next(iter(failures), error), last_lines("\n".join(logged))
                if words:
                    log = f"It logged: {words}"
                elif logging:
                    log = "It logged nothing"
                else:
                    log = f"It logged nothing; --setting {LOGGING}=true may bring more"
                raise EngineFailure(
                    f"{self.name}: {str(cause) or type(cause).__name__} {log}"
                ) from error
        if self.solver == "Euler":
            rows = rows[:: grid.every]
        return rows, started - began, process_time() - started


def has_cvode() -> bool:
    """Return True if fmpy has a library of CVode for this machine."""
    try:
        return bool(import_module("fmpy.sundials"))
    except OSError:
        return False


def _read(file: Path, chosen: Map, map_file: Path) -> tuple[Variables, str]:
    """Return the variables and the interface of an FMU; raise FileError if it cannot be used."""
    from fmpy import read_model_description

    try:
        description = read_model_description(str(file), validate=False)
        interfaces = {
            CO_SIMULATION: description.coSimulation,
            MODEL_EXCHANGE: description.modelExchange,
        }
        offered = [name for name, interface in interfaces.items() if interface is not None]
        if description.fmiMajorVersion not in (2, 3) or not offered:
            raise EngineFailure(
                f"FMI {description.fmiVersion}, {' and '.join(offered) or 'no interface'}"
            )
    except Exception as error:  # fmpy raises Exception itself, for versions and references
        raise FileError(
            str(file),
            [
                Problem(
                    "modelDescription.xml",
                    shortened(str(error), _LONGEST_ERROR),
                    "expected an FMU: an archive with the description of a model of FMI 2 or "
                    "3, for co-simulation or model exchange",
                )
            ],
        ) from None
    chosen_interface = chosen.interface or offered[0]
    variables = Variables(description, chosen, map_file.name)
    problems = list(variables.problems())
    if chosen_interface not in offered:
        problems.append(
            Problem(
                "interface",
                shown(chosen_interface),
                f"expected {' or '.join(offered)}: the FMU has no other",
            )
        )
    elif chosen.capabilities.locates_events and chosen_interface == CO_SIMULATION:
        problems.append(
            Problem(
                "capabilities.locates_events",
                "true",
                "expected false: co-simulation does not stop at events",
            )
        )
    if problems:
        raise FileError(str(map_file), problems)
    return variables, chosen_interface


def _logger(logged: list[str]) -> Callable[..., None]:
    """Return a logger that collects the messages of an FMU, and prints them in case it ends the process."""

    def log(*arguments: Any) -> None:
        # FMI 2 also gives the name of the instance, before these three. A status of 0 is no trouble.
        status, _, message = arguments[-3:]
        text = message.decode(errors="replace").strip() if message else ""
        if status and text:
            logged.append(text)
            print(text, file=sys.stderr, flush=True)

    return log


@contextmanager
def _noting(failures: list[BaseException]) -> Iterator[None]:
    """Collect exceptions that are raised in callbacks from C, which ctypes does not pass on."""

    def note(lost: Any) -> None:
        if "ctypes" in str(lost.err_msg):
            failures.append(lost.exc_value)
        else:
            before(lost)

    before, sys.unraisablehook = sys.unraisablehook, note
    try:
        yield
    finally:
        sys.unraisablehook = before


def _thinned(every: int) -> Callable[[float, Any], bool]:
    """Return a callback that keeps each `every`-th row of fmpy, and raises RuntimeError if a step does not advance."""
    latest, step = -math.inf, 0

    def finished(time: float, recorder: Any) -> bool:
        nonlocal latest, step
        if not time > latest:
            raise RuntimeError(f"the FMU discards the step at t = {time:.9g} s")
        latest, step = time, step + 1
        if step % every:
            recorder.rows.pop()
        return True

    return finished
