"""Bands of a slider-bar's steady states, examined and refined by its return map.

Where the bands may be is found by another method, with more runs than the return map could make in the same time. Here
each of them is examined in its middle and on both sides of its ends, and each end at which the slider begins or ceases
to stick is refined as the threshold is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from stiction.scenes import Scene, SceneError, vary
from stiction.truths.bands import Band, BandKind, ExpectedEnd, is_sharp_end
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.steady_state import (
    MechanismAt,
    NoSteadyState,
    SteadyState,
    StickEnd,
    StickThreshold,
    margin,
    refined_end,
    steady_state,
)
from stiction.truths.truth import TruthRefused

_HALF_WIDTH = 2.5e-4
"""Smallest distance from an end at which both sides are examined, as a part of the end: half of the interval within
which a steady state is followed."""
_SAFETY = 4.0
"""Distance from an end at which both sides are examined first, in units of its uncertainty."""
_WIDER, _ATTEMPTS = 4.0, 3
"""Factor by which that distance grows where a side is not of the kind that was found, and how often it is tried."""
_HALVED = 5e-5
"""Width, as a part of the end, to which an end is halved where the steady state cannot be followed to it: a tenth of
the interval on whose sides it is examined. Narrower ones take minutes, as motions settle ever more slowly."""
_XTOL = 1e-9
"""Accuracy of the value at which a slider at rest breaks away, in the parameter's unit."""
_INSTANTS = 500
"""Instants of a period at which the excess of the load over static friction is sampled before its peak is refined."""


def mechanism_at(scene: Scene, parameter: str) -> MechanismAt:
    """Return the function that yields the slider-bar at a value of a scene's parameter."""
    return lambda value: SliderBar.from_scene(vary(scene, {parameter: value}))


def kind_of(mechanism: SliderBar, steady: SteadyState) -> BandKind:
    """Return the kind of a steady state."""
    if all(segment.mode[0] == 0 for segment in steady.motion.segments):
        return BandKind.REST
    if steady.sticks or margin(mechanism, steady) < 0:
        return BandKind.STICK
    return BandKind.SLIP


def kind_at(at: MechanismAt, value: float) -> BandKind:
    """Return the kind of the steady state that is reached from the start, at a value of the parameter."""
    try:
        mechanism = at(value)
        return kind_of(mechanism, steady_state(mechanism))
    except NoSteadyState:
        return BandKind.UNSETTLED
    except (TruthRefused, SceneError):
        return BandKind.UNKNOWN


def examined_bands(
    at: MechanismAt, bands: Sequence[Band], proven: StickThreshold | None = None
) -> tuple[Band, ...]:
    """Return the bands with refined ends, and whether the return map confirms each of them.

    `proven` is an end that a theorem encloses, if there is one: it is not refined.

    A band with a steady state is confirmed if the return map has the same kind of steady state in its middle and next
    to its ends. An end that is not sharp (`bands.is_sharp_end`) is left as it is.
    """
    bands = list(bands)
    # That a motion never settles is not examined: it would take the return map all of its periods.
    is_confirmed = [band.kind.is_steady and kind_at(at, band.middle) == band.kind for band in bands]
    for i in range(len(bands) - 1):
        below, above = bands[i], bands[i + 1]
        if not is_sharp_end(below.kind, above.kind):
            continue
        end = _proven_end(proven, below, above) or _examined_end(at, below, above)
        if end is None:
            is_confirmed[i] = is_confirmed[i + 1] = False
            continue
        bands[i] = replace(below, high=end.value, high_uncertainty=end.uncertainty)
        bands[i + 1] = replace(above, low=end.value, low_uncertainty=end.uncertainty)
    return tuple(
        replace(band, is_confirmed=confirmed) for band, confirmed in zip(bands, is_confirmed)
    )


