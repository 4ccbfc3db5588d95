"""The horizontal linear complementarity problem of eqs. (34)-(38), compiled.

    A0 y = A1 x + b,   y >= 0,  x >= 0,  y^T x = 0
    y = [lCR+, lD+, F-, gH+, lH-],   x = [lCR-, lD-, F+, lH+, gH-]

Every force of the problem acts through rows of the mechanism (`mechanism`): a corner force F+_j through the normal row
(1), the angle row (lever -+ a/2) and, if its surface slips, the tangential row (friction -mu sgn(g_T) F) with the
surface's lever +- b/2 on the angle row. With E the columns of these coefficients, M1 MKG and its fellows are G E.

Beyond the paper: rows of smooth guides and the angle row of a guide without length are bilateral and are split like
lCR; a guide without length has one pair F+ - F- = R.
"""

from __future__ import annotations

import numpy as np
from reference_impl.compiling import kernel

from reference_impl.lemke import RAY, SOLVED, lemke
from reference_impl.linear_algebra import eliminate_columns
from reference_impl.mode_search import search

SINGULAR = 3
"""Outcome beside those of `lemke`: A0 is singular, eq. (37) cannot be made an LCP."""

COMPLIANCE = 1e-10
"""Added to the diagonal of G, relative to its largest entry, where A0 is singular: redundant constraints then share
their force in the minimum-norm sense. It changes the solution by as much, relatively, and must stand out from the
RANK_TOLERANCE of `linear_algebra`."""

REST, REST_COMPLIANT = 1e-12, 1e-7
"""Acceleration of a stuck slider, relative to the largest acceleration in the problem, up to which a solution means rest.
Lemke's zeros are exact except in degenerate bases, where they are rounding or, with compliance, that compliance
times the ratio of the mechanism's levers (a reserve of 1000)."""


@kernel(allocates=True)
def assemble(m, w, slip, stuck, compliance=0.0):
    """A0, A1, b of eq. (36) for the rows in the workspace.

    Parameters
    ----------
    m, w : Arrays, Workspace
        Filled by `dynamics.row_form`.
    slip : ndarray of int, shape (frictional,)
        sgn(g_T) of each frictional guide that slips.
    stuck : ndarray of bool, shape (frictional,)
        The set H: guides at g_T = 0; their `slip` is not used.
    compliance : float
        Added to the diagonal of the constraint rows of G (1/kg).

    Returns
    -------
    A0, A1 : ndarray, shape (n, n)
    b : ndarray, shape (n,)
    E0, E1 : ndarray, shape (rows + frictional, n)
        Row forces per unit of each variable: force = E0 y + E1 x.
    """
    nr, nf = m.rows, len(m.friction)
    bilateral = np.ones(nr, dtype=np.bool_)
    normal_pairs = 0
    surfaces = 0
    for f in range(nf):
        bilateral[m.friction[f].row] = False
        if m.friction[f].length > 0.0:
            bilateral[m.friction[f].row + 1] = False
            normal_pairs += 2
        else:
            normal_pairs += 1
        surfaces += 2 if stuck[f] else 0
    smooth = 0
    for r in range(nr):
        smooth += 1 if bilateral[r] else 0
    n = smooth + normal_pairs + 2 * surfaces
    E0, E1 = np.zeros((nr + nf, n)), np.zeros((nr + nf, n))
    A0, A1, b = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    column = 0
    for r in range(nr):
        if bilateral[r]:
            E0[r, column], E1[r, column] = 1.0, -1.0
            column += 1
    g_plus = smooth + normal_pairs
    l_minus = g_plus + surfaces
    h = 0
    for f in range(nf):
        normal, tangent = m.friction[f].row, nr + f
        half_a, half_b = 0.5 * m.friction[f].length, 0.5 * m.friction[f].width
        # mt = mubar - V muH: friction per unit of normal force before lH+ is added
        mt = -m.friction[f].mus if stuck[f] else -m.friction[f].mu * slip[f]
        corners = 2 if half_a > 0.0 else 1
        for j in range(corners):
            lever = (2 * j - 1) * half_a if corners == 2 else 0.0
            E1[normal, column] = 1.0
            E0[normal, column] = -1.0
            E1[tangent, column] = mt
            E0[tangent, column] = mt
            if corners == 2:
                E1[normal + 1, column] = lever + half_b * mt
                E0[normal + 1, column] = -lever - half_b * mt
            if stuck[f]:
                # lH+ + lH- = 2 mus FN, eq. (17), on the surface of this corner
                A1[l_minus + h, column] = 2.0 * m.friction[f].mus
                A0[l_minus + h + 1, column] = -2.0 * m.friction[f].mus
            column += 1
        if stuck[f]:
            for surface in range(2):
                i = h + surface
                E1[tangent, g_plus + i] = 1.0
                if corners == 2:
                    E1[normal + 1, g_plus + i] = half_b if surface == 0 else -half_b
                A0[g_plus + i, g_plus + i] = -1.0
                A1[g_plus + i, l_minus + i] = -1.0
                A0[l_minus + i, l_minus + i] = 1.0
                A1[l_minus + i, g_plus + i] = -1.0
            h += 2
    for r in range(nr):
        b[r] = w.right[r]
        for c in range(n):
            y, x = 0.0, 0.0
            for k in range(nr + nf):
                y += w.G[r, k] * E0[k, c]
                x += w.G[r, k] * E1[k, c]
            A0[r, c] = y + compliance * E0[r, c]
            A1[r, c] = -(x + compliance * E1[r, c])
        b[r] = w.right[r]
    h = 0
    for f in range(nf):
        if not stuck[f]:
            continue
        half_b = 0.5 * m.friction[f].width
        angle = m.friction[f].row + 1
        for surface in range(2):
            lever = half_b if surface == 0 else -half_b
            row = g_plus + h
            # W_T of the surface = tangential row +- b/2 angle row, so g_H'' = (that row of G) force - right
            b[row] = w.right[nr + f] + lever * w.right[angle]
            for c in range(n):
                y, x = 0.0, 0.0
                for k in range(nr + nf):
                    g = w.G[nr + f, k] + lever * w.G[angle, k]
                    y += g * E0[k, c]
                    x += g * E1[k, c]
                A0[row, c] += y
                A1[row, c] -= x
            h += 1
    return A0, A1, b, E0, E1


