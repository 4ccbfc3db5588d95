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
from stiction.engines.shared.friction_bound import CAPPED, CONTACT, FrictionBound
from stiction.engines.shared.inconsistent_start import refuse_off
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.reactions import recover_columns
from stiction.reference_impl.multibody.trajectory_columns import guide_motion
from stiction.scenes import Cost, InputError, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity

DEFAULT_STEP = 1e-3
"""Step in seconds where none is given."""
DEFAULT_SHARE = 0.01
"""Largest part of the run that a default step may be, so that short runs have some steps too."""


class Sample(NamedTuple):
    """Motion and friction of a scene at one instant.

    Attributes
    ----------
    q, v, a : ndarray, shape (3 * bodies,)
        Coordinates and velocities of the bodies, and the accelerations of the step that belongs to them.
    modes : ndarray, shape (frictional,)
        By frictional guide: -1, 0 or 1 for slip against the guide's direction, stick, and slip along it.
    friction : ndarray, shape (frictional,)
        By frictional guide: force of the engine on the slider along the guide, N; NaN where it is unknown.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    modes: np.ndarray
    friction: np.ndarray


class Stepper(ABC):
    """A scene inside an engine, which is advanced by one fixed step at a time.

    `step` calls the abstract methods in their order. A pass is a step of the engine that may have to be repeated with
    other bounds of friction.

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
        Clock whose calls are the passes.
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
        self.clock = EngineClock()
        self.h = h
        self.k = 0

    @abstractmethod
    def compile(self) -> None:
        """Compile, or load, what the steps will call, and begin the first one."""

    @abstractmethod
    def aim(self) -> None:
        """Set the motors of drives so that the coming step ends on the drives' laws."""

    @abstractmethod
    def advance(self, caps: Sequence[float]) -> None:
        """Make a pass: the engine steps with these bounds of friction (N) under the loads, and its state is read."""

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
        self.k += 1
        # The loads of the step after this one are evaluated at its end, or with `ahead` at its start.
        t = (self.k + 1 - self.ahead) * self.h
        self.advance(caps())
        while self.finish(t):
            self.retreat()
            self.advance(caps())


def march(stepper: Stepper, grid: Grid, samples: list[Sample]) -> None:
    """Take the steps of a run, and append a sample to a list at t = 0 and after each `grid.every` steps.

    Raises
    ------
    FloatingPointError
        For a state that is not finite; the list then contains the samples before it.
    """
    # A stepper that is ahead of its samples knows the acceleration at t = 0 from a first step.
    for _ in range(stepper.ahead):
        stepper.step()
    # A run that is shorter than settling goes on until the engine has settled, without samples.
    for k in range(max(grid.last, stepper.settling) + 1):
        if k > 0:
            stepper.step()
        if k == stepper.settling and samples:
            # Replace the accelerations and frictions that belong to settling and not to the motion.
            settled = stepper.sample()
            samples[:] = [
                early._replace(a=settled.a, friction=settled.friction) for early in samples
            ]
        if k % grid.every == 0 and k <= grid.last:
            sample = stepper.sample()
            # A sum is finite only if all of its terms are, and costs less than a test of each.
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
    """Return the largest divisor of `steps`, the number of steps of a run, that is at most the wanted number.

    It is the number of steps from one output to the next. A divisor makes the end of the run an output.
    """
    every = min(steps, max(1, round(wanted)))
    while steps % every:
        every -= 1
    return every


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
    settings: dict[str, Any] = {}
    for name, default in defaults.items():
        if isinstance(default, tuple):
            value = given.get(name, default[0])
            _check_word(name, value, default)
        else:
            value = given.get(name, default)
            _check_number(name, value, default)
        settings[name] = value
    return settings


def _check_word(name: str, value: Any, words: tuple[str, ...]) -> None:
    """Raise InputError if the value of a setting is none of the allowed words."""
    if value not in words:
        raise InputError(f"{name}: found {value!r}; expected one of {', '.join(words)}")


def _check_number(name: str, value: Any, default: int | float) -> None:
    """Raise InputError if the value of a setting is not a number like its default, see `settings_of`."""
    is_whole = isinstance(default, int)
    least = min(1, default) if is_whole else 0
    kinds = int if is_whole else (int, float)
    # True is an int in Python, but not a number here.
    is_number = isinstance(value, kinds) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or value < least:
        kind = "whole number" if is_whole else "number"
        raise InputError(f"{name}: found {value!r}; expected a {kind} >= {least}")


