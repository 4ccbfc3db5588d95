"""Error messages for scenes and other files that people write, in the terms of the file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from stiction.scenes.base_errors import InputError
from stiction.scenes.laws import Law
from stiction.scenes.model import Scene, Stabilization
from stiction.scenes.wording import did_you_mean, names, shortened, shown

_UNIONS = (Union, UnionType)
_MAX_SHOWN = 20
"""Largest number of problems in one message, which then fits on a screen."""
_MAX_PROBLEMS = 1000
"""Largest number of problems that an error holds; a hostile file may have a million."""
_MAX_ORIGIN = 200
"""Largest number of characters of a file's name in a message."""


@dataclass(frozen=True)
class Problem:
    """A problem in a file."""

    key: str
    """Where it is: the dotted key in the file, or ``"file"`` for the file as a whole"""
    found: str
    """The value that was found, as a text"""
    expected: str
    """What was expected instead"""

    def __str__(self) -> str:
        return f"{self.key}: found {self.found}; {self.expected}"


class FileError(InputError):
    """A file cannot be used.

    Attributes
    ----------
    origin : str
        The name of the file.
    problems : tuple of Problem
        All problems of the file, or the first 1000.
    """

    def __init__(self, origin: str, problems: Iterable[Problem]):
        self.origin = origin
        self.problems = tuple(islice(problems, _MAX_PROBLEMS))
        super().__init__("\n".join(self._message_lines()))

    def _message_lines(self) -> Iterator[str]:
        """Yield a title with the number of problems, and the first of them."""
        count = len(self.problems)
        plural = "s" if count > 1 else ""
        or_more = " or more" if count == _MAX_PROBLEMS else ""
        yield f"{shortened(self.origin, _MAX_ORIGIN)}: {count} problem{plural}{or_more}"
        for problem in self.problems[:_MAX_SHOWN]:
            yield f"  {problem}"
        if count > _MAX_SHOWN:
            yield f"  ... and {count - _MAX_SHOWN} more"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments of the constructor; by default an exception pickles its message."""
        return type(self), (self.origin, self.problems)


class SceneError(FileError):
    """A scene cannot be used; the message lists all of its problems."""


def _classes_by_tag(annotation: Any) -> dict[str, type[BaseModel]]:
    """Return the classes that a table of a file may have, by their tag.

    The tag is the value of the first field of the classes of a union, such as ``"revolute"``. A table with one class
    has an empty tag. The result is empty if the annotation is not that of a table.
    """
    annotation = _strip_annotation(annotation)
    members: tuple[Any, ...] = (annotation,)
    if get_origin(annotation) in _UNIONS:
        members = get_args(annotation)
    if not all(isinstance(member, type) and issubclass(member, BaseModel) for member in members):
        return {}
    if len(members) == 1:
        return {"": members[0]}
    classes = {}
    for member in members:
        tag_field = next(iter(member.model_fields.values()))
        [tag] = get_args(tag_field.annotation)
        classes[tag] = member
    return classes


def _strip_annotation(annotation: Any) -> Any:
    """Return a type without the metadata of `Annotated`, and without None if it is optional."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _strip_annotation(get_args(annotation)[0])
    if origin in _UNIONS:
        members = [member for member in get_args(annotation) if member is not NoneType]
        if len(members) == 1:
            return _strip_annotation(members[0])
    return annotation


LAWS = _classes_by_tag(Law)
"""Type -> class of a law of time."""
STABILIZATIONS = _classes_by_tag(Stabilization)
"""Method -> class of the stabilization."""
ELEMENTS = {
    section: _classes_by_tag(get_args(Scene.model_fields[section].annotation)[1])
    for section in ("bodies", "joints", "drives", "springs", "forces")
}
"""Section -> type -> class of its elements; bodies and drives have one class each, with an empty type."""


def _resolve_location(
    top: type[BaseModel], location: Sequence[str | int]
) -> tuple[str, dict[str, type[BaseModel]], Any]:
    """Translate pydantic's location of an error into a key of the file.

    Parameters
    ----------
    top
        The class of the file.
    location
        Keys and indices, from the top of the file. It also contains the tags of unions and ``"[key]"``, which are not
        keys of the file.

    Returns
    -------
    key : str
        The dotted key; ``"file"`` for the file as a whole.
    classes : dict
        The classes of the table that contains the key, by tag.
    annotation : type or None
        The type of the value; None if the table has no such key.
    """
    parts: list[str] = []
    classes: dict[str, type[BaseModel]] = {"": top}
    annotation: Any = top
    for part in location:
        inner = _classes_by_tag(annotation)
        if len(inner) > 1:
            # The tag of a union selects one of its classes.
            classes = inner
            annotation = inner[str(part)]
            continue
        if part == "[key]":
            continue
        parts.append(str(part))
        if inner:
            # A key of a table. If its class was selected from a union, `classes` remains the union.
            [model] = inner.values()
            if model not in classes.values():
                classes = inner
            field = model.model_fields.get(str(part))
            annotation = None if field is None else field.annotation
        else:
            annotation = _item_annotation(annotation)
    return shortened(".".join(parts)) or "file", classes, annotation


