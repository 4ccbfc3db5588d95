"""Piecewise smooth motion to machine precision: Picard-Chebyshev steps and events at polynomial roots.

Within a contact mode the equation of motion is smooth, q'' = f(t, q, v). On a step of length h it is
solved by collocation at Chebyshev points, iterated to its fixed point (Clenshaw & Norton, The solution of
nonlinear ordinary differential equations in Chebyshev series, Comput. J. 6, 1963); the step is accepted
once the last coefficients of q'' are rounding. Position and velocity are then polynomials, and so is, to
rounding, every guard: the functions that are positive while the mode lasts. The first root of a guard ends the mode. No
root is overlooked, however short the guard is negative: a part of the step is passed over only where the bound
|p - c0| <= sum |ck| of a Chebyshev series shows that p has no zero there, or that p' has none and p the same sign at
both ends; other parts are halved.

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
"""Seconds; the longer where no mode holds for the shorter, as when a slider would stick for less than that.

Two changes of mode closer than this are taken as one: the error of position is below 1e-10 (usually
1e-12) times the jump of q''. These and the times below hold for motions up to `_FAST`; for faster
ones they are shorter in proportion.
"""
_FAST = 10.0
"""Angular frequency up to which the times of a search hold as they are given, rad/s."""
_SHORTEST_STEP = 1e-9
"""s; a mode that needs shorter steps has no smooth motion."""
_JUNCTION = 1e-12
"""s; a root this close before a step belongs to it: rounding at the junction of two steps."""
_PICARD_LIMIT = 60
"""Picard iterations after which a step counts as too long."""
_SAME = 1e-6
"""Relative; accelerations of two modes that are one motion (a tie of signs) differ by rounding only."""
_ROUNDING = np.finfo(float).eps
_NOISE = 5e-14
"""Rounding of a polynomial's coefficients, relative to max |q''| and what cancels in it: some hundred roundings."""
_STALLED = 4 * _ROUNDING
"""Relative change of q'' at which the Picard iteration has converged whatever its rate: rounding of one evaluation."""
_TAIL = 3
"""Last Chebyshev coefficients that must be rounding: more than one, as every other one of an even function is zero."""
_GUARD_NOISE = 10 * _NOISE
"""As `_NOISE`, for guards, which are computed from q, v and q'' and have the rounding of all of them."""
_BELOW_NOISE = 10.0
"""Ratio of the rounding of a group of guards to a series that counts as zero throughout, rather than full of roots."""
_ROOT_XTOL, _ROOT_RTOL = 1e-15, 4 * _ROUNDING
"""Tolerances of a root in [-1, 1]; the relative one is the smallest that `scipy.optimize.brentq` accepts."""
_TRIMMED = 4 * _ROUNDING
"""Relative size of leading coefficients that are dropped before eigenvalues are taken: they would be divided by."""
_REAL = 1e-10
"""Imaginary part below which an eigenvalue is a real root: rounding of a simple root."""
_HALVINGS = 12
"""After these, where bounds cannot separate a double root from none, eigenvalues decide."""
_LONGER = 1.5
"""Ratio of a step to the one before, if that was accepted; a step that is too long is halved."""
_SWITCH_LIMIT = 100_000
"""Changes of mode after which a motion is refused: they seem to accumulate."""
_LATE = 10.0
"""s; from here on the rounding of the time itself counts.

Rates of q'' are some ten times its size per second, so that eps |t| moves it by 100 eps at this
time, near `_NOISE`.
"""


class Undecided(TruthRefused):
    """Rounding decides the result: two integrations disagree on a grazing event, or no mode is consistent."""


class NoMotion(TruthRefused):
    """The equations have no motion, or more than one, from some instant `time` (s) on."""

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
        """q'' in a mode, shape (n, k); must continue smoothly somewhat beyond the end of the mode."""

    @abstractmethod
    def guards(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, mode: Any
    ) -> np.ndarray:
        """Return guards, shape (m, p, k): the mode lasts while the largest of each one's p functions is positive."""

    def limits(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Any) -> np.ndarray:
        """Functions as of `guards`, shape (m, p, k), positive while the motion of the mode is the only one."""
        return np.empty((0, 1, len(t)))

    @abstractmethod
    def candidates(
        self, t: float, q: np.ndarray, v: np.ndarray, mode: Any, guard: int | None
    ) -> Iterator[list[tuple[Any, np.ndarray]]]:
        """Yield the modes that may follow when `guard` of `mode` has reached zero, each with its initial velocity (n,).

        Modes are yielded in groups; a group is tried only if no mode of the groups before it is
        consistent. NoMotion is raised where the motion would not be unique. At the start of the
        motion mode and guard are None.
        """

    @abstractmethod
    def columns(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Any
    ) -> dict[str, np.ndarray]:
        """All columns of a Trajectory within a mode, each (k,)."""

    @abstractmethod
    def slip(self, mode: Any) -> tuple[int, ...]:
        """Return the direction of slip of each guide, 0 in stick."""

    def corner_guide(self, mode: Any, guard: int) -> int:
        """Number of the guide whose corner force a guard of a mode watches."""
        return 0


