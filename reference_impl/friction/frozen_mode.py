"""Forces while the contact mode is frozen, compiled: one linear solve instead of a complementarity problem.

The mode of a frictional guide is its slip direction d (-1, +1; 0 = stick) and the sign s_j of each corner force
n_j = F+_j - F-_j. While it lasts, with R = n1 + n2 the force of the normal row and T the force of the angle row
(normal forces and surface friction together),

    n_j = R/2 -+ N/a,   N = T + (b/2) mu d R     (moment of the normal forces; surface friction turns by -(b/2) mu d R)
    f = -mu d (s1 n1 + s2 n2)
      = -mu d [ (s1 + s2)/2 R + (s2 - s1)/a (T + (b/2) mu d R) ]

is linear in (R, T), so that G force = right closes with f eliminated. A stuck guide keeps its friction as an unknown
and its tangential row as an equation. A guide without length has f = -mu d s R.

Beyond the paper, friction has a constant part too, -d bound, which goes to the right-hand side. A pin, or a guide
without a coefficient of friction, has that part alone: it has no corners, whose signs would be part of its mode.

Names. Kernels take the mechanism m and the workspace w of one instant; f is the number of a frictional guide, and
m.rows + f that of its tangential row.
"""

from __future__ import annotations

from math import hypot

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, IntegerTable
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import (
    CONTRADICTION,
    ELIMINATION,
    RANK_TOLERANCE,
    eliminate,
    minimum_norm,
    solve_in_place,
)
from stiction.reference_impl.friction.coulomb import (
    capacity,
    corner_forces,
    friction_coefficients,
    sticks,
)
from stiction.reference_impl.multibody import baumgarte
from stiction.reference_impl.multibody.banded_systems import fill_cell, friction_row, solve_cell
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace
from stiction.reference_impl.multibody.singular_positions import pivots_are_above, shortest_forces

ALL = -1.0
"""Argument `least` of `choose_branches` that no capacity is below: it looks at all guides at rest."""


@kernel
def solve_mode(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable) -> bool:
    """Row forces of the mode into w.force: reactions of joints, efforts of drives (driving torque), frictions.

    The mode is d in `slip` (0 for stick), s1 and s2 in the first columns of `corner`.
    False if the system was singular and solved in the minimum-norm sense; the forces are nan if it is contradictory.
    """
    if len(m.cell):
        return solve_cells(m, w, slip, slip, corner, False)
    nr, nf = m.rows, len(m.friction)

    # The ordinary case: elimination. Without friction the pivots are judged more strictly, because near a singular
    # position `shortest_forces` finds the same forces from J M^-1/2, with less rounding.
    n = fill_mode(m, w, slip, corner)
    regular = eliminate(w.A, w.x, w.unit, n, n, RANK_TOLERANCE if nf > 0 else ELIMINATION)
    if not regular and nf == 0:
        shortest_forces(m, w)
        return False

    # Redundant constraints, or more guides at rest than there are freedoms: the shortest forces. If it is the guides at
    # rest that make the system singular, Baumgarte's terms would contradict them.
    if not regular:
        if baumgarte.is_used(m) and n > nr and pivots_are_above(m, w, RANK_TOLERANCE):
            for r in range(nr):
                baumgarte.leave_out(w, r)
        fill_mode(m, w, slip, corner)
        if not minimum_norm(w.A, w.x, n) <= CONTRADICTION:
            for i in range(n):
                w.x[i] = np.nan

    # unknowns back to their rows, and the frictions that were eliminated or are zero
    for i in range(n):
        w.force[w.held[i]] = w.x[i]
    for f in range(nf):
        if slip[f] != 0:
            w.force[nr + f] = friction_of(m, f, slip, corner, w.force)
        elif not sticks(m, slip, f):
            w.force[nr + f] = 0.0
    return regular


@kernel
def friction_of(m, f, slip, corner, force):
    """Friction of a guide that slips, from the forces of its rows."""
    c_R, c_T = friction_coefficients(m, f, slip[f], corner[f, 0], corner[f, 1], m.friction[f].mu)
    by_load = c_R * force[m.friction[f].row] + c_T * force[m.friction[f].row + 1]
    return by_load - slip[f] * m.friction[f].bound


