"""Identity of the code, packages, machine and engines that the results of runs depend on.

Stored results are used again only if this identity has not changed. The identity of a single run is
defined by `bench.timing.timed_runs` (`computation`, `call_of`), `bench.planned_runs.PlannedRun` and
`bench.store`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

from stiction.comparisons.bench.environment import machine, source_digest, versions
from stiction.engines.registry import EngineMissing, load_engine


def circumstances(engines: Iterable[str]) -> list[Any]:
    """Return the code, versions, machine and engines (given by name) that results depend on."""
    return [source_digest(), versions(), machine(), [engine_identity(name) for name in engines]]


def engine_identity(name: str) -> list[str]:
    """Return name, version and content digest of an engine, or name and reason if it is missing.

    The digest is needed because a user's module or program may change without a new version.
    """
    try:
        engine = load_engine(name)
    except EngineMissing as error:
        return [name, str(error)]
    return [name, engine.version, hashlib.sha256(engine.content()).hexdigest()]
