"""The methods section of a paper about a run; its text is ``templates/paper.md``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import pandas as pd

from stiction.comparisons.bench.results import Results
from stiction.engines.registry import own_methods
from stiction.reports.markdown.failures import failed_runs
from stiction.reports.run_folder.data import in_words
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.text import one_line, paragraphs, render_blocks, template
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
"""Citations of engines with their methods, and of libraries; the keys are those of ``references.bib``."""
TEMPLATE = "paper.md"
"""Path of the text in ``templates``."""
EVENT_DRIVEN = "event"
"""Setting ``method`` of event-driven integration by the reference."""
TRIAL = "trial"
"""Setting ``solver`` of event-driven integration that tries contact modes instead of solving an LCP."""
PAPERS_SCHEME = "paper"
"""Setting ``method`` of the time-stepping scheme of the paper."""
INTEGRATION_KINDS = (EVENT_DRIVEN, TRIAL, PAPERS_SCHEME)
"""Ways in which the reference integrates, in the order of the text."""
HASH_LENGTH = 12
"""Number of digits of the hash of a commit in the text."""


def methods(run: StoredRun, results: Results) -> list[str]:
    """Return the paragraphs of the section; ``[@key]`` cites an entry of ``references.bib``."""
    blocks = render_blocks(template(TEMPLATE), _variables(run, results))
    return paragraphs(blocks["methods"])


def tracing() -> str:
    """Return the paragraph that explains the keys of the rows of tables."""
    return one_line(render_blocks(template(TEMPLATE), {}, "tracing")["tracing"])


def _variables(run: StoredRun, results: Results) -> dict[str, object]:
    """Return the variables of the template."""
    origin = run.origin
    campaign = origin["campaign"]
    machine = origin["machine"]
    tiers = _tiers(run.tables)
    own_engines = own_methods()
    commit = None
    if origin["commit"]:
        commit = {
            "hash": origin["commit"]["hash"][:HASH_LENGTH],
            "dirty": origin["commit"]["dirty"],
        }
    return {
        **_own_runs(run.tables["runs"]),
        "engines": [
            _name_with_citation(name, version)
            for name, version in origin["engines"].items()
            if name not in own_engines
        ],
        "tiers": [tier.label for tier in tiers],
        "independent": [tier.label for tier in tiers if tier not in (Tier.OWN_RUN, Tier.NONE)],
        "own_run": Tier.OWN_RUN in tiers,
        "proven": Tier.PROVEN in tiers,
        "samples": _samples(run.tables.get("cost", pd.DataFrame())),
        "depth": campaign.get("depth", ""),
        "interrupted": bool(campaign.get("interrupted")),
        "date": origin["date"][:10],
        "runs": len(results.records) or results.unrecorded_runs,
        "scenes": _scenes(results),
        "timed": sum(
            len(results.tables.get(name, ())) for name in ("cost", "effects", "suppression")
        ),
        "failed": len(failed_runs(results)),
        "commit": commit,
        "software": _software(origin["versions"]),
        "machine": {
            "cpu": machine["cpu"],
            "cores": machine["logical cores"],
            "os": machine["os"],
        },
        "choices": origin["choices"],
    }


def _scenes(results: Results) -> list[str]:
    """Return the names of the compared scenes; of scenes that are not the paper's cases the titles."""
    return [
        name if results.is_of_paper(name) else results.title_of(name)
        for name in results.compared_scenes
    ]


def _software(versions: Mapping[str, str]) -> dict[str, object]:
    """Return the versions of stiction, of Python and of the other libraries as text with citations."""
    return {
        "stiction": _name_with_citation("stiction", versions["stiction"]),
        "python": versions["python"],
        "others": [
            _name_with_citation(name, version)
            for name, version in versions.items()
            if name not in ("stiction", "python")
        ],
    }


def _own_runs(runs: pd.DataFrame) -> dict[str, object]:
    """Return the integration methods and the stabilizations that occur in the runs of the reference.

    Returns
    -------
    dict
        ``integration``: kind (of `INTEGRATION_KINDS`) and step sizes or tolerances of each method;
        ``stabilizations``: kind and parameters of each stabilization.
    """
    steps: dict[str, set[float]] = {kind: set() for kind in INTEGRATION_KINDS}
    stabilizations: dict[str, dict[str, str]] = {}
    # A table without rows has no columns, either.
    own_runs = runs
    if not runs.empty:
        own_runs = runs[(runs["engine"] == "reference") & runs["settings"].notna()]
    for row in own_runs.to_dict("records"):
        settings = json.loads(row["settings"])
        kind = settings.get("method")
        if kind == EVENT_DRIVEN and settings.get("solver") == TRIAL:
            kind = TRIAL
        # Other values of the setting are methods for comparison, which the text does not mention.
        if kind in steps:
            steps[kind].add(float(row["step"]))
        stabilization = settings.get("stabilization")
        if stabilization is not None:
            stabilizations[in_words(stabilization)] = _stabilization(stabilization)
    integration = [
        {"kind": kind, "steps": [f"{step:g}" for step in sorted(values, reverse=True)]}
        for kind, values in steps.items()
        if values
    ]
    return {"integration": integration, "stabilizations": list(stabilizations.values())}


def _stabilization(setting: str | Mapping[str, Any]) -> dict[str, str]:
    """Return kind and parameters of a stabilization, which is a name or a mapping with a method."""
    if isinstance(setting, str):
        return {"kind": setting, "parameters": ""}
    parameters = ", ".join(
        f"{name} = {in_words(value)}" for name, value in setting.items() if name != "method"
    )
    return {"kind": str(setting["method"]), "parameters": parameters}


def _samples(cost: pd.DataFrame) -> dict[str, int] | None:
    """Return numbers of samples of the timed runs, or None if no run was timed.

    Returns
    -------
    dict or None
        ``most``: largest number of samples of a run; ``single``: number of runs with one sample;
        ``runs``: number of timed runs.
    """
    if "repeats" not in cost:
        return None
    samples = cost["repeats"].dropna().astype(int)
    if not samples.any():
        return None
    return {
        "most": int(samples.max()),
        "single": int((samples == 1).sum()),
        "runs": len(samples),
    }


def _tiers(tables: Mapping[str, pd.DataFrame]) -> list[Tier]:
    """Return the tiers of the truths with which errors and thresholds were compared, each once."""
    tiers: list[Tier] = []
    for name in ("accuracy", "threshold"):
        if name in tables and "truth_tier" in tables[name]:
            tiers += [Tier(tier) for tier in tables[name]["truth_tier"].dropna()]
    return list(dict.fromkeys(tiers))


def _name_with_citation(name: str, version: str) -> str:
    """Return name and version of an engine or library, with its citation if there is one."""
    citation = f" [{CITED[name]}]" if name in CITED else ""
    return f"{name} {version}{citation}"
