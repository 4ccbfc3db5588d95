"""Exudyn's implicit methods on a grid of steps, stopped and restarted at the switches of dry friction.

Exudyn has no load-dependent Coulomb friction, so the law is here and the forces are Exudyn's own loads. With R the
resultant normal force and M_n the moment of the normal forces (both multipliers of the prismatic joint),

    n1 + n2 = R ,   n2 - n1 = (2/a) M_n ,   N = |n1| + |n2| = max(|R|, (2/a) |M_n|)     (N = |R| without a length)
    slip in direction s:  f = -mu s N ,   surface moment (b/2) (f_lower - f_upper) = (b/2) (f / N) R
    stick:                |f| <= mus N ,  f = the multiplier of a connector that holds the slider

f and the surface moment change the multipliers: after each Newton solution the loads are renewed and the
step is repeated until they stay (`PostNewton`, a contraction of rate mu |d N / d f|). A step at whose end the mode
is violated is not accepted: single steps from its beginning find the switch (Brent), and Exudyn restarts there
with accelerations and multipliers that are consistent, so that nothing stale is carried over the jump.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import copysign, nan
from typing import Any

import numpy as np
from scipy.optimize import brentq

from stiction.engines.exudyn.model import Model, turned, unit
from stiction.engines.protocol import Declined, EngineFailure, Unsettled
from stiction.engines.shared.engine_clock import EngineClock
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Linear, evaluate_law
from stiction.scenes.model import Translational

INTEGRATORS = {"generalized-alpha": (False, False), "newmark": (True, False), "trapezoidal": (True, True)}
"""Exudyn's implicit methods: whether Newmark's (beta 1/4, gamma 1/2), and whether constraints are met by velocities (index 2) instead of positions."""
FRICTION_TOLERANCE = 1e-8
"""Relative to the load N: largest change of friction in the last repetition; the error is smaller by the rate."""
FRICTION_REPETITIONS = 50
REST_SPEED = 1e-9
"""m/s: below it a slider counts as at rest at the start; above the rounding of initial states, below any motion."""
SHORTEST_STEP = 0.01
"""Of dt: a remainder up to the grid that is shorter joins the next step. Index 3 divides rounding by the square of the
step, so that much shorter ones would spoil the multipliers."""
ROUNDING = 1e-12
"""m/s or N: a margin this far below zero is rounding."""
TRANSIENT = 6
"""Steps after a restart in which the method's own accelerations and multipliers are not reported: they begin off by
O(dt) and come back by the spectral radius a step (the default 0.3^6 = 7e-4)."""
OPEN = 1e-9
"""Of a null vector of unit length: components above it are of reactions that redundant constraints leave open."""
MOST_SWITCHES = 20
"""Within one step; more means that they accumulate (or that no contact mode is consistent)."""


@dataclass
class Sample:
    """The state at one instant, the multipliers, and what was recorded of the guides."""

    t: float
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    multipliers: np.ndarray
    guides: list[Any]


@dataclass
class Switch:
    """A located change of contact mode."""

    kind: str
    guide: str
    before: Sample
    after: Sample


@dataclass
class Counters:
    """Counters of a run."""

    steps: int = 0
    newton: int = 0
    switches: int = 0
    restarts: int = 0


class SlidingGuide:
    """A frictional guide in Exudyn: coefficients, geometry, and the moment of friction on the slider's surfaces as loads."""

    def __init__(self, model: Model, name: str, joint: Translational):
        self.name, self.joint = name, joint
        self.system = model.system
        self.coefficient, self.mus = joint.mu, joint.static_coefficient
        self.lever = 2.0 / joint.length if joint.length else 0.0
        self.half_width = 0.5 * (joint.width or 0.0)
        self.slider = 3 * model.index[joint.slider]
        self.guide = None if joint.guide == GROUND else 3 * model.index[joint.guide]
        self.direction = unit(joint.direction)
        self.mode, self.friction, self.surface_moment, self.load = 0, 0.0, 0.0, 0.0
        self.along = model.along(joint.guide, joint.point, joint.direction, joint.slider, joint.slider_point)
        self.moments = []
        if self.half_width:
            for body, sign in ((joint.slider, 1.0), (joint.guide, -1.0)):
                if body != GROUND:
                    load = self.system.AddLoad(model.items.LoadTorqueVector(markerNumber=model.rigid(body)))
                    self.moments.append((load, sign))

    def bind(self, model: Model) -> None:
        """Look up the multipliers, which exist once the system is assembled."""
        self.reaction_rows = model.rows[self.name]

    def measure_load(self, multipliers: np.ndarray) -> float:
        """Set `load`, N = |n1| + |n2|, from multipliers; returns the normal force R, N."""
        R, moment = multipliers[self.reaction_rows[0]], -multipliers[self.reaction_rows[1]]
        self.load = max(abs(R), self.lever * abs(moment))
        return R

    def apply_surface_moment(self, friction: float, R: float) -> float:
        """Load the surfaces' moment of a friction, with the normal force R, both in N; returns how much it has changed, N m."""
        if not self.moments:
            return 0.0
        before, self.surface_moment = self.surface_moment, self.half_width * friction / self.load * R if self.load else 0.0
        for load, sign in self.moments:
            self.system.SetLoadParameter(load, "loadVector", [0.0, 0.0, sign * self.surface_moment])
        return abs(self.surface_moment - before)

    def slip_speed(self, q: np.ndarray, v: np.ndarray) -> float:
        """Velocity of the slider's point along the guide, m/s."""
        i, j = self.slider, self.guide
        px, py = turned(self.joint.slider_point, q[i + 2])
        vx, vy = v[i] - v[i + 2] * py, v[i + 1] + v[i + 2] * px
        if j is None:
            ux, uy = self.direction
        else:
            ux, uy = turned(self.direction, q[j + 2])
            gx, gy = q[i] + px - q[j], q[i + 1] + py - q[j + 1]
            vx, vy = vx - v[j] + v[j + 2] * gy, vy - v[j + 1] - v[j + 2] * gx
        return ux * vx + uy * vy

    def displacement(self, q: np.ndarray) -> float:
        """Coordinate of the slider's point along the guide."""
        i, j = self.slider, self.guide
        px, py = turned(self.joint.slider_point, q[i + 2])
        gx, gy, angle = (0.0, 0.0, 0.0) if j is None else q[j:j + 3]
        ux, uy = turned(self.direction, angle)
        ox, oy = turned(self.joint.point, angle)
        return ux * (q[i] + px - gx - ox) + uy * (q[i + 1] + py - gy - oy)


