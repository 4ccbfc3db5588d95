"""The stick bands: all values of a parameter, within a range, for which the steady state has a stick phase.

The truth is `true_bands`: the bands that the event-driven reference finds, examined and refined by the return map of
the slider-bar where the scene has its structure. The threshold is the upper end of the interval with stick that
contains the scene's own value, or is next to it; `truths.proof.threshold` proves it. Every engine searches for the
threshold and for the other ends, and is asked whether it sticks at a few values over the whole range.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.methods import with_columns
from stiction.comparisons.bench.participants import extent, threshold_variants
from stiction.comparisons.bench.presentation import (
    METHOD,
    Axis,
    Chart,
    Column,
    Headline,
    Panel,
    Presentation,
    Series,
    row_of,
    view,
)
from stiction.comparisons.bench.presentation.cells import intervals_text, setting_of
from stiction.comparisons.bench.presentation.charts import TRUTH as TRUTH_LOOK
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables, unless_refused
from stiction.comparisons.bench.variants import Variant, has_static_coefficient, run_key, truth_key
from stiction.comparisons.measures.engine_threshold import (
    FIRST_STEP,
    Search,
    StickProbe,
    Threshold,
    arguments_of,
    measure_series,
    measure_threshold,
)
from stiction.comparisons.measures.reference_bands import (
    AMPLITUDE,
    Variation,
    bands_from_own_start,
    bands_of_reference,
    variation_of,
)
from stiction.comparisons.measures.settling import NotSettled
from stiction.engines.isolation import Outcome, Task
from stiction.engines.registry import label_of
from stiction.engines.status import Status
from stiction.scenes import Scene, vary
from stiction.truths import StickThreshold, Tier
from stiction.truths.bands import Band, stick_bands, threshold_of
from stiction.truths.physics import physics_of
from stiction.truths.proof.truth import threshold_of_theorem
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.stick_bands import examined_bands, mechanism_at
from stiction.truths.truth import NotThisMechanism
from stiction.uncertain import Uncertain

PAPER_VALUE = None
"""The paper prints the threshold, but the number is lost in the only text there is; it is never guessed."""
FIRST_PART = 0.1
"""Length of the first step of an engine's search, as a part of the value that it begins at."""
LOCATED_WIDTH = 1e-9
"""Width of the bracket of an engine with located events, in the unit of the parameter."""
BRACKET_RANGE = 12.0
"""N; range to which the width of a bracket of `depth.Extent` refers. For other parameters it is the same part of their
range."""
DEFAULT_VALUES = 60
"""Values in the range at the default depth of `stiction validate`, which has many other studies to make."""
SCAN_VALUES = 8
"""Values from end to end of the range, besides the middles of the bands, at which an engine is asked whether it sticks
at full depth: some runs at its coarsest step, which cost less than one bracket."""
COEFFICIENT = "mu"
"""Parameter over which bands are mapped."""
MAP_FACTORS = tuple(np.linspace(1 / 6, 7 / 6, 13))
"""Values of the map in units of the scene's own: for the paper's mu = 0.03 from 0.005 to 0.035 by 0.0025."""
SETTLES = 0.25
"""Part of an error by which the last refinement may still change it where it is said to be one: with more, finer steps
may remove it."""
CHANGE = "threshold_change"
TRUTH = "threshold truth"
"""Name of the comparison that `plan` requires."""
MIDDLE, ERROR, UNCERTAINTY = "F0_threshold", "threshold_error", "threshold_uncertainty"
TRUE_THRESHOLD, TIER = "true_threshold", "truth_tier"
AGAIN, SCANNED = "sticks_again", "scanned_to"
WITH_STICK, WITHOUT_STICK = "F0_with_stick", "F0_without_stick"
BANDS, MAP = "bands", "bands-map"
"""Names of the tables of bands."""
TRUE_VARIANT = "truth"
"""Label of the rows of the truth in the table of bands."""
CONSTANTS = {"settles": SETTLES, "most_named": 2}
"""What the text of the study mentions besides results: a part of an error, and the number of methods up to which its
answer, which is one line, names them."""


