"""Coulomb's law of one guide: the coefficient in use at rest."""

import numpy as np
import pytest

from stiction.reference_impl.friction.coulomb import (
    capacity,
    equal_mobilization,
    mobilization,
    normal_load,
)
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import scene_from_dict

DRAWS = 400
"""Loads that are drawn for each guide."""
PARTS = np.linspace(0.0, 0.999, 200)
"""Parts of kappa at which less friction must be carried than at kappa."""


def slider(length, width, mus):
    """Arrays of a slider on a level guide; length None for a guide without corners."""
    guide = {"type": "translational", "slider": "slider", "mu": 0.8 * mus, "mus": mus}
    if length is not None:
        guide |= {"length": length, "width": width}
    return Mechanism(
        scene_from_dict(
            {
                "t_end": 1.0,
                "gravity": [0, -9.81],
                "bodies": {"slider": {"mass": 1.0, "inertia": 0.1}},
                "joints": {"guide": guide},
            },
            "slider",
        )
    ).arrays


@pytest.mark.parametrize("length", [None, 0.05, 0.2, 0.3425, 0.6])
@pytest.mark.parametrize("width", [0.0, 0.2, 0.9822, 3.0])
@pytest.mark.parametrize("mus", [0.1, 0.4, 1.396])
def test_the_solver_and_the_columns_mobilize_a_guide_at_rest_alike(length, width, mus):
    """Both take the smallest kappa that carries the friction, also where a wide guide has three."""
    m = slider(length, width, mus)
    guide = m.friction[0]
    rng = np.random.default_rng([int(1e4 * mus), int(1e4 * width), int(1e4 * (length or 0.0))])
    R, T = rng.normal(size=(2, DRAWS)) * [[1.0], [0.5]] * 10.0 ** rng.uniform(-3, 3, DRAWS)
    R[:20] = 0.0
    T[20:40] = 0.0
    part = rng.uniform(-1.0, 1.0, DRAWS)
    for i in range(DRAWS):
        # friction acts against the slip: at full mobilization it is the capacity
        direction = -np.sign(part[i])
        friction = part[i] * capacity(m, 0, R[i], T[i], direction)
        kappa = mobilization(guide, R[i], T[i], friction)
        if friction == 0.0:  # a guide without length or moment carries nothing where R is zero
            continue
        assert kappa * normal_load(guide, R[i], T[i], kappa) == pytest.approx(friction, rel=1e-9)
        assert abs(kappa) <= mus
        for less in PARTS * kappa:
            assert abs(less * normal_load(guide, R[i], T[i], less)) <= abs(friction) * (1 + 1e-9)
        (column,) = equal_mobilization(
            R[i : i + 1], T[i : i + 1], np.array([friction]), length or 0.0, width
        )
        assert kappa == pytest.approx(column, rel=1e-9)


def test_a_guide_that_wedges_takes_the_smallest_of_three_roots():
    """Its load falls with kappa before it grows: roots at -0.3887, -0.6724 and -0.7495."""
    m = slider(0.3425, 0.9822, 1.396)
    R, T, friction = 0.5672, -0.29557, -0.42513
    # (b/2) R kappa^2 - T kappa - (a/2) |friction| = 0 on the branch of negative T - (b/2) kappa R
    smallest = np.roots([0.5 * 0.9822 * R, -T, 0.5 * 0.3425 * -friction]).max()
    assert smallest == pytest.approx(-0.3887, abs=1e-4)
    assert mobilization(m.friction[0], R, T, friction) == pytest.approx(smallest, rel=1e-12)
    columns = equal_mobilization(np.array([R]), np.array([T]), np.array([friction]), 0.3425, 0.9822)
    assert columns[0] == pytest.approx(smallest, rel=1e-12)


def test_a_coefficient_that_cannot_be_known_is_nan():
    """Forces that are not finite have none; without friction, or without any load, it is zero."""
    R = np.array([np.nan, np.inf, 2.0, 0.0, 2.0])
    T = np.array([1.0, 1.0, np.nan, 0.0, 1.0])
    friction = np.array([0.1, np.inf, 0.1, 0.1, 0.0])
    found = equal_mobilization(R, T, friction, 0.5, 0.3)
    np.testing.assert_array_equal(found, [np.nan, np.nan, np.nan, 0.0, 0.0])