@dataclass(frozen=True)
class Segment:
    """A collocation step: Chebyshev coefficients over [start, start + length], valid up to `end`."""

    start: float
    length: float
    end: float
    mode: Any
    position: np.ndarray
    velocity: np.ndarray


@dataclass(frozen=True)
class Switch:
    """The end of a mode between segments[index - 1] and segments[index], and the guard that ended it."""

    time: float
    index: int
    guard: int


@dataclass(frozen=True)
class Motion:
    """The whole motion of a reduced mechanism."""

    segments: tuple[Segment, ...]
    switches: tuple[Switch, ...]

    def owner(self, t: np.ndarray, side: str) -> np.ndarray:
        """Return the index of the segment of each instant; a switch belongs to the one before or after it."""
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
    """Chebyshev collocation of q'' = f with `order` points: the error of a step of h seconds is O(h^order)."""

    def __init__(self, order: int = 24, longest_step: float = 0.25):
        self.order, self.longest_step = order, longest_step
        k = np.arange(order)
        # Chebyshev points of the first kind, ascending. The polynomials are orthogonal over them,
        # so that coefficients are sums over values (discrete cosine transform).
        self.nodes = -np.cos(np.pi * (k + 0.5) / order)
        values = chebyshev.chebvander(self.nodes, order - 1)
        self.to_coefficients = (values * np.where(k == 0, 1, 2) / order).T

        # Matrices on the coefficients of q'': single and double integral from the start of the
        # step, as coefficients and as values at the nodes.
        identity = np.eye(order)
        self._once = np.array([chebyshev.chebint(row, 1, lbnd=-1) for row in identity])
        self._twice = np.array([chebyshev.chebint(row, 2, lbnd=-1) for row in identity])
        self._velocity = chebyshev.chebval(self.nodes, self._once.T).T @ self.to_coefficients
        self._position = chebyshev.chebval(self.nodes, self._twice.T).T @ self.to_coefficients

        # For the search of roots: the derivative of a series, and its coefficients on either half
        # of the interval.
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
        """Instants, q, v, a at the nodes of the step [t0, t0 + h]; None if h is too long for full precision."""
        s = h / 2
        t = t0 + s * (self.nodes + 1)
        drift = q0[:, None] + v0[:, None] * (t - t0)
        a = np.zeros((len(q0), self.order))
        change, magnitude = np.inf, mechanism.magnitude
        # Picard iteration: q and v by integration of the last q'', then q'' anew from them.
        for _ in range(_PICARD_LIMIT):
            q = drift + s * s * a @ self._position.T
            v = v0[:, None] + s * a @ self._velocity.T
            new = mechanism.acceleration(t, q, v, mode)
            if not np.isfinite(new).all():
                return None
            last_change, change = change, np.abs(new - a).max()
            scale = (np.abs(new).max() + magnitude) * max(1.0, abs(t0) / _LATE)
            a = new
            # Converged: changes are one rounding, or small and no longer decrease as those of a
            # contraction do.
            stagnates = change <= _NOISE * scale and change >= last_change / 2
            if change <= _STALLED * scale or stagnates:
                break
        else:
            return None
        # The polynomial is the solution to rounding only if its own last terms are rounding.
        tail = np.abs(a @ self.to_coefficients.T)[:, -_TAIL:]
        return (t, q, v, a) if np.max(tail) <= _NOISE * scale else None

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
        """Return the solved step as polynomials."""
        s = h / 2
        coefficients = a @ self.to_coefficients.T
        velocity = s * coefficients @ self._once
        # the integrals vanish at x = -1; q0 + v0 (t - t0) in Chebyshev polynomials is q0 + s v0 + s
        # v0 T1(x)
        position = s * s * coefficients @ self._twice
        velocity[:, 0] += v0
        position[:, 0] += q0 + s * v0
        position[:, 1] += s * v0
        return Segment(t0, h, end, mode, position, velocity)

    def resolves(self, functions: np.ndarray, magnitude: float) -> bool:
        """Check that polynomials through the values at the nodes, shape (.., order), are the functions to rounding."""
        coefficients = np.abs(functions @ self.to_coefficients.T)
        scale = magnitude + np.max(coefficients, axis=-1, keepdims=True)
        return bool(np.all(coefficients[..., -_TAIL:] <= _GUARD_NOISE * scale))

    def first_root(self, guards: np.ndarray, h: float, ignore: float) -> tuple[float, int] | None:
        """Time since the start of the step, and number, of the first guard that becomes negative after `ignore`.

        Guards as in `PiecewiseMechanism.guards`, by their values at the nodes.
        """
        series = guards @ self.to_coefficients.T
        # |Tk| <= 1: where c0 exceeds the sum of all other |ck| a function is positive throughout,
        # and so is its guard. No search is needed for these.
        positive = np.any(series[..., 0] > np.sum(np.abs(series[..., 1:]), axis=-1), axis=1)
        roots = (
            (self._first_negative(series[i], max(2 * ignore / h - 1, -1.0)), int(i))
            for i in np.flatnonzero(~positive)
        )
        return min((((root + 1) * h / 2, i) for root, i in roots if root is not None), default=None)

    def _first_negative(self, group: np.ndarray, begin: float) -> float | None:
        """First x in [begin, 1] from which on the largest of some Chebyshev series, shape (p, order), is negative."""
        noise = _NOISE * np.max(np.abs(group))
        if np.max(chebyshev.chebval(begin, group.T)) < -noise:
            return begin
        # Between neighbouring roots of all functions none changes its sign: one value decides each
        # stretch.
        roots = sorted(
            root
            for series in group
            for root in self._roots(series, -1.0, 1.0, _HALVINGS, noise / _BELOW_NOISE)
        )
        ends = [root for root in roots if begin < root < 1] + [1.0]
        for root, end in zip(ends, ends[1:]):
            if np.max(chebyshev.chebval((root + end) / 2, group.T)) < 0:
                return root
        return None

    def _roots(
        self, series: np.ndarray, low: float, high: float, halvings: int, zero: float
    ) -> list[float]:
        """Roots of a series over [low, high]; what is nowhere larger than `zero` has none."""
        # The constant term outweighs all others: no zero.
        size = np.abs(series)
        if size[0] > np.sum(size[1:]) or np.sum(size) <= zero:
            return []
        slope = self._derivative @ series
        if abs(slope[0]) > np.sum(np.abs(slope[1:])):
            # The same for the derivative: the function is monotonic, and the signs at the ends
            # decide.
            backwards = series[::-1].tolist()
            if _clenshaw(-1.0, backwards) * _clenshaw(1.0, backwards) > 0:
                return []
            roots = [brentq(_clenshaw, -1.0, 1.0, (backwards,), xtol=_ROOT_XTOL, rtol=_ROOT_RTOL)]
        elif halvings:
            # Neither bound decides. They are closer on halves, where a term of order k is 2^k times
            # smaller.
            middle = (low + high) / 2
            left, right = (half @ series for half in self._halves)
            return self._roots(left, low, middle, halvings - 1, zero) + self._roots(
                right, middle, high, halvings - 1, zero
            )
        else:
            # A double root, to rounding: as the eigenvalues of the companion matrix.
            complex_roots = chebyshev.chebroots(chebyshev.chebtrim(series, _TRIMMED * np.max(size)))
            real = (np.abs(complex_roots.imag) < _REAL) & (np.abs(complex_roots.real) <= 1)
            roots = complex_roots.real[real].tolist()
        return [low + (high - low) * (float(root) + 1) / 2 for root in roots]


