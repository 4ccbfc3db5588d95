"""The protocol of engines: a name, capabilities, and `simulate(scene, ...) -> Trajectory`."""

from __future__ import annotations

import inspect
import math
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache, partial
from importlib.metadata import requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.engines.assembly import Assembly
from stiction.engines.examined import Examined
from stiction.engines.gate import first_problem
from stiction.engines.joint_effects import (
    EFFECTS_OF_GAPS,
    JointEffect,
    first_unsupported,
    has_constant_bounds,
    has_static_bounds,
    neglected_keys,
)
from stiction.scenes import Cost, InputError, Scene, StictionError, Trajectory
from stiction.scenes.fidelity import Fidelity, fidelity_of

if TYPE_CHECKING:
    from packaging.specifiers import SpecifierSet


class Supplier(StrEnum):
    """The program that supplies a part of a simulation: its friction law, or the location of its events."""

    ENGINE = "engine"
    """The engine"""
    ADAPTER = "adapter"
    """The suite's adapter of the engine. If it supplies the friction law, the engine has no Coulomb law, and applies
    the forces that the adapter's law allows."""
    BOTH = "engine + adapter"
    """The engine, with parameters that the adapter changes during the run, such as a coefficient of friction"""
    NOBODY = "nobody"
    """Neither: the scene has no friction, or events are not located"""


FRICTION_SUPPLIED_BY = "friction_supplied_by"
"""Setting of every trajectory: the `Supplier` of its friction law; nobody if the scene has no friction."""
EVENTS_LOCATED_BY = "events_located_by"
"""Setting of every trajectory: the `Supplier` of its located events."""
NEGLECTED = "neglected"
"""Setting of a trajectory: the keys of the scene that its fidelity neglects, such as ``joints.guide.clearance``;
absent if there are none."""
PRECISION = "precision"
"""Setting of a trajectory: by column, how far the column depends on the rounding of the inputs, in its unit; absent if
it was not measured. Engines in single precision measure it by a second run, whose inputs are moved by one unit in the
last place."""
REACTION_SOURCES = ("engine", "momentum balance")
"""Sources of the constraint reactions in a trajectory: the engine itself, or the balance of momentum."""
UNSETTLED = "friction does not settle"
"""Kind of the `stiction.scenes.Breakdown` of an engine that stops because it finds no solution for friction and
reactions."""
MOST_OUTPUTS = 10_000_000
"""Largest number of instants of a trajectory, with which the 35 columns of the slider-bar need 2.8 GB."""

MOST_STEPS = 1_000_000_000
"""Largest number of steps of a fixed-step run. Engines take 2 to 200 microseconds for a step, so that such a run takes
half an hour to days."""

installed_version = cache(version)
"""Version of an installed distribution; reading it takes longer than a short simulation."""


@cache
def required(package: str) -> SpecifierSet:
    """Return the versions of an engine's package that the metadata of the suite require; any if they do not name it.

    Names of packages are compared in their normalized form: ``Dart_Py`` and ``dart-py`` are one package. If the
    metadata name a package several times, for example in several extras, all of its bounds apply.
    """
    # Imported here because most commands need no bound, and the import takes a twentieth of the time
    # of that of `stiction.engines`.
    from packaging.requirements import Requirement
    from packaging.specifiers import SpecifierSet
    from packaging.utils import canonicalize_name

    bounds = SpecifierSet()
    for text in requires("stiction") or ():
        requirement = Requirement(text)
        if canonicalize_name(requirement.name) == canonicalize_name(package):
            bounds &= requirement.specifier
    return bounds


def check_version(package: str, installed: str) -> str:
    """Check the installed version of an engine's package, and return it.

    Parameters
    ----------
    package
        Name of the package in the metadata of the suite.
    installed
        The installed version.

    Raises
    ------
    ImportError
        If the suite requires another version.
    """
    if not required(package).contains(installed, prereleases=True):
        raise ImportError(
            f"found {package} {installed}; expected {required(package)}", name=package
        )
    return installed


