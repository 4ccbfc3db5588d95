"""The contact mode at the start of an integration, behind its events, and where laws switch; compiled.

At an event one guide, pin or drive with a limit breaks away, comes to rest or reverses, or a guide changes a surface;
others may follow in the same instant. Where a law of time switches (`cross_switch`), any of them may.
The contact solver chooses the mode (`mode_choice`). Where the forces of the instant itself do not tell, those just
behind it do.

Names. Kernels take the mechanism m, the workspace w of one instant and the integration s. Event function e = 3 guide +
function belongs to a guide; `frozen_mode.event_functions` has the three functions of a guide. "Behind" an instant is
the state that its accelerations lead to after a small part of a step (`_look_behind`), in `State.probe`.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy, is_finite
from stiction.reference_impl.friction.coulomb import can_jam, normal_load, sticks
from stiction.reference_impl.friction.driven_guides import driven_speed, frictionless_forces
from stiction.reference_impl.friction.frozen_mode import (
    ALL,
    choose_branches,
    most_capacity,
    solve_mode,
)
from stiction.reference_impl.friction.guides_at_rest import leave_together, rest_together
from stiction.reference_impl.friction.mode_choice import HOLDS, LEAVES, choose_mode, other_modes
from stiction.reference_impl.friction.open_forces import LARGE, may_be_several, ordinary_load
from stiction.reference_impl.friction.outcomes import (
    CHATTER,
    DONE,
    JAM,
    NONE,
    ROOM,
    SOLVED,
    UNBOUNDED,
)
from stiction.reference_impl.friction.shared_rest import margins_of_safest
from stiction.reference_impl.friction.uniqueness import gain_of_mode
from stiction.reference_impl.integration.event_location import CREEP
from stiction.reference_impl.integration.integration_state import (
    AT_ONCE,
    NO_EVENT,
    State,
    Task,
    noise,
    remember,
)
from stiction.reference_impl.integration.result import (
    CORNER,
    REVERSAL,
    SAME_INSTANT,
    SLIP,
    STICK,
    SWITCH,
    UNCHANGED,
    EventLog,
)
from stiction.reference_impl.integration.right_hand_side import right_hand_side
from stiction.reference_impl.multibody.dynamics import acceleration, largest_speed, row_form
from stiction.reference_impl.multibody.guide_freedom import DRIVEN, FREE
from stiction.reference_impl.multibody.mechanism import NO_LAW, Arrays, Workspace
from stiction.reference_impl.multibody.projection import project
from stiction.reference_impl.multibody.trajectory_columns import write_sample

COINCIDENCE = 1e-11
"""Slip speed, relative to the largest speed so far, at which a second guide comes to rest in the same event. Far above
the rounding of a located event (1e-15), far below speeds that matter."""
UNLOADED = 1e-9
"""Capacity of a guide, relative to the largest force so far, that counts as zero. Where normal force and friction pass
zero together, as where all loads on a slider pass zero in one ratio, the instant itself does not tell whether the guide
holds, nor by which corners. Nor does it where a guide reverses whose slip speed, relative to the largest so far, is
zero with them, as on a turning arm without weight."""
AT_REST = 1e-6
"""Largest speed so far, relative to that which free bodies would reach in a step, up to which all is taken to have been
at rest."""
AHEAD_OF_DRIVES = 0.1
"""Part of a step behind an instant at which drives tell whether they move a guide that is at rest there. A law of third
order has moved it by then at a speed of a hundredth of the step's."""
DRIVES_REST = 1e-12
"""Slip speed there, relative to the largest speed, up to which drives leave a guide at rest: above rounding."""
MOST_IDLE, MOST_IDLE_PER_GUIDE = 10, 6
"""Events without time passing between them, at all and for each guide, after which modes are taken to chatter. It is
generous: a guide that slips or rests, and changes both corners, has three, and may do so twice as others follow."""
CORNERS_IDLE = 3
"""Events without time passing, beside one for each guide, up to which a corner is changed on its own: corners that go
on changing are decided by the contact solver instead."""
BEHIND = 1e-3
"""Part of a step behind such an instant at which the forces tell: far above what an event is located to, far below what
loads change in."""


