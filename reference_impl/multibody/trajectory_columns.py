"""Columns of a trajectory, from states, accelerations and row forces."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from inspect import unwrap

import numpy as np
from numpy.typing import ArrayLike

from stiction.reference_impl.compiled.bundle import Integers, Reals, Table
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.loops import copy
from stiction.reference_impl.equations_of_motion import Motion
from stiction.reference_impl.friction.coulomb import equal_mobilization, split_between_corners
from stiction.reference_impl.multibody.dynamics import acceleration, largest_force, row_form
from stiction.reference_impl.multibody.mechanism import (
    TRANSLATIONAL,
    Arrays,
    Mechanism,
    Workspace,
)
from stiction.reference_impl.multibody.one_sided import BY_STATE, touch_at_contact
from stiction.scenes import InputError
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.model import Drive, Translational
from stiction.scenes.stribeck import coefficient_in_slip

CORNER_COLUMNS = ("F1", "F2", "F3", "F4", "friction_lower", "friction_upper")
GUIDE_COLUMNS, DRIFT_COLUMNS = ("displacement", "slip_velocity"), ("position", "velocity")
PIN_SLIP = "slip_velocity"
"""Column of a pin with friction, beside those of its row forces: its relative angular velocity."""
LIMIT_COLUMNS = ("slip_velocity", "lag")
"""Columns of a drive with a limit, beside its effort and mode: how its coordinate differs from its law."""
BLOCK = 512
"""Rows that are transposed together: so many of some dozens of numbers fit into a processor's cache."""


