"""Sliders as boxes between two planes, in MJCF.

Four corners, a plane for each surface, a pair of geoms for each possible contact.

A corner is a small sphere, because MuJoCo's own box has four corners on a plane where a planar mechanism needs two.
Contacts have elliptic cones and parameters of their own (``pair``): a plane touches its slider's corners alone.

MuJoCo's law of contact is convex: with x = a - aref + R f, its normal and tangential parts satisfy x_n >= mu |x_t|, so
that a contact which slides with v_t separates the bodies with the acceleration mu b_t v_t, where b_t is the damping of
its friction (``solreffriction``). This drives a slider from one of two surfaces to the other: with b_t = 1/h, which
brings it to rest in a step, with 100 m/s^2 at 0.1 m/s, mu = 1 and h = 1 ms. `slip_damping` makes b_t no larger than is
needed to oppose slip, and the contacts are soft enough to take up the rest (`slip_reference`). What a load adds to v_t
recruits normal force as mu b_t v_t does: a v_t that grows by itself needs no damping to be opposed.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot
from typing import Any
from xml.etree import ElementTree as xml

from stiction.engines.shared.contact_geometry import (
    direction_of,
    narrowing,
    slider_box,
    surface_distance,
)
from stiction.engines.shared.link_tree import LinkTree
from stiction.scenes import Scene
from stiction.scenes.model import Translational

SIDES = {"lower": 1.0, "upper": -1.0}
"""The surfaces of a guide, with the sign of the direction from them to the slider, across the guide's direction."""
_CORNERS = {"lower": (0, 1), "upper": (2, 3)}
"""Corners of `slider_box` that a surface can touch."""
_ROUNDING = 1e-3
"""Radius of a corner, in widths of the slider. Nothing depends on it while the slider is parallel to the guide."""
_RECRUITED = 0.2
"""Largest part of the normal force that a contact's softness takes up which slip may recruit."""
SOLIMP_SHAPE = (0.001, 0.5, 2.0)
"""MuJoCo's defaults of the last three numbers of ``solimp``: width, midpoint and power of the transition from one
impedance to another. They have no effect, as both impedances are equal."""


def numbers(*values: float) -> str:
    """Write numbers as an attribute of MJCF."""
    return " ".join(repr(float(value)) for value in values)


def add(parent: xml.Element, tag: str, **attributes: str) -> xml.Element:
    """Add an element with these attributes."""
    return xml.SubElement(parent, tag, attributes)


def surface(guide: str, side: str) -> str:
    """Return the name of the plane of a guide's surface, of its contacts and of their sensor."""
    return f"{guide}.{side}"


def slip_damping(wanted: float, speed: float, h: float) -> float:
    """Return the damping of friction, 1/s: ends slip in a step of h s, or opposes it with the wanted m/s^2 if less."""
    return 1.0 / h if abs(speed) <= wanted * h else wanted / abs(speed)


def slip_reference(most: float, impedance: float, coefficient: float) -> float:
    """Return the ratio n of the reference acceleration of friction to the acceleration that it opposes, mu N/m.

    The excess of the reference recruits the normal acceleration (n - 1) mu^2 N/m. With the impedance d, the softness of
    the normal direction takes up (1 - d)/d N/m. So n is limited where friction is large, to at most `most`.
    """
    limit = _RECRUITED * (1.0 - impedance) / impedance
    above, square = most - 1.0, coefficient**2
    return 1.0 + (above if above * square <= limit else limit / square)


def add_guides(
    root: xml.Element,
    elements: Mapping[int, xml.Element],
    scene: Scene,
    tree: LinkTree,
    options: Mapping[str, Any],
    timestep: float,
) -> None:
    """Add the planes of each guide and the corners of its slider, with their contacts and the sensors of their forces.

    `elements` are the model's bodies by link, that of the world at -1; `options` are the adapter's settings.
    """
    contact, sensor = xml.SubElement(root, "contact"), xml.SubElement(root, "sensor")
    untouched = {"contype": "0", "conaffinity": "0"}  # geoms touch only as pairs
    for name, guide in scene.guides.items():
        _, width = guide.extent
        radius = _ROUNDING * width
        link = tree.link_of[guide.slider]
        origin = tree.links[link].point
        ux, uy = direction_of(guide)
        corners = slider_box(guide, narrowing(guide, options))
        (x0, y0), (x1, y1) = corners[0], corners[3]  # at the lower and at the upper surface
        height = hypot(x1 - x0, y1 - y0)
        across = (x1 - x0) / height, (y1 - y0) / height
        pair = _pair(guide, options, timestep)
        for side, sign in SIDES.items():
            distance = surface_distance(guide)
            place = (guide.point[0] + sign * uy * distance, guide.point[1] - sign * ux * distance)
            add(
                elements[-1],
                "geom",
                name=surface(name, side),
                type="plane",
                size="1 1 1",
                pos=numbers(*place, 0.0),
                zaxis=numbers(-sign * uy, sign * ux, 0.0),
                **untouched,
            )
            # The sphere touches the surface at the corner, so its centre is a radius inside the box.
            for k in _CORNERS[side]:
                (x, y), inset = corners[k], sign * radius
                add(
                    elements[link],
                    "geom",
                    name=f"{name}.corner{k + 1}",
                    type="sphere",
                    size=repr(radius),
                    pos=numbers(
                        x + inset * across[0] - origin[0], y + inset * across[1] - origin[1], 0.0
                    ),
                    **untouched,
                )
                add(
                    contact,
                    "pair",
                    name=f"{surface(name, side)}.{k + 1}",
                    geom1=surface(name, side),
                    geom2=f"{name}.corner{k + 1}",
                    **pair,
                )
            if guide.frictional:
                xml.SubElement(
                    sensor,
                    "contact",
                    name=surface(name, side),
                    geom1=surface(name, side),
                    data="force",
                    reduce="netforce",
                )


def _pair(guide: Translational, options: Mapping[str, Any], timestep: float) -> dict[str, str]:
    """Return the attributes of a contact of a guide: friction and compliance.

    Two contacts together lose all of their velocity in a step.
    """
    d, time_constant = options["impedance"], options["time_constant"]
    attributes = {"condim": "1"}
    if guide.frictional:
        attributes = {
            "condim": "3",
            "friction": numbers(*[guide.kinetic_coefficient] * 2, 0.0, 0.0, 0.0),
        }
        if not time_constant:
            attributes["solreffriction"] = numbers(-1.0, -d / timestep)
    # MuJoCo's direct format (negative numbers) is the effect of a single contact with its impedance,
    # but two contacts carry a flat box.
    reference = (-d * options["recovery"] / timestep**2, -(1.0 + d) / 2 / timestep)
    return attributes | {
        "solref": numbers(*(time_constant, 1.0) if time_constant else reference),
        "solimp": numbers(d, d, *SOLIMP_SHAPE),
    }
