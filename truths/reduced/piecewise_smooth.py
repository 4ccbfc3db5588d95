"""Integration of piecewise smooth motions to machine precision, with events at roots of polynomials.

Within a contact mode the equation of motion is smooth, q'' = f(t, q, v). On a step of length h it is solved by
collocation at Chebyshev points, iterated to its fixed point (Clenshaw & Norton, The solution of nonlinear ordinary
differential equations in Chebyshev series, Comput. J. 6, 1963). The step is accepted if the last coefficients of q''
are rounding. Position and velocity are then polynomials, and so are, to rounding, all guards, which are functions that
are positive while the mode lasts. The first root of a guard ends the mode. No root is overlooked, even if the guard is
negative for a very short time: a part of the step is skipped only if the bound |p - c0| <= sum |ck| of a Chebyshev
series shows that p has no zero there, or that p' has none and p has the same sign at both ends; other parts are halved.

The mode that follows an event is found by trial. The mechanism lists candidates in the order of
their precedence; the first one that remains consistent during a very short step is taken. No rule
is needed for ties, for a guard that starts at zero, or for break-away without a jump (mus = mu).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import brentq

from stiction.truths.truth import TruthRefused

TRIAL_STEPS = (1e-6, 1e-5)
"""Lengths of trial steps, s. The longer one is used if no mode is consistent for the shorter one, for example because a
slider would stick for less than that.

Changes of mode that are closer than this count as one: the error of position is below 1e-10 (usually 1e-12) times the
jump of q''. These and the following times are for motions up to `_FAST`, and are shortened in proportion for faster
motions.
"""
_FAST = 10.0
"""Angular frequency, rad/s, up to which the times of this module apply unchanged."""
_SHORTEST_STEP = 1e-9
"""Shortest step, s; a mode that needs shorter steps has no smooth motion."""
_JUNCTION = 1e-12
"""Time before a step, s, within which a root belongs to the step: rounding at the junction of two steps."""
_PICARD_LIMIT = 60
"""Picard iterations after which a step counts as too long."""
_SAME = 1e-6
"""Relative difference of accelerations below which two modes are the same motion (a tie of signs)."""
_ROUNDING = np.finfo(float).eps
"""Relative rounding of a number."""
_NOISE = 5e-14
"""Rounding of a polynomial's coefficients, relative to max |q''| and what cancels in it: some hundred roundings."""
_STALLED = 4 * _ROUNDING
"""Relative change of q'' at which the Picard iteration has converged whatever its rate: rounding of one evaluation."""
_TAIL = 3
"""Number of last Chebyshev coefficients that must be rounding. Every other coefficient of an even function is zero."""
_GUARD_NOISE = 10 * _NOISE
"""As `_NOISE`, for guards, which are computed from q, v and q'' and have the rounding of all of them."""
_BELOW_NOISE = 10.0
"""Ratio of the rounding of a group of guards to a series that counts as zero throughout, rather than full of roots."""
_ROOT_XTOL = 1e-15
"""Absolute tolerance of a root in [-1, 1]."""
_ROOT_RTOL = 4 * _ROUNDING
"""Relative tolerance of a root, the smallest that `scipy.optimize.brentq` accepts."""
_TRIMMED = 4 * _ROUNDING
"""Relative size of leading coefficients that are dropped before eigenvalues are taken: they would be divided by."""
_REAL = 1e-10
"""Imaginary part below which an eigenvalue is a real root: rounding of a simple root."""
_HALVINGS = 12
"""Largest number of halvings. If bounds cannot distinguish a double root from none then, eigenvalues decide."""
_GROWTH = 1.5
"""Ratio of a step to the previous one, if that was accepted; a step that is too long is halved."""
_SWITCH_LIMIT = 100_000
"""Changes of mode after which a motion is refused: they seem to accumulate."""
_LATE = 10.0
"""Time, s, after which the rounding of the time itself is considered.

Rates of q'' are some ten times its size per second, so that the rounding eps |t| changes it by 100 eps at this time,
which is near `_NOISE`.
"""


class Undecided(TruthRefused):
    """Rounding decides the result: two integrations disagree on a grazing event, or no mode is consistent."""


class NoMotion(TruthRefused):
    """The equations have no motion, or more than one, after the instant `time` (s)."""

    def __init__(self, reason: str, time: float):
        super().__init__(f"{reason} at t = {time:.9f} s")
        self.time = time


