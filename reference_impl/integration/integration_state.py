"""The state of an event-driven integration, and a step of DOP853 in a frozen contact mode, compiled."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from stiction.reference_impl.compiled.bundle import Bundle, Integers, IntegerTable, Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy
from stiction.reference_impl.integration.dop853 import BY_TIME, combine
from stiction.reference_impl.integration.dop853_coefficients import EXTRA, STAGES, A, C
from stiction.reference_impl.integration.right_hand_side import right_hand_side
from stiction.reference_impl.multibody.kinematics import Workspace
from stiction.reference_impl.multibody.mechanism import Arrays

NODES = 8
"""Degree of the polynomials by which a searched step is represented (`event_location`)."""
NOISE = 1e-13
"""Event functions above minus this, relative to the largest speed or force so far, count as not negative: an event
function starts at zero after its own event and must not fire on rounding. It does not enter the location of events."""

PROGRESS = np.dtype([("time", float), ("step", float), ("speed", float), ("force", float), ("gain", float),
                     ("checked", float),
                     ("aim", float), ("aimed", np.int64), ("missed", np.int64), ("next_output", np.int64),
                     ("next_kink", np.int64),
                     ("idle", np.int64), ("logged", np.int64), ("fresh", np.int64)])
"""What the integration carries from step to step.

time, step : s; the step is the one proposed next.  speed, force : the largest so far, m/s and N; rounding is judged by
them.  gain : friction gain (`uniqueness`) at the last accepted step.  checked : time (s) at which progress was looked
at last.  aim : seconds to where an event is expected, of the event function `aimed`; inf if none is.  missed : times
that the present step was shortened for an event.  next_output, next_kink : places in the output times and in the times
at which a law is not smooth.  idle : events that no time passed between.  logged : events in the log.  fresh : 1 where
the state has changed since y' and the event functions were evaluated.
"""
ATTEMPT = np.dtype([("h", float), ("stop", float), ("resolution", float), ("error", float), ("proposal", float),
                    ("length", float),
                    ("fraction", float), ("gain", float), ("counted", float), ("event", np.int64),
                    ("reaches_stop", np.int64), ("aims", np.int64),
                    ("at_once", np.int64), ("has_rows", np.int64), ("shorter", np.int64), ("critical", np.int64),
                    ("lost", np.int64)])
"""What is known of the step that is being made.

h : its length as attempted (s).  stop : time that it must not pass.  resolution : seconds that time can resolve there.
error : estimated, 1 is at the tolerance.  proposal : the step after it.  length : what is kept of it (s), up to the
event function `event` (-1: none), at the `fraction` of h.  gain : friction gain at its end.  Flags: it reaches_stop; it
aims at an expected event; its event is at_once, at its start; it is shorter than attempted; the workspace has_rows of
its end; the gain is critical; the motion is lost in it, several of them being counted at the fraction `counted`.
"""


class State(Bundle):
    """An integration: its state, and room for a step.

    Attributes
    ----------
    y : (2n,)
        q and v.  y_old, y_new : before and after a step.  probe, dy, scale : scratch, of the same length.
    slip, corner : (frictional,), (frictional, 4)
        The contact mode; see `contact_modes`.  old_slip, old_corner : before an event.
    began : (frictional,)
        When each guide last began to slip (s).  rest_speed : see `mode_transition.choose_mode`.
    K, F : (STAGES + 1 + EXTRA, 2n), (7, 2n)
        Derivatives at the stages of a step, and its dense output.  audit_K : as K, of a step that an audit makes.
    at_start, seen : (3 * frictional,), (STAGES, 3 * frictional)
        Event functions at the start of a step, and at its stages in the order of times.  audit_seen : as seen.
    sampled, bernstein : (NODES + 1, 3 * frictional), (2, NODES + 1)
        See `event_location.first_root`.
    progress, attempt : records of `PROGRESS` and `ATTEMPT`
    """

    y: Reals
    y_old: Reals
    y_new: Reals
    probe: Reals
    dy: Reals
    scale: Reals
    slip: Integers
    corner: IntegerTable
    old_slip: Integers
    old_corner: IntegerTable
    began: Reals
    rest_speed: Reals
    K: Table
    F: Table
    audit_K: Table
    at_start: Reals
    seen: Table
    audit_seen: Table
    sampled: Table
    bernstein: Table
    progress: Annotated[np.ndarray, PROGRESS, 0]
    attempt: Annotated[np.ndarray, ATTEMPT, 0]


def state(q: np.ndarray, v: np.ndarray, frictional: int) -> State:
    """At time 0, before a contact mode has been chosen."""
    n, events = 2 * len(q), 3 * frictional
    s = State.zeros(y=n, y_old=n, y_new=n, probe=n, dy=n, scale=n, slip=frictional, corner=(frictional, 4),
                    old_slip=frictional,
                    old_corner=(frictional, 4), began=frictional, rest_speed=frictional, K=(STAGES + 1 + EXTRA, n),
                    F=(7, n),
                    audit_K=(STAGES + 1, n), at_start=events, seen=(STAGES, events), audit_seen=(STAGES, events),
                    sampled=(NODES + 1, events),
                    bernstein=(2, NODES + 1), progress=(), attempt=())
    s.y[:len(q)], s.y[len(q):], s.corner[:], s.old_corner[:], s.began[:] = q, v, 1, 1, -np.inf
    return s


@kernel
def noise(s, e):
    """Rounding of event function e, m/s or N."""
    is_speed = e % 3 == 0 and s.slip[e // 3] != 0
    return NOISE * (s.progress.speed if is_speed else s.progress.force)


@kernel
def take_step(m, w, s, t, h):
    """The 12 stages from K[0] = y'(t), y_new, K[12] = y'(t + h), and the event functions `seen` at each."""
    _stages(m, w, s, t, h, s.y, s.K, s.y_new, s.probe, s.seen)


@kernel
def take_audit_step(m, w, s, t, h):
    """The same from y_old, in the room of audits; its end into `probe`."""
    _stages(m, w, s, t, h, s.y_old, s.audit_K, s.probe, s.dy, s.audit_seen)


@kernel
def _stages(m: Arrays, w: Workspace, s: State, t: float, h: float, y: Reals,  # noqa: PLR0913 - a kernel's arrays
            K: Table, y_new: Reals, stage: Reals, seen: Table) -> None:
    for i in range(1, STAGES + 1):
        combine(K, A[i], i, h, y, stage)
        right_hand_side(m, w, t + C[i] * h, stage, s.slip, s.corner, K[i])
        for e in range(len(w.event)):
            seen[BY_TIME[i], e] = w.event[e]
    copy(stage, y_new)
