"""A scene as MJCF, the model language of MuJoCo: the file that its users would write by hand."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as xml

from stiction.engines.mujoco.contact import HARDER, Softness, add_guides, numbers
from stiction.engines.shared.link_tree import Link, LinkTree
from stiction.scenes import Scene

ROTOR = 1e10
"""Inertia (kg m^2, kg) of the rotors of drives: nothing in a mechanism of human size changes their motion, which MuJoCo has no constraint for."""
NOSLIP = 5
"""Sweeps over the frictions alone; they settle in one where none feeds on another."""
START = "start"
"""Name of the keyframe with the scene's start."""
_NOT_HERE = """
  Not in this file, as MJCF has no words for it; whoever steps the model does it:
  - friction of the guides: {friction};
  - springs, dampers, forces and torques: to be applied to the bodies (xfrc_applied);
  - drives: rotors of {rotor:g} kg m^2 that turn as the keyframe says; one whose law is not linear needs rotor inertia
    times acceleration in qfrc_applied.
"""
_FRICTION = {False: "frictionloss is a bound in newtons, to be set to mu (|n1| + |n2|) before each step",
             True: "its pairs have the kinetic coefficient, the static one is to be set while stick is undecided; their solreffriction is one step's, "
                   "to be made less while they slide"}


def mjcf(scene: Scene, tree: LinkTree, driven: Mapping[int, float], *, timestep: float, iterations: int, impedance: float, solver: str, integrator: str,
         noslip: bool, softness: Softness | None = None) -> str:
    """The model as XML.

    Parameters
    ----------
    tree : LinkTree
        Of the scene. Its links become bodies and joints; joints that close loops become constraints.
    driven : Mapping of int to float
        By the link that a drive moves, the rate of the link's coordinate at the start (m/s, rad/s).
    timestep : float
        Seconds. Friction brings a slider to rest within one (``solreffriction``), loops close within one.
    iterations : int
        Of the solver.
    impedance : float
        MuJoCo's constraints are soft: this share of the force that would hold is applied (``solimp``); less than 1.
    solver, integrator : str
        By MuJoCo's names.
    noslip : bool
        Whether frictions are solved for once more, as if they were hard (``noslip_iterations``).
    softness : Softness, optional
        Of the contacts of sliders, whose guides are no joints of the tree then.
    """
    root = xml.Element("mujoco", model=scene.name)
    root.append(xml.Comment(_NOT_HERE.format(rotor=ROTOR, friction=_FRICTION[softness is not None])))
    xml.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    option = xml.SubElement(root, "option", timestep=repr(timestep), gravity=numbers(*(scene.gravity or (0.0, 0.0)), 0.0),
                            integrator=integrator, solver=solver, iterations=str(iterations), tolerance="0", noslip_tolerance="0",
                            noslip_iterations=str(NOSLIP * noslip))
    flag = xml.SubElement(option, "flag", autoreset="disable")
    if softness is None:
        flag.set("contact", "disable")
    else:
        flag.set("diagexact", "enable")  # by bodies alone, a slider on a driven bar counts as lighter than its contacts find it
        option.set("cone", "elliptic")
        option.set("impratio", repr(HARDER))
    stiffness, damping = -1.0 / timestep ** 2, -1.0 / timestep
    soft = {"solref": numbers(stiffness, damping), "solimp": numbers(impedance, impedance, 0.001, 0.5, 2.0)}
    elements: dict[int, xml.Element] = {-1: xml.SubElement(root, "worldbody")}
    for i, link in enumerate(tree.links):
        if link.body is None:  # half of a free body's joint: MuJoCo puts all joints of a body into it
            continue
        free = link.joint is None
        parent = -1 if free else link.parent
        origin = tree.links[parent].point if parent >= 0 else (0.0, 0.0)
        place = (link.anchor[0] - origin[0], link.anchor[1] - origin[1])
        body = elements[i] = xml.SubElement(elements[parent], "body", name=link.body, pos=numbers(*place, 0.0), euler=numbers(0.0, 0.0, link.angle))
        for j in (i - 2, i - 1, i) if free else (i,):
            _joint(body, tree.links[j], joint_name(tree, j), scene, j in driven, soft)
        data = scene.bodies[link.body]
        xml.SubElement(body, "inertial", pos=numbers(-link.point[0], -link.point[1], 0.0), mass=repr(data.mass),
                       diaginertia=numbers(*[data.inertia] * 3))
    if tree.loops:
        equality = xml.SubElement(root, "equality")
        for name in tree.loops:
            joint = scene.joints[name]
            for side, (body, point) in enumerate(zip(joint.bodies, joint.points), start=1):
                link = tree.link_of[body]
                offset = tree.links[link].point if link >= 0 else (0.0, 0.0)
                xml.SubElement(elements[link], "site", name=f"{name}.{side}", pos=numbers(point[0] - offset[0], point[1] - offset[1], 0.0))
            xml.SubElement(equality, "connect", name=name, site1=f"{name}.1", site2=f"{name}.2", **soft)
    if softness is not None:
        add_guides(root, elements, scene, tree, softness, timestep)
    position, velocity = tree.coordinates(scene)
    for i, rate in driven.items():
        velocity[i] = rate
    keyframe = xml.SubElement(root, "keyframe")
    xml.SubElement(keyframe, "key", name=START, qpos=numbers(*position), qvel=numbers(*velocity))
    xml.indent(root)
    return xml.tostring(root, encoding="unicode") + "\n"


def joint_name(tree: LinkTree, i: int) -> str:
    """Name of a link's joint: the scene's, or what it moves of a free body."""
    link = tree.links[i]
    if link.joint is not None:
        return link.joint
    body = next(other.body for other in tree.links[i:] if other.body)
    return f"{body}.{'angle' if link.body else 'x' if link.axis[0] else 'y'}"


def _joint(body: xml.Element, link: Link, name: str, scene: Scene, driven: bool, soft: Mapping[str, str]) -> None:
    kind = {"type": "slide", "axis": numbers(*link.axis, 0.0)} if link.slides else {"type": "hinge", "axis": "0 0 1"}
    rotor = {"armature": repr(ROTOR)} if driven else {}
    friction = {"frictionloss": "1", "solreffriction": soft["solref"], "solimpfriction": soft["solimp"]} if name in scene.frictional_guides else {}
    xml.SubElement(body, "joint", name=name, **kind, **rotor, **friction)
