"""Event-driven integration with frozen contact modes.

The HLCP decides the contact mode at the start and at events only. While a mode lasts the forces follow from one linear
solve (`frozen_mode`), the motion is smooth and DOP853 integrates it. A step is made to end where the next event is
expected; one within which an event cannot be excluded is searched, and repeated if there is one (`event_location`).
Each step is audited.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from stiction.reference_impl.compiled.bundle import Reals
from stiction.reference_impl.compiled.kernel import clock, kernel
from stiction.reference_impl.compiled.loops import copy, is_finite
from stiction.reference_impl.friction.coulomb import sticks
from stiction.reference_impl.friction.frozen_mode import event_functions
from stiction.reference_impl.friction.outcomes import (
    AUDIT,
    CRAWL,
    DONE,
    NOT_FINITE,
    REPEAT,
    ROOM,
    SEVERAL,
    STEP_LIMIT,
    STEP_TOO_SMALL,
)
from stiction.reference_impl.friction.solver_names import AUTOMATIC, named
from stiction.reference_impl.friction.uniqueness import gain_of_mode
from stiction.reference_impl.integration.dop853 import (
    A_EXTRA,
    C_EXTRA,
    EXTRA,
    STAGES,
    combine,
    dense_at,
    dense_coefficients,
    error_norm,
)
from stiction.reference_impl.integration.event_location import (
    BESIDE,
    LONGER,
    NEAR,
    SLOPE,
    are_resolved,
    falls_to_end,
    first_root,
    go_to_event,
    may_vanish,
    zero_near_end,
)
from stiction.reference_impl.integration.integration_state import (
    AT_ONCE,
    NO_EVENT,
    NOISE,
    State,
    Task,
    error_along_motion,
    noise,
    remember,
    rounding_of_terms,
    state,
    take_step,
)
from stiction.reference_impl.integration.mode_switch import begin, switch_mode
from stiction.reference_impl.integration.result import (
    EventLog,
    Run,
    Samples,
    breakdown_of,
    columns_and_events,
)
from stiction.reference_impl.integration.right_hand_side import right_hand_side
from stiction.reference_impl.integration.several_motions import NEARLY_SEVERAL, end_at_several
from stiction.reference_impl.integration.step_audit import audit
from stiction.reference_impl.integration.step_limits import TOLERATED, excess, longest_step
from stiction.reference_impl.multibody.dynamics import largest_speed, row_form
from stiction.reference_impl.multibody.kinematics import workspace
from stiction.reference_impl.multibody.mechanism import Arrays, Mechanism, Workspace
from stiction.reference_impl.multibody.projection import project
from stiction.reference_impl.multibody.trajectory_columns import write_sample
from stiction.scenes import Cost

FIRST_STEP = 1e-3
"""Part of the run that the first step tries."""
CRAWL_STEPS, CRAWL_PROGRESS = 1000, 1e-5
"""So many steps must carry the run over this part of its time, or it is given up: 10^8 steps to the end."""
MISSES = 6
"""Times that a step is halved because its dense output did not find its event: of that error, of order 8 in the step,
2^-48 is left."""
REPEATS, SHORTENED = 3, 0.125
"""Times that a step is made shorter, and the part of it that is left, where its stages do not resolve the event
functions, and where a search does not. A smooth one is resolved in a five-hundredth of the step; one that jumps, or is
noise near zero, in none, and is not tried again until a step has resolved all."""
SAFETY = 0.9
"""Part of the step that its error would allow which is tried next: an estimated error is not exact."""
MIN_FACTOR, MAX_FACTOR = 0.2, 6.0
"""Limits of the ratio of a step to the one before, as Hairer, Norsett & Wanner have them for DOP853: far from the last
step an estimate of its error does not hold."""
ORDER = 8
"""Order of the error estimate in the step, of which the root is taken."""
WITHOUT_END = 0.1
"""Part of a step to which it is shortened where its error is not finite."""
SLIVER = 0.01
"""Part of a step by which it is prolonged rather than that a step so short follows before the end or a kink."""
RESOLVED = 4e-16
"""Distance of times that can be told from each other, relative to the largest: two roundings of double precision."""
LEAST_BY_BODY = 1e-10
"""Tolerance from which on the error of a mechanism without friction is estimated body by body. Below, steps are short
enough to make no difference, and near a singular position rounding of one body would be taken for an error."""


@kernel
def integrate(
    m: Arrays, w: Workspace, s: State, task: Task, samples: Samples, log: EventLog
) -> int:
    """Integrate from the state to t_end, filling samples and the event log; returns a termination code.

    The motion does not depend on the samples: they are read from the dense output of steps that are taken without
    regard to them. ROOM: the log is full; empty it and call again. STEP_LIMIT: with a larger one the next call goes on.
    """
    p, step = s.progress, s.attempt
    while True:
        if p.fresh:
            _refresh(m, w, s)
        while p.next_output < len(samples.t) and samples.t[p.next_output] <= p.time:
            if not _emit(m, w, s, samples, p.time, s.y):
                return NOT_FINITE
        if p.time >= task.t_end:
            return DONE
        if w.counters.steps >= task.step_limit:
            return STEP_LIMIT
        if not _propose(m, s, task):
            return STEP_TOO_SMALL
        outcome = _attempt(m, w, s, task)
        if outcome == REPEAT or outcome == DONE and not _locate(m, w, s, samples):
            continue
        if outcome != DONE:
            return outcome
        if step.critical:
            end_at_several(m, w, s)
        while p.next_output < len(samples.t) and samples.t[p.next_output] < p.time + step.length:
            dense_at(s.F, s.y, (samples.t[p.next_output] - p.time) / step.h, s.probe)
            if not _emit(m, w, s, samples, samples.t[p.next_output], s.probe):
                return NOT_FINITE
        outcome = _commit(m, w, s, task)
        if outcome == DONE and step.event != NO_EVENT:
            outcome = switch_mode(m, w, s, log, task.first_step)
        if outcome != DONE:
            return outcome


@kernel
def _refresh(m: Arrays, w: Workspace, s: State) -> None:
    """y' and the event functions of the state."""
    right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])
    remember(m, w, s)
    copy(w.event, s.at_start)
    s.progress.fresh = 0


