"""Constraint reactions and friction that follow from a motion by the balance of momentum.

In M a - Q = J^T force, the multipliers of the constraints and the frictions are the unknowns. The equation does not
depend on the program that has integrated the motion. Redundant constraints share their force in the minimum-norm sense.

Frictions of guides at rest are unknowns as well. If more guides are at rest than the mechanism has degrees of freedom
(hyperstatic rest), a null vector of the columns of the unknowns contains frictions. The forces in this null vector are
arbitrary, and the minimum-norm ones may violate Coulomb's law; these forces are NaN. Null vectors of the constraints
alone, which belong to redundant joints, contain no friction and are not considered.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import Arrays, Mechanism, workspace
from stiction.reference_impl.multibody.trajectory_columns import build_columns, corner_columns
from stiction.scenes import InputError, Scene
from stiction.scenes.columns import BODY_COLUMNS, columns_of
from stiction.scenes.wording import did_you_mean, names, shown

_MAX_NUMBERS = 1_000_000
"""Largest number of elements of the matrices that are solved at a time, 8 MB. At least one matrix is solved."""
_MIN_NULL_PART = 1e-12
"""Square of the part of a force in a unit null vector above which the null vector contains the force. Rounding errors
cause 1e-16, and a lever of a millimetre 1e-6."""


def recover_columns(
    scene: Scene,
    t: ArrayLike,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    reactions: Mapping[str, ArrayLike] | None = None,
    mechanism: Mechanism | None = None,
) -> dict[str, np.ndarray]:
    """Compute all columns of a trajectory from states and accelerations.

    Reactions and friction follow from the equations of motion, whatever friction law the engine used. Friction in pins
    is found like that in guides, from a motion that determines it.

    Parameters
    ----------
    scene
        The scene.
    t : array_like
        Time, s, shape (n,).
    q : array_like
        x, y and angle of each body in the order of the scene (m, rad), shape (n, 3 * bodies).
    v : array_like
        Their velocities (m/s, rad/s), of the same shape.
    a : array_like
        Their accelerations (m/s², rad/s²), of the same shape. Where an acceleration is NaN, the forces are NaN.
    reactions : mapping of str to array_like
        Columns of shape (n,) that the engine itself reports, for example ``"motor.effort"`` or
        ``"guide.normal_force"``. They replace the computed ones, and the corner forces are computed from them. Values
        of a joint's ``friction`` that are not NaN are taken as known, and the other forces are computed with them.
    mechanism : Mechanism
        The compiled mechanism of the scene, if it exists already.

    Returns
    -------
    dict of str to ndarray
        Columns of shape (n,) as in `stiction.scenes.Trajectory`. Friction that is split between both surfaces is split
        with equal mobilization. A force is NaN where the motion and the known friction do not determine it, for example
        in a mechanism with more guides at rest than degrees of freedom.

    Raises
    ------
    InputError
        If an argument has the wrong shape, or contains values that are not finite numbers, or if a name in `reactions`
        is not a column of the scene, or is one of the motion of a body.
    """
    _check_names(reactions or {}, scene)
    if mechanism is None:
        mechanism = Mechanism(scene, stabilization="none")
    m = mechanism.arrays
    t = _numbers("t", t, ("n",))
    shape = (len(t), len(m.inverse_mass))
    q = _numbers("q", q, shape)
    v = _numbers("v", v, shape)
    a = _numbers("a", a, shape, allows_nan=True)
    reported = {
        name: _numbers(f"reactions[{name!r}]", values, (len(t),), allows_nan=True)
        for name, values in (reactions or {}).items()
    }

    # The unknowns are the multipliers, and the frictions that are not reported.
    force = np.zeros((len(t), m.rows + len(mechanism.guide_names)))
    is_known = np.zeros(force.shape, dtype=bool)
    for i, name in enumerate(mechanism.force_names[m.rows :]):
        friction = reported.pop(name, None)
        if friction is not None:
            is_reported = ~np.isnan(friction)
            is_known[:, m.rows + i] = is_reported
            force[is_reported, m.rows + i] = friction[is_reported] / mechanism.slip_radius[i]

    # Solve the balances of some instants at a time, to limit the memory.
    batch = max(1, _MAX_NUMBERS // max(1, len(m.inverse_mass) * force.shape[1]))
    for begin in range(0, len(t), batch):
        rows = slice(begin, begin + batch)
        jacobians, free = columns_of_rows(m, t[rows], q[rows], v[rows])
        inertial = (a[rows] - free) / m.inverse_mass
        force[rows] = _balance(jacobians, inertial, force[rows], is_known[rows], m.rows)

    columns = build_columns(mechanism, t, q, v, a, force)
    if reported:
        columns.update(reported)
        for name, guide in scene.guides.items():
            if guide.length is not None:
                columns.update(corner_columns(name, guide, columns))
    return columns


def _check_names(reactions: Mapping[str, ArrayLike], scene: Scene) -> None:
    """Raise InputError for a name in `reactions` that is not a column of the scene, or one of the motion of a body."""
    labels = [label for group in BODY_COLUMNS for label in group]
    motion = {f"{body}.{label}" for body in scene.bodies for label in labels}
    allowed = [name for name in columns_of(scene) if name not in motion]
    for name in reactions:
        if name not in allowed:
            raise InputError(
                f"reactions: found {shown(name)}; expected names among {names(allowed)}"
                f"{did_you_mean(name, allowed)}"
            )


def _numbers(
    name: str, values: ArrayLike, shape: tuple[int | str, ...], allows_nan: bool = False
) -> np.ndarray:
    """Return an argument as an array for the kernels: float64, C-contiguous, writable.

    Parameters
    ----------
    name
        Name of the argument, for messages.
    values
        Its value.
    shape
        Expected shape; a letter stands for any length.
    allows_nan
        Whether values may be NaN.

    Raises
    ------
    InputError
        If the values are not numbers of this shape, or not finite.
    """
    kind = "numbers" if allows_nan else "finite numbers"
    comma = "," if len(shape) == 1 else ""
    expected = f"expected {kind} of shape ({', '.join(map(str, shape))}{comma})"
    try:
        array = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise InputError(f"{name}: found {error}; {expected}") from None
    if array.dtype.kind not in "fiub":
        raise InputError(f"{name}: found an array of {array.dtype}; {expected}")
    if not _has_shape(array, shape):
        is_transpose = array.ndim == 2 and array.shape[::-1] == shape
        hint = ", its transpose" if is_transpose else ""
        raise InputError(f"{name}: found shape {array.shape}; {expected}{hint}")
    array = np.require(array, float, ("C", "W"))
    is_bad = np.isinf(array) if allows_nan else ~np.isfinite(array)
    if is_bad.any():
        index = tuple(np.argwhere(is_bad)[0])
        place = ", ".join(map(str, index))
        raise InputError(f"{name}: found {array[index]} at [{place}]; {expected}")
    return array


def _has_shape(array: np.ndarray, shape: tuple[int | str, ...]) -> bool:
    """Return whether an array has a shape, in which a letter stands for any length."""
    if array.ndim != len(shape):
        return False
    return all(
        isinstance(size, str) or size == length
        for size, length in zip(shape, array.shape, strict=True)
    )


def columns_of_rows(
    m: Arrays, t: np.ndarray, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return J^T at each instant, shape (n, 3 * bodies, rows + frictional), and M^-1 Q, shape (n, 3 * bodies)."""
    w = workspace(m)
    J, free = np.empty((len(t), len(w.J))), np.empty(q.shape)
    for i in range(len(t)):
        row_form(m, w, t[i], q[i], v[i])
        J[i], free[i] = w.J, w.free
    columns = np.zeros((*q.shape, len(w.force)))
    for place, row, body in m.block:
        columns[:, body : body + 3, row] = J[:, place : place + 3]
    return columns, free


