"""Uniqueness of the contact forces at an instant, compiled; and the number of solutions, for small mechanisms.

The friction of a slipping guide is f = -mu d (|n1| + |n2|) = -mu d max(|R|, |D|), D = n2 - n1 = (2/a)(T + (b/2) mu d
R), and R and T are linear in the frictions of all guides. Where the gain

    max over guides i of  mu_i sum over slipping guides j of  max(|dR_i/df_j|, |dD_i/df_j|)

is below 1 the frictions are the fixed point of a contraction, so that they exist and are unique whatever the loads. For
one slipping guide that is necessary too: beyond, some loads have two solutions and others none (Painleve). There the
contact modes are counted. A guide at rest adds its static coefficient, with both directions of slip in view.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, at
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import eliminate_columns
from stiction.reference_impl.compiled.loops import taken
from stiction.reference_impl.friction.coulomb import normal_load
from stiction.reference_impl.friction.enumeration import LIMIT, TOO_MANY, solutions
from stiction.reference_impl.friction.hlcp import COMPLIANCE
from stiction.reference_impl.multibody.banded_systems import fill_cell, fill_cell_of, friction_row, guides_of
from stiction.reference_impl.multibody.kinematics import Workspace
from stiction.reference_impl.multibody.mechanism import NO_GUIDE, Arrays, Mechanism

COUNTED = 1000
"""Contact modes up to which solutions are counted on the way: three guides at rest, four that slip. Beyond, an
integration does not know whether its solution is the only one."""


@kernel
def friction_gain(m: Arrays, w: Workspace, slip: Integers, released: bool) -> tuple[float, int]:
    """Largest gain of the rows in the workspace (`dynamics.row_form`), and its guide, or NO_GUIDE.

    Parameters
    ----------
    slip : ndarray of int, shape (frictional,)
        Directions; 0 at rest.
    released : bool
        Both directions of a guide at rest are considered, with the static coefficient. Otherwise its slip stays zero by
        whatever friction this takes.
    """
    worst, where = 0.0, NO_GUIDE
    if not (_respond(m, w, slip, released, 0.0) or _respond(m, w, slip, released, COMPLIANCE)):
        return worst, where
    for f in range(len(m.friction)):
        if slip[f] == 0 and not released:
            continue
        guide = m.friction[f]
        normal, moment = (m.position[guide.row],
                          m.position[guide.row + 1]) if len(m.cell) else (guide.row, guide.row + 1)
        mu = guide.mu if slip[f] != 0 else guide.mus
        gain, column = 0.0, 0
        for j in range(len(m.friction)):
            if slip[j] == 0 and not released:
                continue
            R, T = w.response[normal, column], w.response[moment, column]
            load = normal_load(guide, R, T, -mu if slip[f] >= 0 else mu)
            if slip[f] == 0:
                load = max(load, normal_load(guide, R, T, mu))
            gain += mu * load
            column += 1
        if where == NO_GUIDE or gain > worst:
            worst, where = gain, f
    return worst, where


@kernel
def _respond(m, w, slip, released, compliance):
    """Change of the forces of the constraint rows per unit of friction on each guide that slips, into w.response.

    Returns True where the system is regular.
    """
    nr, nf, G = m.rows, len(m.friction), w.G
    if len(m.cell):
        return _respond_banded(m, w, slip, released, compliance)
    n, columns = nr, 0
    for r in range(nr):
        for c in range(nr):
            w.A[r, c] = G[r, c]
        w.A[r, r] += compliance * G[r, r]
    for f in range(nf):
        if slip[f] != 0 or released:
            continue
        for r in range(nr):
            w.A[r, n], w.A[n, r] = G[r, nr + f], G[nr + f, r]
        k = nr
        for other in range(f + 1):
            if slip[other] == 0:
                w.A[n, k], w.A[k, n] = G[nr + f, nr + other], G[nr + other, nr + f]
                k += 1
        n += 1
    for j in range(nf):
        if slip[j] == 0 and not released:
            continue
        k = nr
        for r in range(nr):
            w.response[r, columns] = -G[r, nr + j]
        for f in range(nf):
            if slip[f] == 0 and not released:
                w.response[k, columns] = -G[nr + f, nr + j]
                k += 1
        columns += 1
    return eliminate_columns(w.A, w.response, n, columns, n)


@kernel
def _respond_banded(m: Arrays, w: Workspace, slip: Integers, released: bool, compliance: float) -> bool:
    """Variant of `_respond` for a large mechanism of one cell, rows in its order."""
    size, band, columns = m.rows + len(m.friction), m.cell[0].band, 0
    fill_cell(m, w, 0, band, w.A)
    for r in range(m.rows):
        place = m.position[r]
        w.A[place, place] *= 1.0 + compliance
    for f in range(len(m.friction)):
        if slip[f] != 0 or released:
            friction_row(m, w, w.A, f, size, band, 0.0, 0.0)
            t = m.rows + f
            for r in range(size):
                w.response[r, columns] = 0.0
            w.response[m.position[t], columns] = w.G[t, t]
            columns += 1
    return eliminate_columns(w.A, w.response, size, columns, band)


@kernel
def gain_of_mode(m: Arrays, w: Workspace, slip: Integers) -> tuple[float, int]:
    """The gain with the guides at rest held there, and if there are any, that without: the larger, and its guide.

    0 and NO_GUIDE without friction.
    """
    if len(m.friction) == 0:
        return 0.0, NO_GUIDE
    return _gain_of_cell(m, w, slip) if len(m.cell) < 2 else _gain_of_cells(m, w, slip)


@kernel(allocates=True)
def _gain_of_cells(m: Arrays, w: Workspace, slip: Integers) -> tuple[float, int]:
    worst, where = 0.0, NO_GUIDE
    for c in range(len(m.cell)):
        fill_cell_of(m, w, c)
        own_m, own_w = at(m.separate[c], m), at(w.separate[c], w)
        guides = guides_of(m, own_m)
        if len(guides):
            gain, guide = _gain_of_cell(own_m, own_w, taken(slip, guides))
            if where == NO_GUIDE or gain > worst:
                worst, where = gain, guides[guide] if guide != NO_GUIDE else guide
    return worst, where


@kernel
def _gain_of_cell(m: Arrays, w: Workspace, slip: Integers) -> tuple[float, int]:
    worst, where = friction_gain(m, w, slip, False)
    for f in range(len(slip)):
        if slip[f] == 0:
            released, guide = friction_gain(m, w, slip, True)
            return (released, guide) if released > worst else (worst, where)
    return worst, where


@kernel
def has_several(m: Arrays, w: Workspace, slip: Integers) -> bool:
    """Return True where more than one motion is known to follow from the rows in the workspace; `slip` 0: at rest."""
    return _cell_has_several(m, w, slip) if len(m.cell) < 2 else _cells_have_several(m, w, slip)


@kernel(allocates=True)
def _cells_have_several(m: Arrays, w: Workspace, slip: Integers) -> bool:
    for c in range(len(m.cell)):
        fill_cell_of(m, w, c)
        own_m, own_w = at(m.separate[c], m), at(w.separate[c], w)
        guides = guides_of(m, own_m)
        if len(guides) and _cell_has_several(own_m, own_w, taken(slip, guides)):
            return True
    return False


@kernel(allocates=True)
def _cell_has_several(m: Arrays, w: Workspace, slip: Integers) -> bool:
    gain, _ = _gain_of_cell(m, w, slip)
    if gain < 1.0:
        return False
    forces, directions = np.zeros((2, len(w.force))), np.zeros((2, len(slip)), dtype=np.int64)
    stuck = np.zeros(len(slip), dtype=np.bool_)
    for f in range(len(slip)):
        stuck[f] = slip[f] == 0
    return solutions(m, w, slip, stuck, forces, directions, 0.0, COUNTED) > 1


def number_of_solutions(mechanism: Mechanism, w, slip: np.ndarray, limit: int = LIMIT) -> int:
    """Number of motions that can follow from the rows in a workspace.

    The product over the cells that can have more than one.

    Raises
    ------
    ValueError
        If a cell has more than `limit` contact modes.
    """
    m, total = mechanism.arrays, 1
    if len(m.cell) < 2:
        return len(_every_solution(mechanism, m, w, slip, limit)[0])
    for c in range(len(m.cell)):
        fill_cell_of(m, w, c)
        own_m, own_w = m.separate[c], w.separate[c]
        guides = guides_of(m, own_m)
        if len(guides) and gain_of_mode(own_m, own_w, slip[guides])[0] >= 1.0:
            total *= len(_every_solution(mechanism, own_m, own_w, slip[guides], limit)[0])
    return total


def _every_solution(mechanism: Mechanism, m, w, slip: np.ndarray, limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Row forces and directions of all solutions."""
    room = 16
    while True:
        forces, directions = np.zeros((room, len(w.force))), np.zeros((room, len(slip)), dtype=np.int64)
        found = solutions(m, w, slip, slip == 0, forces, directions, 0.0, limit)
        if found == TOO_MANY:
            raise ValueError(f"{mechanism.scene.name}: {len(slip)} frictional guides have more than {limit} contact "
                             "modes; "
                             "expected a smaller mechanism")
        if found < room:
            return forces[:found], directions[:found]
        room *= 4
