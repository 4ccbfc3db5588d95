"""Reading and writing of scenes: TOML files, the catalogue, and dictionaries.

All problems of a scene are reported in one error, so that a file with several of them is corrected at once.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from stiction.scenes.checking import MAX_DEPTH, TOO_DEEP, checked, plain_tables, to_toml_types
from stiction.scenes.errors import Problem, SceneError
from stiction.scenes.model import Scene
from stiction.scenes.overrides import flattened, override
from stiction.scenes.wording import did_you_mean, names, shortened, shown

MAX_FILE_SIZE = 4 * 2**20
"""Largest size of a scene file, bytes; 10 000 bodies with a joint each take 2 MB."""
_MAX_SYNTAX_ERROR = 160
"""Characters of the TOML parser's message that are shown: more than its usual messages have."""
_LINE_OF_SYNTAX_ERROR = re.compile(r"\(at line (\d+), column \d+\)\Z")
"""Place at the end of the TOML parser's message; the error has it as an attribute only since Python 3.14."""
_QUOTING_RULE = (
    "texts are in quotes, and so are keys with characters other than a-z, A-Z, 0-9, _ and -"
)
"""What is most often wrong in a file that is no TOML."""
_DERIVED_KEYS = ("base", "title", "source", "set", "unset")
"""Keys of a file that describes a scene by its differences from a base."""
# Texts of all four kinds, and comments, closed or not. Possessive quantifiers keep the search
# linear in the size of a hostile file.
_QUOTED = re.compile(r"""(?sx) \"{3} (?: \\. | [^\\] )*? (?: \"{3} | \Z )  |  '{3} .*? (?: '{3} | \Z )
                         | " (?: \\. | [^"\\\n] )*+ "?  |  ' [^'\n]*+ '?  |  \# [^\n]*+""")
# A dotted key with more than MAX_DEPTH parts.
_DEEP_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{MAX_DEPTH}}}")


def catalogue(folder: str = "") -> list[str]:
    """Return the names of the scenes of the catalogue.

    Parameters
    ----------
    folder
        A folder of the catalogue, such as ``"hard"``. The names of its scenes begin with it: ``"hard/.."``.
    """
    return [name for name in _catalogue_files() if name.rpartition("/")[0] == folder]


@cache
def _catalogue_files() -> dict[str, Path]:
    """Return the files of the catalogue by name; cached, since tables call it for each row."""
    folder = Path(str(resources.files("stiction.scenes") / "catalogue"))
    return {
        path.relative_to(folder).with_suffix("").as_posix(): path
        for path in sorted(folder.rglob("*.toml"))
    }


def scene_text(name: str) -> str:
    """Return the text of a file of the catalogue, with its comments.

    Raises
    ------
    SceneError
        If the catalogue has no scene of this name.
    """
    files = _catalogue_files()
    if name not in files:
        raise SceneError("catalogue", [Problem("scene", shown(name), _expected_scene(name, files))])
    return files[name].read_text(encoding="utf-8")


def _expected_scene(name: str, scene_names: Iterable[str]) -> str:
    """Return the message for an unknown scene; the names are those that `name` may be a misspelling of."""
    return f"expected one of: {names(catalogue())}, or of hard/{did_you_mean(name, scene_names)}"


def new_scene_text() -> str:
    """Return the text of a small scene with friction, whose comments explain the format."""
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
    plain = plain_tables(raw, origin)
    _apply_overrides(plain, overrides or {}, origin)

    def validate(tables: dict[str, Any], parameters: dict[str, float]) -> Scene:
        return Scene.model_validate(tables, context=parameters)

    scene = checked(plain, origin, validate)
    scene._raw = plain
    scene._origin = origin
    scene._name = name or origin
    return scene


def vary(scene: Scene, overrides: Mapping[str, Any]) -> Scene:
    """Return a scene with some values replaced.

    Parameters
    ----------
    scene
        The original scene, which does not change.
    overrides
        New values by key, as in `load_scene`; the value None removes the key.

    Raises
    ------
    SceneError
        If there is no such key, or if the new scene cannot be used.
    """
    return scene_from_dict(scene._raw, scene._origin, overrides, scene._name)


