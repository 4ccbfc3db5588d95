"""Energy balance of a motion: what its energies and the works leave unaccounted for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stiction.comparisons.uncertain import Uncertain
from stiction.reference_impl.energies import energy_columns
from stiction.scenes import Scene


@dataclass(frozen=True)
class EnergyBalance:
    """Energy that is not accounted for.

    Attributes
    ----------
    left_over : Uncertain
        J; the largest balance of `energy_columns`, with what the distance of samples leaves unknown of the works.
    exchanged : float
        J; all that the kinetic energy rose and fell.
    """

    left_over: Uncertain
    exchanged: float


def energy_balance(scene: Scene, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> EnergyBalance:
    """Compare the energies with the works, which are unsure by their difference to those of every other sample.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Not decreasing; an instant that occurs twice has both sides of a jump, and both are kept.
    columns : Mapping[str, ndarray]
        `stiction.reference_impl.energies.needed_columns`, each of shape (n,).
    """
    found = energy_columns(scene, t, columns)
    jumps = np.diff(t, prepend=-np.inf) == 0
    half = np.flatnonzero((np.arange(len(t)) % 2 == 0) | jumps | np.append(jumps[1:], True))
    coarse = energy_columns(scene, t[half], {name: values[half] for name, values in columns.items()})
    unsure = np.max(np.abs(found["balance"].to_numpy()[half] - coarse["balance"].to_numpy()))
    return EnergyBalance(Uncertain(float(np.max(np.abs(found["balance"].to_numpy()))), float(unsure)),
                         float(found["kinetic"].diff().abs().sum()))
