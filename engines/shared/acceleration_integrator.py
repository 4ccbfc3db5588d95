"""An engine's accelerations under an integrator of high order that locates events.

It separates the error of an engine's equations of motion from the error of its steps. The engine computes
accelerations in joint coordinates, which satisfy the constraints by themselves. The friction of the guides is computed
here, from the reactions that belong to these accelerations; the integrator is SciPy's DOP853. In a contact mode,
frictions are linear functions of the reactions, and reactions of the frictions. An event is an instant at which an
event function of `stiction.reference_impl.friction.frozen_mode` falls through zero; event functions are sampled at some
instants of each step.

Symbols: y = (x, x') is the state, with the free coordinates x of the links and their rates. `m` are the arrays of the
mechanism and `w` is its workspace, as in `stiction.engines.shared.step_kernels`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from stiction.engines.protocol import Engine, EngineFailure, Refused
from stiction.engines.reference.engine import output_times
from stiction.engines.shared.engine_clock import EngineClock
from stiction.engines.shared.fixed_step import columns_of_motion
from stiction.engines.shared.joint_coordinates import motors_of
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.step_kernels import Balance, applied_loads, assemble, row_forces
from stiction.reference_impl.compiled.kernel import link_kernels
from stiction.reference_impl.friction.coulomb import friction_coefficients
from stiction.reference_impl.friction.frozen_mode import ALL, choose_branches, event_functions
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Cost, Event, Trajectory
from stiction.scenes.event_values import rows_of
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.laws import evaluate_law

METHOD = "accelerations"
"""The setting `method` of the engines that offer this."""
FRICTION_LAW = (
    "Coulomb with located events, bound mu (|n1| + |n2|) from the balance of momentum (adapter)"
)
DEFAULT_TOLERANCE = 1e-9
"""Relative tolerance where none is given; that of the reference implementation."""
_SAMPLES = 8
"""Intervals of a step at whose ends event functions are evaluated. A function that falls below zero and rises again
within an interval is not noticed; steps of DOP853 are short compared with changes of the motion."""
_MAX_EVENTS_AT_ONCE = 100
"""Largest number of events at the same instant. A scene has a few guides with three event functions each; a longer
sequence would never end."""
_EVENT_TOLERANCE = 1e-15
"""Absolute tolerance (s) of Brent's method for the instant of an event: the rounding of times of seconds. SciPy adds
its smallest relative tolerance."""
_SIGN_CORRECTIONS = 2
"""Number of times that the signs of corner forces are corrected. Other signs change the friction, which changes the
corner forces once more."""


Dynamics = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""An engine's mass matrix (links, links) and joint forces (links,) of a position, velocity and acceleration of the
links under gravity, each of shape (links,)."""


class _Instant(NamedTuple):
    """Solution of the equations of motion at a state in a contact mode.

    Attributes
    ----------
    second : ndarray, shape (n,)
        The second derivatives x''.
    friction : ndarray, shape (frictional,)
        The frictions, N.
    event : ndarray, shape (frictional, 3)
        The event functions of each guide: of its slip (or stick), and of its two corner pairs.
    """

    second: np.ndarray
    friction: np.ndarray
    event: np.ndarray


