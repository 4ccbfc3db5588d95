"""Bands of a parameter in which the steady state of a mechanism is of one kind, and the search for their ends.

The answer is a set of intervals that covers the searched range. It is found on a grid whose spacing is the resolution.
A band that is narrower than the resolution may lie between two values of the grid, and nothing is claimed about it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import ceil, isfinite

import numpy as np

from stiction.scenes import InputError

MOST_VALUES = 100_000
"""Largest number of values of a grid. A finer resolution is a mistake: the search would take hours."""
SPLIT_PART = 1 / 8
"""Part of the resolution down to which a third kind between two bands is followed.

Where steady states change their kind on all scales, as next to values without a steady state, this bounds the number of
bands.
"""


NEARLY_HALF = 0.49
"""Distance of two values from the expected end between them, in units of the width that they enclose at most: less than
half, so that rounding does not make their distance larger."""


class BandKind(StrEnum):
    """Kinds of steady states, with regard to one guide."""

    STICK = "sticks"
    """The slider sticks for a part of each period."""
    REST = "rests"
    """The slider is at rest for ever."""
    SLIP = "slips"
    """The slider never rests for longer than an instant."""
    UNSETTLED = "no steady state"
    """The motion neither comes to rest nor repeats itself within the time that it is given."""
    UNKNOWN = "not computed"
    """There is no motion: the scene is impossible with this value, or the run has failed."""

    @property
    def has_stick(self) -> bool:
        """True if the slider is at rest for some time."""
        return self in (BandKind.STICK, BandKind.REST)

    @property
    def is_steady(self) -> bool:
        """True if there is a steady state."""
        return self not in (BandKind.UNSETTLED, BandKind.UNKNOWN)


@dataclass(frozen=True)
class Band:
    """An interval of a parameter with steady states of one kind, reached from the scene's own start.

    Attributes
    ----------
    low, high : float
        Ends, in the unit of the parameter.
    kind : BandKind
        Kind of the steady state at each examined value within.
    low_uncertainty, high_uncertainty : float
        Largest expected error of each end; zero at an end of the searched range.
    coexisting : tuple of BandKind
        Kinds of other steady states that exist somewhere in the band, and are reached from other starts.
    is_confirmed : bool
        True if an independent solution has the same kind in the middle of the band.
    """

    low: float
    high: float
    kind: BandKind
    low_uncertainty: float = 0.0
    high_uncertainty: float = 0.0
    coexisting: tuple[BandKind, ...] = ()
    is_confirmed: bool = False

    @property
    def middle(self) -> float:
        """Value in the middle of the band."""
        return 0.5 * (self.low + self.high)

    @property
    def depends_on_start(self) -> bool:
        """True if another start leads to a steady state of another kind."""
        return bool(self.coexisting)

    def contains(self, value: float) -> bool:
        """Return True if a value lies in the band, ends included."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Range:
    """The searched values of a parameter.

    Attributes
    ----------
    low, high : float
        Ends, in the unit of the parameter.
    resolution : float
        Largest distance of two values that are examined. Narrower bands may be missed.

    Raises
    ------
    InputError
        If the ends are not finite and increasing, or the resolution is not positive, wider than the range, or so fine
        that it needs more than `MOST_VALUES` values.
    """

    low: float
    high: float
    resolution: float

    def __post_init__(self) -> None:
        if not (isfinite(self.low) and isfinite(self.high) and self.low < self.high):
            raise InputError(
                f"range: found {self.low:g}:{self.high:g}; expected two finite numbers LOW:HIGH "
                "with LOW < HIGH"
            )
        width = self.high - self.low
        if not 0 < self.resolution <= width:
            raise InputError(
                f"resolution: found {self.resolution:g}; expected more than zero and at most the "
                f"width of the range, {width:g}"
            )
        if width / self.resolution > MOST_VALUES:
            raise InputError(
                f"resolution: found {self.resolution:g}; expected at most {MOST_VALUES} values in "
                f"the range, that is {width / MOST_VALUES:g} or more"
            )

    def values(self) -> list[float]:
        """Return the values of the grid, both ends included."""
        # A width of 12.000000000000002 resolutions is meant to be 12.
        parts = ceil((self.high - self.low) / self.resolution * (1 - 1e-12))
        return [float(value) for value in np.linspace(self.low, self.high, parts + 1)]


KindAt = Callable[[float], BandKind]
"""Kind of the steady state at a value of the parameter."""
ExpectedEnd = Callable[[float, float], float | None]
"""Where a theory expects the end of a band between two values of the parameter; None if it expects none."""


def no_expected_end(low: float, high: float) -> float | None:
    """Return None: no theory expects an end anywhere."""
    return None


@dataclass(frozen=True)
class _Edge:
    """Two neighbouring values with steady states of different kinds."""

    low: float
    high: float
    below: BandKind
    above: BandKind