class Verdict(StrEnum):
    """How an engine's intervals with stick compare with the true ones."""

    FOUND = "found"
    """Both ends agree with the true ones within the brackets of the search."""
    SHIFTED = "shifted"
    """An end is off by more than its bracket."""
    MISSED = "missed"
    """The engine does not stick where the truth does."""
    INVENTED = "invented"
    """The engine sticks where the truth slips, beyond the shift of an end."""
    NOT_COMPARED = "not compared"
    """The run has failed."""


@dataclass(frozen=True)
class TrueBands:
    """The bands of a scene, and its threshold.

    Attributes
    ----------
    threshold : StickThreshold
        The threshold next to the scene's own value, in the unit of the parameter.
    bands : tuple of Band
        They cover the range.
    tier : Tier
        That of an independent solution, or of our own run.
    reason : str
        Why some value has no steady state.
    """

    threshold: StickThreshold
    bands: tuple[Band, ...]
    tier: Tier
    reason: str = ""


def true_bands(
    scene: Scene, variation: Variation, proven: StickThreshold | None = None
) -> TrueBands:
    """Return the bands of a scene by the best method that it has.

    Of a slider-bar, the bands of the reference are examined by the return map of the independent solution. `proven` is
    the threshold of a theorem about the scene, if there is one.
    """
    by_reference = bands_of_reference(scene, variation)
    bands, tier = by_reference.bands, Tier.OWN_RUN
    if variation.parameter != AMPLITUDE:
        proven = None
    if _is_slider_bar(scene):
        bands = examined_bands(mechanism_at(scene, variation.parameter), bands, proven)
        tier = Tier.HIGH_PRECISION
    threshold = _threshold(bands, variation)
    # The theorem is about the same end, with its bounds and words.
    if proven is not None and threshold.F0 == proven.F0:
        threshold = proven
    return TrueBands(threshold, bands, tier, by_reference.reason)


def _is_slider_bar(scene: Scene) -> bool:
    """Return True if the independent solution of the slider-bar applies."""
    try:
        SliderBar.from_scene(scene)
    except NotThisMechanism:
        return False
    return True


def _threshold(bands: Sequence[Band], variation: Variation) -> StickThreshold:
    """Return the threshold next to the scene's own value; one without a number if no band ends within the range."""
    sides = threshold_of(bands, variation.own)
    if sides is None:
        searched = variation.searched
        note = (
            f"no end of a band with stick above which the slider slips, for {variation.parameter} from "
            f"{searched.low:g} to {searched.high:g}"
        )
        return StickThreshold(None, None, (np.nan, np.nan), note)
    below, above = sides
    others = sorted({str(kind) for band in sides for kind in band.coexisting})
    note = ""
    if others:
        note = f"two steady states coexist: from another start the slider {' or '.join(others)}"
    uncertainty = below.high_uncertainty
    return StickThreshold(
        below.high, uncertainty, (below.high - uncertainty, below.high + uncertainty), note
    )


def variation_in(scope: Scope) -> Variation:
    """Return what the study varies in the first scene of a scope, by the options of the command."""
    options = scope.options
    variation = variation_of(
        scope.scenes[0],
        options.get("parameter"),
        options.get("joint"),
        options.get("range"),
        options.get("resolution"),
    )
    if scope.depth != Depth.DEFAULT or "resolution" in options:
        return variation
    searched = variation.searched
    resolution = (searched.high - searched.low) / DEFAULT_VALUES
    return replace(variation, searched=replace(searched, resolution=resolution))


