"""The bands and the threshold of a scene by the best method that it has, with which engines are compared.

The event-driven reference finds the bands of any scene. Of a scene with the structure of the slider-bar, the return map
of the independent solution examines them and refines their ends, and `truths.proof.threshold` may prove one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction.comparisons.measures.reference_bands import AMPLITUDE, Variation, bands_of_reference
from stiction.scenes import Scene
from stiction.truths import StickThreshold, Tier
from stiction.truths.bands import Band, no_expected_end, threshold_of
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.stick_bands import examined_bands, expected_end_of, mechanism_at
from stiction.truths.truth import NotThisMechanism


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
    if variation.parameter != AMPLITUDE:
        proven = None
    if is_slider_bar(scene):
        mechanism = mechanism_at(scene, variation.parameter)
        by_reference = bands_of_reference(scene, variation, expected_end_of(mechanism, proven))
        bands = examined_bands(mechanism, by_reference.bands, proven)
        tier = Tier.HIGH_PRECISION
    else:
        by_reference = bands_of_reference(scene, variation, no_expected_end)
        bands = by_reference.bands
        tier = Tier.OWN_RUN
    threshold = _threshold(bands, variation)
    # The theorem is about the same end, with its bounds and words.
    if proven is not None and threshold.F0 == proven.F0:
        threshold = proven
    return TrueBands(threshold, bands, tier, by_reference.reason)


def is_slider_bar(scene: Scene) -> bool:
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


def unknown_bands(reason: str) -> TrueBands:
    """Return the result of a computation that failed, without bands and with the reason."""
    return TrueBands(StickThreshold(None, None, (np.nan, np.nan), reason), (), Tier.NONE, reason)
