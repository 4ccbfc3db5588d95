"""Variants, which are compared: an engine in one fidelity with fixed settings, over steps or tolerances."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Literal, get_args

from stiction.engines.isolation import Job, Outcome
from stiction.engines.protocol import EVENTS_LOCATED_BY, FRICTION_SUPPLIED_BY
from stiction.engines.registry import EngineMissing, label_of, load_engine
from stiction.scenes import Scene, Trajectory, catalogue
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.laws import Linear, Sine
from stiction.scenes.model import LinearSpring

Parameter = Literal["dt", "rtol", "iterations"]
PARAMETERS: tuple[Parameter, ...] = get_args(Parameter)
"""Parameters that are refined: a step (s), a relative tolerance, the iterations by which an engine solves a step."""

OWN_CPU = "engine_time"
"""Column of tables: CPU seconds inside the engine's own calls (`stiction.scenes.Cost.own_s`), part of ``cpu_time``."""

FRICTION_BY, EVENTS_BY = "friction_by", "events_by"
"""Columns of tables: who supplies the friction law of a run, and who locates its events (`Supplier`)."""
COEFFICIENTS = "coefficients"
"""Column of tables: the `Coefficients` of friction of a run and of its truth."""


class Coefficients(StrEnum):
    """How many coefficients of friction an engine has in a scene: runs of different ones answer different questions."""

    BOTH = "mus > mu"
    """The static and the kinetic one."""
    ONE = "mus = mu"
    """The kinetic one alone; such a run is compared with the truth for mus = mu."""

    @classmethod
    def of(cls, static_coefficient: bool) -> Coefficients:
        return cls.BOTH if static_coefficient else cls.ONE


@dataclass(frozen=True)
class Variant:
    """An engine with settings, over a `ladder` of steps or tolerances, from coarse to fine.

    The label is short and unique, as it stands in legends: ``"pymunk, contact"``; the parameter is one of `PARAMETERS`.
    With a baseline it is compared in the place of the engine that it `stands_for`, its own if empty. `cost` and
    `threshold` are series of the same parameter for comparisons that take other steps (`campaigns/validation.toml`).
    `effects` are settings by name that `stiction.comparisons.studies.effects` toggles. `subject` and `setting` are of a
    variant that tries a setting: the method whose setting it is, and what is set; `changed` is the name of that
    setting, empty for the default.
    """

    label: str
    engine: str
    parameter: str
    ladder: tuple[float, ...]
    fidelity: Fidelity = Fidelity.JOINT
    settings: Mapping[str, Any] = field(default_factory=dict)
    stands_for: str = ""
    cost: tuple[float, ...] = ()
    threshold: tuple[float, ...] = ()
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    subject: str = ""
    setting: str = ""
    changed: str = ""


@dataclass(frozen=True)
class Record:
    """One run of the campaign and its outcome, whose value is the trajectory, None unless the status is `Status.OK`.

    The key ``"<scene>/<variant>/<parameter>=<step>"`` leads from a row of a table to the trajectory.
    """

    key: str
    scene: str
    variant: Variant
    step: float
    outcome: Outcome

    @property
    def trajectory(self) -> Trajectory | None:
        return self.outcome.value

    @property
    def run(self) -> Trajectory:
        """The trajectory of a run that succeeded; raises ValueError for others."""
        if self.trajectory is None:
            raise ValueError(
                f"{self.key}: found a run that is {self.outcome.status}; expected one that succeeded"
            )
        return self.trajectory

    def describe(self) -> dict[str, Any]:
        """Return the columns that every table begins with."""
        trajectory = self.trajectory
        early = trajectory.termination if trajectory and trajectory.termination != "end" else ""
        return {
            "scene": self.scene,
            "variant": self.variant.label,
            "engine": label_of(self.variant.engine),
            "version": trajectory.version if trajectory else None,
            "fidelity": self.variant.fidelity,
            FRICTION_BY: trajectory.settings.get(FRICTION_SUPPLIED_BY) if trajectory else None,
            EVENTS_BY: trajectory.settings.get(EVENTS_LOCATED_BY) if trajectory else None,
            "parameter": self.variant.parameter,
            "step": self.step,
            "status": self.outcome.status,
            "reason": self.outcome.reason or early,
            "cpu_time": trajectory.cost.stepping_s if trajectory else None,
            OWN_CPU: trajectory.cost.own_s if trajectory else None,
            "settings": json.dumps(dict(trajectory.settings), default=str) if trajectory else None,
            "key": self.key,
        }


COARSEST = 1e-2
"""Seconds; the coarsest step of the runs that are compared, chosen for the paper's cases: 24 s, excited with periods of
seconds. Steps for cost begin up to four times as coarse."""
STEPS_PER_RUN, STEPS_PER_PERIOD = 100, 20
"""Coarsest steps in a run, and in its fastest period, at least: with fewer an output says nothing of the motion, and a
method of first order is off by a third of the amplitude (2 pi/20)."""
MOST_STEPS = 20_000
"""Largest number of coarsest steps in a run because of fast periods: the period of a spring on a light body is a bound,
which constraints may make far too small."""


COMMON_STEP = 1e-3
"""Seconds, times `time_factor`: the step at which methods are compared with each other."""
FINE_OUTPUT, OUTPUT = 0.002, 0.01
"""Seconds, times `time_factor`: distance of the samples that are kept of runs that resolve jumps, and of the others."""
ROUNDING = 1e-9
"""Relative rounding of quotients of steps, so that a whole one counts as such."""
STEP_DIGITS = 12
"""Digits of a step: the last ones, which multiplication leaves, would stand in keys and tables."""


