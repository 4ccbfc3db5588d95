"""Scenes in other units of length, mass and time, whose motion is the same in those units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stiction.scenes import Scene, scene_from_dict

Dimension = tuple[int, int, int]
"""Exponents of length, mass and time."""

NUMBER: Dimension = (0, 0, 0)
LENGTH: Dimension = (1, 0, 0)
MASS: Dimension = (0, 1, 0)
ACCELERATION: Dimension = (1, 0, -2)
FORCE: Dimension = (1, 1, -2)
TORQUE: Dimension = (2, 1, -2)
RATE: Dimension = (0, 0, -1)
DIMENSIONS: Mapping[str, Mapping[str, Dimension]] = {
    "bodies": {
        "mass": MASS,
        "inertia": (2, 1, 0),
        "position": LENGTH,
        "angle": NUMBER,
        "velocity": (1, 0, -1),
        "angular_velocity": RATE,
    },
    "revolute": {"points": LENGTH},
    "translational": {"point": LENGTH, "slider_point": LENGTH, "length": LENGTH, "width": LENGTH},
    "angle": {"points": LENGTH, "law": NUMBER},
    "distance": {"points": LENGTH, "law": LENGTH},
    "linear": {
        "points": LENGTH,
        "stiffness": (0, 1, -2),
        "damping": (0, 1, -1),
        "rest_length": LENGTH,
    },
    "torsional": {"stiffness": TORQUE, "damping": (2, 1, -1), "rest_angle": NUMBER},
    "force": {"point": LENGTH, "law": FORCE},
    "torque": {"law": TORQUE},
    "stabilization": {"alpha": RATE, "beta": RATE},
}
"""Dimensions of the keys of a section of a scene, or of an element by its type. A law of time has the dimension of its
values."""
VALUE_KEYS = {"value": 0, "offset": 0, "amplitude": 0, "values": 0, "rate": -1}
"""Keys of a law that contain its values or their rate: the exponent of time by which they differ from the values."""
TIME_KEYS = {"frequency": -1, "times": 1}
"""Keys of a law that contain times or frequencies only: their exponent of time."""


@dataclass(frozen=True)
class Units:
    """Factors by which the numbers of lengths, masses and times in a scene are multiplied."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def of(self, dimension: Dimension) -> float:
        """Return the factor of a quantity with a dimension."""
        length, mass, time = dimension
        return self.length**length * self.mass**mass * self.time**time


def scaled(scene: Scene, units: Units) -> Scene:
    """Return a scene in other units, with the same name and without parameters."""
    raw = scene.model_dump(exclude={"parameters"})
    raw["t_end"] *= units.time
    if raw["gravity"] is not None:
        raw["gravity"] = _multiplied(raw["gravity"], units.of(ACCELERATION))
    for section in ("bodies", "joints", "drives", "springs", "forces"):
        for element in raw[section].values():
            _scale(element, DIMENSIONS[element.get("type", section)], units)
    _scale(raw["stabilization"], DIMENSIONS["stabilization"], units)
    return scene_from_dict(raw, scene._origin, name=scene.name)


def _scale(element: dict[str, Any], dimensions: Mapping[str, Dimension], units: Units) -> None:
    """Convert the numbers of an element in place; keys without a value are left out."""
    for key, dimension in dimensions.items():
        value = element.get(key)
        if isinstance(value, dict):
            _scale_law(value, dimension, units)
        elif value is not None:
            element[key] = _multiplied(value, units.of(dimension))


def _scale_law(law: dict[str, Any], dimension: Dimension, units: Units) -> None:
    """Convert the numbers of a law in place; `dimension` is that of its values."""
    length, mass, time = dimension
    for name, exponent in VALUE_KEYS.items():
        if name in law:
            law[name] = _multiplied(law[name], units.of((length, mass, time + exponent)))
    for name, exponent in TIME_KEYS.items():
        if name in law:
            law[name] = _multiplied(law[name], units.of((0, 0, exponent)))


def _multiplied(value: Any, factor: float) -> Any:
    """Return a number times a factor, or a list of which each number is multiplied, however deeply it is nested."""
    if isinstance(value, (list, tuple)):
        return [_multiplied(item, factor) for item in value]
    return value * factor
