"""The bands of an engine: which of the true ones it has, and how far their ends are shifted.

An engine is not asked over the whole range, as a run of most engines costs a hundred runs of the reference. It searches
for each true end between the two bands beside it, and is asked at a few other values whether the slider sticks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from stiction.comparisons.bench.variants import Variant
from stiction.comparisons.measures.engine_threshold import (
    FIRST_STEP,
    Search,
    StickProbe,
    Threshold,
    arguments_of,
    measure_series,
    measure_threshold,
)
from stiction.comparisons.measures.reference_bands import Variation
from stiction.comparisons.measures.settling import NotSettled
from stiction.comparisons.measures.true_bands import TrueBands
from stiction.scenes import Scene
from stiction.truths.bands import Band, stick_bands

FIRST_PART = 0.1
"""Length of the first step of an engine's search, as a part of the value that it begins at."""
SAME_END = 1e-6
"""Largest relative difference of two numbers that are the same true end."""


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


def main_search(
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


def other_ends(bands: Sequence[Band], threshold: float | None, width: float) -> list[End]:
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


def scanned_values(bands: Sequence[Band], variation: Variation, count: int) -> list[float]:
    """Return the values at which engines are asked, where the truth has a steady state.

    These are the middles of the bands, and `count` values from end to end of the range.
    """
    searched = variation.searched
    spread = [
        searched.low + (i + 0.5) / count * (searched.high - searched.low) for i in range(count)
    ]
    middles = [0.5 * (low + high) for low, high in stick_bands(bands)]
    middles += [band.middle for band in bands if not band.kind.has_stick]
    return sorted(value for value in {*spread, *middles} if band_at(bands, value) is not None)


def band_at(bands: Sequence[Band], value: float) -> Band | None:
    """Return the band with steady states that contains a value; None if there is none."""
    for band in bands:
        if band.contains(value) and band.kind.is_steady:
            return band
    return None


def compared_bands(engine: EngineBands, true: TrueBands) -> list[dict[str, Any]]:
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
        band = band_at(true.bands, value)
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
        near = [end for end in measured if np.isclose(end, true_end, rtol=SAME_END, atol=0.0)]
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
