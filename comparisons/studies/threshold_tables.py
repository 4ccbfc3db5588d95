"""Tables of the study of stick limits: thresholds of each method, true bands and those of engines, and the map."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.presentation.cells import intervals_text
from stiction.comparisons.bench.variants import Variant, has_static_coefficient, run_key
from stiction.comparisons.measures.engine_bands import Verdict, compared_bands
from stiction.comparisons.measures.reference_bands import Variation
from stiction.comparisons.measures.true_bands import TrueBands
from stiction.engines.isolation import Outcome
from stiction.engines.registry import label_of
from stiction.engines.status import Status
from stiction.scenes import Scene
from stiction.scenes.value_units import unit_of_value
from stiction.truths import Tier
from stiction.truths.bands import Band, stick_bands
from stiction.truths.physics import physics_over_values

PAPER_VALUE = None
"""The paper prints the threshold, but the number is lost in the only text there is; it is never guessed."""
MIDDLE = "threshold"
"""Column: middle of the bracket of a method's threshold."""
WITH_STICK = "with_stick"
"""Column: value at which the steady state has a stick phase, next to the threshold."""
WITHOUT_STICK = "without_stick"
"""Column: value beyond the threshold without a stick phase."""
ERROR = "threshold_error"
"""Column: difference of a method's threshold from the true one."""
UNCERTAINTY = "threshold_uncertainty"
"""Column: uncertainty of `ERROR`."""
CHANGE = "threshold_change"
"""Column: change of the threshold from the next coarser step."""
TRUE_THRESHOLD = "true_threshold"
"""Column: threshold of the truth."""
TRUE_UNCERTAINTY = "true_threshold_uncertainty"
"""Column: uncertainty of `TRUE_THRESHOLD`."""
TIER = "truth_tier"
"""Column: tier of the truth."""
AGAIN = "sticks_again"
"""Column: intervals with stick above the threshold."""
SCANNED = "scanned_to"
"""Column: upper end of the searched range."""
VARIED = "varied"
"""Column: key of the varied parameter, as in `vary`."""
VARIED_UNIT = "varied_unit"
"""Column: unit of the varied parameter; empty if it is not known or the parameter is a ratio."""
BANDS = "bands"
"""Name of the table of bands."""
MAP = "bands-map"
"""Name of the table of bands over the coefficient of friction."""
TRUE_VARIANT = "truth"
"""Label of the rows of the truth in the table of bands."""


def subject_of(scene: Scene, variation: Variation) -> dict[str, Any]:
    """Return the columns that name the scene, and what is varied in which unit."""
    return {
        "scene": scene.name,
        VARIED: variation.parameter,
        VARIED_UNIT: unit_of_value(scene, variation.parameter) or "",
    }


def threshold_table(
    scene: Scene,
    variation: Variation,
    variants: Sequence[Variant],
    outcomes: Sequence[Outcome],
    true: Mapping[bool, TrueBands],
) -> pd.DataFrame:
    """Return one row per variant and step; the values of the outcomes are those of `measure_bands`.

    The numerical uncertainty is the width of the bracket plus the rest of the transient. Along a refinement series the
    change from the next coarser step is added.
    """
    rows = []
    for variant, outcome in zip(variants, outcomes, strict=True):
        has_mus = has_static_coefficient(variant)
        about = _about_truth(scene, variation, has_mus, true[has_mus])
        series = outcome.value.series if outcome.value else [None] * len(variant.ladder)
        for step, threshold in zip(variant.ladder, series, strict=True):
            row = {
                **subject_of(scene, variation),
                "variant": variant.label,
                "engine": label_of(variant.engine),
                "fidelity": variant.fidelity,
                "parameter": variant.parameter,
                "step": step,
                "status": threshold.status if threshold else outcome.status,
                "reason": outcome.reason or (threshold.remark if threshold else ""),
                **about,
                "key": f"threshold/{run_key(scene, variant, step)}",
            }
            if threshold is not None:
                row |= {
                    WITH_STICK: threshold.with_stick,
                    WITHOUT_STICK: threshold.without_stick,
                    "runs": threshold.runs,
                    "residual": threshold.residual,
                }
            rows.append(row)
    return _with_errors(pd.DataFrame(rows))


