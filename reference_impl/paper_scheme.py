"""The paper's scheme: fixed-step Runge-Kutta with the HLCP, by Lemke, at every evaluation (Sect. 4.2).

Choices where the paper is silent: the classical Runge-Kutta method of order 4; the slip/stick set is decided at the
start of a step and kept for its four evaluations, the normal law is decided by the HLCP at each of them; a step in
which a slip velocity changes its sign is repeated with the length at which that velocity vanishes (secant), and the
rest of the step follows from there. A slider leaves the stick set at the start of a step, so that a break-away is late by
up to one step: the scheme is of first order across it.
"""

from __future__ import annotations

import numpy as np

from reference_impl.bundle import Cube, Flags, IntegerTable, Integers, Reals, Table
from reference_impl.columns import build_columns
from reference_impl.compiling import kernel
from reference_impl.contact_modes import solve_mode
from reference_impl.contact_solvers import LEMKE, solve_contact
from reference_impl.dynamics import acceleration, row_form
from reference_impl.event_driven import EVENT_KINDS, REVERSAL, SLIP, STICK, Run, breakdown_of
from reference_impl.kinematics import Workspace, workspace
from reference_impl.linking import clock
from reference_impl.mechanism import Arrays, Mechanism
from reference_impl.mode_choice import COUNTER_NAMES, EVENTS, HLCP, PIVOTS, PROJECTIONS, REJECTED, RHS, STEPS, choose_mode
from reference_impl.outcomes import CHATTER, DONE, NOT_FINITE, SOLVED
from reference_impl.projection import project
from scenes import Cost, Event
from scenes.trajectory import rows_of

RK_NODES = np.array([0.0, 0.5, 0.5, 1.0])
RK_WEIGHTS = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0


@kernel(allocates=True)
def _evaluate(m: Arrays, w: Workspace, solver: int, t: float, y: Reals, slip: Integers, stuck: Flags, corner: IntegerTable, dy: Reals,
              counters: Integers) -> int:
    """y' into dy by the contact solver, without friction by a linear solve; returns the solver's outcome."""
    n = len(m.inverse_mass)
    row_form(m, w, t, y[:n], y[n:])
    counters[RHS] += 1
    outcome = SOLVED
    if len(m.friction):
        outcome, work, _ = solve_contact(m, w, solver, slip, stuck, corner, np.empty(len(m.friction)))
        counters[HLCP] += 1
        counters[PIVOTS] += work
    else:
        solve_mode(m, w, slip, corner)
    dy[:n] = y[n:]
    acceleration(m, w, w.force, dy[n:])
    return outcome


@kernel(allocates=True)
def _runge_kutta(m: Arrays, w: Workspace, solver: int, t: float, h: float, y: Reals, slip: Integers, stuck: Flags, corner: IntegerTable,
                 y_new: Reals, stage: Reals, dy: Reals, counters: Integers) -> int:
    y_new[:] = y
    stage[:] = y
    for s in range(4):
        if s > 0:
            stage[:] = y + RK_NODES[s] * h * dy
        outcome = _evaluate(m, w, solver, t + RK_NODES[s] * h, stage, slip, stuck, corner, dy, counters)
        if outcome != SOLVED:
            return outcome
        y_new += h * RK_WEIGHTS[s] * dy
    return SOLVED


@kernel(allocates=True)
def march(m: Arrays, w: Workspace, solver: int, y: Reals, slip: Integers, corner: IntegerTable, dt: float, steps: int, every: int,
          projecting: bool, motion: Cube, forces: Table, slips: IntegerTable, event_t: Reals, event_kind: Integers, event_guide: Integers,
          counters: Integers) -> tuple[int, int, int, float]:
    """March `steps` steps of dt, writing every `every`-th instant; returns code, samples, events and time reached."""
    n, nf = len(m.inverse_mass), len(m.friction)
    y_new, stage, dy = np.zeros(2 * n), np.zeros(2 * n), np.zeros(2 * n)
    rest_speed, old = np.zeros(nf), np.zeros(nf, dtype=np.int64)
    start_speed = np.zeros(nf)
    written, events = 0, 0
    for step in range(steps + 1):
        t, rest = step * dt, dt
        partial = 0
        while True:
            old[:] = slip
            if nf:
                outcome = choose_mode(m, w, solver, t, y[:n], y[n:], slip, corner, rest_speed, counters)
                if outcome != SOLVED:
                    return outcome, written, events, t
            stuck = slip == 0
            start_speed[:] = w.slip
            for f in range(nf):
                if step + partial > 0 and slip[f] != old[f] and events < len(event_t):
                    kind = SLIP if old[f] == 0 else STICK if slip[f] == 0 else REVERSAL
                    event_t[events], event_kind[events], event_guide[events] = t, kind, f
                    events += 1
                    counters[EVENTS] += 1
                rest_speed[f] = np.inf if stuck[f] else -1.0
            if partial == 0 and step % every == 0:
                outcome = _evaluate(m, w, solver, t, y, slip, stuck, corner, dy, counters)
                if outcome != SOLVED:
                    return outcome, written, events, t
                motion[written, 0], motion[written, 1], motion[written, 2] = y[:n], y[n:], dy[n:]
                forces[written], slips[written] = w.force, slip
                written += 1
            if step == steps:
                return DONE, written, events, t
            h, first = _step_to_rest(m, w, solver, t, rest, y, slip, stuck, corner, start_speed, y_new, stage, dy, counters)
            if h < 0.0:
                return first, written, events, t
            if not np.all(np.isfinite(y_new)):
                return NOT_FINITE, written, events, t
            y[:] = y_new
            t += h
            rest -= h
            if projecting:
                row_form(m, w, t, y[:n], y[n:])
                project(m, w, t, y[:n], y[n:], 1e-15 * m.length_scale, 2)
                counters[PROJECTIONS] += 1
            if first < 0:
                break
            rest_speed[first] = np.inf
            partial += 1
            if partial > 50 + 10 * nf:
                return CHATTER, written, events, t
            if rest <= 1e-12 * dt:
                break
        counters[STEPS] += 1
    return DONE, written, events, steps * dt


