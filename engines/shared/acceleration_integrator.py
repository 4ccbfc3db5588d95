"""An engine's accelerations under an integrator of high order that locates events.

It separates the error of an engine's equations of motion from that of its stepping. The engine computes accelerations
in joint coordinates, which fulfil the constraints by themselves. The friction of the guides is determined here, from
the reactions that belong to those accelerations; the integrator is SciPy's DOP853. In a contact mode friction is linear
in the reactions and these in the friction. An event is an instant at which an event function of
`stiction.reference_impl.friction.frozen_mode` falls through zero; event functions are sampled at some instants of each
step.

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
"""Instants of a step at which event functions are evaluated. A function that falls below zero and rises again between
two of them is not noticed; steps of DOP853 are short against changes of the motion."""
_MOST_EVENTS = 100
"""Largest number of events in a row without time passing. A scene has a few guides, of three event functions each; more
events than that follow each other for ever."""
_EVENT_TOLERANCE = 1e-15
"""Absolute tolerance (s) of Brent's method for the instant of an event: that of rounding at times of seconds. SciPy
adds its smallest relative one."""
_DRAWS = 2
"""Times that the signs of corner forces are corrected: signs change the friction, and this the corner forces once
more."""


Dynamics = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""An engine's mass matrix (links, links) and joint forces (links,) of a position, velocity and acceleration of the
links under gravity, each of shape (links,)."""


