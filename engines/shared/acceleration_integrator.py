"""An engine's accelerations under an integrator of high order that locates events.

It separates the error of an engine's equations of motion from that of its stepping. The engine gives accelerations in
joint coordinates, which fulfil the constraints by themselves. The friction of the guides is decided here, from the
reactions that belong to those accelerations; the integrator is SciPy's DOP853. In a contact mode friction is linear in
the reactions and these in the friction; events are where an event function of
`stiction.reference_impl.friction.frozen_mode` falls through zero between two of the instants at which it is sampled.
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
_SAMPLES = 8  # instants of a step at which event functions are looked at
_MOST_EVENTS = 100  # in a row, without time passing


Dynamics = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""An engine's mass matrix (links, links) and joint forces (links,) of a position, velocity and acceleration of the
links under gravity, each of shape (links,)."""


class _Instant(NamedTuple):
    """Solution at a state in a contact mode: x'', frictions (N), and event functions, shape (frictional, 3)."""

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
        Solutions so far.
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
        links = [tree.link_of_joint[name] for name in scene.frictional_guides]
        # of each frictional guide's displacement the index in x, and 1, or -1 where x grows against it
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
        per_newton = mobility[:, guides] * signs
        q, v, a = self._motion(t, y, second)
        assemble(balance, t, q, v, 0.0)
        # normal forces and moments of the guides: constant + slope @ friction
        constant = self._reactions(a, np.zeros(count))
        slope = np.stack(
            [
                self._reactions(self._motion(t, y, second + add)[2], one) - constant
                for add, one in zip(per_newton.T, np.eye(count))
            ],
            axis=-1,
        )
        matrix, right = np.eye(count), np.zeros(count)
        for i, d in enumerate(self.slip):
            if d == 0:
                matrix[i] = signs[i] * per_newton[guides[i]]
                right[i] = -signs[i] * second[guides[i]]
            else:
                s1, s2 = self.corner[i, :2]
                share = np.array(friction_coefficients(m, i, d, s1, s2, m.friction["mu"][i]))
                matrix[i] -= share @ slope[:, i]
                right[i] = share @ constant[:, i]
        friction = np.linalg.solve(matrix, right)
        rows = m.friction["row"]
        w.force[rows], w.force[rows + 1] = constant + slope @ friction
        w.force[m.rows :], w.slip_speed[:] = friction, self._slip_speed(y)
        choose_branches(m, w, self.slip, self.corner, ALL)
        event_functions(m, w, self.slip, self.corner)
        return _Instant(second + per_newton @ friction, friction, w.event.reshape(count, 3).copy())

    def sample(self, t: float, y: np.ndarray) -> tuple[Any, ...]:
        """Time, coordinates, velocities and accelerations of the bodies, modes and frictions at an instant."""
        instant = self.at(t, y)
        return t, *self._motion(t, y, instant.second), self.slip.copy(), instant.friction

    def first_event(
        self, curve: Callable[[float], np.ndarray], start: float, end: float
    ) -> tuple[float, int]:
        """First instant at which an event function falls through zero, and its place; `end` and -1 if none does."""

        def value(t: float, place: int) -> float:
            return self.at(t, curve(t)).event.flat[place]

        if not len(self.slip):
            return end, -1
        times = np.linspace(start, end, _SAMPLES + 1)
        before = self.at(start, curve(start)).event.ravel()
        for low, high in pairwise(times):
            after = self.at(high, curve(high)).event.ravel()
            # what is not above zero at the start has had its event there: it rises, or its mode was left at once
            falls = np.flatnonzero((after < 0.0) & ((before > 0.0) | (low == start))).tolist()
            if falls:
                return min(
                    (
                        brentq(value, low, high, args=(place,), xtol=1e-15)
                        if before[place] > 0.0
                        else low,
                        place,
                    )
                    for place in falls
                )
            before = after
        return end, -1

    def switch(self, t: float, y: np.ndarray, guide: int, place: int) -> None:
        """Change the contact mode behind an event function of a guide, in place: of its slip, or of a corner."""
        if self.slip[guide] and place:
            self.corner[guide, place - 1] *= -1
            self._draw(t, y, but=(guide, place - 1))
        else:
            self._rest(t, y, guide, held=bool(self.slip[guide]))
            self._draw(t, y)

    def _rest(self, t: float, y: np.ndarray, guide: int, held: bool) -> None:
        """Have a guide at rest stick, in place, if it may be `held` and static friction can; else slip where drawn."""
        y[len(y) // 2 :][self._guides[guide]] = 0.0
        self.slip[guide] = 0
        instant = self.at(t, y)
        if not held or instant.event[guide, :2].min() < 0.0:
            self.slip[guide] = -np.sign(instant.friction[guide])

    def _draw(self, t: float, y: np.ndarray, but: tuple[int, int] | None = None) -> None:
        """Make the corner forces of sliders that slip have the signs of the mode, `but` for one."""
        for _ in range(2):  # signs change the friction, and that the corner forces
            wrong = (self.at(t, y).event[:, 1:] < 0.0) & (self.slip != 0)[:, None]
            if but is not None:
                wrong[but] = False
            self.corner[:, :2][wrong] *= -1

    def _without_friction(self, t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x'' without friction, shape (n,), and what unit forces on the coordinates add, one a column, shape (n, n)."""
        position, velocity, driven = self._joints(t, y, np.zeros(len(y) // 2))
        mass, needed = self.dynamics(position, velocity, driven)
        mobility = np.linalg.inv(mass[np.ix_(self._free, self._free)])
        force = -needed[self._free]
        if self._loaded:
            q, v, _ = self.tree.motion(position, velocity, driven)
            applied_loads(self._balance, t, q, v, 0.0)
            loads = self._balance.loads
            still = np.zeros(len(position))
            for i, unit in enumerate(np.eye(len(position))[self._free]):
                force[i] += self.tree.motion(position, unit, still)[1] @ loads
        return mobility @ force, mobility

    def _reactions(self, a: np.ndarray, friction: np.ndarray) -> np.ndarray:
        """Normal forces (N) and moments (N m) of the frictional guides, shape (2, frictional).

        They belong to accelerations of the bodies and these frictions (N) at the assembled instant. They are of least
        squares in the metric of the masses and of minimum norm.
        """
        balance = self._balance
        balance.known[:] = friction
        row_forces(balance, a)
        rows = balance.m.friction["row"]
        return np.array([balance.force[rows], balance.force[rows + 1]])

    def _motion(self, t: float, y: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, ...]:
        """Coordinates, velocities and accelerations of the bodies, each of shape (3 * bodies,)."""
        return self.tree.motion(*self._joints(t, y, second))

    def _joints(self, t: float, y: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, ...]:
        """Coordinates, rates and accelerations of all joints, those of drives by their laws."""
        joints = np.zeros((3, len(self.tree.links)))
        joints[:, self._free] = *np.split(y, 2), second
        for link, sign, law, offset in self._driven:
            joints[:, link] = sign * np.array(evaluate_law(law, t))
            joints[0, link] += offset
        return tuple(joints)

    def _slip_speed(self, y: np.ndarray) -> np.ndarray:
        """Slip speeds of the frictional guides, m/s."""
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

    EngineFailure if the step becomes too small, or contact modes follow each other without time passing. `setup_s` is
    what the accelerations took to make, seconds of CPU.
    """
    scene, started = mechanism.scene, time.process_time()
    accelerations.compile()
    compiled = time.process_time()
    accelerations.clock.start()
    samples: list[tuple[Any, ...]] = []
    sides: list[tuple[Any, ...]] = []
    switches: list[tuple[str, str]] = []
    names, t, y, steps, idle = list(scene.frictional_guides), 0.0, accelerations.start, 0, 0
    accelerations.begin(y)
    output = output_times(t_end, output_step)
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
                curve = solver.dense_output()
                end, event = accelerations.first_event(curve, t, solver.t)
                samples += [
                    accelerations.sample(at, curve(at))
                    for at in output[(output >= t) & (output < end)]
                ]
                t, y = end, curve(end) if event >= 0 else solver.y
            idle = idle + 1 if t <= started_at else 0
            if idle > _MOST_EVENTS:
                raise EngineFailure(
                    f"contact modes follow each other without time passing at t = {t:.9g} s"
                )
            if event < 0:
                continue
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
    return (
        "corner" if before == after else "slip" if not before else "reversal" if after else "stick"
    )
