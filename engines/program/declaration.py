"""Declaration of a program that takes part as an engine, in a TOML file validated like a scene.

docs/how-to/program.md shows one with every key.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool, StrictFloat, StrictInt, StrictStr

from stiction.engines.protocol import EVENTS_LOCATED_BY, FRICTION_SUPPLIED_BY, NEGLECTED
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
"""Words in braces in an argument, and their replacements."""
RESERVED = {
    "dt",
    "rtol",
    "output_step",
    "accelerations",
    "friction_law",
    FRICTION_SUPPLIED_BY,
    EVENTS_LOCATED_BY,
    NEGLECTED,
}
"""Settings of every trajectory, which no declaration may define."""
_BRACES = re.compile(r"\{(\w+)\}")
_Words = Annotated[tuple[StrictStr, ...], Field(min_length=1)]


class Declaration(Model):
    """A program, and how it is run as an engine.

    Attributes
    ----------
    name
        The name of the engine.
    command
        The program and its arguments, in which `PLACEHOLDERS` are replaced.
    version
        A command that prints the version of the program.
    folder
        The working folder of both commands, relative to the folder of the file with this declaration.
    result
        The format of the table that the program writes.
    largest_file
        The size in MiB at which a file of the program, or what it prints, ends the run.
    capabilities
        What the program can represent, and how it steps.
    settings
        The settings of the program, and their defaults.
    environment
        Environment variables that the program gets in addition.
    """

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
        """Yield each contradiction: the key, the value found, and what was expected."""
        yield from self._misused_placeholders()
        yield from self._wrong_arguments()
        yield from self._reserved_settings()

    def _misused_placeholders(self) -> Iterator[tuple[str, Any, str]]:
        """Yield placeholders that are unknown, and settings that are only a part of an argument."""
        for i, word in enumerate(self.command):
            for unknown in set(_BRACES.findall(word)) - PLACEHOLDERS.keys():
                yield (
                    f"command.{i}",
                    word,
                    f"unknown {{{unknown}}}; expected one of {names(PLACEHOLDERS)}"
                    f"{did_you_mean(unknown, PLACEHOLDERS)}",
                )
            # The settings become any number of arguments, so that they cannot be a part of one.
            if "{settings}" in word and word != "{settings}":
                yield f"command.{i}", word, "expected {settings} as an argument of its own"

    def _wrong_arguments(self) -> Iterator[tuple[str, Any, str]]:
        """Yield placeholders that are missing in the command, and a step or a tolerance that is of no use."""
        # The command has to pass on everything on which the run depends: the step or the tolerance,
        # the settings if there are any, and a file for events if the program is to locate them.
        capabilities = self.capabilities
        if capabilities.adaptive:
            accuracy = "rtol"
            unusable = "dt"
        else:
            accuracy = "dt"
            unusable = "rtol"
        needed = {"scene", "result", accuracy}
        if self.settings:
            needed.add("settings")
        if capabilities.locates_events:
            needed.add("events")
        used = set(_BRACES.findall(" ".join(self.command)))
        for missing in sorted(needed - used):
            yield "command", self.command, f"expected {{{missing}}} among the arguments"
        if unusable in used:
            yield (
                "command",
                self.command,
                f"expected no {{{unusable}}}: capabilities.adaptive is "
                f"{shown(capabilities.adaptive)}",
            )

    def _reserved_settings(self) -> Iterator[tuple[str, Any, str]]:
        """Yield settings with a name that the suite uses for every trajectory."""
        for name in sorted(RESERVED & self.settings.keys()):
            yield (
                f"settings.{name}",
                self.settings[name],
                "another name: the suite gives this setting itself",
            )

    def arguments(self, values: dict[str, str], settings: list[str]) -> list[str]:
        """Return the arguments with their placeholders replaced. No shell reads them."""
        arguments = []
        for word in self.command[1:]:
            if word == "{settings}":
                arguments += settings
            else:
                arguments.append(_BRACES.sub(lambda match: values[match[1]], word))
        return arguments