def true_thresholds(scope: Scope) -> Comparison[dict[bool, TrueBands]]:
    """Return the true bands for the physics with and without a static coefficient of its own.

    Where the suite has a theorem the threshold is the proven interval. A computation that failed has no bands, and its
    reason.

    Raises
    ------
    InputError
        As `variation_of`.
    """
    scene, variation = scope.scenes[0], variation_in(scope)
    physics = {has_mus: physics_of(scene, has_mus) for has_mus in (False, True)}
    tasks = []
    for has_mus, varied in physics.items():
        proven = threshold_of_theorem(varied) if _is_slider_bar(varied) else None
        label = f"threshold/{truth_key(scene.name, has_mus)}/truth"
        tasks.append(Task(label, true_bands, (varied, variation, proven)))

    def tabulate(outcomes: Sequence[Outcome]) -> dict[bool, TrueBands]:
        return {
            has_mus: outcome.value or _unknown(f"{outcome.status}: {outcome.reason}")
            for has_mus, outcome in zip(physics, outcomes, strict=True)
        }

    return Comparison(tuple(tasks), tabulate)


def _unknown(reason: str) -> TrueBands:
    """Return the result of a computation that failed."""
    return TrueBands(StickThreshold(None, None, (np.nan, np.nan), reason), (), Tier.NONE, reason)


@dataclass(frozen=True)
class End:
    """An end of a true interval with stick, as an engine searches for it.

    Attributes
    ----------
    value : float
        The true end.
    search : Search
        Where it is searched for.
    """

    value: float
    search: Search


@dataclass(frozen=True)
class EngineBands:
    """What an engine shows of the bands.

    Attributes
    ----------
    series : tuple of Threshold
        The threshold, for each step from coarse to fine.
    scan : tuple of (float, bool)
        Values over the range, and whether the steady state has a stick phase, with the coarsest step.
    others : tuple of (float, Threshold)
        The other ends, by their true values, with the finest step.
    """

    series: tuple[Threshold, ...]
    scan: tuple[tuple[float, bool], ...] = ()
    others: tuple[tuple[float, Threshold], ...] = ()


def measure_bands(
    scene: Scene,
    variant: Variant,
    variation: Variation,
    search: Search,
    ends: Sequence[End],
    values: Sequence[float],
) -> EngineBands:
    """Measure the threshold of an engine, the other ends, and whether it sticks at values over the range."""
    names = variation.parameter, variation.joint
    series = measure_series(scene, variant, search, *names)
    probe = StickProbe(scene, variant.engine, arguments_of(variant, variant.ladder[0]), *names)
    scan = []
    for value in values:
        try:
            scan.append((value, probe.sticks(value)))
        except NotSettled:
            continue
    finest = arguments_of(variant, variant.ladder[-1])
    others = [
        (end.value, measure_threshold(scene, variant.engine, finest, end.search, *names))
        for end in ends
    ]
    return EngineBands(series, tuple(scan), tuple(others))


def plan(scope: Scope) -> Comparison[Tables]:
    """Return the searches of every engine on the first scene, along its refinement series.

    The first search begins at the scene's own value, finer ones at the variant's own coarser bracket. Only the range of
    a search uses the truth. Each ends with a bracket of the depth's width (with located events: `LOCATED_WIDTH`). The
    bracket is the variant's own: it was seen to stick at one end and not at the other.
    """
    scene, true, variation = scope.scenes[0], scope.known[TRUTH], variation_in(scope)
    variants = threshold_variants(scope.engines, scope.depth)
    searched = variation.searched
    width = extent(scope.depth).bracket
    if variation.parameter != AMPLITUDE:
        width *= (searched.high - searched.low) / BRACKET_RANGE
    tasks = []
    for variant in variants:
        has_mus = has_static_coefficient(variant)
        bracket = LOCATED_WIDTH if variant.parameter == "rtol" else width
        bands = true[has_mus].bands
        centre = true[has_mus].threshold.F0
        arguments = (
            physics_of(scene, has_mus),
            variant,
            variation,
            _main_search(bands, variation, centre, bracket),
            _other_ends(bands, centre, bracket),
            _scanned_values(bands, variation, SCAN_VALUES if scope.depth == Depth.FULL else 0),
        )
        tasks.append(Task(f"threshold/{scene.name}/{variant.label}", measure_bands, arguments))
    mapped = _mapped(scope, variation)

    def tabulate(outcomes: Sequence[Outcome]) -> Tables:
        of_engines, of_map = outcomes[: len(variants)], outcomes[len(variants) :]
        return Tables(
            {
                "threshold": threshold_table(scene, variation, variants, of_engines, true),
                BANDS: band_table(scene, variation, variants, of_engines, true),
                MAP: map_table(scene, variation, list(mapped), of_map),
            }
        )

    return Comparison((*tasks, *mapped.values()), tabulate, variants)


