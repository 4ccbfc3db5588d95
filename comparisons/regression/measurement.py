"""One run and every number that is kept of it: errors against the truth, path, events, drift, counters, time.

The numbers are made in the child process that simulates, the truth included. A run can be made again with changes of
rounding only: masses and gravity are moved by some units in the last place, bodies stand in another order, samples are
kept half as often. It then differs as on another processor or with another library (`tolerances`).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from stiction.comparisons.bench.planned_runs import (
    GRID,
    MOTION,
    MOVED,
    ORDER,
    TRUTH,
    ULPS,
    Metric,
    PlannedRun,
    Row,
)
from stiction.comparisons.bench.timing.calibration import TIME, relative_time
from stiction.comparisons.bench.timing.visits import bare_run
from stiction.comparisons.bench.variants import Variant, has_static_coefficient, job
from stiction.comparisons.measures.accuracy import TORQUE_ERROR, errors, size_of
from stiction.comparisons.measures.drift import DECAY_ERROR, ROUNDING, decay_error, drift
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines import Task, load_engine
from stiction.engines.reference.engine import compile_kernels
from stiction.engines.status import Status
from stiction.scenes import Scene, Trajectory, vary
from stiction.truths import Tier, Truth
from stiction.truths.physics import physics_of

_ACCURACY = {
    "position_error": "position_uncertainty",
    "velocity_error": "velocity_uncertainty",
    TORQUE_ERROR: "torque_uncertainty",
    "event_time_error": "event_time_uncertainty",
}
_EVENTS = ("events_matched", "events_missed", "events_spurious")
_DRIFT = ("position_drift", "velocity_drift")
PATH = "path_length"
AT_THE_END = "end"
"""Family of metrics (`quantities.FAMILIES`): where a body is at the end, ``end:slider.x``."""
END_MOVED = 1e-6
"""Part of the mechanism's size by which fixed steps may end elsewhere: they stay where they are, as in `tolerances`."""
END_TOLERANCES = 1e3
"""Tolerances by which an adaptive run may end elsewhere: other rounding rejects other steps, and the errors of a run
are a hundred tolerances. Its errors are held to closer bounds."""
OUTPUT_STEP = 0.01
"""Seconds between the instants at which errors are measured."""
_STATE = {"x": "m", "y": "m", "angle": "rad"}


def task_of(run: PlannedRun, kinds: Collection[str], repeats: int) -> Task:
    """Return the measurement of a run, for `stiction.engines.isolate`; `row_of` makes a row of its outcome."""
    if run.variant is None:
        return Task(run.key, _truth_row, (run,))
    return Task(run.key, _run_row, (run, run.variant, tuple(kinds), repeats))


def disturbed(scene: Scene, way: str) -> Scene:
    """Return the scene as one of `WAYS` has it; the same motion but for rounding."""
    if way == ORDER:
        return scene.model_copy(update={"bodies": dict(reversed(scene.bodies.items()))})
    if not way.startswith(MOVED):
        return scene
    chance = np.random.default_rng([int(way.removeprefix(MOVED)), 5])

    def moved(value: float) -> float:
        return float(value * (1 + 2.0**-52 * chance.choice([-1, 1]) * chance.integers(1, ULPS + 1)))

    numbers: dict[str, Any] = {
        f"bodies.{name}.{key}": moved(getattr(body, key))
        for name, body in scene.bodies.items()
        for key in ("mass", "inertia")
    }
    if scene.gravity is not None:
        numbers["gravity"] = [moved(part) for part in scene.gravity]
    return vary(scene, numbers)


