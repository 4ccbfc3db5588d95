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
"""Number of bytes that are read of the end of what a program printed."""


class Ended(NamedTuple):
    """End of a program.

    `code`: exit code, or minus the signal that ended it; None if it was not started, or was given up. `cpu_s`: CPU
    seconds, user and system, of the program and of those of its children that it waited for. `words`: the end in words,
    with the last lines that it printed, which are `said`.
    """

    code: int | None
    cpu_s: float
    words: str
    said: str = ""


def run_program(
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    log: Path,
    largest: int,
    timeout_s: float | None = None,
) -> Ended:
    """Run a program in a folder to its end, or for `timeout_s` seconds.

    `environment` adds to the variables of this process. What the program prints goes to `log`. The system ends a
    program that writes more than `largest` bytes to a file, `log` included.
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
            return Ended(None, 0.0, f"no end within {timeout_s:g} s")
        assert supervisor.stdout is not None
        first, _, rest = supervisor.stdout.read().strip().partition(" ")
    # no answer at all, or that the program could not be started
    if not first or first == "error":
        return Ended(None, 0.0, rest or "its supervisor was killed")
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - LOG_BYTES))
        said, code = last_lines(file.read().decode(errors="replace")), int(first)
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    how = f"exit code {code}" if code >= 0 else f"ended by {name}"
    return Ended(code, float(rest), f"{how}: {said or 'nothing was printed'}", said)
