"""One run and every number that is kept of it: errors against the truth, the path it took, events, drift, counters, time.

The numbers are made in the child process that simulates, the truth included, so that nothing that happens to any of them can
end the campaign, and no trajectory has to travel.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stiction.comparisons.campaigns.run_identity import run_identity, truth_identity
from stiction.comparisons.measures.accuracy import TORQUE_ERROR, errors, size_of
from stiction.comparisons.measures.drift import DECAY_ERROR, ROUNDING, decay_error, drift
from stiction.comparisons.measures.scene_truth import OWN_RUN, ground_truth
from stiction.comparisons.timing.nightly_time import TIME, relative_time
from stiction.comparisons.timing.rounds import bare_run
from stiction.comparisons.truth import CLOSED_FORM, NO_TRUTH, Truth
from stiction.comparisons.variants import Variant, job, physics_of, run_key
from stiction.engines.isolation import Outcome, Task
from stiction.engines.reference.engine import compile_kernels
from stiction.engines.registry import load_engine
from stiction.scenes import Scene, Trajectory

TRUTH = "truth"
"""Kind of the numbers that say what is true, and engine and variant of their rows."""
MOTION = "motion"
"""Kind of the path of a run with fixed steps."""
KINDS = ("accuracy", MOTION, "event", "drift", "counter", "time")
"""What can be measured of a run."""
RANDOM = "random"
"""Kind and variant of what is drawn afresh every night, see `stiction.comparisons.random_scenes.night_draws`: it has no baseline, and is right or wrong by itself."""
NOT_RUN = "not run"
"""Status of a run that the campaign had no time left for."""

_ACCURACY = {"position error [m]": "position uncertainty [m]", "velocity error [m/s]": "velocity uncertainty [m/s]",
             TORQUE_ERROR: "torque uncertainty [N m]", "event time error [s]": "event time uncertainty [s]"}
_EVENTS = ("events matched", "events missed", "events spurious")
_DRIFT = ("position drift, max [m]", "velocity drift, max [m/s]")
PATH = "path of the bodies [m]"
OUTPUT_STEP = 0.01
"""Seconds between the instants at which errors are measured."""
_STATE = {"x": "m", "y": "m", "angle": "rad"}


@dataclass(frozen=True)
class Metric:
    """A number: `name` with its unit, `kind` one of `KINDS` or `TRUTH`.

    Attributes
    ----------
    uncertainty : float or None
        In the unit of the value: of a truth its own, of an error that of the truth, of a time how far the second shortest repeat
        is above the shortest; None where none is known.
    tier : str
        Of the truth behind it: what an error was measured against. ``our own run`` for counters and times.
    rounding : float or None
        How far rounding alone moves the value, see `stiction.comparisons.campaigns.rounding`; None where that was not measured.
    """

    name: str
    kind: str
    value: float
    uncertainty: float | None = None
    tier: str = OWN_RUN
    rounding: float | None = None


@dataclass(frozen=True)
class Row:
    """A run, what became of it, and its numbers; of a truth, `variant` and `engine` are `TRUTH`, `parameter` is empty.

    `key` is its name, unique in a campaign; `identity` is what it is, see `stiction.comparisons.campaigns.run_identity`. `traceback` is that of a bug, as the run was
    made; no history keeps it. `other_ends` are the outcomes that the run has with other rounding, where that was measured.
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
    """The status of a run; ``incomplete`` where it came out with a reservation: it ended early, or there is no truth for it."""
    return "incomplete" if status == "ok" and reason else status


@dataclass(frozen=True)
class PlannedRun:
    """What a row is about, before it is run: a variant at one rung on a scene, or the truth of a scene where `variant` is None.

    Of one that is `followed`, the path is measured as well.
    """

    scene: Scene
    variant: Variant | None = None
    step: float = 0.0
    followed: bool = False

    @property
    def key(self) -> str:
        return f"{self.scene.name}/{TRUTH}" if self.variant is None else run_key(self.scene, self.variant, self.step)

    @property
    def identity(self) -> str:
        return truth_identity(self.scene) if self.variant is None else run_identity(self.scene, self.variant, self.step)

    def task(self, kinds: Collection[str], repeats: int) -> Task:
        """The measurement, for `stiction.engines.isolate`; its value is for `row`."""
        if self.variant is None:
            return Task(self.key, _truth_numbers, (self.scene,))
        return task_of_run(self, kinds, repeats, self.scene, OUTPUT_STEP)

    def row(self, outcome: Outcome) -> Row:
        measured: Measured = outcome.value or Measured()
        named = (TRUTH, TRUTH, measured.version, "", "", 0.0) if self.variant is None else (
            self.variant.label, self.variant.engine, measured.version, self.variant.fidelity, self.variant.parameter, self.step)
        status = measured.status if outcome.status == "ok" else outcome.status
        return Row(self.key, self.identity, self.scene.name, *named, status, outcome.reason or measured.reason, measured.settings,
                   measured.metrics, outcome.traceback)


