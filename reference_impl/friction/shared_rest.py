"""Guides at rest that share the load of one freedom: whether any share obeys Coulomb's law, and which one is taken.

Where more guides rest than there are freedoms, frictions and reactions are determined up to null vectors N of the
equations of the mode, force = p + N tau. Null vectors without friction, those of redundant joints, are left aside: of
them the shortest forces are taken (`linear_algebra.minimum_norm`). What a guide has left against a slip in direction
d,

    M_d(tau) = mus max(|R|, (2/a) |T + (b/2) mus d R|) + d f,

is the largest of four linear functions of tau (of two without a length). A share of the load exists where the smallest
of these margins over all guides and both directions can be made positive:

    F = max over tau of min over guides and d of M_d(tau) >= 0 .

F is continuous in time, and rest ends where it passes zero, not where some preferred share leaves the cones. The
maximum of such a piecewise linear function of k variables is where k + 1 of the linear functions are equal: all of
those points are tried, which is cheap for the one or two variables that mechanisms have.

Rigid bodies do not tell which share acts. Taken are the frictions of the smallest sum of squares, in N, that the law
admits: equal guides share equally, whatever the masses between them; none is stressed against another without need;
and the share is continuous up to the instant at which the last one is lost.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, IntegerTable, Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import RANK_TOLERANCE, add_shortest, decompose, solve_in_place
from stiction.reference_impl.compiled.loops import product, taken
from stiction.reference_impl.friction.coulomb import sticks
from stiction.reference_impl.friction.frozen_mode import fill_mode, friction_of
from stiction.reference_impl.multibody.banded_systems import cell_of, count_cells
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

SHARES = 1e-6
"""Part of a null vector of unit size (forces measured by their mobility) in frictions, from which on guides share a
load by it. Rounding leaves 1e-12."""
MOST_POINTS = 20_000
"""Points at which k + 1 linear functions are equal that are tried at most: three guides that share two variables have
2024, four that share three 35 960."""
LINES = 4
"""Linear functions of which a margin is the largest."""
HALVINGS = 60
FARTHEST = 1e12
"""Multiple of the forces up to which a share is looked for along a direction in which all margins grow."""


@kernel(allocates=True)
def share_rest(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable) -> bool:
    """Put an admissible share of the load into w.force, and its margins into the event functions of the guides.

    `w.force` has one solution of the mode, of slip directions `slip` and corner signs `corner`. Of guides that share
    their load the event functions become the margins of the safest share, N: rest is possible while all of them are
    positive. Returns False where there are more than `MOST_POINTS` points to try; nothing is changed then.
    """
    for c in range(count_cells(m)):
        own_m, own_w, guides = cell_of(m, w, c)
        own_slip, own_corner = taken(slip, guides), np.zeros((len(guides), corner.shape[1]), dtype=np.int64)
        for i in range(len(guides)):
            for k in range(corner.shape[1]):
                own_corner[i, k] = corner[guides[i], k]
        for r in range(len(own_m.origin)):
            own_w.force[r] = w.force[own_m.origin[r]]
        margins = np.full((len(guides), 2), np.nan)
        if not _share(own_m, own_w, own_slip, own_corner, margins):
            return False
        for r in range(len(own_m.origin)):
            w.force[own_m.origin[r]] = own_w.force[r]
        for i in range(len(guides)):
            for side in range(2):
                if not np.isnan(margins[i, side]):
                    w.event[3 * guides[i] + side] = margins[i, side]
    return True


@kernel(allocates=True)
def _share(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable, margins: Table) -> bool:
    """Variant of `share_rest` for one cell; `margins` (guides, 2) of those that share, against slip along + and -."""
    null = _null_vectors_with_friction(m, w, slip, corner)
    k = null.shape[1]
    if k == 0:
        return True

    # margins as linear functions of tau: value at tau = 0, gradient, and the pair of guide and direction they belong to
    count = 0
    for f in range(len(m.friction)):
        count += 1 if _is_moved(m, slip, f, null) else 0
    members = np.zeros(count, dtype=np.int64)
    count = 0
    for f in range(len(m.friction)):
        if _is_moved(m, slip, f, null):
            members[count] = f
            count += 1
    value, slope = np.zeros(2 * LINES * count), np.zeros((2 * LINES * count, k))
    friction, slope_of_friction = np.zeros(count), np.zeros((count, k))
    for i in range(count):
        _margins_of_guide(m, w, members[i], null, LINES * 2 * i, value, slope)
        friction[i] = -w.force[m.rows + members[i]]
        for j in range(k):
            slope_of_friction[i, j] = null[m.rows + members[i], j]
    if _points(len(value), k + 1) > MOST_POINTS:
        return False

    # the frictions of the smallest sum of squares, if they are admissible; else as near to them as the law admits
    shortest = np.zeros(k)
    add_shortest(slope_of_friction, friction, shortest)
    safest, best = _safest(value, slope, shortest)
    share = shortest.copy()
    if _least_margin(value, slope, shortest) < 0.0:
        part = 0.0 if best < 0.0 else _part_admissible(value, slope, safest, shortest)
        for j in range(k):
            share[j] = safest[j] + part * (shortest[j] - safest[j])

    for i in range(count):
        for side in range(2):
            margins[members[i], side] = _largest_line(value, slope, 2 * i + side, safest)
    for r in range(len(w.force)):
        w.force[r] += product(null[r], share)
    for f in range(len(m.friction)):
        if slip[f] != 0:
            w.force[m.rows + f] = friction_of(m, f, slip, corner, w.force)
    return True


@kernel(allocates=True)
def _null_vectors_with_friction(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable) -> Table:
    """Null vectors of the mode that contain frictions of guides at rest, as columns (rows + frictional, k)."""
    n = fill_mode(m, w, slip, corner)
    unit, scaled, finite = np.zeros(n), np.zeros((n, n)), True
    for i in range(n):
        unit[i] = np.sqrt(w.G[w.held[i], w.held[i]])
        if not unit[i] > 0.0:
            unit[i] = 1.0
    for i in range(n):
        for j in range(n):
            scaled[i, j] = w.A[i, j] / (unit[i] * unit[j])
            finite = finite and np.isfinite(scaled[i, j])
    if not finite:
        return np.zeros((len(w.force), 0))  # the state is none: the step is going to be rejected
    _, size, right = decompose(scaled)
    first = n
    while first > 0 and size[first - 1] <= RANK_TOLERANCE * size[0]:
        first -= 1

    # of all null vectors those that are orthogonal to the ones without friction
    frictions = np.zeros((n, n - first))
    for i in range(n):
        for j in range(n - first):
            if w.held[i] >= m.rows:
                frictions[i, j] = right[i, first + j]
    if n == first:
        return np.zeros((len(w.force), 0))
    _, part, mixture = decompose(frictions)
    k = 0
    while k < len(part) and part[k] > SHARES:
        k += 1
    null = np.zeros((len(w.force), k))
    for i in range(n):
        for j in range(k):
            for l in range(n - first):
                null[w.held[i], j] += right[i, first + l] * mixture[l, j] / unit[i]
    return null


@kernel
def _is_moved(m, slip, f, null):
    """Return True for a guide at rest that a null vector changes, in its friction or its load."""
    if not sticks(m, slip, f):
        return False
    normal = m.friction[f].row
    for j in range(null.shape[1]):
        largest = 0.0
        for r in range(len(null)):
            largest = max(largest, abs(null[r, j]))
        own = max(abs(null[m.rows + f, j]), abs(null[normal, j]))
        if m.friction[f].length > 0.0:
            own = max(own, abs(null[normal + 1, j]) / m.friction[f].length)
        if own > SHARES * largest:
            return True
    return False


@kernel
def _margins_of_guide(m, w, f, null, first, value, slope):
    """Fill the linear functions of the two margins of a guide, from place `first` on."""
    guide, normal, t = m.friction[f], m.friction[f].row, m.rows + f
    for side in range(2):
        d = 1.0 - 2.0 * side
        for line in range(LINES):
            sign = guide.mus * (1.0 if line % 2 == 0 else -1.0)
            of_R, of_T = sign, 0.0
            if line >= 2 and guide.length > 0.0:
                of_T = sign * 2.0 / guide.length
                of_R = of_T * 0.5 * guide.width * guide.mus * d
            place = first + LINES * side + line
            value[place] = of_R * w.force[normal] + of_T * w.force[normal + 1] + d * w.force[t]
            for j in range(null.shape[1]):
                slope[place, j] = of_R * null[normal, j] + of_T * null[normal + 1, j] + d * null[t, j]


@kernel
def _largest_line(value, slope, margin, tau):
    """A margin: the largest of its linear functions at tau."""
    largest = -np.inf
    for line in range(LINES * margin, LINES * (margin + 1)):
        largest = max(largest, value[line] + product(slope[line], tau))
    return largest


@kernel
def _least_margin(value, slope, tau):
    """The smallest margin at tau."""
    least = np.inf
    for margin in range(len(value) // LINES):
        least = min(least, _largest_line(value, slope, margin, tau))
    return least


@kernel
def _points(lines, size):
    """Number of ways to choose `size` of so many lines."""
    ways = 1.0
    for i in range(size):
        ways *= (lines - i) / (i + 1.0)
    return ways


@kernel(allocates=True)
def _safest(value: Reals, slope: Table, start: Reals) -> tuple[Reals, float]:
    """The tau of the largest smallest margin, and that margin.

    Where all margins grow along a direction, guides jam by their own stress, and there is no largest one: the smallest
    of such a stress, from `start` on, that makes the margins positive.
    """
    k, lines = slope.shape[1], len(value)
    best_tau, best = start.copy(), _least_margin(value, slope, start)
    if k == 1:
        for direction in (1.0, -1.0):
            growth = np.inf
            for margin in range(lines // LINES):
                steepest = -np.inf
                for line in range(LINES * margin, LINES * (margin + 1)):
                    steepest = max(steepest, direction * slope[line, 0])
                growth = min(growth, steepest)
            if growth > 0.0:
                return _far_enough(value, slope, start, direction)
    A, x, unit, tau = np.zeros((k + 1, k + 1)), np.zeros(k + 1), np.zeros(2 * (k + 1)), np.zeros(k)
    chosen = np.arange(k + 1)
    while True:
        for i in range(k + 1):
            for j in range(k):
                A[i, j] = slope[chosen[i], j]
            A[i, k], x[i] = -1.0, -value[chosen[i]]
        if solve_in_place(A, x, unit, k + 1, k + 1):
            for j in range(k):
                tau[j] = x[j]
            least = _least_margin(value, slope, tau)
            if least > best:
                best = least
                for j in range(k):
                    best_tau[j] = tau[j]
        # the next choice of k + 1 lines, in the order of numbers
        place = k
        while place >= 0 and chosen[place] == lines - k - 1 + place:
            place -= 1
        if place < 0:
            return best_tau, best
        chosen[place] += 1
        for i in range(place + 1, k + 1):
            chosen[i] = chosen[i - 1] + 1


@kernel(allocates=True)
def _far_enough(value: Reals, slope: Table, start: Reals, direction: float) -> tuple[Reals, float]:
    """The first tau of one variable along a direction at which all margins are positive, by a part of the largest."""
    tau, size = start.copy(), 0.0
    for line in range(len(value)):
        size = max(size, abs(value[line] + slope[line, 0] * start[0]))
    step = 0.0
    steepest = 1e-300
    for line in range(len(value)):
        steepest = max(steepest, abs(slope[line, 0]))
    while not _least_margin(value, slope, tau) > 0.0 and step < FARTHEST * size / steepest:
        step = 2.0 * step if step > 0.0 else 1e-3 * size / steepest
        tau[0] = start[0] + direction * step
    return tau, _least_margin(value, slope, tau)


@kernel(allocates=True)
def _part_admissible(value: Reals, slope: Table, safe: Reals, wanted: Reals) -> float:
    """Part of the way from an admissible tau to one that is not, up to which margins are not negative."""
    low, high, tau = 0.0, 1.0, safe.copy()
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        for j in range(len(tau)):
            tau[j] = safe[j] + middle * (wanted[j] - safe[j])
        if _least_margin(value, slope, tau) >= 0.0:
            low = middle
        else:
            high = middle
    return low
