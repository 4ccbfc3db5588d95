"""Problems of a scene, or of another file that people write, in the terms of the file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from stiction.scenes.base_errors import InputError
from stiction.scenes.laws import Law
from stiction.scenes.model import Body, Drive, Joint, Load, Scene, Spring, Stabilization
from stiction.scenes.wording import did_you_mean, names, shortened, shown

_SHOWN = 20  # problems in one message: a screen
_KEPT = 1000  # problems in one error: a hostile file may have a million


@dataclass(frozen=True)
class Problem:
    """One thing wrong in a file: where, what was found, what was expected."""

    key: str
    found: str
    expected: str

    def __str__(self) -> str:
        return f"{self.key}: found {self.found}; {self.expected}"


class FileError(InputError):
    """A file that cannot be used; `origin` names it, `problems` all (or the first 1000) things wrong with it."""

    def __init__(self, origin: str, problems: Iterable[Problem]):
        self.origin, self.problems = origin, tuple(islice(problems, _KEPT))
        count = len(self.problems)
        title = f"{shortened(origin, 200)}: {count} problem{'s' * (count > 1)}{' or more' * (count == _KEPT)}"
        lines = [title, *(f"  {problem}" for problem in self.problems[:_SHOWN])]
        super().__init__("\n".join(lines + [f"  ... and {count - _SHOWN} more"] * (count > _SHOWN)))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.origin, self.problems)


class SceneError(FileError):
    """A scene that cannot be used."""


def problems_of(error: ValidationError) -> Iterator[Problem]:
    """The errors of a validated scene in the terms of its file."""
    for detail in error.errors(include_url=False):
        yield from _problems(detail)


def _variants(union: Any, key: str) -> dict[str, type[BaseModel]]:
    """The members of a tagged union by their tag."""
    return {get_args(model.model_fields[key].annotation)[0]: model for model in get_args(get_args(union)[0])}


LAWS = _variants(Law, "type")
STABILIZATIONS = _variants(Stabilization, "method")
ELEMENTS: dict[str, dict[str, type[BaseModel]]] = {
    "bodies": {"": Body}, "joints": _variants(Joint, "type"), "drives": {"": Drive},
    "springs": _variants(Spring, "type"), "forces": _variants(Load, "type")}
"""Section -> type -> class of its elements; bodies and drives have one class each."""


def _variants_at(place: Sequence[str | int]) -> Mapping[str, type[BaseModel]]:
    """The classes, by tag, that the table at a location of pydantic's can have."""
    if not place:
        return {"": Scene}
    if len(place) > 3 and place[-2] == "law":  # deeper than an element that is named law
        return LAWS
    return STABILIZATIONS if place[0] == "stabilization" else ELEMENTS[str(place[0])]


def _unknown(location: Sequence[str | int], key: str) -> str:
    """Word the problem of a key that its table does not have. The location includes the tags of unions."""
    *place, last = location
    variants = _variants_at(place)
    if last in Scene.model_fields:
        return "unknown key: it belongs at the top of the file, above the first [table]"
    known = (variants.get("") or variants[str(place[-1])]).model_fields
    hint = did_you_mean(last, known) or f"; expected one of: {names(known)}"
    if owners := [tag for tag, model in variants.items() if tag and last in model.model_fields]:
        # a tag was changed, what belongs to the old one was not
        return (f"unknown key of {place[-1]!r}, one of {' and '.join(map(repr, owners))}{hint}; "
                f"what a base has is removed by unset = [\"{key}\"] or --set {key}=")
    return f"unknown key{hint}"


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
             "string_pattern_mismatch": "expected a name: a letter of a-z or A-Z, then such letters, digits, _ or -",
             "missing": "this key is required", "extra_forbidden": "unknown key",
             "tuple_type": "expected a list", "model_type": "expected a table",
             "model_attributes_type": "expected a table", "dict_type": "expected a table",
             "greater_than": "expected a number > {gt:g}", "greater_than_equal": "expected a number >= {ge:g}",
             "too_short": "expected at least {min_length}", "too_long": "expected a list of {max_length}",
             "literal_error": "expected {expected}"}


def _problems(detail: Mapping[str, Any]) -> Iterator[Problem]:
    kind, location, value, context = detail["type"], detail["loc"], detail["input"], detail.get("ctx", {})
    key, found, last = _key(location), shown(value), location[-1]
    if kind == "inconsistent":
        for field, wrong, expected in context["found"]:
            yield Problem(f"{key}.{field}", shown(wrong), expected)
    elif last == "[key]":
        yield Problem(_key(location[:-1]), f"the name {found}", _EXPECTED["string_pattern_mismatch"])
    elif kind == "missing" and isinstance(last, int):
        if last == len(value):  # one problem for a list that is short by several
            yield Problem(_key(location[:-1]), found, "expected a list of 2")
    elif kind == "extra_forbidden":
        yield Problem(key, found, _unknown(location, key))
    elif kind.startswith("union_tag"):
        tag = context["discriminator"].strip("'")
        tags = (LAWS if last == "law" and len(location) > 2 else
                STABILIZATIONS if location[0] == "stabilization" else ELEMENTS[location[0]])
        yield Problem(f"{key}.{tag}", shown(value.get(tag)),
                      f"expected {' or '.join(map(repr, tags))}{did_you_mean(value.get(tag), tags)}")
    else:
        yield Problem(key, found_in(detail), expectation(detail))


def problems_in_tables(error: ValidationError, top: type[BaseModel],
                       tables: Mapping[str, type[BaseModel]]) -> Iterator[Problem]:
    """Yield the problems of a validated file other than a scene: `top` has its keys, `tables` those of its tables."""
    for detail in error.errors(include_url=False):
        location, found = detail["loc"], shown(detail["input"])
        key = shortened(".".join(str(part) for part in location if part != "[key]")) or "file"
        if detail["type"] == "inconsistent":
            for field, wrong, expected in detail["ctx"]["found"]:
                yield Problem(f"{key}.{field}" if location else field, shown(wrong), expected)
        elif detail["type"] == "extra_forbidden":
            known = (tables.get(str(location[0]), top) if len(location) > 1 else top).model_fields
            hint = did_you_mean(str(location[-1]), known) or f"; expected one of: {names(known)}"
            yield Problem(key, found, f"unknown key{hint}")
        else:
            yield Problem(key, found_in(detail), expectation(detail))


def found_in(detail: Mapping[str, Any]) -> str:
    """Word the value at which pydantic found an error."""
    return "nothing" if detail["type"] == "missing" else shown(detail["input"])


def expectation(detail: Mapping[str, Any]) -> str:
    """Word the expectation of a value of which pydantic describes an error."""
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "value_error":
        return str(context["error"])
    if kind == "literal_error":
        options = context["expected"].split("'")[1::2]
        return f"expected {context['expected']}{did_you_mean(detail['input'], options)}"
    return _EXPECTED[kind].format(**context) if kind in _EXPECTED else detail["msg"]
