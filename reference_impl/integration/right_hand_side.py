"""The state's derivative while the contact mode is frozen, compiled."""

from __future__ import annotations

from math import sqrt

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, IntegerTable, Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy
from stiction.reference_impl.friction import hlcp
from stiction.reference_impl.friction.coulomb import sticks
from stiction.reference_impl.friction.driven_guides import HELD, driven_acceleration
from stiction.reference_impl.friction.frozen_mode import event_functions, solve_mode
from stiction.reference_impl.friction.open_forces import bounded, ordinary_load
from stiction.reference_impl.friction.outcomes import SOLVED
from stiction.reference_impl.friction.pins_under_load import (
    BLURRED_RESIDUAL,
    MOST_PASSES,
    RESIDUAL,
    solve_mode_of_pins,
    take_loads,
)
from stiction.reference_impl.friction.shared_rest import share_rest
from stiction.reference_impl.friction.uniqueness import COUNTED
from stiction.reference_impl.friction.unlike_masses import solve_with_motion
from stiction.reference_impl.multibody.dynamics import (
    acceleration,
    largest_force,
    row_acceleration,
    row_form,
)
from stiction.reference_impl.multibody.guide_freedom import DRIVEN
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace
from stiction.reference_impl.multibody.one_sided import watch_springs
from stiction.reference_impl.multibody.speed_dependence import continue_beyond_stop


@kernel
def right_hand_side(
    m: Arrays, w: Workspace, t: float, y: Reals, slip: Integers, corner: IntegerTable, dy: Reals
) -> None:
    """Evaluate y' of the frozen mode into dy, and the event functions into w.event.

    The contact mode is `slip` and `corner`; dy is nan where it has no finite forces.
    """
    n = len(m.inverse_mass)

    # forces of the mode, by one linear solve
    row_form(m, w, t, y[:n], y[n:])
    if m.varying > 0:
        continue_beyond_stop(m, w, slip)
    if m.pins > 0:
        regular = solve_mode_of_pins(m, w, slip, corner)
    else:
        regular = solve_mode(m, w, slip, corner)

    # accelerations; of very unlike masses from a system that contains them, as M^-1 (Q + J^T lambda) would cancel
    for i in range(n):
        dy[i] = y[n + i]
    if not (m.unlike and regular and solve_with_motion(m, w, slip, corner, dy[n:])):
        acceleration(m, w, w.force, dy[n:])
    w.counters.rhs += 1

    # Event functions. Where guides at rest share a load the system is singular, and its shortest solution need not be
    # within Coulomb's cones: another share is looked for.
    event_functions(m, w, slip, corner)
    if len(m.one_sided) > 0:
        watch_springs(m, w, y[:n], y[n:])
    if m.unfree > 0:
        _watch_drives(m, w, slip)
    if not regular and len(m.friction):
        has_forces = _hyperstatic_stick(m, w, slip, corner)
        if m.pins > 0 and has_forces:
            has_forces = _share_by_loads(m, w, slip, corner, dy)
        if not has_forces:
            for i in range(len(dy)):
                dy[i] = np.nan


@kernel
def _share_by_loads(
    m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable, dy: Reals
) -> bool:
    """Share the load of joints at rest again until the bounds of pins agree with the forces in them.

    Returns False where they do not agree (`pins_under_load`). Accelerations of whatever moves beside the joints at rest
    follow from the last forces, unless these are of a motion that ends the rest, beyond its event.
    """
    least = np.inf
    for _ in range(MOST_PASSES):
        change = take_loads(m, w)
        if change <= RESIDUAL or change <= BLURRED_RESIDUAL and change >= least:
            if _all_hold(m, w, slip):
                acceleration(m, w, w.force, dy[len(m.inverse_mass) :])
            return True
        least = min(least, change)
        solve_mode(m, w, slip, corner)
        event_functions(m, w, slip, corner)
        if m.unfree > 0:
            _watch_drives(m, w, slip)
        if not _hyperstatic_stick(m, w, slip, corner):
            return False
    return False


@kernel
def _all_hold(m, w, slip):
    """Return True if no event function of a joint at rest is negative."""
    for f in range(len(m.friction)):
        if sticks(m, slip, f) and min(w.event[3 * f], w.event[3 * f + 1]) < 0.0:
            return False
    return True


@kernel
def _watch_drives(m: Arrays, w: Workspace, slip: Integers) -> None:
    """Set the event functions of driven guides.

    At rest: minus the acceleration with which their drives begin to move them. No friction can prevent this, since the
    acceleration follows from the constraints alone. In slip: corner forces, made finite by `open_forces.bounded`.
    """
    for f in range(len(m.friction)):
        if m.friction[f].freedom != DRIVEN:
            continue
        if slip[f] != 0:
            if m.friction[f].corners == 0:
                continue
            ordinary = ordinary_load(m, w, f)
            w.event[3 * f + 1] = bounded(w.event[3 * f + 1], ordinary)
            if m.friction[f].length > 0.0:
                w.event[3 * f + 2] = bounded(w.event[3 * f + 2], ordinary)
        else:
            acceleration = driven_acceleration(m, w, f)
            if acceleration != 0.0:
                side = 0 if acceleration > 0.0 else 1
                w.event[3 * f + side] = -abs(acceleration)


@kernel(allocates=True)
def _hyperstatic_stick(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable) -> bool:
    """Set friction and event functions of guides at rest whose shares of a load are not determined by rigid bodies.

    Returns False where the HLCP is asked (see below) and has no solution, or none is found by Lemke's method or among
    `COUNTED` contact modes; more are not tried, as this is called at every stage of every step.
    """
    # A guide that a drive begins to move in a singular position, as that of a slider whose crank starts from its dead
    # centre, is held by no forces: its event function is minus its acceleration, and rest ends there.
    held = True
    for f in range(len(m.friction)):
        if sticks(m, slip, f):
            t = m.rows + f
            acceleration = row_acceleration(w, t, w.force)
            rounding = HELD * max(abs(w.right[t]), largest_force(m, w, w.force) * sqrt(w.G[t, t]))
            if not abs(acceleration) <= rounding:
                side = 0 if acceleration > 0.0 else 1
                w.event[3 * f + side] = -abs(acceleration)
                held = False

    # the share of `shared_rest`: the event functions are the margins of the safest share, which are continuous
    if not held or share_rest(m, w, slip, corner):
        return True

    # There are more guides than `shared_rest` tries: the HLCP decides. Its share is admissible. The event functions are
    # minus the acceleration that it gives a guide, else 1: they jump where rest ends, so that the guarantee of
    # `event_location` does not hold for them.
    w.counters.hlcp += 1
    force, y, x, outcome, rest = hlcp.solve(m, w, slip, COUNTED)
    accelerate = np.zeros(len(m.friction))
    signs = np.zeros((len(m.friction), 2), dtype=np.int64)
    fastest = 0.0
    if outcome == SOLVED:
        hlcp.read(m, w, slip, force, y, x, accelerate, signs)
        for f in range(len(m.friction)):
            fastest = max(fastest, abs(accelerate[f]))
        # the loads of pins are those of this solution even where it ends the rest
        if fastest <= rest or m.pins > 0:
            copy(force, w.force)
    for f in range(len(m.friction)):
        if sticks(m, slip, f):
            w.event[3 * f], w.event[3 * f + 1] = 1.0, 1.0
            if accelerate[f] > rest:
                w.event[3 * f] = -accelerate[f]
            elif accelerate[f] < -rest:
                w.event[3 * f + 1] = accelerate[f]  # negative, as minus the acceleration along -
    return outcome == SOLVED
