"""Values of a scene replaced, added or removed by key: `F0`, `guide.mu`, `motor.rate`, `bodies.bar.mass`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

from stiction.scenes.errors import ELEMENTS, Problem, SceneError
from stiction.scenes.model import Scene
from stiction.scenes.wording import did_you_mean, names, shown

_MISSING = object()
_INDEX_DIGITS = 8
"""Digits of an index into a list, at most: `int` takes time that grows with the square of their number."""


def parse_override(text: str) -> tuple[str, Any]:
    """Key and value of `KEY=VALUE`, as given on a command line; SceneError for anything else.

    The value is a number, arithmetic, a word, or a TOML list or table; nothing after ``=`` removes the key.
    """
    key, equals, value = (part.strip() for part in text.partition("="))
    if not key or not equals:
        raise SceneError(
            "override",
            [
                Problem(
                    shown(text),
                    "no key and value" if not equals else "no key",
                    "expected KEY=VALUE such as guide.mu=0.05",
                )
            ],
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
    """Nested tables as one with dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        flat |= (
            flattened(value, f"{prefix}{key}.")
            if isinstance(value, Mapping)
            else {f"{prefix}{key}": value}
        )
    return flat


def override(raw: dict[str, Any], key: str, value: Any) -> Problem | None:
    """Put `value` at `key` of a scene's tables, or remove what is there if it is None; say why if there is no place.

    `key` is a parameter, a path from the top of the file or from the name of an element (the word ``law`` may be left
    out), and may end in the index of a list. What the file leaves to its default can be set as well; whether the
    element has such a key is for validation.
    """
    parts = _full_path(raw, key)
    if parts is None:
        return _unknown(raw, key)
    # Down to the table or list that holds the value; tables that the file leaves out are added on
    # the way.
    place: Any = raw
    for depth, part in enumerate(parts[:-1]):
        below = _get(place, part)
        if below is _MISSING and isinstance(place, dict):
            below = _default(parts[: depth + 1])
            if below is not _MISSING:
                place[part] = below
        if not isinstance(below, (dict, list)):
            return _unknown(raw, key)
        place = below
    last = parts[-1]
    if isinstance(place, list):
        if _get(place, last) is _MISSING or value is None:
            return Problem(
                key, "no such entry", f"expected an index from 0 to {len(place) - 1} and a value"
            )
        place[int(last)] = value
    elif value is not None:
        place[last] = value
    elif last in place:
        del place[last]
    elif _default(parts) is _MISSING:
        return Problem(
            key, "nothing to remove", f"expected one of: {names(place)}{did_you_mean(last, place)}"
        )
    return None


def _full_path(raw: Mapping[str, Any], key: str) -> list[str] | None:
    """The path from the top of the file that a short key means; None if it means nothing there."""
    parts = key.split(".")
    first = parts[0]
    if len(parts) == 1 and first in _table(raw, "parameters"):
        return ["parameters", first]
    if first in Scene.model_fields:
        return parts
    section = next((section for section in ELEMENTS if first in _table(raw, section)), None)
    if section is None:
        return None
    own = {name for model in ELEMENTS[section].values() for name in model.model_fields}
    law = ["law"] if len(parts) > 1 and "law" in own and parts[1] not in own else []
    return [section, first, *law, *parts[1:]]


def _table(raw: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    table = raw.get(key)
    return table if isinstance(table, dict) else {}


def _get(place: Any, part: str) -> Any:
    if isinstance(place, dict):
        return place.get(part, _MISSING)
    if (
        isinstance(place, list)
        and part.isdecimal()
        and part.isascii()
        and len(part) <= _INDEX_DIGITS
        and int(part) < len(place)
    ):
        return place[int(part)]
    return _MISSING


def _default(parts: list[str]) -> Any:
    """Default of a path at which the file has nothing: of a section or of an element's key; tuples as lists."""
    if len(parts) == 1 and parts[0] in Scene.model_fields:
        return {} if parts[0] in ELEMENTS or parts[0] in ("parameters", "stabilization") else None
    if len(parts) == 3 and parts[0] in ELEMENTS:
        for model in ELEMENTS[parts[0]].values():
            if parts[2] in model.model_fields and not model.model_fields[parts[2]].is_required():
                return _listed(model.model_fields[parts[2]].default)
    return _MISSING


def _listed(value: Any) -> Any:
    return [_listed(item) for item in value] if isinstance(value, tuple) else value


def _unknown(raw: Mapping[str, Any], key: str) -> Problem:
    elements = [name for section in ELEMENTS for name in _table(raw, section)]
    known = [*_table(raw, "parameters"), *elements, *Scene.model_fields]
    return Problem(
        key,
        "no such key in the scene",
        f"expected one of: {names(known)}{did_you_mean(key.partition('.')[0], known)}",
    )
