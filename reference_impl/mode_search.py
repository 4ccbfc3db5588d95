"""The solution of the HLCP by trying all contact modes: complete, and exponential in the number of guides; compiled.

Lemke's method can end on a ray although a solution exists: the matrices of friction coupled over several guides are
not of a class for which it is known to find one. A solution of the HLCP is a direction (slip, or stick) of every guide
and a sign of every loaded corner for which one linear solve gives forces with those signs.
"""

from __future__ import annotations

import numpy as np
from reference_impl.compiling import kernel

from reference_impl.contact_modes import capacity
from reference_impl.linear_algebra import eliminate

LIMIT = 1_000_000
"""Modes tried at most: 6 guides that stick, 9 that slip."""
SLACK = 1e-10
"""Wrong sign of a force, or of an acceleration, relative to the largest, that counts as zero."""


@kernel(allocates=True)
def search(m, w, slip, stuck, force, direction):
    """First consistent contact mode of the rows in the workspace; the static coefficient holds for every guide at rest.

    Parameters
    ----------
    slip, stuck : ndarray, shape (frictional,)
        As in `hlcp.assemble`.
    force : ndarray, shape (rows + frictional,)
        Receives the row forces.
    direction : ndarray of int, shape (frictional,)
        Receives the direction in which each guide slips or begins to; 0 for one that stays at rest.

    Returns
    -------
    bool
        Whether there is one, among at most `LIMIT`, whose linear system is regular.
    """
    nr, nf = m.rows, len(m.friction)
    choices = np.ones(nf, dtype=np.int64)
    total = 1
    for f in range(nf):
        choices[f] = 4 if m.friction[f].length > 0.0 else 2
        if stuck[f]:
            choices[f] = 1 + 2 * choices[f]
        total *= choices[f]
        if total > LIMIT:
            return False
    A, s1, s2 = np.zeros((nr + nf, nr + nf)), np.zeros(nf, dtype=np.int64), np.zeros(nf, dtype=np.int64)
    for code in range(total):
        rest = code
        for f in range(nf):
            choice, rest = rest % choices[f], rest // choices[f]
            if stuck[f] and choice == 0:
                direction[f] = 0
                continue
            if stuck[f]:
                direction[f] = 1 if choice <= choices[f] // 2 else -1
                choice = (choice - 1) % (choices[f] // 2)
            else:
                direction[f] = slip[f]
            s1[f] = 1 if choice % 2 == 0 else -1
            s2[f] = s1[f] if choice < 2 else -s1[f]
        _fill(m, w, stuck, direction, s1, s2, A, force)
        if eliminate(A, force, nr + nf) and _consistent(m, w, stuck, direction, s1, s2, force):
            return True
    return False


@kernel
def _coefficient(m, f, stuck):
    return m.friction[f].mus if stuck[f] else m.friction[f].mu


@kernel
def _fill(m, w, stuck, direction, s1, s2, A, force):
    """Constraint rows; per guide its tangential row (rest) or f = -mu d (s1 n1 + s2 n2) (slip; see `contact_modes`)."""
    nr = m.rows
    for r in range(nr + len(m.friction)):
        force[r] = w.right[r]
        for c in range(nr + len(m.friction)):
            A[r, c] = w.G[r, c]
    for f in range(len(m.friction)):
        if direction[f] == 0:
            continue
        guide = m.friction[f]
        mu_d = _coefficient(m, f, stuck) * direction[f]
        A[nr + f, :] = 0.0
        A[nr + f, nr + f] = 1.0
        force[nr + f] = 0.0
        if guide.length > 0.0:
            across = (s2[f] - s1[f]) / guide.length
            A[nr + f, guide.row] = mu_d * (0.5 * (s1[f] + s2[f]) + across * 0.5 * guide.width * mu_d)
            A[nr + f, guide.row + 1] = mu_d * across
        else:
            A[nr + f, guide.row] = mu_d * s1[f]


@kernel(allocates=True)
def _consistent(m, w, stuck, direction, s1, s2, force):
    """Whether corner forces, friction at rest and accelerations of guides leaving rest have the signs of their mode."""
    nr = m.rows
    floor = SLACK * np.max(np.abs(force))
    for f in range(len(m.friction)):
        guide, d = m.friction[f], direction[f]
        R, T, friction = force[guide.row], force[guide.row + 1], force[nr + f]
        if d == 0:
            if capacity(m, f, R, T, 1.0) + friction < -floor or capacity(m, f, R, T, -1.0) - friction < -floor:
                return False
            continue
        if guide.length > 0.0:
            half = (T + 0.5 * guide.width * _coefficient(m, f, stuck) * d * R) / guide.length
            if s1[f] * (0.5 * R - half) < -floor or s2[f] * (0.5 * R + half) < -floor:
                return False
        elif s1[f] * R < -floor:
            return False
        if stuck[f]:
            acceleration, size = -w.right[nr + f], abs(w.right[nr + f])
            for r in range(nr + len(m.friction)):
                acceleration += w.G[nr + f, r] * force[r]
                size = max(size, abs(w.G[nr + f, r] * force[r]))
            if d * acceleration < -SLACK * size:
                return False
    return True
