"""Dimensional analysis: a scene in other units of length, mass and time has the same motion in those units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stiction.scenes import Scene, scene_from_dict

Dimension = tuple[int, int, int]
"""Exponents of length, mass and time."""

NUMBER, LENGTH, TIME, MASS = (0, 0, 0), (1, 0, 0), (0, 0, 1), (0, 1, 0)
FORCE, TORQUE = (1, 1, -2), (2, 1, -2)
DIMENSIONS: Mapping[str, Mapping[str, Dimension]] = {
    "bodies": {
        "mass": MASS,
        "inertia": (2, 1, 0),
        "position": LENGTH,
        "angle": NUMBER,
        "velocity": (1, 0, -1),
        "angular_velocity": (0, 0, -1),
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
    "stabilization": {"alpha": (0, 0, -1), "beta": (0, 0, -1)},
}
"""By section of a scene, or by type of an element, the dimensions of its keys; a law has those of its values."""
LAW = {
    "value": 0,
    "offset": 0,
    "amplitude": 0,
    "values": 0,
    "rate": -1,
    "frequency": -1,
    "times": 1,
}
"""Exponents of time of a law's keys, in addition to the law's own dimension."""
OF_TIME = ("frequency", "times")
"""Keys of a law that have no other dimension."""


@dataclass(frozen=True)
class Units:
    """Factors by which lengths, masses and times of a scene are multiplied."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def of(self, dimension: Dimension) -> float:
        return self.length ** dimension[0] * self.mass ** dimension[1] * self.time ** dimension[2]


def scaled(scene: Scene, units: Units) -> Scene:
    """The scene with every quantity multiplied as its dimension requires, without parameters and under its name."""
    raw = scene.model_dump(exclude={"parameters"})
    raw["t_end"] *= units.time
    if raw["gravity"] is not None:
        raw["gravity"] = _times(raw["gravity"], units.of((1, 0, -2)))
    for section in ("bodies", "joints", "drives", "springs", "forces"):
        for element in raw[section].values():
            _scale(element, DIMENSIONS[element.get("type", section)], units)
    _scale(raw["stabilization"], DIMENSIONS["stabilization"], units)
    return scene_from_dict(raw, scene._origin, name=scene.name)


def _scale(element: dict[str, Any], dimensions: Mapping[str, Dimension], units: Units) -> None:
    for key, dimension in dimensions.items():
        value = element.get(key)
        if isinstance(value, dict):
            for name, exponent in LAW.items():
                if name in value:
                    length, mass, time = dimension
                    power = (
                        (length, mass, time + exponent) if name not in OF_TIME else (0, 0, exponent)
                    )
                    value[name] = _times(value[name], units.of(power))
        elif value is not None:
            element[key] = _times(value, units.of(dimension))


def _times(value: Any, factor: float) -> Any:
    return (
        [_times(item, factor) for item in value]
        if isinstance(value, (list, tuple))
        else value * factor
    )