def find_bands(
    kind_at: KindAt,
    searched: Range,
    width: float,
    finer: KindAt | None = None,
    expected_end: ExpectedEnd = no_expected_end,
) -> tuple[Band, ...]:
    """Return the bands that cover a range, in increasing order.

    Each value of the grid is examined by `kind_at`, and values between them by `finer`, if it is given. Where two
    neighbours differ, the interval between them is halved down to `width`. An end that is not sharp (see
    `is_sharp_end`) is halved to `SPLIT_PART` of the resolution only.

    An expected end saves halving, as values on both of its sides are examined as soon as the interval is narrow. If the
    expectation is wrong, the kinds at these values show it, and the halving goes on from there.
    """
    values = searched.values()
    kinds = [kind_at(value) for value in values]
    edges: list[_Edge] = []
    for i in range(len(values) - 1):
        edge = _Edge(values[i], values[i + 1], kinds[i], kinds[i + 1])
        if edge.below != edge.above:
            narrowing = _Narrowing(
                finer or kind_at,
                width,
                SPLIT_PART * searched.resolution,
                expected_end(edge.low, edge.high),
            )
            edges += narrowing.edges_in(edge)

    # Each edge ends one band and begins the next one.
    bands = []
    low, low_uncertainty = values[0], 0.0
    for edge in edges:
        end, uncertainty = 0.5 * (edge.low + edge.high), 0.5 * (edge.high - edge.low)
        bands.append(Band(low, end, edge.below, low_uncertainty, uncertainty))
        low, low_uncertainty = end, uncertainty
    bands.append(Band(low, values[-1], kinds[-1], low_uncertainty, 0.0))
    return tuple(bands)


def is_sharp_end(below: BandKind, above: BandKind) -> bool:
    """Return True if an end between two kinds does not depend on the time that a motion is given to settle.

    Whether a slider is at rest for ever is known at once, also beside motions that do not settle.
    """
    return BandKind.REST in (below, above) or (below.is_steady and above.is_steady)


@dataclass(frozen=True)
class _Narrowing:
    """The search of the ends of bands between two neighbouring values of the grid.

    Attributes
    ----------
    kind_at : callable
        Kind at a value.
    width : float
        Width of the interval to which an end is located.
    split : float
        Width of an interval down to which a third kind within it divides it into two.
    expected : float or None
        Where an end is expected.
    """

    kind_at: KindAt
    width: float
    split: float
    expected: float | None = None

    def edges_in(self, edge: _Edge) -> list[_Edge]:
        """Return the edges within an interval, each as narrow as `width`; none if both of its ends are of one kind.

        A third kind divides the interval into two, as long as it is wider than `split`. In a narrower one the end of
        the lower band is located, and the third kind is counted with the upper band.
        """
        low, high, below, above = edge.low, edge.high, edge.below, edge.above
        if below == above:
            return []
        narrow = self.width if is_sharp_end(below, above) else max(self.width, self.split)
        while high - low > narrow:
            value = self._next_value(low, high)
            kind = self.kind_at(value)
            if kind not in (below, above) and high - low > self.split:
                lower = self.edges_in(_Edge(low, value, below, kind))
                upper = self.edges_in(_Edge(value, high, kind, above))
                return [*lower, *upper]
            if kind == below:
                low = value
            else:
                high = value
        return [_Edge(low, high, below, above)]

    def _next_value(self, low: float, high: float) -> float:
        """Return the value of an interval that is examined next: its middle, or next to the expected end.

        A wider interval than `split` is halved in any case: next to an end motions may take too long to settle, and
        no band must be inferred from these alone.
        """
        if self.expected is not None and high - low <= self.split:
            for value in (
                self.expected - NEARLY_HALF * self.width,
                self.expected + NEARLY_HALF * self.width,
            ):
                if low < value < high:
                    return value
        return 0.5 * (low + high)


def with_coexisting(
    bands: Iterable[Band], kinds: Iterable[tuple[float, BandKind]]
) -> tuple[Band, ...]:
    """Return the bands, each with the other kinds that were seen within it from other starts.

    Values nearer to an end than its uncertainty do not count, nor motions without a steady state: these may only
    need more time.
    """
    seen = list(kinds)
    return tuple(
        replace(band, coexisting=tuple(sorted(_other_kinds(band, seen), key=list(BandKind).index)))
        for band in bands
    )


def _other_kinds(band: Band, seen: Sequence[tuple[float, BandKind]]) -> set[BandKind]:
    """Return the kinds of the steady states within a band that are not the band's own."""
    low, high = band.low + band.low_uncertainty, band.high - band.high_uncertainty
    return {
        kind for value, kind in seen if low < value < high and kind.is_steady and kind != band.kind
    }


def stick_bands(bands: Sequence[Band]) -> tuple[tuple[float, float], ...]:
    """Return the ends of the intervals in which the slider is at rest for some time: bands of rest and stick joined."""
    intervals: list[tuple[float, float]] = []
    for band in bands:
        if not band.kind.has_stick:
            continue
        if intervals and intervals[-1][1] == band.low:
            intervals[-1] = intervals[-1][0], band.high
        else:
            intervals.append((band.low, band.high))
    return tuple(intervals)


def threshold_of(bands: Sequence[Band], own: float) -> tuple[Band, Band] | None:
    """Return the bands on both sides of the threshold next to a value: the one that ends there, and the next one.

    The threshold is the upper end of the interval with stick that contains the value; if none does, of the next one
    below, else of the next one above. None where there is no such end within the range.
    """
    intervals = stick_bands(bands)
    containing = [interval for interval in intervals if interval[0] <= own <= interval[1]]
    lower = [interval for interval in intervals if interval[1] < own]
    # The order of preference; the next one below is the last of the lower ones.
    candidates = [*containing, *reversed(lower), *intervals]
    if not candidates:
        return None
    end = candidates[0][1]
    for below, above in zip(bands, bands[1:]):
        if below.high == end:
            return below, above
    return None
