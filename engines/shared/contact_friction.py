"""Friction of sliders that an engine holds by contacts.

Sums over the contacts of each guide, and the coefficient that they get.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stiction.engines.shared.contact_geometry import direction_of
from stiction.engines.shared.friction_cap import CoefficientSwitch
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import Scene


class ContactFriction(CoefficientSwitch):
    """The frictional guides of a tree whose sliders are free but for their contacts.

    Parameters
    ----------
    scene : Scene
    tree : LinkTree
        With the guides left out.
    """

    def __init__(self, scene: Scene, tree: LinkTree):
        super().__init__(scene)
        self._tree, self._still = tree, np.zeros(len(tree.links))
        places = {name: 3 * i for i, name in enumerate(scene.bodies)}
        self._along = [(places[guide.slider], *direction_of(guide)) for guide in scene.frictional_guides.values()]

    def forget(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Leave stick open where these joint coordinates and velocities have no slip."""
        _, v, _ = self._tree.motion(position, velocity, self._still)
        self._guides["slip_speed"] = [ux * v[place] + uy * v[place + 1] for place, ux, uy in self._along]
        self._guides["stuck"] = self._guides["change"] = 0
        self.begin()

    def observe_contacts(self, position: np.ndarray, velocity: np.ndarray, coefficients: Sequence[float],
                         normals: Sequence[float],
                         frictions: Sequence[float]) -> None:
        """Take in a step.

        Parameters
        ----------
        position, velocity
            Of the joints behind it.
        coefficients
            Per frictional guide, those of the step.
        normals, frictions
            Per frictional guide: sums of the magnitudes of its contacts' normal and tangential forces (N).
        """
        _, v, _ = self._tree.motion(position, velocity, self._still)
        told = self.data
        for i, (place, ux, uy) in enumerate(self._along):
            told.loads[i], told.frictions[i] = coefficients[i] * normals[i], frictions[i]
            told.slip_speeds[i] = ux * v[place] + uy * v[place + 1]
        self.observe()
