"""Checks of truths by their columns alone: derivatives, balances of forces and energy, laws of a guide's contact."""

import numpy as np


def cross(arm, force):
    return arm[0] * force[1] - arm[1] * force[0]


def vector(c, name):
    return np.array([c[f"{name}x"], c[f"{name}y"]])


def balance(scene, body, c):
    """m (a - g): the force that everything but gravity has to supply."""
    return scene.bodies[body].mass * (vector(c, f"{body}.a") - np.array(scene.gravity)[:, None])


def derivative(truth, t, name, h=1e-3):
    """Central difference of fourth order: error h^4/30 times the fifth derivative."""
    a, b, c, d = (truth(t + k * h)[name] for k in (-2, -1, 1, 2))
    return (a - 8 * b + 8 * c - d) / (12 * h)


def between_events(truth, n):
    """Instants whose central differences see no event and no end."""
    t = np.linspace(0, truth.t_end, n)
    others = np.array([0.0, truth.t_end, *(event.time for event in truth.events)])
    return t[np.min(np.abs(t[:, None] - others), axis=1) > 3e-3]


def check_derivatives(truth, pairs, n, atol):
    """Each second column is the rate of the first."""
    t = between_events(truth, n)
    for value, rate in pairs:
        np.testing.assert_allclose(derivative(truth, t, value), truth(t)[rate], atol=atol)


def quadrature(truth, order=40, pieces=8):
    """Instants and weights that integrate columns over time by Gauss-Legendre.

    Every interval between events is in `pieces` parts, so that no jump or kink lies within one.
    """
    x, w = np.polynomial.legendre.leggauss(order)
    ends = np.unique([0.0, *(event.time for event in truth.events), truth.t_end])
    ends = np.append(np.concatenate([np.linspace(a, b, pieces + 1)[:-1] for a, b in zip(ends, ends[1:])]), ends[-1])
    half, middle = np.diff(ends)[:, None] / 2, (ends[1:] + ends[:-1])[:, None] / 2
    return (middle + half * x).ravel(), (half * w).ravel()


def check_energy(truth, energy, power, atol):
    """The energy of the columns changes by the work of the forces, whose power is that of columns and time."""
    t, weight = quadrature(truth)
    first, last = (energy(truth(time))[0] for time in (0.0, truth.t_end))
    assert abs(last - first - power(truth(t), t) @ weight) < atol


def check_contact(c, guide, joint, atol):
    """Corner forces, Coulomb's law, equal mobilization and the moment of a guide."""
    F = np.array([c[f"{guide}.F{i}"] for i in (1, 2, 3, 4)])
    assert np.all(F >= 0) and np.all(F[0] * F[3] == 0) and np.all(F[1] * F[2] == 0)
    np.testing.assert_allclose(F[0] + F[1] - F[2] - F[3], c[f"{guide}.normal_force"], atol=atol)
    lower, upper = c[f"{guide}.friction_lower"], c[f"{guide}.friction_upper"]
    moment = joint.length / 2 * (F[1] - F[0] + F[3] - F[2]) + joint.width / 2 * (lower - upper)
    np.testing.assert_allclose(moment, c[f"{guide}.moment"], atol=atol)
    mode, friction, speed = (c[f"{guide}.{name}"] for name in ("mode", "friction", "slip_velocity"))
    load, slip = F.sum(axis=0), mode != 0
    np.testing.assert_allclose(friction[slip], (-joint.mu * mode * load)[slip], atol=atol)
    assert np.all(np.abs(friction) <= joint.mus * load + atol)
    assert np.all(mode * speed >= -1e-15)  # rounding at rest
    assert np.all(speed[~slip] == 0)
    # both surfaces carry friction in proportion to their load; 1e-11: products of forces up to 100 N
    np.testing.assert_allclose(lower * (F[2] + F[3]), upper * (F[0] + F[1]), atol=1e-11)
