"""Laws of time for drives, forces and torques."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Annotated, Any, Literal, overload

import numpy as np
from pydantic import Field

from stiction.scenes.fields import Model, Number


class Constant(Model):
    """The constant `value`."""

    type: Literal["constant"]
    """A constant"""
    value: Number
    """The value, in the unit of the quantity that follows the law"""


class Linear(Model):
    """The linear function `offset + rate t`."""

    type: Literal["linear"]
    """A linear function"""
    offset: Number = 0.0
    """Value at t = 0"""
    rate: Number
    """Rate, per second"""


class Sine(Model):
    """The harmonic function `offset + amplitude sin(frequency t + phase)`."""

    type: Literal["sine"]
    """A harmonic function"""
    offset: Number = 0.0
    """Mean value"""
    amplitude: Number
    """Amplitude, of either sign"""
    frequency: Number
    """Angular frequency; rad/s"""
    phase: Number = 0.0
    """Phase at t = 0; rad"""


class Table(Model):
    """Values at given times, interpolated linearly or by a natural cubic spline.

    Outside of the given times, a linear table is constant, and a cubic table continues along the tangent at its end,
    where its second derivative is zero.
    """

    type: Literal["table"]
    """A table"""
    times: tuple[Number, ...] = Field(min_length=2)
    """At least two times, increasing; s"""
    values: tuple[Number, ...] = Field(min_length=2)
    """Values, as many as times"""
    interpolation: Literal["linear", "cubic"] = "linear"
    """`"linear"`, or `"cubic"` for a natural cubic spline"""

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        if len(self.times) != len(self.values):
            yield (
                "values",
                self.values,
                f"expected as many as times: {len(self.times)}, not {len(self.values)}",
            )
        for i, (before, after) in enumerate(zip(self.times, self.times[1:])):
            if not after > before:
                yield f"times.{i + 1}", after, f"expected more than the time before it, {before:g}"
                return


Law = Annotated[Constant | Linear | Sine | Table, Field(discriminator="type")]


def law_kinks(law: Law, t_end: float) -> tuple[float, ...]:
    """Knots of a table in (0, t_end): its rate jumps there, or the third derivative that high orders need."""
    return tuple(time for time in law.times if 0 < time < t_end) if isinstance(law, Table) else ()


@lru_cache(maxsize=64)
def spline_slopes(times: tuple[float, ...], values: tuple[float, ...]) -> np.ndarray:
    """Second derivatives of the natural cubic spline at its knots, shape (n,), read-only.

    Its first derivative is continuous, its second zero at both ends (de Boor, A Practical Guide to Splines, ch. IV).
    Kept for the last splines: an adapter evaluates the law of a drive in each step.
    """
    # imported here: nothing else needs it, and it takes longer to import than most scenes to read
    from scipy.interpolate import CubicSpline

    second = CubicSpline(times, values, bc_type="natural")(times, 2)
    second[[0, -1]] = 0.0  # which the spline meets to rounding
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
        Time, s; an array has the shape (n,). Tables are evaluated at one time only.

    Returns
    -------
    tuple
        Value, first and second derivative, in the unit of the law, per s and per s². At a point of a linear table the
        first derivative is the one from the right. Derivatives that are constant are returned as one number.
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
    # A table: the interval in which t lies, its chord, and the second derivatives at its ends, zero
    # of straight lines.
    times, values = np.array(law.times), np.array(law.values)
    cubic = law.interpolation == "cubic"
    second = spline_slopes(law.times, law.values) if cubic else np.zeros(len(times))
    i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    h = times[i + 1] - times[i]
    slope = (values[i + 1] - values[i]) / h
    if t < times[0] or t >= times[-1]:
        if law.interpolation == "linear":
            return float(values[0] if t < times[0] else values[-1]), 0.0, 0.0
        # the tangent of the spline at the end that is nearer
        if t < times[0]:
            end, bend = 0, -2 * second[0] - second[1]
        else:
            end, bend = -1, second[-2] + 2 * second[-1]
        tangent = slope + h / 6 * bend
        return float(values[end] + tangent * (t - times[end])), float(tangent), 0.0
    # The cubic with these values and second derivatives at both ends, in the distances u and w from
    # them.
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
    return float(value), float(rate), float((second[i] * w + second[i + 1] * u) / h)
