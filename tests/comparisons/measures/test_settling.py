"""Transients that have died away, and motions that never repeat themselves."""

import numpy as np
import pytest

from stiction.comparisons.measures.settling import settled


@pytest.mark.parametrize("order, ratio", [(1, 0.5), (1, -0.7), (2, 0.6), (8, 0.3), (1, 0.95)])
def test_settled_bounds_the_rest_of_a_transient(order, ratio):
    k = np.arange(401)
    cycle = np.sin(1.0 + 2 * np.pi * (k % order) / order)
    x = cycle + 0.3 * np.sign(ratio) ** k * abs(ratio) ** (k / order)
    found = settled(x)
    assert found.order == order
    assert abs(x[-1] - cycle[-1]) <= found.distance * np.ptp(x) * (1 + 1e-6) + 1e-15


def test_slow_or_wandering_motions_are_not_settled():
    k = np.arange(401)
    assert settled(1 + 0.3 * 0.999**k) is None  # 0.2 away from its limit
    assert settled(np.sin(k * np.sqrt(2))) is None
    logistic = [0.3]
    for _ in range(400):
        logistic.append(4 * logistic[-1] * (1 - logistic[-1]))
    assert settled(np.array(logistic)) is None
