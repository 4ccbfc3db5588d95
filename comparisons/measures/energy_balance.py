"""Energy balance of a motion: change of kinetic energy, less the work of all that has a power."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stiction.comparisons.uncertain import Uncertain
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.reactions import row_matrices
from stiction.scenes import Scene
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.trajectory import stacked


@dataclass(frozen=True)
class EnergyBalance:
    """Energy that is not accounted for.

    Attributes
    ----------
    left_over : Uncertain
        J; largest |T(t) - T(0) - W(t)|, with what the distance of samples leaves unknown of W.
    exchanged : float
        J; integral of the |power| of weight, springs, loads, motors and friction, each power added before.
    """

    left_over: Uncertain
    exchanged: float


def needed_columns(scene: Scene) -> list[str]:
    """Names of the columns that the balance takes: states, efforts of drives, friction of guides."""
    states = [f"{body}.{label}" for body in scene.bodies for labels in BODY_COLUMNS[:2] for label in labels]
    return [*states, *(f"{drive}.effort" for drive in scene.drives), *(f"{name}.friction" for name in
                                                                       scene.frictional_guides)]


def energy_balance(scene: Scene, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> EnergyBalance:
    """Compare the kinetic energy with the work done, by the trapezoidal rule.

    Pins and ideal guides do no work. The work is unsure by its difference to that of every other sample,
    and of all at jumps.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Not decreasing; an instant that occurs twice has both sides of a jump.
    columns : Mapping[str, ndarray]
        `needed_columns`, each of shape (n,).
    """
    mechanism = Mechanism(scene, stabilization="none")
    m = mechanism.arrays
    q, v = (np.ascontiguousarray(stacked(columns, mechanism.body_names, labels)) for labels in BODY_COLUMNS[:2])
    force_rows, free = row_matrices(m, t, q, v)
    names = [*mechanism.row_names, *(f"{name}.friction" for name in mechanism.guide_names)]
    power = np.einsum("ni,ni->n", v, free / m.inverse_mass)
    for row, name in enumerate(names):
        if name.endswith((".effort", ".friction")):
            power += columns[name] * np.einsum("ni,ni->n", v, force_rows[:, :, row])
    kinetic = np.sum(v ** 2 / m.inverse_mass, axis=1) / 2
    jumps = np.diff(t, prepend=-np.inf) == 0
    half = np.flatnonzero((np.arange(len(t)) % 2 == 0) | jumps | np.append(jumps[1:], True))
    work, coarse = _integrated(t, power), _integrated(t[half], power[half])
    left_over = float(np.max(np.abs(kinetic - kinetic[0] - work)))
    return EnergyBalance(Uncertain(left_over, float(np.max(np.abs(work[half] - coarse)))),
                         float(_integrated(t, np.abs(power))[-1]))


def _integrated(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.append(0.0, np.cumsum(np.diff(t) * (values[1:] + values[:-1]) / 2))
