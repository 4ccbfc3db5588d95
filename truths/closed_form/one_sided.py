"""Closed forms of masses between stops: springs that act on one side only.

A mass m moves along x. A stop is a spring k and a damper c that pushes while the mass is beyond its place. During a
contact the depth u obeys, with w^2 = k/m and without other forces,

    m u'' + c u' + k u = 0,    u(0) = 0,    u'(0) = v,

and the force k u + c u' ends where it is zero, as the stop does not pull. With a = c/(2 m) and p^2 = w^2 - a^2 > 0,

    u = v/p exp(-a s) sin(p s),    u' = v exp(-a s) (cos(p s) - a/p sin(p s)) .

The force k u + c u' vanishes where tan(p s) = -2 a p/(p^2 - a^2), first at

    s = (pi - 2 arctan(a/p))/p,    and there    u' = -v exp(-a s).

From there on the mass leaves with a constant speed, so that exp(-a s) is the coefficient of restitution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Stop:
    """A stop that a mass m (kg) meets without other forces: stiffness k (N/m) and damping c (N s/m), c^2 < 4 k m."""

    mass: float
    stiffness: float
    damping: float = 0.0

    @property
    def _decay(self) -> float:
        return self.damping / (2.0 * self.mass)

    @property
    def _frequency(self) -> float:
        return float(np.sqrt(self.stiffness / self.mass - self._decay**2))

    @property
    def contact_time(self) -> float:
        """The time s from the contact to the end of the force, s; pi/w without damping."""
        p = self._frequency
        return float((np.pi - 2.0 * np.arctan2(self._decay, p)) / p)

    @property
    def restitution(self) -> float:
        """The speed after a contact relative to that before it."""
        return float(np.exp(-self._decay * self.contact_time))


@dataclass(frozen=True)
class MassBetweenStops:
    """A mass that flies with the speed v between two equal stops at a distance l from each other, without damping.

    Attributes
    ----------
    stop : Stop
        Both stops; undamped.
    distance : float
        Free way l between the contacts, m.
    speed : float
        Speed v in flight, m/s.
    """

    stop: Stop
    distance: float
    speed: float

    @property
    def period(self) -> float:
        """The period of the motion, s: two flights and two half swings."""
        return 2.0 * (self.distance / self.speed + self.stop.contact_time)

    def position(self, t: np.ndarray) -> np.ndarray:
        """Return the position at times t (s), from the middle, of a start there with the speed v, m."""
        w = np.sqrt(self.stop.stiffness / self.stop.mass)
        half, way = self.period / 2.0, self.distance
        # one half period after another, each mirrored: a flight from -l/2 to l/2, then a half swing beyond
        shifted = t + way / (2.0 * self.speed)
        number, s = np.divmod(shifted, half)
        flight = way / self.speed
        beyond = way / 2.0 + self.speed / w * np.sin(w * (s - flight))
        x = np.where(s < flight, self.speed * s - way / 2.0, beyond)
        return np.where(number % 2 == 0, x, -x)


@dataclass(frozen=True)
class Drop:
    """A mass m (kg) that falls from the height h (m) above an undamped stop k (N/m), under gravity g (m/s²)."""

    mass: float
    stiffness: float
    height: float
    gravity: float

    @property
    def contact(self) -> float:
        """The time of the first contact, s."""
        return float(np.sqrt(2.0 * self.height / self.gravity))

    @property
    def contact_time(self) -> float:
        """The duration of a contact, s: m u'' = m g - k u with u'(0) = v is released at u = 0.

        u = g/w^2 (1 - cos(w s)) + v/w sin(w s), with zeros at s = 0 and w s = 2 (pi - arctan(v w/g)).
        """
        w = np.sqrt(self.stiffness / self.mass)
        speed = self.gravity * self.contact
        return float(2.0 * (np.pi - np.arctan2(speed * w, self.gravity)) / w)

    @property
    def depth(self) -> float:
        """The largest depth, m: m g (h + u) = k u^2/2."""
        weight = self.mass * self.gravity
        root = np.sqrt(weight**2 + 2.0 * self.stiffness * weight * self.height)
        return float((weight + root) / self.stiffness)

    @property
    def period(self) -> float:
        """The period of the bouncing, s."""
        return 2.0 * self.contact + self.contact_time
