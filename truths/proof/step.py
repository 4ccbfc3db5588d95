"""Enclosure of one step of a motion, with its changes of mode.

A step maps the set of states at one instant to a set at another instant; both instants are exact numbers. The set is a
parallelepiped c + Q r (Lohner 1987). Its image under the map G of the step, which includes the events within it, is in
mean value form

    G(c) + DG (Q r) ,      DG = ... Phi2 S Phi1 ,     S = 1 + (f2 - f1) (grad g)^T / (dg/dt)

with Phi the derivatives of the smooth stretches and S the jump of the derivative at a crossing of the guard g, from the
field f1 to f2 (M. A. Aizerman & F. R. Gantmakher, Q. J. Mech. Appl. Math. 11, 1958). G is differentiable on the set
because every crossing is proven to be one, with a slope, for every state of the set.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from math import isinf
from typing import Any

import numpy as np
from flint import arb, arb_mat, arb_poly

from stiction.truths.proof.enclosures.arc import Arc, partials_at
from stiction.truths.proof.enclosures.series import TooLong, halves, identity, time_series, working
from stiction.truths.proof.enclosures.zeros import Undecided, Zero, first_zero, newton
from stiction.truths.proof.mechanisms.mechanism import Next, ProvableMechanism

_GRID = 2**20
"""Steps end at multiples of 1/_GRID s, which are exact with few bits."""
_LAST = 1 / 8
"""Smallest last step, as a part of a full one; a shorter remainder is added to the step before it."""
SHORTEST = 1e-5
"""Shortest step, s."""
_MOST_EVENTS = 60
"""Largest number of changes of mode within a step; more seem to accumulate."""
_TINY = 1e-300
"""Number that replaces a size of zero as a divisor, if the set is a point."""
_WIDER = 1000
"""Reciprocal of the part of its radius by which a set is widened, so that a proof with other roundings confirms it."""
_BITS_PER_DIGIT = 3.33
"""log2(10), rounded up."""
_GUARD_DIGITS = 12
"""Number of additional digits: loss by the products of derivatives and intervals along a motion."""
_GUARD_BITS = 64
"""Number of additional bits, for the same reason."""
_LOWEST_ORDER = 14
"""Least order of the remainder. Lower orders need so short steps that they are slower."""
_MORE_ORDER = 8
"""Difference of the order and the number of digits, for the same reason."""
_REMAINDER_DIGITS = 8
"""Number of additional digits of the remainder of a step, because the remainders of all steps add up."""
_MARGIN = 10
"""Ratio of the width that is added to a claim to the largest remainder of a step."""


@dataclass(frozen=True)
class StateSet:
    """The states (q, v) = centre + frame size at an instant.

    Attributes
    ----------
    centre : tuple of arb
        2n exact numbers.
    frame : arb_mat
        2n x 2n exact numbers.
    size : tuple of arb
        2n balls.
    """

    centre: tuple[arb, ...]
    frame: arb_mat
    size: tuple[arb, ...]

    @classmethod
    def box(cls, state: Sequence[arb]) -> StateSet:
        """Return the set of all states in 2n balls."""
        return cls(
            tuple(x.mid() for x in state), identity(len(state)), tuple(x - x.mid() for x in state)
        )

    def hull(self) -> list[arb]:
        """Return balls that contain the set."""
        spread = self.frame * column(self.size)
        return [c + spread[i, 0] for i, c in enumerate(self.centre)]

    def contains(self, state: Sequence[arb]) -> bool:
        """Return True if a state is proven to be in the set."""
        return self._holds(self.frame.inv() * column(x - c for x, c in zip(state, self.centre)))

    def image(self, point: list[arb], derivative: arb_mat, margin: float = 0.0) -> StateSet:
        """Return the image under a map, from the image of the centre and the derivatives.

        It is widened by a thousandth and by a margin, so that it can be proven again with other roundings.
        """
        # Lohner's frame reduces the wrapping effect: it is orthogonal, and its first axis is along the
        # longest side of the image. It is computed in floats, because any frame yields an enclosure;
        # this one yields a tight enclosure.
        spread = derivative * self.frame
        middle = middles(spread)
        length = np.array([float(abs(r).upper()) for r in self.size])
        scaled = middle * (length / max(length.max(), _TINY))
        order = np.argsort(-np.linalg.norm(scaled, axis=0), kind="stable")
        frame = arb_mat(np.linalg.qr(middle[:, order])[0].tolist())
        centre = tuple(x.mid() for x in point)
        size = self._image_in(frame, centre, point, derivative)
        return StateSet(
            centre, frame, tuple(_widened(size[i, 0], margin) for i in range(len(centre)))
        )

    def image_lies_in(self, other: StateSet, point: list[arb], derivative: arb_mat) -> bool:
        """Return True if the image under a map, with the arguments of `image`, is proven to be within a set."""
        return other._holds(self._image_in(other.frame, other.centre, point, derivative))

    def _image_in(
        self, frame: arb_mat, centre: Sequence[arb], point: list[arb], derivative: arb_mat
    ) -> arb_mat:
        """Return the image in the coordinates of a set, given by its frame and centre."""
        # Mean value form. The matrices are multiplied first, because each product with the set widens
        # the balls.
        inverse = frame.inv()
        return inverse * (derivative * self.frame) * column(self.size) + inverse * column(
            x - c for x, c in zip(point, centre)
        )

    def _holds(self, inside: arb_mat) -> bool:
        """Return True if a state in the coordinates of the frame is proven to be in the set."""
        return all(size.contains(inside[i, 0]) for i, size in enumerate(self.size))


def column(values: Iterable[arb]) -> arb_mat:
    """Return a matrix of one column."""
    return arb_mat([[x] for x in values])


def middles(matrix: arb_mat) -> np.ndarray:
    """Return the centres of a matrix of balls, in floats."""
    return np.array([[float(x.mid()) for x in row] for row in matrix.tolist()])


@dataclass(frozen=True)
class ProvenEvent:
    """A change of mode at a guide.

    Attributes
    ----------
    time : arb
        Time, s.
    kind, joint : str
        Kind of the event, and the guide.
    after
        Mode after the event.
    q, v : list of arb
        Coordinates and velocities.
    """

    time: arb
    kind: str
    joint: str
    after: Any
    q: list[arb]
    v: list[arb]


@dataclass(frozen=True)
class Leg:
    """The part of a step in one mode, from t on for `end` seconds.

    Polynomials in the time since t enclose the 2n components of the `state`, and the columns of all `bodies`.
    """

    t: arb
    end: arb
    mode: Any
    state: list[arb_poly]
    bodies: dict[str, arb_poly]


def _widened(ball: arb, by: float) -> arb:
    """Return a ball that is wider by a part of its radius and by a number."""
    return ball + (ball.rad() / _WIDER + by) * arb(0, 1)


@dataclass(frozen=True)
class Precision:
    """Precision of a proof.

    Attributes
    ----------
    bits : int
        Bits of the balls.
    order : int
        Order of the remainders.
    remainder : float
        Largest remainder of a step.
    """

    bits: int
    order: int
    remainder: float

    @property
    def margin(self) -> float:
        """Width that is added to an enclosure before it is claimed."""
        return 0.0 if isinf(self.remainder) else _MARGIN * self.remainder

    def working(self) -> AbstractContextManager[None]:
        """Return a context with these bits, and series with one coefficient more than the order."""
        return working(self.bits, self.order + 1)

    @classmethod
    def of(cls, digits: int) -> Precision:
        """Return the precision at which enclosures of a width of 10^-digits are to be expected."""
        return cls(
            int(_BITS_PER_DIGIT * (digits + _GUARD_DIGITS)) + _GUARD_BITS,
            max(_LOWEST_ORDER, digits + _MORE_ORDER),
            10.0 ** -(digits + _REMAINDER_DIGITS),
        )


class Step:
    """The motion of all states of a set, from t0 to t1.

    While the step is in progress, all solutions from the set are in `state` at the time `t`, and the solution from its
    centre is at `point` at the time `point_t`.

    Attributes
    ----------
    t0, t1 : arb
        Start and end, s, which are exact (the end of the whole motion is a ball).
    start : StateSet
        The set at t0.
    point : list of arb
        Image of the centre of the set.
    derivative : arb_mat
        Derivative of the image by the start, for all states of the set.
    current : Next
        The present mode.
    events, legs : list
        Events, and stretches in one mode.
    remainder : float
        Largest remainder of the legs.
    """

    def __init__(self, mechanism: ProvableMechanism, t0: arb, start: StateSet, first: Next):
        self.mechanism = mechanism
        self.start = start
        self.current = first
        self.t0 = self.t1 = self.t = self.point_t = t0
        self.state = start.hull()
        self.point = list(start.centre)
        self.derivative = identity(len(self.state))
        self.events: list[ProvenEvent] = []
        self.legs: list[Leg] = []
        self.remainder = 0.0
        self._hold()

    def _hold(self) -> None:
        """Set the velocities that the mode prescribes; they do not depend on the start."""
        n = len(self.state) // 2
        rows = self.derivative.tolist()
        for i, speed in self.mechanism.held(self.current.mode).items():
            self.state[n + i] = self.point[n + i] = speed
            rows[n + i] = [arb(0)] * (2 * n)
        self.derivative = arb_mat(rows)

    def advance(self, end: arb, precision: Precision, shorter: bool) -> bool:
        """Enclose the motion to the next change of mode or to `end`; return True if the end is reached.

        If `shorter`, the enclosure may end earlier.
        """
        # Enclose all solutions from the set over the whole arc, and prove that they are unique.
        mechanism, mode, t = self.mechanism, self.current.mode, self.t
        arc, reach = self._enclose_arc(end, precision.order, shorter)
        mechanism.require_unique(mode, t + arb(0).union(arc.h), arc.enclosure)
        guards = partial(mechanism.guards, mode)
        groups = arc.functions(guards, arc.fine)
        remainder = arc.remainder(groups)
        if not remainder < precision.remainder:
            raise TooLong(f"remainder {remainder.str(3)}")
        self.remainder = max(self.remainder, float(remainder.upper()))

        # Find the first change of mode, at tau for the set and at point_tau for its centre. The mean value
        # form requires the time of the centre, which is narrower.
        zero = first_zero(groups, t, arc.h, self.current.zeros)
        centre = arc.one(self.point_t, self.point)
        if zero is None:
            tau, point_tau = reach - t, reach - self.point_t
        else:
            tau = zero.tau
            point_tau = newton(arc.functions(guards, centre)[zero.group][zero.function], tau)
        columns = arc.functions(
            lambda *at: {name: [f] for name, f in mechanism.bodies(*at[:3]).items()}, arc.fine
        )
        state = arc.polynomials(arc.fine)
        self.legs.append(
            Leg(t, tau, mode, state, {str(name): column for name, [column] in columns.items()})
        )

        # Move set, centre and derivative to that time.
        self.t, self.point_t = t + tau, self.point_t + point_tau
        self.state = [f(tau) for f in state]
        self.point = [f(point_tau) for f in arc.polynomials(centre)]
        self.derivative = arc.jacobian(tau) * self.derivative
        self._hold()
        if zero is None:
            self.current, self.t1 = Next(mode), end
            return not reach < end
        self._change(zero, groups[zero.group][zero.function].derivative()(tau), precision.margin)
        return False

    def _enclose_arc(self, end: arb, order: int, shorter: bool) -> tuple[Arc, arb]:
        """Return the enclosure of an arc to `end`, and its end.

        If it may be shorter, its length is halved until it has an enclosure.
        """
        equation = partial(self.mechanism.equation, self.current.mode)
        while True:
            length = (end - self.t).upper()
            try:
                return Arc(equation, self.t, length, self.state, order), end
            except TooLong:
                if not shorter or length < SHORTEST:
                    raise
            end = (self.t + length / 2).mid()

    def _change(self, zero: Zero, slope: arb, margin: float) -> None:
        """Change the mode at the zero of a guard; `slope` is dg/dt along the motion before."""
        if len(self.events) == _MOST_EVENTS:
            raise Undecided(f"more than {_MOST_EVENTS} changes of mode within a step", self.t)
        mode = self.current.mode
        self.current = self.mechanism.after(mode, zero.group, self.t, *halves(self.state))
        # If accelerations do not jump, f2 = f1 and S is the identity.
        if not self.current.smooth:
            self.derivative = self._jump(mode, zero, slope) * self.derivative
        self._hold()
        joint = self.mechanism.event_joint(mode, self.current.mode)
        self.events.append(
            ProvenEvent(
                _widened(self.t, margin),
                self.current.kind,
                joint,
                self.current.mode,
                *halves(self.state),
            )
        )

    def _jump(self, mode: Any, zero: Zero, slope: arb) -> arb_mat:
        """Return S at the change from a mode to the current one."""
        t = time_series(self.t, 1)
        before, after = (self.mechanism.equation(each, t) for each in (mode, self.current.mode))

        def guard(q, v):
            return [self.mechanism.guards(mode, t, q, v, before(q, v))[zero.group][zero.function]]

        # S = 1 + (f2 - f1) (grad g)^T / (dg/dt). The rates of positions do not jump, so that only the
        # rows of velocities differ from the identity.
        _, (gradient,) = partials_at(guard, self.state)
        n = len(self.state) // 2
        rows = identity(len(self.state)).tolist()
        accelerations_before, _ = partials_at(before, self.state)
        accelerations_after, _ = partials_at(after, self.state)
        for i, (a_before, a_after) in enumerate(zip(accelerations_before, accelerations_after)):
            jump = (a_after - a_before) / slope
            rows[n + i] = [x + jump * g for x, g in zip(rows[n + i], gradient)]
        return arb_mat(rows)


def take_step(
    mechanism: ProvableMechanism,
    t0: arb,
    start: StateSet,
    first: Next,
    h: float,
    precision: Precision,
    t1: arb | None = None,
) -> Step:
    """Return the enclosure of a step that ends about h seconds after its last event, or at the end of the motion.

    If `t1` is given, the step ends there. It may then be too long for one enclosure, and is taken in parts.

    Raises
    ------
    TooLong
        If there is no enclosure.
    Undecided
        If something is not proven.
    """
    step = Step(mechanism, t0, start, first)
    end = _exact_end(t0, h, mechanism.t_end) if t1 is None else t1
    while not step.advance(end, precision, shorter=t1 is not None):
        # After an event the step continues for a full length, unless its end is given.
        if t1 is None:
            end = _exact_end(step.t, h, mechanism.t_end)
        elif not step.t < end:
            raise Undecided("a change of mode at the end of a step", step.t)
    return step


def _exact_end(t: arb, h: float, t_end: arb) -> arb:
    """Return an instant about h seconds after t, or the end of the motion instead of an instant just before it."""
    end = arb(int((float(t.mid()) + h) * _GRID) + 1) / _GRID
    return end if end + h * _LAST < t_end else t_end
