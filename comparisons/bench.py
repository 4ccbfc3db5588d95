"""The benchmark of the suite itself: how fast is the reference, and against what. Run it by ``make bench``.

Every time is CPU time of the process that did the work, the median of repeats after one run that is not counted, with nothing
else running that this program started. Times of the reference are those of its steps, with the end state as the only
output. They depend on the machine: read the ratios.
"""

from __future__ import annotations

import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np

from comparisons.cost import time_to_error, work_precision
from comparisons.participants import cost_variants
from comparisons.scaling import FAMILIES, exponent
from comparisons.truth import slider_bar_truth
from engines.reference import ReferenceEngine
from scenes import Scene, Trajectory, load_scene

SCENE, RTOL, TARGET = "slider-bar-case-1", 1e-9, 1e-4
REPEATS = 101
SIZES = (((10, 30, 100, 300, 1000), 24.0), *[((10, 25, 50, 100, 200), 1.0)] * 3)
"""Of the families of `comparisons.scaling`, and seconds of each run."""
FINEST = 1e-3
"""Seconds; the finest rung on which the fastest engine is looked for: beyond it a run costs more than one that meets `TARGET`."""


def main() -> None:
    """Print the benchmark."""
    print(f"{platform.platform()}, Python {platform.python_version()}, {os.cpu_count()} CPUs, load {os.getloadavg()[0]:.2f} at the start\n")
    for line in benchmark(load_scene(SCENE)):
        print(line, flush=True)


def benchmark(scene: Scene) -> Iterator[str]:
    """The lines of the benchmark, as they become known."""
    from comparisons.reduced_integrator import integrate, parameters

    reference, truth = ReferenceEngine(), slider_bar_truth(scene)
    end = truth(np.array([scene.t_end]))["slider.x"][0]

    def event_driven(stabilization: str) -> Callable[[], Trajectory]:
        return lambda: reference.simulate(scene, rtol=RTOL, stabilization=stabilization, output_step=scene.t_end)

    yield f"{scene.name}, {scene.t_end:g} s, rtol {RTOL:g}, CPU; slowest and fastest of {REPEATS} repeats in brackets"
    times = {}
    for choice in ("projection", "none", "baumgarte"):
        repeats = REPEATS if choice != "baumgarte" else REPEATS // 5
        run, seconds = _timed(event_driven(choice), repeats, lambda run: run.cost.stepping_s)
        times[choice] = median(seconds)
        error = abs(run["slider.x"][-1] - end)
        yield f"  reference, event-driven, {choice:11} {_spread(seconds)}  {_counts(run)}; |x error| at the end {error:.1e} m"
    p = parameters(scene)
    (x, *_, events, calls), seconds = _timed(lambda: integrate(p, scene.t_end, RTOL), REPEATS)
    reduced = median(seconds)
    yield f"  independent, one degree of freedom       {_spread(seconds)}  rhs {calls}, events {events}; |x error| at the end {abs(x - end):.1e} m"
    yield f"  ratio reference (projection) / independent: {times['projection'] / reduced:.1f} (required: at most 5)"
    yield f"  reference with projection: {1e3 * times['projection']:.2f} ms (required: at most 2 ms); Baumgarte costs {times['baumgarte'] / times['projection']:.1f} times that"

    run, seconds = _timed(lambda: reference.simulate(scene, dt=1e-3, output_step=scene.t_end), 5, lambda run: run.cost.stepping_s)
    hlcp = run.cost.counters["hlcp"]
    yield (f"\npaper's scheme, dt = 1 ms: {1e3 * median(seconds):.0f} ms, {_counts(run)}: "
           f"{1e6 * median(seconds) / hlcp:.2f} us per HLCP solve with everything around it (required: at most 10)")

    yield f"\nCPU time to a position error of {TARGET:g} m over the whole run"
    tight, *others = cost_variants()
    engines = [v for v in others if v.engine != tight.engine and v.fidelity == "joint" and v.parameter == "dt"]
    ladders = [tight, *(replace(variant, ladder=tuple(step for step in variant.ladder if step >= FINEST)) for variant in engines)]
    found = time_to_error(work_precision(scene, ladders, repeats=3).make().table, (TARGET,)).set_index("variant")
    needed = found[f"{TARGET:g} m"]
    for name, row in found.iterrows():
        yield (f"  {name:10} {_or_never(needed[name])}{' at most' * bool(row['at most'])}; smallest error {row['smallest error']:.1e} m, "
               f"{row['failed']} of {row['rungs']} rungs failed")
    engine = needed.drop(tight.label).min()
    if np.isfinite(engine):
        yield (f"  fastest engine / reference: {engine / needed[tight.label]:.0f} at equal error, "
               f"{engine / times['projection']:.0f} with the reference at rtol {RTOL:g} (required: at least 100)")
    yield from _scale()
    yield from _start_up()


def _scale() -> Iterator[str]:
    """CPU time of whole runs, scene to trajectory, over the size of the scene; one run each, after one that is not counted."""
    reference = ReferenceEngine()
    for (name, build), (sizes, t_end) in zip(FAMILIES.items(), SIZES):
        seconds, events = [], []
        reference.simulate(build(sizes[0]), t_end=t_end, rtol=RTOL)
        for n in sizes:
            scene = build(n)
            started = time.process_time()
            run = reference.simulate(scene, t_end=t_end, rtol=RTOL, output_step=t_end / 10, event_values=False)
            seconds.append(time.process_time() - started)
            events.append(f"{run.cost.counters['events']} events{'' if run.termination == 'end' else ', ' + run.termination}")
        yield f"\n{name}, {t_end:g} s: CPU grows with the power {exponent(sizes, seconds):.2f} of n"
        for n, cpu, found in zip(sizes, seconds, events):
            yield f"  n = {n:4d}  {cpu:8.3f} s, {1e3 * cpu / n:8.3f} ms each; {found}"


def _start_up() -> Iterator[str]:
    command = [sys.executable, "-m", "stiction", "--help"]
    cold = [_child(command) for _ in range(3)]
    yield f"\nstiction --help: {median(cold):.2f} s CPU (required: under 0.5)"
    once = [sys.executable, "-c", "from engines.reference import compile_kernels; compile_kernels()"]
    loading = median([_child(once) for _ in range(3)])
    with tempfile.TemporaryDirectory() as folder:
        compiling = _child(once, NUMBA_CACHE_DIR=folder)
    yield f"kernels: {compiling:.0f} s CPU to compile (once for an installation), {loading:.2f} s to load, Python and imports included"


def _timed(call: Callable[[], Any], repeats: int, stepping: Callable[[Any], float] | None = None) -> tuple[Any, list[float]]:
    """The last result and CPU seconds of each call, as `stepping` has them or else of the whole call."""
    result = call()
    seconds = []
    for _ in range(repeats):
        started = time.process_time()
        result = call()
        seconds.append(time.process_time() - started if stepping is None else stepping(result))
    return result, seconds


def _child(command: list[str], **environment: str) -> float:
    """CPU seconds of a child process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=os.environ | environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _spread(seconds: list[float]) -> str:
    return f"{1e3 * median(seconds):7.3f} ms [{1e3 * min(seconds):.3f} .. {1e3 * max(seconds):.3f}]"


def _counts(run: Trajectory) -> str:
    return ", ".join(f"{name} {run.cost.counters[name]}" for name in ("rhs", "hlcp", "pivots", "events"))


def _or_never(seconds: float) -> str:
    return f"{1e3 * seconds:.1f} ms" if np.isfinite(seconds) else "never"


if __name__ == "__main__":
    main()
