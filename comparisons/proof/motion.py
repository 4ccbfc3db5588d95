"""The motion of a mechanism from t = 0 to its end, enclosed.

A step takes the set of states at one instant to a set at another, both instants exact numbers. The set is a parallelepiped
c + Q r (Lohner 1987), and its image under the map G of the step, events within it included, is in mean value form

    G(c) + DG (Q r) ,      DG = ... Phi2 S Phi1 ,     S = 1 + (f2 - f1) (grad g)^T / (dg/dt)

with Phi the derivatives of the smooth stretches and S the jump of the derivative at a crossing of the guard g, from the field f1 to
f2 (M. A. Aizerman & F. R. Gantmakher, Q. J. Mech. Appl. Math. 11, 1958). G is differentiable on the set because every
crossing is proven to be one, with a slope, for every state of the set.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from math import isinf

import numpy as np
from flint import arb, arb_mat, arb_poly

from stiction.comparisons.proof.enclosures.arc import Arc, partials, span
from stiction.comparisons.proof.enclosures.series import TooLong
from stiction.comparisons.proof.enclosures.zeros import Undecided, first_zero, newton
from stiction.comparisons.proof.mechanisms.mechanism import Next, ProvableMechanism, time_series

_GRID = 2 ** 20
"""Steps end at multiples of 1/_GRID s."""
_LONGEST = 0.5
_SHORTEST = 1e-5
_MOST_LEGS = 60


@dataclass(frozen=True)
class StateSet:
    """States (q, v) at an instant: centre + frame size.

    Attributes
    ----------
    centre : tuple of arb
        2n exact numbers.
    frame : arb_mat
        2n x 2n, exact.
    size : tuple of arb
        2n balls.
    """

    centre: tuple[arb, ...]
    frame: arb_mat
    size: tuple[arb, ...]

    @classmethod
    def box(cls, values: list[arb]) -> StateSet:
        n = len(values)
        return cls(tuple(x.mid() for x in values), _identity(n), tuple(x - x.mid() for x in values))

    def hull(self) -> list[arb]:
        spread = self.frame * _column(self.size)
        return [c + spread[i, 0] for i, c in enumerate(self.centre)]

    def image(self, point: list[arb], derivative: arb_mat) -> StateSet:
        """The image with the point's image and the derivatives of a map on the set, in a frame along the image's longest sides."""
        spread = derivative * self.frame
        middle = np.array([[float(spread[i, j].mid()) for j in range(len(point))] for i in range(len(point))])
        length = np.array([float(abs(r).upper()) for r in self.size])
        scaled = middle * (length / max(length.max(), 1e-300))
        order = np.argsort(-np.linalg.norm(scaled, axis=0), kind="stable")
        turned = np.linalg.qr(middle[:, order])[0]
        return self._within(point, spread, arb_mat(turned.tolist()))

    def _within(self, point: list[arb], spread: arb_mat, frame: arb_mat, centre: tuple[arb, ...] | None = None) -> StateSet:
        centre = tuple(x.mid() for x in point) if centre is None else centre
        inverse = frame.inv()
        size = inverse * spread * _column(self.size) + inverse * _column([x - c for x, c in zip(point, centre)])
        return StateSet(centre, frame, tuple(size[i, 0] for i in range(len(point))))

    def image_lies_in(self, point: list[arb], derivative: arb_mat, other: StateSet) -> bool:
        """Whether the image is proven to lie in another set."""
        image = self._within(point, derivative * self.frame, other.frame, other.centre)
        return all(outer.contains(inner) for outer, inner in zip(other.size, image.size))


def _upper(ball: arb) -> float:
    return float(ball.upper())


def _identity(n: int) -> arb_mat:
    return arb_mat([[int(i == j) for j in range(n)] for i in range(n)])


def _column(values) -> arb_mat:
    return arb_mat([[x] for x in values])


@dataclass(frozen=True)
class ProvenEvent:
    """A change of mode: its time in a ball, state in balls."""

    time: arb
    kind: str
    before: Hashable
    after: Hashable
    q: tuple[arb, ...]
    v: tuple[arb, ...]


@dataclass(frozen=True)
class Leg:
    """A stretch within a step in one mode: polynomials from t on, up to `end` seconds later, that enclose all components of the state, and
    the columns of `ProvableMechanism.bodies`."""

    t: arb
    end: arb
    mode: Hashable
    state: tuple[arb_poly, ...]
    bodies: dict[str, arb_poly]

    @classmethod
    def of(cls, mechanism: ProvableMechanism, arc: Arc, end: arb, mode: Hashable) -> Leg:
        """The beginning of an arc."""
        names: list[str] = []

        def bodies(instant, order, q, v, a):
            found = mechanism.bodies(time_series(instant, order), q, v)
            names[:] = found
            return [list(found.values())]

        (columns,) = arc.functions(bodies)
        return cls(arc.t, end, mode, tuple(f for part in arc.polynomials() for f in part), dict(zip(names, columns)))


@dataclass(frozen=True)
class Step:
    """From a set at t0 to its image at t1.

    Attributes
    ----------
    t0, t1 : arb
        Exact (t1 at the end of the motion a ball).
    start : StateSet
        At t0.
    mode, end_mode : Hashable
        At t0 and at t1.
    point : list of arb
        The image of the set's centre, 2n balls.
    derivative : arb_mat
        Of the image by the start, on the set.
    events : tuple of ProvenEvent
        In order.
    legs : tuple of Leg
        One more than events.
    remainder : float
        The largest of its stretches.
    """

    t0: arb
    t1: arb
    start: StateSet
    mode: Hashable
    end_mode: Hashable
    point: list[arb]
    derivative: arb_mat
    events: tuple[ProvenEvent, ...]
    legs: tuple[Leg, ...]
    remainder: float

    def image(self, wider: float) -> StateSet:
        """A set that contains all that `start` becomes, wider than need be by a thousandth and by `wider`: to be proven again otherwise."""
        found = self.start.image(self.point, self.derivative)
        return StateSet(found.centre, found.frame, tuple(_wider(size, wider) for size in found.size))


def _wider(ball: arb, by: float) -> arb:
    return ball + (ball.rad() / 1000 + by) * arb(0, 1)


@dataclass(frozen=True)
class Precision:
    """Bits of the balls, order of the remainder, largest remainder of a step."""

    bits: int
    order: int
    remainder: float

    @property
    def margin(self) -> float:
        """By how much what is claimed is wider than what was found."""
        return 0.0 if isinf(self.remainder) else 10 * self.remainder

    @classmethod
    def of(cls, digits: int) -> Precision:
        """Where enclosures of a width of 10^-digits are to be expected."""
        return cls(int(3.33 * (digits + 12)) + 64, max(14, digits + 8), 10.0 ** -(digits + 8))


def take_step(mechanism: ProvableMechanism, t0: arb, start: StateSet, first: Next, h: float, precision: Precision,
              t1: arb | None = None) -> Step:
    """A step of at most about h seconds after its last event, to the end of the motion at most; to t1 where that is given.

    Raises
    ------
    TooLong
        If it does not get an enclosure.
    Undecided
        If something is not proven.
    """
    n, hull = len(start.centre) // 2, start.hull()
    held = mechanism.held(first.mode)
    t, q, v = t0, hull[:n], [held.get(i, x) for i, x in enumerate(hull[n:])]
    tp, qp, vp = t0, list(start.centre[:n]), [held.get(i, x) for i, x in enumerate(start.centre[n:])]
    derivative, events, legs, remainder = _hold(_identity(2 * n), held), [], [], 0.0
    current, given = first, t1 is not None
    end = t1 if given else _grid(t0, h, mechanism.t_end)
    while True:
        length = (end - t).upper()
        arc = Arc.of(mechanism.timed(current.mode), t, length, q, v, precision.order)
        mechanism.require_unique(current.mode, t + span(arb(0), length), arc.enclosure)

        def guards(instant, order, q, v, a, mode=current.mode):
            return mechanism.guards(mode, instant, order, q, v, a)

        groups = arc.functions(guards)
        size = max([arc.remainder(), *(abs(f[precision.order]) * length ** precision.order for group in groups for f in group)], key=_upper)
        if not size < precision.remainder:
            raise TooLong(f"remainder {size.str(3)}")
        remainder = max(remainder, _upper(size))
        try:
            zero = first_zero(groups, length, current.zeros)
        except Undecided as error:
            raise Undecided(error.reason, t + error.time) from None
        one = arc.one(tp, qp, vp)
        if zero is None:
            tau, own = end - t, end - tp
            legs.append(Leg.of(mechanism, arc, tau, current.mode))
            derivative = arc.jacobian(tau) * derivative
            point = [f(own) for part in arc.polynomials(one) for f in part]
            held = mechanism.held(current.mode)
            for i, speed in held.items():
                point[n + i] = speed
            return Step(t0, end, start, first.mode, current.mode, point, _hold(derivative, held), tuple(events), tuple(legs), remainder)
        if len(legs) == _MOST_LEGS:
            raise Undecided(f"more than {_MOST_LEGS} changes of mode within a step", t + zero.tau)
        tau, own = zero.tau, newton(arc.functions(guards, one, tp)[zero.group][zero.function], zero.tau)
        legs.append(Leg.of(mechanism, arc, tau, current.mode))
        q, v = ([f(tau) for f in part] for part in arc.polynomials())
        qp, vp = ([f(own) for f in part] for part in arc.polynomials(one))
        derivative = arc.jacobian(tau) * derivative
        following = mechanism.after(current.mode, zero.group, t + tau, q, v)
        if not following.smooth:
            derivative = _jump(mechanism, current.mode, following.mode, t + tau, q, v, zero.group, zero.function,
                               groups[zero.group][zero.function].derivative()(tau)) * derivative
        t, tp = t + tau, tp + own
        for i, speed in (mechanism.held(current.mode) | mechanism.held(following.mode)).items():
            v[i] = vp[i] = speed
        derivative = _hold(derivative, mechanism.held(following.mode))
        events.append(ProvenEvent(_wider(t, precision.margin), following.kind, current.mode, following.mode, tuple(q), tuple(v)))
        if not given:
            end = _grid(t, h, mechanism.t_end)
        elif not t < end:
            raise Undecided("a change of mode at the end of a step", t)
        current = following


def _grid(t: arb, h: float, t_end: arb) -> arb:
    """About h seconds after t; the end of the motion rather than an instant just before it."""
    end = arb(int((float(t.mid()) + h) * _GRID) + 1) / _GRID
    return end if end + h / 8 < t_end else t_end


def _hold(derivative: arb_mat, held) -> arb_mat:
    if not held:
        return derivative
    rows, n = derivative.tolist(), derivative.nrows() // 2
    return arb_mat([[arb(0)] * len(row) if i - n in held else row for i, row in enumerate(rows)])


def _jump(mechanism: ProvableMechanism, before: Hashable, after: Hashable, t: arb, q: list[arb], v: list[arb], group: int, function: int,
          slope: arb) -> arb_mat:
    """S, with slope = dg/dt along the motion before the event."""
    n = len(q)
    equations = [mechanism.timed(mode)(t, 1) for mode in (before, after)]
    _, (gradient,) = partials(lambda q, v: [mechanism.guards(before, t, 1, q, v, equations[0](q, v))[group][function]], q, v)
    a = [partials(equation, q, v)[0] for equation in equations]
    rows = _identity(2 * n).tolist()
    for i in range(n):
        jump = (a[1][i] - a[0][i]) / slope
        rows[n + i] = [x + jump * g for x, g in zip(rows[n + i], gradient)]
    return arb_mat(rows)


@dataclass(frozen=True)
class ProvenMotion:
    """A motion by its steps. Its balls keep their width only at the precision they were made with (`series.working`)."""

    mechanism: ProvableMechanism
    precision: Precision
    first: Next
    steps: tuple[Step, ...]
    end: StateSet

    @property
    def events(self) -> tuple[ProvenEvent, ...]:
        return tuple(event for step in self.steps for event in step.events)

    def at(self, t: arb) -> tuple[list[arb], list[arb]]:
        """q and v at an instant; next to an event or the end of a step the hull of what both sides say.

        Raises
        ------
        ValueError
            For a time that is not proven to be within the motion.
        """
        if not (t >= 0 and (t <= self.mechanism.t_end or self.mechanism.t_end.contains(t))):
            raise ValueError(f"t: found {t.str(10)} s; expected times within 0 .. {self.mechanism.t_end.str(10)} s")
        found: list[list[arb]] = []
        for step in self.steps:
            if t < step.t0 or t > step.t1:
                continue
            for leg in step.legs:
                tau = t - leg.t
                if not (tau < 0 or tau > leg.end):
                    found.append([f(tau) for f in leg.state])
        hull = found[0]
        for other in found[1:]:
            hull = [a.union(b) for a, b in zip(hull, other)]
        return hull[:len(hull) // 2], hull[len(hull) // 2:]

    def derivative(self) -> arb_mat:
        """Of the end state by the start, on the set of starts."""
        total = _identity(2 * len(self.mechanism.q))
        for step in self.steps:
            total = step.derivative * total
        return total

    def width(self) -> arb:
        """The largest width of position and velocity at the ends of steps and of the times of events."""
        sets = [*(step.start for step in self.steps), self.end]
        ends = [x for states in sets for x in states.hull()] + [event.time for event in self.events]
        return max((2 * x.rad() for x in ends), key=_upper)


def prove(mechanism: ProvableMechanism, precision: Precision, start: StateSet | None = None) -> ProvenMotion:
    """Enclose the motion from t = 0 to its end; from all states of `start` where that is given.

    Call it with `series.working` at the precision's bits.

    Raises
    ------
    Undecided
        With the time and the reason.
    """
    first = mechanism.start()
    states = StateSet.box([*mechanism.q, *mechanism.v]) if start is None else start
    t, current, h, steps = arb(0), first, _LONGEST / 4, []
    while t < mechanism.t_end:
        try:
            step = take_step(mechanism, t, states, current, h, precision)
        except (TooLong, Undecided) as error:
            h *= 0.7
            if h < _SHORTEST or isinstance(error, Undecided) and h < 1e-2:
                raise error if isinstance(error, Undecided) else Undecided(str(error), t) from error
            continue
        steps.append(step)
        states, t = step.image(precision.margin), step.t1
        current = Next(step.end_mode)
        h = min(_LONGEST, h * min(1.5, 0.9 * (precision.remainder / max(step.remainder, 1e-300)) ** (1 / precision.order)))
    return ProvenMotion(mechanism, precision, first, tuple(steps), states)

