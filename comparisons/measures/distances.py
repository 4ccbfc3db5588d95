"""Distances between nonsmooth motions, each with its numerical uncertainty.

The sup norm of a quantity that jumps is O(1) as soon as a jump is shifted by dt, however small: it is for positions and
velocities. Quantities that jump have the L1 norm over time, O(dt). Events are compared
by kind and time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from stiction.scenes import Event
from stiction.uncertain import Uncertain

SAME_TIME = 8 * np.finfo(float).eps
"""Difference of two times, relative to the largest, up to which they are the two sides of a jump: some roundings."""


@dataclass(frozen=True)
class Graph:
    """A quantity over time, straight between samples.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Not decreasing; a time that occurs twice is a jump, its value before and then after.
    values : ndarray, shape (n,)
    """

    t: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        t, values = np.asarray(self.t, dtype=float), np.asarray(self.values, dtype=float)
        if t.ndim != 1 or t.shape != values.shape or len(t) < 2:
            raise ValueError(
                f"graph: found t of shape {t.shape}, values of shape {values.shape}; "
                "expected one value per time and at least two"
            )
        if not (np.all(np.isfinite(t)) and np.all(np.isfinite(values))):
            raise ValueError(
                "graph: found values that are not finite; expected finite times and values"
            )
        if np.any(np.diff(t) < 0) or t[-1] <= t[0]:
            raise ValueError(
                "graph: found times that decrease or do not advance; expected times in order"
            )
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "values", values)

    @property
    def interpolation_error(self) -> np.ndarray:
        """Per interval, an estimate of the deviation from a smooth curve through the samples, shape (n - 1,).

        The second divided difference of neighbouring samples times h^2/4 (the error of linear interpolation is h^2/8
        times the second derivative; the factor of two covers its variation), the larger of the two ends. Samples
        next to a jump (times that differ by rounding at most) use the difference on their own side.
        """
        h, rise = np.diff(self.t), np.diff(self.values)
        smooth = h > SAME_TIME * np.max(np.abs(self.t))
        slope = np.divide(rise, h, out=np.zeros_like(h), where=smooth)
        # second derivatives at inner samples that have a smooth interval on either side
        pair = smooth[1:] & smooth[:-1]
        both = np.maximum(h[1:] + h[:-1], np.finfo(float).tiny)
        bend = np.where(pair, 2 * np.abs(np.diff(slope)) / both, 0.0)
        second = np.maximum(np.append(bend, 0.0), np.append(0.0, bend))
        return second * h**2 / 4


def l1(a: Graph, b: Graph) -> Uncertain:
    """Integrate |a - b| over the times that both cover, exactly for the two broken lines."""
    start, end = max(a.t[0], b.t[0]), min(a.t[-1], b.t[-1])
    if end <= start:
        raise ValueError(
            f"no time in common: {a.t[0]:g} .. {a.t[-1]:g} s and {b.t[0]:g} .. {b.t[-1]:g} s"
        )
    # On each interval between samples of either both lines are straight, and so is their
    # difference.
    t = np.unique(np.concatenate([a.t, b.t, [start, end]]))
    t = t[(t >= start) & (t <= end)]
    left = value_at(a, t[:-1], "after") - value_at(b, t[:-1], "after")
    right = value_at(a, t[1:], "before") - value_at(b, t[1:], "before")
    # The mean of its size: a trapezium, or two triangles where it changes its sign.
    size, other, h = np.abs(left), np.abs(right), np.diff(t)
    crossing = left * right < 0
    total = size + other
    mean = np.where(crossing, (size**2 + other**2) / np.where(total > 0, 2 * total, 1.0), total / 2)
    # the mean deviation of a parabola from its chord is two thirds of the largest
    unsure = sum(float(np.sum(2 / 3 * g.interpolation_error * np.diff(g.t))) for g in (a, b))
    return Uncertain(float(np.sum(mean * h)), unsure)


def value_at(graph: Graph, t: np.ndarray, side: str) -> np.ndarray:
    """Return the values of the broken line at times t; at a jump that of the given side."""
    right = np.searchsorted(graph.t, t, side="right" if side == "after" else "left")
    right = np.clip(right, 1, len(graph.t) - 1)
    h = graph.t[right] - graph.t[right - 1]
    share = np.divide(t - graph.t[right - 1], h, out=np.ones_like(t), where=h > 0)
    return graph.values[right - 1] + share * (graph.values[right] - graph.values[right - 1])


@dataclass(frozen=True)
class EventComparison:
    """Comparison of the events found with the true ones.

    Attributes
    ----------
    matched : tuple of (Event, Event)
        True event and the one found for it, in order of the true ones.
    missed, spurious : tuple of Event
        True events without a counterpart, found ones without.
    time_error : float
        Largest |time error| of the matched, s; nan without any.
    """

    matched: tuple[tuple[Any, Event], ...]
    missed: tuple[Any, ...]
    spurious: tuple[Event, ...]
    time_error: float


def match_events(true: Sequence[Any], found: Sequence[Event], window: float) -> EventComparison:
    """Match events of the same kind and joint whose times (s) differ by no more than the window.

    The true ones are anything with a time, a kind and a joint.

    The matching has as many pairs as possible and, among those, the smallest sum of time errors (assignment problem).
    """
    if not window > 0:
        raise ValueError(f"window: found {window:g}; expected a positive time in seconds")
    gap = np.abs(np.subtract.outer([e.time for e in true], [e.time for e in found])).reshape(
        len(true), len(found)
    )
    alike = np.array(
        [[e.kind == f.kind and e.joint == f.joint for f in found] for e in true], dtype=bool
    )
    alike = alike.reshape(gap.shape) & (gap <= window)
    # one pair more is worth more than any sum of time errors
    cost = np.where(alike, gap, window * (1 + min(gap.shape)))
    pairs = sorted((i, j) for i, j in zip(*linear_sum_assignment(cost)) if alike[i, j])
    rows, columns = {i for i, _ in pairs}, {j for _, j in pairs}
    missed = tuple(e for i, e in enumerate(true) if i not in rows)
    spurious = tuple(e for j, e in enumerate(found) if j not in columns)
    worst = float(max((gap[pair] for pair in pairs), default=np.nan))
    matched = tuple((true[i], found[j]) for i, j in pairs)
    return EventComparison(matched, missed, spurious, worst)
