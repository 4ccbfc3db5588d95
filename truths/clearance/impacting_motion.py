"""Event-driven motion of a slider in a gap: free flight, impacts, sliding and sticking contact, take-off.

Between events the corners have constant states (`CornerState`), and the equations of motion are smooth:

    M v' = f + W' lambda ,    u_N' = 0 at closed corners ,
    u_T' = 0 at sticking ones ,    T = -mu s N at slipping ones.

DOP853 integrates them with short steps. Within each step the guards of the states are sampled on its dense output: the
gaps of open corners, the normal forces of closed ones, the slip velocities of slipping ones, and mu N -+ T of sticking
ones. The first guard that becomes negative ends the phase; its root is found by Brent's method, and the state there by
one more integration from the begin of the step. A gap is also examined at the minimum between two samples, where u_N
changes its sign, so that no impact is passed over.

A gap that closes leads to an impact. All corners in contact take part in it, simultaneously, by the law of
`corner_law`: u_N+ = -e u_N- where an impulse acts. Any other guard, and every impact, is followed by a search for the
states that the accelerations allow. The equations are solved by enumeration, so that no solution or several different
ones end the motion by an error (`NoMotion`).

At a limit between two states, for example where a normal force reaches zero, several combinations of states are the
same motion at this instant. The one is taken that still fulfils the law a short time later.

Chatter. With 0 < e < 1 a corner that is pressed on its surface hits it infinitely often in a finite time. A corner that
leaves with the speed e v and has the acceleration -p returns after 2 e v / p, and rises by h = (e v)^2 / (2 p). If
h < `LOWEST_FLIGHT` for all corners that hit, and they remain closed without restitution, the impact is completed: they
come to rest on the surface at once. What is left out lasts 2 e v / (p (1 - e)) and displaces nothing by more than h.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853, DenseOutput, solve_ivp
from scipy.optimize import brentq

from stiction.truths.clearance.corner_law import (
    AT_REST,
    CornerState,
    Reactions,
    reactions_in,
    solutions,
    states_of_slip,
)
from stiction.truths.clearance.mechanisms import CORNERS, GapMechanism
from stiction.truths.reduced.piecewise_smooth import NoMotion

States = tuple[CornerState, ...]
"""States of the four corners."""
Derivative = Callable[[float, np.ndarray], np.ndarray]
"""Right side of the equations of motion, of t and y = (q, v, work of friction)."""
OPEN: States = (CornerState.OPEN,) * CORNERS
"""All corners are open."""
LOWEST_FLIGHT = 1e-14
"""Height, m, below which the flight of a corner after an impact is left out: some hundred roundings of a gap."""
TOUCHING = 1e-12
"""Gap, m, below which a corner takes part in an impact of another one.

Corners that hit at the same time in exact arithmetic differ by the errors of the integration, some 1e-15 m. Two impacts
in succession have another result than a simultaneous one; `Impact.next_gap` shows how near an impact is to this.
"""
_RTOL, _ATOL = 1e-13, 1e-16
"""Tolerances of a step of DOP853: near the rounding of coordinates of order 1."""
_REST_SPEED = 1e-9
"""Speed of slip or of opening, m/s, that counts as none after an event.

It is far above the rounding of velocities of 100 m/s; a correction of this size is part of the error of the motion.
"""
_SAMPLES = 8
"""Number of intervals of a step between whose ends guards are compared."""
_ROOT = 4 * np.finfo(float).eps
"""Relative tolerance of the time of an event."""
_TRIAL = 0.01
"""Time, in longest steps, after which states that are the same motion at an event are told apart.

Forces change by 1e-4 of their size in this time, as a longest step is about a hundredth of the time scale of a motion.
"""
_TIME_ROUNDING = 1e-18
"""Absolute tolerance of the time of an event, s: below the rounding of times of a millisecond."""
_GAP_ROUNDING = 1e-15
"""Depth of a minimum of a gap below zero, m, that counts as rounding of coordinates of order 1."""
_APPROACH = 1e-11
"""Speed, m/s, above which a corner whose gap is zero to rounding approaches its surface.

