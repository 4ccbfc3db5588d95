"""A program in any language as an engine: a resolved scene goes out as a file, a table of results comes back."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError

from stiction.engines.program.declaration import Declaration
from stiction.engines.program.process import Ended, run_program
from stiction.engines.protocol import BadTrajectory, EngineFailure, Refused
from stiction.engines.registry import BUILT_IN, EngineBroken, EngineMissing
from stiction.engines.shared.declared_engine import (DEFAULT_RTOL, Declared, DeclaredEngine, all_columns,
                                                     read_declaration, results_of)
from stiction.engines.shared.fixed_step import step_of
from stiction.scenes import Cost, Event, FileError, Problem, Scene, Trajectory
from stiction.scenes.errors import problems_in_tables
from stiction.scenes.fields import Model
from stiction.scenes.resolved import resolved_text
from stiction.scenes.result_table import ResultTable, read_result
from stiction.scenes.trajectory import rows_of
from stiction.scenes.wording import as_given, shown

REFUSAL = 77
"""Exit code of a program that cannot represent the scene; the last lines that it printed say why."""
VERSION_S = 20.0
"""Seconds for the version command."""
_SAME = 1e-9  # of t_end: times that are the same instant


class ProgramError(FileError):
    """A declaration of a program that cannot be used."""


class _Event(Model):
    time: float
    kind: str
    joint: str


class _Report(Model):
    """Second file of a program: events, counters, CPU seconds before the first step, and why it stopped early."""

    events: tuple[_Event, ...] = ()
    counters: dict[str, int] = {}
    setup_s: Annotated[float, Field(ge=0)] = 0.0
    termination: Annotated[str, Field(min_length=1)] = "end"


@dataclass(frozen=True)
class Product:
    """What a program has made of a scene.

    Attributes
    ----------
    table : ResultTable
    report : _Report
    settings : Mapping
        Step or tolerance, and settings of the program.
    cpu_s : float
        CPU seconds of the program.
    """

    table: ResultTable
    report: _Report
    settings: Mapping[str, Any]
    cpu_s: float


class ProgramEngine(DeclaredEngine):
    """A program that is declared in a TOML file (`stiction.engines.program.declaration`).

    It reads a scene in its resolved form, and writes a table: ``t``, positions and velocities of all bodies, and what
    it has of accelerations, reactions, frictions and modes, by the names of columns. Accelerations that it does not
    give are differences of velocities, and forces follow from the balance of momentum.

    Raises
    ------
    ProgramError
        With all problems of the file at once.
    EngineMissing, EngineBroken
        If there is no such program, or it does not answer with its version.
    """

    def __init__(self, file: Path):
        self.file, self.declaration = file, _read(file)
        self.name = self.declaration.name
        self.declare(self.declaration.capabilities)
        if os.name != "posix":
            raise EngineMissing(f"{self.name}: programs run on Linux and macOS")
        self.folder = file.parent / self.declaration.folder
        self._program, asked = (self._found(words[0]) for words in (self.declaration.command, self.declaration.version))
        self._version = _answer(self.name, (str(asked), *self.declaration.version[1:]), self.folder,
                                tuple(self.declaration.environment.items()), self._digests())

    @property
    def version(self) -> str:
        return self._version

    def _found(self, word: str) -> Path:
        """The program of a command: a path from the working folder where it has a slash, else one on PATH."""
        if not self.folder.is_dir():
            raise EngineMissing(f"{self.name}: found no folder {self.folder}; expected the working folder of its "
                                "program")
        path = self.folder / word if "/" in word else shutil.which(word)
        if path is None or not os.access(path, os.X_OK) or Path(path).is_dir():
            where = "on PATH" if path is None else f"as {path}"
            raise EngineMissing(f"{self.name}: found no program {shown(word)} {where}; expected one that can be "
                                f"executed (command, version in {self.file})")
        return Path(path)

    def _digests(self) -> bytes:
        """Digests of the files that the command names: a program may change without a new version."""
        paths = [self._program, *(self.folder / word for word in self.declaration.command[1:])]
        return b"".join(_digest(path, path.stat().st_mtime_ns, path.stat().st_size) for path in paths if path.is_file())

    def content(self) -> bytes:
        return self.file.read_bytes() + self.version.encode() + self._digests()

    def default_settings(self, fidelity: str) -> Mapping[str, Any]:
        return self.declaration.settings

    def run(self, scene: Scene, *, t_end: float, dt: float | None, rtol: float | None, fidelity: str,
            output_step: float, settings: Mapping[str, Any]) -> Trajectory:
        made = self.product(scene, t_end, dt, rtol, output_step, settings)
        columns, extra = all_columns(scene, made.table, self.name)
        setup, last = min(made.report.setup_s, made.cpu_s), made.table.last
        return Trajectory(
            scene=scene.name, engine=self.name, version=self.version, fidelity=fidelity, t=made.table.t[last],
            columns={name: values[last] for name, values in columns.items()},
            events=tuple(self._events(made, columns, t_end)), termination=made.report.termination,
            settings={**made.settings, **extra, "friction_law": self.capabilities.friction_law[fidelity]},
            cost=Cost(setup, 0.0, made.cpu_s - setup, made.report.counters))

    def product(self, scene: Scene, t_end: float, dt: float | None, rtol: float | None, output_step: float,
                settings: Mapping[str, Any]) -> Product:
        """Run the program and read what it has written; for arguments see `Engine.run`.

        Raises
        ------
        Refused, EngineFailure, BadTrajectory
        """
        chosen = {**self.declaration.settings, **settings}
        method = {"rtol": rtol or DEFAULT_RTOL} if self.declared.adaptive else {"dt": step_of(dt, t_end)}
        handed = scene.model_copy(update={"t_end": t_end})
        with TemporaryDirectory(prefix="stiction-program-", ignore_cleanup_errors=True) as name:
            place = Path(name)
            paths = {"scene": place / "scene.json", "result": place / f"result.{self.declaration.result}",
                     "events": place / "events.json"}
            paths["scene"].write_text(resolved_text(handed), encoding="utf-8")
            numbers = {"t_end": t_end, "output_step": output_step, **method}
            values = {key: str(path) for key, path in paths.items()}
            values |= {key: repr(float(value)) for key, value in numbers.items()}
            words = [f"{key}={as_given(value)}" for key, value in chosen.items()]
            command = [str(self._program), *self.declaration.arguments(values, words)]
            with run_program(command, self.folder, self.declaration.environment, place,
                             self.declaration.largest_file * 2 ** 20) as ended:
                self._check(ended, paths["result"])
                return Product(self._table(paths["result"], handed), self._report(paths["events"]), method | chosen,
                               ended.cpu_s)

    def _check(self, ended: Ended, result: Path) -> None:
        """Raise what the end of the program stands for."""
        if ended.code == REFUSAL:
            raise Refused(ended.said or f"{self.name} ended with exit code {REFUSAL}, a refusal, and printed no reason")
        most = self.declaration.largest_file
        full = [path.name for path in result.parent.iterdir() if path.stat().st_size >= most * 2 ** 20]
        too_much = f"; {' and '.join(full)}: reached the limit of {most} MiB" if full else ""
        if ended.code != 0 or too_much:
            raise EngineFailure(f"{self.name}: {ended.words}{too_much}")
        if not result.is_file():
            raise BadTrajectory(f"{self.name} returned no file; expected one at {{result}}: {ended.words}")

    def _table(self, path: Path, scene: Scene) -> ResultTable:
        with results_of(self.name):
            return read_result(path, scene)

    def _report(self, path: Path) -> _Report:
        if not path.is_file():
            return _Report()
        try:
            return _Report.model_validate(json.loads(path.read_text(encoding="utf-8")))
        except ValidationError as error:
            problem = next(problems_in_tables(error, _Report, {"events": _Event}))
            raise BadTrajectory(f"{self.name} returned events that cannot be used: {problem}") from None
        except ValueError as error:
            raise BadTrajectory(f"{self.name} returned events that are not JSON: {error}") from None

    def _events(self, made: Product, columns: Mapping[str, np.ndarray], t_end: float) -> Iterator[Event]:
        """Events with the two rows that the table has at their times."""
        table = made.table
        instants = table.t[table.first]
        for event in made.report.events:
            i = int(np.argmin(np.abs(instants - event.time)))
            sides = [int(rows[i]) for rows in (table.first, table.last)]
            if abs(instants[i] - event.time) > _SAME * t_end or sides[0] == sides[1]:
                raise BadTrajectory(f"{self.name} returned {event.kind} of {event.joint} at t = {event.time:.12g} s; "
                                    "expected two rows of the result at that time, before and after it")
            before, after = rows_of({name: values[sides] for name, values in columns.items()})
            yield Event(float(instants[i]), event.kind, event.joint, before, after)


def _read(file: Path) -> Declaration:
    declaration = read_declaration(file, Declaration, ProgramError, Declared)
    if declaration.name in BUILT_IN:
        raise ProgramError(str(file), [Problem("name", shown(declaration.name), "expected another name: an engine of "
                                               "the suite has it")])
    return declaration


@lru_cache(maxsize=64)
def _digest(path: Path, changed_ns: int, size: int) -> bytes:
    """Digest of a file, read again where its time or its size has changed."""
    return hashlib.sha256(path.read_bytes()).digest()


@lru_cache(maxsize=64)
def _answer(name: str, command: tuple[str, ...], folder: Path, environment: tuple[tuple[str, str], ...],
            digests: bytes) -> str:
    """The first line that the version command prints; asked again where a file of the command has changed."""
    with (TemporaryDirectory(prefix="stiction-program-") as scratch,
          run_program(command, folder, dict(environment), Path(scratch), 2 ** 20, VERSION_S) as ended):
        lines = (Path(scratch) / "printed.txt").read_text(errors="replace").split("\n") if ended.code == 0 else [""]
    if ended.code != 0 or not (line := lines[0].strip()):
        raise EngineBroken(f"{name}: its version command fails: {' '.join(command)}: {ended.words}; expected a line "
                           "with the version")
    return line[:80]
