"""A program in any language as an engine, which reads a resolved scene and writes a table of results."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError

from stiction.engines.assembly import Assembly
from stiction.engines.program.declaration import Declaration
from stiction.engines.program.process import ProgramEnd, run_program
from stiction.engines.protocol import BadTrajectory, EngineFailure, Refused
from stiction.engines.registry import EngineBroken, EngineMissing
from stiction.engines.shared.declared_engine import DEFAULT_RTOL, DeclaredEngine, read_declaration
from stiction.engines.shared.fixed_step import step_of
from stiction.scenes import Cost, Event, Scene, Trajectory
from stiction.scenes.errors import problems_of
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.fields import Model
from stiction.scenes.resolved import resolved_text
from stiction.scenes.result_table import ResultTable, result_table
from stiction.scenes.wording import as_given, shown

REFUSAL = 77
"""Exit code of a program that cannot represent the scene; the last lines of its output are the reason."""
VERSION_S = 20.0
"""Time limit of the version command, s."""
_SAME = 1e-9
"""Largest difference of times that count as the same instant, relative to t_end."""
_MIB = 2**20
"""Bytes in a mebibyte."""
_MAX_CACHED_VERSIONS = 64
"""Number of answers of version commands that are kept in memory."""
_LONGEST_VERSION = 80
"""Largest number of characters of a version."""


class _Event(Model):
    """An event in the report of a program: its time (s), its kind, and the guide."""

    time: float
    kind: str
    joint: str


class _Report(Model):
    """Second file of a program, which is optional.

    Attributes
    ----------
    events
        The events.
    counters
        Counters of the run, such as steps.
    setup_s, engine_s
        CPU time of setting up, and of the solver's own calls, s.
    termination
        "end", or why the run ended early.
    """

    events: tuple[_Event, ...] = ()
    counters: dict[str, int] = {}
    setup_s: Annotated[float, Field(ge=0)] = 0.0
    engine_s: Annotated[float, Field(ge=0)] | None = None
    termination: Annotated[str, Field(min_length=1)] = "end"


class ProgramEngine(DeclaredEngine):
    """A program that is declared in a TOML file (docs/how-to/program.md).

    It reads a scene in its resolved form, and writes a table with ``t``, positions and velocities of all bodies, and
    those accelerations, reactions, frictions and modes that it computes, by the names of columns. Missing accelerations
    are differences of velocities, and missing forces follow from the balance of momentum.

    Raises
    ------
    FileError
        With all problems of the file at once.
    EngineMissing, EngineBroken
        If there is no such program, or it does not answer with its version.
    """

    version = ""

    def __init__(self, file: Path):
        declaration = read_declaration(file, Declaration)
        self.file = file
        self.declaration = declaration
        self.name = declaration.name
        self.folder = file.parent / declaration.folder
        self.declared = declaration.capabilities
        if os.name != "posix":
            raise EngineMissing(f"{self.name}: programs run on Linux and macOS")
        if not self.folder.is_dir():
            raise EngineMissing(
                f"{self.name}: found no folder {self.folder}; expected the working folder of its "
                "program"
            )
        self._program = self._find_program(declaration.command[0])
        # Files that the command names, such as a script, are part of the program: the version command
        # is run again when one of them has changed.
        paths = [self._program, *(self.folder / word for word in declaration.command[1:])]
        self._files = [path for path in paths if path.is_file()]
        command = (str(self._find_program(declaration.version[0])), *declaration.version[1:])
        environment = tuple(declaration.environment.items())
        stamps = tuple((path, path.stat().st_mtime_ns, path.stat().st_size) for path in self._files)
        self.version, end = _ask_version(command, self.folder, environment, stamps)
        if not self.version:
            raise EngineBroken(
                f"{self.name}: its version command fails: {' '.join(command)}: {end}; expected a line "
                "with the version"
            )

    def _find_program(self, word: str) -> Path:
        """Return the program of a command: a path from the working folder if it has a slash, or one on PATH."""
        path = self.folder / word if "/" in word else shutil.which(word)
        if path is None or not os.access(path, os.X_OK) or Path(path).is_dir():
            place = "on PATH" if path is None else f"as {path}"
            raise EngineMissing(
                f"{self.name}: found no program {shown(word)} {place}; expected one that can be "
                f"executed (command, version in {self.file})"
            )
        return Path(path)

    def content(self) -> bytes:
        """See `Engine.content`: files that the command names may change without a new version."""
        return b"".join(
            [
                self.file.read_bytes(),
                self.version.encode(),
                *(path.read_bytes() for path in self._files),
            ]
        )

    def default_settings(self, fidelity: Fidelity) -> Mapping[str, Any]:
        return self.declaration.settings

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
        accuracy: dict[str, float] = {}
        if self.declared.adaptive:
            accuracy["rtol"] = rtol or DEFAULT_RTOL
        else:
            accuracy["dt"] = step_of(dt, t_end)
        all_settings = {**self.declaration.settings, **settings}
        scene_of_run = scene.model_copy(update={"t_end": t_end})
        with TemporaryDirectory(prefix="stiction-program-", ignore_cleanup_errors=True) as name:
            folder = Path(name)
            files = {
                "scene": folder / "scene.json",
                "result": folder / f"result.{self.declaration.result}",
                "events": folder / "events.json",
            }
            files["scene"].write_text(resolved_text(scene_of_run), encoding="utf-8")
            # Numbers are written so that they are read back exactly.
            numbers = {"t_end": t_end, "output_step": output_step, **accuracy}
            values = {key: str(path) for key, path in files.items()}
            values |= {key: repr(float(number)) for key, number in numbers.items()}
            words = [f"{key}={as_given(value)}" for key, value in all_settings.items()]
            arguments = self.declaration.arguments(values, words)
            end = self._run_to_end([str(self._program), *arguments], folder)
            if not files["result"].is_file():
                raise BadTrajectory(
                    f"{self.name} returned no file; expected one at {{result}}: {end.words}"
                )
            with self.reading():
                table = result_table(files["result"], scene_of_run, has_map_option=False)
            report = self._read_report(files["events"])
        # The program's own times cannot exceed the CPU time that the system measured.
        setup_s = min(report.setup_s, end.cpu_s)
        stepping_s = end.cpu_s - setup_s
        engine_s = None if report.engine_s is None else min(report.engine_s, stepping_s)
        return self.trajectory(
            scene,
            table,
            lambda columns: self._events(report, table, columns, t_end),
            accuracy | all_settings,
            Cost(setup_s, 0.0, stepping_s, report.counters, engine_s),
            report.termination,
            assembly,
        )

    def _run_to_end(self, command: list[str], folder: Path) -> ProgramEnd:
        """Run a program, whose files are in a folder, and return its end.

        Raises
        ------
        Refused
            If the program cannot represent the scene.
        EngineFailure
            If the program has failed, or a file has reached the limit of its size.
        """
        limit = self.declaration.largest_file * _MIB
        end = run_program(
            command, self.folder, self.declaration.environment, folder / "printed.txt", limit
        )
        # A refusal is no failure: the program has judged the scene, and its message is the reason.
        if end.code == REFUSAL:
            raise Refused(
                end.last_lines
                or f"{self.name} ended with exit code {REFUSAL}, a refusal, and printed no reason"
            )
        # A program whose file has reached the limit may end as if nothing had happened.
        full = [path.name for path in folder.iterdir() if path.stat().st_size >= limit]
        excess = ""
        if full:
            excess = (
                f"; {' and '.join(full)}: reached the limit of {self.declaration.largest_file} MiB"
            )
        if end.code != 0 or full:
            raise EngineFailure(f"{self.name}: {end.words}{excess}")
        return end

    def _read_report(self, path: Path) -> _Report:
        """Return the report of a program; an empty one if it has written none."""
        if not path.is_file():
            return _Report()
        try:
            return _Report.model_validate_json(path.read_bytes())
        except ValidationError as error:
            problem = next(problems_of(error, _Report))
            raise BadTrajectory(
                f"{self.name} returned events that cannot be used: {problem}"
            ) from None

    def _events(
        self, report: _Report, table: ResultTable, columns: Mapping[str, np.ndarray], t_end: float
    ) -> Iterator[Event]:
        """Yield events with the two rows of the table at their times."""
        sides = list(table.jumps(columns))
        times = np.array([time for time, *_ in sides])
        for event in report.events:
            near = np.flatnonzero(np.abs(times - event.time) <= _SAME * t_end)
            if not len(near):
                raise BadTrajectory(
                    f"{self.name} returned {event.kind} of {event.joint} at t = {event.time:.12g} s; "
                    "expected two rows of the result at that time, before and after it"
                )
            time, before, after = sides[near[0]]
            yield Event(time, event.kind, event.joint, before, after)


@lru_cache(maxsize=_MAX_CACHED_VERSIONS)
def _ask_version(
    command: tuple[str, ...],
    folder: Path,
    environment: tuple[tuple[str, str], ...],
    files: tuple[tuple[Path, int, int], ...],
) -> tuple[str, str]:
    """Return the first line of the output of the version command, empty if it fails, and its end in words.

    The command is run again if one of `files`, with their times and sizes, has changed.
    """
    with TemporaryDirectory(prefix="stiction-program-") as scratch:
        log = Path(scratch) / "printed.txt"
        end = run_program(command, folder, dict(environment), log, _MIB, VERSION_S)
        output = log.read_text(errors="replace") if end.code == 0 else ""
    first_line = output.partition("\n")[0]
    return first_line.strip()[:_LONGEST_VERSION], end.words
