"""The state of an event-driven integration, and a step of DOP853 in a frozen contact mode, compiled."""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import (
    Bundle,
    Integers,
    IntegerTable,
    Reals,
    Record,
    Table,
)
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy
from stiction.reference_impl.integration.dop853 import (
    BY_TIME,
    EXTRA,
    STAGES,
    A,
    C,
    combine,
    error_norm,
)
from stiction.reference_impl.integration.right_hand_side import right_hand_side
from stiction.reference_impl.multibody.dynamics import (
    largest_force,
    largest_speed,
    largest_term,
    row_form,
)
from stiction.reference_impl.multibody.mechanism import NO_LAW, Arrays, Workspace
from stiction.reference_impl.multibody.one_sided import largest_tension
from stiction.reference_impl.multibody.singular_positions import (
    ALWAYS_DEPENDENT,
    BRANCH_RATIO,
    REGULAR_RATIO,
    lengths,
    pivots_are_above,
    singular_rows,
    smallest_ratio,
)

NODES = 8
"""Degree of the polynomials by which a searched step is represented (`event_location`)."""
NOISE = 1e-13
"""Event functions above minus this, relative to the largest speed or force so far, count as not negative: an event
function starts at zero after its own event and must not fire on rounding. It does not enter the location of events."""
AT_ONCE = 100.0
"""Times its rounding up to which an event function is zero at the start of a step, where it may fall below zero at
once."""
NO_EVENT = -1
"""Event function of a step that ends at none."""
FREE_LENGTH, TO_STOP, TO_EXPECTED_EVENT = range(3)
"""What the length of a step was chosen for (`Attempt.target`): by tolerances and limits alone; to end at the end of the
run or at a kink of a law; to end where the steps before it predict an event."""


class Task(Bundle):
    """Request to an integration; times in seconds."""

    t_end: float
    rtol: float
    first_step: float  # the length that it tries
    frequency: float  # of the fastest sine law, rad/s; it bounds the steps of `step_limits`
    audits: int  # instants of each step at which its law is verified
    projecting: int  # 1: states are projected onto the constraints after each step
    step_limit: int  # accepted steps after which it is given up
    kinks: Reals  # (n,), increasing: times at which a law is not smooth
    switches: Reals  # (k,), in order: those of the kinks at which a law may change the contact mode
    switched: Integers  # (k,), the law of each of the switches


class Progress(Record):
    """Record that the integration carries from step to step; times in seconds."""

    time: float
    step: float  # the length proposed next
    speed: float  # the largest so far, m/s; rounding is judged by it and by `force`
    force: float  # the largest so far, N
    length: float  # size of the mechanism, m, by which the rounding of depths of one-sided springs is judged
    gain: float  # friction gain (`uniqueness`) at the last accepted step
    checked: float  # when the progress of the run was checked last
    expected_in: float  # time from the state to the next expected event; inf if none is expected
    expected_event: int  # the event function of that event
    misses: int  # times that the present step was shortened because it missed its event
    unresolved_searches: int  # steps shortened since a search last resolved the event functions
    unresolved_steps: int  # steps shortened since the stages of a step last resolved them
    next_output: int  # index of the next sample in the output times
    next_kink: int  # index in the times at which a law is not smooth
    next_switch: int  # index in those at which a law may change the contact mode
    idle: int  # successive events at one and the same time
    logged: int  # events in the log
    stale: int  # 1 where y' and the event functions are not those of the state


class Attempt(Record):
    """Record of the step that is being made; times in seconds; the integers below `target` are flags."""

    h: float  # attempted length, which the dense output spans
    stop: float  # time that it must not pass
    latest: float  # last time at which it may evaluate laws: before a switch, where they may jump; else inf
    resolution: float  # smallest difference of times that double precision resolves there
    proposal: float  # length proposed for the next step
    length: float  # accepted length: to the event, or `h`
    fraction: float  # place of the event, as a fraction of `h`
    gain: float  # friction gain at its end
    counted: float  # fraction at which several motions were counted, if it `is_ambiguous`
    event: int  # event function at its end, or NO_EVENT
    target: int  # what `h` was chosen for: FREE_LENGTH, TO_STOP or TO_EXPECTED_EVENT
    has_rows: int  # the workspace has the rows of its end
    end_moved: int  # its end was moved from `h` to the zero of an event function, or to its closest approach
    near_several: int  # its friction gain is so large that several motions must be looked for
    is_ambiguous: int  # several motions begin in it, at `fraction`
    unresolved: int  # a search did not resolve the event functions


