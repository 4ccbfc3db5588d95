"""The computation of a point of a sweep: numbers of a steady state, or the bands of a parameter and their threshold."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from stiction.comparisons.bench.presentation.cells import intervals_text
from stiction.comparisons.measures.break_away import NeverSlips
from stiction.comparisons.measures.engine_threshold import StickProbe
from stiction.comparisons.measures.reference_bands import (
    AMPLITUDE,
    USUAL_VALUES,
    Variation,
    bands_from_own_start,
    variation_of,
)
from stiction.comparisons.measures.settling import NoCommonPeriod, NotSettled
from stiction.comparisons.measures.steady_state_measures import (
    SteadyRun,
    measure_of,
    run_from_start,
    steady_window,
)
from stiction.comparisons.studies.threshold_tables import (
    AGAIN,
    SCANNED,
    VARIED,
    VARIED_UNIT,
    WITH_STICK,
    WITHOUT_STICK,
)
from stiction.engines import EngineMissing, Refused
from stiction.engines.status import Status
from stiction.reference_impl.multibody.initial_state import with_consistent_start
from stiction.scenes import Scene, SceneError, vary
from stiction.scenes.value_units import unit_of_value
from stiction.truths.bands import Band, BandKind, find_bands, stick_bands, threshold_of

THRESHOLD = "threshold"
"""The measure that is a search over a parameter and not a run; ``threshold:KEY`` names another parameter than F0."""
THRESHOLD_COLUMN = "threshold"
"""Column: upper end of the band with stick next to the scene's own value."""
STICK_BANDS = "stick_bands"
"""Column: all bands with stick within the range, as pairs of values."""
ALL_BANDS = "all_bands"
"""Column: all bands within the range, as a JSON list of (lower end, upper end, kind)."""
WINDOW_START = "window_begin"
"""Column: start of the window in which a run is measured, s."""
SEARCH = (0.25, 4.0)
"""Multiples of the scene's own value between which a parameter is searched that is no axis; else from end to end of the
axis."""
BRACKET = 2.5e-3
"""Largest width to which the ends of bands are halved, as a part of the range in which they are searched."""
REFERENCE_BRACKET = 1e-5
"""The same for the event-driven reference, whose runs cost a hundredth of those of an engine."""
ENGINE_VALUES = 24
"""Intervals of the range at whose ends a method is asked whose motion is sampled; `USUAL_VALUES` for the event-driven
reference."""
STATUS_OF_ERROR: Mapping[type[Exception], Status] = {
    NotSettled: Status.NO_STEADY_STATE,
    NoCommonPeriod: Status.NO_STEADY_STATE,
    NeverSlips: Status.NOT_FOUND,
    SceneError: Status.REFUSED,
    Refused: Status.REFUSED,
    EngineMissing: Status.MISSING,
    Exception: Status.FAILED,
}
"""Status of a point by its error; the first class that fits."""

Numbers = Callable[[Scene, SteadyRun, Any], dict[str, Any]]
"""Function that returns the numbers of a scene by column, or why there are none."""


@dataclass(frozen=True)
class BandSearch:
    """The search of bands along a parameter, at each point of a sweep.

    Attributes
    ----------
    parameter : str
        Key of the parameter, as in `vary`.
    ends : tuple of float or None
        Ends of the searched range; multiples `SEARCH` of the scene's own value if None.
    """

    parameter: str
    ends: tuple[float, float] | None = None

    def variation(self, scene: Scene, values: int = USUAL_VALUES) -> Variation:
        """Return what is varied in a scene, with a range that is divided into some intervals.

        Raises
        ------
        InputError
            As `variation_of`.
        """
        ends = self.ends
        own = scene.parameters.get(self.parameter)
        if ends is None and own:
            low, high = sorted(factor * own for factor in SEARCH)
            ends = low, high
        resolution = None if ends is None else (ends[1] - ends[0]) / values
        return variation_of(scene, self.parameter, ends=ends, resolution=resolution)


def band_search_of(
    measures: Sequence[str], ranges: Mapping[str, tuple[float, float]]
) -> BandSearch | None:
    """Return the search that the measure `THRESHOLD` asks for; None if it is not among the measures.

    Parameters
    ----------
    measures : sequence of str
        Names of measures.
    ranges : Mapping[str, tuple of float]
        Smallest and largest value of each axis.
    """
    for text in measures:
        if is_threshold(text):
            parameter = text.partition(":")[2] or AMPLITUDE
            return BandSearch(parameter, ranges.get(parameter))
    return None


def is_threshold(measure: str) -> bool:
    """Return True if a measure is a search over a parameter."""
    return measure.partition(":")[0] == THRESHOLD


