"""Identity of what is run: two runs have the same one where everything is the same that their numbers depend on.

A run is identified by parts of these, by `computation` and `call_of` of `bench.timing.timed_runs`, and by
`bench.planned_runs.PlannedRun` and `bench.store`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

from stiction.comparisons.bench.environment import machine, source_digest, versions
from stiction.engines.registry import EngineMissing, load_engine


def circumstances(engines: Iterable[str]) -> list[Any]:
    """Return what numbers depend on besides the run: code, versions, machine, engines by their names."""
    return [source_digest(), versions(), machine(), [engine_identity(name) for name in engines]]


def engine_identity(name: str) -> list[str]:
    """Return name, version and digest of an engine: its author may change its module or program at the same version."""
    try:
        engine = load_engine(name)
    except EngineMissing as error:
        return [name, str(error)]
    return [name, engine.version, hashlib.sha256(engine.content()).hexdigest()]