It is above the rounding of velocities, 1e-14, and far below the speeds of impacts that are not completed.
"""
_EVENT_LIMIT = 2_000
"""Number of events after which a motion is refused: they seem to accumulate."""
_CORRECTIONS = 2
"""Newton corrections of closed corners; their residual is 1e-12 m at most, so that one is enough, and two are safe."""


@dataclass(frozen=True)
class Impact:
    """One impact, of one corner or several at the same time.

    Attributes
    ----------
    time : float
        Time, s.
    q : ndarray, shape (n,)
        Coordinates.
    v_before, v_after : ndarray, shape (n,)
        Velocities on both sides.
    corners : tuple of int
        Corners that take part, from 0: those that hit, and those that are in contact.
    states : tuple of CornerState
        State of each of them during the impact.
    normal_before, normal_after : ndarray, shape (4,)
        Rates u_N of the gaps of all corners, m/s.
    slip_before, slip_after : ndarray, shape (4,)
        Slip velocities u_T of all corners, m/s.
    normal_impulse, friction_impulse : ndarray, shape (4,)
        Impulses, N s.
    restitution : float
        Coefficient of restitution: that of the gap, or 0 for a completed impact.
    momentum_residual : float
        Largest element of M (v+ - v-) - W' P, relative to the largest element of M v-.
    energy_residual : float
        Change of the kinetic energy minus P (u+ + u-)/2, relative to the kinetic energy.
    energy_change : float
        Change of the kinetic energy, J.
    next_gap : float
        Smallest gap, m, of the corners that do not take part.
    """

    time: float
    q: np.ndarray
    v_before: np.ndarray
    v_after: np.ndarray
    corners: tuple[int, ...]
    states: tuple[CornerState, ...]
    normal_before: np.ndarray
    normal_after: np.ndarray
    slip_before: np.ndarray
    slip_after: np.ndarray
    normal_impulse: np.ndarray
    friction_impulse: np.ndarray
    restitution: float
    momentum_residual: float
    energy_residual: float
    energy_change: float
    next_gap: float

    @property
    def speed(self) -> float:
        """Largest speed at which a corner hits, m/s."""
        return float(np.max(-self.normal_before[list(self.corners)], initial=0.0))


@dataclass(frozen=True)
class Phase:
    """A part of a motion in which the corners keep their states.

    Attributes
    ----------
    start, end : float
        The interval of time, s.
    states : tuple of CornerState
        States of the corners.
    steps : tuple of DenseOutput
        Steps of the integration; the last one may extend beyond the end.
    energy_residual : float
        Energy at the end minus that at the start minus the work of friction, J.
    drift : float
        Largest correction of q or v at the start of the phase, m or m/s.
    """

    start: float
    end: float
    states: States
    steps: tuple[DenseOutput, ...]
    energy_residual: float
    drift: float


@dataclass(frozen=True)
class Forces:
    """Forces of all corners in one state.

    Attributes
    ----------
    normal, friction : ndarray, shape (4,)
        Normal forces and frictions, N.
    slip : ndarray, shape (4,)
        Slip velocities u_T, m/s; zero in free flight, where they are not needed.
    acceleration : ndarray, shape (n,)
        Accelerations of the coordinates.
    """

    normal: np.ndarray
    friction: np.ndarray
    slip: np.ndarray
    acceleration: np.ndarray


@dataclass(frozen=True)
class ImpactingMotion:
    """A motion of a mechanism from t = 0 to `t_end`, s.

    Attributes
    ----------
    mechanism : GapMechanism
        The mechanism.
    phases : tuple of Phase
        Phases in the order of time, without gaps.
    impacts : tuple of Impact
        Impacts in the order of time.
    t_end : float
        End of the motion, s.
    """

    mechanism: GapMechanism
    phases: tuple[Phase, ...]
    impacts: tuple[Impact, ...]
    t_end: float

    def phase_at(self, t: float, side: str = "after") -> Phase:
        """Return the phase at a time, s; at an event the one on a side, ``"before"`` or ``"after"``."""
        starts = [phase.start for phase in self.phases]
        later = int(np.searchsorted(starts, t, side="right" if side == "after" else "left"))
        return self.phases[max(0, later - 1)]

    def state(self, t: float, side: str = "after") -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates and velocities at a time, s; at an impact those on a side.

        Raises
        ------
        ValueError
            For a time outside of the motion.
        """
        if not 0.0 <= t <= self.t_end:
            raise ValueError(f"t: found {t:g} s; expected a time within 0 .. {self.t_end:g} s")
        phase = self.phase_at(t, side)
        starts = [step.t_min for step in phase.steps]
        step = phase.steps[max(0, int(np.searchsorted(starts, t, side="right")) - 1)]
        y = step(t)
        n = len(y) // 2
        return y[:n], y[n : 2 * n]

    def forces(self, t: float, side: str = "after") -> Forces:
        """Return the forces of the corners at a time, s, without impulses; at an event those on a side."""
        q, v = self.state(t, side)
        return forces_in(self.mechanism, self.phase_at(t, side).states, q, v)


