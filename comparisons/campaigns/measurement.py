"""One run and every number that is kept of it: errors against the truth, path, events, drift, counters, time.

The numbers are made in the child process that simulates, the truth included. A run can be made again with changes of
rounding only: masses and gravity are moved by some units in the last place, bodies stand in another order, samples are
kept half as often. It then differs as on another processor or with another library (`tolerances`).
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from stiction.comparisons.digest import scene_digest
from stiction.comparisons.measures.accuracy import TORQUE_ERROR, errors, size_of
from stiction.comparisons.measures.drift import DECAY_ERROR, ROUNDING, decay_error, drift
from stiction.comparisons.measures.scene_truth import OWN_RUN, ground_truth
from stiction.comparisons.timing.calibration import TIME, relative_time
from stiction.comparisons.timing.visits import bare_run
from stiction.comparisons.truth import CLOSED_FORM, NO_TRUTH, Truth
from stiction.comparisons.variants import Variant, has_static_coefficient, job, physics_of, run_key
from stiction.engines import Outcome, Task, load_engine
from stiction.engines.reference.engine import compile_kernels
from stiction.scenes import Scene, Trajectory, vary

if TYPE_CHECKING:
    from stiction.comparisons.random_scenes.night_draws import Draw

TRUTH = "truth"
"""Kind of the numbers that say what is true, and engine and variant of their rows."""
MOTION = "motion"
"""Kind of the positions of all bodies at the end of a run, and of the path of one with fixed steps."""
Kind = Literal["accuracy", "motion", "event", "drift", "counter", "time"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""Kinds of numbers that can be measured of a run."""
RANDOM = "random"
"""Kind and variant of scenes drawn afresh every night (`stiction.comparisons.random_scenes.night_draws`), which have no
baseline."""
NOT_RUN = "not run"
"""Status of a run that the campaign had no time left for."""

_ACCURACY = {"position_error": "position_uncertainty", "velocity_error": "velocity_uncertainty",
             TORQUE_ERROR: "torque_uncertainty", "event_time_error": "event_time_uncertainty"}
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

ULPS = 8
"""Units in the last place by which a number is moved at most: some operations' rounding."""
MOVED, ORDER, GRID = "numbers", "order", "grid"
WAYS = (*(f"{MOVED} {seed}" for seed in (1, 2, 3)), ORDER, GRID)
"""Ways in which a run is made again; `GRID`, with half as many samples, is the last."""


@dataclass(frozen=True)
class Metric:
    """A number: `name` with its unit, `kind` one of `KINDS`, `TRUTH` or `RANDOM`; None is what is not known.

    The uncertainty of an error is that of the truth, of a time the distance of the second shortest repeat. `tier` is
    that of the truth behind an error, ``our own run`` for counters and times. `rounding` is the largest change by
    rounding alone (`tolerances.with_rounding`).
    """

    name: str
    kind: str
    value: float
    uncertainty: float | None = None
    tier: str = OWN_RUN
    rounding: float | None = None


@dataclass(frozen=True)
class Row:
    """A run, its status, and its numbers; of a truth, `variant` and `engine` are `TRUTH`, `parameter` is empty.

    `key` and `identity` are those of a `PlannedRun`. `traceback` is that of a bug, which no history keeps. `other_ends`
    are the outcomes that the run has with other rounding, where that was measured.
    """

    key: str
    identity: str
    scene: str
    variant: str
    engine: str
    version: str | None
    fidelity: str
    parameter: str
    step: float
    status: str
    reason: str
    settings: Mapping[str, Any] | None = None
    metrics: tuple[Metric, ...] = ()
    traceback: str = field(default="", compare=False, repr=False)
    other_ends: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        return self.key

    @property
    def outcome(self) -> str:
        return outcome_of(self.status, self.reason)


def outcome_of(status: str, reason: str) -> str:
    """Return the status of a run, ``incomplete`` where it ended early or there is no truth for it."""
    return "incomplete" if status == "ok" and reason else status


@dataclass(frozen=True)
class PlannedRun:
    """A variant with a step on a scene, or the truth of a scene where `variant` is None.

    One that is `followed` is of a scene on which a check runs every variant. A run that is made again has a `way`, one
    of `WAYS`.
    """

    scene: Scene
    variant: Variant | None = None
    step: float = 0.0
    followed: bool = False
    way: str = ""

    @property
    def key(self) -> str:
        """Name of the run, for people."""
        name = f"{self.scene.name}/{TRUTH}" if self.variant is None else run_key(self.scene, self.variant, self.step)
        return f"{name}, {self.way}" if self.way else name

    @property
    def identity(self) -> str:
        """Content of the run, whatever its name: ``"pymunk, joint, dt = 0.01; scene 53f1d0c2a9e84b67"``.

        Only runs of the same identity are compared. The version of the engine is no part of it: whether a new one is
        worse is the question of a check.
        """
        variant, scene = self.variant, f"scene {scene_digest(self.scene)}"
        if variant is None:
            return f"{TRUTH}; {scene}"
        settings = sorted({**variant.settings, variant.parameter: self.step}.items())
        words = ", ".join(f"{name} = {json.dumps(value, sort_keys=True, default=str)}" for name, value in settings)
        return f"{variant.stands_for or variant.engine}, {variant.fidelity}, {words}; {scene}"

    @property
    def row(self) -> Row:
        """Row before the run is made."""
        variant = self.variant or Variant(TRUTH, TRUTH, "", (), fidelity="")
        return Row(self.key, self.identity, self.scene.name, variant.label, variant.engine, None, variant.fidelity,
                   variant.parameter, self.step, NOT_RUN, "")

    def task(self, kinds: Collection[str], repeats: int) -> Task:
        """Return the measurement, for `stiction.engines.isolate`; `row_of` makes a row of its outcome."""
        if self.variant is None:
            return Task(self.key, _truth_row, (self,))
        return Task(self.key, _run_row, (self, self.variant, tuple(kinds), repeats))


