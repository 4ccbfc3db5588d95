"""Forces that the motion and Coulomb's law leave open; compiled, and for the rows of a run.

The friction of a guide that no freedom moves (`guide_freedom`) does not enter the accelerations. Two things follow.

At rest it may be anything within Coulomb's cone. Of a guide that joints lock, zero is taken: the admissible value
nearest to zero, and what a joint that was assembled without stress has. Where a drive holds the guide, as a motor that
dwells against friction, the drive and the friction share the load, and nothing tells how: what the null vector

    J^T lambda + W^T f = 0

of reactions, efforts and this friction moves is reported as nan.

While a driven guide slips, f = -mu d (|n1| + |n2|) with n1, n2 linear in f. Where the friction gain (`uniqueness`) is 1
or more, this equation may have several solutions, with one and the same motion: a strut that pulls a block back beyond
its angle of friction can push it onto the guide or lift it off. The integration goes on with the smallest of them,
which is the last to grow without bound; all of them are in `Trajectory.alternatives`, and the columns are nan. A
solution can be lost in two ways: its forces grow without bound, or it meets another one where a corner force is zero.
The motion is smooth there, and goes on with a solution that is left, if any is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stiction.reference_impl.compiled.bundle import Cube, Integers, IntegerTable, Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy, taken
from stiction.reference_impl.friction.coulomb import coefficient, corner_forces
from stiction.reference_impl.friction.enumeration import SAME, is_same_motion, solutions
from stiction.reference_impl.friction.uniqueness import COUNTED, gain_of_mode
from stiction.reference_impl.multibody.banded_systems import cell_of, count_cells, forces_into_cell
from stiction.reference_impl.multibody.dynamics import largest_force, row_form
from stiction.reference_impl.multibody.guide_freedom import DRIVEN
from stiction.reference_impl.multibody.mechanism import Arrays, Mechanism, Workspace, workspace

MOST_ALTERNATIVES = 8
"""Solutions of one motion that are kept: two for one driven guide without length, up to four with two corners."""

LARGE = 10.0
"""Multiple of the ordinary load from which on a corner force is one that may grow without bound."""
SEVERAL_FROM = 1.0 - 1e-6
"""Friction gain from which on several solutions are looked for: 1, but for rounding where forces grow without bound."""


@kernel
def may_be_several(m, w, slip):
    """Return True where forces of one motion can be several: a driven guide slips, and the friction gain allows it."""
    any_driven_slips = False
    for f in range(len(slip)):
        slips = slip[f] != 0 and m.friction[f].freedom == DRIVEN
        any_driven_slips = any_driven_slips or slips
    return any_driven_slips and gain_of_mode(m, w, slip)[0] >= SEVERAL_FROM


@kernel
def ordinary_load(m, w, f):
    """Size of the forces of constraints, as of the normal row of guide f, N: the smallest that its loads ask for.

    Each row alone would take |right_r| / G_rr to meet its acceleration. It is smooth in time, and knows no friction.
    """
    square = 0.0
    for r in range(m.rows):
        if w.G[r, r] > 0.0:
            square += w.right[r] ** 2 / w.G[r, r]
    normal = m.friction[f].row
    return np.sqrt(square / w.G[normal, normal])


@kernel
def bounded(n, ordinary):
    """A corner force n (N) of a driven guide as an event function: it has the zeros of n and those of 1 / n.

    Where the friction gain passes 1 the corner forces of a mechanism that drives move pass from one infinity to the
    other, while its motion stays smooth: no step is too long for that, and n falls to zero nowhere.
    n / (1 + (n / n0)^2) is smooth there, changes its sign, and is n as long as that is small against n0 = LARGE times
    the ordinary load.
    """
    if not ordinary > 0.0:
        return n
    return n / (1.0 + (n / (LARGE * ordinary)) ** 2)


@kernel(allocates=True)
def forces_of_one_motion(
    m: Arrays, w: Workspace, slip: Integers, forces: Table, directions: IntegerTable
) -> int:
    """Row forces that obey Coulomb's law and give the accelerations of those in w.force; their number.

    `forces`, (k, rows + frictional), and `directions`, (k, frictional), receive them. 0 where there are more than
    `uniqueness.COUNTED` contact modes, which are not all tried.
    """
    # of all consistent forces keep those of this motion, in place
    count = solutions(m, w, slip, forces, directions, 0.0, COUNTED, True)
    kept = 0
    for i in range(max(count, 0)):  # negative where there are too many modes
        if is_same_motion(m, w, forces[i], w.force):
            if kept < i:
                copy(forces[i], forces[kept])
                copy(directions[i], directions[kept])
            kept += 1
    return kept


@kernel(allocates=True)
def take_least_forces(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable) -> None:
    """Put the smallest of several forces of one motion in place of those in w.force, with the signs of its corners."""
    if not may_be_several(m, w, slip):
        return
    nf = len(m.friction)
    forces = np.zeros((MOST_ALTERNATIVES, len(w.force)))
    directions = np.zeros((MOST_ALTERNATIVES, nf), dtype=np.int64)
    count = forces_of_one_motion(m, w, slip, forces, directions)
    best, least = 0, np.inf
    for i in range(count):
        size = largest_force(m, w, forces[i])
        if size < least:
            best, least = i, size
    if count < 2:
        return
    copy(forces[best], w.force)
    for f in range(nf):
        if m.friction[f].corners == 0:
            continue
        normal = m.friction[f].row
        kappa = -coefficient(m, f, slip) * directions[best, f]
        n1, n2 = corner_forces(m.friction[f], w.force[normal], w.force[normal + 1], kappa)
        corner[f, 0] = -1 if n1 < 0.0 else 1
        corner[f, 1] = -1 if n2 < 0.0 else 1


@kernel(allocates=True)
def _alternatives(  # noqa: PLR0913 - a kernel's arrays
    m: Arrays,
    w: Workspace,
    t: Reals,
    q: Table,
    v: Table,
    slip: IntegerTable,
    force: Table,
    alternatives: Cube,
    count: Integers,
) -> None:
    """Fill `alternatives` (n, k, rows + frictional) with the forces of the motion at each instant, `count` (n,) many.

    `force` has those of the run. 1 where they are the only ones.
    """
    for i in range(len(t)):
        count[i] = 1
        row_form(m, w, t[i], q[i], v[i])
        if not may_be_several(m, w, slip[i]):
            continue

        # to begin with all alternatives are the forces of the run: those of closed cells stay so
        for r in range(len(w.force)):
            w.force[r] = force[i, r]
            for k in range(alternatives.shape[1]):
                alternatives[i, k, r] = force[i, r]
        for c in range(count_cells(m)):
            own_m, own_w, guides = cell_of(m, w, c)
            own_slip = taken(slip[i], guides)
            forces_into_cell(m, w, own_m, own_w)
            forces = np.zeros((alternatives.shape[1], len(own_w.force)))
            directions = np.zeros((alternatives.shape[1], len(guides)), dtype=np.int64)
            own_count = forces_of_one_motion(own_m, own_w, own_slip, forces, directions)
            if own_count < 2:
                continue
            # of several cells that are open each has its own alternatives: they are listed side by side
            count[i] = max(count[i], own_count)
            for k in range(own_count):
                for r in range(len(own_w.force)):
                    row = own_m.origin[r] if len(own_m.origin) else r
                    alternatives[i, k, row] = forces[k, r]


@dataclass(frozen=True)
class OpenForces:
    """Row forces of a run, with those that are open.

    Attributes
    ----------
    force : ndarray, shape (n, rows + frictional)
        Row forces; nan where the motion and Coulomb's law do not determine one.
    rows : ndarray of int, shape (m,)
        Instants at which a finite number of forces is possible.
    alternatives : ndarray, shape (m, k, rows + frictional)
        These forces at these instants; nan behind the last, and for a force that is determined.
    """

    force: np.ndarray
    rows: np.ndarray
    alternatives: np.ndarray


def open_forces(
    mechanism: Mechanism,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    force: np.ndarray,
    slip: np.ndarray,
) -> OpenForces:
    """Leave open which forces of a run are not determined.

    Parameters
    ----------
    mechanism : Mechanism
    t : ndarray, shape (n,)
    q, v : ndarray, shape (n, 3 * bodies)
    force : ndarray, shape (n, rows + frictional)
        Row forces of the integration: one of several where several are possible.
    slip : ndarray, shape (n, frictional)
        Directions of slip; 0 at rest.
    """
    from stiction.reference_impl.multibody.reactions import columns_of_rows

    m, total = mechanism.arrays, force.shape[1]
    none = OpenForces(force, np.zeros(0, dtype=np.int64), np.zeros((0, 1, total)))
    if m.unfree == 0 or not len(t):
        return none
    t, q, v, force = (np.ascontiguousarray(values, dtype=float) for values in (t, q, v, force))
    slip = np.ascontiguousarray(slip, dtype=np.int64)
    marked = force.copy()

    # a finite number of forces, while driven guides slip
    at_all_instants = np.full((len(t), MOST_ALTERNATIVES, total), np.nan)
    count = np.ones(len(t), dtype=np.int64)
    _alternatives(m, workspace(m), t, q, v, slip, force, at_all_instants, count)
    rows = np.flatnonzero(count > 1)
    alternatives = at_all_instants[rows]
    alternatives[np.arange(MOST_ALTERNATIVES) >= count[rows, None]] = np.nan
    if len(rows):
        # relative to the largest force of the instant, each by its mobility as in `dynamics.largest_force`: a moment
        # that is zero in all of them, but for rounding, is one and the same
        acts, _ = columns_of_rows(m, t[rows], q[rows], v[rows])
        unit = np.sqrt(np.einsum("nir,i->nr", acts**2, m.inverse_mass))
        spread = unit * (np.nanmax(alternatives, axis=1) - np.nanmin(alternatives, axis=1))
        largest = np.max(unit * np.nanmax(np.abs(alternatives), axis=1), axis=1, keepdims=True)
        differs = spread > SAME * largest
        alternatives = np.where(differs[:, None, :], alternatives, np.nan)
        marked[rows] = np.where(differs, np.nan, marked[rows])
        alternatives = alternatives[:, : int(count[rows].max())]

    # an interval of forces, while a drive holds a guide at rest
    driven = m.friction["freedom"] == DRIVEN
    for instants, guides in _patterns((slip == 0) & driven):
        marked[instants] = np.where(
            _moved(mechanism, t, q, v, instants, guides), np.nan, marked[instants]
        )
    return OpenForces(marked, rows, alternatives)


def _patterns(flags: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the instants that have the same flags (n, k), and the places of the flags that are set, if any are."""
    for pattern in np.unique(flags, axis=0):
        if pattern.any():
            yield np.flatnonzero((flags == pattern).all(axis=1)), np.flatnonzero(pattern)


def _moved(
    mechanism: Mechanism,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    instants: np.ndarray,
    guides: np.ndarray,
) -> np.ndarray:
    """Return which row forces a null vector with the friction of these guides moves, (instants, rows + frictional)."""
    from stiction.reference_impl.multibody.reactions import columns_of_rows, parts_of_null_vectors

    rows = mechanism.arrays.rows
    unknown = np.concatenate([np.arange(rows), rows + guides])
    moved = np.zeros((len(instants), rows + len(mechanism.guide_names)), dtype=bool)
    matrices, _ = columns_of_rows(mechanism.arrays, t[instants], q[instants], v[instants])
    moved[:, unknown] = parts_of_null_vectors(matrices[:, :, unknown], rows)
    return moved
