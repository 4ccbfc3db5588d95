"""Values and names of a file, worded for messages: on one line, printable, short."""

from __future__ import annotations

import difflib
import json
from collections.abc import Collection, Iterable, Mapping
from itertools import islice
from typing import Any

_WIDTH = 80
_MANY = 200  # names: among more, the search for a close one would take longer than the rest of the loading


def shown(value: Any) -> str:
    """A value of a file."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, str):
        return f"'{shortened(value)}'"
    if isinstance(value, (list, tuple)):
        return shortened(
            f"[{', '.join(map(shown, value[:_WIDTH]))}{', ...' * (len(value) > _WIDTH)}]"
        )
    if isinstance(value, int) and abs(value) >= 10**_WIDTH:  # str() refuses integers of many digits
        return "a huge integer"
    return shortened(
        str(value) if isinstance(value, (int, float)) else f"{type(value).__name__} {value}"
    )


def as_given(value: Any) -> str:
    """A value as a command line takes it: words, and numbers and truth values as TOML has them."""
    return value if isinstance(value, str) else json.dumps(value)


def shortened(text: str, width: int = _WIDTH) -> str:
    """Text without characters that cannot be printed, cut to a width."""
    if len(text) > width:
        text = text[: width - 4] + " ..."
    return "".join(
        character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text
    )


def last_lines(text: str) -> str:
    """The last four lines of what was printed, in one."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return " | ".join(shortened(line, 200) for line in lines[-4:])


def names(known: Collection[str]) -> str:
    """Names in one line; the first of them, where they are many."""
    line = ", ".join(shortened(str(name)) for name in islice(known, _WIDTH))
    if len(line) <= 2 * _WIDTH and len(known) <= _WIDTH:
        return line
    return line[: 2 * _WIDTH].rpartition(", ")[0] + f", ... ({len(known)} in all)"


def did_you_mean(name: Any, known: Iterable[str]) -> str:
    """`" (did you mean 'x'?)"`, or nothing where no name is close."""
    known = list(islice(known, _MANY + 1))
    if not isinstance(name, str) or len(name) > _WIDTH or len(known) > _MANY:
        return ""
    close = difflib.get_close_matches(name, known, n=1)
    return f" (did you mean '{shortened(close[0])}'?)" if close else ""
