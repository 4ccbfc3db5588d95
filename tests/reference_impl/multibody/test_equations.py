"""Equations of a scene at an instant against Lagrange's, which differences of positions and energies give."""

import numpy as np
import pytest

import stiction
from stiction import InputError, corner_forces, equations_of_motion, load_scene

EPS = 1e-6
SCENES = ["slider-bar-case-1", "elliptic-trammel", "slider-crank", "slider-on-moving-guide", "coulomb-oscillator"]


@pytest.mark.parametrize("name", SCENES)
def test_derivatives_of_the_constraints(name):
    """J is dPhi/dq and Phi' = J v + dPhi/dt; Phi'' = J v' + gamma along the parabola q + v s + a s^2/2."""
    scene, rng = load_scene(name), np.random.default_rng(5)
    n = 3 * len(scene.bodies)
    q, v, a = rng.normal(size=(3, n))
    t = 0.3
    at = equations_of_motion(scene, t, q, v)
    J = np.array([(equations_of_motion(scene, t, q + EPS * e, v).Phi - equations_of_motion(scene, t, q - EPS * e, v).Phi)
                  / (2 * EPS) for e in np.eye(n)]).T.reshape(at.J.shape)
    np.testing.assert_allclose(at.J, J, atol=1e-8)

    def along(s):
        return equations_of_motion(scene, t + s, q + v * s + a * s ** 2 / 2, v + a * s)

    ahead, behind = along(EPS), along(-EPS)
    np.testing.assert_allclose(at.Phi_dot, (ahead.Phi - behind.Phi) / (2 * EPS), atol=1e-7)
    np.testing.assert_allclose(at.J @ a + at.gamma, (ahead.Phi_dot - behind.Phi_dot) / (2 * EPS), atol=1e-6)
    np.testing.assert_allclose(at.W_T.T @ v, at.slip_velocity, atol=1e-12)  # guides that do not turn by a law


def test_the_solution_of_the_equations_is_the_acceleration_of_the_reference():
    scene = load_scene("slider-bar-case-1")
    run = stiction.load_engine("reference").simulate(scene, t_end=1.0)
    names = equations_of_motion(scene, 0.0, np.zeros(6), np.zeros(6)).coordinates
    rates = [name.replace(".x", ".vx").replace(".y", ".vy").replace(".angle", ".omega") for name in names]
    second = [name.replace(".x", ".ax").replace(".y", ".ay").replace(".angle", ".alpha") for name in names]
    row = 70
    q, v, a = (np.array([run[name][row] for name in part]) for part in (names, rates, second))
    e = equations_of_motion(scene, run.t[row], q, v)
    multipliers = np.array([run[name][row] for name in e.rows])
    frictions = np.array([run[f"{guide}.friction"][row] for guide in e.guides])
    np.testing.assert_allclose(e.M @ a, e.Q + e.J.T @ multipliers + e.W_T @ frictions, atol=1e-8)


def test_corner_forces_have_the_resultant_and_the_moment():
    guide = load_scene("slider-bar-case-1").guides["guide"]
    R, N = np.random.default_rng(1).normal(size=(2, 100))
    F1, F2, F3, F4 = corners = corner_forces(guide, R, N)
    assert (corners >= 0).all() and (np.minimum(F1, F4) == 0).all() and (np.minimum(F2, F3) == 0).all()
    np.testing.assert_allclose(F1 + F2 - F3 - F4, R, atol=1e-12)
    np.testing.assert_allclose(guide.length / 2 * (F2 - F3 - F1 + F4), N, atol=1e-12)


def test_states_of_another_shape_are_refused():
    with pytest.raises(InputError, match="6"):
        equations_of_motion(load_scene("slider-bar-case-1"), 0.0, np.zeros(5), np.zeros(6))
    with pytest.raises(InputError, match="length"):
        corner_forces(load_scene("slider-bar-case-1").guides["guide"].model_copy(update={"length": None}), 1.0, 0.0)
