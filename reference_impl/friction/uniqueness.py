"""Uniqueness of the contact forces at an instant, compiled; and the number of solutions, for small mechanisms.

The friction of a slipping guide is f = -mu d (|n1| + |n2|) = -mu d max(|R|, |D|), D = n2 - n1 = (2/a)(T + (b/2) mu d
R), and R and T are linear in the frictions of all guides. Where the gain

    max over guides i of  mu_i sum over slipping guides j of  max(|dR_i/df_j|, |dD_i/df_j|)

is below 1 the frictions are the fixed point of a contraction. So they exist and are unique whatever the loads. For one
slipping guide that is necessary too: beyond, some loads have two solutions and others none (Painleve). There the
contact modes are counted. A guide at rest adds its static coefficient, with both directions of slip in view.

The load of a pin is the size of the force in it, a norm as well: it counts with its mu r and the sizes of the changes
of its force. As frictions of pins and guides have no unit in common, a mechanism with such pins has the gain of the
loads N_i, which are the fixed point of a map as well,

    max over i of  sum over j of  mu_j |dN_i/df_j| ,    mu_j f_j the frictions by unit load, mu r of a pin,

and where it is below 1 there is one solution.

Where no friction depends on a load, the gain is zero. Friction with constant bounds is convex: the accelerations
minimize the sum of Gauss' constraint (1/2) |a - M^-1 Q|_M^2 and of static_i |g_i''| over the guides at rest, on the
accelerations that the constraints admit, a strictly convex problem. So they exist and are unique for any number of
guides, and nothing is counted.

The contraction is for given directions of slip. Guides at rest that share a load may all stay although a solution has
some of them leave: `mode_choice` looks for that rest by its margins.
"""

from __future__ import annotations

from math import hypot

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import eliminate_columns
from stiction.reference_impl.compiled.loops import taken
from stiction.reference_impl.friction.coulomb import normal_load, sticks
from stiction.reference_impl.friction.enumeration import TOO_MANY, solutions
from stiction.reference_impl.friction.frozen_mode import held_rows
from stiction.reference_impl.friction.hlcp import COMPLIANCE
from stiction.reference_impl.multibody.banded_systems import (
    cell_of,
    count_cells,
    fill_cell,
    friction_row,
    open_cell,
)
from stiction.reference_impl.multibody.mechanism import NO_GUIDE, Arrays, Workspace

COUNTED = 1000
"""Contact modes up to which solutions are counted on the way: three guides at rest, four that slip. Beyond, an
integration does not know whether its solution is the only one."""


@kernel
def friction_gain(m: Arrays, w: Workspace, slip: Integers, released: bool) -> tuple[float, int]:
    """Largest gain of the rows in the workspace (`dynamics.row_form`), and its guide, or NO_GUIDE.

    `released`: both directions of a guide at rest, of `slip` 0, are considered, with the static coefficient. Otherwise
    its slip stays zero by whatever friction this takes.
    """
    worst, where = 0.0, NO_GUIDE
    if not (_respond(m, w, slip, released, 0.0) or _respond(m, w, slip, released, COMPLIANCE)):
        return worst, where
    for f in range(len(m.friction)):
        if not _may_slip(m, slip, f, released):
            continue
        guide = m.friction[f]
        normal, moment = guide.row, guide.row + 1
        if len(m.cell):
            normal, moment = m.position[normal], m.position[moment]
        mu = guide.mu if slip[f] != 0 else guide.mus
        is_pin = guide.pin_mus > 0.0
        gain, column = 0.0, 0
        for j in range(len(m.friction)):
            has_load = guide.corners > 0 or is_pin
            if not has_load or not _may_slip(m, slip, j, released):
                continue  # a constant bound has no gain
            R, T = w.response[normal, column], w.response[moment, column]
            load = hypot(R, T)
            if not is_pin:
                load = normal_load(guide, R, T, -mu if slip[f] >= 0 else mu)
            if slip[f] == 0 and not is_pin:
                load = max(load, normal_load(guide, R, T, mu))
            # by frictions, which mu of this guide makes of the change of its load; or by loads, see the docstring
            gain += mu * load if m.pins == 0 else _load_coefficient(m, slip, j) * load
            column += 1
        if m.pins > 0 and _load_coefficient(m, slip, f) == 0.0:
            gain = 0.0
        if where == NO_GUIDE or gain > worst:
            worst, where = gain, f
    return worst, where


