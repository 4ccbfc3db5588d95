"""One mechanism in guises that must not matter: no truth is needed, the guises must agree with each other.

    python -m stiction.comparisons.random_scenes.metamorphic --seconds 60 --seed 1 --rtol 1e-9

grid       other output times: the same events and the same end, to the last bit
moved      everything shifted and turned
mirrored   left and right exchanged
scaled     millimetres instead of metres
renamed    elements in another order and under other names
company    another mechanism beside it that does not touch it

A guise changes rounding and the sizes that a tolerance is relative to, and a motion may magnify that. Such a difference shrinks with the
tolerance: a pair that differs is run again at a hundredth of it, and disagrees if its difference has not become a tenth.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stiction.comparisons.random_scenes.drawn_scenes import Study, Verdict
from stiction.comparisons.random_scenes.random_mechanisms import SeededDice, moderate_scene, turn
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import Trajectory, scene_from_dict

Tables = dict[str, Any]
REFERENCES = ("body", "slider", "guide")
SECTIONS = ("bodies", "joints", "drives", "springs", "forces")
ALLOWED = 2e4
"""Times rtol: a difference that is not looked into, relative to the size of the motion. Local errors add up over some thousand steps."""
TIGHTER, SHRINKS = 1e-2, 0.1
"""A tolerance that is so many times the first; the difference must become at most so many times the first."""
ROUNDING = 1e-9
"""What a difference may be whatever the tolerance: at rtol 1e-11 rounding is as large as the local errors."""
OUTPUT_STEP, OTHER_STEP = 0.03, 0.0071


@dataclass(frozen=True)
class Guise:
    """The tables of a scene, and the way back from its motion to that of the original.

    Attributes
    ----------
    names : Mapping
        The original's name of each element that has another.
    home : callable
        Positions (2, n), m, in the ground axes of the original.
    spin : float
        Angular velocities times this are the original's.
    output_step : float
    exact : bool
        Whether it must agree to the last bit.
    """

    name: str
    tables: Tables
    names: Mapping[str, str] = field(default_factory=dict)
    home: Callable[[np.ndarray], np.ndarray] = lambda x: x
    spin: float = 1.0
    output_step: float = OUTPUT_STEP
    exact: bool = False


def guises(tables: Tables, random: np.random.Generator) -> Iterator[Guise]:
    """All guises of a scene."""
    shift, angle, factor = random.uniform(-2, 2, 2), float(random.uniform(-3, 3)), 1000.0
    yield Guise("grid", tables, output_step=OTHER_STEP, exact=True)
    yield Guise("moved", moved(tables, shift, angle), home=lambda x: turn(-angle, x - shift[:, None]))
    yield Guise("mirrored", mirrored(tables), home=lambda x: x * [[-1.0], [1.0]], spin=-1.0)
    yield Guise("scaled", scaled(tables, factor), home=lambda x: x / factor)
    other, names = renamed(tables)
    yield Guise("renamed", other, names)
    yield Guise("company", accompanied(tables))


def moved(tables: Tables, shift: np.ndarray, angle: float) -> Tables:
    """Every ground position turned and shifted, every ground direction turned."""
    tables = copy.deepcopy(tables)

    def place(point: list[float]) -> list[float]:
        return list(turn(angle, point) + shift)

    if tables.get("gravity"):
        tables["gravity"] = list(turn(angle, tables["gravity"]))
    for body in tables["bodies"].values():
        body["position"], body["velocity"] = place(body.get("position", [0, 0])), list(turn(angle, body.get("velocity", [0, 0])))
        body["angle"] = body.get("angle", 0.0) + angle
    for element in _elements(tables, "joints", "drives", "springs"):
        if element["type"] == "translational":
            if element.get("guide", "ground") == "ground":
                element["point"] = place(element.get("point", [0, 0]))
                element["direction"] = list(turn(angle, element.get("direction", [1, 0])))
                element["angle"] = element.get("angle", 0.0) + angle
            continue
        sign = [1.0, -1.0][element["bodies"].index("ground")] * -1.0 if "ground" in element["bodies"] else 0.0
        if element["type"] == "angle":
            key = "value" if element["law"]["type"] == "constant" else "offset"
            element["law"][key] = element["law"].get(key, 0.0) + sign * angle
        elif element["type"] == "torsional":
            element["rest_angle"] = element.get("rest_angle", 0.0) + sign * angle
        else:
            points = element.get("points", [[0, 0], [0, 0]])
            element["points"] = [place(point) if body == "ground" else point for body, point in zip(element["bodies"], points)]
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
        for key in ("gravity", "position", "velocity", "point", "slider_point", "direction", "axis"):
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


def scaled(tables: Tables, factor: float) -> Tables:
    """All lengths times a factor, masses and times as they are: forces grow with it, torques and inertias with its square."""
    tables = copy.deepcopy(tables)
    for table in (tables, *_elements(tables, *SECTIONS)):
        for key in ("gravity", "position", "velocity", "point", "slider_point"):
            if table.get(key):
                table[key] = [factor * x for x in table[key]]
        if "points" in table:
            table["points"] = [[factor * x for x in point] for point in table["points"]]
        for key, power in (("length", 1), ("width", 1), ("rest_length", 1), ("inertia", 2)):
            if key in table:
                table[key] *= factor ** power
        kind = table.get("type")
        if kind == "torsional":
            for key in ("stiffness", "damping"):
                table[key] = table.get(key, 0.0) * factor ** 2
        if kind in ("force", "distance", "torque"):
            _scale_law(table["law"], factor ** 2 if kind == "torque" else factor)
    return tables


def renamed(tables: Tables) -> tuple[Tables, dict[str, str]]:
    """The elements in reverse order under other names, and the original's name of each."""
    tables = copy.deepcopy(tables)
    other = {name: f"{section}-{i}" for section in SECTIONS for i, name in enumerate(reversed(tables.get(section, {})))}
    for table in _elements(tables, *SECTIONS):
        for key in REFERENCES:
            if table.get(key) in other:
                table[key] = other[table[key]]
        if "bodies" in table:
            table["bodies"] = [other.get(name, name) for name in table["bodies"]]
    for section in SECTIONS:
        tables[section] = {other[name]: table for name, table in reversed(tables.get(section, {}).items())}
    return tables, {new: old for old, new in other.items()}