@dataclass(frozen=True)
class Grid:
    """Instants of a run of fixed step.

    Attributes
    ----------
    dt : float
        The step, s.
    last : int
        Number of steps.
    every : int
        Number of steps from one output to the next.
    """

    dt: float
    last: int
    every: int

    @property
    def output_times(self) -> np.ndarray:
        """Times of the outputs, s."""
        return np.arange(0, self.last + 1, self.every) * self.dt

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
        By fidelity: settings of the steps, as `settings_of` takes them.
    reach : Mapping
        By fidelity: largest displacement (m) that the guides of the engine allow.
    """

    capabilities = Capabilities(
        fidelities=tuple(Fidelity),
        static_coefficient={Fidelity.JOINT: True, Fidelity.CONTACT: True},
        friction_law={Fidelity.JOINT: CAPPED, Fidelity.CONTACT: CONTACT},
        reactions="momentum balance",
        order="1",
        friction_by={Fidelity.JOINT: Supplier.ADAPTER, Fidelity.CONTACT: Supplier.BOTH},
    )
    defaults: ClassVar[Mapping[str, Defaults]]
    reach: ClassVar[Mapping[str, float]] = {Fidelity.JOINT: math.inf, Fidelity.CONTACT: math.inf}

    def default_settings(self, fidelity: Fidelity) -> Mapping[str, Any]:
        return settings_of({}, self.defaults[fidelity], self.name, fidelity)

    def steps_by_impulses(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        # The setting "method" of some engines selects an integrator instead of these steps.
        return "method" not in settings

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
        begin = process_time()
        grid = Grid.of(t_end, step_of(dt, t_end), output_step)
        options = settings_of(settings, self.defaults[fidelity], self.name, fidelity)
        assembly = assembly_of(scene, assembly)
        refuse_off(assembly)
        with self.stepper(assembly, grid.dt, options, fidelity) as stepper:
            samples, cost = self._take_steps(stepper, grid, begin)
        columns = _columns_of_samples(assembly.whole, grid, samples)
        self._check_reach(assembly.whole, grid, columns, self.reach[fidelity])
        return Trajectory(
            scene=scene.name,
            engine=self.name,
            version=self.version,
            fidelity=fidelity,
            t=grid.output_times,
            columns=columns,
            cost=cost,
            settings={
                "dt": grid.dt,
                **options,
                "friction_law": self.capabilities.friction_law[fidelity],
            },
        )

    def _take_steps(self, stepper: Stepper, grid: Grid, begin: float) -> tuple[list[Sample], Cost]:
        """Return the samples of a run and its cost; `begin` is the CPU time (s) at which setting up began.

        Raises
        ------
        EngineFailure
            If a state or a reaction is not finite.
        """
        samples: list[Sample] = []
        # The cost has three parts: setting up, compiling, and stepping.
        setup_end = compile_end = process_time()
        try:
            stepper.compile()
            compile_end = process_time()
            stepper.clock.start()
            march(stepper, grid, samples)
        except FloatingPointError as error:
            reached = max(len(samples) - 1, 0) * grid.every * grid.dt
            raise EngineFailure(
                f"{self.name}: {error}, after t = {reached:g} s with dt = {grid.dt:g} s"
            ) from error
        passes = stepper.clock.calls
        balances = passes if stepper.balanced else 0
        cost = Cost(
            setup_end - begin,
            compile_end - setup_end,
            process_time() - compile_end,
            {"steps": grid.last + 1, "passes": passes, "balances": balances},
            stepper.clock.engine_s,
        )
        return samples, cost

    def _check_reach(
        self, mechanism: Mechanism, grid: Grid, columns: Mapping[str, np.ndarray], reach: float
    ) -> None:
        """Raise BadTrajectory if a slider is beyond the end of its guide, `reach` metres from the guide's point.

        There the engine has simulated another mechanism.
        """
        t, size = grid.output_times, mechanism.arrays.length_scale
        drift = columns["drift.position"]
        for name in mechanism.scene.guides:
            farthest = np.abs(columns[f"{name}.displacement"]).max()
            if not farthest > reach:
                continue
            # A run that has diverged gets beyond the end too; the message then states this cause.
            diverged = np.flatnonzero(~(drift <= size))
            if len(diverged):
                i = diverged[0]
                raise BadTrajectory(
                    f"{self.name}: the run diverged: {drift[i]:.3g} m off its "
                    f"constraints at t = {t[i]:g} s with dt = {grid.dt:g} s; expected less "
                    f"than the size of the mechanism, {size:.3g} m"
                )
            raise BadTrajectory(
                f"{self.name}: {name} is {farthest:g} m from its guide's point; guides end at "
                f"{reach:g} m"
            )


def _columns_of_samples(
    mechanism: Mechanism, grid: Grid, samples: Sequence[Sample]
) -> dict[str, np.ndarray]:
    """Return all columns of the samples of a run."""
    q, v, a, modes, friction = (np.array(values) for values in zip(*samples))
    rests = _rests_with_others(mechanism, q, v, friction, grid.dt)
    modes = np.where(rests, 0, modes)
    friction = np.where(rests, np.nan, friction)
    return columns_of_motion(mechanism, grid.output_times, q, v, a, modes, friction)


def columns_of_motion(
    mechanism: Mechanism,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    modes: np.ndarray,
    frictions: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return all columns of a motion, with a column of modes and frictions (N) for each frictional guide.

    A friction that is NaN is recovered from the balance of momentum.
    """
    guide_columns: dict[str, np.ndarray] = {}
    for i, name in enumerate(mechanism.guide_names):
        guide_columns |= {f"{name}.mode": modes[:, i], f"{name}.friction": frictions[:, i]}
    return recover_columns(mechanism.scene, t, q, v, a, guide_columns, mechanism)


def _rests_with_others(
    mechanism: Mechanism, q: np.ndarray, v: np.ndarray, friction: np.ndarray, dt: float
) -> np.ndarray:
    """Return flags, shape (n, frictional), of guides that rest to rounding while another one sticks.

    A guide that sticks has a friction of NaN. Guides at rest share the load, and an engine may report some of them as
    slipping with friction at its bound. Their speeds are rounding, whose sign is no direction of slip. Therefore the
    balance of momentum has to give their frictions too.
    """
    if friction.shape[1] < 2:
        return np.zeros(friction.shape, dtype=bool)
    arrays, scene = mechanism.arrays, mechanism.scene
    joints = list(scene.joints)
    slip_speeds = []
    for name in scene.frictional_guides:
        _, speed = guide_motion(arrays, joints.index(name), q, v)
        slip_speeds.append(speed)
    slip = np.stack(slip_speeds, axis=1)
    # A guide is at rest if its slider moves in a step by less than the rounding of its position.
    rests = np.abs(slip) * dt <= np.finfo(float).eps * arrays.length_scale
    return rests & np.isnan(friction).any(axis=1, keepdims=True)
