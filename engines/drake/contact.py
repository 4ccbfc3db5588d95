"""A slider as a box between two surfaces, for Drake's contacts of points with half-spaces.

The corners are spheres of radius zero, and each guide's surfaces are the half-spaces beyond them, at the declared
clearance. So a contact is where a corner is. Two contacts carry a box whether it lies flat or is wedged, and no contact
moves along an edge, as the deepest point of a box would.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import compress
from math import cos, sin
from typing import Any, NamedTuple

import numpy as np

from stiction.engines.shared.contact_geometry import direction_of, slider_box, surface_distance
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import Scene


def corner_inertias(
    scene: Scene, tree: LinkTree, position: np.ndarray, mass: np.ndarray, driven: Sequence[int]
) -> list[float]:
    """Return, per guide, the least effective mass (kg) of its slider's corners across the guide at the start.

    It is 1/(J M^-1 J^T) with J the rate of the corner, Drake's measure of contacts (Castro et al. 2022, Sect. V.B);
    `driven` links are held, loops open. `position` is (links,), `mass` (links, links).
    """
    free = np.setdiff1d(np.arange(len(tree.links)), driven)
    mobility = np.linalg.inv(mass[np.ix_(free, free)])
    # Rates of all bodies by a unit rate of each free joint, shape (free, bodies, 3)
    still = np.zeros(len(tree.links))
    rates = np.array(
        [
            tree.motion(position, unit, still)[1].reshape(-1, 3)
            for unit in np.eye(len(tree.links))[free]
        ]
    )
    inertias = []
    places = {name: i for i, name in enumerate(scene.bodies)}
    for guide in scene.guides.values():
        # J of each corner: the component across the guide of its velocity, v + omega x r
        vx, vy, omega = rates[:, places[guide.slider]].T
        ux, uy = direction_of(guide)
        angle = scene.bodies[guide.slider].angle
        c, s = cos(angle), sin(angle)
        across = [
            -uy * (vx - omega * (s * x + c * y)) + ux * (vy + omega * (c * x - s * y))
            for x, y in slider_box(guide, 0.0)
        ]
        inertias.append(1 / max(J @ mobility @ J for J in across))
    return inertias


@dataclass(frozen=True)
class Material:
    """A corner and a surface that touch each other.

    `stiffness` is that of the contact, N/m; `static` and `kinetic` are coefficients of friction, of which discrete
    steps use the kinetic one alone; `dissipation` is Hunt and Crossley's, s/m; `relaxation_time` is Kelvin and Voigt's,
    s, which the approximation `sap` uses instead.
    """

    stiffness: float
    static: float
    kinetic: float
    dissipation: float
    relaxation_time: float

    def properties(self) -> Any:
        """Return Drake's properties of either shape."""
        from pydrake.geometry import AddContactMaterial, ProximityProperties
        from pydrake.multibody.plant import CoulombFriction

        # Drake adds up the compliances of both shapes, so each has twice the stiffness.
        properties = ProximityProperties()
        AddContactMaterial(
            properties,
            dissipation=self.dissipation,
            point_stiffness=2 * self.stiffness,
            friction=CoulombFriction(self.static, self.kinetic),
        )
        properties.AddProperty("material", "relaxation_time", self.relaxation_time)
        return properties


class _Box(NamedTuple):
    """A slider's link, the guide's normal, Drake's names of its surfaces and corners, and the corners' places."""

    link: int
    normal: np.ndarray
    surfaces: list[Any]
    corners: list[Any]
    places: list[np.ndarray]