@kernel
def switch_mode(m: Arrays, w: Workspace, s: State, log: EventLog, first_step: float) -> int:
    """Choose the contact mode behind the event at the state, and log what has changed.

    Returns DONE, ROOM if the log is full, or why the run ends.
    """
    p, event = s.progress, s.attempt.event
    guide = event // 3
    if chatters(m, s):
        return CHATTER

    # forces of the old mode at the event
    right_hand_side(m, w, p.time, s.y, s.slip, s.corner, s.dy)
    if m.unfree > 0 and not is_finite(s.dy):
        _approach(m, w, s)
    remember(m, w, s)

    # which guide's event it is, and whether its mode does change
    if len(m.friction) > 1 and sticks(m, s.slip, guide):
        event = _first_to_leave(m, w, s, event)
        guide = event // 3
    switches, function, behind = _examine_event(m, w, s, event)
    if not switches:
        p.stale = 0
        return DONE

    # the values before the event, which are the same for all guides that change in it
    first = keep_before(m, w, s, log)

    others = 0
    if s.slip[guide] != 0 and function > 0 and p.idle < CORNERS_IDLE + len(m.friction):
        # A corner force of a guide that slips passes zero. Its friction does not jump, nor do the accelerations: only
        # the sign changes, without a contact problem, unless the forces of one motion can be several.
        several = m.unfree > 0 and may_be_several(m, w, s.slip)
        unbounded = several and _grows_without_bound(m, w, s.slip, guide)
        _change_surfaces(m, w, s, event)
        outcome = _choose_forces_behind(m, w, s, event, unbounded) if several else SOLVED
        if outcome != SOLVED:
            return UNBOUNDED if unbounded and outcome == NONE else outcome
    else:
        # a guide breaks away, comes to rest or reverses: forces jump, and others may change their modes with it
        outcome = _change_slip(m, w, s, first_step, guide, function, behind)
        if outcome != SOLVED:
            return outcome
        others = _count_other_modes(m, w, s)
        note_beginnings(s)
        if s.began[guide] == p.time and not behind:
            # a first break-away: the largest speed so far is rounding, and no scale
            copy(s.y, s.probe)
            _foresee_speeds(m, w, s)
        _remove_creep_against_slip(m, w, s)

    # start of the new mode
    start_mode(m, w, s)
    log_changes(m, w, s, log, first, others)
    return ROOM if p.logged + room_needed(m) >= len(log.t) else DONE


@kernel
def cross_switch(m: Arrays, w: Workspace, s: State, log: EventLog, task: Task) -> int:
    """Choose the contact mode where laws switch, at the state, and log the switch of each law and what has changed.

    Loads may jump there, and drives may begin or end a dwell: unlike at an event, the event functions of the old mode
    do not pass zero. The mode is chosen as at the start of a run, except that guides at rest are known. Returns DONE,
    ROOM if the log is full, or why the run ends.
    """
    p = s.progress
    time = task.switches[p.next_switch]

    # the values before the switch: laws are continuous from the right
    just_before = np.nextafter(p.time, -np.inf)
    right_hand_side(m, w, just_before, s.y, s.slip, s.corner, s.dy)
    remember(m, w, s)
    first = keep_before(m, w, s, log)

    # the mode by the forces of this instant, or by those just behind it
    if len(m.friction) > 0:
        outcome = _choose_at_switch(m, w, s, task)
        if outcome != SOLVED:
            return outcome
        # behind a rest of all bodies the largest speed so far is rounding, and no scale
        copy(s.y, s.probe)
        _foresee_speeds(m, w, s)
    start_mode(m, w, s)
    p.expected_in = np.inf
    p.idle = 0

    # a row for each law, and for each guide whose mode has changed
    while p.next_switch < len(task.switches) and task.switches[p.next_switch] == time:
        i = p.logged
        log.t[i], log.kind[i], log.others[i] = p.time, SWITCH, 0
        log.guide[i] = task.switched[p.next_switch]
        log_sides(w, s, log, first, i)
        p.next_switch += 1
    log_changes(m, w, s, log, first, 0)
    return ROOM if p.logged + room_needed(m) >= len(log.t) else DONE


