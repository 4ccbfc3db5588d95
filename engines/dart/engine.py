"""DART: joint coordinates (Featherstone), impulses by Dantzig's LCP solver, semi-implicit Euler.

Joint fidelity. The bodies are those of `stiction.engines.shared.link_tree.LinkTree`, in prismatic and revolute joints;
joints that close loops are ball joint constraints, corrected by `erp` of their error each step. Drives: actuators of
prescribed velocity. Friction: the Coulomb friction of DART's joints at the bound.

Contact fidelity. The slider has four small spheres between two half-spaces, without clearance. Their outer points are
the corners of a box of the guide's length and width; or it is that box, between two fixed boxes. Contacts are solved by
DART's projected Gauss-Seidel to convergence: of contacts in the plane Dantzig's matrix is singular, and where it is
not, his friction is bound by the normal forces without friction.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import combinations
from typing import Any

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.protocol import BadTrajectory, accepted, installed_version
from stiction.engines.shared.acceleration_integrator import Dynamics
from stiction.engines.shared.contact_geometry import (
    REACH,
    box_angle,
    direction_of,
    several_guides,
    slider_box,
)
from stiction.engines.shared.engine_clock import EngineClock
from stiction.engines.shared.fixed_step import Defaults
from stiction.engines.shared.joint_coordinates import ContactStepper, TreeStepper, motor_link
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.tree_engine import TreeEngine
from stiction.scenes import Scene
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.model import Translational

_SETTINGS: Mapping[str, Defaults] = {
    Fidelity.JOINT: {"passes": 2, "erp": 1.0},
    Fidelity.CONTACT: {
        "iterations": 1000,
        "erp": 1.0,
        "shape": ("spheres", "box"),
        "detector": ("ODE", "FCL", "Bullet", "DART"),
    },
}
_AT_REST = 1e-9
"""Part of the largest rate of a joint below which a slider rests while others move. What friction holds has 1e-14."""
_MIXING = 1e-9
"""DART's constraint force mixing of joint friction (DART_CFM). A joint that it holds keeps this share of a rate: of
what its friction alone would give it in a step."""
_LEAST_FRICTION = 1e-3
"""Coefficient of friction up to which DART's contacts have none (DART_FRICTION_COEFF_THRESHOLD)."""
_ROUGH = 1e9
"""Coefficient of friction of surfaces. DART gives a contact the smaller one of two, so that the slider's is the
contact's; it takes no infinite one."""
_CONVERGED = 1e-12
"""Relative change of an impulse in a sweep of Gauss-Seidel at which it ends. DART's own is 1e-3, after which contacts
let go and hit."""
_MASS = 1e6
"""About that of all bodies together, in the unit that DART is given at contact fidelity, a power of 2: its Gauss-Seidel
takes any impulse below 1e-8 for converged (PGS_EPSILON)."""
_NO_MOBILITY = 1e-9
"""Part of the inverse of all masses below which a direction of a contact cannot be moved. Those out of the plane
cannot, to rounding."""
_RADIUS = 0.25
"""Radius of the spheres, in widths of the guide. Nothing depends on it while the slider is parallel to the guide."""
_DEPTH = 0.5
"""Half the depth of boxes out of the plane in metres; without influence, nothing turns that way."""


