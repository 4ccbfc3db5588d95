"""Piecewise smooth motion to machine precision: Picard-Chebyshev steps and events at polynomial roots.

Within a contact mode the equation of motion is smooth, q'' = f(t, q, v). On a step of length h it is
solved by collocation at Chebyshev points, iterated to its fixed point (Clenshaw & Norton, The solution of
nonlinear ordinary differential equations in Chebyshev series, Comput. J. 6, 1963); the step is accepted
once the last coefficients of q'' are rounding. Position and velocity are then polynomials, and so is, to
rounding, every guard: the functions that are positive while the mode lasts. The first root of a guard (an
eigenvalue of its colleague matrix, so that none is overlooked) ends the mode.

The mode that follows is found by trial: of the candidates that the mechanism names, in its order of
preference, the first that holds during a very short step. No rule is needed for ties, for a guard that starts at
zero, or for break-away without a jump (mus = mu).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

TRIAL_STEPS = (1e-6, 1e-5)
"""Seconds; the longer where no mode holds for the shorter, as when a slider would stick for less than that.

Two changes of mode closer than this are taken as one: an error of position below 1e-10 (usually 1e-12) jumps of q''.
"""
_SHORTEST_STEP = 1e-9
_JUNCTION = 1e-12  # a root this close before a step belongs to it: rounding at the junction of two steps
_PICARD_LIMIT = 60
_SAME = 1e-6  # relative; accelerations of two modes that are one motion (a tie of signs) differ by rounding only
_NOISE = 5e-14  # relative to 1 + max |q''|; forces of 100 N that cancel leave this much rounding in q''
_ROUNDING = np.finfo(float).eps


class NoMotion(ArithmeticError):
    """The equations have no motion, or more than one, from some instant on (Painleve's paradox)."""


class PiecewiseMechanism(ABC):
    """A reduced mechanism whose equation of motion is smooth within each mode.

    Arrays: t (k,), q, v, a (n, k) for n coordinates at k instants.
    """

    @abstractmethod
    def acceleration(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Hashable) -> np.ndarray:
        """q'' in a mode, shape (n, k); must continue smoothly somewhat beyond the end of the mode."""

    def equation(self, t: np.ndarray, mode: Hashable) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        """q''(q, v) of a mode at fixed instants, for iterations: what depends on t alone is best computed here."""
        return lambda q, v: self.acceleration(t, q, v, mode)

    @abstractmethod
    def guards(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, mode: Hashable) -> np.ndarray:
        """Functions that are positive while the mode lasts, shape (m, k)."""

    @abstractmethod
    def candidates(self, t: float, q: np.ndarray, v: np.ndarray,
                   mode: Hashable | None, guard: int | None) -> list[list[tuple[Hashable, np.ndarray]]]:
        """Modes that may follow when `guard` of `mode` reached zero, each with the velocity (n,) it starts with.

        In groups, best first: a group is asked only if no mode of those before it holds. At the start of the motion
        mode and guard are None.
        """

    @abstractmethod
    def columns(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, mode: Hashable) -> dict[str, np.ndarray]:
        """All columns of a Trajectory within a mode, each (k,)."""

    @abstractmethod
    def slip(self, mode: Hashable) -> tuple[int, ...]:
        """Per guide the direction of slip, 0 in stick."""

    def corner_guide(self, mode: Hashable, guard: int) -> int:
        """Number of the guide whose corner force a guard of a mode watches."""
        return 0


@dataclass(frozen=True)
class Segment:
    """A collocation step: Chebyshev coefficients over [start, start + length], valid up to `end`."""

    start: float
    length: float
    end: float
    mode: Hashable
    position: np.ndarray
    velocity: np.ndarray

    def state(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q and v, each (n, k)."""
        x = 2 * (np.asarray(t) - self.start) / self.length - 1
        return chebyshev.chebval(x, self.position.T), chebyshev.chebval(x, self.velocity.T)


@dataclass(frozen=True)
class Switch:
    """The end of a mode: between segments[index - 1] and segments[index]; the guard that ended it."""

    time: float
    index: int
    guard: int


@dataclass(frozen=True)
class Motion:
    """The whole motion of a reduced mechanism."""

    segments: tuple[Segment, ...]
    switches: tuple[Switch, ...]

    def at(self, t: np.ndarray, side: str) -> list[tuple[Segment, np.ndarray]]:
        """Segments and the indices of the instants they cover; a switch belongs to the segment before or after it."""
        ends = np.array([segment.end for segment in self.segments[:-1]])
        owner = np.searchsorted(ends, t, side="right" if side == "after" else "left")
        return [(self.segments[i], np.flatnonzero(owner == i)) for i in np.unique(owner)]

    def final_state(self) -> tuple[np.ndarray, np.ndarray]:
        """q and v at the end, each (n,)."""
        last = self.segments[-1]
        q, v = last.state(np.array([last.end]))
        return q[:, 0], v[:, 0]


class Collocation:
    """Chebyshev collocation of q'' = f with `order` points.

    Parameters
    ----------
    order
        Number of points; the error of a step is O(h^order).
    longest_step
        Seconds.
    """

    def __init__(self, order: int = 24, longest_step: float = 0.25):
        self.order, self.longest_step = order, longest_step
        k = np.arange(order)
        self.nodes = -np.cos(np.pi * (k + 0.5) / order)
        values = chebyshev.chebvander(self.nodes, order - 1)
        self.to_coefficients = (values * np.where(k == 0, 1, 2) / order).T
        identity = np.eye(order)
        once = np.array([chebyshev.chebint(row, 1, lbnd=-1) for row in identity])
        twice = np.array([chebyshev.chebint(row, 2, lbnd=-1) for row in identity])
        self._once, self._twice = once, twice
        self._velocity = chebyshev.chebval(self.nodes, once.T).T @ self.to_coefficients
        self._position = chebyshev.chebval(self.nodes, twice.T).T @ self.to_coefficients

    def solve(self, mechanism: PiecewiseMechanism, mode: Hashable, t0: float, q0: np.ndarray, v0: np.ndarray,
              h: float) -> tuple[np.ndarray, ...] | None:
        """Instants, q, v, a at the nodes of the step [t0, t0 + h]; None if h is too long for full precision."""
        s = h / 2
        t = t0 + s * (self.nodes + 1)
        drift = q0[:, None] + v0[:, None] * (t - t0)
        a = np.zeros((len(q0), self.order))
        equation, change = mechanism.equation(t, mode), np.inf
        for _ in range(_PICARD_LIMIT):
            q = drift + s * s * a @ self._position.T
            v = v0[:, None] + s * a @ self._velocity.T
            new = equation(q, v)
            if not np.all(np.isfinite(new)):
                return None
            last, change = change, np.max(np.abs(new - a))
            # rounding of t, eps |t|, moves the accelerations too; their rates are some ten times their size per second
            scale = (np.max(np.abs(new)) + 1.0) * max(1.0, abs(t0) / 10)
            a = new
            if change <= 4 * _ROUNDING * scale or (change <= _NOISE * scale and change >= last / 2):
                break
        else:
            return None
        tail = np.abs(a @ self.to_coefficients.T)[:, -3:]
        return (t, q, v, a) if np.max(tail) <= _NOISE * scale else None

    def segment(self, mode: Hashable, t0: float, q0: np.ndarray, v0: np.ndarray, h: float, end: float,
                a: np.ndarray) -> Segment:
        """Polynomials of the solved step."""
        s = h / 2
        coefficients = a @ self.to_coefficients.T
        velocity = s * coefficients @ self._once
        position = s * s * coefficients @ self._twice
        velocity[:, 0] += v0
        position[:, 0] += q0 + s * v0
        position[:, 1] += s * v0
        return Segment(t0, h, end, mode, position, velocity)

    def first_root(self, guards: np.ndarray, h: float, ignore: float) -> tuple[float, int] | None:
        """Time since the start of the step, and number, of the first guard that becomes negative after `ignore`."""
        first = None
        for i, coefficients in enumerate(guards @ self.to_coefficients.T):
            if coefficients[0] > np.sum(np.abs(coefficients[1:])):
                continue  # |p - c0| <= sum |ck|: no root
            size = np.max(np.abs(coefficients))
            if size == 0:
                continue
            trimmed = chebyshev.chebtrim(coefficients, 4 * _ROUNDING * size)
            roots = chebyshev.chebroots(trimmed)
            roots = np.sort(roots.real[np.abs(roots.imag) < 1e-10])
            slope = chebyshev.chebder(trimmed)
            for root in roots:
                time = (root + 1) * h / 2
                if ignore < time <= h and chebyshev.chebval(root, slope) < 0:
                    if first is None or time < first[0]:
                        first = (max(time, 0.0), i)
                    break
        return first


def integrate(mechanism: PiecewiseMechanism, t0: float, t_end: float, q0: np.ndarray, v0: np.ndarray,
              collocation: Collocation, switch_limit: int = 100_000) -> Motion:
    """The motion from (t0, q0, v0) to t_end.

    Raises
    ------
    NoMotion
        Where no mode is consistent, where the step falls to nothing, or beyond `switch_limit` switches.
    """
    t, q, v = float(t0), np.array(q0, dtype=float), np.array(v0, dtype=float)
    segments: list[Segment] = []
    switches: list[Switch] = []
    mode, v, ignored = _next_mode(mechanism, collocation, t, q, v, None, None)
    h = collocation.longest_step
    while t < t_end:
        solved = None
        while solved is None:
            h = min(h, collocation.longest_step)
            solved = collocation.solve(mechanism, mode, t, q, v, h)
            if solved is None:
                h /= 2
                if h < _SHORTEST_STEP:
                    raise NoMotion(f"no smooth motion beyond t = {t:.9f} s in mode {mode}")
        nodes, nodal_q, nodal_v, a = solved
        guards = mechanism.guards(nodes, nodal_q, nodal_v, a, mode)
        root = collocation.first_root(guards, h, ignored)
        end = t + (h if root is None else root[0])
        ended = root is not None and end < t_end
        segment = collocation.segment(mode, t, q, v, h, min(end, t_end), a)
        segments.append(segment)
        t = segment.end
        q, v = (value[:, 0] for value in segment.state(np.array([t])))
        if ended:
            if len(switches) == switch_limit:
                raise NoMotion(f"more than {switch_limit} changes of mode up to t = {t:.9f} s")
            switches.append(Switch(t, len(segments), root[1]))
            mode, v, ignored = _next_mode(mechanism, collocation, t, q, v, mode, root[1])
        else:
            h, ignored = 1.5 * h, -_JUNCTION
    return Motion(tuple(segments), tuple(switches))


def _next_mode(mechanism: PiecewiseMechanism, collocation: Collocation, t: float, q: np.ndarray, v: np.ndarray,
               mode: Hashable | None, guard: int | None) -> tuple[Hashable, np.ndarray, float]:
    """The mode from t on, its initial velocity, and the time from t on in which guards are known to be positive."""
    later = slice(collocation.order // 2, None)
    for trial in TRIAL_STEPS:
        for group in mechanism.candidates(t, q, v, mode, guard):
            consistent = []
            for candidate, velocity in group:
                solved = collocation.solve(mechanism, candidate, t, q, velocity, trial)
                if solved is not None:
                    values = mechanism.guards(*(array[..., later] for array in solved), candidate)
                    if np.all(values >= 0):
                        consistent.append((candidate, velocity, solved[3][:, -1]))
            if consistent:
                candidate, velocity, a = consistent[0]
                for other, _, b in consistent[1:]:
                    if np.max(np.abs(a - b)) > _SAME * (1 + np.max(np.abs(a))):
                        raise NoMotion(f"several motions at t = {t:.9f} s: modes {candidate} and {other}")
                return candidate, velocity, trial / 2
    raise NoMotion(f"no consistent contact mode at t = {t:.9f} s (after mode {mode})")