@kernel
def chatters(m, s):
    """Count an event, and return True if too many have followed each other without time passing."""
    s.progress.idle += 1
    most = MOST_IDLE + MOST_IDLE_PER_GUIDE * (len(m.friction) + len(m.one_sided))
    return s.progress.idle > most


@kernel
def keep_before(m, w, s, log):
    """Write the values before an instant, which all changes in it share, into the next row of the log.

    They are those of the workspace and of s.dy. The mode before is kept, too. Returns the number of the row.
    """
    row = s.progress.logged
    write_sample(w, s.y, s.dy, s.slip, log.motion[row, 0], log.force[row, 0], log.slip[row, 0])
    copy(s.slip, s.old_slip)
    for f in range(len(m.friction)):
        copy(s.corner[f], s.old_corner[f])
    return row


@kernel
def note_beginnings(s):
    """Note the guides that began to slip in this instant, which must not be brought to rest in it again."""
    for f in range(len(s.slip)):
        if s.old_slip[f] == 0 and s.slip[f] != 0:
            s.began[f] = s.progress.time


@kernel
def start_mode(m, w, s):
    """Begin the mode that has been chosen, and keep what the next step reads of its start."""
    begin_mode(m, w, s)
    s.progress.gain, _ = gain_of_mode(m, w, s.slip)
    copy(w.event, s.at_start)
    s.progress.stale = 0
    remember(m, w, s)


@kernel
def room_needed(m):
    """Return the largest number of rows of the log that one instant takes."""
    return len(m.friction) + len(m.law) + len(m.one_sided)


@kernel
def _choose_at_switch(m, w, s, task):
    """Choose the contact mode at the state, where laws switch; return the outcome."""
    p, n = s.progress, len(m.inverse_mass)
    t, q, v = p.time, s.y[:n], s.y[n:]
    for f in range(len(m.friction)):
        s.rest_speed[f] = COINCIDENCE * p.speed
        # a drive with a limit holds on only if the rate of its law does not jump
        follows_law = m.friction[f].law != NO_LAW
        if s.slip[f] == 0 and m.friction[f].freedom == FREE and not follows_law:
            s.rest_speed[f] = HOLDS
        elif s.slip[f] != 0 and t - s.began[f] <= SAME_INSTANT * max(task.first_step, t):
            s.rest_speed[f] = LEAVES
    outcome = choose_mode(m, w, t, q, v, s.slip, s.corner, s.rest_speed)
    if outcome == SOLVED and m.unfree > 0 and _foresee_drives(m, w, s):
        outcome = choose_mode(m, w, t, q, v, s.slip, s.corner, s.rest_speed)
    if outcome != SOLVED:
        return outcome

    # a guide at rest without load does not tell at this instant whether it holds: the mode is that just behind
    right_hand_side(m, w, t, s.y, s.slip, s.corner, s.K[0])
    any_unloaded = False
    for f in range(len(m.friction)):
        if abs(w.slip_speed[f]) <= s.rest_speed[f] and m.friction[f].freedom == FREE:
            any_unloaded = any_unloaded or most_capacity(m, w, f) <= UNLOADED * p.force
    if any_unloaded:
        _look_behind(m, w, s)
        outcome = _choose_behind(m, w, s)
    note_beginnings(s)
    return outcome


