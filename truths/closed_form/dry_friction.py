"""Mechanisms of one or two freedoms whose dry friction has constant bounds, in closed form.

The bound is F in slip and F_s >= F at rest: `friction` and `static_friction` of a scene, in N for a guide and N m for a
pin. Each function returns what follows from a balance of energy or of forces alone, so that nothing is integrated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from stiction.truths.truth import NotThisMechanism

_RELATIVE_ZERO = 4 * np.finfo(float).eps
"""Relative tolerance of a root: the least that `scipy.optimize.brentq` accepts."""
_ABSOLUTE_ZERO = 1e-16
"""Absolute tolerance of an angle, rad: below its rounding."""


def pendulum_turning_angles(
    moment: float, bound: float, static_bound: float, start: float
) -> list[float]:
    """Return the angles at which a pendulum with a dry pin turns, and last the angle at which it stays.

    Between two turning angles b and a, of opposite sides, friction takes what the weight gives:

        m g l (cos a - cos b) = tau |b - a| .

    It stays where static friction holds the moment of the weight, m g l |sin a| <= tau_s.

    Parameters
    ----------
    moment : float
        m g l, the largest moment of the weight about the pin, N m.
    bound, static_bound : float
        tau and tau_s, the torques of dry friction, N m.
    start : float
        Angle from the lowest position where the pendulum is at rest at first, rad; its size below pi.
    """
    angles = [start]
    while moment * abs(np.sin(angles[-1])) > static_bound:
        begin = angles[-1]
        side = -np.sign(begin)

        def gain(swing: float, begin: float = begin, side: float = side) -> float:
            """Return what is left of the energy after a swing of this size, N m."""
            end = begin + side * swing
            return moment * (np.cos(end) - np.cos(begin)) - bound * swing

        # The energy grows as long as the moment of the weight exceeds the friction, and falls from
        # there on: the swing ends at its only zero behind that place.
        fastest = abs(begin) - np.arcsin(min(bound / moment, 1.0))
        turn = brentq(gain, fastest, 2 * abs(begin), xtol=_ABSOLUTE_ZERO, rtol=_RELATIVE_ZERO)
        angles.append(begin + side * turn)
    return angles


def oscillator_turning_points(
    stiffness: float, bound: float, static_bound: float, start: float
) -> list[float]:
    """Return the displacements at which a mass on a spring with dry friction turns, and last where it stays.

    The amplitude falls by 2 F/k in each half cycle, as the energies k x^2/2 at two turning points differ by the work of
    friction. The mass stays where static friction holds the spring, k |x| <= F_s.

    Parameters
    ----------
    stiffness : float
        k, N/m.
    bound, static_bound : float
        F and F_s, N.
    start : float
        Displacement from the position without tension where the mass is at rest at first, m.
    """
    places = [start]
    while stiffness * abs(places[-1]) > static_bound:
        amplitude = abs(places[-1]) - 2 * bound / stiffness
        places.append(-np.sign(places[-1]) * amplitude)
    return places


def break_away_load(bounds: Sequence[float], rates: Sequence[float]) -> float:
    """Return the load from which on a mechanism of one freedom at rest begins to move, whatever its joints share of it.

    A load does the power `load` times the rate of its coordinate. Friction can take at most that of all static bounds
    at once, so that the mechanism rests while

        |load| <= sum over joints of static_i |rate_i| ,

    `rates` per unit of the rate of the load's coordinate. Some share of the load lies within all bounds exactly then.
    """
    return float(np.sum(np.abs(rates) * np.array(bounds)))


@dataclass(frozen=True)
class RampedStart:
    """A body of one freedom at rest, under a load that grows linearly: `offset` + `rate` t.

    `inertia` is its mass (kg), or its moment of inertia about a pin (kg m^2); the load is a force (N) or a torque
    (N m), as are the bounds `bound` and `static_bound` of friction. While it moves, the friction is the kinetic one.
    """

    inertia: float
    offset: float
    rate: float
    bound: float
    static_bound: float

    @property
    def break_away(self) -> float:
        """Time at which the load exceeds the static bound, s; inf where it never does."""
        if abs(self.offset) > self.static_bound:
            return 0.0
        if self.rate == 0.0:
            return np.inf
        return (self.static_bound - np.sign(self.rate) * self.offset) / abs(self.rate)

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """Return the acceleration at times t, m/s^2 or rad/s^2; 0 up to the break-away.

        NotThisMechanism is raised for a load that changes its sign behind it, where the body may stop again.
        """
        t, begin = np.asarray(t, dtype=float), self.break_away
        if np.isinf(begin):
            return np.zeros_like(t)
        at_start = self.offset + self.rate * begin
        if at_start * self.rate < 0:
            raise NotThisMechanism("the load falls after the break-away; expected one that grows")
        net = self.offset + self.rate * t - np.sign(at_start) * self.bound
        return np.where(t > begin, net / self.inertia, 0.0)

    def displacement(self, t: np.ndarray) -> np.ndarray:
        """Return the way since the start at times t, m or rad: the acceleration is linear in time, the way cubic."""
        t, begin = np.asarray(t, dtype=float), self.break_away
        since = np.where(t > begin, t - begin, 0.0) if np.isfinite(begin) else np.zeros_like(t)
        first = float(self.acceleration(np.nextafter(begin, np.inf))) if np.isfinite(begin) else 0.0
        return first * since**2 / 2 + self.rate / self.inertia * since**3 / 6


@dataclass(frozen=True)
class MassesInSeries:
    """Two masses: the lower one on a fixed guide, the upper one on a guide along it, pushed by `rate` t from t = 0 on.

    `lower` and `upper` are the bounds of both guides, N, one for slip and rest. At rest both guides carry the whole
    push, so that the smaller bound gives way first. If it is that of the lower guide, both masses move as one with the
    acceleration (P - F_l)/(m_l + m_u), and the upper guide carries F_l and the inertia of the lower mass; if it is that
    of the upper guide, the lower one carries no more than that bound and holds for ever.
    """

    lower_mass: float
    upper_mass: float
    lower: float
    upper: float
    rate: float

    def break_aways(self) -> dict[str, float]:
        """Return the times at which the guides ``lower`` and ``upper`` begin to slip, s; inf for one that holds."""
        if self.upper < self.lower:
            return {"lower": np.inf, "upper": self.upper / self.rate}
        # F_l + m_l (P - F_l)/(m_l + m_u) = F_u
        total = self.lower_mass + self.upper_mass
        push = self.lower + (self.upper - self.lower) * total / self.lower_mass
        return {"lower": self.lower / self.rate, "upper": push / self.rate}
