"""Where the numbers come from: versions, machine, commit, settings, and the choices that the paper leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from stiction.comparisons.results import Results
from stiction.comparisons.environment import commit, machine, source_digest, versions
from stiction.reports.run_folder.reproduce import command

CHOICES = {
    "gravity": "the paper does not give g; it is a parameter of the scenes",
    "spring": "force -k (x - L0): natural length where the slider is at x = L0",
    "start": "slider at rest at x = L0, the bar horizontal and already turning at w0",
    "friction": "of the two coefficients mus, the larger, is the static one",
}
"""What the paper does not say, or what our copy of its text has lost, and what the scenes say instead."""


def provenance(validation: Results) -> dict[str, Any]:
    """All of it, ready for JSON."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "engines": engine_versions(validation),
        "machine": machine(),
        "commit": commit(),
        "source": source_digest(),
        "command": command(validation),
        "campaign": {**{name: _plain(value) for name, value in validation.settings.items()},
                     "runs": len(validation.records), "wall [s]": validation.wall_s, "cpu [s]": validation.cpu_s},
        "choices": CHOICES,
    }


def engine_versions(validation: Results) -> dict[str, str]:
    """By name, as the trajectories say; an engine none of whose runs ended has told no version, one that is not installed is left out."""
    told = {record.variant.engine: "unknown: none of its runs ended" for record in validation.records if record.outcome.status != "missing"}
    return told | {record.variant.engine: record.trajectory.version
                       for record in validation.records if record.trajectory is not None}


def _plain(value: Any) -> Any:
    """As JSON has it: mappings and sequences of numbers and text, anything else by its words."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(entry) for entry in value]
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)
