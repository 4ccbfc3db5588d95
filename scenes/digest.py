"""Digests of scenes and of other content: two things have the same one where everything is the same."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import pickle
from collections.abc import Mapping
from typing import Any

from stiction.scenes.loading import scene_to_toml
from stiction.scenes.model import Scene

SHORT = 16
"""Hexadecimal digits of a digest that stands in names and identities."""
SIGNIFICANT = 12
"""Significant digits of numbers in an identity: the last ones of ``"sqrt(2)/3"`` are those of a machine's libm."""


def digest(content: Any) -> str:
    """Return the SHA-256 of content as hexadecimal digits, the same in every process and on every machine.

    It is of scenes, numbers, texts, mappings, sequences and dataclasses of them; anything else as it is pickled.
    """
    return hashlib.sha256(json.dumps(_plain(content), sort_keys=True).encode()).hexdigest()


def scene_digest(scene: Scene) -> str:
    """Return the digest of what a scene declares, without title and source, in `SIGNIFICANT` digits.

    Names of elements count, for columns and events bear them.
    """
    content = scene.model_dump(
        mode="json", exclude={"title", "source", "parameters"}, exclude_defaults=True
    )
    # rounded, as arithmetic in scenes is evaluated by the machine's own libm
    return digest(_rounded(content))[:SHORT]


def _plain(value: Any) -> Any:
    """Content as JSON has it."""
    if isinstance(value, Scene):
        return ["scene", value.name, scene_to_toml(value)]
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if dataclasses.is_dataclass(value):
        fields = {
            field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)
        }
        return [type(value).__qualname__, fields]
    if value is None or isinstance(value, (str, int, float, bool)):
        return value
    return ["pickled", pickle.dumps(value).hex()]


def _rounded(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _rounded(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_rounded(value) for value in content]
    if isinstance(content, int | float) and not isinstance(content, bool):
        return float(f"{content:.{SIGNIFICANT}g}")
    return content
