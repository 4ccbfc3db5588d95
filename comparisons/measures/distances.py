"""Distances between nonsmooth motions, with their numerical uncertainties.

If a jump is shifted by dt, the maximum norm of the difference is the size of the jump, however
small dt is. Therefore the maximum norm is only used for positions and velocities. Quantities with
jumps are compared by the L1 norm over time, which is O(dt). Events are compared by kind and time.
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
"""Largest difference of the times of both sides of a jump, relative to the largest time: some
rounding errors."""


@dataclass(frozen=True)
class Graph:
    """A quantity over time, linear between samples.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times in ascending order. A time that occurs twice is that of a jump, with the value before
        it and then the value after it.
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
        """Estimate for each interval of the deviation from a smooth curve through the samples, shape (n - 1,).

        The error of linear interpolation is h^2/8 times the second derivative. The estimate is
        h^2/4 times the second divided difference, where the factor of two accounts for its
        variation. The larger one of both ends of the interval is taken; at a jump it is that of the
        other end.
        """
        h, rise = np.diff(self.t), np.diff(self.values)
        is_smooth = h > SAME_TIME * np.max(np.abs(self.t))
        slope = np.divide(rise, h, out=np.zeros_like(h), where=is_smooth)
        # second derivatives at the inner samples, 0 beside a jump
        is_between_smooth = is_smooth[1:] & is_smooth[:-1]
        two_h = np.maximum(h[1:] + h[:-1], np.finfo(float).tiny)
        curvature = np.where(is_between_smooth, 2 * np.abs(np.diff(slope)) / two_h, 0.0)
        largest = np.maximum(np.append(curvature, 0.0), np.append(0.0, curvature))
        return largest * h**2 / 4


def l1(a: Graph, b: Graph) -> Uncertain:
    """Return the integral of |a - b| over the common interval of time, exact for piecewise linear functions.

    Its uncertainty is that of the linear interpolation.
    """
    start, end = max(a.t[0], b.t[0]), min(a.t[-1], b.t[-1])
    if end <= start:
        raise ValueError(
            f"no time in common: {a.t[0]:g} .. {a.t[-1]:g} s and {b.t[0]:g} .. {b.t[-1]:g} s"
        )
    # Between successive samples of either graph, the difference is linear.
    t = np.unique(np.concatenate([a.t, b.t, [start, end]]))
    t = t[(t >= start) & (t <= end)]
    left = value_at(a, t[:-1], "after") - value_at(b, t[:-1], "after")
    right = value_at(a, t[1:], "before") - value_at(b, t[1:], "before")
    # The mean of |difference| is that of a trapezium, or of two triangles if the sign changes.
    left_size, right_size = np.abs(left), np.abs(right)
    total = left_size + right_size
    of_triangles = (left_size**2 + right_size**2) / np.where(total > 0, 2 * total, 1.0)
    mean = np.where(left * right < 0, of_triangles, total / 2)
    # the mean deviation of a parabola from its chord is two thirds of the largest
    uncertainty = sum(float(np.sum(2 / 3 * g.interpolation_error * np.diff(g.t))) for g in (a, b))
    return Uncertain(float(np.sum(mean * np.diff(t))), uncertainty)


def value_at(graph: Graph, t: np.ndarray, side: str) -> np.ndarray:
    """Return the values of a graph at times t; at a jump, the value on the side "before" or "after"."""
    right = np.searchsorted(graph.t, t, side="right" if side == "after" else "left")
    right = np.clip(right, 1, len(graph.t) - 1)
    h = graph.t[right] - graph.t[right - 1]
    share = np.divide(t - graph.t[right - 1], h, out=np.ones_like(t), where=h > 0)
    return graph.values[right - 1] + share * (graph.values[right] - graph.values[right - 1])


@dataclass(frozen=True)
class EventComparison:
    """Comparison of located events with true ones.

    Attributes
    ----------
    matched : tuple of (Event, Event)
        True event and located event, in the order of the true ones.
    missed : tuple of Event
        True events that do not match any located one.
    spurious : tuple of Event
        Located events that do not match any true one.
    time_error : float
        Largest |time error| of matched events, s; nan if there are none.
    """

    matched: tuple[tuple[Any, Event], ...]
    missed: tuple[Any, ...]
    spurious: tuple[Event, ...]
    time_error: float


def match_events(true: Sequence[Any], located: Sequence[Event], window: float) -> EventComparison:
    """Match events of the same kind and joint whose times differ by no more than a window.

    The matching has as many pairs as possible and, among such matchings, the smallest sum of time
    errors. It is an assignment problem.

    Parameters
    ----------
    true : sequence
        Objects with a time, a kind and a joint.
    located : sequence of Event
    window : float
        Seconds.
    """
    if not window > 0:
        raise ValueError(f"window: found {window:g}; expected a positive time in seconds")
    shape = len(true), len(located)
    times = [event.time for event in true]
    time_errors = np.abs(np.subtract.outer(times, [event.time for event in located])).reshape(shape)
    is_pair = np.zeros(shape, dtype=bool)
    for i, event in enumerate(true):
        for j, other in enumerate(located):
            is_pair[i, j] = event.kind == other.kind and event.joint == other.joint
    is_pair &= time_errors <= window
    # Pairs that are not allowed cost more than any sum of time errors, so that the number of
    # allowed pairs is as large as possible.
    cost = np.where(is_pair, time_errors, window * (1 + min(shape)))
    pairs = sorted((i, j) for i, j in zip(*linear_sum_assignment(cost)) if is_pair[i, j])
    matched_true = {i for i, _ in pairs}
    matched_located = {j for _, j in pairs}
    return EventComparison(
        matched=tuple((true[i], located[j]) for i, j in pairs),
        missed=tuple(event for i, event in enumerate(true) if i not in matched_true),
        spurious=tuple(event for j, event in enumerate(located) if j not in matched_located),
        time_error=float(max((time_errors[pair] for pair in pairs), default=np.nan)),
    )
