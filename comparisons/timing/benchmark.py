"""Cost of the reference (``make bench``), and of a step of each engine (``make bench-engines``).

Times are CPU times of the process that did the work, measured by the protocol of `stiction.comparisons.timing.rounds`:
medians over rounds that visit all that is compared, in brackets their intervals. Times of the reference are those of
its steps, with the end state as the only output. They depend on the machine: read the ratios, whose intervals are of
the ratios in the same rounds.
"""

from __future__ import annotations

import os
import platform
import resource
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np

from stiction.comparisons.campaigns.participants import REFERENCE, cost_variants
from stiction.comparisons.studies.work_precision import work_precision
from stiction.comparisons.timing.intervals import Interval, median_interval, ratio_interval
from stiction.comparisons.timing.rounds import MOST, block, in_rounds
from stiction.comparisons.truth import slider_bar_truth
from stiction.comparisons.variants import COMMON_STEP, OWN_CPU
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import Scene, Trajectory, load_scene

SCENE, RTOL = "slider-bar-case-1", 1e-9
STABILIZATIONS = ("projection", "none", "baumgarte")
PAPERS = "paper's scheme"
PERIOD = 8.0
"""Seconds of the runs of `engine_costs`: one period."""
WIDTH = 100
"""Characters of a line."""


def main(arguments: Sequence[str] = ()) -> None:
    """Print `benchmark`, or with the argument ``engines`` `engine_costs`.

    Raises
    ------
    SystemExit
        For other arguments.
    """
    if list(arguments) not in ([], ["engines"]):
        raise SystemExit(f"found {' '.join(arguments)}; expected nothing, or engines")
    machine = f"{platform.platform()}, Python {platform.python_version()}, {os.cpu_count()} CPUs"
    print(f"{machine}, load {os.getloadavg()[0]:.2f} at the start\n")
    for text in (engine_costs if arguments else benchmark)(load_scene(SCENE)):
        for line in text.split("\n"):
            print(line if line.startswith("|") else textwrap.fill(line, WIDTH, subsequent_indent=6 * " "), flush=True)


def benchmark(scene: Scene) -> Iterator[str]:
    """Lines of the benchmark, as they become known."""
    yield from _methods(scene)
    yield from _start_up()


def _methods(scene: Scene) -> Iterator[str]:
    """CPU time of the reference's steps by method."""
    engine = ReferenceEngine()
    true_end = slider_bar_truth(scene)(np.array([scene.t_end]))["slider.x"][0]
    methods: dict[str, dict[str, Any]] = {name: {"rtol": RTOL, "stabilization": name} for name in STABILIZATIONS}
    methods[PAPERS] = {"dt": 1e-3}

    def run(method: str) -> Trajectory:
        return engine.simulate(scene, output_step=scene.t_end, **methods[method])

    def seconds_of(name: str) -> float:
        return median(found.cost.stepping_s for found, _ in block(lambda: run(name)))

    runs = {name: run(name) for name in methods}  # kernels are loaded by this
    times = in_rounds([*methods], lambda names: {name: seconds_of(name) for name in names}, float)
    yield f"{scene.name}, {scene.t_end:g} s, rtol {RTOL:g}, CPU in ms; in brackets the intervals of the medians"
    for name in STABILIZATIONS:
        error = abs(runs[name]["slider.x"][-1] - true_end)
        yield (f"  reference, event-driven, {name:11} {_spread(times[name])}  {_counts(runs[name])}; "
               f"|x error| at the end {error:.1e} m")
    ratio = ratio_interval(times["baumgarte"], times["projection"])
    yield (f"  reference with projection: {_spread(times['projection'])} ms (required: at most 2); "
           f"Baumgarte costs {_interval(ratio)} times that")
    solve = 1e6 * median(times[PAPERS]) / runs[PAPERS].cost.counters["hlcp"]
    yield (f"\npaper's scheme, dt = 1 ms: {_spread(times[PAPERS])} ms, {_counts(runs[PAPERS])}: "
           f"{solve:.2f} us per HLCP solve with everything around it (required: at most 10)")


def engine_costs(scene: Scene) -> Iterator[str]:
    """Lines of Markdown for the engines' pages: microseconds of CPU a `COMMON_STEP`, in all and inside the engine.

    Every method of every engine is run at that step, equally often, in turns; where there is no time the reason stands.
    """
    engines = [replace(variant, ladder=(COMMON_STEP,)) for variant in cost_variants()
               if variant.engine != REFERENCE and variant.parameter == "dt"]
    table = work_precision(scene, engines, t_end=PERIOD, repeats=MOST).make().table
    yield (f"{scene.name}, {PERIOD:g} s, {1e3 * COMMON_STEP:g} ms: us of CPU a step, "
           f"medians of {table['repeats'].max():.0f} repeats each")
    yield ""
    yield "| method | version | total | the engine | the rest / its own | error [m] |"
    yield "|---|---|---|---|---|---|"
    notes: dict[str, int] = {}
    for row in table.to_dict("records"):
        found = [f"{row['status']}: {row['reason']}", "", "", ""]
        if row["status"] == "ok" and not row["reason"]:
            total, own = (1e6 * row[name] / (PERIOD / COMMON_STEP) for name in ("cpu [s]", OWN_CPU))
            mark = f" ({notes.setdefault(row['timing'], len(notes) + 1)})" if row["timing"] else ""
            found = [f"{total:.3g}{mark}", f"{own:.3g}", f"{total / own - 1:.1f}", f"{row['position error [m]']:.1e}"]
        version = row["version"] if row["status"] == "ok" else ""
        yield f"| {' | '.join([row['variant'], version, *found])} |"
    yield ""
    yield from (f"({number}) {note}" for note, number in notes.items())


def _start_up() -> Iterator[str]:
    once = "from stiction.engines.reference.engine import compile_kernels; compile_kernels()"
    commands = {"help": [sys.executable, "-m", "stiction", "--help"], "load": [sys.executable, "-c", once]}
    _child(commands["load"])
    times = in_rounds(list(commands), lambda keys: {key: _child(commands[key]) for key in keys}, float)
    yield f"\nstiction --help: {_spread(times['help'])} ms CPU (required: under 500)"
    with tempfile.TemporaryDirectory() as folder:
        compiling = _child(commands["load"], NUMBA_CACHE_DIR=folder)
    yield (f"kernels: {compiling:.0f} s CPU to compile (once for an installation), {_spread(times['load'])} ms to "
           "load, Python and imports included")


def _child(command: list[str], **environment: str) -> float:
    """CPU seconds of a child process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=os.environ | environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _spread(seconds: Sequence[float]) -> str:
    """Milliseconds."""
    found = median_interval(seconds)
    return f"{1e3 * found.value:.3f} [{1e3 * found.low:.3f} .. {1e3 * found.high:.3f}]"


def _interval(found: Interval) -> str:
    return f"{found.value:.1f} [{found.low:.1f} .. {found.high:.1f}]"


def _counts(run: Trajectory) -> str:
    return ", ".join(f"{name} {run.cost.counters[name]}" for name in ("rhs", "hlcp", "pivots", "events"))


if __name__ == "__main__":
    main(sys.argv[1:])