class State(Bundle):
    """An integration: its state, and room for a step; n is the number of coordinates."""

    y: Reals  # (2n,), q and v
    y_old: Reals  # before a step
    y_new: Reals  # after it
    probe: Reals  # scratch, as dy and scale
    dy: Reals
    scale: Reals
    slip: Integers  # (frictional,), with `corner` the contact mode; see `frozen_mode`
    corner: IntegerTable  # (frictional, 4)
    old_slip: Integers  # before an event
    old_corner: IntegerTable
    began: Reals  # (frictional,), when each guide last began to slip, s
    rest_speed: Reals  # (frictional,); see `mode_choice.choose_mode`
    K: Table  # (STAGES + 1 + EXTRA, 2n), derivatives at the stages of a step
    F: Table  # (7, 2n), its dense output
    audit_K: Table  # as K, of a step that an audit makes
    at_start: Reals  # event functions at the start of a step, as `Workspace.event`
    at_stages: Table  # (STAGES, event functions), those at its stages, in the order of times
    audit_at_stages: Table  # as `at_stages`
    sampled: Table  # (NODES + 1, 3 * frictional); see `event_location.first_root`
    bernstein: Table  # (2, NODES + 1)
    progress: Progress
    attempt: Attempt


def state(q: np.ndarray, v: np.ndarray, frictional: int, one_sided: int = 0) -> State:
    """Return the state at time 0, before a contact mode has been chosen.

    `frictional` and `one_sided` are the numbers of frictional guides and of springs that act on one side only.
    """
    n, events = 2 * len(q), 3 * (frictional + one_sided)
    s = State.zeros(
        y=n,
        y_old=n,
        y_new=n,
        probe=n,
        dy=n,
        scale=n,
        slip=frictional,
        corner=(frictional, 4),
        old_slip=frictional,
        old_corner=(frictional, 4),
        began=frictional,
        rest_speed=frictional,
        K=(STAGES + 1 + EXTRA, n),
        F=(7, n),
        audit_K=(STAGES + 1, n),
        at_start=events,
        at_stages=(STAGES, events),
        audit_at_stages=(STAGES, events),
        sampled=(NODES + 1, events),
        bernstein=(2, NODES + 1),
        progress=(),
        attempt=(),
    )
    s.y[: len(q)] = q
    s.y[len(q) :] = v
    s.corner[:] = 1
    s.old_corner[:] = 1
    s.began[:] = -np.inf
    return s