@kernel(allocates=True)
def _first_to_leave(m: Arrays, w: Workspace, s: State, event: int) -> int:
    """Return the event function of the guide at rest that leaves, in its direction, at an event of a guide at rest.

    It is the event itself unless guides share a load. These have one event function together (`shared_rest`): the one
    with the smallest margin in the safest share leaves. The event functions become the margins then.
    """
    # whether guides share a load: the system of the mode is singular then
    force = w.force.copy()
    regular = solve_mode(m, w, s.slip, s.corner)
    copy(force, w.force)
    if regular:
        return event
    margins = np.zeros((len(m.friction), 2))
    margins_of_safest(m, w, s.slip, s.corner, margins)
    guide, side = event // 3, min(event % 3, 1)
    if np.isnan(margins[guide, side]):
        return event  # this guide shares no load, though others do

    # the smallest of all margins
    least = np.inf
    for f in range(len(margins)):
        for k in range(2):
            if not np.isnan(margins[f, k]):
                w.event[3 * f + k] = margins[f, k]
                if margins[f, k] < least:
                    event, least = 3 * f + k, margins[f, k]

    # Several margins may be the smallest at once. A guide without load has a margin that is zero at this instant only,
    # which ends no rest: if it is among them, its event is the one to examine.
    zero = UNLOADED * s.progress.force
    for f in range(len(margins)):
        for k in range(2):
            if margins[f, k] <= least + zero and most_capacity(m, w, f) <= zero:
                return 3 * f + k
    return event


@kernel
def _examine_event(m, w, s, event):
    """Return if the mode switches at the event, by which of the guide's event functions, and if it is decided behind.

    Where the guide is unloaded, the forces just behind the instant decide (`_look_behind`). A guide at rest that holds
    there, or on another branch of its capacity, does not switch.
    """
    guide, function = event // 3, event % 3
    p, slip = s.progress, s.slip
    if slip[guide] == 0 and not sticks(m, slip, guide):
        return True, function, False  # a drive moves it, whatever its load
    unloaded = most_capacity(m, w, guide) <= UNLOADED * p.force

    # capacity and friction pass zero together: whether the guide holds shows behind the instant only
    if slip[guide] == 0 and unloaded:
        function = _way_out(m, w, s, guide)
        if function == NO_EVENT:
            begin_mode(m, w, s)
            copy(w.event, s.at_start)
            return False, function, True
        right_hand_side(m, w, p.time, s.y, slip, s.corner, s.dy)
        return True, function, True

    # one branch of the capacity has fallen below the friction, but another is above it: the guide holds by that
    if slip[guide] == 0 and choose_branches(m, w, slip, s.corner, UNLOADED * p.force):
        right_hand_side(m, w, p.time, s.y, slip, s.corner, s.dy)
        if w.event[event] > AT_ONCE * noise(s, event):
            copy(s.dy, s.K[0])
            copy(w.event, s.at_start)
            return False, function, False

    # slip speed and load pass zero together: the friction of this instant tells nothing of that behind it
    if slip[guide] != 0 and abs(w.slip_speed[guide]) <= UNLOADED * p.speed and unloaded:
        copy(s.dy, s.K[0])
        _look_behind(m, w, s)
        right_hand_side(m, w, p.time, s.y, slip, s.corner, s.dy)
        return True, 0, True
    return True, function, False


@kernel
def _way_out(m: Arrays, w: Workspace, s: State, guide: int) -> int:
    """Return the event function (0 or 1) by which an unloaded guide at rest breaks away.

    It is the one that is lower just after the state.

    NO_EVENT if the guide holds there.
    """
    right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])
    _look_behind(m, w, s)
    e = 3 * guide
    if not min(w.event[e], w.event[e + 1]) < -AT_ONCE * noise(s, e):
        return NO_EVENT
    _first_to_leave(m, w, s, e)
    return 0 if w.event[e] < w.event[e + 1] else 1


