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
from stiction.reference_impl.friction.driven_guides import driven_speed, frictionless_forces
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
    FREE_LENGTH,
    NO_EVENT,
    NOISE,
    TO_EXPECTED_EVENT,
    TO_STOP,
    State,
    Task,
    error_along_motion,
    noise,
    remember,
    rounding_of_terms,
    state,
    take_step,
)
from stiction.reference_impl.integration.mode_switch import (
    COINCIDENCE,
    begin,
    cross_switch,
    room_needed,
    switch_mode,
)
from stiction.reference_impl.integration.result import (
    EventLog,
    Run,
    Samples,
    breakdown_of,
    columns_and_events,
)
from stiction.reference_impl.integration.right_hand_side import right_hand_side
from stiction.reference_impl.integration.several_motions import NEARLY_SEVERAL, end_at_several
from stiction.reference_impl.integration.spring_switch import begin_one_sided, switch_springs
from stiction.reference_impl.integration.step_audit import audit
from stiction.reference_impl.integration.step_limits import (
    TOLERATED,
    curve_ratio,
    limit_ratio,
    longest_step,
)
from stiction.reference_impl.multibody.dynamics import largest_speed, row_form
from stiction.reference_impl.multibody.guide_freedom import DRIVEN
from stiction.reference_impl.multibody.mechanism import Arrays, Mechanism, Workspace, workspace
from stiction.reference_impl.multibody.projection import project
from stiction.reference_impl.multibody.trajectory_columns import residual_norm, write_sample
from stiction.scenes import Cost

FIRST_STEP = 1e-3
"""Part of the run that the first step tries."""
CRAWL_STEPS, CRAWL_PROGRESS = 1000, 1e-5
"""So many steps must carry the run over this part of its time, or it is given up: 10^8 steps to the end."""
MAX_MISSES = 6
"""Times that a step is halved because its dense output did not find its event. The error of the dense output is of
order 8 in the step, so that 2^-48 of it is left."""
HALVED = 0.5
"""Factor by which a step that missed its event is shortened."""
MAX_REPEATS, SHORTENED = 3, 0.125
"""Times that a step is shortened, and the factor, where its stages do not resolve the event functions, and where a
search does not. A smooth function is resolved in a five-hundredth of the step. One that jumps, or is rounding near
zero, is resolved by no step; shortening is not tried again until a step has resolved all functions."""
SAFETY = 0.9
"""Multiply steps computed from the asymptotic behaviour of errors by this: an estimated error is not exact."""
MIN_FACTOR, MAX_FACTOR = 0.2, 6.0
"""Limits of the ratio of a step to the one before, as Hairer, Norsett & Wanner have them for DOP853: an estimate of the
error does not hold far from the step that it was made for."""
ERROR_EXPONENT = -1.0 / 8.0
"""The error estimate of DOP853 is of order 8 in the step, so that the step goes with the eighth root of the error."""
NOT_FINITE_FACTOR = 0.1
"""Factor by which a step is shortened whose error is not finite, and tells nothing about a better step."""
LEAST_STEP_NOT_FINITE = 1e-10
"""Part of the run below which such a step is not shortened further: the state itself has no finite accelerations."""
SLIVER = 0.01
"""Part of a step by which it is lengthened to reach the end of the run or a kink: no tiny step is left over."""
RESOLVED = 4e-16
"""Smallest difference of times that is resolved, relative to the largest time: two roundings of double precision."""
LEAST_BY_BODY = 1e-10
"""Least tolerance at which the error of a mechanism without friction is estimated body by body. Below it, steps are
short enough to make no difference, and near a singular position the rounding of one body would be taken for an error.
"""
ON_CONSTRAINTS = 1e-14
"""Residual relative to the mechanism's size or its largest speed up to which a state is not projected: some tens of
roundings of double precision."""
DISPLACED = 1e-7
"""Part of the step by which projection may displace an event that is left where it is. An event function changes by a
few times its largest value in a step, so that it is zero to less than columns are compared to
(`force_coherence.SAME`)."""
NOT_IN_STEP, AT_START, WITHIN, NEAR_END = range(4)
"""Where `_locate` expects the first event of a step: in no part of it; so near its start that the mode must be left at
once; at a zero of the dense output; near its end, as predicted by the step before."""


