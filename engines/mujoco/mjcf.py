"""A scene as MJCF, the model language of MuJoCo: the file that its users would write by hand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree as xml

from stiction.engines.mujoco.contact import SOLIMP_SHAPE, add, add_guides, numbers
from stiction.engines.mujoco.loads import ROTOR, Loads, add_loads, add_site
from stiction.engines.shared.joint_coordinates import motor_link
from stiction.engines.shared.link_tree import Link, LinkTree
from stiction.scenes import Scene
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.laws import evaluate_law
from stiction.scenes.model import Translational

HARDEST = 0.9999
"""Impedance of constraints that are to be hard: MuJoCo's own limit."""
_NOSLIP = 5
"""Number of sweeps over the frictions alone. One is enough where no friction depends on another."""
START = "start"
"""Name of the keyframe with the scene's start."""
_HEADER = """
  {title}
  Begins at the keyframe "{start}" (mj_resetDataKeyframe), with steps of {timestep:g} s. Springs, dampers, loads and
  drives of the scene are in this file: drives as rotors of {rotor:g} kg m^2 that keep the rate of the keyframe, the
  others as tendons and actuators.
  To be set before each step, as MJCF has no functions of time and no friction bound that depends on a reaction (t in s,
  N, N m):{to_set}
  Not in this file, as MJCF cannot express it; the force on its bodies goes into xfrc_applied:{missing}
"""
_BOUND = (
    'frictionloss of joint "{name}" (N, here {placeholder:g}): mu (|n1| + |n2|) of its two corners with mu = '
    "{guide.mu!r}, and {guide.static_coefficient!r} while it sticks"
)
_CONSTANT_PART = ", and to that its constant part: {bounds[0]!r}, and {bounds[1]!r} while it sticks"
_STATIC_BOUND = 'frictionloss of joint "{name}", here that of slip, {bounds[0]!r}: {bounds[1]!r} while it sticks'
_COEFFICIENTS = (
    'friction of the pairs "{name}.*": {guide.mu!r} while the slider slides, {guide.static_coefficient!r} '
    "while stick is undecided"
)
_DAMPING = "; solreffriction: less damping while it slides, see the adapter"
_PLACEHOLDER = 1.0
"""Friction of a joint (N, N m) until its bound is set: with zero MuJoCo leaves the row out."""


def mjcf(
    scene: Scene,
    tree: LinkTree,
    timestep: float,
    fidelity: Fidelity,
    options: Mapping[str, Any],
    *,
    loaded: bool = False,
) -> str:
    """Write a scene that is not refused as XML.

    Parameters
    ----------
    tree : LinkTree
        Its links become bodies and joints; joints that close loops become constraints.
    timestep : float
        Seconds. Friction brings a slider to rest within one (``solreffriction``), loops close within one.
    options : Mapping
        All settings of the adapter at this fidelity.
    loaded : bool
        True to include springs, dampers, loads and drives in the model, with a header that lists what is missing. If
        False, the caller applies them.
    """
    contact = fidelity == Fidelity.CONTACT
    if contact:
        impedance, integrator = HARDEST, "Euler"
        noslip = options["noslip_iterations"]
    else:
        impedance, integrator = options["impedance"], options["integrator"]
        noslip = _NOSLIP if options["noslip"] == "on" else 0
    driven = {
        link: sign * evaluate_law(drive.law, 0.0)[1]
        for drive in scene.drives.values()
        for link, sign in [motor_link(scene, tree, drive)]
    }
    root = xml.Element("mujoco", model=scene.name)
    xml.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    option = xml.SubElement(
        root,
        "option",
        timestep=repr(timestep),
        gravity=numbers(*(scene.gravity or (0.0, 0.0)), 0.0),
        integrator=integrator,
        solver=options["solver"],
        iterations=str(options["iterations"]),
        tolerance="0",
        noslip_tolerance="0",
        noslip_iterations=str(noslip),
    )
    # Without autoreset, a state that is not finite is reported instead of replaced by the start.
    # Without eulerdamp, dampers act at the start of a step, as all loads do.
    flag = xml.SubElement(option, "flag", autoreset="disable", eulerdamp="disable")
    if contact:
        # The softness of contacts is scaled by the mobility of their bodies. MuJoCo's approximation
        # takes a slider on a driven bar for lighter than it is for its contacts.
        flag.set("diagexact", "enable")
        option.set("cone", options["cone"])
        option.set("impratio", repr(options["impratio"]))
    else:
        flag.set("contact", "disable")
    # Friction and loops: errors of place and of rate are to vanish within a step (direct format).
    stiffness, damping = -1.0 / timestep**2, -1.0 / timestep
    soft = {
        "solref": numbers(stiffness, damping),
        "solimp": numbers(impedance, impedance, *SOLIMP_SHAPE),
    }
    reference = {"solreffriction": soft["solref"], "solimpfriction": soft["solimp"]}
    if not contact and options["loss_reference"] == "default":
        reference = {}
    elements: dict[int, xml.Element] = {-1: xml.SubElement(root, "worldbody")}
    for i, link in enumerate(tree.links):
        if link.body is None:
            # Part of a free body's joint: in MuJoCo all joints of a body are in its element.
            continue
        free = link.joint is None
        parent = -1 if free else link.parent
        body = elements[i] = xml.SubElement(
            elements[parent],
            "body",
            name=link.body,
            pos=numbers(*tree.place(i)),
            euler=numbers(0.0, 0.0, link.angle),
        )
        for j in (i - 2, i - 1, i) if free else (i,):
            name = joint_name(tree, j)
            attributes = _friction(scene, name, reference)
            if loaded and name in scene.joints and scene.joints[name].damping:
                attributes["damping"] = repr(scene.joints[name].damping)
            _joint(body, tree.links[j], name, j in driven, attributes)
        data = scene.bodies[link.body]
        xml.SubElement(
            body,
            "inertial",
            pos=numbers(-link.point[0], -link.point[1], 0.0),
            mass=repr(data.mass),
            diaginertia=numbers(*[data.inertia] * 3),
        )
    if tree.loops:
        equality = xml.SubElement(root, "equality")
        for name in tree.loops:
            pin = scene.pins[name]
            for side, (held, point) in enumerate(zip(pin.bodies, pin.points), start=1):
                add_site(elements, tree, f"{name}.{side}", held, point)
            add(equality, "connect", name=name, site1=f"{name}.1", site2=f"{name}.2", **soft)
    if contact:
        add_guides(root, elements, scene, tree, options, timestep)
    position, velocity = tree.coordinates(scene)
    for i, rate in driven.items():
        velocity[i] = rate
    joints = [joint_name(tree, i) for i in range(len(tree.links))]
    loads = add_loads(root, elements, scene, tree, joints) if loaded else Loads()
    keyframe = xml.SubElement(root, "keyframe")
    xml.SubElement(
        keyframe,
        "key",
        name=START,
        qpos=numbers(*position),
        qvel=numbers(*velocity),
        ctrl=numbers(*loads.ctrl),
    )
    if loaded:
        if contact:
            line = _COEFFICIENTS + _DAMPING * (not options["time_constant"])
            friction = [
                line.format(name=name, guide=guide)
                for name, guide in scene.frictional_guides.items()
            ]
        else:
            friction = _varying_bounds(scene)
        root.insert(0, xml.Comment(_header(scene, timestep, loads, friction)))
    xml.indent(root)
    return xml.tostring(root, encoding="unicode") + "\n"


