"""Guides that rest together and guides that leave rest together, decided by rank, compiled.

A mechanism of one freedom with two frictional guides rests in both or in none. Their slip velocities pass zero
together, but each is computed with its own rounding, so that no threshold on a speed can tell. The rows can. With J the
constraint rows, W the tangential rows of the guides that are held, and W_f that of another guide,

    W_f = lambda^T [J; W]    means    g_f' = W_f v = -lambda^T [dPhi/dt; 0]    on  J v + dPhi/dt = 0,  W v = 0:

the freedom that is left cannot move guide f. Unless a drive moves it, it is at rest, whatever rounding has left of its
speed. In the same way a guide that breaks away takes those with it that would hold it. This is not said of a drive with
a limit: its slip is measured from its law, so that it may hold where the guide on its line leaves, and the other way
round. Whether it leaves as well is left to the contact problem.

Dependence is measured in the kinetic metric: rows of J M^-1/2 of unit size, orthogonalized in turn (Gram and Schmidt,
each twice). That is a dense system. A large cell, whose G is a band, is spared it where the elimination of G with all
guides held finds no small pivot: then no guide depends on others.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Flags, Integers, Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import (
    ELIMINATION,
    RANK_TOLERANCE,
    solve_in_place,
)
from stiction.reference_impl.compiled.loops import product, subtract, taken
from stiction.reference_impl.friction.coulomb import sticks
from stiction.reference_impl.multibody.banded_systems import cell_of, count_cells, fill_cell
from stiction.reference_impl.multibody.dynamics import largest_speed, roots_of_mobility, unit_rows
from stiction.reference_impl.multibody.guide_freedom import FREE
from stiction.reference_impl.multibody.mechanism import NO_LAW, Arrays, Workspace

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

    `held`: the guides at rest; those that are found are added. `speed`: the largest so far, m/s. `v`: velocities; where
    guides rest together they are brought onto the constraints and to rest in the guides that are held. The change is
    the least in the kinetic metric. Returns whether guides rest together: more are at rest than there were freedoms to
    hold. The workspace is filled by `dynamics.row_form`.
    """
    any_rest_together = False
    for c in range(count_cells(m)):
        own_m, own_w, guides = cell_of(m, w, c)
        own_held = taken(held, guides)
        if not _are_independent(own_m, own_w) and _rest_together(own_m, own_w, own_held, speed, v):
            any_rest_together = True
            for i in range(len(guides)):
                held[guides[i]] = own_held[i]
    return any_rest_together


@kernel(allocates=True)
def _rest_together(m: Arrays, w: Workspace, held: Flags, speed: float, v: Reals) -> bool:
    """Variant of `rest_together` for one cell."""
    # An orthogonal basis of the rows of constraints and of guides that are held: `count` rows with the numbers `basis`.
    # `rate` is what v violates each of them by; it goes through the orthogonalization with its row.
    row, size = unit_rows(m, w, m.rows + len(m.friction), roots_of_mobility(m))
    rate = np.zeros(len(row))
    basis, count = np.zeros(len(row), dtype=np.int64), 0
    admitted = np.zeros(len(row), dtype=np.bool_)
    for r in range(len(row)):
        if r >= m.rows:
            violation = w.slip_speed[r - m.rows]
        else:
            violation = w.phi_dot[m.origin[r] if len(m.origin) else r]
        rate[r] = violation / size[r]
        is_held = r < m.rows or held[r - m.rows] and m.friction[r - m.rows].freedom == FREE
        if is_held and _left(row, rate, basis, count, r) > DEPENDENT:
            _admit(row, rate, basis, count, r)
            count += 1
            admitted[r] = True

    # guides that depend on the basis rest with it, unless drives move them; more rest then than there were freedoms
    rests, several = np.zeros(len(held), dtype=np.bool_), False
    for f in range(len(m.friction)):
        t = m.rows + f
        if m.friction[f].freedom != FREE:
            continue  # joints or drives decide whether it rests
        if not held[f]:
            rests[f] = (
                _left(row, rate, basis, count, t) <= DEPENDENT
                and abs(rate[t]) * size[t] <= DRIVEN * speed
            )
        several = several or rests[f] or held[f] and not admitted[t]

    # the least change of the velocities that meets all rows of the basis; a large one would stop what goes on moving
    change = np.zeros(len(v))
    for i in range(len(v)):
        for k in range(count):
            change[i] -= np.sqrt(m.inverse_mass[i]) * row[basis[k], i] * rate[basis[k]]
    if not several or largest_speed(m, change) > STOPPED * speed:
        return False
    subtract(-1.0, change, v)
    for f in range(len(held)):
        held[f] = held[f] or rests[f]
    return True


