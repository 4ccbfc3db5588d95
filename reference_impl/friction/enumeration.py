"""The solutions of the HLCP by trying all contact modes: complete, and exponential in the number of guides; compiled.

Lemke's method can end on a ray although a solution exists: the matrices of friction coupled over several guides are not
of a class for which it is known to find one. A solution of the HLCP is a direction (slip, or stick) of every guide and
a sign of every loaded corner. It is one where a linear solve for these gives forces with those signs.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, IntegerTable, Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import solve_in_place
from stiction.reference_impl.compiled.loops import copy
from stiction.reference_impl.friction.coulomb import (
    capacity,
    coefficient,
    constant_bound,
    corner_forces,
    friction_coefficients,
    sticks,
)
from stiction.reference_impl.multibody.dynamics import (
    acceleration,
    largest_force,
    largest_speed,
    row_acceleration,
)
from stiction.reference_impl.multibody.mechanism import NO_GUIDE, Arrays, Workspace

LIMIT = 100_000
"""Modes tried at most: 5 guides that stick, 8 that slip; some tenths of a second."""
TOO_MANY = -1
SLACK = 1e-10
"""Wrong sign of a force (measured as in `dynamics.largest_force`), or of an acceleration, relative to the largest, that
counts as zero."""
SAME = 1e-6
"""Difference of accelerations or forces, relative to the largest, up to which two modes are one solution: at a tie of
signs two modes give the same forces to rounding, and a hyperstatic friction splits without influence on the motion."""


@kernel
def _sign_choices(m, f):
    """Return the number of combinations of the signs of the corner forces of a guide: 4, 2 or 1."""
    return 1 << m.friction[f].corners


@kernel
def modes(m, slip):
    """Number of contact modes: directions and signs of corner forces, of every guide."""
    total = 1.0
    for f in range(len(m.friction)):
        signs = _sign_choices(m, f)
        if sticks(m, slip, f):
            total *= 1.0 + 2.0 * signs
        elif slip[f] != 0:
            total *= signs
    return total


@kernel(allocates=True)
def solutions(
    m: Arrays,
    w: Workspace,
    slip: Integers,
    forces: Table,
    directions: IntegerTable,
    compliance: float = 0.0,
    limit: int = LIMIT,
    by_force: bool = False,
) -> int:
    """The consistent contact modes of the rows in the workspace; the static coefficient holds for every guide at rest.

    `slip` and `compliance` as in `hlcp.assemble`. `forces`, (k, rows + frictional), receives the row forces of the
    first k solutions whose accelerations differ or, if told `by_force`, whose row forces do; the search ends with the
    k-th. `directions`, (k, frictional), receives the direction in which each guide slips or begins to; 0 for one that
    stays at rest. Returns the number of solutions found, of those whose linear system is regular; TOO_MANY of more than
    `limit` modes.
    """
    nr, nf = m.rows, len(m.friction)
    if modes(m, slip) > limit:
        return TOO_MANY
    A, force = np.zeros((nr + nf, nr + nf)), np.zeros(nr + nf)
    direction, signs = np.zeros(nf, dtype=np.int64), np.zeros((nf, 2), dtype=np.int64)
    motion, known = np.zeros(len(m.inverse_mass)), np.zeros((len(forces), len(m.inverse_mass)))
    found = 0
    for code in range(int(modes(m, slip))):
        _decode(m, code, slip, direction, signs)
        fill(m, w, slip, direction, signs, A, force, compliance)
        if not solve_in_place(A, force, w.unit, nr + nf, nr + nf):
            continue
        if revise(m, w, slip, direction, signs, force) != NO_GUIDE:
            continue
        acceleration(m, w, force, motion)
        if by_force:
            is_new = _is_new_force(w, force, forces[:found])
        else:
            is_new = _is_new(m, motion, known[:found], SLACK * _largest_term(m, w, force))
        if is_new:
            copy(force, forces[found])
            copy(direction, directions[found])
            copy(motion, known[found])
            found += 1
            if found == len(forces):
                break
    return found


@kernel
def _decode(m, code, slip, direction, signs):
    """Fill `direction` and `signs` with the contact mode of a number from 0 to `modes` - 1.

    The number is read digit by digit, one for each guide: which signs its corners have and, of a guide at rest, whether
    it stays there (0) or begins to slip along + or -.
    """
    for f in range(len(m.friction)):
        count = _sign_choices(m, f)
        direction[f] = slip[f]
        if slip[f] == 0 and not sticks(m, slip, f):
            choice = 0  # without friction: any signs will do
        elif slip[f] == 0:
            choice, code = code % (1 + 2 * count), code // (1 + 2 * count)
            direction[f] = 0
            if choice > 0:
                direction[f] = 1 if choice <= count else -1
            choice = max(choice - 1, 0) % count
        else:
            choice, code = code % count, code // count
        signs[f, 0] = 1 if choice % 2 == 0 else -1
        signs[f, 1] = signs[f, 0] if choice < 2 else -signs[f, 0]


@kernel(allocates=True)
def _largest_term(m: Arrays, w: Workspace, force: Reals) -> float:
    """The largest sum of the sizes of the terms of an acceleration, of which rounding is a part."""
    terms = np.abs(w.free)
    for b in range(len(m.block)):
        i, r, k = np.int64(m.block[b, 0]), np.int64(m.block[b, 1]), np.int64(m.block[b, 2])
        for c in range(3):
            terms[k + c] += abs(w.JM[i + c] * force[r])
    return largest_speed(m, terms)


@kernel(allocates=True)
def is_same_motion(m: Arrays, w: Workspace, one: Reals, other: Reals) -> bool:
    """Return True where two sets of row forces give the same accelerations."""
    motion, known = np.zeros(len(m.inverse_mass)), np.zeros((1, len(m.inverse_mass)))
    acceleration(m, w, one, motion)
    acceleration(m, w, other, known[0])
    rounding = SLACK * max(_largest_term(m, w, one), _largest_term(m, w, other))
    return not _is_new(m, motion, known, rounding)


@kernel
def _is_new(m, motion, known, rounding):
    """Return True for an acceleration that is none of those known.

    Two of which all that is left is rounding are both rest.
    """
    for i in range(len(known)):
        difference, size = 0.0, 0.0
        for k in range(len(motion)):
            unit = m.length_scale if k % 3 == 2 else 1.0
            difference = max(difference, unit * abs(motion[k] - known[i, k]))
            size = max(size, unit * abs(motion[k]), unit * abs(known[i, k]))
        if difference <= max(SAME * size, rounding):
            return False
    return True


@kernel
def _is_new_force(w, force, known):
    """Return True for row forces that are none of those known, each measured as in `dynamics.largest_force`."""
    for i in range(len(known)):
        difference, size = 0.0, 0.0
        for r in range(len(force)):
            unit = np.sqrt(w.G[r, r])
            difference = max(difference, unit * abs(force[r] - known[i, r]))
            size = max(size, unit * abs(force[r]), unit * abs(known[i, r]))
        if difference <= SAME * size:
            return False
    return True


@kernel
def fill(
    m: Arrays,
    w: Workspace,
    slip: Integers,
    direction: Integers,
    signs: IntegerTable,
    A: Table,
    force: Reals,
    compliance: float,
) -> None:
    """Fill A and `force` with the system of a mode: constraint rows, and of each guide its tangential row or its law.

    A guide that stays at rest has its tangential row, as an equation for its acceleration; any other f = c_R R + c_T T
    - d bound.
    """
    nr = m.rows
    for r in range(len(force)):
        force[r] = w.right[r]
        for c in range(len(force)):
            A[r, c] = w.G[r, c]
        A[r, r] += compliance * w.G[r, r]
    for f in range(len(m.friction)):
        if direction[f] == 0 and sticks(m, slip, f):
            continue
        row = m.friction[f].row
        c_R, c_T = friction_coefficients(
            m, f, direction[f], signs[f, 0], signs[f, 1], coefficient(m, f, slip)
        )
        for c in range(len(force)):
            A[nr + f, c] = 0.0
        A[nr + f, row + 1] = -c_T
        A[nr + f, row] = -c_R
        A[nr + f, nr + f] = 1.0
        force[nr + f] = 0.0 - direction[f] * constant_bound(m, f, slip)

    # rows of unit size, so that a system near a singular one is told from that
    for r in range(len(force)):
        size = 0.0
        for c in range(len(force)):
            size = max(size, abs(A[r, c]))
        if size > 0.0:
            force[r] /= size
            for c in range(len(force)):
                A[r, c] /= size


@kernel
def revise(
    m: Arrays, w: Workspace, slip: Integers, direction: Integers, signs: IntegerTable, force: Reals
) -> int:
    """Change, in place, every sign and direction of a mode that its forces contradict.

    A guide at rest whose friction exceeds its capacity begins to slip, with the signs that its corner forces have; one
    that begins to slip against its acceleration rests. Returns the first guide that was contradicted; NO_GUIDE if the
    mode is consistent.
    """
    nr, largest = m.rows, largest_force(m, w, force)
    first = NO_GUIDE
    for f in range(len(m.friction)):
        guide, d = m.friction[f], direction[f]
        changed = False
        floor = SLACK * largest / np.sqrt(w.G[guide.unit, guide.unit])
        R, T, friction = force[guide.row], force[guide.row + 1], force[nr + f]
        if d == 0 and not sticks(m, slip, f):
            continue

        # rest: the friction must be within the capacity, in both directions
        if d == 0:
            if capacity(m, f, R, T, 1.0) + friction < -floor:
                direction[f] = 1
            elif capacity(m, f, R, T, -1.0) - friction < -floor:
                direction[f] = -1
            changed = direction[f] != 0

        # slip: the corner forces, if it has any, must have the signs that were assumed for them
        n1, n2 = corner_forces(guide, R, T, -coefficient(m, f, slip) * direction[f])
        if guide.corners > 0 and (d != 0 or changed):
            if signs[f, 0] * n1 < -floor:
                signs[f, 0] = -signs[f, 0]
                changed = True
            if signs[f, 1] * n2 < -floor:
                signs[f, 1] = -signs[f, 1]
                changed = True

        # a beginning slip: the guide must accelerate in its direction, but for the rounding of the terms
        if slip[f] == 0 and d != 0:
            size = abs(w.right[nr + f])
            for r in range(len(force)):
                size = max(size, abs(w.G[nr + f, r] * force[r]))
            if d * row_acceleration(w, nr + f, force) < -SLACK * size:
                direction[f] = 0
                changed = True
        if changed and first == NO_GUIDE:
            first = f
    return first
