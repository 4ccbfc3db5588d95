"""Variants of engines that are compared, their runs, and the steps and output instants of these runs."""

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
from stiction.scenes.laws import MOVES, Linear, Sine, law_terms
from stiction.scenes.model import LinearSpring, TorsionalSpring

Parameter = Literal["dt", "rtol", "iterations"]
PARAMETERS: tuple[Parameter, ...] = get_args(Parameter)
"""Parameters that are refined: step size (s), relative tolerance, number of iterations per step."""

OWN_CPU = "engine_time"
"""Column: CPU time in calls of the engine (`stiction.scenes.Cost.own_s`), a part of ``cpu_time``;
s."""

FRICTION_BY = "friction_by"
"""Column: the `Supplier` of the friction law of a run."""
EVENTS_BY = "events_by"
"""Column: the `Supplier` of the location of events of a run."""
COEFFICIENTS = "coefficients"
"""Column: the `Coefficients` of friction of a run and of the truth that it is compared with."""


class Coefficients(StrEnum):
    """Coefficients of friction that an engine represents; only runs with the same ones are compared."""

    BOTH = "mus > mu"
    """Static and kinetic coefficient."""
    ONE = "mus = mu"
    """Kinetic coefficient only; such a run is compared with the truth for mus = mu."""

    @classmethod
    def of(cls, static_coefficient: bool) -> Coefficients:
        """Return the coefficients of an engine that represents, or does not represent, a static one."""
        return cls.BOTH if static_coefficient else cls.ONE


