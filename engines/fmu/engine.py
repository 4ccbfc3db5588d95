"""An FMU as an engine, which fmpy steps by co-simulation or integrates by model exchange."""

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
"""Ending of the file with the names and capabilities of an FMU."""
LOGGING = "logging"
"""Setting that turns the debug logging of an FMU on."""
_LIBRARIES = (".so", ".dylib", ".dll")
"""Endings of shared libraries."""
_QUOTIENT_ROUNDING = 1e-9
"""Rounding of t_end divided by an output step: the quotient may be just above a whole number."""
_LONGEST_VERSION = 40
"""Largest number of characters of the version that an FMU states."""
_LONGEST_ERROR = 160
"""Largest number of characters of fmpy's message about a model description, which may quote the description."""


class FmuEngine(DeclaredEngine):
    """An FMU (FMI 2 or 3), with the names and capabilities of ``model.map.toml`` next to it, if there is one.

    By co-simulation dt is the communication step, and rtol, if given, goes to the FMU's own solver. By model exchange
    fmpy's CVode integrates to rtol and locates events; where fmpy has no CVode, Euler's method steps by dt.
    Missing accelerations are differences of velocities, and forces follow from the balance of momentum. The setting
    `logging` turns the FMU's debug logging on; a failed run quotes the log in its reason.

    Raises
    ------
    FileError
        If the file or its map cannot be used, with all problems.
    EngineMissing
        If fmpy is not installed, or the FMU has no binary for this machine.
    """

    version = ""

    def __init__(self, file: Path):
        import fmpy

        self.file = file
        self.name = file.stem
        self.map_file = file.with_name(file.stem + MAP)
        fmpy_version = check_version("fmpy", fmpy.__version__)
        names = read_declaration(self.map_file, Map) if self.map_file.is_file() else Map()
        self.variables, self.interface = _read(file, names, self.map_file)
        description = self.variables.description
        stated = description.version or description.generationDateAndTime or description.guid
        self.version = (
            f"{shortened(stated, _LONGEST_VERSION)} (FMI {description.fmiVersion}, "
            f"fmpy {fmpy_version})"
        )
        self._check_binaries(
            fmpy.platform_tuple if description.fmiMajorVersion == 3 else fmpy.platform
        )
        # A model by co-simulation has a solver of its own. Only CVode adapts its steps and locates
        # events, independently of the map.
        self.solver = ""
        if self.interface == MODEL_EXCHANGE:
            self.solver = "CVode" if has_cvode() else "Euler"
        is_cvode = self.solver == "CVode"
        self.declared = names.capabilities.model_copy(
            update={
                "adaptive": names.capabilities.adaptive or is_cvode,
                "locates_events": names.capabilities.locates_events and is_cvode,
            }
        )

    def _check_binaries(self, platform: str) -> None:
        """Raise EngineMissing if the FMU has no shared library for a platform, by fmpy's name of it."""
        with ZipFile(self.file) as archive:
            files = archive.namelist()
        binaries = [
            name for name in files if name.startswith("binaries/") and name.endswith(_LIBRARIES)
        ]
        if not any(name.startswith(f"binaries/{platform}/") for name in binaries):
            raise EngineMissing(
                f"{self.name}: found {', '.join(binaries) or 'no binaries'}; expected one in "
                f"binaries/{platform}"
            )

    def content(self) -> bytes:
        names = self.map_file.read_bytes() if self.map_file.is_file() else b""
        return self.file.read_bytes() + names + self.version.encode()

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
        """See `Engine.check_arguments`; co-simulation accepts both a step and a tolerance."""
        if self.interface == CO_SIMULATION:
            dt = rtol = None
        super().check_arguments(dt=dt, rtol=rtol, fidelity=fidelity, settings=settings)
        logging = settings.get(LOGGING, False)
        if not isinstance(logging, bool):
            raise InputError(f"{LOGGING}: found {logging!r}; expected true or false")

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        """See `Engine.refusal`. Refused are other scenes than the FMU states, and scenes whose columns it lacks."""
        reason = self.variables.refusal(scene)
        if reason:
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
        has_fixed_step = self.solver != "CVode"
        # A run to a tolerance is recorded at the outputs. Other runs have steps, and each
        # `grid.every`-th of them is an output.
        if not has_fixed_step or (self.declared.adaptive and dt is None):
            rtol = rtol or DEFAULT_RTOL
            dt = t_end / math.ceil(t_end / output_step - _QUOTIENT_ROUNDING)
        grid = Grid.of(t_end, step_of(dt, t_end), output_step)
        parameters = self.variables.settable(scene)
        logging = settings.get(LOGGING, False)
        rows, setup_s, stepping_s = self._simulate(scene, grid, rtol, parameters, logging)
        with self.reading():
            table = result_table(
                self.variables.columns(scene, rows),
                scene.model_copy(update={"t_end": t_end}),
                origin=self.name,
                has_map_option=False,
            )

        def events(columns: Mapping[str, np.ndarray]) -> Iterator[Event]:
            for time, before, after in table.jumps(columns):
                for kind, guide in changed_modes(scene.frictional_guides, before, after):
                    yield Event(time, kind, guide, before, after)

        last_time = float(table.t[-1])
        termination = "end"
        if not last_time > (grid.last - 0.5) * grid.dt:
            termination = f"the FMU ended the run at t = {last_time:.9g} s"
        return self.trajectory(
            scene,
            table,
            events,
            self._settings_of_run(scene, grid, rtol, parameters, logging),
            Cost(setup_s, 0.0, stepping_s, {"steps": grid.last} if has_fixed_step else {}),
            termination,
            assembly,
        )

    def _settings_of_run(
        self,
        scene: Scene,
        grid: Grid,
        rtol: float | None,
        parameters: Mapping[str, float],
        logging: bool,
    ) -> dict[str, Any]:
        """Return the settings that a trajectory stores, without those that do not apply."""
        settings = {
            "dt": grid.dt if self.solver != "CVode" else None,
            "rtol": rtol,
            "interface": self.interface,
            "solver": f"{self.solver} (fmpy)" if self.solver else None,
            LOGGING: logging,
            "parameters": " ".join(f"{name}={value:.12g}" for name, value in parameters.items()),
            "units without a definition, taken as SI": (
                ", ".join(self.variables.undefined_units(scene)) or None
            ),
        }
        return {name: value for name, value in settings.items() if value is not None}

    def _simulate(
        self,
        scene: Scene,
        grid: Grid,
        rtol: float | None,
        parameters: Mapping[str, float],
        logging: bool,
    ) -> tuple[np.ndarray, float, float]:
        """Return the rows that fmpy has recorded, and the CPU seconds before the first step and after its start."""
        from fmpy import extract, instantiate_fmu, simulate_fmu

        description = self.variables.description
        setup_begin = process_time()
        logged: list[str] = []
        failures: list[BaseException] = []
        is_co_simulation = self.interface == CO_SIMULATION
        kind = "CoSimulation" if is_co_simulation else "ModelExchange"
        with TemporaryDirectory(prefix="stiction-fmu-", ignore_cleanup_errors=True) as folder:
            try:
                extract(self.file, folder)
                fmu = instantiate_fmu(
                    folder, description, kind, debug_logging=logging, logger=_logger(logged)
                )
                stepping_begin = process_time()
                with _collect_callback_errors(failures):
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
                        start_values=dict(parameters),
                        output=self.variables.names(scene),
                        step_finished=_keep_outputs(grid.every) if is_co_simulation else None,
                    )
                if failures:
                    raise failures[0]
                fmu.freeInstance()  # only here: after an error no function is safe to call
            except Exception as error:  # fmpy raises Exception itself
                # The cause is an exception in a callback, if there was one; the FMU's own log may
                # explain it.
                cause = failures[0] if failures else error
                log = _describe_log(logged, logging)
                raise EngineFailure(
                    f"{self.name}: {str(cause) or type(cause).__name__} {log}"
                ) from error
        if self.solver == "Euler":
            rows = rows[:: grid.every]
        return rows, stepping_begin - setup_begin, process_time() - stepping_begin


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