class PiecewiseMechanism(ABC):
    """A reduced mechanism whose equation of motion is smooth within each of its modes, which are hashable.

    Arrays: t (k,), q, v, a (n, k) for n coordinates at k instants.
    """

    @property
    def magnitude(self) -> float:
        """Size of the terms of q'' and of the guards before they cancel, which determines their rounding."""
        return 1.0

    @property
    def fastest(self) -> float:
        """Angular frequency of what turns, pushes or swings fastest, rad/s."""
        return 0.0

    @property
    def pace(self) -> float:
        """Factor on the times of a search, 1 or less."""
        return _FAST / max(_FAST, self.fastest)

    @abstractmethod
    def acceleration(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Any) -> np.ndarray:
        """Return q'' in a mode, shape (n, k), which must continue smoothly somewhat beyond the end of the mode."""

    @abstractmethod
    def guards(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, mode: Any
    ) -> np.ndarray:
        """Return m guards of p functions each, shape (m, p, k).

        The mode lasts while the largest function of each guard is positive.
        """

    def limits(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Any) -> np.ndarray:
        """Return functions like `guards`, shape (m, p, k), that are positive while the motion is unique."""
        return np.empty((0, 1, len(t)))

    @abstractmethod
    def candidates(
        self, t: float, q: np.ndarray, v: np.ndarray, mode: Any, guard: int | None
    ) -> Iterator[list[tuple[Any, np.ndarray]]]:
        """Yield the modes that may follow when `guard` of `mode` has reached zero, each with its initial velocity (n,).

        Modes are yielded in groups; a group is tried only if no mode of the previous groups is consistent. At the start
        of the motion mode and guard are None.

        Raises
        ------
        NoMotion
            If the motion would not be unique.
        """

    @abstractmethod
    def columns(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Any
    ) -> dict[str, np.ndarray]:
        """Return all columns of a Trajectory within a mode, each (k,)."""

    @abstractmethod
    def slip(self, mode: Any) -> tuple[int, ...]:
        """Return the direction of slip of each guide, 0 in stick."""

    def corner_guide(self, mode: Any, guard: int) -> int:
        """Return the index of the guide whose corner force is a guard of a mode."""
        return 0


@dataclass(frozen=True)
class Segment:
    """A collocation step.

    Attributes
    ----------
    start, length : float
        The interval [start, start + length] of the polynomials, s.
    end : float
        Time up to which the mode lasts, s.
    mode
        The contact mode.
    position, velocity : ndarray, shape (n, terms)
        Chebyshev coefficients of the coordinates and velocities.
    """

    start: float
    length: float
    end: float
    mode: Any
    position: np.ndarray
    velocity: np.ndarray


@dataclass(frozen=True)
class Switch:
    """The end of a mode.

    Attributes
    ----------
    time : float
        Time, s.
    index : int
        Index of the first segment of the next mode.
    guard : int
        Guard that ended the mode.
    """

    time: float
    index: int
    guard: int


