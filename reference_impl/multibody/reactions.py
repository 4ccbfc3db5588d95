"""Reactions from a motion: what an engine does not report, from the balance of momentum.

M a - Q = J^T force has the multipliers and the frictions on the sliders as unknowns; their rows are those of the
scene's constraints, whoever integrated the motion. Redundant constraints share their force in the minimum-norm sense.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.kinematics import workspace
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.trajectory_columns import build_columns, corner_forces
from stiction.scenes import Scene


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
    m, w = mechanism.arrays, workspace(mechanism.arrays)
    size = m.rows + len(m.friction)
    force = np.zeros((len(t), size))
    mass = 1.0 / m.inverse_mass
    columns_of_rows = np.zeros((len(m.inverse_mass), size))
    reactions = dict(reactions or {})
    friction = np.full((len(t), len(m.friction)), np.nan)
    for i, name in enumerate(mechanism.guide_names):
        friction[:, i] = reactions.pop(f"{name}.friction", np.nan)
    for i in range(len(t)):
        row_form(m, w, t[i], q[i], v[i])
        columns_of_rows[:] = 0.0
        for place, row, body in m.block:
            columns_of_rows[body:body + 3, row] = w.J[place:place + 3]
        known = np.append(np.zeros(m.rows, dtype=bool), ~np.isnan(friction[i]))
        right = mass * (a[i] - w.free) - columns_of_rows[:, known] @ friction[i, known[m.rows:]]
        force[i, known] = friction[i, known[m.rows:]]
        force[i, ~known] = np.linalg.lstsq(columns_of_rows[:, ~known], right, rcond=None)[0]
    columns = build_columns(mechanism, t, q, v, a, force)
    if reactions:
        columns.update({name: np.asarray(values, dtype=float) for name, values in reactions.items()})
        for name, guide in scene.guides.items():
            if guide.length is not None:
                columns.update(corner_forces(name, guide, columns))
    return columns
