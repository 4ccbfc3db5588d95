"""The balance of momentum at one instant, for adapters that need it while their engine steps.

The rows are those of the reference's kinematics; what is solved here is only the friction bound's part: the reactions
of the guides that belong to accelerations which the engine has found.
"""

from __future__ import annotations

import numpy as np

from stiction.engines.shared.step_kernels import Balance, applied_loads, assemble, row_forces
from stiction.reference_impl.compiled.kernel import link_kernels
from stiction.reference_impl.multibody.kinematics import workspace
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Scene


class MomentumBalance:
    """`M a - Q = J^T lambda + T f` of a scene.

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
        m = mechanism.arrays
        frictional, coordinates = len(m.friction), len(m.inverse_mass)
        rows = m.rows + frictional
        self.data = Balance.zeros(
            m=m, w=workspace(m), mass=coordinates, bodies=(rows, 2), known=frictional, unit=2 * rows, unknown=rows,
            system=(rows, rows), work=(rows, rows), **dict.fromkeys(("q", "v", "loads", "excess"), coordinates),
            **dict.fromkeys(("force", "right", "solution", "least_squares"), rows))
        self.data.mass[:], self.data.bodies[:] = 1.0 / m.inverse_mass, -1
        for place, row, body in m.block:
            self.data.bodies[row, place % 6 // 3] = body // 3

    def compile(self) -> None:
        """Compile the kernels, or load them."""
        link_kernels(applied_loads, assemble, row_forces)

    def loads(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Forces of springs, dampers, forces and torques at q (N, N, N m a body), weight apart; overwritten later."""
        applied_loads(self.data, t, q, v, 0.0)
        return self.data.loads

    def assemble(self, t: float, q: np.ndarray, v: np.ndarray) -> None:
        """Make `reactions` refer to this instant."""
        assemble(self.data, t, q, v, 0.0)

    def reactions(self, a: np.ndarray, friction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal forces (N) and moments (N m) of the frictional guides, each of shape (frictional,).

        They belong to accelerations of shape (3 * bodies,) and these frictions (N), by least squares in the metric of
        the masses, of minimum norm.
        """
        m, force = self.data.m, self.data.force
        self.data.known[:] = friction
        row_forces(self.data, a)
        return force[m.friction["row"]], force[m.friction["row"] + 1]