def _main_search(
    bands: Sequence[Band], variation: Variation, centre: float | None, width: float
) -> Search:
    """Return the search of the threshold: from half of the smaller to twice the larger of own value and true threshold.

    It does not go beyond the interval with stick and the gap above it. Without a threshold it is the whole range.
    """
    own, searched = variation.own, variation.searched
    low, high = searched.low, searched.high
    if centre is None:
        return Search(low, high, width)
    for begin, end in stick_bands(bands):
        if abs(end - centre) <= abs(begin - centre) and begin < centre:
            low = begin
        if begin > centre:
            high = 0.5 * (centre + begin)
            break
    if own > 0 and centre > 0:
        low, high = max(low, min(own, centre) / 2), min(high, 2 * max(own, centre))
    near = own if low < own < high else centre
    return Search(low, high, width, near, FIRST_PART * abs(own) or None)


def _other_ends(bands: Sequence[Band], threshold: float | None, width: float) -> list[End]:
    """Return the searches of all ends between stick and slip but the threshold, each within its two bands."""
    ends = []
    for below, above in zip(bands, bands[1:]):
        is_compared = below.kind.is_steady and above.kind.is_steady
        if not is_compared or below.kind.has_stick == above.kind.has_stick:
            continue
        uncertainty = below.high_uncertainty
        if threshold is not None and abs(below.high - threshold) <= max(uncertainty, width):
            continue
        search = Search(
            below.middle,
            above.middle,
            width,
            below.high,
            FIRST_STEP * width,
            is_lower_end=above.kind.has_stick,
        )
        ends.append(End(below.high, search))
    return ends


def _scanned_values(bands: Sequence[Band], variation: Variation, count: int) -> list[float]:
    """Return the values at which engines are asked, where the truth has a steady state.

    These are the middles of the bands, and `count` values from end to end of the range.
    """
    searched = variation.searched
    spread = [
        searched.low + (i + 0.5) / count * (searched.high - searched.low) for i in range(count)
    ]
    middles = [0.5 * (low + high) for low, high in stick_bands(bands)]
    middles += [band.middle for band in bands if not band.kind.has_stick]
    return sorted(value for value in {*spread, *middles} if _band_at(bands, value) is not None)


def _band_at(bands: Sequence[Band], value: float) -> Band | None:
    """Return the band with steady states that contains a value; None if there is none."""
    for band in bands:
        if band.contains(value) and band.kind.is_steady:
            return band
    return None


def _mapped(scope: Scope, variation: Variation) -> dict[float, Task]:
    """Return the computation of the bands at each value of the coefficient of friction; none at lower depths.

    Only F0 of a scene that has the parameter `COEFFICIENT` is mapped.
    """
    scene = scope.scenes[0]
    own = scene.parameters.get(COEFFICIENT)
    if scope.depth != Depth.FULL or variation.parameter != AMPLITUDE or not own:
        return {}
    return {
        factor * own: Task(
            f"threshold/{scene.name}/map {factor * own:.6g}",
            map_bands,
            (scene, variation, factor * own),
        )
        for factor in MAP_FACTORS
    }


def map_bands(scene: Scene, variation: Variation, coefficient: float) -> tuple[Band, ...]:
    """Return the bands by the reference at a coefficient of friction."""
    return bands_from_own_start(vary(scene, {COEFFICIENT: coefficient}), variation).bands


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
                "scene": scene.name,
                "variant": variant.label,
                "engine": label_of(variant.engine),
                "fidelity": variant.fidelity,
                "parameter": variant.parameter,
                "step": step,
                "status": outcome.status,
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
        "true_threshold_uncertainty": threshold.uncertainty,
        "theorem": threshold.theorem,
        "paper_threshold": PAPER_VALUE,
        AGAIN: intervals_text(again),
        SCANNED: variation.searched.high if true.bands else np.nan,
        "mus": _static_coefficient(scene, variation, has_mus),
        "varied": variation.parameter,
    }


