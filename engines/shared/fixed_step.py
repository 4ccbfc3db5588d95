"""Common parts of engines of fixed step: settings, the loop over steps, output, cost."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from time import process_time
from typing import Any, ClassVar, NamedTuple

import numpy as np

from stiction.engines.assembly import Assembly, assembly_of
from stiction.engines.joint_effects import EFFECTS_WITH_LOADS, LAWS, JointEffect
from stiction.engines.protocol import (
    BadTrajectory,
    Capabilities,
    Engine,
    EngineFailure,
    Supplier,
    check_settings,
    check_steps,
)
from stiction.engines.shared.engine_clock import EngineClock
from stiction.engines.shared.friction_bound import (
    CAPPED,
    CONSTANT,
    CONSTANT_SWITCHED,
    CONTACT,
    FrictionBound,
)
from stiction.engines.shared.inconsistent_start import refuse_off
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.reactions import recover_columns
from stiction.reference_impl.multibody.trajectory_columns import slip_velocity
from stiction.scenes import Cost, InputError, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity

DEFAULT_STEP = 1e-3
"""Step in seconds where none is given."""
DEFAULT_SHARE = 0.01
"""Largest part of the run that a default step may be, so that short runs have some steps too."""


class Sample(NamedTuple):
    """A state and the acceleration of the step that belongs to it, each of shape (3 * bodies,).

    Per frictional joint, shape (frictional,): `modes` -1, 0, 1 (slip against, stick, slip along), and `friction`, the
    force that the engine exerted on the slider along the guide (N), or the torque on the first body of a pin (N m), NaN
    where that is not known.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    modes: np.ndarray
    friction: np.ndarray


class Stepper(ABC):
    """A scene inside an engine, advanced by one fixed step at a time; `step` is a step from top to bottom.

    Attributes
    ----------
    h : float
        The step, s.
    k : int
        Number of steps taken.
    bound : FrictionBound
        The bounds of friction for the coming pass.
    finish : callable
        Evaluates a pass, given the time (s) that the next step is for. Returns False if the step is accepted, and has
        then begun the next one; True if it is to be repeated with other bounds. Compiled, and set by `begin`.
    clock : EngineClock
        Its calls are passes: steps of the engine, repeated ones included.
    balanced : bool
        True if the balance of momentum is solved in each pass, for the friction bound.
    ahead : int
        Number of steps taken before the sample at t = 0.
    settling : int
        Number of samples at the start that get the acceleration and the friction of the sample after them. Engines that
        hold constraints by velocities change the consistent velocities of the start into ones that lead the next
        position back onto the constraints. The accelerations of these steps are off by O(1), and not the motion's.
    """

    ahead: ClassVar[int] = 0
    settling = 0
    balanced = False
    bound: FrictionBound
    finish: Callable[[float], bool]

    def __init__(self, h: float) -> None:
        self.clock, self.h, self.k = EngineClock(), h, 0

    @abstractmethod
    def compile(self) -> None:
        """Compile, or load, what the steps will call, and begin the first one."""

    @abstractmethod
    def aim(self) -> None:
        """Set the motors of drives so that the coming step ends on the drives' laws."""

    @abstractmethod
    def advance(self, caps: Sequence[float]) -> None:
        """Make a pass: the engine steps with these bounds of friction (N, N m) under the loads; its state is read."""

    @abstractmethod
    def retreat(self) -> None:
        """Return the engine to the beginning of the step."""

    @abstractmethod
    def sample(self) -> Sample:
        """Return the present sample, with arrays that later steps do not change."""

    def step(self) -> None:
        """Take the next step.

        Passes are repeated until the bounds of friction and the reactions agree; see `FrictionBound`.
        """
        self.aim()
        caps = self.bound.caps
        k = self.k = self.k + 1
        # the time that the loads of the step after this one are due at: its end, or with `ahead` its start
        t = (k + 1 - self.ahead) * self.h
        self.advance(caps())
        while self.finish(t):
            self.retreat()
            self.advance(caps())


def march(stepper: Stepper, grid: Grid, samples: list[Sample]) -> None:
    """Take the steps of a run, and append the samples at t = 0, every h, 2 every h, .. to a list.

    Raises
    ------
    FloatingPointError
        For a state that is not finite; the list then contains the samples before it.
    """
    step, settling, last, every = stepper.step, stepper.settling, grid.last, grid.every
    # A stepper that is ahead of its samples knows the acceleration at t = 0 from a first step.
    for _ in range(stepper.ahead):
        step()
    # A run that is shorter than settling goes on until the engine has settled, without samples.
    for k in range(max(last, settling) + 1):
        if k:
            step()
        if k == settling and samples:
            # the accelerations of the first steps were those of settling, not of the motion
            settled = stepper.sample()
            samples[:] = [
                early._replace(a=settled.a, friction=settled.friction) for early in samples
            ]
        if not k % every and k <= last:
            sample = stepper.sample()
            # a sum is finite only if all of its terms are, and costs less than to ask each
            if not math.isfinite(sample.q.sum() + sample.v.sum() + sample.a.sum()):
                raise FloatingPointError("a state is not finite")
            samples.append(sample)