def _proven_end(proven: StickThreshold | None, below: Band, above: Band) -> StickEnd | None:
    """Return the end of a theorem, if it is the end between two bands: of stick phases, above which there are none."""
    if proven is None or proven.F0 is None or proven.uncertainty is None:
        return None
    is_its_kind = below.kind.has_stick and above.kind == BandKind.SLIP
    if not is_its_kind or abs(proven.F0 - below.high) > _SAFETY * below.high_uncertainty:
        return None
    return StickEnd(proven.F0, proven.uncertainty, proven.bracket)


def _examined_end(at: MechanismAt, below: Band, above: Band) -> StickEnd | None:
    """Return the end between two bands; None where the return map does not have both kinds on its sides."""
    if BandKind.REST in (below.kind, above.kind):
        return _end_of_rest(at, below, above)
    end = below.high
    distance = max(_SAFETY * below.high_uncertainty, _HALF_WIDTH * abs(end))
    for _ in range(_ATTEMPTS):
        low, high = max(end - distance, below.middle), min(end + distance, above.middle)
        if kind_at(at, low) == below.kind and kind_at(at, high) == above.kind:
            inside, outside = (low, high) if below.kind.has_stick else (high, low)
            # Where the sliding motion loses its stability before it comes to rest, it cannot be
            # followed to the end, and settles ever more slowly: halving stops early.
            width = max(_SAFETY * below.high_uncertainty, _HALVED * abs(end))
            return refined_end(at, inside, outside, steady_state(at(outside)), width)
        distance *= _WIDER
    return None


def _end_of_rest(at: MechanismAt, below: Band, above: Band) -> StickEnd | None:
    """Return the value at which a slider that rests from the start breaks away, if that is the end between two bands.

    Beyond that value a motion may take hundreds of periods to settle, so that the return map is no help there. None
    where the slider moves before it rests, or breaks away elsewhere: it may then come to rest for ever at another
    place.
    """
    resting = below if below.kind == BandKind.REST else above
    steady = steady_state(at(resting.middle))
    mechanism = at(resting.middle)
    if kind_of(mechanism, steady) != BandKind.REST or steady.state[0] != mechanism.x:
        return None
    end, uncertainty = below.high, _SAFETY * below.high_uncertainty
    low, high = max(end - uncertainty, below.middle), min(end + uncertainty, above.middle)
    root = _break_away(at, low, high)
    return None if root is None else StickEnd(root, 2 * _XTOL, (low, high))


def expected_end_of(at: MechanismAt, proven: StickThreshold | None = None) -> ExpectedEnd:
    """Return the function that yields the end that the theory of the slider-bar expects between two values.

    That is the end of a theorem, or the value at which a slider at rest at its start breaks away.
    """

    def expected_end(low: float, high: float) -> float | None:
        if proven is not None and proven.F0 is not None and low < proven.F0 < high:
            return proven.F0
        try:
            return _break_away(at, low, high)
        except (TruthRefused, SceneError):
            return None

    return expected_end


def _break_away(at: MechanismAt, low: float, high: float) -> float | None:
    """Return the value at which a slider at rest at its start breaks away; None unless it is between two values.

    There the largest excess of the load over static friction within a period is zero.
    """
    excess = [_largest_excess(at(value)) for value in (low, high)]
    if not min(excess) < 0 < max(excess):
        return None
    return float(brentq(lambda value: _largest_excess(at(value)), low, high, xtol=_XTOL))


def _largest_excess(mechanism: SliderBar) -> float:
    """Return the largest excess of the load over static friction at rest at the start within a period, N."""
    instants, step = np.linspace(0.0, mechanism.period(), _INSTANTS + 1, retstep=True)
    sampled = [mechanism.break_away_margin(t, mechanism.x) for t in instants]
    near = instants[int(np.argmax(sampled))]
    peak = minimize_scalar(
        lambda t: -mechanism.break_away_margin(t, mechanism.x),
        bounds=(near - step, near + step),
        method="bounded",
        options={"xatol": _XTOL},
    )
    return float(max(-peak.fun, *sampled))
