"""One mass on a guide whose friction follows Stribeck's curve, by an independent equation with events.

The slip velocity w of the mass relative to its guide, which moves at the constant velocity u, obeys in slip

    m w' = F(t, x, x') - d (c + (c0 - c) exp(-(|w| / v_s)^p)) ,    x' = u + w ,    d = sgn w ,

with the bounds c of fast slip and c0 at rest, newton. At rest w = 0, as long as |F| <= c0. SciPy's DOP853 integrates
each phase; its events and Brent's method locate the ends of phases. Nothing here is code of the reference
implementation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

_RTOL = 1e-13
"""Relative tolerance of a step: near the rounding of the states."""
_ATOL = 1e-15
"""Absolute tolerance of a step, m and m/s, for motions of about a metre and a second."""
_STEP = 0.01
"""Longest step, s, so that no stop is stepped over in motions that take seconds."""
_SAMPLES = 400
"""Instants per second at which the force on a mass at rest is compared with its bound before the root is bracketed."""
_ROOT = 1e-15
"""Absolute tolerance of the time of a break-away, s: below its rounding."""

Load = Callable[[float, float, float], float]
"""The force along the guide, without friction, N, as a function of time (s), place (m) and velocity (m/s)."""


@dataclass(frozen=True)
class StribeckMass:
    """A mass on a straight guide.

    Attributes
    ----------
    load : callable
        Sum of the applied forces along the guide, N; see `Load`.
    kinetic, static : float
        Bounds of friction in fast slip and at rest, N.
    stribeck_velocity : float
        Speed scale of the curve, m/s.
    shape : float
        Exponent of the curve.
    mass : float
        Mass, kg.
    guide_velocity : float
        Velocity of the guide, m/s.
    """

    load: Load
    kinetic: float
    static: float
    stribeck_velocity: float
    shape: float = 1.0
    mass: float = 1.0
    guide_velocity: float = 0.0

    def bound(self, speed: float) -> float:
        """Return the bound of friction at a speed of slip, N; beyond a stop (negative speeds) that at rest."""
        relative = max(speed, 0.0) / self.stribeck_velocity
        return self.kinetic + (self.static - self.kinetic) * np.exp(-(relative**self.shape))

    def motion(
        self, x: float, v: float, t_end: float
    ) -> tuple[float, float, list[tuple[str, float]]]:
        """Return the place and the velocity at t_end (s), and the kinds and times of all events.

        `x` (m) and `v` (m/s) are those at t = 0.
        """
        t, events = 0.0, []
        direction = int(np.sign(v - self.guide_velocity))
        if direction == 0:
            direction = self._leaves(t, x)
        while t < t_end:
            if direction == 0:
                begin, direction = t, 1
                t = self._break_away(t, x, t_end)
                x += self.guide_velocity * (t - begin)
                v = self.guide_velocity
                if t < t_end:
                    direction = int(np.sign(self.load(t, x, v)))
                    events.append(("slip", t))
                continue
            t, x, v, stops = self._slip(t, x, v, direction, t_end)
            if stops:
                v = self.guide_velocity
                direction = self._leaves(t, x)
                events.append(("stick" if direction == 0 else "reversal", t))
        return x, v, events

    def _leaves(self, t: float, x: float) -> int:
        """Return the direction in which a mass without slip begins to slip at once; 0 if it rests."""
        force = self.load(t, x, self.guide_velocity)
        return int(np.sign(force)) if abs(force) > self.static else 0

    def _slip(
        self, t: float, x: float, v: float, direction: int, t_end: float
    ) -> tuple[float, float, float, bool]:
        """Return time, place and velocity at the end of a phase of slip, and whether the mass stops there."""

        def derivative(time: float, state: np.ndarray) -> list[float]:
            speed = direction * (state[1] - self.guide_velocity)
            force = self.load(time, state[0], state[1]) - direction * self.bound(speed)
            return [state[1], force / self.mass]

        def speed(_: float, state: np.ndarray) -> float:
            return direction * (state[1] - self.guide_velocity)

        speed.terminal = True  # type: ignore[attr-defined]
        speed.direction = -1  # type: ignore[attr-defined]
        solution = solve_ivp(
            derivative,
            (t, t_end),
            [x, v],
            method="DOP853",
            rtol=_RTOL,
            atol=_ATOL,
            max_step=_STEP,
            events=speed,
        )
        return solution.t[-1], *solution.y[:, -1], solution.status == 1

    def _break_away(self, t: float, x: float, t_end: float) -> float:
        """Return the time at which a mass at rest begins to slip, or t_end."""

        def excess(time: float) -> float:
            place = x + self.guide_velocity * (time - t)
            return abs(self.load(time, place, self.guide_velocity)) - self.static

        times = np.linspace(t, t_end, 2 + int(_SAMPLES * (t_end - t)))
        for before, after in zip(times[:-1], times[1:]):
            if excess(after) > 0.0:
                return (
                    float(brentq(excess, before, after, xtol=_ROOT))
                    if excess(before) < 0
                    else before
                )
        return t_end
