"""The state's derivative while the contact mode is frozen, compiled."""

from __future__ import annotations

from math import sqrt

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, IntegerTable, Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy
from stiction.reference_impl.friction import hlcp
from stiction.reference_impl.friction.coulomb import capacity
from stiction.reference_impl.friction.frozen_mode import event_functions, solve_mode
from stiction.reference_impl.friction.outcomes import SOLVED
from stiction.reference_impl.friction.uniqueness import COUNTED
from stiction.reference_impl.friction.unlike_masses import solve_with_motion
from stiction.reference_impl.multibody.dynamics import acceleration, largest_force, row_acceleration, row_form
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

HELD = 1e-9
"""Acceleration of a guide at rest, relative to what the largest force would give it, from which on it is not held: what
rounding leaves of redundant rows is a thousandth of that."""


@kernel
def right_hand_side(m: Arrays, w: Workspace, t: float, y: Reals, slip: Integers, corner: IntegerTable,
                    dy: Reals) -> None:
    """y' of the frozen mode into dy, and the event functions into w.event."""
    n = len(m.inverse_mass)
    row_form(m, w, t, y[:n], y[n:])
    regular = solve_mode(m, w, slip, corner)
    for i in range(n):
        dy[i] = y[n + i]
    if not (m.unlike and regular and solve_with_motion(m, w, slip, corner, dy[n:])):
        acceleration(m, w, w.force, dy[n:])
    w.counters.rhs += 1
    event_functions(m, w, slip, corner)
    if not regular and len(m.friction) and not _hyperstatic_stick(m, w, slip):
        for i in range(len(dy)):
            dy[i] = np.nan


@kernel(allocates=True)
def _hyperstatic_stick(m: Arrays, w: Workspace, slip: Integers) -> bool:
    """Friction and event functions of stuck guides that share their friction indeterminately.

    The shortest forces, those of the mode, where they are within the capacities, else those of the HLCP, whose share is
    admissible. No forces hold a guide that a drive begins to move, as a slider's whose crank starts from its dead
    centre: its event function is minus its acceleration. Event functions: of the shortest forces the margins; of others
    minus the acceleration that the HLCP gives a guide, else 1. They jump where the share changes, so that what
    `event_location` guarantees does not hold for such guides. Returns False where the HLCP has no solution, or none is
    found by Lemke's method or among `COUNTED` contact modes: this is called at every stage of every step.
    """
    admissible, held = True, True
    for f in range(len(m.friction)):
        if slip[f] == 0:
            R, T, friction = w.force[m.friction[f].row], w.force[m.friction[f].row + 1], w.force[m.rows + f]
            w.event[3 * f] = capacity(m, f, R, T, 1.0) + friction
            w.event[3 * f + 1] = capacity(m, f, R, T, -1.0) - friction
            admissible = admissible and w.event[3 * f] >= 0.0 and w.event[3 * f + 1] >= 0.0
            t = m.rows + f
            acceleration = row_acceleration(w, t, w.force)
            rounding = HELD * max(abs(w.right[t]), largest_force(m, w, w.force) * sqrt(w.G[t, t]))
            if not abs(acceleration) <= rounding:
                w.event[3 * f + (0 if acceleration > 0.0 else 1)] = -abs(acceleration)
                held = False
    if admissible or not held:
        return True
    w.counters.hlcp += 1
    force, y, x, outcome, rest = hlcp.solve(m, w, slip, COUNTED)
    accelerate, signs, fastest = np.zeros(len(m.friction)), np.zeros((len(m.friction), 2), dtype=np.int64), 0.0
    if outcome == SOLVED:
        hlcp.read(m, w, slip, force, y, x, accelerate, signs)
        for f in range(len(m.friction)):
            fastest = max(fastest, abs(accelerate[f]))
        if fastest <= rest:
            copy(force, w.force)
    for f in range(len(m.friction)):
        if slip[f] == 0:
            w.event[3 * f], w.event[3 * f + 1] = 1.0, 1.0
            if accelerate[f] > rest:
                w.event[3 * f] = -accelerate[f]
            elif accelerate[f] < -rest:
                w.event[3 * f + 1] = accelerate[f]
    return outcome == SOLVED
