"""Replacing, adding and removing values of a scene by keys such as `F0`, `guide.mu`, or `bodies.bar.mass`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

from stiction.scenes.errors import ELEMENTS, Problem, SceneError
from stiction.scenes.model import Scene
from stiction.scenes.wording import did_you_mean, names, shown

_MISSING = object()
"""Stands for a value that does not exist; None is a value."""
_MAX_INDEX_DIGITS = 8
"""Largest number of digits of an index into a list: `int` takes time that grows with the square of their number."""


def parse_override(text: str) -> tuple[str, Any]:
    """Split `KEY=VALUE`, as written on the command line.

    Parameters
    ----------
    text
        The value is a number, an arithmetic expression, a word, or a TOML list or table. It may be empty.

    Returns
    -------
    key : str
        The key.
    value
        The value; None, which removes the key, if it is empty.

    Raises
    ------
    SceneError
        If the text does not have this form.
    """
    key, equals, value = (part.strip() for part in text.partition("="))
    if not key or not equals:
        found = "no key" if equals else "no key and value"
        raise SceneError(
            "override", [Problem(shown(text), found, "expected KEY=VALUE such as guide.mu=0.05")]
        )
    if value[:1] not in ("[", "{"):
        return key, value or None
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError) as error:
        raise SceneError(
            "override", [Problem(key, shown(value), f"expected a TOML list or table ({error})")]
        ) from None


def flattened(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested tables as one table with dotted keys, each of which begins with `prefix`."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            flat |= flattened(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def override(raw: dict[str, Any], key: str, value: Any) -> Problem | None:
    """Replace, add or remove one value in the tables of a scene, in place.

    Parameters
    ----------
    raw
        The tables of the scene.
    key
        A parameter, or a path from the top of the file or from the name of an element, in which the part ``law`` may be
        omitted. It may end in the index of a list.
    value
        The new value; None removes the key, so that its default applies.

    Returns
    -------
    Problem or None
        Why there is no place for the value. Whether an element can have a new key is checked later, by the validation
        of the scene.
    """
    parts = _full_path(raw, key)
    if parts is None:
        return _unknown_key(raw, key)
    # Descend to the table or list that contains the value. Tables and lists that the file omits are
    # added with their default.
    container: Any = raw
    for depth, part in enumerate(parts[:-1], start=1):
        inner = _get(container, part)
        if inner is _MISSING and isinstance(container, dict):
            inner = _default_at(parts[:depth])
            if inner is not _MISSING:
                container[part] = inner
        if not isinstance(inner, (dict, list)):
            return _unknown_key(raw, key)
        container = inner
    last = parts[-1]
    if isinstance(container, list):
        if _get(container, last) is _MISSING or value is None:
            expected = f"expected an index from 0 to {len(container) - 1} and a value"
            return Problem(key, "no such entry", expected)
        container[int(last)] = value
    elif value is not None:
        container[last] = value
    elif last in container:
        del container[last]
    elif _default_at(parts) is _MISSING:
        hint = did_you_mean(last, container)
        return Problem(key, "nothing to remove", f"expected one of: {names(container)}{hint}")
    return None


def _full_path(raw: Mapping[str, Any], key: str) -> list[str] | None:
    """Return the path from the top of the file that a short key stands for; None if there is no such element."""
    parts = key.split(".")
    first = parts[0]
    if len(parts) == 1 and first in _get_table(raw, "parameters"):
        return ["parameters", first]
    if first in Scene.model_fields:
        return parts
    for section, classes in ELEMENTS.items():
        if first in _get_table(raw, section):
            keys = {name for model in classes.values() for name in model.model_fields}
            is_key_of_law = len(parts) > 1 and "law" in keys and parts[1] not in keys
            law = ["law"] if is_key_of_law else []
            return [section, first, *law, *parts[1:]]
    return None


def _get_table(raw: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Return a table of the scene; an empty one if it is missing or not a table."""
    table = raw.get(key)
    return table if isinstance(table, dict) else {}


def _get(container: Any, part: str) -> Any:
    """Return the value at a key of a table or at an index of a list; `_MISSING` if there is none."""
    if isinstance(container, dict):
        return container.get(part, _MISSING)
    is_index = part.isdecimal() and part.isascii() and len(part) <= _MAX_INDEX_DIGITS
    if isinstance(container, list) and is_index and int(part) < len(container):
        return container[int(part)]
    return _MISSING


def _default_at(parts: list[str]) -> Any:
    """Return the default of a key of the scene or of an element; `_MISSING` if there is none.

    The default of a table is an empty table, to which keys can be added. Tuples become lists.
    """
    if len(parts) == 1 and parts[0] in Scene.model_fields:
        is_table = parts[0] in ELEMENTS or parts[0] in ("parameters", "stabilization")
        return {} if is_table else None
    if len(parts) == 3 and parts[0] in ELEMENTS:
        section, _, key = parts
        for model in ELEMENTS[section].values():
            field = model.model_fields.get(key)
            if field is not None and not field.is_required():
                return _to_lists(field.default)
    return _MISSING


def _to_lists(value: Any) -> Any:
    """Return nested tuples as nested lists; any other value unchanged."""
    return [_to_lists(item) for item in value] if isinstance(value, tuple) else value


def _unknown_key(raw: Mapping[str, Any], key: str) -> Problem:
    """Return the problem of a key that the scene does not have."""
    elements = [name for section in ELEMENTS for name in _get_table(raw, section)]
    options = [*_get_table(raw, "parameters"), *elements, *Scene.model_fields]
    hint = did_you_mean(key.partition(".")[0], options)
    return Problem(key, "no such key in the scene", f"expected one of: {names(options)}{hint}")
