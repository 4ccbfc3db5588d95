"""Coulomb's law on a slider in its guide: corner forces, bound of the friction, direction, stick.

Written once, for kernels and NumPy. The coefficients mu and mus are constant: neither depends on the speed (Stribeck).

The slider has length a and width b, its guide the surfaces (+) and (-), at levers -+b/2. R is the force of the guide's
normal row, T that of its angle row: the moment of normal forces and surface friction together. Both surfaces use the
coefficient kappa, so that the friction is kappa (N+ + N-); a guide that slips in direction d has kappa = -mu d. Eqs.
(1)-(2) and (26) of the paper then give, with its n_j = F+_j - F-_j (`stiction.reference_impl.paper`),

    N = T - (b/2) kappa R,    n_j = R/2 -+ N/a,    N+ + N- = |n1| + |n2| = max(|R|, (2/a) |N|)

and N+ + N- = |R| for a guide without length. The law as a complementarity, eqs. (4)-(7)
and (10)-(17), is in `hlcp.assemble`.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.multibody.guide_freedom import FREE


@kernel
def normal_load(guide, R, T, kappa):
    """Return N+ + N-, N."""
    if guide.length == 0.0:
        return abs(R)
    return max(abs(R), 2.0 / guide.length * abs(T - 0.5 * guide.width * kappa * R))


@kernel
def split_between_corners(R, N, length):
    """Return n1, n2 of a resultant R and a moment N of the normal forces; its `__wrapped__` is the same for arrays."""
    half = N / length
    return 0.5 * R - half, 0.5 * R + half


@kernel
def corner_forces(guide, R, T, kappa):
    """Return n1, n2 of a guide; of one without length R and 0, so that s1 n1 + s2 n2 is s1 R."""
    if guide.length == 0.0:
        return R, 0.0
    return split_between_corners(R, T - 0.5 * guide.width * kappa * R, guide.length)


@kernel
def sticks(m, slip, f):
    """Return True for a guide at rest whose friction is an unknown that holds it there.

    A guide that no freedom moves (`guide_freedom`) is at rest by its joints or drives. Its friction is not determined;
    zero is always within Coulomb's cone, and is what the equations take (`open_forces` says what a run reports).
    """
    return slip[f] == 0 and m.friction[f].freedom == FREE


@kernel
def coefficient(m, f, slip):
    """Coefficient of a slip: static for a guide that sticks, of `slip` 0; `mode_choice` decides which slip."""
    if slip[f] != 0:
        return m.friction[f].mu
    return m.friction[f].mus if m.friction[f].freedom == FREE else 0.0


@kernel
def capacity(m, f, R, T, d):
    """Return the largest static friction of (3) against a beginning slip in direction d, both surfaces mobilized."""
    guide = m.friction[f]
    return guide.mus * normal_load(guide, R, T, -guide.mus * d)


@kernel
def friction_coefficients(m, f, d, s1, s2, mu):
    """c_R, c_T of f = c_R R + c_T T: (3) for a guide that slips with a coefficient mu; `capacity` has that of stick."""
    guide = m.friction[f]
    k, a = -mu * d, guide.length
    if a == 0.0:
        return k * s1, 0.0
    lever = 0.5 * guide.width * mu * d
    across = k * (s2 - s1) / a
    return k * 0.5 * (s1 + s2) + across * lever, across


@kernel
def can_jam(m, f):
    """Return True if a guide at rest can jam under any load.

    The law lets the frictions f+, f- of its two surfaces differ, |f+-| <= mus N+-. With u = f+ - f- the moment of the
    normal forces is T - (b/2) u, N+ + N- = S(u) = max(|R|, (2/a)|T - (b/2) u|), N+ - N- = R, and the largest friction
    is max over u of mus S(u) - |u - mus R|. For mus b <= a that is at u = mus R, both surfaces fully mobilized
    (`capacity`). For mus b > a it grows with u without bound: the corners wedge, as a drawer's do. Where such a guide
    would break away or reverse it may as well stay at rest: its motion is not unique. Only there can `capacity` be
    below the kinetic friction.
    """
    return (
        m.friction[f].length > 0.0
        and m.friction[f].mus * m.friction[f].width > m.friction[f].length
    )


@kernel
def mobilization(guide, R, T, friction):
    """Return kappa of a guide at rest within its capacity, by bisection; see `equal_mobilization`."""
    low, high = -guide.mus, guide.mus
    for _ in range(60):
        kappa = 0.5 * (low + high)
        if kappa * normal_load(guide, R, T, kappa) < friction:
            low = kappa
        else:
            high = kappa
    return 0.5 * (low + high)


def equal_mobilization(R, T, friction, length, width):
    """Return the coefficient of friction in use, kappa = friction/(N+ + N-), equal on both surfaces.

    The split of a hyperstatic stick is not determined by rigid bodies; this one is continuous with
    break-away and equals the sliding friction while slipping. kappa is the root of smallest size of

        kappa max(|R|, (2/a)|T - (b/2) kappa R|) = friction

    (moment of surface friction: (b/2) kappa R). Where N+ + N- vanishes, 0. R, T and friction, (n,), are the resultant
    normal force (N), total moment (N m) and friction (N); length and width (m) are a and b, a 0 of a guide without.
    """
    R, T, friction = (np.asarray(x, dtype=float) for x in (R, T, friction))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # no candidate that is not finite is taken
        candidates = [friction / np.abs(R)]
        if length > 0.0:
            # kappa sigma (T - (b/2) kappa R) = friction a/2, sigma = +-1
            A, C = 0.5 * width * R, 0.5 * length * friction
            for sigma in (1.0, -1.0):
                discriminant = T * T - 4.0 * A * sigma * C
                root = T + np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), T)
                valid = discriminant >= 0.0
                candidates += [
                    np.where(valid, 2.0 * sigma * C / root, np.nan),
                    np.where(valid & (A != 0.0), root / (2.0 * A), np.nan),
                ]
        size = np.maximum(np.abs(friction), np.finfo(float).tiny)
        best = np.zeros_like(friction)
        found = np.full(friction.shape, np.inf)
        for kappa in candidates:
            load = np.abs(R)
            if length > 0.0:
                load = np.maximum(load, 2.0 / length * np.abs(T - 0.5 * width * kappa * R))
            good = (
                np.isfinite(kappa)
                & (np.abs(kappa * load - friction) <= 1e-9 * size)
                & (np.abs(kappa) < found)
            )
            best, found = np.where(good, kappa, best), np.where(good, np.abs(kappa), found)
    return np.where(friction == 0.0, 0.0, best)
