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

from stiction.comparisons.campaigns.participants import cost_variants
from stiction.comparisons.studies.work_precision import FASTEST, SLOWEST, time_to_error, work_precision
from stiction.comparisons.timing.mechanism_families import FAMILIES, exponent
from stiction.comparisons.truth import slider_bar_truth
from stiction.comparisons.variants import OWN_CPU
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import Scene, Trajectory, load_scene

SCENE, RTOL = "slider-bar-case-1", 1e-9
CASES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3")
TARGETS, ENGINE_REPEATS = (1e-3, 1e-4), 5
"""Errors in metres at which reference and engines are compared, and timed repeats of each run."""
REPEATS = 101
SIZES = (((10, 30, 100, 300, 1000), 24.0), *[((10, 25, 50, 100, 200), 1.0)] * 3)
"""Of the families of `stiction.comparisons.timing.mechanism_families`, and seconds of each run."""
FINEST = 1e-3
"""Seconds; the finest rung on which the fastest engine is looked for: beyond it a run costs more than one that meets the smallest of `TARGETS`."""


def main() -> None:
    """Print the benchmark."""
    print(f"{platform.platform()}, Python {platform.python_version()}, {os.cpu_count()} CPUs, load {os.getloadavg()[0]:.2f} at the start\n")
    for line in benchmark(load_scene(SCENE)):
        print(line, flush=True)


def benchmark(scene: Scene) -> Iterator[str]:
    """The lines of the benchmark, as they become known."""
    from stiction.comparisons.timing.reduced_integrator import integrate, parameters

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

    for name in CASES:
        yield from _engines(load_scene(name))
    yield from _scale()
    yield from _start_up()


def _engines(scene: Scene) -> Iterator[str]:
    """Every engine at 1 ms, its own time apart from its adapter's; then the reference against the fastest at equal error."""
    tight, *others = cost_variants()
    engines = [variant for variant in others if variant.engine != tight.engine and variant.parameter == "dt"]
    ladders = [tight, *(replace(variant, ladder=tuple(step for step in variant.ladder if step >= FINEST)) for variant in engines)]
    table = work_precision(scene, ladders, repeats=ENGINE_REPEATS).make().table
    yield f"\n{scene.name}, {scene.t_end:g} s: engines at 1 ms, us of CPU a step in total and inside the engine, error of the position"
    at_1_ms = table[(table["step"] == 1e-3) & (table["parameter"] == "dt")]
    for row in at_1_ms.to_dict("records"):
        if row["status"] != "ok" or row["reason"]:
            yield f"  {row['variant']:18} {row['status']}: {row['reason']}"
            continue
        steps = scene.t_end / row["step"]
        total, own = (1e6 * row[name] / steps for name in ("cpu [s]", OWN_CPU))
        yield (f"  {row['variant']:18} {total:6.1f} us, {own:6.1f} us of them the engine's: the adapter adds {total / own - 1:4.1f} times that; "
               f"{row['position error [m]']:.1e} m")
    found = {cost: time_to_error(table, TARGETS, cost=cost).set_index("variant") for cost in (OWN_CPU, FASTEST, SLOWEST, "cpu [s]")}
    for target in TARGETS:
        column = f"{target:g} m"
        rivals = found[OWN_CPU].drop(tight.label)[column].dropna()
        if rivals.empty:
            yield f"  {column}: no engine reaches it"
            continue
        rival, own = rivals.idxmin(), tight.label
        ratio, least, most = (found[theirs].at[rival, column] / found[ours].at[own, column]
                              for theirs, ours in ((OWN_CPU, OWN_CPU), (FASTEST, SLOWEST), (SLOWEST, FASTEST)))
        yield (f"  {column}: {rival} is the fastest engine, {1e3 * rivals[rival]:.0f} ms of its own ({1e3 * found['cpu [s]'].at[rival, column]:.0f} ms "
               f"with its adapter); the reference takes {1e3 * found[OWN_CPU].at[own, column]:.2f} ms, one {ratio:.0f}th [{least:.0f} .. {most:.0f}]")


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
    once = [sys.executable, "-c", "from stiction.engines.reference.engine import compile_kernels; compile_kernels()"]
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


if __name__ == "__main__":
    main()
