"""Coordinates that the constraints and drives of a mechanism prescribe, whatever forces act."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stiction.engines.examined import POSITIONS
from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Scene
from stiction.truths import Tier, Truth

INSTANTS = 21
"""Number of instants at which the free motions of a mechanism are computed: in a singular position a coordinate may
be held which is free in others."""
HELD = 1e-6
"""Largest component of a coordinate in a free motion (of unit length) for which the coordinate is prescribed. If the
truth lacks some angles of bodies, rounding remains; a free coordinate has a component of 1e-3 or more."""


def prescribed(scene: Scene, truth: Truth) -> set[str]:
    """Return the columns of positions that no force changes.

    These coordinates have no component in any free motion, that is, in the null space of the Jacobian of the
    constraints, J v = 0. The result is empty if there is no free motion.
    """
    names = [f"{body}.{label}" for body in scene.bodies for label in POSITIONS]
    bases = list(_free_motions(scene, truth, names))
    # In a singular position the null space is larger. What it adds is no motion in other positions.
    freedom = min(len(basis) for basis in bases)
    if freedom == 0:
        return set()
    regular = np.array([basis for basis in bases if len(basis) == freedom])
    components = np.max(np.abs(regular), axis=(0, 1))
    return {name for name, component in zip(names, components) if component <= HELD}


def is_prescribed(scene: Scene, truth: Truth) -> bool:
    """Return True if constraints and drives prescribe the whole motion, so that forces show in efforts only."""
    names = [f"{body}.{label}" for body in scene.bodies for label in POSITIONS]
    return min(len(basis) for basis in _free_motions(scene, truth, names)) == 0


def _free_motions(scene: Scene, truth: Truth, names: list[str]) -> Iterator[np.ndarray]:
    """Yield an orthonormal basis (freedom, coordinates) of the free motions at each of `INSTANTS` instants.

    Angles are multiplied by the mechanism's length. Coordinates that the truth lacks have their initial value.
    """
    equations = EquationsOfMotion(scene)
    length = Mechanism(scene, stabilization="none").arrays.length_scale
    scale = np.tile([1.0, 1.0, length], len(scene.bodies))
    initial_q, initial_v = equations.start()
    t = np.linspace(0.0, min(scene.t_end, truth.t_end), INSTANTS)
    q = np.tile(initial_q, (INSTANTS, 1))
    if truth.tier != Tier.NONE:
        true = truth(t)
        for place, name in enumerate(names):
            if name in true:
                q[:, place] = true[name]
    for time, position in zip(t, q):
        jacobian = equations.at(float(time), position, initial_v).J / scale
        _, singular_values, right = np.linalg.svd(jacobian)
        limit = HELD * np.max(singular_values, initial=0.0)
        rank = np.count_nonzero(singular_values > limit)
        yield right[rank:]