class TreeAccelerations:
    """Accelerations of a scene's tree of links by an engine's `dynamics`, with the friction of its guides.

    States y, shape (2 n,), are the free coordinates x of the links and their rates x'.

    Attributes
    ----------
    start : ndarray, shape (2 n,)
        The state at t = 0.
    slip, corner : ndarray, shapes (frictional,) and (frictional, 4)
        The contact mode: slip of each guide, -1, 0 (stick), 1, and signs of its corner forces.
    clock : EngineClock
        CPU time of the engine's own calls.
    calls : int
        Number of solutions so far.
    """

    dynamics: Dynamics

    def __init__(self, mechanism: Mechanism):
        scene = mechanism.scene
        self.tree = tree = LinkTree(scene)
        if tree.loops:
            raise Refused(
                f"joints.{tree.loops[0]}: closes a loop; inverse dynamics are those of a tree"
            )
        self.clock, self.calls = EngineClock(), 0
        position, velocity = tree.coordinates(scene)
        self._driven = motors_of(scene, tree, position)
        self._free = np.setdiff1d(np.arange(len(tree.links)), [link for link, *_ in self._driven])
        self.start = np.concatenate([position[self._free], velocity[self._free]])
        # For each frictional guide, the index of its coordinate in x, and -1 as its sign if the
        # coordinate decreases as the displacement grows, otherwise 1.
        links = [tree.link_of_joint[name] for name in scene.frictional_guides]
        self._guides = np.searchsorted(self._free, links)
        self._signs = np.array([tree.links[link].sign for link in links], dtype=float)
        self._balance = Balance.of(mechanism)
        self._loaded = bool(scene.springs or scene.forces)
        self.slip = np.sign(self._slip_speed(self.start)).astype(np.int64)
        self.corner = np.ones((len(links), 4), dtype=np.int64)

    def begin(self, t: float, y: np.ndarray) -> None:
        """Choose the contact mode at t (s): at the start, or where a law switches, which may release guides at rest.

        The rates of guides that stay at rest are set to zero in y.
        """
        for guide in np.flatnonzero(self.slip == 0).tolist():
            self._leave_rest(t, y, guide, may_stick=True)
        self._correct_signs(t, y)

    def compile(self) -> None:
        """Compile what the solutions call, or load it."""
        link_kernels(applied_loads, assemble, row_forces)

    def at(self, t: float, y: np.ndarray) -> _Instant:
        """Solve for the accelerations and frictions of a state in the present contact mode."""
        self.calls += 1
        count = len(self.slip)
        m, w = self._balance.m, self._balance.w
        second, mobility = self._without_friction(t, y)
        if not count:
            return _Instant(second, np.zeros(0), np.zeros((0, 3)))
        per_newton = mobility[:, self._guides] * self._signs
        constant, slope = self._reactions_by_friction(t, y, second, per_newton)
        friction = self._solve_friction(second, per_newton, constant, slope)
        # The event functions are those of the reference, which reads the forces from its workspace.
        rows = m.friction["row"]
        w.force[rows], w.force[rows + 1] = constant + slope @ friction
        w.force[m.rows :], w.slip_speed[:] = friction, self._slip_speed(y)
        choose_branches(m, w, self.slip, self.corner, ALL)
        event_functions(m, w, self.slip, self.corner)
        return _Instant(second + per_newton @ friction, friction, w.event.reshape(count, 3).copy())

    def _reactions_by_friction(
        self, t: float, y: np.ndarray, second: np.ndarray, per_newton: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the reactions of the frictional guides as linear functions of the frictions.

        Parameters
        ----------
        t, y : float, ndarray
            Time (s) and state.
        second : ndarray, shape (n,)
            x'' without friction.
        per_newton : ndarray, shape (n, frictional)
            x'' by a friction of one newton in each guide.

        Returns
        -------
        constant : ndarray, shape (2, frictional)
            Normal forces (N) and moments (N m) without friction.
        slope : ndarray, shape (2, frictional, frictional)
            Their changes by one newton in each guide.
        """
        count = len(self.slip)
        q, v, a = self._motion(t, y, second)
        assemble(self._balance, t, q, v, 0.0)
        constant = self._reactions(a, np.zeros(count))
        changes = []
        for added, newton in zip(per_newton.T, np.eye(count)):
            _, _, a = self._motion(t, y, second + added)
            changes.append(self._reactions(a, newton) - constant)
        return constant, np.stack(changes, axis=-1)

    def _solve_friction(
        self, second: np.ndarray, per_newton: np.ndarray, constant: np.ndarray, slope: np.ndarray
    ) -> np.ndarray:
        """Return the frictions (N) of the present contact mode; see `_reactions_by_friction` for the arguments."""
        # There is one equation for each guide. In stick its acceleration is zero. In slip its
        # friction is Coulomb's, which with the signs of the corner forces is linear in the reactions.
        m, signs, guides = self._balance.m, self._signs, self._guides
        matrix = np.eye(len(self.slip))
        right = np.zeros(len(self.slip))
        for i, direction in enumerate(self.slip):
            if direction == 0:
                matrix[i] = signs[i] * per_newton[guides[i]]
                right[i] = -signs[i] * second[guides[i]]
                continue
            s1, s2 = self.corner[i, :2]
            coefficients = np.array(
                friction_coefficients(m, i, direction, s1, s2, m.friction["mu"][i])
            )
            matrix[i] -= coefficients @ slope[:, i]
            right[i] = coefficients @ constant[:, i]
        return np.linalg.solve(matrix, right)

    def sample(self, t: float, y: np.ndarray) -> tuple[Any, ...]:
        """Return time, coordinates, velocities, accelerations of the bodies, modes and frictions at an instant."""
        instant = self.at(t, y)
        return t, *self._motion(t, y, instant.second), self.slip.copy(), instant.friction

    def first_event(
        self, curve: Callable[[float], np.ndarray], start: float, end: float
    ) -> tuple[float, int]:
        """Return the first instant at which an event function falls through zero, and the index of the function.

        Parameters
        ----------
        curve : callable
            The state by the time.
        start, end : float
            The times between which events are sought, s.

        Returns
        -------
        time : float
            The instant, s; `end` if there is no event.
        place : int
            Index of the function in the flattened `event` of the instant; -1 if there is no event.
        """
        if not len(self.slip):
            return end, -1
        times = np.linspace(start, end, _SAMPLES + 1)
        before = self.at(start, curve(start)).event.ravel()
        for low, high in pairwise(times):
            after = self.at(high, curve(high)).event.ravel()
            # A function that is not positive at the start of the step has just had its event: it
            # rises from there, or its mode ends at once. One that is not positive at a later instant
            # was found in the interval before.
            falls = np.flatnonzero((after < 0.0) & ((before > 0.0) | (low == start))).tolist()
            if falls:
                zeros = []
                for place in falls:
                    time_of_zero = low
                    if before[place] > 0.0:
                        time_of_zero = self._zero(curve, place, low, high)
                    zeros.append((time_of_zero, place))
                return min(zeros)
            before = after
        return end, -1

    def _zero(
        self, curve: Callable[[float], np.ndarray], place: int, low: float, high: float
    ) -> float:
        """Return the time (s) between low and high at which an event function vanishes."""

        def value(t: float) -> float:
            return self.at(t, curve(t)).event.flat[place]

        return brentq(value, low, high, xtol=_EVENT_TOLERANCE)

    def switch(self, t: float, y: np.ndarray, guide: int, place: int) -> None:
        """Change the contact mode after an event of a guide, in place.

        `place` is the index of the event function of the guide: 0 for slip or stick, 1 and 2 for its corners.
        """
        if self.slip[guide] and place:
            self.corner[guide, place - 1] *= -1
            self._correct_signs(t, y, fixed=(guide, place - 1))
        else:
            self._leave_rest(t, y, guide, may_stick=bool(self.slip[guide]))
            self._correct_signs(t, y)

    def _leave_rest(self, t: float, y: np.ndarray, guide: int, may_stick: bool) -> None:
        """Set the mode of a guide at rest: stick if it `may_stick` and static friction suffices, otherwise slip.

        The rate of the guide in y is set to zero.
        """
        # Try stick. The friction that it needs shows whether stick is possible, and otherwise in which
        # direction the slider goes.
        rates = y[len(y) // 2 :]
        rates[self._guides[guide]] = 0.0
        self.slip[guide] = 0
        instant = self.at(t, y)
        if not may_stick or instant.event[guide, :2].min() < 0.0:
            self.slip[guide] = -np.sign(instant.friction[guide])

    def _correct_signs(self, t: float, y: np.ndarray, fixed: tuple[int, int] | None = None) -> None:
        """Set the signs of the mode to those of the corner forces of sliders that slip.

        `fixed` is the guide and the corner pair whose sign is kept, if any.
        """
        for _ in range(_SIGN_CORRECTIONS):
            is_wrong = (self.at(t, y).event[:, 1:] < 0.0) & (self.slip != 0)[:, None]
            if fixed is not None:
                is_wrong[fixed] = False
            self.corner[:, :2][is_wrong] *= -1

    def _without_friction(self, t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x'' without friction, (n,), and x'' by a unit force on each coordinate, as columns, (n, n)."""
        # The engine's inverse dynamics yield the joint forces of a motion in which the free coordinates
        # are not accelerated. The opposite forces accelerate these coordinates.
        position, velocity, driven = self._joints(t, y, np.zeros(len(y) // 2))
        mass, holding_force = self.dynamics(position, velocity, driven)
        mobility = np.linalg.inv(mass[np.ix_(self._free, self._free)])
        force = -holding_force[self._free]
        # Loads on the bodies become joint forces by their power at a unit rate of each joint.
        if self._loaded:
            q, v, _ = self.tree.motion(position, velocity, driven)
            applied_loads(self._balance, t, q, v, 0.0)
            loads = self._balance.loads
            still = np.zeros(len(position))
            for i, unit in enumerate(np.eye(len(position))[self._free]):
                _, v, _ = self.tree.motion(position, unit, still)
                force[i] += v @ loads
        return mobility @ force, mobility

    def _reactions(self, a: np.ndarray, friction: np.ndarray) -> np.ndarray:
        """Return normal forces (N) and moments (N m) of the frictional guides, shape (2, frictional).

        They belong to accelerations of the bodies and these frictions (N) at the assembled instant. They are the
        solution by least squares in the metric of the masses, and of minimum norm.
        """
        balance = self._balance
        balance.given_friction[:] = friction
        row_forces(balance, a)
        rows = balance.m.friction["row"]
        return np.array([balance.force[rows], balance.force[rows + 1]])

    def _motion(self, t: float, y: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return coordinates, velocities and accelerations of the bodies, each of shape (3 * bodies,)."""
        return self.tree.motion(*self._joints(t, y, second))

    def _joints(self, t: float, y: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return coordinates, rates and accelerations of all joints; those of drives follow their laws."""
        joints = np.zeros((3, len(self.tree.links)))
        joints[:, self._free] = *np.split(y, 2), second
        for link, sign, law, offset in self._driven:
            joints[:, link] = sign * np.array(evaluate_law(law, t))
            joints[0, link] += offset
        return tuple(joints)

    def _slip_speed(self, y: np.ndarray) -> np.ndarray:
        """Return the slip speeds of the frictional guides, m/s."""
        return self._signs * y[len(y) // 2 :][self._guides]


class _Record:
    """What the integration of a motion yields.

    A sample contains time (s), coordinates, velocities, accelerations, modes and frictions; see
    `TreeAccelerations.sample`.

    Attributes
    ----------
    samples : list of tuple
        Samples at the output times.
    sides : list of tuple
        Samples before and after each event, in turn.
    switches : list of tuple of str
        Kind and guide of each event.
    steps : int
        Number of steps of the integrator.
    """

    def __init__(self) -> None:
        self.samples: list[tuple[Any, ...]] = []
        self.sides: list[tuple[Any, ...]] = []
        self.switches: list[tuple[str, str]] = []
        self.steps = 0

    def events(self, mechanism: Mechanism) -> tuple[Event, ...]:
        """Return the events with the columns on both sides."""
        if not self.switches:
            return ()
        rows = rows_of(_columns(mechanism, self.sides))
        return tuple(
            Event(self.sides[2 * i + 1][0], kind, guide, rows[2 * i], rows[2 * i + 1])
            for i, (kind, guide) in enumerate(self.switches)
        )


def integrate(
    accelerations: TreeAccelerations,
    mechanism: Mechanism,
    engine: Engine,
    *,
    t_end: float,
    rtol: float,
    output_step: float,
    setup_s: float,
) -> Trajectory:
    """Return the motion from t = 0 to t_end, with local errors of rtol (1 + |x|), in m, rad and their rates.

    `setup_s` is the CPU time (s) of making the accelerations.

    Raises
    ------
    EngineFailure
        If the step becomes too small, or contact modes follow each other without time passing.
    """
    setup_end = time.process_time()
    accelerations.compile()
    compile_end = time.process_time()
    accelerations.clock.start()
    record = _integrate_stretches(accelerations, mechanism, t_end, rtol, output_step)
    stepping_end = time.process_time()
    cost = Cost(
        setup_s,
        compile_end - setup_end,
        stepping_end - compile_end,
        {
            "steps": record.steps,
            "rhs": accelerations.calls,
            "events": len(record.switches),
        },
        accelerations.clock.engine_s,
    )
    return Trajectory(
        scene=mechanism.scene.name,
        engine=engine.name,
        version=engine.version,
        fidelity=Fidelity.JOINT,
        t=np.array([t for t, *_ in record.samples]),
        columns=_columns(mechanism, record.samples),
        events=record.events(mechanism),
        settings={"rtol": rtol, "method": METHOD, "friction_law": FRICTION_LAW},
        cost=cost,
    )


def _integrate_stretches(
    accelerations: TreeAccelerations,
    mechanism: Mechanism,
    t_end: float,
    rtol: float,
    output_step: float,
) -> _Record:
    """Integrate the motion stretch by stretch, and change the contact mode at each event.

    Between kinks of the laws of time and between events the right-hand side is smooth. A Runge-Kutta method keeps its
    order only there, so that each stretch is a problem of its own.
    """
    record = _Record()
    guides = list(mechanism.scene.frictional_guides)
    output = output_times(t_end, output_step)
    t = 0.0
    y = accelerations.start
    events_at_once = 0
    accelerations.begin(0.0, y)
    switches, _ = mechanism.switches(t_end)
    for stop in (*mechanism.kinks(t_end), t_end):
        while t < stop:
            begin = t
            t, y, event = _integrate_to_event(accelerations, record, output, t, y, stop, rtol)
            events_at_once = events_at_once + 1 if t <= begin else 0
            if events_at_once > _MAX_EVENTS_AT_ONCE:
                raise EngineFailure(
                    f"contact modes follow each other without time passing at t = {t:.9g} s"
                )
            if event < 0:
                continue
            # Change the mode, and record the event with its values in both modes.
            guide, place = divmod(event, 3)
            slip_before = accelerations.slip[guide]
            record.sides.append(accelerations.sample(t, y))
            accelerations.switch(t, y, guide, place)
            record.sides.append(accelerations.sample(t, y))
            kind = _kind(slip_before, accelerations.slip[guide])
            record.switches.append((kind, guides[guide]))
        if stop in switches:
            _cross_switch(accelerations, record, guides, stop, y)
    record.samples.append(accelerations.sample(t, y))
    return record


def _cross_switch(
    accelerations: TreeAccelerations, record: _Record, guides: list[str], t: float, y: np.ndarray
) -> None:
    """Choose the contact mode where a law of time switches (s), and record each guide whose mode changes."""
    before = accelerations.sample(np.nextafter(t, -np.inf), y)
    slip, corner = accelerations.slip.copy(), accelerations.corner.copy()
    accelerations.begin(t, y)
    after = accelerations.sample(t, y)
    for g, guide in enumerate(guides):
        changes_corner = accelerations.slip[g] != 0 and np.any(accelerations.corner[g] != corner[g])
        if accelerations.slip[g] != slip[g] or changes_corner:
            record.sides += [before, after]
            record.switches.append((_kind(slip[g], accelerations.slip[g]), guide))


def _integrate_to_event(
    accelerations: TreeAccelerations,
    record: _Record,
    output: np.ndarray,
    t: float,
    y: np.ndarray,
    stop: float,
    rtol: float,
) -> tuple[float, np.ndarray, int]:
    """Integrate in one contact mode to the first event, or to `stop` (s), and record samples at the `output` times (s).

    Returns
    -------
    t, y : float, ndarray
        Time (s) and state at the end.
    event : int
        Index of the event function as in `TreeAccelerations.first_event`; -1 if there is no event.
    """
    # Laws that jump at the stop have their limits from the left until there.
    latest = np.nextafter(stop, -np.inf)

    def right_hand_side(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[len(y) // 2 :], accelerations.at(min(t, latest), y).second])

    solver = DOP853(right_hand_side, t, y, stop, rtol=rtol, atol=rtol)
    event = -1
    while event < 0 and solver.status == "running":
        message = solver.step()
        if solver.status == "failed":
            raise EngineFailure(f"{message} (t = {solver.t:.9g} s)")
        record.steps += 1
        # The step ends at its first event, which is located on the dense output. Samples up to there
        # are evaluated in the mode of this step.
        curve = solver.dense_output()
        end, event = accelerations.first_event(curve, t, solver.t)
        for instant in output[(output >= t) & (output < end)]:
            record.samples.append(accelerations.sample(instant, curve(instant)))
        y = curve(end) if event >= 0 else solver.y
        t = end
    return t, y, event


def _columns(mechanism: Mechanism, samples: list[tuple[Any, ...]]) -> dict[str, np.ndarray]:
    """Return all columns of samples."""
    return columns_of_motion(mechanism, *(np.array(values) for values in zip(*samples)))


def _kind(before: int, after: int) -> str:
    """Return the kind of an event by the slip of its guide before and after it."""
    if before == after:
        return "corner"
    if before == 0:
        return "slip"
    return "reversal" if after else "stick"