@kernel
def _change_slip(m, w, s, first_step, guide, function, behind):
    """Choose the mode after a break-away, a rest, or a corner that changed too often; return the outcome."""
    t, y, slip = s.progress.time, s.y, s.slip
    n = len(m.inverse_mass)

    set_rest_speeds(s, first_step)

    # the guide of the event, with those that cannot but slip or rest with it
    if sticks(m, slip, guide):
        if can_jam(m, guide):
            return JAM
        _break_away(m, w, s, guide, 1 if function == 0 else -1)
    elif slip[guide] != 0 and function == 0:
        s.rest_speed[guide] = HOLDS
        _come_to_rest(m, w, s)

    # the modes of all guides, again if drives move some that had no speed yet
    if behind:
        return _choose_behind(m, w, s)
    outcome = choose_mode(m, w, t, y[:n], y[n:], slip, s.corner, s.rest_speed)
    if outcome == SOLVED and m.unfree > 0 and _foresee_drives(m, w, s):
        outcome = choose_mode(m, w, t, y[:n], y[n:], slip, s.corner, s.rest_speed)
    return outcome


@kernel
def set_rest_speeds(s, first_step):
    """Set the speed up to which each guide is at rest, at an event.

    A stuck guide is at rest whatever speed it has drifted to; one that began to slip in this instant is not, although
    it has no speed yet.
    """
    t = s.progress.time
    for f in range(len(s.slip)):
        s.rest_speed[f] = HOLDS if s.slip[f] == 0 else COINCIDENCE * s.progress.speed
        if s.slip[f] != 0 and t - s.began[f] <= SAME_INSTANT * max(first_step, t):
            s.rest_speed[f] = LEAVES


@kernel(allocates=True)
def _break_away(m: Arrays, w: Workspace, s: State, guide: int, direction: int) -> None:
    """Let a guide at rest slip, and those at rest without which it cannot: for this instant none of them is at rest."""
    nf = len(m.friction)
    leaving = np.zeros(nf, dtype=np.int64)
    leaving[guide] = direction
    firmness = np.zeros(nf)  # of guides that may leave with it, those of the smallest margin do
    for f in range(nf):
        firmness[f] = min(w.event[3 * f], w.event[3 * f + 1])
    leave_together(m, w, leaving, firmness, s.slip)
    for f in range(nf):
        if s.old_slip[f] == 0 and s.slip[f] != 0:
            s.rest_speed[f] = LEAVES


@kernel(allocates=True)
def _remove_creep_against_slip(m: Arrays, w: Workspace, s: State) -> None:
    """Take their slip speed from guides that begin to slip, where it is against their direction.

    A guide at rest creeps by rounding, and rows of guides that share a load are not projected. Where static bounds
    equal kinetic ones and a load grows slowly, a slip begins without an acceleration, and grows with the square of
    time: a creep against it, above what `event_location` expects by the scale of speeds, would end it at once.
    """
    p, n = s.progress, len(m.inverse_mass)
    q, v = s.y[:n], s.y[n:]
    row_form(m, w, p.time, q, v)
    held = np.zeros(len(m.friction), dtype=np.bool_)
    is_against = False
    for f in range(len(m.friction)):
        held[f] = sticks(m, s.old_slip, f)
        begins = held[f] and s.slip[f] != 0
        is_against = is_against or begins and s.slip[f] * w.slip_speed[f] < -CREEP * p.speed
    # whatever speed guides at rest have is an error: none is too large to be removed
    if is_against and not rest_together(m, w, held, np.inf, v):
        project(m, w, p.time, q, v, s.old_slip, True, 2)


