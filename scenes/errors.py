"""What is wrong in a scene, in the terms of its file."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from scenes.laws import Law
from scenes.model import Body, Drive, Joint, Load, Scene, Spring, Stabilization

_SHOWN = 20  # problems in one message: a screen
_WIDTH = 80  # characters of a value or of a list of names


@dataclass(frozen=True)
class Problem:
    """One thing wrong in a scene: where, what was found, what was expected."""

    key: str
    found: str
    expected: str

    def __str__(self) -> str:
        return f"{self.key}: found {self.found}; {self.expected}"


class SceneError(ValueError):
    """A scene that cannot be used; `origin` names the file, `problems` is everything wrong with it."""

    def __init__(self, origin: str, problems: Iterable[Problem]):
        self.origin, self.problems = origin, tuple(problems)
        count = len(self.problems)
        lines = [f"{origin}: {count} problem{'s' * (count > 1)}", *(f"  {p}" for p in self.problems[:_SHOWN])]
        super().__init__("\n".join(lines + [f"  ... and {count - _SHOWN} more"] * (count > _SHOWN)))

    def __reduce__(self):
        return type(self), (self.origin, self.problems)


def shown(value: Any) -> str:
    """A value of a file, short enough for a message."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, int) and abs(value) >= 10 ** _WIDTH:
        return "a huge integer"
    if isinstance(value, (list, tuple)):
        inner = ", ".join(shown(item) for item in value[:_WIDTH]) + ", ..." * (len(value) > _WIDTH)
        return shortened(f"[{inner}]")
    if isinstance(value, str):
        return repr(shortened(value))
    return shortened(f"{value}" if isinstance(value, (int, float)) else f"{type(value).__name__} {value}")


def shortened(text: str) -> str:
    return text if len(text) <= _WIDTH else text[:_WIDTH - 4] + " ..."


def names(known: Iterable[str]) -> str:
    """Names in one line; the first ones, where they are many."""
    known = list(known)
    line = ", ".join(known[:_WIDTH])
    if len(line) > 2 * _WIDTH or len(known) > _WIDTH:
        line = line[:2 * _WIDTH].rpartition(", ")[0] + f", ... ({len(known)} in all)"
    return line


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """`" (did you mean 'x'?)"`, or nothing where no name is close."""
    close = difflib.get_close_matches(name, known, n=1) if len(name) < _WIDTH else []
    return f" (did you mean {close[0]!r}?)" if close else ""


def problems_of(error: ValidationError) -> list[Problem]:
    """The errors of a validated scene in the terms of its file."""
    return [problem for detail in error.errors(include_url=False) for problem in _problems(detail)]


def _variants(union: Any, key: str) -> dict[str, type[BaseModel]]:
    """The members of a tagged union by their tag."""
    return {get_args(model.model_fields[key].annotation)[0]: model for model in get_args(get_args(union)[0])}


LAWS = _variants(Law, "type")
STABILIZATIONS = _variants(Stabilization, "method")
ELEMENTS: dict[str, dict[str, type[BaseModel]]] = {
    "bodies": {"": Body}, "joints": _variants(Joint, "type"), "drives": {"": Drive},
    "springs": _variants(Spring, "type"), "forces": _variants(Load, "type")}
"""Section -> type -> class of its elements; bodies and drives have one class each."""


def _model(place: Sequence[str | int]) -> type[BaseModel]:
    """The class of the table at a location of pydantic's, which includes the tags of unions."""
    if not place:
        return Scene
    if len(place) > 1 and place[-2] == "law":
        return LAWS[place[-1]]
    if place[0] == "stabilization":
        return STABILIZATIONS[place[-1]]
    variants = ELEMENTS[place[0]]
    return variants.get("") or variants[place[-1]]


def _key(location: Sequence[str | int]) -> str:
    """The key in the file: pydantic's location without the tags of unions."""
    parts = list(location)
    if parts[0] == "stabilization":
        del parts[1:2]
    elif parts[0] in ELEMENTS and "" not in ELEMENTS[parts[0]]:
        del parts[2:3]
    if parts[2:3] == ["law"]:
        del parts[3:4]
    return shortened(".".join(map(str, parts)))


_EXPECTED = {"string_type": "expected text", "string_too_long": "expected at most 60 characters",
             "string_pattern_mismatch": "expected a name: a letter, then letters, digits, _ or -",
             "tuple_type": "expected a list", "model_type": "expected a table",
             "model_attributes_type": "expected a table", "dict_type": "expected a table",
             "greater_than": "expected a number > {gt:g}", "greater_than_equal": "expected a number >= {ge:g}",
             "too_short": "expected at least {min_length}", "too_long": "expected a list of {max_length}",
             "literal_error": "expected {expected}"}


def _problems(detail: Mapping[str, Any]) -> list[Problem]:
    kind, location, value = detail["type"], detail["loc"], detail["input"]
    context = detail.get("ctx", {})
    if kind == "inconsistent":
        return [Problem(f"{_key(location)}.{key}", found if isinstance(found, str) else shown(found), expected)
                for key, found, expected in context["found"]]
    if location[-1] == "[key]":
        return [Problem(_key(location[:-1]), f"the name {shown(value)}", _EXPECTED["string_pattern_mismatch"])]
    if kind == "missing" and isinstance(location[-1], int):
        return [Problem(_key(location[:-1]), shown(value), "expected a list of 2")] if location[-1] == len(value) else []
    if kind == "missing":
        return [Problem(_key(location), "nothing", "this key is required")]
    if kind == "extra_forbidden":
        known = [name for name in _model(location[:-1]).model_fields]
        close = did_you_mean(str(location[-1]), known)
        return [Problem(_key(location), shown(value), f"unknown key{close or ', expected one of: ' + names(known)}")]
    if kind.startswith("union_tag"):
        tag = context["discriminator"].strip("'")
        tags = (LAWS if location[-1] == "law" else STABILIZATIONS if location[0] == "stabilization"
                else ELEMENTS[location[0]])
        expected = "expected " + " or ".join(map(repr, tags)) + did_you_mean(str(value.get(tag)), tags)
        return [Problem(f"{_key(location)}.{tag}", shown(value.get(tag)), expected)]
    if kind == "value_error":
        return [Problem(_key(location), shown(value), str(context["error"]))]
    if kind == "literal_error" and isinstance(value, str):
        expected = "expected " + context["expected"] + did_you_mean(value, context["expected"].split("'")[1::2])
        return [Problem(_key(location), shown(value), expected)]
    expected = _EXPECTED[kind].format(**context) if kind in _EXPECTED else detail["msg"]
    return [Problem(_key(location), shown(value), expected)]
