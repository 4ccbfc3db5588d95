"""Translate a scene into a model of Newton: bodies in the plane z = 0, joints that turn about z, contacts as spheres.

The frame of a body has its origin in the centre of mass, so that positions and velocities of Newton's bodies are those
of the scene. Newton's joints go from a parent to a child: the tree is that of `link_tree`, and the remaining joints are
added outside of any articulation, where Newton takes them for closures of loops.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stiction.engines.newton.solvers import SolverKind
from stiction.engines.shared.contact_geometry import (
    box_angle,
    direction_of,
    narrowing,
    slider_box,
    surface_distance,
)
from stiction.engines.shared.joint_coordinates import motor_link
from stiction.engines.shared.link_tree import Link, LinkTree
from stiction.scenes import Scene
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Body, Joint, Revolute, Translational

PLACEHOLDER = 1.0
"""Bound of friction (N, N m) with which a joint is built whose bound is set in each step. Some solvers have a row for
friction only where the bound is positive when they are built."""
ROTOR = 1e7
"""Inertia of the rotor of a drive, as a multiple of the largest inertia that the drive moves. The error of the speed is
the reciprocal, which is the rounding of single precision."""
CARRIAGE = 1e-4
"""Mass of the bodies that hold another one in the plane, as a part of its mass, by which its inertia is too large. With
lighter ones Kamino's iterations converge more slowly."""
RADIUS = 0.25
"""Radius of the spheres, in widths of the guide. Nothing depends on it while the slider is parallel to the guide."""
DEPTH = 0.5
"""Half the depth of boxes out of the plane, m. Nothing turns in that direction."""
DETECTION = 0.1
"""Distance at which contacts are looked for, in widths of the guide. Forces act only where surfaces touch."""


@dataclass(frozen=True)
class Dofs:
    """Places of a scene's elements among the degrees of freedom of a model.

    Attributes
    ----------
    of_joint : dict of str to int
        By joint of the scene: its degree of freedom.
    of_drive : dict of str to int
        By drive: the degree of freedom that it prescribes.
    carriages : dict of int to (int, int)
        By body that two light bodies hold in the plane: those that slide along x, and along x and y.
    """

    of_joint: dict[str, int] = field(default_factory=dict)
    of_drive: dict[str, int] = field(default_factory=dict)
    carriages: dict[int, tuple[int, int]] = field(default_factory=dict)


class Jitter:
    """Moves numbers by units in the last place of single precision, each of a sequence up or down.

    Parameters
    ----------
    units : int
        Number of units; 0 leaves all numbers as they are. Its sign reverses all directions.
    """

    def __init__(self, units: int):
        self._units = units
        # The directions of the numbers, in the order in which they are asked for, are those of a fixed sequence.
        self._directions = np.random.default_rng(0)

    def __call__(self, value: float) -> float:
        """Return a number in single precision, moved."""
        single = np.float32(value)
        if self._units == 0 or single == 0.0:
            return float(single)
        direction = 1 if self._directions.random() < 0.5 else -1
        return float(single + np.float32(self._units * direction) * np.spacing(single))