@kernel
def _load_coefficient(m, slip, f):
    """Return the friction of a joint per unit of its load: mu of a guide, mu r / L of a pin; static ones at rest."""
    if slip[f] != 0:
        return m.friction[f].mu + m.friction[f].pin_mu
    return m.friction[f].mus + m.friction[f].pin_mus


@kernel
def _may_slip(m, slip, f, released):
    """Return True for a guide whose friction follows its load: one that slips or, if `released`, sticks."""
    return slip[f] != 0 or released and sticks(m, slip, f)


@kernel
def _respond(m, w, slip, released, compliance):
    """Change of the forces of the constraint rows per unit of friction on each guide that slips, into w.response.

    Returns True where the system is regular.
    """
    if len(m.cell):
        return _respond_banded(m, w, slip, released, compliance)
    n, columns = held_rows(m, w, slip, released), 0
    for r in range(m.rows):
        w.A[r, r] += compliance * w.G[r, r]
    for j in range(len(m.friction)):
        if _may_slip(m, slip, j, released):
            for i in range(n):
                w.response[i, columns] = -w.G[w.held[i], m.rows + j]
            columns += 1
    return eliminate_columns(w.A, w.response, n, columns, n)


@kernel
def _respond_banded(
    m: Arrays, w: Workspace, slip: Integers, released: bool, compliance: float
) -> bool:
    """Variant of `_respond` for a large mechanism of one cell, rows in its order."""
    size, band, columns = m.rows + len(m.friction), m.cell[0].band, 0
    fill_cell(m, w, 0, band, w.A)
    for r in range(m.rows):
        place = m.position[r]
        w.A[place, place] *= 1.0 + compliance
    for f in range(len(m.friction)):
        if not sticks(m, slip, f) or released:
            friction_row(m, w, w.A, f, size, band, 0.0, 0.0)
        if _may_slip(m, slip, f, released):
            t = m.rows + f
            for r in range(size):
                w.response[r, columns] = 0.0
            w.response[m.position[t], columns] = w.G[t, t]
            columns += 1
    return eliminate_columns(w.A, w.response, size, columns, band)


@kernel(allocates=True)
def gain_of_mode(m: Arrays, w: Workspace, slip: Integers) -> tuple[float, int]:
    """The gain with the guides at rest held there, and if there are any, that without: the larger, and its guide.

    0 and NO_GUIDE without friction that depends on a load.
    """
    worst, where = 0.0, NO_GUIDE
    if m.loaded == 0:
        return worst, where
    for c in range(count_cells(m)):
        own_m, own_w, guides = cell_of(m, w, c)
        own_slip, ways = taken(slip, guides), min(1, len(guides))
        for f in range(len(guides)):
            ways = 2 if sticks(own_m, own_slip, f) else ways
        for way in range(ways):  # guides at rest are held, then released
            gain, guide = friction_gain(own_m, own_w, own_slip, way == 1)
            if gain > worst or where == NO_GUIDE and guide != NO_GUIDE and way == 0:
                worst, where = gain, guides[guide]
    return worst, where


@kernel(allocates=True)
def has_several(m: Arrays, w: Workspace, slip: Integers) -> bool:
    """Return True where more than one motion is known to follow from the rows in the workspace; `slip` 0: at rest."""
    for c in range(count_cells(m)):
        own_m, own_w, guides = cell_of(m, w, c)
        if _count(own_m, own_w, taken(slip, guides), 2) > 1:
            return True
    return False


def number_of_solutions(m: Arrays, w: Workspace, slip: np.ndarray) -> int:
    """Number of motions that can follow from the rows in a workspace: the product over the cells that are counted."""
    total = 1
    for c in range(count_cells(m)):
        guides = open_cell(m, w, c)
        own_m, own_w = (m.separate[c], w.separate[c]) if m.separate else (m, w)
        count = _count(own_m, own_w, slip[guides], COUNTED)
        total *= count if count != TOO_MANY else 1
    return total


@kernel(allocates=True)
def _count(m: Arrays, w: Workspace, slip: Integers, most: int) -> int:
    """Solutions of a cell, up to `most`; 1 where its gain shows that there is one, TOO_MANY if the modes are.

    With pins under load and a gain of 1 or more they cannot be counted by linear systems: it is then `most`.
    """
    if gain_of_mode(m, w, slip)[0] < 1.0:
        return 1
    if m.pins > 0:
        return most
    forces, directions = np.zeros((most, len(w.force))), np.zeros((most, len(slip)), dtype=np.int64)
    return solutions(m, w, slip, forces, directions, 0.0, COUNTED)