@kernel(allocates=True)
def leave_together(
    m: Arrays, w: Workspace, direction: Integers, firmness: Reals, slip: Integers
) -> None:
    """Let guides at rest slip, and with each of them those at rest without which it cannot move.

    `direction`: 1 or -1 for a guide that leaves, 0 for any other. `firmness`: how far each guide at rest is from
    leaving, in any unit: where one could move with either of several others, those that are held less firmly leave.
    `slip`, 0 at rest, is changed in place.
    """
    for c in range(count_cells(m)):
        own_m, own_w, guides = cell_of(m, w, c)
        own_slip = taken(slip, guides)
        looked, independent = False, False  # the rank is decided once for a cell, if it is needed
        for f in range(len(guides)):
            leaves = direction[guides[f]]
            if leaves == 0 or not sticks(own_m, own_slip, f):
                continue
            own_slip[f] = leaves
            if len(guides) == 1 or own_m.friction[f].law != NO_LAW:
                continue  # there is none to take along
            if not looked:
                looked = True
                independent = _are_independent(own_m, own_w)
            if not independent:
                _take_along(own_m, own_w, f, leaves, taken(firmness, guides), own_slip)
        for i in range(len(guides)):
            slip[guides[i]] = own_slip[i]


@kernel(allocates=True)
def _take_along(
    m: Arrays, w: Workspace, guide: int, direction: int, firmness: Reals, slip: Integers
) -> None:
    """Let those guides at rest slip without which a guide of their cell cannot."""
    row, _ = unit_rows(m, w, m.rows + len(m.friction), roots_of_mobility(m))
    rate = np.zeros(len(row))
    basis, count = np.zeros(len(row), dtype=np.int64), 0
    t = m.rows + guide
    for f in range(len(m.friction)):
        along = product(row[t], row[m.rows + f])
        is_joint = m.friction[f].law == NO_LAW
        if is_joint and sticks(m, slip, f) and along * along >= 1.0 - RANK_TOLERANCE:
            # on one line, as where a drive moves both
            slip[f] = direction if along > 0.0 else -direction

    # what of the guide's direction the constraints leave free
    for r in range(m.rows):
        if _left(row, rate, basis, count, r) > DEPENDENT:
            _admit(row, rate, basis, count, r)
            count += 1
    if _left(row, rate, basis, count, t) <= DEPENDENT:
        return  # it moves as drives move it, by none of the freedoms

    # Other guides at rest join the basis one by one, the most firmly held first, as long as they leave some of that
    # direction free. One that would take all of it slips with the guide.
    free = row[t].copy()
    tried = np.zeros(len(slip), dtype=np.bool_)
    for _ in range(len(slip)):
        f = -1
        for other in range(len(slip)):
            is_joint = m.friction[other].law == NO_LAW
            if not is_joint or not sticks(m, slip, other) or tried[other]:
                continue
            if f < 0 or firmness[other] > firmness[f]:
                f = other
        if f < 0:
            return
        tried[f] = True
        r = m.rows + f
        if _left(row, rate, basis, count, r) <= DEPENDENT:
            continue
        _admit(row, rate, basis, count, r)
        along, before = product(row[r], free), product(free, free)
        subtract(along, row[r], free)
        if product(free, free) > DEPENDENT**2 * before:
            count += 1
        else:
            subtract(-along, row[r], free)
            slip[f] = direction if along > 0.0 else -direction


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


@kernel
def _left(row, rate, basis, count, r):
    """Take out of a row, and of its rate, the parts along the basis; returns the length that is left."""
    for _ in range(2):
        for k in range(count):
            part = product(row[basis[k]], row[r])
            subtract(part, row[basis[k]], row[r])
            rate[r] -= part * rate[basis[k]]
    return np.sqrt(product(row[r], row[r]))


@kernel
def _admit(row, rate, basis, count, r):
    """Make a row that is orthogonal to the basis its next member, of unit size."""
    length = np.sqrt(product(row[r], row[r]))
    for i in range(row.shape[1]):
        row[r, i] /= length
    rate[r] /= length
    basis[count] = r
