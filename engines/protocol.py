"""The protocol of engines: a name, capabilities, and `simulate(scene, ...) -> Trajectory`."""

from __future__ import annotations

import inspect
import math
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache, partial
from importlib.metadata import requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.engines.assembly import Assembly
from stiction.engines.examined import Examined
from stiction.engines.gate import problems
from stiction.scenes import Cost, InputError, Scene, StictionError, Trajectory
from stiction.scenes.fidelity import Fidelity, fidelity_of

if TYPE_CHECKING:
    from packaging.specifiers import SpecifierSet


class Supplier(StrEnum):
    """Who does a part of the work of a run."""

    ENGINE = "engine"
    ADAPTER = "adapter"
    """Our adapter of the engine. Of the friction law: the engine has no Coulomb law, and holds or drives with the
    forces that the adapter's law allows."""
    BOTH = "engine + adapter"
    """The engine's own, with numbers that the adapter sets anew on the way, such as a coefficient of friction."""
    NOBODY = "nobody"


FRICTION_SUPPLIED_BY = "friction_supplied_by"
"""Setting of every trajectory: the `Supplier` of its friction law; nobody where the scene has no friction."""
EVENTS_LOCATED_BY = "events_located_by"
"""Setting of every trajectory: the `Supplier` of its located events."""
UNSETTLED = "friction does not settle"
"""Kind of the `stiction.scenes.Breakdown` of an engine that stops where friction and reactions have no solution that it
finds."""
MOST_OUTPUTS = 10_000_000
"""Instants of a trajectory: 35 columns of the slider-bar are 2.8 GB then."""

MOST_STEPS = 1_000_000_000
"""Steps of a fixed-step run: at the 2 to 200 microseconds that engines take for one, this is half an hour to days."""

installed_version = cache(version)
"""Version of an installed distribution; reading it takes longer than a short simulation."""


@cache
def required(package: str) -> SpecifierSet:
    """Versions of an engine's package that the suite takes, by its own metadata; any, where that lacks the engine."""
    # imported here: most commands ask for no bound, and it takes a twentieth of what `stiction.engines` does
    from packaging.requirements import Requirement
    from packaging.specifiers import SpecifierSet

    return {one.name: one.specifier for one in map(Requirement, requires("stiction") or ())}.get(
        package, SpecifierSet()
    )


def accepted(package: str, found: str) -> str:
    """Return the version found of an engine's package; ImportError if the suite takes others only."""
    if not required(package).contains(found, prereleases=True):
        raise ImportError(f"found {package} {found}; expected {required(package)}", name=package)
    return found


def check_steps(t_end: float, dt: float) -> None:
    """Raise InputError for a run of more than `MOST_STEPS` steps."""
    if t_end / dt > MOST_STEPS:
        raise InputError(
            f"dt: found {dt:g} s, which is {t_end / dt:.3g} steps to t_end = {t_end:g} s; expected at "
            f"most {MOST_STEPS:.0e} steps, which take hours: dt >= {t_end / MOST_STEPS:.3g} s, or an "
            "earlier t_end"
        )


class Refused(StictionError):
    """The engine cannot represent this scene, or not in this way; the message says why."""


class Declined(Refused):
    """The adapter does not run a scene that it can express; the message says why. The engine was not asked."""


class EngineFailure(StictionError):
    """The engine gave up; the message is the engine's own."""


class Unsettled(EngineFailure):
    """Friction and reactions do not settle at an instant.

    They have no solution there, or several, or this engine's way does not find it.

    Attributes
    ----------
    time : float
        Seconds.
    """

    def __init__(self, message: str, time: float):
        super().__init__(message)
        self.time = time


class BadTrajectory(EngineFailure):
    """The result of the engine is no motion of this mechanism, or no trajectory of the run."""


