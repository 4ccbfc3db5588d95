"""PyBullet: a multibody in reduced coordinates (Featherstone), impulses on joint velocities, symplectic Euler.

Where point-to-point constraints close loops, the first step also changes the consistent velocities of the start to the
engine's discrete ones. The sample at 0 then contains the acceleration of the second step.

Joint fidelity. The mechanism is one multibody on a fixed base, its joints those of
`stiction.engines.shared.link_tree.LinkTree`. Revolute joints that close a loop are point-to-point constraints,
corrected by `erp` of their error each step. A translational joint that closes a loop is refused: `createConstraint` has
`JOINT_PRISMATIC`, but no motor, which friction needs. Drives: velocity motors. Friction: a velocity motor of rate zero
with `force` at the bound of `stiction.engines.shared.friction_bound`, in guides and in pins. All damping that PyBullet
adds by default is switched off.

Contact fidelity. The slider is a box of the guide's length and width between two fixed boxes, at the declared
clearance.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.joint_effects import EFFECTS_OF_GAPS, LAWS
from stiction.engines.protocol import check_version, installed_version
from stiction.engines.shared.acceleration_integrator import Dynamics
from stiction.engines.shared.contact_geometry import (
    REACH,
    box_angle,
    crowded,
    direction_of,
    several_guides,
    surface_distance,
)
from stiction.engines.shared.engine_clock import EngineClock
from stiction.engines.shared.fixed_step import Defaults
from stiction.engines.shared.joint_coordinates import ContactStepper, TreeStepper
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.tree_engine import TreeEngine
from stiction.scenes import Scene
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.model import Revolute, Translational

_NO_LIMIT = 1e9
"""Limit of the force of a drive or loop (N, N m), and of joint velocities, which PyBullet clamps at 100 otherwise."""
MOST_GUIDES = 31
"""Largest number of guides at contact fidelity. Sliders touch their own guides only, by a bit of a filter each, and
`setCollisionFilterGroupMask` accepts a positive int of 32 bits."""
MOST_LINKS = 121
"""Largest number of links of a multibody: commands have room for 128 coordinates (MAX_DEGREE_OF_FREEDOM), 7 of which
are those of the base. The coordinates of more links are silently dropped."""
_FASTEST = _NO_LIMIT / 2
"""Joint velocity below which PyBullet has surely not clamped it, which it does silently."""
_SLOWEST = -_NO_LIMIT / 2
"""Joint velocity above which PyBullet has surely not clamped it."""
_DEPTH = 0.5
"""Half the depth (m) of boxes out of the plane. It has no influence, as nothing turns out of the plane."""
_PLACE_GAIN = 0.1
"""PyBullet's default of an optional argument of velocity motors, the gain of positions. All arguments are positional,
because names cost half a microsecond a call."""
_RATE_GAIN = 1.0
"""PyBullet's default of the gain of velocities, which is passed for the same reason."""
_PARENT_OF_JOINT = 16
"""Place of the index of the parent link in what `getJointInfo` returns."""
_MOTOR_FORCE = 3
"""Place of the force of the motor in a joint state."""
_NORMAL_FORCE = 9
"""Index of the normal force in a contact point."""
_FRICTION_1 = 10
"""Index of the friction in the first tangential direction."""
_FRICTION_2 = 12
"""Index of the friction in the second tangential direction."""
_SETTINGS: Mapping[str, Defaults] = {
    Fidelity.JOINT: {"iterations": 50, "passes": 2, "erp": 1.0},
    Fidelity.CONTACT: {
        "iterations": 200,
        "erp": 1.0,
        "contact_erp": 0.2,
        "contact_slop": 1e-5,
        "cone_friction": ("on", "off"),
        "friction_anchor": ("off", "on"),
    },
}