@kernel
def solve_cells(
    m: Arrays,
    w: Workspace,
    slip: Integers,
    direction: Integers,
    corner: IntegerTable,
    assumed: bool,
) -> bool:
    """Variant of `solve_mode`, cell by cell, for guides that slip, or begin to with mus where `slip` is 0.

    The cells of a large mechanism (`banded_systems`) are solved one after the other, each as a band. Where the
    `direction` is only `assumed`, as in a search of modes, the first singular cell ends the solution: False.
    """
    frictionless = len(m.friction) == 0
    tolerance = ELIMINATION if frictionless else RANK_TOLERANCE
    all_regular = True
    for c in range(len(m.cell)):
        band, first = m.cell[c].band, m.cell[c].first
        n = _fill_cell(m, w, c, slip, direction, corner, band)
        if not solve_in_place(w.A, w.x, w.unit, n, band, tolerance):
            if frictionless:
                shortest_forces(m, w)
            if frictionless or assumed:
                return False
            all_regular = False
            # Baumgarte's terms are left out as in `solve_mode`, where guides at rest make the cell singular
            rests = False
            for k in range(n):
                f = m.order[first + k] - m.rows
                rests = rests or f >= 0 and sticks(m, slip, f)
            if rests and baumgarte.is_used(m) and solve_cell(m, w, c, w.phi, 0.0, slip, False):
                for k in range(n):
                    if m.order[first + k] < m.rows:
                        baumgarte.leave_out(w, m.order[first + k])
            # the shortest forces, of the full matrix: they are not those of a band
            _fill_cell(m, w, c, slip, direction, corner, n)
            if not minimum_norm(w.A, w.x, n) <= CONTRADICTION:
                for k in range(n):
                    w.x[k] = np.nan
        for k in range(n):
            w.force[m.order[first + k]] = w.x[k]
    return all_regular


@kernel
def _fill_cell(m, w, c, slip, direction, corner, reach):
    """The system of a cell, all of its rows, into w.A, w.x; returns its size."""
    n = fill_cell(m, w, c, reach, w.A)
    for k in range(n):
        r = m.order[m.cell[c].first + k]
        f = r - m.rows
        w.x[k] = w.right[r]
        # the tangential row of a guide that does not stick becomes an equation for its friction
        if f >= 0 and direction[f] != 0:
            mu = m.friction[f].mus if slip[f] == 0 else m.friction[f].mu
            bound = m.friction[f].static_bound if slip[f] == 0 else m.friction[f].bound
            c_R, c_T = friction_coefficients(m, f, direction[f], corner[f, 0], corner[f, 1], mu)
            friction_row(m, w, w.A, f, n, reach, c_R, c_T)
            w.x[k] = 0.0 - direction[f] * bound * w.G[r, r]
        elif f >= 0 and not sticks(m, slip, f):
            friction_row(m, w, w.A, f, n, reach, 0.0, 0.0)
            w.x[k] = 0.0
    return n


@kernel(inline=True)
def held_rows(m, w, slip, released):
    """Numbers of the constraint rows, and of guides at rest unless `released`, into w.held, and their G into w.A.

    Returns how many they are.
    """
    n = 0
    for r in range(m.rows + len(m.friction)):
        if r < m.rows or not released and sticks(m, slip, r - m.rows):
            w.held[n] = r
            n += 1
    for i in range(n):
        for j in range(n):
            w.A[i, j] = w.G[w.held[i], w.held[j]]
    return n


@kernel(inline=True)
def fill_mode(m, w, slip, corner):
    """The system of the mode into w.A, w.x: constraint rows, then the tangential rows of stuck guides; its size."""
    n = held_rows(m, w, slip, False)
    for i in range(n):
        w.x[i] = w.right[w.held[i]]
    # the friction of guides that slip, c_R R + c_T T, enters the columns of R and T; its constant part is known
    for f in range(len(m.friction)):
        if slip[f] != 0:
            t, normal = m.rows + f, m.friction[f].row
            if m.friction[f].bound > 0.0:
                for i in range(n):
                    w.x[i] += w.G[w.held[i], t] * slip[f] * m.friction[f].bound
            if m.friction[f].corners == 0:
                continue
            c_R, c_T = friction_coefficients(
                m, f, slip[f], corner[f, 0], corner[f, 1], m.friction[f].mu
            )
            for i in range(n):
                w.A[i, normal] += w.G[w.held[i], t] * c_R
                w.A[i, normal + 1] += w.G[w.held[i], t] * c_T
    return n


@kernel
def most_capacity(m, w, f):
    """The capacity of a guide at rest in the direction in which it is larger."""
    R, T = w.force[m.friction[f].row], w.force[m.friction[f].row + 1]
    return max(capacity(m, f, R, T, 1.0), capacity(m, f, R, T, -1.0))


