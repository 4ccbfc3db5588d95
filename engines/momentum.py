"""The balance of momentum at one instant, for adapters that need it while their engine steps.

The rows are those of the reference's kinematics; what is solved here is only the friction bound's part: the
reactions of the guides that belong to accelerations which the engine has found.
"""

from __future__ import annotations

import numpy as np

from reference_impl.compiling import kernel
from reference_impl.dynamics import applied_forces, row_form
from reference_impl.kinematics import rotate, workspace
from reference_impl.linear_algebra import eliminate, minimum_norm
from reference_impl.mechanism import Mechanism
from scenes import Scene


class MomentumBalance:
    """`M a - Q = J^T lambda + T f` of a scene.

    Parameters
    ----------
    scene : Scene

    Attributes
    ----------
    initial : tuple of ndarray, each of shape (3 * bodies,)
        Coordinates and velocities at t = 0.
    """

    def __init__(self, scene: Scene):
        mechanism = Mechanism(scene, stabilization="none")
        self.initial = mechanism.initial_state()
        self._m = mechanism.arrays
        self._w = workspace(self._m)
        self._mass = 1.0 / self._m.inverse_mass
        m = self._m
        bodies = np.full((m.rows + len(m.friction), 2), -1)
        for place, row, body in m.block:
            bodies[row, place % 6 // 3] = body // 3
        self._bodies = bodies

    def compile(self) -> None:
        """Compile the kernels, by one evaluation at the start."""
        self.loads(0.0, *self.initial)
        if len(self._m.friction):
            self.assemble(0.0, *self.initial)
            self.slip(self.initial[1])
            self.reactions(self.initial[1], np.full(len(self._m.friction), np.nan))

    def loads(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Generalized forces (N, N, N m a body) of springs, dampers, forces and torques; weight apart."""
        _applied(self._m, self._w, t, q, v)
        return self._w.free - self._m.weight

    def assemble(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Make `reactions` and `slip` refer to this instant; returns what `loads` does."""
        row_form(self._m, self._w, t, q, v)
        return self._w.free * self._mass - self._m.weight

    def slip(self, v: np.ndarray) -> np.ndarray:
        """Slip velocity of each frictional guide at the assembled coordinates, shape (frictional,), m/s."""
        return _row_products(self._w.J.reshape(-1, 2, 3)[self._m.rows:], self._bodies[self._m.rows:], v)

    def reactions(self, a: np.ndarray, friction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Reactions of the frictional guides: least squares in the metric of the masses, minimum norm.

        Parameters
        ----------
        a : ndarray, shape (3 * bodies,)
            Accelerations at the assembled instant.
        friction : ndarray, shape (frictional,)
            Force on each slider along its guide (N); NaN where it is to be found too.

        Returns
        -------
        normal_force, moment, friction : ndarray, each of shape (frictional,)
            Force on the slider along the normal (N), moment on it about its point (N m), friction (N).
        """
        m = self._m
        force = _row_forces(self._w.J.reshape(-1, 2, 3), self._bodies, self._w.G, a - self._w.free, friction)
        return force[m.friction["row"]], force[m.friction["row"] + 1], force[m.rows:]


@kernel
def _applied(m, w, t, q, v):
    rotate(m, w, q)
    applied_forces(m, w.rotation, t, q, v, w.free)


@kernel(allocates=True)
def _row_products(J, bodies, v):
    """J v for rows stored as two blocks of three."""
    product = np.zeros(len(J))
    for r in range(len(J)):
        for side in range(2):
            body = bodies[r, side]
            if body >= 0:
                for i in range(3):
                    product[r] += J[r, side, i] * v[3 * body + i]
    return product


@kernel(allocates=True)
def _row_forces(J, bodies, G, excess, friction):
    """Row forces with G force = J (a - M^-1 Q); the last rows are the frictions, solved for where NaN."""
    rows = len(J) - len(friction)
    right = _row_products(J, bodies, excess)
    if not np.isfinite(right).all():
        return np.full(len(J), np.nan)
    force = np.zeros(len(J))
    unknown = np.ones(len(J), dtype=np.bool_)
    for i in range(len(friction)):
        if not np.isnan(friction[i]):
            unknown[rows + i] = False
            force[rows + i] = friction[i]
    index = np.nonzero(unknown)[0]
    reduced = right - G @ force
    system, solution = np.zeros((len(index), len(index))), reduced[index]
    for i in range(len(index)):
        for j in range(len(index)):
            system[i, j] = G[index[i], index[j]]
    if not eliminate(system.copy(), solution, np.empty(2 * len(index)), len(index)):
        solution = reduced[index]
        minimum_norm(system, solution, len(index))
    for i in range(len(index)):
        force[index[i]] = solution[i]
    return force
