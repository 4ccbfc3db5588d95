"""Mechanisms of any size."""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, hypot, pi, sin
from typing import Any

from stiction.scenes import Scene, load_scene, scene_from_dict

ELEMENTS = ("bodies", "joints", "drives", "springs", "forces")
SLIDER = {"length": 0.6, "width": 0.5, "mu": 0.03, "mus": 0.04}
DROP = 0.5
"""Metres from the line between two sliders to the pin of the two bars that join them."""


def independent_slider_bars(n: int) -> Scene:
    """n copies of case 1 side by side, with projection: element `slider` becomes `slider0`, `slider1`, .."""
    return scene_from_dict(_copies(n), f"independent-{n}")


def sprung_chain(
    n: int, stiffness: float = 0.5, damping: float = 0.05, phase: float = 0.37
) -> Scene:
    """n slider-bars whose sliders are joined to their neighbours by springs and dampers; loads differ by a phase."""
    tables = _copies(n)
    for k in range(n):
        tables["forces"][f"load{k}"]["law"]["phase"] = phase * k
    for k in range(n - 1):
        tables["springs"][f"link{k}"] = {
            "type": "linear",
            "bodies": [f"slider{k + 1}", f"slider{k}"],
            "axis": [1, 0],
            "stiffness": stiffness,
            "damping": damping,
        }
    return scene_from_dict(tables, f"sprung-chain-{n}")


def barred_chain(n: int) -> Scene:
    """n sliders on one line, 1 m apart, each joined to the next by two bars with a pin between them; n freedoms."""
    return _barred([((k, 0.0), (1.0, 0.0)) for k in range(n)], False, f"barred-chain-{n}")


def closed_loop(n: int) -> Scene:
    """Barred chain on n guides that point away from one centre, the last slider joined to the first; n freedoms."""
    radius = 0.5 / sin(pi / n)
    directions = [(cos(2 * pi * k / n), sin(2 * pi * k / n)) for k in range(n)]
    guides = [((radius * x, radius * y), (x, y)) for x, y in directions]
    return _barred(guides, True, f"closed-loop-{n}")


def _copies(n: int) -> dict[str, Any]:
    source = load_scene("slider-bar-case-1", {"stabilization": {"method": "projection"}})._raw
    tables = {
        **source,
        "title": f"slider-bar-case-1, {n} times",
        **{section: {} for section in ELEMENTS},
    }
    for section in ELEMENTS:
        for k in range(n):
            tables[section] |= {
                f"{name}{k}": _numbered(element, k, source["bodies"])
                for name, element in source.get(section, {}).items()
            }
    return tables


def _numbered(value: Any, k: int, bodies: Iterable[str]) -> Any:
    """Element with the numbers of its bodies added to their names."""
    if isinstance(value, dict):
        return {key: _numbered(item, k, bodies) for key, item in value.items()}
    if isinstance(value, list):
        return [_numbered(item, k, bodies) for item in value]
    return f"{value}{k}" if isinstance(value, str) and value in bodies else value


def _barred(
    guides: list[tuple[tuple[float, float], tuple[float, float]]], closed: bool, name: str
) -> Scene:
    """Sliders on guides (point, direction), each held by a spring, pushed by a load, joined to the next by two bars."""
    n = len(guides)
    tables: dict[str, Any] = {
        "title": f"{n} sliders joined by bars",
        "t_end": 4,
        "gravity": [0, -9.81],
        "stabilization": {"method": "projection"},
        **{section: {} for section in ELEMENTS},
    }
    bodies, joints, springs, forces = (
        tables[key] for key in ("bodies", "joints", "springs", "forces")
    )
    for k, (point, direction) in enumerate(guides):
        bodies[f"slider{k}"] = {"mass": 1, "inertia": 0.05, "position": point}
        joints[f"guide{k}"] = {
            "type": "translational",
            "slider": f"slider{k}",
            "direction": direction,
            "point": point,
            **SLIDER,
        }
        springs[f"spring{k}"] = {
            "type": "linear",
            "bodies": [f"slider{k}", "ground"],
            "points": [[0, 0], point],
            "axis": direction,
            "stiffness": 20,
        }
        forces[f"load{k}"] = {
            "type": "force",
            "body": f"slider{k}",
            "direction": direction,
            "law": {"type": "sine", "amplitude": 5, "frequency": 3, "phase": 1.3 * k},
        }
    for k in range(n if closed else n - 1):
        first, second = guides[k][0], guides[(k + 1) % n][0]
        across, along = (
            (first[1] - second[1], second[0] - first[0]),
            hypot(second[0] - first[0], second[1] - first[1]),
        )
        pin = [0.5 * (a + b) - DROP * c / along for a, b, c in zip(first, second, across)]
        for name_of_bar, end, slider in (
            (f"left{k}", first, k),
            (f"right{k}", second, (k + 1) % n),
        ):
            half = [0.5 * (p - e) for p, e in zip(pin, end)]
            bodies[name_of_bar] = {
                "mass": 0.3,
                "inertia": 0.3 * 4 * hypot(*half) ** 2 / 12,
                "position": [e + h for e, h in zip(end, half)],
            }
            joints[f"{name_of_bar}-end"] = {
                "type": "revolute",
                "bodies": [name_of_bar, f"slider{slider}"],
                "points": [[-h for h in half], [0, 0]],
            }
        joints[f"pin{k}"] = {
            "type": "revolute",
            "bodies": [f"left{k}", f"right{k}"],
            "points": [[0.5 * (p - e) for p, e in zip(pin, end)] for end in (first, second)],
        }
    return scene_from_dict(tables, name)
