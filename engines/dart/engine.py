"""DART: a skeleton in joint coordinates (Featherstone), impulses on joint velocities (Dantzig's LCP solver), semi-implicit Euler.

Joint fidelity. The bodies are those of `stiction.engines.shared.link_tree.LinkTree`, in prismatic and revolute joints; joints that close loops are ball
joint constraints, corrected by `erp` of their error each step. Drives: actuators of prescribed velocity, at the rate of the law, constant or
such that each step ends on it; which joints can be driven is said in `stiction.engines.shared.joint_coordinates`. Friction: the Coulomb friction of
DART's joints at the bound of `stiction.engines.shared.friction_cap`. Springs, dampers, forces and torques are evaluated by the adapter and applied to
the bodies.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np

from stiction.engines.protocol import accepted, installed_version
from stiction.engines.shared.joint_coordinates import TreeAccelerations, TreeStepper, driven_link
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.tree_engine import TreeEngine
from stiction.scenes import Scene

_SETTINGS = {"passes": 2, "erp": 1.0}
_AT_REST = 1e-9
"""Of the largest rate of a joint: below, a slider rests. What friction holds has 1e-14."""
_SETTLING = 16
"""Steps in which the joints that close loops settle at the position error they keep."""


class DartEngine(TreeEngine):
    """Adapter of DART; see the module for what becomes of each element.

    Settings: `passes` at a step where stick is undecided, `erp` (share of a position error of loops that is corrected in one step).
    """

    name, called = "dart", "DART"
    defaults = {"joint": _SETTINGS}

    @property
    def version(self) -> str:
        import dartpy  # noqa: F401: whether it can be imported is the question

        return accepted("dartpy", installed_version("dartpy"))

    def refusal_of_tree(self, scene: Scene, tree: LinkTree) -> str | None:
        for name, drive in scene.drives.items():
            if tree.links[driven_link(scene, tree, drive)[0]].joint is None:
                return f"drives.{name}: turns a body that no joint ties to the ground; DART drives a joint's coordinates all or none"
        return None

    def stepper(self, scene: Scene, h: float, options: Mapping[str, Any], fidelity: str) -> AbstractContextManager[TreeStepper]:
        return nullcontext(_Stepper(scene, h, options))

    def accelerations(self, scene: Scene) -> TreeAccelerations:
        return _Accelerations(scene)


def _skeletons(scene: Scene, tree: LinkTree) -> tuple[dict[int, Any], dict[int, Any], dict[int, Any]]:
    """A skeleton for each link on the ground and all that hangs from it, by the first of its coordinates, which are those of the links; joint and
    body of each link that has a body."""
    from dartpy.dynamics import Inertia, PlanarJointProperties, PrismaticJointProperties, RevoluteJointProperties, Skeleton
    from dartpy.math import Isometry3

    skeletons, joints, bodies = {}, {}, {}
    for i, link in enumerate(tree.links):
        if link.parent < 0:
            first = i
            skeleton = skeletons[i] = Skeleton(f"skeleton-{i}")
        if link.body is None:  # half of a free body's joint: DART has one for all of it, and no links without mass
            continue
        if link.joint is None:
            properties, create = PlanarJointProperties(), skeleton.createPlanarJointAndBodyNodePair
        elif link.slides:
            properties, create = PrismaticJointProperties(), skeleton.createPrismaticJointAndBodyNodePair
            properties.mAxis = np.array((*link.axis, 0.0))
        else:
            properties, create = RevoluteJointProperties(), skeleton.createRevoluteJointAndBodyNodePair
            properties.mAxis = np.array((0.0, 0.0, 1.0))
        properties.mName = f"joint-{i}"
        joint, body = create(bodies.get(link.parent), properties)
        origin = tree.links[link.parent].point if link.parent >= 0 else (0.0, 0.0)
        place, c, s = Isometry3(), math.cos(link.angle), math.sin(link.angle)
        place.set_rotation(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
        place.set_translation(np.array([link.anchor[0] - origin[0], link.anchor[1] - origin[1], 0.0]))
        joint.setTransformFromParentBodyNode(place)
        data = scene.bodies[link.body]
        body.setInertia(Inertia(data.mass, _centre(link.point), np.eye(3) * data.inertia))
        joints[i], bodies[i] = joint, body
        if (found := first + joint.getIndexInSkeleton(joint.getNumDofs() - 1)) != i:
            raise RuntimeError(f"DART numbers the coordinate of link {i} as {found}; expected them as they were made")
    return skeletons, joints, bodies


def _centre(point: tuple[float, float]) -> np.ndarray:
    """A link's centre of mass in the link's frame, whose origin is the joint's point."""
    return np.array([-point[0], -point[1], 0.0])


def _gravity(scene: Scene) -> np.ndarray:
    return np.array([*(scene.gravity or (0.0, 0.0)), 0.0])


