"""What lists of engines show: all known engines, their fidelities and the defaults of their settings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from stiction.engines.protocol import Engine
from stiction.engines.registry import EngineMissing, engine_names, load_engine
from stiction.scenes.wording import as_given


class FidelityRow(NamedTuple):
    """The row of a fidelity: its name, ``"yes"`` if it has a static coefficient else ``"no"``, its friction law."""

    fidelity: str
    has_static_coefficient: str
    friction_law: str


class DefaultSettings(NamedTuple):
    """A table of settings: each row has the key of a setting and then its default in each fidelity."""

    heading: tuple[str, ...]
    rows: list[tuple[str, ...]]


def known_engines() -> Iterator[tuple[str, Engine | EngineMissing]]:
    """Yield the name of each known engine, and the engine or the error that says why it is missing."""
    for name in engine_names():
        try:
            engine: Engine | EngineMissing = load_engine(name)
        except EngineMissing as error:
            engine = error
        yield name, engine


def fidelity_rows(engine: Engine) -> list[FidelityRow]:
    """Return a row for each fidelity of an engine."""
    capabilities = engine.capabilities
    return [
        FidelityRow(
            fidelity,
            "yes" if capabilities.static_coefficient.get(fidelity) else "no",
            capabilities.friction_law.get(fidelity, ""),
        )
        for fidelity in capabilities.fidelities
    ]


def default_settings(engine: Engine) -> DefaultSettings:
    """Return the defaults of an engine's settings; a cell is empty where a fidelity does not have the setting."""
    by_fidelity = {
        fidelity: engine.default_settings(fidelity) for fidelity in engine.capabilities.fidelities
    }
    # Each key once, in the order in which the fidelities give them.
    keys: dict[str, None] = {}
    for defaults in by_fidelity.values():
        keys |= dict.fromkeys(defaults)
    rows = []
    for key in keys:
        cells = [
            as_given(defaults[key]) if key in defaults else "" for defaults in by_fidelity.values()
        ]
        rows.append((key, *cells))
    return DefaultSettings(("setting", *(f"default, {fidelity}" for fidelity in by_fidelity)), rows)
