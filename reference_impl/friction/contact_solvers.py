"""Contact forces and the next contact mode: an exchangeable solver, compiled.

``lemke``: the HLCP by Lemke's method, and nothing else (`hlcp`). ``enumeration``: by trying all modes (`enumeration`).
``trial``: by trial and error on signs (`trial_and_error`). ``automatic``: Lemke's method, and where it finds no
solution all modes; a large mechanism, one that has cells, is first solved by trial and error with banded systems. Its
solution must be known to be the only one (`uniqueness`). Each resort to another way is counted
(`solver_names.Counters`).
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, IntegerTable, Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy
from stiction.reference_impl.friction import hlcp
from stiction.reference_impl.friction.coulomb import coefficient, corner_forces, sticks
from stiction.reference_impl.friction.enumeration import LIMIT, solutions
from stiction.reference_impl.friction.open_forces import take_least_forces
from stiction.reference_impl.friction.outcomes import (
    MODE_LIMIT,
    NONE,
    PIN_LOADS,
    SIGN_CYCLE,
    SOLVED,
)
from stiction.reference_impl.friction.pins_under_load import (
    BLURRED_RESIDUAL,
    MOST_PASSES,
    RESIDUAL,
    take_loads,
)
from stiction.reference_impl.friction.solver_names import AUTOMATIC, ENUMERATION, LEMKE, TRIAL
from stiction.reference_impl.friction.trial_and_error import trial_and_error
from stiction.reference_impl.friction.uniqueness import gain_of_mode
from stiction.reference_impl.multibody.dynamics import row_acceleration
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace


@kernel(allocates=True)
def solve_contact(
    m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable, accelerate: Reals
) -> tuple[int, float]:
    """Solve the contact problem as `_solve_with_bounds`, with the bounds of pins by the forces in them.

    The problem is solved again with the forces of its last solution, until these agree (`pins_under_load`). PIN_LOADS
    where they do not.
    """
    outcome, rest = _solve_with_bounds(m, w, slip, corner, accelerate)
    if m.pins == 0 or outcome != SOLVED:
        return outcome, rest
    least = np.inf
    for _ in range(MOST_PASSES):
        change = take_loads(m, w)
        if change <= RESIDUAL or change <= BLURRED_RESIDUAL and change >= least:
            return outcome, rest
        least = min(least, change)
        outcome, rest = _solve_with_bounds(m, w, slip, corner, accelerate)
        if outcome != SOLVED:
            return outcome, rest
    return PIN_LOADS, rest


@kernel(allocates=True)
def _solve_with_bounds(
    m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable, accelerate: Reals
) -> tuple[int, float]:
    """Find row forces, into w.force, for the rows in the workspace, with the bounds of pins as they are.

    The static coefficient holds for every guide at rest. `slip` as in `hlcp.assemble`. `corner`, (frictional, 2):
    signs of the corner forces, on entry those of the previous instant, on return those of the solution. `accelerate`
    receives the acceleration (m/s^2) with which a guide at rest begins to slip.

    Returns
    -------
    outcome : int
        One of `outcomes`; without a solution w.force and corner mean nothing.
    rest : float
        Acceleration (m/s^2) up to which a guide at rest stays there.
    """
    nf = len(m.friction)
    direction = np.zeros(nf, dtype=np.int64)
    outcome = SIGN_CYCLE
    w.counters.hlcp += 1

    # Trial and error is fast for a large mechanism, as its systems are banded, but may cycle. It finds one solution and
    # knows of no other, so that it comes first only where the gain shows that there is one.
    fallible = w.solver == AUTOMATIC and len(m.cell) > 0 and gain_of_mode(m, w, slip)[0] < 1.0
    if w.solver == TRIAL or fallible:
        outcome, trials, _ = trial_and_error(m, w, slip, corner, w.force, direction)
        w.counters.pivots += trials
        if fallible and outcome != SOLVED:
            w.counters.trial_fallbacks += 1

    # the HLCP, by Lemke's method
    if w.solver == LEMKE or w.solver == AUTOMATIC and outcome != SOLVED:
        force, y, x, outcome, rest = hlcp.solve(m, w, slip, LIMIT)
        copy(force, w.force)
        if outcome == SOLVED:
            hlcp.read(m, w, slip, force, y, x, accelerate, corner)
            if m.unfree > 0:
                take_least_forces(m, w, slip, corner)
        return outcome, rest

    # the first consistent mode of all
    if w.solver == ENUMERATION:
        forces, directions = np.zeros((1, len(w.force))), np.zeros((1, nf), dtype=np.int64)
        count = solutions(m, w, slip, forces, directions, 0.0, LIMIT)
        w.counters.pivots += max(count, 0)
        if count > 0:
            outcome = SOLVED
        else:
            outcome = NONE if count == 0 else MODE_LIMIT
        copy(forces[0], w.force)
        copy(directions[0], direction)
        for f in range(nf):
            guide, mu = m.friction[f], coefficient(m, f, slip)
            if guide.corners == 0:
                continue
            n1, n2 = corner_forces(
                guide, w.force[guide.row], w.force[guide.row + 1], -mu * direction[f]
            )
            corner[f, 0] = -1 if n1 < 0.0 else 1
            corner[f, 1] = -1 if n2 < 0.0 else 1

    # modes tell exactly which guides stay at rest: their accelerations are 0, and none is a matter of rounding
    for f in range(nf):
        accelerate[f] = 0.0
        if sticks(m, slip, f) and direction[f] != 0:
            accelerate[f] = row_acceleration(w, m.rows + f, w.force)
    if outcome == SOLVED and m.unfree > 0:
        take_least_forces(m, w, slip, corner)
    return outcome, 0.0
