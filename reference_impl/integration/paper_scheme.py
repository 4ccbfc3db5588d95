"""The paper's scheme: fixed-step Runge-Kutta with the HLCP, by Lemke, at every evaluation (Sect. 4.2).

Choices where the paper is silent: the classical Runge-Kutta method of order 4; the slip/stick set is decided at the
start of a step and kept for its four evaluations, the normal law is decided by the HLCP at each of them; a step in
which a slip velocity changes its sign is repeated with the length at which that velocity vanishes (secant), and the
rest of the step follows from there. A slider leaves the stick set at the start of a step, so that a break-away is late by
up to one step: the scheme is of first order across it.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Cube, Flags, IntegerTable, Integers, Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.kernel import clock
from stiction.reference_impl.compiled.loops import copy, is_finite
from stiction.reference_impl.friction.contact_modes import solve_mode
from stiction.reference_impl.friction.contact_solvers import solve_contact
from stiction.reference_impl.friction.mode_transition import choose_mode
from stiction.reference_impl.friction.outcomes import CHATTER, DONE, NOT_FINITE, SOLVED
from stiction.reference_impl.friction.solvers import AUTOMATIC, named
from stiction.reference_impl.integration.event_driven import EVENT_KINDS, REVERSAL, SLIP, STICK, Run, breakdown_of
from stiction.reference_impl.multibody.dynamics import acceleration, row_form
from stiction.reference_impl.multibody.kinematics import Workspace, workspace
from stiction.reference_impl.multibody.mechanism import Arrays, Mechanism
from stiction.reference_impl.multibody.projection import project
from stiction.reference_impl.multibody.trajectory_columns import build_columns, write_sample
from stiction.scenes import Cost, Event
from stiction.scenes.trajectory import rows_of

RK_NODES = np.array([0.0, 0.5, 0.5, 1.0])
RK_WEIGHTS = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
MOST_EVENTS = 100_000
"""Of a run; later ones are counted no more. The memory is taken as it is used."""


@kernel(allocates=True)
def _evaluate(m: Arrays, w: Workspace, t: float, y: Reals, slip: Integers, stuck: Flags, corner: IntegerTable, dy: Reals) -> int:
    """y' into dy by the contact solver, without friction by a linear solve; returns the solver's outcome."""
    n = len(m.inverse_mass)
    row_form(m, w, t, y[:n], y[n:])
    w.counters.rhs += 1
    outcome = SOLVED
    if len(m.friction):
        outcome, _ = solve_contact(m, w, slip, stuck, corner, np.empty(len(m.friction)))
    else:
        solve_mode(m, w, slip, corner)
    for i in range(n):
        dy[i] = y[n + i]
    acceleration(m, w, w.force, dy[n:])
    return outcome


@kernel(allocates=True)
def _runge_kutta(m: Arrays, w: Workspace, t: float, h: float, y: Reals, slip: Integers, stuck: Flags, corner: IntegerTable,
                 y_new: Reals, stage: Reals, dy: Reals) -> int:
    copy(y, y_new)
    for s in range(4):
        for i in range(len(y)):
            stage[i] = y[i] + RK_NODES[s] * h * dy[i] if s > 0 else y[i]
        outcome = _evaluate(m, w, t + RK_NODES[s] * h, stage, slip, stuck, corner, dy)
        if outcome != SOLVED:
            return outcome
        for i in range(len(y)):
            y_new[i] += h * RK_WEIGHTS[s] * dy[i]
    return SOLVED


@kernel(allocates=True)
def march(m: Arrays, w: Workspace, beside: Workspace, y: Reals, slip: Integers, corner: IntegerTable, dt: float, steps: int, every: int,
          projecting: bool, motion: Cube, forces: Table, slips: IntegerTable, event_t: Reals, event_kind: Integers, event_guide: Integers,
          side_motion: Cube, side_forces: Table, side_slips: IntegerTable) -> tuple[int, int, int, float]:
    """March `steps` steps of dt, writing every `every`-th instant; returns code, samples, events and time reached.

    beside : a workspace for what is evaluated for the record alone, and is not counted.
    side_motion, side_forces, side_slips : as motion, forces, slips, with two rows per event, before and after it; without rows if
    they are not wanted.
    """
    n, nf = len(m.inverse_mass), len(m.friction)
    y_new, stage, dy = np.zeros(2 * n), np.zeros(2 * n), np.zeros(2 * n)
    rest_speed, start_speed, old = np.zeros(nf), np.zeros(nf), np.zeros(nf, dtype=np.int64)
    stuck, rested = np.zeros(nf, dtype=np.bool_), np.zeros(nf, dtype=np.bool_)
    written, events = 0, 0
    for step in range(steps + 1):
        t, rest = step * dt, dt
        partial = 0
        while True:
            copy(slip, old)
            if nf:
                outcome = choose_mode(m, w, t, y[:n], y[n:], slip, corner, rest_speed)
                if outcome != SOLVED:
                    return outcome, written, events, t
            copy(w.slip_speed, start_speed)
            began = events
            for f in range(nf):
                stuck[f], rested[f] = slip[f] == 0, old[f] == 0
                if step + partial > 0 and slip[f] != old[f] and events < len(event_t):
                    kind = SLIP if old[f] == 0 else STICK if slip[f] == 0 else REVERSAL
                    event_t[events], event_kind[events], event_guide[events] = t, kind, f
                    events += 1
                    w.counters.events += 1
                rest_speed[f] = np.inf if stuck[f] else -1.0
            if began < events <= len(side_motion) // 2:
                for side in range(2):  # the mode that follows last: it leaves its corners' signs
                    mode = slip if side else old
                    outcome = _evaluate(m, beside, t, y, mode, stuck if side else rested, corner, dy)
                    if outcome != SOLVED:
                        return outcome, written, began, t
                    for i in range(2 * began + side, 2 * events, 2):
                        write_sample(beside, y, dy, mode, side_motion[i], side_forces[i], side_slips[i])
            if partial == 0 and step % every == 0:
                outcome = _evaluate(m, w, t, y, slip, stuck, corner, dy)
                if outcome != SOLVED:
                    return outcome, written, events, t
                write_sample(w, y, dy, slip, motion[written], forces[written], slips[written])
                written += 1
            if step == steps:
                return DONE, written, events, t
            h, first = _step_to_rest(m, w, t, rest, y, slip, stuck, corner, start_speed, y_new, stage, dy)
            if h < 0.0:
                return first, written, events, t
            if not is_finite(y_new):
                return NOT_FINITE, written, events, t
            copy(y_new, y)
            t += h
            rest -= h
            if projecting:
                row_form(m, w, t, y[:n], y[n:])
                project(m, w, t, y[:n], y[n:], 1e-15 * m.length_scale, 2)
                w.counters.projections += 1
            if first < 0:
                break
            rest_speed[first] = np.inf
            partial += 1
            if partial > 50 + 10 * nf:
                return CHATTER, written, events, t
            if rest <= 1e-12 * dt:
                break
        w.counters.steps += 1
    return DONE, written, events, steps * dt


@kernel
def _step_to_rest(m: Arrays, w: Workspace, t: float, rest: float, y: Reals, slip: Integers, stuck: Flags, corner: IntegerTable,
                  start_speed: Reals, y_new: Reals, stage: Reals, dy: Reals) -> tuple[float, int]:
    """A step of length `rest`, or up to the first slip velocity that changes its sign.

    Returns the step and the guide that came to rest (-1: none); step -1 and the outcome if the solver failed.
    """
    n = len(m.inverse_mass)
    h = rest
    outcome = _runge_kutta(m, w, t, h, y, slip, stuck, corner, y_new, stage, dy)
    if outcome != SOLVED:
        return -1.0, outcome
    first, fraction = -1, 1.0
    row_form(m, w, t + h, y_new[:n], y_new[n:])
    for f in range(len(m.friction)):
        begin, end = slip[f] * start_speed[f], slip[f] * w.slip_speed[f]
        if not stuck[f] and end < 0.0:
            x = begin / (begin - end) if begin > 0.0 else 0.5
            if first < 0 or x < fraction:
                first, fraction = f, x
    if first < 0:
        return rest, -1
    low, low_value = 0.0, max(slip[first] * start_speed[first], 0.0)
    high, high_value = rest, slip[first] * w.slip_speed[first]
    floor = 1e-13 * max(abs(low_value), abs(high_value))
    for i in range(60):
        h = low + (high - low) * (low_value / (low_value - high_value) if i % 3 != 2 and low_value > 0.0 else 0.5)
        outcome = _runge_kutta(m, w, t, h, y, slip, stuck, corner, y_new, stage, dy)
        if outcome != SOLVED:
            return -1.0, outcome
        row_form(m, w, t + h, y_new[:n], y_new[n:])
        value = slip[first] * w.slip_speed[first]
        if abs(value) <= floor or high - low < 1e-15 * rest:
            break
        if value > 0.0:
            low, low_value = h, value
        else:
            high, high_value = h, value
    w.counters.rejected += 1
    return h, first


def simulate_as_paper(mechanism: Mechanism, q: np.ndarray, v: np.ndarray, dt: float, steps: int, every: int,
                      solver: int = AUTOMATIC, sides: bool = True) -> Run:
    """March a mechanism from t = 0 as the paper does.

    Parameters
    ----------
    q, v : ndarray, shape (3 * bodies,)
        State at t = 0, on the constraints.
    dt : float
        Step (s); `steps` of them, every `every`-th instant is kept.
    solver : int
        One of `solvers.SOLVERS`.
    sides : bool
        Whether events carry the values before and after them, which takes two evaluations each, beyond those that are counted.

    Returns
    -------
    Run
        Events carry their time, kind and guide, and the values at that instant with the modes before and after it: a guide that
        breaks away is late by up to one step, so that before it has the acceleration, O(dt), with which it leaves the stick set;
        `breakdown` says where and why the scheme stopped early; the columns then end there.
    """
    started = clock()
    m, w = mechanism.arrays, workspace(mechanism.arrays, solver)

    def rows(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Room for motion, row forces and modes."""
        return (np.zeros((count, 3, len(m.inverse_mass))), np.zeros((count, m.rows + len(m.friction))),
                np.zeros((count, len(m.friction)), dtype=np.int64))

    def columns(t: np.ndarray, motion: np.ndarray, forces: np.ndarray, slips: np.ndarray) -> dict[str, np.ndarray]:
        q, v, a = (motion[:len(t), i] for i in range(3))
        return build_columns(mechanism, t, q, v, a, forces[:len(t)], slips[:len(t)])

    samples, beside = rows(steps // every + 1), rows(2 * MOST_EVENTS if sides else 0)
    event_t, event_kind, event_guide = np.zeros(MOST_EVENTS), np.zeros(MOST_EVENTS, dtype=np.int64), np.zeros(MOST_EVENTS, dtype=np.int64)
    slip, corner = np.zeros(len(m.friction), dtype=np.int64), np.ones((len(m.friction), 2), dtype=np.int64)
    prepared = clock()
    code, written, events, reached = march(m, w, workspace(m, solver), np.concatenate([q, v]), slip, corner, dt, steps, every,
                                           mechanism.projection, *samples, event_t, event_kind, event_guide, *beside)
    stepped = clock()
    t = np.arange(written) * (every * dt)
    values = rows_of(columns(np.repeat(event_t[:events], 2), *beside)) if sides and events else [{} for _ in range(2 * events)]
    found = tuple(Event(float(event_t[i]), EVENT_KINDS[event_kind[i]], mechanism.guide_names[event_guide[i]], *values[2 * i:2 * i + 2])
                  for i in range(events))
    return Run(t, columns(t, *samples), found, Cost(prepared - started, 0.0, stepped - prepared, named(w.counters)),
               breakdown_of(code, reached, mechanism, w, slip, corner))
