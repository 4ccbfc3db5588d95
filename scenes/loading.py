"""Scenes from TOML files, from the catalogue and from dictionaries, and back; all errors at once."""

from __future__ import annotations

import keyword
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib import resources
from itertools import chain
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from stiction.scenes.base_errors import InputError
from stiction.scenes.errors import ELEMENTS, Problem, SceneError, problems_of
from stiction.scenes.expressions import CONSTANTS, FUNCTIONS, evaluate
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Scene
from stiction.scenes.overrides import flattened, override
from stiction.scenes.wording import did_you_mean, names, shortened, shown

MAX_FILE_SIZE = 4 * 2**20
"""Bytes; a larger file is refused unread (10 000 bodies with a joint each take 2 MB)."""
MAX_DEPTH = 10
"""Tables and lists within each other; a scene needs 5."""
_EXPECTED_NAME = (
    "expected a letter of a-z or A-Z, then such letters, digits or _, "
    "and no word of arithmetic or of Python"
)
_BASED_KEYS = ("base", "title", "source", "set", "unset")
_QUOTED = re.compile(r"""(?sx) \"{3} (?: \\. | [^\\] )*? (?: \"{3} | \Z )  |  '{3} .*? (?: '{3} | \Z )
                         | " (?: \\. | [^"\\\n] )*+ "?  |  ' [^'\n]*+ '?  |  \# [^\n]*+""")
_DEEP_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{MAX_DEPTH}}}")


def catalogue(folder: str = "") -> list[str]:
    """Names of the scenes of the suite; those of a folder of the catalogue, such as ``"hard"``, start with it."""
    return [name for name in _catalogue_files() if name.rpartition("/")[0] == folder]


@cache
def _catalogue_files() -> dict[str, Path]:
    """Files by name, listed once: a table asks for each of its rows."""
    folder = Path(str(resources.files("stiction.scenes") / "catalogue"))
    return {
        path.relative_to(folder).with_suffix("").as_posix(): path
        for path in sorted(folder.rglob("*.toml"))
    }


def scene_text(name: str) -> str:
    """The text of a scene's file in the catalogue, comments included; SceneError if it has none of this name."""
    files = _catalogue_files()
    if name not in files:
        raise SceneError("catalogue", [Problem("scene", shown(name), _expected_scene(name, files))])
    return files[name].read_text(encoding="utf-8")


def _expected_scene(name: str, known: Iterable[str]) -> str:
    return f"expected one of: {names(catalogue())}, or of hard/{did_you_mean(name, known)}"


def new_scene_text() -> str:
    """The text of a small scene with friction to begin with, whose comments explain the format."""
    return (resources.files("stiction.scenes") / "new.toml").read_text(encoding="utf-8")


