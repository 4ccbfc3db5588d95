"""Random mechanisms in guises that must not matter: no truth is needed, the guises must agree with each other.

moved      everything shifted and turned
mirrored   left and right exchanged
scaled     millimetres instead of metres
renamed    elements in another order and under other names

Other output times are in `test_event_location.py`, another mechanism beside it in `test_large_mechanisms.py`: they
change no bit.

A guise changes rounding and the sizes that a tolerance is relative to, and a motion may magnify that. Such a difference
shrinks with the tolerance: a pair that differs is run again at a hundredth of it, and disagrees if its difference has
not become a tenth.
"""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from random_mechanisms import SeededDice, moderate_scene, turn

from stiction.comparisons.hard.scaled_scenes import Units, scaled
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import Scene, Trajectory, scene_from_dict

Tables = dict[str, Any]
NAMES = ("moved", "mirrored", "scaled", "renamed")
T_END, RTOL, SEED = 1.5, 1e-9, 20
REFERENCES = ("body", "slider", "guide")
SECTIONS = ("bodies", "joints", "drives", "springs", "forces")
MILLIMETRES = Units(length=1000.0)
ALLOWED = 2e4
"""Times rtol: a difference that is not looked into, relative to the size of the motion. Some thousand local errors add
up."""
TIGHTER, SHRINKS = 1e-2, 0.1
"""A tolerance that is so many times the first; the difference must become at most so many times the first."""
ROUNDING = 1e-9
"""Difference allowed at any tolerance: at rtol 1e-11 rounding is as large as the local errors."""


@dataclass(frozen=True)
class Guise:
    """A scene, and the way back from its motion to that of the original."""

    scene: Scene
    names: Mapping[str, str] = field(
        default_factory=dict
    )  # the original's name of each element that has another
    home: Callable[[np.ndarray], np.ndarray] = lambda x: (
        x
    )  # positions (2, n), m, in the ground axes of the original
    spin: float = 1.0  # angular velocities times this are the original's


def guises(tables: Tables, random: np.random.Generator) -> dict[str, Guise]:
    """All guises of a scene, by their names."""
    shift, angle = random.uniform(-2, 2, 2), float(random.uniform(-3, 3))
    other, names = renamed(tables)
    place = scene_from_dict(moved(tables, shift, angle))
    return {
        "moved": Guise(place, home=lambda x: turn(-angle, x - shift[:, None])),
        "mirrored": Guise(
            scene_from_dict(mirrored(tables)), home=lambda x: x * [[-1.0], [1.0]], spin=-1.0
        ),
        "scaled": Guise(
            scaled(scene_from_dict(tables), MILLIMETRES), home=lambda x: x / MILLIMETRES.length
        ),
        "renamed": Guise(scene_from_dict(other), names),
    }


def moved(tables: Tables, shift: np.ndarray, angle: float) -> Tables:
    """Every ground position turned and shifted, every ground direction turned."""
    tables = copy.deepcopy(tables)

    def place(point: list[float]) -> list[float]:
        return list(turn(angle, point) + shift)

    if tables.get("gravity"):
        tables["gravity"] = list(turn(angle, tables["gravity"]))
    for body in tables["bodies"].values():
        body["position"] = place(body.get("position", [0, 0]))
        body["velocity"] = list(turn(angle, body.get("velocity", [0, 0])))
        body["angle"] = body.get("angle", 0.0) + angle
    for element in _elements(tables, "joints", "drives", "springs"):
        if element["type"] == "translational":
            if element.get("guide", "ground") == "ground":
                element["point"] = place(element.get("point", [0, 0]))
                element["direction"] = list(turn(angle, element.get("direction", [1, 0])))
                element["angle"] = element.get("angle", 0.0) + angle
            continue
        sign = (
            [1.0, -1.0][element["bodies"].index("ground")] * -1.0
            if "ground" in element["bodies"]
            else 0.0
        )
        if element["type"] == "angle":
            key = "value" if element["law"]["type"] == "constant" else "offset"
            element["law"][key] = element["law"].get(key, 0.0) + sign * angle
        elif element["type"] == "torsional":
            element["rest_angle"] = element.get("rest_angle", 0.0) + sign * angle
        else:
            points = element.get("points", [[0, 0], [0, 0]])
            element["points"] = [
                place(point) if body == "ground" else point
                for body, point in zip(element["bodies"], points)
            ]
            if "axis" in element and element["bodies"][1] == "ground":
                element["axis"] = list(turn(angle, element["axis"]))
    for load in _elements(tables, "forces"):
        if load["type"] == "force":
            load["direction"] = list(turn(angle, load["direction"]))
    return tables


def mirrored(tables: Tables) -> Tables:
    """x -> -x on the ground and in the axes of every body, whose angle changes its sign with that."""
    tables = copy.deepcopy(tables)
    for table in (tables, *_elements(tables, *SECTIONS)):
        for key in (
            "gravity",
            "position",
            "velocity",
            "point",
            "slider_point",
            "direction",
            "axis",
        ):
            if table.get(key):
                table[key] = [-table[key][0], table[key][1]]
        if table.get("type") == "translational" and "direction" not in table:
            table["direction"] = [-1.0, 0.0]
        if "points" in table:
            table["points"] = [[-x, y] for x, y in table["points"]]
        for key in ("angle", "angular_velocity", "rest_angle"):
            if key in table:
                table[key] = -table[key]
        if table.get("type") in ("angle", "torque"):
            _scale_law(table["law"], -1.0)
    return tables


