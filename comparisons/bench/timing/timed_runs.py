"""Timing of the runs of comparisons, in rounds.

Several comparisons, or rows of one table, may need the time of the same computation. It is timed
once.
"""

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

KERNEL = "kernel_time"
"""Column of `samples_table`: CPU time of the calibration kernel, s."""
OTHERS = "other_load"
"""Column of `samples_table`: number of cores that other processes keep busy."""
ALWAYS = 2
"""Number of the coarsest runs of a series that are timed in all rounds even if they exceed the
budget: at least two runs are needed to interpolate the time to an error."""


def computation(task: Task, run: Trajectory) -> str:
    """Return the identity of a simulation.

    It consists of the engine, the fidelity, the contents of the scene, the length, and the settings
    that the run reports. The stabilization that the scene declares is left out if the run reports
    its own. Output instants are left out because timed runs only have output at the start and at
    the end.
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
    """Return the digest of the function and the arguments of a task, scenes by their contents."""
    return digest([task.function.__module__, task.function.__qualname__, task.args])


def affordable(
    runs: Sequence[tuple[Task, Outcome]], series: Sequence[str], rounds: int, budget_s: float
) -> Iterator[tuple[Task, Outcome, bool]]:
    """Yield each run that succeeded, and whether it is timed in all rounds.

    Parameters
    ----------
    runs : sequence of (Task, Outcome)
        Runs, those of a series from coarse to fine.
    series : sequence of str
        Name of the refinement series of each run.
    rounds : int
        Number of rounds.
    budget_s : float
        CPU time of all rounds of one series, s. Runs that exceed it are timed once, except the
        first `ALWAYS`.
    """
    spent_s: dict[str, float] = defaultdict(float)
    count: Counter[str] = Counter()
    for (task, outcome), name in zip(runs, series, strict=True):
        if outcome.status != Status.OK:
            continue
        # The CPU time of the child process is used for an engine that does not report its cost.
        cost = outcome.value.cost
        cost_s = cost.setup_s + cost.stepping_s or outcome.cpu_s or 0.0
        spent_s[name] += rounds * cost_s
        count[name] += 1
        yield task, outcome, count[name] <= ALWAYS or spent_s[name] <= budget_s


def time_runs(
    runs: Iterable[tuple[Task, Outcome, bool]],
    rounds: int,
    isolated: Isolate,
    timeout_s: float,
    on_result: Callable[[Outcome], None] | None = None,
    workers: int | None = None,
) -> dict[str, Timing]:
    """Time the runs that `affordable` yields.

    Runs that are timed in all rounds are executed one at a time. A run that fails in the first
    round is not timed again. Runs that are timed once follow on all processors, which changes a
    time by some per cent (`visits.doubt`). Then disturbed visits are repeated, one at a time.

    Parameters
    ----------
    runs : iterable of (Task, Outcome, bool)
        As yielded by `affordable`.
    rounds : int
        Number of rounds.
    isolated, timeout_s, on_result, workers
        As of `stiction.comparisons.bench.runner.make`; a visit may take as long as a run.

    Returns
    -------
    dict
        Timings by `computation`.
    """
    # Equal computations share their samples. They are timed in all rounds if any of them fits into
    # its budget.
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
        """Yield the samples of visits that succeed, with their keys, and store the reasons of others."""
        # The load by other processes is measured over all visits together, because a single one is
        # too short for the counters of the system.
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

    # The first round, and then rounds in reversed and in original order alternately, so that a
    # steady drift of the machine's speed cancels.
    keys = [key for key in tasks if key in in_all_rounds]
    samples = {key: [sample] for key, sample in visits(keys)}
    further_keys: list[str] = []
    for number in range(1, rounds):
        further_keys += reversed(samples) if number % 2 == 1 else samples
    for key, sample in visits(further_keys):
        samples[key].append(sample)

    # Runs that exceed the budget.
    once = [key for key in tasks if key not in in_all_rounds]
    if once:
        samples |= {key: [sample] for key, sample in visits(once, workers)}

    # Repeat disturbed visits, one of each computation in a pass.
    for _ in range(TRIES):
        disturbed = disturbed_visits(samples)
        if not disturbed:
            break
        for key, sample in visits(list(disturbed)):
            samples[key][disturbed[key][0]] = sample
    return {
        key: Timing(trajectory, tuple(samples.get(key, ())), failures.get(key, ""))
        for key, trajectory in trajectories.items()
    }


def with_time(task: Task, outcome: Outcome, times: Mapping[str, Timing], is_timed: bool) -> Outcome:
    """Return the outcome of a simulation with the medians of its times as its cost.

    The cost is nan if the simulation was not timed, because its own time was measured while others
    ran in parallel.

    Parameters
    ----------
    task : Task
    outcome : Outcome
        Returned unchanged if the task failed or is not a simulation.
    times : Mapping
        Timings by `computation`.
    is_timed : bool
        True to return the `Timing` as the value of the outcome, False to return the trajectory.
    """
    if outcome.status != Status.OK or not is_simulation(task):
        return outcome
    run = outcome.value
    timing = times.get(computation(task, run), Timing(run))
    cost = replace(
        run.cost,
        setup_s=timing.interval("setup_s").value,
        stepping_s=timing.interval("stepping_s").value,
        engine_s=timing.interval("own_s").value,
    )
    run = replace(run, cost=cost)
    if is_timed:
        return replace(outcome, value=replace(timing, trajectory=run))
    return replace(outcome, value=run)


def samples_table(timings: Mapping[str, Timing | None]) -> pd.DataFrame:
    """Return the table of all samples, given the timings by key of a run.

    Returns
    -------
    DataFrame
        One row per run and round, with the columns ``key`` of the run; ``round``, counted from 1;
        ``runs``, the number of repeats whose median is the sample; ``setup_time``, ``cpu_time`` and
        `OWN_CPU` as in the tables of runs; `KERNEL` and `OTHERS`.
    """
    column_of_field = {
        "runs": "runs",
        "setup_s": "setup_time",
        "stepping_s": "cpu_time",
        "own_s": OWN_CPU,
        "kernel_s": KERNEL,
        "others": OTHERS,
    }
    rows = []
    for key, timing in timings.items():
        if timing is None:
            continue
        for number, sample in enumerate(timing.samples, 1):
            rows.append((key, number, *(getattr(sample, field) for field in column_of_field)))
    return pd.DataFrame(rows, columns=["key", "round", *column_of_field.values()])


def machine_while_timing(samples: pd.DataFrame) -> dict[str, Any]:
    """Return a description of the machine during the rounds of `samples_table`, for the provenance.

    It contains the time of the calibration kernel, as median and interval in ms, in the first
    round, in all rounds and in the last round; and the median and the largest load by other
    processes, which is measured for all runs of a round together. It is empty if nothing was timed.
    """
    if samples.empty:
        return {}
    number = samples["round"]
    rounds = {
        "first round": number == number.min(),
        "all rounds": number > 0,
        "last round": number == number.max(),
    }
    machine: dict[str, Any] = {"rounds": int(number.max())}
    for name, is_in_round in rounds.items():
        kernel = median_interval(1e3 * samples.loc[is_in_round, KERNEL].to_numpy(dtype=float))
        machine[f"calibration kernel, {name} [ms]"] = (
            f"{kernel.value:.4f} [{kernel.low:.4f} .. {kernel.high:.4f}]"
        )
    cores = samples.groupby("round")[OTHERS].max().dropna()
    if len(cores):
        machine["cores busy with others, median of rounds"] = float(cores.median())
        machine["cores busy with others, largest"] = float(cores.max())
    return machine
