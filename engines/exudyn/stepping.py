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

from stiction.engines.exudyn.bristles import Bristles
from stiction.engines.exudyn.friction import REST_SPEED, LocatedFriction
from stiction.engines.exudyn.model import Model
from stiction.engines.exudyn.solver import Solver
from stiction.engines.protocol import Declined, EngineFailure, Unsettled
from stiction.reference_impl.multibody.mechanism import Mechanism

FRICTION_TOLERANCE = 1e-8
"""Largest change of friction in the last repetition, relative to the load N. The remaining error is smaller by the rate
of the contraction. Where the load passes through zero, rounding is larger than this, and decides."""
FRICTION_REPETITIONS = 50
"""Repetitions of a step after which friction is taken not to settle. With a rate of 0.69 or less they reach
`FRICTION_TOLERANCE` from a change of the size of the load; rates near one are those at which solutions cease to be
unique."""
DISCONTINUOUS_TOLERANCE = 0.5
"""Exudyn repeats the Newton iteration of a step while the error that `Stepper._judge` reports is above this value. The
errors are 0 or 1, so that any value between them separates the two."""
SHORTEST_STEP = 0.01
"""Part of dt: a remainder up to the grid that is shorter joins the next step. Index 3 divides rounding by the square of
the step, so that much shorter ones would spoil the multipliers."""
AHEAD = 1e-4
"""Part of a step after which a margin that begins at zero is evaluated again, to see whether it rises or falls: short
enough for the first term of its series to decide, long enough for its change to exceed rounding."""
ROUNDING = 1e-12
"""Magnitude of a negative margin that is rounding, m/s or N."""
GRID_ROUNDING = 1e-9
"""Distance from the grid k dt, in steps, that is rounding of an instant that was added up from steps."""
SWITCH_TOLERANCE = 1e-12
"""Part of a step to which the instant of a switch is located. The slip speed at the switch is then off by as small a
part of its change in the step, far below `REST_SPEED`."""
TRANSIENT = 6
"""Steps after a restart in which the method's own accelerations and multipliers are not reported: they begin off by
O(dt) and come back by the spectral radius a step (the default 0.3^6 = 7e-4)."""
MOST_SWITCHES = 20
"""Within one step; more means that they accumulate (or that no contact mode is consistent)."""
REPEAT_STEP = [1.0, -1.0]
END_STEPS = [1.0, 0.0]
ACCEPT_STEP = [0.0, -1.0]
"""Answers to Exudyn after a Newton solution, each ``[error, recommended step size]``. An error above
`DISCONTINUOUS_TOLERANCE` makes Exudyn solve the step again; a recommended step size of -1 is no recommendation, so that
the step remains the same. A recommended step size of 0 asks for a shorter step, which a run of fixed steps cannot make:
Exudyn ends the steps and reports that they failed."""


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
        guides: list[LocatedFriction],
        dt: float,
        settings: Any,
        bristles: list[Bristles],
        mechanism: Mechanism,
        record: Callable[[], list[Any]],
    ):
        self.model, self.guides, self.dt, self._record = model, guides, dt, record
        self.counters = dict.fromkeys(("steps", "newton", "switches", "restarts"), 0)
        self.switches: list[Switch] = []
        self.samples: list[Sample] = []
        self._watching = self._violated = False
        self._repetitions = 0
        # Index 3 obtains the multipliers from the positions and divides the rounding of these by
        # the square of the step. This is the smallest change of a force that means anything.
        size = mechanism.arrays.length_scale
        mass = sum(body.mass for body in model.scene.bodies.values())
        self._rounding = float(np.finfo(float).eps) * mass * size / dt**2
        for each in (*guides, *bristles):
            each.bind(model)
        self.solver = Solver(model, settings)
        # Exudyn calls a hook of Python in each step at a considerable cost, so a scene without
        # friction gets none.
        if guides:
            self.solver.after_newton(self._judge)
        if bristles:
            self.solver.before_step(bristles)
        # Friction is a function of the reactions. Where redundant constraints leave these open,
        # the solver would choose some, and the motion would depend on that choice.
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
        # Instants of the grid, in steps. The last one is no whole number where t_end is not on k dt.
        whole = int(t_end / self.dt + GRID_ROUNDING)
        grid: list[float] = [*range(whole + 1)]
        if t_end > (whole + GRID_ROUNDING) * self.dt:
            grid.append(t_end / self.dt)
        last = len(grid) - 1
        samples = self.samples
        samples.append(self._first())
        transient: list[int] = []  # samples whose forces are still off, by their place in `samples`
        # `k` is the instant of the grid at or before the present time, `in_a_row` the number of
        # attempts in succession that ended at a switch.
        k = 0
        on_grid = True
        in_a_row = 0
        while k < last:
            # All steps up to the next output are made by one call of Exudyn, which is much faster
            # than one call for each. A last step of another length needs a call of its own.
            target = min(
                every * (k // every + 1), last if last == whole else max(whole, k + 1), last
            )
            if not on_grid:
                # Behind a switch, one shorter step leads back to the grid. Where hardly anything is
                # left to the next instant, that instant is skipped; its sample, if any, is the
                # state behind the switch.
                target = k + 1
                if (
                    target < last
                    and grid[target] * self.dt - self.solver.t < SHORTEST_STEP * self.dt
                ):
                    if target % every == 0:
                        samples.append(self.switches[-1].after)
                    target += 1
            switches_before = len(self.switches)
            self._advance(grid[target] * self.dt, target - k if on_grid else 1)
            position = self.solver.t / self.dt
            in_a_row = in_a_row + 1 if len(self.switches) > switches_before else 0
            if in_a_row > MOST_SWITCHES:
                raise EngineFailure(
                    f"more than {MOST_SWITCHES} switches of dry friction in the step at "
                    f"t = {k * self.dt:g} s: they accumulate, or no contact mode is consistent"
                )
            if position < grid[target] - GRID_ROUNDING:
                # The steps ended before the target: at a switch, or after a step in which a
                # suspected switch turned out to be none.
                k = max(k, int(position + GRID_ROUNDING))
                on_grid = abs(position - k) < GRID_ROUNDING
                continue
            k = target
            on_grid = True
            if k % every == 0 or k == last:
                samples.append(self._sample())
                # The method's own accelerations and multipliers are off for some steps behind a
                # restart, and after a very short last step. They are replaced after the run,
                # because to compute them anew resets the solver's state.
                restarted = self.switches[-1].after.t if self.switches else 0.0
                is_short = k == last and last > whole and grid[last] - whole < SHORTEST_STEP
                if is_short or self.guides and samples[-1].t - restarted < TRANSIENT * self.dt:
                    transient.append(len(samples) - 1)
        self.counters["newton"] = self.solver.engine.it.newtonStepsCount
        for i in transient:
            samples[i] = self._consistent(samples[i])

    def _first(self) -> Sample:
        """Return the sample at the start.

        If friction does not settle there, the sample is appended to `samples` without forces before `Unsettled` is
        raised.
        """
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
        """Set the modes of sliders that start at rest and whose motion the constraints prescribe.

        An example is a slider at a dead centre of a driven crank. Friction cannot hold such a slider: it slips in the
        direction of its acceleration, which does not depend on the friction.
        """
        # A slider's motion is prescribed if the row along its guide adds nothing to the rank of the
        # constraints without the connectors that hold sliders.
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
        # The accelerations without friction of these sliders: with any, its direction would have to
        # be known.
        for guide in given:
            guide.switch(1, q)
            guide.slip_without_friction()
        a, _ = self._start(0.0, q, on_constraints)
        # A slider whose speed stays rounding over the first step stays at rest, and is held.
        for guide in given:
            guide.slip_with_kinetic_bound()
            acceleration = guide.slip_acceleration(q, on_constraints, a)
            guide.switch(
                0 if abs(acceleration) * self.dt <= REST_SPEED else int(copysign(1, acceleration)),
                q,
            )

    def _advance(self, t1: float, steps: int) -> None:
        """Make steps from the present state to t1, or to the first switch, and switch there."""
        t0 = self.solver.t
        self._watching = True
        if self._steps(t0, t1, steps):
            return
        # The step that violates a mode was not accepted, and Exudyn still has the state at its
        # start. The switch is searched from there, with steps that may violate the mode.
        start, q, v = self.solver.start_of_step()
        self._watching = False
        self._locate(start, q, self._on_velocity_constraints(start, q, v), (t1 - t0) / steps)

    def _steps(self, t0: float, t1: float, steps: int) -> bool:
        """Make steps of equal length; return False if a violated mode ended them.

        Raises
        ------
        Unsettled, EngineFailure
            If they ended for another reason.
        """
        self._violated, self._repetitions = False, 0
        done, made = self.solver.steps(t0, t1, steps)
        self.counters["steps"] += made
        # Exudyn reports only that the steps failed. What the hook has seen tells the reasons apart.
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
                    "meets them all: they contradict each other"
                )
            raise EngineFailure(self.solver.failure(f"no convergence at t = {t:g} s"))
        return done

    def _settled(self, multipliers: np.ndarray) -> bool:
        """Update the frictions from multipliers; return True if none of them changes any more."""
        changes = [(guide.renew(multipliers), guide.load) for guide in self.guides]
        return all(
            change <= max(FRICTION_TOLERANCE * load, self._rounding) for change, load in changes
        )

    def _judge(self) -> list[float]:
        """Update the friction after a Newton solution, and return the answer to Exudyn.

        The step is repeated with the new friction, accepted, or, where a mode is violated, given up.
        """
        # Friction depends on the multipliers, and these on the friction: a fixed point iteration.
        multipliers = self.solver.multipliers
        self._repetitions += 1
        if not self._settled(multipliers):
            return REPEAT_STEP
        self._repetitions = 0
        # Only friction that has settled says whether a mode still holds. Trial steps of `_locate`
        # may go beyond the end of a mode; they are not watched.
        if self._watching:
            q, v = self.solver.q, self.solver.v
            if min([guide.margin(q, v) for guide in self.guides]) < -ROUNDING:
                self._violated = True
                return END_STEPS
        return ACCEPT_STEP

    def _locate(self, t: float, q: np.ndarray, v: np.ndarray, step: float) -> None:
        """Find the first end of a mode in a step of length `step` from (t, q, v), and switch there.

        If no mode ends after all, the step is made.
        """
        shortest = SHORTEST_STEP * step

        def margins(h: float) -> list[float]:
            """Return the margins of all guides after one step of h seconds; the solver then has the state there."""
            a, _ = self._start(t, q, v)
            state = q, v
            if h >= shortest:
                self._steps(t, t + h, 1)
                state = self.solver.q, self.solver.v
            elif h > 0.0:
                # Exudyn makes no step of length zero, and very short ones spoil the multipliers.
                # Over less than `shortest` the omitted terms of this series are below rounding.
                state = q + h * v + 0.5 * h * h * a, v + h * a
            if h > 0.0 and (sticking or h < shortest):
                # The margin of stick is a force. The multipliers after a single step are off by
                # O(h), so those that belong to its state are computed. The margin of slip is a
                # speed and needs this only where Exudyn did not make the step.
                state = state[0], self._on_velocity_constraints(t + h, *state)
                self._start(t + h, *state)
            return [guide.margin(*state) for guide in self.guides]

        sticking = any(guide.mode == 0 for guide in self.guides)
        # Bracket the first end of a mode: at `lower` all modes hold, at `step` one does not.
        lower = 0.0
        at_start = np.array(margins(0.0))
        at_end_of_mode = at_start <= 0.0
        if at_end_of_mode.any():
            # A margin of zero at the start belongs to a mode that has just begun, and rises, or to
            # one that ends at this very instant, and falls. Those that fall are switched here.
            ended = at_end_of_mode & (np.array(margins(AHEAD * step)) <= at_start)
            if ended.any():
                margins(0.0)  # sets the solver back to the start of the step
                self._switch(self.guides[int(np.argmin(np.where(ended, at_start, np.inf)))])
                return
            # All rise. Halve the step until an instant is found at which all are positive.
            lower = step
            while min(margins(lower)) <= 0.0 and lower > shortest:
                lower *= 0.5
        # The suspicion came from a step among others. One step of its own, restarted with
        # consistent forces, may fulfil all modes; that step is kept.
        if min(margins(step)) >= 0.0:
            return
        if min(margins(lower)) > 0.0:
            lower = brentq(lambda h: min(margins(h)), lower, step, xtol=SWITCH_TOLERANCE * step)
        self._switch(self.guides[int(np.argmin(margins(lower)))])

    def _switch(self, ended: LocatedFriction) -> None:
        """End the mode of a guide at the present state, and restart."""
        modes = [guide.mode for guide in self.guides]
        before = self._consistent(self._sample())
        if ended.mode:
            # Slip has ended. Other sliders that are at rest too stop together with it: their speeds
            # may have passed zero within SHORTEST_STEP of this switch, too close to be told apart.
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
            # Stick has ended. The slider yields to the load, so it slips against its last friction.
            ended.switch(int(-copysign(1, ended.friction)), before.q)
        after = self._restart(before.t, before.q, before.v)
        for guide, old in zip(self.guides, modes):
            if guide.mode != old:
                kind = _kind(old, guide.mode)
                self.switches.append(Switch(kind, guide.name, before, after))
        self.counters["switches"] += 1

    def _stop(self, state: Sample, guides: list[LocatedFriction]) -> None:
        """Reverse sliders that have come to rest if static friction cannot hold them; otherwise they stick."""
        # They are released in the opposite direction with the static coefficient, and stick unless
        # all accelerate that way. To hold them and compare the force with its bound would fail at a
        # reversal that constraints prescribe, where no force holds a slider.
        for guide in guides:
            guide.switch(-guide.mode, state.q)
            guide.slip_with_static_bound()
        a, _ = self._start(state.t, state.q, state.v)
        turns = [
            guide.mode * guide.slip_acceleration(state.q, state.v, a) > 0.0 for guide in guides
        ]
        for guide in guides:
            guide.slip_with_kinetic_bound()
            if not all(turns):
                guide.switch(0, state.q)

    def _restart(self, t: float, q: np.ndarray, v: np.ndarray) -> Sample:
        """Begin at a state, releasing the sticking sliders that friction cannot hold, the most overloaded first."""
        # Each release changes the loads of the other guides. So one slider is released at a time,
        # until friction holds all that are left: at most one turn for each guide that sticks.
        while True:
            held = [guide for guide in self.guides if guide.mode == 0]
            on_constraints = self._on_velocity_constraints(t, q, v)
            # Each held slider has a constraint of its own. If these are dependent, their forces are
            # not unique, and no bound could be compared with them.
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

    def _independent(self, held: list[LocatedFriction]) -> bool:
        """Return True where the connectors that hold sliders all add to the rank of the constraints."""
        jacobian = self.solver.jacobian()
        others = np.delete(jacobian, [guide.hold_row for guide in held], axis=0)
        return np.linalg.matrix_rank(jacobian) == np.linalg.matrix_rank(others) + len(held)

    def _start(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Set the state; return the accelerations and multipliers that belong to it, friction included."""
        # The same fixed point iteration as in `_judge`, on accelerations instead of a step.
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
        """Return the sample with the accelerations and multipliers that belong to its state and contact modes."""
        for guide, (mode, *_) in zip(self.guides, sample.guides):
            guide.switch(mode, sample.q)
        a, multipliers = self._start(
            sample.t, sample.q, self._on_velocity_constraints(sample.t, sample.q, sample.v)
        )
        return replace(sample, a=a, multipliers=multipliers, guides=self._record())

    def _on_velocity_constraints(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the velocities, changed least, that meet the constraints with held sliders at rest."""
        return self.solver.on_velocity_constraints(
            t, q, v, [guide.hold_row for guide in self.guides if guide.mode]
        )

    def _sample(self) -> Sample:
        solver = self.solver
        return Sample(
            solver.t, solver.q, solver.v, solver.accelerations(), solver.multipliers, self._record()
        )


def _kind(before: int, after: int) -> str:
    """Return the kind of a switch by the modes of its guide before and after it, which differ."""
    if before == 0:
        return "slip"
    return "reversal" if after else "stick"