def _describe_log(logged: list[str], logging: bool) -> str:
    """Return a sentence about the messages that an FMU has logged."""
    text = last_lines("\n".join(logged))
    if text:
        return f"It logged: {text}"
    if logging:
        return "It logged nothing"
    return f"It logged nothing; --setting {LOGGING}=true may bring more"


def _logger(logged: list[str]) -> Callable[..., None]:
    """Return a logger that collects the messages of an FMU, and prints them in case it ends the process."""

    def log(*arguments: Any) -> None:
        # FMI 2 also passes the name of the instance, before these three. A status of 0 is no problem.
        status, _, message = arguments[-3:]
        text = message.decode(errors="replace").strip() if message else ""
        if status and text:
            logged.append(text)
            print(text, file=sys.stderr, flush=True)

    return log


@contextmanager
def _collect_callback_errors(failures: list[BaseException]) -> Iterator[None]:
    """Collect exceptions that are raised in callbacks from C, which ctypes does not pass on."""
    previous_hook = sys.unraisablehook

    def hook(unraisable: Any) -> None:
        if "ctypes" in str(unraisable.err_msg):
            failures.append(unraisable.exc_value)
        else:
            previous_hook(unraisable)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = previous_hook


def _keep_outputs(every: int) -> Callable[[float, Any], bool]:
    """Return a callback that keeps each `every`-th row of fmpy, and raises RuntimeError if a step does not advance."""
    latest = -math.inf
    step = 0

    def step_finished(time: float, recorder: Any) -> bool:
        nonlocal latest, step
        if not time > latest:
            raise RuntimeError(f"the FMU discards the step at t = {time:.9g} s")
        latest = time
        step += 1
        if step % every:
            recorder.rows.pop()
        return True

    return step_finished