def task_of_run(run: PlannedRun, kinds: Collection[str], repeats: int, given: Scene, output_step: float) -> Task:
    """The measurement of a run on `given`, a scene that is the run's own but for rounding."""
    made = job(run.scene, run.variant, run.step, output_step=output_step)
    wanted = tuple(kind for kind in kinds if kind != MOTION or run.followed and run.variant.parameter == "dt")
    return Task(run.key, _run_numbers, (made.engine, run.scene, given, dict(made.arguments), wanted, repeats))


@dataclass(frozen=True)
class Measured:
    """What a child returns of a run: the fields of its `Row` that the run itself tells."""

    version: str | None = None
    status: str = "ok"
    reason: str = ""
    settings: Mapping[str, Any] | None = None
    metrics: tuple[Metric, ...] = ()


def _run_numbers(engine: str, scene: Scene, given: Scene, arguments: dict[str, Any], kinds: Collection[str], repeats: int) -> Measured:
    """In the child: simulate `given`, then measure against the truth of `scene`.

    A run is timed apart (`stiction.comparisons.timing.nightly_time`). The time is that of the whole `Engine.run` as this process sees it, whatever the engine says
    of its own.
    """
    compile_kernels()
    solver = load_engine(engine)
    scene, given = (physics_of(each, solver.capabilities.static_coefficient.get(arguments["fidelity"], False)) for each in (scene, given))
    trajectory = solver.simulate(given, **arguments)
    reason = "" if trajectory.termination == "end" else trajectory.termination
    status = "ok"
    metrics: list[Metric] = []
    if {"accuracy", "event"} & set(kinds):
        truth = ground_truth(scene)
        if truth.tier == NO_TRUTH:
            reason = reason or f"no truth to compare with: {truth.note}"
        found = errors(trajectory, truth, size_of(scene))
        status, reason = found.get("status", status), found.get("reason", reason)
        metrics += _errors(found, truth)
    metrics.append(Metric(PATH, MOTION, path_length(trajectory)))
    metrics += _drifts(trajectory, scene)
    metrics += [Metric(name, "counter", count) for name, count in trajectory.cost.counters.items()]
    if "time" in kinds and status == "ok" and trajectory.termination == "end":
        metrics.append(Metric(TIME, "time", *relative_time(bare_run(solver, given, arguments), repeats)))
    return Measured(trajectory.version, status, reason, trajectory.settings, tuple(metric for metric in metrics if metric.kind in kinds))


def _errors(found: Mapping[str, Any], truth: Truth) -> Iterator[Metric]:
    for name, unsure in _ACCURACY.items():
        if math.isfinite(found.get(name, math.nan)):
            yield Metric(name, "accuracy", found[name], found[unsure], truth.effort_tier if name == TORQUE_ERROR else truth.tier)
    yield from (Metric(name, "event", found[name], tier=truth.tier) for name in _EVENTS if name in found)


def path_length(trajectory: Trajectory) -> float:
    """How far the bodies went, all together: unlike an error, it shows what moves a run towards the truth, too."""
    bodies = [name.removesuffix(".vx") for name in trajectory.columns if name.endswith(".vx")]
    speeds = [np.hypot(trajectory[f"{body}.vx"], trajectory[f"{body}.vy"]) for body in bodies]
    return float(sum(np.trapezoid(speed, trajectory.t) for speed in speeds))


def _drifts(trajectory: Trajectory, scene: Scene) -> Iterator[Metric]:
    found = drift(trajectory)
    yield from (Metric(name, "drift", found[name], ROUNDING, CLOSED_FORM) for name in _DRIFT if name in found)
    if (decay := decay_error(trajectory, scene)) is not None:
        yield Metric(DECAY_ERROR, "drift", decay.value, decay.uncertainty, CLOSED_FORM)


def _truth_numbers(scene: Scene) -> Measured:
    """In the child: where the bodies are at the end, and what happened on the way."""
    truth = ground_truth(scene)
    end = truth(np.array([truth.t_end]))
    metrics = [Metric(f"{body}.{name} at the end [{unit}]", TRUTH, float(end[f"{body}.{name}"][0]),
                      truth.uncertainty.get(f"{body}.{name}"), truth.tier)
               for body in scene.bodies for name, unit in _STATE.items() if f"{body}.{name}" in end]
    for (kind, joint), count in sorted(Counter((event.kind, event.joint) for event in truth.events).items()):
        last = max(event.time for event in truth.events if (event.kind, event.joint) == (kind, joint))
        metrics += [Metric(f"{joint}, {kind}: events [-]", TRUTH, count, 0.0, truth.tier),
                    Metric(f"{joint}, {kind}: the last [s]", TRUTH, last, truth.uncertainty.get("event time"), truth.tier)]
    return Measured(reason=truth.note, metrics=tuple(metrics))
