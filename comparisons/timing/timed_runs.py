"""Runs of comparisons that are timed: each computation once, in rounds, whatever comparisons and rows it belongs to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import count
from typing import Any

import pandas as pd

from stiction.comparisons.digest import digest, scene_digest
from stiction.comparisons.timing.intervals import median_interval
from stiction.comparisons.timing.rounds import Timing, VisitTimes, in_rounds, load, others, visit
from stiction.comparisons.variants import OWN_CPU
from stiction.engines.isolation import Isolate, Outcome, Task, is_simulation
from stiction.scenes import Trajectory, vary

KERNEL, OTHERS = "calibration kernel [s]", "others [cores]"
"""Columns of `samples_table`."""


def computation(task: Task, run: Trajectory) -> str:
    """Identity of a simulation: engine, fidelity, scene, length, and the settings that the run states, without names.

    The stabilization that a scene declares is left out where the run states its own. Output instants are no part of it:
    a timed run has none but start and end.
    """
    engine, scene, arguments = task.args
    settings = {**run.settings, **{name: arguments[name] for name in ("dt", "rtol") if arguments.get(name) is not None}}
    content = vary(scene, {"stabilization": None}) if "stabilization" in settings else scene
    t_end = arguments.get("t_end") or scene.t_end
    return digest([engine, arguments.get("fidelity", "joint"), scene_digest(content), t_end, settings])


def call_of(task: Task) -> str:
    """Digest of a task whatever its label: its function and all arguments, scenes by their content."""
    return digest([task.function.__module__, task.function.__qualname__, task.args])


def time_runs(simulations: Iterable[tuple[Task, Outcome, bool]], least: int, isolated: Isolate, timeout_s: float,
              on_result: Callable[[Outcome], None] | None = None, workers: int | None = None) -> dict[str, Timing]:
    """Time the simulations that succeeded, by `computation`: in `least` rounds at least, one run at a time.

    Each comes with whether it is timed once: these runs follow the rounds, on all processors, which moves a time by
    some percent (`rounds.doubt`). Options are those of `stiction.comparisons.campaigns.comparison.make`; a visit may
    take as long as a run.
    """
    tasks: dict[str, Task] = {}
    runs: dict[str, Trajectory] = {}
    in_all: set[str] = set()
    for task, outcome, once in simulations:
        if outcome.status == "ok":
            key = computation(task, outcome.value)
            tasks.setdefault(key, Task(task.label, visit, task.args))
            runs.setdefault(key, outcome.value)
            in_all.update(() if once else (key,))
    failures: dict[str, str] = {}
    rounds = count(1)

    def visits(keys: Sequence[str], workers: int | None = 1) -> dict[str, VisitTimes]:
        number, before = next(rounds), load()
        outcomes = isolated([tasks[key] for key in keys], workers=workers, timeout_s=timeout_s, on_result=on_result)
        cores = others(before, load())
        made = dict(zip(keys, outcomes, strict=True))
        failures.update({key: f"round {number}: {outcome.status}: {outcome.reason}"
                         for key, outcome in made.items() if outcome.status != "ok"})
        return {key: replace(outcome.value, others=cores) for key, outcome in made.items() if key not in failures}

    samples = in_rounds([key for key in tasks if key in in_all], visits, lambda sample: sample.own_s, least)
    if left := [key for key in tasks if key not in in_all]:
        samples |= {key: [sample] for key, sample in visits(left, workers).items()}
    return {key: Timing(run, tuple(samples.get(key, ())), failures.get(key, "")) for key, run in runs.items()}


def with_time(task: Task, outcome: Outcome, times: Mapping[str, Timing], is_timed: bool) -> Outcome:
    """Give a simulation that succeeded the medians of its computation as its cost; nan where it was not timed alone.

    Of a comparison that is timed its value becomes its `Timing`.
    """
    if outcome.status != "ok" or not is_simulation(task):
        return outcome
    timing = times.get(computation(task, outcome.value), Timing(outcome.value))
    setup, stepping, own = (timing.interval(name).value for name in ("setup_s", "stepping_s", "own_s"))
    run = replace(outcome.value, cost=replace(outcome.value.cost, setup_s=setup, stepping_s=stepping, engine_s=own))
    return replace(outcome, value=replace(timing, trajectory=run) if is_timed else run)


def samples_table(timings: Mapping[str, Timing | None]) -> pd.DataFrame:
    """Table of every sample, one row per run and round.

    Columns: ``key`` of the run; ``round``, from 1; ``runs`` of which the sample is the median; ``set-up [s]``, ``cpu
    [s]`` and `OWN_CPU` as in the tables of runs; ``calibration kernel [s]``; ``others [cores]``: kept busy by other
    work.
    """
    columns = {"runs": "runs", "setup_s": "set-up [s]", "stepping_s": "cpu [s]", "own_s": OWN_CPU, "kernel_s": KERNEL,
               "others": OTHERS}
    rows = [(key, number, *(getattr(sample, name) for name in columns))
            for key, timing in timings.items() if timing is not None
            for number, sample in enumerate(timing.samples, 1)]
    return pd.DataFrame(rows, columns=["key", "round", *columns.values()])


def machine_while_timing(samples: pd.DataFrame) -> dict[str, Any]:
    """Describe the machine over all rounds of `samples_table`, for the provenance; empty where nothing was timed.

    The calibration kernel in ms, as median with interval, in the first round, in all, and in the last. All runs share
    the rounds, so that each round has one load by others: median and largest.
    """
    if samples.empty:
        return {}
    number, cores = samples["round"], samples.groupby("round")[OTHERS].max().dropna()
    rounds = {"first round": number == number.min(), "all rounds": number > 0, "last round": number == number.max()}
    found: dict[str, Any] = {"rounds": int(number.max())}
    for name, chosen in rounds.items():
        kernel = median_interval(1e3 * samples.loc[chosen, KERNEL].to_numpy(dtype=float))
        found[f"calibration kernel, {name} [ms]"] = f"{kernel.value:.4f} [{kernel.low:.4f} .. {kernel.high:.4f}]"
    if len(cores):
        found["cores busy with others, median of rounds"] = float(cores.median())
        found["cores busy with others, largest"] = float(cores.max())
    return found
