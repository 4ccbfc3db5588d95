"""Event-driven integration with frozen contact modes.

The HLCP decides the contact mode at the start and at events only. While a mode lasts the forces follow from one linear
solve (`frozen_mode`), the motion is smooth and DOP853 integrates it. A step is made to end where the next event is
expected; one within which an event cannot be excluded is searched, and repeated if there is one (`event_location`).
Each step is audited.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from stiction.reference_impl.compiled.bundle import Bundle, Reals
from stiction.reference_impl.compiled.kernel import clock, kernel
from stiction.reference_impl.compiled.loops import copy, is_finite
from stiction.reference_impl.friction.coulomb import can_jam
from stiction.reference_impl.friction.frozen_mode import ALL, choose_branches, margin, most_capacity
from stiction.reference_impl.friction.guides_at_rest import leave_together, rest_together
from stiction.reference_impl.friction.mode_choice import choose_mode, other_modes
from stiction.reference_impl.friction.outcomes import (AUDIT, CHATTER, CRAWL, DONE, JAM, NOT_FINITE, ROOM, SEVERAL,
                                                       SOLVED, STEP_LIMIT, STEP_TOO_SMALL)
from stiction.reference_impl.friction.solvers import AUTOMATIC, named
from stiction.reference_impl.friction.uniqueness import gain_of_mode, has_several
from stiction.reference_impl.integration.dop853 import combine, dense_at, dense_coefficients, error_norm
from stiction.reference_impl.integration.dop853_coefficients import A_EXTRA, C_EXTRA, EXTRA, STAGES
from stiction.reference_impl.integration.event_location import (BESIDE, LONGER, NEAR, SLOPE, falls_to_end, first_root,
                                                                go_to_event, may_vanish, zero_near_end)
from stiction.reference_impl.integration.integration_state import NOISE, State, noise, state, take_audit_step, take_step
from stiction.reference_impl.integration.result import (CORNER, EVENT_KINDS, REVERSAL, SLIP, STICK, EventLog, Run,
                                                        Samples, breakdown_of)
from stiction.reference_impl.integration.right_hand_side import right_hand_side
from stiction.reference_impl.multibody.dynamics import largest_force, row_form
from stiction.reference_impl.multibody.kinematics import Workspace, workspace
from stiction.reference_impl.multibody.mechanism import Arrays, Mechanism
from stiction.reference_impl.multibody.projection import project
from stiction.reference_impl.multibody.singular_positions import error_along_motion
from stiction.reference_impl.multibody.trajectory_columns import build_columns, write_sample
from stiction.scenes import Cost, Event
from stiction.scenes.trajectory import rows_of

COINCIDENCE = 1e-11
"""Slip speed, relative to the largest speed so far, at which a second guide comes to rest in the same event. Far above
the rounding of a located event (1e-15), far below speeds that matter."""
SAME_INSTANT = 1e-12
"""Of the time so far, or of FIRST_STEP of the run if that is more: both corners of a slider changing within are one
event, and a guide that begins to slip is not taken to be at rest again at the break-away of another."""
FIRST_STEP = 1e-3
"""Length of the first step that is tried, in parts of the run."""
CRAWL_STEPS, CRAWL_PROGRESS = 1000, 1e-5
"""So many steps must carry the run over this part of its time, or it is given up: 10^8 steps to the end."""
MISSES = 6
"""Times that a step is halved because its dense output did not find its event: of that error, of order 8 in the step,
2^-48 is left."""
AT_ONCE = 100.0
"""Times its rounding up to which an event function is zero at the start of a step, where it may fall below zero at
once."""
UNLOADED = 1e-9
"""Capacity of a guide, relative to the largest force so far, that counts as zero. Where normal force and friction pass
zero together, as where all loads on a slider pass zero in one ratio, the instant itself does not tell whether the guide
holds, nor by which corners. Nor does it where a guide reverses whose slip speed, relative to the largest so far, is
zero with them, as on a turning arm without weight."""
AT_REST = 1e-6
"""Largest speed so far, relative to that which free bodies would reach in a step, up to which all is taken to have been
at rest."""
BEHIND = 1e-3
"""Part of a step behind such an instant at which the forces tell: far above what an event is located to, far below what
loads change in."""
NEARLY_SEVERAL = 0.5
"""Friction gain (`uniqueness`) at either end of a step from which on its inside is looked at: several motions need
1."""
SINGULAR_STRETCH = 1e-4
"""A second motion usually comes in from infinity where the gain passes 1. Just behind, its linear system is too nearly
singular to be counted; if the count begins within this part of the stretch between two samples, it began where the gain
passed."""


LONGEST_STEP = np.pi
"""Phase in which a sine law may advance within a step. Of a mechanism at rest the motion does not tell how fast its
loads change."""
AUDITED = 1e-9
"""Violation of Coulomb's law, relative to the largest force or speed so far, that an audit takes for a missed event; or
10 rtol, as the states themselves are wrong by rtol."""
GOLDEN = 0.6180339887498949
"""Audits are at the fractional parts of multiples of the golden section: spread evenly, and related to no stage."""
GAIN_SAMPLES = 8
"""Points of a step at which it is asked for several motions, where the friction gain is critical."""
HALVINGS_BEHIND = 8
"""Points between where the gain passes 1 and the next of those, each in half the distance of the last, at which it is
asked as well."""

LEAST_BY_BODY = 1e-10
"""Tolerance from which on the error of a mechanism without friction is estimated body by body. Below, steps are short
enough to make no difference, and near a singular position rounding of one body would be taken for an error.
"""

class Task(Bundle):
    """Request to an integration.

    Attributes
    ----------
    t_end, rtol : float
    longest : float
        Seconds that a step may have; see LONGEST_STEP.
    audits : int
        Instants of each step at which its law is verified.
    projecting : int
        1: states are projected onto the constraints after each step.
    step_limit : int
        Accepted steps after which it is given up.
    kinks : (n,)
        Times at which a law is not smooth, increasing.
    """

    t_end: float
    rtol: float
    longest: float
    audits: int
    projecting: int
    step_limit: int
    kinks: Reals


@kernel
def integrate(m: Arrays, w: Workspace, s: State, task: Task, samples: Samples, log: EventLog) -> int:
    """Integrate from the state to t_end, filling samples and the event log; returns a termination code.

    The motion does not depend on the samples: they are read from the dense output of steps that are taken without
    regard to them. ROOM: the log is full; empty it and call again. STEP_LIMIT: with a larger one the next call goes on.
    """
    p, step = s.progress, s.attempt
    while True:
        if p.fresh:
            _refresh(m, w, s)
        if not _emit_here(m, w, s, samples):
            return NOT_FINITE
        if p.time >= task.t_end:
            return DONE
        if w.counters.steps >= task.step_limit:
            return STEP_LIMIT
        if not _propose(s, task):
            return STEP_TOO_SMALL
        outcome = _attempt(m, w, s, task)
        if outcome == REPEAT:
            continue
        if outcome != DONE:
            return outcome
        if not _locate(m, w, s, samples):
            continue
        if not _emit_inside(m, w, s, samples):
            return NOT_FINITE
        outcome = _commit(m, w, s, task)
        if outcome != DONE:
            return outcome
        if step.event >= 0:
            outcome = _switch_mode(m, w, s, task, log)
            if outcome != DONE:
                return outcome


REPEAT = -1
"""Of `_attempt`: the step was rejected, and is to be made anew."""


@kernel
def _refresh(m: Arrays, w: Workspace, s: State) -> None:
    """y' and the event functions of the state."""
    right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])
    _remember(m, w, s)
    copy(w.event, s.at_start)
    s.progress.fresh = 0


