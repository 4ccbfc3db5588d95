"""The balance of momentum at one instant, for adapters that need it while their engine steps.

The rows are those of the reference's kinematics; what is solved here is only the friction bound's part: the
reactions of the guides that belong to accelerations which the engine has found.
"""

from __future__ import annotations

import numpy as np

from stiction.engines.shared.step_kernels import Balance, applied_loads, assemble, make_balance, row_forces
from stiction.reference_impl.multibody.kinematics import workspace
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Scene


class MomentumBalance:
    """`M a - Q = J^T lambda + T f` of a scene.

    Parameters
    ----------
    scene : Scene

    Attributes
    ----------
    initial : tuple of ndarray, each of shape (3 * bodies,)
        Coordinates and velocities at t = 0.
    data : Balance
        For kernels that go on from here.
    """

    def __init__(self, scene: Scene):
        mechanism = Mechanism(scene, stabilization="none")
        self.initial = mechanism.initial_state()
        self._m = m = mechanism.arrays
        self._w = w = workspace(m)  # kept: what kernels have of both is their address
        bodies = np.full((m.rows + len(m.friction), 2), -1)
        for place, row, body in m.block:
            bodies[row, place % 6 // 3] = body // 3
        size = len(m.inverse_mass)
        self._loads = np.zeros(size)
        self.data: Balance = make_balance(m, w, 1.0 / m.inverse_mass, bodies, np.zeros(size), np.zeros(size))

    def compile(self) -> None:
        """Compile the kernels, by one evaluation at the start."""
        self.loads(0.0, *self.initial)
        if len(self._m.friction):
            self.assemble(0.0, *self.initial)
            self.reactions(self.initial[1], np.full(len(self._m.friction), np.nan))

    def loads(self, t: float, q: np.ndarray, v: np.ndarray, ahead: float = 0.0) -> np.ndarray:
        """Generalized forces (N, N, N m a body) of springs, dampers, forces and torques at q + ahead v; weight apart.

        The array is written anew by each call.
        """
        applied_loads(self.data, t, q, v, ahead, self._loads)
        return self._loads

    def assemble(self, t: float, q: np.ndarray, v: np.ndarray) -> None:
        """Make `reactions` refer to this instant."""
        assemble(self.data, t, q, v, 0.0, self._loads)

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
        force = row_forces(self.data, a, friction)
        return force[m.friction["row"]], force[m.friction["row"] + 1], force[m.rows:]
