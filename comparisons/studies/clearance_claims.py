"""Verdicts on published statements about clearance, from the effects that the study `clearance` measures.

``data/clearance_claims.toml`` quotes each statement with its source and names the measure that tests it. As in the
study `claims`, a measure returns a margin, which is positive if the statement holds.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import pandas as pd

from stiction.comparisons.bench.results import PAPERS_CASES
from stiction.comparisons.measures.claim_measures import ClaimMargin
from stiction.comparisons.studies.claims import (
    CONTRADICTS,
    FAILS,
    HOLDS,
    NOT_TESTABLE,
    PARTLY,
    UNDECIDED,
)
from stiction.comparisons.studies.clearance_tables import (
    CLEARANCE,
    LIMIT_LOW,
    POSITION,
    RESTITUTION,
    START,
    uncertainty_of,
)
from stiction.engines.status import Status
from stiction.scenes.fields import Model

SLIDER_CRANK = "slider-crank-clearance"
"""Scene with the mechanism of Flores, Leine & Glocker."""
PUBLISHED_CLEARANCE = 1e-3
"""Its published clearance, m."""
PUBLISHED_RESTITUTION = 0.4
"""Its published coefficient of restitution."""
CONFIGURATIONS = ("flight_share", "one_corner_share", "adjacent_share", "opposite_share")
"""Columns with the parts of the time of the four configurations of a slider in a gap."""
NOT_SIMULATED = "the slider-crank was not simulated, or its steps do not resolve this"
"""Reason why a statement about the slider-crank is not decided, which applies if its rows are missing."""


class ClearanceClaim(Model):
    """A published statement; ``data/clearance_claims.toml`` describes the fields."""

    source: str
    words: str
    measure: str = ""
    remark: str = ""
    why: str = ""
    contradiction: str = ""


@dataclass(frozen=True)
class ClaimTables:
    """The tables with which statements are tested.

    Attributes
    ----------
    effects, limits : DataFrame
        Tables by `effects_table` and `limits_table` of `clearance_tables`.
    runs : DataFrame
        One row per run.
    """

    effects: pd.DataFrame
    limits: pd.DataFrame
    runs: pd.DataFrame

    def published_rows(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return the rows about the slider-crank with its published clearance and restitution that succeeded."""
        if CLEARANCE not in table:
            return table.iloc[:0]
        is_published = (
            table["scene"].eq(SLIDER_CRANK)
            & table[CLEARANCE].eq(PUBLISHED_CLEARANCE)
            & table[RESTITUTION].eq(PUBLISHED_RESTITUTION)
            & table["status"].eq(Status.OK)
        )
        return table[is_published]


def _unknown(reason: str) -> ClaimMargin:
    """Return the margin of a statement that is not decided."""
    return ClaimMargin(math.nan, why=reason)


def all_configurations(measured: ClaimTables) -> ClaimMargin:
    """Test that each of the four configurations of a slider in a gap lasts for a part of the time in some motion."""
    shares = measured.effects.reindex(columns=list(CONFIGURATIONS)).dropna()
    if shares.empty:
        return _unknown("no run was made, or the steps do not resolve the configurations")
    longest = shares.max()
    return ClaimMargin(float(longest.min()), bool((longest > 0.0).any()))


def changes_motion(measured: ClaimTables) -> ClaimMargin:
    """Test that the clearance changes the position by more than the uncertainty of this change, with every method."""
    rows = measured.published_rows(measured.effects)
    columns = [POSITION, uncertainty_of(POSITION)]
    changes = rows.reindex(columns=columns).dropna()
    if changes.empty:
        return _unknown(NOT_SIMULATED)
    margins = changes[POSITION] - changes[uncertainty_of(POSITION)]
    return ClaimMargin(float(margins.min()), bool((margins > 0.0).any()))


