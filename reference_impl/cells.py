"""The structure of a large mechanism's linear systems, compiled.

A cell is a set of bodies that joints and drives connect. Springs act between cells, but no row does: G is block diagonal, and
the contact problems of different cells are separate. Within a cell the rows are put into an order (reverse Cuthill-McKee)
in which G is a band; the tangential rows stand among them. A system of a cell has all of its rows: the equation of the
tangential row of a guide that slips is its law of friction, of any other the guide's motion.

A mechanism of few rows has no cells (`mechanism.DENSE`) and is solved as one dense system.
"""

from __future__ import annotations

import numpy as np
from reference_impl.compiling import kernel

from reference_impl.kinematics import Workspace
from reference_impl.linear_algebra import ELIMINATION, eliminate_banded
from reference_impl.mechanism import DENSE, Arrays

FIRST, END, BAND, FIRST_ENTRY, END_ENTRY, FIRST_BLOCK, END_BLOCK, FIELDS = range(8)
"""What `Arrays.structure` says of a cell: the places of its rows in the order (the first and the one behind the last), half the
bandwidth, the places of its entries of G and of its blocks."""


@kernel
def number_of_cells(m):
    return m.structure[0] if len(m.structure) else 0


@kernel
def cell(m, c, field):
    return m.structure[1 + FIELDS * c + field]


@kernel
def ordered(m, k):
    """The row at a place in the order."""
    return m.structure[1 + FIELDS * m.structure[0] + k]


@kernel
def position(m, r):
    """The place of a row in its cell."""
    return m.structure[1 + FIELDS * m.structure[0] + m.rows + len(m.friction) + r]


@kernel
def entry(m, e):
    """Row and column of an entry of G that is not zero."""
    place = 1 + FIELDS * m.structure[0] + 2 * (m.rows + len(m.friction) + e)
    return m.structure[place], m.structure[place + 1]


@kernel
def fill_cell(m, w, c, reach, A):
    """G of a cell into the leading part of A, zero elsewhere within `reach` of the diagonal; returns the number of rows."""
    n = cell(m, c, END) - cell(m, c, FIRST)
    for i in range(n):
        for j in range(max(0, i - reach), min(n, i + reach + 1)):
            A[i, j] = 0.0
    for e in range(cell(m, c, FIRST_ENTRY), cell(m, c, END_ENTRY)):
        r, s = entry(m, e)
        A[position(m, r), position(m, s)] = w.G[r, s]
    return n


@kernel
def friction_row(m, w, A, f, n, reach, c_R, c_T):
    """Make the equation of a tangential row friction - c_R R - c_T T = .., in units of its entry of G, in place."""
    t, normal = m.rows + f, m.friction[f].row
    i, unit = position(m, t), w.G[t, t]
    for j in range(max(0, i - reach), min(n, i + reach + 1)):
        A[i, j] = 0.0
    A[i, position(m, normal)], A[i, position(m, normal + 1)] = -c_R * unit, -c_T * unit
    A[i, i] = unit


@kernel
def solve_bilateral(m, w, c, residual):
    """Forces of the constraint rows of a cell that change Phi'' by `residual`, without friction, into w.force; whether regular."""
    band = cell(m, c, BAND)
    n = fill_cell(m, w, c, band, w.A)
    for k in range(n):
        r = ordered(m, cell(m, c, FIRST) + k)
        w.x[k] = residual[r] if r < m.rows else 0.0
        if r >= m.rows:
            friction_row(m, w, w.A, r - m.rows, n, band, 0.0, 0.0)
    regular = eliminate_banded(w.A, w.x, w.unit, n, band, ELIMINATION)
    for k in range(n):
        w.force[ordered(m, cell(m, c, FIRST) + k)] = w.x[k]
    return regular


@kernel(allocates=True)
def members(m, c):
    """Rows of a cell in increasing order, tangential rows last, and its frictional guides."""
    size = m.rows + len(m.friction)
    own = np.zeros(size, dtype=np.bool_)
    for k in range(cell(m, c, FIRST), cell(m, c, END)):
        own[ordered(m, k)] = True
    return np.flatnonzero(own), np.flatnonzero(own[m.rows:])


@kernel(allocates=True)
def cell_of(m, w, c):
    """A cell as a mechanism of its own, at the instant of the workspace, for everything that starts from its rows.

    Rows and guides are numbered within the cell, bodies as in the whole.

    Returns
    -------
    Arrays, Workspace
    """
    rows, guides = members(m, c)
    size, nf = len(rows), len(guides)
    local = np.zeros(len(w.force), dtype=np.int64)
    for i in range(size):
        local[rows[i]] = i
    friction = m.friction[:nf].copy()
    for i in range(nf):
        friction[i] = m.friction[guides[i]]
        friction[i].row = local[m.friction[guides[i]].row]
    block = m.block[cell(m, c, FIRST_BLOCK):cell(m, c, END_BLOCK)].copy()
    for b in range(len(block)):
        block[b, 1] = local[block[b, 1]]
    first, entries = cell(m, c, FIRST_ENTRY), cell(m, c, END_ENTRY) - cell(m, c, FIRST_ENTRY)
    structure = np.zeros(1 + FIELDS + 2 * (size + entries) if size > DENSE else 0, dtype=np.int64)
    if size > DENSE:
        structure[0], structure[1 + END], structure[1 + BAND] = 1, size, cell(m, c, BAND)
        structure[1 + END_ENTRY], structure[1 + END_BLOCK] = entries, len(block)
        for i in range(size):
            structure[1 + FIELDS + i] = local[ordered(m, cell(m, c, FIRST) + i)]
            structure[1 + FIELDS + size + i] = position(m, rows[i])
    G = np.zeros((size, size))
    for e in range(entries):
        r, s = entry(m, first + e)
        G[local[r], local[s]] = w.G[r, s]
        if size > DENSE:
            place = 1 + FIELDS + 2 * (size + e)
            structure[place], structure[place + 1] = local[r], local[s]
    arrays = Arrays(
        rows=size - nf, inverse_mass=m.inverse_mass, weight=m.weight, constraint=m.constraint[:0], friction=friction,
        spring=m.spring[:0], load=m.load[:0], law=m.law[:0], knots=m.knots[:0], block=block, pair=m.pair[:0],
        structure=structure, baumgarte_2alpha=m.baumgarte_2alpha, baumgarte_beta2=m.baumgarte_beta2,
        length_scale=m.length_scale)
    work = Workspace(
        rotation=w.rotation, J=w.J, JM=w.JM, phi=w.phi, phi_dot=w.phi_dot, gamma=w.gamma, slip=w.slip[guides], free=w.free, G=G,
        right=w.right[rows], A=np.zeros((size, size)), x=np.zeros(size), unit=np.zeros(2 * size),
        response=np.zeros((size, nf)), force=np.zeros(size), event=np.zeros(3 * nf), code=w.code)
    return arrays, work
