"""Runs of comparisons that are timed: each computation once, in rounds, whatever comparisons and rows it belongs to."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import pandas as pd

from stiction.comparisons.bench.timing.intervals import median_interval
from stiction.comparisons.bench.timing.visits import (
    TRIES,
    Timing,
    VisitTimes,
    disturbed_visits,
    load,
    others,
    visit,
)
from stiction.comparisons.bench.variants import OWN_CPU
from stiction.engines.isolation import Isolate, Outcome, Task, is_simulation
from stiction.engines.status import Status
from stiction.scenes import Trajectory, vary
from stiction.scenes.digest import digest, scene_digest
from stiction.scenes.fidelity import Fidelity

KERNEL, OTHERS = "kernel_time", "other_load"
"""Columns of `samples_table`."""
ALWAYS = 2
"""Runs of a series that have all rounds whatever they cost: between two of them a time can be interpolated."""


def computation(task: Task, run: Trajectory) -> str:
    """Identity of a simulation: engine, fidelity, scene, length, and the settings that the run states, without names.

    The stabilization that a scene declares is left out where the run states its own. Output instants are no part of it:
    a timed run has none but start and end.
    """
    engine, scene, arguments = task.args
    settings = dict(run.settings)
    for name in ("dt", "rtol"):
        if arguments.get(name) is not None:
            settings[name] = arguments[name]
    content = vary(scene, {"stabilization": None}) if "stabilization" in settings else scene
    t_end = arguments.get("t_end") or scene.t_end
    return digest(
        [engine, arguments.get("fidelity", Fidelity.JOINT), scene_digest(content), t_end, settings]
    )


def call_of(task: Task) -> str:
    """Digest of a task whatever its label: its function and all arguments, scenes by their content."""
    return digest([task.function.__module__, task.function.__qualname__, task.args])


def affordable(
    runs: Sequence[tuple[Task, Outcome]], series: Sequence[str], rounds: int, budget_s: float
) -> Iterator[tuple[Task, Outcome, bool]]:
    """Yield the runs that succeeded, and whether all rounds of them fit into the budget of their series, CPU seconds.

    The first `ALWAYS` of each series always have all rounds.
    """
    spent: dict[str, float] = defaultdict(float)
    steps: Counter[str] = Counter()
    for (task, outcome), name in zip(runs, series, strict=True):
        if outcome.status == Status.OK:
            # an engine need not state its cost: then it is that of the child process
            cost = outcome.value.cost
            spent[name] += rounds * (cost.setup_s + cost.stepping_s or outcome.cpu_s or 0.0)
            steps[name] += 1
            yield task, outcome, steps[name] <= ALWAYS or spent[name] <= budget_s


def time_runs(
    runs: Iterable[tuple[Task, Outcome, bool]],
    rounds: int,
    isolated: Isolate,
    timeout_s: float,
    on_result: Callable[[Outcome], None] | None = None,
    workers: int | None = None,
) -> dict[str, Timing]:
    """Time the runs of `affordable`, by `computation`: one at a time, in turns, and the others once.

    A run that is lost in the first round has no other. What is timed once follows on all processors, which moves a time
    by some percent (`visits.doubt`). Then disturbed visits are repeated, one at a time. Options are those of
    `stiction.comparisons.bench.runner.make`; a visit may take as long as a run.
    """
    # Rows that are the same computation share its samples. It has all rounds if any of them affords
    # it.
    tasks: dict[str, Task] = {}
    trajectories: dict[str, Trajectory] = {}
    in_all_rounds: set[str] = set()
    for task, outcome, is_affordable in runs:
        key = computation(task, outcome.value)
        tasks.setdefault(key, Task(task.label, visit, task.args))
        trajectories.setdefault(key, outcome.value)
        if is_affordable:
            in_all_rounds.add(key)
    failures: dict[str, str] = {}

    def visits(keys: Sequence[str], workers: int | None = 1) -> Iterator[tuple[str, VisitTimes]]:
        # The load by others is that of the whole call: single visits are too short for the system's
        # counters.
        before = load()
        outcomes = isolated(
            [tasks[key] for key in keys], workers=workers, timeout_s=timeout_s, on_result=on_result
        )
        cores = others(before, load())
        for key, outcome in zip(keys, outcomes, strict=True):
            if outcome.status == Status.OK:
                yield key, replace(outcome.value, others=cores)
            else:
                failures[key] = f"while it was timed: {outcome.status}: {outcome.reason}"

    # The first round, and the others in turns backwards and forwards, so that a steady drift of the
    # machine's speed averages out.
    keys = [key for key in tasks if key in in_all_rounds]
    samples = {key: [sample] for key, sample in visits(keys)}
    turns = [list(reversed(samples)), list(samples)] * rounds
    for key, sample in visits([key for turn in turns[: rounds - 1] for key in turn]):
        samples[key].append(sample)

    # Runs beyond the budget.
    once = [key for key in tasks if key not in in_all_rounds]
    if once:
        samples |= {key: [sample] for key, sample in visits(once, workers)}

    # Disturbed visits again, one of each computation at a time.
    for _ in range(TRIES):
        disturbed = disturbed_visits(samples)
        for key, sample in visits(list(disturbed)) if disturbed else ():
            samples[key][disturbed[key][0]] = sample
    return {
        key: Timing(trajectory, tuple(samples.get(key, ())), failures.get(key, ""))
        for key, trajectory in trajectories.items()
    }


def with_time(task: Task, outcome: Outcome, times: Mapping[str, Timing], is_timed: bool) -> Outcome:
    """Give a simulation that succeeded the medians of its computation as its cost; nan where it was not timed alone.

    Of a comparison that is timed its value becomes its `Timing`.
    """
    if outcome.status != Status.OK or not is_simulation(task):
        return outcome
    timing = times.get(computation(task, outcome.value), Timing(outcome.value))
    setup, stepping, own = (
        timing.interval(name).value for name in ("setup_s", "stepping_s", "own_s")
    )
    run = replace(
        outcome.value,
        cost=replace(outcome.value.cost, setup_s=setup, stepping_s=stepping, engine_s=own),
    )
    return replace(outcome, value=replace(timing, trajectory=run) if is_timed else run)


def samples_table(timings: Mapping[str, Timing | None]) -> pd.DataFrame:
    """Table of every sample, one row per run and round.

    Columns: ``key`` of the run; ``round``, from 1; ``runs`` of which the sample is the median; ``setup_time``,
    ``cpu_time`` and `OWN_CPU` as in the tables of runs; ``kernel_time``: of the calibration kernel;
    ``other_load``: cores that are kept busy by other work.
    """
    columns = {
        "runs": "runs",
        "setup_s": "setup_time",
        "stepping_s": "cpu_time",
        "own_s": OWN_CPU,
        "kernel_s": KERNEL,
        "others": OTHERS,
    }
    rows = [
        (key, number, *(getattr(sample, name) for name in columns))
        for key, timing in timings.items()
        if timing is not None
        for number, sample in enumerate(timing.samples, 1)
    ]
    return pd.DataFrame(rows, columns=["key", "round", *columns.values()])


def machine_while_timing(samples: pd.DataFrame) -> dict[str, Any]:
    """Describe the machine over all rounds of `samples_table`, for the provenance; empty where nothing was timed.

    The calibration kernel in ms, as median with interval, in the first round, in all, and in the last. All runs share
    the rounds, so that each round has one load by others: median and largest.
    """
    if samples.empty:
        return {}
    number, cores = samples["round"], samples.groupby("round")[OTHERS].max().dropna()
    rounds = {
        "first round": number == number.min(),
        "all rounds": number > 0,
        "last round": number == number.max(),
    }
    machine: dict[str, Any] = {"rounds": int(number.max())}
    for name, chosen in rounds.items():
        kernel = median_interval(1e3 * samples.loc[chosen, KERNEL].to_numpy(dtype=float))
        machine[f"calibration kernel, {name} [ms]"] = (
            f"{kernel.value:.4f} [{kernel.low:.4f} .. {kernel.high:.4f}]"
        )
    if len(cores):
        machine["cores busy with others, median of rounds"] = float(cores.median())
        machine["cores busy with others, largest"] = float(cores.max())
    return machine