def _on_half(row: np.ndarray, side: int, x: np.ndarray) -> Any:
    return chebyshev.chebval((x + side) / 2, row)


def _clenshaw(x: float, backwards: list[float]) -> float:
    """Value of a Chebyshev series whose coefficients are given from the last to the first.

    Clenshaw's recurrence b[k] = c[k] + 2 x b[k+1] - b[k+2]; in plain floats, as Brent's method asks
    for one value at a time and NumPy's calls would take longer than the sum itself.
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
    """Integrate the motion from (t0, q0, v0) to t_end.

    Raises NoMotion where no mode is consistent at the start, where the step falls to nothing, or after too many
    switches; Undecided where none is consistent to rounding later on.
    """
    t, q, v = float(t0), np.array(q0, dtype=float), np.array(v0, dtype=float)
    segments: list[Segment] = []
    switches: list[Switch] = []
    mode, v, ignored = _next_mode(mechanism, collocation, t, q, v, None, None)
    h, junction = collocation.longest_step, _JUNCTION * mechanism.pace
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

        # What comes first: the end of the mode, the loss of uniqueness, or the end of the step.
        root = collocation.first_root(guards, h, ignored)
        limit = collocation.first_root(limits, h, -junction)
        if limit is not None and t + limit[0] < t_end and (root is None or limit[0] < root[0]):
            raise NoMotion(
                f"several motions, or none, besides mode {mode}: friction adds more load than inertia takes "
                "away",
                t + limit[0],
            )
        # The polynomials of the whole step stay as they are; the mode's part of them ends at the
        # root.
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
            h, ignored = _LONGER * h, -junction
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
    """Find the mode from t on, its initial velocity, and the time from t on in which guards are known to be positive.

    A candidate holds if its guards are positive in the second half of a short trial step: in the
    first half those that start at zero are rounding.
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
            # Several modes of one group may describe one motion (a corner force that is zero), but
            # not several motions.
            if consistent:
                candidate, velocity, a = consistent[0]
                for other, _, b in consistent[1:]:
                    if np.max(np.abs(a - b)) > _SAME * (1 + np.max(np.abs(a))):
                        raise NoMotion(f"several motions: modes {candidate} and {other}", t)
                return candidate, velocity, trial / 2
    if mode is None:
        raise NoMotion("no consistent contact mode", t)
    # up to here the motion is unique, so that a mode exists; near the loss of uniqueness accelerations change too fast
    raise Undecided(f"no mode is consistent to rounding after mode {mode} at t = {t:.9f} s")