@kernel
def _propose(m: Arrays, s: State, task: Task) -> bool:
    """Length of the next step: not past the end or a kink, nor longer than forces are resolved in (`longest_step`).

    It ends where an event is expected. False if time cannot resolve it.
    """
    p, step, kinks = s.progress, s.attempt, task.kinks
    t = p.time
    while p.next_kink < len(kinks) and kinks[p.next_kink] <= t:
        p.next_kink += 1
    stop = task.t_end
    if p.next_kink < len(kinks):
        stop = min(stop, kinks[p.next_kink])
    longest = longest_step(m, s, task.frequency) if len(m.friction) > 0 else np.inf
    h = min(p.step, longest, stop - t)
    if stop - t - h < SLIVER * h and stop - t <= longest:
        h = stop - t
    step.stop, step.reaches_stop, step.aims = stop, h == stop - t, 0
    step.resolution = RESOLVED * max(abs(t), abs(task.t_end))
    if step.resolution < p.aim < h:
        h, step.reaches_stop, step.aims = p.aim, 0, 1
    p.aim = np.inf
    step.h = h
    return h > step.resolution or step.reaches_stop != 0


@kernel
def _attempt(m: Arrays, w: Workspace, s: State, task: Task) -> int:
    """Make the step: DONE within the tolerance, else REPEAT with a shorter one, or why there is none."""
    p, step = s.progress, s.attempt
    h = step.h
    take_step(m, w, s, p.time, h)
    _scales(m, w, s, task.rtol)
    smooth = len(m.friction) == 0 and m.rows > 0
    bodies = len(m.inverse_mass) // 3 if smooth and task.rtol >= LEAST_BY_BODY else 0
    error = error_norm(s.K, h, s.scale, bodies)
    if 1.0 < error < np.inf and smooth:
        error = error_along_motion(m, w, s, error, bodies)
    if not error <= 1.0:
        w.counters.rejected += 1
        if not np.isfinite(error):
            if h < 1e-10 * task.t_end:
                return NOT_FINITE
            p.step = WITHOUT_END * h
        else:
            p.step = h * max(MIN_FACTOR, SAFETY * error ** (-1.0 / ORDER))
        return STEP_TOO_SMALL if p.step <= step.resolution else REPEAT
    too_long = excess(m, s, task.frequency) if len(m.friction) > 0 else 0.0
    if too_long > TOLERATED:
        # what turns or passes in it became faster than at its start: forces may have changed unseen
        w.counters.rejected += 1
        p.step = h * max(MIN_FACTOR, SAFETY / too_long)
        return STEP_TOO_SMALL if p.step <= step.resolution else REPEAT
    if are_resolved(s):
        p.blurred = 0
    elif p.blurred < REPEATS and SHORTENED * h > step.resolution:
        w.counters.rejected += 1
        p.blurred += 1
        p.step = SHORTENED * h
        return REPEAT
    step.gain, _ = gain_of_mode(m, w, s.slip)
    step.critical, step.lost = max(step.gain, p.gain) > NEARLY_SEVERAL, 0
    growth = min(MAX_FACTOR, SAFETY * error ** (-1.0 / ORDER)) if error > 0.0 else MAX_FACTOR
    step.proposal = max(p.step, h * growth) if step.reaches_stop or step.aims else h * growth
    return DONE