class PybulletEngine(TreeEngine):
    """Adapter of PyBullet; the module describes how each element of a scene is modelled.

    Settings at both fidelities: `iterations` of the solver per step; `erp`, the fraction of the position error of loops
    that is corrected in one step.

    Further setting at joint fidelity: `passes`, repetitions of a step in which sticking is undecided.

    Further settings at contact fidelity: `contact_erp`, as `erp`, for overlap; `contact_slop`, the overlap that is not
    corrected, in m; `cone_friction` (on, off), whether the friction forces in two directions have a common bound or one
    each; `friction_anchor` (off, on), whether friction also pulls a contact back to the point where it began.
    """

    name, called, defaults = "pybullet", "PyBullet", _SETTINGS
    reach = {Fidelity.JOINT: math.inf, Fidelity.CONTACT: REACH}
    capabilities = replace(
        TreeEngine.capabilities,
        joint_effects={
            **TreeEngine.capabilities.joint_effects,
            Fidelity.CONTACT: LAWS | EFFECTS_OF_GAPS,
        },
    )

    @property
    def version(self) -> str:
        _ = _pybullet().connect  # an AttributeError if another package has this name
        return check_version("pybullet", installed_version("pybullet"))

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        return super().refusal(scene, fidelity) or (
            crowded(scene, MOST_GUIDES, "PyBullet") or several_guides(scene)
            if fidelity == Fidelity.CONTACT
            else None
        )

    def refusal_of_tree(self, scene: Scene, tree: LinkTree) -> str | None:
        if len(tree.links) > MOST_LINKS:
            return f"{len(tree.links)} links; PyBullet puts at most {MOST_LINKS} of a multibody where they are to start"
        return None

    @contextlib.contextmanager
    def stepper(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], fidelity: Fidelity
    ) -> Iterator[TreeStepper]:
        with _client() as client:
            yield (_Stepper if fidelity == Fidelity.JOINT else _ContactStepper)(
                assembly, h, options, client
            )

    @contextlib.contextmanager
    def dynamics(self, scene: Scene, tree: LinkTree, clock: EngineClock) -> Iterator[Dynamics]:
        with _client() as client:
            bullet = _pybullet()
            if scene.gravity is not None:
                bullet.setGravity(*scene.gravity, 0.0, physicsClientId=client)
            body = _multibody(scene, tree, {}, client)

            def compute(*motion: list[float]) -> tuple[Sequence[Sequence[float]], Sequence[float]]:
                return (
                    bullet.calculateMassMatrix(body, motion[0], physicsClientId=client),
                    bullet.calculateInverseDynamics(body, *motion, physicsClientId=client),
                )

            def evaluate(*motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                mass, needed = clock.call(compute, *(part.tolist() for part in motion))
                return np.array(mass), np.array(needed)

            yield evaluate


def _pybullet() -> Any:
    """Import the library when it is needed, without the build time that it writes to the error stream."""
    if "pybullet" in sys.modules:
        return sys.modules["pybullet"]
    # It is written by C code, so that the file descriptor has to be redirected for the import.
    sys.stderr.flush()
    kept = os.dup(2)
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        import pybullet
    finally:
        os.dup2(kept, 2)
        os.close(kept)
    return pybullet


@contextlib.contextmanager
def _client() -> Iterator[int]:
    """Connect to a physics server for one run."""
    bullet = _pybullet()
    client = bullet.connect(bullet.DIRECT)
    if client < 0:
        raise RuntimeError("PyBullet gave no physics server")
    try:
        yield client
    finally:
        bullet.disconnect(client)


def _multibody(scene: Scene, tree: LinkTree, shapes: Mapping[int, int], client: int) -> int:
    """Create the scene's links in PyBullet, with collision shapes by link, without motors and damping."""
    bullet, links = _pybullet(), tree.links
    body = bullet.createMultiBody(
        baseMass=0.0,
        linkMasses=[scene.bodies[link.body].mass if link.body else 0.0 for link in links],
        linkCollisionShapeIndices=[shapes.get(i, -1) for i in range(len(links))],
        linkVisualShapeIndices=[-1] * len(links),
        linkPositions=[tree.place(i) for i in range(len(links))],
        linkOrientations=[bullet.getQuaternionFromEuler([0.0, 0.0, link.angle]) for link in links],
        linkInertialFramePositions=[tree.centre(i) for i in range(len(links))],
        linkInertialFrameOrientations=[(0.0, 0.0, 0.0, 1.0)] * len(links),
        linkParentIndices=[link.parent + 1 for link in links],
        linkJointTypes=[
            bullet.JOINT_PRISMATIC if link.slides else bullet.JOINT_REVOLUTE for link in links
        ],
        linkJointAxis=[(*link.axis, 0.0) if link.slides else (0.0, 0.0, 1.0) for link in links],
        physicsClientId=client,
    )
    if body < 0:
        raise RuntimeError("PyBullet did not create the multibody")
    for i, link in enumerate(links):
        # States and motors are addressed by number, so the order has to be that of the tree.
        joint = bullet.getJointInfo(body, i, physicsClientId=client)
        if joint[_PARENT_OF_JOINT] != link.parent:
            raise RuntimeError(
                f"PyBullet numbered the links otherwise than they were given: link {i}"
            )
        bullet.changeDynamics(
            body,
            i,
            linearDamping=0.0,
            angularDamping=0.0,
            jointDamping=0.0,
            maxJointVelocity=_NO_LIMIT,
            physicsClientId=client,
        )
        # In a call of its own: PyBullet silently ignores an inertia in the same call as damping.
        if link.body:
            inertia = scene.bodies[link.body].inertia
            bullet.changeDynamics(
                body, i, localInertiaDiagonal=[inertia] * 3, physicsClientId=client
            )
        # PyBullet gives each joint a motor that brakes it; it is switched off.
        bullet.setJointMotorControl2(
            body, i, bullet.VELOCITY_CONTROL, force=0.0, physicsClientId=client
        )
    return body


class _Stepper(TreeStepper):
    """A scene as a PyBullet multibody; friction as capped motors of its joints."""

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any], client: int):
        super().__init__(assembly, h, options)
        scene = assembly.scene
        bullet = _pybullet()
        self._bullet = bullet
        self._client = client
        tree = self.tree
        bullet.setTimeStep(h, physicsClientId=client)
        bullet.setPhysicsEngineParameter(
            numSolverIterations=options["iterations"],
            solverResidualThreshold=0.0,
            erp=options["erp"],
            physicsClientId=client,
        )
        if scene.gravity is not None:
            bullet.setGravity(*scene.gravity, 0.0, physicsClientId=client)
        self._multibody = _multibody(scene, tree, self._shapes(scene), client)
        loaded = {
            name for spring in scene.springs_and_dampers.values() for name in spring.bodies
        } | {load.body for load in scene.forces.values()}
        # Functions with the arguments that do not change, which saves time in each step.
        links = list(range(len(tree.links)))
        self._simulate = bullet.stepSimulation
        self._states = partial(bullet.getJointStates, self._multibody, links, client)
        self._reset = partial(bullet.resetJointStatesMultiDof, self._multibody, links)
        braked = len(self.friction_links)
        self._brake = partial(
            bullet.setJointMotorControlArray,
            self._multibody,
            self.friction_links,
            bullet.VELOCITY_CONTROL,
            [0.0] * braked,
            [0.0] * braked,
        )
        self._place_gains, self._rate_gains = [_PLACE_GAIN] * braked, [_RATE_GAIN] * braked
        self._braked = list(enumerate(self.friction_links))
        self._world = bullet.WORLD_FRAME
        self._pushers = [
            (
                3 * i,
                partial(bullet.applyExternalForce, self._multibody, tree.link_of[name]),
                partial(bullet.applyExternalTorque, self._multibody, tree.link_of[name]),
            )
            for i, name in enumerate(scene.bodies)
            if name in loaded
        ]
        # A memory view reads and writes single numbers in half the time that an array takes.
        self._positions, self._velocities = self.position.data, self.velocity.data
        self._held = self.held.data
        self._forces = self.loads.data
        # PyBullet applies forces at the places of the links that it computed last: those at the
        # start of the step before, or those that `put` has set. `_places` are these, and
        # `_present` those at the start of the coming step.
        self._places, self._present = np.zeros(len(self.coordinates)).data, self.coordinates.data
        self.put(self.position, self.velocity)
        for name in tree.loops:
            self._close_loop(scene.pins[name])

    def _shapes(self, scene: Scene) -> dict[int, int]:
        """Return collision shapes by link."""
        return {}

    def _close_loop(self, joint: Revolute) -> None:
        """Add the constraint of a revolute joint that closes a loop."""
        bullet = self._bullet
        (first, second), (p, q) = (self.tree.link_of[name] for name in joint.bodies), joint.points
        pin = bullet.createConstraint(
            self._multibody,
            first,
            self._multibody,
            second,
            bullet.JOINT_POINT2POINT,
            [0, 0, 0],
            [*p, 0.0],
            [*q, 0.0],
            physicsClientId=self._client,
        )
        bullet.changeConstraint(pin, maxForce=_NO_LIMIT, physicsClientId=self._client)

    def drive_rate(self, link: int, rate: float) -> None:
        self._bullet.setJointMotorControl2(
            self._multibody,
            link,
            self._bullet.VELOCITY_CONTROL,
            targetVelocity=rate,
            force=_NO_LIMIT,
            physicsClientId=self._client,
        )

    def put(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._reset(
            [[place] for place in position.tolist()],
            [[rate] for rate in velocity.tolist()],
            self._client,
        )

    def begin(self) -> None:
        super().begin()
        self._places[:] = self._present

    def advance(self, caps: Sequence[float]) -> None:
        client = self._client
        if caps:
            self._brake(caps, self._place_gains, self._rate_gains, client)
        place, loads = self._places, self._forces
        for i, push, turn in self._pushers:
            fx, fy, torque = loads[i], loads[i + 1], loads[i + 2]
            if fx or fy:
                push((fx, fy, 0.0), (place[i], place[i + 1], 0.0), self._world, client)
            if torque:
                turn((0.0, 0.0, torque), self._world, client)
        self.clock.call(self._simulate, client)
        if self._pushers:
            place[:] = self._present
        states, positions, velocities, held = (
            self._states(),
            self._positions,
            self._velocities,
            self._held,
        )
        for i, (position, velocity, _, _) in enumerate(states):
            if not _SLOWEST < velocity < _FASTEST:
                raise FloatingPointError(f"a joint velocity is above {_FASTEST:g}")
            positions[i], velocities[i] = position, velocity
        for i, link in self._braked:
            held[i] = abs(states[link][_MOTOR_FORCE])


class _ContactStepper(ContactStepper, _Stepper):
    """Sliders as boxes between two fixed boxes each."""

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any], client: int):
        super().__init__(assembly, h, options, client)
        scene = assembly.scene
        bullet = self._bullet
        bullet.setPhysicsEngineParameter(
            contactERP=options["contact_erp"],
            contactSlop=options["contact_slop"],
            enableConeFriction=int(options["cone_friction"] == "on"),
            physicsClientId=client,
        )
        if any(guide.restitution for guide in scene.guides.values()):
            # Bullet's default is 0.2 m/s, below which contacts do not rebound.
            bullet.setPhysicsEngineParameter(
                restitutionVelocityThreshold=0.0, physicsClientId=client
            )
        # Each slider touches the two surfaces of its own guide only, by a bit of its filter. Bullet
        # multiplies the coefficients of two shapes, so that with 1 for the surfaces the slider's is
        # the contact's.
        self._guides = []
        for number, guide in enumerate(scene.guides.values()):
            link = self.tree.link_of[guide.slider]
            along = np.array(direction_of(guide))
            bodies = (
                (self._multibody, link),
                (self._surface(guide, along), -1),
                (self._surface(guide, -along), -1),
            )
            for body in bodies:
                bullet.setCollisionFilterGroupMask(
                    *body, 1 << number, 1 << number, physicsClientId=client
                )
            # Coefficients of restitution are multiplied, too.
            bullet.changeDynamics(
                self._multibody,
                link,
                lateralFriction=0.0,
                restitution=guide.restitution,
                physicsClientId=client,
            )
            if options["friction_anchor"] == "on":
                bullet.changeDynamics(
                    self._multibody, link, frictionAnchor=1, physicsClientId=client
                )
            if guide.frictional:
                self._guides.append(link)

    def _shapes(self, scene: Scene) -> dict[int, int]:
        bullet = self._bullet
        # The frame of a slider, which is a free link, has its origin in the centre of mass.
        return {
            self.tree.link_of[guide.slider]: bullet.createCollisionShape(
                bullet.GEOM_BOX,
                halfExtents=[guide.extent[0] / 2, guide.extent[1] / 2, _DEPTH],
                collisionFramePosition=[*guide.slider_point, 0.0],
                collisionFrameOrientation=bullet.getQuaternionFromEuler(
                    [0.0, 0.0, box_angle(guide)]
                ),
                physicsClientId=self._client,
            )
            for guide in scene.guides.values()
        }

    def _surface(self, guide: Translational, along: np.ndarray) -> int:
        """Create the fixed box whose face lies to the right of `along`, beyond the slider and its clearance."""
        bullet = self._bullet
        inward = np.array([-along[1], along[0]])
        centre = guide.point - inward * (surface_distance(guide) + _DEPTH)
        shape = bullet.createCollisionShape(
            bullet.GEOM_BOX, halfExtents=[REACH, _DEPTH, 2 * _DEPTH], physicsClientId=self._client
        )
        body = bullet.createMultiBody(
            0.0,
            shape,
            basePosition=[*centre, 0.0],
            physicsClientId=self._client,
            baseOrientation=bullet.getQuaternionFromEuler(
                [0.0, 0.0, math.atan2(along[1], along[0])]
            ),
        )
        bullet.changeDynamics(
            body, -1, lateralFriction=1.0, restitution=1.0, physicsClientId=self._client
        )
        return body

    def rub(self, coefficients: Sequence[float]) -> None:
        for link, coefficient in zip(self._guides, coefficients):
            self._bullet.changeDynamics(
                self._multibody, link, lateralFriction=coefficient, physicsClientId=self._client
            )

    def contact_forces(self) -> tuple[list[float], list[float]]:
        contacts = [
            self._bullet.getContactPoints(
                bodyA=self._multibody, linkIndexA=link, physicsClientId=self._client
            )
            for link in self._guides
        ]
        normals = [sum([point[_NORMAL_FORCE] for point in points]) for points in contacts]
        frictions = [
            sum([math.hypot(point[_FRICTION_1], point[_FRICTION_2]) for point in points])
            for points in contacts
        ]
        return normals, frictions
