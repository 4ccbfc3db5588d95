"""Pins whose friction depends on the force in them, compiled.

A journal of radius r in a bearing has friction at its surface, whose resultant torque has the bound

    c = friction + mu r |R|  in slip ,    cH = static_friction + mus r |R|  at rest ,    R = (fx, fy)

(the friction circle of radius mu r; r counts as that at which the normal force acts, which holds for small mu). |R| is
the root of a sum of squares, so that no linear complementarity has it. But for given loads |R| the bounds are numbers,
and the pin is one of constant bounds. The loads are found around the linear problems:

- In a mode (`solve_mode_of_pins`) the forces are linear in the loads rho of the pins that slip. Newton's method solves
  rho_i = |R_i(rho)| from the last values. Pins at rest have loads, but these enter no force.
- In a contact problem (`contact_solvers`), and where joints at rest share a load, the problem is solved again with the
  loads of its last solution, until Coulomb's law holds to `RESIDUAL`.

Where the friction gain (`uniqueness`), to which pins contribute mu r times the response of their forces, is below 1,
the forces of given directions of slip are the fixed point of a contraction, and there is no other root. Where it is 1
or more, a run ends: whether the motion is the only one is not known.

Bounds are fields of `Arrays.friction`, in newton at the radius of the pin's slip (`Mechanism.slip_radius`).
"""

from __future__ import annotations

from math import hypot, sqrt

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, IntegerTable, Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import solve_in_place
from stiction.reference_impl.friction.frozen_mode import solve_mode
from stiction.reference_impl.multibody.dynamics import largest_force
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace
from stiction.reference_impl.multibody.speed_dependence import set_bounds

RESIDUAL = 1e-14
"""Change of a bound from one solution to the next, relative to the largest force, up to which they agree: some tens of
roundings. Coulomb's law is violated by so much."""
BLURRED_RESIDUAL = 1e-11
"""The same where rounding keeps the changes from falling further: they do not become smaller any more, though they are
as small as this. It is below what an audit takes for a missed event."""
MOST_PASSES = 1000
"""Solutions of a contact problem at most. Their changes fall by the friction gain each time, so that a gain of 0.96 is
left to convergence."""
NEWTON_STEPS = 50
"""Steps of Newton's method at most. |R| is convex in the loads; from below a root the method comes to it from above in
one step, and then quadratically."""
CONVERGED = 4e-16
"""Change of a load in a step of Newton's method, relative to the largest load, that is rounding."""
ALMOST_CONVERGED = 1e-12
"""The same that is accepted after all steps, where rounding of the responses keeps it from falling."""


@kernel
def is_under_load(m, f):
    """Return True for a pin whose friction depends on the force in it."""
    return m.friction[f].pin_mus > 0.0


@kernel
def force_in_pin(m, f, force):
    """Return the size of the force in a pin, |R|, newton, from row forces."""
    row = m.friction[f].row
    return hypot(force[row], force[row + 1])


@kernel
def take_loads(m: Arrays, w: Workspace) -> float:
    """Set the bounds of all pins under load by the forces in the workspace.

    Returns
    -------
    float
        The largest change of a bound, at rest or in slip, relative to the largest force, each force measured as in
        `dynamics.largest_force`. nan where a force is.
    """
    change = 0.0
    for f in range(len(m.friction)):
        if not is_under_load(m, f):
            continue
        pin, t = m.friction[f], m.rows + f
        load = force_in_pin(m, f, w.force)
        difference = pin.pin_mus * abs(load - pin.load) * sqrt(w.G[t, t])
        change = difference if difference > change or np.isnan(difference) else change
        set_bounds(m, f, load)
    largest = largest_force(m, w, w.force)
    if change > 0.0 and largest == 0.0:
        return 1.0  # from some loads to none
    return change / largest if change != 0.0 else 0.0