@dataclass(frozen=True)
class Capabilities:
    """Capabilities of an engine.

    Attributes
    ----------
    fidelities : tuple of Fidelity
        Their values may be given: ``"joint"`` (bilateral joints, friction bound from their reactions), ``"contact"`` (a
        box between two surfaces, the engine's own contacts and friction).
    static_coefficient : Mapping[str, bool]
        By fidelity: whether mus > mu can be represented (by the engine or its adapter).
    friction_law : Mapping[str, str]
        By fidelity: the friction law, in words.
    reactions : str
        Where multipliers come from: ``"engine"`` or ``"momentum balance"``.
    order : str
        The order of convergence that the method promises across events.
    adaptive : bool
        Whether a run is given a tolerance, ``rtol``, instead of a step, ``dt``; the other one is refused
        (`Engine.check_arguments`).
    event_location : Supplier
        Who locates events in runs that have them located: the engine or the adapter.
    friction_by : Mapping[str, Supplier]
        By fidelity: who supplies the friction law; the engine where nothing is given. Only runs with the
        same supplier are ranked together.

    Raises
    ------
    TypeError, ValueError
        For values of other types, or a fidelity that there is not.
    """

    fidelities: tuple[Fidelity, ...]
    static_coefficient: Mapping[str, bool]
    friction_law: Mapping[str, str] = field(repr=False)
    reactions: str
    order: str = field(repr=False)
    adaptive: bool = False
    event_location: Supplier = Supplier.ENGINE
    friction_by: Mapping[str, Supplier] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (
            isinstance(self.fidelities, tuple)
            and self.fidelities
            and all(fidelity in tuple(Fidelity) for fidelity in self.fidelities)
        ):
            raise ValueError(
                f"fidelities: found {self.fidelities!r}; expected a tuple of "
                f"{' or '.join(repr(str(one)) for one in Fidelity)}"
            )
        object.__setattr__(self, "fidelities", tuple(map(Fidelity, self.fidelities)))
        for name in ("static_coefficient", "friction_law", "friction_by"):
            if not isinstance(found := getattr(self, name), Mapping):
                raise TypeError(f"{name}: found {found!r}; expected a mapping by fidelity")
        if self.event_location not in (Supplier.ENGINE, Supplier.ADAPTER):
            raise ValueError(
                f"event_location: found {self.event_location!r}; expected 'engine' or 'adapter'"
            )
        for fidelity, supplier in self.friction_by.items():
            if fidelity not in self.fidelities or supplier not in tuple(Supplier):
                raise ValueError(
                    f"friction_by: found {str(fidelity)!r}: {supplier!r}; expected one of "
                    f"{', '.join(repr(str(one)) for one in self.fidelities)} and one of "
                    f"{', '.join(repr(str(one)) for one in Supplier)}"
                )


def check_settings(
    given: Iterable[str], known: Iterable[str], engine: str, fidelity: Fidelity
) -> None:
    """Raise InputError for names that are not among those of the engine's settings."""
    known = list(known)
    for name in given:
        if name not in known:
            raise InputError(
                f"{name}: {engine} has no such setting at {fidelity} fidelity; expected "
                f"{'one of ' + ', '.join(known) if known else 'none: it has no settings'}"
            )


@cache
def _takes_assembly(engine: type[Engine]) -> bool:
    """Return True where `run` of a class names a parameter `assembly`."""
    return "assembly" in inspect.signature(engine.run).parameters


OBLIGATORY = ("name", "capabilities", "version", "refusal", "run")
"""Attributes and methods that a class derived from `Engine` must define."""


