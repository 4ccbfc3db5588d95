"""The paper's scheme: fixed-step Runge-Kutta with the HLCP, by Lemke, at every evaluation (Sect. 4.2).

Choices where the paper is silent: the classical Runge-Kutta method of order 4; the slip/stick set is decided at the
start of a step and kept for its four evaluations; the normal law is decided by the HLCP at each of them; a step in
which a slip velocity changes its sign is repeated with the length at which that velocity vanishes (secant). The rest of
the step follows from there. A slider leaves the stick set at the start of a step, so that a break-away is late by up to
one step: the scheme is of first order across it.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Bundle, Integers, IntegerTable, Reals
from stiction.reference_impl.compiled.kernel import clock, kernel
from stiction.reference_impl.compiled.loops import copy, is_finite
from stiction.reference_impl.friction.contact_solvers import solve_contact
from stiction.reference_impl.friction.frozen_mode import solve_mode
from stiction.reference_impl.friction.mode_choice import HOLDS, LEAVES, choose_mode
from stiction.reference_impl.friction.outcomes import CHATTER, DONE, NOT_FINITE, SOLVED
from stiction.reference_impl.friction.solver_names import AUTOMATIC, named
from stiction.reference_impl.integration.result import (
    REVERSAL,
    SLIP,
    STICK,
    EventLog,
    Run,
    Samples,
    breakdown_of,
    columns_and_events,
)
from stiction.reference_impl.multibody.dynamics import acceleration, row_form
from stiction.reference_impl.multibody.mechanism import (
    NO_GUIDE,
    Arrays,
    Mechanism,
    Workspace,
    workspace,
)
from stiction.reference_impl.multibody.projection import project
from stiction.reference_impl.multibody.trajectory_columns import write_sample
from stiction.scenes import Cost

RK_NODES = np.array([0.0, 0.5, 0.5, 1.0])
RK_WEIGHTS = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
MOST_EVENTS = 100_000
"""Events of a run that are logged; later ones are not counted. The memory is taken as it is used."""


class Steps(Bundle):
    """Steps of one length dt (s); every `every`-th instant is kept.

    `projecting` 1: states are projected after each step.
    """

    dt: float
    steps: int
    every: int
    projecting: int


class State(Bundle):
    """State and contact mode at the start of a step, and scratch."""

    y: Reals  # (6 * bodies,), as y_new, stage and dy
    y_new: Reals
    stage: Reals
    dy: Reals
    slip: Integers  # (frictional,), directions of slip, 0 at rest
    old_slip: Integers  # in the step before
    corner: IntegerTable  # (frictional, 2), signs of the corner forces
    rest_speed: (
        Reals  # (frictional,), slip speed up to which a guide comes to rest (`choose_mode`), m/s
    )
    start_speed: Reals  # (frictional,), slip speed at the start of the step, m/s


@kernel(allocates=True)
def _evaluate(
    m: Arrays, w: Workspace, t: float, y: Reals, slip: Integers, corner: IntegerTable, dy: Reals
) -> int:
    """Fill dy with y', and return the outcome of the solver.

    With friction this is the contact solver, else a linear solve.
    """
    n = len(m.inverse_mass)
    row_form(m, w, t, y[:n], y[n:])
    w.counters.rhs += 1
    outcome = SOLVED
    if len(m.friction):
        outcome, _ = solve_contact(m, w, slip, corner, np.empty(len(m.friction)))
    else:
        solve_mode(m, w, slip, corner)
    for i in range(n):
        dy[i] = y[n + i]
    acceleration(m, w, w.force, dy[n:])
    return outcome


@kernel
def _runge_kutta(m: Arrays, w: Workspace, s: State, t: float, h: float) -> int:
    """Make a step of length h into y_new, and return the outcome of the solver."""
    copy(s.y, s.y_new)
    for k in range(4):
        for i in range(len(s.y)):
            s.stage[i] = s.y[i] + RK_NODES[k] * h * s.dy[i] if k > 0 else s.y[i]
        outcome = _evaluate(m, w, t + RK_NODES[k] * h, s.stage, s.slip, s.corner, s.dy)
        if outcome != SOLVED:
            return outcome
        for i in range(len(s.y)):
            s.y_new[i] += h * RK_WEIGHTS[k] * s.dy[i]
    return SOLVED


@kernel
def march(
    m: Arrays,
    w: Workspace,
    beside: Workspace,
    s: State,
    task: Steps,
    samples: Samples,
    log: EventLog,
) -> tuple[int, int, int, float]:
    """March through the steps; return the code, the samples, the events and the time reached.

    `beside`: a workspace for what is evaluated for the record alone, and is not counted. `log`: its sides without rows
    if they are not wanted.
    """
    n, nf, y, slip, written, events = len(m.inverse_mass), len(m.friction), s.y, s.slip, 0, 0
    for step in range(task.steps + 1):
        t, rest = step * task.dt, task.dt
        partial = 0
        while True:
            copy(slip, s.old_slip)
            if nf:
                outcome = choose_mode(m, w, t, y[:n], y[n:], slip, s.corner, s.rest_speed)
                if outcome != SOLVED:
                    return outcome, written, events, t
            copy(w.slip_speed, s.start_speed)
            began = events
            events = _log_changes(s, log, t, events, step + partial > 0)
            w.counters.events += events - began
            if began < events <= len(log.motion):
                outcome = _log_sides(m, beside, s, log, t, began, events)
                if outcome != SOLVED:
                    return outcome, written, began, t
            if partial == 0 and step % task.every == 0:
                outcome = _evaluate(m, w, t, y, slip, s.corner, s.dy)
                if outcome != SOLVED:
                    return outcome, written, events, t
                write_sample(
                    w,
                    y,
                    s.dy,
                    slip,
                    samples.motion[written],
                    samples.force[written],
                    samples.slip[written],
                )
                written += 1
            if step == task.steps:
                return DONE, written, events, t
            outcome, h, first = _step_to_rest(m, w, s, t, rest)
            if outcome != SOLVED:
                return outcome, written, events, t
            if not is_finite(s.y_new):
                return NOT_FINITE, written, events, t
            copy(s.y_new, y)
            t += h
            rest -= h
            if task.projecting:
                row_form(m, w, t, y[:n], y[n:])
                project(m, w, t, y[:n], y[n:], slip, False, 2)
                w.counters.projections += 1
            if first == NO_GUIDE:
                break
            s.rest_speed[first] = HOLDS
            partial += 1
            if partial > 50 + 10 * nf:
                return CHATTER, written, events, t
            if rest <= 1e-12 * task.dt:
                break
        w.counters.steps += 1
    return DONE, written, events, task.steps * task.dt


@kernel
def _log_changes(s, log, t, events, began):
    """Take over the mode that was chosen, and log the guides whose mode it changes; returns the events so far."""
    for f in range(len(s.slip)):
        if began and s.slip[f] != s.old_slip[f] and events < len(log.t):
            kind = SLIP if s.old_slip[f] == 0 else STICK if s.slip[f] == 0 else REVERSAL
            log.t[events], log.kind[events], log.guide[events] = t, kind, f
            events += 1
        s.rest_speed[f] = HOLDS if s.slip[f] == 0 else LEAVES
    return events


@kernel
def _log_sides(m, beside, s, log, t, began, events):
    """Log the values before and after the events of an instant; return the solver's outcome."""
    for side in range(2):  # the mode that follows last: it leaves its corners' signs
        mode = s.slip if side else s.old_slip
        # laws are continuous from the right: their limits from the left are those of the time just before
        time = t if side else np.nextafter(t, -np.inf)
        outcome = _evaluate(m, beside, time, s.y, mode, s.corner, s.dy)
        if outcome != SOLVED:
            return outcome
        for i in range(began, events):
            write_sample(
                beside, s.y, s.dy, mode, log.motion[i, side], log.force[i, side], log.slip[i, side]
            )
    return SOLVED


