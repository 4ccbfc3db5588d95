"""Whether the contact forces at an instant are the only ones, compiled; and all of them, for small mechanisms.

The friction of a slipping guide is f = -mu d (|n1| + |n2|) = -mu d max(|R|, |D|), D = n2 - n1 = (2/a)(T + (b/2) mu d R), and R
and T are linear in the frictions of all guides. Where the gain

    max over guides i of  mu_i sum over slipping guides j of  max(|dR_i/df_j|, |dD_i/df_j|)

is below 1 the frictions are the fixed point of a contraction, so that they exist and are unique whatever the loads. For one
slipping guide that is necessary too: beyond, some loads have two solutions and others none (Painleve). There the contact
modes are counted. A guide at rest adds its static coefficient, with both directions of slip in view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from reference_impl.compiling import kernel

from reference_impl.dynamics import acceleration, row_form
from reference_impl.hlcp import COMPLIANCE
from reference_impl.kinematics import workspace
from reference_impl.linear_algebra import eliminate_columns
from reference_impl.mechanism import Mechanism
from reference_impl.mode_search import LIMIT, TOO_MANY, solutions

COUNTED = 1000
"""Contact modes up to which solutions are counted on the way: three guides at rest, four that slip. Beyond, an integration
does not know whether its solution is the only one."""


@kernel(allocates=True)
def friction_gain(m, w, slip, held):
    """The largest gain of the rows in the workspace (`dynamics.row_form`), and the guide that has it (-1 if none slips).

    Parameters
    ----------
    slip : ndarray of int, shape (frictional,)
        Directions; 0 of a guide that is not held: both are considered, with the static coefficient.
    held : ndarray of bool, shape (frictional,)
        Guides whose slip stays zero by whatever friction this takes.
    """
    nr, nf = m.rows, len(m.friction)
    kept = np.sum(held)
    rows = np.arange(nr + kept)
    rows[nr:] = nr + np.flatnonzero(held)
    free = np.flatnonzero(~held)
    response = _response(w.G, nr, rows, free, 0.0)
    if len(response) == 0:
        response = _response(w.G, nr, rows, free, COMPLIANCE)
    worst, where = 0.0, -1
    if len(response) == 0:
        return worst, where
    for f in free:
        guide = m.friction[f]
        mu = guide.mu if slip[f] != 0 else guide.mus
        gain = 0.0
        for j in range(len(free)):
            R, D = response[guide.row, j], 0.0
            if guide.length > 0.0:
                T, lever = response[guide.row + 1, j], 0.5 * guide.width * mu
                D = abs(T + lever * slip[f] * R) if slip[f] != 0 else abs(T) + lever * abs(R)
            gain += mu * max(abs(R), 2.0 / guide.length * D if guide.length > 0.0 else 0.0)
        if where < 0 or gain > worst:
            worst, where = gain, f
    return worst, where


@kernel(allocates=True)
def _response(G, nr, rows, free, compliance):
    """Change of the forces of `rows` per unit of friction on each guide of `free`; without entries if singular."""
    n = len(rows)
    A, B = np.empty((n, n)), np.empty((n, len(free)))
    for i in range(n):
        for k in range(n):
            A[i, k] = G[rows[i], rows[k]]
        for j in range(len(free)):
            B[i, j] = -G[rows[i], nr + free[j]]
        if i < nr:
            A[i, i] += compliance * G[rows[i], rows[i]]
    return B if eliminate_columns(A, B) else B[:0]


@kernel(allocates=True)
def gain_of_mode(m, w, slip):
    """The gain with the guides at rest held there, and if there are any, that without: the larger, and its guide."""
    worst, where = friction_gain(m, w, slip, slip == 0)
    if np.any(slip == 0):
        released, guide = friction_gain(m, w, slip, np.zeros(len(slip), dtype=np.bool_))
        if released > worst:
            return released, guide
    return worst, where


@kernel(allocates=True)
def has_several(m, w, slip):
    """Whether more than one motion is known to follow from the rows in the workspace; `slip` 0: at rest."""
    gain, _ = gain_of_mode(m, w, slip)
    if gain < 1.0:
        return False
    forces, directions = np.zeros((2, len(w.force))), np.zeros((2, len(slip)), dtype=np.int64)
    return solutions(m, w, slip, slip == 0, forces, directions, 0.0, COUNTED) > 1


@dataclass(frozen=True)
class Solution:
    """Forces and accelerations that satisfy all contact conditions at an instant.

    Attributes
    ----------
    directions : dict of str to int
        By frictional guide: the direction in which it slips or begins to; 0: at rest.
    forces : dict of str to float
        By row (``guide.normal_force``, ``motor.effort``) and ``<guide>.friction``; N and N m.
    acceleration : ndarray, shape (bodies, 3)
        m/s^2 and rad/s^2, in the order of `Mechanism.body_names`.
    """

    directions: dict[str, int]
    forces: dict[str, float]
    acceleration: np.ndarray


def all_solutions(mechanism: Mechanism, t: float, q: np.ndarray, v: np.ndarray, rest_speed: float = 0.0,
                  limit: int = LIMIT) -> list[Solution]:
    """Every motion that can follow at an instant, by trying all contact modes.

    Parameters
    ----------
    t, q, v
        Time and state, q and v of shape (3 * bodies,).
    rest_speed : float
        Slip speed (m/s) up to which a guide is at rest; the static coefficient holds for it.
    limit : int
        Contact modes to be tried at most.

    Raises
    ------
    ValueError
        If there are more than `limit` contact modes.
    """
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    row_form(m, w, t, q, v)
    slip = np.where(np.abs(w.slip) <= rest_speed, 0, np.sign(w.slip)).astype(np.int64)
    return solutions_of(mechanism, w, slip, limit)


def solutions_of(mechanism: Mechanism, w, slip: np.ndarray, limit: int = LIMIT) -> list[Solution]:
    """As `all_solutions`, of the rows in a workspace."""
    m, room = mechanism.arrays, 16
    while True:
        forces, directions = np.zeros((room, len(w.force))), np.zeros((room, len(slip)), dtype=np.int64)
        found = solutions(m, w, slip, slip == 0, forces, directions, 0.0, limit)
        if found == TOO_MANY:
            raise ValueError(f"{mechanism.scene.name}: {len(slip)} frictional guides have more than {limit} contact modes; "
                             "expected a smaller mechanism")
        if found < room:
            break
        room *= 4
    names = mechanism.row_names + [f"{name}.friction" for name in mechanism.guide_names]
    motion = np.zeros((found, len(m.inverse_mass)))
    for i in range(found):
        acceleration(m, w, forces[i], motion[i])
    return [Solution(dict(zip(mechanism.guide_names, map(int, directions[i]))), dict(zip(names, map(float, forces[i]))),
                     motion[i].reshape(-1, 3)) for i in range(found)]