def _run_row(run: PlannedRun, variant: Variant, kinds: Collection[str], repeats: int) -> Row:
    """Simulate and measure against the truth, in the child; the time is that of the whole `Engine.run`."""
    compile_kernels()
    solver, has_static = load_engine(variant.engine), has_static_coefficient(variant)
    scene, given = (
        physics_of(each, has_static) for each in (run.scene, disturbed(run.scene, run.way))
    )
    output_step = OUTPUT_STEP * (2 if run.way == GRID else 1)
    arguments = job(run.scene, variant, run.step, output_step=output_step).arguments
    trajectory = solver.simulate(given, **arguments)
    status, reason = Status.OK, "" if trajectory.termination == "end" else trajectory.termination
    found, metrics = drift(trajectory), [*_motion(trajectory, scene, variant.parameter, run.step)]
    metrics += [
        Metric(name, "drift", found[name], ROUNDING, Tier.CLOSED_FORM)
        for name in _DRIFT
        if name in found
    ]
    if (decay := decay_error(trajectory, scene)) is not None:
        metrics.append(
            Metric(DECAY_ERROR, "drift", decay.value, decay.uncertainty, Tier.CLOSED_FORM)
        )
    metrics += [Metric(name, "counter", count) for name, count in trajectory.cost.counters.items()]
    if {"accuracy", "event"} & set(kinds):
        truth = ground_truth(scene)
        if truth.tier == Tier.NONE:
            reason = reason or f"no truth to compare with: {truth.note}"
        found = errors(trajectory, truth, size_of(scene))
        status, reason = found.get("status", status), found.get("reason", reason)
        metrics = [*_errors(found, truth), *metrics]
    if "time" in kinds and status == Status.OK and trajectory.termination == "end":
        metrics.append(
            Metric(TIME, "time", *relative_time(bare_run(solver, given, arguments), repeats))
        )
    return replace(
        run.row,
        version=trajectory.version,
        status=status,
        reason=reason,
        settings=trajectory.settings,
        metrics=tuple(metric for metric in metrics if metric.kind in kinds),
    )


def _errors(found: Mapping[str, Any], truth: Truth) -> Iterator[Metric]:
    for name, unsure in _ACCURACY.items():
        if math.isfinite(found.get(name, math.nan)):
            tier = truth.effort_tier if name == TORQUE_ERROR else truth.tier
            yield Metric(name, "accuracy", found[name], found[unsure], tier)
    yield from (
        Metric(name, "event", found[name], tier=truth.tier) for name in _EVENTS if name in found
    )


def _motion(trajectory: Trajectory, scene: Scene, parameter: str, step: float) -> Iterator[Metric]:
    """Where the bodies are at the end, and how far they went in fixed steps.

    The uncertainty of an end position is the change that is none: for fixed steps `END_MOVED` of the mechanism's size,
    or of the position; for tolerances `END_TOLERANCES` of them. A run that ended early has none: when it does so may
    depend on rounding.
    """
    if parameter != "rtol":
        yield Metric(PATH, MOTION, path_length(trajectory))
    if trajectory.termination != "end":
        return
    size, part = size_of(scene), END_TOLERANCES * step if parameter == "rtol" else END_MOVED
    for body in scene.bodies:
        for label, unit in _STATE.items():
            value = float(trajectory[f"{body}.{label}"][-1])
            scale = max(abs(value), 1.0 if unit == "rad" else size)
            yield Metric(f"{AT_THE_END}:{body}.{label}", MOTION, value, part * scale)


def path_length(trajectory: Trajectory) -> float:
    """Return the length of the paths of all bodies; unlike an error, it changes where a run moves towards the truth."""
    bodies = [name.removesuffix(".vx") for name in trajectory.columns if name.endswith(".vx")]
    speeds = [np.hypot(trajectory[f"{body}.vx"], trajectory[f"{body}.vy"]) for body in bodies]
    return float(sum(np.trapezoid(speed, trajectory.t) for speed in speeds))


def _truth_row(run: PlannedRun) -> Row:
    """Find where the bodies are at the end, and the events on the way, in the child."""
    truth = ground_truth(run.scene)
    end = truth(np.array([truth.t_end]))
    metrics = [
        Metric(
            f"{AT_THE_END}:{body}.{name}",
            TRUTH,
            float(end[f"{body}.{name}"][0]),
            truth.uncertainty.get(f"{body}.{name}"),
            truth.tier,
        )
        for body in run.scene.bodies
        for name in _STATE
        if f"{body}.{name}" in end
    ]
    times: dict[tuple[str, str], list[float]] = defaultdict(list)
    for event in truth.events:
        times[event.kind, event.joint].append(event.time)
    for (kind, joint), found in sorted(times.items()):
        metrics += [
            Metric(f"events:{joint}.{kind}", TRUTH, len(found), 0.0, truth.tier),
            Metric(
                f"last_event:{joint}.{kind}",
                TRUTH,
                max(found),
                truth.uncertainty.get("event time"),
                truth.tier,
            ),
        ]
    return replace(run.row, status=Status.OK, reason=truth.note, metrics=tuple(metrics))