def _balance(
    columns: np.ndarray, needed: np.ndarray, force: np.ndarray, is_known: np.ndarray, rows: int
) -> np.ndarray:
    """Return the row forces that balance a motion, in the least-squares sense and with the least norm.

    Singular values below the largest one times machine precision times the size of the matrix count as zero, as in
    `numpy.linalg.lstsq`.

    Parameters
    ----------
    columns : ndarray, shape (n, 3 * bodies, rows + frictional)
        Generalized forces of unit row forces.
    needed : ndarray, shape (n, 3 * bodies)
        Generalized forces that all row forces must have together.
    force : ndarray, shape (n, rows + frictional)
        Known row forces; the values of unknown ones do not matter.
    is_known : ndarray of bool, shape (n, rows + frictional)
        Which row forces are known.
    rows : int
        Number of constraint rows; the other row forces are frictions.

    Returns
    -------
    ndarray, shape (n, rows + frictional)
        NaN where a null vector that contains frictions contains the force.
    """
    balanced = force.copy()
    remainder = needed - np.einsum("nij,nj->ni", columns, np.where(is_known, force, 0.0))
    # All instants with the same unknowns are solved together.
    for pattern in np.unique(is_known, axis=0):
        instants = np.flatnonzero((is_known == pattern).all(axis=1))
        unknowns = np.flatnonzero(~pattern)
        matrices = columns[np.ix_(instants, np.arange(columns.shape[1]), unknowns)]
        left, size, right = np.linalg.svd(matrices, full_matrices=False)
        coefficients = _inverse(matrices, size) * np.einsum("nik,ni->nk", left, remainder[instants])
        solution = np.einsum("nki,nk->ni", right, coefficients)
        is_open = _moved_with_frictions(matrices, rows, size, right)
        balanced[np.ix_(instants, unknowns)] = np.where(is_open, np.nan, solution)
    return balanced