@kernel
def _step_to_rest(
    m: Arrays, w: Workspace, s: State, t: float, rest: float
) -> tuple[int, float, int]:
    """Make a step of length `rest`, or up to the first slip velocity that changes its sign.

    Returns the solver's outcome, the step, and the guide that came to rest, or NO_GUIDE.
    """
    n, slip, y_new = len(m.inverse_mass), s.slip, s.y_new
    h = rest
    outcome = _runge_kutta(m, w, s, t, h)
    if outcome != SOLVED:
        return outcome, h, NO_GUIDE
    first, fraction = NO_GUIDE, 1.0
    row_form(m, w, t + h, y_new[:n], y_new[n:])
    for f in range(len(m.friction)):
        begin, end = slip[f] * s.start_speed[f], slip[f] * w.slip_speed[f]
        if slip[f] != 0 and end < 0.0:
            x = begin / (begin - end) if begin > 0.0 else 0.5
            if first == NO_GUIDE or x < fraction:
                first, fraction = f, x
    if first == NO_GUIDE:
        return SOLVED, rest, first
    low, low_value = 0.0, max(slip[first] * s.start_speed[first], 0.0)
    high, high_value = rest, slip[first] * w.slip_speed[first]
    floor = 1e-13 * max(abs(low_value), abs(high_value))
    for i in range(60):
        h = low + (high - low) * (
            low_value / (low_value - high_value) if i % 3 != 2 and low_value > 0.0 else 0.5
        )
        outcome = _runge_kutta(m, w, s, t, h)
        if outcome != SOLVED:
            return outcome, h, NO_GUIDE
        row_form(m, w, t + h, y_new[:n], y_new[n:])
        value = slip[first] * w.slip_speed[first]
        if abs(value) <= floor or high - low < 1e-15 * rest:
            break
        if value > 0.0:
            low, low_value = h, value
        else:
            high, high_value = h, value
    w.counters.rejected += 1
    return SOLVED, h, first