@kernel
def _propose(s: State, task: Task) -> bool:
    """Length of the next step: not past the end or a kink, and to where an event is expected.

    False if time cannot resolve it.
    """
    p, step, kinks = s.progress, s.attempt, task.kinks
    t = p.time
    while p.next_kink < len(kinks) and kinks[p.next_kink] <= t:
        p.next_kink += 1
    stop = task.t_end
    if p.next_kink < len(kinks):
        stop = min(stop, kinks[p.next_kink])
    h = min(p.step, task.longest, stop - t)
    if stop - t - h < 0.01 * h and stop - t <= task.longest:
        h = stop - t
    step.stop, step.reaches_stop, step.aims = stop, h == stop - t, 0
    step.resolution = 4e-16 * max(abs(t), abs(task.t_end))
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
        error = error_along_motion(m, w, p.time, h, s.y, s.y_new, s.K, s.scale, s.probe, error, bodies)
    if not error <= 1.0:
        w.counters.rejected += 1
        if not np.isfinite(error):
            if h < 1e-10 * task.t_end:
                return NOT_FINITE
            p.step = 0.1 * h
        else:
            p.step = h * max(0.2, 0.9 * error ** -0.125)
        return STEP_TOO_SMALL if p.step <= step.resolution else REPEAT
    step.gain, _ = gain_of_mode(m, w, s.slip)
    step.critical = max(step.gain, p.gain) > NEARLY_SEVERAL
    growth = min(6.0, 0.9 * error ** -0.125) if error > 0.0 else 6.0
    step.proposal = max(p.step, h * growth) if step.reaches_stop or step.aims else h * growth
    return DONE


