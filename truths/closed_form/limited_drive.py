"""Closed forms of mechanisms of one freedom whose drive has a limit.

The drive pulls with at most L along its coordinate x, towards the rate r of its law. While it gives way its force is
constant, L sgn(r - x'), so that each motion below is elementary.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq


@dataclass(frozen=True)
class Hoist:
    """A mass m on a vertical axis that a drive of rate r lifts from rest against its weight m g.

    Attributes
    ----------
    mass, weight, limit : float
        m (kg), m g (N) and L (N).
    rate : float
        Rate r of the law, m/s, > 0.
    """

    mass: float
    weight: float
    limit: float
    rate: float

    @property
    def acceleration(self) -> float:
        """The acceleration L/m - g while the drive gives way, m/s²; the mass sinks where it is negative."""
        return (self.limit - self.weight) / self.mass

    @property
    def time_to_hold(self) -> float:
        """The time at which the mass has the rate of the law, s; infinite if the limit is below the weight."""
        return self.rate / self.acceleration if self.acceleration > 0.0 else np.inf

    def position(self, t: np.ndarray) -> np.ndarray:
        """Return the height above the start at times t, m."""
        begin = np.minimum(t, self.time_to_hold)
        return self.acceleration * begin**2 / 2 + self.rate * (t - begin)

    def effort(self, t: np.ndarray) -> np.ndarray:
        """Return the force of the drive at times t, N: its limit, then the weight."""
        return np.where(t < self.time_to_hold, self.limit, self.weight)


@dataclass(frozen=True)
class Stall:
    """A mass m that a drive of rate r pushes against a spring k and a damper c, from x = 0 at the rate r.

    The force of the rate is k x + c r, and reaches the limit L at x1 = (L - c r)/k. From then on
    m x'' + c x' + k x = L with x' below r, so that the drive never holds again: with u = x - L/k, w^2 = k/m - a^2 and
    a = c/(2 m),

        u = exp(-a s) (u1 cos(w s) + (r + a u1)/w sin(w s)),    s = t - t1,    u1 = -c r/k .

    Attributes
    ----------
    mass, stiffness, damping, limit, rate : float
        m (kg), k (N/m), c (N s/m, below 2 sqrt(k m)), L (N) and r (m/s); all > 0.
    """

    mass: float
    stiffness: float
    damping: float
    limit: float
    rate: float

    @property
    def time_of_slip(self) -> float:
        """The time t1 at which the drive gives way, s."""
        return (self.limit - self.damping * self.rate) / (self.stiffness * self.rate)

    def position(self, t: np.ndarray) -> np.ndarray:
        """Return x at times t, m."""
        s = np.maximum(t - self.time_of_slip, 0.0)
        decay = self.damping / (2 * self.mass)
        frequency = np.sqrt(self.stiffness / self.mass - decay**2)
        start = -self.damping * self.rate / self.stiffness
        swing = start * np.cos(frequency * s)
        swing += (self.rate + decay * start) / frequency * np.sin(frequency * s)
        stalled = self.limit / self.stiffness + np.exp(-decay * s) * swing
        return np.where(t < self.time_of_slip, self.rate * t, stalled)


@dataclass(frozen=True)
class ShakenRotor:
    """A rotor of inertia I that a drive with the rate A w cos(w t) shakes, from the rate of the law.

    The law asks for the torque -I A w^2 sin(w t), and the drive holds it up to its limit L, if L < I A w^2 until

        t1 = arcsin(L/(I A w^2))/w .

    From then on the torque is -L until the rates are equal again. There the drive holds if the torque that the law
    asks for is within the limit; otherwise its effort reverses.

    Attributes
    ----------
    inertia, limit, amplitude, frequency : float
        I (kg m²), L (N m), A (rad) and w (rad/s); all > 0.
    """

    inertia: float
    limit: float
    amplitude: float
    frequency: float

    @property
    def time_of_slip(self) -> float:
        """The time t1 at which the drive gives way, s."""
        largest = self.inertia * self.amplitude * self.frequency**2
        return float(np.arcsin(self.limit / largest)) / self.frequency

    @property
    def time_of_equal_rates(self) -> float:
        """The first time after t1 at which the rotor has the rate of the law, s."""
        slip, rate = self.time_of_slip, self.amplitude * self.frequency

        def slip_rate(t: float) -> float:
            rotor = rate * np.cos(self.frequency * slip) - self.limit / self.inertia * (t - slip)
            return float(rotor - rate * np.cos(self.frequency * t))

        # just behind t1 the law is slower than the rotor, and after a period faster
        later = slip + 1e-3 / self.frequency
        return float(brentq(slip_rate, later, 2 * np.pi / self.frequency, xtol=1e-15, rtol=1e-15))

    @property
    def holds_again(self) -> bool:
        """Whether the drive holds where the rates are equal again."""
        largest = self.inertia * self.amplitude * self.frequency**2
        return abs(largest * np.sin(self.frequency * self.time_of_equal_rates)) <= self.limit
