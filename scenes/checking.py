"""Checks of a scene's tables: values, parameters, and references between elements.

All problems are reported in one error, so that a scene with several of them is corrected at once.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from pydantic import ValidationError

from stiction.scenes.base_errors import InputError
from stiction.scenes.errors import ELEMENTS, Problem, SceneError, problems_of
from stiction.scenes.expressions import CONSTANTS, FUNCTIONS, evaluate
from stiction.scenes.fields import GROUND, Part
from stiction.scenes.model import Scene
from stiction.scenes.wording import did_you_mean, names, shortened, shown

MAX_DEPTH = 10
"""Largest number of nested tables and lists; a scene needs 5."""
TOO_DEEP = "lists or tables nested too deep", f"expected at most {MAX_DEPTH} levels"
"""The value found, and what was expected, where a scene has more levels."""
_EXPECTED_NAME = (
    "expected a letter of a-z or A-Z, then such letters, digits or _, "
    "and no word of arithmetic or of Python"
)


def checked(
    tables: Mapping[str, Any],
    origin: str,
    validate: Callable[[dict[str, Any], dict[str, float]], Scene],
) -> Scene:
    """Return the scene that the tables describe.

    Parameters
    ----------
    tables
        The tables of the scene in the types of TOML, as `plain_tables` returns them.
    origin
        What error messages call the scene, such as a file name.
    validate
        Creates a scene from its tables, with the values of its parameters.

    Raises
    ------
    SceneError
        If the scene cannot be used. The message lists all problems.
    """
    # Parameters are evaluated first, since all other numbers may use them.
    parameters: dict[str, float] = {}
    parameter_problems: list[Problem] = []
    evaluated = dict(tables)
    if isinstance(tables.get("parameters"), dict):
        parameters, parameter_problems = _evaluate_parameters(tables["parameters"])
        evaluated["parameters"] = parameters
    # Problems of all three kinds are reported together. They are generated lazily, and SceneError
    # takes only the first of them: a hostile file may have a million.
    invalid_values: Iterator[Problem] = iter(())
    try:
        scene = validate(evaluated, parameters)
    except ValidationError as error:
        invalid_values = problems_of(error, Scene)
    problems = chain(parameter_problems, invalid_values, _reference_problems(tables))
    for first in problems:
        raise SceneError(origin, chain([first], problems))
    return scene


def plain_tables(tables: Mapping[str, Any], origin: str) -> dict[str, Any]:
    """Return a copy of the tables of a scene in the types of TOML, without the keys whose value is None.

    Raises
    ------
    SceneError
        If tables or lists are nested too deep.
    """
    plain: dict[str, Any] = to_toml_types(tables, origin)
    return plain


def to_toml_types(value: Any, origin: str, depth: int = 0) -> Any:
    """Return a copy in the types of TOML; numbers and sequences of other libraries become Python's own.

    `depth` is the number of tables and lists around the value.
    """
    if depth > MAX_DEPTH:
        raise SceneError(origin, [Problem("file", *TOO_DEEP)])
    if type(value) in (str, float, int, bool):
        return value
    if isinstance(value, Part):
        value = value.declared()
    if isinstance(value, Mapping):
        return {
            str(key): to_toml_types(item, origin, depth + 1)
            for key, item in value.items()
            if item is not None
        }
    if hasattr(value, "tolist"):  # arrays and scalars of NumPy
        return to_toml_types(value.tolist(), origin, depth + 1)
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return [to_toml_types(item, origin, depth + 1) for item in value]
    return value


def _evaluate_parameters(table: Mapping[str, Any]) -> tuple[dict[str, float], list[Problem]]:
    """Evaluate parameters in order of appearance; each may use those before it.

    Returns
    -------
    values : dict
        By name. An invalid parameter has the value 1, so that expressions with it can be checked as well.
    problems : list of Problem
        Invalid names and values.
    """
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
    """Yield names that are used twice, and invalid references to bodies.

    The tables are those of the file. They need not be valid otherwise, so that all problems can be reported together.
    """
    sections: dict[str, dict[str, Any]] = {}
    for section in ELEMENTS:
        table = raw.get(section)
        if isinstance(table, dict):
            sections[section] = table
    bodies = sections.get("bodies", {})
    keys_by_name: dict[str, str] = {}
    for section, table in sections.items():
        for name, element in table.items():
            key = f"{section}.{shortened(name)}"
            if name == GROUND:
                yield Problem(
                    key, f"'{GROUND}'", "expected another name; this one means the fixed body"
                )
            if name in keys_by_name:
                yield Problem(
                    key,
                    f"the name of {keys_by_name[name]}",
                    "expected a name of its own for every element",
                )
            keys_by_name.setdefault(name, key)
            if isinstance(element, dict):
                yield from _body_problems(key, element, bodies)


def _body_problems(
    key: str, element: Mapping[str, Any], bodies: Mapping[str, Any]
) -> Iterator[Problem]:
    """Yield references of an element to bodies that do not exist, must not be the ground, or are equal."""
    pair = element.get("bodies")
    if not isinstance(pair, list):
        pair = []
    references = {field: element.get(field) for field in ("slider", "guide", "body")}
    references |= {f"bodies.{i}": body for i, body in enumerate(pair)}
    for field, body in references.items():
        if body == GROUND and field in ("slider", "body"):
            yield Problem(f"{key}.{field}", f"'{GROUND}'", "expected a body that can move")
        elif isinstance(body, str) and body not in bodies and body != GROUND:
            body_names = names([*bodies, GROUND])
            hint = did_you_mean(body, bodies)
            yield Problem(
                f"{key}.{field}", shown(body), f"expected a body of the scene: {body_names}{hint}"
            )
    if element.get("type") == "translational":
        pair = [element.get("slider"), element.get("guide", GROUND)]
    if len(pair) == 2 and pair[0] == pair[1] and isinstance(pair[0], str):
        yield Problem(key, f"{shown(pair[0])} twice", "expected two different bodies")