@kernel
def _scales(m, w, s, rtol):
    """Tolerances per component: lengths and angles by the mechanism's size, speeds by the largest so far.

    No speed is asked to be better than the rounding of the accelerations, which is all there is in a mechanism at rest,
    or than what they change in the time that a clock cannot resolve, as where a load comes within a nanosecond.
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
    suspicious = may_vanish(s, p.aimed if meets else -1)
    output = p.next_output < len(samples.t) and samples.t[p.next_output] < t + (LONGER if meets else 1.0) * h
    step.event, step.fraction, slope = -1, 1.0, 0.0
    step.has_rows = not (suspicious or output or step.critical != 0)
    if not step.has_rows:
        for i in range(EXTRA):
            combine(s.K, A_EXTRA[i], STAGES + 1 + i, h, s.y, s.probe)
            right_hand_side(m, w, t + C_EXTRA[i] * h, s.probe, s.slip, s.corner, s.K[STAGES + 1 + i])
        dense_coefficients(s.K, h, s.y, s.y_new, s.F)
    if suspicious:
        step.fraction, step.event, slope = first_root(m, w, s)
    step.length, met = h, True
    step.at_once = (step.event >= 0 and step.fraction < BESIDE
                    and s.at_start[step.event] <= AT_ONCE * noise(s, step.event))
    if step.at_once:
        met = False
    elif step.event >= 0:
        length = step.fraction * h
        take_step(m, w, s, t, length)
        correction = -s.seen[STAGES - 1, step.event] * h / slope
        step.length, met = go_to_event(m, w, s, length, correction, SLOPE, step.event, False)
    elif meets and not suspicious:
        step.event = p.aimed
        step.length, met = go_to_event(m, w, s, h, ahead * h, NEAR, step.event, True)
        step.fraction = step.length / h
        if t + step.length > step.stop:
            p.step = max(p.step, step.stop - t)  # there is none before the stop: a step that ends there
            w.counters.rejected += 1
            return False
    if step.event >= 0 and not step.at_once and t + step.length > step.stop:
        take_step(m, w, s, t, h)
        step.length, step.event, met = h, -1, True
    if not met and p.missed < MISSES:
        # the dense output was not accurate enough to find it, or to find its place: a shorter step makes it so
        p.step = 0.5 * (1.0 if step.at_once else max(step.fraction, BESIDE)) * h
        p.missed += 1
        w.counters.rejected += 1
        return False
    step.shorter = step.event >= 0
    if step.at_once:
        step.length = 0.0
    elif not met and w.event[step.event] > noise(s, step.event):
        step.event = -1  # it comes near zero, and does not pass it
    p.missed = 0
    step.lost, step.counted = 0, 0.0
    if step.critical:
        lost, fraction, step.counted = _first_several(m, w, s, step.length / h)
        step.lost, step.fraction = lost, fraction
        if lost:
            step.length = fraction * h
    return True


@kernel
def _emit_here(m: Arrays, w: Workspace, s: State, samples: Samples) -> bool:
    """Write the samples that are due at the state; False if it is not finite."""
    p = s.progress
    while p.next_output < len(samples.t) and samples.t[p.next_output] <= p.time:
        right_hand_side(m, w, p.time, s.y, s.slip, s.corner, s.dy)
        if not is_finite(s.dy):
            return False
        i = p.next_output
        write_sample(w, s.y, s.dy, s.slip, samples.motion[i], samples.force[i], samples.slip[i])
        p.next_output += 1
    return True


@kernel
def _emit_inside(m: Arrays, w: Workspace, s: State, samples: Samples) -> bool:
    """Write the samples within the step; False if one is not finite."""
    p, step = s.progress, s.attempt
    while p.next_output < len(samples.t) and samples.t[p.next_output] < p.time + step.length:
        i = p.next_output
        dense_at(s.F, s.y, (samples.t[i] - p.time) / step.h, s.probe)
        right_hand_side(m, w, samples.t[i], s.probe, s.slip, s.corner, s.dy)
        if not is_finite(s.dy):
            return False
        write_sample(w, s.probe, s.dy, s.slip, samples.motion[i], samples.force[i], samples.slip[i])
        p.next_output += 1
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
    if step.event < 0 and not step.shorter:
        for e in range(len(w.event)):
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
        _remember(m, w, s)
    if step.length > step.resolution:
        part = max(AUDITED, 10.0 * task.rtol)
        for i in range(task.audits):
            x = ((w.counters.steps * task.audits + i) * GOLDEN) % 1.0
            if not _is_held(m, w, s, t, x, part * speed, part * force):
                row_form(m, w, t + x * step.length, s.probe[:n], s.probe[n:])
                copy(s.probe, s.y)
                p.time = t + x * step.length
                return AUDIT
    if step.event < 0 and not p.fresh:
        copy(s.K[STAGES], s.K[0])
        copy(s.seen[STAGES - 1], s.at_start)
    return DONE


@kernel
def _switch_mode(m: Arrays, w: Workspace, s: State, task: Task, log: EventLog) -> int:
    """Choose the contact mode behind the event at the state, and log what has changed.

    DONE, or why the run ends or is left.
    """
    p, event = s.progress, s.attempt.event
    guide = event // 3
    p.idle += 1
    if p.idle > 10 + 6 * len(m.friction):
        return CHATTER
    right_hand_side(m, w, p.time, s.y, s.slip, s.corner, s.dy)
    _remember(m, w, s)
    switches, function, behind = _examine_event(m, w, s, event)
    if not switches:
        p.fresh = 0
        return DONE
    first = p.logged
    write_sample(w, s.y, s.dy, s.slip, log.motion[first, 0], log.force[first, 0], log.slip[first, 0])
    copy(s.slip, s.old_slip)
    for f in range(len(m.friction)):
        copy(s.corner[f], s.old_corner[f])
    others = 0
    if s.slip[guide] != 0 and function > 0 and p.idle < 3 + len(m.friction):
        _change_surfaces(m, w, s, event)
    else:
        outcome = _change_slip(m, w, s, task, guide, function, behind)
        if outcome != SOLVED:
            return outcome
        others = _count_other_modes(m, w, s)
        for f in range(len(m.friction)):
            if s.old_slip[f] == 0 and s.slip[f] != 0:
                s.began[f] = p.time
        if s.began[guide] == p.time and not behind:
            copy(s.y, s.probe)
            _foresee_speeds(m, w, s)
    begin_mode(m, w, s)
    p.gain, _ = gain_of_mode(m, w, s.slip)
    copy(w.event, s.at_start)
    p.fresh = 0
    _remember(m, w, s)
    _log_changes(m, w, s, log, others)
    return ROOM if p.logged + len(m.friction) >= len(log.t) else DONE


@kernel
def _examine_event(m, w, s, event):
    """Look at the event at the state.

    The mode switches or goes on there, the guide's event function, and decided behind it or not.

    It is decided just behind where the guide is unloaded. A guide at rest goes on if it holds there, or on another
    branch of its capacity.
    """
    guide, function, p, slip = event // 3, event % 3, s.progress, s.slip
    unloaded = most_capacity(m, w, guide) <= UNLOADED * p.force
    if slip[guide] == 0 and unloaded:
        function = _way_out(m, w, s, guide)
        if function < 0:
            begin_mode(m, w, s)
            copy(w.event, s.at_start)
            return False, function, True
        right_hand_side(m, w, p.time, s.y, slip, s.corner, s.dy)
        return True, function, True
    if slip[guide] == 0 and choose_branches(m, w, slip, s.corner, UNLOADED * p.force):
        right_hand_side(m, w, p.time, s.y, slip, s.corner, s.dy)
        if w.event[event] > AT_ONCE * noise(s, event):
            copy(s.dy, s.K[0])
            copy(w.event, s.at_start)
            return False, function, False
    if slip[guide] != 0 and abs(w.slip_speed[guide]) <= UNLOADED * p.speed and unloaded:
        copy(s.dy, s.K[0])
        _look_behind(m, w, s)
        right_hand_side(m, w, p.time, s.y, slip, s.corner, s.dy)
        return True, 0, True
    return True, function, False


@kernel
def _change_slip(m, w, s, task, guide, function, behind):
    """Choose the mode after a break-away, a rest, or a corner that changed too often; return the outcome."""
    t, y, slip, n = s.progress.time, s.y, s.slip, len(m.inverse_mass)
    for f in range(len(m.friction)):
        # a stuck guide stays at rest whatever speed it has drifted to; one that began to slip in this instant does not
        s.rest_speed[f] = np.inf if slip[f] == 0 else COINCIDENCE * s.progress.speed
        if slip[f] != 0 and t - s.began[f] <= SAME_INSTANT * max(FIRST_STEP * task.t_end, t):
            s.rest_speed[f] = -1.0
    if slip[guide] == 0:
        if can_jam(m, guide):
            return JAM
        _break_away(m, w, s, guide, 1 if function == 0 else -1)
    elif function == 0:
        s.rest_speed[guide] = np.inf
        _come_to_rest(m, w, s)
    if behind:
        return _choose_behind(m, w, s)
    return choose_mode(m, w, t, y[:n], y[n:], slip, s.corner, s.rest_speed)


@kernel
def _log_changes(m, w, s, log, others):
    """Log an event for each guide whose mode has changed; the values before it stand in the row of the first."""
    p, first = s.progress, s.progress.logged
    for f in range(len(m.friction)):
        kind = _kind_of_change(s, f)
        if kind < 0:
            continue
        i = p.logged
        log.t[i], log.kind[i], log.guide[i], log.others[i] = p.time, kind, f, others
        if i > first:
            for k in range(3):
                copy(log.motion[first, 0, k], log.motion[i, 0, k])
            copy(log.force[first, 0], log.force[i, 0])
            copy(log.slip[first, 0], log.slip[i, 0])
        write_sample(w, s.y, s.K[0], s.slip, log.motion[i, 1], log.force[i, 1], log.slip[i, 1])
        p.logged += 1
        w.counters.events += 1


@kernel(allocates=True)
def _break_away(m: Arrays, w: Workspace, s: State, guide: int, direction: int) -> None:
    """Let a guide at rest slip, and those at rest without which it cannot: for this instant none of them is at rest."""
    nf = len(m.friction)
    leaving, firmness, stuck = np.zeros(nf, dtype=np.int64), np.zeros(nf), np.zeros(nf, dtype=np.bool_)
    leaving[guide] = direction
    for f in range(nf):
        firmness[f], stuck[f] = min(w.event[3 * f], w.event[3 * f + 1]), s.slip[f] == 0
    leave_together(m, w, leaving, firmness, s.slip, stuck)
    for f in range(nf):
        if s.old_slip[f] == 0 and not stuck[f]:
            s.rest_speed[f] = -1.0


@kernel(allocates=True)
def _come_to_rest(m: Arrays, w: Workspace, s: State) -> None:
    """Bring to rest, with the guides at rest, those that cannot but rest with them (`guides_at_rest`)."""
    held, t, n = np.zeros(len(m.friction), dtype=np.bool_), s.progress.time, len(m.inverse_mass)
    q, v = s.y[:n], s.y[n:]
    for f in range(len(m.friction)):
        held[f] = 0.0 <= abs(w.slip_speed[f]) <= s.rest_speed[f]
    if not rest_together(m, w, held, s.progress.speed, v):
        return
    for f in range(len(m.friction)):
        if held[f]:
            s.rest_speed[f] = np.inf
    if m.baumgarte_beta2 > 0.0:
        # what is at rest cannot follow the acceleration by which Baumgarte's terms would take back a residual
        row_form(m, w, t, q, v)
        project(m, w, t, q, v, 1e-15 * m.length_scale, 2)


@kernel(allocates=True)
def _count_other_modes(m: Arrays, w: Workspace, s: State) -> int:
    """Modes other than the chosen one that would have been consistent behind the event at the state (`other_modes`)."""
    resting = np.zeros(len(m.friction), dtype=np.bool_)
    for f in range(len(m.friction)):
        resting[f] = s.old_slip[f] == 0 or abs(w.slip_speed[f]) <= s.rest_speed[f]
    return other_modes(m, w, resting, s.slip)


@kernel
def _change_surfaces(m, w, s, event):
    """Change the sign of the corner whose event it is, and of all that fell to zero with it."""
    for f in range(len(m.friction)):
        if s.slip[f] == 0:
            continue
        for j in range(2):
            e = 3 * f + 1 + j
            zero = AT_ONCE * noise(s, e)
            if e == event or abs(w.event[e]) <= zero < s.at_start[e]:
                s.corner[f, j] *= -1


@kernel
def _kind_of_change(s, f):
    """Kind of the event of a guide, by its modes before and after; -1 if nothing has changed."""
    if s.slip[f] != s.old_slip[f]:
        return SLIP if s.old_slip[f] == 0 else STICK if s.slip[f] == 0 else REVERSAL
    if s.slip[f] != 0 and (s.corner[f, 0] != s.old_corner[f, 0] or s.corner[f, 1] != s.old_corner[f, 1]):
        return CORNER
    return -1


@kernel
def begin_mode(m: Arrays, w: Workspace, s: State) -> None:
    """y' into K[0] and the event functions into w.event at the start of a mode, on the largest branches of capacity.

    Of a guide at rest that is unloaded they are those that are the largest just behind.
    """
    right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])
    _remember(m, w, s)
    least, changed = UNLOADED * s.progress.force, False
    for f in range(len(m.friction)):
        changed = changed or s.slip[f] == 0 and most_capacity(m, w, f) <= least
    if changed:
        _look_behind(m, w, s)
        right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])
    if choose_branches(m, w, s.slip, s.corner, least) or changed:
        right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])


@kernel
def _begin(m: Arrays, w: Workspace, s: State, load: float) -> int:
    """Choose the first mode and begin it, of a state whose largest speed is not known yet; returns the outcome.

    Just behind the start it is told how large forces are, and where a guide is unloaded also what moves. Then the
    largest `load` (N) tells what rounding is: that of a sine law near zero is one of its amplitude.
    """
    n = len(m.inverse_mass)
    for i in range(n):
        s.progress.speed = max(s.progress.speed, abs(s.y[n + i]) * (m.length_scale if i % 3 == 2 else 1.0))
    rest_speed = COINCIDENCE * s.progress.speed
    for f in range(len(m.friction)):
        s.rest_speed[f] = rest_speed
    row_form(m, w, 0.0, s.y[:n], s.y[n:])
    _come_to_rest(m, w, s)
    outcome = choose_mode(m, w, 0.0, s.y[:n], s.y[n:], s.slip, s.corner, s.rest_speed)
    right_hand_side(m, w, 0.0, s.y, s.slip, s.corner, s.K[0])
    _look_behind(m, w, s)
    _remember(m, w, s)
    right_hand_side(m, w, 0.0, s.y, s.slip, s.corner, s.K[0])
    unloaded = False
    for f in range(len(m.friction)):
        if abs(w.slip_speed[f]) <= s.rest_speed[f]:
            s.rest_speed[f] = np.inf
            unloaded = unloaded or most_capacity(m, w, f) <= UNLOADED * s.progress.force
    if unloaded:
        s.progress.force = max(s.progress.force, load)
        outcome = _choose_behind(m, w, s)
    begin_mode(m, w, s)
    for f in range(len(m.friction)):
        if s.slip[f] != 0:
            s.began[f] = 0.0
    s.progress.gain, _ = gain_of_mode(m, w, s.slip)
    return outcome


@kernel
def _look_behind(m, w, s):
    """Row forces and event functions BEHIND a step after the state, with the branches that are the largest there.

    The state's y' is in K[0].
    """
    h = BEHIND * s.attempt.h
    for k in range(len(s.y)):
        s.probe[k] = s.y[k] + h * s.K[0, k]
    right_hand_side(m, w, s.progress.time + h, s.probe, s.slip, s.corner, s.dy)
    if choose_branches(m, w, s.slip, s.corner, ALL):
        right_hand_side(m, w, s.progress.time + h, s.probe, s.slip, s.corner, s.dy)


@kernel
def _choose_behind(m, w, s):
    """The mode of the state in `probe`, as `choose_mode`."""
    n = len(m.inverse_mass)
    time = s.progress.time + BEHIND * s.attempt.h
    outcome = choose_mode(m, w, time, s.probe[:n], s.probe[n:], s.slip, s.corner, s.rest_speed)
    _foresee_speeds(m, w, s)
    return outcome


@kernel
def _foresee_speeds(m, w, s):
    """Take the scale of speeds from the state in `probe` where all has been at rest.

    Otherwise the scale would be rounding.
    """
    n, p, h, free = len(m.inverse_mass), s.progress, BEHIND * s.attempt.h, 0.0
    for i in range(n):
        free = max(free, abs(w.free[i]) * (m.length_scale if i % 3 == 2 else 1.0))
    if p.speed > AT_REST * free * s.attempt.h:
        return
    right_hand_side(m, w, p.time + h, s.probe, s.slip, s.corner, s.dy)
    for i in range(n):
        p.speed = max(p.speed, abs(s.dy[n + i]) * (m.length_scale if i % 3 == 2 else 1.0) * h)


@kernel
def _way_out(m, w, s, guide):
    """Event function by which a guide at rest that is unloaded breaks away.

    The lower just behind, -1 if it holds there.
    """
    right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])
    _look_behind(m, w, s)
    e = 3 * guide
    function = 0 if w.event[e] < w.event[e + 1] else 1
    return function if w.event[e + function] < -AT_ONCE * noise(s, e) else -1


@kernel
def _remember(m, w, s):
    """Keep the largest speed and force so far, by which rounding is judged.

    Forces in the unit of a guide's normal row.
    """
    n, y, p = len(m.inverse_mass), s.y, s.progress
    for i in range(n // 3):
        p.speed = max(p.speed, abs(y[n + 3 * i]), abs(y[n + 3 * i + 1]), abs(y[n + 3 * i + 2]) * m.length_scale)
    largest = largest_force(m, w, w.force) if len(m.friction) else 0.0
    for f in range(len(m.friction)):
        normal = m.friction[f].row
        p.force = max(p.force, largest / np.sqrt(w.G[normal, normal]))


@kernel
def _is_held(m: Arrays, w: Workspace, s: State, t: float, x: float, speed: float, force: float) -> bool:
    """Return True where Coulomb's law holds, up to a speed (m/s) and a force (N), at the fraction x of a step.

    The state there is that of the cubic through both ends. Only if it violates the law a step is made that ends there,
    into `probe`, and decides.
    """
    length = s.attempt.length
    for k in range(len(s.y)):
        change = s.y_new[k] - s.y_old[k]
        left, right = length * s.K[0, k] - change, change - length * s.K[STAGES, k]
        s.probe[k] = s.y_old[k] + x * change + x * (1.0 - x) * ((1.0 - x) * left + x * right)
    right_hand_side(m, w, t + x * length, s.probe, s.slip, s.corner, s.dy)
    if not _violates(m, w, s.slip, speed, force):
        return True
    copy(s.K[0], s.audit_K[0])
    take_audit_step(m, w, s, t, x * length)
    return not _violates(m, w, s.slip, speed, force)


@kernel
def _violates(m, w, slip, speed, force):
    """Return True where a guide is beyond Coulomb's law by more than a speed (m/s) or a force (N)."""
    for f in range(len(m.friction)):
        of_speed, of_force = margin(m, w, slip, f)
        if not (of_speed >= -speed and of_force >= -force):
            return True
    return False