class Boxes:
    """The sliders' corners and the guides' surfaces, added to a plant that is not finalized.

    `bodies` are Drake's bodies of the links of the tree; there is one of the `materials` for each guide.
    """

    def __init__(
        self,
        scene: Scene,
        tree: LinkTree,
        bodies: Sequence[Any],
        plant: Any,
        graph: Any,
        materials: Sequence[Material],
    ):
        from pydrake.geometry import HalfSpace, Sphere
        from pydrake.math import RigidTransform

        self._graph, self._source = graph, plant.get_source_id()
        # Surfaces and corners of all guides. Those of frictional guides also change materials, and
        # their forces are measured.
        self._boxes: list[_Box] = []
        for number, (guide, own) in enumerate(zip(scene.guides.values(), materials)):
            link, material = tree.link_of[guide.slider], own.properties()
            ux, uy = direction_of(guide)
            normal = np.array([-uy, ux, 0.0])
            distance = surface_distance(guide)
            point = np.array([*guide.point, 0.0])
            surfaces = [
                plant.RegisterCollisionGeometry(
                    plant.world_body(),
                    HalfSpace.MakePose(inward, point - inward * distance),
                    HalfSpace(),
                    f"surface-{number}-{side}",
                    material,
                )
                for side, inward in enumerate((normal, -normal))
            ]
            places = [tree.centre(link) + (x, y, 0.0) for x, y in slider_box(guide, 0.0)]
            corners = [
                plant.RegisterCollisionGeometry(
                    bodies[link],
                    RigidTransform(place),
                    Sphere(0.0),
                    f"corner-{number}-{i}",
                    material,
                )
                for i, place in enumerate(places)
            ]
            self._boxes.append(_Box(link, normal[:2], surfaces, corners, places))
        frictional = [guide.frictional for guide in scene.guides.values()]
        self._frictional = list(compress(self._boxes, frictional))
        self._materials = list(compress(materials, frictional))
        self._number = {
            corner: i for i, box in enumerate(self._frictional) for corner in box.corners
        }
        self._keep_apart(graph.collision_filter_manager())

    def _keep_apart(self, filters: Any) -> None:
        """Let corners touch the surfaces of their own guide only."""
        from pydrake.geometry import CollisionFilterDeclaration, GeometrySet

        for own in self._boxes:
            others = [
                shape
                for box in self._boxes
                if box is not own
                for shape in (*box.surfaces, *box.corners)
            ]
            filters.Apply(
                CollisionFilterDeclaration().ExcludeBetween(
                    GeometrySet(own.corners), GeometrySet(others)
                )
            )

    def begin(self, root: Any) -> None:
        """Use this context of the diagram from now on."""
        self._context = self._graph.GetMyMutableContextFromRoot(root)

    def sink(self, position: np.ndarray, after: np.ndarray) -> None:
        """Change each slider's place across its guide, and its angle, to those of other coordinates of the links."""
        for link, normal, *_ in self._boxes:
            place = slice(link - 2, link)  # coordinates of the links that slide along x and y
            position[place] += normal * (normal @ (after[place] - position[place]))
            position[link] = after[link]

    def move(self, start: np.ndarray, position: np.ndarray) -> None:
        """Move each guide's box within its body.

        With the links' coordinates `start` the box is then where it was with those of `position`.
        """
        from pydrake.geometry import Sphere
        from pydrake.math import RigidTransform, RotationMatrix

        # The corner's place in the body is body^-1 box place: the box as it was at `position`, seen
        # from the body at `start`.
        for link, _, _, corners, places in self._boxes:
            body, box = (
                RigidTransform(RotationMatrix.MakeZRotation(angle), (x, y, 0.0))
                for x, y, angle in (start[link - 2 : link + 1], position[link - 2 : link + 1])
            )
            for corner, place in zip(corners, places):
                self._graph.ChangeShape(
                    self._context,
                    self._source,
                    corner,
                    Sphere(0.0),
                    RigidTransform(body.inverse() @ box @ place),
                )
        # Drake drops the filters of a shape that is changed.
        self._keep_apart(self._graph.collision_filter_manager(self._context))

    def rub(self, coefficients: Sequence[float]) -> None:
        """Set the coefficient of each frictional guide where it has changed."""
        from pydrake.geometry import RoleAssign

        # An assignment is costly, so coefficients that have not changed are left alone.
        for i, coefficient in enumerate(coefficients):
            if coefficient != self._materials[i].kinetic:
                self._materials[i] = replace(
                    self._materials[i], static=coefficient, kinetic=coefficient
                )
                material = self._materials[i].properties()
                for shape in (*self._frictional[i].surfaces, *self._frictional[i].corners):
                    self._graph.AssignRole(
                        self._context, self._source, shape, material, RoleAssign.kReplace
                    )

    def forces(self, results: Any) -> tuple[list[float], list[float]]:
        """Return per frictional guide the sums of the magnitudes of its contacts' normal and tangential forces (N)."""
        # Only corners are looked up: a contact is of a corner, on either side, and a surface.
        normals, frictions = [0.0] * len(self._frictional), [0.0] * len(self._frictional)
        for k in range(results.num_point_pair_contacts()):
            contact = results.point_pair_contact_info(k)
            pair = contact.point_pair()
            place = self._number.get(pair.id_A, self._number.get(pair.id_B))
            if place is None:
                continue
            nx, ny, _ = pair.nhat_BA_W
            fx, fy, _ = contact.contact_force()
            normals[place] += abs(nx * fx + ny * fy)
            frictions[place] += abs(nx * fy - ny * fx)
        return normals, frictions


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the warning that half-spaces do not touch deformable bodies, which do not occur here."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)
