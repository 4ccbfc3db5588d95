"""Times of runs relative to older code: both codes run in alternation on this machine.

Other work on the machine changes the ratio of a run's time to that of a calibration kernel by up to 1.46 for the same
code, another processor by 1.9. The same run with older code is the same work, and is disturbed in the same way at the
same time.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from stiction.comparisons.bench.planned_runs import PlannedRun
from stiction.comparisons.bench.timing.visits import in_rounds
from stiction.comparisons.bench.variants import Variant, has_static_coefficient, job
from stiction.scenes import InputError
from stiction.truths.physics import physics_of

MIN_ROUNDS = 5
"""Least number of rounds."""
MAX_ROUNDS = 40
"""Largest number of rounds; a shorter run is not repeated more often."""
MEASURED_S = 0.1
"""CPU time for which a short run is repeated, s: only the shortest times count."""
BEFORE = "before"
"""Name of the older code."""
NOW = "now"
"""Name of this code."""
TOTAL = "cpu"
"""Name of the CPU time of a whole run."""
STEPPING = "stepping"
"""Name of the time of the steps, as the engine states it. The setup of a short run takes ten times as long, and would
hide that the steps take half as long again."""
COMPILING = 600.0
"""Time that the first run with each code may take in addition, s: its kernels may have to be compiled."""
NO_TIME = 1e-9
"""Smallest CPU time by which the number of rounds is divided, s; clocks may return 0."""

# The program of the child process. The first line of its input contains the folder of the older code (or null) and the
# runs. Each further line is the number of a run, to which it answers with one line: times by name, or why it failed.
_CHILD = """
import json, os, sys, tempfile
from pathlib import Path
from time import process_time
import stiction
sys.path.append(os.getcwd())  # engines of the user are there
folder, runs = json.loads(sys.stdin.readline())
if folder and Path(folder) not in Path(stiction.__file__).resolve().parents:
    sys.exit(f"expected a checkout of stiction; found none: {stiction.__file__} would be run")
if folder and hasattr(stiction, "__path__"):  # before it was a package, the others had names of their own
    stiction.__path__.append(folder)  # in a checkout they lie next to it
for line in sys.stdin:
    engine, name, text, arguments = runs[int(line)]
    try:
        with tempfile.TemporaryDirectory() as place:
            file = Path(place, f"{name}.toml")
            file.write_text(text)
            # only these two functions are certain to exist in older code, too
            scene, solver = stiction.load_scene(file), stiction.load_engine(engine)
        started = process_time()
        cost = getattr(solver.simulate(scene, **arguments), "cost", None)
        answer = {"cpu": process_time() - started}
        stepping = getattr(cost, "stepping_s", None)
        if stepping is not None:
            answer["stepping"] = stepping
    except Exception as error:
        answer = f"{type(error).__name__}: {error}"
    print(json.dumps(answer), flush=True)
