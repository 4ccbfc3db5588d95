"""Springs, dampers, forces, torques and drives in MJCF, and what MJCF cannot express of them.

A spring between two points is a spatial tendon of two sites, one along a guide or about hinges is a fixed tendon of
their joints, and one along an axis of the ground is an actuator with an affine bias. A force or a torque is an actuator
whose ``ctrl`` is its law in N or N m. ``refsite`` names the frame that the actuator's direction belongs to. When that
frame turns, MuJoCo leaves out the moment on it, so that it has to be the frame of the ground (mj_transmission,
https://mujoco.readthedocs.io/en/stable/XMLreference.html#actuator-general-refsite).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import cos, hypot, sin
from xml.etree import ElementTree as xml

from stiction.engines.mujoco.contact import add, numbers
from stiction.engines.shared.joint_coordinates import link_along, motor_link
from stiction.engines.shared.law_expression import law_expression
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Law, Linear, evaluate_law
from stiction.scenes.model import LinearSpring, Torque, TorsionalSpring

ROTOR = 1e10
"""Inertia (kg m^2, kg) of the rotors of drives, so large that nothing in a mechanism of human size changes their
motion. A constraint would not do: MuJoCo's equality constraints hold a joint at a place, not at a rate."""
_WORLD = "world-axes"
"""Name of the site in the origin of the ground. All other sites have a dot in their names."""


@dataclass
class Loads:
    """Values of the actuators at the start, what is to be set before each step, and what the file does not contain."""

    ctrl: list[float] = field(default_factory=list)
    to_set: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)


def add_site(
    elements: Mapping[int, xml.Element],
    tree: LinkTree,
    name: str,
    body: str,
    point: Iterable[float],
) -> str:
    """Give a body's element a site at a point of the body, and return its name."""
    link = tree.link_of[body]
    origin = tree.links[link].point if link >= 0 else (0.0, 0.0)
    x, y = point
    xml.SubElement(
        elements[link], "site", name=name, pos=numbers(x - origin[0], y - origin[1], 0.0)
    )
    return name


