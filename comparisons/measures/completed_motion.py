"""The motion of all bodies from some coordinates of a table: what constraints and drives determine beside them.

Of a mechanism with one freedom one coordinate determines all others. The unknown coordinates are those with Phi(q, t) =
0, from the truth's as a guess, by Gauss-Newton; the unknown velocities those with J v + Phi_t = 0.
"""

from __future__ import annotations

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
from stiction.truths import Truth

RANK = 1e-9
"""Ratio of the smallest to the largest singular value of the equations of the unknown coordinates below which these are
not determined."""
ENLARGED = 20.0
"""Factor by which errors of given coordinates may be enlarged in completed ones (angles times the mechanism's size):
near a dead centre it is larger, and a completed motion says nothing of the table."""
ROUNDS, CONVERGED = 20, 1e-10
"""Gauss-Newton steps at most, and the last of them, in parts of the mechanism's size."""
LEFT = 1e-2
"""Part of the mechanism's size by which a completed state may violate the constraints: columns that contradict each
other by more are of no motion of it."""
AT_ONCE = 2**13
"""Instants that are solved together."""
MOST = 20_001
"""Instants whose energy is balanced where accelerations are differences of velocities: of closer ones the differences
are rounding."""
STRIDES, FEWEST = (2, 3), 9
"""Distances of the rows of coarser balances, and instants at least: second-order differences take three."""
STILL = 1e-3
"""A guide is at rest below this part of its largest slip velocity."""


