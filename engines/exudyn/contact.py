"""A slider as a box between two surfaces, with Exudyn's own penalty contact and regularized friction.

Four small spheres stand at the corners of the slider, each against a plane (a large triangle) of the guide; they touch
at the corners themselves, at the declared clearance, while the slider is parallel to the guide.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, sin
from typing import Any

import numpy as np

from stiction.engines.exudyn.model import Model, unit
from stiction.engines.shared.contact_geometry import surface_distance
from stiction.scenes.model import Translational

_REACH = 1e3
"""The planes extend this many lengths of the slider. Nothing depends on it while the slider stays on them."""
_RADIUS = 0.25
"""Radius of the spheres in widths of the slider. Nothing depends on it while the slider is parallel to the guide."""
CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))
"""Places along and across the guide of F1 .. F4: lower rear, lower front, upper front, upper rear."""


class ContactGuide:
    """The contacts of one slider of a model that is not yet assembled, by the adapter's settings.

    The guide has length and width > 0, and at most one coefficient of friction.
    """

    def __init__(self, model: Model, name: str, joint: Translational, options: Mapping[str, float]):
        import exudyn

        self.name, self.joint = name, joint
        self._model = model
        items, system = model.items, model.system
        # `u` along the guide and `n` across it, in the axes of the body that has the guide
        u = np.array(unit(joint.direction))
        n = np.array([-u[1], u[0]])
        c, s = cos(joint.angle), sin(joint.angle)
        to_slider = np.array([[c, s], [-s, c]])  # from the axes of the guide to those of the slider
        length, width = joint.extent
        radius, reach = _RADIUS * width, _REACH * length
        plane = model.rigid(joint.guide, joint.point)
        self._contacts = []
        for along, across in CORNERS:
            # A sphere inside the slider that touches the surface at the corner itself. Exudyn's
            # surfaces are triangles; this one is large, and extends out of the plane too.
            centre = to_slider @ (0.5 * along * length * u + across * (0.5 * width - radius) * n)
            surface = across * surface_distance(joint) * n
            points = [
                [*(surface + x * reach * u), z * reach]
                for x, z in ((-1.0, -1.0), (1.0, -1.0), (0.0, 1.0))
            ]
            # Exudyn keeps the state variables of a contact in a node of its own.
            data = system.AddNode(
                items.NodeGenericData(initialCoordinates=[0.0] * 4, numberOfDataCoordinates=4)
            )
            self._contacts.append(
                system.AddObject(
                    items.ObjectContactSphereTriangle(
                        markerNumbers=[
                            model.rigid(joint.slider, tuple(np.array(joint.slider_point) + centre)),
                            plane,
                        ],
                        nodeNumber=data,
                        sphereRadius=radius,
                        trianglePoints=exudyn.Vector3DList(points),
                        includeEdges=0,
                        dynamicFriction=joint.mu or 0.0,
                        frictionProportionalZone=options["friction_zone"],
                        contactStiffness=options["contact_stiffness"],
                        contactDamping=options["contact_damping"],
                    )
                )
            )

    def record(self) -> np.ndarray:
        """Return the forces of the contacts on the slider, shape (4, 2), in ground axes and in the order F1 .. F4."""
        import exudyn

        kind = exudyn.OutputVariableType.Force
        return np.array(
            [self._model.system.GetObjectOutput(contact, kind)[:2] for contact in self._contacts]
        )

    def columns(self, forces: np.ndarray, q: np.ndarray, _: Any) -> dict[str, np.ndarray]:
        """Return the guide's columns from forces of shape (n, 4, 2) and states of shape (n, 3 * bodies)."""
        joint = self.joint
        # Forces are measured along and across the slider's own direction at each instant: the
        # corner forces of the other columns are those of the slider's corners.
        angle = q[:, 3 * self._model.index[joint.slider] + 2] - joint.angle
        c, s = np.cos(angle), np.sin(angle)
        u = np.array(unit(joint.direction))
        direction = np.stack([c * u[0] - s * u[1], s * u[0] + c * u[1]], axis=1)
        normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
        along, across = (
            np.einsum("nki,ni->nk", forces, direction),
            np.einsum("nki,ni->nk", forces, normal),
        )
        places = 0.5 * np.array(CORNERS) * joint.extent
        # A corner force is positive where it presses: across the guide on the lower surface,
        # against it on the upper one.
        columns = {
            f"{self.name}.normal_force": across.sum(axis=1),
            f"{self.name}.moment": across @ places[:, 0] - along @ places[:, 1],
            **{f"{self.name}.F{k + 1}": -CORNERS[k][1] * across[:, k] for k in range(4)},
        }
        if joint.frictional:
            lower = along[:, :2].sum(axis=1)
            upper = along[:, 2:].sum(axis=1)
            columns |= {
                f"{self.name}.friction": lower + upper,
                f"{self.name}.friction_lower": lower,
                f"{self.name}.friction_upper": upper,
            }
        return columns