LOG_ROOM = 256
"""Events that the log has room for, beside those of a last instant, before it is emptied."""
HEADER_ARRAYS = 4
"""First arrays of an `EventLog`: time, kind, guide and number of other modes; those behind have the values of columns.
"""


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
        # where a law switches, forces may jump, and with them the contact mode
        if p.next_switch < len(task.switches) and task.switches[p.next_switch] <= p.time:
            outcome = cross_switch(m, w, s, log, task)
            if outcome != DONE:
                return outcome
        # y' and the event functions at the start of the step; they are at hand behind a step that ended as attempted
        if p.stale:
            _refresh(m, w, s)
        # samples at the state itself: the start of the run, and instants at which a step happened to end
        while p.next_output < len(samples.t) and samples.t[p.next_output] <= p.time:
            if not _emit(m, w, s, samples, p.time, s.y):
                return NOT_FINITE
        if p.time >= task.t_end:
            return DONE
        if w.counters.steps >= task.step_limit:
            return STEP_LIMIT
        if not _propose(m, s, task):
            return STEP_TOO_SMALL
        # a step within the tolerance, which ends at its first event; a rejected one has left a shorter length in p.step
        outcome = _attempt(m, w, s, task)
        if outcome == REPEAT:
            continue
        if outcome != DONE:
            return outcome
        if not _locate(m, w, s, samples):
            continue
        _relocate_on_constraints(m, w, s, task)
        if step.near_several:
            end_at_several(m, w, s)
        # samples within the step, by its dense output, which spans the attempted length h whatever was accepted of it
        while p.next_output < len(samples.t) and samples.t[p.next_output] < p.time + step.length:
            dense_at(s.F, s.y, (samples.t[p.next_output] - p.time) / step.h, s.probe)
            if not _emit(m, w, s, samples, samples.t[p.next_output], s.probe):
                return NOT_FINITE
        outcome = _commit(m, w, s, task)
        # the contact problem is solved at events only: the new mode holds until the next of them
        if outcome == DONE and step.event != NO_EVENT:
            outcome = _switch(m, w, s, log, task.first_step)
        if outcome != DONE:
            return outcome


@kernel
def _switch(m, w, s, log, first_step):
    """Choose what follows the event at the state, of a guide or of a spring; return the outcome."""
    if s.attempt.event < 3 * len(m.friction):
        return switch_mode(m, w, s, log, first_step)
    return switch_springs(m, w, s, log, first_step)


@kernel
def _refresh(m: Arrays, w: Workspace, s: State) -> None:
    """Evaluate y' into K[0] and the event functions into `at_start`, of the state."""
    right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])
    remember(m, w, s)
    copy(w.event, s.at_start)
    s.progress.stale = 0