class DartEngine(TreeEngine):
    """Adapter of DART; the module describes how each element of a scene is modelled.

    Setting at both fidelities: `erp`, the fraction of the position error of loops that is corrected in one step.

    Further setting at joint fidelity: `passes`, repetitions of a step in which sticking is undecided.

    Further settings at contact fidelity: `iterations`, the largest number of iterations of the solver per step;
    `shape`, spheres at the corners of the slider or the faces of a box; `detector`, the collision detector: ODE, FCL,
    Bullet or DART.
    """

    name, called, defaults = "dart", "DART", _SETTINGS
    reach = {Fidelity.JOINT: math.inf, Fidelity.CONTACT: REACH}

    @property
    def version(self) -> str:
        import_module("dartpy")  # ImportError where it cannot be imported
        return accepted("dartpy", installed_version("dartpy"))

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        if (reason := super().refusal(scene, fidelity)) or fidelity == Fidelity.JOINT:
            return reason
        for name, guide in scene.frictional_guides.items():
            for coefficient in (guide.kinetic_coefficient, guide.static_coefficient):
                if 0 < coefficient <= _LEAST_FRICTION:
                    return (
                        f"joints.{name}: found a coefficient of friction of {coefficient:g}; DART's contacts have "
                        f"none up to {_LEAST_FRICTION:g}"
                    )
        return several_guides(scene)

    def refusal_of_tree(self, scene: Scene, tree: LinkTree) -> str | None:
        for name, drive in scene.drives.items():
            if tree.links[motor_link(scene, tree, drive)[0]].joint is None:
                return (
                    f"drives.{name}: turns a body that no joint ties to the ground; DART drives a joint's "
                    "coordinates all or none"
                )
        return None

    @contextmanager
    def stepper(
        self, assembly: Assembly, h: float, options: Mapping[str, Any], fidelity: Fidelity
    ) -> Iterator[TreeStepper]:
        with _loops_closed_by(options["erp"]):
            yield (_Stepper if fidelity == Fidelity.JOINT else _ContactStepper)(
                assembly, h, options
            )

    @contextmanager
    def dynamics(self, scene: Scene, tree: LinkTree, clock: EngineClock) -> Iterator[Dynamics]:
        skeletons, *_ = _skeletons(scene, tree)
        for skeleton, _ in skeletons:
            skeleton.setGravity(np.array([*(scene.gravity or (0.0, 0.0)), 0.0]))

        def mass_and_bias(
            position: np.ndarray, velocity: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            mass, bias = np.zeros((len(position), len(position))), np.zeros(len(position))
            for skeleton, part in skeletons:
                skeleton.setPositions(position[part])
                skeleton.setVelocities(velocity[part])
                mass[part, part], bias[part] = (
                    skeleton.getMassMatrix(),
                    skeleton.getCoriolisAndGravityForces(),
                )
            return mass, bias

        def evaluate(
            position: np.ndarray, velocity: np.ndarray, second: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            mass, bias = clock.call(mass_and_bias, position, velocity)
            return mass, mass @ second + bias

        yield evaluate


@contextmanager
def _loops_closed_by(erp: float) -> Iterator[None]:
    """Have this share of a loop's error corrected in a step, at any speed; DART has one value for the whole process."""
    from dartpy.constraint import BallJointConstraint as Loop

    before = Loop.getErrorReductionParameter(), Loop.getMaxErrorReductionVelocity()
    Loop.setErrorReductionParameter(erp)
    Loop.setMaxErrorReductionVelocity(math.inf)
    try:
        yield
    finally:
        Loop.setErrorReductionParameter(before[0])
        Loop.setMaxErrorReductionVelocity(before[1])


def _skeletons(
    scene: Scene, tree: LinkTree, unit: float = 1.0
) -> tuple[list[tuple[Any, slice]], dict[int, Any], dict[int, Any]]:
    """Skeletons with the places of their coordinates, joints and bodies by link."""
    from dartpy.dynamics import (
        Inertia,
        PlanarJointProperties,
        PrismaticJointProperties,
        RevoluteJointProperties,
        Skeleton,
    )

    skeletons: dict[int, Any] = {}
    joints: dict[int, Any] = {}
    bodies: dict[int, Any] = {}
    for i, link in enumerate(tree.links):
        if link.parent < 0:
            first = i
            skeleton = skeletons[i] = Skeleton(f"skeleton-{i}")
        if link.body is None:
            # half of a free body's joint: DART has one for all of it, and no links without mass
            continue
        if link.joint is None:
            properties, create = PlanarJointProperties(), skeleton.createPlanarJointAndBodyNodePair
        elif link.slides:
            properties, create = (
                PrismaticJointProperties(),
                skeleton.createPrismaticJointAndBodyNodePair,
            )
            properties.mAxis = np.array((*link.axis, 0.0))
        else:
            properties, create = (
                RevoluteJointProperties(),
                skeleton.createRevoluteJointAndBodyNodePair,
            )
            properties.mAxis = np.array((0.0, 0.0, 1.0))
        properties.mName = f"joint-{i}"
        joint, body = create(bodies.get(link.parent), properties)
        joint.setTransformFromParentBodyNode(_placed(tree.place(i)[:2], link.angle))
        data = scene.bodies[link.body]
        body.setInertia(
            Inertia(unit * data.mass, tree.centre(i), np.eye(3) * (unit * data.inertia))
        )
        joints[i], bodies[i] = joint, body
        if (found := first + joint.getIndexInSkeleton(joint.getNumDofs() - 1)) != i:
            raise RuntimeError(
                f"DART numbers the coordinate of link {i} as {found}; expected them as they were made"
            )
    places = [
        (skeleton, slice(first, first + skeleton.getNumDofs()))
        for first, skeleton in skeletons.items()
    ]
    return places, joints, bodies


def _placed(point: Sequence[float] | np.ndarray, angle: float) -> Any:
    """A place and an angle in the plane, as DART's transform."""
    from dartpy.math import Isometry3

    place, c, s = Isometry3(), math.cos(angle), math.sin(angle)
    place.set_rotation(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    place.set_translation(np.array([*point, 0.0]))
    return place


class _Stepper(TreeStepper):
    """A scene as DART's world of a skeleton for each branch from the ground, friction as that of its joints."""

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any]):
        from dartpy.dynamics import ActuatorType
        from dartpy.simulation import World

        super().__init__(assembly, h, options)
        scene = assembly.scene
        tree, mass = self.tree, sum(body.mass for body in scene.bodies.values())
        self._unit = (
            2.0 ** round(math.log2(_MASS / mass)) if self.fidelity == Fidelity.CONTACT else 1.0
        )
        self._world = world = World()
        world.setTimeStep(h)
        world.setGravity(np.array([*(scene.gravity or (0.0, 0.0)), 0.0]))
        sleep = world.getDeactivationOptions()
        sleep.mEnabled = False  # on by default: what hardly moves is stopped
        world.setDeactivationOptions(sleep)
        self._skeletons, self._joints, self._links = _skeletons(scene, tree, self._unit)
        for drive in scene.drives.values():
            self._joints[motor_link(scene, tree, drive)[0]].setActuatorType(ActuatorType.VELOCITY)
        for skeleton, _ in self._skeletons:
            world.addSkeleton(skeleton)
        self.put(self.position, self.velocity)
        for name in tree.loops:
            self._close_loop(scene, name)
        self._bodies = (
            [
                (self._links[link], tree.centre(link))
                for link in (tree.link_of[name] for name in scene.bodies)
            ]
            if self.loaded
            else []
        )

    def _close_loop(self, scene: Scene, name: str) -> None:
        from dartpy.constraint import BallJointConstraint

        pin, tree, links = scene.pins[name], self.tree, self._links
        (other, _), (first, p) = sorted(
            (tree.link_of[body], point) for body, point in zip(pin.bodies, pin.points)
        )
        body = links[first]
        place = body.getWorldTransform().multiply(tree.centre(first) + (*p, 0.0))
        constraint = (
            BallJointConstraint(body, links[other], place)
            if other >= 0
            else BallJointConstraint(body, place)
        )
        self._world.getConstraintSolver().addConstraint(constraint)

    def put(self, position: np.ndarray, velocity: np.ndarray) -> None:
        for skeleton, part in self._skeletons:
            skeleton.setPositions(position[part])
            skeleton.setVelocities(velocity[part])

    def advance(self, caps: Sequence[float]) -> None:
        for link, cap in zip(self.friction_links, caps):
            self._joints[link].setCoulombFriction(0, cap)
        for link, rate in self.rates.items():  # a step forgets commands and loads
            self._joints[link].setCommand(0, rate)
        if self.loaded:
            loads = (self._unit * self.loads).tolist()
            for i, (body, centre) in enumerate(self._bodies):
                fx, fy, torque = loads[3 * i : 3 * i + 3]
                if fx or fy:
                    body.addExtForce((fx, fy, 0.0), centre, False, True)
                if torque:
                    body.addExtTorque((0.0, 0.0, torque), False)
        self.clock.call(self._world.step, True)
        self.position[:], self.velocity[:] = (
            self._of_all("getPositions"),
            self._of_all("getVelocities"),
        )
        if self.tree.loops:  # whose forces DART has in one sum with those of friction
            slip_speed = np.abs(self.velocity[self.friction_links])
            moves = slip_speed > _AT_REST * np.abs(self.velocity).max(initial=0.0)
            self.held[:] = 0.0
            if moves.any():
                # 1/kg of each guide's joint, as DART has it: other joints are free, and loops open
                mobility = np.concatenate(
                    [np.diagonal(skeleton.getInvMassMatrix()) for skeleton, _ in self._skeletons]
                )
                friction = slip_speed / (_MIXING * self.h * mobility[self.friction_links])
                self.held[moves] = np.minimum(friction, caps)[moves]
        else:
            self.held[:] = np.abs(self._of_all("getConstraintForces")[self.friction_links])

    def _of_all(self, what: str) -> np.ndarray:
        """Coordinates of each skeleton, in one array."""
        parts = [getattr(skeleton, what)() for skeleton, _ in self._skeletons]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)


