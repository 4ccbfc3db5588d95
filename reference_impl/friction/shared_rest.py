"""Guides at rest that share the load of one freedom: whether any share obeys Coulomb's law, and which one is taken.

Where more guides rest than there are freedoms, frictions and reactions are determined up to null vectors N of the
equations of the mode, force = p + N tau. Null vectors without friction, those of redundant joints, are left aside: of
them the shortest forces are taken (`linear_algebra.minimum_norm`). What a guide has left against a slip in direction
d,

    M_d(tau) = static + mus max(|R|, (2/a) |T + (b/2) mus d R|) + d f,

is the largest of four linear functions of tau (of two without a length). A share of the load exists where the smallest
of these margins over all guides and both directions can be made positive:

    F = max over tau of min over guides and d of M_d(tau) >= 0 .

F is continuous in time, and rest ends where it passes zero, not where some preferred share leaves the cones. The
maximum of such a piecewise linear function of k variables is where k + 1 of the linear functions are equal: all of
those points are tried, which is cheap for the one or two variables that mechanisms have. It is looked for up to the
size of the margins only, so that it is finite where guides can wedge each other.

Rigid bodies do not tell which share acts. Taken are the frictions of the smallest sum of squares, in N, that the law
admits: equal guides share equally, whatever the masses between them, and none is stressed against another without
need. The share is continuous while the admissible ones are a convex set, as where no load changes its sign.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, IntegerTable, Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import (
    RANK_TOLERANCE,
    add_shortest,
    decompose,
    solve_in_place,
)
from stiction.reference_impl.compiled.loops import copy, product, taken, taken_rows
from stiction.reference_impl.friction.coulomb import sticks
from stiction.reference_impl.friction.frozen_mode import fill_mode, friction_of
from stiction.reference_impl.multibody.banded_systems import (
    cell_of,
    count_cells,
    forces_into_cell,
    forces_of_cell,
)
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

SHARES = 1e-6
"""Part of a null vector of unit size (forces measured by their mobility) in frictions, from which on guides share a
load by it. Rounding leaves 1e-12."""
MOST_POINTS = 20_000
"""Points at which k + 1 linear functions are equal that are tried at most: three guides that share two variables have
2300, four that share three 40 920."""
LINES = 4
"""Linear functions of which a margin is the largest."""
ROUNDING = 1e-12
"""Negative margin, relative to the largest, that counts as zero: of a share on the border of the cones."""


@kernel(allocates=True)
def share_rest(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable) -> bool:
    """Put an admissible share of the load into w.force, and its margins into the event functions of the guides.

    `w.force` has one solution of the mode, of slip directions `slip` and corner signs `corner`. Of guides that share
    their load all event functions become F, N: rest is possible while it is positive. Returns False where there are
    more than `MOST_POINTS` points to try; nothing is changed then.

    The margins of the safest share themselves are no event functions: where several shares are the safest, all but the
    smallest of them jump from instant to instant. `margins_of_safest` has them where rest ends.
    """
    for c in range(count_cells(m)):
        shared, guides, margins = _share_of_cell(m, w, c, slip, corner)
        if not shared:
            return False
        least = np.inf
        for i in range(len(guides)):
            for side in range(2):
                if not np.isnan(margins[i, side]):
                    least = min(least, margins[i, side])
        for i in range(len(guides)):
            for side in range(2):
                if not np.isnan(margins[i, side]):
                    w.event[3 * guides[i] + side] = least
    return True


@kernel(allocates=True)
def margins_of_safest(
    m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable, result: Table
) -> None:
    """Fill `result` (guides, 2) with the margins against slip along + and -, of the safest share of guides.

    They are nan for guides that share no load. `w.force` has one solution of the mode. The smallest tells which
    guide leaves, and where to, when rest ends.
    """
    kept = w.force.copy()
    for f in range(len(result)):
        result[f, 0] = np.nan
        result[f, 1] = np.nan
    for c in range(count_cells(m)):
        _, guides, margins = _share_of_cell(m, w, c, slip, corner)
        for i in range(len(guides)):
            copy(margins[i], result[guides[i]])
    copy(kept, w.force)


@kernel(allocates=True)
def _share_of_cell(
    m: Arrays, w: Workspace, c: int, slip: Integers, corner: IntegerTable
) -> tuple[bool, Integers, Table]:
    """Share the load in a cell: whether there were few enough points to try, its guides, and their margins.

    The forces of the cell are those of the share then. The margins, (guides, 2), are nan for guides that share no load.
    """
    own_m, own_w, guides = cell_of(m, w, c)
    forces_into_cell(m, w, own_m, own_w)
    margins = np.full((len(guides), 2), np.nan)
    shared = _share(own_m, own_w, taken(slip, guides), taken_rows(corner, guides), margins)
    forces_of_cell(m, w, own_m, own_w)
    return shared, guides, margins


@kernel(allocates=True)
def _share(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable, margins: Table) -> bool:
    """Variant of `share_rest` for one cell; `margins` (guides, 2) of those that share, against slip along + and -."""
    null = _null_vectors_with_friction(m, w, slip, corner)
    k = null.shape[1]
    if k == 0:
        return True

    # the guides that share
    count = 0
    for f in range(len(m.friction)):
        count += 1 if _is_moved(m, slip, f, null) else 0
    members = np.zeros(count, dtype=np.int64)
    count = 0
    for f in range(len(m.friction)):
        if _is_moved(m, slip, f, null):
            members[count] = f
            count += 1

    # Margins as linear functions of tau, `value` + `slope` tau: guide i of the members has the functions from 8 i on,
    # four for each direction. Frictions likewise, for their sum of squares |slope_of_friction tau - friction|^2.
    value, slope = np.zeros(2 * LINES * count), np.zeros((2 * LINES * count, k))
    friction, slope_of_friction = np.zeros(count), np.zeros((count, k))
    for i in range(count):
        _margins_of_guide(m, w, members[i], null, LINES * 2 * i, value, slope)
        friction[i] = -w.force[m.rows + members[i]]
        for j in range(k):
            slope_of_friction[i, j] = null[m.rows + members[i], j]
    if _points(len(value) + 1, k + 1) > MOST_POINTS:
        return False

    # the frictions of the smallest sum of squares, if they are admissible; else the smallest ones that are
    shortest = np.zeros(k)
    add_shortest(slope_of_friction, friction, shortest)
    largest = 0.0
    for line in range(len(value)):
        largest = max(largest, abs(value[line] + product(slope[line], shortest)))
    safest, best = _safest(value, slope, shortest, largest)
    share = shortest
    if _least_margin(value, slope, shortest) < 0.0:
        share = safest
        if best > 0.0:
            share = _shortest_admissible(value, slope, friction, slope_of_friction, safest, largest)

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
def _null_vectors_with_friction(
    m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable
) -> Table:
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

    # null vectors of the symmetric matrix: right singular vectors of the singular values that are zero
    _, size, right = decompose(scaled)
    first = n
    while first > 0 and size[first - 1] <= RANK_TOLERANCE * size[0]:
        first -= 1

    # Of all null vectors those that are orthogonal to the ones without friction: a second decomposition, of their parts
    # in frictions, has the mixtures of them in the order of these parts.
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
        own = abs(null[m.rows + f, j])
        if m.friction[f].corners > 0:
            own = max(own, abs(null[normal, j]))
        if m.friction[f].length > 0.0:
            own = max(own, abs(null[normal + 1, j]) / m.friction[f].length)
        if own > SHARES * largest:
            return True
    return False


@kernel
def _margins_of_guide(m, w, f, null, first, value, slope):
    """Fill the linear functions of the two margins of a guide, from place `first` on.

    They are those whose largest is M_d of the module's docstring: static + mus (+-R) + d f and
    static + mus (2/a) (+-(T + (b/2) mus d R)) + d f.
    """
    guide, normal, t = m.friction[f], m.friction[f].row, m.rows + f
    for side in range(2):
        d = 1.0 - 2.0 * side
        for line in range(LINES):
            # coefficients of R and T; a guide without length has the first pair twice
            sign = guide.mus * (1.0 if line % 2 == 0 else -1.0)
            of_R, of_T = sign, 0.0
            if line >= 2 and guide.length > 0.0:
                of_T = sign * 2.0 / guide.length
                of_R = of_T * 0.5 * guide.width * guide.mus * d
            place = first + LINES * side + line
            value[place] = of_R * w.force[normal] + of_T * w.force[normal + 1] + d * w.force[t]
            value[place] += guide.static_bound
            for j in range(null.shape[1]):
                slope[place, j] = (
                    of_R * null[normal, j] + of_T * null[normal + 1, j] + d * null[t, j]
                )


@kernel
def _largest_line(value, slope, margin, tau):
    """Return a margin: the largest of its linear functions at tau."""
    largest = -np.inf
    for line in range(LINES * margin, LINES * (margin + 1)):
        largest = max(largest, value[line] + product(slope[line], tau))
    return largest


@kernel
def _least_margin(value, slope, tau):
    """Return the smallest margin at tau."""
    least = np.inf
    for margin in range(len(value) // LINES):
        least = min(least, _largest_line(value, slope, margin, tau))
    return least


@kernel
def _points(lines, size):
    """Return the number of ways to choose `size` of so many lines; a float, as it may be very large."""
    ways = 1.0
    for i in range(size):
        ways *= (lines - i) / (i + 1.0)
    return ways


@kernel(allocates=True)
def _safest(value: Reals, slope: Table, start: Reals, most: float) -> tuple[Reals, float]:
    """Return the tau at which the least margin is largest, and that margin, N, up to `most`.

    Where margins grow along a direction without end, as of guides that wedge each other, there is a corner at `most`.
    """
    k, lines = slope.shape[1], len(value)
    best_tau, best = start.copy(), min(most, _least_margin(value, slope, start))
    A, x = np.zeros((k + 1, k + 1)), np.zeros(k + 1)
    unit, tau = np.zeros(2 * (k + 1)), np.zeros(k)
    chosen = np.arange(k + 1)
    while best < most:
        # The point (tau, F) at which k + 1 of the functions have one and the same value F: slope tau - F = -value.
        # Function number `lines` is the constant `most`.
        for i in range(k + 1):
            is_line = chosen[i] < lines
            for j in range(k):
                A[i, j] = slope[chosen[i], j] if is_line else 0.0
            A[i, k] = -1.0
            x[i] = -value[chosen[i]] if is_line else -most
        if solve_in_place(A, x, unit, k + 1, k + 1):
            for j in range(k):
                tau[j] = x[j]
            least = min(most, _least_margin(value, slope, tau))
            if least > best:
                best = least
                for j in range(k):
                    best_tau[j] = tau[j]
        if not _choose_next(chosen, lines + 1):
            break
    return best_tau, best


@kernel
def _choose_next(chosen, count):
    """The next choice of so many of `count` numbers, in place, in the order of numbers; False behind the last."""
    size = len(chosen)
    place = size - 1
    while place >= 0 and chosen[place] == count - size + place:
        place -= 1
    if place < 0:
        return False
    chosen[place] += 1
    for i in range(place + 1, size):
        chosen[i] = chosen[i - 1] + 1
    return True


@kernel(allocates=True)
def _shortest_admissible(
    value: Reals,
    slope: Table,
    friction: Reals,
    slope_of_friction: Table,
    safe: Reals,
    largest: float,
) -> Reals:
    """The tau of the smallest sum of squared frictions at which no margin is negative; `safe` is one of them.

    It is not the smallest of all, so that it is on the border: where from one to k of the linear functions are zero. Of
    each such choice the smallest sum of squares follows from the linear system of Lagrange's multipliers.
    """
    k, lines = slope.shape[1], len(value)
    best_tau, best = safe.copy(), np.inf
    tau = safe.copy()
    for zeros in range(k + 1):
        n = k + zeros
        A, x, unit = np.zeros((n, n)), np.zeros(n), np.zeros(2 * n)
        chosen = np.arange(max(zeros, 1))
        while True:
            solved = zeros == 0  # the safe one itself comes first
            if zeros > 0:
                # The smallest |S tau - friction|^2, S the slopes of friction, with the chosen functions zero: of tau
                # and the multipliers mu, S^T S tau + slope^T mu = S^T friction and slope tau = -value.
                for i in range(n):
                    x[i] = 0.0
                    for j in range(n):
                        A[i, j] = 0.0
                for i in range(k):
                    for g in range(len(friction)):
                        x[i] += slope_of_friction[g, i] * friction[g]
                        for j in range(k):
                            A[i, j] += slope_of_friction[g, i] * slope_of_friction[g, j]
                for i in range(zeros):
                    x[k + i] = -value[chosen[i]]
                    for j in range(k):
                        A[j, k + i] = slope[chosen[i], j]
                        A[k + i, j] = slope[chosen[i], j]
                solved = solve_in_place(A, x, unit, n, n)
                for j in range(k):
                    tau[j] = x[j]
            # it counts if all other margins are positive as well
            if solved and _least_margin(value, slope, tau) >= -ROUNDING * largest:
                square = 0.0
                for g in range(len(friction)):
                    square += (product(slope_of_friction[g], tau) - friction[g]) ** 2
                if square < best:
                    best = square
                    for j in range(k):
                        best_tau[j] = tau[j]
            if zeros == 0 or not _choose_next(chosen, lines):
                break
    return best_tau