class ModelWriter:
    """Writes a scene into a builder of Newton.

    Parameters
    ----------
    scene : Scene
    tree : LinkTree
        The tree of the scene at this fidelity.
    fidelity : Fidelity
    kind : SolverKind
        What the solver represents. A body that hangs on no joint has a planar joint, if the solver has it; otherwise it
        hangs on two light bodies at contact fidelity (`CARRIAGE`), and is free in space at joint fidelity. The joint of
        a drive has a rotor (`ROTOR`), if the solver has armature, and otherwise a spring.
    options : mapping
        Settings of the run.
    jitter : Jitter
        Moves the inputs by units in the last place.

    Attributes
    ----------
    builder : newton.ModelBuilder
        The model, which is not finalized yet. Its first bodies are those of the scene, in their order.
    dofs : Dofs
        The places of the elements of the scene.
    """

    def __init__(
        self,
        scene: Scene,
        tree: LinkTree,
        fidelity: Fidelity,
        kind: SolverKind,
        options: Mapping[str, Any],
        jitter: Jitter,
    ):
        import newton

        self._scene, self._tree, self._fidelity, self._kind = scene, tree, fidelity, kind
        self._options, self._jitter = options, jitter
        gravity = [jitter(value) for value in scene.gravity or (0.0, 0.0)]
        self.builder: Any = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(*gravity, 0.0))
        self.dofs = Dofs()
        self._start, _ = tree.coordinates(scene)
        self._motors = {
            motor_link(scene, tree, drive)[0]: name for name, drive in scene.drives.items()
        }
        self._rotor = ROTOR * inertia_scale(scene)
        self._bodies = {GROUND: -1}
        self._next_dof = 0
        self._add_bodies()
        self._add_tree()
        for name in tree.loops:
            self._close_loop(name)
            self.dofs.of_joint[name] = self._take_dofs(1)
        if fidelity == Fidelity.CONTACT:
            for number, guide in enumerate(scene.guides.values()):
                _add_shapes(
                    self.builder, guide, self._bodies[guide.slider], number, options, jitter
                )

    def _add_bodies(self) -> None:
        """Add the bodies of the scene, whose frames have their origins in the centres of mass."""
        jitter = self._jitter
        for name, body in self._scene.bodies.items():
            self._bodies[name] = self.builder.add_link(
                xform=placed([*map(jitter, body.position)], jitter(body.angle)),
                mass=jitter(body.mass),
                inertia=np.eye(3) * jitter(body.inertia),
                lock_inertia=True,
                label=name,
            )

    def _add_tree(self) -> None:
        """Add the joints of the tree, with an articulation for each branch that starts from the ground."""
        branches: list[list[int]] = []
        for number, link in enumerate(self._tree.links):
            # A link without a body is part of the joint of a free body, which has three coordinates.
            if link.body is None:
                continue
            if link.parent < 0 or link.joint is None:
                branches.append([])
            if link.joint is None:
                joints, driven_dof = self._add_free(number, self._bodies[link.body])
            else:
                joints, driven_dof = [self._add_joint(number, link)], self._take_dofs(1)
                self.dofs.of_joint[link.joint] = driven_dof
            branches[-1] += joints
            if number in self._motors:
                self.dofs.of_drive[self._motors[number]] = driven_dof
        for joints in branches:
            self.builder.add_articulation(joints)

    def _take_dofs(self, count: int) -> int:
        """Return the last of the next degrees of freedom, which belong to the joints that were just added."""
        self._next_dof += count
        return self._next_dof - 1

    def _add_free(self, number: int, child: int) -> tuple[list[int], int]:
        """Add the joints of a body that no joint of the scene ties to others.

        Returns
        -------
        joints : list of int
            Their numbers.
        turning : int
            The degree of freedom about z.
        """
        builder = self.builder
        x, y, angle = map(self._jitter, self._start[number - 2 : number + 1])
        turned = placed((0.0, 0.0), -angle)
        turning_axis = self._axis(None, number, (0, 0, 1))
        if self._kind.has_planar_joint:
            joint = builder.add_joint_d6(
                -1,
                child,
                parent_xform=placed((x, y), 0.0),
                child_xform=turned,
                linear_axes=[self._axis(None, -1, (1, 0, 0)), self._axis(None, -1, (0, 1, 0))],
                angular_axes=[turning_axis],
            )
            return [joint], self._take_dofs(3)
        if self._fidelity == Fidelity.JOINT:
            return [builder.add_joint_free(child, parent=-1)], self._take_dofs(6)
        body = self._scene.bodies[str(self._tree.links[number].body)]
        joints, carriages = _add_carriages(builder, body, (x, y))
        self.dofs.carriages[child] = carriages
        last = builder.add_joint_revolute(
            carriages[1], child, axis=turning_axis, child_xform=turned
        )
        return [*joints, last], self._take_dofs(3)

    def _add_joint(self, number: int, link: Link) -> int:
        """Add the joint of a link, and return its number.

        Newton's coordinate is zero at the start. Some solvers take the place where a loop closes from the configuration
        in which all coordinates are zero.
        """
        jitter, start = self._jitter, float(self._start[number])
        parent, child = (
            self._bodies[_body_of(self._tree, link.parent)],
            self._bodies[str(link.body)],
        )
        direction = (*link.axis, 0.0) if link.slides else (0.0, 0.0, 1.0)
        config = self._axis(self._scene.joints[str(link.joint)], number, direction)
        anchor, angle, turn = np.array(link.anchor), link.angle, 0.0
        add = self.builder.add_joint_revolute
        if link.slides:
            # The axis is given in the frame of the joint, which is turned by the angle of the link.
            c, s = math.cos(angle), math.sin(angle)
            ux, uy = link.axis
            anchor = anchor + start * np.array([c * ux - s * uy, s * ux + c * uy])
            add = self.builder.add_joint_prismatic
        else:
            turn = -jitter(start)
        return int(
            add(
                parent,
                child,
                axis=config,
                parent_xform=placed([*map(jitter, anchor)], angle),
                child_xform=placed([*map(jitter, link.point)], turn),
            )
        )

    def _close_loop(self, name: str) -> None:
        """Add a joint that closes a loop, outside of any articulation; its child is the first body of the joint."""
        joint, jitter = self._scene.joints[name], self._jitter
        if isinstance(joint, Translational):
            (first, second), turn = (joint.slider, joint.guide), joint.angle
            own, other = joint.slider_point, joint.point
        else:
            (first, second), turn = joint.bodies, 0.0
            own, other = joint.points
        sign = 1.0
        # The child of a joint is a body; only the parent may be the ground.
        if first == GROUND:
            first, second, own, other, turn, sign = second, first, other, own, -turn, -1.0
        add = self.builder.add_joint_revolute
        direction = (0.0, 0.0, sign)
        if isinstance(joint, Translational):
            # The direction is given in the axes of the guide, and the axis in those of the slider.
            ux, uy = direction_of(joint)
            c, s = math.cos(turn), math.sin(turn)
            direction = (c * ux + s * uy, c * uy - s * ux, 0.0)
            add = self.builder.add_joint_prismatic
        else:
            # so that the coordinate is zero at the start, as in `_add_joint`
            turn = self._angle_of(first) - self._angle_of(second)
        add(
            self._bodies[second],
            self._bodies[first],
            axis=self._axis(joint, -1, direction),
            parent_xform=placed([*map(jitter, other)], turn),
            child_xform=placed([*map(jitter, own)], 0.0),
        )

    def _angle_of(self, body: str) -> float:
        """Return the angle of a body at the start, rad; 0 for the ground."""
        return 0.0 if body == GROUND else self._scene.bodies[body].angle

    def _axis(self, joint: Joint | None, link: int, direction: Sequence[float]) -> Any:
        """Return the configuration of one degree of freedom, with its friction and its drive."""
        import newton

        config = newton.ModelBuilder.JointDofConfig(axis=tuple(map(float, direction)))
        config.friction = 0.0
        if joint is not None and joint.frictional and self._fidelity == Fidelity.JOINT:
            is_constant = isinstance(joint, Revolute) or joint.static_coefficient == 0.0
            config.friction = self._jitter(joint.bounds[0]) if is_constant else PLACEHOLDER
        if link in self._motors:
            if self._kind.has_armature:
                config.armature = self._rotor
            else:
                config.target_ke = self._options["drive_stiffness"]
                config.target_kd = self._options["drive_damping"]
        return config