def _static_coefficient(scene: Scene, variation: Variation, has_mus: bool) -> float:
    """Return mus of the joint that is looked at; nan for one whose friction does not depend on a normal force."""
    guide = physics_of(scene, has_mus).frictional_guides.get(variation.joint)
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
            "scene": scene.name,
            "varied": variation.parameter,
            "joint": variation.joint,
            "mus": _static_coefficient(scene, variation, has_mus),
            "range_low": searched.low,
            "range_high": searched.high,
            "resolution": searched.resolution,
        }
        rows += [
            {**about, "variant": TRUE_VARIANT, **_band_row(band, bands.tier)}
            for band in bands.bands
        ]
        for variant, outcome in zip(variants, outcomes, strict=True):
            if has_static_coefficient(variant) != has_mus:
                continue
            own = {**about, "variant": variant.label, "fidelity": variant.fidelity}
            if outcome.value is None:
                rows.append({**own, "verdict": Verdict.NOT_COMPARED})
            else:
                rows += [{**own, **row} for row in _compared(outcome.value, bands)]
    table = pd.DataFrame(rows)
    # Where both physics are the same, as in a scene with mus = mu, the truth is listed once.
    return table.drop_duplicates(ignore_index=True)


def _band_row(band: Band, tier: Tier) -> dict[str, Any]:
    """Return the columns of a true band."""
    return {
        "band_low": band.low,
        "band_high": band.high,
        "band_low_uncertainty": band.low_uncertainty,
        "band_high_uncertainty": band.high_uncertainty,
        "band_kind": band.kind,
        "depends_on_start": band.depends_on_start,
        "coexisting": ", ".join(band.coexisting),
        "truth_tier": tier if band.is_confirmed else Tier.OWN_RUN,
    }


def _compared(engine: EngineBands, true: TrueBands) -> list[dict[str, Any]]:
    """Return a row for each true interval with stick, and for each value at which the engine sticks without one."""
    measured = dict(engine.others)
    if true.threshold.F0 is not None and engine.series:
        measured[true.threshold.F0] = engine.series[-1]
    intervals = stick_bands(true.bands)
    rows = [_compared_interval(interval, engine, measured) for interval in intervals]

    # Between a true end and the engine's own one the end is shifted, and nothing is invented.
    shifted = []
    for end, threshold in measured.items():
        if threshold.with_stick is not None:
            shifted.append(sorted((end, threshold.with_stick)))
    for value, sticks in engine.scan:
        band = _band_at(true.bands, value)
        is_shift = any(low <= value <= high for low, high in shifted)
        if sticks and band is not None and not band.kind.has_stick and not is_shift:
            rows.append({"band_low": value, "band_high": value, "verdict": Verdict.INVENTED})
    return rows


def _compared_interval(
    interval: tuple[float, float], engine: EngineBands, measured: Mapping[float, Threshold]
) -> dict[str, Any]:
    """Return the engine's ends of a true interval with stick, their shifts, and the verdict."""
    row: dict[str, Any] = {"verdict": Verdict.FOUND}
    middle = 0.5 * (interval[0] + interval[1])
    if (middle, False) in engine.scan:
        row["verdict"] = Verdict.MISSED
    for name, true_end in zip(("band_low", "band_high"), interval):
        near = [end for end in measured if np.isclose(end, true_end, rtol=1e-6, atol=0.0)]
        if not near:
            continue
        threshold = measured[near[0]]
        if threshold.with_stick is None or threshold.without_stick is None:
            row["verdict"] = Verdict.MISSED
            continue
        end = 0.5 * (threshold.with_stick + threshold.without_stick)
        width = abs(threshold.with_stick - threshold.without_stick) + threshold.residual
        row |= {name: end, f"{name}_uncertainty": width, f"{name}_shift": end - true_end}
        if abs(end - true_end) > width and row["verdict"] == Verdict.FOUND:
            row["verdict"] = Verdict.SHIFTED
    return row


