"""Short, printable texts of values and names, for messages of one line."""

from __future__ import annotations

import difflib
import json
from collections.abc import Collection, Iterable, Mapping
from itertools import islice
from typing import Any

_WIDTH = 80
"""Characters of a text, or entries of a list, that are shown: about a line of a terminal."""
_MAX_CANDIDATES = 200
"""Largest number of names among which a similar one is searched; with more, the search would take longer than loading
the scene."""
_LAST_LINES = 4
"""Lines at the end of a program's output that are shown; its error message is usually among them."""
_LINE_WIDTH = 200
"""Characters of each of these lines."""


def shown(value: Any) -> str:
    """Return the text by which messages show a value of a file."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, str):
        return f"'{shortened(value)}'"
    if isinstance(value, (list, tuple)):
        entries = [shown(entry) for entry in value[:_WIDTH]]
        if len(value) > _WIDTH:
            entries.append("...")
        return shortened(f"[{', '.join(entries)}]")
    # Python refuses to convert integers of thousands of digits.
    if isinstance(value, int) and abs(value) >= 10**_WIDTH:
        return "a huge integer"
    if isinstance(value, (int, float)):
        return shortened(str(value))
    return shortened(f"{type(value).__name__} {value}")


def as_given(value: Any) -> str:
    """Return a value as it is written on the command line: texts as they are, all others as in TOML."""
    return value if isinstance(value, str) else json.dumps(value)


def shortened(text: str, width: int = _WIDTH) -> str:
    """Return a text cut to `width` characters, with a replacement for each character that cannot be printed."""
    if len(text) > width:
        text = text[: width - 4] + " ..."
    return "".join(
        character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text
    )


def last_lines(text: str) -> str:
    """Return the last lines of the output of a program, joined to one line."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return " | ".join(shortened(line, _LINE_WIDTH) for line in lines[-_LAST_LINES:])


def names(entries: Collection[str]) -> str:
    """Return names as a text of one line; of many names, the first ones and their number."""
    line = ", ".join(shortened(str(name)) for name in islice(entries, _WIDTH))
    if len(line) <= 2 * _WIDTH and len(entries) <= _WIDTH:
        return line
    # Cut between two names.
    return line[: 2 * _WIDTH].rpartition(", ")[0] + f", ... ({len(entries)} in all)"


def did_you_mean(name: Any, candidates: Iterable[str]) -> str:
    """Return ``" (did you mean 'x'?)"`` with the most similar candidate; empty if none is similar."""
    candidates = list(islice(candidates, _MAX_CANDIDATES + 1))
    if not isinstance(name, str) or len(name) > _WIDTH or len(candidates) > _MAX_CANDIDATES:
        return ""
    matches = difflib.get_close_matches(name, candidates, n=1)
    return f" (did you mean '{shortened(matches[0])}'?)" if matches else ""