def _add_carriages(
    builder: Any, body: Body, place: tuple[float, float]
) -> tuple[list[int], tuple[int, int]]:
    """Add two light bodies, which slide along x on the ground and along y on each other.

    A third body that turns on the second one moves in the plane.

    Returns
    -------
    joints : list of int
        The numbers of their joints.
    carriages : (int, int)
        The numbers of the two bodies.
    """
    import newton

    joints, carriages = [], []
    parent = -1
    for direction in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        carriage = builder.add_link(
            xform=placed(place, 0.0),
            mass=CARRIAGE * body.mass,
            inertia=np.eye(3) * CARRIAGE * body.inertia,
            lock_inertia=True,
        )
        # The first joint begins at the place of the body, the second one at the first carriage.
        anchor = placed(place if parent < 0 else (0.0, 0.0), 0.0)
        config = newton.ModelBuilder.JointDofConfig(axis=direction)
        joints.append(
            builder.add_joint_prismatic(parent, carriage, axis=config, parent_xform=anchor)
        )
        carriages.append(carriage)
        parent = carriage
    return joints, (carriages[0], carriages[1])


def inertia_scale(scene: Scene) -> float:
    """Return the largest inertia that a drive of a scene may move, kg m^2; of a slider in kg."""
    extent = _extent(scene)
    inertia = sum(body.inertia + body.mass * extent**2 for body in scene.bodies.values())
    return max(inertia, sum(body.mass for body in scene.bodies.values()))


