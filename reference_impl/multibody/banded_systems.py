"""The structure of a large mechanism's linear systems, compiled.

A cell is a set of bodies that joints and drives connect. Springs act between cells, but no row does: G is block
diagonal, and the contact problems of different cells are separate. Within a cell the rows are put into an order
(reverse Cuthill-McKee) in which G is a band; the tangential rows stand among them. A system of a cell has all of its
rows: the equation of the tangential row of a guide that slips is its law of friction, of any other the guide's motion.

A mechanism of few rows has no cells (`mechanism.DENSE`): it is solved as one dense system, and looked at as one cell.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, at
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import ELIMINATION, solve_in_place
from stiction.reference_impl.friction.coulomb import sticks
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace


@kernel
def fill_cell(m, w, c, reach, A):
    """Fill the leading part of A with G of a cell, and return its size.

    Other entries within `reach` of the diagonal become zero.
    """
    n = m.cell[c].end - m.cell[c].first
    for i in range(n):
        for j in range(max(0, i - reach), min(n, i + reach + 1)):
            A[i, j] = 0.0
    for e in range(m.cell[c].first_entry, m.cell[c].end_entry):
        r, s = m.entry[e, 0], m.entry[e, 1]
        A[m.position[r], m.position[s]] = w.G[r, s]
    return n


@kernel
def friction_row(m, w, A, f, n, reach, c_R, c_T):
    """Make the equation of a tangential row friction - c_R R - c_T T = .., in units of its entry of G, in place."""
    t, normal = m.rows + f, m.friction[f].row
    i, unit = m.position[t], w.G[t, t]
    for j in range(max(0, i - reach), min(n, i + reach + 1)):
        A[i, j] = 0.0
    A[i, m.position[normal]], A[i, m.position[normal + 1]] = -c_R * unit, -c_T * unit
    A[i, i] = unit


@kernel
def solve_cell(m, w, c, residual, rate, slip, holds):
    """Fill w.force with forces of a cell, without friction, that change Phi'' by `residual`.

    Returns False if the system of the cell is singular.

    If it `holds`, those of guides at rest change their slip by `rate` times the slip velocity.
    """
    band, first = m.cell[c].band, m.cell[c].first
    n = fill_cell(m, w, c, band, w.A)
    for k in range(n):
        r = m.order[first + k]
        f = r - m.rows
        w.x[k] = residual[r] if f < 0 else 0.0
        if f >= 0 and holds and sticks(m, slip, f):
            w.x[k] = rate * w.slip_speed[f]
        elif f >= 0:
            friction_row(m, w, w.A, f, n, band, 0.0, 0.0)
    regular = solve_in_place(w.A, w.x, w.unit, n, band, ELIMINATION)
    for k in range(n):
        w.force[m.order[first + k]] = w.x[k]
    return regular


@kernel
def count_cells(m):
    """Return the number of cells whose contact modes are chosen in turn.

    It is 1 for a mechanism of few rows, and 0 for one without friction.
    """
    return max(1, len(m.cell)) if len(m.friction) else 0


@kernel(allocates=True)
def cell_of(m, w, c):
    """Return cell c as a mechanism of its own, its workspace, and its guides in the whole.

    The workspace has G, `right` and slip speeds.
    """
    guides = open_cell(m, w, c)
    if len(m.cell) < 2:
        return m, w, guides
    return at(m.separate[c], m), at(w.separate[c], w), guides


@kernel
def forces_into_cell(m, w, own_m, own_w):
    """Hand the row forces of the whole to the workspace of a cell.

    Where the cell is the whole (`cell_of`) they are there. It may then be the cell of a larger mechanism, whose rows
    its `origin` names.
    """
    if len(m.cell) > 1:
        for r in range(len(own_m.origin)):
            own_w.force[r] = w.force[own_m.origin[r]]


@kernel
def forces_of_cell(m, w, own_m, own_w):
    """Take the row forces of a cell into those of the whole, as `forces_into_cell` hands them over."""
    if len(m.cell) > 1:
        for r in range(len(own_m.origin)):
            w.force[own_m.origin[r]] = own_w.force[r]


@kernel(allocates=True)
def open_cell(m: Arrays, w: Workspace, c: int) -> Integers:
    """Fill the workspace of a cell where there are several; returns its frictional guides.

    Coefficients of friction that depend on the state are handed over as well.
    """
    if len(m.cell) < 2:
        guides = np.empty(len(m.friction), dtype=np.int64)
        for f in range(len(guides)):
            guides[f] = f
        return guides
    own, work = at(m.separate[c], m), at(w.separate[c], w)
    guides = np.empty(len(own.friction), dtype=np.int64)
    for i in range(len(own.origin)):
        work.right[i] = w.right[own.origin[i]]
        for j in range(len(own.origin)):
            work.G[i, j] = w.G[own.origin[i], own.origin[j]]
    for f in range(len(guides)):
        guides[f] = own.origin[own.rows + f] - m.rows
        work.slip_speed[f] = w.slip_speed[guides[f]]
        if m.varying > 0:
            joint = m.friction[guides[f]]
            own.friction[f].mu = joint.mu
            own.friction[f].own_bound = joint.own_bound
            own.friction[f].pin_mu = joint.pin_mu
            own.friction[f].load = joint.load
            own.friction[f].bound = joint.bound
            own.friction[f].static_bound = joint.static_bound
    return guides
