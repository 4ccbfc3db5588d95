"""Creep that follows from a law of friction which is zero at rest: closed forms, to be found in runs with that law.

A law f = mu N g(v) with g(0) = 0 holds no load at rest. Under a steady load of part p of mu N a slider creeps with
v = g^-1(p), whatever mu is and however N is shared by its contacts: so the first two functions, while the last two
need n like contacts. Only an engine whose g jumps at 0, or has memory as bristles have, holds. Parts are of [0, 1), all
other arguments and the results in SI units.
"""

from __future__ import annotations

from math import sqrt


def linear_zone(part: float, zone: float) -> float:
    """Return p zone, of g = v/zone (Exudyn's ``frictionProportionalZone``)."""
    return part * zone


def soft_norm(part: float, tolerance: float) -> float:
    """Return p e/sqrt(1 - p^2), of g = v/sqrt(v^2 + e^2): Drake's "lagged", "similar" and continuous contacts.

    Its e is ``stiction_tolerance`` or, in discrete steps, `near_rigid_friction` of the bound mu N if that is more
    (Castro, Han & Masterjohn 2023, "A theory of irrotational contact fields").
    """
    return tolerance * part / sqrt(1.0 - part * part)


def near_rigid_friction(load: float, contacts: int, *, inverse_mass: float, step: float) -> float:
    """Return 1e-3 w h F/n: Drake's "sap" contacts.

    Friction is regularized by R = 1e-3 w, v = R times the impulse h F/n of one of n contacts, with `inverse_mass` w =
    |W|/3, 1/kg, W the 3 x 3 block of J M^-1 J' (Castro, Permenter & Han 2022, "An unconstrained convex formulation of
    compliant contact", Sec. V).
    """
    return 1e-3 * inverse_mass * step * load / contacts


def convex_contact(load: float, contacts: int, *, inverse_mass: float, impedance: float, damping: float,
                   impratio: float) -> float:
    """Return (1/d - 1) a F/(n b r): MuJoCo's contacts with elliptic cones.

    Its law is x = accel - aref + R f, and zero inside of the cone, with aref = -b v and R = (1/d - 1) a/r across the
    normal (manual, "Constraint model": solver parameters, ``impratio``). At rest accel = 0, and n contacts share F.

    Parameters
    ----------
    inverse_mass
        Of a contact along its normal, 1/kg: J M^-1 J' with ``diagexact``, else MuJoCo's estimate of it.
    damping
        Of friction, 1/s: ``solreffriction``, or 2/(dmax timeconst) of a critically damped ``solref``.
    """
    return (1.0 / impedance - 1.0) * inverse_mass * load / (contacts * damping * impratio)