def _about_truth(
    scene: Scene, variation: Variation, has_mus: bool, true: TrueBands
) -> dict[str, Any]:
    """Return the columns about the truth of a physics, and what is varied."""
    threshold = true.threshold
    tier = true.tier
    if threshold.F0 is None:
        tier = Tier.NONE
    elif threshold.theorem:
        tier = Tier.PROVEN
    again = []
    if threshold.F0 is not None:
        again = [band for band in stick_bands(true.bands) if band[0] > threshold.F0]
    return {
        TRUE_THRESHOLD: threshold.F0,
        TIER: tier,
        "truth_note": threshold.note,
        TRUE_UNCERTAINTY: threshold.uncertainty,
        "theorem": threshold.theorem,
        "paper_threshold": PAPER_VALUE,
        AGAIN: intervals_text(again),
        SCANNED: variation.searched.high if true.bands else np.nan,
        "mus": _static_coefficient(scene, variation, has_mus),
    }


def _static_coefficient(scene: Scene, variation: Variation, has_mus: bool) -> float:
    """Return mus of the joint that is looked at; nan for one whose friction does not depend on a normal force."""
    guide = physics_over_values(scene, has_mus).frictional_guides.get(variation.joint)
    if guide is None or guide.mu is None:
        return np.nan
    return guide.static_coefficient


def _with_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with the middle of each bracket, its error and uncertainty, if there is a bracket."""
    if WITH_STICK not in table:
        return table
    ends, residual = table[[WITH_STICK, WITHOUT_STICK]].astype(float), table.pop("residual")
    middle = 0.5 * (ends[WITH_STICK] + ends[WITHOUT_STICK])
    change = middle.dropna().groupby(table["variant"]).diff().abs().reindex(table.index)
    width = ends[WITHOUT_STICK] - ends[WITH_STICK]
    return table.assign(
        **ends,
        **{
            MIDDLE: middle,
            ERROR: middle - table[TRUE_THRESHOLD].astype(float),
            UNCERTAINTY: width + residual + change.fillna(0.0),
            CHANGE: change,
        },
    )


def band_table(
    scene: Scene,
    variation: Variation,
    variants: Sequence[Variant],
    outcomes: Sequence[Outcome],
    true: Mapping[bool, TrueBands],
) -> pd.DataFrame:
    """Return the true bands, a row each, and the intervals with stick of each variant with their verdicts."""
    rows: list[dict[str, Any]] = []
    searched = variation.searched
    for has_mus, bands in true.items():
        about = {
            **subject_of(scene, variation),
            "joint": variation.joint,
            "mus": _static_coefficient(scene, variation, has_mus),
            "range_low": searched.low,
            "range_high": searched.high,
            "resolution": searched.resolution,
        }
        about_truth = {**about, "variant": TRUE_VARIANT, "status": Status.OK}
        rows += [{**about_truth, **row} for row in band_rows(bands.bands, bands.tier)]
        for variant, outcome in zip(variants, outcomes, strict=True):
            if has_static_coefficient(variant) != has_mus:
                continue
            own = {
                **about,
                "variant": variant.label,
                "fidelity": variant.fidelity,
                "status": outcome.status,
                "reason": outcome.reason,
            }
            if outcome.value is None:
                rows.append({**own, "verdict": Verdict.NOT_COMPARED})
            else:
                rows += [{**own, **row} for row in compared_bands(outcome.value, bands)]
    table = pd.DataFrame(rows)
    # Where both physics are the same, as in a scene with mus = mu, the truth is listed once.
    return table.drop_duplicates(ignore_index=True)


def band_rows(bands: Iterable[Band], tier: Tier) -> Iterator[dict[str, Any]]:
    """Yield the columns of each true band; one that no independent solution confirms is that of our own run."""
    for band in bands:
        yield {
            "band_low": band.low,
            "band_high": band.high,
            "band_low_uncertainty": band.low_uncertainty,
            "band_high_uncertainty": band.high_uncertainty,
            "band_kind": band.kind,
            "depends_on_start": band.depends_on_start,
            "coexisting": ", ".join(band.coexisting),
            "truth_tier": tier if band.is_confirmed else Tier.OWN_RUN,
        }


def map_table(
    scene: Scene, variation: Variation, coefficients: Sequence[float], outcomes: Sequence[Outcome]
) -> pd.DataFrame:
    """Return the bands by the reference over the coefficient of friction, a row each."""
    rows = []
    for coefficient, outcome in zip(coefficients, outcomes, strict=True):
        about = {
            **subject_of(scene, variation),
            "mu": coefficient,
            "status": outcome.status,
            "reason": outcome.reason,
        }
        bands = outcome.value or ()
        rows += [{**about, **row} for row in band_rows(bands, Tier.OWN_RUN)] or [about]
    return pd.DataFrame(rows)
