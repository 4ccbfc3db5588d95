"""Problems of a scene, or of another file that people write, in the terms of the file."""

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
    """A scene that cannot be used; the message lists all of its problems."""


def _tables(kind: Any) -> dict[str, type[BaseModel]]:
    """The classes of a table by their tag, the value of the first key; by an empty one if it is one class."""
    kind = _plain(kind)
    members = get_args(kind) if get_origin(kind) in _UNIONS else (kind,)
    if not all(isinstance(member, type) and issubclass(member, BaseModel) for member in members):
        return {}
    tags = (
        [""]
        if len(members) == 1
        else [
            get_args(next(iter(member.model_fields.values())).annotation)[0] for member in members
        ]
    )
    return dict(zip(tags, members))


def _plain(kind: Any) -> Any:
    """A type without its metadata, and without None."""
    if get_origin(kind) is Annotated:
        return _plain(get_args(kind)[0])
    members = (
        [member for member in get_args(kind) if member is not NoneType]
        if get_origin(kind) in _UNIONS
        else []
    )
    return _plain(members[0]) if len(members) == 1 else kind


LAWS, STABILIZATIONS = _tables(Law), _tables(Stabilization)
ELEMENTS = {
    section: _tables(get_args(Scene.model_fields[section].annotation)[1])
    for section in ("bodies", "joints", "drives", "springs", "forces")
}
"""Section -> type -> class of its elements; bodies and drives have one class each."""


def _place(
    top: type[BaseModel], location: Sequence[str | int]
) -> tuple[str, dict[str, type[BaseModel]], Any]:
    """Key in a file of class `top`, pydantic's location without the tags of unions; classes of its table; its type."""
    parts: list[str] = []
    tables: dict[str, type[BaseModel]] = {"": top}
    kind: Any = top
    for part in location:
        inner = _tables(kind)
        if len(inner) > 1:
            # the tag of a union, which is in the location and not in the file
            tables, kind = inner, inner[str(part)]
            continue
        if part == "[key]":
            continue
        parts.append(str(part))
        if inner:
            [model] = inner.values()
            tables = tables if model in tables.values() else inner
            kind = model.model_fields[part].annotation if part in model.model_fields else None
        else:
            # the values of a mapping, the entries of a list
            kind = _plain(kind)
            inside, container = get_args(kind), get_origin(kind)
            kind = inside[container is dict] if container in (dict, tuple) else None
    return shortened(".".join(parts)) or "file", tables, kind


def _unknown(top: type[BaseModel], location: Sequence[str | int]) -> str:
    """Word the problem of a key that its table does not have. The location includes the tags of unions."""
    (*place, last), (key, tables, _) = location, _place(top, location)
    if last in top.model_fields:
        return "unknown key: it belongs at the top of the file, above the first [table]"
    fields = (tables.get("") or tables[str(place[-1])]).model_fields
    hint = did_you_mean(last, fields) or f"; expected one of: {names(fields)}"
    owners = [tag for tag, model in tables.items() if tag and last in model.model_fields]
    if owners:
        # a tag was changed, what belongs to the old one was not
        return (
            f"unknown key of {place[-1]!r}, one of {' and '.join(map(repr, owners))}{hint}; "
            f'what a base has is removed by unset = ["{key}"] or --set {key}='
        )
    return f"unknown key{hint}"


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
    """Yield the errors of a validated file in its terms; `top` is its class."""
    for detail in error.errors(include_url=False):
        kind, location, value = detail["type"], detail["loc"], detail["input"]
        context = detail.get("ctx", {})
        key, _, place = _place(top, location)
        last = location[-1] if location else ""
        if kind == "inconsistent":
            for field, wrong, expected in context["found"]:
                yield Problem(f"{key}.{field}" if location else field, shown(wrong), expected)
        elif last == "[key]":
            yield Problem(key, f"the name {shown(value)}", _EXPECTED["string_pattern_mismatch"])
        elif kind == "missing" and isinstance(last, int):
            if last == len(value):  # one problem for a list that is short by several
                yield Problem(key.rpartition(".")[0], shown(value), "expected a list of 2")
        elif kind == "extra_forbidden":
            yield Problem(key, shown(value), _unknown(top, location))
        elif kind.startswith("union_tag"):
            tag, tags = context["discriminator"].strip("'"), _tables(place)
            yield Problem(
                f"{key}.{tag}",
                shown(value.get(tag)),
                f"expected {' or '.join(map(repr, tags))}{did_you_mean(value.get(tag), tags)}",
            )
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
    if kind in ("literal_error", "enum"):
        options = context["expected"].split("'")[1::2]
        return f"expected {context['expected']}{did_you_mean(detail['input'], options)}"
    return _EXPECTED[kind].format(**context) if kind in _EXPECTED else detail["msg"]
