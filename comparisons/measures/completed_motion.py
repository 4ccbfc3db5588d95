"""Completion of a motion: the coordinates and velocities of all bodies, computed from some of them.

In a mechanism with one degree of freedom, one coordinate determines all others by the constraints
and drives. The unknown coordinates are the solution of Phi(q, t) = 0 by the Gauss-Newton method,
which starts from the truth. The unknown velocities are the solution of J v + Phi_t = 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stiction.engines.examined import POSITIONS, VELOCITIES
from stiction.reference_impl.energies import energy_columns, needed_columns
from stiction.reference_impl.equations_of_motion import EquationsOfMotion, Motion
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.reactions import recover_columns
from stiction.reference_impl.multibody.trajectory_columns import corner_columns
from stiction.scenes import Scene
from stiction.scenes.column_file import row_slices
from stiction.scenes.model import Revolute
from stiction.scenes.stribeck import (
    bound_in_slip,
    coefficient_in_slip,
    friction_radius_in_slip,
)
from stiction.truths import Truth

RANK = 1e-9
"""Ratio of the smallest to the largest singular value of the equations for the unknown coordinates,
below which they do not determine these."""
ENLARGED = 20.0
"""Largest factor by which errors of given coordinates are amplified in completed ones, with angles
multiplied by the mechanism's size. Near a dead centre it is larger, and the completed motion is not
that of the table."""
ROUNDS = 20
"""Largest number of Gauss-Newton steps."""
CONVERGED = 1e-10
"""Size of the last Gauss-Newton step, relative to the mechanism's size."""
LEFT = 1e-2
"""Largest violation of the constraints in a completed state, relative to the mechanism's size. If
it is larger, the columns contradict each other and are not a motion of the mechanism."""
AT_ONCE = 2**13
"""Number of instants that are solved together, which limits the memory."""
MOST = 20_001
"""Largest number of instants of an energy balance with accelerations from differences of
velocities. With closer instants, the differences would be rounding errors."""
STRIDES = (2, 3)
"""Every second and every third row are used to estimate the error of the energy balance."""
FEWEST = 9
"""Smallest number of rows of an energy balance: three remain with the larger stride, as
second-order differences need."""
STILL = 1e-3
"""Slip velocity below which a guide is at rest, relative to its largest slip velocity."""