@kernel
def _first_several(m: Arrays, w: Workspace, s: State, fraction: float) -> tuple[bool, float, float]:
    """Return whether the first `fraction` of the step has several motions, from where on, and where to count them."""
    low, below = 0.0, True
    for i in range(1, GAIN_SAMPLES + 1):
        high = fraction * i / GAIN_SAMPLES
        _rows_at(m, w, s, high)
        several = has_several(m, w, s.slip)
        gain, _ = gain_of_mode(m, w, s.slip)
        if not several and below and gain >= 1.0:
            # two motions may have come and merged since the gain passed 1, as where a corner changes its surface
            passed = _onset(m, w, s, low, high, False)
            for k in range(1, HALVINGS_BEHIND + 1):
                between = passed + (high - passed) * 0.5 ** k
                _rows_at(m, w, s, between)
                if has_several(m, w, s.slip):
                    several, high = True, between
                    break
        below = gain < 1.0
        if several:
            counted, passed = _onset(m, w, s, low, high, True), _onset(m, w, s, low, high, False)
            return True, passed if counted - passed <= SINGULAR_STRETCH * (high - low) else counted, counted
        low = high
    return False, fraction, fraction


@kernel
def _onset(m: Arrays, w: Workspace, s: State, low: float, high: float, several: bool) -> float:
    """Bisect between two fractions of the step.

    Where several motions begin to be counted, or the gain reaches 1.
    """
    while (high - low) * s.attempt.h > 4e-16 * max(s.progress.time, s.attempt.h):
        middle = 0.5 * (low + high)
        _rows_at(m, w, s, middle)
        gain, _ = gain_of_mode(m, w, s.slip)
        if has_several(m, w, s.slip) if several else gain >= 1.0:
            high = middle
        else:
            low = middle
    return high


