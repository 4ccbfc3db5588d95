"""Differences between the environments of two nights: versions of engines and packages, the machine and the commit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from typing import Any

ABSENT = "none"
"""Written in place of a version that one of two nights does not have."""
COMMIT_DIGITS = 12
"""Number of digits of a commit that are written; they identify it."""


def engine_versions(versions: Iterable[tuple[str, str | None]]) -> dict[str, str]:
    """Return the versions of engines by name, from pairs of name and version; pairs without a version are ignored.

    Different versions of one engine are joined by "and".
    """
    versions_of: dict[str, list[str]] = {}
    for engine, version in versions:
        if version is None:
            continue
        known = versions_of.setdefault(engine, [])
        if version not in known:
            known.append(version)
    return {engine: " and ".join(several) for engine, several in versions_of.items()}


def environment_changes(
    before: Mapping[str, Any],
    now: Mapping[str, Any],
    engines_before: Mapping[str, str],
    engines_now: Mapping[str, str],
) -> list[str]:
    """Return what changed from one night to another, for example ``"numba 0.61.0 -> 0.62.1"``.

    Parameters
    ----------
    before, now
        The `bench.environment.origin` of both nights.
    engines_before, engines_now
        Versions of the engines by name. An engine that only one of the nights has does not count as changed.
    """
    pairs = chain(
        _engine_pairs(engines_before, engines_now),
        _pairs(before.get("versions", {}), now.get("versions", {})),
        _pairs(before.get("machine", {}), now.get("machine", {})),
        [("commit", short_commit(before.get("commit")), short_commit(now.get("commit")))],
    )
    changes: dict[str, str] = {}
    for name, old, new in pairs:
        # An engine may also be listed among the packages: its first entry counts.
        if old != new and name not in changes:
            changes[name] = f"{name} {old} -> {new}"
    return list(changes.values())


def _engine_pairs(
    before: Mapping[str, str], now: Mapping[str, str]
) -> Iterator[tuple[str, str, str]]:
    """Yield name and both versions of each engine that both nights have."""
    for name, version in before.items():
        if name in now:
            yield name, version, now[name]


def _pairs(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield name and both values of each entry that one of the nights has."""
    for name in {**before, **now}:
        yield name, str(before.get(name, ABSENT)), str(now.get(name, ABSENT))


def short_commit(commit: str | None) -> str:
    """Return a commit with `COMMIT_DIGITS`, and with the suffix that tells that files differ from it."""
    if commit is None:
        return "unknown"
    digits, hyphen, suffix = commit.partition("-")
    return digits[:COMMIT_DIGITS] + hyphen + suffix