@kernel
def _scales(m, w, s, rtol):
    """Tolerances per component: lengths and angles by the mechanism's size, speeds by the largest so far.

    No speed is asked to be better than the rounding of the accelerations, which is all there is in a mechanism at rest.
    Nor need it be better than what they change in the time that a clock cannot resolve, as where a load comes within a
    nanosecond.
    """
    n, h, K, scale, jump = len(m.inverse_mass), s.attempt.h, s.K, s.scale, 0.0
    speed, rounding = s.progress.speed, 0.0
    for i in range(n // 3):
        for k in range(3):
            unit = m.length_scale if k == 2 else 1.0
            speed = max(speed, abs(K[0, n + 3 * i + k]) * unit * h)
            rounding = max(rounding, NOISE * abs(w.free[3 * i + k]) * unit * h)
            jump = max(jump, abs(K[STAGES, n + 3 * i + k] - K[0, n + 3 * i + k]) * unit)
    rounding = max(rounding, jump * s.attempt.resolution)
    for i in range(n // 3):
        for k in range(3):
            unit = m.length_scale if k == 2 else 1.0
            scale[3 * i + k] = rtol * m.length_scale / unit
            scale[n + 3 * i + k] = max(rtol * speed, rounding) / unit


@kernel
def _locate(m: Arrays, w: Workspace, s: State, samples: Samples) -> bool:
    """Find the first event of the step, and end the step there; False if the step must be repeated, shorter.

    Its dense output is made where an event or a sample may be in it, or several motions.
    """
    p, step = s.progress, s.attempt
    t, h, ahead = p.time, step.h, np.inf
    if step.aims and falls_to_end(s, p.aimed):
        ahead = zero_near_end(s.at_start, s.seen, p.aimed)
    meets = abs(ahead) < NEAR
    suspicious = may_vanish(s, p.aimed if meets else NO_EVENT)
    output = (
        p.next_output < len(samples.t)
        and samples.t[p.next_output] < t + (LONGER if meets else 1.0) * h
    )
    step.event, step.fraction, slope = NO_EVENT, 1.0, 0.0
    step.has_rows = not (suspicious or output or step.critical != 0)
    if not step.has_rows:
        for i in range(EXTRA):
            combine(s.K, A_EXTRA[i], STAGES + 1 + i, h, s.y, s.probe)
            right_hand_side(
                m, w, t + C_EXTRA[i] * h, s.probe, s.slip, s.corner, s.K[STAGES + 1 + i]
            )
        dense_coefficients(s.K, h, s.y, s.y_new, s.F)
    if suspicious:
        step.fraction, step.event, slope = first_root(m, w, s)
        if step.unresolved == 0:
            p.searched = 0
        elif p.searched < REPEATS:
            # too long for these functions; those that no step resolves are judged by their values at the nodes
            p.step = SHORTENED * h
            p.searched += 1
            w.counters.rejected += 1
            return False
    step.length, met = h, True
    at_once = (
        step.event != NO_EVENT
        and step.fraction < BESIDE
        and s.at_start[step.event] <= AT_ONCE * noise(s, step.event)
    )
    if at_once:
        met = False
    elif step.event != NO_EVENT:
        length = step.fraction * h
        take_step(m, w, s, t, length)
        correction = -s.seen[STAGES - 1, step.event] * h / slope
        step.length, met = go_to_event(m, w, s, length, correction, SLOPE, False)
    elif meets and not suspicious:
        step.event = p.aimed
        step.length, met = go_to_event(m, w, s, h, ahead * h, NEAR, True)
        step.fraction = step.length / h
        if t + step.length > step.stop:
            p.step = max(
                p.step, step.stop - t
            )  # there is none before the stop: a step that ends there
            w.counters.rejected += 1
            return False
    if step.event != NO_EVENT and not at_once and t + step.length > step.stop:
        take_step(m, w, s, t, h)
        step.length, step.event, met = h, NO_EVENT, True
    if not met and p.missed < MISSES:
        # the dense output was not accurate enough to find it, or to find its place: a shorter step makes it so
        p.step = 0.5 * (1.0 if at_once else max(step.fraction, BESIDE)) * h
        p.missed += 1
        w.counters.rejected += 1
        return False
    step.shorter = step.event != NO_EVENT
    if at_once:
        step.length = 0.0
    elif not met and w.event[step.event] > noise(s, step.event):
        step.event = NO_EVENT  # it comes near zero, and does not pass it
    p.missed = 0
    return True


@kernel
def _emit(m: Arrays, w: Workspace, s: State, samples: Samples, t: float, y: Reals) -> bool:
    """Write the next sample, of the state y at t; False if it is not finite."""
    i = s.progress.next_output
    right_hand_side(m, w, t, y, s.slip, s.corner, s.dy)
    if not is_finite(s.dy):
        return False
    write_sample(w, y, s.dy, s.slip, samples.motion[i], samples.force[i], samples.slip[i])
    s.progress.next_output += 1
    return True


@kernel
def _commit(m: Arrays, w: Workspace, s: State, task: Task) -> int:
    """Make the end of the step the state, projected and audited; DONE, or why the run ends."""
    p, step = s.progress, s.attempt
    t, n = p.time, len(m.inverse_mass)
    w.counters.steps += 1
    if w.counters.steps % CRAWL_STEPS == 0:
        if t - p.checked < CRAWL_PROGRESS * task.t_end:
            return CRAWL
        p.checked = t
    if step.lost:
        dense_at(s.F, s.y, step.counted, s.probe)
        row_form(m, w, t + step.counted * step.h, s.probe[:n], s.probe[n:])
        dense_at(s.F, s.y, step.fraction, s.probe)
        copy(s.probe, s.y)
        p.time = t + step.length
        return SEVERAL
    t_new = step.stop if step.reaches_stop and not step.shorter else t + step.length
    has_rows = step.has_rows != 0 and step.shorter == 0 and t_new == t + step.h
    if not step.shorter:
        for e in range(len(w.event)):
            if max(abs(s.at_start[e]), abs(s.seen[STAGES - 1, e])) <= rounding_of_terms(m, w, s, e):
                continue  # as of the corners of a guide without any load: its zeros are no events
            distance = zero_near_end(s.at_start, s.seen, e)
            if BESIDE < distance < p.aim / step.h:
                p.aim, p.aimed = distance * step.h, e
    p.fresh = not has_rows
    p.step, p.gain = step.proposal, max(step.gain, p.gain) if step.shorter else step.gain
    if step.length > 0.0:
        copy(s.y, s.y_old)
        copy(s.y_new, s.y)
        p.time, p.idle = t_new, 0
        if task.projecting and _project(m, w, s, has_rows):
            p.fresh = 1
    speed, force = p.speed, p.force  # audits do not depend on whether there was output in the step
    if not p.fresh:
        remember(m, w, s)
    if task.audits and step.length > step.resolution and not audit(m, w, s, task, t, speed, force):
        return AUDIT
    if step.event == NO_EVENT and not p.fresh:
        copy(s.K[STAGES], s.K[0])
        copy(s.seen[STAGES - 1], s.at_start)
    return DONE


@kernel
def _project(m, w, s, has_rows):
    """Project the state if its residuals exceed rounding; returns whether it was changed.

    has_rows : the rows in the workspace are those of this state.
    """
    n, t, y = len(m.inverse_mass), s.progress.time, s.y
    if not has_rows:
        row_form(m, w, t, y[:n], y[n:])
    # of a mechanism at rest the speeds are rounding of what its free bodies would reach
    position, velocity, speed = (
        0.0,
        0.0,
        max(s.progress.speed, largest_speed(m, w.free) * s.attempt.length),
    )
    for r in range(m.rows):
        position, velocity = max(position, abs(w.phi[r])), max(velocity, abs(w.phi_dot[r]))
    holds = False
    for f in range(len(m.friction)):
        if sticks(m, s.slip, f):
            holds, velocity = True, max(velocity, abs(w.slip_speed[f]))
    if position <= 1e-14 * m.length_scale and velocity <= 1e-14 * speed:
        return False
    w.counters.projections += 1
    project(m, w, t, y[:n], y[n:], s.slip, holds, 2)
    return True


@dataclass(frozen=True)
class Options:
    """Options of an integration besides its tolerance."""

    step_limit: int = 10_000_000
    """Accepted steps after which the run is given up."""
    solver: int = AUTOMATIC
    """One of `solver_names.SOLVERS`."""
    sides: bool = True
    """Whether events keep the values of the columns before and after them: of all, a kilobyte or more each."""
    audits: int = 1
    """Instants of each step at which Coulomb's law is verified; where it is violated the run ends."""
    names: Collection[str] | None = None
    """The columns that are wanted; all where None."""
    events_behind: float = -np.inf
    """Seconds; of the events those behind this instant are wanted."""
    ends: list[float] | None = None
    """A list that gets the ends of all accepted steps (s), and the instant of a breakdown."""


class Integration:
    """A motion of a mechanism from t = 0 with frozen contact modes and located events.

    Begun when this is made, stepped when its run is asked for. `q` and `v` (3 * bodies,): the state at t = 0, on the
    constraints. `output`: times, increasing, within [0, t_end]. `rtol`: local error per step relative to the
    mechanism's size (positions; 1 rad for angles) and to its largest speed so far (velocities).
    """

    def __init__(
        self,
        mechanism: Mechanism,
        q: np.ndarray,
        v: np.ndarray,
        output: np.ndarray,
        t_end: float,
        rtol: float,
        options: Options = Options(),
    ):
        started = clock()
        m, frictional = mechanism.arrays, len(mechanism.guide_names)
        self._mechanism, self._output, self._options = (
            mechanism,
            np.array(output, dtype=float),
            options,
        )
        self._workspace, self._state = workspace(m, options.solver), state(q, v, frictional)
        fastest = mechanism.fastest_law() if frictional else 0.0
        self._task = Task(
            t_end=t_end,
            rtol=rtol,
            first_step=FIRST_STEP * t_end,
            frequency=fastest,
            audits=options.audits,
            projecting=int(mechanism.projection),
            step_limit=options.step_limit,
            kinks=mechanism.kinks(t_end),
        )
        self._state.progress["step"] = self._task.first_step
        longest = longest_step(m, self._state, fastest) if frictional else np.inf
        self._state.attempt["h"] = min(self._task.first_step, longest)
        self._code = (
            begin(m, self._workspace, self._state, mechanism.largest_load()) if frictional else DONE
        )
        self._setup_s = clock() - started

    def forces_at(
        self, t: float, q: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Accelerations, event functions and row forces of another state, in the contact mode at the end of the run."""
        m, w, s, dy = self._mechanism.arrays, self._workspace, self._state, np.zeros(2 * len(q))
        right_hand_side(m, w, t, np.concatenate([q, v]), s.slip, s.corner, dy)
        if m.unfree > 0:
            # corner forces themselves, not what `open_forces.bounded` makes of them, which depends on mobilities
            event_functions(m, w, s.slip, s.corner)
        return dy[len(q) :], w.event.copy(), w.force.copy()

    @cached_property
    def run(self) -> Run:
        """Result of the integration, stepped.

        `breakdown` says where and why it stopped early; the columns then end there. One that stops at the start has the
        state there, and accelerations and forces that are nan.
        """
        started, mechanism, options, output = clock(), self._mechanism, self._options, self._output
        m, w, s = mechanism.arrays, self._workspace, self._state
        n, progress, room = len(m.inverse_mass), s.progress, 256 + len(m.friction)
        samples, log = Samples.room(m, len(output)), EventLog.room(m, room, room)
        samples.t[:] = output
        logged = [[part[:0] for part in log]]
        prepared, code = clock(), ROOM if self._code == DONE else self._code
        while code == ROOM:
            progress["fresh"], progress["missed"], progress["logged"], progress["aim"] = (
                1,
                0,
                0,
                np.inf,
            )
            code = _march(m, w, s, self._task, samples, log, options.ends)
            used = int(progress["logged"])
            logged.append(
                [part[: used if options.sides or i < 4 else 0].copy() for i, part in enumerate(log)]
            )
        stepped, reached = clock(), int(progress["next_output"])
        if code != DONE and not reached and len(output) and output[0] == 0.0:
            # it stopped at once: the start is known, accelerations and forces are not
            samples.motion[0, 0], samples.motion[0, 1], samples.motion[0, 2] = (
                s.y[:n],
                s.y[n:],
                np.nan,
            )
            samples.force[0], samples.slip[0], reached = np.nan, s.slip, 1
        events_of_run = [np.concatenate(parts) for parts in zip(*logged)]
        first = np.searchsorted(events_of_run[0], options.events_behind, side="right")
        columns, events, alternatives = columns_and_events(
            mechanism,
            [part[:reached] for part in samples],
            [part[first:] for part in events_of_run],
            options.names,
            options.sides,
            self._task.first_step,
        )
        if code in (NOT_FINITE, STEP_TOO_SMALL, CRAWL):
            # the workspace has the rows of a stage that failed: those of the last state tell why
            row_form(m, w, float(progress["time"]), s.y[:n], s.y[n:])
        breakdown = breakdown_of(
            code,
            float(progress["time"]),
            mechanism,
            w,
            s.slip,
            s.corner,
            (float(progress["speed"]) or 1.0, float(progress["force"]) or 1.0),
        )
        cost = Cost(self._setup_s + prepared - started, 0.0, stepped - prepared, named(w.counters))
        return Run(output[:reached], columns, events, cost, breakdown, alternatives)


def simulate_event_driven(
    mechanism: Mechanism,
    q: np.ndarray,
    v: np.ndarray,
    output: np.ndarray,
    t_end: float,
    rtol: float,
    **options: Any,
) -> Run:
    """Return the run of an `Integration`, of which these are the parameters and `Options`."""
    return Integration(mechanism, q, v, output, t_end, rtol, Options(**options)).run


def _march(
    m: Arrays,
    w: Workspace,
    s: State,
    task: Task,
    samples: Samples,
    log: EventLog,
    ends: list[float] | None,
) -> int:
    """Variant of `integrate` that notes where each accepted step ends if `ends` are wanted."""
    if ends is None:
        return integrate(m, w, s, task, samples, log)
    while True:
        code = integrate(
            m, w, s, task.replaced(step_limit=int(w.counters["steps"]) + 1), samples, log
        )
        ends.append(float(s.progress["time"]))
        if code != STEP_LIMIT or w.counters["steps"] >= task.step_limit:
            return code
