"""Laws of time for drives, forces and torques."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from scenes.fields import Model, Number


class Constant(Model):
    """`value` at all times."""

    type: Literal["constant"]
    value: Number


class Linear(Model):
    """`offset + rate t`."""

    type: Literal["linear"]
    offset: Number = 0.0
    rate: Number


class Sine(Model):
    """`offset + amplitude sin(frequency t + phase)`; frequency in rad/s."""

    type: Literal["sine"]
    offset: Number = 0.0
    amplitude: Number
    frequency: Number
    phase: Number = 0.0


class Table(Model):
    """Values at given times: joined by straight lines, or by a natural cubic spline.

    Before the first time and after the last the law keeps the end value (linear) or
    continues the end's tangent (cubic, whose second derivative is zero there).
    """

    type: Literal["table"]
    times: tuple[Number, ...] = Field(min_length=2)
    values: tuple[Number, ...] = Field(min_length=2)
    interpolation: Literal["linear", "cubic"] = "linear"

    @model_validator(mode="after")
    def _increasing(self) -> Table:
        if len(self.times) != len(self.values):
            raise ValueError(f"{len(self.times)} times but {len(self.values)} values: expected as many values as times")
        if any(b <= a for a, b in zip(self.times, self.times[1:])):
            raise ValueError("times are not increasing: expected strictly increasing times")
        return self


Law = Annotated[Constant | Linear | Sine | Table, Field(discriminator="type")]


def spline_slopes(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Second derivatives of the natural cubic spline at its knots.

    The tridiagonal system of continuity of the first derivative with zero second
    derivative at both ends (de Boor, A Practical Guide to Splines, ch. IV).
    """
    n = len(times)
    h = np.diff(times)
    system = np.eye(n)
    right = np.zeros(n)
    for i in range(1, n - 1):
        system[i, i - 1:i + 2] = h[i - 1], 2 * (h[i - 1] + h[i]), h[i]
        right[i] = 6 * ((values[i + 1] - values[i]) / h[i] - (values[i] - values[i - 1]) / h[i - 1])
    return np.linalg.solve(system, right)


def evaluate_law(law: Law, t: float) -> tuple[float, float, float]:
    """Value, first and second derivative of a law at time t (of a linear table: from the right)."""
    if isinstance(law, Constant):
        return law.value, 0.0, 0.0
    if isinstance(law, Linear):
        return law.offset + law.rate * t, law.rate, 0.0
    if isinstance(law, Sine):
        phase = law.frequency * t + law.phase
        sine, cosine = np.sin(phase), np.cos(phase)
        return (law.offset + law.amplitude * sine, law.amplitude * law.frequency * cosine,
                -law.amplitude * law.frequency ** 2 * sine)
    times, values = np.array(law.times), np.array(law.values)
    second = spline_slopes(times, values) if law.interpolation == "cubic" else np.zeros(len(times))
    i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    h = times[i + 1] - times[i]
    slope = (values[i + 1] - values[i]) / h
    if t < times[0] or t >= times[-1]:
        if law.interpolation == "linear":
            return float(values[0] if t < times[0] else values[-1]), 0.0, 0.0
        end = 0 if t < times[0] else -1
        tangent = slope - h / 6 * (2 * second[0] + second[1]) if end == 0 else slope + h / 6 * (second[-2] + 2 * second[-1])
        return float(values[end] + tangent * (t - times[end])), float(tangent), 0.0
    u, w = t - times[i], times[i + 1] - t
    value = (second[i] * w ** 3 + second[i + 1] * u ** 3) / (6 * h) \
        + (values[i] / h - second[i] * h / 6) * w + (values[i + 1] / h - second[i + 1] * h / 6) * u
    rate = (second[i + 1] * u ** 2 - second[i] * w ** 2) / (2 * h) + slope - h / 6 * (second[i + 1] - second[i])
    return float(value), float(rate), float((second[i] * w + second[i + 1] * u) / h)