def row_of(run: PlannedRun | Draw, outcome: Outcome) -> Row:
    """Return the row of a run whose task had an outcome."""
    if outcome.status == "ok":
        return outcome.value
    return replace(run.row, status=outcome.status, reason=outcome.reason, traceback=outcome.traceback)


def disturbed(scene: Scene, way: str) -> Scene:
    """Return the scene as one of `WAYS` has it; the same motion but for rounding."""
    if way == ORDER:
        return scene.model_copy(update={"bodies": dict(reversed(scene.bodies.items()))})
    if not way.startswith(MOVED):
        return scene
    chance = np.random.default_rng([int(way.removeprefix(MOVED)), 5])

    def moved(value: float) -> float:
        return float(value * (1 + 2.0 ** -52 * chance.choice([-1, 1]) * chance.integers(1, ULPS + 1)))

    numbers: dict[str, Any] = {f"bodies.{name}.{key}": moved(getattr(body, key))
                               for name, body in scene.bodies.items() for key in ("mass", "inertia")}
    if scene.gravity is not None:
        numbers["gravity"] = [moved(part) for part in scene.gravity]
    return vary(scene, numbers)


def _run_row(run: PlannedRun, variant: Variant, kinds: Collection[str], repeats: int) -> Row:
    """Simulate and measure against the truth, in the child; the time is that of the whole `Engine.run`."""
    compile_kernels()
    solver, has_static = load_engine(variant.engine), has_static_coefficient(variant)
    scene, given = (physics_of(each, has_static) for each in (run.scene, disturbed(run.scene, run.way)))
    output_step = OUTPUT_STEP * (2 if run.way == GRID else 1)
    arguments = job(run.scene, variant, run.step, output_step=output_step).arguments
    trajectory = solver.simulate(given, **arguments)
    status, reason = "ok", "" if trajectory.termination == "end" else trajectory.termination
    found, metrics = drift(trajectory), [*_motion(trajectory, scene, variant.parameter, run.step)]
    metrics += [Metric(name, "drift", found[name], ROUNDING, CLOSED_FORM) for name in _DRIFT if name in found]
    if (decay := decay_error(trajectory, scene)) is not None:
        metrics.append(Metric(DECAY_ERROR, "drift", decay.value, decay.uncertainty, CLOSED_FORM))
    metrics += [Metric(name, "counter", count) for name, count in trajectory.cost.counters.items()]
    if {"accuracy", "event"} & set(kinds):
        truth = ground_truth(scene)
        if truth.tier == NO_TRUTH:
            reason = reason or f"no truth to compare with: {truth.note}"
        found = errors(trajectory, truth, size_of(scene))
        status, reason = found.get("status", status), found.get("reason", reason)
        metrics = [*_errors(found, truth), *metrics]
    if "time" in kinds and status == "ok" and trajectory.termination == "end":
        metrics.append(Metric(TIME, "time", *relative_time(bare_run(solver, given, arguments), repeats)))
    return replace(run.row, version=trajectory.version, status=status, reason=reason, settings=trajectory.settings,
                   metrics=tuple(metric for metric in metrics if metric.kind in kinds))


def _errors(found: Mapping[str, Any], truth: Truth) -> Iterator[Metric]:
    for name, unsure in _ACCURACY.items():
        if math.isfinite(found.get(name, math.nan)):
            tier = truth.effort_tier if name == TORQUE_ERROR else truth.tier
            yield Metric(name, "accuracy", found[name], found[unsure], tier)
    yield from (Metric(name, "event", found[name], tier=truth.tier) for name in _EVENTS if name in found)


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
    metrics = [Metric(f"{AT_THE_END}:{body}.{name}", TRUTH, float(end[f"{body}.{name}"][0]),
                      truth.uncertainty.get(f"{body}.{name}"), truth.tier)
               for body in run.scene.bodies for name in _STATE if f"{body}.{name}" in end]
    times: dict[tuple[str, str], list[float]] = defaultdict(list)
    for event in truth.events:
        times[event.kind, event.joint].append(event.time)
    for (kind, joint), found in sorted(times.items()):
        metrics += [Metric(f"events:{joint}.{kind}", TRUTH, len(found), 0.0, truth.tier),
                    Metric(f"last_event:{joint}.{kind}", TRUTH, max(found), truth.uncertainty.get("event time"),
                           truth.tier)]
    return replace(run.row, status="ok", reason=truth.note, metrics=tuple(metrics))