class _Instant(NamedTuple):
    """Solution at a state in a contact mode: x'', frictions (N), and event functions, shape (frictional, 3).

    The event functions of a guide are that of its slip (or stick), and those of its two corner pairs.
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
        # Of each frictional guide: the index of its displacement in x, and the sign, which is -1
        # where x decreases as the displacement grows.
        links = [tree.link_of_joint[name] for name in scene.frictional_guides]
        self._guides = np.searchsorted(self._free, links)
        self._signs = np.array([tree.links[link].sign for link in links], dtype=float)
        self._balance, self._loaded = Balance.of(mechanism), bool(scene.springs or scene.forces)
        self.slip = np.sign(self._slip_speed(self.start)).astype(np.int64)
        self.corner = np.ones((len(links), 4), dtype=np.int64)

    def begin(self, y: np.ndarray) -> None:
        """Choose the contact mode of the start, in place."""
        for guide in np.flatnonzero(self.slip == 0).tolist():
            self._rest(0.0, y, guide, held=True)
        self._draw(0.0, y)

    def compile(self) -> None:
        """Compile what the solutions call, or load it."""
        link_kernels(applied_loads, assemble, row_forces)

    def at(self, t: float, y: np.ndarray) -> _Instant:
        """Solve for the accelerations and frictions of a state in the present contact mode."""
        self.calls += 1
        balance, signs, guides, count = self._balance, self._signs, self._guides, len(self.slip)
        m, w = balance.m, balance.w
        second, mobility = self._without_friction(t, y)
        if not count:
            return _Instant(second, np.zeros(0), np.zeros((0, 3)))
        # Reactions are linear in the friction. The reactions without friction and with one newton
        # in each guide give normal forces and moments of the guides: constant + slope @ friction.
        per_newton = mobility[:, guides] * signs
        q, v, a = self._motion(t, y, second)
        assemble(balance, t, q, v, 0.0)
        constant = self._reactions(a, np.zeros(count))
        slope = np.stack(
            [
                self._reactions(self._motion(t, y, second + added)[2], newton) - constant
                for added, newton in zip(per_newton.T, np.eye(count))
            ],
            axis=-1,
        )
        # One equation for each guide: in stick its acceleration is zero, in slip its friction is
        # Coulomb's, which with the signs of the corner forces is linear in the reactions.
        matrix, right = np.eye(count), np.zeros(count)
        for i, direction in enumerate(self.slip):
            if direction == 0:
                matrix[i] = signs[i] * per_newton[guides[i]]
                right[i] = -signs[i] * second[guides[i]]
            else:
                s1, s2 = self.corner[i, :2]
                share = np.array(
                    friction_coefficients(m, i, direction, s1, s2, m.friction["mu"][i])
                )
                matrix[i] -= share @ slope[:, i]
                right[i] = share @ constant[:, i]
        friction = np.linalg.solve(matrix, right)
        # The event functions are those of the reference, which reads the forces from its workspace.
        rows = m.friction["row"]
        w.force[rows], w.force[rows + 1] = constant + slope @ friction
        w.force[m.rows :], w.slip_speed[:] = friction, self._slip_speed(y)
        choose_branches(m, w, self.slip, self.corner, ALL)
        event_functions(m, w, self.slip, self.corner)
        return _Instant(second + per_newton @ friction, friction, w.event.reshape(count, 3).copy())

    def sample(self, t: float, y: np.ndarray) -> tuple[Any, ...]:
        """Return time, coordinates, velocities, accelerations of the bodies, modes and frictions at an instant."""
        instant = self.at(t, y)
        return t, *self._motion(t, y, instant.second), self.slip.copy(), instant.friction

    def first_event(
        self, curve: Callable[[float], np.ndarray], start: float, end: float
    ) -> tuple[float, int]:
        """Return the first instant at which an event function falls through zero, and its place in `event`.

        `end` and -1 if none does. `curve` is the state by the time.
        """

        def value(t: float, place: int) -> float:
            return self.at(t, curve(t)).event.flat[place]

        def time_of_zero(place: int) -> float:
            if before[place] > 0.0:
                return brentq(value, low, high, args=(place,), xtol=_EVENT_TOLERANCE)
            return low

        if not len(self.slip):
            return end, -1
        times = np.linspace(start, end, _SAMPLES + 1)
        before = self.at(start, curve(start)).event.ravel()
        for low, high in pairwise(times):
            after = self.at(high, curve(high)).event.ravel()
            # A function that is not positive at the start of the step has just had its event: it
            # rises from there, or its mode ends at once. Later on, one that is not positive was
            # found in an earlier interval.
            falls = np.flatnonzero((after < 0.0) & ((before > 0.0) | (low == start))).tolist()
            if falls:
                return min((time_of_zero(place), place) for place in falls)
            before = after
        return end, -1

    def switch(self, t: float, y: np.ndarray, guide: int, place: int) -> None:
        """Change the contact mode after an event of a guide, in place.

        `place` is that of the event function: 0 of its slip or stick, 1 and 2 of its corners.
        """
        if self.slip[guide] and place:
            self.corner[guide, place - 1] *= -1
            self._draw(t, y, but=(guide, place - 1))
        else:
            self._rest(t, y, guide, held=bool(self.slip[guide]))
            self._draw(t, y)

    def _rest(self, t: float, y: np.ndarray, guide: int, held: bool) -> None:
        """Let a guide at rest stick, in place, if static friction can hold it; otherwise slip where the load draws it.

        Unless it may be `held`, it slips in any case.
        """
        # Try stick: its friction tells whether it holds, and in which direction the slider goes if not.
        y[len(y) // 2 :][self._guides[guide]] = 0.0
        self.slip[guide] = 0
        instant = self.at(t, y)
        if not held or instant.event[guide, :2].min() < 0.0:
            self.slip[guide] = -np.sign(instant.friction[guide])

    def _draw(self, t: float, y: np.ndarray, but: tuple[int, int] | None = None) -> None:
        """Choose the signs of the mode as those of the corner forces of sliders that slip, `but` for one."""
        for _ in range(_DRAWS):
            wrong = (self.at(t, y).event[:, 1:] < 0.0) & (self.slip != 0)[:, None]
            if but is not None:
                wrong[but] = False
            self.corner[:, :2][wrong] *= -1

    def _without_friction(self, t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x'' without friction, (n,), and x'' by a unit force on each coordinate, as columns, (n, n)."""
        # The engine's inverse dynamics give the joint forces that the motion without accelerations
        # of the free coordinates needs. The opposite forces accelerate these coordinates.
        position, velocity, driven = self._joints(t, y, np.zeros(len(y) // 2))
        mass, needed = self.dynamics(position, velocity, driven)
        mobility = np.linalg.inv(mass[np.ix_(self._free, self._free)])
        force = -needed[self._free]
        # Loads on the bodies become joint forces by their power: the velocities of the bodies for a
        # unit rate of each joint.
        if self._loaded:
            q, v, _ = self.tree.motion(position, velocity, driven)
            applied_loads(self._balance, t, q, v, 0.0)
            loads = self._balance.loads
            still = np.zeros(len(position))
            for i, unit in enumerate(np.eye(len(position))[self._free]):
                force[i] += self.tree.motion(position, unit, still)[1] @ loads
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
    """Integrate from t = 0 to t_end with local errors of rtol (1 + |x|), in m, rad and their rates.

    `setup_s` is the CPU time (s) of making the accelerations.

    Raises
    ------
    EngineFailure
        If the step becomes too small, or contact modes follow each other without time passing.
    """
    scene, started = mechanism.scene, time.process_time()
    accelerations.compile()
    compiled = time.process_time()
    accelerations.clock.start()
    samples: list[tuple[Any, ...]] = []
    sides: list[tuple[Any, ...]] = []  # before and after each event, in turn
    switches: list[tuple[str, str]] = []  # kind and guide of each event
    names = list(scene.frictional_guides)
    t, y = 0.0, accelerations.start
    steps = 0
    events_at_once = 0
    accelerations.begin(y)
    output = output_times(t_end, output_step)
    # Between kinks of the laws of time and between events the right-hand side is smooth. A
    # Runge-Kutta method keeps its order only there, so each stretch is a problem of its own.
    for stop in (*mechanism.kinks(t_end), t_end):
        while t < stop:
            solver = DOP853(
                lambda t, y: np.concatenate([y[len(y) // 2 :], accelerations.at(t, y).second]),
                t,
                y,
                stop,
                rtol=rtol,
                atol=rtol,
            )
            event, started_at = -1, t
            while event < 0 and solver.status == "running":
                message = solver.step()
                if solver.status == "failed":
                    raise EngineFailure(f"{message} (t = {solver.t:.9g} s)")
                steps += 1
                # The step ends at its first event, of which only the dense output knows. Samples
                # up to there are evaluated in the mode of this step.
                curve = solver.dense_output()
                end, event = accelerations.first_event(curve, t, solver.t)
                samples += [
                    accelerations.sample(at, curve(at))
                    for at in output[(output >= t) & (output < end)]
                ]
                t, y = end, curve(end) if event >= 0 else solver.y
            events_at_once = events_at_once + 1 if t <= started_at else 0
            if events_at_once > _MOST_EVENTS:
                raise EngineFailure(
                    f"contact modes follow each other without time passing at t = {t:.9g} s"
                )
            if event < 0:
                continue
            # Change the mode, and record the event with its values in both modes.
            guide, place = divmod(event, 3)
            slipped = accelerations.slip[guide]
            sides.append(accelerations.sample(t, y))
            accelerations.switch(t, y, guide, place)
            sides.append(accelerations.sample(t, y))
            switches.append((_kind(slipped, accelerations.slip[guide]), names[guide]))
    samples.append(accelerations.sample(t, y))
    ended, engine_s = time.process_time(), accelerations.clock.engine_s
    events = []
    if switches:
        rows = rows_of(_columns(mechanism, sides))
        events = [
            Event(sides[2 * i][0], kind, guide, rows[2 * i], rows[2 * i + 1])
            for i, (kind, guide) in enumerate(switches)
        ]
    return Trajectory(
        scene=scene.name,
        engine=engine.name,
        version=engine.version,
        fidelity=Fidelity.JOINT,
        t=np.array([t for t, *_ in samples]),
        columns=_columns(mechanism, samples),
        events=tuple(events),
        settings={"rtol": rtol, "method": METHOD, "friction_law": FRICTION_LAW},
        cost=Cost(
            setup_s,
            compiled - started,
            ended - compiled,
            {"steps": steps, "rhs": accelerations.calls, "events": len(events)},
            engine_s,
        ),
    )


def _columns(mechanism: Mechanism, samples: list[tuple[Any, ...]]) -> dict[str, np.ndarray]:
    return columns_of_motion(mechanism, *(np.array(part) for part in zip(*samples)))


def _kind(before: int, after: int) -> str:
    """Return the kind of an event by the slip of its guide before and after it."""
    if before == after:
        return "corner"
    if before == 0:
        return "slip"
    return "reversal" if after else "stick"
