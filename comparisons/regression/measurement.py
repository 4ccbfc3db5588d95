"""Measurement of one run: errors against the truth, path, events, drift, counters and time.

The numbers are computed in the child process that simulates the run, and so is the truth. A run can be repeated with
changes that affect only the rounding: masses and gravity change by some units in the last place, the bodies have
another order, or the output has half as many samples. It then differs from the first run as it would on another
processor or with another library (`tolerances`).
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

# The keys of `errors` and `drift` that become metrics.
_ACCURACY = {
    "position_error": "position_uncertainty",
    "velocity_error": "velocity_uncertainty",
    TORQUE_ERROR: "torque_uncertainty",
    "event_time_error": "event_time_uncertainty",
}
"""Errors, with their uncertainties."""
_EVENTS = ("events_matched", "events_missed", "events_spurious")
_DRIFT = ("position_drift", "velocity_drift")
PATH = "path_length"
"""Metric: length of the paths of all bodies, m."""
AT_THE_END = "end"
"""Family of metrics (`quantities.FAMILIES`): position of a body at the end, for example ``end:slider.x``."""
END_MOVED = 1e-6
"""Largest change of a position at the end of a run with fixed steps, as a fraction of the mechanism's size: only
rounding changes it, as in `tolerances.PATH_MOVED`."""
END_TOLERANCES = 1e3
"""Largest change of a position at the end of an adaptive run, in tolerances times the mechanism's size. With another
rounding, other steps are rejected, and the errors of a run are about a hundred tolerances. They have closer bounds of
their own."""
OUTPUT_STEP = 0.01
"""Distance of the instants at which errors are measured, s."""
_POSITIONS = ("x", "y", "angle")
"""Labels of the coordinates of a body, m and rad."""


def task_of(run: PlannedRun, kinds: Collection[str], repeats: int) -> Task:
    """Return the task that measures a run in a child process; `row_of` returns the row of its outcome."""
    if run.variant is None:
        return Task(run.key, _truth_row, (run,))
    return Task(run.key, _run_row, (run, run.variant, tuple(kinds), repeats))


def disturbed(scene: Scene, way: str) -> Scene:
    """Return a scene changed in one of `WAYS`; its motion differs only by rounding. Other ways leave it unchanged."""
    if way == ORDER:
        return scene.model_copy(update={"bodies": dict(reversed(scene.bodies.items()))})
    if not way.startswith(MOVED):
        return scene
    seed = int(way.removeprefix(MOVED))
    generator = np.random.default_rng([seed, 5])
    numbers: dict[str, Any] = {}
    for name, body in scene.bodies.items():
        numbers[f"bodies.{name}.mass"] = _by_some_ulps(body.mass, generator)
        numbers[f"bodies.{name}.inertia"] = _by_some_ulps(body.inertia, generator)
    if scene.gravity is not None:
        numbers["gravity"] = [_by_some_ulps(part, generator) for part in scene.gravity]
    return vary(scene, numbers)


def _by_some_ulps(value: float, generator: np.random.Generator) -> float:
    """Return a number changed by one to `ULPS` units in the last place, in a random direction."""
    sign = generator.choice([-1, 1])
    return float(value * (1 + 2.0**-52 * sign * generator.integers(1, ULPS + 1)))


def _run_row(run: PlannedRun, variant: Variant, kinds: Collection[str], repeats: int) -> Row:
    """Simulate a run and return its row; called in a child process."""
    compile_kernels()
    engine = load_engine(variant.engine)
    has_static = has_static_coefficient(variant)
    scene = physics_of(run.scene, has_static)
    simulated_scene = physics_of(disturbed(run.scene, run.way), has_static)
    output_step = OUTPUT_STEP * (2 if run.way == GRID else 1)
    arguments = job(run.scene, variant, run.step, output_step=output_step).arguments
    trajectory = engine.simulate(simulated_scene, **arguments)

    status = Status.OK
    reason = "" if trajectory.termination == "end" else trajectory.termination
    metrics: list[Metric] = []
    if "accuracy" in kinds or "event" in kinds:
        truth = ground_truth(scene, fidelity=variant.fidelity)
        if truth.tier == Tier.NONE and not reason:
            reason = f"no truth to compare with: {truth.note}"
        measures = errors(trajectory, truth, size_of(scene))
        # A trajectory that cannot be compared with the truth has a status of its own.
        status = measures.get("status", status)
        reason = measures.get("reason", reason)
        metrics += _errors(measures, truth)
    metrics += _motion(trajectory, scene, variant.parameter, run.step)
    metrics += _drift(trajectory, scene)
    metrics += [Metric(name, "counter", count) for name, count in trajectory.cost.counters.items()]
    if "time" in kinds and status == Status.OK and trajectory.termination == "end":
        # The time is that of the whole `Engine.run`.
        time, uncertainty = relative_time(bare_run(engine, simulated_scene, arguments), repeats)
        metrics.append(Metric(TIME, "time", time, uncertainty))
    return replace(
        run.row,
        version=trajectory.version,
        status=status,
        reason=reason,
        settings=trajectory.settings,
        metrics=tuple(metric for metric in metrics if metric.kind in kinds),
    )


def _errors(measures: Mapping[str, Any], truth: Truth) -> Iterator[Metric]:
    """Yield the errors that are finite, and the counts of events, from the measures of `errors`."""
    for name, uncertainty in _ACCURACY.items():
        if math.isfinite(measures.get(name, math.nan)):
            tier = truth.effort_tier if name == TORQUE_ERROR else truth.tier
            yield Metric(name, "accuracy", measures[name], measures[uncertainty], tier)
    for name in _EVENTS:
        if name in measures:
            yield Metric(name, "event", measures[name], tier=truth.tier)


def _drift(trajectory: Trajectory, scene: Scene) -> Iterator[Metric]:
    """Yield the drift of the constraints, and the error of its decay if it is to be stabilized."""
    measures = drift(trajectory)
    for name in _DRIFT:
        if name in measures:
            yield Metric(name, "drift", measures[name], ROUNDING, Tier.CLOSED_FORM)
    decay = decay_error(trajectory, scene)
    if decay is not None:
        yield Metric(DECAY_ERROR, "drift", decay.value, decay.uncertainty, Tier.CLOSED_FORM)


def _motion(trajectory: Trajectory, scene: Scene, parameter: str, step: float) -> Iterator[Metric]:
    """Yield the positions of all bodies at the end, and the length of their paths if the steps are fixed.

    The uncertainty of a position at the end is the change that is allowed: `END_MOVED` for fixed steps, and
    `END_TOLERANCES` times the tolerance `step` for adaptive ones, of the mechanism's size or of the position if that is
    larger. A run that ended early has no such positions, because the time of its end may depend on rounding.
    """
    is_adaptive = parameter == "rtol"
    if not is_adaptive:
        yield Metric(PATH, MOTION, path_length(trajectory, scene))
    if trajectory.termination != "end":
        return
    allowed = END_TOLERANCES * step if is_adaptive else END_MOVED
    sizes = {"x": size_of(scene), "y": size_of(scene), "angle": 1.0}
    for body in scene.bodies:
        for label in _POSITIONS:
            value = float(trajectory[f"{body}.{label}"][-1])
            uncertainty = allowed * max(abs(value), sizes[label])
            yield Metric(f"{AT_THE_END}:{body}.{label}", MOTION, value, uncertainty)


def path_length(trajectory: Trajectory, scene: Scene) -> float:
    """Return the length of the paths of all bodies, m.

    Unlike an error, it also changes if a run changes towards the truth.
    """
    length = 0.0
    for body in scene.bodies:
        speed = np.hypot(trajectory[f"{body}.vx"], trajectory[f"{body}.vy"])
        length += float(np.trapezoid(speed, trajectory.t))
    return length


def _truth_row(run: PlannedRun) -> Row:
    """Return the row of the truth of a scene; called in a child process."""
    truth = ground_truth(run.scene)
    metrics = [*_true_positions(run.scene, truth), *_true_events(truth)]
    return replace(run.row, status=Status.OK, reason=truth.note, metrics=tuple(metrics))


def _true_positions(scene: Scene, truth: Truth) -> Iterator[Metric]:
    """Yield the positions of all bodies at the end, as far as the truth contains them."""
    end = truth(np.array([truth.t_end]))
    for body in scene.bodies:
        for label in _POSITIONS:
            column = f"{body}.{label}"
            if column in end:
                name = f"{AT_THE_END}:{column}"
                value = float(end[column][0])
                yield Metric(name, TRUTH, value, truth.uncertainty.get(column), truth.tier)


def _true_events(truth: Truth) -> Iterator[Metric]:
    """Yield the number and the last time of the events of each joint, by their kind."""
    times_of: dict[tuple[str, str], list[float]] = defaultdict(list)
    for event in truth.events:
        times_of[event.kind, event.joint].append(event.time)
    uncertainty = truth.uncertainty.get("event time")
    for (kind, joint), times in sorted(times_of.items()):
        yield Metric(f"events:{joint}.{kind}", TRUTH, len(times), 0.0, truth.tier)
        yield Metric(f"last_event:{joint}.{kind}", TRUTH, max(times), uncertainty, truth.tier)
