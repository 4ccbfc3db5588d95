"""DART: joint coordinates (Featherstone), impulses by Dantzig's LCP solver, semi-implicit Euler.

Joint fidelity. The bodies are those of `stiction.engines.shared.link_tree.LinkTree`, in prismatic and revolute joints;
joints that close loops are ball joint constraints, corrected by `erp` of their error each step. Drives: actuators of
prescribed velocity. Friction: the Coulomb friction of DART's joints, sliding and turning, at the bound.

Contact fidelity. The slider has four small spheres between two half-spaces, at the declared clearance. Their outer
points are the corners of a box of the guide's length and width; or the slider is that box, between two fixed boxes.
DART's projected Gauss-Seidel solves for the contacts to convergence. For contacts in the plane the matrix of Dantzig's
method is singular; where it is not, that method bounds friction by the normal forces without friction.
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
from stiction.engines.protocol import BadTrajectory, check_version, installed_version
from stiction.engines.shared.acceleration_integrator import Dynamics
from stiction.engines.shared.contact_geometry import (
    REACH,
    box_angle,
    direction_of,
    several_guides,
    slider_box,
    surface_distance,
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
"""Part of the largest rate of a joint below which a slider rests while others move. A slider that friction holds has
1e-14 of it."""
_MIXING = 1e-9
"""DART's constraint force mixing of joint friction (DART_CFM). A joint that friction holds keeps this share of the rate
that its friction alone would cause in a step."""
_LEAST_FRICTION = 1e-3
"""Coefficient of friction up to which DART's contacts have none (DART_FRICTION_COEFF_THRESHOLD)."""
_ROUGH = 1e9
"""Coefficient of friction of surfaces. DART's contacts have the smaller coefficient of their two shapes, so that the
slider's is the contact's. An infinite one is not allowed."""
_CONVERGED = 1e-12
"""Relative change of an impulse in a sweep of Gauss-Seidel at which the iteration ends. DART's default is 1e-3, with
which contacts open and hit again."""
_MASS = 1e6
"""Approximate mass of all bodies together, in the unit of mass that DART is given at contact fidelity. The unit is a
power of 2, so that the conversion is exact. DART's Gauss-Seidel takes any impulse below 1e-8 for converged
(PGS_EPSILON), and in this unit impulses are far above that."""
_NO_MOBILITY = 1e-9
"""Part of the inverse of all masses below which a direction of a contact cannot be moved. Directions out of the plane
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
        return check_version("dartpy", installed_version("dartpy"))

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
    """Correct this share of a loop's error in a step, at any speed, within this context."""
    from dartpy.constraint import BallJointConstraint as Loop

    # DART has one value for the whole process, so that of the caller is restored.
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
    """Return the skeletons with the places of their coordinates, and joints and bodies by link.

    Each branch from the ground is a skeleton. Masses are multiplied by `unit`.
    """
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
            # Part of a free body's joint. DART has a planar joint of three coordinates for all of
            # it, and no links without mass.
            continue
        if link.joint is None:
            properties = PlanarJointProperties()
            create = skeleton.createPlanarJointAndBodyNodePair
        elif link.slides:
            properties = PrismaticJointProperties()
            properties.mAxis = np.array((*link.axis, 0.0))
            create = skeleton.createPrismaticJointAndBodyNodePair
        else:
            properties = RevoluteJointProperties()
            properties.mAxis = np.array((0.0, 0.0, 1.0))
            create = skeleton.createRevoluteJointAndBodyNodePair
        properties.mName = f"joint-{i}"
        joint, body = create(bodies.get(link.parent), properties)
        joint.setTransformFromParentBodyNode(_placed(tree.place(i)[:2], link.angle))
        data = scene.bodies[link.body]
        body.setInertia(
            Inertia(unit * data.mass, tree.centre(i), np.eye(3) * (unit * data.inertia))
        )
        joints[i], bodies[i] = joint, body
        # Arrays of coordinates are exchanged by place, so DART's order has to be that of the links.
        place = first + joint.getIndexInSkeleton(joint.getNumDofs() - 1)
        if place != i:
            raise RuntimeError(
                f"DART gives the coordinate of link {i} the number {place}; expected the order of creation"
            )
    places = [
        (skeleton, slice(first, first + skeleton.getNumDofs()))
        for first, skeleton in skeletons.items()
    ]
    return places, joints, bodies