def load_scene(name_or_path: str | Path, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Read a scene from the catalogue (by name) or from a TOML file (by path).

    A file may describe a scene by its differences from another one: ``base`` names a scene of the catalogue or a file
    (relative to this one), ``set`` contains overrides, and ``unset`` lists keys to remove.

    Parameters
    ----------
    name_or_path
        The name of a scene of the catalogue, such as ``"slider-bar-case-1"``, or the path of a TOML file.
    overrides
        Values that replace those of the file, by key: a parameter (``"F0"``), a key of an element
        (``"motor.rate"``, ``"guide.mu"``, ``"bar.position.0"``) or a full path (``"bodies.bar.mass"``,
        ``"gravity.1"``). The value None removes the key.

    Returns
    -------
    Scene
        The validated scene; all quantities are in SI units, angles in radians.

    Raises
    ------
    SceneError
        If the scene cannot be used. The message lists all problems of the file.
    """
    origin = str(name_or_path)
    return scene_from_dict(_read(origin, Path(), ()), origin, overrides, Path(origin).stem)


def scene_from_dict(
    raw: Mapping[str, Any],
    origin: str = "<scene>",
    overrides: Mapping[str, Any] | None = None,
    name: str | None = None,
) -> Scene:
    """Create a scene from nested dictionaries with the structure of a TOML file.

    Parameters
    ----------
    raw
        The tables of the scene. Keys whose value is None are ignored. NumPy arrays and scalars are accepted.
    origin
        What error messages call the scene, such as a file name.
    overrides
        Values that replace those of `raw`, by key, as in `load_scene`.
    name
        The name of the scene; `origin` if None.

    Returns
    -------
    Scene
        The validated scene.

    Raises
    ------
    SceneError
        If the scene cannot be used. The message lists all problems.
    """
    plain: dict[str, Any] = _plain(raw, origin)
    _apply(plain, overrides or {}, origin)
    parameters: dict[str, float] = {}
    problems: list[Problem] = []
    invalid: Iterator[Problem] = iter(())
    # Parameters first, as all other numbers may use them. Problems of all kinds are collected: a
    # file with several faults is mended at once.
    tables = plain
    if isinstance(plain.get("parameters"), dict):
        parameters, problems = _parameters(plain["parameters"])
        tables = plain | {"parameters": parameters}
    try:
        scene = Scene.model_validate(tables, context=parameters)
    except ValidationError as error:
        invalid = problems_of(error, Scene)
    wrong = chain(problems, invalid, _reference_problems(plain))
    if (first := next(wrong, None)) is not None:
        raise SceneError(origin, chain([first], wrong))
    scene._raw, scene._origin, scene._name = plain, origin, name or origin
    return scene


def vary(scene: Scene, overrides: Mapping[str, Any]) -> Scene:
    """Return the scene with values replaced or, where they are None, removed; keys as in `load_scene`."""
    return scene_from_dict(tables_of(scene), scene._origin, overrides, scene._name)


def tables_of(scene: Scene) -> dict[str, Any]:
    """Return the scene as `scene_from_dict` takes it: as it was written, or of one made in Python its values."""
    return scene._raw or scene.model_dump(mode="json", exclude_none=True)


def scene_to_toml(scene: Scene) -> str:
    """Return the scene as the text of a TOML file, with its parameters and arithmetic expressions.

    Parameters
    ----------
    scene
        A scene.

    Returns
    -------
    str
        TOML. Loading it gives an equal scene.
    """
    return tomli_w.dumps(tables_of(scene))


def _read(name_or_path: str, folder: Path, derived: tuple[Path, ...]) -> dict[str, Any]:
    """Read the tables of a file, those of its base included; `derived` holds the files that have led to this one."""
    files = _catalogue_files()
    asked_by, key = (str(derived[-1]), "base") if derived else (name_or_path, "scene")
    try:
        path = files.get(name_or_path, folder / name_or_path).resolve()
        if path.is_file():
            kind = ""
        else:
            kind = "a folder" if path.is_dir() else "no such file"
    except (OSError, ValueError) as error:  # a name too long, a null byte
        path, kind = Path(), str(error)
    if kind:
        near = sorted(file.name for file in folder.glob("*.toml"))
        expected = _expected_scene(name_or_path, [*files, *near]).replace(
            "expected", "expected a TOML file or", 1
        )
        raise SceneError(
            asked_by, [Problem(key, f"{shown(name_or_path)} ({shortened(kind)})", expected)]
        )
    if path in derived:
        raise SceneError(
            asked_by,
            [
                Problem(
                    key,
                    " -> ".join(file.stem for file in (*derived, path)),
                    "expected a base that does not lead back",
                )
            ],
        )
    raw = read_toml(path, name_or_path)
    return _based(raw, name_or_path, path, derived) if "base" in raw else raw


def read_toml(path: Path, origin: str) -> dict[str, Any]:
    """The tables of one file; raises SceneError for one that cannot be read."""
    try:
        if (size := path.stat().st_size) > MAX_FILE_SIZE:
            raise SceneError(
                origin, [Problem("file", f"{size} bytes", f"expected at most {MAX_FILE_SIZE}")]
            )
        text = path.read_text(encoding="utf-8-sig")
        if _DEEP_KEY.search(_QUOTED.sub("s", text)):
            # tomllib would take hours over a key of 100 000 parts
            raise RecursionError
        return _plain(tomllib.loads(text), origin)
    except SceneError:
        raise
    except OSError as error:
        found, expected = str(error.strerror), "expected a file that can be read"
    except UnicodeDecodeError as error:
        found, expected = f"byte {error.start} that is not UTF-8", "expected TOML in UTF-8"
    except RecursionError:
        found, expected = _TOO_DEEP
    except tomllib.TOMLDecodeError as error:
        found, expected = shortened(str(error), 160), "expected TOML (toml.io)"
        if not _QUOTED.sub("", text).isascii():
            # outside of texts and comments there are keys and numbers only
            expected += ", in which names have no letters but a-z and A-Z"
    except ValueError:  # Python's, of tomllib's call of int()
        found, expected = "an integer of thousands of digits", "expected numbers below 1.8e308"
    raise SceneError(origin, [Problem("file", found, expected)])


def _based(
    raw: dict[str, Any], origin: str, path: Path, derived: tuple[Path, ...]
) -> dict[str, Any]:
    """The tables of the base of a file with the changes that the file makes."""
    problems = [
        Problem(
            key, shown(raw[key]), "unknown key beside base; expected one of: " + names(_BASED_KEYS)
        )
        for key in raw
        if key not in _BASED_KEYS
    ]
    unset = raw.get("unset", [])
    if not isinstance(raw["base"], str):
        problems.append(Problem("base", shown(raw["base"]), "expected the name or path of a scene"))
    if not isinstance(raw.get("set", {}), dict):
        problems.append(Problem("set", shown(raw["set"]), "expected a table of keys and values"))
    if not (isinstance(unset, list) and all(isinstance(key, str) for key in unset)):
        problems.append(Problem("unset", shown(unset), "expected a list of keys"))
    if problems:
        raise SceneError(origin, problems)
    tables = _read(raw["base"], path.parent, (*derived, path))
    tables |= {key: raw[key] for key in ("title", "source") if key in raw}
    _apply(tables, dict.fromkeys(unset) | flattened(raw.get("set", {})), origin)
    return tables


def _apply(raw: dict[str, Any], changes: Mapping[str, Any], origin: str) -> None:
    """Make overrides in a scene's tables."""
    problems = [
        problem
        for key, value in changes.items()
        if (problem := override(raw, str(key), None if value is None else _plain(value, origin)))
    ]
    if problems:
        raise SceneError(origin, problems)


_TOO_DEEP = "lists or tables nested too deep", f"expected at most {MAX_DEPTH} levels"


def _plain(value: Any, origin: str, depth: int = 0) -> Any:
    """A copy in the types that TOML has; numbers and sequences of other libraries become Python's own."""
    if depth > MAX_DEPTH:
        raise SceneError(origin, [Problem("file", *_TOO_DEEP)])
    if type(value) in (str, float, int, bool):
        return value
    if isinstance(value, Mapping):
        return {
            str(key): _plain(item, origin, depth + 1)
            for key, item in value.items()
            if item is not None
        }
    if hasattr(value, "tolist"):  # numpy's arrays and scalars
        return _plain(value.tolist(), origin, depth + 1)
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return [_plain(item, origin, depth + 1) for item in value]
    return value


def _parameters(table: Mapping[str, Any]) -> tuple[dict[str, float], list[Problem]]:
    """Evaluate parameters in order of appearance; each may use those before it. A wrong one counts as 1 after that."""
    values: dict[str, float] = {}
    problems = []
    for key, value in table.items():
        reserved = keyword.iskeyword(key) or key in CONSTANTS or key in FUNCTIONS
        if reserved or not re.fullmatch("[A-Za-z][A-Za-z0-9_]{0,59}", key):
            problems.append(Problem("parameters", f"the name {shown(key)}", _EXPECTED_NAME))
            continue
        try:
            values[key] = evaluate(value, values)
        except InputError as error:
            above = " (a parameter may use those above it)" if "unknown name" in str(error) else ""
            problems.append(Problem(f"parameters.{key}", shown(value), f"{error}{above}"))
            values[key] = 1.0
    return values, problems


def _reference_problems(raw: Mapping[str, Any]) -> Iterator[Problem]:
    """Names used twice, and references to bodies that are not there or to one body twice, whatever else is wrong."""
    sections = {
        section: table for section in ELEMENTS if isinstance(table := raw.get(section), dict)
    }
    bodies = sections.get("bodies", {})
    names_of_bodies = names([*bodies, GROUND])
    seen: dict[str, str] = {}
    for section, table in sections.items():
        for name, element in table.items():
            key = f"{section}.{shortened(name)}"
            if name == GROUND:
                yield Problem(
                    key, f"'{GROUND}'", "expected another name; this one means the fixed body"
                )
            if name in seen:
                yield Problem(
                    key, f"the name of {seen[name]}", "expected a name of its own for every element"
                )
            seen.setdefault(name, key)
            if not isinstance(element, dict):
                continue
            # Everything in the element that names a body.
            bodies_given = element.get("bodies")
            pair: list[Any] = bodies_given if isinstance(bodies_given, list) else []
            for field, body in [
                *((field, element.get(field)) for field in ("slider", "guide", "body")),
                *((f"bodies.{i}", body) for i, body in enumerate(pair)),
            ]:
                if body == GROUND and field in ("slider", "body"):
                    yield Problem(f"{key}.{field}", f"'{GROUND}'", "expected a body that can move")
                elif isinstance(body, str) and body not in bodies and body != GROUND:
                    yield Problem(
                        f"{key}.{field}",
                        shown(body),
                        f"expected a body of the scene: {names_of_bodies}{did_you_mean(body, bodies)}",
                    )
            # a slider on its own guide, or a joint of a body with itself
            if element.get("type") == "translational":
                pair = [element.get("slider"), element.get("guide", GROUND)]
            if len(pair) == 2 and pair[0] == pair[1] and isinstance(pair[0], str):
                yield Problem(key, f"{shown(pair[0])} twice", "expected two different bodies")
