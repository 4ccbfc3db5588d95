"""The methods paragraphs: what was done, with which versions and settings, from a run's provenance and tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from stiction.comparisons.bench.results import Results
from stiction.reports.markdown.failures import failed_runs
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.truths import PROVEN

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
METHOD = (
    "The reference implementation follows Zhuang and Wang [@zhuang2014]: rigid bodies in Cartesian coordinates, "
    "bilateral constraints with multipliers, and set-valued Coulomb friction in the translational joints, whose "
    "corner forces and accelerations satisfy a horizontal linear complementarity problem that Lemke's method "
    "[@lemke1965; @cottle1992] solves."
)
TIMES = "CPU times are {} of runs made one at a time, without set-up, compiling or output."


def methods(run: StoredRun, results: Results) -> list[str]:
    """Return paragraphs; ``[@key]`` cites an entry of ``references.bib``."""
    tables, origin, variants = run.tables, run.origin, run.tables["variants"]
    own = variants[variants["engine"] == "reference"] if len(variants) else variants
    others = [
        _cited(name, version) for name, version in origin["engines"].items() if name != "reference"
    ]
    compared = (
        f"It was compared with {', '.join(others)}. Who supplies the friction law, engine or adapter, is part "
        "of the settings of each variant."
    )
    return [
        " ".join(sentences)
        for sentences in (
            (METHOD, *_integration(own)),
            (
                *([compared] if others else []),
                *_truth(tables),
                *_times(tables.get("cost", pd.DataFrame())),
            ),
            (
                _campaign(results, origin),
                _machine(origin),
                "What the paper leaves open: "
                + "; ".join(f"{name}: {text}" for name, text in origin["choices"].items())
                + ".",
            ),
        )
    ]


def _times(cost: pd.DataFrame) -> Iterator[str]:
    """Say what the times are of: one sample of a run is no median."""
    if "repeats" in cost and (samples := cost["repeats"].dropna().astype(int)).any():
        least, most = samples.min(), samples.max()
        of = "single samples" if most == 1 else f"medians of up to {most} samples"
        if 1 == least < most:
            of += f", single samples for {(samples == 1).sum()} of {len(samples)} runs,"
        yield TIMES.format(of)


def _integration(own: pd.DataFrame) -> Iterator[str]:
    if own.empty:
        return
    trial = own["solver"] == "trial"
    texts = (
        (
            own[(own["method"] == "event") & ~trial],
            "event-driven, with contact modes frozen between located events, by the explicit Runge-Kutta method "
            "DOP853 of order 8(5,3) of Hairer, Nørsett and Wanner [@hairer1993] with relative tolerances",
        ),
        (
            own[trial],
            "the same with the contact forces found by trial and error [@klepp1996] with relative tolerances",
        ),
        (
            own[own["method"] == "paper"],
            "as in that paper, by the classical Runge-Kutta method of fixed step with steps (s)",
        ),
    )
    parts = []
    for rows, text in texts:
        steps = {
            value for ladder in rows["ladder"] for value in ladder.partition(" = ")[2].split(", ")
        }
        parts += [f"{text} {', '.join(sorted(steps, key=float, reverse=True))}"] if steps else []
    if parts:
        yield f"It integrates {'; '.join(parts)}."
    words = {"none": "none", "projection": "projection onto the constraints after each step"}
    baumgarte = "that of Baumgarte [@baumgarte1972; @flores2011], "
    if used := [
        words.get(value, baumgarte + value.partition(" ")[2].strip("()"))
        for value in own["stabilization"].unique()
        if value
    ]:
        yield f"Constraint stabilization: {'; '.join(used)}."


def _cited(name: str, version: str) -> str:
    return f"{name} {version}" + (f" [{CITED[name]}]" if name in CITED else "")


def _truth(tables: Mapping[str, pd.DataFrame]) -> Iterator[str]:
    tiers = dict.fromkeys(
        tier
        for name in ("accuracy", "threshold")
        if "truth_tier" in tables.get(name, ())
        for tier in tables[name]["truth_tier"].dropna()
    )
    if not tiers:
        return
    yield (
        f'Errors are measured against truths of the tier "{", ".join(tiers)}": the mechanism in its own minimal '
        "coordinates, without constraint Jacobian or complementarity problem, its uncertainty the difference of two "
        "discretizations."
    )
    if PROVEN in tiers:
        yield (
            "Where it is proven, its positions, velocities and times of events are enclosed in ball arithmetic, and "
            "every inequality that decides on contact is verified."
        )
    yield (
        "An engine without a static coefficient of friction is compared with the truth for equal coefficients."
    )


def _campaign(results: Results, origin: Mapping[str, Any]) -> str:
    campaign, scenes = origin["campaign"], dict.fromkeys(record.scene for record in results.records)
    depth = f" (depth: {campaign['depth']})" if "depth" in campaign else ""
    timed = sum(len(results.tables.get(name, ())) for name in ("cost", "effects", "suppression"))
    cut = " It was interrupted: all numbers are of the runs that were made until then."
    return (
        f"The campaign{depth} of {origin['date'][:10]} made {len(results.records)} runs of "
        f"{', '.join(scenes) or 'no scene'}, and {timed} more for the comparisons of cost. "
        f"Of these and of all other studies {len(failed_runs(results)) or 'none'} failed or ended early."
        f"{cut if campaign.get('interrupted') else ''}"
    )


def _machine(origin: Mapping[str, Any]) -> str:
    commit, machine, versions = origin["commit"], origin["machine"], origin["versions"]
    changes = ", with uncommitted changes" if commit and commit["dirty"] else ""
    revision = f" (commit {commit['hash'][:12]}{changes})" if commit else ""
    others = ", ".join(
        _cited(name, version)
        for name, version in versions.items()
        if name not in ("stiction", "python")
    )
    return (
        f"Software: {_cited('stiction', versions['stiction'])}{revision}, Python {versions['python']}, {others}. "
        f"Machine: {machine['cpu']}, {machine['logical cores']} logical cores, {machine['os']}."
    )
