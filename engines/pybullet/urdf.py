"""A scene as URDF, the robot description that PyBullet, Drake, DART and others read."""

from __future__ import annotations

from xml.etree import ElementTree as xml

from stiction.engines.protocol import Refused
from stiction.engines.shared.law_expression import law_expression
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import Scene
from stiction.scenes.model import Joint

BASE = "base"
_HEADER = """
  {title}
  The tree of links at joint coordinates 0; the start of each joint is in its comment. PyBullet reads it with
  useFixedBase=True and flags=URDF_USE_INERTIA_FROM_FILE, and adds damping and a motor to each joint, which
  changeDynamics and setJointMotorControl2 remove. Links without a body have no mass.
  Not in this file, as a joint of URDF has no more than viscous damping and a constant friction:{missing}
"""
_UNLIMITED = "1e9"
"""Limits of sliding joints (m, N, m/s), which URDF requires: beyond those of any mechanism."""


def urdf(scene: Scene) -> str:
    """Write the model as XML: a link a body, two more without mass for a free body, a joint a link.

    Raises
    ------
    Refused
        If joints close loops, which URDF cannot express.
    """
    tree = LinkTree(scene)
    if tree.loops:
        raise Refused(f"joints.{tree.loops[0]}: closes a loop; URDF describes trees")
    root = xml.Element("robot", name=scene.name)
    root.append(
        xml.Comment(_HEADER.format(title=scene.title, missing=_missing(scene)).replace("--", "- -"))
    )
    # The base is the ground. URDF requires it to be a link, and the parent of all others.
    _inertial(xml.SubElement(root, "link", name=BASE), (0.0, 0.0), 0.0, 0.0)
    names = [link.body or f"{link.joint or 'free'}-{i}" for i, link in enumerate(tree.links)]
    position, velocity = tree.coordinates(scene)
    for i, (link, name) in enumerate(zip(tree.links, names)):
        element = xml.SubElement(root, "link", name=name)
        data = None if link.body is None else scene.bodies[link.body]
        _inertial(element, link.point, *((data.mass, data.inertia) if data else (0.0, 0.0)))
        joint = xml.SubElement(
            root,
            "joint",
            name=link.joint or f"{name}-joint",
            type="prismatic" if link.slides else "continuous",
        )
        joint.append(xml.Comment(f" start: {float(position[i])!r}, rate {float(velocity[i])!r} "))
        xml.SubElement(joint, "parent", link=BASE if link.parent < 0 else names[link.parent])
        xml.SubElement(joint, "child", link=name)
        xml.SubElement(
            joint, "origin", xyz=_numbers(*tree.place(i)), rpy=_numbers(0.0, 0.0, link.angle)
        )
        xml.SubElement(joint, "axis", xyz=_numbers(*link.axis, 0.0) if link.slides else "0 0 1")
        if link.joint is not None:
            _dynamics(joint, scene.joints[link.joint])
        if link.slides:
            xml.SubElement(
                joint,
                "limit",
                lower=f"-{_UNLIMITED}",
                upper=_UNLIMITED,
                effort=_UNLIMITED,
                velocity=_UNLIMITED,
            )
    xml.indent(root)
    return xml.tostring(root, encoding="unicode") + "\n"


def _inertial(link: xml.Element, point: tuple[float, float], mass: float, inertia: float) -> None:
    """Give a link its mass at minus this point, as its origin is in the joint."""
    inertial = xml.SubElement(link, "inertial")
    xml.SubElement(inertial, "origin", xyz=_numbers(-point[0], -point[1], 0.0), rpy="0 0 0")
    xml.SubElement(inertial, "mass", value=repr(float(mass)))
    moments = {"ixx": inertia, "iyy": inertia, "izz": inertia, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
    xml.SubElement(inertial, "inertia", {key: repr(float(value)) for key, value in moments.items()})


def _dynamics(element: xml.Element, joint: Joint) -> None:
    """Give a joint its damping and the constant bound of its friction in slip, if it has any."""
    if joint.damping or joint.friction:
        xml.SubElement(
            element,
            "dynamics",
            damping=repr(float(joint.damping)),
            friction=repr(float(joint.friction or 0.0)),
        )


def _missing(scene: Scene) -> str:
    """Return a line for each effect of the scene that is not in the file."""
    effects = [
        (f'{kind} "{name}"', law_expression(element.law) or "the table of the scene")
        for kind, elements in (("drive", scene.drives), ("load", scene.forces))
        for name, element in elements.items()
    ]
    effects += [
        (
            f'spring "{name}"',
            f"with its damper, to {spring.acts} only" if spring.acts else "with its damper",
        )
        for name, spring in scene.springs.items()
    ]
    effects += [
        (f'limit of drive "{name}"', f"{drive.effort_limit!r}")
        for name, drive in scene.limited_drives.items()
    ]
    effects += [
        (
            f'friction of guide "{name}"',
            f"bound mu (|n1| + |n2|), mu = {guide.mu!r}, and "
            f"{guide.static_coefficient!r} while it sticks",
        )
        for name, guide in scene.guides.items()
        if guide.mu is not None
    ]
    effects += [
        (f'static friction of "{name}"', f"the bound is {joint.bounds[1]!r} while it sticks")
        for name, joint in scene.joints.items()
        if joint.bounds[1] > joint.bounds[0]
    ]
    effects += [
        (f'clearance of guide "{name}"', f"{guide.clearance!r} m to each surface")
        for name, guide in scene.guides.items()
        if guide.clearance is not None
    ]
    return "".join(f"\n  - {effect}: {what};" for effect, what in effects) or " nothing."


def _numbers(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)