@kernel
def _propose(m: Arrays, s: State, task: Task) -> bool:
    """Choose the length of the next step; return False if it is too small for the resolution of time.

    The step passes neither the end of the run nor a kink of a law, is not longer than forces are resolved in
    (`longest_step`), and ends where an event is expected.
    """
    p, step = s.progress, s.attempt
    t, kinks = p.time, task.kinks

    # a step must not pass a kink: error estimate and dense output hold for smooth right-hand sides
    while p.next_kink < len(kinks) and kinks[p.next_kink] <= t:
        p.next_kink += 1
    stop = task.t_end
    if p.next_kink < len(kinks):
        stop = min(stop, kinks[p.next_kink])
    longest = longest_step(m, s, task.frequency) if len(s.at_start) > 0 else np.inf
    h = min(p.step, longest, stop - t)
    if stop - t - h < SLIVER * h and stop - t <= longest:
        h = stop - t
    step.stop = stop
    # laws are continuous from the right: a step that ends at a switch takes their limits from the left
    ends_at_switch = p.next_switch < len(task.switches) and task.switches[p.next_switch] == stop
    step.latest = np.nextafter(stop, -np.inf) if ends_at_switch else np.inf
    # where a drive may begin to dwell, the zero of a driven speed is not foreseen, but searched (`_rests_at_switch`)
    if ends_at_switch and p.expected_in < np.inf and _is_speed_of_driven(m, s, p.expected_event):
        p.expected_in = np.inf
    step.target = TO_STOP if h == stop - t else FREE_LENGTH
    step.resolution = RESOLVED * max(abs(t), abs(task.t_end))

    # a step that ends at the event as predicted needs no search: a correction by the secant method is enough
    if step.resolution < p.expected_in < h:
        h = p.expected_in
        step.target = TO_EXPECTED_EVENT
    p.expected_in = np.inf  # a prediction serves one attempt; `_commit` makes the next
    step.h = h
    return h > step.resolution or step.target == TO_STOP


@kernel
def _attempt(m: Arrays, w: Workspace, s: State, task: Task) -> int:
    """Make the step: DONE within the tolerance, else REPEAT with a shorter one, or why there is none."""
    p, step = s.progress, s.attempt
    h = step.h
    take_step(m, w, s, p.time, h)

    # The error of the motion. Without friction nothing but this error bounds the step, and each body has an estimate of
    # its own: one that turns fast would hide the error of another (`error_norm`).
    _set_scales(m, w, s, task.rtol)
    frictionless = len(m.friction) == 0 and m.rows > 0
    bodies = len(m.inverse_mass) // 3 if frictionless and task.rtol >= LEAST_BY_BODY else 0
    error = error_norm(s.K, h, s.scale, bodies)
    # near a singular position an error towards another branch of motion is no error along this one
    if 1.0 < error < np.inf and frictionless:
        error = error_along_motion(m, w, s, error, bodies)
    if not error <= 1.0:  # nan counts as too large
        w.counters.rejected += 1
        if np.isfinite(error):
            p.step = h * max(MIN_FACTOR, SAFETY * error**ERROR_EXPONENT)
        elif h < LEAST_STEP_NOT_FINITE * task.t_end:
            return NOT_FINITE
        else:
            p.step = NOT_FINITE_FACTOR * h
        return STEP_TOO_SMALL if p.step <= step.resolution else REPEAT

    # The limits of `longest_step` were computed at the start. Where bodies became faster within the step, forces may
    # have changed unseen between its stages.
    ratio = limit_ratio(m, s, task.frequency) if len(s.at_start) > 0 else 0.0
    curve = curve_ratio(m, s) if m.varying > 0 else 0.0
    ratio = max(ratio, curve)
    if ratio > TOLERATED:
        w.counters.rejected += 1
        p.step = h * max(MIN_FACTOR, SAFETY / ratio)
        return STEP_TOO_SMALL if p.step <= step.resolution else REPEAT

    # Event functions are made of forces, of which the error of the motion says nothing: if the stages do not resolve
    # them, a shorter step may. After MAX_REPEATS the step is accepted, as they are not smooth whatever its length.
    if are_resolved(s):
        p.unresolved_steps = 0
    elif p.unresolved_steps < MAX_REPEATS and SHORTENED * h > step.resolution:
        w.counters.rejected += 1
        p.unresolved_steps += 1
        p.step = SHORTENED * h
        return REPEAT

    # the gain at both ends tells whether `end_at_several` must look into the step
    step.gain, _ = gain_of_mode(m, w, s.slip)
    step.near_several = max(step.gain, p.gain) > NEARLY_SEVERAL
    step.is_ambiguous = 0

    growth = MAX_FACTOR
    if error > 0.0:
        growth = min(MAX_FACTOR, SAFETY * error**ERROR_EXPONENT)
    if curve > 0.0:
        # along a curve of friction the next step goes about as far as this one
        growth = min(growth, max(1.0, SAFETY / curve))
    step.proposal = h * growth
    if step.target != FREE_LENGTH:
        # the step was cut short by its target, not by its error: the length proposed before the cut still holds
        step.proposal = max(p.step, step.proposal)
    return DONE


