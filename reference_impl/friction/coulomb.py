"""Coulomb's law on a slider in its guide: corner forces, load, coefficients and capacity at rest.

The functions are kernels, which the solvers call for one guide at a time. Two serve the columns of
a trajectory as well, for arrays of samples: `split_between_corners` by its `__wrapped__`, and
`equal_mobilization`, which is written in NumPy. The coefficients mu (slip) and mus (rest) are
constant: neither depends on the speed, as Stribeck's would.

The slider has length a and width b. Its guide has a lower surface (+) at the lever -b/2 and an
upper surface (-) at b/2. The symbols used throughout are

==========  =======================================================================================
bound       constant part of the bound of friction in slip (newton): `friction` of a scene
static      the same at rest: `static_friction`
R           force of the normal row of the guide (newton): resultant of its normal forces
T           force of its angle row (newton metre): moment of normal forces and surface friction
N+, N-      normal forces of the two surfaces (newton); the load is their sum
M           moment of the normal forces alone (newton metre)
n1, n2      normal forces at the rear and the front corners (newton), n_j = F+_j - F-_j: positive
            where the lower surface carries, negative where the upper does
s1, s2      signs of n1 and n2
kappa       coefficient of friction in use, with its sign: friction = kappa (N+ + N-) without a bound
d           direction of a slip, 1 or -1; a guide that slips has kappa = -mu d
==========  =======================================================================================

Both surfaces use the same kappa. Eqs. (1)-(2) and (26) of the paper
(`stiction.reference_impl.paper`) then give

    M = T - (b/2) kappa R,    n_j = R/2 -+ M/a,    N+ + N- = |n1| + |n2| = max(|R|, (2/a) |M|)

and N+ + N- = |R| for a guide without length. `hlcp.assemble` has the law as a complementarity,
eqs. (4)-(7) and (10)-(17).

Beyond the paper, friction has a constant bound beside, or instead of, that by the load:

    slip: friction = -d (bound + mu (N+ + N-)),    rest: |friction| <= static + mus (N+ + N-)

The constant part is shared equally by both surfaces, so that it turns no slider: the moments above
hold unchanged. At rest the part rho in use, from -1 to 1, is that of both bounds, kappa = rho mus,
and friction = rho (static + mus (N+ + N-)) = kappa (static/mus + N+ + N-): as if the load were
larger by static/mus. A pin has a constant bound alone, and mu = mus = 0; so has a guide without a
coefficient.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.multibody.guide_freedom import FREE

_HALVINGS = 60
"""Halvings of a bracket of kappa: 2^-60 of its width is below the rounding of its ends."""
_ROOT_TOLERANCE = 1e-9
"""Part of the friction by which a candidate may miss the equation with absolute values.