def point_row(
    numbers: Numbers, scene: Scene, run: SteadyRun, about: Any, point: Mapping[str, float]
) -> dict[str, Any]:
    """Return the row of a point: its axes, ``status``, ``reason`` and numbers; an exception is its reason."""
    try:
        columns = numbers(vary(scene, point), run, about)
    except (
        Exception
    ) as error:  # whatever it is, it concerns this point alone, and its row reports it
        columns = {
            "status": _status_of(error),
            "reason": " ".join(f"{type(error).__name__}: {error}".split()),
        }
    return {**point, "status": Status.OK, "reason": "", **columns}


def _status_of(error: Exception) -> Status:
    """Return the status of a point that has failed with an error."""
    for kind, status in STATUS_OF_ERROR.items():
        if isinstance(error, kind):
            return status
    return Status.FAILED


def map_numbers(scene: Scene, run: SteadyRun, measures: Sequence[str]) -> dict[str, Any]:
    """Return the measures of a run by column, and the start of the window in which they were taken, s.

    Measures of the start of a motion come from a run of their own, which needs no steady state.
    """
    chosen = [measure_of(text) for text in measures]
    of_start = [measure for measure in chosen if measure.from_start]
    steady = [measure for measure in chosen if not measure.from_start]
    numbers: dict[str, Any] = {}
    if steady:
        window = steady_window(scene, run, steady)
        numbers[WINDOW_START] = window.start
        numbers |= {measure.column: measure.value(window) for measure in steady}
    if of_start:
        whole = run_from_start(scene, run)
        numbers |= {
            measure.column: float(measure.function(whole, measure.source(scene)))
            for measure in of_start
        }
    return numbers


def threshold_numbers(scene: Scene, run: SteadyRun, search: BandSearch) -> dict[str, Any]:
    """Return the threshold and all bands within the range of a search by column."""
    if run.is_event_driven_reference:
        variation = search.variation(scene)
        searched = variation.searched
        width = REFERENCE_BRACKET * (searched.high - searched.low)
        bands = bands_from_own_start(scene, variation, width).bands
    else:
        variation = search.variation(scene, ENGINE_VALUES)
        searched = variation.searched
        bands = _bands_of_engine(scene, run, variation)

    intervals = stick_bands(bands)
    unit = unit_of_value(scene, variation.parameter) or ""
    numbers: dict[str, Any] = {
        VARIED: variation.parameter,
        VARIED_UNIT: unit,
        STICK_BANDS: intervals_text(intervals),
        ALL_BANDS: json.dumps([[band.low, band.high, band.kind] for band in bands]),
        SCANNED: searched.high,
    }
    sides = threshold_of(bands, variation.own)
    if sides is None:
        with_unit = f" {unit}" if unit else ""
        status = Status.NOT_FOUND
        reason = (
            f"no stick phase at {variation.parameter} = {searched.low:g}{with_unit} to "
            f"{searched.high:g}{with_unit}"
        )
        if intervals:
            reason = (
                f"still a stick phase at {variation.parameter} = {intervals[-1][1]:g}{with_unit}"
            )
        # Where the steady state is not known, the slider may stick.
        unknown = [band for band in bands if not band.kind.is_steady]
        if unknown and not intervals:
            status = Status.NO_STEADY_STATE
            reason += (
                f", but no steady state is known at {unknown[0].low:g}{with_unit} to "
                f"{unknown[0].high:g}{with_unit}"
            )
        return {**numbers, "status": status, "reason": reason}
    below, _ = sides
    threshold, uncertainty = below.high, below.high_uncertainty
    return {
        **numbers,
        THRESHOLD_COLUMN: threshold,
        WITH_STICK: threshold - uncertainty,
        WITHOUT_STICK: threshold + uncertainty,
        AGAIN: intervals_text([interval for interval in intervals if interval[0] > threshold]),
    }


def _bands_of_engine(scene: Scene, run: SteadyRun, variation: Variation) -> tuple[Band, ...]:
    """Return the bands by a method other than the event-driven reference."""
    step = run.step(scene)
    arguments: dict[str, Any] = {"rtol": run.rtol} if step is None else {"dt": step}
    probe = StickProbe(
        with_consistent_start(scene, assemble=True),
        run.engine,
        {**arguments, "fidelity": run.fidelity},
        variation.parameter,
        variation.joint,
    )

    def kind_at(value: float) -> BandKind:
        try:
            return BandKind.STICK if probe.sticks(value) else BandKind.SLIP
        except NotSettled:
            return BandKind.UNSETTLED

    searched = variation.searched
    return find_bands(kind_at, searched, BRACKET * (searched.high - searched.low))
