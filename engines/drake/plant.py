"""A scene's links as Drake's multibody plant.

Drake numbers coordinates in an order of its own; `Plant` converts from and to that of the links.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stiction.engines.drake.contact import quiet
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import Scene


class Plant:
    """A scene's tree of links as multibody plant.

    It is continuous if its step is 0. Links without a body have the least mass, kg.

    Attributes
    ----------
    plant, bodies, joints
        Drake's plant, its body of each link and the joint to its parent.
    loads
        Forces and torques that the adapter applies to the scene's bodies, as objects of Drake.
    system, root, context
        Drake's diagram (or the plant alone), its context and the plant's, once it is finalized.
    """

    def __init__(self, scene: Scene, tree: LinkTree, time_step: float, least_mass: float = 0.0):
        from pydrake.math import RigidTransform, RollPitchYaw
        from pydrake.multibody.math import SpatialForce
        from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
        from pydrake.multibody.tree import (
            FixedOffsetFrame,
            PrismaticJoint,
            RevoluteJoint,
            RotationalInertia,
            SpatialInertia,
        )

        self.plant = plant = MultibodyPlant(time_step)
        plant.mutable_gravity_field().set_gravity_vector([*(scene.gravity or (0.0, 0.0)), 0.0])
        self.bodies: list[Any] = []
        self.joints: list[Any] = []
        for i, link in enumerate(tree.links):
            # A link's inertia about its centre of mass; the value for axes in the plane has no
            # effect.
            data = None if link.body is None else scene.bodies[link.body]
            mass, turning = (data.mass, data.inertia) if data else (least_mass, 0.0)
            inertia = SpatialInertia.Zero()
            if mass:
                inertia = SpatialInertia.MakeFromCentralInertia(
                    mass, tree.centre(i), RotationalInertia(*[turning] * 3)
                )
            body = plant.AddRigidBody(f"link-{i}", inertia)
            parent = self.bodies[link.parent] if link.parent >= 0 else plant.world_body()
            # The joint's frame on the parent is turned by the angle at joint coordinate zero.
            frame = plant.AddFrame(
                FixedOffsetFrame(
                    f"parent-{i}",
                    parent.body_frame(),
                    RigidTransform(RollPitchYaw(0.0, 0.0, link.angle), tree.place(i)),
                )
            )
            kind, axis = (
                (PrismaticJoint, (*link.axis, 0.0))
                if link.slides
                else (RevoluteJoint, (0.0, 0.0, 1.0))
            )
            self.joints.append(plant.AddJoint(kind(f"joint-{i}", frame, body.body_frame(), axis)))
            self.bodies.append(body)
        # Loads act at the centre of mass of each body of the scene.
        self._force = SpatialForce
        self.loads = [ExternallyAppliedSpatialForce() for _ in scene.bodies]
        for load, name in zip(self.loads, scene.bodies):
            i = tree.link_of[name]
            load.body_index, load.p_BoBq_B = self.bodies[i].index(), tree.centre(i)

    def set_loads(self, values: Sequence[float]) -> None:
        """Set the loads from the force x, force y (N) and torque (N m) of each body, one after the other."""
        for i, load in enumerate(self.loads):
            fx, fy, torque = values[3 * i : 3 * i + 3]
            load.F_Bq_W = self._force((0.0, 0.0, torque), (fx, fy, 0.0))

    def finalize(self, builder: Any = None) -> None:
        """Complete the model, alone or as part of a diagram's `builder`, and create its context."""
        if not self.plant.is_finalized():
            self.plant.Finalize()
        self._order = np.array([joint.velocity_start() for joint in self.joints], dtype=int)
        with quiet():
            self.system = self.plant if builder is None else builder.Build()
            self.root = self.system.CreateDefaultContext()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)

    def put(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Set the links' coordinates and rates, each of shape (links,)."""
        state = np.empty((2, len(self._order)))
        state[:, self._order] = position, velocity
        self.plant.SetPositionsAndVelocities(self.context, state.reshape(-1))

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the links' coordinates and rates."""
        return self.ordered(self.plant.GetPositionsAndVelocities(self.context))

    def ordered(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the links' coordinates and rates in a state of Drake's."""
        position, velocity = state.reshape(2, -1).take(self._order, axis=1)
        return position, velocity

    def dynamics(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the mass matrix, (links, links), and the joint forces without acceleration, (links,)."""
        mass = self.plant.CalcMassMatrix(self.context)
        bias = self.plant.CalcBiasTerm(self.context) - self.plant.CalcGravityGeneralizedForces(
            self.context
        )
        return mass[np.ix_(self._order, self._order)], bias[self._order]


def start_mass(scene: Scene, tree: LinkTree) -> np.ndarray:
    """Return the mass matrix of the links at the scene's start, shape (links, links)."""
    plant = Plant(scene, tree, 0.0)
    plant.finalize()
    plant.put(*tree.coordinates(scene))
    return plant.dynamics()[0]