class _ContactStepper(ContactStepper, _Stepper):
    """Sliders between two fixed surfaces each."""

    def __init__(self, assembly: Assembly, h: float, options: Mapping[str, Any]):
        from dartpy.dynamics import Skeleton
        from dartpy.simulation import CollisionDetectorType

        super().__init__(assembly, h, options)
        scene = assembly.scene
        self._world.setCollisionDetector(
            getattr(CollisionDetectorType, options["detector"].upper())
        )
        self._solve_by_gauss_seidel(options["iterations"])
        ground = Skeleton("guides")
        surfaces, self._guides = [], []
        for number, guide in enumerate(scene.guides.values()):
            slider = self._links[self.tree.link_of[guide.slider]]
            along = np.array(direction_of(guide))
            _, surface = ground.createWeldJointAndBodyNodePair()
            surfaces.append((surface, slider))
            own, fixed = (_spheres if options["shape"] == "spheres" else _boxes)(guide, along)
            touching = [_touch(slider, number, shape, place) for shape, place in own]
            for shape, place in fixed:
                _touch(surface, number, shape, place).setFrictionCoeff(_ROUGH)
            for aspect in touching:
                aspect.setFrictionCoeff(0.0)
            if guide.frictional:
                self._guides.append((number, touching, *along.tolist()))
        self._world.addSkeleton(ground)
        self._keep_apart(surfaces)
        self._alone = len(surfaces) == 1
        # of a root, x is two links before its angle
        self._ends = [
            (name, self.tree.link_of[guide.slider] - 2, guide.point)
            for name, guide in scene.guides.items()
        ]
        self._set: Sequence[float] = []

    def _solve_by_gauss_seidel(self, iterations: int) -> None:
        from dartpy.constraint import BoxedLcpConstraintSolver, PgsBoxedLcpSolverOption

        solver, option = (
            self._world.getConstraintSolver(),
            PgsBoxedLcpSolverOption(iterations, 0.0, _CONVERGED, _NO_MOBILITY / _MASS),
        )
        # Python can make none, but takes that of another: DART will not have one solver for both, and forgets what the
        # first has not finished
        first, second = (
            each.getSecondaryBoxedLcpSolver() for each in (BoxedLcpConstraintSolver(), solver)
        )
        first.setOption(option)
        second.setOption(option)
        solver.setBoxedLcpSolver(first)

    def _keep_apart(self, surfaces: Sequence[tuple[Any, Any]]) -> None:
        """Let each slider touch the surfaces of its own guide only."""
        # of which Python has a copy: another one is not heeded
        uncollided = self._world.getConstraintSolver().getCollisionOption().collisionFilter
        for (surface, slider), (other_surface, other_slider) in combinations(surfaces, 2):
            for pair in (
                (surface, other_surface),
                (surface, other_slider),
                (slider, other_surface),
                (slider, other_slider),
            ):
                uncollided.addBodyNodePairToBlackList(*pair)

    def rub(self, coefficients: Sequence[float]) -> None:
        if coefficients != self._set:
            self._set = coefficients
            for (_, touching, _, _), coefficient in zip(self._guides, coefficients):
                for aspect in touching:
                    aspect.setFrictionCoeff(coefficient)

    def advance(self, caps: Sequence[float]) -> None:
        super().advance(caps)
        for name, x, point in self._ends:
            if (distance := math.dist(self.position[x : x + 2], point)) > REACH:
                # much farther, and ODE ends the process
                raise BadTrajectory(
                    f"dart: {name} is {distance:g} m from its guide's point; guides end at {REACH:g} m"
                )

    def contact_forces(self) -> tuple[list[float], list[float]]:
        contacts, normals, frictions = self._world.getLastCollisionResult().getContacts(), [], []
        for number, _, ux, uy in self._guides:
            forces = [
                contact.force.tolist()
                for contact in contacts
                if self._alone  # whose shapes have its number
                or int(contact.collisionObject1.getShapeFrame().getName().split()[0]) == number
            ]
            normals.append(sum([abs(ux * fy - uy * fx) for fx, fy, _ in forces]) / self._unit)
            frictions.append(sum([abs(ux * fx + uy * fy) for fx, fy, _ in forces]) / self._unit)
        return normals, frictions


