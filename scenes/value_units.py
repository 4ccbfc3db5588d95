"""Units of the numbers of a scene: of a value of an element, and of a parameter by where the scene uses it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from stiction.scenes.model import Scene

BODY_UNITS: Mapping[str, str] = {
    "mass": "kg",
    "inertia": "kg m²",
    "position": "m",
    "velocity": "m/s",
    "angle": "rad",
    "angular_velocity": "rad/s",
}
"""Units of the values of a body."""
GUIDE_UNITS: Mapping[str, str] = {
    "mu": "",
    "mus": "",
    "normal_load": "N",
    "length": "m",
    "width": "m",
    "point": "m",
    "slider_point": "m",
    "angle": "rad",
    "friction": "N",
    "static_friction": "N",
    "stribeck_velocity": "m/s",
    "stribeck_shape": "",
    "damping": "N s/m",
    "clearance": "m",
    "restitution": "",
}
"""Units of the values of a translational joint."""
PIN_UNITS: Mapping[str, str] = {
    "points": "m",
    "friction": "N m",
    "static_friction": "N m",
    "mu": "",
    "mus": "",
    "radius": "m",
    "stribeck_velocity": "rad/s",
    "stribeck_shape": "",
    "damping": "N m s/rad",
}
"""Units of the values of a revolute joint."""
LINEAR_SPRING_UNITS: Mapping[str, str] = {
    "points": "m",
    "stiffness": "N/m",
    "damping": "N s/m",
    "rest_length": "m",
}
"""Units of the values of a linear spring."""
TORSIONAL_SPRING_UNITS: Mapping[str, str] = {
    "stiffness": "N m/rad",
    "damping": "N m s/rad",
    "rest_angle": "rad",
}
"""Units of the values of a torsional spring."""
UNITS_BY_PART_AND_TYPE: Mapping[tuple[str, str], Mapping[str, str]] = {
    ("bodies", ""): BODY_UNITS,
    ("joints", "translational"): GUIDE_UNITS,
    ("joints", "revolute"): PIN_UNITS,
    ("drives", "angle"): {"effort_limit": "N m"},
    ("drives", "distance"): {"effort_limit": "N", "points": "m"},
    ("springs", "linear"): LINEAR_SPRING_UNITS,
    ("springs", "torsional"): TORSIONAL_SPRING_UNITS,
}
"""Units of the values of an element, by its part of the scene and its type."""
UNITS_OF_LAWS: Mapping[tuple[str, str], str] = {
    ("drives", "angle"): "rad",
    ("drives", "distance"): "m",
    ("forces", "force"): "N",
    ("forces", "torque"): "N m",
}
"""Unit of the value of a law, by the part of the scene and the type of its element."""
SCENE_UNITS: Mapping[str, str] = {"t_end": "s", "gravity": "m/s²"}
"""Units of the values of the scene itself."""


def unit_of_value(scene: Scene, key: str) -> str | None:
    """Return the unit of a number of a scene, by its key as in `vary`; None if it is not known.

    The unit of a parameter is that of the values that consist of its name alone, with either sign, if they all have the
    same unit. A ratio has the empty unit.
    """
    values = list(_values_with_units(scene.to_dict()))
    if key in scene.parameters:
        units = {unit for _, value, unit in values if value in (key, f"-{key}")}
        return units.pop() if len(units) == 1 else None
    # Keys may leave out the part of the scene, the law, and the number of a component.
    parts = [part for part in key.split(".") if part != "law" and not part.isdigit()]
    for path, _, unit in values:
        if path[-len(parts) :] == tuple(parts):
            return unit
    return None


def _values_with_units(
    tables: Mapping[str, Any],
) -> Iterator[tuple[tuple[str, ...], object, str]]:
    """Yield the path, without ``law``, of each value whose unit is known, the value as written, and its unit.

    Each component of a vector is a value of its own, with the path of the vector.
    """
    for name, unit in SCENE_UNITS.items():
        for value in _components(tables.get(name)):
            yield (name,), value, unit
    for part in ("bodies", "joints", "springs", "drives", "forces"):
        for name, element in tables.get(part, {}).items():
            kind = element.get("type", "")
            units = UNITS_BY_PART_AND_TYPE.get((part, kind), {})
            for field, unit in units.items():
                for value in _components(element.get(field)):
                    yield (part, name, field), value, unit
            if (part, kind) in UNITS_OF_LAWS:
                law_units = _law_units(UNITS_OF_LAWS[part, kind])
                for field, unit in law_units.items():
                    for value in _components(element.get("law", {}).get(field)):
                        yield (part, name, field), value, unit


def _law_units(unit: str) -> dict[str, str]:
    """Return the units of the values of a law whose own value has a unit."""
    return {
        "value": unit,
        "values": unit,
        "offset": unit,
        "distance": unit,
        "start": "s",
        "duration": "s",
        "ramp": "s",
        "amplitude": unit,
        "rate": f"{unit}/s",
        "frequency": "rad/s",
        "phase": "rad",
        "times": "s",
    }


def _components(value: object) -> Iterator[object]:
    """Yield a number, or the components of a vector; nothing if the value is missing."""
    if isinstance(value, (list, tuple)):
        for component in value:
            yield from _components(component)
    elif value is not None:
        yield value