@dataclass(frozen=True)
class Motion:
    """Motion of a reduced mechanism: its segments and changes of mode, in the order of time."""

    segments: tuple[Segment, ...]
    switches: tuple[Switch, ...]

    def owner(self, t: np.ndarray, side: str) -> np.ndarray:
        """Return the index of the segment of each instant; `side` selects the segment at a change of mode."""
        ends = np.array([segment.end for segment in self.segments[:-1]])
        return np.searchsorted(ends, t, side="right" if side == "after" else "left")

    def state(self, t: np.ndarray, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return q and v, each (n, k), by the polynomials of the segments with the indices `owner` (k,)."""
        start, length, position, velocity = (
            np.array([getattr(s, name) for s in self.segments])[owner]
            for name in ("start", "length", "position", "velocity")
        )
        x = 2 * (t - start) / length - 1
        q, v = (
            chebyshev.chebval(x, np.moveaxis(series, -1, 0).swapaxes(1, 2), tensor=False)
            for series in (position, velocity)
        )
        return q, v

    def final_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return q and v at the end, each (n,)."""
        q, v = self.state(np.array([self.segments[-1].end]), np.array([len(self.segments) - 1]))
        return q[:, 0], v[:, 0]


class Collocation:
    """Chebyshev collocation of q'' = f with `order` points.

    The error of a step of h seconds, at most `longest_step`, is O(h^order).
    """

    def __init__(self, order: int = 24, longest_step: float = 0.25):
        self.order = order
        self.longest_step = longest_step
        k = np.arange(order)
        # Nodes are the Chebyshev points of the first kind, ascending. The polynomials are orthogonal on
        # them, so that coefficients are sums over values (discrete cosine transform).
        self.nodes = -np.cos(np.pi * (k + 0.5) / order)
        values = chebyshev.chebvander(self.nodes, order - 1)
        self.to_coefficients = (values * np.where(k == 0, 1, 2) / order).T

        # Matrices of the single and the double integral from the start of the step map coefficients of
        # q'' to coefficients, and values at the nodes to values.
        identity = np.eye(order)
        self._once = np.array([chebyshev.chebint(row, 1, lbnd=-1) for row in identity])
        self._twice = np.array([chebyshev.chebint(row, 2, lbnd=-1) for row in identity])
        self._velocity = chebyshev.chebval(self.nodes, self._once.T).T @ self.to_coefficients
        self._position = chebyshev.chebval(self.nodes, self._twice.T).T @ self.to_coefficients

        # Matrices for the search of roots yield the derivative of a series, and its coefficients on either
        # half of the interval.
        self._derivative = np.array([np.append(chebyshev.chebder(row), 0.0) for row in identity]).T
        self._halves = [
            np.array(
                [
                    chebyshev.chebinterpolate(partial(_on_half, row, side), order - 1)
                    for row in identity
                ]
            ).T
            for side in (-1, 1)
        ]

    def solve(
        self,
        mechanism: PiecewiseMechanism,
        mode: Hashable,
        t0: float,
        q0: np.ndarray,
        v0: np.ndarray,
        h: float,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
        """Return the instants, q, v and a at the nodes of the step [t0, t0 + h].

        None is returned if h (s) is too long for full precision.
        """
        s = h / 2
        t = t0 + s * (self.nodes + 1)
        drift = q0[:, None] + v0[:, None] * (t - t0)
        a = np.zeros((len(q0), self.order))
        change = np.inf
        magnitude = mechanism.magnitude
        # Picard iteration: integrate the last q'' to q and v, and evaluate q'' from these.
        for _ in range(_PICARD_LIMIT):
            q = drift + s * s * a @ self._position.T
            v = v0[:, None] + s * a @ self._velocity.T
            new = mechanism.acceleration(t, q, v, mode)
            if not np.isfinite(new).all():
                return None
            last_change = change
            change = np.abs(new - a).max()
            scale = (np.abs(new).max() + magnitude) * max(1.0, abs(t0) / _LATE)
            a = new
            # The iteration has converged if changes are one rounding, or are small and no longer decrease
            # as for a contraction.
            stagnates = change <= _NOISE * scale and change >= last_change / 2
            if change <= _STALLED * scale or stagnates:
                break
        else:
            return None
        # The polynomial is the solution to rounding only if its own last terms are rounding.
        tail = np.abs(a @ self.to_coefficients.T)[:, -_TAIL:]
        if not np.max(tail) <= _NOISE * scale:
            return None
        return t, q, v, a

    def segment(
        self,
        mode: Hashable,
        t0: float,
        q0: np.ndarray,
        v0: np.ndarray,
        h: float,
        end: float,
        a: np.ndarray,
    ) -> Segment:
        """Return a step, with its solution `a` at the nodes, as polynomials that are valid up to `end` (s)."""
        s = h / 2
        coefficients = a @ self.to_coefficients.T
        velocity = s * coefficients @ self._once
        # The integrals vanish at x = -1. In Chebyshev polynomials q0 + v0 (t - t0) is
        # q0 + s v0 + s v0 T1(x).
        position = s * s * coefficients @ self._twice
        velocity[:, 0] += v0
        position[:, 0] += q0 + s * v0
        position[:, 1] += s * v0
        return Segment(t0, h, end, mode, position, velocity)

    def resolves(self, functions: np.ndarray, magnitude: float) -> bool:
        """Return True if the polynomials through the values at the nodes, shape (.., order), equal the functions."""
        coefficients = np.abs(functions @ self.to_coefficients.T)
        scale = magnitude + np.max(coefficients, axis=-1, keepdims=True)
        return bool(np.all(coefficients[..., -_TAIL:] <= _GUARD_NOISE * scale))

    def first_root(self, guards: np.ndarray, h: float, ignore: float) -> tuple[float, int] | None:
        """Return when the first guard becomes negative, in seconds from the start of the step, and its index.

        Parameters
        ----------
        guards : ndarray, shape (m, p, order)
            Guards as in `PiecewiseMechanism.guards`, at the nodes.
        h : float
            Length of the step, s.
        ignore : float
            Time from the start of the step up to which guards are not considered, s.
        """
        series = guards @ self.to_coefficients.T
        # Since |Tk| <= 1, a function whose c0 exceeds the sum of all other |ck| is positive throughout,
        # and so is its guard, which needs no search.
        is_positive = np.any(series[..., 0] > np.sum(np.abs(series[..., 1:]), axis=-1), axis=1)
        begin = max(2 * ignore / h - 1, -1.0)
        ends = []
        for i in np.flatnonzero(~is_positive).tolist():
            root = self._first_negative(series[i], begin)
            if root is not None:
                ends.append(((root + 1) * h / 2, i))
        return min(ends, default=None)

    def _first_negative(self, group: np.ndarray, begin: float) -> float | None:
        """Return the first x in [begin, 1] at which the largest of some series becomes negative; None if there is none.

        The Chebyshev series have the shape (p, order).
        """
        noise = _NOISE * np.max(np.abs(group))
        if np.max(chebyshev.chebval(begin, group.T)) < -noise:
            return begin
        # Between neighbouring roots of all functions no sign changes, so that one value decides.
        roots: list[float] = []
        for series in group:
            roots += self._roots(series, -1.0, 1.0, _HALVINGS, noise / _BELOW_NOISE)
        roots.sort()
        ends = [root for root in roots if begin < root < 1] + [1.0]
        for root, end in zip(ends, ends[1:]):
            if np.max(chebyshev.chebval((root + end) / 2, group.T)) < 0:
                return root
        return None

    def _roots(
        self, series: np.ndarray, low: float, high: float, halvings: int, zero: float
    ) -> list[float]:
        """Return the roots of a series over [low, high].

        A series that is nowhere larger than `zero` counts as zero and has no roots. `halvings` is the number of
        halvings that are left.
        """
        # There is no root if the constant term exceeds all others.
        size = np.abs(series)
        if size[0] > np.sum(size[1:]) or np.sum(size) <= zero:
            return []
        slope = self._derivative @ series
        if abs(slope[0]) > np.sum(np.abs(slope[1:])):
            # By the same bound the derivative has no zero: the function is monotonic, and the signs at
            # the ends decide.
            backwards = series[::-1].tolist()
            if _clenshaw(-1.0, backwards) * _clenshaw(1.0, backwards) > 0:
                return []
            roots = [brentq(_clenshaw, -1.0, 1.0, (backwards,), xtol=_ROOT_XTOL, rtol=_ROOT_RTOL)]
        elif halvings:
            # Neither bound decides. They are closer on halves, where a term of order k is smaller by a
            # factor of 2^k.
            middle = (low + high) / 2
            left, right = (half @ series for half in self._halves)
            return self._roots(left, low, middle, halvings - 1, zero) + self._roots(
                right, middle, high, halvings - 1, zero
            )
        else:
            # To rounding this is a double root: roots are the eigenvalues of the companion matrix.
            complex_roots = chebyshev.chebroots(chebyshev.chebtrim(series, _TRIMMED * np.max(size)))
            real = (np.abs(complex_roots.imag) < _REAL) & (np.abs(complex_roots.real) <= 1)
            roots = complex_roots.real[real].tolist()
        return [low + (high - low) * (float(root) + 1) / 2 for root in roots]


def _on_half(row: np.ndarray, side: int, x: np.ndarray) -> Any:
    """Return the values of a series at x in [-1, 1], scaled to the left (-1) or right (1) half of the interval."""
    return chebyshev.chebval((x + side) / 2, row)


def _clenshaw(x: float, backwards: list[float]) -> float:
    """Return the value of a Chebyshev series at x; `backwards` contains its coefficients from the last to the first.

    Clenshaw's recurrence is b[k] = c[k] + 2 x b[k+1] - b[k+2]. It uses plain floats because Brent's method evaluates
    one point at a time, for which NumPy's calls would take longer than the sum itself.
    """
    b1 = b2 = 0.0
    for coefficient in backwards[:-1]:
        b1, b2 = coefficient + 2 * x * b1 - b2, b1
    return backwards[-1] + x * b1 - b2


def integrate(
    mechanism: PiecewiseMechanism,
    t0: float,
    t_end: float,
    q0: np.ndarray,
    v0: np.ndarray,
    collocation: Collocation,
) -> Motion:
    """Return the motion from (t0, q0, v0) to t_end (s).

    Raises
    ------
    NoMotion
        If no mode is consistent at the start, if the step becomes too small, or after too many changes of mode.
    Undecided
        If no mode is consistent to rounding later.
    """
    t = float(t0)
    q = np.array(q0, dtype=float)
    v = np.array(v0, dtype=float)
    segments: list[Segment] = []
    switches: list[Switch] = []
    mode, v, ignored = _next_mode(mechanism, collocation, t, q, v, None, None)
    h = collocation.longest_step
    junction = _JUNCTION * mechanism.pace
    while t < t_end:
        # A step is short enough if the motion and all guards are polynomials to rounding.
        h = min(h, collocation.longest_step)
        solved = collocation.solve(mechanism, mode, t, q, v, h)
        if solved is not None:
            guards, limits = mechanism.guards(*solved, mode), mechanism.limits(*solved[:3], mode)
        if solved is None or not all(
            collocation.resolves(f, mechanism.magnitude) for f in (guards, limits)
        ):
            h /= 2
            if h < _SHORTEST_STEP * mechanism.pace:
                raise NoMotion(f"no smooth motion in mode {mode}", t)
            continue

        # The mode ends at the first root of a guard, unless uniqueness is lost before it.
        root = collocation.first_root(guards, h, ignored)
        limit = collocation.first_root(limits, h, -junction)
        if limit is not None and t + limit[0] < t_end and (root is None or limit[0] < root[0]):
            raise NoMotion(
                f"several motions, or none, besides mode {mode}: friction adds more load than inertia takes "
                "away",
                t + limit[0],
            )
        # The segment has the polynomials of the whole step, and is valid up to the root.
        end = t + (h if root is None else root[0])
        segments.append(collocation.segment(mode, t, q, v, h, min(end, t_end), solved[3]))
        t = segments[-1].end
        q, v = Motion((segments[-1],), ()).final_state()
        if root is not None and end < t_end:
            if len(switches) == _SWITCH_LIMIT:
                raise NoMotion(f"more than {_SWITCH_LIMIT} changes of mode", t)
            switches.append(Switch(t, len(segments), root[1]))
            mode, v, ignored = _next_mode(mechanism, collocation, t, q, v, mode, root[1])
        else:
            h, ignored = _GROWTH * h, -junction
    return Motion(tuple(segments), tuple(switches))


def _next_mode(
    mechanism: PiecewiseMechanism,
    collocation: Collocation,
    t: float,
    q: np.ndarray,
    v: np.ndarray,
    mode: Hashable,
    guard: int | None,
) -> tuple[Hashable, np.ndarray, float]:
    """Return the mode after t, its initial velocity, and the time after t within which its guards are positive.

    A candidate is consistent if its guards are positive in the second half of a short trial step. In the first half
    guards that start at zero are rounding.
    """
    later = slice(collocation.order // 2, None)
    for trial in (mechanism.pace * seconds for seconds in TRIAL_STEPS):
        for group in mechanism.candidates(t, q, v, mode, guard):
            consistent = []
            for candidate, velocity in group:
                solved = collocation.solve(mechanism, candidate, t, q, velocity, trial)
                if solved is None:
                    continue
                instants, positions, velocities, accelerations = (
                    array[..., later] for array in solved
                )
                values = mechanism.guards(instants, positions, velocities, accelerations, candidate)
                if np.all(np.max(values, axis=1) >= 0):
                    consistent.append((candidate, velocity, solved[3][:, -1]))
            # Several modes of a group may have the same motion (if a corner force is zero), but not
            # different motions.
            if consistent:
                candidate, velocity, a = consistent[0]
                for other, _, b in consistent[1:]:
                    if np.max(np.abs(a - b)) > _SAME * (1 + np.max(np.abs(a))):
                        raise NoMotion(f"several motions: modes {candidate} and {other}", t)
                return candidate, velocity, trial / 2
    if mode is None:
        raise NoMotion("no consistent contact mode", t)
    # The motion is unique up to t, so that a mode exists. Near the loss of uniqueness accelerations
    # change too fast for it to be found.
    raise Undecided(f"no mode is consistent to rounding after mode {mode} at t = {t:.9f} s")
