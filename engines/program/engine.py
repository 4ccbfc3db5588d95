"""A program in any language as an engine: a resolved scene goes out as a file, a table of results comes back."""

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
from stiction.engines.program.process import Ended, run_program
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
"""Exit code of a program that cannot represent the scene; the last lines that it printed say why."""
VERSION_S = 20.0
"""Seconds for the version command."""
_SAME = 1e-9
"""Difference of times that are the same instant, relative to t_end."""
_MIB = 2**20
"""Bytes in a mebibyte."""
_VERSIONS_KEPT = 64
"""Number of answers of version commands that are kept in memory."""
_LONGEST_VERSION = 80
"""Characters of a version."""


class _Event(Model):
    time: float
    kind: str
    joint: str


class _Report(Model):
    """Second file of a program: events, counters, CPU seconds of set-up, then in its solver, why it stopped early."""

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
        self.file, self.declaration = file, (declared := read_declaration(file, Declaration))
        self.name, self.folder, self.declared = (
            declared.name,
            file.parent / declared.folder,
            declared.capabilities,
        )
        if os.name != "posix":
            raise EngineMissing(f"{self.name}: programs run on Linux and macOS")
        if not self.folder.is_dir():
            raise EngineMissing(
                f"{self.name}: found no folder {self.folder}; expected the working folder of its "
                "program"
            )
        self._program = self._found(declared.command[0])
        # Files that the command names, such as a script, are part of the program: the version is
        # asked for again when one has changed.
        paths = [self._program, *(self.folder / word for word in declared.command[1:])]
        self._files = [path for path in paths if path.is_file()]
        version = str(self._found(declared.version[0])), *declared.version[1:]
        stamps = tuple((path, path.stat().st_mtime_ns, path.stat().st_size) for path in self._files)
        self.version, words = _answer(
            version, self.folder, tuple(declared.environment.items()), stamps
        )
        if not self.version:
            raise EngineBroken(
                f"{self.name}: its version command fails: {' '.join(version)}: {words}; expected a line "
                "with the version"
            )

    def _found(self, word: str) -> Path:
        """Return the program of a command: a path from the working folder if it has a slash, or one on PATH."""
        path = self.folder / word if "/" in word else shutil.which(word)
        if path is None or not os.access(path, os.X_OK) or Path(path).is_dir():
            where = "on PATH" if path is None else f"as {path}"
            raise EngineMissing(
                f"{self.name}: found no program {shown(word)} {where}; expected one that can be "
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
        declared = self.declaration
        chosen = {**declared.settings, **settings}
        method = (
            {"rtol": rtol or DEFAULT_RTOL} if self.declared.adaptive else {"dt": step_of(dt, t_end)}
        )
        handed = scene.model_copy(update={"t_end": t_end})
        with TemporaryDirectory(prefix="stiction-program-", ignore_cleanup_errors=True) as name:
            place = Path(name)
            files = {
                "scene": place / "scene.json",
                "result": place / f"result.{declared.result}",
                "events": place / "events.json",
            }
            files["scene"].write_text(resolved_text(handed), encoding="utf-8")
            numbers = {"t_end": t_end, "output_step": output_step, **method}
            values = {
                **{key: str(path) for key, path in files.items()},
                **{key: repr(float(value)) for key, value in numbers.items()},
            }
            # Numbers are written so that they are read back exactly.
            words = [f"{key}={as_given(value)}" for key, value in chosen.items()]
            ended = self._ended([str(self._program), *declared.arguments(values, words)], place)
            if not files["result"].is_file():
                raise BadTrajectory(
                    f"{self.name} returned no file; expected one at {{result}}: {ended.words}"
                )
            with self.reading():
                table = result_table(files["result"], handed, has_map_option=False)
            report = self._report(files["events"])
        # The program's own times cannot be more than the CPU time that the system measured.
        setup = min(report.setup_s, ended.cpu_s)
        stepping = ended.cpu_s - setup
        engine_s = None if report.engine_s is None else min(report.engine_s, stepping)
        return self.trajectory(
            scene,
            table,
            lambda columns: self._events(report, table, columns, t_end),
            method | chosen,
            Cost(setup, 0.0, stepping, report.counters, engine_s),
            report.termination,
            assembly,
        )

    def _ended(self, command: list[str], place: Path) -> Ended:
        """Run a program, whose files are in a folder; return its end if it has not failed."""
        most = self.declaration.largest_file * _MIB
        ended = run_program(
            command, self.folder, self.declaration.environment, place / "printed.txt", most
        )
        # A refusal is no failure: the program has judged the scene, and its message is the reason.
        if ended.code == REFUSAL:
            raise Refused(
                ended.said
                or f"{self.name} ended with exit code {REFUSAL}, a refusal, and printed no reason"
            )
        # A program whose file has reached the limit may have ended as if nothing had happened.
        full = [path.name for path in place.iterdir() if path.stat().st_size >= most]
        too_much = (
            f"; {' and '.join(full)}: reached the limit of {self.declaration.largest_file} MiB"
            if full
            else ""
        )
        if ended.code != 0 or too_much:
            raise EngineFailure(f"{self.name}: {ended.words}{too_much}")
        return ended

    def _report(self, path: Path) -> _Report:
        try:
            return _Report.model_validate_json(path.read_bytes()) if path.is_file() else _Report()
        except ValidationError as error:
            wrong = next(problems_of(error, _Report))
            raise BadTrajectory(
                f"{self.name} returned events that cannot be used: {wrong}"
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


@lru_cache(maxsize=_VERSIONS_KEPT)
def _answer(
    command: tuple[str, ...],
    folder: Path,
    environment: tuple[tuple[str, str], ...],
    files: tuple[tuple[Path, int, int], ...],
) -> tuple[str, str]:
    """Return the first line that the version command prints, empty if it fails, and how it ended.

    The command is run again if one of `files`, with their times and sizes, has changed.
    """
    with TemporaryDirectory(prefix="stiction-program-") as scratch:
        log = Path(scratch) / "printed.txt"
        ended = run_program(command, folder, dict(environment), log, _MIB, VERSION_S)
        first = log.read_text(errors="replace").partition("\n")[0] if ended.code == 0 else ""
    return first.strip()[:_LONGEST_VERSION], ended.words
