"""Checks of truths by their columns alone: rates, balances of forces, laws of a guide's contact; and two scenes that no catalogue has."""

import copy

import numpy as np
from reference_checks import MOTION, balance_residual

from stiction.scenes import load_scene, scene_from_dict, vary


def rocking_trammel(**changes):
    """The catalogue's trammel from rest, with a spring and a sine force, so that it comes to rest again and again."""
    raw = copy.deepcopy(
        vary(
            load_scene("elliptic-trammel"), {"w": 0, "T": 0, "mu": 0.1, "mus": 0.15, **changes}
        )._raw
    )
    raw["springs"] = {
        "spring": {
            "type": "linear",
            "bodies": ["slider-x", "ground"],
            "axis": [1, 0],
            "stiffness": 40,
        }
    }
    raw["forces"]["load"] = {
        "type": "force",
        "body": "slider-x",
        "direction": [1, 0],
        "law": {"type": "sine", "amplitude": 10, "frequency": 4},
    }
    return scene_from_dict(raw, "rocking")


def driven_arm():
    """The arm of the catalogue, turned by a motor instead of swinging."""
    raw = copy.deepcopy(load_scene("slider-on-moving-guide", {"w": 2.0})._raw)
    raw["drives"] = {
        "motor": {
            "type": "angle",
            "bodies": ["arm", "ground"],
            "law": {"type": "linear", "offset": "phi", "rate": "w"},
        }
    }
    del raw["springs"]["twist"]
    return scene_from_dict(raw, "driven arm")


def check_newton_and_euler(scene, truth, rtol=1e-12):
    """By the dense equations of motion, which the truths share nothing with; what has no column does not move."""
    t = np.linspace(0, truth.t_end, 1001)
    still = {
        f"{body}.{label}": np.full(len(t), value)
        for body, start in scene.bodies.items()
        for label, value in zip(MOTION, (*start.position, start.angle, *np.zeros(6)))
    }
    assert (
        balance_residual(scene, t, still | truth(t)) < rtol
    )  # rounding, relative to the largest force


def check_motion(scene, truth, atol):
    """Velocities and accelerations are rates, and no state jumps at an event."""
    columns = truth(0.0)
    pairs = [
        (f"{body}.{one}", f"{body}.{other}")
        for body in scene.bodies
        for k in range(6)
        for one, other in [(MOTION[k], MOTION[k + 3])]
    ]
    check_derivatives(truth, [pair for pair in pairs if set(pair) <= columns.keys()], 1500, atol)
    for event in truth.events:
        for body in scene.bodies:
            for name in (f"{body}.{label}" for label in MOTION[:6]):
                assert abs(event.jump(name)) < 1e-12 if name in columns else True, name


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