def map_table(
    scene: Scene, variation: Variation, coefficients: Sequence[float], outcomes: Sequence[Outcome]
) -> pd.DataFrame:
    """Return the bands by the reference over the coefficient of friction, a row each."""
    rows = []
    for coefficient, outcome in zip(coefficients, outcomes, strict=True):
        about = {
            "scene": scene.name,
            "mu": coefficient,
            "varied": variation.parameter,
            "status": outcome.status,
            "reason": outcome.reason,
        }
        bands = outcome.value or ()
        rows += [{**about, **_band_row(band, Tier.OWN_RUN)} for band in bands] or [about]
    return pd.DataFrame(rows)


def present(results: Results) -> Presentation:
    """Return the bands, and the distance of each method's threshold from the truth with the methods that are off."""
    table = results.table("threshold")
    bands = results.table(BANDS)
    true = _true_rows(bands)
    if table.empty or ERROR not in table or table[ERROR].isna().all():
        if not true:
            return Presentation()
        return Presentation(
            rows={**_no_threshold(table), "bands": true, **_range(bands), **CONSTANTS},
            tables=_band_views(bands),
            figures=[*_band_figures(bands), *_map_figures(results.table(MAP))],
        )
    table = with_columns(table, CHANGE, TIER, AGAIN, SCANNED, "varied").assign(
        setting=list(map(setting_of, table["parameter"], table["step"]))
    )
    measured = table[table[ERROR].notna()]
    finest = measured.loc[measured.groupby("variant", sort=False)["step"].idxmin()]
    clearly, may_vanish = _off(finest)
    installed = table.loc[table["status"] != Status.MISSING, "variant"].unique()
    rows = {
        "truth": row_of("threshold", table, measured.index[0])[TRUE_THRESHOLD],
        "off": _errors(table, clearly),
        "inconclusive": _errors(table, may_vanish),
        "without": [variant for variant in installed if variant not in set(finest["variant"])],
        "proven": [
            row_of("threshold", table, label)
            for label in table[table[TIER] == Tier.PROVEN].drop_duplicates("mus").index
        ],
        "bands": true,
        **_range(bands),
        **_wrong_bands(bands),
        **_above(table),
        **CONSTANTS,
    }
    headline = Headline(
        "error of the stick limit [N]",
        {
            row["variant"]: Uncertain(row[ERROR], row[UNCERTAINTY]).both()
            for row in finest.to_dict("records")
        },
    )
    columns = (
        METHOD,
        Column("fidelity"),
        Column("mus", form="g"),
        Column("setting"),
        Column(WITH_STICK, "sticks at", form=".6g", brief=False),
        Column(WITHOUT_STICK, "slips at", form=".6g", brief=False),
        Column(ERROR, "F0, difference from truth", interval=True),
        Column(AGAIN),
        Column("runs", brief=False),
        Column("reason", brief=False),
    )
    return Presentation(
        rows=rows,
        headlines=[headline],
        tables=[
            *_band_views(bands),
            view("threshold", finest, columns),
            view("threshold-all", table, columns, source="threshold", in_report=False),
        ],
        figures=[
            *_map_figures(results.table(MAP)),
            *_band_figures(bands),
            _figure(measured),
        ],
    )


def _no_threshold(table: pd.DataFrame) -> dict[str, object]:
    """Return the rows of the text where no method has a threshold."""
    return {
        "truth": None,
        "off": [],
        "inconclusive": [],
        "without": [],
        "proven": [],
        "invented": [],
        "missed": [],
        **_above(with_columns(table, AGAIN, SCANNED)),
    }


def _true_rows(bands: pd.DataFrame) -> list[object]:
    """Return the rows of the true bands."""
    if bands.empty:
        return []
    return [row_of(BANDS, bands, label) for label in bands[bands["variant"] == TRUE_VARIANT].index]


