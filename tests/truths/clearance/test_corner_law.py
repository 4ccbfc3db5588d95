"""Law of the corners: closed forms of one corner, lost existence and uniqueness, and the law for random corners."""

import numpy as np
import pytest

from stiction.truths.clearance.corner_law import AT_REST, CornerState, solutions


def one_corner(response, free, mu):
    """All motions of one corner without slip velocity."""
    return solutions(np.array(response, float), np.array(free, float), mu, [AT_REST], [True])


def test_one_corner_sticks_slips_or_opens():
    mass_2 = np.diag([0.5, 0.5])
    ((stick, *_),) = one_corner(mass_2, [-3, 1], 0.5)
    assert stick.states == (CornerState.STICK,)
    np.testing.assert_allclose([stick.normal[0], stick.friction[0]], [6, -2], rtol=1e-14)
    ((slip, *_),) = one_corner(mass_2, [-3, 2], 0.5)
    assert slip.states == (CornerState.FORWARD,)
    np.testing.assert_allclose([slip.friction[0], slip.slip_rate[0]], [-3, 0.5], rtol=1e-14)
    ((back, *_),) = one_corner(mass_2, [-3, -2], 0.5)
    np.testing.assert_allclose([back.friction[0], back.slip_rate[0]], [3, -0.5], rtol=1e-14)
    ((away,),) = one_corner(mass_2, [3, 2], 0.5)
    assert away.states == (CornerState.OPEN,) and away.normal[0] == 0


def test_existence_and_uniqueness_are_lost_beyond_the_critical_coefficient():
    """A corner that slips forwards has xi = free_N + (D_NN - mu D_NT) N: with mu > D_NN/D_NT Painleve's paradox."""
    response, slips = (
        np.array([[1.0, 2.0], [2.0, 9.0]]),
        [(CornerState.FORWARD, CornerState.OPEN)],
    )
    for mu, pressed, lifted in ((0.49, 1, 1), (0.51, 0, 2)):
        assert len(solutions(response, np.array([-1.0, 0.0]), mu, slips, [False])) == pressed
        assert len(solutions(response, np.array([1.0, 0.0]), mu, slips, [False])) == lifted


@pytest.mark.parametrize("corners", [1, 2, 3, 4])
def test_random_corners_fulfil_the_law(corners):
    rng = np.random.default_rng(corners)
    for _ in range(60):
        rows = rng.normal(size=(2 * corners, 2 * corners))
        response, free = rows @ rows.T, rng.normal(size=2 * corners)
        mu = rng.uniform(0, 0.1)
        motions = solutions(response, free, mu, [AT_REST] * corners, [True] * corners)
        # the response is positive definite and friction small, so that there is exactly one motion as a rule
        assert motions
        for motion in motions:
            one = motion[0]
            reaction = np.concatenate([one.normal, one.friction])
            rate = np.concatenate([one.normal_rate, one.slip_rate])
            scale = np.abs(response).max() * max(1.0, np.abs(reaction).max())
            np.testing.assert_allclose(rate, free + response @ reaction, atol=1e-11 * scale)
            assert np.min(one.normal) >= -1e-8 and np.min(one.normal_rate) >= -1e-8
            np.testing.assert_allclose(one.normal * one.normal_rate, 0, atol=1e-8)
            assert np.all(np.abs(one.friction) <= mu * one.normal + 1e-8)
            # friction against slip, of full size
            np.testing.assert_allclose(
                one.friction * one.slip_rate, -mu * one.normal * np.abs(one.slip_rate), atol=1e-8
            )