def accompanied(tables: Tables) -> Tables:
    """With a pendulum far off that swings by itself."""
    tables = copy.deepcopy(tables)
    tables["bodies"]["stranger"] = {"mass": 1.7, "inertia": 0.3, "position": [0.0, -20.0], "angular_velocity": 0.0}
    tables["joints"]["nail"] = {"type": "revolute", "bodies": ["stranger", "ground"], "points": [[-1.5, 0.0], [-1.5, -20.0]]}
    return tables


def _elements(tables: Tables, *sections: str) -> list[Tables]:
    return [table for section in sections for table in tables.get(section, {}).values()]


def _scale_law(law: Tables, factor: float) -> None:
    for key in ("value", "offset", "rate", "amplitude"):
        if key in law:
            law[key] *= factor
    if "values" in law:
        law["values"] = [factor * value for value in law["values"]]


def simulate(guise: Guise, t_end: float, rtol: float) -> Trajectory:
    return ReferenceEngine().simulate(scene_from_dict(guise.tables), t_end=t_end, rtol=rtol, stabilization="projection", output_step=guise.output_step)


def difference(one: Trajectory, other: Trajectory, bodies: Mapping[str, Any], guise: Guise) -> float | str:
    """How far two runs are apart: in words where they do not even have the same events and end.

    Else the largest of: differences of event times, s, and at the end of positions and angular velocities, relative to 1 and their size.
    """
    ends = [(run.breakdown and run.breakdown.kind) for run in (one, other)]
    if ends[0] != ends[1]:
        return f"one ends with {ends[0] or 'its time'}, the other with {ends[1] or 'its time'}"
    events = [sorted((round(event.time, 5), guise.names.get(event.joint, event.joint), event.kind, event.time) for event in run.events)
              for run in (one, other)]
    if (kinds := [[event[1:3] for event in found] for found in events])[0] != kinds[1]:
        first = next((i for i, (a, b) in enumerate(zip(*kinds)) if a != b), min(map(len, kinds)))
        return f"{len(kinds[0])} and {len(kinds[1])} events, the first other one {events[0][first:first + 1]} and {events[1][first:first + 1]}"
    apart = [abs(a[3] - b[3]) for a, b in zip(*events)]
    if one.breakdown is not None:
        return max([*apart, abs(one.breakdown.time - other.breakdown.time)])  # the last output before it depends on the grid
    new_name = {old: new for new, old in guise.names.items()}
    for name in bodies:
        theirs = new_name.get(name, name)
        a = np.array([one[f"{name}.x"][-1:], one[f"{name}.y"][-1:]])
        b = guise.home(np.array([other[f"{theirs}.x"][-1:], other[f"{theirs}.y"][-1:]]))
        turning = one[f"{name}.omega"][-1], guise.spin * other[f"{theirs}.omega"][-1]
        apart += [np.max(np.abs(a - b)) / (1 + np.max(np.abs(a))), abs(turning[0] - turning[1]) / (1 + abs(turning[0]))]
    return float(max(apart))


def disagreement(tables: Tables, guise: Guise, t_end: float, rtol: float) -> str:
    """In words, or nothing."""
    def apart(tolerance: float) -> float | str:
        return difference(simulate(Guise("as it is", tables), t_end, tolerance), simulate(guise, t_end, tolerance), tables["bodies"], guise)

    first = apart(rtol)
    if guise.exact:
        return "" if first == 0.0 else f"{guise.name}: not to the last bit: {first}"
    if not isinstance(first, str) and first <= ALLOWED * rtol:
        return ""
    second = apart(TIGHTER * rtol)
    if isinstance(second, str):
        return f"{guise.name}: {second}, at rtol {TIGHTER * rtol:g} too"
    allowed = max(ROUNDING, ALLOWED * TIGHTER * rtol, 0.0 if isinstance(first, str) else SHRINKS * first)
    return "" if second <= allowed else f"{guise.name}: {first} at rtol {rtol:g}, {second:.1e} at {TIGHTER * rtol:g}; allowed {allowed:.1e}"


AGREE, DISAGREE = "agree", "disagree"


def judge_drawn(seed: int, i: int, rtols: Sequence[float], t_end: float) -> list[list[Verdict]]:
    """All guises of a scene of a seed."""
    random = np.random.default_rng([seed, i])
    tables = moderate_scene(SeededDice(random))
    looks = list(guises(tables, random))
    return [[Verdict(DISAGREE if found else AGREE, found, about=f"scene {i} of seed {seed}")
             for found in (disagreement(tables, guise, t_end, rtol) for guise in looks)] for rtol in rtols]


STUDY = Study("stiction.comparisons.random_scenes.metamorphic", judge_drawn, {AGREE: "a guise and its original have one motion", DISAGREE: "they do not, whatever the tolerance"},
              (DISAGREE,), "error [-]", (1e-9,), 1.5)


if __name__ == "__main__":
    raise SystemExit(STUDY.main(__doc__))
