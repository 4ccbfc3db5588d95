"""Which contact mode follows: the HLCP's answer, made definite, compiled.

The HLCP is solved with the static coefficient for every guide at rest (the set H). A guide whose solution has an
acceleration leaves H in that direction; with mus > mu its friction drops to the kinetic one, which may set others free,
so that the problem is solved again until no guide leaves.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from reference_impl import hlcp
from reference_impl.dynamics import row_form
from reference_impl.lemke import SOLVED

REST = 1e-12
"""Acceleration of a stuck slider, relative to the largest free or joint acceleration of the instant, below which a
solution of the HLCP counts as rest. Lemke's zeros are exact except in degenerate bases, where they are rounding."""


@njit(cache=True)
def choose_mode(m, w, t, q, v, slip, corner, rest_speed, counters):
    """Decide stick or slip and the corners' signs at (t, q, v), in place.

    Parameters
    ----------
    slip : ndarray of int, shape (frictional,)
        On entry the directions of guides that slip (kept where the speed exceeds `rest_speed`, or where
        the guide's entry of `corner` column 2 says it has just broken away); 0 for guides at rest.
    corner : ndarray of int, shape (frictional, 2)
    rest_speed : ndarray, shape (frictional,)
        Slip speed (m/s) up to which a guide is at rest; negative for a guide that has just broken away.
    counters : ndarray of int
        Entries HLCP, PIVOTS are increased.

    Returns
    -------
    outcome : int
        Of `lemke` or `hlcp`.
    """
    nf = m.frictional
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
        force, y, x, outcome, pivots = hlcp.solve(m, w, slip, stuck)
        counters[HLCP] += 1
        counters[PIVOTS] += pivots
        if outcome != SOLVED:
            return outcome
        hlcp.read(m, stuck, y, x, accelerate, corner)
        floor = REST * acceleration_scale(m, w, force)
        left = False
        for f in range(nf):
            if stuck[f] and abs(accelerate[f]) > floor:
                slip[f] = 1 if accelerate[f] > 0.0 else -1
                stuck[f] = False
                left = True
        if not left:
            return SOLVED
    return SOLVED


STEPS, REJECTED, RHS, HLCP, PIVOTS, EVENTS, PROJECTIONS = range(7)
"""Places in the array of counters."""
COUNTER_NAMES = ("steps", "rejected", "rhs", "hlcp", "pivots", "events", "projections")


@njit(cache=True)
def acceleration_scale(m, w, force):
    """Largest tangential acceleration that a single row force or the free motion causes (m/s^2)."""
    scale = 0.0
    for f in range(m.frictional):
        t = m.rows + f
        scale = max(scale, abs(w.right[t]))
        for r in range(m.rows + m.frictional):
            scale = max(scale, abs(w.G[t, r] * force[r]))
    return scale
