"""The horizontal linear complementarity problem of eqs. (34)-(38), compiled.

    A0 y = A1 x + b,   y >= 0,  x >= 0,  y^T x = 0
    y = [lCR+, lD+, F-, gH+, lH-],   x = [lCR-, lD-, F+, lH+, gH-]

Every force of the problem acts through rows of the mechanism (`mechanism`): a corner force F+_j through the normal row
(1), the angle row (lever -+ a/2) and, if its surface slips, the tangential row (friction -mu sgn(g_T) F) with the
surface's lever +- b/2 on the angle row. With E the columns of these coefficients, M1 MKG and its fellows are G E.

Beyond the paper: friction has a constant bound beside that by the load (`coulomb`), or instead of it as in a pin,

    slip: lambda_T = mubar FN - sgn(g_T') c ,    rest: lH+- = muH FN + cH +- lambda_H ,    lH+ = 2 (muH FN + cH) - lH-

with c and cH the bounds in slip and at rest of each direction: half of a guide's for each of its two surfaces, so that
the constant part turns no slider, and the whole bound for the single direction of a pin. The constants are forces
e = -sgn(g_T') c - V cH of the tangential rows, and go to the right-hand side: that of (34) and (35) becomes
right - G e, that of (17) 2 cH.

Also beyond the paper: rows of smooth guides and the angle row of a guide without length are bilateral and are split
like lCR; a guide without length has one pair F+ - F- = R.

Places in y and x, the same everywhere: the rows that no corner force replaces (`Arrays.smooth`), the corner forces of
each guide (`friction.pair`), which together are as many as there are rows, then gH+ with lH+ of every surface of the
guides at rest, then lH- with gH- of these. A pin, or a guide without a coefficient, has one "surface" here.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import (
    CONTRADICTION,
    add_shortest,
    eliminate_columns,
)
from stiction.reference_impl.compiled.loops import copy, product
from stiction.reference_impl.friction.coulomb import (
    coefficient,
    constant_bound,
    corner_forces,
    mobilization,
    sticks,
)
from stiction.reference_impl.friction.enumeration import LIMIT, solutions
from stiction.reference_impl.friction.frozen_mode import (
    ALL,
    choose_branches,
    event_functions,
    solve_mode,
)
from stiction.reference_impl.friction.lemke import lemke
from stiction.reference_impl.friction.outcomes import NONE, RAY, SINGULAR, SOLVED
from stiction.reference_impl.friction.shared_rest import share_rest
from stiction.reference_impl.friction.solver_names import LEMKE
from stiction.reference_impl.multibody.dynamics import largest_force, row_acceleration
from stiction.reference_impl.multibody.mechanism import ANGLE, NO_ROW, REVOLUTE, Arrays, Workspace

COMPLIANCE = 1e-10
"""Added to the diagonal of G, relative to each entry, where A0 is singular: redundant constraints then share their
force in the minimum-norm sense, each measured by the square root of its mobility G_rr, so that units do not matter. It
must stand out from the RANK_TOLERANCE of `linear_algebra`; what it changes, and what pivoting loses by it, `_polish`
takes back."""

REST, REST_COMPLIANT = 1e-12, 1e-10
"""Acceleration of a stuck slider, relative to the largest acceleration in the problem, up to which a solution means
rest. Lemke's zeros are exact except in degenerate bases, where they are rounding or, with compliance, what `_polish`
leaves of it. By so much the break-away of guides that share their load is late."""


@kernel(allocates=True)
def assemble(
    m: Arrays, w: Workspace, slip: Integers, compliance: float = 0.0
) -> tuple[Table, Table, Reals, Table, Table, Reals]:
    """A0, A1, b of eq. (36) for the rows in the workspace.

    `slip`: sgn(g_T) of each frictional guide; 0 of those at rest, the set H. `compliance` is added to the diagonal of
    the constraint rows of G, relative to it.

    Returns
    -------
    A0, A1, b : ndarray, shape (n, n), (n, n), (n,)
    E0, E1 : ndarray, shape (rows + frictional, n)
        Row forces per unit of each variable: force = E0 y + E1 x + e.
    e : ndarray, shape (rows + frictional,)
        Constant part of the row forces: that of friction with a bound of its own.
    """
    nr, nf, surfaces = m.rows, len(m.friction), _surfaces(m, slip)
    n = nr + 2 * surfaces
    E0, E1, e = np.zeros((nr + nf, n)), np.zeros((nr + nf, n)), np.zeros(nr + nf)
    A0, A1, b = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    row, y, x = np.zeros(nr + nf), np.zeros(n), np.zeros(n)

    # E0 and E1: which row forces each variable makes. Bilateral rows first, then the corner forces of each guide and,
    # for the two surfaces of a guide at rest, the friction variables at place g with their own equations (16) and (17).
    for c in range(len(m.smooth)):
        E0[m.smooth[c], c], E1[m.smooth[c], c] = 1.0, -1.0  # (27)-(28)
    g = nr
    for f in range(nf):
        corners = m.friction[f].corners
        normal, tangent = m.friction[f].row, nr + f
        half_a, half_b = 0.5 * m.friction[f].length, 0.5 * m.friction[f].width
        # mt = mubar - V muH, (3) and (11): friction per unit of normal force before lH+ is added
        mu = coefficient(m, f, slip)
        mt = -mu if slip[f] == 0 else -mu * slip[f]
        bound = constant_bound(m, f, slip)
        e[tangent] -= bound if slip[f] == 0 else bound * slip[f]
        for k in range(corners):
            column = m.friction[f].pair + k
            lever = (2 * k - 1) * half_a if corners == 2 else 0.0  # (26): S of F+, K = -S of F-
            E0[normal, column], E1[normal, column] = -1.0, 1.0
            E0[tangent, column], E1[tangent, column] = mt, mt
            if corners == 2:
                E0[normal + 1, column], E1[normal + 1, column] = (
                    -lever - half_b * mt,
                    lever + half_b * mt,
                )
            if slip[f] == 0:
                # (17): lH+ + lH- = 2 muH FN, of FN = H F+ + G F-, (4) and (10), the part of this corner
                A1[g + surfaces, column] = 2.0 * mu
                A0[g + surfaces + 1, column] = -2.0 * mu
        for surface in range(m.friction[f].surfaces if slip[f] == 0 else 0):
            E1[tangent, g] = 1.0  # lambda_H = lH+ - muH FN - cH, (6) and (14)
            b[g + surfaces] = 2.0 * bound / m.friction[f].surfaces  # 2 cH of (17)
            if corners == 2:
                E1[normal + 1, g] = half_b if surface == 0 else -half_b
            A0[g, g], A1[g, g + surfaces] = -1.0, -1.0  # gH'' = gH+ - gH-, (5), (13) and (16)
            A0[g + surfaces, g + surfaces], A1[g + surfaces, g] = 1.0, -1.0
            g += 1

    # (34): constraint rows of G (E0 y + E1 x + e) = right, with the compliance on their diagonal
    for r in range(nr):
        _multiply_row(w.G[r], E0, E1, y, x)
        for c in range(n):
            A0[r, c] = y[c] + compliance * w.G[r, r] * E0[r, c]
            A1[r, c] = -(x[c] + compliance * w.G[r, r] * E1[r, c])
        b[r] = w.right[r] - product(w.G[r], e)

    # (35): accelerations of the surfaces of guides at rest, added to the terms of gH'' that stand in these rows
    g = nr
    for f in range(nf):
        half_b, angle = 0.5 * m.friction[f].width, m.friction[f].row + 1
        for surface in range(m.friction[f].surfaces if slip[f] == 0 else 0):
            lever = half_b if surface == 0 else -half_b  # of (8)-(9); the row is (32), (35)
            # W_T of the surface = tangential row +- b/2 angle row, so gH'' of (12) = (that row of G) force - right
            for k in range(nr + nf):
                row[k] = w.G[nr + f, k] + lever * w.G[angle, k]
            _multiply_row(row, E0, E1, y, x)
            for c in range(n):
                A0[g, c] += y[c]
                A1[g, c] -= x[c]
            b[g] = w.right[nr + f] + lever * w.right[angle] - product(row, e)
            g += 1
    return A0, A1, b, E0, E1, e


@kernel
def _multiply_row(row, E0, E1, y, x):
    """Put the row times E0 into y, and times E1 into x."""
    for c in range(len(y)):
        y[c], x[c] = 0.0, 0.0
        for k in range(len(row)):
            y[c] += row[k] * E0[k, c]
            x[c] += row[k] * E1[k, c]


SATURATION_COVER = 10.0
"""Weight of the rows of lH- in Lemke's covering vector, those of all others being 1. The problem has a ray of its own
for every stuck surface: gH+ and gH- of a surface without load can grow together (the column of gH- has a single entry,
1 in the row of gH+), and Lemke's path can end there. Of random problems that have a solution it does with equal weights
in 1 % where mu is at most 0.2 and in 24 % where friction is extreme; with artificial capacity that outlasts the
artificial forces in none of 3000 and in 7 % of 2940."""

TINY = 1e-300
"""Least size of a largest term, so that a residual relative to it is 0, not nan, where all terms are zero."""
ACCURATE = 1e-9
"""Residual relative to the largest term above which a solution by pivoting is not one."""


@kernel(allocates=True)
def solve(  # noqa: C901 - each way a solve ends
    m: Arrays,
    w: Workspace,
    slip: Integers,
    limit: int = LIMIT,
) -> tuple[Reals, Reals, Reals, int, float]:
    """Solve the HLCP by Lemke's method, else by trying all contact modes, if they are not above `limit`.

    The solver ``lemke`` tries none.

    Returns
    -------
    force : ndarray, shape (rows + frictional,)
        Row forces: multipliers and frictions.
    y, x : ndarray, shape (n,)
    outcome : int
        Those of `lemke`; SINGULAR: A0 is, and (36) cannot be made the LCP (37); NONE: no contact mode is consistent.
    rest : float
        Acceleration (m/s^2) up to which a stuck guide of this solution is at rest.
    """
    surfaces = _surfaces(m, slip)
    n = m.rows + 2 * surfaces
    row, unit_y, unit_x = _units(m, w, slip, n)

    # (37): the LCP y = A0^-1 A1 x + A0^-1 b, in scaled variables. A0 is singular where constraints are redundant; then
    # it is made regular by the compliance, which `_polish` takes out of the solution again.
    right, regular = np.zeros((n, n + 1)), False
    for compliance in (0.0, COMPLIANCE):
        A0, A1, b, E0, E1, e = assemble(m, w, slip, compliance)
        _scale(A0, A1, b, row, unit_y, unit_x, right)
        regular = eliminate_columns(A0, right, n, n + 1, n)
        if regular:
            break
    if not regular:
        return np.zeros(len(w.force)), b, b, SINGULAR, 0.0

    # Lemke's method; a solution that does not satisfy the equations, after many pivots, is none
    q, cover = np.zeros(n), np.zeros(n)
    for i in range(n):
        q[i] = right[i, n]
        cover[i] = 1.0 if i < m.rows + surfaces else SATURATION_COVER
    y, x, outcome, pivots = lemke(right, q, cover)
    w.counters.pivots += pivots
    if outcome == SOLVED and not _violation(right, q, y, x) <= ACCURATE:
        outcome = RAY
    if outcome != SOLVED:
        w.counters.lemke_rays += 1

    # a ray does not tell that there is no solution: the first consistent contact mode, if any, is one
    if outcome != SOLVED and w.solver != LEMKE:
        w.counters.enumerations += 1
        forces = np.zeros((1, len(w.force)))
        directions = np.zeros((1, len(m.friction)), dtype=np.int64)
        count = solutions(m, w, slip, forces, directions, compliance, limit)
        if count > 0:
            _variables(m, w, slip, forces[0], directions[0], y, x)
            _rescale(y, x, unit_y, unit_x, -1)
            outcome = SOLVED
        elif count == 0:
            outcome = NONE

    # row forces of the solution, without the compliance, and with the share of guides at rest that does not depend on
    # the order of the constraints
    force = np.zeros(len(w.force))
    if outcome == SOLVED:
        if compliance > 0.0:
            A0, A1, b, _, _, _ = assemble(m, w, slip)
            _scale(A0, A1, b, row, unit_y, unit_x, right)
            for i in range(n):
                q[i] = right[i, n]
            if _polish(A0, right, q, y, x) > CONTRADICTION:
                outcome = SINGULAR
            _share(m, w, slip, y, x, unit_y, unit_x)
        _rescale(y, x, unit_y, unit_x, 1)
        for k in range(len(force)):
            force[k] = e[k]
            for c in range(n):
                force[k] += E0[k, c] * y[c] + E1[k, c] * x[c]

    # acceleration up to which a guide at rest does not move: a part of the largest term of its equation
    scale = 0.0
    for f in range(len(m.friction)):
        t = m.rows + f
        scale = max(scale, abs(w.right[t]))
        for k in range(len(force)):
            scale = max(scale, abs(w.G[t, k] * e[k]))
            for c in range(n):
                of_y, of_x = w.G[t, k] * E0[k, c] * y[c], w.G[t, k] * E1[k, c] * x[c]
                scale = max(scale, abs(of_y), abs(of_x))
    if compliance > 0.0 or outcome != SOLVED:
        return force, y, x, outcome, scale * REST_COMPLIANT
    return force, y, x, outcome, max(scale * REST, _residual_acceleration(m, w, force))


@kernel
def _residual_acceleration(m, w, force):
    """Largest acceleration that row forces leave to points that joints hold, m/s^2.

    Rounding makes it large next to a light body, and the acceleration of no guide is known better than that.
    """
    largest = 0.0
    for c in range(len(m.constraint)):
        kind, first = m.constraint[c].kind, m.constraint[c].row
        if kind == ANGLE or first == NO_ROW:
            continue  # an angle is no point, and a drive with a limit does not hold its points
        for r in range(first, first + (2 if kind == REVOLUTE else 1)):
            largest = max(largest, abs(row_acceleration(w, r, force)))
    return largest


@kernel
def _surfaces(m, slip):
    """Return the number of surfaces of guides at rest."""
    count = 0
    for f in range(len(slip)):
        count += m.friction[f].surfaces if slip[f] == 0 else 0
    return count


@kernel
def _rescale(y: Reals, x: Reals, unit_y: Reals, unit_x: Reals, power: int) -> None:
    """Multiply y and x by their units, or divide (power -1), in place."""
    for i in range(len(y)):
        y[i] = y[i] * unit_y[i] if power > 0 else y[i] / unit_y[i]
        x[i] = x[i] * unit_x[i] if power > 0 else x[i] / unit_x[i]


@kernel(allocates=True)
def _units(m: Arrays, w: Workspace, slip: Integers, n: int) -> tuple[Reals, Reals, Reals]:
    """Return the scales of the equations, of y and of x: each row in units of the square root of its mobility G_rr.

    With them neither the units of length, mass and time nor the masses of the bodies enter the decision which pivots
    are zero.
    """
    row, unit_y, unit_x = np.zeros(n), np.zeros(n), np.zeros(n)

    # constraint rows: accelerations over the root of the mobility, forces of the same unit
    for r in range(m.rows):
        row[r] = 1.0 / np.sqrt(w.G[r, r]) if w.G[r, r] > 0.0 else 1.0
    for c in range(len(m.smooth)):
        unit_y[c] = row[m.smooth[c]]
        unit_x[c] = row[m.smooth[c]]

    # guides: corner forces as their normal row; of the surfaces at rest accelerations as the tangential row, and
    # saturations lH as the normal forces that they are multiples of
    g, surfaces = m.rows, _surfaces(m, slip)
    for f in range(len(m.friction)):
        t = m.rows + f
        force = 1.0 / np.sqrt(w.G[m.friction[f].unit, m.friction[f].unit])
        for c in range(m.friction[f].pair, m.friction[f].pair + m.friction[f].corners):
            unit_y[c] = force
            unit_x[c] = force
        if slip[f] == 0:
            acceleration = np.sqrt(w.G[t, t])
            for _ in range(m.friction[f].surfaces):
                # the equation of gH'', with gH+ in y and lH+ in x
                row[g] = 1.0 / acceleration
                unit_y[g] = acceleration
                unit_x[g] = force
                # the equation of lH+ + lH-, with lH- in y and gH- in x
                row[g + surfaces] = 1.0 / force
                unit_y[g + surfaces] = force
                unit_x[g + surfaces] = acceleration
                g += 1
    return row, unit_y, unit_x


@kernel
def _scale(
    A0: Table, A1: Table, b: Reals, row: Reals, unit_y: Reals, unit_x: Reals, right: Table
) -> None:
    """Scale A0 in place, and A1 beside b into `right`, by the units of `_units`."""
    n = len(b)
    for i in range(n):
        for j in range(n):
            A0[i, j] *= row[i] * unit_y[j]
            right[i, j] = A1[i, j] * row[i] * unit_x[j]
        right[i, n] = b[i] * row[i]


@kernel(allocates=True)
def _polish(A0: Table, A1: Table, b: Reals, y: Reals, x: Reals) -> float:
    """Take the compliance out of a solution, in place: the shortest one of A0 y = A1 x + b in its variables not zero.

    With compliance A0 is so badly conditioned that pivoting loses half of all digits. A variable that becomes zero on
    the way to the shortest solution stays zero (as in Lawson & Hanson's least squares with bounds). Returns the largest
    residual over the largest right-hand side: above CONTRADICTION there is no solution.
    """
    n = len(b)

    # the variables that are not zero, `count` of them: of each pair y_j, x_j one at most
    value, shortest, count = np.zeros(n), np.zeros(n), 0
    in_y, chosen = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.int64)
    for j in range(n):
        value[j] = max(y[j], x[j])
        in_y[j] = y[j] > x[j]
        if value[j] > 0.0:
            chosen[count] = j
            count += 1

    # each turn goes to the shortest solution in these variables, or up to where one of them becomes zero
    while count > 0:
        basis = np.zeros((n, count))
        for k in range(count):
            shortest[k] = 0.0
            for i in range(n):
                basis[i, k] = A0[i, chosen[k]] if in_y[chosen[k]] else -A1[i, chosen[k]]
        add_shortest(basis, b, shortest)
        # the part of the way that leaves all of them positive, and the first to become zero
        part, first = 1.0, -1
        for k in range(count):
            old = value[chosen[k]]
            if shortest[k] < 0.0 and old < part * (old - shortest[k]):
                part = old / (old - shortest[k])
                first = k
        for k in range(count):
            value[chosen[k]] += part * (shortest[k] - value[chosen[k]])
        if first < 0:
            break
        value[chosen[first]] = 0.0
        count -= 1
        for k in range(first, count):
            chosen[k] = chosen[k + 1]
    for j in range(n):
        y[j] = max(value[j], 0.0) if in_y[j] else 0.0
        x[j] = 0.0 if in_y[j] else max(value[j], 0.0)

    # whether that solves the equations without compliance
    largest, worst = 0.0, 0.0
    for i in range(n):
        residual = -b[i]
        for j in range(n):
            residual += A0[i, j] * y[j] - A1[i, j] * x[j]
        largest = max(largest, abs(b[i]))
        worst = max(worst, abs(residual))
    return worst / largest if largest > 0.0 else 0.0


@kernel(allocates=True)
def _share(
    m: Arrays, w: Workspace, slip: Integers, y: Reals, x: Reals, unit_y: Reals, unit_x: Reals
) -> None:
    """Take the share of `shared_rest` where all guides at rest stay there, in place, if it is within the capacities.

    It is the solution of a hyperstatic stick that depends neither on the order of constraints nor on masses. y, x in
    the units of `_units`.
    """
    nf, surfaces = len(m.friction), _surfaces(m, slip)

    # nothing to share where a guide leaves
    largest = 0.0
    for j in range(len(y)):
        largest = max(largest, y[j], x[j])
    for g in range(m.rows, m.rows + surfaces):
        if max(y[g], x[g + surfaces]) > REST_COMPLIANT * largest:
            return

    # the forces of this mode with the share, and their margins, for which the event functions of the workspace are used
    corner, accelerate = np.zeros((nf, 4), dtype=np.int64), np.zeros(nf)
    event = np.zeros(len(w.event))
    copy(w.event, event)
    read(m, w, slip, w.force, y, x, accelerate, corner)
    solve_mode(m, w, slip, corner)
    choose_branches(m, w, slip, corner, ALL)
    event_functions(m, w, slip, corner)
    share_rest(m, w, slip, corner)

    # admissible if finite and, but for rounding, within Coulomb's law
    largest, admissible = largest_force(m, w, w.force), True
    for r in range(len(w.force)):
        admissible = admissible and np.isfinite(w.force[r])
    for f in range(nf):
        unit = m.friction[f].unit
        floor = ACCURATE * largest / np.sqrt(w.G[unit, unit])
        for e in range(0 if slip[f] == 0 else 1, 3):
            admissible = admissible and w.event[3 * f + e] >= -floor
    copy(event, w.event)
    if admissible:
        _variables(m, w, slip, w.force, slip, y, x)
        _rescale(y, x, unit_y, unit_x, -1)


@kernel
def _violation(M: Table, q: Reals, y: Reals, x: Reals) -> float:
    """Return the largest difference of y and M x + q, relative to the largest term."""
    worst, size = 0.0, TINY
    for i in range(len(q)):
        value = q[i] - y[i]
        size = max(size, abs(q[i]), abs(y[i]))
        for j in range(len(q)):
            value += M[i, j] * x[j]
            size = max(size, abs(M[i, j] * x[j]))
        worst = max(worst, abs(value))
    return worst / size


@kernel(allocates=True)
def _variables(
    m: Arrays, w: Workspace, slip: Integers, force: Reals, direction: Integers, y: Reals, x: Reals
) -> None:
    """Fill y and x from row forces; the friction of a stuck slider mobilizes both surfaces equally."""
    nr, nf, surfaces = m.rows, len(m.friction), _surfaces(m, slip)
    for c in range(len(m.smooth)):
        y[c] = max(force[m.smooth[c]], 0.0)
        x[c] = max(-force[m.smooth[c]], 0.0)
    g = nr
    for f in range(nf):
        guide = m.friction[f]
        column = guide.pair
        R, T, friction = force[guide.row], force[guide.row + 1], force[nr + f]
        mu = coefficient(m, f, slip)
        kappa = -mu * direction[f] if direction[f] != 0 else mobilization(guide, R, T, friction)

        # F- in y and F+ in x; their sums are the loads of the two surfaces
        corners = corner_forces(guide, R, T, kappa)
        lower, upper = 0.0, 0.0
        for k in range(guide.corners):
            y[column + k] = max(-corners[k], 0.0)
            x[column + k] = max(corners[k], 0.0)
            lower += x[column + k]
            upper += y[column + k]

        # gH+, lH- in y and lH+, gH- in x, of each surface
        if slip[f] == 0:
            acceleration = row_acceleration(w, nr + f, force) if direction[f] != 0 else 0.0
            # the part of the constant bound in use, that of the coefficient if there is one
            bound = constant_bound(m, f, slip)
            part = 0.0
            if direction[f] != 0:
                part = -1.0 * direction[f]
            elif mu > 0.0:
                part = kappa / mu
            elif bound > 0.0:
                part = min(max(friction / bound, -1.0), 1.0)
            bound /= guide.surfaces
            for surface in range(guide.surfaces):
                load = lower if surface == 0 else upper
                y[g] = max(acceleration, 0.0)
                x[g + surfaces] = max(-acceleration, 0.0)
                y[g + surfaces] = (mu - kappa) * load + (1.0 - part) * bound
                x[g] = (mu + kappa) * load + (1.0 + part) * bound
                g += 1


@kernel
def read(m, w, slip, force, y, x, accelerate, corner):
    """Read accelerations g_H'' of the stuck guides and the signs of the corner forces from a solution.

    `accelerate` receives the accelerations, exactly 0 of a guide that stays at rest; `corner` the signs of F+_j - F-_j,
    +1 where both vanish. A guide without length uses the first.
    """
    g, surfaces = m.rows, _surfaces(m, slip)
    for f in range(len(m.friction)):
        for k in range(m.friction[f].corners):
            column = m.friction[f].pair + k
            corner[f, k] = -1 if y[column] > x[column] else 1
        accelerate[f] = 0.0
        if slip[f] == 0:
            # A guide is at rest where gH+ - gH- of its lower surface is zero; the upper one has the same, as the slider
            # cannot turn in its guide. Elsewhere the forces give the acceleration: with compliance the variables of the
            # basis differ between guides on one line.
            if y[g] != x[g + surfaces] and sticks(m, slip, f):
                accelerate[f] = row_acceleration(w, m.rows + f, force)
            # friction never acts along the acceleration: the compliance has chosen a wrong basis, by less than itself
            if accelerate[f] * force[m.rows + f] > 0.0:
                accelerate[f] = 0.0
            g += m.friction[f].surfaces


def residual(A0: np.ndarray, A1: np.ndarray, b: np.ndarray, y: np.ndarray, x: np.ndarray) -> float:
    """Largest relative violation of A0 y = A1 x + b, y, x >= 0 and min(y, x) = 0.

    The first is relative to its largest term, the others to the largest variable.
    """
    terms = max(
        np.max(np.abs(A0) * np.abs(y)), np.max(np.abs(A1) * np.abs(x)), np.max(np.abs(b)), TINY
    )
    size = max(np.max(np.abs(y)), np.max(np.abs(x)), TINY)
    return float(
        max(np.max(np.abs(A0 @ y - A1 @ x - b)) / terms, np.max(np.abs(np.minimum(y, x))) / size)
    )
