"""The page ``KEYS.md`` of the benchmark: the keys of ``scene.json``, from the descriptions in the scene format.

It contains the elements that occur in the scenes of the set. Keys that have no effect in any of them are only named.
"""

from __future__ import annotations

import inspect
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from stiction.reports.markdown.tables import align_columns
from stiction.scenes import Scene
from stiction.scenes.errors import ELEMENTS, LAWS
from stiction.scenes.resolved import FORMAT, VERSION, resolved_scene

INTRODUCTION = f"""\
# Keys of scene.json

`scene.json` contains the keys `format` (`"{FORMAT}"`), `version` ({VERSION}) and `name`, and the
mechanism under the key `scene`, which this page describes. Quantities are in SI units, angles in rad and
counter-clockwise. Points and directions that belong to a body are in its axes, and points are counted from its centre
of mass; `"ground"` is the fixed body with the origin (0, 0). In a formula a key is the name of its value, `t` is the
time in s, and a prime is a derivative by time. Every key is present. `null` means that the scene does not declare the
effect, and so does a coefficient 0. What a description calls a default has been filled in.
"""
TITLES = {
    "bodies": "Bodies: `bodies`",
    "joints": "Joints: `joints`",
    "drives": "Motors: `drives`",
    "springs": "Springs: `springs`",
    "forces": "Loads: `forces`",
}
"""Headings of the sections of a scene."""
PARAMETERS = "parameters"
"""Key of a scene file that a resolved scene does not have."""

Values = dict[str, list[Any]]
"""The values that a key has in all elements of a type, by key."""


def keys_page(scenes: Iterable[Scene]) -> str:
    """Return the text of ``KEYS.md`` for the scenes of a set."""
    tables = [resolved_scene(scene)["scene"] for scene in scenes]
    top = [
        (f"`{key}`", field.description or "")
        for key, field in Scene.model_fields.items()
        if key != PARAMETERS
    ]
    parts = [INTRODUCTION + "\n" + _key_table(top)]
    laws: dict[str, Values] = defaultdict(lambda: defaultdict(list))
    for section, title in TITLES.items():
        parts.append(f"## {title}\n\nAn object with an element under each name.")
        elements = [element for table in tables for element in table[section].values()]
        for tag, values in sorted(_values_by_type(elements, ELEMENTS[section]).items()):
            heading = f'### `"type": "{tag}"`\n\n' if tag else ""
            parts.append(heading + _element_text(ELEMENTS[section][tag], values))
        for element in elements:
            if "law" in element:
                _collect(element["law"], laws[element["law"]["type"]])
    parts.append("## Laws of time: `law`\n\nThe formula is the value of the law at the time `t`.")
    for tag, values in sorted(laws.items()):
        parts.append(f'### `"type": "{tag}"`\n\n' + _element_text(LAWS[tag], values))
    return "\n\n".join(parts) + "\n"


def _collect(element: Mapping[str, Any], values: Values) -> None:
    """Add the values of an element to the lists of values of its keys."""
    for key, value in element.items():
        values[key].append(value)


def _values_by_type(
    elements: Iterable[Mapping[str, Any]], classes: Mapping[str, type[BaseModel]]
) -> dict[str, Values]:
    """Return the values of all keys by the type of the element; the type is empty in a section with one class."""
    values_by_type: dict[str, Values] = defaultdict(lambda: defaultdict(list))
    for element in elements:
        tag = "" if "" in classes else element["type"]
        _collect(element, values_by_type[tag])
    return values_by_type


def _has_no_effect(model: type[BaseModel], key: str, values: Iterable[Any]) -> bool:
    """Return True if a key has in all elements its default, null or a number.

    Keys in the first paragraph of the description are excepted, because this contains the formula of the element.
    """
    default = model.model_fields[key].default
    is_in_formula = re.search(rf"\b{key}\b", _description(model)[0]) is not None
    is_plain = default is None or isinstance(default, float)
    return is_plain and not is_in_formula and all(value == default for value in values)


def _description(model: type[BaseModel]) -> list[str]:
    """Return the paragraphs of the description of a class."""
    return inspect.cleandoc(model.__doc__ or "").split("\n\n")


def _element_text(model: type[BaseModel], values: Values) -> str:
    """Return the description of a class of elements, a table of its keys, and the keys without effect."""
    unused = [key for key in values if _has_no_effect(model, key, values[key])]
    rows = [
        (f"`{key}`", model.model_fields[key].description or "")
        for key in values
        if key not in unused
    ]
    parts = [*_paragraphs(model, unused), _key_table(rows)]
    if unused:
        defaults = [f"`{key}` ({json.dumps(model.model_fields[key].default)})" for key in unused]
        parts.append(f"Without effect in all scenes of this set: {', '.join(defaults)}.")
    return "\n\n".join(parts)


def _paragraphs(model: type[BaseModel], unused: Iterable[str]) -> Iterator[str]:
    """Yield the paragraphs of the description of a class that are not about unused keys."""
    for paragraph in _description(model):
        if not any(f"`{key}`" in paragraph for key in unused):
            yield paragraph


def _key_table(rows: list[tuple[str, str]]) -> str:
    """Return a Markdown table of keys."""
    return align_columns(("key", "meaning; unit"), rows, [False, False])
