"""Geometry of contact fidelity, at which each slider is a box in a guide on the ground."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import cos, hypot, sin
from typing import Any

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Translational

REACH = 1e3
"""Half the length (m) of a guide's surfaces in engines whose surfaces end; the guides of a scene do not end."""


def contact_refusal(scene: Scene) -> str | None:
    """Return why the scene's guides cannot be boxes between fixed surfaces; None if they can."""
    # Surfaces are fixed in all engines, and the corners need a length and a width.
    if not scene.guides:
        return "contact fidelity needs sliders in guides, and the scene has no translational joint"
    for name, guide in scene.guides.items():
        if guide.guide != GROUND:
            return f"joints.{name}: its guide is the body {guide.guide!r}; at contact fidelity guides are fixed"
        if not guide.length or not guide.width:
            return f"joints.{name}: contact fidelity needs the slider's length and width, both > 0"
    return None


def static_coefficient_refusal(scene: Scene, law: str) -> str | None:
    """Return why a law with one coefficient of friction cannot be that of all guides; None if it can.

    `law` is the beginning of the sentence: ``"Exudyn's contacts have"``.
    """
    for name, guide in scene.frictional_guides.items():
        if guide.static_coefficient != guide.kinetic_coefficient:
            return (
                f"joints.{name}: {law} one coefficient of friction; mus = "
                f"{guide.static_coefficient:g} is not mu = {guide.kinetic_coefficient:g}"
            )
    return None


def crowded(scene: Scene, most: int, called: str) -> str | None:
    """Return why an engine with one bit for each guide in its collision filters cannot separate the guides.

    None if it can. The engine has `most` bits, and is `called` so in messages.
    """
    if len(scene.guides) <= most:
        return None
    return f"{len(scene.guides)} guides; {called}'s collision filters, which keep them apart, have room for {most}"


def several_guides(scene: Scene) -> str | None:
    """Return the refusal of a body in two guides, for engines that give a body one box; None if there is none."""
    for name, other in _guides_of_same_slider(scene):
        return f"joints.{name}: its slider slides in joints.{other}, too; here a body touches one guide"
    return None


def unlike_guides(scene: Scene) -> str | None:
    """Return the refusal of a body in two guides with different friction; None if there is none.

    It is for engines whose contacts are identified by the two bodies alone.
    """
    friction = {name: (guide.mu, guide.static_coefficient) for name, guide in scene.guides.items()}
    for name, other in _guides_of_same_slider(scene):
        if friction[name] != friction[other]:
            return (
                f"joints.{name}: its slider slides in joints.{other}, too, with other coefficients; here a body has "
                "one friction"
            )
    return None


def _guides_of_same_slider(scene: Scene) -> Iterator[tuple[str, str]]:
    """Yield each guide whose slider already has a guide, with the first guide of that slider."""
    first_guide: dict[str, str] = {}
    for name, guide in scene.guides.items():
        if guide.slider in first_guide:
            yield name, first_guide[guide.slider]
        else:
            first_guide[guide.slider] = name


def surface_distance(guide: Translational) -> float:
    """Return the distance of each surface of a guide from the line of the slider's point, m.

    It is half the width of the slider, and the declared clearance.
    """
    return guide.extent[1] / 2 + (guide.clearance or 0.0)


def narrowing(guide: Translational, options: Mapping[str, Any]) -> float:
    """Return by how much the box of a slider is narrower than the slider, m.

    It is the setting `clearance` of an engine, which keeps boxes of guides without clearance from being pressed between
    both surfaces. A guide with a declared clearance does not need it.
    """
    return 0.0 if guide.clearance else options["clearance"]


def direction_of(guide: Translational) -> tuple[float, float]:
    """Return the unit vector along a guide, in the axes of the body that has the guide."""
    length = hypot(*guide.direction)
    return guide.direction[0] / length, guide.direction[1] / length


def box_angle(guide: Translational) -> float:
    """Return the angle of the box's long side in the slider's axes, rad."""
    return float(np.arctan2(guide.direction[1], guide.direction[0])) - guide.angle


def slider_box(guide: Translational, clearance: float) -> list[tuple[float, float]]:
    """Return the corners of the box in the slider's axes (m), counter-clockwise, around the slider's point.

    The box is narrower than the guide by the clearance (m). The order of the corners is that of the corner forces F1 ..
    F4: lower rear, lower front, upper front, upper rear.
    """
    x0, y0 = guide.slider_point
    length, width = guide.extent
    a = length / 2
    b = (width - clearance) / 2
    corners = ((-a, -b), (a, -b), (a, b), (-a, b))
    # Turn the corners from the axes of the box into those of the slider.
    angle = box_angle(guide)
    c, s = cos(angle), sin(angle)
    return [(x0 + c * x - s * y, y0 + s * x + c * y) for x, y in corners]
