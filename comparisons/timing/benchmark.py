"""The benchmark of the suite itself: how fast is the reference, and against what. Run it by ``make bench``.
``make bench-engines`` has what a step of each engine costs.

Times are CPU times of the process that did the work, measured by the protocol of `stiction.comparisons.timing.rounds`: medians over rounds that visit all that is
compared, in brackets their intervals. Times of the reference are those of its steps, with the end state as the only
output. They depend on the machine: read the ratios, whose intervals are of the ratios in the same rounds.
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

import numpy as np
import pandas as pd

from stiction.comparisons.campaigns.participants import REFERENCE, cost_variants
from stiction.comparisons.studies.equal_error import QUANTITIES, rounds_to
from stiction.comparisons.studies.work_precision import work_precision
from stiction.comparisons.timing.intervals import Interval, median_interval, ranking, ratio_interval
from stiction.comparisons.timing.mechanism_families import FAMILIES, exponent
from stiction.comparisons.timing.rounds import LEAST, MOST, block, in_rounds, times_in_rounds
from stiction.comparisons.truth import slider_bar_truth
from stiction.comparisons.variants import COMMON_STEP, OWN_CPU, Variant
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import Scene, Trajectory, load_scene

SCENE, RTOL = "slider-bar-case-1", 1e-9
TARGETS = (1e-3, 1e-4)
"""Errors in metres at which reference and engines are compared."""
POSITION = QUANTITIES[0]
RIVAL, PAPERS = "independent", "paper's scheme"
SIZES = (((10, 100, 1000), 1.0), ((10, 50, 200), 0.5), ((10, 25, 50), 0.25), ((10, 50, 200), 0.25))
"""Of the families of `stiction.comparisons.timing.mechanism_families`, and seconds of each run: none takes more than a second or two."""
ENGINES_END = 4.0
"""Seconds of the runs of engines: half a period. What whole runs on all cases cost is what `stiction validate` is for, which takes as many minutes."""
PERIOD = 8.0
"""Seconds of the runs of `engine_costs`: one period."""
FINEST = 1e-3
"""Seconds; the finest rung on which the fastest engine is looked for: beyond it a run costs more than one that meets the smallest of `TARGETS`."""
WIDTH = 100
"""Characters of a line."""


def main(arguments: Sequence[str] = ()) -> None:
    """Print the benchmark, or ``engines``: `engine_costs`.

    Raises
    ------
    SystemExit
        For other arguments.
    """
    if list(arguments) not in ([], ["engines"]):
        raise SystemExit(f"found {' '.join(arguments)}; expected nothing, or engines")
    print(f"{platform.platform()}, Python {platform.python_version()}, {os.cpu_count()} CPUs, load {os.getloadavg()[0]:.2f} at the start\n")
    for text in (engine_costs if arguments else benchmark)(load_scene(SCENE)):
        for line in text.split("\n"):
            print(line if line.startswith("|") else textwrap.fill(line, WIDTH, subsequent_indent=6 * " "), flush=True)


def benchmark(scene: Scene) -> Iterator[str]:
    """The lines of the benchmark, as they become known."""
    from stiction.comparisons.timing.reduced_integrator import integrate, parameters

    reference, truth = ReferenceEngine(), slider_bar_truth(scene)
    end = truth(np.array([scene.t_end]))["slider.x"][0]

    p = parameters(scene)
    runs: dict[str, dict[str, object]] = {choice: {"rtol": RTOL, "stabilization": choice} for choice in ("projection", "none", "baumgarte")} | {PAPERS: {"dt": 1e-3}}

    def one_round(keys: Sequence[str]) -> dict[str, float]:
        return {key: median(run.cost.stepping_s for run, _ in block(lambda: reference.simulate(scene, output_step=scene.t_end, **runs[key]))) if key in runs
                else median(seconds for _, seconds in block(lambda: integrate(p, scene.t_end, RTOL))) for key in keys}

    ends = {key: reference.simulate(scene, output_step=scene.t_end, **arguments) for key, arguments in runs.items()}  # kernels are loaded by this
    times = in_rounds([*runs, RIVAL], one_round, float)
    yield f"{scene.name}, {scene.t_end:g} s, rtol {RTOL:g}, CPU in ms; in brackets the intervals of the medians"
    for choice in ("projection", "none", "baumgarte"):
        run = ends[choice]
        yield f"  reference, event-driven, {choice:11} {_spread(times[choice])}  {_counts(run)}; |x error| at the end {abs(run['slider.x'][-1] - end):.1e} m"
    x, *_, events, calls = integrate(p, scene.t_end, RTOL)
    yield f"  independent, one degree of freedom       {_spread(times[RIVAL])}  rhs {calls}, events {events}; |x error| at the end {abs(x - end):.1e} m"
    yield f"  ratio reference (projection) / independent: {_interval(ratio_interval(times['projection'], times[RIVAL]))} (required: at most 5)"
    yield (f"  reference with projection: {_spread(times['projection'])} ms (required: at most 2); Baumgarte costs "
           f"{_interval(ratio_interval(times['baumgarte'], times['projection']))} times that")
    run = ends[PAPERS]
    yield (f"\npaper's scheme, dt = 1 ms: {_spread(times[PAPERS])} ms, {_counts(run)}: "
           f"{1e6 * median(times[PAPERS]) / run.cost.counters['hlcp']:.2f} us per HLCP solve with everything around it (required: at most 10)")

    yield from _engines(scene)
    yield from _scale()
    yield from _start_up()


def _engines(scene: Scene) -> Iterator[str]:
    """Every engine at 1 ms, its own time apart from its adapter's; then the reference against the fastest at equal error."""
    tight, *others = cost_variants()
    engines = [variant for variant in others if variant.engine != tight.engine and variant.parameter == "dt"]
    ladders = [tight, *(replace(variant, ladder=tuple(step for step in variant.ladder if step >= FINEST)) for variant in engines)]
    found = work_precision(scene, ladders, t_end=ENGINES_END, repeats=LEAST).make()
    table = found.table
    yield ""
    yield from step_costs(scene, table[(table["step"] == COMMON_STEP) & (table["parameter"] == "dt")], ENGINES_END)
    for target in TARGETS:
        rounds = {variant: rounds_to(ladder, found.samples, POSITION, target) for variant, ladder in table.groupby("variant", sort=False)}
        reached = {variant: times for variant, times in rounds.items() if times is not None}
        own = reached.pop(tight.label)[OWN_CPU]
        groups = ranking({variant: median_interval(times[OWN_CPU]) for variant, times in reached.items()})
        if not groups:
            yield f"  {target:g} m: no engine reaches it"
        for variant in groups[0] if groups else ():
            times = reached[variant]
            yield (f"  {target:g} m: {variant}, {'the fastest engine' if len(groups[0]) == 1 else 'one of those that no other is faster than'}: {_spread(times[OWN_CPU])} ms of its "
                   f"own, {_spread(times['cpu [s]'])} ms with its adapter; the reference takes {_spread(own)} ms, one "
                   f"{_interval(ratio_interval(times[OWN_CPU], own), 0)}th")


