"""The contact mode that follows: the answer of a contact solver, made definite, compiled.

The contact problem is solved with the static coefficient for every guide at rest (the set H). A guide whose solution
has an acceleration leaves H in that direction; with mus > mu its friction drops to the kinetic one, which may set
others free. The problem is solved again until no guide leaves. An answer that is not the only one is not accepted, nor
that a guide leaves H that may as well jam there (`coulomb.can_jam`).
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Flags, Integers, IntegerTable, Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy, taken, taken_rows
from stiction.reference_impl.friction.contact_solvers import solve_contact
from stiction.reference_impl.friction.coulomb import can_jam, sticks
from stiction.reference_impl.friction.driven_guides import follow_drives
from stiction.reference_impl.friction.frozen_mode import margin, solve_mode
from stiction.reference_impl.friction.guides_at_rest import leave_together
from stiction.reference_impl.friction.outcomes import JAM, SEVERAL, SOLVED
from stiction.reference_impl.friction.shared_rest import margins_of_safest
from stiction.reference_impl.friction.uniqueness import has_several
from stiction.reference_impl.multibody.banded_systems import cell_of, count_cells, forces_of_cell
from stiction.reference_impl.multibody.dynamics import largest_force, row_acceleration, row_form
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

HOLDS, LEAVES = np.inf, -1.0
"""Rest speeds of a guide that is at rest whatever its slip speed, and of one that leaves rest at this instant."""
RESTS = 1e-6
"""Least margin of a rest, relative to the largest force, from which on it is one of several motions: at the event that
ends a rest its margin is zero, but for the rounding of redundant rows."""
MOST_AT_REST = 4
"""Guides of a cell at rest up to which other modes are looked for: 80 contact problems."""


@kernel(allocates=True)
def choose_mode(
    m: Arrays,
    w: Workspace,
    t: float,
    q: Reals,
    v: Reals,
    slip: Integers,
    corner: IntegerTable,
    rest_speed: Reals,
) -> int:
    """Decide stick or slip and the corners' signs at (t, q, v), in place.

    `slip` receives the directions, and is read for a guide that has just broken away. `corner`, of two columns or more:
    the corners' signs, before, and on return after. `rest_speed`: slip speed (m/s) up to which a guide is at rest;
    HOLDS; or LEAVES, in the direction `slip`. Returns the outcome: the solver's (`outcomes`), or SEVERAL, or JAM.
    """
    # The set H of guides at rest, and the directions of the others. A guide that has just broken away has no speed yet,
    # and keeps its direction.
    row_form(m, w, t, q, v)
    for f in range(len(slip)):
        if abs(w.slip_speed[f]) <= rest_speed[f]:
            slip[f] = 0
        elif rest_speed[f] != LEAVES:
            slip[f] = 1 if w.slip_speed[f] > 0.0 else -1
    if m.unfree > 0:
        follow_drives(m, w, slip)

    # cells do not act on each other's forces: each is a contact problem of its own, and far cheaper than all together
    for c in range(count_cells(m)):
        own_m, own_w, guides = cell_of(m, w, c)
        if not len(guides):
            continue
        own_slip, own_corner = taken(slip, guides), taken_rows(corner, guides)
        outcome = _settle(own_m, own_w, own_slip, own_corner)
        for i in range(len(guides)):
            slip[guides[i]] = own_slip[i]
            copy(own_corner[i], corner[guides[i]])
        forces_of_cell(m, w, own_m, own_w)
        if outcome != SOLVED:
            return outcome
    return SOLVED


@kernel(allocates=True)
def _settle(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable) -> int:
    """Settle the modes of the guides of one cell, in place: solve, let guides leave H, and solve again until none does.

    H only loses guides, so that there are nf + 1 rounds at most.
    """
    nf = len(m.friction)
    accelerate = np.zeros(nf)  # of guides at rest, m/s^2
    firmness = np.zeros(nf)
    direction = np.zeros(nf, dtype=np.int64)
    for _ in range(nf + 1):
        outcome, rest = solve_contact(m, w, slip, corner, accelerate)
        if outcome != SOLVED:
            return outcome
        if has_several(m, w, slip):
            return SEVERAL

        # guides that accelerate leave H: from now on their friction is kinetic
        leaving = False
        for f in range(nf):
            firmness[f] = -abs(accelerate[f])
            direction[f] = 0
            if sticks(m, slip, f) and abs(accelerate[f]) > rest:
                if can_jam(m, f):
                    return JAM
                leaving = True
                direction[f] = 1 if accelerate[f] > 0.0 else -1
        if not leaving:
            return SOLVED

        # a solution in which guides leave is not the only one if they could also share the load and stay
        if nf > 1 and m.loaded > 0 and _may_rest_as_well(m, w, slip, corner):
            return SEVERAL
        leave_together(m, w, direction, firmness, slip)
    return SOLVED


@kernel(allocates=True)
def _may_rest_as_well(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable) -> bool:
    """Return True where guides that share a load could all stay at rest, though a solution has some of them leave.

    A count of solutions (`uniqueness`) does not have this one: the linear system of guides that share a load is
    singular. Nor does a friction gain below 1 exclude it: that shows the frictions of guides that slip to be unique.
    """
    guides_at_rest = 0
    for f in range(len(slip)):
        guides_at_rest += 1 if sticks(m, slip, f) else 0
    if guides_at_rest < 2:
        return False

    # the smallest margin of all guides, with those that share a load in the safest share; a singular system alone does
    # not tell that guides share, as redundant joints make one too
    solution = w.force.copy()
    is_singular = not solve_mode(m, w, slip, corner)
    any_shares, least = False, np.inf
    if is_singular:
        margins = np.zeros((len(slip), 2))
        margins_of_safest(m, w, slip, corner, margins)
        for f in range(len(slip)):
            if not sticks(m, slip, f):
                continue
            if np.isnan(margins[f, 0]):
                _, own_margin = margin(m, w, slip, f)
                least = min(least, own_margin)
            else:
                least = min(least, margins[f, 0], margins[f, 1])
                any_shares = True
    largest = largest_force(m, w, solution)
    copy(solution, w.force)

    # all could stay if that margin is positive, by more than rounding, for the units of every guide's rows
    for f in range(len(slip)):
        unit = m.friction[f].unit
        if not least > RESTS * largest / np.sqrt(w.G[unit, unit]):
            return False
    return any_shares


@kernel(allocates=True)
def other_modes(m: Arrays, w: Workspace, resting: Flags, slip: Integers) -> int:
    """Count the other contact modes that obey the law of two coefficients where not all guides can rest.

    Each guide that was at rest (`resting`) may stay, with the static coefficient. It may leave in either direction,
    with the kinetic one, if it then accelerates that way. Where several guides are at rest, each of two may be the one
    whose departure relieves the other. `choose_mode` takes what follows from the static coefficients of all (Zhuang &
    Wang, Sect. 3), the mode `slip`; this tells where another choice was possible. It is 0 as well where more than
    MOST_AT_REST guides of a cell are at rest. The row forces of the workspace are changed.
    """
    count = 0
    for c in range(count_cells(m)):
        own_m, own_w, guides = cell_of(m, w, c)
        count += _other_modes(own_m, own_w, taken(resting, guides), taken(slip, guides))
    return count


@kernel(allocates=True)
def _other_modes(m: Arrays, w: Workspace, resting: Flags, slip: Integers) -> int:
    """Variant of `other_modes` for one cell."""
    nf = len(m.friction)

    # there is a choice only where one of several guides at rest leaves, and its friction drops as it does
    count, modes = 0, 1
    any_leaves, any_drops = False, False
    for f in range(nf):
        if resting[f]:
            count += 1
            modes *= 3
            any_leaves = any_leaves or slip[f] != 0
            guide = m.friction[f]
            any_drops = any_drops or guide.mus > guide.mu or guide.static_bound > guide.bound
    if not (any_leaves and any_drops and 2 <= count <= MOST_AT_REST):
        return 0

    other, accelerate = slip.copy(), np.zeros(nf)
    corner = np.ones((nf, 2), dtype=np.int64)
    consistent_modes = 0
    for mode in range(modes):
        # the digits of the mode's number to base 3 are the directions -1, 0, 1 of the guides that were at rest
        digits = mode
        any_moves, is_chosen = False, True
        for f in range(nf):
            if resting[f]:
                other[f] = digits % 3 - 1
                digits //= 3
                any_moves = any_moves or other[f] != 0
                is_chosen = is_chosen and other[f] == slip[f]
        if is_chosen or not any_moves:
            continue

        # it is consistent if guides that leave accelerate in their directions, and the others do not accelerate
        outcome, rest = solve_contact(m, w, other, corner, accelerate)
        consistent = outcome == SOLVED
        for f in range(nf):
            if resting[f] and other[f] != 0:
                accelerate[f] = row_acceleration(w, m.rows + f, w.force)
                consistent = consistent and other[f] * accelerate[f] > rest
            elif resting[f]:
                consistent = consistent and abs(accelerate[f]) <= rest
        consistent_modes += consistent
    return consistent_modes
