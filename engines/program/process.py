"""Run of a program without a shell, in a process group that ends with the process that waits for it.

A process that leaves its group, as by ``setsid``, is not ended.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from stiction.scenes.wording import last_lines

SUPERVISOR = Path(__file__).with_name("supervisor.py")
LOG_BYTES = 4000
"""Number of bytes at the end of a program's output that are read."""


class ProgramEnd(NamedTuple):
    """How a program ended.

    Attributes
    ----------
    code : int or None
        Exit code, or minus the signal that ended the program; None if it was not started or exceeded its time.
    cpu_s : float
        CPU time (s), user and system, of the program and of those of its children that it waited for.
    words : str
        The end in words, with the last lines of the output.
    last_lines : str
        The last lines of the output.
    """

    code: int | None
    cpu_s: float
    words: str
    last_lines: str = ""


def run_program(
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    log: Path,
    largest: int,
    timeout_s: float | None = None,
) -> ProgramEnd:
    """Run a program to its end, or for `timeout_s` seconds, and return how it ended.

    Parameters
    ----------
    command
        The program and its arguments.
    folder
        The working folder.
    environment
        Environment variables in addition to those of this process.
    log
        The file for the output of the program.
    largest
        The size of a file, the log included, at which the system ends the program, in bytes.
    timeout_s
        Time limit, s.
    """
    # The supervisor ends the program when its standard input is closed, which also happens when this
    # process is interrupted or killed.
    with subprocess.Popen(
        [sys.executable, "-I", "-S", str(SUPERVISOR), str(log), str(largest), *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={**os.environ, **environment},
        start_new_session=True,
    ) as supervisor:
        try:
            supervisor.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return ProgramEnd(None, 0.0, f"no end within {timeout_s:g} s")
        assert supervisor.stdout is not None
        first, _, rest = supervisor.stdout.read().strip().partition(" ")
    # The supervisor answers nothing if it was killed, and "error" if the program could not be started.
    if not first or first == "error":
        return ProgramEnd(None, 0.0, rest or "its supervisor was killed")
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - LOG_BYTES))
        output = last_lines(file.read().decode(errors="replace"))
    code = int(first)
    words = f"{_describe_code(code)}: {output or 'nothing was printed'}"
    return ProgramEnd(code, float(rest), words, output)


def _describe_code(code: int) -> str:
    """Return an exit code, or minus a signal, in words."""
    if code >= 0:
        return f"exit code {code}"
    if -code in set(signal.Signals):
        return f"ended by {signal.Signals(-code).name}"
    return f"ended by signal {-code}"
