"""Provenance of the numbers: versions, machine, commit, settings, and the choices that the paper leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from stiction.comparisons.bench.environment import commit, machine, source_digest, versions
from stiction.comparisons.bench.results import Results
from stiction.engines.status import Status
from stiction.reports.run_folder.reproduce import command

CHOICES = {
    "gravity": "the paper does not give g; it is a parameter of the scenes",
    "spring": "force -k (x - L0): natural length where the slider is at x = L0",
    "start": "slider at rest at x = L0, the bar horizontal and already turning at w0",
    "friction": "of the two coefficients mus, the larger, is the static one",
}
"""Choices of the scenes where the paper, or our copy of its text, says nothing."""


def provenance(results: Results) -> dict[str, Any]:
    """Return all of it, ready for JSON; versions of engines as their trajectories state them."""
    campaign = {
        "runs": len(results.records),
        "wall_time": results.wall_s,
        "cpu_time": results.cpu_s,
    }
    engines = {
        record.variant.engine: "unknown: none of its runs ended"
        for record in results.records
        if record.outcome.status != Status.MISSING
    }
    engines |= {
        record.variant.engine: record.trajectory.version
        for record in results.records
        if record.trajectory
    }
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "engines": engines,
        "machine": machine(),
        "commit": commit(),
        "source": source_digest(),
        "command": command(results),
        "campaign": {**results.settings, **campaign},
        "choices": CHOICES,
    }


def commit_in_words(origin: Mapping[str, Any]) -> str:
    """Name the commit of a run, and whether there were changes beyond it."""
    commit = origin["commit"]
    return (
        commit["hash"] + " with uncommitted changes" * commit["dirty"]
        if commit
        else "not in a checkout"
    )
