"""Costs of runs over their costs in the code before: both timed in turns, on this machine, in one go.

A busy neighbour changes the ratio of a run to a calibration kernel by 1.46 times for the same code, another processor
by 1.9 times. The same run in the code before is the same work, disturbed alike at the same time.
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
from stiction.scenes import InputError, scene_to_toml
from stiction.truths.physics import physics_of

FEWEST, MOST, SECONDS = 5, 40, 0.1
"""Least and largest number of rounds, and CPU seconds that a short run is repeated for: the shortest times count."""
BEFORE, NOW = "before", "now"
TOTAL, STEPPING = "cpu", "stepping"
"""Times of a run: all of it, and its steps as stated by the engine. Setting up a short run takes ten times as long as
its steps do, and would hide that they are half as slow again."""
COMPILING = 600.0
"""Seconds that the first run of a code may take beyond its limit: its kernels may have to be compiled."""

_CHILD = """
import json, os, sys, tempfile
from pathlib import Path
from time import process_time
import stiction
sys.path.append(os.getcwd())  # engines of the user's are there
folder, runs = json.loads(sys.stdin.readline())
if folder and Path(folder) not in Path(stiction.__file__).resolve().parents:
    sys.exit(f"expected a checkout of stiction; found none: {stiction.__file__} would be run")
if folder and hasattr(stiction, "__path__"):  # before it was a package, the others had names of their own
    stiction.__path__.append(folder)  # in a checkout they lie next to it
for line in sys.stdin:
    engine, name, text, arguments = runs[int(line)]
    try:
        with tempfile.TemporaryDirectory() as place:  # only these two functions of the older code are sure to be public
            (file := Path(place, f"{name}.toml")).write_text(text)
            scene, solver = stiction.load_scene(file), stiction.load_engine(engine)
        started = process_time()
        cost = getattr(solver.simulate(scene, **arguments), "cost", None)
        answer = {"cpu": process_time() - started}
        if (stepping := getattr(cost, "stepping_s", None)) is not None:
            answer["stepping"] = stepping
    except Exception as error:
        answer = f"{type(error).__name__}: {error}"
    print(json.dumps(answer), flush=True)
"""


class ControlRefused(InputError):
    """Code before that cannot be run."""


def times_in_turns(
    runs: Sequence[PlannedRun], before: Path, limit_s: float = 240.0
) -> dict[str, dict[str, float] | str]:
    """Return CPU times now over those before, by key of the run: `TOTAL`, and `STEPPING` where both codes state it.

    They are timed in rounds as of `bench.timing.visits`. Where there are none the value is the reason.
    An engine that stands for another is timed against that one. In either code a run may take `limit_s`, the first one
    `COMPILING` longer. Raises `ControlRefused` if `before` is no checkout of the suite, or the process died.
    """
    made = [(run, run.variant) for run in runs if run.variant is not None]
    of_then, of_now = (
        [_task(run, variant, stand_in) for run, variant in made] for stand_in in (True, False)
    )
    with (
        closing(_Code(before.resolve(), of_then, limit_s)) as then,
        closing(_Code(None, of_now, limit_s)) as now,
    ):
        return {run.key: _ratios({BEFORE: then, NOW: now}, i) for i, (run, _) in enumerate(made)}


def _ratios(codes: Mapping[str, _Code], i: int) -> dict[str, float] | str:
    """CPU times of a run now over those before, the shortest of each, or the reason why there are none."""
    failed: list[str] = []

    def one_round(when: Sequence[str]) -> dict[str, dict[str, float]]:
        answers = {name: codes[name].timed(i) for name in when}
        failed.extend(
            f"{name}: {answer}" for name, answer in answers.items() if isinstance(answer, str)
        )
        return (
            {}
            if failed
            else {name: answer for name, answer in answers.items() if not isinstance(answer, str)}
        )

    first = one_round((BEFORE, NOW))  # may have to compile: not counted
    if not failed:
        least = max(FEWEST, min(MOST, round(SECONDS / max(first[NOW][TOTAL], 1e-9))))
        times = in_rounds((BEFORE, NOW), one_round, least)
    if failed:
        return "; ".join(failed)
    then, now = (
        {what: min(sample[what] for sample in times[when]) for what in first[when]}
        for when in (BEFORE, NOW)
    )
    return {what: now[what] / then[what] for what in now if then.get(what)}


def _task(run: PlannedRun, variant: Variant, stand_in: bool) -> list[Any]:
    """Return a run with start and end as its only output: its cost is that of the motion, not of the table of it."""
    scene = physics_of(run.scene, has_static_coefficient(variant))
    found = job(scene, variant, run.step, output_step=scene.t_end)
    engine = variant.stands_for if stand_in and variant.stands_for else found.engine
    return [engine, scene.name, scene_to_toml(scene), dict(found.arguments)]


class _Code:
    """Process that runs the code of a checkout, or this code, and is started again after a run that takes too long."""

    def __init__(self, folder: Path | None, tasks: Sequence[list[Any]], limit_s: float):
        self._folder, self._tasks, self._limit_s = folder, tasks, limit_s
        self._patience = COMPILING
        self._start()

    def timed(self, number: int) -> dict[str, float] | str:
        """Return CPU seconds of the run with a number, by `TOTAL` and `STEPPING`, or why there are none."""
        limit, self._patience = self._limit_s + self._patience, 0.0
        end, timer = time.monotonic() + limit, threading.Timer(limit, self._process.kill)
        timer.start()
        try:
            self._ask(str(number))
            answer = self._answers.readline()
        finally:
            timer.cancel()
        if answer:
            return json.loads(answer)
        code = self._process.wait()
        if time.monotonic() >= end:
            self.close()
            self._start()
            return f"no result within {limit:g} s"
        self._errors.seek(0)
        reason = self._errors.read().strip() or f"exit code {code}"
        raise ControlRefused(f"{self._folder or 'this code'}: {reason.splitlines()[-1]}")

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        with suppress(BrokenPipeError):  # of a question that it did not live to read
            self._questions.close()
        self._answers.close()
        self._errors.close()

    def _start(self) -> None:
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
        assert (
            self._process.stdin is not None and self._process.stdout is not None
        )  # both are pipes
        self._questions, self._answers = self._process.stdin, self._process.stdout
        self._ask(json.dumps([self._folder and str(self._folder), self._tasks]))

    def _ask(self, question: str) -> None:
        with suppress(BrokenPipeError):  # there will be no answer, and its errors say why
            self._questions.write(question + "\n")
            self._questions.flush()
