"""A scene as URDF, the robot description that PyBullet, Drake, DART and others read."""

from __future__ import annotations

from xml.etree import ElementTree as xml

from stiction.engines.protocol import Refused
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import Scene

BASE = "base"
_NOT_HERE = """
  The tree of links at joint coordinates 0; starts are those of the joints named in the comment of each. Not in this file, as URDF has
  no words for it: drives, springs, dampers, forces, and friction whose bound is mu (|n1| + |n2|) of the guide.
"""


def urdf(scene: Scene) -> str:
    """The model as XML: a link a body (two more without mass for a body that nothing ties to the ground), a joint a link.

    Raises
    ------
    Refused
        If joints close loops, which URDF cannot say.
    """
    tree = LinkTree(scene)
    if tree.loops:
        raise Refused(f"joints.{tree.loops[0]}: closes a loop; URDF describes trees")
    root = xml.Element("robot", name=scene.name)
    root.append(xml.Comment(_NOT_HERE))
    xml.SubElement(root, "link", name=BASE)
    names = [link.body or f"{link.joint or 'free'}-{i}" for i, link in enumerate(tree.links)]
    position, velocity = tree.coordinates(scene)
    for i, (link, name) in enumerate(zip(tree.links, names)):
        element = xml.SubElement(root, "link", name=name)
        if link.body:
            data = scene.bodies[link.body]
            inertial = xml.SubElement(element, "inertial")
            xml.SubElement(inertial, "origin", xyz=_numbers(-link.point[0], -link.point[1], 0.0), rpy="0 0 0")
            xml.SubElement(inertial, "mass", value=repr(data.mass))
            inertia = {"ixx": data.inertia, "iyy": data.inertia, "izz": data.inertia, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
            xml.SubElement(inertial, "inertia", {key: repr(float(value)) for key, value in inertia.items()})
        joint = xml.SubElement(root, "joint", name=link.joint or f"{name}-joint", type="prismatic" if link.slides else "continuous")
        joint.append(xml.Comment(f" start: {float(position[i])!r}, rate {float(velocity[i])!r} "))
        xml.SubElement(joint, "parent", link=BASE if link.parent < 0 else names[link.parent])
        xml.SubElement(joint, "child", link=name)
        origin = tree.links[link.parent].point if link.parent >= 0 else (0.0, 0.0)
        xml.SubElement(joint, "origin", xyz=_numbers(link.anchor[0] - origin[0], link.anchor[1] - origin[1], 0.0), rpy=_numbers(0.0, 0.0, link.angle))
        xml.SubElement(joint, "axis", xyz=_numbers(*link.axis, 0.0) if link.slides else "0 0 1")
        if link.slides:
            xml.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
    xml.indent(root)
    return xml.tostring(root, encoding="unicode") + "\n"


def _numbers(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)