def add_loads(
    root: xml.Element,
    elements: Mapping[int, xml.Element],
    scene: Scene,
    tree: LinkTree,
    joints: list[str],
) -> Loads:
    """Add the springs, dampers, forces, torques and drives to a model, whose `elements` are its bodies by link.

    The element of the world is at -1; `joints` are the names of the links' joints.
    """
    loads = Loads()
    tendons, actuators = xml.Element("tendon"), xml.Element("actuator")
    add_site(elements, tree, _WORLD, GROUND, (0.0, 0.0))

    def add_actuator(
        kind: str,
        name: str,
        body: str,
        point: Iterable[float],
        direction: tuple[float, float],
        torque: float = 0.0,
        **more: str,
    ) -> None:
        """Add an actuator that acts on a body's point in the axes of the ground."""
        add(
            actuators,
            kind,
            name=name,
            site=add_site(elements, tree, f"{name}.1", body, point),
            refsite=_WORLD,
            gear=numbers(*direction, 0.0, 0.0, 0.0, torque),
            **more,
        )

    # Springs by what they are measured along: two points, joint coordinates, an axis of the ground.
    # MJCF has no element for an axis of a moving body that is not a guide's.
    # Dampers of joints are attributes of these, but joints that close loops are no joints of MJCF.
    dampers = {name: scene.joints[name].damper for name in tree.loops}
    springs = scene.springs | {name: damper for name, damper in dampers.items() if damper}
    for name, spring in springs.items():
        constants = {"stiffness": repr(spring.stiffness), "damping": repr(spring.damping)}
        if isinstance(spring, LinearSpring) and spring.axis is None:
            tendon = add(
                tendons, "spatial", name=name, springlength=repr(spring.rest_length), **constants
            )
            for number, (body, point) in enumerate(zip(spring.bodies, spring.points), start=1):
                xml.SubElement(
                    tendon, "site", site=add_site(elements, tree, f"{name}.{number}", body, point)
                )
        elif (joint_coordinate := _coordinate(scene, tree, spring)) is not None:
            terms, rest = joint_coordinate
            # A negative length at rest is measured in the other direction: MuJoCo reads a length of
            # -1 as the length at joint coordinates 0.
            direction = -1.0 if rest < 0 else 1.0
            tendon = add(
                tendons, "fixed", name=name, springlength=repr(direction * rest), **constants
            )
            for link, sign in terms:
                xml.SubElement(tendon, "joint", joint=joints[link], coef=repr(direction * sign))
        elif (
            isinstance(spring, LinearSpring)
            and spring.axis is not None
            and spring.bodies[1] == GROUND
        ):
            # The actuator measures from the origin of the ground, not from the spring's point of it.
            (px, py), (ax, ay), length = spring.points[1], spring.axis, hypot(*spring.axis)
            rest = spring.rest_length + (ax * px + ay * py) / length
            add_actuator(
                "general",
                name,
                spring.bodies[0],
                spring.points[0],
                (ax / length, ay / length),
                biastype="affine",
                biasprm=numbers(spring.stiffness * rest, -spring.stiffness, -spring.damping),
            )
            loads.ctrl.append(0.0)
        else:
            loads.missing.append(
                f'spring "{name}": along an axis of {spring.bodies[1]}, which moves, and of no guide'
            )
    for name, load in scene.forces.items():
        if isinstance(load, Torque):
            add_actuator("motor", name, load.body, (0.0, 0.0), (0.0, 0.0), torque=1.0)
        else:
            (x, y), length = load.direction, hypot(*load.direction)
            add_actuator("motor", name, load.body, load.point, (x / length, y / length))
        loads.ctrl.append(float(evaluate_law(load.law, 0.0)[0]))
        if not isinstance(load.law, Constant):
            loads.to_set.append(f'ctrl of actuator "{name}": {_words(load.law)}')
    # A drive of constant rate keeps it by its rotor alone. Others need a force on the rotor, which
    # whoever steps the model has to compute.
    position, _ = tree.coordinates(scene)
    for name, drive in scene.drives.items():
        if isinstance(drive.law, (Constant, Linear)):
            continue
        link, sign = motor_link(scene, tree, drive)
        xml.SubElement(actuators, "motor", name=name, joint=joints[link], gear=repr(ROTOR))
        loads.ctrl.append(0.0)
        offset = float(position[link] - sign * evaluate_law(drive.law, 0.0)[0])
        law = f"{offset!r} {'+-'[sign < 0]} {_words(drive.law)}"
        loads.to_set.append(
            f'ctrl of actuator "{name}": acceleration of joint "{joints[link]}" that ends its step at '
            f"{law}, t at the end of the step"
        )
    root.extend(part for part in (tendons, actuators) if len(part))
    return loads


def _coordinate(
    scene: Scene, tree: LinkTree, spring: LinearSpring | TorsionalSpring
) -> tuple[list[tuple[int, int]], float] | None:
    """Return links and signs whose joint coordinates add up to the spring's, and their sum at rest.

    None if there are none.
    """
    if isinstance(spring, TorsionalSpring):
        terms = tree.hinge_between(*spring.bodies)
        return terms, spring.rest_angle - sum(sign * tree.links[link].angle for link, sign in terms)
    if spring.axis is None:
        return None
    parallel = link_along(scene, tree, spring.bodies, spring.axis)
    if parallel is None:
        return None
    link, sign = parallel
    if (name := tree.links[link].joint) is None:
        return None
    # The spring's points are not those of the guide. The distance between both pairs of points is
    # constant along the axis, as the slider does not turn in its guide.
    guide, (p, q), length = scene.guides[name], spring.points, hypot(*spring.axis)
    c, s = cos(guide.angle), sin(guide.angle)
    x, y = p[0] - guide.slider_point[0], p[1] - guide.slider_point[1]
    across = (c * x - s * y + guide.point[0] - q[0], s * x + c * y + guide.point[1] - q[1])
    return [(link, sign)], spring.rest_length - (
        spring.axis[0] * across[0] + spring.axis[1] * across[1]
    ) / length


def _words(law: Law) -> str:
    """Return a law as an expression of t, or the mention of a table."""
    return law_expression(law) or "the table of the scene"