def forces_in(mechanism: GapMechanism, states: States, q: np.ndarray, v: np.ndarray) -> Forces:
    """Return the forces of the corners in given states.

    Raises
    ------
    NoMotion
        If the states do not determine them.
    """
    free_acceleration = np.linalg.solve(mechanism.mass(q), mechanism.force(q, v))
    if states == OPEN:
        none = np.zeros(CORNERS)
        return Forces(none, none, none, free_acceleration)
    problem = _ContactProblem.of(mechanism, q, v, range(CORNERS), free_acceleration)
    reactions = reactions_in(states, problem.response, problem.free, mechanism.gap.mu)
    if reactions is None:
        raise NoMotion("the forces of the corners are not determined", 0.0)
    acceleration = free_acceleration + problem.change(reactions)
    slip = problem.rows[CORNERS:] @ v
    return Forces(reactions.normal, reactions.friction, slip, acceleration)


@dataclass(frozen=True)
class _ContactProblem:
    """Response of the accelerations of some corners to their forces.

    Attributes
    ----------
    response : ndarray, shape (2 k, 2 k)
        Accelerations per force, normal directions first; also velocities per impulse.
    free : ndarray, shape (2 k,)
        Accelerations without forces, m/s^2.
    rows : ndarray, shape (2 k, n)
        Directions of the forces in the coordinates.
    inverse_rows : ndarray, shape (n, 2 k)
        Accelerations of the coordinates per force.
    """

    response: np.ndarray
    free: np.ndarray
    rows: np.ndarray
    inverse_rows: np.ndarray

    @classmethod
    def of(
        cls,
        mechanism: GapMechanism,
        q: np.ndarray,
        v: np.ndarray,
        corners: Sequence[int],
        free_acceleration: np.ndarray,
    ) -> _ContactProblem:
        """Return the problem of some corners, from the acceleration (n,) of the coordinates without contact."""
        kinematics = mechanism.corner_rows(q, v)
        chosen = list(corners)
        rows = np.vstack([kinematics.normal[chosen], kinematics.tangent[chosen]])
        bias = np.concatenate([kinematics.normal_bias[chosen], kinematics.tangent_bias[chosen]])
        inverse_rows = np.linalg.solve(mechanism.mass(q), rows.T)
        return cls(rows @ inverse_rows, rows @ free_acceleration + bias, rows, inverse_rows)

    def change(self, reactions: Reactions) -> np.ndarray:
        """Return what reactions add to the accelerations, or to the velocities, of the coordinates."""
        return self.inverse_rows @ np.concatenate([reactions.normal, reactions.friction])