def _placed(point: Sequence[float] | np.ndarray, angle: float) -> Any:
    """Return DART's transform of a place and an angle in the plane."""
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
        # Masses and forces go to DART in this unit; accelerations do not depend on it.
        self._unit = (
            2.0 ** round(math.log2(_MASS / mass)) if self.fidelity == Fidelity.CONTACT else 1.0
        )
        self._world = world = World()
        world.setTimeStep(h)
        world.setGravity(np.array([*(scene.gravity or (0.0, 0.0)), 0.0]))
        # By default DART stops bodies that hardly move.
        sleep = world.getDeactivationOptions()
        sleep.mEnabled = False
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
        """Add the constraint of a revolute joint that closes a loop."""
        from dartpy.constraint import BallJointConstraint

        pin, tree, links = scene.pins[name], self.tree, self._links
        # The ground, if it is one of the two, is link -1 and so comes first in this order.
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
        # DART sets commands and loads to zero in each step.
        for link, rate in self.rates.items():
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
        self.position[:] = self._of_all("getPositions")
        self.velocity[:] = self._of_all("getVelocities")
        self._read_friction(caps)

    def _read_friction(self, caps: Sequence[float]) -> None:
        """Set `held` from the last pass, which had these bounds of friction (N)."""
        if self.tree.loops:
            # DART reports the forces of a joint as one sum, in which those of loops are too. But
            # a joint that friction holds keeps a small rate, proportional to the friction.
            slip_speed = np.abs(self.velocity[self.friction_links])
            moves = slip_speed > _AT_REST * np.abs(self.velocity).max(initial=0.0)
            self.held[:] = 0.0
            if moves.any():
                # The mobility (1/kg, 1/(kg m^2)) by which DART scales the mixing: that of each joint
                # with all other joints free, and loops open.
                mobility = np.concatenate(
                    [np.diagonal(skeleton.getInvMassMatrix()) for skeleton, _ in self._skeletons]
                )
                friction = slip_speed / (_MIXING * self.h * mobility[self.friction_links])
                self.held[moves] = np.minimum(friction, caps)[moves]
        else:
            self.held[:] = np.abs(self._of_all("getConstraintForces")[self.friction_links])

    def _of_all(self, what: str) -> np.ndarray:
        """Return the values of a method of all skeletons, in one array."""
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
        # The surfaces of each guide are a body of its own, fixed to the ground, so that contacts can
        # be told apart.
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
        # Of each guide: its name, the coordinate x of its slider, which is that of two links before
        # the link itself, and its point.
        self._ends = [
            (name, self.tree.link_of[guide.slider] - 2, guide.point)
            for name, guide in scene.guides.items()
        ]
        self._coefficients: Sequence[float] = []

    def _solve_by_gauss_seidel(self, iterations: int) -> None:
        from dartpy.constraint import BoxedLcpConstraintSolver, PgsBoxedLcpSolverOption

        solver, option = (
            self._world.getConstraintSolver(),
            PgsBoxedLcpSolverOption(iterations, 0.0, _CONVERGED, _NO_MOBILITY / _MASS),
        )
        # Both solvers of the world are to be Gauss-Seidel: where the first does not converge, DART
        # discards its result and asks the second. Python cannot create one, but each constraint
        # solver has one as its second, so the first is that of another. DART does not accept the
        # same object for both.
        first, second = (
            each.getSecondaryBoxedLcpSolver() for each in (BoxedLcpConstraintSolver(), solver)
        )
        first.setOption(option)
        second.setOption(option)
        solver.setBoxedLcpSolver(first)

    def _keep_apart(self, surfaces: Sequence[tuple[Any, Any]]) -> None:
        """Let each slider touch the surfaces of its own guide only."""
        # Python gets a copy of the option, whose filter is the world's own. A new filter would have
        # no effect.
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
        if coefficients != self._coefficients:
            self._coefficients = coefficients
            for (_, touching, _, _), coefficient in zip(self._guides, coefficients):
                for aspect in touching:
                    aspect.setFrictionCoeff(coefficient)

    def advance(self, caps: Sequence[float]) -> None:
        super().advance(caps)
        for name, x, point in self._ends:
            # This is checked in each step, because ODE ends the process if a body is much farther away.
            distance = math.dist(self.position[x : x + 2], point)
            if distance > REACH:
                raise BadTrajectory(
                    f"dart: {name} is {distance:g} m from its guide's point; guides end at {REACH:g} m"
                )

    def contact_forces(self) -> tuple[list[float], list[float]]:
        contacts, normals, frictions = self._world.getLastCollisionResult().getContacts(), [], []
        for number, _, ux, uy in self._guides:
            # Shapes have the number of their guide in their names. With one guide, they need not be
            # looked up.
            forces = [
                contact.force.tolist()
                for contact in contacts
                if self._alone
                or int(contact.collisionObject1.getShapeFrame().getName().split()[0]) == number
            ]
            normals.append(sum([abs(ux * fy - uy * fx) for fx, fy, _ in forces]) / self._unit)
            frictions.append(sum([abs(ux * fx + uy * fy) for fx, fy, _ in forces]) / self._unit)
        return normals, frictions


def _touch(body: Any, number: int, shape: Any, place: Any) -> Any:
    """Add a colliding shape to a body, named by its guide's number; return its dynamics, with friction 1 until set."""
    node = body.createShapeNode(shape, f"{number} {body.getNumShapeNodes()}")
    node.setRelativeTransform(place)
    node.createCollisionAspect()
    node.createDynamicsAspect()
    return node.getDynamicsAspect()


def _spheres(
    guide: Translational, along: np.ndarray
) -> tuple[list[tuple[Any, Any]], list[tuple[Any, Any]]]:
    """Return shapes of the slider and of the guide's two surfaces, with their places.

    Places of the slider's shapes are relative to its centre of mass, which is the origin of a root of the tree.
    """
    from dartpy.dynamics import PlaneShape, SphereShape

    width = guide.extent[1]
    radius, inward = _RADIUS * width, np.array([-along[1], along[0]])
    return (
        [(SphereShape(radius), _placed(corner, 0.0)) for corner in slider_box(guide, 2 * radius)],
        [
            (
                PlaneShape(
                    np.array([*normal, 0.0]), float(normal @ guide.point) - surface_distance(guide)
                ),
                _placed((0.0, 0.0), 0.0),
            )
            for normal in (inward, -inward)
        ],
    )


def _boxes(
    guide: Translational, along: np.ndarray
) -> tuple[list[tuple[Any, Any]], list[tuple[Any, Any]]]:
    """Return boxes as the shapes of the slider and of the surfaces, with their places, as `_spheres`."""
    from dartpy.dynamics import BoxShape

    away = np.array([-along[1], along[0]]) * (surface_distance(guide) + _DEPTH)
    angle = math.atan2(along[1], along[0])
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
