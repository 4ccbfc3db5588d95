"""Steady states of a mass on a spring with dry friction in closed form; the motion to them: `oscillator.py`.

Mass on a belt (mus > mu). A spring k holds a mass m that rests with normal force N on a belt of speed v0;
D = (mus - mu) N, w = sqrt(k/m). In stick the spring is stretched at the rate v0 from (mu N - D)/k to (mu N + D)/k; in
slip the mass swings about mu N / k, from displacement D/k and velocity v0 until its velocity is v0 again.

Forced oscillator without stops. J. P. Den Hartog, Forced vibrations with combined Coulomb and viscous friction,
Trans. ASME 53 (1931), APM-53-9; scaled with wn = 1, P/k = 1, b = mu N / P, r = Omega / wn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar


@dataclass(frozen=True)
class StickSlipCycle:
    """The steady cycle: seconds of stick and of slip, and amplitude (m) of the swing about mu N / k."""

    stick_time: float
    slip_time: float
    amplitude: float


def stick_slip_cycle(mass: float, stiffness: float, speed: float, mu: float, mus: float,
                     normal: float) -> StickSlipCycle:
    """Return the cycle: 2 D/(k v0), (2/w)(pi - arctan(w D/(k v0))), sqrt((D/k)^2 + (v0/w)^2).

    ValueError is raised without mus > mu or a moving belt: there is no cycle.
    """
    if not (mus > mu >= 0 and speed != 0):
        raise ValueError(f"found mu = {mu:g}, mus = {mus:g}, speed = {speed:g}; "
                         "a cycle needs mus > mu and a moving belt")
    w, stretch = np.sqrt(stiffness / mass), (mus - mu) * normal / stiffness
    v0 = abs(speed)
    return StickSlipCycle(float(2 * stretch / v0), float(2 / w * (np.pi - np.arctan(w * stretch / v0))),
                          float(np.hypot(stretch, v0 / w)))


def non_stop_peak(r: float, b: float) -> float:
    """Return the largest displacement over P/k of the steady motion without stops: sqrt(V^2 - b^2 U^2).

    Valid for r > 0 except 1 and 1/n with odd n (poles of V and U) and b up to `non_stop_limit`; else a ValueError. At
    r = 1/n with even n, U = 0 and the peak does not depend on b.
    """
    limit = non_stop_limit(r)
    if not 0 <= b <= limit:
        raise ValueError(f"b: found {b:g}; a motion without stops at r = {r:g} exists for 0 <= b <= {limit:.6g}")
    V, U = _response(r)
    return float(np.sqrt(V * V - b * b * U * U))


def non_stop_limit(r: float) -> float:
    """Return the largest b = mu N / P for which the steady motion has no stops: |V| / sqrt(U^2 + (S / r^2)^2).

    S = max over 0 < s < pi of [r sin(s/r) + U r^2 (cos s - cos(s/r))] / sin s, whose limits are 1 at 0, where the
    motion reverses, and -1 at pi. ValueError is raised where V or U has a pole: r <= 0, r = 1 and r = 1/n with odd n.
    """
    V, U = _response(r)

    def quotient(s: np.ndarray) -> np.ndarray:
        return (r * np.sin(s / r) + U * r * r * (np.cos(s) - np.cos(s / r))) / np.sin(s)

    grid = np.linspace(0, np.pi, 4001)[1:-1]
    best = int(np.argmax(quotient(grid)))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    peak = minimize_scalar(lambda s: -quotient(s), bounds=bounds, method="bounded", options={"xatol": 1e-10})
    S = max(-peak.fun, 1.0)
    return float(abs(V) / np.sqrt(U * U + (S / (r * r)) ** 2))


def _response(r: float) -> tuple[float, float]:
    if not (r > 0 and abs(r - 1) > 1e-9 and abs(1 + np.cos(np.pi / r)) > 1e-12):
        raise ValueError(f"r: found {r:g}; expected a positive ratio other than 1 and 1/n with odd n")
    return 1 / (1 - r * r), np.sin(np.pi / r) / (r * (1 + np.cos(np.pi / r)))