@dataclass(frozen=True)
class Variant:
    """An engine in one fidelity and with fixed settings, together with its refinement series.

    Attributes
    ----------
    label : str
        Short unique name, as in legends: ``"pymunk, contact"``.
    engine : str
        Name of the engine.
    parameter : str
        The parameter that is refined, one of `PARAMETERS`.
    ladder : tuple of float
        Values of the parameter, from coarse to fine.
    fidelity : Fidelity
    settings : Mapping
        Settings of the engine.
    stands_for : str
        Name of the engine with whose baseline the runs are compared; `engine` if empty.
    cost, threshold : tuple of float
        Other values of the parameter, for work-precision diagrams and for the stick threshold.
    effects : Mapping
        By name, settings that `stiction.comparisons.studies.effects` switches on or off.
    subject, setting, changed : str
        Only for variants of `stiction.comparisons.studies.settings`: the method whose setting is
        varied, the setting with its value, and the name of the setting, which is empty for the
        default.
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
    """One run and its outcome.

    Attributes
    ----------
    key : str
        ``"<scene>/<variant>/<parameter>=<step>"``; rows of tables refer to the run by it.
    scene : str
        Name of the scene.
    variant : Variant
    step : float
        Value of the variant's parameter.
    outcome : Outcome
        Its value is the trajectory if the status is `Status.OK`, and None otherwise.
    """

    key: str
    scene: str
    variant: Variant
    step: float
    outcome: Outcome

    @property
    def trajectory(self) -> Trajectory | None:
        """The trajectory, None if the run failed."""
        return self.outcome.value

    @property
    def run(self) -> Trajectory:
        """The trajectory; raises ValueError if the run failed."""
        if self.trajectory is None:
            raise ValueError(
                f"{self.key}: found a run that is {self.outcome.status}; expected one that succeeded"
            )
        return self.trajectory

    def describe(self) -> dict[str, Any]:
        """Return the values of the columns that every table of runs begins with."""
        trajectory = self.trajectory
        row: dict[str, Any] = {
            "scene": self.scene,
            "variant": self.variant.label,
            "engine": label_of(self.variant.engine),
            "version": None,
            "fidelity": self.variant.fidelity,
            FRICTION_BY: None,
            EVENTS_BY: None,
            "parameter": self.variant.parameter,
            "step": self.step,
            "status": self.outcome.status,
            "reason": self.outcome.reason,
            "cpu_time": None,
            OWN_CPU: None,
            "settings": None,
            "key": self.key,
        }
        if trajectory is None:
            return row
        row["version"] = trajectory.version
        row[FRICTION_BY] = trajectory.settings.get(FRICTION_SUPPLIED_BY)
        row[EVENTS_BY] = trajectory.settings.get(EVENTS_LOCATED_BY)
        if not self.outcome.reason and trajectory.termination != "end":
            row["reason"] = trajectory.termination
        row["cpu_time"] = trajectory.cost.stepping_s
        row[OWN_CPU] = trajectory.cost.own_s
        row["settings"] = json.dumps(dict(trajectory.settings), default=str)
        return row


COARSEST = 1e-2
"""Coarsest step of the runs that are compared, s. It was chosen for the paper's cases, which last
24 s and have excitations with periods of seconds. Series for cost begin with steps up to four times
as long."""
STEPS_PER_RUN = 100
"""Minimum number of the coarsest steps in a run; with fewer, the output does not show the
motion."""
STEPS_PER_PERIOD = 20
"""Minimum number of the coarsest steps in the fastest period. A method of first order then has an
error of about a third of the amplitude (2 pi / 20)."""
MOST_STEPS = 20_000
"""Largest number of the coarsest steps in a run that a fast period may require: the period of a
spring at a light body is a lower bound, which may be far too small if constraints connect the body
to others."""
COMMON_STEP = 1e-3
"""Step at which methods are compared, s; to be multiplied by `time_factor`."""
FINE_OUTPUT = 0.002
"""Time between output samples of runs in which jumps are resolved, s; to be multiplied by
`time_factor`."""
OUTPUT = 0.01
"""Time between output samples of all other runs, s; to be multiplied by `time_factor`."""
ROUNDING = 1e-9
"""Relative tolerance of quotients of times, which must not be affected by rounding if they are
whole numbers."""
STEP_DIGITS = 12
"""Significant digits of a step; further ones are rounding of a product, which keys and tables
should not contain."""


def time_factor(scene: Scene, t_end: float | None = None) -> float:
    """Return the factor by which steps and times between samples are multiplied: 1, 0.5, 0.2, 0.1, ..

    It is the largest factor with which the coarsest step is at most 1/`STEPS_PER_RUN` of the run
    and 1/`STEPS_PER_PERIOD` of the fastest period. The second condition is limited to `MOST_STEPS`
    steps per run.
    """
    end = scene.t_end if t_end is None else t_end
    longest_for_period = max(fastest_period(scene) / STEPS_PER_PERIOD, end / MOST_STEPS)
    longest = min(end / STEPS_PER_RUN, longest_for_period)
    # A run of 1 s has 100 steps of 1e-2 s in spite of rounding.
    limit = longest / COARSEST * (1 + ROUNDING)
    if limit >= 1:
        return 1.0
    # Round down to 5, 2 or 1 times a power of ten. 1 is the factor if 5 and 2 are too large.
    decade = math.floor(math.log10(limit))
    digit = 1
    for candidate in (2, 5):
        if candidate * 10.0**decade <= limit * (1 + ROUNDING):
            digit = candidate
    # from text, because 5 * 10.0**-3 is not the float 0.005
    return float(f"{digit}e{decade}")


def fastest_period(scene: Scene) -> float:
    """Return the shortest period of laws of time, rotating drives and springs of a scene, s; inf if there is none.

    A spring of stiffness k between two otherwise free bodies has the angular frequency sqrt(k c).
    The compliance c is the sum of 1/m + r^2/I over both bodies, with the distance r of the spring's
    point from the centre of mass, or of 1/I for a torsional spring. It is an upper bound in a
    mechanism, because constraints add mass (Rayleigh's quotient).
    """
    frequencies = [0.0]
    for element in (*scene.drives.values(), *scene.forces.values()):
        for law in law_terms(element.law):
            if isinstance(law, Sine):
                frequencies.append(abs(law.frequency))
            elif isinstance(law, Linear) and getattr(element, "type", "") == "angle":
                frequencies.append(abs(law.rate))
            elif isinstance(law, MOVES):
                frequencies.append(2 * math.pi / law.duration)
    for spring in scene.springs.values():
        frequencies.append(math.sqrt(spring.stiffness * _compliance(scene, spring)))
    fastest = max(frequencies)
    return 2 * math.pi / fastest if fastest else math.inf


def _compliance(scene: Scene, spring: LinearSpring | TorsionalSpring) -> float:
    """Return the largest relative acceleration of a spring's ends by a unit force or torque, 1/kg or 1/(kg m^2)."""
    compliance = 0.0
    for i, name in enumerate(spring.bodies):
        body = scene.bodies.get(name)
        if body is None:
            continue  # the ground does not move
        if isinstance(spring, LinearSpring):
            x, y = spring.points[i]
            compliance += 1 / body.mass + (x**2 + y**2) / body.inertia
        else:
            compliance += 1.0 / body.inertia
    return compliance


def scaled(
    variants: Iterable[Variant], scene: Scene, t_end: float | None = None
) -> tuple[Variant, ...]:
    """Return variants whose steps, including a step among the settings, are multiplied by `time_factor`."""
    factor = time_factor(scene, t_end)
    if factor == 1:
        return tuple(variants)
    return tuple(_with_scaled_steps(variant, factor) for variant in variants)


def _with_scaled_steps(variant: Variant, factor: float) -> Variant:
    """Return a variant with its steps multiplied by a factor."""
    ladder = variant.ladder
    if variant.parameter == "dt":
        ladder = tuple(_round_step(step * factor) for step in ladder)
    settings = dict(variant.settings)
    if "dt" in settings:
        settings["dt"] = _round_step(settings["dt"] * factor)
    return replace(variant, ladder=ladder, settings=settings)


def _round_step(step: float) -> float:
    """Return a step rounded to `STEP_DIGITS` significant digits."""
    return float(f"{step:.{STEP_DIGITS}g}")


def run_key(scene: Scene, variant: Variant, step: float) -> str:
    """Return the key of a run: ``scene/variant/dt=0.001``."""
    return f"{scene.name}/{variant.label}/{variant.parameter}={step:g}"


def job(scene: Scene, variant: Variant, step: float, **arguments: Any) -> Job:
    """Return the job of a run; `arguments` of `Engine.simulate` override the settings unless they are None.

    Output is sampled with `FINE_OUTPUT` if the step is the finest of its variant, or at most
    `COMMON_STEP`, so that jumps of the driving effort are resolved by all methods that are
    compared; otherwise with `OUTPUT`.
    """
    arguments = {name: value for name, value in arguments.items() if value is not None}
    factor = time_factor(scene, arguments.get("t_end"))
    is_finest = step == variant.ladder[-1]
    is_common_or_finer = variant.parameter == "dt" and step <= _round_step(COMMON_STEP * factor)
    output_step = FINE_OUTPUT if is_finest or is_common_or_finer else OUTPUT
    return Job(
        run_key(scene, variant, step),
        variant.engine,
        scene,
        {
            variant.parameter: step,
            "fidelity": variant.fidelity,
            "output_step": _round_step(output_step * factor),
            **variant.settings,
            **arguments,
        },
    )


def run_command(scene: str, engine: str, options: Iterable[tuple[str, str]]) -> str | None:
    """Return the shell command of a run, with options given by name and value.

    Returns None if the scene is neither in the catalogue nor a TOML file.
    """
    if scene not in catalogue() and not scene.endswith(".toml"):
        return None
    words = ["stiction", "run", scene, "--engine", engine]
    for name, value in options:
        words += [f"--{name}", value]
    return shlex.join(words)


def has_static_coefficient(variant: Variant) -> bool:
    """Return whether a variant represents mus > mu; otherwise it is compared with the truth for mus = mu."""
    try:
        capabilities = load_engine(variant.engine).capabilities
    except EngineMissing:
        # Its runs fail with `Status.MISSING`, so that they are not compared with any truth.
        return True
    return capabilities.static_coefficient.get(variant.fidelity, False)


def coefficients_of(variant: Variant) -> dict[str, str]:
    """Return the column `COEFFICIENTS` of the runs of a variant, for tables that compare them with a truth."""
    return {COEFFICIENTS: str(Coefficients.of(has_static_coefficient(variant)))}


MUS_EQUALS_MU = " (mus = mu)"
"""End of the name of a truth for engines without a static coefficient."""


WITH_CLEARANCE = " (clearance)"
"""End of the name of a truth with the clearance that a scene declares; without it joints are ideal."""


def truth_key(scene: str, static_coefficient: bool, has_gaps: bool = False) -> str:
    """Return the name of the truth of a scene for engines with or without a static coefficient and clearance."""
    name = scene if static_coefficient else scene + MUS_EQUALS_MU
    return name + WITH_CLEARANCE if has_gaps else name