class Engine(ABC):
    """Base of the adapters. Simulations share nothing: one engine object can run many scenes.

    A class defines all of `OBLIGATORY`; all else has a default.
    """

    name: str
    capabilities: Capabilities

    @property
    @abstractmethod
    def version(self) -> str:
        """Version of the engine itself."""

    def default_settings(self, fidelity: Fidelity) -> Mapping[str, Any]:
        """Default of each setting at this fidelity, by name; empty for an engine without settings."""
        return {}

    def check_arguments(
        self,
        *,
        dt: float | None,
        rtol: float | None,
        fidelity: Fidelity,
        settings: Mapping[str, Any],
    ) -> None:
        """Refuse a step or a tolerance that the engine does not have, and settings not in `default_settings`.

        An engine whose methods differ in them overrides it.

        Raises
        ------
        InputError
        """
        if rtol is not None and not self.capabilities.adaptive:
            raise InputError(f"rtol: found {rtol!r}; {self.name} has a fixed step, expected dt")
        if dt is not None and self.capabilities.adaptive:
            raise InputError(f"dt: found {dt!r}; {self.name} has a tolerance, expected rtol")
        check_settings(settings, self.default_settings(fidelity), self.name, fidelity)

    def settings_of_run(
        self, given: Mapping[str, Any], *, fidelity: Fidelity, dt: float | None, rtol: float | None
    ) -> dict[str, Any]:
        """Return the settings that `run` gets: those given, and the defaults of all others.

        An engine whose methods have other settings, or other defaults, overrides it.
        """
        return {**self.default_settings(fidelity), **given}

    def friction_supplier(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> Supplier:
        """Return who supplies the friction law of a run with these settings.

        An engine whose methods differ in it overrides it.
        """
        return self.capabilities.friction_by.get(fidelity, Supplier.ENGINE)

    def locates_events(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        """Return True where runs with these settings of a trajectory report an event at each change of a guide's mode.

        A run that does not, where this is true, is a `BadTrajectory`.
        """
        return False

    def keeps_cone(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        """Return True where friction stays in Coulomb's cone by the forces of the columns.

        A run that leaves it, where this is true, is a `BadTrajectory`. False for regularized laws, and at contact
        fidelity: a box may press on both surfaces at once, and a motion does not determine by how much.
        """
        return fidelity == Fidelity.JOINT

    def steps_by_impulses(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        """Return True where steps exchange impulses between velocities.

        The theory of such schemes has motions where finite forces have none, with jumps of velocity (Moreau; Stewart
        2000, SIAM Review 42, 3-39).
        """
        return False

    def content(self) -> bytes:
        """Return what numbers depend on besides name and version: the code of the adapter's module."""
        return Path(inspect.getfile(type(self))).read_bytes()

    def prepare(self) -> None:  # noqa: B027 - most have nothing to do
        """Compile what the engine keeps on disk; called before any run has a time limit. Nothing to do for most."""

    def prepare_run(self, scene: Scene, **arguments: Any) -> None:  # noqa: B027 - most have nothing to do
        """Compile what the run of a scene calls for and is not on disk yet; arguments as of `simulate`.

        Nothing to do for most.
        """

    @abstractmethod
    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        """Why this engine cannot represent the scene at this fidelity; None if it can. Cheap."""

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
        """Simulate a scene that was not refused.

        The settings are all of `settings_of_run`, defaults among them. The columns that the
        trajectory must have: `gate.required_columns`. An engine whose `run` has a parameter `assembly` besides gets the
        `stiction.engines.assembly.Assembly` of this run, with the scene's mechanism; None where `run` is called by
        itself.
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
        """Simulate from t = 0. A cost that the engine does not state is the CPU time of the whole run.

        Parameters
        ----------
        t_end
            Seconds; the scene's own where None.
        dt, rtol
            Step of a fixed-step method (s), relative tolerance of an adaptive one; the engine's default where None.
        fidelity
            A `stiction.scenes.Fidelity`, or its value: ``"joint"`` or ``"contact"``.
        output_step
            Distance of output instants in seconds, at most; a fixed-step engine uses a multiple of dt, and the end is
            always one.
        **settings
            The engine's own; those it does not have are an error (`check_arguments`).

        Raises
        ------
        InputError
            For arguments that no run can have: not positive, a step longer than the run, an unknown setting.
        Refused
            Before anything is run, if the engine cannot represent the scene.
        EngineFailure
            If the engine gave up.
        BadTrajectory
            If the result is not a trajectory of this run; see `gate.problems`.
        """
        t_end = scene.t_end if t_end is None else t_end
        for name, value in (("t_end", t_end), ("dt", dt), ("output_step", output_step)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"{name}: found {value!r}; expected seconds, > 0")
        if t_end / output_step > MOST_OUTPUTS:
            raise InputError(
                f"t_end, output_step: found {t_end:g} s and {output_step:g} s, {t_end / output_step:.3g} "
                f"instants; expected at most {MOST_OUTPUTS:g}"
            )
        if dt is not None and dt > t_end:
            raise InputError(f"dt: found {dt!r}; expected at most t_end = {t_end:g} s")
        if dt is not None:
            check_steps(t_end, dt)
        if rtol is not None and not sys.float_info.epsilon <= rtol < 1:
            raise InputError(
                f"rtol: found {rtol!r}; expected at least the rounding of floats, "
                f"{sys.float_info.epsilon:.2g}, and less than 1"
            )
        fidelity = fidelity_of(fidelity)
        if fidelity not in self.capabilities.fidelities:
            first, *_ = known = self.capabilities.fidelities
            raise Refused(
                f"{self.name} has no {fidelity} fidelity; expected {' or '.join(known)}: add --fidelity "
                f'{first} to the command, fidelity="{first}" in Python'
            )
        self.check_arguments(dt=dt, rtol=rtol, fidelity=fidelity, settings=settings)
        reason = self.refusal(scene, fidelity)
        if reason is not None:
            raise Refused(reason)
        output_step = min(output_step, t_end)  # the end is an output instant whatever was asked for
        started = time.process_time()
        complete = self.settings_of_run(settings, fidelity=fidelity, dt=dt, rtol=rtol)
        assembly = Assembly(scene)
        found = self.run(
            scene,
            t_end=t_end,
            dt=dt,
            rtol=rtol,
            fidelity=fidelity,
            output_step=output_step,
            settings=complete,
            **({"assembly": assembly} if _takes_assembly(type(self)) else {}),
        )
        spent = time.process_time() - started
        examined = Examined(
            found,
            scene,
            t_end,
            dt,
            output_step,
            fidelity,
            partial(self.locates_events, fidelity),
            partial(self.keeps_cone, fidelity),
            assembly,
        )
        for problem in problems(examined):
            raise BadTrajectory(f"{self.name} returned {problem}")
        locates = self.locates_events(fidelity, found.settings)
        suppliers = {
            FRICTION_SUPPLIED_BY: self.friction_supplier(fidelity, found.settings)
            if scene.frictional_guides
            else Supplier.NOBODY,
            EVENTS_LOCATED_BY: self.capabilities.event_location if locates else Supplier.NOBODY,
        }
        return replace(
            found,
            fidelity=fidelity,
            mechanism=scene,
            settings={**found.settings, **{name: str(one) for name, one in suppliers.items()}},
            cost=found.cost if found.cost != Cost() else Cost(stepping_s=spent),
        )