def impacting_motion(
    mechanism: GapMechanism,
    q: np.ndarray,
    v: np.ndarray,
    t_end: float,
    longest_step: float,
    impacts: int | None = None,
) -> ImpactingMotion:
    """Return the motion of a mechanism.

    Parameters
    ----------
    mechanism : GapMechanism
        The mechanism.
    q, v : ndarray, shape (n,)
        Coordinates and velocities at t = 0; no corner may be beyond its surface.
    t_end : float
        End of the motion, s.
    longest_step : float
        Longest step, s. It bounds the error of the dense output, and the time between two samples of a guard.
    impacts : int, optional
        Number of impacts after which the motion ends, at the next impact; None for no limit.

    Raises
    ------
    NoMotion
        If the law of contact has no solution or several, or if events accumulate.
    """
    return _Integration(mechanism, t_end, longest_step, impacts).run(q, v)


class _Integration:
    """The integration of one motion."""

    def __init__(
        self, mechanism: GapMechanism, t_end: float, longest_step: float, impact_limit: int | None
    ) -> None:
        self.mechanism = mechanism
        self.t_end = t_end
        self.longest_step = longest_step
        self.impact_limit = impact_limit
        self.phases: list[Phase] = []
        self.impacts: list[Impact] = []

    def run(self, q: np.ndarray, v: np.ndarray) -> ImpactingMotion:
        """Return the motion from the state at t = 0."""
        q, v = np.array(q, dtype=float), np.array(v, dtype=float)
        if np.min(self.mechanism.gaps(q)) < -TOUCHING:
            raise ValueError("q: a corner is beyond its surface at the start; expected gaps >= 0")
        t = 0.0
        # A corner that starts on its surface and moves into it is an impact at t = 0.
        if self._is_hit(q, v):
            v = self._impact(t, q, v, OPEN)
        states = self._next_states(t, q, v)
        for _ in range(_EVENT_LIMIT):
            t, q, v, is_closing = self._phase(t, q, v, states)
            if t >= self.t_end:
                break
            # A corner whose flight was too low to be resolved is on its surface without an impact.
            if is_closing and self._is_hit(q, v):
                if self.impact_limit is not None and len(self.impacts) >= self.impact_limit:
                    break
                v = self._impact(t, q, v, states)
            states = self._next_states(t, q, v)
        else:
            raise NoMotion(f"more than {_EVENT_LIMIT} events", t)
        return ImpactingMotion(self.mechanism, tuple(self.phases), tuple(self.impacts), t)

    # Impacts

    def _is_hit(self, q: np.ndarray, v: np.ndarray) -> bool:
        """Return whether a corner on its surface moves into it."""
        kinematics = self.mechanism.corner_rows(q, v)
        return bool(np.any((kinematics.gap <= TOUCHING) & (kinematics.normal @ v < -_REST_SPEED)))

    def _impact(self, t: float, q: np.ndarray, v: np.ndarray, states: States) -> np.ndarray:
        """Record the impact at (t, q, v), and return the velocities after it; `states` are those before it."""
        gap = self.mechanism.gaps(q)
        corners = [i for i in range(CORNERS) if gap[i] <= TOUCHING or states[i].is_closed]
        problem = _ContactProblem.of(self.mechanism, q, v, corners, np.zeros_like(v))
        velocity = problem.rows @ v
        approach = np.minimum(velocity[: len(corners)], 0.0)
        restitution = self.mechanism.gap.restitution
        if self._is_end_of_chatter(t, q, v, corners):
            restitution = 0.0
        reactions = self._impact_reactions(t, problem, velocity, approach, restitution)
        v_after = v + problem.change(reactions)
        self.impacts.append(
            self._record(t, q, v, v_after, corners, reactions, problem, restitution)
        )
        return v_after

    def _impact_reactions(
        self,
        t: float,
        problem: _ContactProblem,
        velocity: np.ndarray,
        approach: np.ndarray,
        restitution: float,
    ) -> Reactions:
        """Return the impulses of the corners of an impact, from their velocities (normal, tangential) before it."""
        k = len(approach)
        free = velocity.copy()
        free[:k] += restitution * approach
        mu = self.mechanism.gap.mu
        motion = self._only_motion(t, problem.response, free, mu, [AT_REST] * k, [True] * k)
        return motion[0]

    def _is_end_of_chatter(
        self, t: float, q: np.ndarray, v: np.ndarray, corners: list[int]
    ) -> bool:
        """Return whether the flights after an impact of some corners would be too low to be resolved."""
        problem = _ContactProblem.of(self.mechanism, q, v, corners, np.zeros_like(v))
        velocity = problem.rows @ v
        approach = np.minimum(velocity[: len(corners)], 0.0)
        is_hitting = approach < -_APPROACH
        hitting = [corner for corner, hits in zip(corners, is_hitting) if hits]
        # Without restitution the corners must remain on their surfaces.
        reactions = self._impact_reactions(t, problem, velocity, approach, 0.0)
        v_after = v + problem.change(reactions)
        states = self._next_states(t, q, v_after)
        if not hitting or not all(states[i].is_closed for i in hitting):
            return False
        # With restitution they fly under the acceleration that they have without their own contact.
        flying = tuple(
            CornerState.OPEN if i in hitting else state for i, state in enumerate(states)
        )
        acceleration = forces_in(self.mechanism, flying, q, v_after).acceleration
        kinematics = self.mechanism.corner_rows(q, v_after)
        pressing = -(kinematics.normal @ acceleration + kinematics.normal_bias)[hitting]
        leaving = self.mechanism.gap.restitution * approach[is_hitting]
        return bool(np.all(leaving**2 <= 2.0 * LOWEST_FLIGHT * pressing))

    def _record(
        self,
        t: float,
        q: np.ndarray,
        v: np.ndarray,
        v_after: np.ndarray,
        corners: list[int],
        reactions: Reactions,
        problem: _ContactProblem,
        restitution: float,
    ) -> Impact:
        """Return the record of an impact, with its balances."""
        mechanism = self.mechanism
        kinematics = mechanism.corner_rows(q, v)
        impulse = np.concatenate([reactions.normal, reactions.friction])
        normal_impulse, friction_impulse = np.zeros(CORNERS), np.zeros(CORNERS)
        normal_impulse[corners], friction_impulse[corners] = reactions.normal, reactions.friction
        momentum_before = mechanism.mass(q) @ v
        momentum = mechanism.mass(q) @ (v_after - v)
        mean_velocity = problem.rows @ (0.5 * (v + v_after))
        energy_change = 0.5 * float((v_after - v) @ mechanism.mass(q) @ (v_after + v))
        kinetic = 0.5 * float(v @ mechanism.mass(q) @ v)
        others = [i for i in range(CORNERS) if i not in corners]
        return Impact(
            t,
            q,
            v,
            v_after,
            tuple(corners),
            reactions.states,
            kinematics.normal @ v,
            kinematics.normal @ v_after,
            kinematics.tangent @ v,
            kinematics.tangent @ v_after,
            normal_impulse,
            friction_impulse,
            restitution,
            float(
                np.max(np.abs(momentum - problem.rows.T @ impulse))
                / np.max(np.abs(momentum_before))
            ),
            (energy_change - float(impulse @ mean_velocity)) / kinetic,
            energy_change,
            float(np.min(kinematics.gap[others], initial=np.inf)),
        )

    # States of the corners after an event

    def _next_states(self, t: float, q: np.ndarray, v: np.ndarray) -> States:
        """Return the states that the corners have from the state (q, v) at an event on."""
        kinematics = self.mechanism.corner_rows(q, v)
        opening, slip = kinematics.normal @ v, kinematics.tangent @ v
        touching = (kinematics.gap <= TOUCHING) & (opening <= _REST_SPEED)
        corners = [int(i) for i in np.flatnonzero(touching)]
        if not corners:
            return OPEN
        at_rest = [bool(abs(slip[i]) <= _REST_SPEED) for i in corners]
        choices = [
            AT_REST if rests else states_of_slip(int(np.sign(slip[i])))
            for i, rests in zip(corners, at_rest)
        ]
        acceleration = np.linalg.solve(self.mechanism.mass(q), self.mechanism.force(q, v))
        problem = _ContactProblem.of(self.mechanism, q, v, corners, acceleration)
        mu = self.mechanism.gap.mu
        motion = self._only_motion(t, problem.response, problem.free, mu, choices, at_rest)
        candidates = []
        for reactions in motion:
            all_states = list(OPEN)
            for corner, state in zip(corners, reactions.states):
                all_states[corner] = state
            candidates.append(tuple(all_states))
        if len(candidates) > 1:
            for states in candidates:
                if self._persists(t, q, v, states, corners):
                    return states
        return candidates[0]

    def _persists(
        self, t: float, q: np.ndarray, v: np.ndarray, states: States, corners: list[int]
    ) -> bool:
        """Return whether states of corners that touch still fulfil the law a short time later."""
        n = len(q)
        q, v, _ = self._on_surfaces(q, v, states)
        later = t + _TRIAL * self.longest_step
        y = _advanced(self._derivative(states, n), t, np.concatenate([q, v, [0.0]]), later)
        q, v = y[:n], y[n : 2 * n]
        forces = forces_in(self.mechanism, states, q, v)
        kinematics = self.mechanism.corner_rows(q, v)
        opening = kinematics.normal @ forces.acceleration + kinematics.normal_bias
        slip = kinematics.tangent @ v
        slack = self.mechanism.gap.mu * forces.normal - np.abs(forces.friction)
        for i in corners:
            state = states[i]
            if not state.is_closed and opening[i] < 0.0:
                return False
            if state.is_closed and forces.normal[i] < 0.0:
                return False
            if state is CornerState.STICK and slack[i] < 0.0:
                return False
            if state.direction * slip[i] < -_APPROACH:
                return False
        return True

    def _only_motion(
        self,
        t: float,
        response: np.ndarray,
        free: np.ndarray,
        mu: float,
        choices: Sequence[Sequence[CornerState]],
        slip_is_open: Sequence[bool],
    ) -> list[Reactions]:
        """Return the solutions of the law of the corners, which are one motion.

        Raises
        ------
        NoMotion
            If there is none, or if there are several motions.
        """
        motions = solutions(response, free, mu, choices, slip_is_open)
        if not motions:
            raise NoMotion("the law of the corners has no solution", t)
        if len(motions) > 1:
            raise NoMotion(f"the law of the corners has {len(motions)} solutions", t)
        return motions[0]

    # Phases

    def _phase(
        self, t: float, q: np.ndarray, v: np.ndarray, states: States
    ) -> tuple[float, np.ndarray, np.ndarray, bool]:
        """Integrate a phase from (t, q, v), and return time and state at its end, and whether a gap closes there."""
        n = len(q)
        start, start_energy = t, self.mechanism.energy(q, v)
        q, v, drift = self._on_surfaces(q, v, states)
        derivative = self._derivative(states, n)
        solver = DOP853(
            derivative,
            t,
            np.concatenate([q, v, [0.0]]),
            self.t_end,
            max_step=self.longest_step,
            rtol=_RTOL,
            atol=_ATOL,
        )
        guards = _Guards(self.mechanism, states)
        steps: list[DenseOutput] = []
        end, y, is_closing = t, solver.y, False
        while solver.status == "running":
            begin, y_begin = solver.t, solver.y
            message = solver.step()
            if solver.status == "failed":
                raise NoMotion(f"the integration fails: {message}", solver.t)
            dense = solver.dense_output()
            steps.append(dense)
            end, y = solver.t, solver.y
            event = guards.first_event(dense, begin, end, is_start=len(steps) == 1)
            if event is not None:
                end, is_closing = event
                y = _advanced(derivative, begin, y_begin, end)
                break
        q, v, work = y[:n], y[n : 2 * n], y[2 * n]
        residual = self.mechanism.energy(q, v) - start_energy - work
        self.phases.append(Phase(start, end, states, tuple(steps), residual, drift))
        return end, q, v, is_closing

    def _derivative(self, states: States, n: int) -> Derivative:
        """Return the right side of the equations of motion for y = (q, v, work of friction)."""

        def derivative(t: float, y: np.ndarray) -> np.ndarray:
            q, v = y[:n], y[n : 2 * n]
            forces = forces_in(self.mechanism, states, q, v)
            return np.concatenate([v, forces.acceleration, [forces.friction @ forces.slip]])

        return derivative

    def _on_surfaces(
        self, q: np.ndarray, v: np.ndarray, states: States
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the state with closed corners exactly on their surfaces and without velocity, and the correction.

        The correction is the smallest one in the norm of the mass matrix.
        """
        closed = [i for i, state in enumerate(states) if state.is_closed]
        if not closed:
            return q, v, 0.0
        sticking = [i for i, state in enumerate(states) if state is CornerState.STICK]
        q_new, v_new = q.copy(), v.copy()
        for _ in range(_CORRECTIONS):
            kinematics = self.mechanism.corner_rows(q_new, v_new)
            normal = kinematics.normal[closed]
            q_new -= _least_change(self.mechanism.mass(q_new), normal, kinematics.gap[closed])
        kinematics = self.mechanism.corner_rows(q_new, v_new)
        rows = np.vstack([kinematics.normal[closed], kinematics.tangent[sticking]])
        v_new -= _least_change(self.mechanism.mass(q_new), rows, rows @ v_new)
        drift = max(np.max(np.abs(q_new - q)), np.max(np.abs(v_new - v)))
        return q_new, v_new, float(drift)


def _least_change(mass: np.ndarray, rows: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Return the change d with ``rows d = residual`` that is smallest in the norm of the mass matrix.

    Rows may depend on each other: two corners that stick on one line have the same tangent.
    """
    inverse_rows = np.linalg.solve(mass, rows.T)
    multipliers = np.linalg.lstsq(rows @ inverse_rows, residual, rcond=None)[0]
    return inverse_rows @ multipliers


def _advanced(derivative: Derivative, t: float, y: np.ndarray, t_end: float) -> np.ndarray:
    """Return the state at t_end, integrated from (t, y) by itself: more accurate than a dense output."""
    if t_end <= t:
        return y
    solution = solve_ivp(
        derivative, (t, t_end), y, method="DOP853", rtol=_RTOL, atol=_ATOL, t_eval=[t_end]
    )
    if not solution.success:
        raise NoMotion(f"the integration fails: {solution.message}", t)
    return solution.y[:, -1]


class _Guards:
    """Functions that are positive as long as the corners keep their states."""

    def __init__(self, mechanism: GapMechanism, states: States) -> None:
        self.mechanism = mechanism
        self.states = states
        self.open_corners = [i for i, state in enumerate(states) if not state.is_closed]

    def values(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the gaps of the open corners, m, and the other guards: forces, N, and slip speeds, m/s."""
        n = len(y) // 2
        q, v = y[:n], y[n : 2 * n]
        gaps = self.mechanism.gaps(q)[self.open_corners]
        if self.states == OPEN:
            return gaps, np.empty(0)
        forces = forces_in(self.mechanism, self.states, q, v)
        others: list[float] = []
        for i, state in enumerate(self.states):
            if not state.is_closed:
                continue
            others.append(forces.normal[i])
            if state is CornerState.STICK:
                bound = self.mechanism.gap.mu * forces.normal[i]
                others += [bound - forces.friction[i], bound + forces.friction[i]]
            elif CornerState.STICK not in self.states:
                # A slipping corner beside a sticking one has no slip velocity: it is the extreme share of the
                # friction of two sticking corners, see `corner_law`.
                others.append(state.direction * forces.slip[i])
        return gaps, np.array(others)

    def opening_rate(self, y: np.ndarray, index: int) -> float:
        """Return the rate of the gap of the open corner with the number `index` among the open ones, m/s."""
        n = len(y) // 2
        q, v = y[:n], y[n : 2 * n]
        return float(self.mechanism.corner_rows(q, v).normal[self.open_corners[index]] @ v)

    def first_event(
        self, dense: DenseOutput, begin: float, end: float, is_start: bool
    ) -> tuple[float, bool] | None:
        """Return the time of the first event in a step, s, and whether a gap closes there; None if there is none.

        `is_start` is True in the first step of a phase, where a guard may begin at zero.
        """
        times = np.linspace(begin, end, _SAMPLES + 1)
        gaps, others = zip(*(self.values(dense(t)) for t in times))
        for j in range(1, len(times)):
            interval = (times[j - 1], times[j])
            may_touch = is_start and j == 1
            events = [
                (root, True)
                for k in range(len(self.open_corners))
                if (root := self._closing(dense, interval, k, gaps[j - 1][k], gaps[j][k]))
                is not None
            ]
            events += [
                (self._root(dense, interval, k, others[j - 1][k]), False)
                for k in range(len(others[j]))
                if others[j][k] < 0.0 and (others[j - 1][k] > 0.0 or may_touch)
            ]
            if events:
                return min(events)
        return None

    def _root(
        self, dense: DenseOutput, interval: tuple[float, float], k: int, first: float
    ) -> float:
        """Return the time at which a guard other than a gap becomes negative."""
        if first <= 0.0:
            return interval[0]
        return float(
            brentq(
                lambda t: self.values(dense(t))[1][k], *interval, xtol=_TIME_ROUNDING, rtol=_ROOT
            )
        )

    def _closing(
        self,
        dense: DenseOutput,
        interval: tuple[float, float],
        k: int,
        first: float,
        last: float,
    ) -> float | None:
        """Return the time at which the gap of an open corner closes; None if it does not.

        The gap is negative at the end of the interval, or at a minimum within.
        """
        start, stop = interval
        rates = [self.opening_rate(dense(t), k) for t in interval]

        def gap(t: float) -> float:
            return float(self.values_of_gaps(dense(t))[k])

        def rate(t: float) -> float:
            return self.opening_rate(dense(t), k)

        if rates[0] < 0.0 < rates[1]:
            stop = float(brentq(rate, start, stop, xtol=_TIME_ROUNDING, rtol=_ROOT))
            if gap(stop) >= -_GAP_ROUNDING:
                return None
        elif last >= 0.0 or rates[1] > -_APPROACH:
            return None
        if rates[0] > 0.0 > rates[1]:
            # The corner rises first, perhaps from its surface: it returns after the maximum of the gap.
            start = float(brentq(rate, start, stop, xtol=_TIME_ROUNDING, rtol=_ROOT))
            # The flight is so low that the gap is zero to rounding: it ends at once.
            if gap(start) <= 0.0:
                return start
        elif first <= 0.0:
            return start
        return float(brentq(gap, start, stop, xtol=_TIME_ROUNDING, rtol=_ROOT))

    def values_of_gaps(self, y: np.ndarray) -> np.ndarray:
        """Return the gaps of the open corners, m."""
        return self.mechanism.gaps(y[: len(y) // 2])[self.open_corners]
