"""The methods paragraphs: what was done, with which versions and settings, from a run's provenance and tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from stiction.comparisons.results import Results
from stiction.comparisons.truth import PROVEN
from stiction.reports.markdown.losses import losses
from stiction.reports.run_folder.stored_run import StoredRun

CITED = {"exudyn": "@exudyn; @chung1993; @arnold2007", "pymunk": "@pymunk", "pybullet": "@pybullet", "mujoco": "@mujoco", "moreau": "@moreau1988; @flores2010",
         "stiction": "@stiction", "numpy": "@numpy", "scipy": "@scipy", "numba": "@numba", "pandas": "@pandas", "matplotlib": "@matplotlib"}
"""Engines, with their methods, and libraries that ``references.bib`` has entries for."""
_PROVEN = (" Where it is proven, its positions, velocities and times of events are enclosed in ball arithmetic, and every inequality that decides on "
           "contact is verified.")


def methods(run: StoredRun, validation: Results) -> list[str]:
    """Paragraphs; ``[@key]`` cites an entry of ``references.bib``."""
    tables, origin = run.tables, run.origin
    variants = tables["variants"]
    own = variants[variants["engine"] == "reference"] if len(variants) else variants
    return [" ".join(filter(None, sentences)) for sentences in (
        (_method(), _integration(own), _stabilization(own)),
        (_engines(origin), _truth(tables), _orders(tables)),
        (_campaign(validation, origin), _machine(origin), _choices(origin)))]


def _method() -> str:
    return ("The reference implementation follows Zhuang and Wang [@zhuang2014]: rigid bodies in Cartesian coordinates, bilateral constraints "
            "with multipliers, and set-valued Coulomb friction in the translational joints, whose corner forces and accelerations satisfy a "
            "horizontal linear complementarity problem that Lemke's method [@lemke1965; @cottle1992] solves.")


def _integration(own: pd.DataFrame) -> str:
    if own.empty:
        return ""
    parts = []
    trial = own["other settings"].str.contains("solver = trial")
    if len(event := own[(own["method"] == "event") & ~trial]):
        parts.append("event-driven, with contact modes frozen between located events, by the explicit Runge-Kutta method DOP853 of order 8(5,3) of "
                     f"Hairer, Nørsett and Wanner [@hairer1993] with relative tolerances {_ladders(event)}")
    if trial.any():
        parts.append(f"the same with the contact forces found by trial and error [@klepp1996] with relative tolerances {_ladders(own[trial])}")
    if len(paper := own[own["method"] == "paper"]):
        parts.append(f"as in that paper, by the classical Runge-Kutta method of fixed step with steps (s) {_ladders(paper)}")
    return f"It integrates {'; '.join(parts)}." if parts else ""


def _ladders(variants: pd.DataFrame) -> str:
    """All steps or tolerances, as text."""
    values = {value for ladder in variants["ladder"] for value in ladder.partition(" = ")[2].split(", ")}
    return ", ".join(sorted(values, key=float, reverse=True))


def _stabilization(own: pd.DataFrame) -> str:
    if own.empty:
        return ""
    words = {"none": "none", "projection": "projection onto the constraints after each step"}
    used = [words.get(value, f"that of Baumgarte [@baumgarte1972; @flores2011], {value.partition(' ')[2].strip('()')}")
            for value in dict.fromkeys(own["stabilization"]) if value]
    return f"Constraint stabilization: {'; '.join(used)}." if used else ""


def _engines(origin: Mapping[str, Any]) -> str:
    told = [_cited(name, version) for name, version in origin["engines"].items() if name != "reference"]
    return (f"It was compared with {', '.join(told)}. Who supplies the friction law, engine or adapter, is part of the settings of each variant."
            if told else "")


def _cited(name: str, version: str) -> str:
    return f"{name} {version}" + (f" [{CITED[name]}]" if name in CITED else "")


def _truth(tables: Mapping[str, pd.DataFrame]) -> str:
    tiers = dict.fromkeys(tier for name in ("accuracy", "threshold") if "truth tier" in tables.get(name, ())
                          for tier in tables[name]["truth tier"].dropna())
    return (f"Errors are measured against truths of the tier \"{', '.join(tiers)}\": the mechanism in its own minimal coordinates, without "
            "constraint Jacobian or complementarity problem, its uncertainty the difference of two discretizations."
            f"{_PROVEN if PROVEN in tiers else ''} An engine without a "
            "static coefficient of friction is compared with the truth for equal coefficients." if tiers else "")


def _orders(tables: Mapping[str, pd.DataFrame]) -> str:
    return ("Observed orders and grid convergence indices follow Celik et al. [@celik2008]; CPU times are medians of runs made one at a time, "
            "without set-up, compiling or output." if len(tables.get("cost", ())) else "")


def _campaign(validation: Results, origin: Mapping[str, Any]) -> str:
    campaign, scenes = origin["campaign"], dict.fromkeys(record.scene for record in validation.records)
    lost = len(losses(validation))
    depth = f" (depth: {campaign['depth']})" if "depth" in campaign else ""
    return (f"The campaign{depth} of {origin['date'][:10]} made {len(validation.records)} runs of "
            f"{', '.join(scenes) or 'no scene'}, and {_timed(validation)} more for the comparisons of cost; "
            f"{lost or 'none'} did not come out whole." + (" It was interrupted: all numbers are of the runs that were made until then." if campaign.get("interrupted") else ""))


def _timed(validation: Results) -> int:
    return sum(len(validation.tables.get(name, ())) for name in ("cost", "effects", "suppression"))


def _machine(origin: Mapping[str, Any]) -> str:
    commit, machine, versions = origin["commit"], origin["machine"], origin["versions"]
    revision = "" if commit is None else f" (commit {commit['hash'][:12]}{', with uncommitted changes' if commit['dirty'] else ''})"
    others = ", ".join(_cited(name, version) for name, version in versions.items() if name not in ("stiction", "python"))
    return (f"Software: {_cited('stiction', versions['stiction'])}{revision}, Python {versions['python']}, {others}. Machine: {machine['cpu']}, "
            f"{machine['logical cores']} logical cores, {machine['os']}.")


def _choices(origin: Mapping[str, Any]) -> str:
    return "What the paper leaves open: " + "; ".join(f"{name}: {text}" for name, text in origin["choices"].items()) + "."