SATURATION_COVER = 10.0
"""Weight of the rows of lH- in Lemke's covering vector, those of all others being 1. The problem has a ray of its own for
every stuck surface: gH+ and gH- of a surface without load can grow together (the column of gH- has a single entry, 1 in the
row of gH+), and with equal weights Lemke's path ends there in 5 to 50 % of random problems that have a solution. With
artificial capacity that outlasts the artificial forces it did not in any of several thousand."""

ACCURATE = 1e-9
"""Residual relative to the largest term above which a solution by pivoting is not one."""


@kernel(allocates=True)
def solve(m, w, slip, stuck):
    """Solve the HLCP by Lemke's method, and where that finds no solution by trying all contact modes.

    Returns
    -------
    force : ndarray, shape (rows + frictional,)
        Row forces: multipliers and frictions.
    y, x : ndarray, shape (n,)
    outcome, pivots : int
    rest : float
        Acceleration (m/s^2) up to which a stuck guide of this solution is at rest.
    """
    compliance = 0.0
    A0, A1, b, E0, E1 = assemble(m, w, slip, stuck)
    n = len(b)
    right = np.empty((n, n + 1))
    right[:, :n], right[:, n] = A1, b
    if not eliminate_columns(A0, right):
        for r in range(m.rows):
            compliance = max(compliance, COMPLIANCE * w.G[r, r])
        A0, A1, b, E0, E1 = assemble(m, w, slip, stuck, compliance)
        right[:, :n], right[:, n] = A1, b
        if not eliminate_columns(A0, right):
            return np.zeros(len(w.force)), b, b, SINGULAR, 0, 0.0
    M, q = np.ascontiguousarray(right[:, :n]), np.ascontiguousarray(right[:, n])
    cover = np.ones(n)
    cover[n - 2 * np.sum(stuck):] = SATURATION_COVER
    y, x, outcome, pivots = lemke(M, q, cover)
    force = np.zeros(len(w.force))
    if outcome == SOLVED and _violation(M, q, y, x) <= ACCURATE:
        for k in range(len(force)):
            for c in range(n):
                force[k] += E0[k, c] * y[c] + E1[k, c] * x[c]
    else:
        direction = np.zeros(len(m.friction), dtype=np.int64)
        if search(m, w, slip, stuck, force, direction):
            _variables(m, w, stuck, force, direction, y, x)
            outcome = SOLVED
        elif outcome == SOLVED:
            outcome = RAY
    scale = 0.0
    for f in range(len(m.friction)):
        t = m.rows + f
        scale = max(scale, abs(w.right[t]))
        for k in range(len(force)):
            scale = max(scale, abs(w.G[t, k] * force[k]))
    return force, y, x, outcome, pivots, scale * (REST if compliance == 0.0 else REST_COMPLIANT)


@kernel
def _violation(M, q, y, x):
    """Largest difference of y and M x + q, relative to the largest term."""
    worst, size = 0.0, 1e-300
    for i in range(len(q)):
        value = q[i] - y[i]
        size = max(size, abs(q[i]), abs(y[i]))
        for j in range(len(q)):
            value += M[i, j] * x[j]
            size = max(size, abs(M[i, j] * x[j]))
        worst = max(worst, abs(value))
    return worst / size