def _extent(scene: Scene) -> float:
    """Return the largest distance of a joint's point from the centre of mass of its body, m."""
    distances = [0.0]
    for joint in scene.joints.values():
        points = joint.points if isinstance(joint, Revolute) else (joint.slider_point,)
        bodies = joint.bodies if isinstance(joint, Revolute) else (joint.slider,)
        for body, point in zip(bodies, points):
            if body != GROUND:
                distances.append(math.hypot(*point))
    return max(distances)


def _body_of(tree: LinkTree, link: int) -> str:
    """Return the name of the body of a link; the ground for -1."""
    if link < 0:
        return GROUND
    body = tree.links[link].body
    assert body is not None, "a link without a body has no children but those of its own joint"
    return body


def placed(point: Sequence[float], angle: float) -> Any:
    """Return Newton's transform of a place and an angle in the plane."""
    import warp as wp

    return wp.transform(
        wp.vec3(*point, 0.0), wp.quat(0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))
    )


def _add_shapes(
    builder: Any,
    guide: Translational,
    slider: int,
    number: int,
    options: Mapping[str, Any],
    jitter: Jitter,
) -> None:
    """Add the shapes of a slider and of the two surfaces of its guide."""
    import newton
    import warp as wp

    length, width = guide.extent
    gap = narrowing(guide, options)
    config = newton.ModelBuilder.ShapeConfig(
        density=0.0,
        mu=jitter(guide.kinetic_coefficient),
        mu_torsional=0.0,
        mu_rolling=0.0,
        restitution=0.0,
        ke=options["contact_stiffness"],
        kd=options["contact_damping"],
        kf=options["friction_gain"],
        margin=0.0,
        gap=DETECTION * width,
        collision_group=number + 1,
    )
    # Spheres at the corners, whose outermost points are those of the slider; or the box itself.
    if options["shape"] == "spheres":
        radius = RADIUS * width
        for corner in slider_box(guide, 2 * radius + gap):
            place = placed(corner, 0.0)
            builder.add_shape_sphere(slider, xform=place, radius=radius, cfg=config)
    else:
        place = placed(guide.slider_point, box_angle(guide))
        builder.add_shape_box(
            slider, xform=place, hx=length / 2, hy=(width - gap) / 2, hz=DEPTH, cfg=config
        )
    ux, uy = direction_of(guide)
    across = np.array([-uy, ux])
    for side in (1, -1):
        normal = side * across
        point = np.array(guide.point) - surface_distance(guide) * normal
        turn = wp.quat_between_vectors(wp.vec3(0.0, 0.0, 1.0), wp.vec3(*normal, 0.0))
        place = wp.transform(wp.vec3(*map(jitter, point), 0.0), turn)
        builder.add_shape_plane(xform=place, width=0.0, length=0.0, body=-1, cfg=config)