"""


class ControlRefused(InputError):
    """Raised if the older code cannot be run."""


def times_in_turns(
    runs: Sequence[PlannedRun], before: Path, limit_s: float = 240.0
) -> dict[str, dict[str, float] | str]:
    """Return the ratios of the CPU times of runs to those with older code.

    The times are measured in rounds like those in `bench.timing.visits`. With the older code, an engine that stands for
    another one is replaced by that one.

    Parameters
    ----------
    runs
        The runs; truths are left out.
    before
        Checkout of the older code.
    limit_s
        Time that a run may take, s; the first run with each code may take `COMPILING` longer.

    Returns
    -------
    dict
        By key of the run, the ratio of `TOTAL` and, if both codes state it, of `STEPPING`. The value is a string, the
        reason, if the run could not be timed.

    Raises
    ------
    ControlRefused
        If `before` is no checkout of the suite, or if a process ended unexpectedly.
    """
    keys, older_tasks, newer_tasks = [], [], []
    for run in runs:
        variant = run.variant
        if variant is None:
            continue
        keys.append(run.key)
        older_tasks.append(_task(run, variant, variant.stands_for or variant.engine))
        newer_tasks.append(_task(run, variant, variant.engine))
    ratios: dict[str, dict[str, float] | str] = {}
    with (
        closing(_Code(before.resolve(), older_tasks, limit_s)) as older,
        closing(_Code(None, newer_tasks, limit_s)) as newer,
    ):
        codes = {BEFORE: older, NOW: newer}
        for number, key in enumerate(keys):
            ratios[key] = _ratios(codes, number)
    return ratios


class _NotTimed(Exception):
    """Raised if a run fails with one of the codes; the message says with which, and why."""


def _ratios(codes: Mapping[str, _Code], number: int) -> dict[str, float] | str:
    """Return the ratios of the times of a run, the shortest with each code, or the reason why there are none."""

    def one_round(order: Sequence[str]) -> dict[str, dict[str, float]]:
        # Both codes run even if the first one fails, so that the reason mentions all failures.
        answers = {name: codes[name].timed(number) for name in order}
        failures = [
            f"{name}: {answer}" for name, answer in answers.items() if isinstance(answer, str)
        ]
        if failures:
            raise _NotTimed("; ".join(failures))
        return {name: answer for name, answer in answers.items() if not isinstance(answer, str)}

    try:
        # The first round may have to compile kernels, and does not count.
        first = one_round((BEFORE, NOW))
        rounds = round(MEASURED_S / max(first[NOW][TOTAL], NO_TIME))
        rounds = min(max(rounds, MIN_ROUNDS), MAX_ROUNDS)
        times = in_rounds((BEFORE, NOW), one_round, rounds)
    except _NotTimed as error:
        return str(error)
    ratios = {}
    for name in first[NOW]:
        if name not in first[BEFORE]:
            continue
        shortest_before = min(sample[name] for sample in times[BEFORE])
        shortest_now = min(sample[name] for sample in times[NOW])
        if shortest_before:
            ratios[name] = shortest_now / shortest_before
    return ratios


def _task(run: PlannedRun, variant: Variant, engine: str) -> list[Any]:
    """Return engine, scene and arguments of a run of a variant for the child process.

    Start and end are the only output, so that the time is that of the motion and not of writing its table.
    """
    scene = physics_of(run.scene, has_static_coefficient(variant))
    planned = job(run.scene, variant, run.step, output_step=scene.t_end)
    return [engine, scene.name, scene.to_toml(), dict(planned.arguments)]


class _Code:
    """A process that makes runs with the code of a checkout, or with this code.

    It is started again after a run that exceeds its time.

    Parameters
    ----------
    folder
        The checkout; None for this code.
    tasks
        Engine, scene and arguments of each run (`_task`).
    limit_s
        Time that a run may take, s.
    """

    def __init__(self, folder: Path | None, tasks: Sequence[list[Any]], limit_s: float):
        self._folder = folder
        self._tasks = tasks
        self._limit_s = limit_s
        self._extra_s = COMPILING  # until the first run
        self._start()

    def timed(self, number: int) -> dict[str, float] | str:
        """Return the CPU times (s) of a run by name, or the reason why there are none.

        Raises
        ------
        ControlRefused
            If the process ended unexpectedly.
        """
        limit_s = self._limit_s + self._extra_s
        self._extra_s = 0.0
        # Reading the answer blocks. A process that exceeds its time is killed, which ends the reading.
        end = time.monotonic() + limit_s
        timer = threading.Timer(limit_s, self._process.kill)
        timer.start()
        try:
            self._ask(str(number))
            answer = self._answers.readline()
        finally:
            timer.cancel()
        if answer:
            return json.loads(answer)
        exit_code = self._process.wait()
        if time.monotonic() >= end:
            self.close()
            self._start()
            return f"no result within {limit_s:g} s"
        self._errors.seek(0)
        reason = self._errors.read().strip() or f"exit code {exit_code}"
        raise ControlRefused(f"{self._folder or 'this code'}: {reason.splitlines()[-1]}")

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        # A question that the process did not read is lost with it.
        with suppress(BrokenPipeError):
            self._questions.close()
        self._answers.close()
        self._errors.close()

    def _start(self) -> None:
        """Start the process, and send it the runs."""
        places = [str(place) for place in (self._folder, os.environ.get("PYTHONPATH")) if place]
        self._errors = tempfile.TemporaryFile("w+")
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _CHILD],
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(places)},
        )
        # Both are pipes, as was requested.
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._questions = self._process.stdin
        self._answers = self._process.stdout
        folder = None if self._folder is None else str(self._folder)
        self._ask(json.dumps([folder, self._tasks]))

    def _ask(self, question: str) -> None:
        """Send a line to the process."""
        # If it has ended, there will be no answer, and its error output says why.
        with suppress(BrokenPipeError):
            self._questions.write(question + "\n")
            self._questions.flush()
