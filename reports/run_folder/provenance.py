"""Provenance of the numbers: versions, machine, commit, settings, and the choices that the paper leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from stiction.comparisons.environment import commit, machine, source_digest, versions
from stiction.comparisons.results import Results
from stiction.reports.run_folder.reproduce import command

CHOICES = {
    "gravity": "the paper does not give g; it is a parameter of the scenes",
    "spring": "force -k (x - L0): natural length where the slider is at x = L0",
    "start": "slider at rest at x = L0, the bar horizontal and already turning at w0",
    "friction": "of the two coefficients mus, the larger, is the static one",
}
"""Choices of the scenes where the paper, or our copy of its text, says nothing."""


def provenance(results: Results) -> dict[str, Any]:
    """Return all of it, ready for JSON."""
    campaign = {"runs": len(results.records), "wall [s]": results.wall_s, "cpu [s]": results.cpu_s}
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"), "versions": versions(),
        "engines": engine_versions(results), "machine": machine(), "commit": commit(), "source": source_digest(),
        "command": command(results), "campaign": {**_plain(results.settings), **campaign}, "choices": CHOICES}


def engine_versions(results: Results) -> dict[str, str]:
    """Return versions by engine, as the trajectories state them; an engine that is not installed is left out."""
    found = {record.variant.engine: "unknown: none of its runs ended" for record in results.records
             if record.outcome.status != "missing"}
    return found | {record.variant.engine: record.trajectory.version for record in results.records
                    if record.trajectory is not None}


def commit_in_words(origin: Mapping[str, Any]) -> str:
    """Name the commit of a run, and whether there were changes beyond it."""
    commit = origin["commit"]
    return commit["hash"] + " with uncommitted changes" * commit["dirty"] if commit else "not in a checkout"


def _plain(value: Any) -> Any:
    """Turn a value into what JSON has: mappings and sequences of numbers and text, anything else as text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(entry) for entry in value]
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)
