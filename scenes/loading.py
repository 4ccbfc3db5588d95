"""Scenes from TOML files, from the catalogue and from dictionaries, and back; all errors at once."""

from __future__ import annotations

import keyword
import numbers
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from scenes.errors import ELEMENTS, Problem, SceneError, did_you_mean, names, problems_of, shown
from scenes.expressions import CONSTANTS, FUNCTIONS, evaluate
from scenes.fields import GROUND
from scenes.model import Scene
from scenes.overrides import flattened, override

MAX_FILE_SIZE = 8 * 2 ** 20
"""Bytes; a larger file is refused unread (10 000 bodies with a joint each take 3 MB)."""
MAX_DEPTH = 10
"""Tables and lists within each other; a scene needs 5."""
_BASED_KEYS = ("base", "title", "source", "set", "unset")


def catalogue() -> list[str]:
    """Names of the scenes that come with the suite."""
    return sorted(_catalogue_files())


def _catalogue_files() -> dict[str, Path]:
    folder = Path(str(resources.files("scenes") / "catalogue"))
    return {path.stem: path for path in folder.glob("*.toml")}


def load_scene(name_or_path: str | Path, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Read a scene from the catalogue (by name) or from a TOML file (by path).

    A file may be another scene with a few changes: ``base`` names a scene of the catalogue or a file
    (relative to this one), ``set`` holds overrides, ``unset`` lists keys to remove.

    Parameters
    ----------
    name_or_path
        A name of the catalogue such as ``"slider-bar-case-1"``, or a path.
    overrides
        Values that replace those of the file, by key: a parameter (``"F0"``), an element's key
        (``"motor.rate"``, ``"guide.mu"``, ``"bar.position.0"``) or a full path
        (``"bodies.bar.mass"``, ``"gravity.1"``). None removes what is there.

    Raises
    ------
    SceneError
        With all problems of the file at once.
    """
    return scene_from_dict(_read(name_or_path, Path(), ()), str(name_or_path), overrides, Path(name_or_path).stem)


def scene_from_dict(raw: Mapping[str, Any], origin: str = "<scene>",
                    overrides: Mapping[str, Any] | None = None, name: str | None = None) -> Scene:
    """A scene from nested dictionaries, as a TOML file would give them; see `load_scene`. None means absent."""
    raw = _plain(raw, origin)
    problems = [problem for key, value in _plain(overrides or {}, "overrides", keep_none=True).items()
                if (problem := override(raw, key, value))]
    if problems:
        raise SceneError(origin, problems)
    evaluated = dict(raw)
    parameters: dict[str, float] = {}
    if isinstance(raw.get("parameters"), dict):
        parameters, problems = _parameters(raw["parameters"])
        evaluated["parameters"] = parameters
    try:
        scene = Scene.model_validate(evaluated, context=parameters)
    except ValidationError as error:
        problems += problems_of(error)
    problems += _reference_problems(raw)
    if problems:
        raise SceneError(origin, problems)
    scene._raw, scene._origin, scene._name = raw, origin, name or origin
    return scene


def vary(scene: Scene, overrides: Mapping[str, Any]) -> Scene:
    """The scene with some of its values replaced or, where they are None, removed; keys as in `load_scene`."""
    return scene_from_dict(scene._raw, scene._origin, overrides, scene._name)


def scene_to_toml(scene: Scene) -> str:
    """The scene as the text of a file, parameters and arithmetic included; loading it gives an equal scene."""
    return tomli_w.dumps(scene._raw)


def _read(name_or_path: str | Path, folder: Path, chain: tuple[Path, ...]) -> dict[str, Any]:
    """The tables of a file, those of its base included; `chain` holds the files that led here."""
    origin = str(name_or_path)
    known = _catalogue_files()

    def error(key: str, found: str, expected: str) -> SceneError:
        return SceneError(str(chain[-1]) if chain and key == "base" else origin, [Problem(key, found, expected)])

    try:
        path = known.get(origin, folder / origin).resolve()
        if not path.is_file():
            found = f"{shown(origin)}, a folder" if path.is_dir() else shown(origin)
            raise error("base" if chain else "scene", found, "expected a TOML file or a scene of the catalogue: "
                        + ", ".join(known) + did_you_mean(origin, known))
        if path in chain:
            raise error("base", " -> ".join(p.stem for p in (*chain, path)), "expected a base that does not lead back")
        size = path.stat().st_size
        if size > MAX_FILE_SIZE:
            raise error("file", f"{size} bytes", f"expected at most {MAX_FILE_SIZE}")
        raw = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as reason:
        raise error("file", shown(reason.strerror), "expected a readable file") from None
    except UnicodeDecodeError as reason:
        raise error("file", f"byte {reason.start} that is not UTF-8", "expected TOML in UTF-8") from None
    except RecursionError:
        raise error("file", "lists or tables nested too deep", f"expected at most {MAX_DEPTH} levels") from None
    except SceneError:
        raise
    except ValueError as reason:  # tomllib's, int()'s about digits, pathlib's about null bytes
        raise error("file", f"{reason}", "expected TOML (toml.io)") from None
    return _based(_plain(raw, origin), origin, path, chain) if "base" in raw else raw


def _based(raw: dict[str, Any], origin: str, path: Path, chain: tuple[Path, ...]) -> dict[str, Any]:
    """The tables of a base with the changes of a file that has one."""
    problems = [Problem(key, shown(raw[key]), "unknown key beside base; expected one of: " + names(_BASED_KEYS))
                for key in raw if key not in _BASED_KEYS]
    for key, kind, expected in (("base", str, "the name or path of a scene"), ("set", dict, "a table of keys and values"),
                                ("unset", list, "a list of keys")):
        if not isinstance(raw.get(key, kind()), kind) or key == "unset" and any(not isinstance(k, str) for k in raw.get(key, ())):
            problems.append(Problem(key, shown(raw[key]), f"expected {expected}"))
    if problems:
        raise SceneError(origin, problems)
    tables = _plain(_read(raw["base"], path.parent, (*chain, path)), origin)
    tables |= {key: raw[key] for key in ("title", "source") if key in raw}
    changes = {key: None for key in raw.get("unset", ())} | flattened(raw.get("set", {}))
    problems = [problem for key, value in changes.items() if (problem := override(tables, key, value))]
    if problems:
        raise SceneError(origin, problems)
    return tables


def _plain(value: Any, origin: str, depth: int = 0, keep_none: bool = False) -> Any:
    """A copy in the types that TOML has; numbers and sequences of other libraries become Python's own."""
    if depth > MAX_DEPTH:
        raise SceneError(origin, [Problem("file", "lists or tables nested too deep",
                                          f"expected at most {MAX_DEPTH} levels")])
    if isinstance(value, Mapping):
        return {key: _plain(item, origin, depth + 1) for key, item in value.items() if item is not None or keep_none}
    if hasattr(value, "tolist"):  # numpy's arrays and scalars
        return _plain(value.tolist(), origin, depth + 1)
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return [_plain(item, origin, depth + 1) for item in value]
    return value


def _parameters(table: Mapping[str, Any]) -> tuple[dict[str, float], list[Problem]]:
    """Parameters in order of appearance; each may use those before it. A wrong one counts as 1 from there on."""
    values: dict[str, float] = {}
    problems = []
    for key, value in table.items():
        if not (isinstance(key, str) and key.isidentifier() and key.isascii()) or keyword.iskeyword(key) \
                or key in CONSTANTS or key in FUNCTIONS:
            problems.append(Problem("parameters", f"the name {shown(key)}", "expected letters, digits and _, and not a "
                                    "word of arithmetic or of Python"))
        try:
            values[key] = evaluate(value, values)
        except ValueError as error:
            problems.append(Problem(f"parameters.{key}", shown(value), f"{error} (a parameter may use those above it)"
                                    if "unknown name" in str(error) else str(error)))
            values[key] = 1.0
    return values, problems


def _reference_problems(raw: Mapping[str, Any]) -> list[Problem]:
    """Names used twice, and references to bodies that do not exist or to one body twice.

    Of the tables as they are in the file, whatever else may be wrong with them.
    """
    problems: list[Problem] = []
    sections = {section: table for section in ELEMENTS if isinstance(table := raw.get(section), dict)}
    bodies = sections.get("bodies", {})
    known = f"expected a body of the scene: {names([*bodies, GROUND])}"
    seen: dict[str, str] = {}

    def check(key: str, name: Any, ground_allowed: bool) -> None:
        if name == GROUND and not ground_allowed:
            problems.append(Problem(key, repr(GROUND), "expected a body that can move"))
        elif isinstance(name, str) and name not in bodies and name != GROUND:
            problems.append(Problem(key, shown(name), known + did_you_mean(name, bodies)))

    for section, table in sections.items():
        for name, element in table.items():
            key = f"{section}.{name}"
            if name == GROUND:
                problems.append(Problem(key, repr(GROUND), "expected another name; this one means the fixed body"))
            if name in seen:
                problems.append(Problem(key, f"the name of {seen[name]}", "expected a name of its own for every element"))
            seen.setdefault(name, key)
            if not isinstance(element, dict):
                continue
            for field, ground_allowed in (("slider", False), ("guide", True), ("body", False)):
                check(f"{key}.{field}", element.get(field), ground_allowed)
            pair = element.get("bodies")
            for i, body in enumerate(pair if isinstance(pair, list) else ()):
                check(f"{key}.bodies.{i}", body, ground_allowed=True)
            if element.get("type") == "translational":
                pair = [element.get("slider"), element.get("guide", GROUND)]
            if isinstance(pair, list) and len(pair) == 2 and pair[0] == pair[1] and isinstance(pair[0], str):
                problems.append(Problem(key, f"{shown(pair[0])} twice", "expected two different bodies"))
    return problems