def time_factor(scene: Scene, t_end: float | None = None) -> float:
    """Return the factor on the steps and on the distance of outputs for a scene: 1, 0.5, 0.2, 0.1, ..

    It is the largest with which the coarsest step is at most 1/`STEPS_PER_RUN` of the run and 1/`STEPS_PER_PERIOD` of
    the fastest period. For the latter a run has no more than some `MOST_STEPS`.
    """
    end = scene.t_end if t_end is None else t_end
    longest = min(
        end / STEPS_PER_RUN, max(fastest_period(scene) / STEPS_PER_PERIOD, end / MOST_STEPS)
    )
    # a run of 1 s has 100 steps of 1e-2 s, whatever rounding says
    limit = longest / COARSEST * (1 + ROUNDING)
    if limit >= 1:
        return 1.0
    # the next lower one of 5, 2, 1 in its decade
    decade = math.floor(math.log10(limit))
    return next(
        float(f"{digit}e{decade}")
        for digit in (5, 2, 1)
        if digit * 10.0**decade <= limit * (1 + ROUNDING)
    )


def fastest_period(scene: Scene) -> float:
    """Return the shortest period that the scene declares, s: of laws, turns and springs; infinite without any.

    The frequency of a spring alone between two bodies is at most sqrt(k c), where c is what a unit force at its points
    accelerates them by: 1/m + r^2/I of each (Rayleigh's quotient; constraints only add mass), of a torsional spring 1/I
    of each.
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
            # the ground does not move
            if (body := scene.bodies.get(name)) is not None:
                turned = 1.0 if arm is None else arm[0] ** 2 + arm[1] ** 2
                compliance += (0.0 if arm is None else 1 / body.mass) + turned / body.inertia
        frequencies.append(math.sqrt(spring.stiffness * compliance))
    fastest = max(frequencies)
    return 2 * math.pi / fastest if fastest else math.inf


def scaled(
    given: Iterable[Variant], scene: Scene, t_end: float | None = None
) -> tuple[Variant, ...]:
    """Return the variants with their steps, and a step among their settings, times `time_factor`."""
    factor = time_factor(scene, t_end)
    if factor == 1:
        return tuple(given)

    def scaled_one(variant: Variant) -> Variant:
        steps = tuple(_rounded(step * factor) for step in variant.ladder)
        own = {"dt": _rounded(variant.settings["dt"] * factor)} if "dt" in variant.settings else {}
        return replace(
            variant,
            ladder=steps if variant.parameter == "dt" else variant.ladder,
            settings={**variant.settings, **own},
        )

    return tuple(map(scaled_one, given))


def _rounded(step: float) -> float:
    """Drop the digits of a step beyond `STEP_DIGITS`."""
    return float(f"{step:.{STEP_DIGITS}g}")


def run_key(scene: Scene, variant: Variant, step: float) -> str:
    """Return the key of a run: ``scene/variant/dt=0.001``."""
    return f"{scene.name}/{variant.label}/{variant.parameter}={step:g}"


def job(scene: Scene, variant: Variant, step: float, **arguments: Any) -> Job:
    """Return the run of a variant with one of its steps; arguments that are None are left out.

    Samples are kept every 10 ms; every 2 ms with the finest step and at `COMMON_STEP` and below, for the jumps of the
    driving effort: methods that are compared have the same. Both times `time_factor`.
    """
    arguments = {name: value for name, value in arguments.items() if value is not None}
    factor = time_factor(scene, arguments.get("t_end"))
    fine = step == variant.ladder[-1] or (
        variant.parameter == "dt" and step <= _rounded(COMMON_STEP * factor)
    )
    output = {"output_step": _rounded((FINE_OUTPUT if fine else OUTPUT) * factor)}
    return Job(
        run_key(scene, variant, step),
        variant.engine,
        scene,
        {
            variant.parameter: step,
            "fidelity": variant.fidelity,
            **output,
            **variant.settings,
            **arguments,
        },
    )


def run_command(scene: str, engine: str, options: Iterable[tuple[str, str]]) -> str | None:
    """Return the command of a run, for a shell, options by name; None if its scene is not in the catalogue."""
    words = ["stiction", "run", scene, "--engine", engine]
    return (
        shlex.join(words + [word for name, value in options for word in (f"--{name}", value)])
        if scene in catalogue()
        else None
    )


def has_static_coefficient(variant: Variant) -> bool:
    """Tell if the variant represents mus > mu; else it is compared with the truth for mus = mu."""
    try:
        return load_engine(variant.engine).capabilities.static_coefficient.get(
            variant.fidelity, False
        )
    except EngineMissing:
        return True  # its runs will be rows with status `Status.MISSING`; any truth will do


def coefficients_of(variant: Variant) -> dict[str, str]:
    """Return the column `COEFFICIENTS` of a run of the variant, for tables that compare it with a truth."""
    return {COEFFICIENTS: str(Coefficients.of(has_static_coefficient(variant)))}


MUS_EQUALS_MU = " (mus = mu)"
"""Ending of the key of a truth for engines without a static coefficient."""


def truth_key(scene: str, static_coefficient: bool) -> str:
    """Return the name of the truth of a scene with the physics of an engine."""
    return scene if static_coefficient else scene + MUS_EQUALS_MU