def is_negligible(measured: ClaimTables) -> ClaimMargin:
    """Test that there is a clearance below which the mean driving effort hardly changes, in each of the paper's cases.

    The margin is the smallest of these clearances among all cases and methods. Simulations can confirm that one exists,
    but cannot refute it: if none was determined, smaller clearances may still have one, and the statement is undecided.
    """
    limits = measured.limits
    if limits.empty or LIMIT_LOW not in limits:
        return _unknown("no clearance was determined")
    determined = limits[limits["scene"].isin(PAPERS_CASES) & limits[LIMIT_LOW].notna()]
    missing = sorted(set(PAPERS_CASES) - set(determined["scene"]))
    if missing:
        return _unknown(f"no clearance was determined for {', '.join(missing)}")
    return ClaimMargin(float(determined[LIMIT_LOW].min()))


def overlap_grows(measured: ClaimTables) -> ClaimMargin:
    """Test that the largest overlap grows as the step is reduced, from the coarsest to the finest step of each method.

    The margin is the smallest relative growth.
    """
    runs = measured.published_rows(measured.runs)
    if runs.empty or "largest_overlap" not in runs:
        return _unknown(NOT_SIMULATED)
    growths = []
    for _, method_runs in runs[runs[START] == 0].groupby("variant", sort=False):
        ordered = method_runs.sort_values("step", ascending=False)
        overlaps = ordered["largest_overlap"].to_numpy(float)
        if len(overlaps) > 1 and overlaps[0] > 0.0:
            growths.append(float(overlaps[-1] / overlaps[0] - 1.0))
    if not growths:
        return _unknown(NOT_SIMULATED)
    return ClaimMargin(min(growths), max(growths) > 0.0)


MEASURES: Mapping[str, Callable[[ClaimTables], ClaimMargin]] = {
    "all_configurations": all_configurations,
    "changes_motion": changes_motion,
    "is_negligible": is_negligible,
    "overlap_grows": overlap_grows,
}
"""Measures by the names in the data."""
MARGINS = {
    "all_configurations": "part of the time of the rarest configuration where it lasts longest; fails at 0",
    "changes_motion": "change of the slider's position less its uncertainty, m; fails at 0",
    "is_negligible": "smallest clearance up to which the mean torque changes by less than 1 %, m",
    "overlap_grows": "growth of the largest overlap from the coarsest to the finest step; fails at 0",
}
"""Meaning of the margin of each measure."""


@cache
def clearance_claims() -> tuple[ClearanceClaim, ...]:
    """Return the statements of ``data/clearance_claims.toml`` in their order."""
    file = resources.files("stiction.comparisons") / "data" / "clearance_claims.toml"
    entries = tomllib.loads(file.read_text(encoding="utf-8"))["claim"]
    return tuple(ClearanceClaim.model_validate(entry) for entry in entries)


def claims_table(measured: ClaimTables) -> pd.DataFrame:
    """Return one row per statement: source, words, verdict, and the margin or the reason why there is none."""
    return pd.DataFrame([_claim_row(claim, measured) for claim in clearance_claims()])


def _claim_row(claim: ClearanceClaim, measured: ClaimTables) -> dict[str, Any]:
    """Return the row of one statement."""
    row: dict[str, Any] = {"place": claim.source, "claim": claim.words}
    if claim.contradiction:
        return {**row, "verdict": CONTRADICTS, "why": claim.contradiction}
    if not claim.measure:
        return {**row, "verdict": NOT_TESTABLE, "why": claim.why}
    margin = MEASURES[claim.measure](measured)
    return {
        **row,
        "verdict": _verdict(margin),
        "why": margin.why,
        "margin": margin.margin,
        "margin_kind": MARGINS[claim.measure] + claim.remark,
    }


def _verdict(margin: ClaimMargin) -> str:
    """Return the verdict that follows from a margin."""
    if math.isnan(margin.margin):
        return UNDECIDED
    if margin.holds:
        return HOLDS
    return PARTLY if margin.some else FAILS
