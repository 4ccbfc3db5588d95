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
        """Yield lists of different lengths, and the first time that does not increase."""
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
    """Return the times in (0, t_end) at which a law is not smooth, s: the inner knots of a table.

    The rate of a linear table jumps there, and the third derivative of a cubic table, so that no method of high order
    should step across a knot.
    """
    if not isinstance(law, Table):
        return ()
    return tuple(time for time in law.times if 0 < time < t_end)


@lru_cache(maxsize=64)
def spline_slopes(times: tuple[float, ...], values: tuple[float, ...]) -> np.ndarray:
    """Return the second derivatives of the natural cubic spline at its knots, shape (n,), read-only.

    The first derivative of this spline is continuous, and the second derivative is zero at both ends (de Boor, A
    Practical Guide to Splines, ch. IV). Results are cached, since an adapter evaluates the law of a drive in each step.
    """
    # Imported here, because it takes longer than reading most scenes, and few scenes have tables.
    from scipy.interpolate import CubicSpline

    second = CubicSpline(times, values, bc_type="natural")(times, 2)
    # The natural end conditions hold up to rounding; make them exact.
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
    return _evaluate_table(law, t)


def _evaluate_table(law: Table, t: float) -> tuple[float, float, float]:
    """Return the value and the first and second derivative of a table at time t (s)."""
    times = np.array(law.times)
    values = np.array(law.values)
    # Straight lines are cubics whose second derivatives are zero at the knots.
    second = np.zeros(len(times))
    if law.interpolation == "cubic":
        second = spline_slopes(law.times, law.values)
    # The interval in which t lies, or the nearest one; its length h and the slope of its chord.
    i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    h = times[i + 1] - times[i]
    slope = (values[i + 1] - values[i]) / h

    if t < times[0] or t >= times[-1]:
        end = 0 if t < times[0] else -1
        if law.interpolation == "linear":
            return float(values[end]), 0.0, 0.0
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