def _varying_bounds(scene: Scene) -> list[str]:
    """Return a line for each joint whose friction has a bound that is to be set before each step."""
    lines = []
    for name, joint in scene.frictional_joints.items():
        kinetic, static = joint.bounds
        if isinstance(joint, Translational) and joint.mu is not None:
            line = _BOUND.format(name=name, guide=joint, placeholder=_PLACEHOLDER)
            if static > 0.0:
                line += _CONSTANT_PART.format(bounds=joint.bounds)
            lines.append(line)
        elif static > kinetic:
            lines.append(_STATIC_BOUND.format(name=name, bounds=joint.bounds))
    return lines


def _header(scene: Scene, timestep: float, loads: Loads, friction: list[str]) -> str:
    """Return the comment of a file; `friction` are lines of what is to be set for frictional joints."""
    to_set, missing = (
        "".join(f"\n  - {line};" for line in lines) or " nothing."
        for lines in (loads.to_set + friction, loads.missing)
    )
    header = _HEADER.format(
        title=scene.title,
        start=START,
        timestep=timestep,
        rotor=ROTOR,
        to_set=to_set,
        missing=missing,
    )
    return header.replace("--", "- -")  # two hyphens are not allowed in a comment of XML


def joint_name(tree: LinkTree, i: int) -> str:
    """Return the name of a link's joint: the scene's, or the coordinate of a free body that it moves."""
    link = tree.links[i]
    if link.joint is not None:
        return link.joint
    # the two links that slide along x and y precede the link of their body
    body = next(other.body for other in tree.links[i:] if other.body)
    if link.body:
        return f"{body}.angle"
    return f"{body}.{'x' if link.axis[0] else 'y'}"


def _friction(scene: Scene, name: str, reference: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes of a joint's friction; none if the scene has no frictional joint of that name."""
    if name not in scene.frictional_joints:
        return {}
    joint = scene.frictional_joints[name]
    is_constant = not isinstance(joint, Translational) or joint.mu is None
    loss = joint.bounds[0] if is_constant else 0.0
    return {"frictionloss": repr(loss or _PLACEHOLDER), **reference}


def _joint(
    body: xml.Element, link: Link, name: str, driven: bool, attributes: Mapping[str, str]
) -> None:
    """Add the joint of a link to an element, with further attributes."""
    kind = (
        {"type": "slide", "axis": numbers(*link.axis, 0.0)}
        if link.slides
        else {"type": "hinge", "axis": "0 0 1"}
    )
    rotor = {"armature": repr(ROTOR)} if driven else {}
    add(body, "joint", name=name, **kind, **rotor, **attributes)