def step_of(dt: float | None, t_end: float) -> float:
    """Return the step in seconds, or the default if none is given; raise InputError if it is too short for the run."""
    if dt is None:
        dt = min(DEFAULT_STEP, DEFAULT_SHARE * t_end)
    check_steps(t_end, dt)
    return dt


def steps_between_outputs(steps: int, wanted: float) -> int:
    """Return the steps from one output to the next: the largest divisor of `steps` that is not above the wanted number.

    A divisor, so that the end of the run is an output.
    """
    most = min(steps, max(1, round(wanted)))
    return next(every for every in range(most, 0, -1) if steps % every == 0)


Defaults = Mapping[str, int | float | tuple[str, ...]]
"""Default of each setting; for a setting that is a word, all allowed words, the default first."""


def settings_of(
    given: Mapping[str, Any], defaults: Defaults, engine: str, fidelity: Fidelity
) -> dict[str, Any]:
    """Return all settings of the engine: those given, and the defaults of the others.

    A number has the type of its default, and is finite and not negative. A whole number is at least 1, unless its
    default is 0.

    Raises
    ------
    InputError
        For an unknown name, a wrong type or a value that is not allowed.
    """
    check_settings(given, defaults, engine, fidelity)
    for name, value in given.items():
        if isinstance(default := defaults[name], tuple):
            if value not in default:
                raise InputError(f"{name}: found {value!r}; expected one of {', '.join(default)}")
            continue
        # A number: True is an int in Python, but not a number here.
        whole = isinstance(default, int)
        least = min(1, default) if whole else 0
        if (
            isinstance(value, bool)
            or not isinstance(value, int if whole else (int, float))
            or not math.isfinite(value)
            or value < least
        ):
            kind = "whole number" if whole else "number"
            raise InputError(f"{name}: found {value!r}; expected a {kind} >= {least}")
    settings = {
        name: default[0] if isinstance(default, tuple) else default
        for name, default in defaults.items()
    }
    return {**settings, **given}


@dataclass(frozen=True)
class Grid:
    """Instants of a run: `last` steps of `dt` seconds, each `every`-th of them an output."""

    dt: float
    last: int
    every: int

    @staticmethod
    def of(t_end: float, dt: float, output_step: float) -> Grid:
        """Return the grid up to the multiple of dt nearest to `t_end`, with outputs `output_step` apart at most, s."""
        last = max(1, round(t_end / dt))
        return Grid(dt, last, steps_between_outputs(last, output_step / dt))