def engine_costs(scene: Scene, end: float = PERIOD, repeats: int = MOST) -> Iterator[str]:
    """The costs of the engines' pages: every method of every engine at one step, equally many repeats, in turns."""
    engines = [replace(variant, ladder=(COMMON_STEP,)) for variant in cost_variants()
               if variant.engine != REFERENCE and variant.parameter == "dt"]
    found = work_precision(scene, engines, t_end=end, repeats=repeats).make()
    yield from step_costs(scene, found.table, end)


def step_costs(scene: Scene, table: pd.DataFrame, end: float) -> Iterator[str]:
    """Lines of Markdown: by row of a table of `work_precision` microseconds of CPU a `COMMON_STEP` of motion,
    in all and inside the engine; why, where there are none."""
    repeats = f"medians of {table['repeats'].max():.0f} repeats each"
    yield f"{scene.name}, {end:g} s, {1e3 * COMMON_STEP:g} ms: us of CPU a step, {repeats}"
    yield ""
    yield "| method | version | total | the engine | the rest / its own | error [m] |"
    yield "|---|---|---|---|---|---|"
    notes: dict[str, int] = {}
    for row in table.to_dict("records"):
        found = [f"{row['status']}: {row['reason']}", "", "", ""]
        if row["status"] == "ok" and not row["reason"]:
            total, own = (1e6 * row[name] / (end / COMMON_STEP) for name in ("cpu [s]", OWN_CPU))
            mark = f" ({notes.setdefault(row['timing'], len(notes) + 1)})" if row["timing"] else ""
            found = [f"{total:.3g}{mark}", f"{own:.3g}", f"{total / own - 1:.1f}", f"{row['position error [m]']:.1e}"]
        yield f"| {' | '.join([row['variant'], row['version'] if row['status'] == 'ok' else '', *found])} |"
    yield ""
    yield from (f"({number}) {note}" for note, number in notes.items())


def _scale() -> Iterator[str]:
    """CPU time of whole runs, scene to trajectory, over the size of the scene."""
    reference = ReferenceEngine()
    for (name, build), (sizes, t_end) in zip(FAMILIES.items(), SIZES):
        scenes, runs = {n: build(n) for n in sizes}, {}

        def run(n: int) -> None:
            runs[n] = reference.simulate(scenes[n], t_end=t_end, rtol=RTOL, output_step=t_end / 10, event_values=False)

        times = times_in_rounds({n: lambda n=n: run(n) for n in sizes})
        yield f"\n{name}, {t_end:g} s: CPU grows with the power {exponent(sizes, [median(times[n]) for n in sizes]):.2f} of n"
        for n in sizes:
            ended = "" if runs[n].termination == "end" else f", {runs[n].termination}"
            yield f"  n = {n:4d}  {_spread(times[n])} ms, {1e3 * median(times[n]) / n:8.3f} ms each; {runs[n].cost.counters['events']} events{ended}"


def _start_up() -> Iterator[str]:
    once = "from stiction.engines.reference.engine import compile_kernels; compile_kernels()"
    commands = {"help": [sys.executable, "-m", "stiction", "--help"], "load": [sys.executable, "-c", once]}
    _child(commands["load"])
    times = in_rounds(list(commands), lambda keys: {key: _child(commands[key]) for key in keys}, float)
    yield f"\nstiction --help: {_spread(times['help'])} ms CPU (required: under 500)"
    with tempfile.TemporaryDirectory() as folder:
        compiling = _child(commands["load"], NUMBA_CACHE_DIR=folder)
    yield f"kernels: {compiling:.0f} s CPU to compile (once for an installation), {_spread(times['load'])} ms to load, Python and imports included"


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


def _interval(found: Interval, digits: int = 1) -> str:
    return f"{found.value:.{digits}f} [{found.low:.{digits}f} .. {found.high:.{digits}f}]"


def _counts(run: Trajectory) -> str:
    return ", ".join(f"{name} {run.cost.counters[name]}" for name in ("rhs", "hlcp", "pivots", "events"))


if __name__ == "__main__":
    main(sys.argv[1:])
