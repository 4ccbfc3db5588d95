"""Guides that rest together and guides that leave rest together, decided by rank, compiled.

A mechanism of one freedom with two frictional guides rests in both or in none. Their slip velocities pass zero
together, but each is computed with its own rounding, so that no threshold on a speed can tell. The rows can. With J the
constraint rows, W the tangential rows of the guides that are held, and W_f that of another guide,

    W_f = lambda^T [J; W]    means    g_f' = W_f v = -lambda^T [dPhi/dt; 0]    on  J v + dPhi/dt = 0,  W v = 0:

the freedom that is left cannot move guide f. Unless a drive moves it, it is at rest, whatever rounding has left of its
speed. In the same way a guide that breaks away takes those with it that would hold it.

Dependence is measured in the kinetic metric: rows of J M^-1/2 of unit size, orthogonalized in turn (Gram and Schmidt,
each twice). That is a dense system. A large cell, whose G is a band, is spared it where the elimination of G with all
guides held finds no small pivot: then no guide depends on others.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Flags, Integers, Reals, Table, at
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import ELIMINATION, RANK_TOLERANCE, solve_in_place
from stiction.reference_impl.compiled.loops import taken
from stiction.reference_impl.multibody.banded_systems import fill_cell, fill_cell_of, guides_of
from stiction.reference_impl.multibody.dynamics import largest_speed
from stiction.reference_impl.multibody.kinematics import Workspace
from stiction.reference_impl.multibody.mechanism import Arrays

DEPENDENT = 1e-6
"""Part of a row of unit size, across the others, up to which it depends on them. Rounding leaves 1e-16 over the
smallest part that counts as independent, 1e-10."""
DRIVEN = 1e-8
"""Slip speed that drives give a guide that is held otherwise, relative to the largest speed so far, from which on it
slips. Rounding leaves 1e-16 over DEPENDENT, 1e-10."""

STOPPED = 1e-3
"""Part of the largest speed so far by which bringing to rest may change a speed: far above what integration leaves
where a mechanism stops. A slider that turns round in a dead centre passes zero while its mechanism goes on, with all of
its speed."""


@kernel(allocates=True)
def rest_together(m: Arrays, w: Workspace, held: Flags, speed: float, v: Reals) -> bool:
    """Find the guides that are at rest because others are, and bring the mechanism that they hold together to rest.

    Parameters
    ----------
    m, w : Arrays, Workspace
        Filled by `dynamics.row_form`.
    held : ndarray of bool, shape (frictional,)
        The guides at rest; those that are found are added.
    speed : float
        The largest speed so far, m/s.
    v : ndarray, shape (3 * bodies,)
        Velocities. Where guides rest together they are brought onto the constraints and to rest in the guides that are
        held, by the least change in the kinetic metric.

    Returns
    -------
    bool
        Whether guides rest together: more are at rest than there were freedoms to hold.
    """
    if len(m.cell) < 2:
        return not _are_independent(m, w) and _rest_together(m, w, held, speed, v)
    found = False
    for c in range(len(m.cell)):
        own_m = at(m.separate[c], m)
        guides = guides_of(m, own_m)
        own_held, count = taken(held, guides), 0
        for i in range(len(guides)):
            count += own_held[i]
        if count == 0:
            continue
        fill_cell_of(m, w, c)
        if not _are_independent(own_m, at(w.separate[c], w)) and _rest_together(own_m, w, own_held, speed, v):
            found = True
            for i in range(len(guides)):
                held[guides[i]] = own_held[i]
    return found


@kernel(allocates=True)
def _rest_together(m: Arrays, w: Workspace, held: Flags, speed: float, v: Reals) -> bool:
    """Variant of `rest_together` for one cell, with the workspace of the whole."""
    row, size = _unit_rows(m, w)
    rate, basis, count = np.zeros(len(row)), np.zeros(len(row), dtype=np.int64), 0
    for r in range(len(row)):
        place = m.origin[r] if len(m.origin) else r
        rate[r] = (w.phi_dot[place] if r < m.rows else w.slip_speed[place - len(w.phi_dot)]) / size[r]
        if (r < m.rows or held[r - m.rows]) and _left(row, rate, basis, count, r) > DEPENDENT:
            _admit(row, rate, basis, count, r)
            count += 1
    found, several = np.zeros(len(held), dtype=np.bool_), False
    for f in range(len(m.friction)):
        t = m.rows + f
        if not held[f]:
            found[f] = _left(row, rate, basis, count, t) <= DEPENDENT and abs(rate[t]) * size[t] <= DRIVEN * speed
        several = several or found[f] or held[f] and not _is_in(basis, count, t)
    change = np.zeros(len(v))
    for i in range(len(v)):
        for k in range(count):
            change[i] -= np.sqrt(m.inverse_mass[i]) * row[basis[k], i] * rate[basis[k]]
    if not several or largest_speed(m, change) > STOPPED * speed:
        return False
    _subtract(-1.0, change, v)
    for f in range(len(held)):
        held[f] = held[f] or found[f]
    return True


@kernel(allocates=True)
def leave_together(m: Arrays, w: Workspace, direction: Integers, firmness: Reals, slip: Integers,
                   stuck: Flags) -> None:
    """Let guides at rest slip, and with each of them those at rest without which it cannot move.

    Where it could move with either of several others, those that are held less firmly leave.

    Parameters
    ----------
    direction : ndarray of int, shape (frictional,)
        1 or -1 for a guide that leaves; 0 for any other.
    firmness : ndarray, shape (frictional,)
        How far each guide at rest is from leaving, in any unit.
    slip, stuck : ndarray, shape (frictional,)
        The directions, and which guides are at rest: changed in place.
    """
    if len(m.cell) < 2:
        _leave_together(m, w, w, direction, firmness, slip, stuck)
        return
    for c in range(len(m.cell)):
        own_m = at(m.separate[c], m)
        guides = guides_of(m, own_m)
        own_direction, own_slip, own_stuck = taken(direction, guides), taken(slip, guides), taken(stuck, guides)
        fill_cell_of(m, w, c)
        _leave_together(own_m, w, at(w.separate[c], w), own_direction, taken(firmness, guides), own_slip, own_stuck)
        for i in range(len(guides)):
            slip[guides[i]], stuck[guides[i]] = own_slip[i], own_stuck[i]


@kernel(allocates=True)
def _leave_together(m: Arrays, w: Workspace, own: Workspace, direction: Integers, firmness: Reals, slip: Integers,
                    stuck: Flags) -> None:
    """Variant of `leave_together` for one cell, with the workspace of the whole and its own."""
    looked, independent = False, False
    for f in range(len(stuck)):
        if not stuck[f] or direction[f] == 0:
            continue
        if not looked:
            looked, independent = True, _are_independent(m, own)
        slip[f], stuck[f] = direction[f], False
        if not independent:
            _take_along(m, w, f, direction[f], firmness, slip, stuck)


@kernel(allocates=True)
def _take_along(m: Arrays, w: Workspace, guide: int, direction: int, firmness: Reals, slip: Integers,
                stuck: Flags) -> None:
    """Let those guides at rest slip without which a guide of their cell cannot."""
    row, _ = _unit_rows(m, w)
    rate, basis, count, t = np.zeros(len(row)), np.zeros(len(row), dtype=np.int64), 0, m.rows + guide
    for f in range(len(m.friction)):
        along = _product(row[t], row[m.rows + f])
        if stuck[f] and along * along >= 1.0 - RANK_TOLERANCE:
            # on one line, as where a drive moves both
            slip[f], stuck[f] = direction if along > 0.0 else -direction, False
    for r in range(m.rows):
        if _left(row, rate, basis, count, r) > DEPENDENT:
            _admit(row, rate, basis, count, r)
            count += 1
    if _left(row, rate, basis, count, t) <= DEPENDENT:
        return  # it moves as drives move it, by none of the freedoms
    free, seen = row[t].copy(), np.zeros(len(stuck), dtype=np.bool_)
    for _ in range(len(stuck)):
        f = -1
        for other in range(len(stuck)):
            if stuck[other] and not seen[other] and (f < 0 or firmness[other] > firmness[f]):
                f = other
        if f < 0:
            return
        seen[f], r = True, m.rows + f
        if _left(row, rate, basis, count, r) <= DEPENDENT:
            continue
        _admit(row, rate, basis, count, r)
        along, before = _product(row[r], free), _product(free, free)
        _subtract(along, row[r], free)
        if _product(free, free) > DEPENDENT ** 2 * before:
            count += 1
        else:
            _subtract(-along, row[r], free)
            slip[f], stuck[f] = direction if along > 0.0 else -direction, False


@kernel
def _are_independent(m: Arrays, w: Workspace) -> bool:
    """Return True where a cell that is a band has no guide that depends on others; its G is in the workspace.

    A pivot above ELIMINATION is the square of a part above 1e-3 of a row of unit size, far above DEPENDENT.
    """
    if not len(m.cell):
        return False
    band = m.cell[0].band
    n = fill_cell(m, w, 0, band, w.A)
    for i in range(n):
        w.x[i] = 0.0
    return solve_in_place(w.A, w.x, w.unit, n, band, ELIMINATION)


@kernel(allocates=True)
def _unit_rows(m: Arrays, w: Workspace) -> tuple[Table, Reals]:
    """Rows of J M^-1/2 of a cell, tangential ones behind, divided by their size; the sizes."""
    count, n = m.rows + len(m.friction), len(m.inverse_mass)
    row, size = np.zeros((count, n)), np.zeros(count)
    for b in range(len(m.block)):
        at, j, k = np.int64(m.block[b, 0]), np.int64(m.block[b, 1]), np.int64(m.block[b, 2])
        for c in range(3):
            row[j, k + c] += w.J[at + c] * np.sqrt(m.inverse_mass[k + c])
    for r in range(count):
        square = _product(row[r], row[r])
        size[r] = np.sqrt(square) if square > 0.0 else 1.0
        for i in range(n):
            row[r, i] /= size[r]
    return row, size


@kernel
def _is_in(basis, count, r):
    for k in range(count):
        if basis[k] == r:
            return True
    return False


@kernel
def _left(row, rate, basis, count, r):
    """Take out of a row, and of its rate, the parts along the basis; returns the length that is left."""
    for _ in range(2):
        for k in range(count):
            part = _product(row[basis[k]], row[r])
            _subtract(part, row[basis[k]], row[r])
            rate[r] -= part * rate[basis[k]]
    return np.sqrt(_product(row[r], row[r]))


@kernel
def _admit(row, rate, basis, count, r):
    """Make a row that is orthogonal to the basis its next member, of unit size."""
    length = np.sqrt(_product(row[r], row[r]))
    for i in range(row.shape[1]):
        row[r, i] /= length
    rate[r] /= length
    basis[count] = r


@kernel
def _product(a, b):
    """Scalar product of two vectors, in the order of their components whatever the processor."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@kernel
def _subtract(part, a, b):
    """b - part a in place of b."""
    for i in range(len(b)):
        b[i] -= part * a[i]
