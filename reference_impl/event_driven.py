"""Event-driven integration with frozen contact modes.

The HLCP decides the contact mode at the start and at events only. While a mode lasts the forces follow from one linear
solve (`contact_modes`), the motion is smooth and DOP853 integrates it. A step is made to end where the next event is expected;
one within which an event cannot be excluded is searched, and repeated if there is one (`event_location`). Each step is audited.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from reference_impl.bundle import Bundle, Cube, IntegerTable, Integers, Reals, Table
from reference_impl.columns import build_columns
from reference_impl.compiling import kernel
from reference_impl.contact_modes import can_jam, choose_branches, margin
from reference_impl.contact_solvers import LEMKE
from reference_impl.dop853 import A_EXTRA, C_EXTRA, EXTRA, STAGES, combine, dense_at, dense_coefficients, error_norm
from reference_impl.dynamics import largest_force, row_form
from reference_impl.event_location import (BESIDE, LONGER, NEAR, NODES, SLOPE, falls_to_end, first_root, go_to_event, may_vanish,
                                           zero_near_end)
from reference_impl.kinematics import Workspace, workspace
from reference_impl.linking import clock
from reference_impl.mechanism import Arrays, Mechanism
from reference_impl.mode_choice import COUNTER_NAMES, EVENTS, PROJECTIONS, REJECTED, STEPS, choose_mode
from reference_impl.outcomes import (AUDIT, BREAKDOWNS, CHATTER, CRAWL, DONE, JAM, MODE_LIMIT, NONE, NOT_FINITE, PIVOT_LIMIT, RAY,
                                     ROOM, SEVERAL, SIGN_CYCLE, SINGULAR, SOLVED, STEP_LIMIT, STEP_TOO_SMALL)
from reference_impl.projection import project
from reference_impl.right_hand_side import right_hand_side
from reference_impl.singular_positions import error_along_motion
from reference_impl.step import CHECKED, FORCE, GAIN, NOISE, SPEED, STEP, TIME, copy, noise, take_step
from reference_impl.trial_and_error import trial_and_error
from reference_impl.uniqueness import COUNTED, gain_of_mode, has_several, number_of_solutions
from scenes import Breakdown, Cost, Event
from scenes.trajectory import rows_of

SLIP, STICK, REVERSAL, CORNER = range(4)
EVENT_KINDS = ("slip", "stick", "reversal", "corner")

COINCIDENCE = 1e-11
"""Slip speed, relative to the largest speed so far, at which a second guide comes to rest in the same event. Far above
the rounding of a located event (1e-15), far below speeds that matter."""
SAME_INSTANT = 1e-12
"""Seconds, times the time if that is more than 1 s: both corners of a slider changing within are one event, and a guide that begins to
slip is not taken to be at rest again at the break-away of another."""
CRAWL_STEPS, CRAWL_PROGRESS = 1000, 1e-5
"""So many steps must carry the run over this part of its time, or it is given up: 10^8 steps to the end."""
MISSES = 6
"""Times that a step is halved because its dense output did not find its event: of that error, of order 8 in the step,
2^-48 is left."""
AT_ONCE = 100.0
"""Times its rounding up to which an event function is zero at the start of a step, where it may fall below zero at once."""
NEARLY_SEVERAL = 0.5
"""Friction gain (`uniqueness`) at either end of a step from which on its inside is looked at: several motions need 1."""
SINGULAR_STRETCH = 1e-4
"""A second motion usually comes in from infinity where the gain passes 1. Just behind, its linear system is too nearly singular to
be counted; if the count begins within this part of the stretch between two samples, it began where the gain passed."""


LONGEST_STEP = np.pi
"""Phase in which a sine law may advance within a step. Of a mechanism at rest the motion does not tell how fast its loads change."""
AUDITED = 1e-9
"""Violation of Coulomb's law, relative to the largest force or speed so far, that an audit takes for a missed event; or 10 rtol, as the
states themselves are wrong by rtol."""
GOLDEN = 0.6180339887498949
"""Audits are at the fractional parts of multiples of the golden section: spread evenly, and related to no stage."""
GAIN_SAMPLES = 8
"""Points of a step at which it is asked for several motions, where the friction gain is critical."""
HALVINGS_BEHIND = 8
"""Points between where the gain passes 1 and the next of those, each in half the distance of the last, at which it is asked as well."""

OUTPUT, KINK, IDLE, LOGGED = range(4)
"""Places in `State.cursor`."""


class State(Bundle):
    """What the integration loop carries on, so that it can be left and entered again.

    y : (2n,) state (q, v).  scalar : TIME, STEP proposed (s), largest SPEED and FORCE so far, time at which progress was CHECKED last,
    friction GAIN.
    slip, corner : the mode; see `contact_modes`.  began : (frictional,) when each guide last began to slip.  counters : see `mode_choice`.
    cursor : positions of the next OUTPUT and KINK, events that no time passed between (IDLE), events LOGGED.
    """

    y: Reals
    scalar: Reals
    slip: Integers
    corner: IntegerTable
    began: Reals
    counters: Integers
    cursor: Integers


class Scratch(Bundle):
    """Room for a step, made outside of the integration loop.

    K : (STAGES + 1 + EXTRA, 2n) derivatives at the stages.  F : (7, 2n) dense output.  y_old, y_new, probe, dy, scale : (2n,).
    at_start : (3 * frictional,) event functions.  seen : the same of each stage, in the order of times.
    sampled, bernstein : see `event_location.first_root`.  rest_speed : (frictional,).  old_slip, old_corner : the mode before an event.
    audit_K, audit_seen : as K and seen, of a step that an audit makes.
    """

    K: Table
    F: Table
    y_old: Reals
    y_new: Reals
    probe: Reals
    dy: Reals
    scale: Reals
    at_start: Reals
    seen: Table
    sampled: Table
    bernstein: Table
    rest_speed: Reals
    old_slip: Integers
    old_corner: IntegerTable
    audit_K: Table
    audit_seen: Table


def _scratch(n: int, frictional: int) -> Scratch:
    """For n coordinates."""
    y, event, seen = np.zeros(2 * n), np.zeros(3 * frictional), np.zeros((STAGES, 3 * frictional))
    return Scratch(np.zeros((STAGES + 1 + EXTRA, 2 * n)), np.zeros((7, 2 * n)), y, y.copy(), y.copy(), y.copy(), y.copy(), event,
                   seen, np.zeros((NODES + 1, 3 * frictional)), np.zeros((2, NODES + 1)), np.zeros(frictional),
                   np.zeros(frictional, dtype=np.int64), np.zeros((frictional, 4), dtype=np.int64),
                   np.zeros((STAGES + 1, 2 * n)), seen.copy())


class Samples(Bundle):
    """Output at given times: q, v, a together (n, 3, 3 * bodies), row forces, slip."""

    t: Reals
    motion: Cube
    force: Table
    slip: IntegerTable


class EventLog(Bundle):
    """Events: time, kind, frictional guide, and two-sided samples (n, 2, ...)."""

    t: Reals
    kind: Integers
    guide: Integers
    motion: Annotated[np.ndarray, np.float64, 4]
    force: Cube
    slip: Annotated[np.ndarray, np.int64, 3]


@kernel
def _scales(m, w, K, h, rtol, scalar, scale):
    """Tolerances per component: lengths and angles by the mechanism's size, speeds by the largest so far.

    No speed is asked to be better than the rounding of the accelerations, which is all there is in a mechanism at rest.
    """
    n = len(m.inverse_mass)
    speed, rounding = scalar[SPEED], 0.0
    for i in range(len(m.inverse_mass) // 3):
        for k in range(3):
            unit = m.length_scale if k == 2 else 1.0
            speed = max(speed, abs(K[0, n + 3 * i + k]) * unit * h)
            rounding = max(rounding, NOISE * abs(w.free[3 * i + k]) * unit * h)
    for i in range(len(m.inverse_mass) // 3):
        for k in range(3):
            unit = m.length_scale if k == 2 else 1.0
            scale[3 * i + k] = rtol * m.length_scale / unit
            scale[n + 3 * i + k] = max(rtol * speed, rounding) / unit


@kernel
def _remember(m, w, y, scalar):
    """Keep the largest speed and force so far, by which rounding is judged; forces in the unit of a guide's normal row."""
    n = len(m.inverse_mass)
    for i in range(len(m.inverse_mass) // 3):
        scalar[SPEED] = max(scalar[SPEED], abs(y[n + 3 * i]), abs(y[n + 3 * i + 1]), abs(y[n + 3 * i + 2]) * m.length_scale)
    largest = largest_force(m, w, w.force) if len(m.friction) else 0.0
    for f in range(len(m.friction)):
        normal = m.friction[f].row
        scalar[FORCE] = max(scalar[FORCE], largest / np.sqrt(w.G[normal, normal]))


@kernel
def _write(motion, force, slip_out, m, w, y, dy, slip):
    n = len(m.inverse_mass)
    for i in range(n):
        motion[0, i], motion[1, i], motion[2, i] = y[i], y[n + i], dy[n + i]
    copy(w.force, force)
    copy(slip, slip_out)


@kernel
def _is_finite(x):
    for i in range(len(x)):
        if not np.isfinite(x[i]):
            return False
    return True


@kernel
def integrate(m: Arrays, w: Workspace, solver: int, state: State, t_end: float, rtol: float, projecting: bool, kinks: Reals, longest: float,
              audits: int, samples: Samples, log: EventLog, scratch: Scratch, step_limit: int) -> int:
    """Integrate from state to t_end, filling samples and the event log; returns a termination code.

    The motion does not depend on the samples: they are read from the dense output of steps that are taken without regard to them.
    longest : seconds that a step may have; see LONGEST_STEP.  audits : instants of each step at which its law is verified.
    ROOM: the log is full; empty it and call again.
    """
    n = len(m.inverse_mass)
    y, scalar, slip, corner, began, counters, cursor = (state.y, state.scalar, state.slip, state.corner, state.began,
                                                        state.counters, state.cursor)
    K, F, y_old, y_new, probe, dy, scale = (scratch.K, scratch.F, scratch.y_old, scratch.y_new, scratch.probe, scratch.dy,
                                            scratch.scale)
    at_start, seen, sampled, bernstein = scratch.at_start, scratch.seen, scratch.sampled, scratch.bernstein
    rest_speed, old_slip, old_corner = scratch.rest_speed, scratch.old_slip, scratch.old_corner
    log_used = 0
    fresh, missed = True, 0
    aim, aimed = np.inf, -1  # seconds to where an event is expected, and its function
    while True:
        t = scalar[TIME]
        if fresh:
            right_hand_side(m, w, t, y, slip, corner, K[0], counters)
            _remember(m, w, y, scalar)
            copy(w.event, at_start)
            fresh = False
        while cursor[OUTPUT] < len(samples.t) and samples.t[cursor[OUTPUT]] <= t:
            right_hand_side(m, w, t, y, slip, corner, dy, counters)
            if not _is_finite(dy):
                return NOT_FINITE
            i = cursor[OUTPUT]
            _write(samples.motion[i], samples.force[i], samples.slip[i], m, w, y, dy, slip)
            cursor[OUTPUT] += 1
        if t >= t_end:
            return DONE
        if counters[STEPS] >= step_limit:
            return STEP_LIMIT

        # propose
        while cursor[KINK] < len(kinks) and kinks[cursor[KINK]] <= t:
            cursor[KINK] += 1
        stop = t_end
        if cursor[KINK] < len(kinks):
            stop = min(stop, kinks[cursor[KINK]])
        h = min(scalar[STEP], longest, stop - t)
        if stop - t - h < 0.01 * h and stop - t <= longest:
            h = stop - t
        reaches_stop, aims = h == stop - t, False
        resolution = 4e-16 * max(abs(t), abs(t_end))
        if resolution < aim < h:
            h, reaches_stop, aims = aim, False, True
        aim = np.inf
        if h <= resolution and not reaches_stop:
            return STEP_TOO_SMALL

        # attempt
        take_step(m, w, t, h, y, slip, corner, K, y_new, probe, counters, seen)
        _scales(m, w, K, h, rtol, scalar, scale)
        error = error_norm(K, h, scale)
        if 1.0 < error < np.inf and len(m.friction) == 0 and m.rows > 0:
            error = error_along_motion(m, w, t, h, y, y_new, K, scale, probe, error)
        if not error <= 1.0:
            counters[REJECTED] += 1
            if not np.isfinite(error):
                if h < 1e-10 * t_end:
                    return NOT_FINITE
                scalar[STEP] = 0.1 * h
            else:
                scalar[STEP] = h * max(0.2, 0.9 * error ** -0.125)
            if scalar[STEP] <= resolution:
                return STEP_TOO_SMALL
            continue
        gain, _ = gain_of_mode(m, w, slip)
        critical = max(gain, scalar[GAIN]) > NEARLY_SEVERAL
        growth = min(6.0, 0.9 * error ** -0.125) if error > 0.0 else 6.0
        proposal = max(scalar[STEP], h * growth) if reaches_stop or aims else h * growth

        # locate
        ahead = np.inf
        if aims and falls_to_end(at_start, seen, aimed, noise(slip, aimed, scalar)):
            ahead = zero_near_end(at_start, seen, aimed)
        meets = abs(ahead) < NEAR
        suspicious = may_vanish(at_start, seen, slip, scalar, aimed if meets else -1)
        output = cursor[OUTPUT] < len(samples.t) and samples.t[cursor[OUTPUT]] < t + (LONGER if meets else 1.0) * h
        has_rows = not (suspicious or output or critical)
        event, fraction, slope = -1, 1.0, 0.0
        if not has_rows:
            for s in range(EXTRA):
                combine(K, A_EXTRA[s], STAGES + 1 + s, h, y, probe)
                right_hand_side(m, w, t + C_EXTRA[s] * h, probe, slip, corner, K[STAGES + 1 + s], counters)
            dense_coefficients(K, h, y, y_new, F)
        if suspicious:
            fraction, event, slope = first_root(m, w, t, h, F, y, slip, corner, probe, dy, counters, scalar, at_start, sampled,
                                                 bernstein)
        length, met = h, True
        at_once = event >= 0 and fraction < BESIDE and at_start[event] <= AT_ONCE * noise(slip, event, scalar)
        if at_once:
            met = False
        elif event >= 0:
            length = fraction * h
            take_step(m, w, t, length, y, slip, corner, K, y_new, probe, counters, seen)
            correction = -seen[STAGES - 1, event] * h / slope
            length, met = go_to_event(m, w, t, length, correction, SLOPE, slip, corner, K, y_new, probe, counters, scalar, seen,
                                      event, False)
        elif meets and not suspicious:
            event = aimed
            length, met = go_to_event(m, w, t, h, ahead * h, NEAR, slip, corner, K, y_new, probe, counters, scalar, seen, event, True)
            fraction = length / h
            if t + length > stop:
                scalar[STEP] = max(scalar[STEP], stop - t)  # there is none before the stop: a step that ends there
                counters[REJECTED] += 1
                continue
        if event >= 0 and not at_once and t + length > stop:
            take_step(m, w, t, h, y, slip, corner, K, y_new, probe, counters, seen)
            length, event, met = h, -1, True
        if not met and missed < MISSES:
            # the dense output was not accurate enough to find it, or to find its place: a shorter step makes it so
            scalar[STEP], missed = 0.5 * (1.0 if at_once else max(fraction, BESIDE)) * h, missed + 1
            counters[REJECTED] += 1
            continue
        shorter = event >= 0
        if at_once:
            length = 0.0
        elif not met and w.event[event] > noise(slip, event, scalar):
            event = -1  # it comes near zero, and does not pass it
        missed = 0
        lost, counted = False, 0.0
        if critical:
            lost, fraction, counted = _first_several(m, w, t, h, length / h, F, y, slip, probe)
            length = fraction * h if lost else length

        # emit
        while cursor[OUTPUT] < len(samples.t) and samples.t[cursor[OUTPUT]] < t + length:
            i = cursor[OUTPUT]
            dense_at(F, y, (samples.t[i] - t) / h, probe)
            right_hand_side(m, w, samples.t[i], probe, slip, corner, dy, counters)
            if not _is_finite(dy):
                return NOT_FINITE
            _write(samples.motion[i], samples.force[i], samples.slip[i], m, w, probe, dy, slip)
            cursor[OUTPUT] += 1

        # commit
        counters[STEPS] += 1
        if counters[STEPS] % CRAWL_STEPS == 0:
            if t - scalar[CHECKED] < CRAWL_PROGRESS * t_end:
                return CRAWL
            scalar[CHECKED] = t
        if lost:
            dense_at(F, y, counted, probe)
            row_form(m, w, t + counted * h, probe[:n], probe[n:])
            dense_at(F, y, fraction, probe)
            copy(probe, y)
            scalar[TIME] = t + length
            return SEVERAL
        t_new = stop if reaches_stop and not shorter else t + length
        has_rows = has_rows and not shorter and t_new == t + h
        if event < 0 and not shorter:
            for e in range(len(w.event)):
                distance = zero_near_end(at_start, seen, e)
                if BESIDE < distance < aim / h:
                    aim, aimed = distance * h, e
        fresh = not has_rows
        scalar[STEP], scalar[GAIN] = proposal, max(gain, scalar[GAIN]) if shorter else gain
        if length > 0.0:
            copy(y, y_old)
            copy(y_new, y)
            scalar[TIME] = t_new
            cursor[IDLE] = 0
            if projecting and _project(m, w, t_new, y, scalar, counters, has_rows):
                fresh = True
        speed, force = scalar[SPEED], scalar[FORCE]  # audits do not depend on whether there was output in the step
        if not fresh:
            _remember(m, w, y, scalar)
        if length > resolution:
            for i in range(audits):
                x = ((counters[STEPS] * audits + i) * GOLDEN) % 1.0
                if not _is_held(m, w, t, length, x, y_old, slip, corner, K, y_new, probe, dy, scratch.audit_K,
                                scratch.audit_seen, counters, speed, force, rtol):
                    row_form(m, w, t + x * length, probe[:n], probe[n:])
                    copy(probe, y)
                    scalar[TIME] = t + x * length
                    return AUDIT
        if event < 0:
            if not fresh:
                copy(K[STAGES], K[0])
                copy(seen[STAGES - 1], at_start)
            continue

        # switch mode
        cursor[IDLE] += 1
        if cursor[IDLE] > 10 + 6 * len(m.friction):
            return CHATTER
        right_hand_side(m, w, t_new, y, slip, corner, dy, counters)
        _remember(m, w, y, scalar)
        guide, function = event // 3, event % 3
        if slip[guide] == 0 and choose_branches(m, w, slip, corner):
            right_hand_side(m, w, t_new, y, slip, corner, dy, counters)
            if w.event[event] > AT_ONCE * noise(slip, event, scalar):
                copy(dy, K[0])
                copy(w.event, at_start)
                fresh = False
                continue
        # two-sided values: before in the old mode, after in the new one
        _write(log.motion[log_used, 0], log.force[log_used, 0], log.slip[log_used, 0], m, w, y, dy, slip)
        copy(slip, old_slip)
        for f in range(len(m.friction)):
            copy(corner[f], old_corner[f])
        is_corner = slip[guide] != 0 and function > 0
        if is_corner and cursor[IDLE] < 3 + len(m.friction):
            corner[guide, function - 1] *= -1
        else:
            for f in range(len(m.friction)):
                # a stuck guide stays at rest whatever speed it has drifted to; one that began to slip in this instant does not
                rest_speed[f] = np.inf if slip[f] == 0 else COINCIDENCE * scalar[SPEED]
                if slip[f] != 0 and t_new - began[f] <= SAME_INSTANT * max(1.0, t_new):
                    rest_speed[f] = -1.0
            if slip[guide] == 0:
                if can_jam(m, guide):
                    return JAM
                slip[guide] = 1 if function == 0 else -1
                rest_speed[guide] = -1.0
            elif not is_corner:
                rest_speed[guide] = np.inf
            outcome = choose_mode(m, w, solver, t_new, y[:n], y[n:], slip, corner, rest_speed, counters)
            if outcome != SOLVED:
                return outcome
            for f in range(len(m.friction)):
                if old_slip[f] == 0 and slip[f] != 0:
                    began[f] = t_new
        begin_mode(m, w, t_new, y, slip, corner, K[0], counters)
        fresh = False
        scalar[GAIN], _ = gain_of_mode(m, w, slip)
        copy(w.event, at_start)
        _remember(m, w, y, scalar)
        first = log_used
        for f in range(len(m.friction)):
            kind = -1
            if slip[f] != old_slip[f]:
                kind = SLIP if old_slip[f] == 0 else STICK if slip[f] == 0 else REVERSAL
            elif slip[f] != 0 and (corner[f, 0] != old_corner[f, 0] or corner[f, 1] != old_corner[f, 1]):
                kind = CORNER
            if kind < 0:
                continue
            log.t[log_used], log.kind[log_used], log.guide[log_used] = t_new, kind, f
            if log_used > first:
                for k in range(3):
                    copy(log.motion[first, 0, k], log.motion[log_used, 0, k])
                copy(log.force[first, 0], log.force[log_used, 0])
                copy(log.slip[first, 0], log.slip[log_used, 0])
            _write(log.motion[log_used, 1], log.force[log_used, 1], log.slip[log_used, 1], m, w, y, K[0], slip)
            log_used += 1
            counters[EVENTS] += 1
        cursor[LOGGED] = log_used
        if log_used + len(m.friction) >= len(log.t):
            return ROOM


@kernel
def begin_mode(m: Arrays, w: Workspace, t: float, y: Reals, slip: Integers, corner: IntegerTable, dy: Reals, counters: Integers) -> None:
    """y' into dy and the event functions into w.event at the start of a mode, with the branches of capacity that are the largest there."""
    right_hand_side(m, w, t, y, slip, corner, dy, counters)
    if choose_branches(m, w, slip, corner):
        right_hand_side(m, w, t, y, slip, corner, dy, counters)


@kernel
def _is_held(m: Arrays, w: Workspace, t: float, length: float, x: float, y: Reals, slip: Integers, corner: IntegerTable, K: Table,
             y_new: Reals, probe: Reals, dy: Reals, audit_K: Table, audit_seen: Table, counters: Integers, speed: float, force: float,
             rtol: float) -> bool:
    """Whether Coulomb's law holds at the fraction x of a step from y to y_new.

    The state there is that of the cubic through both ends. Only if it violates the law a step is made that ends there, into `probe`, and
    decides.
    """
    for k in range(len(y)):
        change = y_new[k] - y[k]
        left, right = length * K[0, k] - change, change - length * K[STAGES, k]
        probe[k] = y[k] + x * change + x * (1.0 - x) * ((1.0 - x) * left + x * right)
    right_hand_side(m, w, t + x * length, probe, slip, corner, dy, counters)
    tolerance = max(AUDITED, 10.0 * rtol)
    if not _violates(m, w, slip, tolerance * speed, tolerance * force):
        return True
    copy(K[0], audit_K[0])
    take_step(m, w, t, x * length, y, slip, corner, audit_K, probe, dy, counters, audit_seen)
    return not _violates(m, w, slip, tolerance * speed, tolerance * force)


@kernel
def _violates(m, w, slip, speed, force):
    """Whether a guide is beyond Coulomb's law by more than a speed (m/s) or a force (N)."""
    for f in range(len(m.friction)):
        of_speed, of_force = margin(m, w, slip, f)
        if not (of_speed >= -speed and of_force >= -force):
            return True
    return False


@kernel
def _first_several(m: Arrays, w: Workspace, t: float, h: float, fraction: float, F: Table, y: Reals, slip: Integers,
                   probe: Reals) -> tuple[bool, float, float]:
    """Whether there are several motions somewhere in the first `fraction` of the step, from which fraction on, and one from which
    on they can be counted."""
    n = len(m.inverse_mass)
    low, below = 0.0, True
    for i in range(1, GAIN_SAMPLES + 1):
        high = fraction * i / GAIN_SAMPLES
        dense_at(F, y, high, probe)
        row_form(m, w, t + high * h, probe[:n], probe[n:])
        several = has_several(m, w, slip)
        gain, _ = gain_of_mode(m, w, slip)
        if not several and below and gain >= 1.0:
            # two motions may have come and merged since the gain passed 1, as where a corner changes its surface
            passed = _onset(m, w, t, h, low, high, F, y, slip, probe, False)
            for k in range(1, HALVINGS_BEHIND + 1):
                between = passed + (high - passed) * 0.5 ** k
                dense_at(F, y, between, probe)
                row_form(m, w, t + between * h, probe[:n], probe[n:])
                if has_several(m, w, slip):
                    several, high = True, between
                    break
        below = gain < 1.0
        if several:
            counted = _onset(m, w, t, h, low, high, F, y, slip, probe, True)
            passed = _onset(m, w, t, h, low, high, F, y, slip, probe, False)
            return True, passed if counted - passed <= SINGULAR_STRETCH * (high - low) else counted, counted
        low = high
    return False, fraction, fraction


@kernel
def _onset(m: Arrays, w: Workspace, t: float, h: float, low: float, high: float, F: Table, y: Reals, slip: Integers, probe: Reals,
           several: bool) -> float:
    """By bisection between two fractions of the step: where several motions begin to be counted, or the gain reaches 1."""
    n = len(m.inverse_mass)
    while (high - low) * h > 4e-16 * max(t, h):
        middle = 0.5 * (low + high)
        dense_at(F, y, middle, probe)
        row_form(m, w, t + middle * h, probe[:n], probe[n:])
        gain, _ = gain_of_mode(m, w, slip)
        if has_several(m, w, slip) if several else gain >= 1.0:
            high = middle
        else:
            low = middle
    return high


@kernel
def _project(m: Arrays, w: Workspace, t: float, y: Reals, scalar: Reals, counters: Integers, has_rows: bool) -> bool:
    """Project the state if its residuals exceed rounding; returns whether it was changed.

    has_rows : the rows in the workspace are those of this state.
    """
    n = len(m.inverse_mass)
    if not has_rows:
        row_form(m, w, t, y[:n], y[n:])
    position, velocity = 0.0, 0.0
    for r in range(m.rows):
        position, velocity = max(position, abs(w.phi[r])), max(velocity, abs(w.phi_dot[r]))
    if position <= 1e-14 * m.length_scale and velocity <= 1e-14 * scalar[SPEED]:
        return False
    counters[PROJECTIONS] += 1
    project(m, w, t, y[:n], y[n:], 1e-15 * m.length_scale, 2)
    return True


@dataclass(frozen=True)
class Run:
    """What an integration yields: columns at the output times, events, counters, and how it ended."""

    t: np.ndarray
    columns: dict[str, np.ndarray]
    events: tuple[Event, ...]
    cost: Cost
    breakdown: Breakdown | None

    @property
    def termination(self) -> str:
        return "end" if self.breakdown is None else str(self.breakdown)


def breakdown_of(code: int, time: float, mechanism: Mechanism, w, slip: np.ndarray, corner: np.ndarray,
                 scales: tuple[float, float] = (1.0, 1.0)) -> Breakdown | None:
    """The typed end of a run, from what its kernel left behind at the instant where it failed; None at the end of its time.

    Parameters
    ----------
    code : int
        Of `outcomes`.
    w : Workspace
        Holding the rows of that instant.
    slip, corner : ndarray of int
        The contact mode assumed there.
    scales : tuple of float
        Largest speed (m/s) and force (N), by which an audit measures.
    """
    if code == DONE:
        return None
    m, guide, found = mechanism.arrays, -1, None
    kind, reason = BREAKDOWNS[code]
    if code in (RAY, PIVOT_LIMIT, NONE, SEVERAL, SINGULAR, MODE_LIMIT):
        _, guide = gain_of_mode(m, w, slip)
    if code == SIGN_CYCLE:
        _, _, guide = trial_and_error(m, w, slip, slip == 0, corner, np.zeros(len(w.force)), np.zeros_like(slip))
    if code == AUDIT:
        guide = int(np.argmin([min(np.divide(margin(m, w, slip, f), scales)) for f in range(len(m.friction))]))
    if code == JAM:
        guide = min((f for f in range(len(m.friction)) if can_jam(m, f)), key=lambda f: abs(w.slip[f]))
    if code == NONE:
        found = 0
    if code == SEVERAL:
        found = number_of_solutions(mechanism, w, slip, COUNTED)
    return Breakdown(kind, float(time), reason, mechanism.guide_names[guide] if guide >= 0 else "", found)


def simulate_event_driven(mechanism: Mechanism, q: np.ndarray, v: np.ndarray, output: np.ndarray, t_end: float,
                          rtol: float, step_limit: int = 10_000_000, solver: int = LEMKE, sides: bool = True, audits: int = 1) -> Run:
    """Integrate a mechanism from t = 0 with frozen contact modes and located events.

    Parameters
    ----------
    q, v : ndarray, shape (3 * bodies,)
        State at t = 0, on the constraints.
    output : ndarray
        Output times, increasing, within [0, t_end].
    rtol : float
        Local error per step relative to the mechanism's size (positions; 1 rad for angles) and to its
        largest speed so far (velocities).
    step_limit : int
        Accepted steps after which the run is given up.
    solver : int
        One of `contact_solvers.SOLVERS`.
    audits : int
        Instants of each step at which Coulomb's law is verified; where it is violated the run ends.
    sides : bool
        Whether events keep the values of all columns before and after them: a kilobyte or more each.

    Returns
    -------
    Run
        `breakdown` says where and why the integration stopped early; the columns then end there. One that stops at the start has the
        state there, and accelerations and forces that are nan.
    """
    started = clock()
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    n, nf, size = len(m.inverse_mass), len(m.friction), m.rows + len(m.friction)
    state = State(y=np.concatenate([q, v]), scalar=np.array([0.0, 1e-3 * t_end, 0.0, 0.0, 0.0, 0.0]),
                  slip=np.zeros(nf, dtype=np.int64), corner=np.ones((nf, 4), dtype=np.int64), began=np.full(nf, -np.inf),
                  counters=np.zeros(len(COUNTER_NAMES), dtype=np.int64), cursor=np.zeros(4, dtype=np.int64))
    output = np.array(output, dtype=float)
    samples = Samples(output, np.zeros((len(output), 3, n)), np.zeros((len(output), size)),
                      np.zeros((len(output), nf), dtype=np.int64))
    kinks, scratch = mechanism.kinks(t_end), _scratch(n, nf)
    fastest = mechanism.fastest_law() if nf else 0.0
    longest = LONGEST_STEP / fastest if fastest > 0.0 else np.inf
    room = 256 + nf
    log = EventLog(np.zeros(room), np.zeros(room, dtype=np.int64), np.zeros(room, dtype=np.int64),
                   np.zeros((room, 2, 3, n)), np.zeros((room, 2, size)), np.zeros((room, 2, nf), dtype=np.int64))
    chunks = [EventLog(*(part[:0] for part in log))]
    code = _start(m, w, solver, state) if nf else DONE
    prepared = clock()
    while code in (DONE, ROOM):
        state.cursor[LOGGED] = 0
        code = integrate(m, w, solver, state, t_end, rtol, mechanism.projection, kinks, longest, audits, samples, log, scratch,
                         step_limit)
        used = state.cursor[LOGGED]
        chunks.append(EventLog(*(part[:used if sides or i < 3 else 0].copy() for i, part in enumerate(log))))
        if code == DONE:
            break
    stepped = clock()
    reached = state.cursor[OUTPUT]
    if code != DONE and not reached and len(output) and output[0] == 0.0:
        # it stopped at once: the start is known, accelerations and forces are not
        samples.motion[0, 0], samples.motion[0, 1], samples.motion[0, 2] = q, v, np.nan
        samples.force[0], samples.slip[0], reached = np.nan, state.slip, 1
    columns, events = _columns_and_events(mechanism, Samples(*(part[:reached] for part in samples)),
                                          EventLog(*map(np.concatenate, zip(*chunks))), sides)
    breakdown = breakdown_of(code, state.scalar[TIME], mechanism, w, state.slip, state.corner,
                             (state.scalar[SPEED] or 1.0, state.scalar[FORCE] or 1.0))
    counters = dict(zip(COUNTER_NAMES, map(int, state.counters)))
    cost = Cost(prepared - started, 0.0, stepped - prepared, counters)
    return Run(output[:reached], columns, events, cost, breakdown)


def _start(m, w, solver: int, state: State) -> int:
    """Choose the first contact mode; returns the outcome."""
    n = len(m.inverse_mass)
    v = state.y[n:].reshape(-1, 3)
    speed = max(np.max(np.abs(v[:, :2])), np.max(np.abs(v[:, 2])) * m.length_scale)
    outcome = choose_mode(m, w, solver, 0.0, state.y[:n], state.y[n:], state.slip, state.corner,
                          np.full(len(m.friction), COINCIDENCE * speed), state.counters)
    begin_mode(m, w, 0.0, state.y, state.slip, state.corner, np.zeros(2 * n), state.counters)
    state.began[state.slip != 0] = 0.0
    state.scalar[GAIN], _ = gain_of_mode(m, w, state.slip)
    return outcome


def _columns_and_events(mechanism: Mechanism, samples: Samples, log: EventLog,
                        sides: bool) -> tuple[dict[str, np.ndarray], tuple[Event, ...]]:
    """Columns of the samples, and the events with the same on both of their sides, made together."""
    count, kept = len(samples.t), len(log.t) if sides else 0
    t, motion, force, slip = (np.concatenate([sample, *sided]) for sample, sided in (
        (samples.t, (log.t[:kept], log.t[:kept])), (samples.motion, (log.motion[:, 0], log.motion[:, 1])),
        (samples.force, (log.force[:, 0], log.force[:, 1])), (samples.slip, (log.slip[:, 0], log.slip[:, 1]))))
    columns = build_columns(mechanism, t, motion[:, 0], motion[:, 1], motion[:, 2], force, slip)
    rows = rows_of({name: column[count:] for name, column in columns.items()})
    events: list[Event] = []
    for i in range(len(log.t)):
        before, after = (rows[i], rows[kept + i]) if sides else ({}, {})
        found = Event(float(log.t[i]), EVENT_KINDS[log.kind[i]], mechanism.guide_names[log.guide[i]], before, after)
        last = events[-1] if events else None
        if last and last.kind == found.kind == "corner" and last.joint == found.joint \
                and found.time - last.time <= SAME_INSTANT * max(1.0, found.time):
            # both corners change their surface where the resultant passes zero without a moment
            found = replace(found, before=last.before)
            events.pop()
        events.append(found)
    return {name: column[:count].copy() for name, column in columns.items()}, tuple(events)
