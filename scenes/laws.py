"""Laws of time for drives, forces and torques."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, Literal, overload

import numpy as np
from pydantic import Field

from stiction.scenes.fields import Number, Part, Positive

MOST_COEFFICIENTS = 20
"""Largest number of coefficients of a polynomial: a higher degree is rounding, in powers of u."""


class Constant(Part):
    """The constant `value`."""

    type: Literal["constant"] = "constant"
    """A constant"""
    value: Number
    """The value, in the unit of the quantity that follows the law"""


class Linear(Part):
    """The linear function `offset + rate t`."""

    type: Literal["linear"] = "linear"
    """A linear function"""
    offset: Number = 0.0
    """Value at t = 0"""
    rate: Number
    """Rate, per second"""


class Sine(Part):
    """The harmonic function `offset + amplitude sin(frequency t + phase)`."""

    type: Literal["sine"] = "sine"
    """A harmonic function"""
    offset: Number = 0.0
    """Mean value"""
    amplitude: Number
    """Amplitude, of either sign"""
    frequency: Number
    """Angular frequency; rad/s"""
    phase: Number = 0.0
    """Phase at t = 0; rad"""


class Table(Part):
    """Values at given times, interpolated linearly or by a cubic spline.

    A time that occurs twice in a linear table is a step: the value jumps there from the first to the second. Outside of
    the given times, a linear table is constant, and a cubic table continues along the tangent at its end. The natural
    spline has the second derivative zero at both ends, the clamped spline the first derivative: a drive with a clamped
    table starts from rest and ends at rest.
    """

    type: Literal["table"] = "table"
    """A table"""
    times: tuple[Number, ...] = Field(min_length=2)
    """At least two times, increasing; in a linear table, a step has the same time twice; s"""
    values: tuple[Number, ...] = Field(min_length=2)
    """Values, as many as times"""
    interpolation: Literal["linear", "cubic"] = "linear"
    """`"linear"`, or `"cubic"` for a cubic spline"""
    ends: Literal["natural", "clamped"] = "natural"
    """Ends of a cubic spline: `"natural"`, or `"clamped"` for the rate zero"""

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield lists of different lengths, the first time that does not increase, and ends of straight lines."""
        if len(self.times) != len(self.values):
            yield (
                "values",
                self.values,
                f"expected as many as times: {len(self.times)}, not {len(self.values)}",
            )
        if self.interpolation == "linear" and self.ends != "natural":
            yield "ends", self.ends, "expected with interpolation = 'cubic' only"
        may_step = self.interpolation == "linear"
        for i, (before, after) in enumerate(zip(self.times, self.times[1:])):
            is_step = after == before and may_step and (i == 0 or self.times[i - 1] < before)
            if not (after > before or is_step):
                expected = f"expected more than the time before it, {before:g}"
                if may_step:
                    expected += ", or the same once, for a step"
                yield f"times.{i + 1}", after, expected
                return

    @property
    def steps(self) -> tuple[float, ...]:
        """The times at which the value jumps, s."""
        return tuple(time for time, later in zip(self.times, self.times[1:]) if later == time)