@kernel(allocates=True)
def _come_to_rest(m: Arrays, w: Workspace, s: State) -> None:
    """Bring to rest, with the guides at rest, those that cannot but rest with them (`guides_at_rest`)."""
    t, n = s.progress.time, len(m.inverse_mass)
    q, v = s.y[:n], s.y[n:]
    held = np.zeros(len(m.friction), dtype=np.bool_)
    for f in range(len(m.friction)):
        held[f] = abs(w.slip_speed[f]) <= s.rest_speed[f]
    if not rest_together(m, w, held, s.progress.speed, v):
        return
    for f in range(len(m.friction)):
        if held[f]:
            s.rest_speed[f] = HOLDS
    if m.baumgarte_beta2 > 0.0:
        # A mechanism at rest cannot follow the accelerations by which Baumgarte's terms reduce a residual. Velocities
        # meet their constraints already: only positions are left, which the term of beta acts on.
        row_form(m, w, t, q, v)
        project(m, w, t, q, v, s.slip, False, 2)


@kernel(allocates=True)
def _count_other_modes(m: Arrays, w: Workspace, s: State) -> int:
    """Count the modes that would also have been consistent after the event (`other_modes`)."""
    resting = np.zeros(len(m.friction), dtype=np.bool_)
    for f in range(len(m.friction)):
        at_rest = s.old_slip[f] == 0 or abs(w.slip_speed[f]) <= s.rest_speed[f]
        resting[f] = at_rest and m.friction[f].freedom == FREE
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
def log_changes(m, w, s, log, first, others):
    """Log an event for each guide whose mode has changed; the values before it stand in row `first`."""
    p = s.progress
    for f in range(len(m.friction)):
        kind = _kind_of_change(s, f)
        if kind == UNCHANGED:
            continue
        i = p.logged
        log.t[i], log.kind[i], log.guide[i], log.others[i] = p.time, kind, f, others
        log_sides(w, s, log, first, i)
        w.counters.events += 1


@kernel
def log_sides(w, s, log, first, i):
    """Write both sides of an instant into row i of the log: those before from row `first`, those after as they are."""
    if i > first:
        for k in range(3):
            copy(log.motion[first, 0, k], log.motion[i, 0, k])
        copy(log.force[first, 0], log.force[i, 0])
        copy(log.slip[first, 0], log.slip[i, 0])
    write_sample(w, s.y, s.K[0], s.slip, log.motion[i, 1], log.force[i, 1], log.slip[i, 1])
    s.progress.logged += 1


@kernel
def _kind_of_change(s, f):
    """Return the kind of the event of a guide, by its modes before and after."""
    if s.slip[f] != s.old_slip[f]:
        if s.old_slip[f] == 0:
            return SLIP
        return STICK if s.slip[f] == 0 else REVERSAL
    changes_corner = s.corner[f, 0] != s.old_corner[f, 0] or s.corner[f, 1] != s.old_corner[f, 1]
    return CORNER if s.slip[f] != 0 and changes_corner else UNCHANGED


@kernel
def begin_mode(m: Arrays, w: Workspace, s: State) -> None:
    """Evaluate y' into K[0] and the event functions into w.event at the start of a mode.

    Guides at rest get the branches of their capacity that are the largest there; unloaded ones, whose branches are all
    zero, those that are the largest just behind.
    """
    right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])
    remember(m, w, s)
    least, any_unloaded = UNLOADED * s.progress.force, False
    for f in range(len(m.friction)):
        is_unloaded = sticks(m, s.slip, f) and most_capacity(m, w, f) <= least
        any_unloaded = any_unloaded or is_unloaded
    if any_unloaded:
        _look_behind(m, w, s)
        right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])
    # branches enter the event functions, and evaluations with the old ones are repeated
    if choose_branches(m, w, s.slip, s.corner, least) or any_unloaded:
        right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.K[0])


