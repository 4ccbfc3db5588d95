"""Which contact mode follows: the HLCP's answer, made definite, compiled.

The HLCP is solved with the static coefficient for every guide at rest (the set H). A guide whose solution has an
acceleration leaves H in that direction; with mus > mu its friction drops to the kinetic one, which may set others free,
so that the problem is solved again until no guide leaves.
"""

from __future__ import annotations

import numpy as np
from reference_impl.compiling import kernel

from reference_impl import hlcp
from reference_impl.dynamics import row_form
from reference_impl.lemke import SOLVED

STEPS, REJECTED, RHS, HLCP, PIVOTS, EVENTS, PROJECTIONS = range(7)
"""Places in the array of counters."""
COUNTER_NAMES = ("steps", "rejected", "rhs", "hlcp", "pivots", "events", "projections")


@kernel(allocates=True)
def choose_mode(m, w, t, q, v, slip, corner, rest_speed, counters):
    """Decide stick or slip and the corners' signs at (t, q, v), in place.

    Parameters
    ----------
    slip : ndarray of int, shape (frictional,)
        Receives the directions; read for a guide that has just broken away.
    corner : ndarray of int, shape (frictional, 2)
        Receives the corners' signs.
    rest_speed : ndarray, shape (frictional,)
        Slip speed (m/s) up to which a guide is at rest; negative: it has just broken away, in the direction `slip`.
    counters : ndarray of int
        Entries HLCP, PIVOTS are increased.

    Returns
    -------
    outcome : int
        Of `lemke` or `hlcp`.
    """
    nf = len(m.friction)
    row_form(m, w, t, q, v)
    stuck = np.zeros(nf, dtype=np.bool_)
    for f in range(nf):
        stuck[f] = rest_speed[f] >= 0.0 and abs(w.slip[f]) <= rest_speed[f]
        if stuck[f]:
            slip[f] = 0
        elif rest_speed[f] >= 0.0:
            slip[f] = 1 if w.slip[f] > 0.0 else -1
    accelerate = np.zeros(nf)
    for _ in range(nf + 1):
        _, y, x, outcome, pivots, rest = hlcp.solve(m, w, slip, stuck)
        counters[HLCP] += 1
        counters[PIVOTS] += pivots
        if outcome != SOLVED:
            return outcome
        hlcp.read(m, stuck, y, x, accelerate, corner)
        left = False
        for f in range(nf):
            if stuck[f] and abs(accelerate[f]) > rest:
                slip[f] = 1 if accelerate[f] > 0.0 else -1
                stuck[f] = False
                left = True
        if not left:
            return SOLVED
    return SOLVED