class Trapezoid(Part):
    """A move by `distance` with a trapezoidal rate: rest, acceleration, constant rate, deceleration, rest.

    Acceleration and deceleration take `ramp` each and are constant; the value is `offset` before the move and
    `offset + distance` after it.
    """

    type: Literal["trapezoid"] = "trapezoid"
    """A move with a trapezoidal rate"""
    offset: Number = 0.0
    """Value before the move"""
    distance: Number
    """Change of the value by the move, of either sign"""
    start: Number = 0.0
    """Time at which the move begins; s"""
    duration: Positive
    """Duration of the move; s, > 0"""
    ramp: Positive
    """Duration of the acceleration, and of the deceleration; at most half of `duration`; s, > 0"""

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield ramps that are longer than the move."""
        if self.ramp > 0.5 * self.duration:
            yield "ramp", self.ramp, f"expected at most half of duration = {self.duration:g}"


class Cycloid(Part):
    """A move by `distance` along a cycloid: `offset + distance (u - sin(2 pi u)/(2 pi))`, u = (t - start)/duration.

    The value is `offset` before the move and `offset + distance` after it. Rate and second derivative are continuous.
    """

    type: Literal["cycloid"] = "cycloid"
    """A move along a cycloid"""
    offset: Number = 0.0
    """Value before the move"""
    distance: Number
    """Change of the value by the move, of either sign"""
    start: Number = 0.0
    """Time at which the move begins; s"""
    duration: Positive
    """Duration of the move; s, > 0"""


class Polynomial(Part):
    """A polynomial `offset + distance (c0 + c1 u + c2 u^2 + ..)` of u = (t - start)/duration, from u = 0 to 1.

    The default coefficients are those of the 3-4-5 polynomial, a move by `distance` from rest to rest whose second
    derivative is continuous. Before and after, the law continues along the tangent at its end: at rest where the rate
    of the polynomial is zero.
    """

    type: Literal["polynomial"] = "polynomial"
    """A polynomial"""
    offset: Number = 0.0
    """Value to which the polynomial is added"""
    distance: Number = 1.0
    """Factor of the polynomial, of either sign"""
    start: Number = 0.0
    """Time at which u is 0; s"""
    duration: Positive
    """Time in which u increases by 1; s, > 0"""
    coefficients: tuple[Number, ...] = Field(
        default=(0.0, 0.0, 0.0, 10.0, -15.0, 6.0), min_length=1, max_length=MOST_COEFFICIENTS
    )
    """Coefficients of the powers of u, that of u^0 first"""


class Sum(Part):
    """The sum of laws, such as a cycloid that rises, a dwell, and a cycloid that returns."""

    type: Literal["sum"] = "sum"
    """A sum"""
    terms: tuple[Term, ...] = Field(min_length=1)
    """Laws of any type but `"sum"`"""


MOVES = (Trapezoid, Cycloid, Polynomial)
"""The laws that are made of `pieces`."""
Term = Annotated[
    Constant | Linear | Sine | Table | Trapezoid | Cycloid | Polynomial,
    Field(discriminator="type"),
]
"""A law that is no sum."""
Law = Annotated[
    Constant | Linear | Sine | Table | Trapezoid | Cycloid | Polynomial | Sum,
    Field(discriminator="type"),
]
Sum.model_rebuild()


@dataclass(frozen=True)
class Piece:
    """A law of time from an instant on: a polynomial and a sine of u = t - origin.

    Attributes
    ----------
    begin : float
        First instant of the piece, s; -inf in the first piece of a law.
    origin : float
        Time at which u is 0, s.
    coefficients : tuple of float
        Coefficients of the powers of u.
    amplitude : float
        Amplitude of the sine.
    frequency : float
        Angular frequency of the sine, rad/s.
    """

    begin: float
    origin: float
    coefficients: tuple[float, ...]
    amplitude: float = 0.0
    frequency: float = 0.0


@lru_cache(maxsize=64)
def pieces(law: Trapezoid | Cycloid | Polynomial) -> tuple[Piece, ...]:
    """Return the pieces of a move, in order of time."""
    start, end = law.start, law.start + law.duration
    before = Piece(-math.inf, start, (law.offset,))
    after = Piece(end, end, (law.offset + law.distance,))
    if isinstance(law, Cycloid):
        frequency = 2.0 * math.pi / law.duration
        rise = (law.offset, law.distance / law.duration)
        return before, Piece(start, start, rise, -law.distance / (2.0 * math.pi), frequency), after

    if isinstance(law, Trapezoid):
        # The rate of the middle piece, with which the area below the trapezoid is the distance.
        rate = law.distance / (law.duration - law.ramp)
        half_of_acceleration = 0.5 * rate / law.ramp
        ramp_way = 0.5 * rate * law.ramp
        middle, last = start + law.ramp, end - law.ramp
        low, high = law.offset + ramp_way, law.offset + law.distance - ramp_way
        accelerated = Piece(start, start, (law.offset, 0.0, half_of_acceleration))
        even = Piece(middle, middle, (low, rate))
        decelerated = Piece(last, last, (high, rate, -half_of_acceleration))
        if last > middle:
            return before, accelerated, even, decelerated, after
        return before, accelerated, decelerated, after

    # The polynomial in powers of t - start, and the tangents at u = 0 and u = 1.
    scaled = [law.distance * c / law.duration**k for k, c in enumerate(law.coefficients)]
    end_value = law.offset + law.distance * math.fsum(law.coefficients)
    slopes = [k * c for k, c in enumerate(law.coefficients)]
    end_rate = law.distance * math.fsum(slopes) / law.duration
    scaled[0] += law.offset
    start_rate = scaled[1] if len(scaled) > 1 else 0.0
    return (
        Piece(-math.inf, start, (scaled[0], start_rate)),
        Piece(start, start, tuple(scaled)),
        Piece(end, end, (end_value, end_rate)),
    )


def law_terms(law: Law) -> tuple[Term, ...]:
    """Return the terms of a sum, and any other law alone."""
    return law.terms if isinstance(law, Sum) else (law,)


def law_kinks(law: Law, t_end: float) -> tuple[float, ...]:
    """Return the times in (0, t_end) at which a law is not smooth, in order, s.

    They are the knots of a table and the times between the pieces of a move. There the value or the rate of a linear
    table jumps, the third derivative of a cubic table (at the ends of a clamped one the second), and the second or
    third derivative of a move. No method of high order should step across such a time.
    """
    times: set[float] = set()
    for term in law_terms(law):
        if isinstance(term, Table):
            times.update(term.times)
        elif isinstance(term, MOVES):
            times.update(piece.begin for piece in pieces(term))
    return _within(times, t_end)


def law_switches(law: Law, t_end: float) -> tuple[float, ...]:
    """Return those of the `law_kinks` at which forces may jump, or a drive may begin or end a dwell, s.

    They are the steps of a table, the ends of a clamped table, and the times between the pieces of a move.
    """
    times: set[float] = set()
    for term in law_terms(law):
        if isinstance(term, Table):
            times.update(term.steps)
            if term.ends == "clamped":
                times.update((term.times[0], term.times[-1]))
        else:
            times.update(law_kinks(term, t_end))
    return _within(times, t_end)


def _within(times: Iterable[float], t_end: float) -> tuple[float, ...]:
    """Return those of the times that are in (0, t_end), in order, s."""
    return tuple(sorted(time for time in times if 0 < time < t_end))


def constant_from(law: Law) -> float:
    """Return the time from which on a table, a move, or a sum of those and constants is constant, s.

    It is -inf of a constant, and inf of a law that is never constant.
    """
    latest = -math.inf
    for term in law_terms(law):
        if isinstance(term, Constant):
            continue
        if isinstance(term, Table):
            is_constant = term.interpolation == "linear" or term.ends == "clamped"
            latest = max(latest, term.times[-1] if is_constant else math.inf)
        elif isinstance(term, MOVES):
            last = pieces(term)[-1]
            latest = max(latest, math.inf if any(last.coefficients[1:]) else last.begin)
        else:
            return math.inf
    return latest


def scaled_law(law: Law, factor: float) -> Law:
    """Return a law multiplied by a factor."""
    if isinstance(law, Sum):
        terms = tuple(scaled_law(term, factor) for term in law.terms)
        return law.model_copy(update={"terms": terms})
    if isinstance(law, Table):
        values = tuple(factor * value for value in law.values)
        return law.model_copy(update={"values": values})
    sizes = ("value", "offset", "rate", "amplitude", "distance")
    update = {name: factor * getattr(law, name) for name in sizes if hasattr(law, name)}
    return law.model_copy(update=update)


def shifted_law(law: Law, shift: float) -> Law:
    """Return the law whose value at time t is that of `law` at t + shift (s)."""
    match law:
        case Linear():
            return law.model_copy(update={"offset": law.offset + law.rate * shift})
        case Sine():
            return law.model_copy(update={"phase": law.phase + law.frequency * shift})
        case Table():
            return law.model_copy(update={"times": tuple(time - shift for time in law.times)})
        case Trapezoid() | Cycloid() | Polynomial():
            return law.model_copy(update={"start": law.start - shift})
        case Sum():
            terms = tuple(shifted_law(term, shift) for term in law.terms)
            return law.model_copy(update={"terms": terms})
    return law


@lru_cache(maxsize=64)
def spline_slopes(
    times: tuple[float, ...], values: tuple[float, ...], ends: str = "natural"
) -> np.ndarray:
    """Return the second derivatives of a cubic spline at its knots, shape (n,), read-only.

    The first and second derivative of the spline are continuous (de Boor, A Practical Guide to Splines, ch. IV). At
    both ends of a ``"natural"`` spline the second derivative is zero, of a ``"clamped"`` spline the first. Results are
    cached, since an adapter evaluates the law of a drive in each step.
    """
    # Imported here, because it takes longer than reading most scenes, and few scenes have tables.
    from scipy.interpolate import CubicSpline

    second = CubicSpline(times, values, bc_type=ends)(times, 2)
    # The natural end conditions hold up to rounding; make them exact.
    if ends == "natural":
        second[[0, -1]] = 0.0
    second.flags.writeable = False
    return second


@overload
def evaluate_law(law: Law, t: float) -> tuple[float, float, float]: ...


@overload
def evaluate_law(
    law: Constant | Linear | Sine, t: np.ndarray
) -> tuple[float | np.ndarray, float | np.ndarray, float | np.ndarray]: ...


def evaluate_law(law: Law, t: Any) -> Any:
    """Evaluate a law of time and its first and second derivative.

    Parameters
    ----------
    law
        The law of a drive, a force or a torque of a scene.
    t : float or ndarray
        Time, s; an array has the shape (n,). Tables, moves and sums are evaluated at one time only.

    Returns
    -------
    tuple
        Value, first and second derivative, in the unit of the law, per s and per s². Where one of them jumps it is the
        limit from the right. Derivatives that are constant are returned as one number.
    """
    if isinstance(law, Constant):
        return law.value, 0.0, 0.0
    if isinstance(law, Linear):
        return law.offset + law.rate * t, law.rate, 0.0
    if isinstance(law, Sine):
        phase = law.frequency * t + law.phase
        sine, cosine = np.sin(phase), np.cos(phase)
        return (
            law.offset + law.amplitude * sine,
            law.amplitude * law.frequency * cosine,
            -law.amplitude * law.frequency**2 * sine,
        )
    if isinstance(law, Sum):
        value, rate, second_rate = zip(*(evaluate_law(term, t) for term in law.terms))
        return sum(value), sum(rate), sum(second_rate)
    if isinstance(law, Table):
        return _evaluate_table(law, t)
    return _evaluate_piece(next(piece for piece in reversed(pieces(law)) if piece.begin <= t), t)


def _evaluate_piece(piece: Piece, t: float) -> tuple[float, float, float]:
    """Return the value and the first and second derivative of a piece at time t (s)."""
    u = t - piece.origin
    value = rate = half_second_rate = 0.0
    # Horner's rule for a polynomial and its first two derivatives.
    for coefficient in reversed(piece.coefficients):
        half_second_rate = half_second_rate * u + rate
        rate = rate * u + value
        value = value * u + coefficient
    sine = piece.amplitude * math.sin(piece.frequency * u)
    cosine = piece.amplitude * math.cos(piece.frequency * u)
    return (
        value + sine,
        rate + piece.frequency * cosine,
        2.0 * half_second_rate - piece.frequency**2 * sine,
    )


def _evaluate_table(law: Table, t: float) -> tuple[float, float, float]:
    """Return the value and the first and second derivative of a table at time t (s)."""
    times = np.array(law.times)
    values = np.array(law.values)
    # Straight lines are cubics whose second derivatives are zero at the knots.
    second = np.zeros(len(times))
    if law.interpolation == "cubic":
        second = spline_slopes(law.times, law.values, law.ends)
    is_outside = t < times[0] or t >= times[-1]
    end = 0 if t < times[0] else -1
    if is_outside and law.interpolation == "linear":
        return float(values[end]), 0.0, 0.0
    # The interval in which t lies, or the nearest one; its length h and the slope of its chord.
    i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    h = times[i + 1] - times[i]
    slope = (values[i + 1] - values[i]) / h

    if is_outside:
        # Continue along the tangent of the spline at the nearer end.
        bend = -2 * second[0] - second[1] if end == 0 else second[-2] + 2 * second[-1]
        tangent = slope + h / 6 * bend
        return float(values[end] + tangent * (t - times[end])), float(tangent), 0.0

    # The cubic that has these values and second derivatives at both ends of the interval; u and w
    # are the distances of t from the ends.
    u, w = t - times[i], times[i + 1] - t
    value = (
        (second[i] * w**3 + second[i + 1] * u**3) / (6 * h)
        + (values[i] / h - second[i] * h / 6) * w
        + (values[i + 1] / h - second[i + 1] * h / 6) * u
    )
    rate = (
        (second[i + 1] * u**2 - second[i] * w**2) / (2 * h)
        + slope
        - h / 6 * (second[i + 1] - second[i])
    )
    second_rate = (second[i] * w + second[i + 1] * u) / h
    return float(value), float(rate), float(second_rate)
