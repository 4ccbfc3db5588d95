"""Scenes from TOML files, from the catalogue and from dictionaries; overrides; all errors at once."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from scenes.expressions import evaluate
from scenes.fields import GROUND
from scenes.model import Scene

SECTIONS = ("bodies", "joints", "drives", "springs", "forces")
MAX_FILE_SIZE = 16 * 2 ** 20
"""Bytes; a file above is refused unread."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong in a scene: where, what was found, what was expected."""

    key: str
    found: str
    expected: str

    def __str__(self) -> str:
        found = f": found {self.found}" if self.found else ""
        return f"{self.key}{found}; {self.expected}"


class SceneError(ValueError):
    """A scene that cannot be used; `origin` names the file, `problems` lists everything wrong with it."""

    def __init__(self, origin: str, problems: list[Problem]):
        self.origin, self.problems = origin, tuple(problems)
        super().__init__("\n".join([f"{origin}: {len(problems)} problem{'s' * (len(problems) > 1)}",
                                    *(f"  {problem}" for problem in problems)]))

    def __reduce__(self):
        return type(self), (self.origin, list(self.problems))


def catalogue() -> list[str]:
    """Names of the scenes that come with the suite."""
    folder = resources.files("scenes") / "catalogue"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_scene(name_or_path: str | Path, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Read a scene from the catalogue (by name) or from a TOML file (by path).

    Parameters
    ----------
    name_or_path
        A name of the catalogue such as ``"slider-bar-case-1"``, or a path.
    overrides
        Values that replace those of the file, by key: a parameter (``"F0"``), an element's
        number (``"motor.rate"``, ``"guide.mu"``) or a full path (``"bodies.bar.mass"``).

    Raises
    ------
    SceneError
        With all problems of the file at once.
    """
    path = Path(name_or_path)
    if str(name_or_path) in catalogue():
        path = Path(str(resources.files("scenes") / "catalogue" / f"{name_or_path}.toml"))
    origin = str(name_or_path)
    if not path.is_file():
        raise SceneError(origin, [Problem("scene", repr(origin),
                                          "expected a TOML file or one of: " + ", ".join(catalogue()))])
    if path.stat().st_size > MAX_FILE_SIZE:
        raise SceneError(origin, [Problem("file", f"{path.stat().st_size} bytes", f"expected at most {MAX_FILE_SIZE}")])
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(origin, [Problem("file", str(error), "expected TOML in UTF-8")]) from None
    return scene_from_dict(raw, origin, overrides, name=path.stem)


def scene_from_dict(raw: Mapping[str, Any], origin: str = "<scene>",
                    overrides: Mapping[str, Any] | None = None, name: str | None = None) -> Scene:
    """A scene from nested dictionaries, as a TOML file would give them; see `load_scene`."""
    raw = copy.deepcopy(dict(raw))
    problems = [problem for key, value in (overrides or {}).items() if (problem := _override(raw, key, value))]
    if problems:
        raise SceneError(origin, problems)
    parameters, problems = _parameters(raw.get("parameters", {}))
    try:
        scene = Scene.model_validate(raw, context=parameters)
    except ValidationError as error:
        problems += [_problem(detail) for detail in error.errors()]
        raise SceneError(origin, problems) from None
    problems += _reference_problems(scene)
    if problems:
        raise SceneError(origin, problems)
    scene._raw, scene._origin, scene._name = raw, origin, name or origin
    return scene


def vary(scene: Scene, overrides: Mapping[str, Any]) -> Scene:
    """The scene with some of its values replaced; keys as in `load_scene`."""
    return scene_from_dict(scene._raw, scene._origin, overrides, scene._name)


def _parameters(table: Any) -> tuple[dict[str, float], list[Problem]]:
    """Parameters in order of appearance; each may use those before it."""
    values: dict[str, float] = {}
    problems = []
    for key, value in (table.items() if isinstance(table, dict) else ()):
        try:
            values[key] = evaluate(value, values)
        except ValueError as error:
            problems.append(Problem(f"parameters.{key}", repr(value), str(error)))
            values[key] = 1.0
    return values, problems


def _override(raw: dict, key: str, value: Any) -> Problem | None:
    """Put `value` at `key` of the raw tables; a problem if there is no such place."""
    parts = key.split(".")
    if len(parts) == 1 and key in raw.get("parameters", {}):
        raw["parameters"][key] = value
        return None
    owner = next((section for section in SECTIONS if parts[0] in raw.get(section, {})), None)
    if owner is not None:
        element = raw[owner][parts[0]]
        law = element.get("law") if isinstance(element, dict) else None
        if len(parts) == 2 and isinstance(law, dict) and parts[1] in {*law, "offset", "phase"} - {"type"} \
                and parts[1] not in element:
            parts = [parts[0], "law", parts[1]]
        parts = [owner, *parts]
    place: Any = raw
    for part in parts[:-1]:
        if isinstance(place, dict) and part in place:
            place = place[part]
        elif isinstance(place, list) and part.isdigit() and int(part) < len(place):
            place = place[int(part)]
        else:
            place = None
            break
    last = parts[-1]
    if len(parts) > 1 and isinstance(place, dict):
        place[last] = value
    elif isinstance(place, list) and last.isdigit() and int(last) < len(place):
        place[int(last)] = value
    elif len(parts) == 1 and key in Scene.model_fields:
        raw[key] = value
    else:
        names = [*raw.get("parameters", {}), *(f"{name}.*" for section in SECTIONS for name in raw.get(section, {}))]
        return Problem(key, "no such value in the scene", "expected one of: " + ", ".join(names))
    return None


_TAGS = {"revolute", "translational", "constant", "linear", "sine", "table", "torsional", "force", "torque",
         "baumgarte", "projection", "none"}


def _problem(detail: Mapping[str, Any]) -> Problem:
    """A pydantic error in the terms of the file."""
    location = [str(part) for part in detail["loc"]]
    key = ".".join(part for i, part in enumerate(location) if not (i and part in _TAGS and i >= 1)) or "scene"
    found = "" if detail["type"] == "missing" else repr(detail.get("input"))
    found = found if len(found) <= 120 else found[:117] + "..."
    message = detail["msg"].removeprefix("Value error, ")
    expected = {"missing": "missing; this key is required",
                "extra_forbidden": "unknown key here; expected one that the element has"}.get(detail["type"], message)
    return Problem(key, found, expected)


def _reference_problems(scene: Scene) -> list[Problem]:
    """Names used twice, and references to bodies that do not exist or to one body twice."""
    problems = []
    seen: dict[str, str] = {}
    for section in SECTIONS:
        for name in getattr(scene, section):
            key = f"{section}.{name}"
            if name == GROUND:
                problems.append(Problem(key, repr(GROUND), "this name means the fixed body; expected another"))
            if name in seen:
                problems.append(Problem(key, f"also {seen[name]}", "expected a name of its own for every element"))
            seen.setdefault(name, key)
    known = ", ".join([*scene.bodies, GROUND])

    def check(key: str, names: tuple[str, ...], ground_allowed: bool = True) -> None:
        for name in names:
            if name not in scene.bodies and not (ground_allowed and name == GROUND):
                problems.append(Problem(key, repr(name), f"expected a body of the scene: {known}"))
        if len(names) == 2 and names[0] == names[1]:
            problems.append(Problem(key, f"{names[0]!r} twice", "expected two different bodies"))

    for section in ("joints", "drives", "springs"):
        for name, element in getattr(scene, section).items():
            check(f"{section}.{name}.bodies", element.bodies)
    for name, guide in scene.guides.items():
        check(f"joints.{name}.slider", (guide.slider,), ground_allowed=False)
    for name, load in scene.forces.items():
        check(f"forces.{name}.body", (load.body,), ground_allowed=False)
    return problems
