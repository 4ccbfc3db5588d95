"""Equations of motion of a scene at one instant, for those who write a solver: the paper's symbols as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stiction.reference_impl.friction.coulomb import split_between_corners
from stiction.reference_impl.multibody.kinematics import workspace
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.reactions import row_matrices
from stiction.scenes import InputError, Scene
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.model import Translational


@dataclass(frozen=True, eq=False)
class Equations:
    """The equations M v' = Q + J^T multipliers + W_T frictions, with Phi = 0 and Phi'' = J v' + gamma = 0.

    Attributes
    ----------
    coordinates : tuple of str
        Names of q, ``bar.x``, ``bar.y``, ``bar.angle``, ..: n of them, body by body.
    rows : tuple of str
        Columns of the multipliers, ``pin.fx``, ``guide.normal_force``, ``motor.effort``, ..: m of them.
    guides : tuple of str
        Frictional guides: f of them.
    M : ndarray, shape (n, n)
        Mass matrix; coordinates are those of centres of mass, so that it is diagonal.
    Q : ndarray, shape (n,)
        Applied forces: weight, springs and dampers, loads; N and N m.
    Phi, Phi_dot, gamma : ndarray, shape (m,)
        Residuals of the constraints, their rates, and what their second derivatives are without J v'.
    J : ndarray, shape (m, n)
        Derivative of Phi by q.
    W_T : ndarray, shape (n, f)
        Generalized force of a unit of friction on each slider, along its guide's direction.
    slip_velocity : ndarray, shape (f,)
        Of each slider along its guide, m/s.
    """

    coordinates: tuple[str, ...]
    rows: tuple[str, ...]
    guides: tuple[str, ...]
    M: np.ndarray
    Q: np.ndarray
    Phi: np.ndarray
    Phi_dot: np.ndarray
    gamma: np.ndarray
    J: np.ndarray
    W_T: np.ndarray
    slip_velocity: np.ndarray


def equations_of_motion(scene: Scene, t: float, q: ArrayLike, v: ArrayLike) -> Equations:
    """Evaluate mass matrix, constraints and applied forces; nothing of a stabilization is among them.

    Parameters
    ----------
    t : float
        Seconds.
    q, v : array_like, shape (3 * bodies,)
        x, y, angle per body in the order of the scene, and their rates.

    Returns
    -------
    Equations
        By eqs. (19) and (24) of the paper for any planar mechanism.

    Raises
    ------
    InputError
        For states of another shape or that are not finite.
    """
    mechanism = Mechanism(scene, stabilization="none")
    m = mechanism.arrays
    q, v = (_state(name, values, len(m.inverse_mass)) for name, values in (("q", q), ("v", v)))
    w = workspace(m)
    [force_rows], [free] = row_matrices(m, np.array([float(t)]), q[None], v[None], w)
    names = tuple(f"{body}.{label}" for body in mechanism.body_names for label in BODY_COLUMNS[0])
    return Equations(names, tuple(mechanism.row_names), tuple(mechanism.guide_names), np.diag(1.0 / m.inverse_mass),
                     free / m.inverse_mass, w.phi.copy(), w.phi_dot.copy(), w.gamma[:m.rows].copy(),
                     force_rows[:, :m.rows].T.copy(), force_rows[:, m.rows:].copy(), w.slip_speed.copy())


def corner_forces(guide: Translational, normal_force: ArrayLike, moment: ArrayLike) -> np.ndarray:
    """Split the normal forces of a slider between its four corners, by eqs. (1) and (2) of the paper.

    Parameters
    ----------
    guide : Translational
        With a `length`.
    normal_force : array_like
        Resultant on the slider along the guide's normal, N.
    moment : array_like
        Of the normal forces alone on the slider about its point, N m: without that of the surface frictions.

    Returns
    -------
    ndarray, shape (4, ..)
        F1 lower rear, F2 lower front, F3 upper front, F4 upper rear; N, none is negative.

    Raises
    ------
    InputError
        For a guide without a length.
    """
    if guide.length is None:
        raise InputError("guide.length: found none; expected a guide with corners")
    n1, n2 = split_between_corners.__wrapped__(np.asarray(normal_force, float), np.asarray(moment, float), guide.length)
    return np.array([np.maximum(n, 0.0) for n in (n1, n2, -n2, -n1)])


def _state(name: str, values: ArrayLike, size: int) -> np.ndarray:
    found = np.array(values, dtype=float)
    if found.shape != (size,) or not np.isfinite(found).all():
        raise InputError(f"{name}: found {found!r}; expected {size} finite numbers, three for each body")
    return found