@kernel
def begin(m: Arrays, w: Workspace, s: State, load: float) -> int:
    """Choose the first mode and begin it, of a state whose largest speed is not known yet; returns the outcome.

    Just behind the start it is told how large forces are, and where a guide is unloaded also what moves. Then the
    largest `load` (N) tells what rounding is: that of a sine law near zero is one of its amplitude.
    """
    n = len(m.inverse_mass)

    # which guides are at rest, by their speeds relative to the largest
    s.progress.speed = largest_speed(m, s.y[n:])
    for f in range(len(m.friction)):
        s.rest_speed[f] = COINCIDENCE * s.progress.speed
    row_form(m, w, 0.0, s.y[:n], s.y[n:])
    _come_to_rest(m, w, s)

    # the mode by the forces at the start, again if drives move guides that have no speed yet
    outcome = choose_mode(m, w, 0.0, s.y[:n], s.y[n:], s.slip, s.corner, s.rest_speed)
    if outcome == SOLVED and m.unfree > 0 and _foresee_drives(m, w, s):
        outcome = choose_mode(m, w, 0.0, s.y[:n], s.y[n:], s.slip, s.corner, s.rest_speed)

    # the scale of forces, at the start and just behind it, where loads that begin at zero act already
    right_hand_side(m, w, 0.0, s.y, s.slip, s.corner, s.K[0])
    _look_behind(m, w, s)
    remember(m, w, s)
    right_hand_side(m, w, 0.0, s.y, s.slip, s.corner, s.K[0])

    # a guide at rest without load does not tell at the start whether it holds: the mode is that just behind
    any_unloaded = False
    for f in range(len(m.friction)):
        if abs(w.slip_speed[f]) <= s.rest_speed[f] and m.friction[f].freedom == FREE:
            s.rest_speed[f] = HOLDS
            is_unloaded = most_capacity(m, w, f) <= UNLOADED * s.progress.force
            any_unloaded = any_unloaded or is_unloaded
    if any_unloaded:
        s.progress.force = max(s.progress.force, load)
        outcome = _choose_behind(m, w, s)
    begin_mode(m, w, s)
    for f in range(len(m.friction)):
        if s.slip[f] != 0:
            s.began[f] = 0.0
    s.progress.gain, _ = gain_of_mode(m, w, s.slip)
    return outcome


@kernel
def _look_behind(m: Arrays, w: Workspace, s: State) -> None:
    """Evaluate row forces and event functions BEHIND a step after the state, on the branches that are largest there.

    The state behind is made by Euler's method from y' in K[0], into `probe`.
    """
    h = BEHIND * s.attempt.h
    for k in range(len(s.y)):
        s.probe[k] = s.y[k] + h * s.K[0, k]
    right_hand_side(m, w, s.progress.time + h, s.probe, s.slip, s.corner, s.dy)
    if choose_branches(m, w, s.slip, s.corner, ALL):
        right_hand_side(m, w, s.progress.time + h, s.probe, s.slip, s.corner, s.dy)


@kernel
def _foresee_drives(m: Arrays, w: Workspace, s: State) -> bool:
    """Let driven guides slip that are at rest at the state, and that their drives move just behind it.

    The first derivative of a law that is not zero there tells: a cubic one may begin with neither speed nor
    acceleration. Returns whether there are any; they have the rest speed LEAVES then.
    """
    n, h = len(m.inverse_mass), AHEAD_OF_DRIVES * s.attempt.h
    # the state behind, with positions to second order
    right_hand_side(m, w, s.progress.time, s.y, s.slip, s.corner, s.dy)
    for k in range(n):
        s.probe[k] = s.y[k] + h * (s.y[n + k] + 0.5 * h * s.dy[n + k])
        s.probe[n + k] = s.y[n + k] + h * s.dy[n + k]
    # the impulses that bring its velocities onto the constraints there are what the drives do
    row_form(m, w, s.progress.time + h, s.probe[:n], s.probe[n:])
    frictionless_forces(m, w, w.phi_dot)
    least = DRIVES_REST * max(s.progress.speed, largest_speed(m, s.probe[n:]))
    any_moves = False
    for f in range(len(m.friction)):
        if s.slip[f] == 0 and m.friction[f].freedom == DRIVEN:
            speed = driven_speed(m, w, f)
            if abs(speed) > least:
                s.slip[f] = 1 if speed > 0.0 else -1
                s.rest_speed[f] = LEAVES
                any_moves = True
    return any_moves


