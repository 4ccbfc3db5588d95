"""Provenance of the numbers: versions, machine, commit, settings, and the choices that the paper leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from stiction.comparisons.bench.environment import commit, machine, source_digest, versions
from stiction.comparisons.bench.results import Results
from stiction.engines.status import Status
from stiction.reports.run_folder.reproduce import campaign_command

CHOICES = {
    "gravity": "the paper does not give g; it is a parameter of the scenes",
    "spring": "force -k (x - L0): natural length where the slider is at x = L0",
    "start": "slider at rest at x = L0, the bar horizontal and already turning at w0",
    "friction": "of the two coefficients mus, the larger, is the static one",
}
"""Choices of the scenes where the paper, or the available copy of its text, does not give a value."""


def provenance(results: Results) -> dict[str, Any]:
    """Return the provenance of a run, which JSON can represent.

    The versions of engines are those that their trajectories state.
    """
    campaign = {
        "runs": len(results.records),
        "wall_time": results.wall_s,
        "cpu_time": results.cpu_s,
    }
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "engines": _engine_versions(results),
        "machine": machine(),
        "commit": commit(),
        "source": source_digest(),
        "command": campaign_command(results),
        "campaign": {**results.settings, **campaign},
        # Other scenes than the paper's have nothing that the paper could leave open.
        "choices": CHOICES if results.is_about_paper else {},
    }


def _engine_versions(results: Results) -> dict[str, str]:
    """Return the version of each engine that took part, by name."""
    engine_versions = {
        record.variant.engine: "unknown: none of its runs ended"
        for record in results.records
        if record.outcome.status != Status.MISSING
    }
    for record in results.records:
        if record.trajectory is not None:
            engine_versions[record.variant.engine] = record.trajectory.version
    return engine_versions


def commit_in_words(origin: Mapping[str, Any]) -> str:
    """Return the commit in the provenance of a run as text, with a remark if there were uncommitted changes."""
    commit = origin["commit"]
    if not commit:
        return "not in a checkout"
    if commit["dirty"]:
        return f"{commit['hash']} with uncommitted changes"
    return commit["hash"]
