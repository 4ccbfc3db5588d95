"""What runs cost now over what they cost in the code before: both timed in turns, on this machine, in one go.

A time by itself says little: a calibration kernel is not of the kind of what is measured, so that a busy neighbour (who shares caches and, in
virtual machines, the core itself) or another processor changes their ratio: 1.46 times and 1.9 times were seen for the same code. The
same run in the code before is of the same kind, and suffers the same at the same time.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from comparisons.environment import ROOT
from comparisons.measurement import Run
from comparisons.variants import job, physics_of
from engines.registry import load_engine
from scenes import InputError, scene_to_toml

SECONDS, TURNS = 0.1, (5, 40)
"""A run is timed in turns for so many CPU seconds of either code, and so many times at least and at most; the shortest times count."""

_CHILD = """
import json, sys, tomllib
from pathlib import Path
from time import process_time
import stiction
from scenes import scene_from_dict
folder, runs = json.loads(sys.stdin.readline())
if Path(folder) not in Path(stiction.__file__).resolve().parents:
    sys.exit(f"expected a checkout of stiction; found none: {stiction.__file__} would be run")
for line in sys.stdin:
    engine, name, text, arguments = runs[int(line)]
    try:
        scene, solver = scene_from_dict(tomllib.loads(text), name=name), stiction.load_engine(engine)
        started = process_time()
        solver.simulate(scene, **arguments)
        answer = process_time() - started
    except Exception as error:
        answer = f"{type(error).__name__}: {error}"
    print(json.dumps(answer), flush=True)
"""


class ControlRefused(InputError):
    """The code before cannot be run."""


def times_in_turns(runs: Sequence[Run], before: Path) -> dict[str, float | str]:
    """By key of the run, CPU time now over that before; in words why there is none.

    Parameters
    ----------
    before
        A checkout of the suite. An engine that stands for another is timed against that one.

    Raises
    ------
    ControlRefused
        If it is no checkout of the suite, or the process died.
    """
    asked = [run for run in runs if run.variant is not None]
    found: dict[str, float | str] = {}
    with _code(before.resolve(), [_task(run, stand_in=True) for run in asked]) as then, _code(ROOT, [_task(run) for run in asked]) as now:
        for i, run in enumerate(asked):
            pairs: list[tuple[float, float]] = []
            words = [f"{when}: {value}" for when, value in (("before", then(i)), ("now", now(i))) if isinstance(value, str)]
            while not words and len(pairs) < TURNS[1] and (len(pairs) < TURNS[0] or sum(pair[1] for pair in pairs) < SECONDS):
                turn = {"before": then(i), "now": now(i)}
                words = [f"{when}: {value}" for when, value in turn.items() if isinstance(value, str)]
                pairs.append(tuple(turn.values()))
            found[run.key] = "; ".join(words) or min(pair[1] for pair in pairs) / min(pair[0] for pair in pairs)
    return found


def _task(run: Run, stand_in: bool = False) -> list[Any]:
    """A run with its start and end as its only output: what it costs is the motion, not the table of it."""
    solver = load_engine(run.variant.engine)
    scene = physics_of(run.scene, solver.capabilities.static_coefficient.get(run.variant.fidelity, False))
    found = job(scene, run.variant, run.step, output_step=scene.t_end)
    return [run.variant.stands_for if stand_in and run.variant.stands_for else found.engine, scene.name, scene_to_toml(scene), dict(found.arguments)]


@contextmanager
def _code(folder: Path, tasks: Sequence[list[Any]]) -> Iterator[Callable[[int], float | str]]:
    """A process that runs the code of a folder: called with the number of a task, it gives CPU seconds, or why there are none."""
    places = [str(folder), str(Path.cwd()), *filter(None, [os.environ.get("PYTHONPATH")])]  # engines of the user's are in the working folder
    with tempfile.TemporaryFile("w+") as said, subprocess.Popen(
            [sys.executable, "-P", "-c", _CHILD], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(places)}) as process:
        def ask(question: str) -> str:
            try:
                process.stdin.write(question + "\n")
                process.stdin.flush()
                return process.stdout.readline() if question.isdigit() else "sent"
            except BrokenPipeError:  # what it said tells why
                return ""

        def timed(number: int) -> float | str:
            if not (answer := ask(str(number))):
                code = process.wait()
                said.seek(0)
                raise ControlRefused(f"{folder}: {(said.read().strip() or f'exit code {code}').splitlines()[-1]}")
            return json.loads(answer)

        try:
            ask(json.dumps([str(folder), tasks]))
            yield timed
        finally:
            process.kill()
            with suppress(BrokenPipeError):  # of a question that it did not live to read
                process.stdin.close()