def check_steps(t_end: float, dt: float) -> None:
    """Raise InputError for a run of more than `MOST_STEPS` steps."""
    if t_end / dt > MOST_STEPS:
        raise InputError(
            f"dt: found {dt:g} s, which is {t_end / dt:.3g} steps to t_end = {t_end:g} s; expected at "
            f"most {MOST_STEPS:.0e} steps, which take hours: dt >= {t_end / MOST_STEPS:.3g} s, or an "
            "earlier t_end"
        )


class Refused(StictionError):
    """The engine cannot represent the scene, or not with these arguments; the message contains the reason."""


class Declined(Refused):
    """The adapter refuses a scene that it could represent, without calling the engine; the message says why."""


class EngineFailure(StictionError):
    """The engine failed during a run; the message is the engine's own."""


class Unsettled(EngineFailure):
    """Friction and reactions do not settle at an instant.

    They have no solution there, or several, or this engine's method does not find it.

    Attributes
    ----------
    time : float
        Seconds.
    """

    def __init__(self, message: str, time: float):
        super().__init__(message)
        self.time = time


class BadTrajectory(EngineFailure):
    """The result of the engine is not a trajectory of the run, or not a motion of the mechanism."""


@dataclass(frozen=True)
class Capabilities:
    """Capabilities of an engine.

    Attributes
    ----------
    fidelities : tuple of Fidelity
        The supported models of a slider: ``"joint"`` (a bilateral joint whose friction is bounded by its reactions),
        ``"contact"`` (a box between two surfaces, with the engine's own contacts and friction).
    static_coefficient : Mapping[str, bool]
        By fidelity: whether a static coefficient mus > mu can be represented, by the engine or its adapter.
    friction_law : Mapping[str, str]
        By fidelity: the friction law, in words.
    reactions : str
        Source of the constraint reactions: ``"engine"`` or ``"momentum balance"``.
    order : str
        The expected order of convergence across events.
    adaptive : bool
        Whether the accuracy of a run is set by a tolerance, ``rtol``, instead of a step, ``dt``. The other argument is
        rejected by `Engine.check_arguments`.
    event_location : Supplier
        Who locates events, in runs with event location: the engine or the adapter.
    friction_by : Mapping[str, Supplier]
        By fidelity: who supplies the friction law; by default the engine. Only runs with the same supplier are ranked
        together.
    constant_bound_by : Mapping[str, Supplier]
        By fidelity: who supplies friction in joints whose bounds are constants, in scenes without other friction; by
        default the supplier in `friction_by`. If the bounds at rest and in slip differ, an engine that supplies it is
        assisted by its adapter, see `Engine.constant_bound_supplier`.
    joint_effects : Mapping[str, frozenset of JointEffect]
        By fidelity: the effects of joints, drives, springs and loads that are supported beside Coulomb's law in
        guides; by default none. Scenes with other effects are refused.

    Raises
    ------
    TypeError
        If a value has the wrong type.
    ValueError
        If a fidelity does not exist, if a mapping has a fidelity that is not among `fidelities`, if
        `static_coefficient` or `friction_law` lacks one of them, or if a value is not among those that exist.
    """

    fidelities: tuple[Fidelity, ...]
    static_coefficient: Mapping[str, bool]
    friction_law: Mapping[str, str] = field(repr=False)
    reactions: str
    order: str = field(repr=False)
    adaptive: bool = False
    event_location: Supplier = Supplier.ENGINE
    friction_by: Mapping[str, Supplier] = field(default_factory=dict)
    constant_bound_by: Mapping[str, Supplier] = field(default_factory=dict)
    joint_effects: Mapping[str, frozenset[JointEffect]] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        self._check_fidelities()
        # An adapter may use plain texts in place of members.
        object.__setattr__(self, "fidelities", tuple(map(Fidelity, self.fidelities)))
        self._check_mapping("static_coefficient", bool, is_complete=True)
        self._check_mapping("friction_law", str, is_complete=True)
        self._check_mapping("friction_by", str)
        self._check_mapping("constant_bound_by", str)
        self._check_mapping("joint_effects", Set)
        for name in ("friction_by", "constant_bound_by"):
            for supplier in getattr(self, name).values():
                _check_member(name, supplier, Supplier)
        for effects in self.joint_effects.values():
            for effect in effects:
                _check_member("joint_effects", effect, JointEffect)
        _check_member("event_location", self.event_location, (Supplier.ENGINE, Supplier.ADAPTER))
        _check_member("reactions", self.reactions, REACTION_SOURCES)
        if not isinstance(self.order, str):
            raise TypeError(f"order: found {self.order!r}; expected a text")
        if not isinstance(self.adaptive, bool):
            raise TypeError(f"adaptive: found {self.adaptive!r}; expected True or False")

    def _check_fidelities(self) -> None:
        """Raise ValueError unless `fidelities` is a tuple of one or more fidelities."""
        is_tuple = isinstance(self.fidelities, tuple) and bool(self.fidelities)
        if not is_tuple or not all(fidelity in tuple(Fidelity) for fidelity in self.fidelities):
            raise ValueError(
                f"fidelities: found {self.fidelities!r}; expected a tuple of "
                f"{' or '.join(map(_quoted, Fidelity))}"
            )

    def _check_mapping(self, name: str, value_type: type, is_complete: bool = False) -> None:
        """Check a mapping by fidelity, whose values must have a type.

        If `is_complete`, it must contain all supported fidelities; there is no default for them.
        """
        mapping = getattr(self, name)
        if not isinstance(mapping, Mapping):
            raise TypeError(f"{name}: found {mapping!r}; expected a mapping by fidelity")
        supported = ", ".join(map(_quoted, self.fidelities))
        for fidelity, value in mapping.items():
            if fidelity not in self.fidelities:
                raise ValueError(
                    f"{name}: found {fidelity!r}: {value!r}; expected supported fidelities: {supported}"
                )
            if not isinstance(value, value_type):
                raise TypeError(
                    f"{name}: found {_quoted(fidelity)}: {value!r}; expected a value of the type "
                    f"{value_type.__name__}"
                )
        if is_complete and len(mapping) < len(self.fidelities):
            raise ValueError(
                f"{name}: found {dict(mapping)!r}; expected a value for each of {supported}"
            )