@kernel
def _rows_at(m, w, s, x):
    """The rows of the workspace at the fraction x of the step."""
    n = len(m.inverse_mass)
    dense_at(s.F, s.y, x, s.probe)
    row_form(m, w, s.progress.time + x * s.attempt.h, s.probe[:n], s.probe[n:])


@kernel
def _project(m, w, s, has_rows):
    """Project the state if its residuals exceed rounding; returns whether it was changed.

    has_rows : the rows in the workspace are those of this state.
    """
    n, t, y = len(m.inverse_mass), s.progress.time, s.y
    if not has_rows:
        row_form(m, w, t, y[:n], y[n:])
    position, velocity, speed = 0.0, 0.0, s.progress.speed
    for i in range(n):
        # of a mechanism at rest the speeds are rounding of what its free bodies would reach
        speed = max(speed, abs(w.free[i]) * s.attempt.length * (m.length_scale if i % 3 == 2 else 1.0))
    for r in range(m.rows):
        position, velocity = max(position, abs(w.phi[r])), max(velocity, abs(w.phi_dot[r]))
    if position <= 1e-14 * m.length_scale and velocity <= 1e-14 * speed:
        return False
    w.counters.projections += 1
    project(m, w, t, y[:n], y[n:], 1e-15 * m.length_scale, 2)
    return True


