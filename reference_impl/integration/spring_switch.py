"""The states of springs that act on one side only, at the start of an integration and behind their events, compiled.

A spring changes its state (`one_sided`) where one of its event functions passes zero: it comes into contact, is
released, or is clamped by its damper. Its tension jumps only at the contact of a damped spring. Guides may then break
away, or change their surfaces, in the same instant: the contact solver chooses their modes anew. At all other changes
forces are continuous, and so are the modes of guides.

Names. Kernels take the mechanism m, the workspace w of one instant and the integration s.
"""

from __future__ import annotations

from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.friction.mode_choice import choose_mode
from stiction.reference_impl.friction.outcomes import CHATTER, DONE, ROOM, SOLVED
from stiction.reference_impl.integration.integration_state import AT_ONCE, State, noise, remember
from stiction.reference_impl.integration.mode_switch import (
    chatters,
    keep_before,
    log_changes,
    log_sides,
    note_beginnings,
    room_needed,
    set_rest_speeds,
    start_mode,
)
from stiction.reference_impl.integration.result import CONTACT, RELEASE, EventLog
from stiction.reference_impl.integration.right_hand_side import right_hand_side
from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace
from stiction.reference_impl.multibody.one_sided import (
    ACTS,
    FREE,
    FUNCTIONS,
    begin_springs,
    next_state,
)


@kernel
def begin_one_sided(m: Arrays, w: Workspace, s: State) -> None:
    """Set the states of all springs at the start of an integration."""
    n = len(m.inverse_mass)
    row_form(m, w, 0.0, s.y[:n], s.y[n:])
    begin_springs(m, w, s.y[:n], s.y[n:])


@kernel(allocates=True)
def switch_springs(m: Arrays, w: Workspace, s: State, log: EventLog, first_step: float) -> int:
    """Change the states of springs at an event of one of them, and log the changes.

    Returns DONE, ROOM if the log is full, or why the run ends.
    """
    p, n = s.progress, len(m.inverse_mass)
    if chatters(m, s):
        return CHATTER

    # values before the event, with the forces of the old states
    right_hand_side(m, w, p.time, s.y, s.slip, s.corner, s.dy)
    remember(m, w, s)
    first = keep_before(m, w, s, log)

    # the spring of the event, and those whose functions fall to zero with it
    before = w.acting.copy()
    jumps = False
    for k in range(len(m.one_sided)):
        for function in range(2):
            e = FUNCTIONS * (len(m.friction) + k) + function
            zero = AT_ONCE * noise(s, e)
            falls_with_it = abs(w.event[e]) <= zero < s.at_start[e]
            if w.acting[k] == before[k] and (e == s.attempt.event or falls_with_it):
                w.acting[k] = next_state(before[k], function)
                is_contact = before[k] == FREE and w.acting[k] == ACTS
                jumps = jumps or is_contact and m.one_sided[k].damping > 0.0

    # the modes of the guides, where forces jump
    if jumps and len(m.friction) > 0:
        set_rest_speeds(s, first_step)
        outcome = choose_mode(m, w, p.time, s.y[:n], s.y[n:], s.slip, s.corner, s.rest_speed)
        if outcome != SOLVED:
            return outcome
        note_beginnings(s)

    # start of the new states
    start_mode(m, w, s)
    for k in range(len(m.one_sided)):
        if (w.acting[k] == ACTS) != (before[k] == ACTS):
            i = p.logged
            log.kind[i] = CONTACT if w.acting[k] == ACTS else RELEASE
            log.t[i], log.guide[i], log.others[i] = p.time, len(m.friction) + k, 0
            log_sides(w, s, log, first, i)
            w.counters.events += 1
    log_changes(m, w, s, log, first, 0)
    return ROOM if p.logged + room_needed(m) >= len(log.t) else DONE
