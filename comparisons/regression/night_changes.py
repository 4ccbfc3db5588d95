"""What differs between two nights besides their numbers: versions of engines and packages, the machine, the commit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import chain
from typing import Any

ABSENT = "none"
"""Stands for a version that one of two nights does not have."""
COMMIT_SIGNS = 12
"""Signs of a commit that tell it from others."""


def engine_versions(versions: Iterable[tuple[str, str | None]]) -> dict[str, str]:
    """Return the versions of engines by name, from pairs of both in the runs of a night."""
    found: dict[str, list[str]] = {}
    for engine, version in versions:
        if version is not None and version not in found.setdefault(engine, []):
            found[engine].append(version)
    return {engine: " and ".join(several) for engine, several in found.items() if several}


def environment_changes(
    before: Mapping[str, Any],
    now: Mapping[str, Any],
    engines_before: Mapping[str, str],
    engines_now: Mapping[str, str],
) -> list[str]:
    """Return what changed from one night to another, as ``"numba 0.61.0 -> 0.62.1"``.

    `before` and `now` are what `bench.environment.origin` returned. An engine that has runs in one of
    the nights only is no change of its version.
    """
    both = {
        name: (version, engines_now[name])
        for name, version in engines_before.items()
        if name in engines_now
    }
    pairs = chain(
        both.items(),
        _pairs(before, now, "versions"),
        _pairs(before, now, "machine"),
        [("commit", (_short(before.get("commit")), _short(now.get("commit"))))],
    )
    found: dict[str, str] = {}
    for name, (old, new) in pairs:
        if old != new:
            found.setdefault(name, f"{name} {old} -> {new}")
    return list(found.values())


def _pairs(
    before: Mapping[str, Any], now: Mapping[str, Any], part: str
) -> list[tuple[str, tuple[str, str]]]:
    old, new = before.get(part, {}), now.get(part, {})
    return [
        (name, (str(old.get(name, ABSENT)), str(new.get(name, ABSENT)))) for name in {**old, **new}
    ]


def _short(commit: str | None) -> str:
    """A hash as short as people write it, with what says that files differ."""
    if commit is None:
        return "unknown"
    head, _, rest = commit.partition("-")
    return head[:COMMIT_SIGNS] + ("-" + rest if rest else "")