class SteppedEngine(Engine):
    """An engine that makes steps of fixed size and leaves the bound of friction, or its coefficient, to the adapter.

    Springs, dampers, forces and torques are evaluated by the adapter and applied to the bodies. At contact fidelity
    normal forces and friction are the engine's contacts; before each step a guide gets mus if its slider stuck or is
    about to reverse, mu otherwise (`stiction.engines.shared.friction_bound`).

    Attributes
    ----------
    defaults : Mapping
        By fidelity: settings of its steps, as `settings_of` takes them.
    reach : Mapping
        By fidelity: largest displacement (m) that its guides allow.
    """

    capabilities = Capabilities(
        fidelities=tuple(Fidelity),
        static_coefficient={Fidelity.JOINT: True, Fidelity.CONTACT: True},
        friction_law={Fidelity.JOINT: CAPPED, Fidelity.CONTACT: CONTACT},
        reactions="momentum balance",
        order="1",
        friction_by={Fidelity.JOINT: Supplier.ADAPTER, Fidelity.CONTACT: Supplier.BOTH},
        constant_bound_by={Fidelity.JOINT: Supplier.ENGINE},
        joint_effects={
            Fidelity.JOINT: EFFECTS_WITH_LOADS,
            Fidelity.CONTACT: LAWS | {JointEffect.CLEARANCE},
        },
    )
    defaults: ClassVar[Mapping[str, Defaults]]
    reach: ClassVar[Mapping[str, float]] = {Fidelity.JOINT: math.inf, Fidelity.CONTACT: math.inf}

    def default_settings(self, fidelity: Fidelity) -> Mapping[str, Any]:
        return settings_of({}, self.defaults[fidelity], self.name, fidelity)

    def steps_by_impulses(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return "method" not in settings  # a method is something else than these steps

    @abstractmethod
    def stepper(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], fidelity: Fidelity
    ) -> AbstractContextManager[Stepper]:
        """Return a context whose value is the stepper of a scene, with steps of h seconds.

        Raises
        ------
        InputError
            For a setting out of its range.
        """

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
        assembly: Assembly | None = None,
    ) -> Trajectory:
        started = process_time()
        grid, samples = Grid.of(t_end, step_of(dt, t_end), output_step), list[Sample]()
        h, last, every = grid.dt, grid.last, grid.every
        options = settings_of(settings, self.defaults[fidelity], self.name, fidelity)
        assembly = assembly_of(scene, assembly)
        refuse_off(assembly)
        with self.stepper(assembly, h, options, fidelity) as stepper:
            # CPU time is reported by three parts of the run: setting up, compiling, and stepping.
            set_up = start = process_time()
            try:
                stepper.compile()
                start = process_time()
                stepper.clock.start()
                march(stepper, grid, samples)
            except FloatingPointError as error:
                reached = max(len(samples) - 1, 0) * every * h
                raise EngineFailure(
                    f"{self.name}: {error}, after t = {reached:g} s with dt = {h:g} s"
                ) from error
            passes = stepper.clock.calls
            cost = Cost(
                set_up - started,
                start - set_up,
                process_time() - start,
                {"steps": last + 1, "passes": passes, "balances": passes * stepper.balanced},
                stepper.clock.engine_s,
            )
        t = np.arange(0, last + 1, every) * h
        q, v, a, modes, friction = (np.array(part) for part in zip(*samples))
        rests = _rest_with_others(assembly.whole, q, v, friction, h)
        columns = columns_of_motion(
            assembly.whole, t, q, v, a, np.where(rests, 0, modes), np.where(rests, np.nan, friction)
        )
        # Beyond the end of a guide the engine has simulated another mechanism. A run that has
        # diverged gets there too, and gets the message about that cause.
        size = assembly.whole.arrays.length_scale
        drift = columns["drift.position"]
        for name in scene.guides:
            if (farthest := np.abs(columns[f"{name}.displacement"]).max()) > self.reach[fidelity]:
                if len(diverged := np.flatnonzero(~(drift <= size))):
                    raise BadTrajectory(
                        f"{self.name}: the run diverged: {drift[diverged[0]]:.3g} m off its "
                        f"constraints at t = {t[diverged[0]]:g} s with dt = {h:g} s; expected less "
                        f"than the size of the mechanism, {size:.3g} m"
                    )
                raise BadTrajectory(
                    f"{self.name}: {name} is {farthest:g} m from its guide's point; guides end at "
                    f"{self.reach[fidelity]:g} m"
                )
        return Trajectory(
            scene=scene.name,
            engine=self.name,
            version=self.version,
            fidelity=fidelity,
            t=t,
            columns=columns,
            cost=cost,
            settings={
                "dt": h,
                **options,
                "friction_law": self._friction_law(scene, fidelity, options),
            },
        )

    def _friction_law(self, scene: Scene, fidelity: Fidelity, options: Mapping[str, Any]) -> str:
        """Return the friction law of the steps of a scene, in words."""
        match self.constant_bound_supplier(scene, fidelity, options):
            case Supplier.ENGINE:
                return CONSTANT
            case Supplier.BOTH:
                return CONSTANT_SWITCHED
        return self.capabilities.friction_law[fidelity]


def columns_of_motion(
    mechanism: Mechanism,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    modes: np.ndarray,
    frictions: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return all columns of a motion, with columns of modes and frictions (N, N m) for each frictional joint.

    A friction that is NaN is recovered from the balance of momentum.
    """
    joint_columns: dict[str, np.ndarray] = {}
    for i, name in enumerate(mechanism.guide_names):
        joint_columns |= {f"{name}.mode": modes[:, i], f"{name}.friction": frictions[:, i]}
    return recover_columns(mechanism.scene, t, q, v, a, joint_columns, mechanism)


def _rest_with_others(
    mechanism: Mechanism, q: np.ndarray, v: np.ndarray, friction: np.ndarray, dt: float
) -> np.ndarray:
    """Return flags, shape (n, frictional), of joints that rest to rounding while another one is held.

    A joint that is held has a friction of NaN. Joints at rest share the load, and an engine may give some of them the
    friction of slip at its bound. Their speeds are rounding, whose sign is no direction of slip, so that the balance of
    momentum has to give their shares too.
    """
    if friction.shape[1] < 2:
        return np.zeros(friction.shape, dtype=bool)
    arrays, scene = mechanism.arrays, mechanism.scene
    joints = list(scene.joints)
    slip = np.stack(
        [slip_velocity(arrays, joints.index(name), q, v) for name in scene.frictional_joints],
        axis=1,
    )
    slip *= mechanism.slip_radius
    # at rest: in a step the slider moves by less than the rounding of its place
    rests = np.abs(slip) * dt <= np.finfo(float).eps * arrays.length_scale
    return rests & np.isnan(friction).any(axis=1, keepdims=True)
