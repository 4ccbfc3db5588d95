"""How much of a joint's position error a step of pymunk can correct.

Chipmunk holds constraints by velocities, and steers them so that the next step removes a share s
of each position error (`Constraint.error_bias`). Impulses are found by N iterations of
Gauss-Seidel, which begin with those of the step before (warm starting). Let r be the part of an
error that is left in the slowest mode of these iterations after N of them: its convergence in one
iteration to the power N. Where a light body joins two heavy ones of a mass R times its own,
convergence in one iteration is 1 - c/R with c of order one.

For that mode, with the position error phi/h, the error of the velocity u and the impulse p times
its effect on u, a step of size h is (positions first, then the impulses of the step before, then
iterations towards u = -s phi)

    phi' = phi + u
    u' = r (u + p) - (1 - r) s phi'
    p' = r p - (1 - r) (s phi' + u)

The eigenvalues z of this map are the roots of

    z^3 + (a - 2 r - 1) z^2 + 3 r z - r = 0 ,   a = (1 - r) s .

By the criterion of Jury all of them are inside the unit circle if and only if 0 < s < (1 - r)/r
(the other conditions, r < 1 and a < 2 + 6 r, are weaker for s <= 1). With r <= 1/2 a step can
correct a whole error; above, what it corrects too much of comes back with growing size, at any
step, and the mechanism flies apart.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from stiction.engines.shared.step_kernels import Balance
from stiction.scenes import Scene
from stiction.scenes.model import Revolute

SPARE = 4
"""The share is that of this part of the iterations: convergence is measured at the start, and a
mechanism that moves has positions in which it is slower. With slow convergence the share is then
a quarter of what is stable at the start. With 2 a four-bar of light couplers flies apart on its
way."""
_WHOLE_ERROR = 0.5
"""Part r of an error that iterations may leave where a step corrects the whole of it, s = 1: then 1 < (1 - r)/r."""
_NEGLIGIBLE = 1e-9
"""Part of an error that is negligible: far below 1/2, and above rounding."""
_MOST_ITERATIONS = 100_000
"""Largest number of iterations of the trial step before a run, which then takes some hundredths of a second."""
_REDUNDANT = 1e-10
"""Ratio of a singular value of the rows to the largest below which it is rounding, so that constraints are redundant.
It is far below the root of any ratio of masses."""


class Iteration:
    """The convergence of Gauss-Seidel in the constraints of a scene whose balance is assembled.

    Parameters
    ----------
    scene : Scene
    balance : Balance
    fixed : set of str
        Bodies that cannot turn.
    """

    def __init__(self, scene: Scene, balance: Balance, fixed: set[str]):
        J, rows = constraint_rows(balance), balance.m.rows
        mobility = 1.0 / balance.mass
        mobility[2::3][[name in fixed for name in scene.bodies]] = 0.0
        # Velocities are multiplied by the roots of the masses. In these units the square of a length
        # is twice an energy, and the impulse of a row is an orthogonal projection.
        scaled = J * np.sqrt(mobility)
        # Blocks of rows whose impulses Chipmunk solves for together: the two of a pin; each other
        # row is a block of its own.
        blocks: list[list[int]] = []
        for joint in scene.joints.values():
            row = sum(map(len, blocks))
            blocks += [[row, row + 1]] if isinstance(joint, Revolute) else [[row], [row + 1]]
        blocks += [[row] for row in range(2 * len(scene.joints), len(J))]
        # Friction that holds a slider is one more row. The two extremes are considered: no slider
        # is held, and all of them are.
        self._sweeps = [
            _sweep(scaled[:size], [block for block in blocks if block[-1] < size])
            for size in dict.fromkeys((rows, len(J)))
        ]

    def left(self, iterations: int) -> float:
        """Return the part of an error that is left in the slowest mode after so many iterations."""
        return max(_left(sweep, iterations) for sweep in self._sweeps)

    def share(self, iterations: int) -> float:
        """Return the share of a position error that a step of so many iterations may correct, at most 1."""
        left = self.left(max(1, iterations // SPARE))
        return 1.0 if left <= _WHOLE_ERROR else 1.0 / left - 1.0

    def needed(self, least: int) -> int:
        """Return the number of iterations, at least `least`, after which the rest of an error is negligible."""
        left = self.left(least)
        if left <= _NEGLIGIBLE:
            return least
        if left >= 1.0:
            return _MOST_ITERATIONS
        # an error decreases by the same factor in each iteration: left^(n/least) = negligible
        return min(_MOST_ITERATIONS, math.ceil(least * math.log(_NEGLIGIBLE) / math.log(left)))


def _sweep(rows: np.ndarray, blocks: list[list[int]]) -> np.ndarray:
    """Return the matrix of one iteration, which maps velocities to those after it.

    It acts on the velocities that constraints can change, in an orthonormal basis of these.
    """
    # The impulse of a block removes the component that violates the block: a projection.
    after = np.eye(rows.shape[1])
    for block in blocks:
        after -= np.linalg.pinv(rows[block]) @ (rows[block] @ after)
    # Velocities that violate no row are not changed at all, and would look like a mode that does
    # not converge. They are left out by restricting the map to the row space.
    _, sizes, directions = np.linalg.svd(rows, full_matrices=False)
    basis = directions[sizes > _REDUNDANT * sizes.max(initial=0.0)]
    return basis @ after @ basis.T


def _left(sweep: np.ndarray, iterations: int) -> float:
    """Return the part of an error that so many iterations leave of the slowest mode, at most 1."""
    # As many iterations before, in which faster modes decay, leave the slowest mode alone.
    first = np.linalg.matrix_power(sweep, iterations)
    if not len(sweep) or (size := float(np.linalg.norm(first, 2))) <= _NEGLIGIBLE:
        return 0.0
    return min(1.0, float(np.linalg.norm(first @ first, 2) / size))


def constraint_rows(balance: Balance) -> np.ndarray:
    """Return the assembled J, shape (rows + frictional, 3 * bodies).

    Its rows are those of joints, then of drives, then those along frictional guides.
    """
    m, w = balance.m, balance.w
    J = np.zeros((len(w.gamma), len(balance.mass)))
    for place, row, body in m.block.astype(int):
        J[row, body : body + 3] = w.J[place : place + 3]
    return J


def bias_of_share(share: float, h: float) -> float:
    """Return Chipmunk's `error_bias` for a share of an error that a step of h seconds corrects.

    It is the part of an error that is left after a second. At steps below 0.3 ms it may be too small for a float. Then
    it is the smallest positive one, which corrects a smaller share.
    """
    if share >= 1.0:
        return 0.0
    return max((1.0 - share) ** (1.0 / h), sys.float_info.min)


def share_of_bias(error_bias: float, h: float) -> float:
    """Return the share of a position error that a step of h seconds corrects."""
    return 1.0 - error_bias**h