@kernel
def _set_scales(m, w, s, rtol):
    """Set the tolerances per component: of lengths and angles by the mechanism's size, of speeds by the largest so far.

    No speed needs to be more accurate than the rounding of the accelerations times the step, which is all there is in a
    mechanism at rest. Nor than the change of the accelerations times the smallest resolved time, as where a load sets
    in within a nanosecond.
    """
    n = len(m.inverse_mass)
    h, K, scale = s.attempt.h, s.K, s.scale
    speed, rounding, jump = s.progress.speed, 0.0, 0.0
    # angular quantities are multiplied by the mechanism's size, so that all are compared in metres
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

    On return the step has its `event`, or NO_EVENT, and its accepted `length`; y_new is the state at its end.
    """
    p, step = s.progress, s.attempt
    t, h = p.time, step.h

    # A step that was made to end at an expected event is expected to end near it. Its stages tell how far the zero is
    # from its end (`correction`, in steps), without further evaluations.
    correction = np.inf
    if step.target == TO_EXPECTED_EVENT and falls_to_end(s, p.expected_event):
        correction = zero_near_end(s.at_start, s.at_stages, p.expected_event)
    is_near_end = abs(correction) < NEAR

    # The bound of `event_location` on the values at the stages excludes a zero of any other function in nearly all
    # steps. A step is searched only where it does not.
    is_searched = may_vanish(s, p.expected_event if is_near_end else NO_EVENT)

    # The dense output costs three evaluations, and is made only for those who read it: the search, the samples (the
    # corrections near the end may lengthen the step), and the search for several motions. The rows of the workspace are
    # then those of an extra stage, and no longer those of the end.
    reach = (LONGER if is_near_end else 1.0) * h
    is_sampled = p.next_output < len(samples.t) and samples.t[p.next_output] < t + reach
    step.has_rows = not (is_searched or is_sampled or step.near_several != 0)
    if not step.has_rows:
        _make_dense_output(m, w, s)

    # where in the step its first event is
    step.event, step.fraction = NO_EVENT, 1.0
    place, slope = NOT_IN_STEP, 0.0
    if is_searched:
        step.fraction, step.event, slope = first_root(m, w, s)
        if step.unresolved == 0:
            p.unresolved_searches = 0
        elif p.unresolved_searches < MAX_REPEATS:
            # The step is too long for its event functions. Those that no step resolves, as they jump, are judged by
            # their values at the nodes: `first_root` has done so when MAX_REPEATS shorter steps did not help.
            p.unresolved_searches += 1
            _repeat_with(w, s, SHORTENED * h)
            return False
        if step.event != NO_EVENT and _rests_at_switch(m, w, s):
            step.event, step.fraction = NO_EVENT, 1.0
        if step.event != NO_EVENT:
            place = WITHIN
            # a function that is zero at the start and falls from there: the event is at the state itself
            begins_at_zero = s.at_start[step.event] <= AT_ONCE * noise(s, step.event)
            if step.fraction < BESIDE and begins_at_zero:
                place = AT_START
    elif is_near_end:
        place = NEAR_END
        step.event = p.expected_event

    # Go there. The dense output is less accurate than a step, by one order, so that the end of the step is taken by a
    # step of that length, and corrected by the secant method on the event function itself.
    step.length, reached = h, True
    if place == AT_START:
        reached = False  # no step can end there: a shorter one may show that the function does not fall at once
    elif place == WITHIN:
        length = step.fraction * h
        take_step(m, w, s, t, length)
        correction = -s.at_stages[STAGES - 1, step.event] * h / slope
        step.length, reached = go_to_event(m, w, s, length, correction, SLOPE, False)
        if t + step.length > step.stop:
            # the event is behind the stop, and belongs to a later step: this one is taken to its end after all
            take_step(m, w, s, t, h)
            step.length, step.event = h, NO_EVENT
            place, reached = NOT_IN_STEP, True
    elif place == NEAR_END:
        step.length, reached = go_to_event(m, w, s, h, correction * h, NEAR, True)
        step.fraction = step.length / h
        if t + step.length > step.stop:
            # there is no event before the stop: take a step that ends there
            _repeat_with(w, s, max(p.step, step.stop - t))
            return False

    # The dense output was not accurate enough to find the event, or its place. Its error is of order 8 in the step:
    # a step that ends at half the way to the event makes it accurate.
    if not reached and p.misses < MAX_MISSES:
        p.misses += 1
        way = 1.0 if place == AT_START else max(step.fraction, BESIDE)
        _repeat_with(w, s, HALVED * way * h)
        return False
    p.misses = 0

    # after MAX_MISSES the step ends where the search has led to
    step.end_moved = step.event != NO_EVENT
    if place == AT_START:
        step.length = 0.0
    elif not reached and w.event[step.event] > noise(s, step.event):
        step.event = NO_EVENT  # it comes near zero, and does not pass it
    return True


@kernel
def _is_speed_of_driven(m, s, e):
    """Return True if event function e is the slip speed of a guide that drives move."""
    f = e // 3
    return e % 3 == 0 and s.slip[f] != 0 and m.friction[f].freedom == DRIVEN


@kernel
def _rests_at_switch(m, w, s):
    """Return True if the event of the step is no reversal of a driven guide, which comes to rest where the step ends.

    A drive that begins to dwell at a switch of its law brings its guides to rest with a speed that has a zero of higher
    order there. The zeros near the end that rounding, or the error of the step, makes of it are no events: the mode is
    chosen at the switch. What the drives do between such a zero and the end tells: a guide that reverses has a speed
    there. The rows of the workspace are changed.
    """
    p, step = s.progress, s.attempt
    n, e = len(m.inverse_mass), step.event
    ends_at_switch = step.latest < np.inf and step.target == TO_STOP
    if not (ends_at_switch and _is_speed_of_driven(m, s, e)):
        return False

    # the slip velocity of velocities on the constraints, which those of the dense output are not
    middle = 0.5 * (step.fraction + 1.0)
    dense_at(s.F, s.y, middle, s.probe)
    row_form(m, w, p.time + middle * step.h, s.probe[:n], s.probe[n:])
    frictionless_forces(m, w, w.phi_dot)
    speed = s.slip[e // 3] * driven_speed(m, w, e // 3)
    return speed >= -COINCIDENCE * p.speed


@kernel
def _relocate_on_constraints(m: Arrays, w: Workspace, s: State, task: Task) -> None:
    """Move the end of a step that ends at an event to that of the projected state, if projection displaces it.

    An event is located on states that are off the constraints by the error of the step; `_commit` then projects its
    state. At a loose tolerance the event function of the projected state is zero at another instant. The mode behind
    would begin with a sign that has not changed yet, or has changed already, and other event functions that pass zero
    in the same instant would be on the wrong side of it as well. A displacement of up to DISPLACED is left.
    """
    p, step = s.progress, s.attempt
    if not task.projecting or step.event == NO_EVENT or step.length == 0.0:
        return
    n, h, e = len(m.inverse_mass), step.h, step.event
    time = p.time + step.length

    # the event function of the state as `_commit` will project it; `y_old` is free until then
    copy(s.y_new, s.y_old)
    if not _project(m, w, s, time, s.y_old, False):
        return
    right_hand_side(m, w, time, s.y_old, s.slip, s.corner, s.dy)
    value = w.event[e]
    if not abs(value) > noise(s, e):
        return

    # its slope, along the motion of the projected state
    for k in range(2 * n):
        s.probe[k] = s.y_old[k] + BESIDE * h * s.dy[k]
    right_hand_side(m, w, time + BESIDE * h, s.probe, s.slip, s.corner, s.K[1])
    slope = (w.event[e] - value) / (BESIDE * h)
    if not slope < 0.0:
        return  # it does not fall: there is no event to go to
    correction = -value / slope
    if not DISPLACED * h < abs(correction) < NEAR * h:
        return
    # the event must stay within the step, and before samples that `_locate` has made no dense output for
    length = step.length + correction
    if not 0.0 < length < (LONGER - NEAR) * h or time + correction > step.stop:
        return

    # Go on from the projected state, which stays on the constraints over so short a way. Stages 4 and 5 of the step are
    # not read any more, and keep the state and y' as they are.
    copy(s.y_new, s.K[4])
    copy(s.K[STAGES], s.K[5])
    copy(s.y_old, s.y_new)
    copy(s.dy, s.K[STAGES])
    s.at_stages[STAGES - 1, e] = value
    length, reached = go_to_event(m, w, s, step.length, correction, SLOPE, False)
    if reached and is_finite(s.y_new) and is_finite(s.K[STAGES]):
        step.length = length
    else:
        # forces that grow without bound beside the event leave no way to it: it stays where it was found
        copy(s.K[4], s.y_new)
        copy(s.K[5], s.K[STAGES])


@kernel
def _make_dense_output(m, w, s):
    """Make the dense output of the step, F, by the three extra stages of DOP853."""
    for i in range(EXTRA):
        stage = STAGES + 1 + i
        combine(s.K, A_EXTRA[i], stage, s.attempt.h, s.y, s.probe)
        time = s.progress.time + C_EXTRA[i] * s.attempt.h
        right_hand_side(m, w, time, s.probe, s.slip, s.corner, s.K[stage])
    dense_coefficients(s.K, s.attempt.h, s.y, s.y_new, s.F)


@kernel
def _repeat_with(w, s, length):
    """Reject the step, and propose another length."""
    s.progress.step = length
    w.counters.rejected += 1


@kernel
def _emit(m: Arrays, w: Workspace, s: State, samples: Samples, t: float, y: Reals) -> bool:
    """Write the next sample, of the state y at t; False if it is not finite."""
    i = s.progress.next_output
    right_hand_side(m, w, t, y, s.slip, s.corner, s.dy)
    if not is_finite(s.dy):
        return False
    write_sample(w, y, s.dy, s.slip, samples.motion[i], samples.force[i], samples.slip[i])
    # the rows of this state are at hand
    samples.residual[i, 0], samples.residual[i, 1] = residual_norm(w.phi), residual_norm(w.phi_dot)
    s.progress.next_output += 1
    return True


@kernel
def _commit(m: Arrays, w: Workspace, s: State, task: Task) -> int:
    """Make the end of the step the state, projected and audited; DONE, or why the run ends."""
    p, step = s.progress, s.attempt
    t, n = p.time, len(m.inverse_mass)
    w.counters.steps += 1

    # a run that will not reach its end in any reasonable time is given up
    if w.counters.steps % CRAWL_STEPS == 0:
        if t - p.checked < CRAWL_PROGRESS * task.t_end:
            return CRAWL
        p.checked = t

    # Uniqueness is lost: the run ends at the instant itself. The rows are those just behind it, where the motions can
    # be counted, because there the linear system is singular no longer.
    if step.is_ambiguous:
        dense_at(s.F, s.y, step.counted, s.probe)
        row_form(m, w, t + step.counted * step.h, s.probe[:n], s.probe[n:])
        dense_at(s.F, s.y, step.fraction, s.probe)
        copy(s.probe, s.y)
        p.time = t + step.length
        return SEVERAL

    # a step to a stop ends exactly there, whatever the rounding of t + h: laws have their kinks at these times
    t_new = t + step.length
    if step.target == TO_STOP and not step.end_moved:
        t_new = step.stop
    has_rows = step.has_rows != 0 and step.end_moved == 0 and t_new == t + step.h

    if not step.end_moved:
        _expect_event(m, w, s)

    # step.gain is that of the attempted end: where the end was moved, the larger one of both ends is kept
    p.stale = not has_rows
    p.step = step.proposal
    p.gain = max(step.gain, p.gain) if step.end_moved else step.gain
    if step.length > 0.0:
        copy(s.y, s.y_old)
        copy(s.y_new, s.y)
        p.time, p.idle = t_new, 0
        if task.projecting and _project(m, w, s, t_new, s.y, has_rows):
            w.counters.projections += 1
            p.stale = 1

    # the scales of the audit are those before this state: it does not depend on whether there was output in the step
    speed, force = p.speed, p.force
    if not p.stale:
        remember(m, w, s)
    if task.audits and step.length > step.resolution and not audit(m, w, s, task, t, speed, force):
        return AUDIT

    # the last stage of this step is the first of the next, unless a new mode begins
    if step.event == NO_EVENT and not p.stale:
        copy(s.K[STAGES], s.K[0])
        copy(s.at_stages[STAGES - 1], s.at_start)
    return DONE


@kernel
def _expect_event(m, w, s):
    """Predict the first event after the step from its stages: the next step ends there."""
    p, step = s.progress, s.attempt
    for e in range(len(w.event)):
        largest = max(abs(s.at_start[e]), abs(s.at_stages[STAGES - 1, e]))
        if largest <= rounding_of_terms(m, w, s, e):
            continue  # as of the corners of a guide without any load: its zeros are no events
        distance = zero_near_end(s.at_start, s.at_stages, e)
        if BESIDE < distance < p.expected_in / step.h:
            p.expected_in = distance * step.h
            p.expected_event = e


@kernel
def _project(m, w, s, t, y, has_rows):
    """Project a state y at t if its residuals exceed rounding; returns whether it was changed.

    has_rows : the rows in the workspace are those of this state.
    """
    n = len(m.inverse_mass)
    if not has_rows:
        row_form(m, w, t, y[:n], y[n:])
    # the speeds of a mechanism at rest are the rounding of what its bodies would reach without joints in this step
    speed = max(s.progress.speed, largest_speed(m, w.free) * s.attempt.length)
    position, velocity = 0.0, 0.0
    for r in range(m.rows):
        position = max(position, abs(w.phi[r]))
        velocity = max(velocity, abs(w.phi_dot[r]))
    # a guide at rest is one more constraint on velocities
    holds = False
    for f in range(len(m.friction)):
        if sticks(m, s.slip, f):
            holds = True
            velocity = max(velocity, abs(w.slip_speed[f]))
    if position <= ON_CONSTRAINTS * m.length_scale and velocity <= ON_CONSTRAINTS * speed:
        return False
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
        mechanism = mechanism.of_one_run()
        m, frictional = mechanism.arrays, len(mechanism.guide_names)
        self._mechanism = mechanism
        self._output = np.array(output, dtype=float)
        self._options = options
        self._workspace = workspace(m, options.solver)
        one_sided = len(m.one_sided)
        has_events = frictional + one_sided > 0
        self._state = state(q, v, frictional, one_sided)
        fastest = mechanism.fastest_law() if has_events else 0.0
        switches, switched = mechanism.switches(t_end)
        self._task = Task(
            t_end=t_end,
            rtol=rtol,
            first_step=FIRST_STEP * t_end,
            frequency=fastest,
            audits=options.audits,
            projecting=int(mechanism.projection),
            step_limit=options.step_limit,
            kinks=mechanism.kinks(t_end),
            switches=switches,
            switched=switched,
        )
        self._state.progress["step"] = self._task.first_step
        self._state.progress["length"] = m.length_scale
        longest = longest_step(m, self._state, fastest) if has_events else np.inf
        self._state.attempt["h"] = min(self._task.first_step, longest)
        self._code = DONE
        if one_sided:
            begin_one_sided(m, self._workspace, self._state)
        if frictional:
            self._code = begin(m, self._workspace, self._state, mechanism.largest_load())
        self._setup_s = clock() - started

    def forces_at(
        self, t: float, q: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return accelerations, event functions and row forces of another state.

        The contact mode is that at the end of the run.
        """
        m, w, s = self._mechanism.arrays, self._workspace, self._state
        dy = np.zeros(2 * len(q))
        right_hand_side(m, w, t, np.concatenate([q, v]), s.slip, s.corner, dy)
        if m.unfree > 0:
            # corner forces themselves, not what `open_forces.bounded` makes of them, which depends on mobilities
            event_functions(m, w, s.slip, s.corner)
        return dy[len(q) :], w.event.copy(), w.force.copy()

    @cached_property
    def run(self) -> Run:
        """Return the result of the integration that has been stepped.

        `breakdown` says where and why it stopped early; the columns then end there. One that stops at the start has the
        state there, and accelerations and forces that are nan.
        """
        started = clock()
        mechanism, options, output = self._mechanism, self._options, self._output
        m, w, s = mechanism.arrays, self._workspace, self._state
        n, progress = len(m.inverse_mass), s.progress
        # all guides and springs may change in one event, and all laws may switch at once
        room = LOG_ROOM + room_needed(m)
        samples, log = Samples.room(m, len(output)), EventLog.room(m, room, room)
        samples.t[:] = output
        logged = [[part[:0] for part in log]]

        # kernels cannot enlarge the log: each time that it is full it is copied and emptied, and the run goes on
        prepared = clock()
        code = ROOM if self._code == DONE else self._code
        while code == ROOM:
            progress["stale"] = 1
            progress["misses"] = 0
            progress["logged"] = 0
            progress["expected_in"] = np.inf
            code = _march(m, w, s, self._task, samples, log, options.ends)
            logged.append(_copy_of_log(log, int(progress["logged"]), options.sides))
        stepped = clock()

        samples_written = int(progress["next_output"])
        residual: np.ndarray | None = samples.residual[:samples_written]
        if code != DONE and not samples_written and len(output) and output[0] == 0.0:
            # it stopped at once: the start is known, accelerations and forces are not
            samples.motion[0, 0] = s.y[:n]
            samples.motion[0, 1] = s.y[n:]
            samples.motion[0, 2] = np.nan
            samples.force[0] = np.nan
            samples.slip[0] = s.slip
            samples_written = 1
            residual = None
        events_of_run = [np.concatenate(parts) for parts in zip(*logged)]
        first = np.searchsorted(events_of_run[0], options.events_behind, side="right")
        columns, events, switches, alternatives = columns_and_events(
            mechanism,
            [
                part[:samples_written]
                for part in (samples.t, samples.motion, samples.force, samples.slip)
            ],
            [part[first:] for part in events_of_run],
            options.names,
            options.sides,
            self._task.first_step,
            residual,
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
        return Run(
            output[:samples_written], columns, events, cost, breakdown, alternatives, switches
        )


def _copy_of_log(log: EventLog, count: int, sides: bool) -> list[np.ndarray]:
    """Return copies of the first `count` events of the log, array by array; without `sides`, none of their values."""
    return [part[: count if sides or i < HEADER_ARRAYS else 0].copy() for i, part in enumerate(log)]


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
    """Do the work of `integrate`, and record where each accepted step ends if `ends` are wanted."""
    if ends is None:
        return integrate(m, w, s, task, samples, log)
    while True:
        code = integrate(
            m, w, s, task.replaced(step_limit=int(w.counters["steps"]) + 1), samples, log
        )
        ends.append(float(s.progress["time"]))
        if code != STEP_LIMIT or w.counters["steps"] >= task.step_limit:
            return code