def build_columns(  # noqa: PLR0913 - the parts of samples
    mechanism: Mechanism,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    force: np.ndarray,
    slip: np.ndarray | None = None,
    names: Collection[str] | None = None,
    residual: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Return the columns of a trajectory (`stiction.scenes.Trajectory`); all if `names` is None.

    `q`, `v` and `a` are (n, 3 * bodies). `force`, (n, rows + frictional): multipliers in the order of
    `mechanism.row_names`, then the frictions, in newton as the kernels have them (`Mechanism.force_units`). `slip`, (n,
    frictional): contact modes (d; 0 = stick); without them the corner forces are those of equal mobilization throughout
    and there is no column ``mode``. `residual`, (n, 2): norms of Phi and Phi'; computed where None.
    """

    def are_wanted(prefix: str, labels: Sequence[str]) -> bool:
        return names is None or any(f"{prefix}.{label}" in names for label in labels)

    m = mechanism.arrays
    read: dict[str, np.ndarray] = {}
    motion = [_as_columns(values) for values in (q, v, a)]
    for i, name in enumerate(mechanism.body_names):
        for values, labels in zip(motion, BODY_COLUMNS):
            read.update({f"{name}.{label}": values[3 * i + k] for k, label in enumerate(labels)})
    forces = _as_columns(force)
    for r, name in enumerate(mechanism.row_names):
        read[name] = forces[r]
    for i, name in enumerate(mechanism.guide_names):
        read[mechanism.force_names[m.rows + i]] = forces[m.rows + i] * mechanism.slip_radius[i]
        if slip is not None:
            read[f"{name}.mode"] = slip[:, i].astype(np.int8)
    columns = {name: values for name, values in read.items() if names is None or name in names}
    for name, guide in mechanism.scene.guides.items():
        if guide.length is not None and are_wanted(name, CORNER_COLUMNS):
            if guide.depends_on_speed:
                k = list(mechanism.scene.joints).index(name)
                read[f"{name}.slip_velocity"] = slip_velocity(m, k, q, v)
            columns.update(corner_columns(name, guide, read))
    for k, (name, joint) in enumerate(mechanism.scene.joints.items()):
        is_guide = m.constraint[k]["kind"] == TRANSLATIONAL
        if is_guide and are_wanted(name, GUIDE_COLUMNS):
            columns.update(
                zip((f"{name}.{label}" for label in GUIDE_COLUMNS), guide_motion(m, k, q, v))
            )
        if not is_guide and joint.frictional and are_wanted(name, (PIN_SLIP,)):
            columns[f"{name}.{PIN_SLIP}"] = slip_velocity(m, k, q, v)
    for name, drive in mechanism.scene.limited_drives.items():
        if are_wanted(name, LIMIT_COLUMNS):
            motion_of_drive = limited_motion(drive, mechanism.body_names, t, q, v)
            columns.update(zip((f"{name}.{label}" for label in LIMIT_COLUMNS), motion_of_drive))
    if are_wanted("drift", DRIFT_COLUMNS):
        norms = (
            residual_norms(
                m, mechanism.workspace, *(np.ascontiguousarray(values) for values in (t, q, v))
            )
            if residual is None
            else _as_columns(residual)
        )
        columns.update(zip((f"drift.{label}" for label in DRIFT_COLUMNS), norms))
    return columns if names is None else {name: columns[name] for name in names}


def _as_columns(table: np.ndarray) -> np.ndarray:
    """Return the columns of a table (n, k), each contiguous: an array (k, n) of its own.

    They are copied block by block, as one column of a long table at a time reads each line of memory k times.
    """
    columns = np.empty(table.shape[::-1])
    for begin in range(0, len(table), BLOCK):
        columns[:, begin : begin + BLOCK] = table[begin : begin + BLOCK].T
    return columns


@kernel
def write_sample(
    w: Workspace, y: Reals, dy: Reals, slip: Integers, motion: Table, force: Reals, slips: Integers
) -> None:
    """Write a sample: the state y, the derivative dy, the forces and the contact modes.

    The forces are those in the workspace.
    """
    n = motion.shape[1]
    for i in range(n):
        motion[0, i], motion[1, i], motion[2, i] = y[i], y[n + i], dy[n + i]
    copy(w.force, force)
    copy(slip, slips)


def corner_forces(guide: Translational, normal_force: ArrayLike, moment: ArrayLike) -> np.ndarray:
    """Split the normal force of a slider between its four corners by eqs. (1) and (2) of the paper.

    Parameters
    ----------
    guide : Translational
        A guide of a scene, with a ``length``.
    normal_force : array_like
        Resultant force on the slider along the guide's normal, N.
    moment : array_like
        Moment of the normal forces on the slider about its point, N m, without the moment of surface friction.

    Returns
    -------
    ndarray
        F1 (lower rear), F2 (lower front), F3 (upper front) and F4 (upper rear), N, shape (4, ...); none is negative.

    Raises
    ------
    InputError
        If the guide has no length.
    """
    if guide.length is None:
        raise InputError("guide.length: found none; expected a guide with corners")
    n1, n2 = unwrap(split_between_corners)(
        np.asarray(normal_force, float), np.asarray(moment, float), guide.length
    )
    return np.array([np.maximum(n, 0.0) for n in (n1, n2, -n2, -n1)])


def corner_columns(
    name: str, guide: Translational, columns: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return F1..F4 and the surface frictions of a guide from R, T, friction and any mode.

    A guide whose coefficient depends on its speed of slip also needs the column of that speed.
    """
    R, T = columns[f"{name}.normal_force"], columns[f"{name}.moment"]
    a = guide.length or 0.0
    b = guide.width or 0.0
    kappa = np.zeros_like(R)
    if guide.frictional:
        # in slip the coefficient is the kinetic one; at rest it follows from the friction
        friction = columns[f"{name}.friction"]
        mode = columns.get(f"{name}.mode", np.zeros(len(R)))
        coefficient: float | np.ndarray = guide.kinetic_coefficient
        if guide.depends_on_speed:
            coefficient = coefficient_in_slip(guide, columns[f"{name}.slip_velocity"])
        kappa = -coefficient * mode
        rests = mode == 0
        static_bound, extra = guide.bounds[1], 0.0
        if static_bound > 0.0 and guide.static_coefficient > 0.0:
            extra = static_bound / guide.static_coefficient
        if static_bound > extra == 0.0:
            kappa[rests] = 0.0  # the constant part carries all friction
        else:
            kappa[rests] = equal_mobilization(R[rests], T[rests], friction[rests], a, b, extra)
        kappa[np.isnan(friction)] = np.nan
    N = (
        T - 0.5 * b * kappa * R if b else T
    )  # without a width an unknown friction leaves the corner forces known
    corners = {
        f"{name}.F{number}": force for number, force in enumerate(corner_forces(guide, R, N), 1)
    }
    if guide.frictional:
        lower = kappa * (corners[f"{name}.F1"] + corners[f"{name}.F2"])
        upper = kappa * (corners[f"{name}.F3"] + corners[f"{name}.F4"])
        if guide.bounds[1] > 0.0:
            # what the loads do not carry is the constant part, of which each surface has half
            constant = 0.5 * (friction - lower - upper)
            lower, upper = lower + constant, upper + constant
        corners[f"{name}.friction_lower"], corners[f"{name}.friction_upper"] = lower, upper
    return corners


@kernel(allocates=True)
def residual_norms(m: Arrays, w: Workspace, t: Reals, q: Table, v: Table) -> tuple[Reals, Reals]:
    """Return the norms of Phi and Phi' at times t, for q and v (n, 3 * bodies).

    Residuals in m and rad, and per s, are summed as they are.
    """
    position, velocity = np.zeros(len(t)), np.zeros(len(t))
    for i in range(len(t)):
        row_form(m, w, t[i], q[i], v[i])
        position[i], velocity[i] = residual_norm(w.phi), residual_norm(w.phi_dot)
    return position, velocity


@kernel
def residual_norm(residuals):
    """Return the root of the sum of squares of residuals in m and rad, summed as they are."""
    total = 0.0
    for residual in residuals:
        total += residual**2
    return np.sqrt(total)


@kernel(allocates=True)
def imbalance(
    m: Arrays, w: Workspace, t: Reals, q: Table, v: Table, a: Table, force: Table
) -> tuple[Reals, Reals, Reals, Reals]:
    """Return the remainder of Newton's and Euler's equations at times t (n,), and the largest term.

    Both are in sqrt(kg) m/s^2.

    q, v, a of shape (n, 3 * bodies); row forces as of `build_columns`. The largest over all coordinates, each in units
    of the square root of its mobility, as in `dynamics.largest_force`: N and N m have no order. Behind them the norms
    of Phi and Phi', as of `residual_norms`, which come without further work.
    """
    left, size, balanced = np.zeros(len(t)), np.zeros(len(t)), np.zeros(q.shape[1])
    position, velocity = np.zeros(len(t)), np.zeros(len(t))
    for i in range(len(t)):
        row_form(m, w, t[i], q[i], v[i])
        position[i], velocity[i] = residual_norm(w.phi), residual_norm(w.phi_dot)
        left[i], size[i] = _imbalance_of_rows(m, w, a[i], force[i], balanced)
        if len(m.one_sided) > 0 and touch_at_contact(m, w, q[i], v[i]):
            # The tension of damped springs jumps where they come into contact: it may be that of either side.
            row_form(m, w, t[i], q[i], v[i])
            other, size[i] = _imbalance_of_rows(m, w, a[i], force[i], balanced)
            left[i] = min(left[i], other)
            for k in range(len(m.one_sided)):
                w.acting[k] = BY_STATE
    return left, size, position, velocity


@kernel
def _imbalance_of_rows(m, w, a, force, balanced):
    """Return the remainder and the largest term of `imbalance`, of the rows in the workspace."""
    acceleration(m, w, force, balanced)
    left, size = 0.0, largest_force(m, w, force)
    for k in range(len(balanced)):
        unit = 1.0 / np.sqrt(m.inverse_mass[k])
        left = max(left, abs(a[k] - balanced[k]) * unit)
        size = max(size, max(abs(a[k]), abs(w.free[k])) * unit)
    return left, size


def slip_velocity(m, k: int, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the slip velocity of a frictional joint: along a guide (m/s), or of a pin's bodies (rad/s).

    k is the number of the constraint; q and v have the shape (n, 3 * bodies).
    """
    constraint = m.constraint[k]
    if constraint["kind"] == TRANSLATIONAL:
        return guide_motion(m, k, q, v)[1]
    rate = np.zeros(len(v))
    for sign, body in ((1.0, constraint["a"]), (-1.0, constraint["b"])):
        if body >= 0:
            rate += sign * v[:, 3 * body + 2]
    return rate


def limited_motion(
    drive: Drive, bodies: Sequence[str], t: np.ndarray, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return how the coordinate of a drive with a limit differs from its law at times t (n,).

    Parameters
    ----------
    drive : Drive
        The drive.
    bodies : sequence of str
        The names of the bodies, in the order of the coordinates.
    t, q, v : ndarray
        Times, s, shape (n,), and coordinates and velocities, shape (n, 3 * bodies).

    Returns
    -------
    slip_velocity : ndarray, shape (n,)
        The rate of the coordinate minus that of the law, rad/s or m/s.
    lag : ndarray, shape (n,)
        The value of the law minus the coordinate, rad or m.
    """
    motion = Motion(list(bodies), np.asarray(t, dtype=float), np.asarray(q), np.asarray(v))
    difference = motion.coordinate(drive) - motion.law(drive.law)
    return difference.rate, -difference.value


def guide_motion(m, k: int, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinate of the slider's point along its guide, and its rate.

    k is the number of the constraint; q and v have the shape (n, 3 * bodies).
    """
    constraint = m.constraint[k]

    def absolute(body: int, px: float, py: float) -> tuple[np.ndarray | float, ...]:
        if body < 0:
            return px, py, 0.0, 0.0, 0.0, 1.0, 0.0
        x, y, angle = q[:, 3 * body : 3 * body + 3].T
        vx, vy, omega = v[:, 3 * body : 3 * body + 3].T
        c, s = np.cos(angle), np.sin(angle)
        rx, ry = c * px - s * py, s * px + c * py
        return x + rx, y + ry, vx - omega * ry, vy + omega * rx, omega, c, s

    xs, ys, vxs, vys, *_ = absolute(constraint["a"], constraint["ax"], constraint["ay"])
    xg, yg, vxg, vyg, omega, c, s = absolute(constraint["b"], constraint["bx"], constraint["by"])
    ux, uy = (
        c * constraint["ux"] - s * constraint["uy"],
        s * constraint["ux"] + c * constraint["uy"],
    )
    dx, dy = xs - xg, ys - yg
    return ux * dx + uy * dy, ux * (vxs - vxg) + uy * (vys - vyg) + omega * (ux * dy - uy * dx)
