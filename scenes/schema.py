"""The JSON schema of the scene format, by which editors complete keys and mark errors while one types.

Scenes themselves are validated by their classes (`model`) when they are read (`loading`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from stiction.scenes.model import Scene

SCHEMA_FILE = "scene.schema.json"
"""Its usual name, in the folder of the scene files that name it in their first line."""
DIALECT = "http://json-schema.org/draft-07/schema#"
"""The one that editors of TOML understand."""
_DERIVED = {
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

    It has every key, its type, its limits and its description. Only `load_scene` finds what depends on several keys at
    once (a body that does not exist, ``mus`` below ``mu``) and arithmetic that cannot be read: a file that fails the
    schema is no scene, one that passes may not be one yet.
    """
    made = _strict(Scene.model_json_schema())
    definitions = made.pop("$defs")
    return {
        "$schema": DIALECT,
        "title": "stiction scene",
        "definitions": definitions,
        "if": {"required": ["base"]},
        "then": _DERIVED,
        "else": made,
    }


def scene_schema_text() -> str:
    """`scene_schema` as the text of a file."""
    return json.dumps(scene_schema(), indent=1) + "\n"


def _strict(schema: Any) -> Any:
    """Turn a schema of pydantic's into draft 7 for TOML.

    There is no null in TOML; the tag of a union's member is required; names that match no pattern are refused.
    """
    if isinstance(schema, list):
        return [_strict(entry) for entry in schema]
    if not isinstance(schema, Mapping):
        return schema
    dropped = {"discriminator", *(["title"] if isinstance(schema.get("title"), str) else [])}
    made = {key: _strict(value) for key, value in schema.items() if key not in dropped}
    if isinstance(made.get("$ref"), str):
        made["$ref"] = made["$ref"].replace("#/$defs/", "#/definitions/")
    if "prefixItems" in made:
        made["items"] = made.pop("prefixItems")
    if "patternProperties" in made:
        made["additionalProperties"] = False
    if made.get("default", 0) is None:
        del made["default"]
        kinds = [kind for kind in made.pop("anyOf") if kind != {"type": "null"}]
        made |= kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
    if "properties" in made:
        tags = [key for key, value in made["properties"].items() if "const" in value]
        made["required"] = list(dict.fromkeys([*made.get("required", ()), *tags]))
    return made