@dataclass(frozen=True)
class Options:
    """Options of an integration besides its tolerance.

    Attributes
    ----------
    step_limit : int
        Accepted steps after which the run is given up.
    solver : int
        One of `solvers.SOLVERS`.
    sides : bool
        Whether events keep the values of the columns before and after them: of all, a kilobyte or more each.
    audits : int
        Instants of each step at which Coulomb's law is verified; where it is violated the run ends.
    names : Collection of str, optional
        The columns that are wanted; all where None.
    events_behind : float
        Seconds; of the events those behind this instant are wanted.
    ends : list of float, optional
        Gets the ends of all accepted steps (s), and the instant of a breakdown.
    """

    step_limit: int = 10_000_000
    solver: int = AUTOMATIC
    sides: bool = True
    audits: int = 1
    names: Collection[str] | None = None
    events_behind: float = -np.inf
    ends: list[float] | None = None


class Integration:
    """A motion of a mechanism from t = 0 with frozen contact modes and located events.

    Begun when this is made, stepped when its run is asked for.

    Parameters
    ----------
    q, v : ndarray, shape (3 * bodies,)
        State at t = 0, on the constraints.
    output : ndarray
        Output times, increasing, within [0, t_end].
    rtol : float
        Local error per step relative to the mechanism's size (positions; 1 rad for angles) and to its
        largest speed so far (velocities).
    options : Options, optional
    """

    def __init__(self, mechanism: Mechanism, q: np.ndarray, v: np.ndarray, output: np.ndarray, t_end: float,
                 rtol: float, options: Options = Options()):
        started = clock()
        m, frictional = mechanism.arrays, len(mechanism.guide_names)
        self._mechanism, self._output, self._options = mechanism, np.array(output, dtype=float), options
        self._workspace, self._state = workspace(m, options.solver), state(q, v, frictional)
        fastest = mechanism.fastest_law() if frictional else 0.0
        self._task = Task(t_end=t_end, rtol=rtol, longest=LONGEST_STEP / fastest if fastest > 0.0 else np.inf,
                          audits=options.audits, projecting=int(mechanism.projection), step_limit=options.step_limit,
                          kinks=mechanism.kinks(t_end))
        self._state.progress["step"] = FIRST_STEP * t_end
        self._state.attempt["h"] = min(FIRST_STEP * t_end, self._task.longest)
        self._code = _begin(m, self._workspace, self._state, mechanism.largest_load()) if frictional else DONE
        self._logged: list[tuple[np.ndarray, ...]] = []
        self._setup_s, self._stepping_s = clock() - started, 0.0

    def step(self) -> None:
        """Go to `t_end`, or to where it stops, if it has not yet."""
        if self._logged:
            return
        started, m, w, s, output = clock(), self._mechanism.arrays, self._workspace, self._state, self._output
        n, nf, size = len(m.inverse_mass), len(m.friction), m.rows + len(m.friction)
        kept, room = len(output), 256 + nf
        self._samples = samples = Samples.zeros(t=kept, motion=(kept, 3, n), force=(kept, size), slip=(kept, nf))
        samples.t[:] = output
        log = EventLog.zeros(t=room, kind=room, guide=room, others=room, motion=(room, 2, 3, n), force=(room, 2, size),
                             slip=(room, 2, nf))
        prepared, code = clock(), self._code
        while code in (DONE, ROOM):
            s.progress["fresh"], s.progress["missed"], s.progress["logged"], s.progress["aim"] = 1, 0, 0, np.inf
            code = _march(m, w, s, self._task, samples, log, self._options.ends)
            used = int(s.progress["logged"])
            logged = tuple(part[:used if self._options.sides or i < 4 else 0] for i, part in enumerate(log))
            if code != ROOM:
                self._logged.append(logged)
                break
            self._logged.append(tuple(part.copy() for part in logged))
        stepped = clock()
        self._logged = self._logged or [tuple(part[:0] for part in log)]
        self._code, self._setup_s, self._stepping_s = code, self._setup_s + prepared - started, stepped - prepared

    def forces_at(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Accelerations, event functions and row forces of another state, in the contact mode at the end of the run."""
        m, w, s, dy = self._mechanism.arrays, self._workspace, self._state, np.zeros(2 * len(q))
        right_hand_side(m, w, t, np.concatenate([q, v]), s.slip, s.corner, dy)
        return dy[len(q):], w.event.copy(), w.force.copy()

    @cached_property
    def run(self) -> Run:
        """Result of the integration, stepped.

        `breakdown` says where and why it stopped early; the columns then end there. One that stops at the start has the
        state there, and accelerations and forces that are nan.
        """
        self.step()
        mechanism, w, s, code = self._mechanism, self._workspace, self._state, self._code
        samples, output = self._samples, self._output
        n, reached = len(mechanism.arrays.inverse_mass), int(s.progress["next_output"])
        if code != DONE and not reached and len(output) and output[0] == 0.0:
            # it stopped at once: the start is known, accelerations and forces are not
            samples.motion[0, 0], samples.motion[0, 1], samples.motion[0, 2] = s.y[:n], s.y[n:], np.nan
            samples.force[0], samples.slip[0], reached = np.nan, s.slip, 1
        logged = [np.concatenate(parts) if len(parts) > 1 else parts[0] for parts in zip(*self._logged)]
        first = np.searchsorted(logged[0], self._options.events_behind, side="right")
        columns, events = _columns_and_events(
            mechanism, [part[:reached] for part in samples], [part[first:] for part in logged], self._options,
            FIRST_STEP * self._task.t_end)
        breakdown = breakdown_of(code, float(s.progress["time"]), mechanism, w, s.slip, s.corner,
                                 (float(s.progress["speed"]) or 1.0, float(s.progress["force"]) or 1.0))
        cost = Cost(self._setup_s, 0.0, self._stepping_s, named(w.counters))
        return Run(output[:reached], columns, events, cost, breakdown)


def simulate_event_driven(mechanism: Mechanism, q: np.ndarray, v: np.ndarray, output: np.ndarray, t_end: float,
                          rtol: float, **options: Any) -> Run:
    """Return the run of an `Integration`, of which these are the parameters and `Options`."""
    return Integration(mechanism, q, v, output, t_end, rtol, Options(**options)).run


def _march(m: Arrays, w: Workspace, s: State, task: Task, samples: Samples, log: EventLog,
           ends: list[float] | None) -> int:
    """Variant of `integrate` that notes where each accepted step ends if `ends` are wanted."""
    if ends is None:
        return integrate(m, w, s, task, samples, log)
    while True:
        code = integrate(m, w, s, task.replaced(step_limit=int(w.counters["steps"]) + 1), samples, log)
        ends.append(float(s.progress["time"]))
        if code != STEP_LIMIT or w.counters["steps"] >= task.step_limit:
            return code


def _columns_and_events(mechanism: Mechanism, samples: Sequence[np.ndarray], log: Sequence[np.ndarray],
                        options: Options, begun: float) -> tuple[dict[str, np.ndarray], tuple[Event, ...]]:
    """Columns of the samples, and the events with the same on both of their sides.

    Arrays as of `Samples` and `EventLog`.

    begun : the least time (s) that SAME_INSTANT is taken of.
    """
    def build(t: np.ndarray, motion: np.ndarray, force: np.ndarray, slip: np.ndarray) -> dict[str, np.ndarray]:
        return build_columns(mechanism, t, motion[:, 0], motion[:, 1], motion[:, 2], force, slip, options.names)

    (instants, kinds, guides, others, *sided), columns = log, build(*samples)
    rows: list[dict[str, float]] = [{} for _ in range(2 * len(instants))]
    if options.sides and columns and len(instants):
        rows = rows_of(build(np.repeat(instants, 2), *(part.reshape(-1, *part.shape[2:]) for part in sided)))
    events: list[Event] = []
    logged = zip(instants.tolist(), kinds.tolist(), guides.tolist(), others.tolist(), rows[::2], rows[1::2])
    for instant, kind, guide, more, before, after in logged:
        found = Event(instant, EVENT_KINDS[kind], mechanism.guide_names[guide], before, after, more)
        last = events[-1] if events else None
        if last and last.kind == found.kind == "corner" and last.joint == found.joint \
                and found.time - last.time <= SAME_INSTANT * max(begun, found.time):
            # both corners change their surface where the resultant passes zero without a moment
            found = replace(found, before=last.before)
            events.pop()
        events.append(found)
    return columns, tuple(events)