def _check_member(name: str, value: object, members: Iterable[str]) -> None:
    """Raise ValueError if a value of the attribute `name` is not among `members`."""
    allowed = tuple(members)
    if value not in allowed:
        raise ValueError(f"{name}: found {value!r}; expected {' or '.join(map(_quoted, allowed))}")


def _quoted(member: str) -> str:
    """Return the value of an enumeration's member in quotes, for messages."""
    return repr(str(member))


def check_settings(
    given: Iterable[str], settings: Iterable[str], engine: str, fidelity: Fidelity
) -> None:
    """Raise InputError for names that are not among the settings of an engine.

    Parameters
    ----------
    given
        Names of settings.
    settings
        The settings that the engine has.
    engine
        Name of the engine, for the message.
    fidelity
        Fidelity of the run, for the message.
    """
    allowed = list(settings)
    expected = "one of " + ", ".join(allowed) if allowed else "none: it has no settings"
    for name in given:
        if name not in allowed:
            raise InputError(
                f"{name}: {engine} has no such setting at {fidelity} fidelity; expected {expected}"
            )


@cache
def _takes_assembly(engine: type[Engine]) -> bool:
    """Return True if `run` of a class has a parameter `assembly`."""
    return "assembly" in inspect.signature(engine.run).parameters


OBLIGATORY = ("name", "capabilities", "version", "refusal", "run")
"""Attributes and methods that a class derived from `Engine` must define."""


def _complete_cost(reported: Cost, run_s: float, gate_s: float) -> Cost:
    """Return the cost of a run.

    Parameters
    ----------
    reported
        The cost that the engine reports; if it reports none, the whole run counts as stepping.
    run_s
        CPU time of `Engine.run`, s.
    gate_s
        CPU time of the examination of the result, s.
    """
    cost = Cost(stepping_s=run_s) if reported == Cost() else reported
    # If the engine runs in a process of its own, the times that it reports may exceed `run_s`.
    output_s = max(0.0, run_s - cost.setup_s - cost.compile_s - cost.stepping_s)
    return replace(cost, output_s=output_s, gate_s=gate_s)