@dataclass(frozen=True)
class Completion:
    """Which coordinates of a scene a table has, and that the others follow from them.

    `places`, `rates`: of the coordinates and velocities (order: x, y, angle of each body) that are given, bool (k,).
    `ways`: guides whose displacement is given, while a coordinate of a body is not.
    """

    scene: Scene
    truth: Truth
    places: np.ndarray
    rates: np.ndarray
    ways: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scene, columns: Mapping[str, np.ndarray], truth: Truth) -> Completion | None:
        """Return the completion of a table; None where it has no coordinate."""
        places, rates = (
            np.array([f"{body}.{label}" in columns for body in scene.bodies for label in labels])
            for labels in (POSITIONS, VELOCITIES)
        )
        ways = tuple(
            name for name in scene.guides if f"{name}.displacement" in columns and not places.all()
        )
        return cls(scene, truth, places, rates, ways) if places.any() or ways else None

    def names(self, labels: tuple[str, ...]) -> list[str]:
        """Columns of all bodies."""
        return [f"{body}.{label}" for body in self.scene.bodies for label in labels]

    def positions(self, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> np.ndarray | None:
        """Coordinates of all bodies, (n, k); None where the given ones do not determine the others at all instants."""
        parts = []
        for part in row_slices(len(t), AT_ONCE):
            given = {name: columns[name][part] for name in self._given(columns)}
            parts.append(self._positions(t[part], given))
        known = [q for q in parts if q is not None]
        return np.concatenate(known) if len(known) == len(parts) else None

    def _given(self, columns: Mapping[str, np.ndarray]) -> list[str]:
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
        equations = EquationsOfMotion(self.scene)
        q = np.tile(equations.start()[0], (len(t), 1))
        # Given coordinates as they are, the others from the truth: close enough for Gauss-Newton,
        # and on the right branch of the constraints.
        true = self.truth(t) if not self.places.all() else {}
        for place, name in enumerate(self.names(POSITIONS)):
            source = columns if self.places[place] else true
            if name in source:
                q[:, place] = source[name]
        unknown = ~self.places
        if not unknown.any():
            return q
        # All instants at once, each with its own least-squares step.
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
        # Converged to a least-squares solution, which is one of the equations only where the
        # residual is small, and the only one where they determine it.
        residual, J = self._equations(equations, t, q, columns)
        if np.max(np.abs(residual)) > LEFT * scale.max() or not _are_determined(
            J / scale, unknown, len(self.ways)
        ):
            return None
        return q

    def _scale(self) -> np.ndarray:
        """1 of lengths, the mechanism's size of angles, (k,)."""
        size = Mechanism(self.scene, stabilization="none").arrays.length_scale
        return np.tile([1.0, 1.0, size], len(self.scene.bodies))

    def _equations(
        self,
        equations: EquationsOfMotion,
        t: np.ndarray,
        q: np.ndarray,
        columns: Mapping[str, np.ndarray],
    ) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (n, rows) of the constraints and of given displacements, and their Jacobian (n, rows, k)."""
        terms = equations.at(t, q, np.zeros_like(q))
        motion = Motion(list(self.scene.bodies), t, q, np.zeros_like(q))
        residuals, jacobians = [terms.phi], [terms.J]
        for name in self.ways:
            guide = self.scene.guides[name]
            way = motion.direction(guide.guide, guide.direction).dot(
                motion.between(guide.bodies, (guide.slider_point, guide.point))
            )
            residuals.append((way.value - columns[f"{name}.displacement"])[:, None])
            jacobians.append(way.jacobian[:, None])
        return np.concatenate(residuals, axis=1), np.concatenate(jacobians, axis=1)

    def velocities(
        self, t: np.ndarray, q: np.ndarray, columns: Mapping[str, np.ndarray]
    ) -> np.ndarray | None:
        """Velocities of all bodies, (n, k), from those that are given, where these determine the others; else None."""
        return self._velocities(
            t, q, {name: columns[name] for name in self._given(columns)}, self.rates
        )

    def differences(
        self, t: np.ndarray, q: np.ndarray, columns: Mapping[str, np.ndarray]
    ) -> np.ndarray:
        """Velocities of all bodies: given ones, and else the difference quotients of coordinates."""
        v = np.gradient(q, t, axis=0, edge_order=2)
        for place, name in enumerate(self.names(VELOCITIES)):
            if name in columns:
                v[:, place] = columns[name]
        return v

    def _velocities(
        self, t: np.ndarray, q: np.ndarray, columns: Mapping[str, np.ndarray], rates: np.ndarray
    ) -> np.ndarray | None:
        unknown, equations, scale = ~rates, EquationsOfMotion(self.scene), self._scale()
        v = np.zeros_like(q)
        for place, name in enumerate(self.names(VELOCITIES)):
            if rates[place]:
                v[:, place] = columns[name]
        for part in row_slices(len(t), AT_ONCE) if unknown.any() else ():
            # phi_dot = J v + Phi_t, with zero for the unknown
            terms = equations.at(t[part], q[part], v[part])
            if not _are_determined(terms.J / scale, unknown):
                return None
            J = terms.J[..., unknown] / scale[unknown]
            v[part, unknown] = (
                -np.einsum("nij,nj->ni", np.linalg.pinv(J), terms.phi_dot) / scale[unknown]
            )
        return v


def _are_determined(J: np.ndarray, unknown: np.ndarray, ways: int = 0) -> bool:
    """Test if linear equations (n, rows, k) determine the unknown coordinates (k,) by the others at all instants.

    The last rows `ways` hold given displacements, whose errors count like those of given coordinates.
    """
    wanted, rows = J[..., unknown], J.shape[-2]
    if wanted.shape[-1] > rows:
        return False
    singular = np.linalg.svd(wanted, compute_uv=False)
    if not np.all(singular[:, -1] > RANK * singular[:, 0]):
        return False
    # d(unknown) = -pinv d(given): how much errors of coordinates, and of displacements, are
    # enlarged
    inverse = np.linalg.pinv(wanted)
    gains = [inverse @ J[..., ~unknown], inverse[..., rows - ways :]]
    return all(np.max(np.abs(gain), initial=0.0) <= ENLARGED for gain in gains)


def slips(
    completion: Completion, t: np.ndarray, columns: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return slip velocities of the frictional guides; none where the columns do not determine them.

    Of given velocities where they determine all others, else difference quotients of displacements.
    """
    q = completion.positions(t, columns)
    if q is None:
        return {}
    v = completion.velocities(t, q, columns)
    parts: dict[str, list[np.ndarray]] = {}
    for part in row_slices(len(t), AT_ONCE):
        v_part = None if v is None else v[part]
        for name, displacement, rate in _ways(completion.scene, t[part], q[part], v_part):
            parts.setdefault(name, []).append(displacement if v is None else rate)
    joined = {name: np.concatenate(values) for name, values in parts.items()}
    return {
        f"{name}.slip_velocity": np.gradient(values, t) if v is None else values
        for name, values in joined.items()
    }


def _ways(
    scene: Scene, t: np.ndarray, q: np.ndarray, v: np.ndarray | None
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Name, displacement and slip velocity of each frictional joint; of a pin relative angle and angular velocity."""
    motion = Motion(list(scene.bodies), t, q, np.zeros_like(q) if v is None else v)
    for name, joint in scene.frictional_joints.items():
        if isinstance(joint, Revolute):
            way = motion.angle(joint.bodies[0]) - motion.angle(joint.bodies[1])
        else:
            way = motion.direction(joint.guide, joint.direction).dot(
                motion.between(joint.bodies, (joint.slider_point, joint.point))
            )
        yield name, way.value, way.rate


def energy_of_motion(
    completion: Completion, t: np.ndarray, columns: Mapping[str, np.ndarray]
) -> tuple[float, float, float] | None:
    """Return what `unaccounted_energy` does, for a table that lacks velocities, efforts or frictions.

    Forces are those that the motion needs, with difference quotients for accelerations (`recover_columns`). Only what
    guides dissipate is Coulomb's: the kinetic coefficient times the load of the guide times the slip. So the balance is
    that of the table's motion with the scene's friction. It is unsure by twice its difference to those of every
    second and every third row: at the kinks of a velocity difference quotients are of first order, and half as wrong
    with half the step; how wrong also depends on where between two rows a kink is, which is another place in each.
    None where the columns do not determine the motion or its forces. Times are distinct, shape (n,).
    """
    # Every n-th row, n rounded up: neighbours that are too close would make differences of
    # rounding.
    every = -(-len(t) // MOST)
    t = t[::every]
    chosen = {
        name: columns[name][::every]
        for name in {*completion._given(columns), *needed_columns(completion.scene)}
        if name in columns
    }
    if len(t) < FEWEST:
        return None
    fine = _balance(completion, t, chosen)
    if fine is None:
        return None
    unsure = 0.0
    for stride in STRIDES:
        fewer = {name: values[::stride] for name, values in chosen.items()}
        coarse = _balance(completion, t[::stride], fewer)
        if coarse is None:
            return None
        off = fine["balance"].to_numpy()[::stride] - coarse["balance"].to_numpy()
        unsure = max(unsure, float(np.max(np.abs(off))))
    changes = np.sum(np.abs(np.diff(fine["kinetic"])))
    return float(fine["balance"].abs().max()), float(2 * unsure), float(changes)


def _balance(
    completion: Completion, t: np.ndarray, columns: Mapping[str, np.ndarray]
) -> pd.DataFrame | None:
    """`energy_columns` of the completed motion; None where forces are not determined."""
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
    # Forces that the motion needs, with the accelerations as differences; given ones stay as they
    # are.
    accelerations = np.gradient(v, t, axis=0, edge_order=2)
    completed = {**recover_columns(scene, t, q, v, accelerations, given), **given}
    for name, _, slip in _ways(scene, t, q, v):
        if f"{name}.friction" not in given:
            completed[f"{name}.friction"] = _coulomb(scene, name, slip, completed)
    if any(np.isnan(completed[name]).any() for name in needed_columns(scene)):
        return None
    return energy_columns(scene, t, completed)


def _coulomb(
    scene: Scene, name: str, slip: np.ndarray, columns: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Friction of a joint by its kinetic bound and coefficient; zero at rest, where it does no work."""
    joint = scene.joints[name]
    mode = np.where(np.abs(slip) > STILL * np.max(np.abs(slip)), np.sign(slip), 0.0)
    bound, _ = joint.bounds
    if isinstance(joint, Revolute):
        return -mode * bound
    if joint.length is None:
        load = np.abs(columns[f"{name}.normal_force"])
    else:
        sliding = corner_columns(name, joint, {**columns, f"{name}.mode": mode})
        load = sum(sliding[f"{name}.F{corner}"] for corner in (1, 2, 3, 4))
    return np.where(mode != 0, -mode * (bound + joint.kinetic_coefficient * load), 0.0)
