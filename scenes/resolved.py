"""Resolved scenes: scenes as JSON for programs in other languages.

A resolved scene contains numbers in place of arithmetic expressions, in SI units. Every key is present. Defaults are
replaced by the values that apply: without gravity it is ``[0, 0]``, ``mus`` is ``mu``, ``static_friction`` is
``friction``, and the width of a guide with a length is 0. A key is null if the scene does not declare an effect:
friction (``mu``, ``mus``, ``friction``, ``static_friction``), its dependence on speed (``stribeck_velocity``), corner
forces (``length``, ``width``), ``clearance``, an ``axis``, the ``effort_limit`` of a drive, or the side on which a
spring ``acts``.
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
from stiction.scenes.schema import is_added_by_pydantic, one_of

FORMAT = "stiction resolved scene"
VERSION = 1
"""Version of the format. It is increased if programs written for the previous version could misread a scene."""


class _Resolved(Model):
    """The outermost keys of a resolved scene; `scene_from_dict` validates the scene itself."""

    format: Literal["stiction resolved scene"]
    version: Literal[1]
    name: StrictStr
    scene: dict[str, Any]


def resolved_scene(scene: Scene) -> dict[str, Any]:
    """Return a scene in its resolved form, from which `load_resolved` makes a scene with the same motion."""
    tables = scene.model_dump(mode="json", exclude={"parameters"})
    if scene.gravity is None:
        tables["gravity"] = [0.0, 0.0]
    for name, guide in scene.guides.items():
        joint = tables["joints"][name]
        if guide.mu is not None:
            joint["mus"] = guide.static_coefficient
        if guide.length is not None:
            joint["width"] = guide.width or 0.0
    for name, pin in scene.pins.items():
        if pin.mu is not None:
            tables["joints"][name]["mus"] = pin.mu if pin.mus is None else pin.mus
    for name, frictional_joint in scene.joints.items():
        if frictional_joint.friction is not None:
            static = frictional_joint.static_friction
            tables["joints"][name]["static_friction"] = (
                frictional_joint.friction if static is None else static
            )
    return {"format": FORMAT, "version": VERSION, "name": scene.name, "scene": tables}


def resolved_text(scene: Scene) -> str:
    """Return `resolved_scene` as the text of a file; its numbers have enough digits to be read back exactly."""
    return json.dumps(resolved_scene(scene), indent=1, allow_nan=False) + "\n"


def load_resolved(text: str, origin: str = "<resolved scene>") -> Scene:
    """Make a scene from the text of its resolved form.

    Parameters
    ----------
    text
        What `resolved_text` returned.
    origin
        What error messages call the scene, such as a file name.

    Raises
    ------
    SceneError
        If the text has another format or version, or if the scene cannot be used.
    """
    try:
        resolved = _Resolved.model_validate_json(text)
    except ValidationError as error:
        raise SceneError(origin, problems_of(error, _Resolved)) from None
    return scene_from_dict(resolved.scene, origin, name=resolved.name)


def resolved_schema() -> dict[str, Any]:
    """Return the JSON schema of `resolved_scene`, in which every key is required and no number is arithmetic."""
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
    """Convert a schema made by pydantic, or a part of it, to the schema of a resolved scene.

    Arithmetic expressions and defaults are removed, and all properties of a table become required.
    """
    if isinstance(schema, list):
        return [_numbers_only(entry) for entry in schema]
    if not isinstance(schema, Mapping):
        return schema
    converted = {
        key: _numbers_only(value)
        for key, value in schema.items()
        if key != "default" and not is_added_by_pydantic(key, value)
    }
    if any(kind.get("type") == "number" for kind in converted.get("anyOf", [])):
        kinds = [kind for kind in converted.pop("anyOf") if kind != {"type": "string"}]
        converted |= one_of(kinds)
    if "prefixItems" in converted:
        converted["items"] = False
    if "patternProperties" in converted:
        converted["additionalProperties"] = False
    if "properties" in converted:
        converted["required"] = list(converted["properties"])
    return converted
