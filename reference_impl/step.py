"""A step of DOP853 in a frozen contact mode, compiled."""

from __future__ import annotations

from reference_impl.bundle import IntegerTable, Integers, Reals, Table
from reference_impl.compiling import kernel
from reference_impl.dop853 import A, BY_TIME, C, STAGES, combine
from reference_impl.kinematics import Workspace
from reference_impl.mechanism import Arrays
from reference_impl.right_hand_side import right_hand_side

TIME, STEP, SPEED, FORCE, CHECKED, GAIN = range(6)
"""Places in `event_driven.State.scalar`."""
NOISE = 1e-13
"""Event functions above minus this, relative to the largest speed or force so far, count as not negative: an event
function starts at zero after its own event and must not fire on rounding. It does not enter the location of events."""


@kernel
def noise(slip, e, scalar):
    """Rounding of event function e; scalar as in `event_driven.State`."""
    is_speed = e % 3 == 0 and slip[e // 3] != 0
    return NOISE * (scalar[SPEED] if is_speed else scalar[FORCE])


@kernel
def copy(source, target):
    for i in range(len(source)):
        target[i] = source[i]


@kernel
def take_step(m: Arrays, w: Workspace, t: float, h: float, y: Reals, slip: Integers, corner: IntegerTable, K: Table, y_new: Reals,
              stage: Reals, counters: Integers, seen: Table) -> None:
    """The 12 stages from K[0] = y'(t), y_new, and K[12] = y'(t + h); `seen`: the event functions of each, in the order of times.

    The right-hand side is put in place here: passing it all arrays costs a quarter of it.
    """
    for s in range(1, STAGES + 1):
        combine(K, A[s], s, h, y, stage)
        right_hand_side(m, w, t + C[s] * h, stage, slip, corner, K[s], counters)
        for e in range(len(w.event)):
            seen[BY_TIME[s], e] = w.event[e]
    for i in range(len(y)):
        y_new[i] = stage[i]