def _item_annotation(annotation: Any) -> Any:
    """Return the type of the values of a mapping, or of the entries of a list; None for other types."""
    annotation = _strip_annotation(annotation)
    container = get_origin(annotation)
    if container is dict:
        return get_args(annotation)[1]
    if container is tuple:
        return get_args(annotation)[0]
    return None


def _unknown_key(top: type[BaseModel], location: Sequence[str | int]) -> str:
    """Return the message for a key that its table does not have; `location` as in `_resolve_location`."""
    *table_location, name = location
    key, classes, _ = _resolve_location(top, location)
    if name in top.model_fields:
        return "unknown key: it belongs at the top of the file, above the first [table]"
    model = classes.get("") or classes[str(table_location[-1])]
    hint = did_you_mean(name, model.model_fields) or (
        f"; expected one of: {names(model.model_fields)}"
    )
    # A key of another class of the union: the type was changed, for example by an override, while
    # the keys of the former type remained.
    owners = [tag for tag, other in classes.items() if tag and name in other.model_fields]
    if owners:
        return (
            f"unknown key of {table_location[-1]!r}, one of {' and '.join(map(repr, owners))}"
            f'{hint}; what a base has is removed by unset = ["{key}"] or --set {key}='
        )
    return f"unknown key{hint}"


# pydantic's type of an error -> what was expected; fields in braces are those of its context.
_EXPECTED = {
    "string_type": "expected text",
    "string_too_long": "expected at most 60 characters",
    "string_pattern_mismatch": "expected a name: a letter of a-z or A-Z, then such letters, digits, _ or -",
    "missing": "this key is required",
    "extra_forbidden": "unknown key",
    "tuple_type": "expected a list",
    "model_type": "expected a table",
    "model_attributes_type": "expected a table",
    "dict_type": "expected a table",
    "greater_than": "expected a number > {gt:g}",
    "greater_than_equal": "expected a number >= {ge:g}",
    "too_short": "expected at least {min_length}",
    "too_long": "expected a list of {max_length}",
}


def problems_of(error: ValidationError, top: type[BaseModel]) -> Iterator[Problem]:
    """Translate the errors of a validation by pydantic.

    Parameters
    ----------
    error
        What ``top.model_validate`` raised.
    top
        The class of the file.

    Yields
    ------
    Problem
        Each problem in the terms of the file.
    """
    for detail in error.errors(include_url=False):
        kind = detail["type"]
        location = detail["loc"]
        value = detail["input"]
        context = detail.get("ctx", {})
        key, _, annotation = _resolve_location(top, location)
        last = location[-1] if location else ""
        if kind == "inconsistent":
            # What `Model.inconsistencies` of a table yielded; the location is that of the table.
            for field, wrong, expected in context["found"]:
                yield Problem(f"{key}.{field}" if location else field, shown(wrong), expected)
        elif last == "[key]":
            yield Problem(key, f"the name {shown(value)}", _EXPECTED["string_pattern_mismatch"])
        elif kind == "missing" and isinstance(last, int):
            # pydantic reports each missing entry of a list; the first one stands for all.
            if last == len(value):
                yield Problem(key.rpartition(".")[0], shown(value), "expected a list of 2")
        elif kind == "extra_forbidden":
            yield Problem(key, shown(value), _unknown_key(top, location))
        elif kind.startswith("union_tag"):
            tag_key = context["discriminator"].strip("'")
            tags = _classes_by_tag(annotation)
            hint = did_you_mean(value.get(tag_key), tags)
            yield Problem(
                f"{key}.{tag_key}",
                shown(value.get(tag_key)),
                f"expected {' or '.join(map(repr, tags))}{hint}",
            )
        else:
            yield Problem(key, found_in(detail), expectation(detail))


def found_in(detail: Mapping[str, Any]) -> str:
    """Return the value at which pydantic found an error as a text; `detail` is an entry of its ``errors()``."""
    return "nothing" if detail["type"] == "missing" else shown(detail["input"])


def expectation(detail: Mapping[str, Any]) -> str:
    """Return what was expected where pydantic found an error; `detail` is an entry of its ``errors()``."""
    kind = detail["type"]
    context = detail.get("ctx", {})
    if kind == "value_error":
        return str(context["error"])
    if kind in ("literal_error", "enum"):
        # pydantic gives the options as one text, each in quotes.
        options = context["expected"].split("'")[1::2]
        return f"expected {context['expected']}{did_you_mean(detail['input'], options)}"
    if kind in _EXPECTED:
        return _EXPECTED[kind].format(**context)
    return detail["msg"]