The root of smallest size is wrong by some roundings only. A root of the wrong sign or branch is
wrong by about the friction itself, unless it is next to a right one."""


@kernel
def normal_load(guide, R, T, kappa):
    """Return the load N+ + N- of a guide (newton) if its surfaces use the coefficient kappa."""
    if guide.length == 0.0:
        return abs(R)
    return max(abs(R), 2.0 / guide.length * abs(T - 0.5 * guide.width * kappa * R))


@kernel
def split_between_corners(R, M, length):
    """Return n1 and n2 of a resultant R and a moment M of the normal forces.

    Its `__wrapped__` takes arrays as well.
    """
    half = M / length
    return 0.5 * R - half, 0.5 * R + half


@kernel
def corner_forces(guide, R, T, kappa):
    """Return n1 and n2 of a guide whose surfaces use the coefficient kappa.

    A guide without length has R and 0, so that s1 n1 + s2 n2 is s1 R.
    """
    if guide.length == 0.0:
        return R, 0.0
    return split_between_corners(R, T - 0.5 * guide.width * kappa * R, guide.length)


@kernel
def sticks(m, slip, f):
    """Return True for a guide at rest whose friction is an unknown that holds it there.

    A guide that no freedom moves (`guide_freedom`) is at rest by its joints or drives. Its friction
    is not determined. Zero is always within Coulomb's cone, and the equations take it
    (`open_forces` says what a run reports).
    """
    return slip[f] == 0 and m.friction[f].freedom == FREE


@kernel
def coefficient(m, f, slip):
    """Return the coefficient of friction of a guide: mu in slip, mus where it sticks, else 0.

    A guide sticks where its `slip` is 0 and its joints and drives leave it free; `mode_choice`
    decides which slip a guide has.
    """
    if slip[f] != 0:
        return m.friction[f].mu
    if m.friction[f].freedom == FREE:
        return m.friction[f].mus
    return 0.0


@kernel
def constant_bound(m, f, slip):
    """Return the constant part of the bound: that of slip, that of rest where the guide sticks, else 0.

    It is the counterpart of `coefficient`.
    """
    if slip[f] != 0:
        return m.friction[f].bound
    if m.friction[f].freedom == FREE:
        return m.friction[f].static_bound
    return 0.0


@kernel
def capacity(m, f, R, T, d):
    """Return the largest static friction of (3) against a slip that begins in direction d (newton).

    Both surfaces are fully mobilized. `can_jam` tells where the law allows more.
    """
    guide = m.friction[f]
    return guide.static_bound + guide.mus * normal_load(guide, R, T, -guide.mus * d)


@kernel
def friction_coefficients(m, f, d, s1, s2, mu):
    """Return c_R and c_T of the friction c_R R + c_T T of a guide that slips, eq. (3).

    The constant part of the friction, -d times the bound, is left to the caller. They follow from
    friction = kappa (s1 n1 + s2 n2), which is linear in R and T once the signs of the corner forces
    are known. With mus in place of mu, they are those of the `capacity`.

    Parameters
    ----------
    m : Arrays
        The mechanism.
    f : int
        Number of the guide among those with friction.
    d : int
        Direction of the slip, 1 or -1.
    s1, s2 : int
        Signs assumed for n1 and n2, 1 or -1. A guide without length uses s1 only.
    mu : float
        Coefficient of friction.

    Returns
    -------
    c_R, c_T : float
        Friction per resultant R (no unit) and per moment T (1/m).
    """
    guide = m.friction[f]
    kappa = -mu * d
    if guide.length == 0.0:
        return kappa * s1, 0.0
    lever = 0.5 * guide.width * mu * d
    across = kappa * (s2 - s1) / guide.length
    return kappa * 0.5 * (s1 + s2) + across * lever, across


@kernel
def can_jam(m, f):
    """Return True if a guide at rest can jam under any load.

    The law lets the frictions f+, f- of the two surfaces differ: |f+| <= mus N+, |f-| <= mus N-.
    With u = f+ - f-, the moment of the normal forces is T - (b/2) u. Hence

        N+ + N- = S(u) = max(|R|, (2/a) |T - (b/2) u|),    N+ - N- = R

    and the largest friction is the maximum over u of mus S(u) - |u - mus R|. For mus b <= a the
    maximum is at u = mus R, where both surfaces are fully mobilized (`capacity`). For mus b > a it
    grows with u without bound: the corners wedge, as a drawer's do. Where such a guide would break
    away or reverse it may as well stay at rest: its motion is not unique. Only there can `capacity`
    be below the kinetic friction.
    """
    return _wedges(m.friction[f])


@kernel
def _wedges(guide):
    """Return True for a guide with mus b > a: its friction can raise its own load without bound."""
    return guide.length > 0.0 and guide.mus * guide.width > guide.length


@kernel
def mobilization(guide, R, T, friction):
    """Return the kappa that `equal_mobilization` defines for a guide at rest, within -mus .. mus.

    The friction must be within the `capacity`, but for rounding: -mus or mus is returned beyond it.

    The friction carried, kappa (N0 + N+ + N-) with N0 = static/mus, is bisected. It grows with
    kappa where mus b <= a, so that there is one root. A guide that wedges can have three, as its
    load falls with kappa before it grows. The friction by its moment,
    kappa (N0 + (2/a) |T - (b/2) kappa R|), has a peak at kappa = (T +- (a/2) N0) / (b R), with the
    sign of T, if that is before the zero of the moment, 2 T / (b R). Below the peak both terms of
    the friction grow. Beyond it the friction by the moment reaches the height of the peak again
    only once it grows for good. So the root of smallest size is below the peak if the friction
    carried there is large enough, and the only crossing beyond it if not.
    """
    if guide.mus == 0.0:
        return 0.0
    low = -guide.mus
    high = guide.mus
    extra = guide.static_bound / guide.mus

    # cut the bracket of a guide that wedges at the peak, if that is on the side of the friction
    if _wedges(guide) and R != 0.0:
        lever = 0.5 * guide.length * extra
        peak = (T + (lever if T > 0.0 else -lever)) / (guide.width * R)
        if peak * friction > 0.0 and abs(peak) < guide.mus and lever < abs(T):
            carried = abs(peak) * (extra + normal_load(guide, R, T, peak))
            root_is_below_peak = carried >= abs(friction)
            if root_is_below_peak == (friction > 0.0):
                high = peak
            else:
                low = peak

    for _ in range(_HALVINGS):
        kappa = 0.5 * (low + high)
        if kappa * (extra + normal_load(guide, R, T, kappa)) < friction:
            low = kappa
        else:
            high = kappa
    return 0.5 * (low + high)


def equal_mobilization(
    R: np.ndarray,
    T: np.ndarray,
    friction: np.ndarray,
    length: float,
    width: float,
    extra: float = 0.0,
) -> np.ndarray:
    """Return the coefficient of friction in use at rest, kappa, where it is equal on both surfaces.

    Rigid bodies do not determine how the two surfaces share the friction of a guide at rest. This
    share is continuous with break-away, and that of a guide that slips. Where several kappa carry
    the friction, that of smallest size is taken: the one reached as the friction grows from zero.

    Parameters
    ----------
    R : ndarray, shape (n,)
        Resultant normal force, newton.
    T : ndarray, shape (n,)
        Moment of normal forces and surface friction, newton metre.
    friction : ndarray, shape (n,)
        Friction of both surfaces together, newton.
    length : float
        Length a of the slider, m; 0 for a guide without length.
    width : float
        Width b of the slider, m.
    extra : float
        Load N0 as which a constant bound counts, static/mus, newton.

    Returns
    -------
    ndarray, shape (n,)
        The root kappa of smallest size of

            kappa (N0 + max(|R|, (2/a) |T - (b/2) kappa R|)) = friction

        and 0 without friction or without any load (R, T and N0 zero). There is a root for every other
        finite force; NaN where a force is not finite, or where floating-point numbers overflow.
    """
    R, T, friction = (np.asarray(force, dtype=float) for force in (R, T, friction))
    tolerance = _ROOT_TOLERANCE * np.maximum(np.abs(friction), np.finfo(float).tiny)
    smallest = np.full(friction.shape, np.nan)
    size = np.full(friction.shape, np.inf)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for kappa in _candidates(R, T, friction, length, width, extra):
            load = np.abs(R)
            if length > 0.0:
                load = np.maximum(load, 2.0 / length * np.abs(T - 0.5 * width * kappa * R))
            load = extra + load
            is_root = np.isfinite(kappa) & (np.abs(kappa * load - friction) <= tolerance)
            is_better = is_root & (np.abs(kappa) < size)
            smallest = np.where(is_better, kappa, smallest)
            size = np.where(is_better, np.abs(kappa), size)

    has_no_load = (R == 0.0) & (extra == 0.0)
    if length > 0.0:
        has_no_load &= T == 0.0
    return np.where((friction == 0.0) | has_no_load, 0.0, smallest)


def _candidates(
    R: np.ndarray, T: np.ndarray, friction: np.ndarray, length: float, width: float, extra: float
) -> Iterator[np.ndarray]:
    """Yield what kappa of `equal_mobilization` is if its absolute values are replaced by signs.

    Candidates may be infinite or NaN; the caller ignores division by zero and invalid operations.
    """
    # the load is |R|
    yield friction / (extra + np.abs(R))
    if length == 0.0:
        return

    # The load is sign (2/a) (T - (b/2) kappa R), so that with T0 = T + sign (a/2) N0
    #     (b/2) R kappa^2 - T0 kappa + sign (a/2) friction = 0.
    # The root of larger size adds numbers of one sign. The other is the product of both roots over
    # it, so that nothing cancels there either.
    quadratic = 0.5 * width * R
    product = 0.5 * length * friction
    for sign in (1.0, -1.0):
        linear = T + sign * 0.5 * length * extra
        discriminant = linear * linear - 4.0 * quadratic * sign * product
        is_real = discriminant >= 0.0
        numerator = linear + np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), linear)
        yield np.where(is_real, 2.0 * sign * product / numerator, np.nan)
        yield np.where(is_real & (quadratic != 0.0), numerator / (2.0 * quadratic), np.nan)
