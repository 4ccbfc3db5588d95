"""Reactions from a motion: what an engine does not report, from the balance of momentum.

M a - Q = J^T force has the multipliers and the frictions on the sliders as unknowns; their rows are those of the
scene's constraints, whoever integrated the motion. Redundant constraints share their force in the minimum-norm sense.

Frictions of guides at rest are unknowns as well. Where more of them hold than the mechanism has freedoms (hyperstatic
rest), a null vector of the unknowns' columns contains frictions: the forces in it can have any size, and the shortest
ones may lie outside Coulomb's cone. Those are nan. The null vectors of the constraints alone, of redundant joints, move
no friction and are not counted.
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

_ROOM = 1_000_000
"""Numbers in the matrices that are solved at a time, 8 MB, at most; one matrix at least."""
_MOVED = 1e-12
"""Square of a force's part in a unit null vector above which it belongs to it; rounding leaves 1e-16, levers of a
millimetre 1e-6."""


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
    q, v, a = (
        _numbers(name, values, (len(t), len(m.inverse_mass)), unknown=name == "a")
        for name, values in (("q", q), ("v", v), ("a", a))
    )
    frictions = [f"{name}.friction" for name in mechanism.guide_names]
    reported = {
        name: _numbers(f"reactions[{name!r}]", values, (len(t),), unknown=True)
        for name, values in (reactions or {}).items()
    }
    friction = np.full((len(t), len(frictions)), np.nan)
    for i, name in enumerate(frictions):
        friction[:, i] = reported.pop(name, np.nan)
    friction /= mechanism.slip_radius
    told = ~np.isnan(friction)
    force, known = (
        np.hstack([np.zeros((len(t), m.rows), dtype=values.dtype), values])
        for values in (np.where(told, friction, 0.0), told)
    )
    at_once = max(1, _ROOM // max(1, len(m.inverse_mass) * force.shape[1]))
    for part in (slice(first, first + at_once) for first in range(0, len(t), at_once)):
        jacobians, free = columns_of_rows(m, t[part], q[part], v[part])
        force[part] = _balanced(
            jacobians, (a[part] - free) / m.inverse_mass, force[part], known[part], m.rows
        )
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
    name: str, values: ArrayLike, shape: tuple[int | str, ...], unknown: bool = False
) -> np.ndarray:
    """Return an argument as the kernels take it: float64, C-contiguous, writable.

    `shape` may have a letter; `unknown`: NaN is allowed.
    """
    wanted = (
        f"expected {'number' if unknown else 'finite number'}s of shape "
        f"({', '.join(map(str, shape))}{',' * (len(shape) == 1)})"
    )
    try:
        found = np.asarray(values)
    except ValueError as error:  # rows of unlike length
        raise InputError(f"{name}: found {error}; {wanted}") from None
    if found.dtype.kind not in "fiub":
        raise InputError(f"{name}: found an array of {found.dtype}; {wanted}")
    if found.ndim != len(shape) or any(
        isinstance(size, int) and size != other for size, other in zip(shape, found.shape)
    ):
        turned = ", its transpose" if found.ndim == 2 and found.shape[::-1] == shape else ""
        raise InputError(f"{name}: found shape {found.shape}; {wanted}{turned}")
    found = np.require(found, float, ("C", "W"))
    if (bad := np.argwhere(np.isinf(found) if unknown else ~np.isfinite(found))).size:
        place = ", ".join(map(str, bad[0]))
        raise InputError(f"{name}: found {found[tuple(bad[0])]} at [{place}]; {wanted}")
    return found


def columns_of_rows(
    m: Arrays, t: np.ndarray, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return J^T at each instant, and M^-1 Q without joints.

    Their shapes are (n, 3 * bodies, rows + frictional) and (n, 3 * bodies).
    """
    w = workspace(m)
    J, free = np.empty((len(t), len(w.J))), np.empty(q.shape)
    for i in range(len(t)):
        row_form(m, w, t[i], q[i], v[i])
        J[i], free[i] = w.J, w.free
    columns = np.zeros((*q.shape, len(w.force)))
    for place, row, body in m.block:
        columns[:, body : body + 3, row] = J[:, place : place + 3]
    return columns, free


def _balanced(
    columns: np.ndarray, needed: np.ndarray, force: np.ndarray, known: np.ndarray, rows: int
) -> np.ndarray:
    """Row forces (n, rows + frictional).

    Those that are known, and with them the smallest others whose sum in the least-squares sense is `needed`, (n, 3 *
    bodies).

    nan where a null vector that contains frictions moves them. Singular values below the largest times machine
    precision times the size count as zero, as in `numpy.linalg.lstsq`.
    """
    found = force.copy()
    rest = needed - np.einsum("nij,nj->ni", columns, np.where(known, force, 0.0))
    for pattern in np.unique(known, axis=0):
        those, others = np.flatnonzero((known == pattern).all(axis=1)), np.flatnonzero(~pattern)
        matrices = columns[np.ix_(those, np.arange(columns.shape[1]), others)]
        left, size, right = np.linalg.svd(matrices, full_matrices=False)
        solved = np.einsum(
            "nki,nk->ni",
            right,
            _inverse(matrices, size) * np.einsum("nik,ni->nk", left, rest[those]),
        )
        moved = _moved_with_frictions(matrices, rows, size, right)
        found[np.ix_(those, others)] = np.where(moved, np.nan, solved)
    return found


def parts_of_null_vectors(matrices: np.ndarray, rows: int) -> np.ndarray:
    """Return which unknowns a null vector that contains frictions moves, shape (n, j).

    matrices : ndarray, shape (n, 3 * bodies, j)
        Columns of the unknowns at each instant: those of `rows` constraints, then those of frictions.
    """
    _, size, right = np.linalg.svd(matrices, full_matrices=False)
    return _moved_with_frictions(matrices, rows, size, right)


def _moved_with_frictions(
    matrices: np.ndarray, rows: int, size: np.ndarray, right: np.ndarray
) -> np.ndarray:
    """Do the work of `parts_of_null_vectors`, from singular values and right vectors."""
    moved = _null_parts(matrices, size, right)
    hyperstatic = (moved[:, rows:] > _MOVED).any(axis=1)
    moved[~hyperstatic] = 0.0
    if hyperstatic.any():
        # null vectors of the constraints alone move no friction, and are taken out
        alone = matrices[hyperstatic][:, :, :rows]
        _, size, right = np.linalg.svd(alone, full_matrices=False)
        moved[hyperstatic, :rows] -= _null_parts(alone, size, right)
    return moved > _MOVED


def _inverse(matrices: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return 1 / singular values; 0 for those that count as zero."""
    kept = size > np.finfo(float).eps * max(matrices.shape[1:]) * np.max(
        size, axis=1, keepdims=True, initial=0.0
    )
    return np.divide(1.0, size, out=np.zeros_like(size), where=kept)


def _null_parts(matrices: np.ndarray, size: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the diagonal of the projector onto the null vectors of matrices (n, i, j), (n, j).

    The square of each unknown's largest part in one of unit length.
    """
    return 1.0 - np.einsum("nk,nkj->nj", (_inverse(matrices, size) > 0).astype(float), right**2)