@kernel(allocates=True)
def solve_mode_of_pins(m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable) -> bool:
    """Solve the row forces of a mode as `frozen_mode.solve_mode`, and the loads of its pins with them.

    Where no loads are found the forces are nan. A mode whose system is singular, as of joints at rest that share a
    load, is solved with the loads that the pins have.
    """
    regular = solve_mode(m, w, slip, corner)
    pins = _slipping_pins(m, slip)
    n = len(pins)
    if not regular or n == 0:
        if regular:
            take_loads(m, w)
        return regular

    # the forces in these pins, and their changes per unit of each of their frictions: by solutions of the mode with
    # other bounds, as the forces are linear in these
    start = np.zeros(n)
    force_x, force_y = np.zeros(n), np.zeros(n)
    step = 0.0
    for i in range(n):
        start[i] = m.friction[pins[i]].load
        row = m.friction[pins[i]].row
        force_x[i], force_y[i] = w.force[row], w.force[row + 1]
        step = max(step, force_in_pin(m, pins[i], w.force), start[i])
    if not np.isfinite(step):
        return regular
    if step == 0.0:
        step = 1.0
    response_x, response_y = np.zeros((n, n)), np.zeros((n, n))
    for j in range(n):
        set_bounds(m, pins[j], start[j] + step)
        solve_mode(m, w, slip, corner)
        set_bounds(m, pins[j], start[j])
        for i in range(n):
            row = m.friction[pins[i]].row
            response_x[i, j] = (w.force[row] - force_x[i]) / step
            response_y[i, j] = (w.force[row + 1] - force_y[i]) / step

    # the loads, and the forces of the mode with them
    load = start.copy()
    found = _agreeing_loads(start, force_x, force_y, response_x, response_y, load)
    for i in range(n):
        set_bounds(m, pins[i], load[i])
    regular = solve_mode(m, w, slip, corner)
    if not found:
        w.force[:] = np.nan
    take_loads(m, w)
    return regular


@kernel(allocates=True)
def _slipping_pins(m: Arrays, slip: Integers) -> Integers:
    """Return the numbers of the pins under load that slip."""
    pins = np.zeros(len(slip), dtype=np.int64)
    count = 0
    for f in range(len(slip)):
        if slip[f] != 0 and is_under_load(m, f):
            pins[count] = f
            count += 1
    return pins[:count].copy()


@kernel(allocates=True)
def _agreeing_loads(
    start: Reals, force_x: Reals, force_y: Reals, response_x: Table, response_y: Table, load: Reals
) -> bool:
    """Solve load_i = |R_i(load)| by Newton's method, in place; return whether it has converged.

    R_i = (force_x, force_y)_i + sum over j of (response_x, response_y)_ij (load_j - start_j).
    """
    n = len(load)
    A, x, unit = np.zeros((n, n)), np.zeros(n), np.zeros(2 * n)
    change, largest = np.inf, 0.0
    for _ in range(NEWTON_STEPS):
        largest = 0.0
        for i in range(n):
            fx, fy = force_x[i], force_y[i]
            for j in range(n):
                fx += response_x[i, j] * (load[j] - start[j])
                fy += response_y[i, j] * (load[j] - start[j])
            size = hypot(fx, fy)
            largest = max(largest, size)
            x[i] = size - load[i]
            for j in range(n):
                slope = (
                    (fx * response_x[i, j] + fy * response_y[i, j]) / size if size > 0.0 else 0.0
                )
                A[i, j] = (1.0 if i == j else 0.0) - slope
        if not solve_in_place(A, x, unit, n, n):
            return False
        change = 0.0
        for i in range(n):
            load[i] += x[i]
            change = max(change, abs(x[i]))
        if change <= CONVERGED * largest:
            break
    # a negative load is no root of |R|
    for i in range(n):
        if not load[i] >= -ALMOST_CONVERGED * largest:
            return False
        load[i] = max(load[i], 0.0)
    return change <= ALMOST_CONVERGED * largest
