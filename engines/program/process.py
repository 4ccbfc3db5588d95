"""Run of a program without a shell, in a process group that ends with the process that waits for it.

A process that leaves its group, as by ``setsid``, is not ended.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from stiction.scenes.wording import shortened

SUPERVISOR = Path(__file__).with_name("supervisor.py")
LOG_BYTES, LOG_LINES = 4000, 4
"""What is read of the end of what a program printed, and the lines of it that a message has."""


@dataclass(frozen=True)
class Ended:
    """End of a program.

    Attributes
    ----------
    code : int or None
        Exit code, or minus the signal that ended it; None where it was not started, or given up.
    cpu_s : float
        CPU seconds, user and system, of the program and of those of its children that it waited for.
    said : str
        The last lines of what it printed, in one line; why it was not started.
    """

    code: int | None
    cpu_s: float
    said: str

    @property
    def words(self) -> str:
        """The end in words, with the last lines."""
        if self.code is None:
            return self.said
        how = f"exit code {self.code}" if self.code >= 0 else f"ended by {_signal(-self.code)}"
        return f"{how}: {self.said or 'nothing was printed'}"


@contextmanager
def run_program(command: Sequence[str], folder: Path, environment: Mapping[str, str], scratch: Path, largest: int,
                timeout_s: float | None = None) -> Iterator[Ended]:
    """Run a program to its end, and read what it has written within the context, after which `scratch` is removed.

    Parameters
    ----------
    command
        Path of the program and its arguments; no shell reads them.
    folder
        Working folder of the program.
    environment
        Variables besides those of this process.
    scratch
        Folder for what the program prints and writes. It is removed even if this process is killed.
    largest
        Bytes that a file of the program may have, what it prints included; the system ends a program that writes more.
    timeout_s
        Seconds after which it is killed; no limit where None.
    """
    log = scratch / "printed.txt"
    supervisor = subprocess.Popen(
        [sys.executable, "-I", "-S", str(SUPERVISOR), str(scratch), str(log), str(largest), *command],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder, env={**os.environ, **environment},
        start_new_session=True)
    assert supervisor.stdin is not None and supervisor.stdout is not None
    limit = threading.Timer(timeout_s or threading.TIMEOUT_MAX, supervisor.stdin.close)
    limit.daemon = True
    try:
        limit.start()
        answer = supervisor.stdout.readline().strip()
        limit.cancel()
        first, _, rest = answer.partition(" ")
        if not answer:
            unfinished = f"no end within {timeout_s:g} s" if timeout_s else "its supervisor was killed"
            yield Ended(None, 0.0, unfinished)
        else:
            yield Ended(None, 0.0, rest) if first == "error" else Ended(int(first), float(rest), _end_of(log))
    finally:  # an interrupt included: the end of its input ends the supervisor and all that it has started
        limit.cancel()
        supervisor.stdin.close()
        supervisor.wait()
        supervisor.stdout.close()


def _end_of(log: Path) -> str:
    """The last lines of a file, in one."""
    if not log.exists():
        return ""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - LOG_BYTES))
        lines = [line.strip() for line in file.read().decode(errors="replace").splitlines() if line.strip()]
    return " | ".join(shortened(line, 200) for line in lines[-LOG_LINES:])


def _signal(number: int) -> str:
    return signal.Signals(number).name if number in set(signal.Signals) else f"signal {number}"