def simulate_as_paper(
    mechanism: Mechanism,
    q: np.ndarray,
    v: np.ndarray,
    dt: float,
    steps: int,
    every: int,
    solver: int = AUTOMATIC,
    sides: bool = True,
) -> Run:
    """March a mechanism from t = 0 as the paper does.

    `q` and `v` (3 * bodies,): the state there, on the constraints. `dt`: the step (s); of `steps` every `every`-th
    instant is kept. `solver`: one of `solver_names.SOLVERS`. `sides`: whether events carry the values before and after
    them, which takes two evaluations each, beyond those that are counted.

    The values of an event are those at its instant with the modes before and after it: a guide that breaks away is late
    by up to one step, so that before it has the acceleration, O(dt), with which it leaves the stick set. `breakdown`
    says where and why the scheme stopped early; the columns then end there.
    """
    started = clock()
    mechanism = mechanism.of_one_run()
    m, w = mechanism.arrays, workspace(mechanism.arrays, solver)
    n, nf = len(q), len(m.friction)
    samples, log = (
        Samples.room(m, steps // every + 1),
        EventLog.room(m, MOST_EVENTS, MOST_EVENTS if sides else 0),
    )
    samples.t[:] = np.arange(len(samples.t)) * (every * dt)
    state = State.zeros(
        y=2 * n,
        y_new=2 * n,
        stage=2 * n,
        dy=2 * n,
        slip=nf,
        old_slip=nf,
        corner=(nf, 2),
        rest_speed=nf,
        start_speed=nf,
    )
    state.y[:], state.corner[:] = np.concatenate([q, v]), 1
    task, prepared = Steps(dt, steps, every, int(mechanism.projection)), clock()
    code, written, events, reached = march(m, w, workspace(m, solver), state, task, samples, log)
    stepped = clock()
    columns, found, _, alternatives = columns_and_events(
        mechanism,
        [part[:written] for part in (samples.t, samples.motion, samples.force, samples.slip)],
        [part[:events] for part in log],
        None,
        sides,
        dt,
    )
    return Run(
        samples.t[:written],
        columns,
        found,
        Cost(prepared - started, 0.0, stepped - prepared, named(w.counters)),
        breakdown_of(code, reached, mechanism, w, state.slip, state.corner),
        alternatives,
    )