def _touch(body: Any, number: int, shape: Any, place: Any) -> Any:
    """Give a body a shape that touches, named by its guide's number; returns its dynamics, of friction 1 until set."""
    node = body.createShapeNode(shape, f"{number} {body.getNumShapeNodes()}")
    node.setRelativeTransform(place)
    node.createCollisionAspect()
    node.createDynamicsAspect()
    return node.getDynamicsAspect()


def _spheres(
    guide: Translational, along: np.ndarray
) -> tuple[list[tuple[Any, Any]], list[tuple[Any, Any]]]:
    """Shapes of the slider and of the guide's two surfaces, with their places.

    Those of the slider count from its centre of mass, which is the origin of the root of a tree.
    """
    from dartpy.dynamics import PlaneShape, SphereShape

    width = guide.extent[1]
    radius, inward = _RADIUS * width, np.array([-along[1], along[0]])
    return (
        [(SphereShape(radius), _placed(corner, 0.0)) for corner in slider_box(guide, 2 * radius)],
        [
            (
                PlaneShape(np.array([*normal, 0.0]), float(normal @ guide.point) - width / 2),
                _placed((0.0, 0.0), 0.0),
            )
            for normal in (inward, -inward)
        ],
    )


def _boxes(
    guide: Translational, along: np.ndarray
) -> tuple[list[tuple[Any, Any]], list[tuple[Any, Any]]]:
    """Shapes and places as of `_spheres`."""
    from dartpy.dynamics import BoxShape

    away, angle = (
        np.array([-along[1], along[0]]) * (guide.extent[1] / 2 + _DEPTH),
        math.atan2(along[1], along[0]),
    )
    return (
        [
            (
                BoxShape(np.array([*guide.extent, 2 * _DEPTH])),
                _placed(guide.slider_point, box_angle(guide)),
            )
        ],
        [
            (
                BoxShape(np.array([2 * REACH, 2 * _DEPTH, 4 * _DEPTH])),
                _placed(guide.point + side * away, angle),
            )
            for side in (-1, 1)
        ],
    )
