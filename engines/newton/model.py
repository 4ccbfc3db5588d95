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
    shapes : dict of str to list of int
        By guide, at contact fidelity: its shapes, those of the slider and those of the surfaces.
    carriages : dict of int to (int, int)
        By body that two light bodies hold in the plane: those that slide along x, and along x and y.
    """

    of_joint: dict[str, int] = field(default_factory=dict)
    of_drive: dict[str, int] = field(default_factory=dict)
    shapes: dict[str, list[int]] = field(default_factory=dict)
    carriages: dict[int, tuple[int, int]] = field(default_factory=dict)


def build(
    scene: Scene,
    tree: LinkTree,
    fidelity: Fidelity,
    *,
    is_planar_joint: bool,
    has_rotors: bool,
    options: Mapping[str, Any],
    jitter: Jitter,
) -> tuple[Any, Dofs]:
    """Return the builder of a scene's model, which is not finalized yet, and the places of its elements.

    Parameters
    ----------
    tree : LinkTree
        The tree of the scene at this fidelity.
    is_planar_joint : bool
        Whether a body that hangs on no joint is held in the plane by a joint with three degrees of freedom. Otherwise
        it hangs on two light bodies at contact fidelity (`CARRIAGE`), and is free in space at joint fidelity.
    has_rotors : bool
        Whether the joint of a drive has a rotor (`ROTOR`), on which the adapter applies a force. Otherwise the drive is
        a spring that pulls the joint to its target.
    options
        Settings of the run.
    jitter : Jitter
        Changes the inputs by units in the last place.
    """
    import newton
    import warp as wp

    gravity = scene.gravity or (0.0, 0.0)
    builder = newton.ModelBuilder(
        up_axis=newton.Axis.Y, gravity=(*(jitter(value) for value in gravity), 0.0)
    )
    dofs = Dofs()
    start, _ = tree.coordinates(scene)
    bodies = {GROUND: -1}
    for name, body in scene.bodies.items():
        bodies[name] = builder.add_link(
            xform=placed((*map(jitter, body.position),), jitter(body.angle)),
            mass=jitter(body.mass),
            inertia=np.eye(3) * jitter(body.inertia),
            lock_inertia=True,
            label=name,
        )
    motors = {motor_link(scene, tree, drive)[0]: name for name, drive in scene.drives.items()}
    rotor = ROTOR * inertia_scale(scene)

    def axis(joint: Joint | None, link: int, direction: Sequence[float]) -> Any:
        """Return the configuration of one degree of freedom, with its friction and its drive."""
        is_driven = link in motors
        bound = 0.0
        if joint is not None and joint.frictional and fidelity == Fidelity.JOINT:
            is_constant = isinstance(joint, Revolute) or joint.static_coefficient == 0.0
            bound = jitter(joint.bounds[0]) if is_constant else PLACEHOLDER
        return newton.ModelBuilder.JointDofConfig(
            axis=wp.vec3(*direction),
            friction=bound,
            armature=rotor if is_driven and has_rotors else 0.0,
            target_ke=options["drive_stiffness"] if is_driven and not has_rotors else 0.0,
            target_kd=options["drive_damping"] if is_driven and not has_rotors else 0.0,
        )

    roots: list[list[int]] = []
    dof = 0
    for i, link in enumerate(tree.links):
        if link.body is None:
            continue  # part of the joint of a free body, which has its three degrees of freedom
        if link.parent < 0 or link.joint is None:
            roots.append([])
        child = bodies[link.body]
        if link.joint is None:
            x, y, angle = map(jitter, start[i - 2 : i + 1])
            if is_planar_joint:
                joint = builder.add_joint_d6(
                    -1,
                    child,
                    parent_xform=placed((x, y), 0.0),
                    child_xform=placed((0.0, 0.0), -angle),
                    linear_axes=[axis(None, -1, (1, 0, 0)), axis(None, -1, (0, 1, 0))],
                    angular_axes=[axis(None, i, (0, 0, 1))],
                )
                count = 3
            elif fidelity == Fidelity.CONTACT:
                roots[-1] += _add_carriages(builder, scene.bodies[link.body], (x, y))
                dofs.carriages[child] = (builder.body_count - 2, builder.body_count - 1)
                joint = builder.add_joint_revolute(
                    builder.body_count - 1,
                    child,
                    axis=axis(None, i, (0, 0, 1)),
                    child_xform=placed((0.0, 0.0), -angle),
                )
                count = 3
            else:
                joint = builder.add_joint_free(child, parent=-1)
                count = 6
            turning = dof + count - 1
        else:
            parent = bodies[_body_of(tree, link.parent)]
            config = axis(
                scene.joints[link.joint], i, (*link.axis, 0.0) if link.slides else (0, 0, 1)
            )
            joint = _add_joint(builder, link, parent, child, config, start[i], jitter)
            dofs.of_joint[link.joint] = dof
            count, turning = 1, dof
        if i in motors:
            dofs.of_drive[motors[i]] = turning
        roots[-1].append(joint)
        dof += count
    for joints in roots:
        builder.add_articulation(joints)
    for name in tree.loops:
        _close_loop(builder, scene, name, bodies, axis, jitter)
        dofs.of_joint[name] = dof
        dof += 1
    if fidelity == Fidelity.CONTACT:
        for number, (name, guide) in enumerate(scene.guides.items()):
            dofs.shapes[name] = _add_shapes(
                builder, guide, bodies[guide.slider], number, options, jitter
            )
    return builder, dofs


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


def _add_carriages(builder: Any, body: Body, place: tuple[float, float]) -> list[int]:
    """Add two light bodies, which slide along x on the ground and along y on each other; return their joints.

    A third body that turns on the last one moves in the plane.
    """
    import newton

    joints = []
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
        parent = carriage
    return joints


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


def _add_joint(
    builder: Any, link: Link, parent: int, child: int, config: Any, start: float, jitter: Jitter
) -> int:
    """Add the joint of a link, and return its number; `start` is the coordinate of the link at the start.

    Newton's coordinate is zero at the start. Some solvers take the place where a loop closes from the configuration in
    which all coordinates are zero.
    """
    anchor, angle = np.array(link.anchor), link.angle
    if link.slides:
        # The axis is given in the frame of the joint, which is turned by the angle of the link.
        c, s = math.cos(angle), math.sin(angle)
        ux, uy = link.axis
        anchor = anchor + start * np.array([c * ux - s * uy, s * ux + c * uy])
        places = placed([*map(jitter, anchor)], angle), placed([*map(jitter, link.point)], 0.0)
        add = builder.add_joint_prismatic
    else:
        places = (
            placed([*map(jitter, anchor)], angle),
            placed([*map(jitter, link.point)], -jitter(start)),
        )
        add = builder.add_joint_revolute
    return int(add(parent, child, axis=config, parent_xform=places[0], child_xform=places[1]))


def _close_loop(
    builder: Any,
    scene: Scene,
    name: str,
    bodies: Mapping[str, int],
    axis: Any,
    jitter: Jitter,
) -> None:
    """Add a joint that closes a loop, outside of any articulation; its child is the first body of the joint."""
    joint = scene.joints[name]
    first, second = joint.bodies
    if isinstance(joint, Translational):
        points: Sequence[Sequence[float]] = (joint.slider_point, joint.point)
        turn, ends = joint.angle, (joint.slider, joint.guide)
        first, second = ends
    else:
        points, turn = joint.points, 0.0
    own, other = points
    sign = 1
    # The child of a joint is a body; only the parent may be the ground.
    if first == GROUND:
        first, second, own, other, turn, sign = second, first, other, own, -turn, -1
    if isinstance(joint, Revolute):
        angles = [0.0 if body == GROUND else scene.bodies[body].angle for body in (first, second)]
        turn = (
            angles[0] - angles[1]
        )  # so that the coordinate is zero at the start, as in `_add_joint`
    places = {
        "parent_xform": placed([*map(jitter, other)], turn),
        "child_xform": placed([*map(jitter, own)], 0.0),
    }
    if isinstance(joint, Translational):
        # The direction is given in the axes of the guide, and the axis in those of the slider.
        ux, uy = direction_of(joint)
        c, s = math.cos(turn), math.sin(turn)
        config = axis(joint, -1, (c * ux + s * uy, c * uy - s * ux, 0.0))
        builder.add_joint_prismatic(bodies[second], bodies[first], axis=config, **places)
    else:
        config = axis(joint, -1, (0, 0, sign))
        builder.add_joint_revolute(bodies[second], bodies[first], axis=config, **places)


def _add_shapes(
    builder: Any,
    guide: Translational,
    slider: int,
    number: int,
    options: Mapping[str, Any],
    jitter: Jitter,
) -> list[int]:
    """Add the shapes of a slider and of the two surfaces of its guide; return their numbers."""
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
    shapes = []
    # Corners of spheres, whose outermost points are those of the slider; or the box itself.
    if options["shape"] == "spheres":
        radius = RADIUS * width
        for corner in slider_box(guide, 2 * radius + gap):
            place = placed(corner, 0.0)
            shapes.append(builder.add_shape_sphere(slider, xform=place, radius=radius, cfg=config))
    else:
        place = placed(guide.slider_point, box_angle(guide))
        shapes.append(
            builder.add_shape_box(
                slider, xform=place, hx=length / 2, hy=(width - gap) / 2, hz=DEPTH, cfg=config
            )
        )
    ux, uy = direction_of(guide)
    across = np.array([-uy, ux])
    for side in (1, -1):
        normal = side * across
        point = np.array(guide.point) - surface_distance(guide) * normal
        turn = wp.quat_between_vectors(wp.vec3(0.0, 0.0, 1.0), wp.vec3(*normal, 0.0))
        place = wp.transform(wp.vec3(*map(jitter, point), 0.0), turn)
        shapes.append(
            builder.add_shape_plane(xform=place, width=0.0, length=0.0, body=-1, cfg=config)
        )
    return shapes
