"""Corner forces have the resultant F1 + F2 - F3 - F4 = R and the moment (a/2) (F2 + F4 - F1 - F3) = N; no corner pulls."""

import numpy as np
import pytest

from stiction import InputError, corner_forces, load_scene


def test_resultant_and_moment():
    guide = load_scene("slider-bar-case-1").guides["guide"]
    R, N = np.random.default_rng(1).normal(size=(2, 100))
    F1, F2, F3, F4 = corners = corner_forces(guide, R, N)
    assert (
        (corners >= 0).all() and (np.minimum(F1, F4) == 0).all() and (np.minimum(F2, F3) == 0).all()
    )
    np.testing.assert_allclose(F1 + F2 - F3 - F4, R, atol=1e-12)
    np.testing.assert_allclose(guide.length / 2 * (F2 + F4 - F1 - F3), N, atol=1e-12)


def test_a_guide_without_corners_is_refused():
    with pytest.raises(InputError, match="length"):
        corner_forces(
            load_scene("slider-bar-case-1").guides["guide"].model_copy(update={"length": None}),
            1.0,
            0.0,
        )