@dataclass(frozen=True)
class Completion:
    """The coordinates and velocities of a scene that a table contains, from which the others are computed.

    Attributes
    ----------
    scene : Scene
    truth : Truth
        Truth of the scene; its positions are the initial guess.
    has_position, has_velocity : ndarray of bool, shape (k,)
        Which coordinates, and which velocities, are given, for x, y and angle of each body: k is
        three times the number of bodies.
    guides : tuple of str
        Guides whose displacement is given; empty if all coordinates are given.
    """

    scene: Scene
    truth: Truth
    has_position: np.ndarray
    has_velocity: np.ndarray
    guides: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scene, columns: Mapping[str, np.ndarray], truth: Truth) -> Completion | None:
        """Return the completion for the columns of a table; None if no coordinate is given."""
        has_position, has_velocity = (
            np.array([f"{body}.{label}" in columns for body in scene.bodies for label in labels])
            for labels in (POSITIONS, VELOCITIES)
        )
        guides: tuple[str, ...] = ()
        if not has_position.all():
            guides = tuple(name for name in scene.guides if f"{name}.displacement" in columns)
        if not has_position.any() and not guides:
            return None
        return cls(scene, truth, has_position, has_velocity, guides)

    def names(self, labels: tuple[str, ...]) -> list[str]:
        """Return the names of the columns of all bodies with some labels."""
        return [f"{body}.{label}" for body in self.scene.bodies for label in labels]

    def positions(self, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> np.ndarray | None:
        """Return the coordinates of all bodies, shape (n, k); None if they are not determined at all instants."""
        parts = []
        for part in row_slices(len(t), AT_ONCE):
            given = {name: columns[name][part] for name in self._given(columns)}
            q = self._positions(t[part], given)
            if q is None:
                return None
            parts.append(q)
        return np.concatenate(parts)

    def _given(self, columns: Mapping[str, np.ndarray]) -> list[str]:
        """Return the names of the columns with coordinates or velocities."""
        labels = {
            f"{guide}.{label}"
            for guide in self.scene.guides
            for label in ("displacement", "slip_velocity")
        }
        return [
            name
            for name in columns
            if name in {*self.names(POSITIONS), *self.names(VELOCITIES), *labels}
        ]

    def _positions(self, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> np.ndarray | None:
        """Return the coordinates at some instants, all of which are solved together; see `positions`."""
        equations = EquationsOfMotion(self.scene)
        q = np.tile(equations.start()[0], (len(t), 1))
        # The truth is the initial guess of the unknown coordinates, because it is near and on the
        # right branch of the constraints.
        true = self.truth(t) if not self.has_position.all() else {}
        for i, name in enumerate(self.names(POSITIONS)):
            source = columns if self.has_position[i] else true
            if name in source:
                q[:, i] = source[name]
        unknown = ~self.has_position
        if not unknown.any():
            return q
        # Gauss-Newton steps: the smallest least-squares solution at each instant.
        scale = self._scale()
        for _ in range(ROUNDS):
            residual, J = self._equations(equations, t, q, columns)
            J = J[..., unknown] / scale[unknown]
            step = -np.einsum("nij,nj->ni", np.linalg.pinv(J), residual)
            q[:, unknown] += step / scale[unknown]
            if np.max(np.abs(step)) <= CONVERGED * max(scale.max(), np.max(np.abs(q))):
                break
        else:
            return None
        # The least-squares solution satisfies the equations only if the residual is small, and it is
        # unique only if the equations determine the unknown coordinates.
        residual, J = self._equations(equations, t, q, columns)
        if np.max(np.abs(residual)) > LEFT * scale.max():
            return None
        return q if _are_determined(J / scale, unknown, len(self.guides)) else None

    def _scale(self) -> np.ndarray:
        """Return the length of a unit of each coordinate, shape (k,), m: the mechanism's size for angles."""
        size = Mechanism(self.scene, stabilization="none").arrays.length_scale
        return np.tile([1.0, 1.0, size], len(self.scene.bodies))

    def _equations(
        self,
        equations: EquationsOfMotion,
        t: np.ndarray,
        q: np.ndarray,
        columns: Mapping[str, np.ndarray],
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (n, rows) of the constraints and of given displacements, and their Jacobian (n, rows, k)."""
        terms = equations.at(t, q, np.zeros_like(q))
        motion = Motion(list(self.scene.bodies), t, q, np.zeros_like(q))
        residuals, jacobians = [terms.phi], [terms.J]
        for name in self.guides:
            guide = self.scene.guides[name]
            displacement = motion.direction(guide.guide, guide.direction).dot(
                motion.between(guide.bodies, (guide.slider_point, guide.point))
            )
            residuals.append((displacement.value - columns[f"{name}.displacement"])[:, None])
            jacobians.append(displacement.jacobian[:, None])
        return np.concatenate(residuals, axis=1), np.concatenate(jacobians, axis=1)

    def velocities(
        self, t: np.ndarray, q: np.ndarray, columns: Mapping[str, np.ndarray]
    ) -> np.ndarray | None:
        """Return the velocities of all bodies, shape (n, k); None if the given ones do not determine the others."""
        given = {name: columns[name] for name in self._given(columns)}
        return self._velocities(t, q, given)

    def differences(
        self, t: np.ndarray, q: np.ndarray, columns: Mapping[str, np.ndarray]
    ) -> np.ndarray:
        """Return the velocities of all bodies, shape (n, k): given ones, and differences of coordinates for others."""
        v = np.gradient(q, t, axis=0, edge_order=2)
        for i, name in enumerate(self.names(VELOCITIES)):
            if name in columns:
                v[:, i] = columns[name]
        return v

    def _velocities(
        self, t: np.ndarray, q: np.ndarray, columns: Mapping[str, np.ndarray]
    ) -> np.ndarray | None:
        """Return the velocities for the columns with coordinates or velocities; see `velocities`."""
        equations = EquationsOfMotion(self.scene)
        scale = self._scale()
        v = np.zeros_like(q)
        for i, name in enumerate(self.names(VELOCITIES)):
            if self.has_velocity[i]:
                v[:, i] = columns[name]
        unknown = ~self.has_velocity
        if not unknown.any():
            return v
        for part in row_slices(len(t), AT_ONCE):
            # phi_dot is J v + Phi_t; here the unknown velocities are still zero
            terms = equations.at(t[part], q[part], v[part])
            if not _are_determined(terms.J / scale, unknown):
                return None
            J = terms.J[..., unknown] / scale[unknown]
            v[part, unknown] = (
                -np.einsum("nij,nj->ni", np.linalg.pinv(J), terms.phi_dot) / scale[unknown]
            )
        return v


def _are_determined(J: np.ndarray, unknown: np.ndarray, displacements: int = 0) -> bool:
    """Return whether linear equations determine the unknown coordinates at all instants.

    Parameters
    ----------
    J : ndarray, shape (n, rows, k)
        Jacobian of the equations, scaled to lengths.
    unknown : ndarray of bool, shape (k,)
    ways : int
        Number of the last rows that are those of given displacements, which have errors like given
        coordinates.
    """
    rows = J.shape[-2]
    on_unknown = J[..., unknown]
    if on_unknown.shape[-1] > rows:
        return False
    singular_values = np.linalg.svd(on_unknown, compute_uv=False)
    if not np.all(singular_values[:, -1] > RANK * singular_values[:, 0]):
        return False
    # Errors of given coordinates and displacements are amplified by these matrices.
    inverse = np.linalg.pinv(on_unknown)
    gains = [inverse @ J[..., ~unknown], inverse[..., rows - displacements :]]
    return all(np.max(np.abs(gain), initial=0.0) <= ENLARGED for gain in gains)


def slips(
    completion: Completion, t: np.ndarray, columns: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the slip velocities of all guides with friction, m/s, by column; empty if they are not determined.

    They are computed from the given velocities if these determine all others, and otherwise as
    differences of displacements.
    """
    q = completion.positions(t, columns)
    if q is None:
        return {}
    v = completion.velocities(t, q, columns)
    displacements: dict[str, list[np.ndarray]] = {}
    rates: dict[str, list[np.ndarray]] = {}
    for part in row_slices(len(t), AT_ONCE):
        v_part = None if v is None else v[part]
        for name, displacement, rate in _slips_of_guides(
            completion.scene, t[part], q[part], v_part
        ):
            displacements.setdefault(name, []).append(displacement)
            rates.setdefault(name, []).append(rate)
    slip_of_guide = {}
    for name in rates:
        if v is None:
            slip = np.gradient(np.concatenate(displacements[name]), t)
        else:
            slip = np.concatenate(rates[name])
        slip_of_guide[f"{name}.slip_velocity"] = slip
    return slip_of_guide


def _slips_of_guides(
    scene: Scene, t: np.ndarray, q: np.ndarray, v: np.ndarray | None
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield name, displacement (m) and slip velocity (m/s) of each joint with friction; of a pin rad and rad/s."""
    motion = Motion(list(scene.bodies), t, q, np.zeros_like(q) if v is None else v)
    for name, joint in scene.frictional_joints.items():
        if isinstance(joint, Revolute):
            displacement = motion.angle(joint.bodies[0]) - motion.angle(joint.bodies[1])
        else:
            displacement = motion.direction(joint.guide, joint.direction).dot(
                motion.between(joint.bodies, (joint.slider_point, joint.point))
            )
        yield name, displacement.value, displacement.rate


def energy_of_motion(
    completion: Completion, t: np.ndarray, columns: Mapping[str, np.ndarray]
) -> tuple[float, float, float] | None:
    """Return the energy that is not accounted for, like `unaccounted_energy`, if velocities or forces are not given.

    The forces are those that the motion requires (`recover_columns`), with accelerations from
    differences. The dissipation in guides, however, is that of Coulomb's law with the kinetic
    coefficient. So the balance shows whether the motion of the table is possible with the friction
    of the scene.

    The uncertainty is twice the largest difference from the balances of every second and of every
    third row. Differences are of first order at kinks of the velocity, so that the error is about
    half as large with half the step. It also depends on the position of a kink between two rows,
    which is different with each stride.

    Parameters
    ----------
    completion : Completion
    t : ndarray, shape (n,)
        Distinct times, s.
    columns : Mapping[str, ndarray]
        Columns of the table, each of shape (n,).

    Returns
    -------
    tuple of float or None
        Largest energy that is not accounted for, its uncertainty, and the sum of all changes of the
        kinetic energy; J. None if the columns do not determine the motion or its forces.
    """
    # With at most MOST rows, differences are not dominated by rounding.
    every = math.ceil(len(t) / MOST)
    t = t[::every]
    strided = {
        name: columns[name][::every]
        for name in {*completion._given(columns), *needed_columns(completion.scene)}
        if name in columns
    }
    if len(t) < FEWEST:
        return None
    fine = _balance(completion, t, strided)
    if fine is None:
        return None
    largest_difference = 0.0
    for stride in STRIDES:
        fewer_rows = {name: values[::stride] for name, values in strided.items()}
        coarse = _balance(completion, t[::stride], fewer_rows)
        if coarse is None:
            return None
        difference = fine["balance"].to_numpy()[::stride] - coarse["balance"].to_numpy()
        largest_difference = max(largest_difference, float(np.max(np.abs(difference))))
    exchanged = float(np.sum(np.abs(np.diff(fine["kinetic"]))))
    return float(fine["balance"].abs().max()), 2 * largest_difference, exchanged


def _balance(
    completion: Completion, t: np.ndarray, columns: Mapping[str, np.ndarray]
) -> pd.DataFrame | None:
    """Return `energy_columns` of the completed motion; None if motion or forces are not determined."""
    scene = completion.scene
    q = completion.positions(t, columns)
    if q is None:
        return None
    v = completion.velocities(t, q, columns)
    if v is None:
        v = completion.differences(t, q, columns)
    given = {
        name: columns[name]
        for name in needed_columns(scene)
        if name in columns and name.endswith((".effort", ".friction"))
    }
    # Forces that the motion requires; given ones are used as they are.
    accelerations = np.gradient(v, t, axis=0, edge_order=2)
    completed = {**recover_columns(scene, t, q, v, accelerations, given), **given}
    for name, _, slip in _slips_of_guides(scene, t, q, v):
        if f"{name}.friction" not in given:
            completed[f"{name}.friction"] = _coulomb(scene, name, slip, completed)
    if any(np.isnan(completed[name]).any() for name in needed_columns(scene)):
        return None
    return energy_columns(scene, t, completed)


def _coulomb(
    scene: Scene, name: str, slip: np.ndarray, columns: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Return the friction of a joint in slip by its bound and coefficient, N or N m; zero at rest, without work."""
    joint = scene.joints[name]
    mode = np.where(np.abs(slip) > STILL * np.max(np.abs(slip)), np.sign(slip), 0.0)
    bound = bound_in_slip(joint, slip)
    if isinstance(joint, Revolute):
        force = np.hypot(columns[f"{name}.fx"], columns[f"{name}.fy"])
        return -mode * (bound + friction_radius_in_slip(joint, slip) * force)
    if joint.length is None:
        load = np.abs(columns[f"{name}.normal_force"])
    else:
        given = {**columns, f"{name}.mode": mode, f"{name}.slip_velocity": slip}
        sliding = corner_columns(name, joint, given)
        load = sum(sliding[f"{name}.F{corner}"] for corner in (1, 2, 3, 4))
    return np.where(mode != 0, -mode * (bound + coefficient_in_slip(joint, slip) * load), 0.0)
