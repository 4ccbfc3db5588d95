"""What is compared: an engine in one fidelity with fixed settings, over a ladder of steps or tolerances."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from stiction.engines.isolation import Job, Outcome
from stiction.engines.protocol import EVENTS_LOCATED_BY
from stiction.engines.registry import EngineMissing, load_engine
from stiction.scenes import Scene, Trajectory, vary
from stiction.scenes.laws import Linear, Sine
from stiction.scenes.model import LinearSpring

PARAMETERS = ("dt", "rtol", "iterations")
"""What is refined: a step (s), a relative tolerance, the iterations by which an engine solves a step."""

OWN_CPU = "engine cpu [s]"
"""Column of tables: CPU seconds inside the engine's own calls (`stiction.scenes.Cost.own_s`), of those in ``cpu [s]``."""

UNMADE = ("missing", "not run")
"""Statuses of runs that were not made: their engine is not installed, or the campaign was interrupted. They are counted for nobody."""

FRICTION_BY, EVENTS_BY = "friction by", "events by"
"""Columns of tables: who supplies the friction law of a run, and who locates its events."""


@dataclass(frozen=True)
class Variant:
    """An engine with settings, over a ladder.

    Attributes
    ----------
    label : str
        Short and unique, as it stands in legends: ``"pymunk, contact"``.
    engine : str
    parameter : {"dt", "rtol"}
        What the ladder varies.
    ladder : tuple of float
        From coarse to fine.
    fidelity : str
    settings : Mapping
    stands_for : str
        The engine in whose place this one is compared with a baseline: its own if empty.
    cost, threshold : tuple of float
        Other ladders of the same parameter, for the comparisons that take other steps; see `campaigns/validation.toml`.
    effects : Mapping[str, Mapping]
        Settings by name that `stiction.comparisons.studies.effects` toggles, beside what the scene declares.
    """

    label: str
    engine: str
    parameter: str
    ladder: tuple[float, ...]
    fidelity: str = "joint"
    settings: Mapping[str, Any] = field(default_factory=dict)
    stands_for: str = ""
    cost: tuple[float, ...] = ()
    threshold: tuple[float, ...] = ()
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Record:
    """One run of the campaign and what became of it.

    Attributes
    ----------
    key : str
        ``"<scene>/<variant>/<parameter>=<step>"``; leads from a row of a table to the trajectory.
    variant : Variant
    step : float
        The rung of the ladder: dt (s) or rtol.
    outcome : Outcome
        Its value is the trajectory, None unless the status is ``"ok"``.
    """

    key: str
    scene: str
    variant: Variant
    step: float
    outcome: Outcome

    @property
    def trajectory(self) -> Trajectory | None:
        return self.outcome.value

    def describe(self) -> dict[str, Any]:
        """The columns that every table begins with."""
        trajectory = self.trajectory
        return {"scene": self.scene, "variant": self.variant.label, "engine": self.variant.engine,
                "version": trajectory.version if trajectory else None, "fidelity": self.variant.fidelity,
                FRICTION_BY: supplier(str(trajectory.settings.get("friction_law", ""))) if trajectory else None,
                EVENTS_BY: trajectory.settings.get(EVENTS_LOCATED_BY) if trajectory else None,
                "parameter": self.variant.parameter, "step": self.step, "status": self.outcome.status,
                "reason": self.outcome.reason or (trajectory.termination if trajectory and trajectory.termination != "end" else ""),
                "cpu [s]": trajectory.cost.stepping_s if trajectory else None,
                OWN_CPU: trajectory.cost.own_s if trajectory else None,
                "settings": json.dumps(dict(trajectory.settings), default=str) if trajectory else None,
                "key": self.key}


def supplier(law: str) -> str:
    """Who supplies a friction law, by its words: engine, adapter, or the engine with a number of the adapter."""
    if "adapter" not in law:
        return "engine"
    return "engine + adapter" if "(engine)" in law else "adapter"


COARSEST = 1e-2
"""Seconds; the coarsest step of the ladders of runs that are compared, which are those of the paper's cases: 24 s, excited with periods of seconds. Ladders of cost begin
up to four times as coarse."""
STEPS_PER_RUN, STEPS_PER_PERIOD = 100, 20
"""Coarsest steps in a run, and in its fastest period, at least: with fewer an output says nothing of the motion, and a method of first order
is off by a third of the amplitude (2 pi/20)."""
MOST_STEPS = 20_000
"""Coarsest steps in a run to which fast periods may lead: the period of a spring on a light body is a bound, which constraints may make far too small."""


COMMON_STEP = 1e-3
"""Seconds, times `time_factor`: the step at which methods are compared with each other."""