@kernel
def _choose_behind(m: Arrays, w: Workspace, s: State) -> int:
    """Choose the mode of the state behind, in `probe`; return the outcome as `choose_mode` does."""
    n = len(m.inverse_mass)
    time = s.progress.time + BEHIND * s.attempt.h
    outcome = choose_mode(m, w, time, s.probe[:n], s.probe[n:], s.slip, s.corner, s.rest_speed)
    _foresee_speeds(m, w, s)
    return outcome


@kernel
def _choose_forces_behind(m: Arrays, w: Workspace, s: State, event: int, unbounded: bool) -> int:
    """Choose the forces behind a corner event where one motion can have several; return the outcome.

    A corner force that falls to zero need not pass it: where the friction gain is 1 or more, two solutions, with either
    sign of the force, can meet there and end together. Or it is none that falls to zero, but one that grows without
    bound (`open_forces.bounded`), if `unbounded`. The signs just behind are those of the smallest solution that is
    left; NONE where none is. A force that passes zero has its new sign there: nothing else is changed then.
    """
    n, h = len(m.inverse_mass), BEHIND * s.attempt.h
    # with the new sign the force is positive behind if it passes zero: that is the ordinary case
    for k in range(2 * n):
        s.probe[k] = s.y[k] + h * s.dy[k]
    right_hand_side(m, w, s.progress.time + h, s.probe, s.slip, s.corner, s.K[0])
    if not unbounded and w.event[event] >= -AT_ONCE * noise(s, event):
        return SOLVED
    # otherwise a solution has ended: choose among those that are left, in the same motion, so with the same slips
    for f in range(len(m.friction)):
        s.rest_speed[f] = HOLDS if s.slip[f] == 0 else LEAVES
    return choose_mode(
        m, w, s.progress.time + h, s.probe[:n], s.probe[n:], s.slip, s.corner, s.rest_speed
    )


@kernel
def _approach(m: Arrays, w: Workspace, s: State) -> None:
    """Fill s.dy with the accelerations of a state whose row forces are infinite.

    The row forces are those a little before the state.

    Forces that grow without bound are those of driven guides: they do not enter the accelerations.
    """
    n, h = len(m.inverse_mass), BEHIND * s.attempt.h
    # accelerations do not depend on the friction of driven guides, so that forces without friction give them
    row_form(m, w, s.progress.time, s.y[:n], s.y[n:])
    frictionless_forces(m, w, w.right)
    for k in range(n):
        s.dy[k] = s.y[n + k]
    acceleration(m, w, w.force, s.dy[n:])
    # row forces of the state a little before, by which the way they grow is told
    for k in range(2 * n):
        s.probe[k] = s.y[k] - h * s.dy[k]
    right_hand_side(m, w, s.progress.time - h, s.probe, s.slip, s.corner, s.K[0])


@kernel
def _grows_without_bound(m, w, slip, guide):
    """Return True where the event of a corner of a driven guide is one at which its force is infinite, not zero.

    `open_forces.bounded` makes both zeros of its event function.
    """
    row, mu = m.friction[guide].row, m.friction[guide].mu
    load = normal_load(m.friction[guide], w.force[row], w.force[row + 1], -mu * slip[guide])
    return m.friction[guide].freedom == DRIVEN and not load < LARGE * ordinary_load(m, w, guide)


@kernel
def _foresee_speeds(m: Arrays, w: Workspace, s: State) -> None:
    """Take the scale of speeds from the state in `probe` where all has been at rest.

    Otherwise the scale would be rounding.
    """
    n, h = len(m.inverse_mass), BEHIND * s.attempt.h
    p = s.progress
    if p.speed > AT_REST * largest_speed(m, w.free) * s.attempt.h:
        return
    right_hand_side(m, w, p.time + h, s.probe, s.slip, s.corner, s.dy)
    p.speed = max(p.speed, largest_speed(m, s.dy[n:]) * h)
