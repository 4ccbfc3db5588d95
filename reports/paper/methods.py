"""What the methods paragraphs of a paper mention, from a run's provenance and tables; the text is ``paper.md``."""

from __future__ import annotations

import json
from collections.abc import Mapping

import pandas as pd

from stiction.comparisons.bench.results import Results
from stiction.engines.registry import own_methods
from stiction.reports.markdown.failures import failed_runs
from stiction.reports.run_folder.data import words
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.text import filled, one_line, paragraphs, template
from stiction.truths import Tier

CITED = {
    "exudyn": "@exudyn; @chung1993; @arnold2007",
    "pymunk": "@pymunk",
    "pybullet": "@pybullet",
    "mujoco": "@mujoco",
    "moreau": "@moreau1988; @flores2010",
    "stiction": "@stiction",
    "numpy": "@numpy",
    "scipy": "@scipy",
    "numba": "@numba",
    "pandas": "@pandas",
    "matplotlib": "@matplotlib",
}
"""Engines, with their methods, and libraries that ``references.bib`` has entries for."""
TEMPLATE = "paper.md"
EVENT_DRIVEN, TRIAL, PAPERS_SCHEME = "event", "trial", "paper"
"""Ways in which the reference integrates, in the order of the text; `TRIAL` is event-driven with another solver."""


def methods(run: StoredRun, results: Results) -> list[str]:
    """Return paragraphs; ``[@key]`` cites an entry of ``references.bib``."""
    return paragraphs(filled(template(TEMPLATE), _mentioned(run, results))["methods"])


def tracing() -> str:
    """Return the paragraph on keys of rows."""
    return one_line(filled(template(TEMPLATE), {}, "tracing")["tracing"])


def _mentioned(run: StoredRun, results: Results) -> dict[str, object]:
    origin, tables = run.origin, run.tables
    campaign, machine, versions = origin["campaign"], origin["machine"], origin["versions"]
    tiers = _tiers(tables)
    timed = sum(len(results.tables.get(name, ())) for name in ("cost", "effects", "suppression"))
    commit = origin["commit"]
    return {
        **_own_runs(tables["runs"]),
        "engines": [
            _cited(name, version)
            for name, version in origin["engines"].items()
            if name not in own_methods()
        ],
        "tiers": [tier.label for tier in tiers],
        "proven": Tier.PROVEN in tiers,
        "samples": _samples(tables.get("cost", pd.DataFrame())),
        "depth": campaign.get("depth", ""),
        "interrupted": bool(campaign.get("interrupted")),
        "date": origin["date"][:10],
        "runs": len(results.records),
        "scenes": list(dict.fromkeys(record.scene for record in results.records)),
        "timed": timed,
        "failed": len(failed_runs(results)),
        "commit": commit and {"hash": commit["hash"][:12], "dirty": commit["dirty"]},
        "software": {
            "stiction": _cited("stiction", versions["stiction"]),
            "python": versions["python"],
            "others": [
                _cited(name, version)
                for name, version in versions.items()
                if name not in ("stiction", "python")
            ],
        },
        "machine": {
            "cpu": machine["cpu"],
            "cores": machine["logical cores"],
            "os": machine["os"],
        },
        "choices": origin["choices"],
    }


def _own_runs(runs: pd.DataFrame) -> dict[str, object]:
    """How the reference integrates and stabilizes, from the settings that its runs state."""
    steps: dict[str, set[float]] = {EVENT_DRIVEN: set(), TRIAL: set(), PAPERS_SCHEME: set()}
    stabilizations: dict[str, dict[str, str]] = {}
    own = runs[(runs["engine"] == "reference") & runs["settings"].notna()] if len(runs) else runs
    for row in own.to_dict("records"):
        settings = json.loads(row["settings"])
        method = settings.get("method")
        if method == EVENT_DRIVEN and settings.get("solver") == TRIAL:
            method = TRIAL
        if method in steps:
            steps[method].add(float(row["step"]))
        if (given := settings.get("stabilization")) is not None:
            stabilization = given if isinstance(given, Mapping) else {"method": given}
            stabilizations[words(given)] = {
                "kind": str(stabilization["method"]),
                "parameters": ", ".join(
                    f"{name} = {words(value)}"
                    for name, value in stabilization.items()
                    if name != "method"
                ),
            }
    return {
        "integration": [
            {"kind": kind, "steps": [f"{step:g}" for step in sorted(found, reverse=True)]}
            for kind, found in steps.items()
            if found
        ],
        "stabilizations": list(stabilizations.values()),
    }


def _samples(cost: pd.DataFrame) -> dict[str, int] | None:
    """How many samples the times are medians of; None where nothing was timed."""
    samples = cost["repeats"].dropna().astype(int) if "repeats" in cost else pd.Series(dtype=int)
    if not samples.any():
        return None
    return {
        "most": int(samples.max()),
        "single": int((samples == 1).sum()),
        "runs": len(samples),
    }


def _tiers(tables: Mapping[str, pd.DataFrame]) -> list[Tier]:
    """Tiers of the truths that errors and thresholds are measured against."""
    return list(
        dict.fromkeys(
            Tier(tier)
            for name in ("accuracy", "threshold")
            if "truth_tier" in tables.get(name, ())
            for tier in tables[name]["truth_tier"].dropna()
        )
    )


def _cited(name: str, version: str) -> str:
    return f"{name} {version}" + (f" [{CITED[name]}]" if name in CITED else "")
