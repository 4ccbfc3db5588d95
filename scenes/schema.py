"""JSON schema of the scene format, with which editors complete keys and mark errors.

When a scene is read (`loading`), it is validated by the classes of `model` and not by this schema.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from stiction.scenes.model import Scene

SCHEMA_FILE = "scene.schema.json"
"""Usual name of the schema's file, next to the scene files that refer to it in their first line."""
DIALECT = "http://json-schema.org/draft-07/schema#"
"""Version of JSON schema; editors of TOML support draft 7."""
# A file with a `base` has other keys than a scene; `loading` validates them without pydantic.
_DERIVED_SCENE = {
    "title": "A scene that is another one with changes",
    "type": "object",
    "properties": {
        "base": {
            "type": "string",
            "description": "A name of the catalogue, or a file beside this one",
        },
        "title": {"type": "string"},
        "source": {"type": "string"},
        "set": {
            "type": "object",
            "description": "Overrides: keys as of `--set`, and the values that they get",
        },
        "unset": {
            "type": "array",
            "items": {"type": "string"},
            "description": "Keys that are removed",
        },
    },
    "required": ["base"],
    "additionalProperties": False,
}


def scene_schema() -> dict[str, Any]:
    """Return the schema of a scene file, JSON schema draft 7.

    It contains every key with its type, limits and description. A file that does not satisfy the schema is not a
    scene. The converse does not hold: `load_scene` also finds errors that involve several keys (a body that does not
    exist, ``mus`` below ``mu``) and invalid arithmetic expressions.
    """
    scene = _to_draft_7(Scene.model_json_schema())
    definitions = scene.pop("$defs")
    return {
        "$schema": DIALECT,
        "title": "stiction scene",
        "definitions": definitions,
        "if": {"required": ["base"]},
        "then": _DERIVED_SCENE,
        "else": scene,
    }


def scene_schema_text() -> str:
    """Return `scene_schema` as the text of a file."""
    return json.dumps(scene_schema(), indent=1) + "\n"


def _to_draft_7(schema: Any) -> Any:
    """Convert a schema made by pydantic, or a part of it, to draft 7, for TOML.

    TOML has no null, so that None is removed from defaults and types. The key by which the classes of a union are
    distinguished becomes required. Names of elements that do not match their pattern are refused.
    """
    if isinstance(schema, list):
        return [_to_draft_7(entry) for entry in schema]
    if not isinstance(schema, Mapping):
        return schema
    converted = {
        key: _to_draft_7(value)
        for key, value in schema.items()
        if not is_added_by_pydantic(key, value)
    }
    # Keywords that have another name or place in draft 7.
    if isinstance(converted.get("$ref"), str):
        converted["$ref"] = converted["$ref"].replace("#/$defs/", "#/definitions/")
    if "prefixItems" in converted:
        converted["items"] = converted.pop("prefixItems")
    if "patternProperties" in converted:
        converted["additionalProperties"] = False
    # An optional key: its type is that of its value if it is present.
    if "default" in converted and converted["default"] is None:
        del converted["default"]
        kinds = [kind for kind in converted.pop("anyOf") if kind != {"type": "null"}]
        converted |= one_of(kinds)
    # The key of the tag has one possible value.
    if "properties" in converted:
        tags = [key for key, value in converted["properties"].items() if "const" in value]
        converted["required"] = list(dict.fromkeys([*converted.get("required", ()), *tags]))
    return converted


def is_added_by_pydantic(key: str, value: Any) -> bool:
    """Return True for keywords of a schema that editors do not need: the title of a class, and the discriminator.

    `title` may also be the name of a property, whose value is a schema and not a text.
    """
    return key == "discriminator" or (key == "title" and isinstance(value, str))


def one_of(kinds: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return the schema of a value that has one of several types."""
    return kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