def renamed(tables: Tables) -> tuple[Tables, dict[str, str]]:
    """The elements in reverse order under other names, and the original's name of each."""
    tables = copy.deepcopy(tables)
    other = {
        name: f"{section}-{i}"
        for section in SECTIONS
        for i, name in enumerate(reversed(tables.get(section, {})))
    }
    for table in _elements(tables, *SECTIONS):
        for key in REFERENCES:
            if table.get(key) in other:
                table[key] = other[table[key]]
        if "bodies" in table:
            table["bodies"] = [other.get(name, name) for name in table["bodies"]]
    for section in SECTIONS:
        tables[section] = {
            other[name]: table for name, table in reversed(tables.get(section, {}).items())
        }
    return tables, {new: old for old, new in other.items()}


def _elements(tables: Tables, *sections: str) -> list[Tables]:
    return [table for section in sections for table in tables.get(section, {}).values()]


def _scale_law(law: Tables, factor: float) -> None:
    for key in ("value", "offset", "rate", "amplitude"):
        if key in law:
            law[key] *= factor
    if "values" in law:
        law["values"] = [factor * value for value in law["values"]]


def simulate(scene: Scene, rtol: float, t_end: float) -> Trajectory:
    return ReferenceEngine().simulate(
        scene, t_end=t_end, rtol=rtol, stabilization="projection", output_step=t_end
    )


def difference(
    one: Trajectory, other: Trajectory, bodies: Mapping[str, Any], guise: Guise
) -> float | str:
    """Difference of two runs: in words where they do not even have the same events and end.

    Else the largest of: differences of event times, s; at the end of positions and angular velocities, relative to 1
    and their size.
    """
    ends = [(run.breakdown and run.breakdown.kind) for run in (one, other)]
    if ends[0] != ends[1]:
        return f"one ends with {ends[0] or 'its time'}, the other with {ends[1] or 'its time'}"
    events = [
        sorted(
            (
                round(event.time, 5),
                guise.names.get(event.joint, event.joint),
                event.kind,
                event.time,
            )
            for event in run.events
        )
        for run in (one, other)
    ]
    kinds = [[event[1:3] for event in found] for found in events]
    if kinds[0] != kinds[1]:
        return f"events {events[0]} and {events[1]}"
    differences = [abs(a[3] - b[3]) for a, b in zip(*events)]
    if one.breakdown is not None:
        return max([*differences, abs(one.breakdown.time - other.breakdown.time)])
    new_name = {old: new for new, old in guise.names.items()}
    for name in bodies:
        theirs = new_name.get(name, name)
        a = np.array([one[f"{name}.x"][-1:], one[f"{name}.y"][-1:]])
        b = guise.home(np.array([other[f"{theirs}.x"][-1:], other[f"{theirs}.y"][-1:]]))
        omega, its_omega = one[f"{name}.omega"][-1], guise.spin * other[f"{theirs}.omega"][-1]
        differences += [
            np.max(np.abs(a - b)) / (1 + np.max(np.abs(a))),
            abs(omega - its_omega) / (1 + abs(omega)),
        ]
    return float(max(differences))


def disagreement(tables: Tables, guise: Guise, t_end: float = T_END) -> str:
    """In words, or nothing."""

    def at(rtol: float) -> float | str:
        runs = (simulate(scene, rtol, t_end) for scene in (scene_from_dict(tables), guise.scene))
        return difference(*runs, tables["bodies"], guise)

    first = at(RTOL)
    if not isinstance(first, str) and first <= ALLOWED * RTOL:
        return ""
    second = at(TIGHTER * RTOL)
    if isinstance(second, str):
        return f"{second}, at rtol {TIGHTER * RTOL:g} too"
    allowed = max(
        ROUNDING, ALLOWED * TIGHTER * RTOL, 0.0 if isinstance(first, str) else SHRINKS * first
    )
    if second <= allowed:
        return ""
    return f"{first} at rtol {RTOL:g}, {second:.1e} at {TIGHTER * RTOL:g}; allowed {allowed:.1e}"


def drawn(seed: int, number: int) -> tuple[Tables, dict[str, Guise]]:
    random = np.random.default_rng([seed, number])
    tables = moderate_scene(SeededDice(random))
    return tables, guises(tables, random)


def disagreements(name: str, seed: int, scenes: range, t_end: float = T_END) -> list[str]:
    found = ((number, *drawn(seed, number)) for number in scenes)
    return [
        f"seed {seed}, scene {number}: {words}"
        for number, tables, all_ in found
        if (words := disagreement(tables, all_[name], t_end))
    ]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("seed", "count", "t_end"),
    [
        (SEED, 30, T_END),
        *(pytest.param(SEED + 1, 300, t_end, marks=pytest.mark.long) for t_end in (1.5, 8.0)),
    ],
)
def test_guises_agree(name, seed, count, t_end, compiled):
    assert disagreements(name, seed, range(count), t_end) == []


def test_scenes_have_what_the_guises_are_about():
    scenes = (scene_from_dict(drawn(SEED, number)[0]) for number in range(30))
    several = [scene for scene in scenes if len(scene.frictional_guides) > 1]
    assert (
        len(several) > 10
        and sum(len(simulate(scene, RTOL, T_END).events) for scene in several) > 30
    )


@pytest.mark.parametrize("name", NAMES)
def test_a_guise_that_is_another_mechanism_disagrees(name, compiled):
    """A mass that is another by a thousandth of itself, in each guise; the way home forgotten, in those that have
    one."""
    tables, all_ = drawn(SEED, 0)
    guise = all_[name]
    raw = guise.scene.model_dump()
    next(iter(raw["bodies"].values()))["mass"] *= 1.001
    assert disagreement(tables, replace(guise, scene=scene_from_dict(raw)))
    if name != "renamed":
        assert disagreement(tables, replace(guise, home=lambda x: x))