@kernel
def _branch(m, f, R, T, d, s1, s2):
    """The static bound and mus (s1 n1 + s2 n2), with the surface friction fully mobilized.

    The capacity where s1, s2 are the signs of n1, n2, less elsewhere.
    """
    guide = m.friction[f]
    n1, n2 = corner_forces(guide, R, T, -guide.mus * d)
    return guide.static_bound + guide.mus * (s1 * n1 + s2 * n2)


@kernel
def choose_branches(m, w, slip, corner, least):
    """Make the signs of guides at rest those of their corner forces at full mobilization; returns whether one changed.

    Columns 0 and 1 of `corner` are for a slip along +, columns 2 and 3 for one along -. A guide whose capacity (N) is
    `least` or less keeps its signs.
    """
    changed = False
    for f in range(len(m.friction)):
        # of a guide without load the signs would be those of rounding
        if not sticks(m, slip, f) or most_capacity(m, w, f) <= least:
            continue
        if m.friction[f].corners == 0:
            continue
        R, T = w.force[m.friction[f].row], w.force[m.friction[f].row + 1]
        for k in range(2):
            direction = 1.0 - 2.0 * k
            n1, n2 = corner_forces(m.friction[f], R, T, -m.friction[f].mus * direction)
            s1 = -1 if n1 < 0.0 else 1
            s2 = -1 if n2 < 0.0 else 1
            changed = changed or corner[f, 2 * k] != s1 or corner[f, 2 * k + 1] != s2
            corner[f, 2 * k] = s1
            corner[f, 2 * k + 1] = s2
    return changed


@kernel
def event_functions(m, w, slip, corner):
    """Fill w.event from w.force and w.slip_speed.

    Three functions per frictional guide, smooth in the motion while the mode lasts.

    Slip: d g_T' (the slider comes to rest where it falls below zero), s1 n1, s2 n2 (a corner changes its surface).
    Stick: a branch of the capacity minus the friction needed, against slip along + and along -, and 1. The capacity is
    the largest of its branches, over the signs s1, s2: while the one that `corner` names is above the friction, the
    guide sticks. Where it falls below, the guide breaks away, or another branch is the largest (`choose_branches`). So
    the kinks of the capacity, where a corner of a slider at rest changes its surface, are in no event function.
    """
    for f in range(len(m.friction)):
        r = m.friction[f].row
        R, T = w.force[r], w.force[r + 1]
        e = 3 * f
        # functions that a guide does not have are 1, and never zero
        if slip[f] == 0 and not sticks(m, slip, f):
            w.event[e], w.event[e + 1], w.event[e + 2] = 1.0, 1.0, 1.0
            continue
        if slip[f] == 0:
            friction = w.force[m.rows + f]
            w.event[e] = _branch(m, f, R, T, 1.0, corner[f, 0], corner[f, 1]) + friction
            w.event[e + 1] = _branch(m, f, R, T, -1.0, corner[f, 2], corner[f, 3]) - friction
            w.event[e + 2] = 1.0
            continue
        w.event[e] = slip[f] * w.slip_speed[f]
        w.event[e + 1], w.event[e + 2] = 1.0, 1.0
        if m.friction[f].corners > 0:
            n1, n2 = corner_forces(m.friction[f], R, T, -m.friction[f].mu * slip[f])
            w.event[e + 1] = corner[f, 0] * n1
            if m.friction[f].length > 0.0:
                w.event[e + 2] = corner[f, 1] * n2


@kernel
def margin(m, w, slip, f):
    """Margin by which a guide obeys Coulomb's law: m/s against its direction, and N; negative where it does not.

    Written in absolute values, so that no assumption about corners or branches enters. Slip: d g_T', and minus the
    difference of |f| and bound + mu (|n1| + |n2|), where the bound of a pin is that by its force, (R, T) = (fx, fy).
    Stick: no speed, and the capacity minus the friction needed, in the
    worse direction.
    """
    r, friction = m.friction[f].row, w.force[m.rows + f]
    R, T = w.force[r], w.force[r + 1]
    if slip[f] == 0:
        return 0.0, min(capacity(m, f, R, T, 1.0) + friction, capacity(m, f, R, T, -1.0) - friction)
    n1, n2 = corner_forces(m.friction[f], R, T, -m.friction[f].mu * slip[f])
    by_load = friction + slip[f] * m.friction[f].mu * (abs(n1) + abs(n2))
    bound = m.friction[f].bound
    if m.friction[f].pin_mus > 0.0:
        bound = m.friction[f].own_bound + m.friction[f].pin_mu * hypot(R, T)
    return slip[f] * w.slip_speed[f], -abs(by_load + slip[f] * bound)