@kernel(allocates=True)
def _variables(m, w, stuck, force, direction, y, x):
    """y and x of row forces; the friction of a stuck slider mobilizes both surfaces equally."""
    nr, nf = m.rows, len(m.friction)
    bilateral = np.ones(nr, dtype=np.bool_)
    for f in range(nf):
        bilateral[m.friction[f].row] = False
        bilateral[m.friction[f].row + 1] = bilateral[m.friction[f].row + 1] and not m.friction[f].length > 0.0
    column = 0
    for r in range(nr):
        if bilateral[r]:
            y[column], x[column] = max(force[r], 0.0), max(-force[r], 0.0)
            column += 1
    surfaces = 2 * np.sum(stuck)
    h = len(y) - 2 * surfaces
    for f in range(nf):
        guide = m.friction[f]
        R, T, friction = force[guide.row], force[guide.row + 1], force[nr + f]
        coefficient = guide.mus if stuck[f] else guide.mu
        kappa = -coefficient * direction[f]
        if direction[f] == 0:
            kappa = _mobilization(guide, R, T, friction)
        upper, lower = max(-R, 0.0), max(R, 0.0)
        if guide.length > 0.0:
            half = (T - 0.5 * guide.width * kappa * R) / guide.length
            lower, upper = 0.0, 0.0
            for n in (0.5 * R - half, 0.5 * R + half):
                y[column], x[column] = max(-n, 0.0), max(n, 0.0)
                lower, upper = lower + x[column], upper + y[column]
                column += 1
        else:
            y[column], x[column] = upper, lower
            column += 1
        if stuck[f]:
            acceleration = -w.right[nr + f]
            for r in range(nr + nf):
                acceleration += w.G[nr + f, r] * force[r]
            for load in (lower, upper):
                if direction[f] != 0:
                    y[h], x[h + surfaces] = max(acceleration, 0.0), max(-acceleration, 0.0)
                else:
                    y[h], x[h + surfaces] = 0.0, 0.0
                y[h + surfaces], x[h] = (coefficient - kappa) * load, (coefficient + kappa) * load
                h += 1


@kernel
def _mobilization(guide, R, T, friction):
    """kappa = friction / (N+ + N-) of a guide at rest within its capacity, by bisection; see `equal_mobilization`."""
    low, high = -guide.mus, guide.mus
    for _ in range(60):
        kappa = 0.5 * (low + high)
        load = abs(R)
        if guide.length > 0.0:
            load = max(load, 2.0 / guide.length * abs(T - 0.5 * guide.width * kappa * R))
        if kappa * load < friction:
            low = kappa
        else:
            high = kappa
    return 0.5 * (low + high)


@kernel
def read(m, stuck, y, x, accelerate, corner):
    """Accelerations g_H'' of the stuck guides and the signs of the corner forces from a solution.

    Parameters
    ----------
    accelerate : ndarray, shape (frictional,)
        Receives gH+ - gH- of the lower surface (both surfaces agree, the slider cannot turn in its guide).
    corner : ndarray of int, shape (frictional, 2)
        Receives the sign of F+_j - F-_j; +1 where both vanish. A guide without length uses the first.
    """
    column = 0
    nf = len(m.friction)
    pairs = 0
    surfaces = 0
    for f in range(nf):
        pairs += 2 if m.friction[f].length > 0.0 else 1
        surfaces += 2 if stuck[f] else 0
    smooth = len(y) - pairs - 2 * surfaces
    column = smooth
    h = smooth + pairs
    for f in range(nf):
        for j in range(2 if m.friction[f].length > 0.0 else 1):
            corner[f, j] = -1 if y[column] > x[column] else 1
            column += 1
        accelerate[f] = 0.0
        if stuck[f]:
            accelerate[f] = y[h] - x[h + surfaces]
            h += 2


@kernel(allocates=True)
def residual(A0, A1, b, y, x):
    """Largest violation of A0 y = A1 x + b, y, x >= 0 and min(y, x) = 0, relative to the largest term and variable."""
    worst, size = 0.0, 1e-300
    for i in range(len(b)):
        value = -b[i]
        size = max(size, abs(b[i]))
        for j in range(len(b)):
            value += A0[i, j] * y[j] - A1[i, j] * x[j]
            size = max(size, abs(A0[i, j] * y[j]), abs(A1[i, j] * x[j]))
        worst = max(worst, abs(value))
    worst /= size
    size_x = max(1e-300, np.max(np.abs(y)), np.max(np.abs(x)))
    for i in range(len(b)):
        worst = max(worst, abs(min(y[i], x[i])) / size_x)
    return worst
