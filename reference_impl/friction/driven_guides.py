"""Guides that drives move (`guide_freedom.DRIVEN`): whether they slip, and where to, from kinematics alone; compiled.

The tangential row of such a guide depends on the rows of joints and drives, so that its slip velocity and acceleration
are the same for all forces that meet the constraints. No complementarity decides them: those of forces without friction
will do.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import (
    RANK_TOLERANCE,
    minimum_norm,
    solve_in_place,
)
from stiction.reference_impl.multibody.banded_systems import fill_cell, friction_row
from stiction.reference_impl.multibody.dynamics import largest_force, row_acceleration
from stiction.reference_impl.multibody.guide_freedom import DRIVEN, LOCKED
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

HELD = 1e-9
"""Acceleration of a guide at rest, relative to what the largest force would give it, from which on it is not held: what
rounding leaves of redundant rows is a thousandth of that."""


@kernel
def driven_acceleration(m, w, f):
    """Acceleration along a driven guide at rest, m/s^2, of row forces that meet the constraints; 0 for rounding."""
    row = m.rows + f
    acceleration = row_acceleration(w, row, w.force)
    largest = largest_force(m, w, w.force) * np.sqrt(w.G[row, row])
    return acceleration if abs(acceleration) > HELD * max(abs(w.right[row]), largest) else 0.0


@kernel
def driven_speed(m, w, f):
    """Slip velocity of a driven guide, m/s, of velocities on the constraints.

    w.force : `frictionless_forces` of w.phi_dot, by which the velocities of the workspace are off.
    """
    speed = w.slip_speed[f]
    for r in range(m.rows):
        speed -= w.G[m.rows + f, r] * w.force[r]
    return speed


@kernel(allocates=True)
def frictionless_forces(m: Arrays, w: Workspace, needed: Reals) -> None:
    """Forces of the constraint rows into w.force that accelerate the constraints as `needed` (rows,); no friction.

    Redundant rows have the shortest ones.
    """
    for r in range(len(w.force)):
        w.force[r] = 0.0

    # A mechanism without cells: a dense solve of its constraint rows. Elimination destroys the matrix, so that it is
    # filled anew for the solution of least norm, in a second turn, where rows are dependent.
    if len(m.cell) == 0:
        for way in range(2):
            for r in range(m.rows):
                w.x[r] = needed[r]
                for c in range(m.rows):
                    w.A[r, c] = w.G[r, c]
            if way == 0 and solve_in_place(w.A, w.x, w.unit, m.rows, m.rows, RANK_TOLERANCE):
                break
            if way == 1:
                minimum_norm(w.A, w.x, m.rows)
        for r in range(m.rows):
            w.force[r] = w.x[r]
        return

    # the same cell by cell; the tangential rows within a cell have no friction
    for c in range(len(m.cell)):
        band, first = m.cell[c].band, m.cell[c].first
        n = m.cell[c].end - first
        for way in range(2):
            reach = band if way == 0 else n
            fill_cell(m, w, c, reach, w.A)
            for k in range(n):
                r = m.order[first + k]
                w.x[k] = needed[r] if r < m.rows else 0.0
                if r >= m.rows:
                    friction_row(m, w, w.A, r - m.rows, n, reach, 0.0, 0.0)
            if way == 0 and solve_in_place(w.A, w.x, w.unit, n, band, RANK_TOLERANCE):
                break
            if way == 1:
                minimum_norm(w.A, w.x, n)
        for k in range(n):
            w.force[m.order[first + k]] = w.x[k]


@kernel(allocates=True)
def follow_drives(m: Arrays, w: Workspace, slip: Integers) -> None:
    """Decide the directions of guides that are not free, in place; the rows of the instant are in the workspace.

    A locked guide rests. A driven one of slip 0 begins to slip where it has an acceleration.
    """
    any_may_begin = False
    for f in range(len(slip)):
        if m.friction[f].freedom == LOCKED:
            slip[f] = 0
        any_may_begin = any_may_begin or slip[f] == 0 and m.friction[f].freedom == DRIVEN
    if not any_may_begin:
        return

    # the accelerations of driven guides are the same for all forces that meet the constraints
    frictionless_forces(m, w, w.right)
    for f in range(len(slip)):
        if slip[f] == 0 and m.friction[f].freedom == DRIVEN:
            acceleration = driven_acceleration(m, w, f)
            if acceleration != 0.0:
                slip[f] = 1 if acceleration > 0.0 else -1