@kernel
def _step_to_rest(m: Arrays, w: Workspace, solver: int, t: float, rest: float, y: Reals, slip: Integers, stuck: Flags, corner: IntegerTable,
                  start_speed: Reals, y_new: Reals, stage: Reals, dy: Reals, counters: Integers) -> tuple[float, int]:
    """A step of length `rest`, or up to the first slip velocity that changes its sign.

    Returns the step and the guide that came to rest (-1: none); step -1 and the outcome if the solver failed.
    """
    n = len(m.inverse_mass)
    h = rest
    outcome = _runge_kutta(m, w, solver, t, h, y, slip, stuck, corner, y_new, stage, dy, counters)
    if outcome != SOLVED:
        return -1.0, outcome
    first, fraction = -1, 1.0
    row_form(m, w, t + h, y_new[:n], y_new[n:])
    for f in range(len(m.friction)):
        begin, end = slip[f] * start_speed[f], slip[f] * w.slip[f]
        if not stuck[f] and end < 0.0:
            x = begin / (begin - end) if begin > 0.0 else 0.5
            if first < 0 or x < fraction:
                first, fraction = f, x
    if first < 0:
        return rest, -1
    low, low_value = 0.0, max(slip[first] * start_speed[first], 0.0)
    high, high_value = rest, slip[first] * w.slip[first]
    floor = 1e-13 * max(abs(low_value), abs(high_value))
    for i in range(60):
        h = low + (high - low) * (low_value / (low_value - high_value) if i % 3 != 2 and low_value > 0.0 else 0.5)
        outcome = _runge_kutta(m, w, solver, t, h, y, slip, stuck, corner, y_new, stage, dy, counters)
        if outcome != SOLVED:
            return -1.0, outcome
        row_form(m, w, t + h, y_new[:n], y_new[n:])
        value = slip[first] * w.slip[first]
        if abs(value) <= floor or high - low < 1e-15 * rest:
            break
        if value > 0.0:
            low, low_value = h, value
        else:
            high, high_value = h, value
    counters[REJECTED] += 1
    return h, first


def simulate_as_paper(mechanism: Mechanism, q: np.ndarray, v: np.ndarray, dt: float, steps: int, every: int,
                      solver: int = LEMKE) -> Run:
    """March a mechanism from t = 0 as the paper does.

    Parameters
    ----------
    q, v : ndarray, shape (3 * bodies,)
        State at t = 0, on the constraints.
    dt : float
        Step (s); `steps` of them, every `every`-th instant is kept.
    solver : int
        One of `contact_solvers.SOLVERS`.

    Returns
    -------
    Run
        Events carry their time, kind and guide, and two-sided values of the nearest samples; `breakdown`
        says where and why the scheme stopped early; the columns then end there.
    """
    started = clock()
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    kept = steps // every + 1
    motion, forces = np.zeros((kept, 3, len(m.inverse_mass))), np.zeros((kept, m.rows + len(m.friction)))
    slips = np.zeros((kept, len(m.friction)), dtype=np.int64)
    room = 100_000
    event_t, event_kind, event_guide = np.zeros(room), np.zeros(room, dtype=np.int64), np.zeros(room, dtype=np.int64)
    counters = np.zeros(len(COUNTER_NAMES), dtype=np.int64)
    slip, corner = np.zeros(len(m.friction), dtype=np.int64), np.ones((len(m.friction), 2), dtype=np.int64)
    prepared = clock()
    code, written, events, reached = march(m, w, solver, np.concatenate([q, v]), slip, corner, dt, steps, every,
                                           mechanism.projection, motion, forces, slips, event_t, event_kind, event_guide,
                                           counters)
    stepped = clock()
    t = np.arange(written) * (every * dt)
    columns = build_columns(mechanism, t, motion[:written, 0], motion[:written, 1], motion[:written, 2],
                            forces[:written], slips[:written])
    before = np.maximum(np.searchsorted(t, event_t[:events], side="right") - 1, 0)
    after = np.minimum(before + 1, written - 1)
    sides = (rows_of({name: column[at] for name, column in columns.items()}) for at in (before, after))
    found = [Event(float(event_t[i]), EVENT_KINDS[event_kind[i]], mechanism.guide_names[event_guide[i]], *values)
             for i, values in enumerate(zip(*sides))]
    return Run(t, columns, tuple(found), Cost(prepared - started, 0.0, stepped - prepared,
                                              dict(zip(COUNTER_NAMES, map(int, counters)))),
               breakdown_of(code, reached, mechanism, w, slip, corner))