class FrictionalGuide(SlidingGuide):
    """A guide whose friction is the adapter's: its load, the connector that holds a sticking slider, its mode."""

    def __init__(self, model: Model, name: str, joint: Translational):
        super().__init__(model, name, joint)
        self._force = self.system.AddLoad(model.items.LoadCoordinate(markerNumber=self.along))
        self._loaded = 0.0
        self._connector = self.system.AddObject(model.items.ObjectConnectorCoordinate(
            markerNumbers=[model.zero(), self.along], activeConnector=False))

    def bind(self, model: Model) -> None:
        """Look up the multipliers, which exist once the system is assembled."""
        super().bind(model)
        (self.hold_row,) = model.multipliers(self._connector)

    def switch(self, mode: int, q: np.ndarray | None = None) -> None:
        """Slip against (-1) or along (1) the direction, or stick (0) at the place that q gives."""
        self.mode = mode
        self.system.SetObjectParameter(self._connector, "activeConnector", mode == 0)
        if mode == 0:
            self.system.SetObjectParameter(self._connector, "offset", self.displacement(q))
            self._apply(0.0)

    def _apply(self, friction: float) -> float:
        """Load a friction in the model; returns by how much it has changed there, N."""
        before, self._loaded = self._loaded, friction
        self.system.SetLoadParameter(self._force, "load", friction)
        return abs(friction - before)

    def renew(self, multipliers: np.ndarray) -> float:
        """Loads from multipliers; returns the change of friction relative to the normal load."""
        R = self.measure_load(multipliers)
        if self.mode:
            friction = -self.coefficient * self.mode * self.load
            change = self._apply(friction)
        else:
            friction, change = -multipliers[self.hold_row], 0.0
        self.friction, bound = friction, self.mus * self.load
        # a slider that is held by more is let go; until then its surfaces have what they can hold: with more, friction and load need not settle
        change = max(change, self.lever * self.apply_surface_moment(min(max(friction, -bound), bound), R))
        return change / self.load if change else 0.0

    def margin(self, q: np.ndarray, v: np.ndarray) -> float:
        """Distance of the mode from its end: speed in its direction (m/s), or friction left (N); negative beyond."""
        if self.mode:
            return self.mode * self.slip_speed(q, v)
        return self.mus * self.load - abs(self.friction)

    def slip_acceleration(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> float:
        """Rate of `slip_speed` by a central difference over 2e-5 s: its sign is what matters."""
        return (self.slip_speed(q + 1e-5 * v, v + 1e-5 * a) - self.slip_speed(q - 1e-5 * v, v - 1e-5 * a)) / 2e-5


class Stepper:
    """Runs a model at fixed steps.

    Attributes
    ----------
    samples : list of Sample
    redundant : bool
        Whether constraints are redundant at the start: then Exudyn's solver for singular matrices is used.
    clock : EngineClock
        CPU time of Exudyn's steps and initial accelerations, without callbacks.

    Parameters
    ----------
    model : Model
    guides : list of FrictionalGuide
        Those with a load of their own in the model; none, and nothing of Python runs within a step.
    dt : float
        Step in seconds; shorter ones end at switches and lead back to the grid k dt.
    settings : exudyn.SimulationSettings
    record : callable, optional
        What to record of the guides at each sample; else (mode, friction, surface moment) of each of `guides`.
    before_step : callable, optional
        Called by Exudyn before each step, with the multipliers of the one before.
    """

    def __init__(self, model: Model, guides: list[FrictionalGuide], dt: float, settings: Any,
                 record: Callable[[], list[Any]] | None = None, before_step: Callable[[np.ndarray], None] | None = None):
        import exudyn

        self.model, self.guides, self.dt = model, guides, dt
        self.counters = Counters()
        self._record = record or (lambda: [(guide.mode, guide.friction, guide.surface_moment) for guide in guides])
        self.switches: list[Switch] = []
        self._settings, self._integration = settings, settings.timeIntegration
        self._system, self._data = model.system, model.system.systemData
        self._initial = exudyn.ConfigurationType.Initial
        self._start_of_step = exudyn.ConfigurationType.StartOfStep
        self._accelerated = [(model.rows[name][0], drive.law) for name, drive in model.scene.drives.items()
                             if not isinstance(drive.law, (Constant, Linear))]
        self._watching = self._violated = False
        self._repetitions = 0
        self.samples: list[Sample] = []
        self.clock = EngineClock()
        for guide in guides:
            guide.bind(model)
        if guides:
            self._system.SetPostNewtonUserFunction(self._post_newton)
        self._before_step = before_step
        if before_step is not None:
            self._system.SetPreStepUserFunction(self._pre_step)
        self._solver = exudyn.MainSolverImplicitSecondOrder()
        linear = settings.linearSolver
        self.redundant = False
        # a solver that bears redundant constraints first, to look for them; the other is faster
        linear.solverType, linear.ignoreSingularJacobian = exudyn.LinearSolverType.EigenDense, True
        self._initialize_solver()
        self._count = len(self._data.GetODE2Coordinates())
        jacobian = self._matrix()[self._count:, :self._count]
        self.redundant = self._find_redundancy(jacobian)
        if not self.redundant:
            linear.solverType, linear.ignoreSingularJacobian = exudyn.LinearSolverType.EXUdense, False
            self._initialize_solver()

    def _initialize_solver(self) -> None:
        if not self._solver.InitializeSolver(self._system, self._settings):
            raise EngineFailure(self._words("the solver could not be initialized"))

    def _find_redundancy(self, jacobian: np.ndarray) -> bool:
        """Return True where constraints are redundant at the start.

        Raises
        ------
        Declined
            If the reactions of a frictional guide are among those that the constraints leave open: its friction is then too.
        """
        active = np.flatnonzero(jacobian.any(axis=1))
        if not len(active) or (rank := np.linalg.matrix_rank(jacobian[active])) == len(active):
            return False
        open_ = np.abs(np.linalg.svd(jacobian[active])[0][:, rank:]).max(axis=1) > OPEN
        for guide in self.guides:
            if np.intersect1d(active[open_], guide.reaction_rows).size:
                raise Declined(f"joints.{guide.name}: the constraints are redundant and leave its reactions open, and with them its friction")
        return True

    def run(self, t_end: float, every: int) -> None:
        """Integrate from the scene's initial state; `samples` are at the grid's output instants, the last at t_end.

        Parameters
        ----------
        t_end : float
            Seconds; the last step is shorter where it is no multiple of dt.
        every : int
            Steps of the grid from sample to sample.

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
        q, v = self.model.initial_state()
        for guide in self.guides:
            speed = guide.slip_speed(q, v)
            guide.switch(0 if abs(speed) <= REST_SPEED else int(copysign(1, speed)), q)
        nothing = np.full(self._count, nan), np.full(len(self._data.GetAECoordinates()), nan)
        self.samples = samples = [Sample(0.0, q, v, *nothing, self._record())]  # what is known if there is no motion
        samples[0] = self._restart(0.0, q, v)
        transient: list[int] = []
        k, on_grid, recent = 0, True, 0
        while k < last:
            target = min(every * (k // every + 1), last if last == whole else max(whole, k + 1), last)
            if not on_grid:
                target = k + 1
                if target < last and grid[target] * self.dt - self._data.GetTime() < SHORTEST_STEP * self.dt:
                    if target % every == 0:
                        samples.append(self.switches[-1].after)
                    target += 1
            known = len(self.switches)
            self._advance(grid[target] * self.dt, target - k if on_grid else 1)
            position = self._data.GetTime() / self.dt
            recent = recent + 1 if len(self.switches) > known else 0
            if recent > MOST_SWITCHES:
                raise EngineFailure(f"more than {MOST_SWITCHES} switches of dry friction in the step at "
                                    f"t = {k * self.dt:g} s: they accumulate, or no contact mode is consistent")
            if position < grid[target] - 1e-9:  # stopped before: at a switch, or behind one that was none
                k = max(k, int(position + 1e-9))
                on_grid = abs(position - k) < 1e-9
                continue
            k, on_grid = target, True
            if k % every == 0 or k == last:
                samples.append(self._sample())
                restarted = self.switches[-1].after.t if self.switches else 0.0
                if self.guides and samples[-1].t - restarted < TRANSIENT * self.dt:
                    transient.append(len(samples) - 1)
        self.counters.newton = self._solver.it.newtonStepsCount
        for i in transient:
            samples[i] = self._consistent(samples[i])

    def _advance(self, t1: float, steps: int) -> None:
        """Steps from the present state to t1, or to the first switch, which is then done."""
        t0 = self._data.GetTime()
        self._watching = True
        if self._steps(t0, t1, steps):
            return
        start = self._data.GetTime(self._start_of_step)
        q = np.array(self._data.GetODE2Coordinates(self._start_of_step))
        v = np.array(self._data.GetODE2Coordinates_t(self._start_of_step))
        self._watching = False
        self._locate(start, q, self._on_velocity_constraints(start, q, v), (t1 - t0) / steps)

    def _steps(self, t0: float, t1: float, steps: int) -> bool:
        """Steps of equal length; False if a violated mode stopped them."""
        iteration = self._solver.it
        iteration.startTime = iteration.currentTime = t0
        iteration.endTime, iteration.maxStepSize = t1, (t1 - t0) / steps
        self._solver.it = iteration
        self._integration.endTime = t1
        self._violated, self._repetitions = False, 0
        done = self.clock.call(self._solver.SolveSteps, self._system, self._settings)
        self.counters.steps += self._solver.it.currentStepIndex - 1
        if not done and not self._violated:
            t = self._data.GetTime()
            if self._repetitions >= FRICTION_REPETITIONS:
                raise Unsettled(f"friction and reactions do not settle at t = {t:g} s: no solution, or several", t)
            if self.redundant:
                raise EngineFailure(f"the constraints are redundant, and Exudyn finds no state at t = {t:g} s that meets them all: they contradict")
            raise EngineFailure(self._words(f"no convergence at t = {t:g} s"))
        return done

    def _locate(self, t: float, q: np.ndarray, v: np.ndarray, step: float) -> None:
        """Find the first end of a mode in a step from (t, q, v) and switch there; if there is none after all, step."""

        def margins(h: float) -> list[float]:
            self._start(t, q, v)
            if h > 0.0:
                self._steps(t, t + h, 1)
            state = np.array(self._data.GetODE2Coordinates()), np.array(self._data.GetODE2Coordinates_t())
            if h > 0.0 and sticking:
                # of the state, not of the step: multipliers of a first step are off by O(h); speeds are those that it is started with
                state = state[0], self._on_velocity_constraints(t + h, *state)
                self._start(t + h, *state)
            return [guide.margin(*state) for guide in self.guides]

        sticking = any(guide.mode == 0 for guide in self.guides)
        lower = 0.0
        if min(margins(0.0)) <= 0.0:  # a mode that has just begun: its margin rises first
            lower = step
            while min(margins(lower)) <= 0.0 and lower > SHORTEST_STEP * step:
                lower *= 0.5
        if min(margins(step)) >= 0.0:
            return
        if min(margins(lower)) > 0.0:
            lower = brentq(lambda h: min(margins(h)), lower, step, xtol=1e-12 * step)
        ended = self.guides[int(np.argmin(margins(lower)))]
        modes = [guide.mode for guide in self.guides]
        before = self._consistent(self._sample())
        if ended.mode:
            # the one that ended may have passed zero within SHORTEST_STEP of another's switch, too soon to be distinguished from that
            self._stop(before, [guide for guide in self.guides if guide.mode
                                and (guide is ended or abs(guide.slip_speed(before.q, before.v)) <= REST_SPEED)])
        else:
            ended.switch(int(-copysign(1, ended.friction)))
        after = self._restart(before.t, before.q, before.v)
        for guide, old in zip(self.guides, modes):
            if guide.mode != old:
                kind = "slip" if old == 0 else "stick" if guide.mode == 0 else "reversal"
                self.switches.append(Switch(kind, guide.name, before, after))
        self.counters.switches += 1

    def _stop(self, state: Sample, guides: list[FrictionalGuide]) -> None:
        """Sliders that came to rest: they turn round if static friction lets them, else they stick.

        Holding them and looking at the force instead would fail where a slider only turns round because the
        mechanism does (a dead centre): there no force holds it.
        """
        for guide in guides:
            guide.switch(-guide.mode)
            guide.coefficient = guide.mus
        a, _ = self._start(state.t, state.q, state.v)
        turns = [guide.mode * guide.slip_acceleration(state.q, state.v, a) > 0.0 for guide in guides]
        for guide in guides:
            guide.coefficient = guide.joint.mu
            if not all(turns):
                guide.switch(0, state.q)

    def _restart(self, t: float, q: np.ndarray, v: np.ndarray) -> Sample:
        """Begin at a state, releasing the sticking sliders that friction cannot hold, the most overloaded first."""
        while True:
            held = [guide for guide in self.guides if guide.mode == 0]
            on_constraints = self._on_velocity_constraints(t, q, v)
            if held and not self._independent(held):
                names = ", ".join(guide.name for guide in held)
                raise Declined(f"at t = {t:g} s the sliders of {names} stick and hold the same motion: their shares are open, "
                              "and the adapter holds each by a constraint of its own")
            a, multipliers = self._start(t, q, on_constraints)
            overloaded = min(held, key=lambda guide: guide.margin(q, v), default=None)
            if overloaded is None or overloaded.margin(q, v) >= -ROUNDING:
                return Sample(t, q, on_constraints, a, multipliers, self._record())
            overloaded.switch(int(-copysign(1, overloaded.friction)))

    def _independent(self, held: list[FrictionalGuide]) -> bool:
        """Return, by connector that holds a slider, True where it adds to the rank of the constraints."""
        jacobian = self._matrix()[self._count:, :self._count]
        others = np.delete(jacobian, [guide.hold_row for guide in held], axis=0)
        return np.linalg.matrix_rank(jacobian) == np.linalg.matrix_rank(others) + len(held)

    def _start(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Set the state, with accelerations and multipliers that belong to it, friction included; returns these."""
        self.counters.restarts += 1
        self._set_state(t, q, v)
        for _ in range(FRICTION_REPETITIONS):
            self._initialize()
            a, multipliers = np.array(self._data.GetODE2Coordinates_tt()), np.array(self._data.GetAECoordinates())
            if self._accelerated:
                change = self._solve({row: evaluate_law(law, t)[2] for row, law in self._accelerated})
                a, multipliers = a + change[:self._count], multipliers + change[self._count:]
            if max((guide.renew(multipliers) for guide in self.guides), default=0.0) <= FRICTION_TOLERANCE:
                break
        else:
            raise Unsettled(f"friction and reactions do not settle at t = {t:g} s: no solution, or several", t)
        if self._accelerated:
            self._data.SetODE2Coordinates_tt(a, configuration=self._initial)
            self._integration.generalizedAlpha.computeInitialAccelerations = False
            self._initialize()
            self._integration.generalizedAlpha.computeInitialAccelerations = True
        return a, multipliers

    def _set_state(self, t: float, q: np.ndarray, v: np.ndarray) -> None:
        self._data.SetODE2Coordinates(q, configuration=self._initial)
        self._data.SetODE2Coordinates_t(v, configuration=self._initial)
        self._integration.startTime = t
        self._data.SetTime(t, self._initial)

    def _consistent(self, sample: Sample) -> Sample:
        """The sample with the accelerations and multipliers that belong to its state and contact modes."""
        for guide, (mode, *_) in zip(self.guides, sample.guides):
            guide.switch(mode, sample.q)
        a, multipliers = self._start(sample.t, sample.q, self._on_velocity_constraints(sample.t, sample.q, sample.v))
        return replace(sample, a=a, multipliers=multipliers, guides=self._record())

    def _on_velocity_constraints(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The velocities changed least (in kinetic energy) so that they meet the constraints, held sliders at rest.

        Index 3 leaves a velocity residual; a restart would turn it into an impulse of the multipliers.
        """
        self._set_state(t, q, v)
        self._initialize()
        self._solver.ComputeAlgebraicEquations(self._system, True)
        residual = np.array(self._solver.GetSystemResidual())[self._count:]
        idle = [guide.hold_row for guide in self.guides if guide.mode]
        return v + self._solve({row: -value for row, value in enumerate(residual) if row not in idle})[:self._count]

    def _solve(self, right: dict[int, float]) -> np.ndarray:
        """x of [M C_q^T; C_q 0] x = [0; right] at the present state; least squares if constraints are redundant."""
        system = self._matrix()
        vector = np.zeros(len(system))
        for row, value in right.items():
            vector[self._count + row] = value
        return np.linalg.lstsq(system, vector, rcond=None)[0]

    def _matrix(self) -> np.ndarray:
        """[M C_q^T; C_q 0], with 1 on the diagonal for connectors that are not active."""
        self._solver.SetSystemJacobian(np.zeros_like(np.array(self._solver.GetSystemJacobian())))
        self._solver.ComputeJacobianAE(self._system, 1.0, 1.0, 1.0, False)
        system = np.array(self._solver.GetSystemJacobian())
        system[:self._count, :self._count] += np.array(self._solver.GetSystemMassMatrix())
        return system

    def _pre_step(self, system: Any, t: float) -> bool:
        """Exudyn's hook before each step; True: go on."""
        self.clock.call_back(self._prepare_step)
        return True

    def _post_newton(self, system: Any, t: float) -> list[float]:
        """Exudyn's hook after each Newton solution of a step: [error, recommended step]; error > 0 repeats the step."""
        return self.clock.call_back(self._renewed)

    def _prepare_step(self) -> None:
        self._before_step(np.array(self._data.GetAECoordinates()))

    def _initialize(self) -> None:
        """Accelerations and multipliers of the initial state, by Exudyn."""
        self.clock.call(self._solver.InitializeSolverInitialConditions, self._system, self._settings)

    def _renewed(self) -> list[float]:
        multipliers = self._data.GetAECoordinates()
        self._repetitions += 1
        if max([guide.renew(multipliers) for guide in self.guides]) > FRICTION_TOLERANCE:
            return [1.0, -1.0]
        self._repetitions = 0
        if self._watching:
            q, v = self._data.GetODE2Coordinates(), self._data.GetODE2Coordinates_t()
            if min([guide.margin(q, v) for guide in self.guides]) < -ROUNDING:
                self._violated = True
                return [1.0, 0.0]
        return [0.0, -1.0]

    def _sample(self) -> Sample:
        data = self._data
        sample = Sample(data.GetTime(), np.array(data.GetODE2Coordinates()), np.array(data.GetODE2Coordinates_t()),
                        np.array(data.GetODE2Coordinates_tt()), np.array(data.GetAECoordinates()), self._record())
        if not (np.isfinite(sample.q).all() and np.isfinite(sample.v).all() and np.isfinite(sample.a).all()):
            raise EngineFailure(self._words(f"the state is not finite at t = {sample.t:g} s"))
        return sample

    def _words(self, what: str) -> str:
        return f"{what}; {self._solver.GetErrorString()}".rstrip("; ")