class _Stepper(TreeStepper):
    """A scene as DART's world of one skeleton."""

    def __init__(self, scene: Scene, h: float, options: Mapping[str, Any]):
        from dartpy.dynamics import ActuatorType
        from dartpy.simulation import World

        tree = LinkTree(scene)
        super().__init__(scene, h, tree, options["passes"])
        self._world = world = World()
        world.setTimeStep(h)
        world.setGravity(_gravity(scene))
        sleep = world.getDeactivationOptions()
        sleep.mEnabled = False  # on by default: what hardly moves is stopped
        world.setDeactivationOptions(sleep)
        skeletons, self._joints, links = _skeletons(scene, tree)
        self._skeletons = [(skeleton, slice(first, first + skeleton.getNumDofs())) for first, skeleton in skeletons.items()]
        self._rates: dict[int, float] = {}
        for drive in scene.drives.values():
            self._joints[driven_link(scene, tree, drive)[0]].setActuatorType(ActuatorType.VELOCITY)
        for skeleton in skeletons.values():
            world.addSkeleton(skeleton)
        self._put(self.position, self.velocity)
        for name in tree.loops:
            self._close_loop(scene, name, links, options["erp"])
        self._bodies = [(links[tree.link_of[name]], _centre(tree.links[tree.link_of[name]].point)) for name in scene.bodies] if self.loaded else []
        self.add_drives(scene)
        if tree.loops:
            self.settling = _SETTLING

    def _close_loop(self, scene: Scene, name: str, links: Mapping[int, Any], erp: float) -> None:
        from dartpy.constraint import BallJointConstraint

        joint = scene.joints[name]
        (first, p), (second, _) = sorted(zip(joint.bodies, joint.points), key=lambda side: self.tree.link_of[side[0]], reverse=True)
        body, other = links[self.tree.link_of[first]], self.tree.link_of[second]
        place = body.getWorldTransform().multiply(_centre(self.tree.links[self.tree.link_of[first]].point) + (*p, 0.0))
        constraint = BallJointConstraint(body, links[other], place) if other >= 0 else BallJointConstraint(body, place)
        constraint.setErrorReductionParameter(erp)  # DART has one for all constraints
        constraint.setMaxErrorReductionVelocity(math.inf)
        self._world.getConstraintSolver().addConstraint(constraint)

    def _put(self, position: np.ndarray, velocity: np.ndarray) -> None:
        for skeleton, part in self._skeletons:
            skeleton.setPositions(position[part])
            skeleton.setVelocities(velocity[part])

    def drive_rate(self, link: int, rate: float) -> None:
        self._rates[link] = rate

    def advance(self, caps: Sequence[float]) -> None:
        for link, cap in zip(self.friction_links, caps):
            self._joints[link].setCoulombFriction(0, cap)
        for link, rate in self._rates.items():  # a step forgets commands and loads
            self._joints[link].setCommand(0, rate)
        if self.loaded:
            loads = self.loads.tolist()
            for i, (body, centre) in enumerate(self._bodies):
                fx, fy, torque = loads[3 * i:3 * i + 3]
                if fx or fy:
                    body.addExtForce((fx, fy, 0.0), centre, False, True)
                if torque:
                    body.addExtTorque((0.0, 0.0, torque), False)
        self.clock.call(self._world.step, True)
        self.position[:], self.velocity[:] = self._of_all("getPositions"), self._of_all("getVelocities")
        if self.tree.loops:  # whose forces DART has in one sum with those of friction; but what friction holds is at rest to rounding
            slip_speed = np.abs(self.velocity[self.friction_links])
            self.held[:] = np.where(slip_speed > _AT_REST * np.abs(self.velocity).max(initial=0.0), caps, 0.0)
        else:
            self.held[:] = np.abs(self._of_all("getConstraintForces")[self.friction_links])

    def _of_all(self, what: str) -> np.ndarray:
        """What each skeleton says of its coordinates, in one array."""
        parts = [getattr(skeleton, what)() for skeleton, _ in self._skeletons]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def retreat(self) -> None:
        self._put(*self.start)


class _Accelerations(TreeAccelerations):
    """DART's mass matrix and bias forces."""

    def __init__(self, scene: Scene):
        tree = LinkTree(scene)
        super().__init__(scene, tree)
        skeletons, *_ = _skeletons(scene, tree)
        self._skeletons = [(skeleton, slice(first, first + skeleton.getNumDofs())) for first, skeleton in skeletons.items()]
        for skeleton in skeletons.values():
            skeleton.setGravity(_gravity(scene))

    def dynamics(self, position: np.ndarray, velocity: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mass, bias = self.clock.call(self._mass_and_bias, position, velocity)
        return mass, mass @ second + bias

    def _mass_and_bias(self, position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of all skeletons, by the engine."""
        mass, bias = np.zeros((len(position), len(position))), np.zeros(len(position))
        for skeleton, part in self._skeletons:
            skeleton.setPositions(position[part])
            skeleton.setVelocities(velocity[part])
            mass[part, part], bias[part] = skeleton.getMassMatrix(), skeleton.getCoriolisAndGravityForces()
        return mass, bias
