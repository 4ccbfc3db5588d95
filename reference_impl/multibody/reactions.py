"""Reactions from a motion: what an engine does not report, from the balance of momentum.

M a - Q = J^T force has the multipliers and the frictions on the sliders as unknowns; their rows are those of the
scene's constraints, whoever integrated the motion. Redundant constraints share their force in the minimum-norm sense.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.kinematics import workspace
from stiction.reference_impl.multibody.mechanism import Arrays, Mechanism
from stiction.reference_impl.multibody.trajectory_columns import build_columns, corner_forces
from stiction.scenes import Scene

_ROOM = 1_000_000
"""Numbers in the matrices that are solved at a time, 8 MB, at most; one matrix at least."""


def recover_columns(scene: Scene, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray,
                    reactions: Mapping[str, np.ndarray] | None = None) -> dict[str, np.ndarray]:
    """All columns of a trajectory from states and accelerations.

    Parameters
    ----------
    t : ndarray, shape (n,)
    q, v, a : ndarray, shape (n, 3 * bodies)
        x, y, angle per body in the order of the scene, their rates and accelerations.
    reactions : mapping of str to ndarray of shape (n,), optional
        Columns that the engine itself reports, e.g. ``"motor.effort"``, ``"guide.normal_force"``; they replace the
        recovered ones, and corner forces follow from them. A guide's ``friction`` is taken as known where it is not
        NaN and the others follow from it: in a mechanism with more guides than freedoms the motion alone does not
        tell frictions from reactions.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        Columns as in `stiction.scenes.Trajectory`; friction is the tangential force that the motion needs,
        whatever law the engine used. Corner forces: equal mobilization of both surfaces.
    """
    mechanism = Mechanism(scene, stabilization="none")
    m = mechanism.arrays
    reactions = dict(reactions or {})
    friction = np.full((len(t), len(m.friction)), np.nan)
    for i, name in enumerate(mechanism.guide_names):
        friction[:, i] = reactions.pop(f"{name}.friction", np.nan)
    told = ~np.isnan(friction)
    force, known = (np.hstack([np.zeros((len(t), m.rows), dtype=values.dtype), values]) for values in (np.where(told, friction, 0.0), told))
    at_once = max(1, _ROOM // max(1, len(m.inverse_mass) * force.shape[1]))
    for part in (slice(first, first + at_once) for first in range(0, len(t), at_once)):
        columns_of_rows, free = _rows(m, t[part], q[part], v[part])
        force[part] = _balanced(columns_of_rows, (a[part] - free) / m.inverse_mass, force[part], known[part])
    columns = build_columns(mechanism, t, q, v, a, force)
    if reactions:
        columns.update({name: np.asarray(values, dtype=float) for name, values in reactions.items()})
        for name, guide in scene.guides.items():
            if guide.length is not None:
                columns.update(corner_forces(name, guide, columns))
    return columns


def _rows(m: Arrays, t: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """J^T at each instant, shape (n, 3 * bodies, rows + frictional), and the accelerations M^-1 Q without joints, shape (n, 3 * bodies)."""
    w = workspace(m)
    J, free = np.empty((len(t), len(w.J))), np.empty(q.shape)
    for i in range(len(t)):
        row_form(m, w, t[i], q[i], v[i])
        J[i], free[i] = w.J, w.free
    columns_of_rows = np.zeros((*q.shape, len(w.force)))
    for place, row, body in m.block:
        columns_of_rows[:, body:body + 3, row] = J[:, place:place + 3]
    return columns_of_rows, free


def _balanced(columns_of_rows: np.ndarray, needed: np.ndarray, force: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Row forces (n, rows + frictional): those that are known, and with them the smallest others whose sum in the least-squares sense is `needed`, (n, 3 * bodies).

    Singular values below the largest times machine precision times the size count as zero, as in `numpy.linalg.lstsq`.
    """
    found = force.copy()
    rest = needed - np.einsum("nij,nj->ni", columns_of_rows, np.where(known, force, 0.0))
    for pattern in np.unique(known, axis=0):
        those, others = np.flatnonzero((known == pattern).all(axis=1)), np.flatnonzero(~pattern)
        matrices = columns_of_rows[np.ix_(those, range(columns_of_rows.shape[1]), others)]
        inverses = np.linalg.pinv(matrices, rcond=np.finfo(float).eps * max(matrices.shape[1:]))
        found[np.ix_(those, others)] = np.einsum("nij,nj->ni", inverses, rest[those])
    return found