def _range(bands: pd.DataFrame) -> dict[str, object]:
    """Return what was varied, in which range and resolution, and the bands in which the start decides."""
    if bands.empty:
        return {
            "searched": None,
            "name": AMPLITUDE,
            "unit": " N",
            "start_dependent": [],
            "own_run": False,
        }
    name = str(bands["varied"].iloc[0])
    true = bands[bands["variant"] == TRUE_VARIANT]
    dependent = true[true["depends_on_start"].eq(True)]
    return {
        "searched": row_of(BANDS, bands, bands.index[0]),
        "name": name,
        "unit": " N" if name == AMPLITUDE else "",
        "start_dependent": [row_of(BANDS, bands, label) for label in dependent.index],
        "own_run": bool(len(true)) and bool(true["truth_tier"].eq(Tier.OWN_RUN).all()),
    }


def _wrong_bands(bands: pd.DataFrame) -> dict[str, object]:
    """Return the methods that miss or invent a band."""
    if bands.empty or "verdict" not in bands:
        return {"missed": [], "invented": []}
    return {
        name: list(bands.loc[bands["verdict"] == verdict, "variant"].unique())
        for name, verdict in (("missed", Verdict.MISSED), ("invented", Verdict.INVENTED))
    }


def _band_views(bands: pd.DataFrame) -> list[Any]:
    """Return the table of the true bands, and that of the engines'."""
    if bands.empty:
        return []
    is_true = bands["variant"] == TRUE_VARIANT
    ends = (Column("band_low", form=".12g"), Column("band_high", form=".12g"))
    true = view(
        BANDS,
        bands[is_true],
        (
            Column("mus", form="g"),
            *ends,
            Column("band_kind"),
            Column("coexisting"),
            Column("truth_tier"),
        ),
    )
    engines = with_columns(
        bands[~is_true], "verdict", "fidelity", "band_low_shift", "band_high_shift"
    )
    if engines.empty:
        return [true]
    compared = view(
        "bands-engines",
        engines,
        (
            METHOD,
            Column("mus", form="g"),
            Column("band_low", form=".6g"),
            Column("band_high", form=".6g"),
            Column("band_low_shift", interval=True, uncertainty="band_low_uncertainty"),
            Column("band_high_shift", interval=True, uncertainty="band_high_uncertainty"),
            Column("verdict"),
        ),
        source=BANDS,
        in_report=False,
    )
    return [true, compared]


