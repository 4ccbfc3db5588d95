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
"""Of what a program printed, the end is read."""


class Ended(NamedTuple):
    """End of a program.

    `code`: exit code, or minus the signal that ended it; None where it was not started, or given up. `cpu_s`: seconds,
    user and system, of the program and of those of its children that it waited for. `said`: the last lines of what it
    printed, in one; why it was not started.
    """

    code: int | None
    cpu_s: float
    said: str

    @property
    def words(self) -> str:
        """The end in words, with the last lines."""
        if self.code is None:
            return self.said
        name = signal.Signals(-self.code).name if -self.code in set(signal.Signals) else f"signal {-self.code}"
        how = f"exit code {self.code}" if self.code >= 0 else f"ended by {name}"
        return f"{how}: {self.said or 'nothing was printed'}"


def run_program(command: Sequence[str], folder: Path, environment: Mapping[str, str], log: Path, largest: int,
                timeout_s: float | None = None) -> Ended:
    """Run a program to its end; no shell reads its path and its arguments.

    Parameters
    ----------
    folder
        Working folder of the program.
    environment
        Variables besides those of this process.
    log
        File for what the program prints.
    largest
        Bytes that a file of the program may have, `log` included; the system ends a program that writes more.
    timeout_s
        Seconds after which it is killed; no limit where None.
    """
    # the end of its input, by an interrupt or by the end of this process too, ends the supervisor and what it started
    with subprocess.Popen([sys.executable, "-I", "-S", str(SUPERVISOR), str(log), str(largest), *command],
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder,
                          env={**os.environ, **environment}, start_new_session=True) as supervisor:
        try:
            supervisor.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return Ended(None, 0.0, f"no end within {timeout_s:g} s")
        assert supervisor.stdout is not None
        first, _, rest = supervisor.stdout.read().strip().partition(" ")
    if not first or first == "error":
        return Ended(None, 0.0, rest or "its supervisor was killed")
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - LOG_BYTES))
        return Ended(int(first), float(rest), last_lines(file.read().decode(errors="replace")))