def _check_times(t_end: float, dt: float | None, rtol: float | None, output_step: float) -> None:
    """Raise InputError if arguments of `Engine.simulate` are not positive, too small, or too large."""
    for name, value in (("t_end", t_end), ("dt", dt), ("output_step", output_step)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise InputError(f"{name}: found {value!r}; expected seconds, > 0")
    if t_end / output_step > MOST_OUTPUTS:
        raise InputError(
            f"t_end, output_step: found {t_end:g} s and {output_step:g} s, {t_end / output_step:.3g} "
            f"instants; expected at most {MOST_OUTPUTS:g}"
        )
    if dt is not None:
        if dt > t_end:
            raise InputError(f"dt: found {dt!r}; expected at most t_end = {t_end:g} s")
        check_steps(t_end, dt)
    if rtol is not None and not sys.float_info.epsilon <= rtol < 1:
        raise InputError(
            f"rtol: found {rtol!r}; expected at least the rounding of floats, "
            f"{sys.float_info.epsilon:.2g}, and less than 1"
        )


class Engine(ABC):
    """Base class of the adapters of engines.

    Simulations do not share any state, so one object can run many scenes. A subclass must define ``name``,
    ``capabilities``, ``version``, `refusal` and `run`; all other methods have defaults.
    """

    name: str
    """Name of the engine in tables and commands"""
    capabilities: Capabilities
    """What the engine can represent"""

    @property
    @abstractmethod
    def version(self) -> str:
        """Version of the engine itself, not of its adapter."""

    def default_settings(self, fidelity: Fidelity) -> Mapping[str, Any]:
        """Return the default of each setting at this fidelity, by name; empty for an engine without settings."""
        return {}

    def check_arguments(
        self,
        *,
        dt: float | None,
        rtol: float | None,
        fidelity: Fidelity,
        settings: Mapping[str, Any],
    ) -> None:
        """Reject arguments that the engine does not have.

        The default accepts `rtol` for adaptive engines and `dt` for all others, and the settings in `default_settings`.
        Engines with several methods that take different arguments override it.

        Parameters
        ----------
        dt
            Step as passed to `simulate`, s; None if not given.
        rtol
            Relative tolerance as passed to `simulate`; None if not given.
        fidelity
            ``"joint"`` or ``"contact"``.
        settings
            Settings as passed to `simulate`.

        Raises
        ------
        InputError
            If an argument is not accepted.
        """
        if rtol is not None and not self.capabilities.adaptive:
            raise InputError(f"rtol: found {rtol!r}; {self.name} has a fixed step, expected dt")
        if dt is not None and self.capabilities.adaptive:
            raise InputError(f"dt: found {dt!r}; {self.name} has a tolerance, expected rtol")
        check_settings(settings, self.default_settings(fidelity), self.name, fidelity)

    def settings_of_run(
        self, given: Mapping[str, Any], *, fidelity: Fidelity, dt: float | None, rtol: float | None
    ) -> dict[str, Any]:
        """Return the settings that are passed to `run`: those given, and the defaults of all others.

        Engines with several methods that have different settings or defaults override it.
        """
        return {**self.default_settings(fidelity), **given}

    def friction_supplier(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> Supplier:
        """Return who supplies the law of friction that depends on normal forces, in a run with these settings.

        The default is that of `Capabilities.friction_by`. Engines with several methods that differ in it override it.
        """
        return self.capabilities.friction_by.get(fidelity, Supplier.ENGINE)

    def constant_bound_supplier(
        self, scene: Scene, fidelity: Fidelity, settings: Mapping[str, Any]
    ) -> Supplier | None:
        """Return who supplies the friction law of a scene in which all bounds of friction are constants.

        It is None for other scenes, whose supplier is `friction_supplier`. The default is that of
        `Capabilities.constant_bound_by`; if this is the engine and a bound is larger at rest, both, as the adapter
        then switches between the bounds.
        """
        if not has_constant_bounds(scene):
            return None
        supplier = self.capabilities.constant_bound_by.get(fidelity)
        if supplier == Supplier.ENGINE and has_static_bounds(scene):
            return Supplier.BOTH
        return supplier

    def locates_events(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        """Return True if runs with these settings report an event at each change of a guide's mode.

        A run that lacks one of these events is then rejected with `BadTrajectory`.
        """
        return False

    def keeps_cone(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        """Return True if friction stays within Coulomb's cone of the reported normal forces.

        A run whose friction leaves the cone is then rejected with `BadTrajectory`. It is False for regularized friction
        laws, and at contact fidelity, where a box may press on both surfaces at once and the motion does not determine
        the two normal forces.
        """
        return fidelity == Fidelity.JOINT

    def steps_by_impulses(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        """Return True for time-stepping schemes, whose steps are formulated in impulses and velocities.

        These schemes have solutions with jumps of velocity where no solution with finite forces exists (Moreau; Stewart
        2000, SIAM Review 42, 3-39).
        """
        return False

    def content(self) -> bytes:
        """Return what the results depend on besides name and version: the source code of the adapter's module."""
        return Path(inspect.getfile(type(self))).read_bytes()

    def prepare(self) -> None:  # noqa: B027 - most have nothing to do
        """Compile code that is cached on disk. Called before runs with a time limit; by default it does nothing."""

    def prepare_run(self, scene: Scene, **arguments: Any) -> None:  # noqa: B027 - most have nothing to do
        """Compile code that a run of this scene needs and that is not cached yet; by default it does nothing.

        Parameters
        ----------
        scene
            The scene.
        **arguments
            Arguments of `simulate`.
        """

    @abstractmethod
    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        """Return the reason why the engine cannot represent the scene at this fidelity, or None if it can.

        It should take much less time than a run.
        """

    def reason_to_refuse(self, scene: Scene, fidelity: Fidelity) -> str | None:
        """Return the reason why a scene is not run at this fidelity, or None if it is.

        It is an effect of an element that `Capabilities.joint_effects` lacks, or else the engine's own `refusal`.
        Clearance and restitution are no reason at joint fidelity, which neglects them (the setting `NEGLECTED` of the
        run).
        """
        supported = self.capabilities.joint_effects.get(fidelity, frozenset())
        if fidelity == Fidelity.JOINT:
            supported = supported | EFFECTS_OF_GAPS
        unsupported = first_unsupported(scene, supported)
        if unsupported is not None:
            name, effect = unsupported
            sections = ("joints", "drives", "springs", "forces")
            [section] = [section for section in sections if name in getattr(scene, section)]
            return f"{section}.{name}: {self.name} does not yet take {effect}"
        return self.refusal(scene, fidelity)

    @abstractmethod
    def run(
        self,
        scene: Scene,
        *,
        t_end: float,
        dt: float | None,
        rtol: float | None,
        fidelity: Fidelity,
        output_step: float,
        settings: Mapping[str, Any],
    ) -> Trajectory:
        """Simulate a scene that was not refused; called by `simulate`, which checks arguments and result.

        The trajectory must have the columns of `stiction.engines.gate.required_columns`. If `run` of a subclass has a
        further parameter `assembly`, `simulate` passes the `stiction.engines.assembly.Assembly` of this run, which
        contains the mechanism of the scene; its default must be None.

        Parameters
        ----------
        scene
            The scene.
        t_end
            End of the run, s.
        dt
            Step of a fixed-step method, s; None for the engine's default.
        rtol
            Relative tolerance of an adaptive method; None for the engine's default.
        fidelity
            ``"joint"`` or ``"contact"``.
        output_step
            Largest distance between output times, s.
        settings
            All settings, as returned by `settings_of_run`.
        """

    def simulate(
        self,
        scene: Scene,
        *,
        t_end: float | None = None,
        dt: float | None = None,
        rtol: float | None = None,
        fidelity: str = Fidelity.JOINT,
        output_step: float = 0.01,
        **settings: Any,
    ) -> Trajectory:
        """Simulate a scene from t = 0.

        Parameters
        ----------
        scene
            The scene.
        t_end
            End of the run, s; that of the scene if None.
        dt
            Step of a fixed-step method, s; the engine's default if None.
        rtol
            Relative tolerance of an adaptive method; the engine's default if None.
        fidelity
            A `stiction.scenes.Fidelity`, or its value: ``"joint"`` or ``"contact"``.
        output_step
            Largest distance between output times, s. A fixed-step engine uses a multiple of `dt`; the end is always an
            output time.
        **settings
            Settings of the engine, see `default_settings`.

        Returns
        -------
        Trajectory
            Its cost is that reported by the engine or, failing that, the CPU time of the whole run.

        Raises
        ------
        InputError
            If an argument cannot be used: not positive, a step longer than the run, an unknown setting.
        Refused
            If the engine cannot represent the scene; nothing has been run then.
        EngineFailure
            If the engine gave up.
        BadTrajectory
            If the result is not a trajectory of this run; see `stiction.engines.gate.first_problem`.
        """
        t_end = scene.t_end if t_end is None else t_end
        _check_times(t_end, dt, rtol, output_step)
        fidelity = fidelity_of(fidelity)
        self._refuse_fidelity(fidelity)
        self.check_arguments(dt=dt, rtol=rtol, fidelity=fidelity, settings=settings)
        reason = self.reason_to_refuse(scene, fidelity)
        if reason is not None:
            raise Refused(reason)

        # The end is always an output instant.
        output_step = min(output_step, t_end)
        assembly = Assembly(scene)
        further_arguments = {"assembly": assembly} if _takes_assembly(type(self)) else {}
        begin = time.process_time()
        trajectory = self.run(
            scene,
            t_end=t_end,
            dt=dt,
            rtol=rtol,
            fidelity=fidelity,
            output_step=output_step,
            settings=self.settings_of_run(settings, fidelity=fidelity, dt=dt, rtol=rtol),
            **further_arguments,
        )
        run_s = time.process_time() - begin

        # The result of an engine is validated before it is used.
        self._examine(
            Examined(
                trajectory=trajectory,
                scene=scene,
                t_end=t_end,
                dt=dt,
                output_step=output_step,
                fidelity=fidelity,
                locates=partial(self.locates_events, fidelity),
                keeps=partial(self.keeps_cone, fidelity),
                assembly=assembly,
            )
        )
        gate_s = time.process_time() - begin - run_s

        # Complete the fields that do not depend on the engine's report.
        completion: dict[str, Any] = self._suppliers(scene, fidelity, trajectory.settings)
        neglected = neglected_keys(scene) if fidelity == Fidelity.JOINT else []
        if neglected:
            completion[NEGLECTED] = neglected
        return replace(
            trajectory,
            fidelity=fidelity,
            mechanism=scene,
            settings={**trajectory.settings, **completion},
            cost=_complete_cost(trajectory.cost, run_s, gate_s),
        )

    def _refuse_fidelity(self, fidelity: Fidelity) -> None:
        """Raise Refused if the engine does not support a fidelity."""
        available = self.capabilities.fidelities
        if fidelity not in available:
            first = available[0]
            raise Refused(
                f"{self.name} has no {fidelity} fidelity; expected {' or '.join(available)}: add --fidelity "
                f'{first} to the command, fidelity="{first}" in Python'
            )

    def _examine(self, examined: Examined) -> None:
        """Raise BadTrajectory if the result of a run is not a trajectory of this run, or not a motion of the scene."""
        problem = first_problem(examined)
        if problem is not None:
            raise BadTrajectory(f"{self.name} returned {problem}")

    def _suppliers(
        self, scene: Scene, fidelity: Fidelity, settings: Mapping[str, Any]
    ) -> dict[str, str]:
        """Return the settings that tell who supplies the friction law of a run, and who locates its events.

        `settings` are those of the trajectory.
        """
        friction_supplier = Supplier.NOBODY
        if scene.frictional_joints:
            friction_supplier = self.constant_bound_supplier(
                scene, fidelity, settings
            ) or self.friction_supplier(fidelity, settings)
        event_supplier = Supplier.NOBODY
        if self.locates_events(fidelity, settings):
            event_supplier = self.capabilities.event_location
        return {
            FRICTION_SUPPLIED_BY: str(friction_supplier),
            EVENTS_LOCATED_BY: str(event_supplier),
        }
