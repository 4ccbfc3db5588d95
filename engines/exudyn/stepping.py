"""Exudyn's steps on a grid, stopped and restarted at the switches of dry friction.

Friction (`friction`) and the surface moment change the multipliers. After each Newton solution the loads are renewed.
The step is repeated until they stay (`PostNewton`, a contraction of rate mu |d N / d f|). A step at whose end the mode
is violated is not accepted: single steps from its beginning find the switch (Brent). Exudyn restarts there with
accelerations and multipliers that are consistent, so that nothing stale is carried over the jump.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import copysign, nan
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from stiction.engines.exudyn.bristles import BristleGuide
from stiction.engines.exudyn.friction import REST_SPEED, FrictionalGuide
from stiction.engines.exudyn.model import Model
from stiction.engines.exudyn.solver import Solver
from stiction.engines.protocol import Declined, EngineFailure, Unsettled
from stiction.reference_impl.multibody.mechanism import Mechanism

FRICTION_TOLERANCE = 1e-8
"""Relative to the load N: largest change of friction in the last repetition; the error is smaller
by the rate. Where the load passes through zero rounding is larger, and decides."""
FRICTION_REPETITIONS = 50
SHORTEST_STEP = 0.01
"""Part of dt: a remainder up to the grid that is shorter joins the next step. Index 3 divides rounding by the square of
the step, so that much shorter ones would spoil the multipliers."""
AHEAD = 1e-4
"""Part of a step after which a margin that begins at zero is looked at: does it rise or fall?"""
ROUNDING = 1e-12
"""Margin below zero that is rounding, m/s or N."""
TRANSIENT = 6
"""Steps after a restart in which the method's own accelerations and multipliers are not reported: they begin off by
O(dt) and come back by the spectral radius a step (the default 0.3^6 = 7e-4)."""
MOST_SWITCHES = 20
"""Within one step; more means that they accumulate (or that no contact mode is consistent)."""
REPEAT_STEP, END_STEPS, ACCEPT_STEP = [1.0, -1.0], [1.0, 0.0], [0.0, -1.0]
"""Answers to Exudyn after a Newton solution: an error, and a recommended step (-1: none)."""


@dataclass(frozen=True)
class Sample:
    """The state at one instant, the multipliers, and what was recorded of the guides."""

    t: float
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    multipliers: np.ndarray
    guides: list[Any]


class Switch(NamedTuple):
    """A located change of contact mode."""

    kind: str
    guide: str
    before: Sample
    after: Sample


class Stepper:
    """Runs a model at fixed steps, of which `samples`, `switches` and `counters` tell; `solver` is Exudyn's.

    Steps take `dt` seconds; shorter ones end at switches and lead back to the grid k dt. Switches of `guides` are
    located: without any, nothing of Python runs within a step. Bounds of `bristles` are renewed before each step.
    `record` returns what to keep of all guides at each sample.

    Raises
    ------
    Declined
        If redundant constraints leave the reactions of a frictional guide open: its friction is then too.
    """

    def __init__(
        self,
        model: Model,
        guides: list[FrictionalGuide],
        dt: float,
        settings: Any,
        bristles: list[BristleGuide],
        mechanism: Mechanism,
        record: Callable[[], list[Any]],
    ):
        self.model, self.guides, self.dt, self._record = model, guides, dt, record
        self.counters = dict.fromkeys(("steps", "newton", "switches", "restarts"), 0)
        self.switches: list[Switch] = []
        self.samples: list[Sample] = []
        self._watching = self._violated = False
        self._repetitions = 0
        # index 3 gets forces from positions, whose rounding it divides by the square of the step
        size = mechanism.arrays.length_scale
        mass = sum(body.mass for body in model.scene.bodies.values())
        self._rounding = float(np.finfo(float).eps) * mass * size / dt**2
        for each in (*guides, *bristles):
            each.bind(model)
        self.solver = Solver(model, settings)
        if guides:
            self.solver.after_newton(self._judge)
        if bristles:
            self.solver.before_step(bristles)
        for guide in guides if self.solver.redundant else ():
            if np.intersect1d(self.solver.open_rows, guide.reaction_rows).size:
                raise Declined(
                    f"joints.{guide.name}: the constraints are redundant and leave its reactions open, and "
                    "with them its friction"
                )

    def run(self, t_end: float, every: int) -> None:
        """Integrate from the scene's initial state; `samples` are at each `every`-th instant of the grid, and at t_end.

        The last step is shorter where t_end is no multiple of dt.

        Raises
        ------
        Unsettled
            If friction does not; `samples` are those before.
        EngineFailure
            If Exudyn's solver gives up or switches accumulate.
        """
        whole = int(t_end / self.dt + 1e-9)
        grid = [*range(whole + 1), *([t_end / self.dt] if t_end > (whole + 1e-9) * self.dt else [])]
        last = len(grid) - 1
        samples = self.samples
        samples.append(self._first())
        transient: list[int] = []
        k, on_grid, recent = 0, True, 0
        while k < last:
            target = min(
                every * (k // every + 1), last if last == whole else max(whole, k + 1), last
            )
            if not on_grid:
                target = k + 1
                if (
                    target < last
                    and grid[target] * self.dt - self.solver.t < SHORTEST_STEP * self.dt
                ):
                    if target % every == 0:
                        samples.append(self.switches[-1].after)
                    target += 1
            known = len(self.switches)
            self._advance(grid[target] * self.dt, target - k if on_grid else 1)
            position = self.solver.t / self.dt
            recent = recent + 1 if len(self.switches) > known else 0
            if recent > MOST_SWITCHES:
                raise EngineFailure(
                    f"more than {MOST_SWITCHES} switches of dry friction in the step at "
                    f"t = {k * self.dt:g} s: they accumulate, or no contact mode is consistent"
                )
            if position < grid[target] - 1e-9:
                # stopped before: at a switch, or behind one that was none
                k = max(k, int(position + 1e-9))
                on_grid = abs(position - k) < 1e-9
                continue
            k, on_grid = target, True
            if k % every == 0 or k == last:
                samples.append(self._sample())
                restarted = self.switches[-1].after.t if self.switches else 0.0
                is_short = k == last and last > whole and grid[last] - whole < SHORTEST_STEP
                if is_short or self.guides and samples[-1].t - restarted < TRANSIENT * self.dt:
                    transient.append(len(samples) - 1)
        self.counters["newton"] = self.solver.engine.it.newtonStepsCount
        for i in transient:
            samples[i] = self._consistent(samples[i])

    def _first(self) -> Sample:
        """The sample at the start; without forces, and kept in `samples`, if friction does not settle there."""
        q, v = self.model.initial_state()
        for guide in self.guides:
            speed = guide.slip_speed(q, v)
            guide.switch(0 if abs(speed) <= REST_SPEED else int(copysign(1, speed)), q)
        try:
            self._start_with_drives(q, v)
            return self._restart(0.0, q, v)
        except Unsettled:
            nothing = np.full(self.solver.coordinates, nan), np.full(self.solver.constraints, nan)
            self.samples.append(Sample(0.0, q, v, *nothing, self._record()))
            raise

    def _start_with_drives(self, q: np.ndarray, v: np.ndarray) -> None:
        """Let sliders go that start at rest and whose motion the constraints give, as at a dead centre of a crank.

        Nothing is left there for friction to hold: their direction is that of their acceleration, without friction.
        """
        on_constraints = self._on_velocity_constraints(0.0, q, v)
        jacobian = self.solver.jacobian()
        bilateral = np.delete(jacobian, [guide.hold_row for guide in self.guides], axis=0)
        rank = np.linalg.matrix_rank(bilateral)
        given = [
            guide
            for guide in self.guides
            if guide.mode == 0
            and np.linalg.matrix_rank(np.vstack([bilateral, jacobian[guide.hold_row]])) == rank
        ]
        if not given:
            return
        for guide in given:
            guide.switch(1, q)
            guide.coefficient = 0.0
        a, _ = self._start(0.0, q, on_constraints)
        for guide in given:
            guide.coefficient = guide.joint.kinetic_coefficient
            acceleration = guide.slip_acceleration(q, on_constraints, a)
            guide.switch(
                0 if abs(acceleration) * self.dt <= REST_SPEED else int(copysign(1, acceleration)),
                q,
            )

    def _advance(self, t1: float, steps: int) -> None:
        """Steps from the present state to t1, or to the first switch, which is then done."""
        t0 = self.solver.t
        self._watching = True
        if self._steps(t0, t1, steps):
            return
        start, q, v = self.solver.start_of_step()
        self._watching = False
        self._locate(start, q, self._on_velocity_constraints(start, q, v), (t1 - t0) / steps)

    def _steps(self, t0: float, t1: float, steps: int) -> bool:
        """Steps of equal length; False if a violated mode stopped them."""
        self._violated, self._repetitions = False, 0
        done, made = self.solver.steps(t0, t1, steps)
        self.counters["steps"] += made
        if not done and not self._violated:
            t = self.solver.t
            if self._repetitions >= FRICTION_REPETITIONS:
                raise Unsettled(
                    f"friction and reactions do not settle at t = {t:g} s: no solution, or several",
                    t,
                )
            if self.solver.redundant:
                raise EngineFailure(
                    f"the constraints are redundant, and Exudyn finds no state at t = {t:g} s that "
                    "meets them all: they contradict"
                )
            raise EngineFailure(self.solver.failure(f"no convergence at t = {t:g} s"))
        return done

    def _settled(self, multipliers: np.ndarray) -> bool:
        """Renew the frictions; True where they stay."""
        changes = [(guide.renew(multipliers), guide.load) for guide in self.guides]
        return all(
            change <= max(FRICTION_TOLERANCE * load, self._rounding) for change, load in changes
        )

    def _judge(self) -> list[float]:
        """Renew the friction after a Newton solution; repeat the step, accept it, or end where a mode is violated."""
        multipliers = self.solver.multipliers
        self._repetitions += 1
        if not self._settled(multipliers):
            return REPEAT_STEP
        self._repetitions = 0
        if self._watching:
            q, v = self.solver.q, self.solver.v
            if min([guide.margin(q, v) for guide in self.guides]) < -ROUNDING:
                self._violated = True
                return END_STEPS
        return ACCEPT_STEP

    def _locate(self, t: float, q: np.ndarray, v: np.ndarray, step: float) -> None:
        """Find the first end of a mode in a step from (t, q, v) and switch there; if there is none after all, step."""
        shortest = SHORTEST_STEP * step

        def margins(h: float) -> list[float]:
            a, _ = self._start(t, q, v)
            state = q, v
            if h >= shortest:
                self._steps(t, t + h, 1)
                state = self.solver.q, self.solver.v
            elif h > 0.0:
                # Exudyn makes no steps of nothing; over these the next terms of the series are
                # below rounding
                state = q + h * v + 0.5 * h * h * a, v + h * a
            if h > 0.0 and (sticking or h < shortest):
                # of the state: multipliers of a first step are off by O(h); speeds are those that it is started with
                state = state[0], self._on_velocity_constraints(t + h, *state)
                self._start(t + h, *state)
            return [guide.margin(*state) for guide in self.guides]

        sticking = any(guide.mode == 0 for guide in self.guides)
        lower, at_start = 0.0, np.array(margins(0.0))
        if (over := at_start <= 0.0).any():
            # of modes that have just begun margins rise first; others end at the very beginning of
            # the step
            ended = over & (np.array(margins(AHEAD * step)) <= at_start)
            if ended.any():
                margins(0.0)
                self._switch(self.guides[int(np.argmin(np.where(ended, at_start, np.inf)))])
                return
            lower = step
            while min(margins(lower)) <= 0.0 and lower > shortest:
                lower *= 0.5
        if min(margins(step)) >= 0.0:
            return
        if min(margins(lower)) > 0.0:
            lower = brentq(lambda h: min(margins(h)), lower, step, xtol=1e-12 * step)
        self._switch(self.guides[int(np.argmin(margins(lower)))])

    def _switch(self, ended: FrictionalGuide) -> None:
        """End the mode of a guide at the present state, and restart."""
        modes = [guide.mode for guide in self.guides]
        before = self._consistent(self._sample())
        if ended.mode:
            # it may have passed zero within SHORTEST_STEP of another's switch, too soon to be distinguished from that
            self._stop(
                before,
                [
                    guide
                    for guide in self.guides
                    if guide.mode
                    and (guide is ended or abs(guide.slip_speed(before.q, before.v)) <= REST_SPEED)
                ],
            )
        else:
            ended.switch(int(-copysign(1, ended.friction)), before.q)
        after = self._restart(before.t, before.q, before.v)
        for guide, old in zip(self.guides, modes):
            if guide.mode != old:
                kind = "slip" if old == 0 else "stick" if guide.mode == 0 else "reversal"
                self.switches.append(Switch(kind, guide.name, before, after))
        self.counters["switches"] += 1

    def _stop(self, state: Sample, guides: list[FrictionalGuide]) -> None:
        """Turn sliders that came to rest round where static friction lets them; else they stick."""
        # to hold them and look at the force would fail where the mechanism turns round: there no force holds them
        for guide in guides:
            guide.switch(-guide.mode, state.q)
            guide.coefficient = guide.mus
        a, _ = self._start(state.t, state.q, state.v)
        turns = [
            guide.mode * guide.slip_acceleration(state.q, state.v, a) > 0.0 for guide in guides
        ]
        for guide in guides:
            guide.coefficient = guide.joint.kinetic_coefficient
            if not all(turns):
                guide.switch(0, state.q)

    def _restart(self, t: float, q: np.ndarray, v: np.ndarray) -> Sample:
        """Begin at a state, releasing the sticking sliders that friction cannot hold, the most overloaded first."""
        while True:
            held = [guide for guide in self.guides if guide.mode == 0]
            on_constraints = self._on_velocity_constraints(t, q, v)
            if held and not self._independent(held):
                names = ", ".join(guide.name for guide in held)
                raise Declined(
                    f"at t = {t:g} s the sliders of {names} stick and hold the same motion: their shares "
                    "are open, and the adapter holds each by a constraint of its own"
                )
            a, multipliers = self._start(t, q, on_constraints)
            overloaded = min(held, key=lambda guide: guide.margin(q, v), default=None)
            if overloaded is None or overloaded.margin(q, v) >= -ROUNDING:
                return Sample(t, q, on_constraints, a, multipliers, self._record())
            overloaded.switch(int(-copysign(1, overloaded.friction)), q)

    def _independent(self, held: list[FrictionalGuide]) -> bool:
        """Return True where the connectors that hold sliders all add to the rank of the constraints."""
        jacobian = self.solver.jacobian()
        others = np.delete(jacobian, [guide.hold_row for guide in held], axis=0)
        return np.linalg.matrix_rank(jacobian) == np.linalg.matrix_rank(others) + len(held)

    def _start(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Set the state, with accelerations and multipliers that belong to it, friction included; returns these."""
        self.counters["restarts"] += 1
        self.solver.set_state(t, q, v)
        for _ in range(FRICTION_REPETITIONS):
            a, multipliers = self.solver.initial_accelerations(t)
            if self._settled(multipliers):
                self.solver.keep_accelerations(a)
                return a, multipliers
        raise Unsettled(
            f"friction and reactions do not settle at t = {t:g} s: no solution, or several", t
        )

    def _consistent(self, sample: Sample) -> Sample:
        """The sample with the accelerations and multipliers that belong to its state and contact modes."""
        for guide, (mode, *_) in zip(self.guides, sample.guides):
            guide.switch(mode, sample.q)
        a, multipliers = self._start(
            sample.t, sample.q, self._on_velocity_constraints(sample.t, sample.q, sample.v)
        )
        return replace(sample, a=a, multipliers=multipliers, guides=self._record())

    def _on_velocity_constraints(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The velocities changed least so that they meet the constraints, held sliders at rest."""
        return self.solver.on_velocity_constraints(
            t, q, v, [guide.hold_row for guide in self.guides if guide.mode]
        )

    def _sample(self) -> Sample:
        solver = self.solver
        return Sample(
            solver.t, solver.q, solver.v, solver.accelerations(), solver.multipliers, self._record()
        )
