"""Springs, dampers, forces, torques and drives in MJCF, with what a file of MJCF cannot hold.

A spring between two points is a spatial tendon of two sites, one along a guide or about hinges a fixed tendon of their
joints; one along an axis of the ground is an actuator with an affine bias. A force or a torque is an actuator whose
``ctrl`` is its law in N or N m. ``refsite`` names the frame that the actuator's direction belongs to. MuJoCo turns that
frame without the moment of its turning, so that it has to be the ground's (mj_transmission,
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
"""Inertia (kg m^2, kg) of the rotors of drives, whose motion nothing in a mechanism of human size changes. MuJoCo's
equality constraints hold a joint at a place, not at a rate."""
_WORLD = "world-axes"
"""Name of the site in the origin of the ground; all other sites have a dot in theirs."""


@dataclass
class Loads:
    """Values of the actuators at the start, what is to be set before each step, and what the file does not hold."""

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
    """Give a model, whose `elements` are its bodies by link, the springs, dampers, forces, torques and drives.

    The world's element is at -1; `joints` are the names of the links' joints.
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
        """Add one that acts on a body's point in the axes of the ground."""
        add(
            actuators,
            kind,
            name=name,
            site=add_site(elements, tree, f"{name}.1", body, point),
            refsite=_WORLD,
            gear=numbers(*direction, 0.0, 0.0, 0.0, torque),
            **more,
        )

    for name, spring in scene.springs.items():
        constants = {"stiffness": repr(spring.stiffness), "damping": repr(spring.damping)}
        if isinstance(spring, LinearSpring) and spring.axis is None:
            tendon = add(
                tendons, "spatial", name=name, springlength=repr(spring.rest_length), **constants
            )
            for number, (body, point) in enumerate(zip(spring.bodies, spring.points), start=1):
                xml.SubElement(
                    tendon, "site", site=add_site(elements, tree, f"{name}.{number}", body, point)
                )
        elif (found := _coordinate(scene, tree, spring)) is not None:
            terms, rest = found
            turned = (
                -1.0 if rest < 0 else 1.0
            )  # a length of -1 is MuJoCo's word for that at joint coordinates 0
            tendon = add(tendons, "fixed", name=name, springlength=repr(turned * rest), **constants)
            for link, sign in terms:
                xml.SubElement(tendon, "joint", joint=joints[link], coef=repr(turned * sign))
        elif (
            isinstance(spring, LinearSpring)
            and spring.axis is not None
            and spring.bodies[1] == GROUND
        ):
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
    """Links and signs whose joint coordinates add up to the spring's, and their sum at rest; None if there are none."""
    if isinstance(spring, TorsionalSpring):
        terms = tree.hinge_between(*spring.bodies)
        return terms, spring.rest_angle - sum(sign * tree.links[link].angle for link, sign in terms)
    if (
        spring.axis is None
        or (found := link_along(scene, tree, spring.bodies, spring.axis)) is None
    ):
        return None
    link, sign = found
    if (name := tree.links[link].joint) is None:
        return None
    guide, (p, q), length = scene.guides[name], spring.points, hypot(*spring.axis)
    c, s = cos(guide.angle), sin(guide.angle)
    x, y = p[0] - guide.slider_point[0], p[1] - guide.slider_point[1]
    across = (c * x - s * y + guide.point[0] - q[0], s * x + c * y + guide.point[1] - q[1])
    return [(link, sign)], spring.rest_length - (
        spring.axis[0] * across[0] + spring.axis[1] * across[1]
    ) / length


def _words(law: Law) -> str:
    return law_expression(law) or "the table of the scene"