def _read(name_or_path: str, folder: Path, derived: tuple[Path, ...]) -> dict[str, Any]:
    """Read the tables of a scene, and merge them with those of its base.

    Parameters
    ----------
    name_or_path
        The name of a scene of the catalogue, or the path of a file relative to `folder`.
    folder
        The folder of the file that names this one as its base, or the working directory.
    derived
        The files that led here: each names the next one as its base, and the last one names this scene.
    """
    files = _catalogue_files()
    # A problem is reported for the file that names this one, or for the name that the user gave.
    referrer, key = name_or_path, "scene"
    if derived:
        referrer, key = str(derived[-1]), "base"
    path = Path()
    failure = ""
    try:
        path = files.get(name_or_path, folder / name_or_path).resolve()
        if path.is_dir():
            failure = "a folder"
        elif not path.is_file():
            failure = "no such file"
    except (OSError, ValueError) as error:
        # The name is too long, or contains a null byte.
        failure = str(error)
    if failure:
        neighbours = sorted(file.name for file in folder.glob("*.toml"))
        expected = _expected_scene(name_or_path, [*files, *neighbours]).replace(
            "expected", "expected a TOML file or", 1
        )
        found = f"{shown(name_or_path)} ({shortened(failure)})"
        raise SceneError(referrer, [Problem(key, found, expected)])
    if path in derived:
        cycle = " -> ".join(file.stem for file in (*derived, path))
        raise SceneError(referrer, [Problem(key, cycle, "expected a base that does not lead back")])
    raw = read_toml(path, name_or_path)
    if "base" in raw:
        return _merge_with_base(raw, name_or_path, path, derived)
    return raw


def read_toml(path: Path, origin: str) -> dict[str, Any]:
    """Read the tables of one file.

    Parameters
    ----------
    path
        The file.
    origin
        What error messages call it.

    Raises
    ------
    SceneError
        If it cannot be read, is too large, or is not TOML.
    """
    try:
        size = path.stat().st_size
        if size > MAX_FILE_SIZE:
            raise SceneError(
                origin, [Problem("file", f"{size} bytes", f"expected at most {MAX_FILE_SIZE}")]
            )
        text = path.read_text(encoding="utf-8-sig")
        # The time that tomllib takes for a dotted key grows with the square of the number of its
        # parts: hours for 100 000 of them. Such keys are refused before.
        if _DEEP_KEY.search(_QUOTED.sub("s", text)):
            raise RecursionError
        return to_toml_types(tomllib.loads(text), origin)
    except SceneError:
        raise
    except OSError as error:
        found, expected = str(error.strerror), "expected a file that can be read"
    except UnicodeDecodeError as error:
        found, expected = f"byte {error.start} that is not UTF-8", "expected TOML in UTF-8"
    except RecursionError:
        found, expected = TOO_DEEP
    except tomllib.TOMLDecodeError as error:
        found = shortened(str(error), _MAX_SYNTAX_ERROR) + _wrong_line(str(error), text)
        expected = f"expected TOML (toml.io): {_QUOTING_RULE}"
    except ValueError:
        # tomllib passes on the error of int(), which refuses texts of thousands of digits.
        found, expected = "an integer of thousands of digits", "expected numbers below 1.8e308"
    raise SceneError(origin, [Problem("file", found, expected)])


def _wrong_line(message: str, text: str) -> str:
    """Return the words for the line of a text that the TOML parser's message names; empty if it names none."""
    place = _LINE_OF_SYNTAX_ERROR.search(message)
    if place is None:
        return ""
    # The parser counts only line feeds; other characters that end lines for `splitlines` may be in texts.
    line = text.split("\n")[int(place[1]) - 1]
    return f", in the line {shown(line.strip())}"


def _merge_with_base(
    raw: dict[str, Any], origin: str, path: Path, derived: tuple[Path, ...]
) -> dict[str, Any]:
    """Return the tables of the base of a file, with the changes that the file declares.

    `raw` holds the tables of the file at `path`; `derived` is as in `_read`.
    """
    expected_keys = "unknown key beside base; expected one of: " + names(_DERIVED_KEYS)
    problems = [
        Problem(key, shown(raw[key]), expected_keys) for key in raw if key not in _DERIVED_KEYS
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
    _apply_overrides(tables, dict.fromkeys(unset) | flattened(raw.get("set", {})), origin)
    return tables


def _apply_overrides(raw: dict[str, Any], overrides: Mapping[str, Any], origin: str) -> None:
    """Replace or remove values in the tables of a scene, in place; keys as in `load_scene`."""
    problems = []
    for key, value in overrides.items():
        plain = None if value is None else to_toml_types(value, origin)
        problem = override(raw, str(key), plain)
        if problem is not None:
            problems.append(problem)
    if problems:
        raise SceneError(origin, problems)
