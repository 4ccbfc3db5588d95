"""The stored coefficients of DOP853 are those of SciPy, bit for bit, and those of a Runge-Kutta method of its order."""

import numpy as np
import pytest
from scipy.integrate import DOP853

from stiction.reference_impl.integration import dop853

S = dop853.STAGES


@pytest.mark.parametrize(
    "name, published",
    [
        ("A", np.vstack([DOP853.A[:S, :S], DOP853.B])),
        ("C", np.append(DOP853.C[:S], 1.0)),
        ("E3", DOP853.E3),
        ("E5", DOP853.E5),
        ("A_EXTRA", DOP853.A_EXTRA),
        ("C_EXTRA", DOP853.C_EXTRA),
        ("D", DOP853.D),
    ],
)
def test_equal_to_scipy_in_every_bit(name, published):
    np.testing.assert_array_equal(getattr(dop853, name), published, strict=True)


def test_order_conditions_hold():
    """Quadrature conditions up to order 8, sum b c^(k-1) = 1/k, and row sums (Hairer, Norsett & Wanner, Sect. II.1, II.2)."""
    A, b, c = dop853.A[:S], dop853.A[S], dop853.C[:S]
    rounding = (
        40 * np.finfo(float).eps
    )  # twelve products of weights up to 6, twelve sums of stages up to 43
    for k in range(1, 9):
        assert abs(b @ c ** (k - 1) - 1 / k) < rounding
    assert np.all(np.abs(A.sum(axis=1) - c) < rounding)
    assert np.all(np.abs(dop853.A_EXTRA.sum(axis=1) - dop853.C_EXTRA) < rounding)
