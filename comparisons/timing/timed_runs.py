"""Runs of comparisons that are timed: each computation once, in rounds, whatever comparisons and rows it belongs to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.digest import digest, scene_digest
from stiction.comparisons.timing.disturbance import load, others
from stiction.comparisons.timing.intervals import median_interval
from stiction.comparisons.timing.rounds import Sample, Timing, in_rounds, visit
from stiction.comparisons.variants import OWN_CPU
from stiction.engines.isolation import Isolate, Outcome, Task
from stiction.scenes import Scene, Trajectory, vary

KERNEL, OTHERS = "calibration kernel [s]", "others [cores]"
"""Columns of `samples_table`."""


def computation(engine: str, scene: Scene, arguments: Mapping[str, Any], run: Trajectory) -> str:
    """What is computed, whatever it is called and however it was asked for: engine, fidelity, scene, length, and the settings that the run states.

    What a scene declares against drift is left out where the run states what it did. Output instants are no part of it: a timed run has none but start and end.
    """
    settings = {**run.settings, **{name: arguments[name] for name in ("dt", "rtol") if arguments.get(name) is not None}}
    content = vary(scene, {"stabilization": None}) if "stabilization" in settings else scene
    t_end = arguments.get("t_end") or scene.t_end
    return digest([engine, arguments.get("fidelity", "joint"), scene_digest(content), t_end, settings])


def call_of(task: Task) -> str:
    """What a simulation asks for, whatever it is called: engine, scene and all arguments, those of its output included."""
    engine, scene, arguments = task.args
    return digest([engine, scene.name, scene_digest(scene), arguments])


def time_runs(simulations: Iterable[tuple[Task, Outcome]], least: int, isolated: Isolate, timeout_s: float,
              on_result: Callable[[Outcome], None] | None = None) -> dict[str, Timing]:
    """Time the runs that came out, by `computation`: in rounds, one run at a time.

    Parameters
    ----------
    simulations
        Tasks of `stiction.engines.isolation.simulation` and what became of them. What two of them compute alike is timed once.
    least
        Rounds at least.
    isolated, timeout_s, on_result
        As in `stiction.comparisons.campaigns.comparison.make`; a visit may take as long as a run.
    """
    tasks: dict[str, Task] = {}
    runs: dict[str, Trajectory] = {}
    for task, outcome in simulations:
        if outcome.status == "ok":
            key = computation(*task.args, outcome.value)
            tasks.setdefault(key, Task(task.label, visit, task.args))
            runs.setdefault(key, outcome.value)
    loads: list[float] = []
    lost: dict[str, str] = {}

    def one_round(keys: Sequence[str]) -> dict[str, Sample]:
        before = load()
        found = isolated([tasks[key] for key in keys], workers=1, timeout_s=timeout_s, on_result=on_result)
        loads.append(others(before, load()))
        lost.update({key: f"round {len(loads)}: {outcome.status}: {outcome.reason}" for key, outcome in zip(keys, found) if outcome.status != "ok"})
        return {key: outcome.value for key, outcome in zip(keys, found, strict=True) if outcome.status == "ok"}

    samples = in_rounds(list(tasks), one_round, lambda sample: sample.own_s, least, lambda sample: sample.setup_s + sample.stepping_s)
    return {key: Timing(runs[key], tuple(found), tuple(loads[:len(found)]), lost.get(key, "")) for key, found in samples.items()}


def timed(task: Task, outcome: Outcome, times: Mapping[str, Timing], budget_s: float) -> Outcome:
    """The outcome of a simulation with its `Timing` as the value: without samples for a rung that `budget_s`, of its ladder, was too little for."""
    if outcome.status != "ok":
        return outcome
    untimed = Timing(outcome.value, reason=f"not timed: the rounds of its ladder, up to this rung, take more than {budget_s:g} s")
    timing = times.get(computation(*task.args, outcome.value), untimed)
    return replace(outcome, value=replace(timing, trajectory=with_cost(outcome.value, timing)))


def with_cost(run: Trajectory, timing: Timing | None) -> Trajectory:
    """A run with the medians of its timing as its cost; without times where it was not timed: what it took beside others is no time."""
    samples = timing.samples if timing is not None else ()
    setup, stepping, own = (median(getattr(sample, name) for sample in samples) if samples else np.nan for name in ("setup_s", "stepping_s", "own_s"))
    return replace(run, cost=replace(run.cost, setup_s=setup, stepping_s=stepping, engine_s=own))


def samples_table(timings: Mapping[str, Timing | None]) -> pd.DataFrame:
    """Every sample, one row per run and round.

    Columns: ``key`` of the run; ``round``, from 1; ``runs`` of which the sample is the median; ``set-up [s]``, ``cpu [s]`` and `OWN_CPU` as in the tables of runs;
    ``calibration kernel [s]``; ``others [cores]``: kept busy by anything else in that round.
    """
    rows = [{"key": key, "round": number, "runs": sample.runs, "set-up [s]": sample.setup_s, "cpu [s]": sample.stepping_s, OWN_CPU: sample.own_s,
             KERNEL: sample.kernel_s, OTHERS: cores}
            for key, timing in timings.items() if timing is not None
            for number, (sample, cores) in enumerate(zip(timing.samples, timing.others, strict=True), 1)]
    return pd.DataFrame(rows, columns=["key", "round", "runs", "set-up [s]", "cpu [s]", OWN_CPU, KERNEL, OTHERS])


def machine_while_timing(samples: pd.DataFrame) -> dict[str, Any]:
    """The machine over all rounds of `samples_table`, for the provenance; empty where nothing was timed.

    The calibration kernel in ms, as median with interval, before (first round), between (all) and after (last round). The rounds are the same for all runs, so that
    each has one load by others: median and largest.
    """
    if samples.empty:
        return {}
    kernel = {"first round": samples.loc[samples["round"] == samples["round"].min(), KERNEL], "all rounds": samples[KERNEL],
              "last round": samples.loc[samples["round"] == samples["round"].max(), KERNEL]}
    found = {name: median_interval(1e3 * values.to_numpy(dtype=float)) for name, values in kernel.items()}
    cores = samples.groupby("round")[OTHERS].max().dropna()
    return {"rounds": int(samples["round"].max()),
            **{f"calibration kernel, {name} [ms]": f"{interval.value:.4f} [{interval.low:.4f} .. {interval.high:.4f}]" for name, interval in found.items()},
            **({"cores busy with others, median of rounds": float(cores.median()), "cores busy with others, largest": float(cores.max())} if len(cores) else {})}