def _off(finest: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Rows whose error is larger than its uncertainty, by its size: those that are sure, and those that may vanish.

    Finer steps may remove an error at a step that is not the finest of all, or whose last refinement has changed it by
    more than `SETTLES` of itself.
    """
    beyond = finest[finest[ERROR].abs() > finest[UNCERTAINTY]]
    beyond = beyond.sort_values(ERROR, key=abs, kind="stable")
    has_steps = beyond["parameter"].eq("dt")
    is_coarser = beyond["step"] > finest.loc[finest["parameter"] == "dt", "step"].min()
    has_settled = beyond[CHANGE] < SETTLES * beyond[ERROR].abs()  # False where it is not known
    may_vanish = has_steps & (is_coarser | ~has_settled)
    return beyond[~may_vanish], beyond[may_vanish]


def _errors(table: pd.DataFrame, rows: pd.DataFrame) -> list[dict[str, object]]:
    """Methods with their errors."""
    return [
        {"variant": variant, "error": row_of("threshold", table, label)[ERROR]}
        for label, variant in rows["variant"].items()
    ]


def _above(table: pd.DataFrame) -> dict[str, object]:
    """Where the slider sticks again above the threshold of each physics, as far as the scan has seen.

    The end of the shortest scan is None if there was none.
    """
    scanned = table[table[SCANNED].notna()].drop_duplicates("mus")
    again = scanned[scanned[AGAIN].fillna("").ne("")]
    end = None
    if len(scanned):
        end = row_of("threshold", table, scanned[SCANNED].idxmin())[SCANNED]
    return {
        "again": [row_of("threshold", table, label) for label in again.index],
        "scanned_to": end,
    }


def _figure(measured: pd.DataFrame) -> Chart:
    """Intervals, a method a line; the steps of a method from coarse to fine below each other.

    The coarsest step has no interval: nothing is known of what a refinement changes.
    """
    names = list(measured["variant"].unique())
    series = []
    for place, variant in enumerate(names):
        runs = measured[measured["variant"] == variant].sort_values("step", ascending=False)
        offsets = np.linspace(0.25, -0.25, len(runs)) if len(runs) > 1 else np.zeros(1)
        is_known = runs[CHANGE].notna() | (runs["parameter"] != "dt")
        error = runs[ERROR].to_numpy(float)
        unsure = runs[UNCERTAINTY].where(is_known).to_numpy(float)
        series.append(
            Series(
                "",
                error,
                offsets - place,
                error - unsure,
                error + unsure,
                look=variant,
                line=False,
                points=True,
            )
        )
    panel = Panel(
        "",
        Axis("stick threshold on F0, difference from the truth [N]"),
        Axis("", ticks=[float(-place) for place in range(len(names))], words=names),
        series,
        horizontal=True,
        lines=(0.0,),
    )
    return Chart("threshold", (panel,), columns=1, height=1.0 + 0.24 * len(names))


def _band_figures(bands: pd.DataFrame) -> list[Chart]:
    """Return the chart of the true intervals with stick over the parameter, a line for each physics."""
    if bands.empty:
        return []
    true = bands[bands["variant"] == TRUE_VARIANT]
    series, names = [], []
    is_named: set[str] = set()
    for place, (mus, rows) in enumerate(true.groupby("mus", sort=False)):
        names.append(f"mus = {mus:g}")
        for kind, alike in rows.groupby("band_kind", sort=False):
            low, high = alike["band_low"].to_numpy(float), alike["band_high"].to_numpy(float)
            series.append(
                Series(
                    "" if kind in is_named else str(kind),
                    0.5 * (low + high),
                    np.full(len(low), -float(place)),
                    low,
                    high,
                    look=str(kind),
                    line=False,
                    points=True,
                )
            )
            is_named.add(kind)
    ticks = [-float(place) for place in range(len(names))]
    varied = str(bands["varied"].iloc[0])
    label = f"{varied} [N]" if varied == AMPLITUDE else varied
    panel = Panel(
        "",
        Axis(label),
        Axis("", ticks=ticks, words=names),
        series,
        horizontal=True,
    )
    return [Chart(BANDS, (panel,), columns=1, height=0.8 + 0.3 * len(names))]


def _map_figures(mapped: pd.DataFrame) -> list[Chart]:
    """Return the map of the bands: a vertical bar over F0 for each band and each coefficient of friction."""
    if mapped.empty or "band_kind" not in mapped:
        return []
    series = []
    for kind, rows in mapped.dropna(subset="band_kind").groupby("band_kind", sort=False):
        low, high = rows["band_low"].to_numpy(float), rows["band_high"].to_numpy(float)
        series.append(
            Series(
                str(kind),
                rows["mu"].to_numpy(float),
                0.5 * (low + high),
                low,
                high,
                look=TRUTH_LOOK if kind == "sticks" else str(kind),
                line=False,
                points=True,
            )
        )
    panel = Panel("", Axis("mu"), Axis("F0 [N]"), series)
    return [Chart(MAP, (panel,), columns=1, height=3.4)]


STUDY = Study(
    "threshold",
    "Stick limit",
    "For which load amplitudes does the slider stick in the steady state?",
    present,
    plan,
    {TRUTH: true_thresholds},
    seconds=10.0,
    takes=frozenset({"engines", "parameter", "range", "joint", "resolution"}),
    applies=unless_refused(variation_in),
    tables={
        "threshold": "Stick thresholds",
        BANDS: "Bands with and without stick phases",
        MAP: "Bands over the coefficient of friction",
    },
)
