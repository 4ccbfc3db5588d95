"""Where rigid bodies with Coulomb friction have no motion, or several: closed forms (Painleve 1895).

Slider-bar. Along the guide  f(x'') = m x'' + mu s N(x'') = P,  N = max(|R|, |A - B x''|), with s = sgn x' and

    A = (2/a) (c g cos th + (b/2) mu s R),  B = (2/a) c sin th,  c = m1 L/2 ,

R and P independent of x''. f grows for every x'' exactly while mu |B| < m, that is while |sin th| < m a/(mu m1 L); beyond, it is convex
(s = 1) or concave (s = -1), and has two solutions or none.

Sliding rod. See the scene ``painleve-rod`` for p(th), whose sign decides.
"""

from __future__ import annotations

import numpy as np

from stiction.comparisons.truth.reduced.slider_bar import SliderBar


def critical_bar_angle(mechanism: SliderBar) -> float:
    """The smallest angle of the bar, rad, from which on the slip of a slider-bar has two motions or none.

    Raises
    ------
    ValueError
        If there is none, mu being below m a/(m1 L), or no length of the slider.
    """
    contact = mechanism.contact
    sine = mechanism.mass * (contact.length or np.inf) / (2 * mechanism.c * contact.mu)
    if not sine <= 1:
        raise ValueError(f"sin th = {sine:g}; expected mu > m a/(m1 L)")
    return float(np.arcsin(sine))


def slip_accelerations(mechanism: SliderBar, t: float, x: float, v: float) -> list[float]:
    """All x'', ascending, that solve the equation of slip of a slider-bar at velocity v != 0."""
    contact, s, m = mechanism.contact, np.sign(v), mechanism.mass
    R, P, th = mechanism.normal(t), float(mechanism.applied(t, x, v)), mechanism.theta(t)
    A = 2 / contact.length * (mechanism.c * mechanism.g * np.cos(th) + contact.width / 2 * contact.mu * s * R)
    B = 2 / contact.length * mechanism.c * np.sin(th)
    found = [a for a in [(P - contact.mu * s * abs(R)) / m] if abs(A - B * a) <= abs(R)]
    for sigma in (1, -1):  # the sign of A - B x''
        a = (P - contact.mu * s * sigma * A) / (m - contact.mu * s * sigma * B)
        if sigma * (A - B * a) > abs(R):
            found.append(a)
    return sorted(map(float, found))


def rod_critical_friction(eta: float = 0.0) -> float:
    """The friction coefficient below which a uniform rod has one motion at every angle: 4/3 at eta = 0.

    (4/3) sqrt((1 + eta)(1 + 4 eta)), with eta the mass of the slider at its end by its own: the least value over th
    of (1 + 3 cos^2 th + 4 eta)/(3 |sin th cos th|), reached at tan^2 th = (4 + 4 eta)/(1 + 4 eta).
    """
    return 4 / 3 * float(np.sqrt((1 + eta) * (1 + 4 * eta)))


def rod_critical_angles(mu: float, eta: float = 0.0) -> tuple[float, float]:
    """The angles, rad, between which p(th) < 0: the roots of (1 + 4 eta) u^2 - 3 mu u + 4 + 4 eta = 0, u = tan th.

    Raises
    ------
    ValueError
        If mu is below the critical coefficient.
    """
    roots = np.roots([1 + 4 * eta, -3 * mu, 4 + 4 * eta])
    if np.iscomplexobj(roots):
        raise ValueError(f"mu = {mu:g}; expected at least {rod_critical_friction(eta):g}")
    low, high = np.sort(np.arctan(roots))
    return float(low), float(high)