def parts_of_null_vectors(matrices: np.ndarray, rows: int) -> np.ndarray:
    """Return which unknowns are contained in a null vector that contains frictions, bool, shape (n, j).

    Parameters
    ----------
    matrices : ndarray, shape (n, 3 * bodies, j)
        Columns of the unknowns at each instant: first those of the constraint rows, then those of frictions.
    rows : int
        Number of constraint rows.
    """
    _, size, right = np.linalg.svd(matrices, full_matrices=False)
    return _moved_with_frictions(matrices, rows, size, right)


def _moved_with_frictions(
    matrices: np.ndarray, rows: int, size: np.ndarray, right: np.ndarray
) -> np.ndarray:
    """Return the result of `parts_of_null_vectors` from the singular values and the right singular vectors."""
    parts = _null_parts(matrices, size, right)
    is_hyperstatic = (parts[:, rows:] > _MIN_NULL_PART).any(axis=1)
    parts[~is_hyperstatic] = 0.0
    if is_hyperstatic.any():
        # Null vectors of the constraints alone contain no friction, and are subtracted.
        constraints = matrices[is_hyperstatic][:, :, :rows]
        _, size, right = np.linalg.svd(constraints, full_matrices=False)
        parts[is_hyperstatic, :rows] -= _null_parts(constraints, size, right)
    return parts > _MIN_NULL_PART


def _inverse(matrices: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the reciprocals of singular values, shape (n, k); 0 for those that count as zero."""
    largest = np.max(size, axis=1, keepdims=True, initial=0.0)
    is_positive = size > np.finfo(float).eps * max(matrices.shape[1:]) * largest
    return np.divide(1.0, size, out=np.zeros_like(size), where=is_positive)


def _null_parts(matrices: np.ndarray, size: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the diagonal of the projector onto the null space of each matrix, shape (n, j).

    An element is the square of the largest component that the unknown has in a unit null vector.
    """
    is_in_row_space = (_inverse(matrices, size) > 0).astype(float)
    return 1.0 - np.einsum("nk,nkj->nj", is_in_row_space, right**2)
