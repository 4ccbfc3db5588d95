"""Cost of whole runs of the reference beside their stepping, the table of the page on cost (``make bench``).

A run costs what its integration costs, and the work around it: set-up, output, examination of the result. A point of a
sweep has no examination, and the columns of its measures only. The least CPU time of several runs is printed: other
work on the machine makes times longer, never shorter.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

from stiction.comparisons.bench.environment import conditions, load
from stiction.comparisons.measures.steady_state_measures import MEASURES, SteadyRun, steady_window
from stiction.engines.registry import load_engine
from stiction.scenes import Scene, Trajectory, load_scene, vary

Result = TypeVar("Result")
REPEATS = 9
"""Runs of which the least time is printed."""
RUNS = (
    ("slider-bar-case-1", 24.0, 1e-9, 24.0),
    ("slider-bar-case-1", 24.0, 1e-9, 0.01),
    ("slider-bar-case-3", 24.0, 1e-9, 24.0),
    ("slider-bar-case-1", 240.0, 1e-6, 240.0),
    ("slider-bar-case-1", 240.0, 1e-6, 0.01),
)
"""Scene, end (s), rtol, and distance of the rows (s) of each run."""
SWEPT = "slider-bar-case-1"
AMPLITUDES = (1.0, 3.0, 5.0)
"""N: points of a sweep, with and without stick."""
SETTLE, SWEEP_END, SWEEP_RTOL = 80.0, 240.0, 1e-6


def main() -> None:
    """Print the machine, and the costs of runs and of a sweep's points."""
    print(f"{conditions()}; load {load()['load']} at the start\n")
    for line in (*run_costs(), "", *point_costs()):
        print(line, flush=True)


def run_costs() -> Iterator[str]:
    """Lines of Markdown: milliseconds of CPU of each run in all, of its parts, and the ratio to its stepping."""
    yield "| scene | end [s] | rtol | rows | events | in all [ms] | stepping | output | gate | in all / stepping |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    engine = load_engine("reference")
    for name, t_end, rtol, output_step in RUNS:
        scene = load_scene(name)

        def run(
            scene: Scene = scene,
            t_end: float = t_end,
            rtol: float = rtol,
            output_step: float = output_step,
        ) -> Trajectory:
            return engine.simulate(
                scene,
                t_end=t_end,
                rtol=rtol,
                output_step=output_step,
                stabilization="projection",
            )

        seconds, trajectory = _least(run)
        cost = trajectory.cost
        parts = (seconds, cost.stepping_s, cost.output_s, cost.gate_s)
        times = " | ".join(f"{1e3 * part:.2f}" for part in parts)
        ratio = seconds / cost.stepping_s
        rows, events = len(trajectory.t), len(trajectory.events)
        yield f"| {name} | {t_end:g} | {rtol:g} | {rows} | {events} | {times} | {ratio:.2f} |"


def point_costs() -> Iterator[str]:
    """Lines of Markdown: milliseconds of CPU of points of a sweep for a peak speed, and of the stepping in them."""
    yield "| F0 [N] | point of a sweep [ms] | stepping |"
    yield "|---|---|---|"
    steady_run = SteadyRun(SETTLE, SWEEP_END, SWEEP_RTOL)
    measure = MEASURES["peak-speed"]
    scene = load_scene(SWEPT)
    for amplitude in AMPLITUDES:

        def point(amplitude: float = amplitude) -> float:
            window = steady_window(vary(scene, {"F0": amplitude}), steady_run, [measure])
            measure.value(window)
            return window.whole.cost.stepping_s

        seconds, stepping = _least(point)
        yield f"| {amplitude:g} | {1e3 * seconds:.2f} | {1e3 * stepping:.2f} |"


def _least(call: Callable[[], Result]) -> tuple[float, Result]:
    """Return the least CPU time of a call, s, and the result of that call; the first loads kernels."""
    result = call()
    least = math.inf
    for _ in range(REPEATS):
        begin = time.process_time()
        another = call()
        spent = time.process_time() - begin
        # only the fastest result is kept: memory that is held makes later runs slower
        if spent < least:
            least, result = spent, another
    return least, result


if __name__ == "__main__":
    main()
