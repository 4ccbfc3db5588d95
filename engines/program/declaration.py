"""Declaration of a program that takes part as an engine, in a TOML file validated like a scene.

docs/how-to/program.md shows one with every key.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool, StrictFloat, StrictInt, StrictStr

from stiction.engines.protocol import EVENTS_LOCATED_BY, FRICTION_SUPPLIED_BY
from stiction.engines.shared.declared_engine import Declared
from stiction.scenes.fields import Model, Name
from stiction.scenes.wording import did_you_mean, names, shown

PLACEHOLDERS = {
    "scene": "path of the resolved scene (JSON)",
    "result": "path of the table to write",
    "events": "path of a JSON file that the program may write",
    "t_end": "simulated time in seconds",
    "dt": "step in seconds",
    "rtol": "relative tolerance",
    "output_step": "largest time between rows in seconds",
    "settings": "one argument `KEY=VALUE` for each setting; nothing else may be in this argument",
}
"""Words that are replaced if they are in braces in an argument, and what replaces them."""
RESERVED = {
    "dt",
    "rtol",
    "output_step",
    "accelerations",
    "friction_law",
    FRICTION_SUPPLIED_BY,
    EVENTS_LOCATED_BY,
}
"""Settings of every trajectory, which no declaration may define."""
_BRACES = re.compile(r"\{(\w+)\}")
_Words = Annotated[tuple[StrictStr, ...], Field(min_length=1)]


class Declaration(Model):
    """A program and how it is run."""

    name: Name
    command: _Words
    version: _Words
    folder: StrictStr = "."
    result: Literal["csv", "parquet"] = "csv"
    largest_file: Annotated[StrictInt, Field(ge=1, le=1024)] = 1024
    capabilities: Declared = Declared()
    settings: dict[Name, StrictBool | StrictInt | StrictFloat | StrictStr] = {}
    environment: dict[Name, StrictStr] = {}

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        used = set(_BRACES.findall(" ".join(self.command)))
        for i, word in enumerate(self.command):
            for unknown in set(_BRACES.findall(word)) - PLACEHOLDERS.keys():
                yield (
                    f"command.{i}",
                    word,
                    f"unknown {{{unknown}}}; expected one of {names(PLACEHOLDERS)}"
                    f"{did_you_mean(unknown, PLACEHOLDERS)}",
                )
            if "{settings}" in word and word != "{settings}":
                yield f"command.{i}", word, "expected {settings} as an argument of its own"
        # The command has to pass on what the run depends on: a step or a tolerance, settings, and a
        # file for events if the program is to locate these.
        can = self.capabilities
        refined, other = ("rtol", "dt") if can.adaptive else ("dt", "rtol")
        needed = {
            "scene",
            "result",
            refined,
            *["settings"] * bool(self.settings),
            *["events"] * can.locates_events,
        }
        for missing in sorted(needed - used):
            yield "command", self.command, f"expected {{{missing}}} among the arguments"
        if other in used:
            yield (
                "command",
                self.command,
                f"expected no {{{other}}}: capabilities.adaptive is {shown(can.adaptive)}",
            )
        for name in sorted(RESERVED & self.settings.keys()):
            yield (
                f"settings.{name}",
                self.settings[name],
                "another name: the suite gives this setting itself",
            )

    def arguments(self, values: dict[str, str], settings: list[str]) -> list[str]:
        """Return the arguments with values for the placeholders; they are never read by a shell."""
        filled = []
        for word in self.command[1:]:
            filled += (
                settings
                if word == "{settings}"
                else [_BRACES.sub(lambda found: values[found[1]], word)]
            )
        return filled
