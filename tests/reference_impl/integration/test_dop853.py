"""SciPy's table of DOP853, as it is read here, is that of a Runge-Kutta method of order 8."""

import numpy as np

from stiction.reference_impl.integration import dop853

S = dop853.STAGES


def test_order_conditions_hold():
    """Quadrature conditions up to order 8, sum b c^(k-1) = 1/k, and row sums (Hairer, Norsett & Wanner, Sect. II.1, II.2)."""
    A, b, c = dop853.A[:S], dop853.A[S], dop853.C[:S]
    rounding = 40 * np.finfo(float).eps  # twelve products of weights up to 6, twelve sums of stages up to 43
    for k in range(1, 9):
        assert abs(b @ c ** (k - 1) - 1 / k) < rounding
    assert np.all(np.abs(A.sum(axis=1) - c) < rounding)
    assert np.all(np.abs(dop853.A_EXTRA.sum(axis=1) - dop853.C_EXTRA) < rounding)