@kernel
def noise(s, e):
    """Return the rounding of event function e, m/s, N or m, by the largest speed or force so far, or by the size."""
    if e >= 3 * len(s.slip):
        return NOISE * (s.progress.length if e % 3 == 0 else s.progress.force)
    is_speed = e % 3 == 0 and s.slip[e // 3] != 0
    return NOISE * (s.progress.speed if is_speed else s.progress.force)


@kernel
def rounding_of_terms(m, w, s, e):
    """Return the rounding that the terms of the instant leave in event function e, m/s or N.

    It is less than `noise` where forces were larger before: a force that grows without bound makes all others look like
    rounding, though its event function falls to zero there.
    """
    is_of_spring = e >= 3 * len(s.slip)
    if is_of_spring or (e % 3 == 0 and s.slip[e // 3] != 0):
        return noise(s, e)
    unit = m.friction[e // 3].unit
    return NOISE * largest_term(m, w) / np.sqrt(w.G[unit, unit])


@kernel
def remember(m, w, s):
    """Keep the largest speed and force so far, by which rounding is judged; forces as of the row `unit` of a guide.

    A force that the terms of its equation leave small is known to the rounding of these terms: so is that of a guide
    which falls with its slider, without any load.
    """
    n, y, p = len(m.inverse_mass), s.y, s.progress
    p.speed = max(p.speed, largest_speed(m, y[n:]))
    for f in range(len(m.friction)):
        if m.friction[f].law != NO_LAW:
            # the rate of a law has its rounding, too, as where a drive begins with a mechanism at rest
            p.speed = max(p.speed, abs(w.slip_speed[f]))
    largest = max(largest_force(m, w, w.force), largest_term(m, w)) if len(m.friction) else 0.0
    for f in range(len(m.friction)):
        unit = m.friction[f].unit
        p.force = max(p.force, largest / np.sqrt(w.G[unit, unit]))
    if len(m.one_sided) > 0:
        p.force = max(p.force, largest_tension(m, w, y[:n], y[n:]))


@kernel
def take_step(m, w, s, t, h):
    """Make a step of DOP853 from the state at t, whose y' is in K[0].

    K receives the stages and, at last, y' at the end; y_new the state there, `at_stages` the event functions. The
    workspace is that of the end.
    """
    _stages(m, w, s, t, h, s.y, s.K, s.y_new, s.probe, s.at_stages)


@kernel
def take_audit_step(m, w, s, t, h):
    """Make a step from y_old, in the room of audits; its end goes into `probe`."""
    _stages(m, w, s, t, h, s.y_old, s.audit_K, s.probe, s.dy, s.audit_at_stages)


@kernel
def _stages(  # noqa: PLR0913 - a kernel's arrays
    m: Arrays,
    w: Workspace,
    s: State,
    t: float,
    h: float,
    y: Reals,
    K: Table,
    y_new: Reals,
    stage: Reals,
    at_stages: Table,
) -> None:
    for i in range(1, STAGES + 1):
        combine(K, A[i], i, h, y, stage)
        time = min(t + C[i] * h, s.attempt.latest)
        right_hand_side(m, w, time, stage, s.slip, s.corner, K[i])
        for e in range(len(w.event)):
            at_stages[BY_TIME[i], e] = w.event[e]
    copy(stage, y_new)


@kernel(allocates=True)
def error_along_motion(m: Arrays, w: Workspace, s: State, error: float, bodies: int) -> float:
    """Return the local error of the step (`dop853.error_norm`) along the present branch of motion.

    The part along another branch is left out where a stage has a singular value of J below BRANCH_RATIO.
    The directions are those of the stage that has the smallest. The rows of the workspace are those
    of y_new, before and after.
    """
    n, unit = len(m.inverse_mass), lengths(m)
    t, h = s.progress.time, s.attempt.h

    # no singular position anywhere around: by pivots first, which are far cheaper than singular values
    if len(m.cell) == 0 and pivots_are_above(m, w, REGULAR_RATIO**2):
        return error
    _, _, values, across = singular_rows(m, w, unit)
    if not smallest_ratio(values) < REGULAR_RATIO:
        return error

    # The stage with the smallest singular value of all. Its right vectors from `first` to `last` are the directions of
    # the other branch: their singular values are small, but not zero as those of redundant constraints.
    nearest = BRANCH_RATIO
    first, last = 0, 0
    for stage in range(1, STAGES + 1):
        combine(s.K, A[stage], stage, h, s.y, s.probe)
        row_form(m, w, t + C[stage] * h, s.probe[:n], s.probe[n:])
        _, _, values, right_of = singular_rows(m, w, unit)
        if smallest_ratio(values) < nearest:
            nearest, across = smallest_ratio(values), right_of
            first, last = 0, 0
            for value in values:
                first += 1 if value >= BRANCH_RATIO * values[0] else 0
                last += 1 if value > ALWAYS_DEPENDENT * values[0] else 0
    row_form(m, w, min(t + h, s.attempt.latest), s.y_new[:n], s.y_new[n:])
    if first == last:
        return error

    # the error of the stages without their parts in these directions, in positions and in speeds
    along = s.K.copy()
    for i in range(STAGES + 1):
        for half in range(0, 2 * n, n):
            for k in range(first, last):
                part = 0.0
                for c in range(n):
                    part += across[c, k] * along[i, half + c] / unit[c]
                for c in range(n):
                    along[i, half + c] -= unit[c] * across[c, k] * part
    return error_norm(along, h, s.scale, bodies)