def time_factor(scene: Scene, t_end: float | None = None) -> float:
    """What the steps of the ladders, and the distance of outputs, are multiplied by on a scene: 1, 0.5, 0.2, 0.1, ..; 1 on the paper's cases.

    The largest of these with which the coarsest step is no more than 1/`STEPS_PER_RUN` of the run and 1/`STEPS_PER_PERIOD` of the fastest period,
    as far as a run has no more than some `MOST_STEPS` for that.
    """
    end = scene.t_end if t_end is None else t_end
    longest = min(end / STEPS_PER_RUN, max(fastest_period(scene) / STEPS_PER_PERIOD, end / MOST_STEPS))
    limit = longest / COARSEST * (1 + 1e-9)  # a run of 1 s has 100 steps of 1e-2 s, whatever rounding says
    if limit >= 1:
        return 1.0
    decade = math.floor(math.log10(limit))
    return next(float(f"{digit}e{decade}") for digit in (5, 2, 1) if digit * 10.0 ** decade <= limit * (1 + 1e-9))


def fastest_period(scene: Scene) -> float:
    """Seconds: the shortest period that the scene declares; infinite without any.

    Those of sinusoidal laws, of a turn of a drive of constant rate, and of springs. The frequency of a spring alone between two bodies is at
    most sqrt(k c), where c is what a unit force at its points accelerates them by: 1/m + r^2/I of each (Rayleigh's quotient; constraints
    only add mass), of a torsional spring 1/I of each.
    """
    frequencies = [0.0]
    for element in (*scene.drives.values(), *scene.forces.values()):
        if isinstance(element.law, Sine):
            frequencies.append(abs(element.law.frequency))
        elif isinstance(element.law, Linear) and getattr(element, "type", "") == "angle":
            frequencies.append(abs(element.law.rate))
    for spring in scene.springs.values():
        arms = spring.points if isinstance(spring, LinearSpring) else (None, None)
        compliance = 0.0
        for name, arm in zip(spring.bodies, arms):
            if (body := scene.bodies.get(name)) is not None:  # the ground does not move
                compliance += 1 / body.inertia if arm is None else 1 / body.mass + (arm[0] ** 2 + arm[1] ** 2) / body.inertia
        frequencies.append(math.sqrt(spring.stiffness * compliance))
    fastest = max(frequencies)
    return 2 * math.pi / fastest if fastest else math.inf


def scaled(given: Iterable[Variant], scene: Scene, t_end: float | None = None) -> tuple[Variant, ...]:
    """The variants with the steps of their ladders, and a step among their settings, times `time_factor`."""
    factor = time_factor(scene, t_end)
    if factor == 1:
        return tuple(given)
    return tuple(replace(
        variant, ladder=tuple(_rounded(step * factor) for step in variant.ladder) if variant.parameter == "dt" else variant.ladder,
        settings={name: _rounded(value * factor) if name == "dt" else value for name, value in variant.settings.items()}) for variant in given)


def _rounded(step: float) -> float:
    """Without the last digits, which multiplication leaves in keys and tables."""
    return float(f"{step:.12g}")


def run_key(scene: Scene, variant: Variant, step: float) -> str:
    return f"{scene.name}/{variant.label}/{variant.parameter}={step:g}"


def job(scene: Scene, variant: Variant, step: float, **arguments: Any) -> Job:
    """The run of a variant at one rung of its ladder, for `stiction.engines.isolation`.

    Samples are kept every 10 ms; every 2 ms at the finest rung and at `COMMON_STEP` and below, for the jumps of the driving effort: what can be read off samples depends on their
    distance, so that methods which are compared have the same. Both times `time_factor`. What is None among the arguments is not asked for.
    """
    arguments = {name: value for name, value in arguments.items() if value is not None}
    factor = time_factor(scene, arguments.get("t_end"))
    fine = step == variant.ladder[-1] or (variant.parameter == "dt" and step <= _rounded(COMMON_STEP * factor))
    output = {"output_step": _rounded((0.002 if fine else 0.01) * factor)}
    return Job(run_key(scene, variant, step), variant.engine, scene,
               {variant.parameter: step, "fidelity": variant.fidelity, **output, **variant.settings, **arguments})


def has_static_coefficient(variant: Variant) -> bool:
    """Whether the variant represents mus > mu; without it, it is compared with the truth for mus = mu."""
    try:
        return load_engine(variant.engine).capabilities.static_coefficient.get(variant.fidelity, False)
    except EngineMissing:
        return True  # its runs will be rows with status "missing"; any truth will do


MUS_EQUALS_MU = " (mus = mu)"
"""Ending of the key of a truth for engines without a static coefficient."""


def truth_key(scene: str, static_coefficient: bool) -> str:
    """Name of the truth of a scene with the physics of an engine."""
    return scene if static_coefficient else scene + MUS_EQUALS_MU


def physics_of(scene: Scene, static_coefficient: bool) -> Scene:
    """The scene with the physics that an engine has: mus = mu on every guide unless it has a static coefficient."""
    overrides = {f"{name}.mus": guide.mu for name, guide in scene.frictional_guides.items() if guide.mus is not None}
    return scene if static_coefficient or not overrides else vary(scene, overrides)
