"""Resolved scenes: what programs in other languages read, as JSON.

Numbers instead of arithmetic, every key there, laws as data, SI units. What a scene leaves out has its value: no
gravity is ``[0, 0]``, ``mus`` is ``mu``, ``static_friction`` is ``friction``, the width of a guide with a length is 0.
null is what the scene does not declare: friction (``mu`` and ``mus``, ``friction`` and ``static_friction``), corner
forces (``length``, ``width``), an ``axis``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Literal

from pydantic import StrictStr, ValidationError

from stiction.scenes.errors import SceneError, problems_of
from stiction.scenes.fields import Model
from stiction.scenes.loading import scene_from_dict
from stiction.scenes.model import Scene

FORMAT = "stiction resolved scene"
VERSION = 1
"""Raised where a program written for the version before would read a scene wrongly, or refuse it."""


class _Resolved(Model):
    format: Literal["stiction resolved scene"]
    version: Literal[1]
    name: StrictStr
    scene: dict[str, Any]


def resolved_scene(scene: Scene) -> dict[str, Any]:
    """Return a scene as programs read it; `load_resolved` makes one of it again that moves by the same equations."""
    tables = scene.model_dump(mode="json", exclude={"parameters"})
    tables["gravity"] = tables["gravity"] or [0.0, 0.0]
    # the values in force where a joint leaves them out
    for name, guide in scene.guides.items():
        if guide.mu is not None:
            tables["joints"][name]["mus"] = guide.static_coefficient
        if guide.length is not None:
            tables["joints"][name]["width"] = guide.width or 0.0
    for name, joint in scene.joints.items():
        if joint.friction is not None:
            tables["joints"][name]["static_friction"] = joint.bounds[1]
    return {"format": FORMAT, "version": VERSION, "name": scene.name, "scene": tables}


def resolved_text(scene: Scene) -> str:
    """`resolved_scene` as the text of a file; numbers in as many digits as give them back exactly."""
    return json.dumps(resolved_scene(scene), indent=1, allow_nan=False) + "\n"


def load_resolved(text: str, origin: str = "<resolved scene>") -> Scene:
    """Make a scene of the text of its resolved form; SceneError as of `scene_from_dict`, and for another format."""
    try:
        resolved = _Resolved.model_validate_json(text)
    except ValidationError as error:
        raise SceneError(origin, problems_of(error, _Resolved)) from None
    return scene_from_dict(resolved.scene, origin, name=resolved.name)


def resolved_schema() -> dict[str, Any]:
    """Return the JSON schema of `resolved_scene`; every key is there, no number is arithmetic."""
    scene = _numbers_only(Scene.model_json_schema(mode="serialization"))
    definitions = scene.pop("$defs")
    del scene["properties"]["parameters"]
    scene["required"] = list(scene["properties"])
    header = {
        "format": {"const": FORMAT},
        "version": {"const": VERSION},
        "name": {"type": "string", "description": "Of the scene's file, without its ending"},
        "scene": scene,
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"{FORMAT}, version {VERSION}",
        "type": "object",
        "properties": header,
        "required": list(header),
        "additionalProperties": False,
        "$defs": definitions,
    }


def _numbers_only(schema: Any) -> Any:
    """Take arithmetic, defaults and pydantic's own keys out of a schema; all properties of a table are required."""
    if isinstance(schema, list):
        return [_numbers_only(entry) for entry in schema]
    if not isinstance(schema, Mapping):
        return schema
    dropped = {
        "discriminator",
        "default",
        *(["title"] if isinstance(schema.get("title"), str) else []),
    }
    made = {key: _numbers_only(value) for key, value in schema.items() if key not in dropped}
    if any(kind.get("type") == "number" for kind in made.get("anyOf", [])):
        kinds = [kind for kind in made.pop("anyOf") if kind != {"type": "string"}]
        made |= kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
    if "prefixItems" in made:
        made["items"] = False
    if "patternProperties" in made:
        made["additionalProperties"] = False
    if "properties" in made:
        made["required"] = list(made["properties"])
    return made
