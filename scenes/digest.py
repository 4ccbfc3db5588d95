"""Digests of scenes and of other content, which are equal if and only if the content is equal."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import pickle
from collections.abc import Mapping
from typing import Any

from stiction.scenes.fields import Part
from stiction.scenes.model import Scene

SHORT = 16
"""Number of hexadecimal digits of a digest that is part of a name or an identity."""
SIGNIFICANT = 12
"""Significant digits of the numbers in an identity. The last digits of an expression such as ``"sqrt(2)/3"`` depend on
the mathematical library of the machine."""


def digest(content: Any) -> str:
    """Return the SHA-256 digest of content, as hexadecimal digits.

    Parameters
    ----------
    content
        Scenes, numbers, texts, or mappings, sequences and dataclasses of these, whose digest is the same in every
        process and on every machine. Anything else contributes the bytes of its pickle.
    """
    text = json.dumps(_to_json_types(content), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def scene_digest(scene: Scene) -> str:
    """Return the digest of what a scene declares, `SHORT` digits.

    Title and source are ignored. Names of elements are included, because columns and events contain them. Numbers are
    rounded to `SIGNIFICANT` digits.
    """
    content = _declared(scene)
    for key in ("title", "source", "parameters"):
        content.pop(key, None)
    return digest(_rounded(content))[:SHORT]


def _declared(value: Any) -> Any:
    """Return a part of a scene in the types of JSON, without the keys that have their default.

    The type of an element is included: with other types, the same keys describe something else.
    """
    if isinstance(value, Part):
        return {
            key: _declared(getattr(value, key))
            for key, field in type(value).model_fields.items()
            if key == "type" or getattr(value, key) != field.default
        }
    if isinstance(value, dict):
        return {key: _declared(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [_declared(item) for item in value]
    return value


def _to_json_types(value: Any) -> Any:
    """Return content in the types of JSON; scenes, dataclasses and pickles become lists that begin with their kind."""
    if isinstance(value, Scene):
        return ["scene", value.name, value.to_toml()]
    if isinstance(value, Mapping):
        return {str(key): _to_json_types(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_to_json_types(item) for item in value]
    if dataclasses.is_dataclass(value):
        fields = {
            field.name: _to_json_types(getattr(value, field.name))
            for field in dataclasses.fields(value)
        }
        return [type(value).__qualname__, fields]
    if value is None or isinstance(value, (str, int, float, bool)):
        return value
    return ["pickled", pickle.dumps(value).hex()]


def _rounded(content: Any) -> Any:
    """Return content in the types of JSON with all numbers as floats of `SIGNIFICANT` digits."""
    if isinstance(content, dict):
        return {key: _rounded(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_rounded(value) for value in content]
    if isinstance(content, int | float) and not isinstance(content, bool):
        return float(f"{content:.{SIGNIFICANT}g}")
    return content
